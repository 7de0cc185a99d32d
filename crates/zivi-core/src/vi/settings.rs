//! Settings, statuses, budgets and validation of the solver.
//!
//! Settings and reports.

use core::fmt;

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
    /// Rejects the first setting that is out of its range.
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

// Status of a solve, and errors of its input.

/// How a solve ended. Only a residual recomputed from `F` at the returned point makes it solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The natural residual is within the tolerance.
    Solved,
    /// Like [`Status::Solved`], but the Jacobian on the rows inside the box is singular there: the
    /// solution may belong to a continuum or have higher multiplicity.
    SolvedNotIsolated,
    /// The merit function is stationary where the residual is not small.
    Stationary,
    /// The merit function has not fallen by a tenth over twenty iterations.
    Stalled,
    /// The budget of iterations is used up.
    IterationLimit,
    /// Pivoting reached its limit in the affine subproblems.
    PivotLimit,
    /// No point was found from which to go on with `F` and its Jacobian finite.
    DomainError,
    /// The caller's evaluation failed.
    EvaluationError,
    /// No point of the box satisfies all rows of an affine problem: there is no solution.
    Infeasible,
    /// The caller's monitor stopped the solve.
    Stopped,
}

impl Status {
    /// True when the returned point solves the problem within the tolerance.
    #[must_use]
    pub fn is_success(self) -> bool {
        matches!(self, Self::Solved | Self::SolvedNotIsolated)
    }

    /// The documented name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Solved => "Solved",
            Self::SolvedNotIsolated => "SolvedNotIsolated",
            Self::Stationary => "Stationary",
            Self::Stalled => "Stalled",
            Self::IterationLimit => "IterationLimit",
            Self::PivotLimit => "PivotLimit",
            Self::DomainError => "DomainError",
            Self::EvaluationError => "EvaluationError",
            Self::Infeasible => "Infeasible",
            Self::Stopped => "Stopped",
        }
    }

    /// Reason and advice.
    #[must_use]
    pub fn message(self) -> &'static str {
        match self {
            Self::Solved => "solved: the natural residual is within the tolerance",
            Self::SolvedNotIsolated => {
                "solved, but the Jacobian is singular there: other solutions may lie arbitrarily near"
            }
            Self::Stationary => {
                "the merit function is stationary at a point that does not solve the problem: try another \
                 starting point, check the Jacobian, or the problem may have no solution"
            }
            Self::Stalled => {
                "progress became too slow: scale the rows of F, try another starting point, or \
                 the problem may have no solution"
            }
            Self::IterationLimit => "the iteration limit was reached: raise it or start nearer",
            Self::PivotLimit => {
                "pivoting reached its limit in the affine subproblems: raise the limit or try \
                 another starting point"
            }
            Self::DomainError => {
                "F or its Jacobian is not finite at all trial points: start where both are \
                 finite, or tighten the bounds to their domain"
            }
            Self::EvaluationError => "the evaluation of F or of its Jacobian failed",
            Self::Infeasible => {
                "there is no solution: no point of the box satisfies all rows of F (for components \
                 with one bound, their signs); check the bounds and the sign of F"
            }
            Self::Stopped => "stopped by the caller before a solution was found",
        }
    }
}

impl fmt::Display for Status {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(self.message())
    }
}

/// Input that no solver can use; found before `F` is called.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InvalidInput {
    /// There are no unknowns.
    Empty,
    /// A vector or matrix has the wrong number of entries.
    Length {
        /// Name of the argument.
        name: &'static str,
        /// Entries it must have.
        expected: usize,
        /// Entries it has.
        got: usize,
    },
    /// An entry that must be finite is not, or a bound is NaN.
    NotFinite {
        /// Name of the argument.
        name: &'static str,
        /// Index of the entry.
        index: usize,
        /// The entry.
        value: f64,
    },
    /// `lower > upper`.
    CrossedBounds {
        /// Index of the component.
        index: usize,
        /// Its lower bound.
        lower: f64,
        /// Its upper bound.
        upper: f64,
    },
    /// `lower = +inf` or `upper = -inf`: nothing is between the bounds.
    EmptyRange {
        /// `"lower"` or `"upper"`.
        name: &'static str,
        /// Index of the component.
        index: usize,
    },
    /// A setting, or a row scale, outside its range.
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// The value that was rejected.
        value: f64,
        /// The admissible range, in words.
        range: &'static str,
    },
    /// The workspace is smaller than [`super::workspace_len`] says.
    Workspace,
}

