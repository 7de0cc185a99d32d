//! The theta-gamma method over a grid: the paper's scheme for any force.
//!
//! The force is taken at `t + theta h` and, when it depends on the state, at the state there:
//!
//! ```text
//! f = f(t + theta h, |s_theta|, R lambda_s v_theta)      z_theta = theta z+ + (1 - theta) z
//! ```

use zivi_core::setting::{Setting, Value, Values};
use zivi_core::{Lifted, Physical, Restitution, StepSolution, ThetaGammaStep};

use crate::record::columns::Sample;
use crate::record::status::Failure;
use crate::record::trajectory::Values as ReferencePoint;
use crate::record::trajectory::{checked_count, Run, SetupError};
use crate::stepping::fixed_step::{run, FixedStep, Scheme, Start};
use crate::stepping::implicit::ImplicitForce;
use crate::stepping::step_solver::{Exact, General, StepSolver};
use crate::{Dependence, Force, Grid, Monitor};

/// Settings of the method; the step size is the grid's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThetaGamma {
    /// Weight of the new velocity, in `(0, 1]`.
    pub theta: f64,
    /// Where the signs are taken, in `(0, 1]`.
    pub gamma: f64,
    /// How the signs are found.
    pub solver: Solver,
}

/// How the signs of a step are found (see [`crate::stepping::step_solver`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Solver {
    /// The exact case analysis.
    #[default]
    Exact,
    /// The general VI solver ("inner linearisation").
    Newton,
    /// Repeated affine VIs without a merit function ("outer linearisation").
    Outer {
        /// Maximal number per step, from 1 to 1000.
        linearisations: usize,
    },
}

impl Solver {
    /// Which solver.
    pub const SETTING: Setting = Setting {
        name: "solver",
        meaning: "how the signs are found",
        unit: "",
        values: Values::Choice(&[
            Value::Name("exact"),
            Value::Name("newton"),
            Value::Name("outer"),
        ]),
        range: "one of exact, newton, outer",
        default: Value::Name("exact"),
    };
    /// The linearisations that a step may take.
    pub const LINEARISATIONS: Setting = Setting {
        name: "linearisations",
        meaning: "for solver outer: at most so many",
        unit: "1",
        values: Values::Counts(1, 1000),
        range: "from 1 to 1000",
        default: Value::Count(20),
    };

    /// Rejects a number of linearisations out of range.
    ///
    /// # Errors
    /// [`SetupError::Count`].
    pub fn check(self) -> Result<(), SetupError> {
        match self {
            Solver::Outer { linearisations } => {
                checked_count(&Self::LINEARISATIONS, linearisations)
            }
            _ => Ok(()),
        }
    }

    /// The solver of a name; `linearisations` matter to one of them.
    #[must_use]
    pub fn named(name: &str, linearisations: usize) -> Option<Self> {
        match name {
            "exact" => Some(Solver::Exact),
            "newton" => Some(Solver::Newton),
            "outer" => Some(Solver::Outer { linearisations }),
            _ => None,
        }
    }
}

impl ThetaGamma {
    /// `theta = gamma = 1`: the only member that reaches rest exactly.
    #[must_use]
    pub const fn implicit_euler() -> Self {
        Self { theta: 1.0, gamma: 1.0, solver: Solver::Exact }
    }
}

impl Default for ThetaGamma {
    fn default() -> Self {
        Self::implicit_euler()
    }
}

/// Simulates `x'' = f`, `x >= 0`, `x'+ = -e x'-` with the theta-gamma method.
///
/// # Errors
/// [`SetupError`] before anything is computed. Whatever goes wrong later is in the run's status.
pub fn simulate_theta_gamma<E, F: Force<E>>(
    method: ThetaGamma,
    restitution: Restitution,
    force: &mut F,
    grid: Grid,
    initial: Physical,
    monitor: &mut impl Monitor<E>,
) -> Result<Run<E>, SetupError> {
    method.check(grid.h(), restitution)?;
    method.run(restitution, force, grid, initial, monitor)
}

