//! Trees of rigid bodies that hinges and slides join, with points of them as gaps.
//!
//! ```text
//! M(q) q'' = -b(q, q') - k (q - s) - c q' + tau + N^T lambda
//! ```
//!
//! Each joint has one coordinate and a frame whose third axis is its own; a rotation in space is three joints.
//! Coordinates, velocities and accelerations of bodies are followed from the root outwards, in axes of the world (`frame`);
//! forces and composite bodies are gathered inwards, which gives `b` (the recursive Newton-Euler
//! equations) and `M` (the composite rigid body algorithm). Gaps, dry friction and equality rows are in `gap`.

mod frame;
mod gap;

pub use frame::{Joint, JointKind};
pub use gap::TreeConstraint;
pub use gap::{TreeFriction, TreeGap};

use frame::change_chart;
use frame::{
    add, cross, dot, place, read, scaled, shift, sub, times, turned, turned_inertia, Frame,
    Symmetric, Vector,
};
use gap::EqualityRows;
use gap::{Row, SlipRow};

use crate::numeric::power_series::{DualNumber, Real};
use crate::system::dynamics::{Dynamics, Layout};
use crate::system::linear_system::GapMotion;
use crate::system::partials::{
    DifferentiableDynamics, DirectionalDerivative, StateDirection, TimedState,
};
use std::ops::Range;
use std::sync::Arc;

/// A tree: joints, gaps, dry friction, and their numbers: gravity (3), each joint, each gap, each
/// friction channel, each constraint.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    /// The joints.
    pub joints: Vec<Joint>,
    /// The gaps.
    pub gaps: Vec<TreeGap>,
    /// The channels of dry friction.
    pub friction: Vec<TreeFriction>,
    /// The constraints: each has equality rows.
    pub constraints: Vec<TreeConstraint>,
    /// Prescribed motion that is taken from the value of an equality row.
    pub drives: Vec<(usize, GapMotion)>,
    /// The numbers.
    pub numbers: Vec<f64>,
}

impl Tree {
    /// The same if its parts fit together.
    #[must_use]
    pub fn validated(self) -> Option<Self> {
        let n = self.joints.len();
        let grown = self.joints.iter().enumerate().all(|(i, it)| it.parent.is_none_or(|p| p < i));
        let turns = (0..n).all(|i| self.is_in_order(i));
        let known = |gap: &TreeGap| gap.joints().into_iter().flatten().all(|joint| joint < n);
        let rubs = |it: &TreeFriction| it.is_known(&self.joints, &self.gaps);
        let of_friction: usize = self.friction.iter().map(|it| it.numbers()).sum();
        let of_constraints: usize = self.constraints.iter().map(|it| it.numbers()).sum();
        let numbers = self.gap_numbers(self.gaps.len()).start + of_friction + of_constraints;
        let holds = |it: &TreeConstraint| it.joints().into_iter().flatten().all(|joint| joint < n);
        let rows = self.layout().k;
        let moves = self.drives.iter().all(|it| it.0 < rows);
        let fits = n > 0
            && moves
            && turns
            && self.constraints.iter().all(holds)
            && grown
            && self.gaps.iter().all(known)
            && self.numbers.len() == numbers;
        (fits && self.friction.iter().all(rubs)).then_some(self)
    }

    /// Whether the coordinates of a rotation follow each other.
    fn is_in_order(&self, i: usize) -> bool {
        let Joint { parent, kind } = self.joints[i];
        let of = |j: usize| self.joints.get(j).map(|it| it.kind);
        match kind {
            JointKind::Rotation(0) => of(i + 1) == Some(JointKind::Rotation(1)),
            JointKind::Rotation(1) => {
                parent == i.checked_sub(1) && of(i + 1) == Some(JointKind::Rotation(2))
            }
            JointKind::Rotation(2) => {
                parent.is_some_and(|p| p + 1 == i && of(p) == Some(JointKind::Rotation(1)))
            }
            JointKind::Rotation(_) => false,
            JointKind::Hinge | JointKind::Slide => true,
        }
    }

