//! Numerics that know no mechanics: Runge-Kutta pairs and their steps, Bernstein polynomials, roots,
//! grids.

pub(crate) mod bernstein;
pub(crate) mod cholesky;
pub(crate) mod coordinates;
pub(crate) mod dense;
pub(crate) mod elimination;
pub(crate) mod first_root;
pub mod grid;
pub(crate) mod linear_map;
pub mod lu;
pub(crate) mod power_series;
pub(crate) mod probes;
pub(crate) mod real;
pub(crate) mod richardson;
pub(crate) mod root;
pub(crate) mod singular;
pub(crate) mod stages;
pub(crate) mod step_error;
pub(crate) mod step_size;
pub(crate) mod tableau;
pub(crate) mod turns;
pub(crate) mod vector;
