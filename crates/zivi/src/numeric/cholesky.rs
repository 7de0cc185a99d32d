//! Symmetric positive definite systems: of a few unknowns `A = L L^T`, row by row, of more
//! `A = L^T L` from the last row up, which keeps the zeros of a tree whose parents come first.

use crate::numeric::dense::{axpy, dot};

/// Overwrites the lower triangle of `A` (`n x n`) by `L`. The smallest `l_ii^2/a_ii`: the remaining
/// share of a diagonal entry after the rows above, 1 for a diagonal matrix, 0 for singular `A`,
/// negative or NaN for indefinite `A`.
pub(crate) fn factor(a: &mut [f64], n: usize) -> f64 {
    // of a size that the compiler knows the loops are unrolled
    match n {
        1 => factor_sized(a, 1),
        2 => factor_sized(a, 2),
        3 => factor_sized(a, 3),
        4 => factor_sized(a, 4),
        _ => factor_sized(a, n),
    }
}

#[inline(always)]
fn factor_sized(a: &mut [f64], n: usize) -> f64 {
    let a = &mut a[..n * n];
    let mut least = 1.0_f64;
    for i in 0..n {
        for j in 0..=i {
            let (above, row) = a.split_at_mut(i * n);
            let product = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
            if j < i {
                let other = &above[j * n..][..=j];
                row[j] = (row[j] - product(&row[..j], &other[..j])) / other[j];
            } else {
                let left = row[i] - product(&row[..i], &row[..i]);
                let part = if row[i] > 0.0 { left / row[i] } else { -1.0 };
                least = if part < least || part.is_nan() { part } else { least };
                row[i] = left.sqrt();
            }
        }
    }
    least
}

/// `b <- A^-1 b` from the `L` of [`factor`].
pub(crate) fn solve(l: &[f64], n: usize, b: &mut [f64]) {
    match n {
        1 => solve_sized(l, 1, b),
        2 => solve_sized(l, 2, b),
        3 => solve_sized(l, 3, b),
        4 => solve_sized(l, 4, b),
        _ => solve_sized(l, n, b),
    }
}

#[inline(always)]
fn solve_sized(l: &[f64], n: usize, b: &mut [f64]) {
    let (l, b) = (&l[..n * n], &mut b[..n]);
    for i in 0..n {
        let row = &l[i * n..][..=i];
        let done: f64 = row[..i].iter().zip(&*b).map(|(l, b)| l * b).sum();
        b[i] = (b[i] - done) / row[i];
    }
    for i in (0..n).rev() {
        let done: f64 = (i + 1..n).map(|k| l[k * n + i] * b[k]).sum();
        b[i] = (b[i] - done) / l[i * n + i];
    }
}

/// Overwrites the lower triangle of `A` by `L` of `A = L^T L` and returns the smallest `l_ii^2/a_ii`. Rows are
/// computed from the last one up: each row loses its products with the rows below, without the zeros (R.
/// Featherstone, Rigid Body Dynamics Algorithms, 2008, section 6.5).
fn factor_from_end(a: &mut [f64], n: usize) -> f64 {
    let mut least = 1.0_f64;
    for i in (0..n).rev() {
        let (above, below) = a.split_at_mut((i + 1) * n);
        let row = &mut above[i * n..][..=i];
        let diagonal = row[i];
        let rows = |k: usize| &below[(k - i - 1) * n..][..=i];
        let (mut found, mut four) = (0, [(0.0, &below[..0]); 4]);
        for k in (i + 1..n).rev() {
            let other = rows(k);
            if other[i] == 0.0 {
                continue;
            }
            four[found] = (other[i], other);
            found += 1;
            if found == 4 {
                subtract(row, four);
                found = 0;
            }
        }
        four[..found].iter().for_each(|(factor, other)| axpy(row, -factor, other));
        let part = if diagonal > 0.0 { row[i] / diagonal } else { -1.0 };
        least = if part < least || part.is_nan() { part } else { least };
        let pivot = row[i].sqrt();
        let inverse = 1.0 / pivot;
        row[..i].iter_mut().for_each(|entry| *entry *= inverse);
        row[i] = pivot;
    }
    least
}