    fn joint_numbers(&self, joint: usize) -> Range<usize> {
        let start = 3 + joint * place::ALL;
        start..start + place::ALL
    }

    /// Range of the numbers of a gap; the range after the last gap starts at the end.
    fn gap_numbers(&self, gap: usize) -> Range<usize> {
        let before: usize = self.gaps[..gap].iter().map(|it| it.numbers()).sum();
        let start = 3 + self.joints.len() * place::ALL + before;
        start..start + self.gaps.get(gap).map_or(0, |it| it.numbers())
    }
}

// Forces and composite bodies, gathered from the leaves inwards.

/// A force and its moment about the origin of a frame.
#[derive(Clone, Copy, Debug)]
struct Wrench<T> {
    force: Vector<T>,
    moment: Vector<T>,
}

impl<T: Real> Wrench<T> {
    /// Its power for a unit speed of the joint.
    #[inline(always)]
    fn along(&self, joint: Joint, frame: &Frame<T>) -> T {
        let of = match joint.kind {
            JointKind::Slide => self.force,
            JointKind::Hinge | JointKind::Rotation(_) => self.moment,
        };
        dot(frame.axis(), of)
    }

    /// The same about the origin of the parent.
    #[inline(always)]
    fn carried(&self, arm: Vector<T>) -> Self {
        Self { force: self.force, moment: add(self.moment, cross(arm, self.force)) }
    }
}

/// Inertia moved by a joint: its own body, then its whole subtree.
#[derive(Clone, Copy, Debug)]
struct Load<T> {
    mass: T,
    /// The first moment about the origin of the frame.
    first: Vector<T>,
    /// The inertia about the origin.
    inertia: Symmetric<T>,
    /// Wrench for the motion without `q''`, gravity included.
    wrench: Wrench<T>,
}

impl<T: Real> Load<T> {
    /// That of the body of a joint.
    #[inline(always)]
    fn of(frame: &Frame<T>, numbers: &[T], gravity: Vector<T>) -> Self {
        let mass = numbers[place::MASS];
        let first = turned(&frame.axes, read(numbers, place::MOMENT));
        let (of, more) = (place::INERTIA, place::INERTIA + 3);
        let ([xx, yy, zz], [xy, xz, yz]) = (read(numbers, of), read(numbers, more));
        let inertia = turned_inertia(&frame.axes, &[xx, yy, zz, xy, xz, yz]);
        let Frame { omega, alpha, .. } = *frame;
        let fall = sub(frame.acceleration, gravity);
        let turning = add(cross(alpha, first), cross(omega, cross(omega, first)));
        let spinning = add(times(&inertia, alpha), cross(omega, times(&inertia, omega)));
        let wrench = Wrench {
            force: add(scaled(fall, mass), turning),
            moment: add(spinning, cross(first, fall)),
        };
        Self { mass, first, inertia, wrench }
    }

    /// The force of the joint that is needed, `b`.
    #[inline(always)]
    fn bias(&self, joint: Joint, frame: &Frame<T>) -> T {
        self.wrench.along(joint, frame)
    }

    /// Adds what a child carries.
    #[inline(always)]
    fn take(&mut self, child: &Self, arm: Vector<T>) {
        let moved = shift(child.mass, child.first, arm);
        self.mass = self.mass + child.mass;
        self.first = add(self.first, add(child.first, scaled(arm, child.mass)));
        for (own, (child, moved)) in self.inertia.iter_mut().zip(child.inertia.iter().zip(moved)) {
            *own = *own + (*child + moved);
        }
        let wrench = child.wrench.carried(arm);
        self.wrench = Wrench {
            force: add(self.wrench.force, wrench.force),
            moment: add(self.wrench.moment, wrench.moment),
        };
    }

