//! The memory of the solver, carved from one slice of reals and one of indices.

use crate::vi::natural::natural_component;
use crate::vi::newton;
use crate::vi::pivotal::PivotalWorkspace;
use crate::vi::problem::steps_into;
use crate::vi::stages::{Iterate, Outcome};
use core::slice::ChunksExact;

/// Vectors of length `n` beside the two `n x n` matrices.
const VECTORS: usize = 24;

/// Lengths of the two slices a solve with `n` unknowns works in: reals and indices.
///
/// ```
/// let (reals, indices) = zivi_core::vi::workspace_len(3);
/// let (mut reals, mut indices) = (vec![0.0; reals], vec![0; indices]);
/// assert!(zivi_core::vi::Workspace::new(3, &mut reals, &mut indices).is_some());
/// ```
#[must_use]
pub const fn workspace_len(n: usize) -> (usize, usize) {
    (2 * n * n + VECTORS * n, 2 * n)
}

/// The memory of a solve with `n` unknowns. Nothing in it is read before it is written.
#[derive(Debug)]
pub struct Workspace<'a> {
    pub(super) pivotal: PivotalWorkspace<'a>,
    pub(super) jacobian: &'a mut [f64],
    pub(super) f: &'a mut [f64],
    pub(super) phi: &'a mut [f64],
    pub(super) gradient: &'a mut [f64],
    pub(super) slope_z: &'a mut [f64],
    pub(super) slope_f: &'a mut [f64],
    pub(super) step: &'a mut [f64],
    pub(super) trial: &'a mut [f64],
    pub(super) trial_f: &'a mut [f64],
    pub(super) lower: &'a mut [f64],
    pub(super) upper: &'a mut [f64],
    pub(super) scale: &'a mut [f64],
    pub(super) start: &'a mut [f64],
    pub(super) centre: &'a mut [f64],
    pub(super) best: &'a mut [f64],
    pub(super) point: &'a mut [f64],
    pub(super) neighbour: &'a mut [f64],
    pub(super) weights: &'a mut [f64],
}

impl<'a> Workspace<'a> {
    /// `None` where a slice is shorter than [`workspace_len`] says.
    #[must_use]
    pub fn new(n: usize, reals: &'a mut [f64], indices: &'a mut [usize]) -> Option<Self> {
        let (mut reals, mut indices) = (reals, indices);
        let pivotal = PivotalWorkspace {
            inverse: take(&mut reals, n * n)?,
            values: take(&mut reals, n)?,
            direction: take(&mut reals, n)?,
            covering: take(&mut reals, n)?,
            resting: take(&mut reals, n)?,
            column: take(&mut reals, n)?,
            pivot_row: take(&mut reals, n)?,
            residual: take(&mut reals, n)?,
            members: take(&mut indices, n)?,
            held: take(&mut indices, n)?,
        };
        let jacobian = take(&mut reals, n * n)?;
        let mut vector = || take(&mut reals, n);
        Some(Self {
            pivotal,
            jacobian,
            f: vector()?,
            phi: vector()?,
            gradient: vector()?,
            slope_z: vector()?,
            slope_f: vector()?,
            step: vector()?,
            trial: vector()?,
            trial_f: vector()?,
            lower: vector()?,
            upper: vector()?,
            scale: vector()?,
            start: vector()?,
            centre: vector()?,
            best: vector()?,
            point: vector()?,
            neighbour: vector()?,
            weights: vector()?,
        })
    }
}

impl Workspace<'_> {
    /// `F` at the end of the last solve (NaN where it is not known there).
    #[must_use]
    pub fn map(&self) -> &[f64] {
        self.trial_f
    }
}

/// The first `length` entries of `rest`, which keeps the others.
fn take<'a, T>(rest: &mut &'a mut [T], length: usize) -> Option<&'a mut [T]> {
    let (head, tail) = core::mem::take(rest).split_at_mut_checked(length)?;
    *rest = tail;
    Some(head)
}

// Vectors and square row-major matrices on slices, without panics: what lies outside a slice
// reads as NaN and is not written.

