//! Numerics that know no mechanics: Runge-Kutta pairs and their steps, Bernstein polynomials, roots,
//! grids.

pub(crate) mod bernstein;
pub(crate) mod cholesky;
pub(crate) mod coordinates;
pub(crate) mod dense;
pub(crate) mod elimination;
pub mod grid;
pub mod lu;
pub(crate) mod power_series;
pub(crate) mod root;
pub(crate) mod stages;
pub(crate) mod tableau;