    /// The momentum of all at a unit speed of the joint.
    #[inline(always)]
    fn momentum(&self, joint: Joint, axis: Vector<T>) -> Wrench<T> {
        match joint.kind {
            JointKind::Slide => {
                Wrench { force: scaled(axis, self.mass), moment: cross(self.first, axis) }
            }
            JointKind::Hinge | JointKind::Rotation(_) => {
                Wrench { force: cross(axis, self.first), moment: times(&self.inertia, axis) }
            }
        }
    }
}

/// Row and column of `M` of a joint: how its motion moves the joints that carry it.
#[inline(always)]
fn couple<T: Real>(
    i: usize,
    joints: &[Joint],
    frames: &[Frame<T>],
    load: &Load<T>,
    mass: &mut [T],
) {
    let n = joints.len();
    let mut momentum = load.momentum(joints[i], frames[i].axis());
    let mut at = i;
    loop {
        let entry = momentum.along(joints[at], &frames[at]);
        mass[i * n + at] = entry;
        mass[at * n + i] = entry;
        match joints[at].parent {
            Some(parent) => {
                momentum = momentum.carried(frames[at].arm);
                at = parent;
            }
            None => return,
        }
    }
}

// A tree as a model of a run, with its partial derivatives.

/// Kinematics of the bodies at a state.
#[derive(Clone, Debug, Default)]
struct Bodies<T> {
    frames: Vec<Frame<T>>,
    loads: Vec<Load<T>>,
}

/// A tree that is ready to be evaluated.
#[derive(Clone, Debug)]
pub struct TreeDynamics {
    tree: Arc<Tree>,
    /// Directions in which parameters move the numbers of the tree.
    directions: Arc<Vec<Vec<f64>>>,
    bodies: Bodies<f64>,
    moved: Bodies<DualNumber>,
}

impl TreeDynamics {
    /// For runs of this tree.
    #[must_use]
    pub fn new(tree: Arc<Tree>) -> Self {
        Self::with_directions(tree, Arc::new(Vec::new()))
    }

    /// The same, with the derivatives of the tree's numbers by each of its parameters.
    #[must_use]
    pub fn with_directions(tree: Arc<Tree>, directions: Arc<Vec<Vec<f64>>>) -> Self {
        Self {
            tree,
            directions,
            bodies: Bodies { frames: Vec::new(), loads: Vec::new() },
            moved: Bodies { frames: Vec::new(), loads: Vec::new() },
        }
    }

    /// The tree.
    #[must_use]
    pub fn tree(&self) -> &Arc<Tree> {
        &self.tree
    }
}

impl Tree {
    /// Coordinates, gaps and channels of friction.
    #[must_use]
    pub fn layout(&self) -> Layout {
        let k = self.constraints.iter().map(|it| it.rows()).sum();
        Layout { n: self.joints.len(), m: self.gaps.len(), p: self.friction.len(), k }
    }

    /// Fills in all numbers of an evaluation.
    #[inline(always)]
    fn fill<T: Real>(
        &self,
        numbers: &[T],
        (q, w): (&[T], &[T]),
        bodies: &mut Bodies<T>,
        out: &mut [T],
    ) {
        let layout = self.layout();
        self.follow(numbers, q, w, bodies);
        let (mass, rest) = out.split_at_mut(layout.n * layout.n);
        mass.fill(T::of(0.0));
        self.gather(numbers, (q, w), bodies, mass, &mut rest[..layout.n]);
        let known = (&self.joints[..], &bodies.frames[..]);
        self.fill_gaps(numbers, q, known, &mut out[layout.gap().start..]);
        if layout.p > 0 {
            self.fill_friction(numbers, known, out);
        }
        if layout.k > 0 {
            self.fill_constraints(numbers, (q, w), known, out);
        }
    }

