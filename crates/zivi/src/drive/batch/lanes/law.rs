//! What kernels for different forces have in common.

use pulp::Simd;

use super::alone::OneByOne;
use super::flight::{Lane, Lanes};

/// The everyday steps under one kind of force.
pub(super) trait Law<F> {
    /// Looks at a mass after a step of its own, and before steps of another size.
    fn place(&mut self, i: usize, run: &OneByOne<F>, lanes: &Lanes);

    /// Tells a mass what the steps side by side have left, before a step of its own.
    fn tell(&self, i: usize, run: &mut OneByOne<F>);

    /// Evaluates what depends on time alone, for the step that takes its force at `t`.
    fn begin(&mut self, t: f64, runs: &mut [OneByOne<F>]);

    /// Takes the everyday steps of the masses in the first `n` vectors; one whose step is `hard` (not
    /// 0) stays. Gives whether there is one. Must be inlined always.
    fn everyday<S: Simd>(&mut self, simd: S, lanes: &mut Lanes, n: usize, hard: &mut Lane) -> bool;

    /// Evaluations of the force in so many steps.
    fn nfev(&self, i: usize, run: &OneByOne<F>, steps: u64) -> u64;
}
