//! Dynamics of mechanical systems, also driven ones, and their evaluation.
//!
//! A mechanical system with unilateral constraints, `n` coordinates and `m` gaps, and dry friction in
//! `p` channels.
//!
//! ```text
//! M(t, q) q'' = F(t, q, q') + N^T lambda + B^T f      0 <= g(t, q)  perp  lambda >= 0
//! ```
//!
//! `N` has the rows `n_i = grad g_i`. The gap speeds are `g' = N q' + g_t` and their accelerations
//! `g'' = N q'' + h` with the numbers `h_i = q'^T (Hess g_i) q' + 2 (grad dg_i/dt) q' + d^2 g_i/dt^2`.
//! The slip speeds are `w = B q' + beta`, their accelerations `w' = B q'' + k`, see [`crate::system::force`].
//!
//! `k` equality rows `phi(t, q) = 0` add `G^T mu` to the forces, with `G = d phi/d q`: closed chains and
//! prescribed motion. Their speeds `G q' + phi_t` and accelerations `G q'' + c` vanish.

use crate::record::gap_set::GapSet;
use crate::record::status::Failure;
use crate::system::force::Friction;
use crate::system::linear_system::LinearSystem;
use crate::{Force, SetupError, Status};
use std::ops::Range;
use std::sync::Arc;
use zivi_core::Physical;

/// Most coordinates, and most gaps with the channels of friction.
pub const MOST: usize = GapSet::MOST;

/// Where what belongs to `M`, `F`, `g`, `(N, B)`, `(h, k)`, `(g_t, beta)`, the limits of friction and
/// those of sticking, and then `phi`, `G`, `c` and `phi_t` lies in the numbers of an evaluation, in this
/// order, matrices row by row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Coordinates.
    pub n: usize,
    /// Gaps.
    pub m: usize,
    /// Channels of friction.
    pub p: usize,
    /// Equality rows.
    pub k: usize,
}

impl Layout {
    /// Without friction.
    #[must_use]
    pub const fn smooth(n: usize, m: usize) -> Self {
        Self { n, m, p: 0, k: 0 }
    }

    /// How many numbers there are: `n^2 + n + m + (m + p) (n + 2) + 2 p + k (n + 3)`.
    #[must_use]
    pub fn len(self) -> usize {
        self.equality_rate().end
    }

    /// Forces of gaps, channels and equality rows.
    #[must_use]
    pub fn forces(self) -> usize {
        self.rows() + self.k
    }

    /// Gaps and channels: the rows of `N`, then those of `B`.
    #[must_use]
    pub fn rows(self) -> usize {
        self.m + self.p
    }

    /// Integrated quantities: coordinates, gaps, slips, and the work of friction if any.
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

    /// `phi`, `k`.
    #[must_use]
    pub fn equality(self) -> Range<usize> {
        after(self.static_limit(), self.k)
    }

    /// `G`, `k x n`.
    #[must_use]
    pub fn equality_gradient(self) -> Range<usize> {
        after(self.equality(), self.k * self.n)
    }

    /// `c`, `k`.
    #[must_use]
    pub fn equality_curvature(self) -> Range<usize> {
        after(self.equality_gradient(), self.k)
    }

    /// `phi_t`, `k`.
    #[must_use]
    pub fn equality_rate(self) -> Range<usize> {
        after(self.equality_curvature(), self.k)
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

    /// Writes `M`, `F`, `g`, `N`, `h`, `g_t` and the friction data at time `t`, coordinates `q` and
    /// velocities `w` into `out`, in the order of [`Layout`]. Numbers that are not finite end the
    /// run with a status.
    ///
    /// # Errors
    /// Errors of the system; they end the run, which keeps its results so far.
    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E>;

    /// The same over what [`Self::evaluate`] has written into `out` before: numbers that never change
    /// may be left as they are.
    ///
    /// # Errors
    /// As [`Self::evaluate`].
    fn evaluate_again(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.evaluate(t, q, w, out)
    }

    /// Writes `g`, `h` and `g_t` alone, for constant `M` and `N`; other entries of `out` may be
    /// left unchanged.
    ///
    /// # Errors
    /// As [`Self::evaluate`].
    fn evaluate_gaps(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.evaluate_again(t, q, w, out)
    }

    /// Writes `phi`, `G`, `c` and `phi_t` alone: what else is in `out` may be overwritten.
    ///
    /// # Errors
    /// As [`Self::evaluate`].
    fn evaluate_equalities(
        &mut self,
        t: f64,
        q: &[f64],
        w: &[f64],
        out: &mut [f64],
    ) -> Result<(), E> {
        self.evaluate_again(t, q, w, out)
    }

    /// Whether [`Self::evaluate_equalities`] computes no forces.
    fn has_separate_equalities(&self) -> bool {
        false
    }

    /// The contact force of a compliant gap whose law is a function, at a depth `>= 0` and its rate.
    ///
    /// # Errors
    /// As [`Self::evaluate`].
    fn contact_force(&mut self, _gap: usize, _depth: f64, _rate: f64) -> Result<f64, E> {
        Ok(0.0)
    }

    /// Whether `M`, `F`, `N` and `g_t` are constants: contact forces hold no surprise then, such as
    /// a pulse, and are not probed for one.
    fn is_steady(&self) -> bool {
        false
    }

    /// Whether all numbers are smooth functions of the state alone: flights hold no pulse that long
    /// steps might miss, and are not probed for one.
    fn is_autonomous(&self) -> bool {
        false
    }

    /// The matrices, loads and gaps, where the system is a linear one.
    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        None
    }