/// `y <- y - a_0 x_0 - a_1 x_1 - a_2 x_2 - a_3 x_3`.
#[inline(always)]
fn subtract(y: &mut [f64], of: [(f64, &[f64]); 4]) {
    let n = y.len();
    let [(a, xa), (b, xb), (c, xc), (d, xd)] = of;
    let (xa, xb, xc, xd) = (&xa[..n], &xb[..n], &xc[..n], &xd[..n]);
    for j in 0..n {
        y[j] = y[j] - a * xa[j] - b * xb[j] - c * xc[j] - d * xd[j];
    }
}

/// The factor of a matrix that is often the same again.

#[derive(Clone, Debug)]
pub(crate) struct Factor {
    n: usize,
    /// The matrix that was factored last.
    of: Vec<f64>,
    /// `L` by rows: of [`factor`] for few unknowns, of [`factor_from_end`] for many unknowns.
    l: Vec<f64>,
    /// `L` by columns, `L^T` by rows, of few unknowns.
    transposed: Vec<f64>,
    /// `1/l_ii`.
    inverses: Vec<f64>,
    is_known: bool,
    is_diagonal: bool,
}

/// Shorter columns are not worth vectorising.
const COLUMNS: usize = 5;
/// From here on `A = L^T L`.
const MANY: usize = 9;

impl Factor {
    pub(crate) fn new(n: usize) -> Self {
        let zeros = || vec![0.0; n * n];
        let (of, l, transposed, inverses) = (zeros(), zeros(), zeros(), vec![0.0; n]);
        Self { n, of, l, transposed, inverses, is_known: false, is_diagonal: false }
    }

    /// Whether it is that of this matrix, bit for bit.
    #[inline]
    pub(crate) fn is_of(&self, a: &[f64]) -> bool {
        let same = |same: bool, (x, y): (&f64, &f64)| same & (x.to_bits() == y.to_bits());
        self.is_known && a.iter().zip(&self.of).fold(true, same)
    }

    /// `L^T x`, or `L x` for many unknowns, whose norm is that of `x` in the metric of the matrix.
    pub(crate) fn transposed_times(&self, x: &[f64]) -> Vec<f64> {
        if self.n < MANY {
            return self.transposed.chunks_exact(self.n).map(|row| dot(row, x)).collect();
        }
        let rows = self.l.chunks_exact(self.n).enumerate();
        rows.map(|(i, row)| dot(&row[..=i], &x[..=i])).collect()
    }

    /// Factors another matrix if that is symmetric: whether it is that, and definite.
    pub(crate) fn renew(&mut self, a: &[f64], is_symmetric: bool) -> bool {
        let Self { n, of, l, transposed, inverses, is_known, is_diagonal } = self;
        of.copy_from_slice(a);
        l.copy_from_slice(a);
        let factor = if *n < MANY { factor } else { factor_from_end };
        *is_known = is_symmetric && factor(l, *n) > 0.0;
        *is_diagonal = (0..*n).all(|i| l[i * *n..][..i].iter().all(|l| *l == 0.0));
        for i in 0..*n {
            for j in 0..if *n < MANY { i + 1 } else { 0 } {
                transposed[j * *n + i] = l[i * *n + j];
            }
            inverses[i] = 1.0 / l[i * *n + i];
        }
        *is_known
    }

    /// `b <- A^-1 b`, of few unknowns to the last bit as [`solve`].
    pub(crate) fn solve(&self, b: &mut [f64]) {
        let Self { n, l, transposed, inverses, is_diagonal, .. } = self;
        let n = *n;
        if n < COLUMNS {
            return solve(l, n, b);
        }
        let b = &mut b[..n];
        if *is_diagonal {
            return b.iter_mut().zip(inverses).for_each(|(b, inverse)| *b = *b * inverse * inverse);
        }
        if n >= MANY {
            return self.solve_many(b);
        }
        // by columns, whose entries change at once
        for j in 0..n {
            let column = &transposed[j * n..][..n];
            b[j] *= inverses[j];
            let x = b[j];
            for (b, l) in b[j + 1..].iter_mut().zip(&column[j + 1..]) {
                *b -= l * x;
            }
        }
        for i in (0..n).rev() {
            let row = &l[i * n..][..n];
            b[i] *= inverses[i];
            let x = b[i];
            for (b, l) in b[..i].iter_mut().zip(row) {
                *b -= l * x;
            }
        }
    }
}