impl Scheme for ThetaGamma {
    const NAME: &'static str = "ThetaGamma";
    const MEANING: &'static str = "theta-gamma scheme with implicit set-valued signs";
    const SETTINGS: &'static [Setting] = &[
        ThetaGammaStep::STEP,
        ThetaGammaStep::THETA,
        ThetaGammaStep::GAMMA,
        Solver::SETTING,
        Solver::LINEARISATIONS,
    ];

    fn of(values: &ReferencePoint) -> Result<Self, SetupError> {
        let linearisations = values.count(&Solver::LINEARISATIONS)?;
        Ok(Self {
            theta: values.number(&ThetaGammaStep::THETA)?,
            gamma: values.number(&ThetaGammaStep::GAMMA)?,
            solver: values.choice(&Solver::SETTING, |it| Solver::named(it, linearisations))?,
        })
    }

    fn check(&self, h: f64, restitution: Restitution) -> Result<(), SetupError> {
        ThetaGammaStep::new(h, self.theta, self.gamma, restitution)?;
        self.solver.check()
    }

    fn run<E, F: Force<E>>(
        &self,
        restitution: Restitution,
        force: &mut F,
        grid: Grid,
        initial: Physical,
        monitor: &mut impl Monitor<E>,
    ) -> Result<Run<E>, SetupError> {
        let step = ThetaGammaStep::new(grid.h(), self.theta, self.gamma, restitution)?;
        let start = (grid, initial);
        match self.solver {
            Solver::Exact => with_solver(Exact, step, force, start, monitor),
            Solver::Newton => with_solver(General::newton(), step, force, start, monitor),
            Solver::Outer { linearisations } => {
                with_solver(General::outer(linearisations), step, force, start, monitor)
            }
        }
    }
}

fn with_solver<E, F: Force<E>>(
    solver: impl StepSolver,
    step: ThetaGammaStep,
    force: &mut F,
    (grid, initial): (Grid, Physical),
    monitor: &mut impl Monitor<E>,
) -> Result<Run<E>, SetupError> {
    let stepper = ThetaGammaStepper::new(step, solver);
    run(stepper, step.restitution(), force, grid, initial, monitor)
}

/// The method as something that steps.
pub(crate) struct ThetaGammaStepper<S> {
    step: ThetaGammaStep,
    solver: S,
    /// The value of a force that depends on nothing, once it is known.
    constant: Option<f64>,
    /// State of the implicit force between steps.
    pub(crate) implicit: ImplicitForce,
}

impl<S: StepSolver> ThetaGammaStepper<S> {
    pub(crate) fn new(step: ThetaGammaStep, solver: S) -> Self {
        Self { step, solver, constant: None, implicit: ImplicitForce::default() }
    }

    /// Evaluates a force that depends on nothing, before the first step.
    pub(crate) fn evaluate_constant<E, F: Force<E>>(&mut self, force: &mut F, t: f64) {
        if force.dependence() == Dependence::Constant {
            // where it has no value the first step says so
            self.constant = self.implicit.evaluate(force, t, Physical::default()).ok();
        }
    }

    /// The value of a force that depends on nothing, once it is known.
    pub(crate) fn constant(&self) -> Option<f64> {
        self.constant
    }

    /// The step under a force that does not depend on where it ends.
    #[inline]
    fn under<E>(&mut self, f: f64, start: Start) -> Result<Sample, Failure<E>> {
        let end = self.solver.solve(&self.step, start.z, f, start.sigma)?;
        Ok(sample(f, end))
    }
}

impl<E, F: Force<E>, S: StepSolver> FixedStep<E, F> for ThetaGammaStepper<S> {
    #[inline]
    fn advance(&mut self, start: Start, force: &mut F) -> Result<Sample, Failure<E>> {
        if let Some(f) = self.constant {
            return self.under(f, start);
        }
        let dependence = force.dependence();
        if dependence == Dependence::State {
            let (f, end) = self.implicit.solve(&self.step, &mut self.solver, start, force)?;
            return Ok(sample(f, end));
        }
        let t = start.t + self.step.theta() * self.step.h();
        let f = self.implicit.evaluate(force, t, Physical::default())?;
        self.constant = (dependence == Dependence::Constant).then_some(f);
        self.under(f, start)
    }

    #[inline(always)]
    fn everyday(&self, z: Lifted) -> Option<Sample> {
        let f = self.constant?;
        self.solver.everyday(&self.step, z, f).map(|end| sample(f, end))
    }

    #[inline]
    fn residual(&self, z: Lifted, f: f64, lambda: [f64; 2]) -> f64 {
        self.step.vi_residual(z, f, lambda)
    }

    fn resize(&mut self, h: f64) {
        // a grid has no step that could be rejected
        self.step = self.step.with_h(h).unwrap_or(self.step);
    }

    fn nfev(&self) -> u64 {
        self.implicit.nfev
    }

    #[inline]
    fn has_failed(&self) -> bool {
        self.solver.has_failed()
    }
}

#[inline]
fn sample(f: f64, end: StepSolution) -> Sample {
    let StepSolution { s, v, lambda_s, lambda_v, .. } = end;
    Sample { z: Lifted { s, v }, lambda_s, lambda_v, f }
}
