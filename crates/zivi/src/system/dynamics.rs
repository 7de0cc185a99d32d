//! A mechanical system with unilateral constraints, `n` coordinates and `m` gaps.
//!
//! ```text
//! M(t, q) q'' = F(t, q, q') + N^T lambda      0 <= g(t, q)  perp  lambda >= 0
//! ```
//!
//! `N` has the rows `n_i = grad g_i`. The gap speeds are `g' = N q' + g_t` and their accelerations
//! `g'' = N q'' + h` with the numbers `h_i = q'^T (Hess g_i) q' + 2 (grad dg_i/dt) q' + d^2 g_i/dt^2`.

use std::ops::Range;

/// Most coordinates, and most gaps.
pub const MOST: usize = 64;

/// Where what belongs to `M`, `F`, `g`, `N`, `h` and `g_t` lies in the numbers of an evaluation,
/// in this order, matrices row by row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Coordinates.
    pub n: usize,
    /// Gaps.
    pub m: usize,
}

impl Layout {
    /// How many numbers there are: `n^2 + n + m n + 3 m`.
    #[must_use]
    pub fn len(self) -> usize {
        self.rate().end
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// `M`, `n x n` (mass).
    #[must_use]
    pub fn mass(self) -> Range<usize> {
        0..self.n * self.n
    }

    /// `F`, `n` (generalised forces, Coriolis and centrifugal terms included).
    #[must_use]
    pub fn force(self) -> Range<usize> {
        after(self.mass(), self.n)
    }

    /// `g`, `m`.
    #[must_use]
    pub fn gap(self) -> Range<usize> {
        after(self.force(), self.m)
    }

    /// `N`, `m x n`.
    #[must_use]
    pub fn gradient(self) -> Range<usize> {
        after(self.gap(), self.m * self.n)
    }

    /// `h`, `m`.
    #[must_use]
    pub fn curvature(self) -> Range<usize> {
        after(self.gradient(), self.m)
    }

    /// `g_t`, `m`.
    #[must_use]
    pub fn rate(self) -> Range<usize> {
        after(self.curvature(), self.m)
    }
}

fn after(range: Range<usize>, length: usize) -> Range<usize> {
    range.end..range.end + length
}

/// A mechanical system whose evaluation may raise an error `E`.
pub trait Dynamics<E> {
    /// How many coordinates and gaps there are.
    fn layout(&self) -> Layout;

    /// Writes `M`, `F`, `g`, `N`, `h` and `g_t` at time `t`, coordinates `q` and velocities `w`
    /// into `out`, as [`Layout`] says. Numbers that are not finite end the run with a status.
    ///
    /// # Errors
    /// Whatever the system raises; it ends the run, which keeps what was computed.
    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E>;

    /// Whether `M`, `F`, `N` and `g_t` are constants: contact forces hold no surprise then, such as
    /// a pulse, and are not probed for one.
    fn is_steady(&self) -> bool {
        false
    }
}

/// A system given by a function.
#[derive(Clone, Copy, Debug)]
pub struct FunctionDynamics<F> {
    /// How many coordinates and gaps there are.
    pub layout: Layout,
    /// As [`Dynamics::evaluate`].
    pub function: F,
}

impl<E, F> Dynamics<E> for FunctionDynamics<F>
where
    F: FnMut(f64, &[f64], &[f64], &mut [f64]) -> Result<(), E>,
{
    fn layout(&self) -> Layout {
        self.layout
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        (self.function)(t, q, w, out)
    }
}