impl fmt::Display for InvalidInput {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Empty => write!(out, "the problem must have at least one unknown"),
            Self::Length { name, expected, got } => {
                write!(out, "{name} must have {expected} entries, got {got}")
            }
            Self::NotFinite { name, index, value } if name == "lower" || name == "upper" => {
                write!(out, "{name}[{index}] must be a number or infinite, got {value}")
            }
            Self::NotFinite { name, index, value } => {
                write!(out, "{name}[{index}] must be finite, got {value}")
            }
            Self::CrossedBounds { index, lower, upper } => {
                write!(out, "lower[{index}] must be <= upper[{index}], got {lower} > {upper}")
            }
            Self::EmptyRange { name: "lower", index } => {
                write!(out, "lower[{index}] must be < +inf, got +inf")
            }
            Self::EmptyRange { name, index } => {
                write!(out, "{name}[{index}] must be > -inf, got -inf")
            }
            Self::Setting { name, value, range } => {
                write!(out, "{name} must be {range}, got {value}")
            }
            Self::Workspace => write!(out, "the workspace must have the length workspace_len(n)"),
        }
    }
}

impl core::error::Error for InvalidInput {}

// The budget of pivots, and the share of it that each stage may use.

/// Pivots that may be spent. Other work counts as the pivots it costs: a column that enters a
/// starting basis is one, a factorisation of order `n` (`n^3/3` against `2 n^2` operations) is
/// `n/6`.
#[derive(Debug)]
pub(super) struct Budget {
    total: usize,
    spent: usize,
    /// Budget at the end of the stage.
    stage_end: usize,
}

impl Budget {
    pub(super) fn new(total: usize) -> Self {
        Self { total, spent: 0, stage_end: total }
    }

    /// Starts a stage: it may use `weight / weights` of the remaining budget, with `weights` the
    /// sum over it and the later stages, which inherit the rest.
    pub(super) fn open_stage(&mut self, weight: usize, weights: usize) {
        let left = self.total.saturating_sub(self.spent);
        let share = (left as f64 * weight as f64 / weights.max(weight) as f64) as usize;
        self.stage_end = self.spent.saturating_add(share.clamp(usize::from(left > 0), left));
    }

    pub(super) fn spend(&mut self, pivots: usize) {
        self.spent = self.spent.saturating_add(pivots);
    }

    pub(super) fn spent(&self) -> usize {
        self.spent
    }

    pub(super) fn spend_on_factors(&mut self, n: usize) {
        self.spend(n.div_ceil(6));
    }

    /// Pivots left to the stage.
    pub(super) fn left(&self) -> usize {
        self.stage_end.saturating_sub(self.spent)
    }

    /// Pivots left for it and all later stages.
    pub(super) fn left_to_all(&self) -> usize {
        self.total.saturating_sub(self.spent)
    }

    pub(super) fn is_spent(&self) -> bool {
        self.spent >= self.stage_end
    }

    pub(super) fn is_spent_by_all(&self) -> bool {
        self.spent >= self.total
    }
}

/// The weight of a stage's share. The first has the best chance; a restart is one of many.
pub(super) fn weight(stage: Stage) -> usize {
    match stage {
        Stage::JosephyNewton => 4,
        Stage::Smoothing | Stage::Semismooth => 3,
        Stage::Proximal => 2,
        Stage::Restart(_) => 1,
        Stage::Enumeration => 0,
    }
}

// Refusing input that no solver can use, before `F` is called.

/// `Ok` when `lower` and `upper` have `n` entries and every `[lower_i, upper_i]` holds a number.
///
/// # Errors
/// [`InvalidInput`] names the first component that is wrong.
pub fn validate_bounds(n: usize, lower: &[f64], upper: &[f64]) -> Result<(), InvalidInput> {
    if n == 0 {
        return Err(InvalidInput::Empty);
    }
    for (name, bound, empty) in
        [("lower", lower, f64::INFINITY), ("upper", upper, f64::NEG_INFINITY)]
    {
        require_length(name, bound, n)?;
        for (index, &value) in bound.iter().enumerate() {
            if value.is_nan() {
                return Err(InvalidInput::NotFinite { name, index, value });
            }
            if value == empty {
                return Err(InvalidInput::EmptyRange { name, index });
            }
        }
    }
    for (index, (&lower, &upper)) in lower.iter().zip(upper).enumerate() {
        if lower > upper {
            return Err(InvalidInput::CrossedBounds { index, lower, upper });
        }
    }
    Ok(())
}