    /// Equality rows, without what is prescribed.
    fn fill_constraints<T: Real>(
        &self,
        numbers: &[T],
        (q, w): (&[T], &[T]),
        known: (&[Joint], &[Frame<T>]),
        out: &mut [T],
    ) {
        let layout = self.layout();
        let of_friction: usize = self.friction.iter().map(|it| it.numbers()).sum();
        let mut start = self.gap_numbers(self.gaps.len()).start + of_friction;
        let (values, rest) = out[layout.equality().start..].split_at_mut(layout.k);
        let (gradients, rest) = rest.split_at_mut(layout.k * layout.n);
        let (curvatures, rates) = rest.split_at_mut(layout.k);
        rates.fill(T::of(0.0));
        let mut row = 0;
        for it in &self.constraints {
            let (own, count) = (&numbers[start..start + it.numbers()], it.rows());
            let rows = EqualityRows {
                values: &mut values[row..row + count],
                gradients: &mut gradients[row * layout.n..(row + count) * layout.n],
                curvatures: &mut curvatures[row..row + count],
            };
            it.fill(own, q, w, known, rows);
            (start, row) = (start + own.len(), row + count);
        }
    }

    /// Takes prescribed motion from the rows that were just filled in.
    fn drive(&self, t: f64, out: &mut [f64]) {
        let layout = self.layout();
        for (row, motion) in &self.drives {
            let [place, rate, acceleration] = motion.at(t);
            out[layout.equality().start + row] -= place;
            out[layout.equality_rate().start + row] -= rate;
            out[layout.equality_curvature().start + row] -= acceleration;
        }
    }

    /// Gaps, their gradients, curvatures and rates; `out` starts at the gaps.
    #[inline(always)]
    fn fill_gaps<T: Real>(
        &self,
        numbers: &[T],
        q: &[T],
        known: (&[Joint], &[Frame<T>]),
        out: &mut [T],
    ) {
        let layout = self.layout();
        let (gaps, rest) = out.split_at_mut(layout.m);
        let (gradients, rest) = rest.split_at_mut(layout.gradient().len());
        let (curvatures, rates) = rest.split_at_mut(layout.rows());
        rates[..layout.rows()].fill(T::of(0.0));
        let mut own = self.gap_numbers(0);
        for (i, it) in self.gaps.iter().enumerate() {
            let gradient = &mut gradients[i * layout.n..][..layout.n];
            let row = Row { gap: &mut gaps[i], gradient, curvature: &mut curvatures[i] };
            own = own.start..own.start + it.numbers();
            it.fill(&numbers[own.clone()], q, known, row);
            own.start = own.end;
        }
    }

    /// Directions of slip, their curvatures and the limits of friction.
    fn fill_friction<T: Real>(&self, numbers: &[T], known: (&[Joint], &[Frame<T>]), out: &mut [T]) {
        let layout = self.layout();
        let mut start = self.gap_numbers(self.gaps.len()).start;
        for (c, it) in self.friction.iter().enumerate() {
            let of_gap = match it {
                TreeFriction::Plane(gap)
                | TreeFriction::Tangent(gap)
                | TreeFriction::Between(gap, _) => &numbers[self.gap_numbers(*gap)],
                TreeFriction::Joint(_) => &[],
            };
            let row = layout.m + c;
            let (gradients, rest) = out.split_at_mut(layout.curvature().start);
            let (curvatures, rest) = rest.split_at_mut(layout.rows());
            let (limits, statics) = rest[layout.rows()..].split_at_mut(layout.p);
            let first = layout.gradient().start + row * layout.n;
            let slip = SlipRow {
                direction: &mut gradients[first..][..layout.n],
                curvature: &mut curvatures[row],
                limit: &mut limits[c],
                static_limit: &mut statics[c],
            };
            let own = &numbers[start..start + it.numbers()];
            it.fill((own, of_gap), &self.gaps, known, slip);
            start += it.numbers();
        }
    }

