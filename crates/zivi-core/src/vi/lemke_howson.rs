//! Equilibria of bimatrix games by complementary paths (Lemke & Howson, *J. SIAM* 12 (1964)
//! 413-423).
//!
//! ```text
//! r = 1 - B'x >= 0,  x >= 0        s = 1 - A y >= 0,  y >= 0        A, B > 0
//! x_i or s_i is zero for every i, y_j or r_j for every j
//! ```
//!
//! Strategies are `x` and `y` over their sums. At `x = 0`, `y = 0` every label (`i`, or `m + j`) is
//! there; a path that gives up one label ends at an equilibrium. Which label is given up may change
//! the length of the path by orders of magnitude: labels take turns, each with a budget from the
//! sequence of Luby, Sinclair & Zuckerman (*Information Processing Letters* 47 (1993) 173-180).
//! Ties are broken lexicographically, so that no path cycles.

use core::ops::Range;

use super::dense;
use super::problem::Interruption;

/// Pivots that one unit of the sequence of budgets is worth, for each row or column of the game.
const UNIT: f64 = 0.5;
/// Smallest budget of a path.
const LEAST: usize = 20;
/// Entries below this, relative to the largest of their column, are rounding.
const NEGLIGIBLE: f64 = 1e-11;
/// Ratios this near, relatively, are ties.
const TIE: f64 = 1e-12;

/// Lengths of the two slices that [`lemke_howson`] works in for payoffs of `m` rows and `n`
/// columns: reals and indices.
#[must_use]
pub const fn lemke_howson_len(m: usize, n: usize) -> (usize, usize) {
    (2 * m * n + 2 * (m + n), 4 * (m + n))
}

/// Finds an equilibrium of the game with the payoffs `a` and `b`, both `m x n`, row by row, finite
/// and positive.
///
/// `x` (of `m`) and `y` (of `n`) are overwritten by unscaled strategies, for the caller to check;
/// returns the pivots, or `None` where none was found within `limit` pivots or a slice is too short.
///
/// ```
/// use zivi_core::vi::{lemke_howson, lemke_howson_len};
///
/// // matching pennies, with 2 added to all payoffs
/// let (a, b) = ([3.0, 1.0, 1.0, 3.0], [1.0, 3.0, 3.0, 1.0]);
/// let (reals, indices) = lemke_howson_len(2, 2);
/// let (mut reals, mut indices) = (vec![0.0; reals], vec![0; indices]);
/// let (mut x, mut y) = ([0.0; 2], [0.0; 2]);
/// let work = (&mut reals[..], &mut indices[..]);
/// let pivots = lemke_howson((&a, &b), (&mut x, &mut y), 100, work, &mut || Ok(()))?;
/// let equal = |z: [f64; 2]| (z[0] - z[1]).abs() < 1e-15;
/// assert!(pivots.is_some() && equal(x) && equal(y));
/// # Ok::<(), zivi_core::vi::Interruption>(())
/// ```
///
/// # Errors
/// Whatever `poll` says.
pub fn lemke_howson(
    (a, b): (&[f64], &[f64]),
    (x, y): (&mut [f64], &mut [f64]),
    limit: usize,
    (reals, indices): (&mut [f64], &mut [usize]),
    poll: &mut dyn FnMut() -> Result<(), Interruption>,
) -> Result<Option<usize>, Interruption> {
    let (m, n) = (x.len(), y.len());
    let (needed, indices_needed) = lemke_howson_len(m, n);
    let fits = reals.len() >= needed && indices.len() >= indices_needed;
    if !fits || m * n == 0 || a.len() != m * n || b.len() != m * n {
        return Ok(None);
    }
    let (first, rest) = reals.split_at_mut_checked(m * n + n + m).unwrap_or_default();
    let (of_first, of_rest) = indices.split_at_mut_checked(2 * (m + n)).unwrap_or_default();
    // x_i has the label i, y_j the label m + j, in both
    let mut game = [
        Dictionary::new(n, m, m..m + n, (first, of_first)), // r in terms of x
        Dictionary::new(m, n, 0..m, (rest, of_rest)),       // s in terms of y
    ];
    let labels = m + n;
    let unit = ((UNIT * labels as f64) as usize).max(LEAST);
    let mut spent = 0;
    for turn in 0.. {
        poll()?;
        let label = spread(turn, labels);
        let budget = unit.saturating_mul(luby(turn + 1)).min(limit - spent);
        let [of_x, of_y] = &mut game;
        of_x.reset(|j, i| dense::at(b, i * n + j));
        of_y.reset(|i, j| dense::at(a, i * n + j));
        let (end, pivots) = follow(&mut game, label, m, budget, poll)?;
        spent += pivots;
        if end {
            let [of_x, of_y] = &game;
            of_x.read(|label| Some(label).filter(|&label| label < m), x);
            of_y.read(|label| label.checked_sub(m), y);
            return Ok(Some(spent));
        }
        if spent >= limit {
            break;
        }
    }
    Ok(None)
}