impl Factor {
    /// `b <- A^-1 b` with `A = L^T L`: upwards, then downwards.
    fn solve_many(&self, b: &mut [f64]) {
        let Self { n, l, inverses, .. } = self;
        for i in (0..*n).rev() {
            b[i] *= inverses[i];
            let x = b[i];
            if x != 0.0 {
                axpy(&mut b[..i], -x, &l[i * n..][..i]);
            }
        }
        for i in 0..*n {
            b[i] = (b[i] - dot(&l[i * n..][..i], &b[..i])) * inverses[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kept_factor_solves_as_a_new_one() {
        let mut random = 0.3_f64;
        for n in (1..9).chain([12, 20]) {
            let mut draw = || {
                random = (random * 997.0 + 0.1).fract();
                random - 0.5
            };
            let g: Vec<f64> = (0..n * n).map(|_| draw()).collect();
            let b: Vec<f64> = (0..n).map(|_| draw()).collect();
            let row = |i: usize| &g[i * n..][..n];
            let entry = |i: usize, j: usize| {
                let product: f64 = row(i).iter().zip(row(j)).map(|(x, y)| x * y).sum();
                product + if i == j { 1.0 } else { 0.0 }
            };
            let a: Vec<f64> = (0..n * n).map(|k| entry(k / n, k % n)).collect();
            let (mut l, mut x, mut y) = (a.clone(), b.clone(), b.clone());
            assert!(factor(&mut l, n) > 0.0);
            solve(&l, n, &mut x);
            let mut kept = Factor::new(n);
            assert!(!kept.is_of(&a) && kept.renew(&a, true) && kept.is_of(&a));
            kept.solve(&mut y);
            let rounding = if n < COLUMNS { 0.0 } else { 1e-14 };
            assert!(x.iter().zip(&y).all(|(x, y)| (x - y).abs() <= rounding));
            let energy: f64 = kept.transposed_times(&x).iter().map(|it| it * it).sum();
            let work: f64 = x.iter().zip(&b).map(|(x, b)| x * b).sum();
            assert!((energy - work).abs() < 1e-13 * work.abs());
            assert!(!kept.renew(&a, false) && !kept.is_of(&a));
            let negative: Vec<f64> = a.iter().map(|a| -a).collect();
            assert!(!kept.renew(&negative, true) && !kept.is_of(&negative));
        }
    }

    #[test]
    fn solves_what_is_definite_and_tells_what_is_not() {
        let a = [4.0, 2.0, -1.0, 2.0, 3.0, 0.5, -1.0, 0.5, 2.0];
        let (mut l, mut b) = (a, [1.0, -2.0, 0.5]);
        assert!(factor(&mut l, 3) > 0.1);
        solve(&l, 3, &mut b);
        for (row, right) in a.chunks(3).zip([1.0, -2.0, 0.5]) {
            let left: f64 = row.iter().zip(b).map(|(a, x)| a * x).sum();
            assert!((left - right).abs() < 1e-14);
        }
        assert_eq!(factor(&mut [4.0, 0.0, 0.0, 9.0], 2), 1.0);
        assert!(factor(&mut [1.0, 2.0, 2.0, 4.0], 2) <= 0.0);
        assert!(factor(&mut [1.0, 2.0, 2.0, 1.0], 2) < 0.0);
        assert!(factor(&mut [-1.0], 1) < 0.0 && factor(&mut [0.0], 1) < 0.0);
        assert!(factor(&mut [f64::NAN], 1) < 0.0);
    }
}