    /// Frames and bodies, from the root outwards.
    #[inline(always)]
    fn follow<T: Real>(&self, numbers: &[T], q: &[T], w: &[T], bodies: &mut Bodies<T>) {
        let (gravity, world) = (read(numbers, 0), Frame::world());
        bodies.frames.clear();
        bodies.loads.clear();
        for (i, joint) in self.joints.iter().enumerate() {
            let own = &numbers[self.joint_numbers(i)];
            let parent = joint.parent.map_or(&world, |parent| &bodies.frames[parent]);
            let frame = match joint.kind {
                JointKind::Rotation(k) => parent.next_in_rotation(k, own, (i, q, w)),
                _ => parent.next(*joint, own, q[i], w[i]),
            };
            bodies.loads.push(Load::of(&frame, own, gravity));
            bodies.frames.push(frame);
        }
    }

    /// `M` and `F`, inwards.
    #[inline(always)]
    fn gather<T: Real>(
        &self,
        numbers: &[T],
        (q, w): (&[T], &[T]),
        bodies: &mut Bodies<T>,
        mass: &mut [T],
        force: &mut [T],
    ) {
        let Bodies { frames, loads } = bodies;
        let n = self.joints.len();
        for (i, joint) in self.joints.iter().enumerate().rev() {
            let own = &numbers[self.joint_numbers(i)];
            let spring = own[place::STIFFNESS] * (q[i] - own[place::SPRING]);
            let passive = spring + own[place::DAMPING] * w[i];
            force[i] = own[place::TORQUE] - passive - loads[i].bias(*joint, &frames[i]);
            couple(i, &self.joints, frames, &loads[i], mass);
            mass[i * n + i] = mass[i * n + i] + own[place::ARMATURE];
            if let Some(parent) = joint.parent {
                let (before, from) = loads.split_at_mut(i);
                before[parent].take(&from[0], frames[i].arm);
            }
        }
    }
}

impl<E> Dynamics<E> for TreeDynamics {
    fn layout(&self) -> Layout {
        self.tree.layout()
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.tree.fill(&self.tree.numbers, (q, w), &mut self.bodies, out);
        self.tree.drive(t, out);
        Ok(())
    }

    fn evaluate_equalities(
        &mut self,
        t: f64,
        q: &[f64],
        w: &[f64],
        out: &mut [f64],
    ) -> Result<(), E> {
        let Self { tree, bodies, .. } = self;
        tree.follow(&tree.numbers, q, w, bodies);
        let known = (&tree.joints[..], &bodies.frames[..]);
        tree.fill_constraints(&tree.numbers, (q, w), known, out);
        tree.drive(t, out);
        Ok(())
    }

    fn has_separate_equalities(&self) -> bool {
        true
    }

    fn is_autonomous(&self) -> bool {
        self.tree.drives.is_empty()
    }

    fn change_charts(&self, far: f64, q: &mut [f64], w: &mut [f64]) -> bool {
        let mut is_changed = false;
        for (i, joint) in self.tree.joints.iter().enumerate() {
            if joint.kind == JointKind::Rotation(0) {
                is_changed |= change_chart(far, &mut q[i..i + 3], &mut w[i..i + 3]);
            }
        }
        is_changed
    }
}

/// The numbers of a tree with zero slopes, and their slopes with respect to each parameter.
#[derive(Debug)]
struct MovingTree {
    tree: Arc<Tree>,
    constants: Vec<DualNumber>,
    moved: Vec<Vec<DualNumber>>,
}

impl MovingTree {
    fn new(tree: Arc<Tree>, directions: &[Vec<f64>]) -> Self {
        let constants: Vec<DualNumber> =
            tree.numbers.iter().map(|&it| DualNumber::of(it)).collect();
        let along = |direction: &Vec<f64>| match direction.is_empty() {
            true => Vec::new(),
            false => moving(&tree.numbers, direction),
        };
        let moved = directions.iter().map(along).collect();
        Self { tree, constants, moved }
    }
}

/// Numbers that move at given rates.
fn moving(numbers: &[f64], rates: &[f64]) -> Vec<DualNumber> {
    numbers.iter().zip(rates).map(|(&value, &slope)| DualNumber { value, slope }).collect()
}

