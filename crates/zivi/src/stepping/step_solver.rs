//! Solvers for the signs of a step.
//!
//! Solvers for the signs of a step: an exact distinction of cases, or a general solver for box VIs.
//!
//! * [`Exact`] is the case analysis of `zivi_core::step`.
//! * [`General`] solves the inclusion as a VI. "Inner linearisation" ([`General::newton`])
//!   linearises inside the VI solver, which searches along a merit function and has fall-backs.
//!   "Outer linearisation" ([`General::outer`]) solves affine VIs one after another, each
//!   linearised at the solution of the one before, and takes every full step.
//!
//! A general solver starts from the signs of the exact motion where the force pushes away from the wall
//! (there are several solutions then), else from its own last signs.

use zivi_core::step::{selection, StepInclusion};
use zivi_core::vi::{Problem, RowScale, Settings, Workspace};
use zivi_core::{sgn, transform, vi, Lifted, StepFailure, StepSolution, ThetaGammaStep};

/// Finds the end of one step under a frozen force.
pub trait StepSolver {
    /// The step from `z` under the frozen force `f`.
    ///
    /// # Errors
    /// [`StepFailure`] if it fails.
    fn solve(
        &mut self,
        step: &ThetaGammaStep,
        z: Lifted,
        f: f64,
        sigma: f64,
    ) -> Result<StepSolution, StepFailure>;

    /// The same where it takes no search; must be small and call nothing.
    #[inline(always)]
    fn everyday(&self, _: &ThetaGammaStep, _: Lifted, _: f64) -> Option<StepSolution> {
        None
    }

    /// Whether the last step was not solved by this solver but by the exact solution instead.
    fn has_failed(&self) -> bool {
        false
    }

    /// Told when the step was taken by the exact patterns, though every call had an answer.
    fn replaced(&mut self) {}
}

/// The case analysis.
#[derive(Clone, Copy, Debug, Default)]
pub struct Exact;

impl StepSolver for Exact {
    #[inline]
    fn solve(
        &mut self,
        step: &ThetaGammaStep,
        z: Lifted,
        f: f64,
        sigma: f64,
    ) -> Result<StepSolution, StepFailure> {
        step.solve(z, f, sigma)
    }

    #[inline(always)]
    fn everyday(&self, step: &ThetaGammaStep, z: Lifted, f: f64) -> Option<StepSolution> {
        step.everyday(z, f)
    }
}

/// A general VI solver. Where it fails, the step is taken by the exact solution and
/// [`StepSolver::has_failed`] says so.
#[derive(Clone, Debug)]
pub struct General {
    /// The multipliers of the last step: the next one starts there.
    signs: SignSolver<2>,
    failed: bool,
}

impl General {
    /// Inner linearisation: the solver with all its stages.
    #[must_use]
    pub fn newton() -> Self {
        Self { signs: SignSolver::newton(), failed: false }
    }

    /// Inner linearisation by Josephy-Newton with its line search, without fall-backs.
    #[must_use]
    pub fn newton_without_fall_backs() -> Self {
        Self { signs: SignSolver::newton_without_fall_backs(), failed: false }
    }

    /// Outer linearisation: at most `linearisations` affine VIs, no merit function.
    #[must_use]
    pub fn outer(linearisations: usize) -> Self {
        Self { signs: SignSolver::outer(linearisations), failed: false }
    }

    /// Starts the next solve from these multipliers.
    pub fn start_from(&mut self, lambda: [f64; 2]) {
        self.signs.start_from(lambda);
    }

    /// Solves the inclusion from the present multipliers; true if its residual is small.
    pub fn solve_inclusion(&mut self, step: &ThetaGammaStep, z: Lifted, f: f64) -> bool {
        self.signs.solve(&mut StepInclusion { step, z, f }, step.vi_scales(z, f, [0.0; 2]))
    }

    /// The multipliers of the last solve.
    #[must_use]
    pub fn lambda(&self) -> [f64; 2] {
        self.signs.signs()
    }
}

