//! A mechanical system with unilateral constraints, `n` coordinates and `m` gaps, and dry friction in
//! `p` channels.
//!
//! ```text
//! M(t, q) q'' = F(t, q, q') + N^T lambda + B^T f      0 <= g(t, q)  perp  lambda >= 0
//! ```
//!
//! `N` has the rows `n_i = grad g_i`. The gap speeds are `g' = N q' + g_t` and their accelerations
//! `g'' = N q'' + h` with the numbers `h_i = q'^T (Hess g_i) q' + 2 (grad dg_i/dt) q' + d^2 g_i/dt^2`.
//! The slip speeds are `w = B q' + beta`, their accelerations `w' = B q'' + k`, see [`super::friction`].

use std::ops::Range;
use std::sync::Arc;

use crate::record::gap_set::GapSet;
use crate::system::linear_system::LinearSystem;

use super::friction::Friction;

/// Most coordinates, and most gaps with the channels of friction.
pub const MOST: usize = GapSet::MOST;

/// Where what belongs to `M`, `F`, `g`, `(N, B)`, `(h, k)`, `(g_t, beta)`, the limits of friction and
/// those of sticking lies in the numbers of an evaluation, in this order, matrices row by row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Coordinates.
    pub n: usize,
    /// Gaps.
    pub m: usize,
    /// Channels of friction.
    pub p: usize,
}

impl Layout {
    /// Without friction.
    #[must_use]
    pub const fn smooth(n: usize, m: usize) -> Self {
        Self { n, m, p: 0 }
    }

    /// How many numbers there are: `n^2 + n + m + (m + p) (n + 2) + 2 p`.
    #[must_use]
    pub fn len(self) -> usize {
        self.static_limit().end
    }

    /// Gaps and channels: the rows of `N`, then those of `B`.
    #[must_use]
    pub fn rows(self) -> usize {
        self.m + self.p
    }

    /// What is integrated: coordinates, gaps, slips, and the work of friction if there is any.
    #[must_use]
    pub fn size(self) -> usize {
        self.n + self.rows() + usize::from(self.p > 0)
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

    /// `N` above `B`, `(m + p) x n`.
    #[must_use]
    pub fn gradient(self) -> Range<usize> {
        after(self.gap(), self.rows() * self.n)
    }

    /// `h`, then `k`, `m + p`.
    #[must_use]
    pub fn curvature(self) -> Range<usize> {
        after(self.gradient(), self.rows())
    }

    /// `g_t`, then `beta`, `m + p`.
    #[must_use]
    pub fn rate(self) -> Range<usize> {
        after(self.curvature(), self.rows())
    }

    /// By channel, `p`: the coefficient `mu` of one at a gap, the force `L` of a joint, in slip.
    #[must_use]
    pub fn limit(self) -> Range<usize> {
        after(self.rate(), self.p)
    }

    /// The same while it sticks, not smaller.
    #[must_use]
    pub fn static_limit(self) -> Range<usize> {
        after(self.limit(), self.p)
    }
}

fn after(range: Range<usize>, length: usize) -> Range<usize> {
    range.end..range.end + length
}

/// A mechanical system whose evaluation may raise an error `E`.
pub trait Dynamics<E> {
    /// How many coordinates, gaps and channels of friction there are.
    fn layout(&self) -> Layout;

    /// The channels of friction, as many as the layout says.
    fn friction(&self) -> &Friction {
        Friction::none()
    }

    /// Writes `M`, `F`, `g`, `N`, `h`, `g_t` and what belongs to friction at time `t`, coordinates `q`
    /// and velocities `w` into `out`, as [`Layout`] says. Numbers that are not finite end the run with a status.
    ///
    /// # Errors
    /// Whatever the system raises; it ends the run, which keeps what was computed.
    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E>;

    /// The same over what [`Self::evaluate`] has written into `out` before: numbers that never change
    /// may be left as they are.
    ///
    /// # Errors
    /// As [`Self::evaluate`].
    fn evaluate_again(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.evaluate(t, q, w, out)
    }

    /// Writes `g`, `h` and `g_t` alone, where `M` and `N` never change: what else is in `out` may be left as
    /// it is.
    ///
    /// # Errors
    /// As [`Self::evaluate`].
    fn evaluate_gaps(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.evaluate_again(t, q, w, out)
    }

    /// Whether `M`, `F`, `N` and `g_t` are constants: contact forces hold no surprise then, such as
    /// a pulse, and are not probed for one.
    fn is_steady(&self) -> bool {
        false
    }

    /// The matrices, loads and gaps, where the system is a linear one.
    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        None
    }
}

/// A borrowed system, of a kind that is known only when the program runs (`dyn`), too.
impl<E, D: Dynamics<E> + ?Sized> Dynamics<E> for &mut D {
    fn layout(&self) -> Layout {
        (**self).layout()
    }

    fn friction(&self) -> &Friction {
        (**self).friction()
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        (**self).evaluate(t, q, w, out)
    }

    fn evaluate_again(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        (**self).evaluate_again(t, q, w, out)
    }

    fn evaluate_gaps(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        (**self).evaluate_gaps(t, q, w, out)
    }

    fn is_steady(&self) -> bool {
        (**self).is_steady()
    }

    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        (**self).linear()
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
