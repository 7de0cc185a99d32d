//! Trees of rigid bodies that hinges and slides join, with points of them as gaps.
//!
//! ```text
//! M(q) q'' = -b(q, q') - k (q - s) - c q' + tau + N^T lambda
//! ```
//!
//! Each joint has one coordinate and a frame whose third axis is its own. Coordinates, velocities and
//! accelerations of bodies are followed from the root outwards, in axes of the world ([`motion`]);
//! forces and composite bodies are gathered inwards, which gives `b` (the recursive Newton-Euler
//! equations) and `M` (the composite rigid body algorithm, [`gather`]).

use crate::numeric::power_series::{Dual, Real};
use crate::system::dynamics::{Dynamics, Layout};
use crate::system::partials::{DifferentiableDynamics, TimedState};
use std::ops::Range;
use std::sync::Arc;

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// About its axis, by an angle (rad).
    Hinge,
    /// Along its axis (m).
    Slide,
}

/// A joint and what it moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Joint {
    /// The joint that moves it, with a smaller number; none for the world.
    pub parent: Option<usize>,
    /// How it moves.
    pub kind: JointKind,
}

/// A gap of a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TreeGap {
    /// `q_j - bound`: one number.
    Lower(usize),
    /// `bound - q_j`: one number.
    Upper(usize),
    /// `n.p - c` of a point of a body: `p` in the frame of the joint, `n`, `c`.
    Plane(usize),
    /// `|p_a - p_b| - c` of points of two bodies, the world if none: `p_a`, `p_b`, `c`.
    Balls(Option<usize>, Option<usize>),
}

impl TreeGap {
    fn numbers(self) -> usize {
        match self {
            Self::Lower(_) | Self::Upper(_) => 1,
            Self::Plane(_) | Self::Balls(..) => 7,
        }
    }

    fn joints(self) -> [Option<usize>; 2] {
        match self {
            Self::Lower(j) | Self::Upper(j) | Self::Plane(j) => [Some(j), None],
            Self::Balls(a, b) => [a, b],
        }
    }
}

/// Where the numbers of a joint lie, from the first of them on.
mod place {
    /// The origin of its frame in that of the parent.
    pub(super) const POSITION: usize = 0;
    /// The columns of its axes in those of the parent.
    pub(super) const AXES: usize = 3;
    /// Of what it moves: the mass,
    pub(super) const MASS: usize = 12;
    /// the first moment,
    pub(super) const MOMENT: usize = 13;
    /// the inertia about the origin: `xx, yy, zz, xy, xz, yz`.
    pub(super) const INERTIA: usize = 16;
    /// `k`, `s`, `c`, what is added to the diagonal of `M`, `tau`.
    pub(super) const STIFFNESS: usize = 22;
    pub(super) const SPRING: usize = 23;
    pub(super) const DAMPING: usize = 24;
    pub(super) const ARMATURE: usize = 25;
    pub(super) const TORQUE: usize = 26;
    /// The coordinate at which the frame is where position and axes say.
    pub(super) const REFERENCE: usize = 27;
    /// How many there are.
    pub(super) const ALL: usize = 28;
}

/// A tree: joints, gaps, and their numbers, those of gravity (3) first, then of each joint, then of
/// each gap.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    /// The joints.
    pub joints: Vec<Joint>,
    /// The gaps.
    pub gaps: Vec<TreeGap>,
    /// The numbers.
    pub numbers: Vec<f64>,
}

impl Tree {
    /// The same if its parts fit together.
    #[must_use]
    pub fn validated(self) -> Option<Self> {
        let n = self.joints.len();
        let grown = self.joints.iter().enumerate().all(|(i, it)| it.parent.is_none_or(|p| p < i));
        let known = |gap: &TreeGap| gap.joints().into_iter().flatten().all(|joint| joint < n);
        let numbers = self.gap_numbers(self.gaps.len()).start;
        let fits = n > 0 && grown && self.gaps.iter().all(known) && self.numbers.len() == numbers;
        fits.then_some(self)
    }