/// The labels in an order that jumps between the players and over their strategies.
fn spread(turn: usize, labels: usize) -> usize {
    // golden-section steps visit all labels if coprime to their number
    let step =
        (1..labels).rev().find(|&step| step <= (labels * 618) / 1000 && gcd(step, labels) == 1);
    (turn % labels) * step.unwrap_or(1) % labels
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 {
        a
    } else {
        gcd(b, a % b)
    }
}

/// `1, 1, 2, 1, 1, 2, 4, 1, ...`: for `k >= 1`, `2^(i-1)` where `k = 2^i - 1`, else that of
/// `k - 2^(i-1) + 1` with `2^(i-1) <= k < 2^i - 1`.
fn luby(mut k: usize) -> usize {
    loop {
        let i = usize::BITS - k.leading_zeros();
        if k == usize::MAX >> (usize::BITS - i) {
            return 1 << (i - 1);
        }
        k -= (1 << (i - 1)) - 1;
    }
}

/// Follows the path without the label `missing`; whether it has ended, and the pivots.
fn follow(
    game: &mut [Dictionary<'_>; 2],
    missing: usize,
    m: usize,
    budget: usize,
    poll: &mut dyn FnMut() -> Result<(), Interruption>,
) -> Result<(bool, usize), Interruption> {
    let mut entering = missing;
    let mut which = usize::from(missing >= m);
    for pivot in 0..budget {
        if dense::is_time_to_poll(pivot, m) {
            poll()?;
        }
        let Some(leaving) = game.get_mut(which).and_then(|it| it.enter(entering)) else {
            return Ok((false, pivot));
        };
        if leaving == missing {
            return Ok((true, pivot + 1));
        }
        (entering, which) = (leaving, 1 - which);
    }
    Ok((false, budget))
}

/// Basic variables in terms of the others: `basic = constant - matrix * others`.
///
/// Of each label there are two variables, one in either dictionary: what is left out in one enters
/// the other. In one dictionary a variable is identified by its label, since each label occurs
/// once.
struct Dictionary<'a> {
    rows: usize,
    columns: usize,
    /// Labels of the variables that are basic at first: `r` or `s`.
    slacks: Range<usize>,
    matrix: &'a mut [f64],
    constant: &'a mut [f64],
    pivot_row: &'a mut [f64],
    /// Labels of the basic variables, followed by the nonbasic ones.
    labels: &'a mut [usize],
    /// Where a label is among them.
    places: &'a mut [usize],
}

impl<'a> Dictionary<'a> {
    fn new(
        rows: usize,
        columns: usize,
        slacks: Range<usize>,
        (reals, indices): (&'a mut [f64], &'a mut [usize]),
    ) -> Self {
        let (matrix, rest) = reals.split_at_mut((rows * columns).min(reals.len()));
        let (constant, pivot_row) = rest.split_at_mut(rows.min(rest.len()));
        let (labels, places) = indices.split_at_mut((rows + columns).min(indices.len()));
        Self { rows, columns, slacks, matrix, constant, pivot_row, labels, places }
    }

    /// `slacks = 1 - entries * others`.
    fn reset(&mut self, entry: impl Fn(usize, usize) -> f64) {
        for (i, row) in self.matrix.chunks_exact_mut(self.columns).enumerate() {
            row.iter_mut().enumerate().for_each(|(j, to)| *to = entry(i, j));
        }
        self.constant.fill(1.0);
        let labels = self.rows + self.columns;
        let others = (0..labels).filter(|label| !self.slacks.contains(label));
        for (place, label) in self.slacks.clone().chain(others).enumerate() {
            dense::put(self.labels, place, label);
            dense::put(self.places, label, place);
        }
    }