    /// Whether `M` and `N` never change, and no part of the gaps depends on velocities:
    /// [`Self::evaluate_gaps`] needs no forces then.
    fn has_constant_matrices(&self) -> bool {
        self.linear().is_some()
    }

    /// Takes rotations that are farther than `far` from the middle of their chart, whose edge is at one, into
    /// their other chart: coordinates and velocities change, the motion does not. Whether there were such.
    fn change_charts(&self, _far: f64, _q: &mut [f64], _w: &mut [f64]) -> bool {
        false
    }
}

/// A borrowed system, possibly of dynamic type (`dyn`).
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

    fn evaluate_equalities(
        &mut self,
        t: f64,
        q: &[f64],
        w: &[f64],
        out: &mut [f64],
    ) -> Result<(), E> {
        (**self).evaluate_equalities(t, q, w, out)
    }

    fn has_separate_equalities(&self) -> bool {
        (**self).has_separate_equalities()
    }

    fn contact_force(&mut self, gap: usize, depth: f64, rate: f64) -> Result<f64, E> {
        (**self).contact_force(gap, depth, rate)
    }

    fn is_steady(&self) -> bool {
        (**self).is_steady()
    }

    fn is_autonomous(&self) -> bool {
        (**self).is_autonomous()
    }

    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        (**self).linear()
    }

    fn has_constant_matrices(&self) -> bool {
        (**self).has_constant_matrices()
    }

    fn change_charts(&self, far: f64, q: &mut [f64], w: &mut [f64]) -> bool {
        (**self).change_charts(far, q, w)
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

// A mechanical system under a control that acts through a matrix of inputs.
//
// ```text
// M q'' = F + B(t, q) u + N^T lambda
// ```

/// The matrix `B`, `n x r` row by row.
#[derive(Clone, Debug)]
pub enum InputMatrix<F> {
    /// Constant.
    Constant(Vec<f64>),
    /// A function of time and coordinates that fills it in.
    Function(F),
}

/// A system with the force `B u` of a control that is held.
#[derive(Clone, Debug)]
pub struct Driven<D, F> {
    dynamics: D,
    inputs: InputMatrix<F>,
    u: Vec<f64>,
    /// `B`, if a function.
    matrix: Vec<f64>,
    /// `B u`.
    force: Vec<f64>,
    /// How much nearer walls are than the system says; of no gap if empty.
    offsets: Vec<f64>,
}

impl<D, F> Driven<D, F> {
    /// A system of `n` coordinates with `r` inputs, which are zero; `None` if a constant matrix has
    /// another size.
    pub fn new(dynamics: D, (n, r): (usize, usize), inputs: InputMatrix<F>) -> Option<Self> {
        if let InputMatrix::Constant(matrix) = &inputs {
            if matrix.len() != n * r {
                return None;
            }
        }
        let (matrix, force) = (vec![0.0; n * r], vec![0.0; n]);
        Some(Self { dynamics, inputs, u: vec![0.0; r], matrix, force, offsets: Vec::new() })
    }

    /// Holds this control from here on.
    pub fn hold(&mut self, u: &[f64]) {
        self.u.copy_from_slice(u);
        if let InputMatrix::Constant(matrix) = &self.inputs {
            product(matrix, &self.u, &mut self.force);
        }
    }

    /// Holds none.
    pub fn release(&mut self) {
        self.u.fill(0.0);
        self.force.fill(0.0);
    }

    /// From here on gaps are smaller by these numbers than the system says; those of none if empty.
    pub fn offset(&mut self, by: &[f64]) {
        self.offsets.clear();
        self.offsets.extend_from_slice(by);
    }

    /// `B`, `n x r` row by row, at its last evaluation.
    pub fn matrix(&self) -> &[f64] {
        match &self.inputs {
            InputMatrix::Constant(matrix) => matrix,
            InputMatrix::Function(_) => &self.matrix,
        }
    }

    /// The control that is held.
    pub fn control(&self) -> &[f64] {
        &self.u
    }
}

/// `to = B u`.
fn product(matrix: &[f64], u: &[f64], to: &mut [f64]) {
    for (i, to) in to.iter_mut().enumerate() {
        let row = &matrix[i * u.len()..][..u.len()];
        *to = row.iter().zip(u).map(|(b, u)| b * u).sum();
    }
}

impl<E, D, F> Dynamics<E> for Driven<D, F>
where
    D: Dynamics<E>,
    F: FnMut(f64, &[f64], &mut [f64]) -> Result<(), E>,
{
    fn layout(&self) -> Layout {
        self.dynamics.layout()
    }

    fn friction(&self) -> &Friction {
        self.dynamics.friction()
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.dynamics.evaluate(t, q, w, out)?;
        if let InputMatrix::Function(function) = &mut self.inputs {
            function(t, q, &mut self.matrix)?;
            product(&self.matrix, &self.u, &mut self.force);
        }
        let force = &mut out[self.dynamics.layout().force()];
        force.iter_mut().zip(&self.force).for_each(|(to, force)| *to += force);
        let gaps = &mut out[self.dynamics.layout().gap()];
        gaps.iter_mut().zip(&self.offsets).for_each(|(gap, offset)| *gap -= offset);
        Ok(())
    }

    fn evaluate_equalities(
        &mut self,
        t: f64,
        q: &[f64],
        w: &[f64],
        out: &mut [f64],
    ) -> Result<(), E> {
        self.dynamics.evaluate_equalities(t, q, w, out)
    }

    fn has_separate_equalities(&self) -> bool {
        self.dynamics.has_separate_equalities()
    }

    fn contact_force(&mut self, gap: usize, depth: f64, rate: f64) -> Result<f64, E> {
        self.dynamics.contact_force(gap, depth, rate)
    }

    fn is_steady(&self) -> bool {
        self.dynamics.is_steady() && matches!(self.inputs, InputMatrix::Constant(_))
    }

    /// None: the control is no load of the linear system.
    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        None
    }

    fn change_charts(&self, far: f64, q: &mut [f64], w: &mut [f64]) -> bool {
        self.dynamics.change_charts(far, q, w)
    }
}