    fn joint_numbers(&self, joint: usize) -> Range<usize> {
        let start = 3 + joint * place::ALL;
        start..start + place::ALL
    }

    /// Where the numbers of a gap lie; those of the one behind the last start at the end.
    fn gap_numbers(&self, gap: usize) -> Range<usize> {
        let before: usize = self.gaps[..gap].iter().map(|it| it.numbers()).sum();
        let start = 3 + self.joints.len() * place::ALL + before;
        start..start + self.gaps.get(gap).map_or(0, |it| it.numbers())
    }
}

// Vectors in space and symmetric matrices.

/// A vector.
type Vector<T> = [T; 3];
/// Columns of a matrix.
type Columns<T> = [Vector<T>; 3];
/// A symmetric matrix: `xx, yy, zz, xy, xz, yz`.
type Symmetric<T> = [T; 6];

#[inline(always)]
fn zero<T: Real>() -> Vector<T> {
    [T::of(0.0); 3]
}

#[inline(always)]
fn add<T: Real>(a: Vector<T>, b: Vector<T>) -> Vector<T> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
fn sub<T: Real>(a: Vector<T>, b: Vector<T>) -> Vector<T> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn scaled<T: Real>(a: Vector<T>, s: T) -> Vector<T> {
    [a[0] * s, a[1] * s, a[2] * s]
}

#[inline(always)]
fn dot<T: Real>(a: Vector<T>, b: Vector<T>) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross<T: Real>(a: Vector<T>, b: Vector<T>) -> Vector<T> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The three numbers that start here.
#[inline(always)]
fn read<T: Real>(numbers: &[T], start: usize) -> Vector<T> {
    [numbers[start], numbers[start + 1], numbers[start + 2]]
}

/// `R x`.
#[inline(always)]
fn turned<T: Real>(r: &Columns<T>, x: Vector<T>) -> Vector<T> {
    add(add(scaled(r[0], x[0]), scaled(r[1], x[1])), scaled(r[2], x[2]))
}

/// `S x`.
#[inline(always)]
fn times<T: Real>(s: &Symmetric<T>, x: Vector<T>) -> Vector<T> {
    [
        s[0] * x[0] + s[3] * x[1] + s[4] * x[2],
        s[3] * x[0] + s[1] * x[1] + s[5] * x[2],
        s[4] * x[0] + s[5] * x[1] + s[2] * x[2],
    ]
}

/// `R S R^T`.
#[inline(always)]
fn turned_inertia<T: Real>(r: &Columns<T>, s: &Symmetric<T>) -> Symmetric<T> {
    let rows = [[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]];
    let half: Columns<T> = rows.map(|row| turned(r, row));
    let entry =
        |i: usize, j: usize| half[0][i] * r[0][j] + half[1][i] * r[1][j] + half[2][i] * r[2][j];
    [entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(0, 2), entry(1, 2)]
}

/// What a mass `m` with the first moment `h` adds to its inertia about a point `-d` from its own:
/// `(2 h.d + m d^2) 1 - h d^T - d h^T - m d d^T`.
#[inline(always)]
fn shift<T: Real>(m: T, h: Vector<T>, d: Vector<T>) -> Symmetric<T> {
    // with e = h + m d: e.d + h.d on the diagonal, less h d^T + d e^T
    let e = add(h, scaled(d, m));
    let both = dot(e, d) + dot(h, d);
    let product = |i: usize, j: usize| h[i] * d[j] + d[i] * e[j];
    [
        both - product(0, 0),
        both - product(1, 1),
        both - product(2, 2),
        -product(0, 1),
        -product(0, 2),
        -product(1, 2),
    ]
}

// How the frames of the joints move, from the root outwards.

