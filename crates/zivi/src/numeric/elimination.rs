//! Square systems of a few unknowns that need not be symmetric nor regular: elimination with
//! complete pivoting.

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

#[cfg(test)]
mod tests {
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