/// `v_i`.
#[inline]
pub(super) fn at(v: &[f64], i: usize) -> f64 {
    v.get(i).copied().unwrap_or(f64::NAN)
}

/// `v_i <- value`.
#[inline]
pub(super) fn put<T>(v: &mut [T], i: usize, value: T) {
    if let Some(slot) = v.get_mut(i) {
        *slot = value;
    }
}

/// The rows of an `n x n` matrix.
#[inline]
pub(super) fn rows(matrix: &[f64], n: usize) -> ChunksExact<'_, f64> {
    matrix.chunks_exact(n.max(1))
}

/// Row `i` of an `n x n` matrix.
#[inline]
pub(super) fn row(matrix: &[f64], n: usize, i: usize) -> &[f64] {
    matrix.get(i * n..(i + 1) * n).unwrap_or(&[])
}

/// `to <- from`, over the shorter of the two.
#[inline]
pub(super) fn copy(to: &mut [f64], from: &[f64]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
}

/// `a . b`, in four partial sums so that it vectorises.
#[inline]
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let tail: f64 = a4.remainder().iter().zip(b4.remainder()).map(|(a, b)| a * b).sum();
    let mut sums = [0.0; 4];
    for (a, b) in a4.zip(b4) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    sums.iter().sum::<f64>() + tail
}

/// The range from the first to the last entry that is not zero.
#[inline]
pub(super) fn support(v: &[f64]) -> core::ops::Range<usize> {
    match (v.iter().position(|v| *v != 0.0), v.iter().rposition(|v| *v != 0.0)) {
        (Some(first), Some(last)) => first..last + 1,
        _ => 0..0,
    }
}

/// The part of `v` in a range; empty where there is none.
#[inline]
pub(super) fn part(v: &[f64], range: core::ops::Range<usize>) -> &[f64] {
    v.get(range).unwrap_or(&[])
}

/// `y <- y + a x`.
#[inline]
pub(super) fn axpy(y: &mut [f64], a: f64, x: &[f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x);
}

/// Lists which of `0..n` are in a set; how many there are.
#[inline]
pub(super) fn list(n: usize, holds: impl Fn(usize) -> bool, to: &mut [usize]) -> usize {
    let mut size = 0;
    for i in (0..n).filter(|&i| holds(i)) {
        put(to, size, i);
        size += 1;
    }
    size
}

/// `to_k <- v_j` for the `k`-th `j` of a list.
#[inline]
pub(super) fn pick(to: &mut [f64], v: &[f64], list: &[usize]) {
    to.iter_mut().zip(list).for_each(|(to, &j)| *to = at(v, j));
}

/// `v_i <- s_i v_i`.
#[inline]
pub(super) fn scale(v: &mut [f64], scale: &[f64]) {
    v.iter_mut().zip(scale).for_each(|(v, scale)| *v *= scale);
}

/// Entries that are looked at together, so that it vectorises.
const LANES: usize = 16;

/// `max |v_i|`; NaN entries are passed over.
#[inline]
pub(super) fn norm(v: &[f64]) -> f64 {
    // a comparison that drops NaN
    let larger = |worst: f64, v: &f64| if v.abs() > worst { v.abs() } else { worst };
    let whole = v.chunks_exact(LANES);
    let rest = whole.remainder().iter().fold(0.0, larger);
    let mut worst = [0.0; LANES];
    for part in whole {
        worst.iter_mut().zip(part).for_each(|(worst, v)| *worst = larger(*worst, v));
    }
    worst.iter().fold(rest, larger)
}

/// True when every entry is finite.
#[inline]
pub(super) fn is_finite(v: &[f64]) -> bool {
    // without a jump at every entry
    v.chunks(LANES).all(|part| part.iter().fold(true, |all, v| all & v.is_finite()))
}

/// `z` moved to the nearest point of `[lower, upper]`.
#[inline]
pub(super) fn project(z: &mut [f64], lower: &[f64], upper: &[f64]) {
    for (z, (&lower, &upper)) in z.iter_mut().zip(lower.iter().zip(upper)) {
        *z = z.max(lower).min(upper);
    }
}

