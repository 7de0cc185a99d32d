//! How a solve ended, and what was wrong with its input.

use core::fmt;

/// How a solve ended. Only a residual recomputed from `F` at the returned point makes it solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The natural residual is within the tolerance.
    Solved,
    /// As [`Status::Solved`], and the Jacobian on the rows inside the box is singular there: the
    /// solution may be one of a continuum, or of higher multiplicity.
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

    /// The name, as in the documentation.
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

    /// What happened and what to try.
    #[must_use]
    pub fn message(self) -> &'static str {
        match self {
            Self::Solved => "solved: the natural residual is within the tolerance",
            Self::SolvedNotIsolated => {
                "solved, but the Jacobian is singular there: other solutions may lie arbitrarily near"
            }
            Self::Stationary => {
                "the merit function is stationary at a point that is no solution: try another \
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
                "no point was found from which to go on with F and its Jacobian finite: start \
                 where both are defined, or tighten the bounds to the domain"
            }
            Self::EvaluationError => "the evaluation of F or of its Jacobian failed",
            Self::Infeasible => {
                "there is no solution: no point of the box satisfies all rows of F (their signs \
                 where there is no bound at which they may be wrong); check the bounds and the \
                 sign of F"
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
        /// The value that was refused.
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

#[cfg(test)]
mod tests {
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