impl StepSolver for General {
    fn solve(
        &mut self,
        step: &ThetaGammaStep,
        z: Lifted,
        f: f64,
        sigma: f64,
    ) -> Result<StepSolution, StepFailure> {
        if f > 0.0 {
            self.start_from(signs_of_exact_motion(step, z, f, sigma));
        }
        self.failed = !self.solve_inclusion(step, z, f);
        if self.failed {
            let end = step.solve(z, f, sigma)?;
            self.start_from([end.lambda_s, end.lambda_v]);
            return Ok(end);
        }
        let end = step.end(z, f, self.lambda());
        if end.end().is_finite() {
            Ok(end)
        } else {
            Err(StepFailure::NotFinite)
        }
    }

    fn has_failed(&self) -> bool {
        self.failed
    }

    fn replaced(&mut self) {
        self.failed = true;
    }
}

/// Direction of the selection rule when the force pushes away from the wall.
fn signs_of_exact_motion(step: &ThetaGammaStep, z: Lifted, f: f64, sigma: f64) -> [f64; 2] {
    let sigma = transform::side(z, sigma);
    let seen = Lifted { s: sigma * z.s, v: sigma * z.v };
    let end = selection::exact_motion(seen, f, step.h(), step.restitution());
    [sigma * sgn(end.s), sigma * sgn(end.v)]
}

// The general VI solver for the signs of a step, with the settings that steps want.

/// Largest scaled residual of a solved step.
const TOLERANCE: f64 = 1e-12;

/// Solves VIs on the box `[-1, 1]^N` one after another, each from the signs of the last or from
/// given ones.
#[derive(Clone, Debug)]
pub struct SignSolver<const N: usize> {
    settings: Settings<'static>,
    signs: [f64; N],
    reals: Vec<f64>,
    indices: Vec<usize>,
}

impl<const N: usize> SignSolver<N> {
    /// Inner linearisation: the solver with all its stages.
    #[must_use]
    pub fn newton() -> Self {
        Self::with(Settings::default())
    }

    /// Inner linearisation by Josephy-Newton with its line search, without fall-backs.
    #[must_use]
    pub fn newton_without_fall_backs() -> Self {
        Self::with(josephy_newton())
    }

    /// Outer linearisation: at most `linearisations` affine VIs, no merit function.
    #[must_use]
    pub fn outer(linearisations: usize) -> Self {
        Self::with(Settings {
            stage_iterations: linearisations,
            line_search: false,
            descent_steps: false,
            ..josephy_newton()
        })
    }

    /// Any settings; the tolerance and the row scaling are those of a step.
    #[must_use]
    pub fn with(settings: Settings<'static>) -> Self {
        let (reals, indices) = vi::workspace_len(N);
        Self {
            settings: Settings {
                tol: TOLERANCE,
                test_isolation: false,
                // of several solutions of a step the one on the path from the last signs counts
                active_set: false,
                smoothing: false,
                ..settings
            },
            signs: [0.0; N],
            reals: vec![0.0; reals],
            indices: vec![0; indices],
        }
    }

    /// Starts the next solve from these signs.
    pub fn start_from(&mut self, signs: [f64; N]) {
        self.signs = signs;
    }

    /// Solves a VI whose rows are of these magnitudes; true if its scaled residual is small.
    /// Otherwise the signs are unchanged.
    pub fn solve(&mut self, problem: &mut impl Problem, scales: [f64; N]) -> bool {
        let scale = scales.map(|scale| 1.0 / scale);
        let settings = Settings { row_scale: RowScale::Given(&scale), ..self.settings };
        let Some(mut work) = Workspace::new(N, &mut self.reals, &mut self.indices) else {
            return false;
        };
        let bounds = (&[-1.0; N][..], &[1.0; N][..]);
        let mut signs = self.signs;
        let solved = vi::solve(problem, bounds, &mut signs, &settings, &mut work)
            .is_ok_and(|report| report.scaled_residual <= TOLERANCE);
        if solved {
            self.signs = signs;
        }
        solved
    }

    /// The signs of the last solve.
    #[must_use]
    pub fn signs(&self) -> [f64; N] {
        self.signs
    }
}

/// Josephy-Newton alone, from the starting point alone.
fn josephy_newton() -> Settings<'static> {
    Settings {
        semismooth: false,
        proximal: false,
        restarts: 0,
        enumerate_up_to: 0,
        ..Settings::default()
    }
}
