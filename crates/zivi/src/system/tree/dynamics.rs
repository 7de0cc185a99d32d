//! A tree as a model of a run, with its partial derivatives.

use std::sync::Arc;

use super::gap::Row;
use super::gather::{couple, Load};
use super::motion::Frame;
use super::vector::read;
use super::{place, Tree};
use crate::numeric::real::{Dual, Real};
use crate::system::dynamics::{Dynamics, Layout};
use crate::system::partials::{DifferentiableDynamics, TimedState};

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
mod tests {
    use std::convert::Infallible;

    use super::super::{Joint, JointKind, TreeGap};
    use super::*;
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