    fn place(&self, label: usize) -> usize {
        self.places.get(label).copied().unwrap_or(0)
    }

    /// The variable with this label enters; returns the label of the one that leaves.
    fn enter(&mut self, label: usize) -> Option<usize> {
        let column = self.place(label).checked_sub(self.rows)?;
        let row = self.leaving(column)?;
        let leaving = self.labels.get(row).copied()?;
        self.pivot(row, column);
        self.labels.swap(row, self.rows + column);
        dense::put(self.places, label, row);
        dense::put(self.places, leaving, self.rows + column);
        Some(leaving)
    }

    fn entry(&self, row: usize, column: usize) -> f64 {
        dense::at(self.matrix, row * self.columns + column)
    }

    /// The row whose variable vanishes first as that of the column grows.
    fn leaving(&self, column: usize) -> Option<usize> {
        let largest = (0..self.rows).fold(0.0, |most, i| f64::max(most, self.entry(i, column)));
        let mut first: Option<(usize, f64)> = None;
        for row in 0..self.rows {
            let rate = self.entry(row, column);
            if rate <= NEGLIGIBLE * largest {
                continue;
            }
            let ratio = dense::at(self.constant, row) / rate;
            let comes_first = match first {
                None => true,
                Some((other, shortest)) => {
                    let tie = TIE * (ratio.abs() + shortest.abs());
                    if (ratio - shortest).abs() <= tie {
                        self.precedes(row, other, column)
                    } else {
                        ratio < shortest
                    }
                }
            };
            if comes_first {
                first = Some((row, ratio));
            }
        }
        first.map(|(row, _)| row)
    }

    /// Breaks a tie between two rows: as if the ones on the right were `1 + eps, 1 + eps^2, ...`.
    fn precedes(&self, row: usize, other: usize, column: usize) -> bool {
        let (rate, other_rate) = (self.entry(row, column), self.entry(other, column));
        for label in self.slacks.clone() {
            let of = |row| self.inverse_entry(row, label);
            let (a, b) = (of(row) / rate, of(other) / other_rate);
            if (a - b).abs() > TIE * (a.abs() + b.abs()) {
                return a < b;
            }
        }
        false
    }

    /// The effect of the right-hand side of the row in which `label` was basic at first.
    fn inverse_entry(&self, row: usize, label: usize) -> f64 {
        match self.place(label).checked_sub(self.rows) {
            Some(column) => self.entry(row, column),
            None if self.place(label) == row => 1.0,
            None => 0.0,
        }
    }

    fn pivot(&mut self, row: usize, column: usize) {
        let pivot = self.entry(row, column);
        let from = row * self.columns;
        let taken = dense::part(self.matrix, from..from + self.columns);
        dense::copy(self.pivot_row, taken);
        self.pivot_row.iter_mut().for_each(|entry| *entry /= pivot);
        dense::put(self.pivot_row, column, 1.0 / pivot);
        let length = dense::at(self.constant, row) / pivot;
        for (i, entries) in self.matrix.chunks_exact_mut(self.columns).enumerate() {
            if i == row {
                dense::copy(entries, self.pivot_row);
                continue;
            }
            let rate = dense::at(entries, column);
            if rate != 0.0 {
                dense::put(entries, column, 0.0);
                dense::axpy(entries, -rate, self.pivot_row);
                let before = dense::at(self.constant, i);
                let value = before - rate * length;
                // what cancels leaves rounding, of either sign: a tie in the pivots to come
                dense::put(self.constant, i, if value <= TIE * before { 0.0 } else { value });
            }
        }
        dense::put(self.constant, row, length);
    }

    /// The values of the basic variables that have an index in `out`; zero for the others.
    fn read(&self, index: impl Fn(usize) -> Option<usize>, out: &mut [f64]) {
        out.fill(0.0);
        for (&label, &value) in self.labels.iter().zip(self.constant.iter()) {
            if let Some(i) = index(label) {
                dense::put(out, i, value);
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing, clippy::unwrap_used)]
mod tests;