/// The frame of a joint, in axes of the world; accelerations are those without `q''` and gravity.
#[derive(Clone, Copy, Debug)]
struct Frame<T> {
    /// Its axes.
    axes: Columns<T>,
    /// Its origin.
    origin: Vector<T>,
    /// The origin less that of the parent.
    arm: Vector<T>,
    omega: Vector<T>,
    velocity: Vector<T>,
    alpha: Vector<T>,
    acceleration: Vector<T>,
}

impl<T: Real> Frame<T> {
    /// That of the world.
    fn world() -> Self {
        let (one, zero) = (T::of(1.0), zero());
        let [mut x, mut y, mut z] = [zero; 3];
        (x[0], y[1], z[2]) = (one, one, one);
        Self {
            axes: [x, y, z],
            origin: zero,
            arm: zero,
            omega: zero,
            velocity: zero,
            alpha: zero,
            acceleration: zero,
        }
    }

    /// The axis of the joint.
    #[inline(always)]
    fn axis(&self) -> Vector<T> {
        self.axes[2]
    }

    /// `omega x r`.
    #[inline(always)]
    fn velocity_at(&self, arm: Vector<T>) -> Vector<T> {
        add(self.velocity, cross(self.omega, arm))
    }

    /// `a + alpha x r + omega x (omega x r)`.
    #[inline(always)]
    fn acceleration_at(&self, arm: Vector<T>) -> Vector<T> {
        let turning = add(cross(self.alpha, arm), cross(self.omega, cross(self.omega, arm)));
        add(self.acceleration, turning)
    }

    /// The frame of a joint on this one.
    #[inline(always)]
    fn next(&self, joint: Joint, numbers: &[T], q: T, w: T) -> Self {
        let axis_of = |k: usize| turned(&self.axes, read(numbers, place::AXES + 3 * k));
        let [x, y, axis] = [axis_of(0), axis_of(1), axis_of(2)];
        let mut arm = turned(&self.axes, read(numbers, place::POSITION));
        let moved = q - numbers[place::REFERENCE];
        let swept = cross(self.omega, scaled(axis, w));
        match joint.kind {
            JointKind::Hinge => {
                let (sin, cos) = moved.sin_cos();
                Self {
                    axes: [
                        add(scaled(x, cos), scaled(y, sin)),
                        add(scaled(y, cos), scaled(x, -sin)),
                        axis,
                    ],
                    origin: add(self.origin, arm),
                    arm,
                    omega: add(self.omega, scaled(axis, w)),
                    velocity: self.velocity_at(arm),
                    alpha: add(self.alpha, swept),
                    acceleration: self.acceleration_at(arm),
                }
            }
            JointKind::Slide => {
                arm = add(arm, scaled(axis, moved));
                Self {
                    axes: [x, y, axis],
                    origin: add(self.origin, arm),
                    arm,
                    omega: self.omega,
                    velocity: add(self.velocity_at(arm), scaled(axis, w)),
                    alpha: self.alpha,
                    acceleration: add(self.acceleration_at(arm), add(swept, swept)),
                }
            }
        }
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
            JointKind::Hinge => self.moment,
            JointKind::Slide => self.force,
        };
        dot(frame.axis(), of)
    }

    /// The same about the origin of the parent.
    #[inline(always)]
    fn carried(&self, arm: Vector<T>) -> Self {
        Self { force: self.force, moment: add(self.moment, cross(arm, self.force)) }
    }
}

/// What a joint moves, its own body first, then all that it carries too.
#[derive(Clone, Copy, Debug)]
struct Load<T> {
    mass: T,
    /// The first moment about the origin of the frame.
    first: Vector<T>,
    /// The inertia about the origin.
    inertia: Symmetric<T>,
    /// What moves it as it moves without `q''`, against gravity.
    wrench: Wrench<T>,
}

