//! What is linear in where a step starts.

use super::terms::{Start, WAVES};

/// What a flight is linear in: `x`, `V`, the constant, the two parts of each wave.
pub(super) const COLUMNS: usize = 3 + 2 * WAVES;

/// Numbers that are linear in where a step starts: by each of what it is linear in.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Columns<const N: usize>(pub(super) [[f64; N]; COLUMNS]);

impl<const N: usize> Columns<N> {
    /// The first of them for a start with `W` waves.
    #[inline(always)]
    pub(super) fn of<const W: usize, const FIRST: usize>(&self, start: &Start) -> [f64; FIRST] {
        // a loop is compiled for the vectors of whoever calls, a closure is not
        let mut all = [0.0; FIRST];
        for (n, sum) in all.iter_mut().enumerate() {
            *sum = self.one::<W>(start, n);
        }
        all
    }

    /// One of them.
    #[inline(always)]
    pub(super) fn one<const W: usize>(&self, start: &Start, n: usize) -> f64 {
        let (Start { x, v, force, waves }, by) = (*start, &self.0);
        let mut sum = x * by[0][n] + v * by[1][n] + force * by[2][n];
        for m in 0..W {
            let [re, im] = waves[m];
            sum += re * by[3 + 2 * m][n] + im * by[4 + 2 * m][n];
        }
        sum
    }
}

/// A bound that is linear in the sizes of what a step starts from: by `|x|`, by `|V|`, by the
/// constant, by `|z|` of each wave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bound(pub(super) [f64; 3 + WAVES]);

impl Bound {
    /// That of the sizes that columns have; the two of a wave are turned into each other.
    pub(super) fn sizes(of: impl Fn(usize) -> f64) -> Self {
        let wave = |m: usize| length(of(3 + 2 * m), of(4 + 2 * m));
        Self([of(0), of(1), of(2), wave(0), wave(1)])
    }

    #[inline(always)]
    pub(super) fn of<const W: usize>(&self, start: &Start) -> f64 {
        let Self([x, v, force, waves @ ..]) = self;
        let mut sum = x * start.x.abs() + v * start.v.abs() + force * start.force.abs();
        for (of, z) in waves.iter().zip(&start.waves).take(W) {
            // |z| is at most the sum of the absolute values of its parts
            sum += of * (z[0].abs() + z[1].abs());
        }
        sum
    }
}

/// `sqrt(a^2 + b^2)` for numbers whose squares are some.
pub(super) fn length(a: f64, b: f64) -> f64 {
    (a * a + b * b).sqrt()
}
