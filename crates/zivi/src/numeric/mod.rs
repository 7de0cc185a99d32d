//! Numerics that know no mechanics: Runge-Kutta pairs, Bernstein polynomials, roots, grids.

pub(crate) mod bernstein;
pub(crate) mod cholesky;
pub mod grid;
pub(crate) mod root;
pub(crate) mod tableau;
pub(crate) mod turns;