impl<T: Real> Load<T> {
    /// That of the body of a joint.
    #[inline(always)]
    fn of(frame: &Frame<T>, numbers: &[T], gravity: Vector<T>) -> Self {
        let mass = numbers[place::MASS];
        let first = turned(&frame.axes, read(numbers, place::MOMENT));
        let own: Symmetric<T> = std::array::from_fn(|k| numbers[place::INERTIA + k]);
        let inertia = turned_inertia(&frame.axes, &own);
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
        self.inertia = std::array::from_fn(|k| self.inertia[k] + (child.inertia[k] + moved[k]));
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
            JointKind::Hinge => {
                Wrench { force: cross(axis, self.first), moment: times(&self.inertia, axis) }
            }
            JointKind::Slide => {
                Wrench { force: scaled(axis, self.mass), moment: cross(self.first, axis) }
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

// Gaps between points of a tree.

/// The places in an evaluation that belong to one gap.
struct Row<'a, T> {
    gap: &'a mut T,
    gradient: &'a mut [T],
    curvature: &'a mut T,
}

/// A point of a body, with its velocity, and its acceleration without `q''`.
struct Point<T> {
    joint: Option<usize>,
    at: Vector<T>,
    velocity: Vector<T>,
    acceleration: Vector<T>,
}

impl<T: Real> Point<T> {
    #[inline(always)]
    fn of(joint: Option<usize>, own: Vector<T>, frames: &[Frame<T>]) -> Self {
        let Some(index) = joint else {
            let still = [T::of(0.0); 3];
            return Self { joint, at: own, velocity: still, acceleration: still };
        };
        let frame = &frames[index];
        let arm = turned(&frame.axes, own);
        Self {
            joint,
            at: add(frame.origin, arm),
            velocity: frame.velocity_at(arm),
            acceleration: frame.acceleration_at(arm),
        }
    }

    /// Adds how the point moves along `n` with each coordinate.
    #[inline(always)]
    fn pull(&self, n: Vector<T>, joints: &[Joint], frames: &[Frame<T>], out: &mut [T]) {
        let mut at = self.joint;
        while let Some(index) = at {
            let frame = &frames[index];
            let moved = match joints[index].kind {
                JointKind::Hinge => cross(frame.axis(), sub(self.at, frame.origin)),
                JointKind::Slide => frame.axis(),
            };
            out[index] = out[index] + dot(n, moved);
            at = joints[index].parent;
        }
    }
}

impl TreeGap {
    /// Writes the gap, its gradient and its curvature; `numbers` are its own.
    #[inline(always)]
    fn fill<T: Real>(
        self,
        numbers: &[T],
        q: &[T],
        (joints, frames): (&[Joint], &[Frame<T>]),
        row: Row<'_, T>,
    ) {
        row.gradient.fill(T::of(0.0));
        match self {
            Self::Lower(joint) => {
                *row.gap = q[joint] - numbers[0];
                row.gradient[joint] = T::of(1.0);
                *row.curvature = T::of(0.0);
            }
            Self::Upper(joint) => {
                *row.gap = numbers[0] - q[joint];
                row.gradient[joint] = T::of(-1.0);
                *row.curvature = T::of(0.0);
            }
            Self::Plane(joint) => {
                let (point, n) =
                    (Point::of(Some(joint), read(numbers, 0), frames), read(numbers, 3));
                *row.gap = dot(n, point.at) - numbers[6];
                point.pull(n, joints, frames, row.gradient);
                *row.curvature = dot(n, point.acceleration);
            }
            Self::Balls(a, b) => {
                let a = Point::of(a, read(numbers, 0), frames);
                let b = Point::of(b, read(numbers, 3), frames);
                // l'' = u.s'' + (|s'|^2 - (u.s')^2)/l  with s = p_a - p_b, l = |s|, u = s/l
                let [s, rate] = [sub(a.at, b.at), sub(a.velocity, b.velocity)];
                let distance = dot(s, s).sqrt();
                let u = scaled(s, distance.inverse());
                *row.gap = distance - numbers[6];
                a.pull(u, joints, frames, row.gradient);
                b.pull(scaled(u, T::of(-1.0)), joints, frames, row.gradient);
                let closing = dot(u, rate);
                let swing = (dot(rate, rate) - closing * closing) * distance.inverse();
                *row.curvature = dot(u, sub(a.acceleration, b.acceleration)) + swing;
            }
        }
    }
}

// A tree as a model of a run, with its partial derivatives.

/// What is known of the bodies at a state.
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
    moved: Bodies<Dual>,
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
    /// Coordinates and gaps.
    #[must_use]
    pub fn layout(&self) -> Layout {
        Layout::smooth(self.joints.len(), self.gaps.len())
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
        let (gap, gradient, curvature) = (layout.gap(), layout.gradient(), layout.curvature());
        let (gaps, rest) = out[gap.start..].split_at_mut(gap.len());
        let (gradients, rest) = rest.split_at_mut(gradient.len());
        let (curvatures, rates) = rest.split_at_mut(curvature.len());
        rates.fill(T::of(0.0));
        let known = (&self.joints[..], &bodies.frames[..]);
        let mut own = self.gap_numbers(0);
        for (i, it) in self.gaps.iter().enumerate() {
            let gradient = &mut gradients[i * layout.n..][..layout.n];
            let row = Row { gap: &mut gaps[i], gradient, curvature: &mut curvatures[i] };
            own = own.start..own.start + it.numbers();
            it.fill(&numbers[own.clone()], q, known, row);
            own.start = own.end;
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
            let frame = parent.next(*joint, own, q[i], w[i]);
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

    fn evaluate(&mut self, _: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.tree.fill(&self.tree.numbers, (q, w), &mut self.bodies, out);
        Ok(())
    }
}

impl<E> DifferentiableDynamics<E> for TreeDynamics {
    fn parameters(&self) -> usize {
        self.directions.len()
    }

    fn partials(&mut self, at: TimedState<'_>, by: &[usize], out: &mut [f64]) -> Result<(), E> {
        let constants = |of: &[f64]| of.iter().map(|&it| Dual::of(it)).collect::<Vec<Dual>>();
        let (layout, mut numbers) = (self.tree.layout(), constants(&self.tree.numbers));
        let (n, mut state) = (layout.n, [constants(at.q), constants(at.w)].concat());
        let mut row = vec![Dual::of(0.0); layout.len()];
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

    use super::{Joint, JointKind, TreeGap, *};
    use crate::system::partials::{DifferencedDynamics, Neighbours, MOVES};

    /// A branched tree whose numbers are those of a generator.
    fn tree() -> Tree {
        let joint = |parent, kind| Joint { parent, kind };
        let joints = vec![
            joint(None, JointKind::Hinge),
            joint(Some(0), JointKind::Slide),
            joint(Some(1), JointKind::Hinge),
            joint(Some(0), JointKind::Hinge),
        ];
        let gaps = vec![
            TreeGap::Lower(1),
            TreeGap::Plane(2),
            TreeGap::Upper(3),
            TreeGap::Balls(Some(2), Some(3)),
            TreeGap::Balls(None, Some(1)),
        ];
        let mut seed = 7_u64;
        let mut number = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 33) as f64 / f64::from(1_u32 << 30) - 1.0
        };
        let numbers = (0..3 + 4 * place::ALL + 23).map(|_| number()).collect();
        Tree { joints, gaps, numbers }.validated().unwrap()
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
        let (q, w) = ([0.3, -0.7, 1.1, 0.4], [0.9, -1.2, 0.5, 0.8]);
        let at = TimedState { t: 0.0, q: &q, w: &w };
        let size = tree.layout().len() * 11;
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
            assert!((found - known).abs() < 1e-10, "{found} {known}");
        }
        assert!(found.iter().any(|it| it.abs() > 1.0));
    }
}
