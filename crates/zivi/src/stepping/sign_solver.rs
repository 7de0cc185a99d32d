//! The general VI solver for the signs of a step, with the settings that steps want.

use zivi_core::vi::{self, Problem, RowScale, Settings, Workspace};

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

    /// Inner linearisation by Josephy-Newton with its search alone, nothing behind it.
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

    /// Solves a VI whose rows are of these magnitudes; true if its scaled residual is small. The
    /// signs stay as they were if it is not.
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
