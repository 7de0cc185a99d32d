//! Vectors and square row-major matrices on slices, without panics: what lies outside a slice
//! reads as NaN and is not written.

use core::slice::ChunksExact;

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

/// The part of `v` in a range, possibly empty.
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

/// Entries processed together for vectorisation.
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

/// Whether it is time, after `step` pivots, columns or rows with as many rows of `n` entries, to
/// check for interruption, about every ten milliseconds.
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

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
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
