//! Square systems of a few unknowns that need not be symmetric nor regular: elimination with
//! complete pivoting.

use crate::numeric::dense::dot;

/// `P A Q = L U` of an `n x n` matrix whose entries are of order one.
#[derive(Clone, Debug, Default)]
pub(crate) struct Elimination {
    n: usize,
    lu: Vec<f64>,
    /// `P` and `Q`: which rows and columns stand where.
    rows: Vec<usize>,
    columns: Vec<usize>,
    rank: usize,
    determinant: f64,
}

impl Elimination {
    /// Of the matrix, row by row. Pivots up to `least` are zero.
    pub(crate) fn new(a: Vec<f64>, n: usize, least: f64) -> Self {
        let (rows, columns) = ((0..n).collect(), (0..n).collect());
        let mut it = Self { n, lu: a, rows, columns, rank: n, determinant: 1.0 };
        for k in 0..n {
            let (mut size, mut at) = (0.0, (k, k));
            for i in k..n {
                for j in k..n {
                    let entry = it.lu[i * n + j].abs();
                    // a NaN would be passed over
                    if entry > size || entry.is_nan() {
                        (size, at) = (entry, (i, j));
                    }
                }
            }
            it.swap(k, at);
            let pivot = it.lu[k * n + k];
            it.determinant *= pivot;
            if size <= least || pivot.is_nan() {
                it.rank = k;
                it.determinant *= (k + 1..n).map(|i| it.lu[i * n + i]).product::<f64>();
                return it;
            }
            for i in k + 1..n {
                let factor = it.lu[i * n + k] / pivot;
                it.lu[i * n + k] = factor;
                for j in k + 1..n {
                    it.lu[i * n + j] -= factor * it.lu[k * n + j];
                }
            }
        }
        it
    }

    fn swap(&mut self, k: usize, (i, j): (usize, usize)) {
        let n = self.n;
        if i != k {
            (0..n).for_each(|c| self.lu.swap(k * n + c, i * n + c));
            self.rows.swap(k, i);
            self.determinant = -self.determinant;
        }
        if j != k {
            (0..n).for_each(|r| self.lu.swap(r * n + k, r * n + j));
            self.columns.swap(k, j);
            self.determinant = -self.determinant;
        }
    }

    /// How many unknowns the system determines.
    pub(crate) fn rank(&self) -> usize {
        self.rank
    }

    /// The determinant.
    pub(crate) fn determinant(&self) -> f64 {
        self.determinant
    }

    /// `A x = b`, with zeros where `x` is not determined.
    pub(crate) fn solve(&self, b: &[f64]) -> Vec<f64> {
        let (n, r) = (self.n, self.rank);
        let mut y: Vec<f64> = self.rows.iter().map(|&i| b[i]).collect();
        for i in 1..r {
            let done: f64 = (0..i).map(|j| self.lu[i * n + j] * y[j]).sum();
            y[i] -= done;
        }
        y[r..].fill(0.0);
        self.back(&mut y);
        self.unordered(&y)
    }

    /// The vectors with `A x = 0`: for each unknown that the others leave free the one in which it is 1
    /// and the other free ones are 0.
    pub(crate) fn null_space(&self) -> Vec<Vec<f64>> {
        let (n, r) = (self.n, self.rank);
        let null = |free: usize| {
            let mut y: Vec<f64> =
                (0..n).map(|i| if i < r { -self.lu[i * n + free] } else { 0.0 }).collect();
            self.back(&mut y);
            y[free] = 1.0;
            self.unordered(&y)
        };
        (r..n).map(null).collect()
    }

    /// `U y = y` of the first rows.
    fn back(&self, y: &mut [f64]) {
        let n = self.n;
        for i in (0..self.rank).rev() {
            let done: f64 = (i + 1..self.rank).map(|j| self.lu[i * n + j] * y[j]).sum();
            y[i] = (y[i] - done) / self.lu[i * n + i];
        }
    }

    fn unordered(&self, y: &[f64]) -> Vec<f64> {
        let mut x = vec![0.0; self.n];
        self.columns.iter().zip(y).for_each(|(&j, &y)| x[j] = y);
        x
    }
}

// Singular values of a few rows and columns, by one-sided rotations (Hestenes, Jacobi).
//
// ```text
// A V = U diag(s)      V orthogonal, its last columns a basis of what A takes to 0
// ```

/// Sweeps over all pairs of columns; about six are needed.
const SWEEPS: usize = 40;

