//! The variational columns of a mechanical system, in the Runge-Kutta steps of the motion.
//!
//! A column holds the derivatives of coordinates and gaps, and those of their rates, at a fixed
//! time. The gaps are carried along as in the motion itself: the shift of an impact is the ratio of
//! a small derivative to a small speed.

use super::local::{Direction, Local};
use crate::mechanics::equation::{Stages, State};
use crate::mechanics::kinetics::Model;
use crate::numeric::stages::Equation;
use crate::numeric::step_error::{worse, Tolerances};
use crate::numeric::tableau::{Estimate, Interpolant};
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::system::dynamics::Layout;
use crate::system::partials::DifferentiableDynamics;

/// What a column is the derivative by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MechanicalWrt {
    /// An initial coordinate.
    Q0(usize),
    /// An initial velocity.
    Qdot0(usize),
    /// The time of the initial state.
    T0,
    /// The first parameter of the impact laws of all gaps together, of Newton's the coefficient of
    /// restitution.
    AllE,
    /// A parameter of the impact law of a gap, by its number.
    Law {
        /// The gap.
        gap: usize,
        /// The parameter.
        parameter: usize,
    },
    /// A parameter of the system, by its number.
    Parameter(usize),
}

impl MechanicalWrt {
    /// What the law of a gap has by it: a derivative by a parameter of the law, or none.
    pub(super) fn of_law(self, of: usize, by: impl Fn(usize) -> f64) -> f64 {
        match self {
            Self::AllE => by(0),
            Self::Law { gap, parameter } if gap == of => by(parameter),
            _ => 0.0,
        }
    }
}

/// The columns under way.
#[derive(Clone, Debug)]
pub(super) struct Columns {
    pub(super) wrt: Vec<MechanicalWrt>,
    /// Which of the parameters of `local` a column is by.
    pub(super) parameter: Vec<Option<usize>>,
    pub(super) layout: Layout,
    pub(super) local: Local,
    /// All columns, one after the other, and the last step of them.
    pub(super) now: State,
    pub(super) steps: Stages,
    /// The contacts in the last step, and how many of its stages are known.
    pub(super) closed: GapSet,
    known: usize,
    /// Where the system was last evaluated, if that is known.
    pub(super) visited: Option<Place>,
}

/// A time, the contacts, and between which times the system is smooth.
type Place = (f64, GapSet, (f64, f64));

/// The variational equations along the stages of a step of the motion: with `J` the Jacobian at
/// each of them the columns are the exact derivative of the step that was made.
struct Variation<'r, 'm, D> {
    motion: &'r Stages,
    closed: GapSet,
    parameter: &'r [Option<usize>],
    layout: Layout,
    local: &'r mut Local,
    known: &'r mut usize,
    model: &'r mut Model<'m, D>,
}

impl<E, D: DifferentiableDynamics<E>> Equation<Vec<f64>, Failure<E>> for Variation<'_, '_, D> {
    fn acceleration(&mut self, at: &State, into: &mut Vec<f64>) -> Result<(), Failure<E>> {
        let (motion, i, n) = (self.motion, *self.known, self.layout.n);
        let last = motion.pair.b.len();
        let node = match motion.pair.interpolant {
            _ if i == last => motion.end.clone(),
            Interpolant::Nested { a, .. } if i > last => motion.node(i, &a[i - last - 1]),
            _ => motion.node(i, &motion.pair.a[i - 1]),
        };
        self.local.visit(self.model, node.t, &node.x[..n], &node.xdot[..n])?;
        self.local.kinetics.determined_contact(self.closed)?;
        *self.known += 1;
        accelerations(self.local, (self.layout, self.parameter), self.closed, at, into)
    }
}

impl Columns {
    pub(super) fn new(
        wrt: &[MechanicalWrt],
        layout: Layout,
        pair: &'static crate::numeric::tableau::Pair,
    ) -> Self {
        let mut by = Vec::new();
        let mut place = |wrt: &MechanicalWrt| match wrt {
            MechanicalWrt::Parameter(number) => {
                by.push(*number);
                Some(by.len() - 1)
            }
            _ => None,
        };
        let parameter = wrt.iter().map(&mut place).collect();
        let entries = wrt.len() * (layout.n + layout.m);
        Self {
            wrt: wrt.to_vec(),
            parameter,
            layout,
            local: Local::new(layout, by),
            now: State::zeros(entries),
            steps: Stages::new(pair, entries),
            closed: GapSet::EMPTY,
            known: 0,
            visited: None,
        }
    }

    /// Coordinates and gaps: the length of a column.
    pub(super) fn size(&self) -> usize {
        self.layout.n + self.layout.m
    }

