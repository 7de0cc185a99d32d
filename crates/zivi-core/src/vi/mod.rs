//! Variational inequalities on a box: find `z` in `[l, u]` with `0 in F(z) + N_[l,u](z)`.
//!
//! Component by component: `F_i >= 0` at `z_i = l_i`, `F_i <= 0` at `z_i = u_i`, and `F_i = 0`
//! strictly between. Infinite bounds are allowed (a mixed complementarity problem), and so is
//! `l_i = u_i` (`F_i` is then free). Nothing here knows of time or of impacts.
//!
//! [`solve`] goes through its stages (Josephy-Newton on a pivotal solver for the affine
//! problem, semismooth Newton, proximal Josephy-Newton, restarts, enumeration) until the
//! [`natural_residual`], recomputed from `F`, is within the tolerance. The caller supplies `F`
//! and its Jacobian as a [`Problem`] ([`Differenced`] takes the Jacobian by differences,
//! [`Affine`] is `M z + q`), and all memory as a [`Workspace`].
//!
//! A small residual cannot tell a solution from an approach to one at infinity (`F = exp(-z)`
//! tends to zero as `z` grows): see [`Report::size`].

mod active_set;
mod dense;
mod infeasible;
mod iterate;
mod lemke_howson;
pub mod natural;
mod newton;
mod pivotal;
mod problem;
mod settings;
mod smoothing;
mod stages;

pub use dense::factor;
pub use iterate::{workspace_len, Workspace};
pub use lemke_howson::{lemke_howson, lemke_howson_len};
pub use natural::{natural_component, natural_residual};
pub use problem::{Affine, Differenced, EvaluationError, Interruption, Problem, Progress, Scheme};
pub use settings::{
    validate_bounds, Counts, InvalidInput, Report, RowScale, Settings, Stage, Start, Status,
};
pub use stages::solve;
