//! The controllers with the signs of their steps found by a general solver: as the VI (23) of two signs
//! and (24) of six.
//!
//! Each solve starts from the signs of the last tick. Where the step has one solution the control is
//! that of the exact one; where it has several, this is the one near the last signs.

use zivi_core::control::inclusion::{AsProblem, Inclusion};
use zivi_core::control::{
    ExplicitTwisting, ReferencePeriod, TwistingRegulator, TwistingTracker, Waypoint,
};
use zivi_core::{Physical, SettingError};

use crate::stepping::step_solver::SignSolver;
use crate::stepping::theta_gamma::Solver;

/// A controller and how its steps are solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solved<C> {
    /// The controller.
    pub controller: C,
    /// The solver.
    pub solver: Solver,
}

/// The general solver, `None` for the exact solution.
fn general<const N: usize>(solver: Solver, signs: [f64; N]) -> Option<SignSolver<N>> {
    let mut found = match solver {
        Solver::Exact => return None,
        Solver::Newton => SignSolver::newton(),
        Solver::Outer { linearisations } => SignSolver::outer(linearisations),
    };
    found.start_from(signs);
    Some(found)
}

impl Solved<TwistingRegulator> {
    /// [`TwistingRegulator::tick`].
    ///
    /// # Errors
    /// The same.
    pub fn tick(&mut self, measured: Physical, force: f64) -> Result<f64, SettingError> {
        let it = &mut self.controller;
        let Some(mut solver) = general(self.solver, it.state().signs) else {
            return it.tick(measured, force);
        };
        it.tick_by(measured, force, |inclusion| {
            let scales = inclusion.scales([1.0; 2]);
            solver.solve(&mut AsProblem(*inclusion), scales).then(|| solver.signs())
        })
    }
}

impl Solved<ExplicitTwisting> {
    /// [`ExplicitTwisting::tick`], whose signs are those of the sample.
    ///
    /// # Errors
    /// The same.
    pub fn tick(
        &mut self,
        measured: Physical,
        force: f64,
        force_ref: f64,
    ) -> Result<f64, SettingError> {
        self.controller.tick(measured, force, force_ref)
    }
}

impl Solved<TwistingTracker> {
    /// [`TwistingTracker::tick`].
    ///
    /// # Errors
    /// The same.
    pub fn tick(
        &mut self,
        measured: Physical,
        force: f64,
        force_ref: f64,
    ) -> Result<f64, SettingError> {
        if self.solver == Solver::Exact {
            return self.controller.tick(measured, force, force_ref);
        }
        self.ticked(measured, force, |it| Ok(it.own_period(force_ref)))
    }

    /// [`TwistingTracker::tick_to`].
    ///
    /// # Errors
    /// The same.
    pub fn tick_to(
        &mut self,
        measured: Physical,
        force: f64,
        [now, next]: [Waypoint; 2],
        acceleration: Option<f64>,
    ) -> Result<f64, SettingError> {
        if self.solver == Solver::Exact {
            return self.controller.tick_to(measured, force, now, next, acceleration);
        }
        self.ticked(measured, force, |it| {
            let of = (it.reference_step().restitution(), it.h());
            let course = ReferencePeriod::between(of, force, [now, next], acceleration)?;
            Ok(it.given_period(course))
        })
    }

    fn ticked(
        &mut self,
        measured: Physical,
        force: f64,
        course: impl FnOnce(&TwistingTracker) -> Result<ReferencePeriod, SettingError>,
    ) -> Result<f64, SettingError> {
        let it = &mut self.controller;
        let planned = it.plan(measured, force, course)?;
        let Some(mut solver) = general(self.solver, it.state().signs) else {
            return it.follow(&planned);
        };
        it.follow_by(&planned, |inclusion| {
            let scales = inclusion.scales([1.0; 6]);
            solver.solve(&mut AsProblem(*inclusion), scales).then(|| solver.signs())
        })
    }
}