    /// Evaluates the system at a state with some contacts.
    pub(super) fn visit<E, D: DifferentiableDynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        at: &State,
        closed: GapSet,
    ) -> Result<(), Failure<E>> {
        let n = self.layout.n;
        self.local.visit(model, at.t, &at.x[..n], &at.xdot[..n])?;
        self.local.kinetics.determined_contact(closed)?;
        self.visited = Some((at.t, closed, model.smooth.ends()));
        Ok(())
    }

    /// The equations along a step of the motion, and the step of the columns.
    fn along<'r, 'm, D>(
        &'r mut self,
        motion: &'r Stages,
        model: &'r mut Model<'m, D>,
    ) -> (Variation<'r, 'm, D>, &'r mut Stages) {
        let Self { steps, closed, parameter, layout, local, known, visited, .. } = self;
        *visited = None;
        let (closed, layout) = (*closed, *layout);
        (Variation { motion, closed, parameter, layout, local, known, model }, steps)
    }

    /// From `self.now` through a step of the motion with these contacts, to `self.steps.end`.
    pub(super) fn advance<E, D: DifferentiableDynamics<E>>(
        &mut self,
        motion: &Stages,
        closed: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        if self.visited != Some((motion.from.t, closed, model.smooth.ends())) {
            self.visit(model, &motion.from, closed)?;
        }
        (self.now.t, self.now.late) = (motion.from.t, motion.from.late);
        let mut slope = vec![0.0; self.now.x.len()];
        let (of, now) = ((self.layout, &self.parameter[..]), &self.now);
        accelerations(&mut self.local, of, closed, now, &mut slope)?;
        (self.closed, self.known) = (closed, 1);
        let from = self.now.clone();
        let (mut equation, steps) = self.along(motion, model);
        steps.step(&from, &slope, motion.h, &mut equation)
    }

    /// All stages of the dense output. The motion has its own.
    pub(super) fn complete<E, D: DifferentiableDynamics<E>>(
        &mut self,
        motion: &Stages,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (mut equation, steps) = self.along(motion, model);
        steps.complete(&mut equation)
    }

    /// The largest error relative to `atol/size + rtol |entry|`, `sizes` being the magnitudes of
    /// what the columns are derivatives by; of those that are not lost.
    pub(super) fn error<E, D: DifferentiableDynamics<E>>(
        &mut self,
        motion: &Stages,
        tolerances: &Tolerances,
        (sizes, lost): (&[f64], &[bool]),
        model: &mut Model<'_, D>,
    ) -> Result<f64, Failure<E>> {
        if let Estimate::Single(_) = motion.pair.estimate {
            let (mut equation, steps) = self.along(motion, model);
            steps.finish(&mut equation)?;
        }
        let (size, steps) = (self.size(), &self.steps);
        let mut worst = 0.0_f64;
        for entry in (0..self.now.x.len()).filter(|entry| !lost[entry / size]) {
            let atol = tolerances.atol.map(|atol| atol / sizes[entry / size]);
            let scales = steps.scales(entry, &Tolerances { atol, ..*tolerances });
            worst = worse(steps.error_of(entry).norm(scales), worst);
        }
        Ok(worst)
    }

    /// Takes the last step, up to a time `delta` after its end that is short beside it.
    pub(super) fn take<E, D: DifferentiableDynamics<E>>(
        &mut self,
        motion: &Stages,
        delta: f64,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        if delta != 0.0 {
            let (mut equation, steps) = self.along(motion, model);
            steps.finish(&mut equation)?;
        }
        self.now.copy_from(&self.steps.end);
        if delta != 0.0 {
            for entry in 0..self.now.x.len() {
                let slope = self.steps.end_slope(entry);
                self.now.x[entry] += delta * (self.now.xdot[entry] + 0.5 * delta * slope);
                self.now.xdot[entry] += delta * slope;
            }
        }
        Ok(())
    }

    /// Moves the columns into the manifold of the contacts, at a state where the system has just
    /// been evaluated.
    pub(super) fn project<E>(&mut self, closed: GapSet, at: &State) -> Result<(), Failure<E>> {
        let Layout { n, .. } = self.layout;
        let size = self.size();
        for (column, parameter) in self.parameter.iter().enumerate() {
            let x = &mut self.now.x[column * size..][..size];
            let v = &mut self.now.xdot[column * size..][..size];
            self.local.project(closed, &at.xdot[..n], *parameter, (&mut x[..n], &mut v[..n]))?;
            for i in closed.iter() {
                (x[n + i], v[n + i]) = (0.0, 0.0);
            }
        }
        Ok(())
    }
}

/// The accelerations of the columns, where the system has just been evaluated.
fn accelerations<E>(
    local: &mut Local,
    (layout, parameter): (Layout, &[Option<usize>]),
    closed: GapSet,
    at: &State,
    out: &mut [f64],
) -> Result<(), Failure<E>> {
    let (n, size) = (layout.n, layout.n + layout.m);
    for (column, parameter) in parameter.iter().enumerate() {
        let (q, w) = (&at.x[column * size..][..n], &at.xdot[column * size..][..n]);
        let row = local.along(Direction { t: 0.0, q, w, parameter: *parameter });
        let (change, _) = local.acceleration(closed, &row)?;
        out[column * size..][..size].copy_from_slice(&change);
    }
    Ok(())
}
