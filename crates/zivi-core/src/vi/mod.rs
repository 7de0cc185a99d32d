//! Variational inequalities on a box: find `z` in `[l, u]` with `0 in F(z) + N_[l,u](z)`.
//!
//! Component by component: `F_i >= 0` at `z_i = l_i`, `F_i <= 0` at `z_i = u_i`, and `F_i = 0`
//! strictly between. Infinite bounds are allowed (a mixed complementarity problem). Nothing here
//! knows of time or of impacts.

pub mod natural;

pub use natural::{natural_component, natural_residual};
