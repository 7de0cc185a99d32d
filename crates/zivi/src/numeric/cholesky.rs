//! Symmetric positive definite systems of a few unknowns, `A = L L^T`, row by row.

/// Overwrites the lower triangle of `A` (`n x n`) by `L`. The smallest `l_ii^2/a_ii`: what is left
/// of a diagonal entry by the rows above, 1 for a diagonal matrix, 0 where `A` is singular and
/// negative or NaN where it is not definite.
pub(crate) fn factor(a: &mut [f64], n: usize) -> f64 {
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

#[cfg(test)]
mod tests {
    use super::*;

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