/// `Ok` when `v` has `n` entries.
pub(super) fn require_length(
    name: &'static str,
    v: &[f64],
    expected: usize,
) -> Result<(), InvalidInput> {
    match v.len() {
        got if got == expected => Ok(()),
        got => Err(InvalidInput::Length { name, expected, got }),
    }
}

/// `Ok` when every entry is finite.
pub(super) fn require_finite(name: &'static str, v: &[f64]) -> Result<(), InvalidInput> {
    match v.iter().enumerate().find(|(_, value)| !value.is_finite()) {
        None => Ok(()),
        Some((index, &value)) => Err(InvalidInput::NotFinite { name, index, value }),
    }
}

#[cfg(test)]
mod status_tests {
    extern crate std;
    use super::Status;
    use std::collections::BTreeSet;
    use std::string::ToString;

    #[test]
    fn each_status_has_a_message_of_its_own() {
        let all = [
            (Status::Solved, "within the tolerance"),
            (Status::SolvedNotIsolated, "singular"),
            (Status::Stationary, "stationary"),
            (Status::Stalled, "too slow"),
            (Status::IterationLimit, "iteration limit"),
            (Status::PivotLimit, "pivoting"),
            (Status::DomainError, "finite"),
            (Status::EvaluationError, "evaluation"),
            (Status::Infeasible, "no solution"),
            (Status::Stopped, "stopped"),
        ];
        for (status, words) in all {
            assert!(status.message().contains(words), "{status:?}");
            assert_eq!(status.to_string(), status.message());
            assert_eq!(std::format!("{status:?}"), status.name());
        }
        let messages: BTreeSet<&str> = all.iter().map(|(status, _)| status.message()).collect();
        assert_eq!(messages.len(), all.len());
    }
}

#[cfg(test)]
mod budget_tests {
    use super::*;

    #[test]
    fn every_stage_gets_its_share_of_what_is_left() {
        let mut budget = Budget::new(100);
        budget.open_stage(1, 4);
        assert_eq!(budget.left(), 25);
        budget.spend(40); // a pivot or two more than allowed
        assert!(budget.is_spent() && !budget.is_spent_by_all());
        budget.open_stage(1, 3);
        assert_eq!(budget.left(), 20);
        budget.spend_on_factors(13);
        assert_eq!((budget.left(), budget.left_to_all()), (17, 57));
        budget.open_stage(1, 1);
        assert_eq!(budget.left(), 57);
        budget.spend(57);
        assert!(budget.is_spent_by_all());
        budget.open_stage(1, 1);
        assert_eq!(budget.left(), 0);
    }

    #[test]
    fn no_stage_starves_while_something_is_left() {
        let mut budget = Budget::new(3);
        budget.open_stage(1, 17);
        assert_eq!(budget.left(), 1);
        let mut unlimited = Budget::new(usize::MAX);
        unlimited.open_stage(4, 17);
        assert!(unlimited.left() > 1 << 60);
    }
}

#[cfg(test)]
mod validate_tests {
    extern crate std;
    use super::*;
    use std::string::{String, ToString};

    const INF: f64 = f64::INFINITY;

    #[test]
    fn every_bad_bound_is_named() {
        let cases = [
            (0, [0.0, 0.0], [1.0, 1.0], "at least one"),
            (3, [0.0, 0.0], [1.0, 1.0], "lower must have 3"),
            (2, [0.0, f64::NAN], [1.0, 1.0], "lower[1]"),
            (2, [0.0, 0.0], [f64::NAN, 1.0], "upper[0]"),
            (2, [0.0, INF], [1.0, INF], "lower[1]"),
            (2, [-INF, 0.0], [-INF, 1.0], "upper[0]"),
            (2, [0.0, 2.0], [1.0, 1.0], "lower[1] must be <= upper[1]"),
        ];
        for (n, lower, upper, expected) in cases {
            let error = validate_bounds(n, &lower, &upper);
            let text = error.map_or_else(|error| error.to_string(), |()| String::new());
            assert!(text.contains(expected), "{text}: {expected}");
        }
        assert_eq!(validate_bounds(2, &[-INF, 1.0], &[INF, 1.0]), Ok(()));
    }
}