/// The singular values of a matrix with their vectors.
#[derive(Clone, Debug)]
pub(crate) struct Singular {
    rows: usize,
    columns: usize,
    /// `U diag(s)`, column by column, the longest first.
    scaled: Vec<f64>,
    /// `V`, column by column.
    right: Vec<f64>,
    values: Vec<f64>,
}

/// Rotates columns `i < j` of length `size` by an angle.
fn turn(all: &mut [f64], size: usize, (i, j): (usize, usize), (c, s): (f64, f64)) {
    let (head, tail) = all.split_at_mut(j * size);
    for (x, y) in head[i * size..][..size].iter_mut().zip(&mut tail[..size]) {
        (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
    }
}

impl Singular {
    /// Of a matrix, row by row.
    pub(crate) fn new(a: &[f64], rows: usize, columns: usize) -> Self {
        let mut scaled: Vec<f64> =
            (0..rows * columns).map(|k| a[k % rows * columns + k / rows]).collect();
        let mut right = vec![0.0; columns * columns];
        (0..columns).for_each(|j| right[j * columns + j] = 1.0);
        for _ in 0..SWEEPS {
            let mut turned = false;
            for j in 1..columns {
                for i in 0..j {
                    let (x, y) = (&scaled[i * rows..][..rows], &scaled[j * rows..][..rows]);
                    let (a, b, c) = (dot(x, x), dot(y, y), dot(x, y));
                    // written so that a NaN ends it
                    if c * c > f64::EPSILON * f64::EPSILON * a * b {
                        let ratio = (b - a) / (2.0 * c);
                        let tangent = ratio.signum() / (ratio.abs() + ratio.hypot(1.0));
                        let cosine = 1.0 / tangent.hypot(1.0);
                        let by = (cosine, cosine * tangent);
                        turn(&mut scaled, rows, (i, j), by);
                        turn(&mut right, columns, (i, j), by);
                        turned = true;
                    }
                }
            }
            if !turned {
                break;
            }
        }
        let size = |j: usize| dot(&scaled[j * rows..][..rows], &scaled[j * rows..][..rows]).sqrt();
        let mut order: Vec<usize> = (0..columns).collect();
        order.sort_by(|&i, &j| size(j).total_cmp(&size(i)));
        let picked = |all: &[f64], n: usize| -> Vec<f64> {
            order.iter().flat_map(|&j| all[j * n..][..n].iter().copied()).collect()
        };
        let values = order.iter().map(|&j| size(j)).collect();
        let (scaled, right) = (picked(&scaled, rows), picked(&right, columns));
        Self { rows, columns, scaled, right, values }
    }

    /// One for each column, the largest first.
    pub(crate) fn values(&self) -> &[f64] {
        &self.values
    }

    /// How many are above this part of the largest.
    pub(crate) fn rank(&self, part: f64) -> usize {
        let least = part * self.values.first().copied().unwrap_or(0.0);
        self.values.iter().filter(|&&value| value > least).count()
    }

    /// The shortest `x` with the least `|A x - b|`, of a matrix of this rank.
    pub(crate) fn solve(&self, b: &[f64], rank: usize) -> Vec<f64> {
        let mut x = vec![0.0; self.columns];
        for j in 0..rank {
            let of = &self.scaled[j * self.rows..][..self.rows];
            let part = dot(of, b) / self.values[j] / self.values[j];
            let along = &self.right[j * self.columns..][..self.columns];
            x.iter_mut().zip(along).for_each(|(x, v)| *x += part * v);
        }
        x
    }

    /// The vectors that a matrix of this rank takes to 0, one after the other.
    pub(crate) fn null_space(&self, rank: usize) -> &[f64] {
        &self.right[rank * self.columns..]
    }
}

#[cfg(test)]
mod elimination_tests {
    use super::*;

    fn times(a: &[f64], x: &[f64]) -> Vec<f64> {
        a.chunks(x.len()).map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum()).collect()
    }

    #[test]
    fn regular_systems_are_solved() {
        let a = [0.0, 2.0, -1.0, 1.0, 3.0, 0.5, -1.0, 0.25, 2.0];
        let it = Elimination::new(a.to_vec(), 3, 1e-9);
        let x = it.solve(&[1.0, -2.0, 0.5]);
        for (left, right) in times(&a, &x).iter().zip([1.0, -2.0, 0.5]) {
            assert!((left - right).abs() < 1e-14);
        }
        // by the first row
        let exact = -2.0 * (1.0 * 2.0 + 0.5) - 1.0 * (0.25 + 3.0);
        assert!(it.rank() == 3 && (it.determinant() - exact).abs() < 1e-13, "{it:?}");
        assert!(it.null_space().is_empty());
        assert_eq!(Elimination::new(Vec::new(), 0, 1e-9).determinant(), 1.0);
    }

    #[test]
    fn what_is_not_determined_is_told() {
        // the third row is the sum of the others
        let a = [1.0, 2.0, -1.0, 0.5, 3.0, 0.5, 1.5, 5.0, -0.5];
        let it = Elimination::new(a.to_vec(), 3, 1e-9);
        assert!(it.rank() == 2 && it.determinant().abs() < 1e-14);
        let x = it.solve(&[1.0, -2.0, -1.0]);
        let left = times(&a, &x);
        assert!(left.iter().zip([1.0, -2.0, -1.0]).all(|(l, r)| (l - r).abs() < 1e-14), "{left:?}");
        let none = it.null_space();
        assert!(none.len() == 1 && none[0].contains(&1.0));
        assert!(times(&a, &none[0]).iter().all(|y| y.abs() < 1e-14));
        // x + 2 y - z = 0 leaves two unknowns free
        let plane = Elimination::new([[1.0, 2.0, -1.0]; 3].as_flattened().to_vec(), 3, 1e-9);
        let free = plane.null_space();
        assert!(free.len() == 2 && free[0] != free[1]);
        assert!(free.iter().all(|x| (x[0] + 2.0 * x[1] - x[2]).abs() < 1e-15 && x.contains(&1.0)));
        assert_eq!(Elimination::new(vec![0.0; 4], 2, 1e-9).null_space().len(), 2);
        assert_eq!(Elimination::new(vec![f64::NAN, 1.0, 1.0, 1.0], 2, 1e-9).rank(), 0);
    }
}