/// Whether it is time, after `step` pivots, columns or rows with as many rows of `n` entries, to look
/// at whoever may want to interrupt: every ten milliseconds or so.
#[inline]
pub(super) fn is_time_to_poll(step: usize, n: usize) -> bool {
    let every = (4_000_000 / n.saturating_mul(n).max(1)).clamp(1, 32);
    step % every == every - 1
}

/// Overwrites the leading `k x k` matrix (row length `k`) by its factors `P A = L U` with partial
/// pivoting on rows of comparable size; returns `min |u_ii| / max |u_ii|`, 0 when singular. Zeros
/// outside a band cost nothing but a look.
///
/// # Errors
/// Those of `poll`, which is called now and then.
pub fn factor<E>(
    matrix: &mut [f64],
    k: usize,
    permutation: &mut [usize],
    poll: &mut dyn FnMut() -> Result<(), E>,
) -> Result<f64, E> {
    let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
    for step in 0..k {
        if is_time_to_poll(step, k) {
            poll()?;
        }
        let best = (step..k).fold((step, -1.0), |best, i| {
            let size = at(matrix, i * k + step).abs();
            if size > best.1 {
                (i, size)
            } else {
                best
            }
        });
        let (pivot_row, size) = best;
        put(permutation, step, pivot_row);
        if size <= 0.0 || !size.is_finite() {
            return Ok(0.0);
        }
        swap_rows(matrix, k, step, pivot_row);
        (least, most) = (least.min(size), most.max(size));
        let (above, below) = match matrix.split_at_mut_checked((step + 1) * k) {
            Some(halves) => halves,
            None => return Ok(0.0),
        };
        let pivot = above.get(step * k + step..).unwrap_or(&[]);
        let pivot = part(pivot, 0..support(pivot).end);
        for row in below.chunks_exact_mut(k).take(k - step - 1) {
            let ahead = row.get_mut(step..).unwrap_or(&mut []);
            if let (Some((lead, rest)), Some((by, tail))) =
                (ahead.split_first_mut(), pivot.split_first())
            {
                *lead /= *by;
                if *lead != 0.0 {
                    axpy(rest, -*lead, tail);
                }
            }
        }
    }
    Ok(if k == 0 { 1.0 } else { least / most })
}

fn swap_rows(matrix: &mut [f64], k: usize, i: usize, j: usize) {
    if i == j {
        return;
    }
    let (i, j) = (i.min(j), i.max(j));
    if let Some((head, tail)) = matrix.split_at_mut_checked(j * k) {
        let upper = head.get_mut(i * k..(i + 1) * k).unwrap_or(&mut []);
        upper.iter_mut().zip(tail).for_each(|(a, b)| core::mem::swap(a, b));
    }
}

/// Solves `A x = b` in place from the factors of [`factor`].
pub(super) fn solve(factors: &[f64], k: usize, permutation: &[usize], b: &mut [f64]) {
    for (i, &p) in permutation.iter().enumerate().take(k) {
        if p != i && p < b.len() {
            b.swap(i, p);
        }
    }
    for i in 1..k {
        let done = dot(row(factors, k, i).get(..i).unwrap_or(&[]), b.get(..i).unwrap_or(&[]));
        let reduced = at(b, i) - done;
        put(b, i, reduced);
    }
    for i in (0..k).rev() {
        let ahead = row(factors, k, i).get(i + 1..).unwrap_or(&[]);
        let done = dot(ahead, b.get(i + 1..k).unwrap_or(&[]));
        let solved = (at(b, i) - done) / at(factors, i * k + i);
        put(b, i, solved);
    }
}

// The Jacobian at the iterate and what follows from it.

