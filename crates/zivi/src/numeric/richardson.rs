//! Richardson's extrapolation of vectors `S_k -> S` whose errors fall in known powers.
//!
//! With `S_k^(0) = S + c_1 q^(ak) + c_2 q^((a+1)k) + ...` and the powers `p_j = q^(a+j-1)`,
//!
//! ```text
//! S_k^(j) = (S_k^(j-1) - p_j S_(k-1)^(j-1))/(1 - p_j)                                 (1)
//! ```
//!
//! removes one term after the other.

/// Ratio `q` of the terms of neighbouring rows, and the power that the first column removes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Powers {
    pub(crate) ratio: f64,
    pub(crate) first: f64,
}

/// The newest entry of a column, and what tells its error.
#[derive(Debug)]
pub(crate) struct Entry<'t> {
    /// Number of the column.
    pub(crate) j: usize,
    /// `p_j`, and the power that the next column would remove.
    pub(crate) power: f64,
    next: f64,
    pub(crate) newest: &'t [f64],
    /// The entry of the row before.
    above: &'t [f64],
    /// That of the column before.
    pub(crate) across: &'t [f64],
}

impl Entry<'_> {
    /// The estimated error of a component: the larger of two differences, to the column before and
    /// to the row before. The first alone is optimistic by up to two digits.
    #[inline]
    pub(crate) fn error(&self, c: usize) -> f64 {
        let down = (self.newest[c] - self.above[c]).abs() / (1.0 - self.next);
        (self.newest[c] - self.across[c]).abs().max(down)
    }
}

/// A column that is being made.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Column {
    /// Its number.
    pub(crate) j: usize,
    /// `p_j`.
    pub(crate) power: f64,
    /// How many numbers its entries are together.
    pub(crate) length: usize,
}

/// Makes the columns (1) in the place of the rows, vectors of one length, the newest first, and
/// shows each that has two entries; `across` is memory for one vector.
#[inline]
pub(crate) fn columns(
    rows: &mut [f64],
    across: &mut [f64],
    powers: Powers,
    show: impl FnMut(&Entry<'_>),
) {
    columns_with(rows, across, powers, |_, _| (), show);
}

/// The same with something added to a column before it is shown.
#[inline]
pub(crate) fn columns_with(
    rows: &mut [f64],
    across: &mut [f64],
    Powers { ratio, first }: Powers,
    mut add: impl FnMut(Column, &mut [f64]),
    mut show: impl FnMut(&Entry<'_>),
) {
    let width = across.len();
    let (mut power, mut left) = (first, rows.len() / width);
    for j in 1.. {
        left = left.saturating_sub(1);
        if left < 2 {
            return;
        }
        across.copy_from_slice(&rows[..width]);
        let length = left * width;
        for i in 0..length {
            rows[i] = (rows[i] - power * rows[i + width]) / (1.0 - power);
        }
        add(Column { j, power, length }, rows);
        let (newest, above) = rows.split_at(width);
        show(&Entry { j, power, next: power * ratio, newest, above, across });
        power *= ratio;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_column_removes_its_power_from_each_component() {
        // S_k = S + sum_j c_j q^(jk), j = 2, 3, 4: nothing is left after three columns
        let (q, s) = (0.4_f64, [3.0, -1.0]);
        let c = [[1.0, 2.0], [-0.5, 0.7], [0.2, -0.4]];
        let row = |k: i32| -> [f64; 2] {
            std::array::from_fn(|i| {
                let terms = c.iter().zip(2..).map(|(c, j)| c[i] * q.powi(j * k));
                s[i] + terms.sum::<f64>()
            })
        };
        let mut rows: Vec<f64> = (0..7).rev().flat_map(row).collect();
        let powers = Powers { ratio: q, first: q * q };
        let (mut off, mut seen) = ([f64::INFINITY; 2], 0);
        columns(&mut rows, &mut [0.0; 2], powers, |entry| {
            seen += 1;
            assert_eq!(entry.j, seen);
            for i in 0..2 {
                let error = (entry.newest[i] - s[i]).abs();
                // each column is better, and the estimate is one of the error
                assert!(error < 1e-14 || (error < 0.1 * off[i] && error <= entry.error(i)));
                off[i] = error;
            }
            if seen == 3 {
                assert!(off[0] < 1e-14 && off[1] < 1e-14, "{off:?}");
            }
        });
        assert_eq!(seen, 5);
    }

    #[test]
    fn two_rows_show_nothing() {
        let powers = Powers { ratio: 0.5, first: 0.25 };
        for n in 0..3 {
            columns(&mut vec![1.0; n], &mut [0.0], powers, |_| panic!("a column"));
        }
    }
}