// One value of the force, or why there is none.

/// Evaluates the force, turning NaN and infinity into a failure. For x < 0, where a contact law may
/// be undefined, a failing force is evaluated at the wall instead.
#[inline]
pub(crate) fn finite_force<E>(
    force: &mut impl Force<E>,
    t: f64,
    state: Physical,
) -> Result<f64, Failure<E>> {
    match evaluate(force, t, state) {
        Err(failure) if ends_at_the_wall(force, state, &failure) => {
            evaluate(force, t, Physical { x: 0.0, ..state })
        }
        value => value,
    }
}

/// Whether a force that failed may have a value at the wall.
#[cold]
pub(crate) fn ends_at_the_wall<E>(
    force: &impl Force<E>,
    state: Physical,
    failure: &Failure<E>,
) -> bool {
    state.x < 0.0
        && match failure {
            Failure::Raised(error) => !force.is_interruption(error),
            Failure::Status(_) => true,
        }
}

/// Evaluates the force, turning NaN and infinity into a failure.
#[inline]
pub(crate) fn evaluate<E>(
    force: &mut impl Force<E>,
    t: f64,
    state: Physical,
) -> Result<f64, Failure<E>> {
    let value = force.at(t, state.x, state.xdot).map_err(Failure::Raised)?;
    if value.is_finite() {
        Ok(value)
    } else {
        Err(Failure::Status(Status::ForceNotFinite))
    }
}

/// Rejects a state that is not finite or has x < 0.
pub(crate) fn check_initial(initial: Physical) -> Result<(), SetupError> {
    if !(initial.x >= 0.0 && initial.x.is_finite()) {
        return Err(SetupError::Setting("x0", initial.x, "a finite distance >= 0 from the wall"));
    }
    if !initial.xdot.is_finite() {
        return Err(SetupError::Setting("xdot0", initial.xdot, "a finite velocity"));
    }
    Ok(())
}