impl Iterate<'_, '_> {
    /// The Jacobian at the iterate, `Phi`, its slopes and the gradient of the merit
    /// `H' Phi`, `H = diag(slope_z) + diag(slope_f) J`. False where the Jacobian is not finite.
    pub(super) fn linearise(&mut self) -> Outcome<bool> {
        let n = self.n();
        copy(self.work.trial, self.z);
        copy(self.work.trial_f, self.work.f);
        let finite = self.jacobian_at_trial()?;
        let work = &mut *self.work;
        for i in 0..n {
            let (z, f) = (at(self.z, i), at(work.f, i));
            let (lower, upper) = (at(self.lower, i), at(self.upper, i));
            let (slope_z, slope_f) = newton::slopes(z, f, lower, upper);
            put(work.phi, i, newton::component(z, f, lower, upper));
            put(work.slope_z, i, slope_z);
            put(work.slope_f, i, slope_f);
        }
        for ((g, phi), slope) in work.gradient.iter_mut().zip(&*work.phi).zip(&*work.slope_z) {
            *g = phi * slope;
        }
        for (i, row) in rows(work.jacobian, n).enumerate() {
            let weight = at(work.phi, i) * at(work.slope_f, i);
            if weight != 0.0 {
                axpy(work.gradient, weight, row);
            }
        }
        Ok(finite)
    }

    /// The scaled Jacobian at `work.trial`, where `F` is `work.trial_f`; entries that are not
    /// finite by differences. False where these are not finite either. That of an affine `F` is
    /// evaluated once.
    pub(super) fn jacobian_at_trial(&mut self) -> Outcome<bool> {
        let n = self.n();
        self.problem.poll()?;
        if self.jacobian_is_known && self.problem.is_affine() {
            return Ok(true);
        }
        let work = &mut *self.work;
        self.counts.jacobian += 1;
        self.inside_is_regular = false;
        self.problem.jacobian(work.trial, work.jacobian)?;
        let rows = work.jacobian.chunks_exact_mut(n).zip(work.scale.iter());
        for (row, scale) in rows.filter(|(_, scale)| **scale != 1.0) {
            row.iter_mut().for_each(|entry| *entry *= scale);
        }
        self.jacobian_is_known = is_finite(work.jacobian) || self.mend_jacobian()?;
        Ok(self.jacobian_is_known)
    }