#[cfg(test)]
mod singular_tests {
    use super::*;

    #[test]
    fn values_are_those_of_a_matrix_that_is_known() {
        // diag(5, 2) between two rotations, and a column that is a multiple of another
        let (c, s) = (0.6, 0.8);
        let a = [5.0 * c * c + 2.0 * s * s, 3.0 * c * s, 3.0 * c * s, 5.0 * s * s + 2.0 * c * c];
        let found = Singular::new(&a, 2, 2);
        assert!((found.values()[0] - 5.0).abs() < 1e-14 && (found.values()[1] - 2.0).abs() < 1e-14);
        let flat = Singular::new(&[1.0, 2.0, -2.0, -4.0], 2, 2);
        assert!((flat.values()[0] - 5.0).abs() < 1e-14 && flat.values()[1] < 1e-14);
        assert_eq!((flat.rank(1e-12), found.rank(1e-12), found.rank(0.5)), (1, 2, 1));
        let none = Singular::new(&[0.0; 6], 2, 3);
        assert_eq!((none.rank(0.0), none.values()), (0, &[0.0; 3][..]));
    }

    #[test]
    fn least_squares_leave_what_is_at_right_angles_and_the_rest_is_no_longer_than_needed() {
        let mut random = 0.3_f64;
        let mut draw = || {
            random = (random * 997.0 + 0.1).fract();
            random - 0.5
        };
        for (rows, columns) in [(1, 1), (2, 4), (4, 2), (3, 3), (1, 5), (5, 5)] {
            let a: Vec<f64> = (0..rows * columns).map(|_| draw()).collect();
            let b: Vec<f64> = (0..rows).map(|_| draw()).collect();
            let found = Singular::new(&a, rows, columns);
            let rank = found.rank(1e-12);
            assert_eq!(rank, rows.min(columns));
            let x = found.solve(&b, rank);
            let left: Vec<f64> =
                (0..rows).map(|i| dot(&a[i * columns..][..columns], &x) - b[i]).collect();
            for j in 0..columns {
                let slope: f64 = (0..rows).map(|i| a[i * columns + j] * left[i]).sum();
                assert!(slope.abs() < 1e-13, "{rows} {columns} {slope:e}");
            }
            let null = found.null_space(rank);
            assert_eq!(null.len(), (columns - rank) * columns);
            for v in null.chunks(columns) {
                assert!(dot(v, &x).abs() < 1e-13 && (dot(v, v) - 1.0).abs() < 1e-14);
                assert!((0..rows).all(|i| dot(&a[i * columns..][..columns], v).abs() < 1e-14));
            }
        }
    }

    #[test]
    fn what_is_no_number_ends_too() {
        assert!(Singular::new(&[f64::NAN, 1.0, 2.0, 3.0], 2, 2)
            .values()
            .iter()
            .any(|it| it.is_nan()));
    }
}