impl DirectionalDerivative for MovingTree {
    fn along(
        &self,
        (q, w): (&[f64], &[f64]),
        direction: StateDirection<'_>,
        (values, slopes): (&mut [f64], &mut [f64]),
    ) {
        let StateDirection { q: by_q, w: by_w, parameter } = direction;
        let (q, w) = (moving(q, by_q), moving(w, by_w));
        let numbers = parameter.map_or(&self.constants, |number| &self.moved[number]);
        let mut row = vec![DualNumber::of(0.0); values.len()];
        let mut bodies =
            Bodies { frames: Vec::with_capacity(q.len()), loads: Vec::with_capacity(q.len()) };
        self.tree.fill(numbers, (&q, &w), &mut bodies, &mut row);
        for (it, (value, slope)) in row.into_iter().zip(values.iter_mut().zip(slopes)) {
            (*value, *slope) = (it.value, it.slope);
        }
    }
}

impl<E> DifferentiableDynamics<E> for TreeDynamics {
    fn parameters(&self) -> usize {
        self.directions.len()
    }

    fn directional(&self) -> Option<Arc<dyn DirectionalDerivative>> {
        let moving = || MovingTree::new(self.tree.clone(), &self.directions);
        self.tree.drives.is_empty().then(|| Arc::new(moving()) as Arc<_>)
    }