    /// `J_ij <- (F_i(z + h e_j) - F_i(z)) / h` for the entries that are not finite, towards the
    /// farther bound, or else the nearer one.
    fn mend_jacobian(&mut self) -> Outcome<bool> {
        let n = self.n();
        for j in 0..n {
            let is_whole =
                self.work.jacobian.iter().skip(j).step_by(n).all(|entry| entry.is_finite());
            if is_whole {
                continue;
            }
            let z = at(self.work.trial, j);
            let room = [at(self.upper, j) - z, at(self.lower, j) - z];
            let mut mended = room == [0.0; 2] && self.clear_column(j);
            for step in steps_into(z, room, self.problem.rounding()) {
                mended = mended || self.difference_column(j, step)?;
            }
            if !mended {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// A fixed component does not move: what `F` would do with it does not matter.
    fn clear_column(&mut self, j: usize) -> bool {
        let n = self.n();
        let column = self.work.jacobian.iter_mut().skip(j).step_by(n);
        column.filter(|entry| !entry.is_finite()).for_each(|entry| *entry = 0.0);
        true
    }

    /// The entries of column `j` that are not finite, by the quotient over `step`.
    fn difference_column(&mut self, j: usize, step: f64) -> Outcome<bool> {
        let n = self.n();
        let work = &mut *self.work;
        let z = at(work.trial, j);
        let moved = z + step;
        if moved == z {
            return Ok(false);
        }
        self.problem.poll()?;
        self.counts.f += 1;
        put(work.trial, j, moved);
        let done = self.problem.map(work.trial, work.neighbour);
        put(work.trial, j, z);
        done?;
        scale(work.neighbour, work.scale);
        let values = work.neighbour.iter().zip(work.trial_f.iter());
        let column = work.jacobian.iter_mut().skip(j).step_by(n);
        for (entry, (there, here)) in column.zip(values).filter(|(entry, _)| !entry.is_finite()) {
            *entry = (there - here) / (moved - z);
        }
        Ok(self.work.jacobian.iter().skip(j).step_by(n).all(|entry| entry.is_finite()))
    }
}

/// Share of a row's terms that the differences of `F` must show.
const STEEP_ENOUGH: f64 = 0.1;

impl Iterate<'_, '_> {
    /// Whether the rows whose rounding is taken for their tolerance are as steep as the Jacobian
    /// says. Each component moves by `d_j = +-h |z_j|`, `h` the cube root of the rounding, in the
    /// direction in which all terms of the row grow, or backwards where a bound is in the way:
    ///
    /// ```text
    /// F_i(z + d forwards) - F_i(z + d backwards) = h sum_j |J_ij z_j| + O(h^2)
    /// ```
    pub(super) fn rows_are_as_steep(&mut self) -> Outcome<bool> {
        if self.problem.is_affine() || self.problem.is_differenced() {
            return Ok(true); // the Jacobian is made of F
        }
        for i in 0..self.n() {
            let (z, f) = (at(self.z, i), at(self.work.f, i));
            let (lower, upper) = (at(self.lower, i), at(self.upper, i));
            let at_tolerance = natural_component(z, f, lower, upper).abs() <= self.tol;
            if !at_tolerance && !self.row_is_as_steep(i)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn row_is_as_steep(&mut self, i: usize) -> Outcome<bool> {
        let mut ends = [0.0; 2];
        let mut expected = 0.0;
        for (end, backwards) in ends.iter_mut().zip([false, true]) {
            expected += self.move_along_row(i, backwards);
            if !self.evaluate_trial()? {
                return Ok(false);
            }
            *end = at(self.work.trial_f, i);
        }
        let [forth, back] = ends;
        Ok(forth - back >= STEEP_ENOUGH * expected)
    }

    /// `trial <- z + d` for the components that can move forwards, or for the others; returns what
    /// row `i` should change by.
    fn move_along_row(&mut self, i: usize, backwards: bool) -> f64 {
        let relative = libm::cbrt(self.problem.rounding());
        let n = self.n();
        let mut change = 0.0;
        for j in 0..n {
            let z = at(self.z, j);
            let (lower, upper) = (at(self.lower, j), at(self.upper, j));
            let slope = at(self.work.jacobian, i * n + j);
            let step = relative * z.abs() * slope.signum();
            let is_inside = |z: f64| lower <= z && z <= upper;
            let moved = match (is_inside(z + step), backwards) {
                (true, false) => z + step,
                (false, true) if is_inside(z - step) => z - step,
                _ => z,
            };
            put(self.work.trial, j, moved);
            change += (slope * (moved - z)).abs();
        }
        change
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod workspace_tests {
    use super::*;

    #[test]
    fn the_lengths_are_exactly_enough() {
        let (reals, indices) = workspace_len(3);
        let (mut r, mut i) = ([0.0; 200], [0; 20]);
        let fits =
            |reals: &mut [f64], indices: &mut [usize]| Workspace::new(3, reals, indices).is_some();
        assert!(fits(&mut r[..reals], &mut i[..indices]));
        assert!(!fits(&mut r[..reals - 1], &mut i[..indices]));
        assert!(!fits(&mut r[..reals], &mut i[..indices - 1]));
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod dense_tests {
    use super::*;

    #[test]
    fn factors_solve_and_tell_a_singular_matrix() {
        let mut a = [0.0, 2.0, 1.0, 1.0, 1.0, 0.0, 3.0, 0.0, -1.0];
        let x = [1.0, -2.0, 0.5];
        let mut b = [0, 1, 2].map(|i| dot(row(&a, 3, i), &x));
        let mut permutation = [0; 3];
        let mut factor = |a: &mut [f64], k| {
            let mut poll = || Ok::<(), ()>(());
            (super::factor(a, k, &mut permutation, &mut poll), permutation)
        };
        let (ratio, order) = factor(&mut a, 3);
        assert!(ratio > Ok(0.05));
        solve(&a, 3, &order, &mut b);
        assert!(b.iter().zip(x).all(|(b, x)| (b - x).abs() < 1e-15), "{b:?}");
        let mut singular = [1.0, 2.0, 2.0, 4.0];
        assert_eq!(factor(&mut singular, 2).0, Ok(0.0));
    }

    #[test]
    fn products_of_every_length() {
        for n in 0..10 {
            let v = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0];
            let v = &v[..n];
            assert_eq!(dot(v, v), (n * (n + 1) * (2 * n + 1) / 6) as f64);
        }
    }
}
