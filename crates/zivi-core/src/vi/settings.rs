//! What can be set, and what comes back.

use super::status::{InvalidInput, Status};

/// Scaling of the rows, `F_i -> sigma_i F_i` with `sigma_i > 0`: it changes the residual, not the
/// solutions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RowScale<'a> {
    /// `sigma_i = 1`.
    Unit,
    /// `sigma_i` as given: positive and finite.
    Given(&'a [f64]),
    /// `sigma_i = 1 / max_j |dF_i/dz_j|` at the starting point (1 for a row of zeros).
    Jacobian,
}

/// The settings, each with its default and its range. Every fall-back can be switched off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings<'a> {
    /// Largest natural residual of a solution, after row scaling. Default 1e-9; > 0.
    pub tol: f64,
    /// The same relative to the residual of the starting point; the larger of the two holds.
    /// Default 0; 0 to 1, 1 excluded.
    pub rtol: f64,
    /// Scaling of the rows. Default [`RowScale::Unit`].
    pub row_scale: RowScale<'a>,
    /// Iterations of all stages together. Default 10000; >= 1.
    pub max_iterations: usize,
    /// Iterations of one stage. Default 200; >= 1.
    pub stage_iterations: usize,
    /// Pivots of one affine solve; `None` is `20 n + 50` in the first iteration,
    /// `4 n + 50` after it. Default `None`; >= 1.
    pub max_pivots: Option<usize>,
    /// Pivots of all stages together; `None` is `200 n + 10000` and, while they
    /// are cheap, `min(100 n^2, 3e8 / n^2)` more. Each stage may use a share. Other
    /// work counts as the pivots it costs: a column of a starting basis as one, a factorisation as
    /// `n/6`. Default `None`; >= 1.
    pub total_pivots: Option<usize>,
    /// Search from Josephy-Newton directions; without it every full step is taken. Default true.
    pub line_search: bool,
    /// Merit values the nonmonotone search looks back on; 1 is monotone. Default 8; 1 to 16.
    pub memory: usize,
    /// Semismooth and gradient steps where a Josephy-Newton step fails. Default true.
    pub descent_steps: bool,
    /// Try the active-set Newton method for the affine problem before pivoting. Default true.
    pub active_set: bool,
    /// Which start of the pivotal solver is tried first. Default [`Start::Regular`].
    pub first_start: Start,
    /// Stage S0, Josephy-Newton. Default true.
    pub josephy_newton: bool,
    /// Stage SM, smoothing Newton. Default true.
    pub smoothing: bool,
    /// Stage S1, semismooth Newton on the Fischer-Burmeister function. Default true.
    pub semismooth: bool,
    /// Stage S2, proximal Josephy-Newton. Default true.
    pub proximal: bool,
    /// Number of restarts, stages R0 to R7. Default 8; 0 to 8.
    pub restarts: usize,
    /// Largest `n` for which all patterns of active bounds are enumerated. Default 6; 0 to 6.
    pub enumerate_up_to: usize,
    /// Test whether the solution is isolated (one more Jacobian and its factors). Default true.
    pub test_isolation: bool,
}

impl Default for Settings<'_> {
    fn default() -> Self {
        Self {
            tol: 1e-9,
            rtol: 0.0,
            row_scale: RowScale::Unit,
            max_iterations: 10_000,
            stage_iterations: 200,
            max_pivots: None,
            total_pivots: None,
            line_search: true,
            memory: 8,
            descent_steps: true,
            active_set: true,
            first_start: Start::Regular,
            josephy_newton: true,
            smoothing: true,
            semismooth: true,
            proximal: true,
            restarts: 8,
            enumerate_up_to: 6,
            test_isolation: true,
        }
    }
}