    fn partials(&mut self, at: TimedState<'_>, by: &[usize], out: &mut [f64]) -> Result<(), E> {
        let constants =
            |of: &[f64]| of.iter().map(|&it| DualNumber::of(it)).collect::<Vec<DualNumber>>();
        let (layout, mut numbers) = (self.tree.layout(), constants(&self.tree.numbers));
        let (n, mut state) = (layout.n, [constants(at.q), constants(at.w)].concat());
        let mut row = vec![DualNumber::of(0.0); layout.len()];
        let (by_time, rest) = out.split_at_mut(layout.len());
        by_time.fill(0.0);
        for (c, out) in rest.chunks_exact_mut(layout.len()).enumerate() {
            let direction = c.checked_sub(2 * n).map(|k| &self.directions[by[k]]);
            match direction {
                None => state[c].slope = 1.0,
                Some(it) => numbers.iter_mut().zip(it).for_each(|(to, slope)| to.slope = *slope),
            }
            self.tree.fill(&numbers, state.split_at(n), &mut self.moved, &mut row);
            out.iter_mut().zip(&row).for_each(|(out, it)| *out = it.slope);
            match direction {
                None => state[c].slope = 0.0,
                Some(_) => numbers.iter_mut().for_each(|to| to.slope = 0.0),
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod dynamics_tests {
    use std::convert::Infallible;

    use super::{Joint, JointKind, TreeFriction, TreeGap, *};
    use crate::system::partials::{DifferencedDynamics, Neighbours, MOVES};

    /// A branched tree whose numbers are those of a generator.
    fn tree() -> Tree {
        let joint = |parent, kind| Joint { parent, kind };
        let joints = vec![
            joint(None, JointKind::Hinge),
            joint(Some(0), JointKind::Slide),
            joint(Some(1), JointKind::Hinge),
            joint(Some(0), JointKind::Hinge),
            joint(Some(1), JointKind::Rotation(0)),
            joint(Some(4), JointKind::Rotation(1)),
            joint(Some(5), JointKind::Rotation(2)),
        ];
        let gaps = vec![
            TreeGap::Lower(1),
            TreeGap::Plane(2),
            TreeGap::Upper(3),
            TreeGap::Balls(Some(2), Some(3)),
            TreeGap::Balls(None, Some(1)),
            TreeGap::Plane(6),
            TreeGap::Balls(Some(6), Some(3)),
        ];
        let mut seed = 7_u64;
        let mut number = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 33) as f64 / f64::from(1_u32 << 30) - 1.0
        };
        let friction = vec![
            TreeFriction::Plane(1),
            TreeFriction::Joint(3),
            TreeFriction::Tangent(5),
            TreeFriction::Between(6, 0),
            TreeFriction::Between(6, 1),
        ];
        let of_parts = 23 + 14 + 8 + 14 + 37;
        let numbers = (0..3 + 7 * place::ALL + of_parts).map(|_| number()).collect();
        let constraints = vec![
            TreeConstraint::Connect(Some(2), Some(3)),
            TreeConstraint::Weld(Some(2), None),
            TreeConstraint::Joint(1, Some(3)),
        ];
        let drives = vec![];
        Tree { joints, gaps, friction, constraints, drives, numbers }.validated().unwrap()
    }

    #[test]
    fn partial_derivatives_are_differences() {
        let tree = tree();
        let directions: Vec<Vec<f64>> = (0..2)
            .map(|k| (0..tree.numbers.len()).map(|i| ((i + k) as f64).cos()).collect())
            .collect();
        let step = 1e-3;
        let neighbours = directions.iter().map(|direction| {
            let systems = MOVES.map(|factor| {
                let moved = tree.numbers.iter().zip(direction).map(|(x, d)| x + factor * step * d);
                let numbers = moved.collect();
                TreeDynamics::new(Arc::new(Tree { numbers, ..tree.clone() }))
            });
            Neighbours { step, systems }
        });
        let tree = Arc::new(tree.clone());
        let plain = TreeDynamics::new(tree.clone());
        let mut differenced = DifferencedDynamics::new(plain, neighbours.collect(), 1.0);
        let mut exact = TreeDynamics::with_directions(tree.clone(), Arc::new(directions));
        let q = [0.3, -0.7, 1.1, 0.4, 0.2, -0.5, 0.3];
        let w = [0.9, -1.2, 0.5, 0.8, 0.7, 0.4, -0.6];
        let at = TimedState { t: 0.0, q: &q, w: &w };
        let size = tree.layout().len() * 17;
        let (mut found, mut known) = (vec![0.0; size], vec![0.0; size]);
        let Ok(()) =
            DifferentiableDynamics::<Infallible>::partials(&mut exact, at, &[1, 0], &mut found);
        let Ok(()) = DifferentiableDynamics::<Infallible>::partials(
            &mut differenced,
            at,
            &[1, 0],
            &mut known,
        );
        for (found, known) in found.iter().zip(&known) {
            assert!((found - known).abs() < 1e-10 * (1.0 + known.abs()), "{found} {known}");
        }
        assert!(found.iter().any(|it| it.abs() > 1.0));
        let length = tree.layout().len();
        let mut plain = vec![0.0; length];
        let Ok(()) = Dynamics::<Infallible>::evaluate(&mut exact, 0.0, &q, &w, &mut plain);
        let directional =
            DifferentiableDynamics::<Infallible>::directional(&exact).expect("trees have them");
        let (by_q, by_w) = ([0.3, -1.0, 0.2, 0.0, 1.1, 0.7, -0.4], [0.5; 7]);
        for (parameter, number) in [(None, None), (Some(0), Some(1)), (Some(1), Some(0))] {
            let (mut values, mut along) = (vec![0.0; length], vec![0.0; length]);
            let direction = StateDirection { q: &by_q, w: &by_w, parameter };
            directional.along((&q, &w), direction, (&mut values, &mut along));
            assert_eq!(values, plain);
            for (i, along) in along.into_iter().enumerate() {
                let column = |c: usize| found[(1 + c) * length + i];
                let of_state = by_q.iter().chain(&by_w).enumerate().map(|(c, by)| by * column(c));
                let sum = of_state.sum::<f64>() + number.map_or(0.0, |k: usize| column(14 + k));
                assert!((along - sum).abs() < 1e-12 * (1.0 + sum.abs()), "{along} {sum}");
            }
        }
    }
}
