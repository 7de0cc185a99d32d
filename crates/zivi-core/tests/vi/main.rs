//! The solver of variational inequalities: planted solutions, enumeration, single stages, fuzz.

mod affine;
mod enumeration;
mod fuzz;
mod infeasible;
mod outside;
mod single_stages;
mod stages;
mod support;