impl Settings<'_> {
    /// Refuses the first setting that is out of its range.
    pub(super) fn validate(&self, n: usize) -> Result<(), InvalidInput> {
        let check = |name, ok: bool, value: f64, range| match ok {
            true => Ok(()),
            false => Err(InvalidInput::Setting { name, value, range }),
        };
        let count = |name, value: usize, least: usize, most: usize, range| {
            check(name, (least..=most).contains(&value), value as f64, range)
        };
        check("tol", self.tol > 0.0 && self.tol.is_finite(), self.tol, "a finite number > 0")?;
        check("rtol", (0.0..1.0).contains(&self.rtol), self.rtol, "at least 0 and below 1")?;
        count("max_iterations", self.max_iterations, 1, usize::MAX, "at least 1")?;
        count("stage_iterations", self.stage_iterations, 1, usize::MAX, "at least 1")?;
        count("max_pivots", self.max_pivots.unwrap_or(1), 1, usize::MAX, "at least 1")?;
        count("total_pivots", self.total_pivots.unwrap_or(1), 1, usize::MAX, "at least 1")?;
        count("memory", self.memory, 1, MEMORY, "1 to 16")?;
        count("restarts", self.restarts, 0, RESTARTS, "0 to 8")?;
        count("enumerate_up_to", self.enumerate_up_to, 0, 6, "0 to 6")?;
        if let RowScale::Given(scale) = self.row_scale {
            if scale.len() != n {
                return Err(InvalidInput::Length {
                    name: "row_scale",
                    expected: n,
                    got: scale.len(),
                });
            }
            for &value in scale {
                check("row_scale", value > 0.0 && value.is_finite(), value, "finite and > 0")?;
            }
        }
        Ok(())
    }

    /// Pivots allowed for one affine solve with `n` unknowns. Where theory promises the path an
    /// end it may be long; where the first one has none, short ones from many points do better.
    pub(super) fn pivot_limit(&self, n: usize, is_first: bool) -> usize {
        self.max_pivots.unwrap_or(if is_first { 20 * n + 50 } else { 4 * n + 50 })
    }

    /// Pivots allowed for a whole solve.
    pub(super) fn total_pivot_limit(&self, n: usize) -> usize {
        self.total_pivots.unwrap_or_else(|| default_total(n))
    }
}

/// `200 n + 10000 + min(100 n^2, 3e8 / n^2)`: more where paths are many and pivots cheap.
fn default_total(n: usize) -> usize {
    let square = n.saturating_mul(n).max(1);
    200 * n + 10_000 + (300_000_000 / square).min(100 * square)
}

/// Longest memory of the nonmonotone search.
pub(super) const MEMORY: usize = 16;
/// Number of restarts there are seeds for.
pub(super) const RESTARTS: usize = 8;

/// The part of the solver that produced the returned point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// S0: Josephy-Newton from the starting point.
    JosephyNewton,
    /// SM: smoothing Newton from the starting point.
    Smoothing,
    /// S1: semismooth Newton from the starting point.
    Semismooth,
    /// S2: proximal Josephy-Newton, ray start first, from the starting point.
    Proximal,
    /// R0 to R7: Josephy-Newton from a random point.
    Restart(u8),
    /// Enumeration of the patterns of active bounds.
    Enumeration,
}

impl Stage {
    /// `"S0"`, `"SM"`, `"S1"`, `"S2"`, `"R0"` to `"R7"`, or `"E"`.
    #[must_use]
    pub fn name(self) -> &'static str {
        const NAMES: [&str; RESTARTS] = ["R0", "R1", "R2", "R3", "R4", "R5", "R6", "R7"];
        match self {
            Self::JosephyNewton => "S0",
            Self::Smoothing => "SM",
            Self::Semismooth => "S1",
            Self::Proximal => "S2",
            Self::Restart(k) => NAMES.get(usize::from(k)).copied().unwrap_or("R"),
            Self::Enumeration => "E",
        }
    }
}

/// How much work was done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Iterations of all stages.
    pub iterations: usize,
    /// Evaluations of `F`.
    pub f: usize,
    /// Evaluations of the Jacobian.
    pub jacobian: usize,
    /// Pivots, bound flips included.
    pub pivots: usize,
    /// Steps of the smoothing Newton method.
    pub smoothing_steps: usize,
    /// Steps along a semismooth Newton direction.
    pub semismooth_steps: usize,
    /// Steps along the projected gradient.
    pub gradient_steps: usize,
    /// Restarts.
    pub restarts: usize,
}

/// The end of a solve; the point itself is in the caller's `z`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// How it ended.
    pub status: Status,
    /// Natural residual of the caller's `F` at `z`.
    pub residual: f64,
    /// The same with the rows scaled: what is compared with the tolerance.
    pub scaled_residual: f64,
    /// The tolerance, raised to the rounding error of the rows where that is larger.
    pub tolerance: f64,
    /// The stage that found `z`.
    pub stage: Stage,
    /// How much work was done.
    pub counts: Counts,
    /// `max |z_i|`. Residuals cannot tell a solution from an approach to one at infinity: a large
    /// value here, with a convergence ratio that is not small, can.
    pub size: f64,
    /// The residual divided by that of the previous iterate (NaN before the first step).
    pub convergence_ratio: f64,
    /// The starting point was outside the box, and was projected.
    pub projected: bool,
}

/// Where the path begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// At the given point, which solves the problem for a covering vector built from it.
    Regular,
    /// On the ray `s -> inf` from the vertex of the box nearest to the given point.
    Ray,
}
