//! Coordinates of a state: one number or several.
//!
//! A mass above a wall is the smallest case of a mechanical system, and costs no more than code
//! that is written for one number: its coordinates are an `f64`, seen as a slice of length one.

use pulp::{Simd, WithSimd};
use std::fmt::Debug;

/// Most stages that a pair has, further ones included.
pub(crate) const MOST_STAGES: usize = 16;

/// Deviation of a stage from a uniform acceleration from the start of the step: `(V_i - x' - c_i h
/// k_0)/h` and `k_i - k_0`, side by side for sums over both.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(16))]
pub(crate) struct Beyond {
    pub(crate) v: f64,
    pub(crate) k: f64,
}

/// That of all stages in one coordinate. The deviation at the start is zero.
pub(crate) type Row = [Beyond; MOST_STAGES];

/// The coordinates of a state.
pub(crate) trait Coordinates: Clone + Debug + PartialEq {
    /// One row for each of them.
    type Rows: Clone + Debug + AsRef<[Row]> + AsMut<[Row]>;

    /// So many zeros; one number is one, whatever is requested.
    fn zeros(count: usize) -> Self;

    /// So many rows of zeros.
    fn rows(count: usize) -> Self::Rows;

    /// Memory to work in, lent from a place that keeps it; one number needs none. Its content is
    /// irrelevant.
    fn lend(place: &mut Self) -> Self;

    /// Back to the place that keeps it.
    fn give_back(self, place: &mut Self);

    /// All of them, in order.
    fn as_slice(&self) -> &[f64];

    /// The same, to be changed.
    fn as_mut_slice(&mut self) -> &mut [f64];
}

impl Coordinates for f64 {
    type Rows = [Row; 1];

    fn zeros(_: usize) -> Self {
        0.0
    }

    fn rows(_: usize) -> Self::Rows {
        [Row::default()]
    }

    #[inline(always)]
    fn lend(_: &mut Self) -> Self {
        0.0
    }

    #[inline(always)]
    fn give_back(self, _: &mut Self) {}

    #[inline(always)]
    fn as_slice(&self) -> &[f64] {
        std::slice::from_ref(self)
    }

    #[inline(always)]
    fn as_mut_slice(&mut self) -> &mut [f64] {
        std::slice::from_mut(self)
    }
}

impl Coordinates for Vec<f64> {
    type Rows = Vec<Row>;

    fn zeros(count: usize) -> Self {
        vec![0.0; count]
    }

    fn rows(count: usize) -> Self::Rows {
        vec![Row::default(); count]
    }

    fn lend(place: &mut Self) -> Self {
        std::mem::take(place)
    }

    fn give_back(self, place: &mut Self) {
        *place = self;
    }

    fn as_slice(&self) -> &[f64] {
        self
    }

    fn as_mut_slice(&mut self) -> &mut [f64] {
        self
    }
}

/// Coordinates and their rates at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct State<Q> {
    pub(crate) t: f64,
    /// Rounding error of `t`: far from `t = 0` it would add up to a drift.
    pub(crate) late: f64,
    pub(crate) x: Q,
    pub(crate) xdot: Q,
}

impl<Q: Coordinates> State<Q> {
    /// So many coordinates at rest in the origin, at `t = 0`.
    pub(crate) fn zeros(count: usize) -> Self {
        Self { t: 0.0, late: 0.0, x: Q::zeros(count), xdot: Q::zeros(count) }
    }

    /// Becomes another one, in the memory that it has.
    #[inline]
    pub(crate) fn copy_from(&mut self, other: &Self) {
        (self.t, self.late) = (other.t, other.late);
        self.x.clone_from(&other.x);
        self.xdot.clone_from(&other.xdot);
    }
}

impl<Q> State<Q> {
    /// Moves the time on by `h`.
    #[inline]
    pub(crate) fn pass(&mut self, h: f64) {
        let step = h + self.late;
        let t = self.t + step;
        self.late = step - (t - self.t);
        self.t = t;
    }

    /// The coordinates `x` with the rates `xdot` after the time `h`.
    #[inline]
    pub(crate) fn after(&self, h: f64, x: Q, xdot: Q) -> Self {
        let mut after = State { t: self.t, late: self.late, x, xdot };
        after.pass(h);
        after
    }
}

// Products of a matrix with vectors, by the widest registers of the processor: with the same bits.

/// Number of full columns added together.
const TOGETHER: usize = 4;
/// Below this number of entries vectorisation costs more than it saves.
const WIDE: usize = 96;

/// A matrix of which most entries may be zero: columns that have few entries by diagonals, which
/// banded matrices have few of, the others as they are.
#[derive(Clone, Debug)]
pub(crate) struct LinearMap {
    diagonals: Vec<Diagonal>,
    /// The numbers of the full columns.
    full: Vec<usize>,
    /// Their entries, column by column, with zeros to a whole number of [`TOGETHER`].
    entries: Vec<f64>,
    /// How many numbers it consists of.
    size: usize,
}

/// Entries `a_(i + k, j + k)`, `k = 0, 1, ..`.
#[derive(Clone, Debug)]
struct Diagonal {
    i: usize,
    j: usize,
    entries: Vec<f64>,
}

impl Diagonal {
    /// From the first to the last nonzero entry, if any.
    fn of((i, j): (usize, usize), mut entries: Vec<f64>) -> Option<Self> {
        let first = entries.iter().position(|entry| *entry != 0.0)?;
        let last = entries.iter().rposition(|entry| *entry != 0.0)?;
        entries.truncate(last + 1);
        entries.drain(..first);
        Some(Self { i: i + first, j: j + first, entries })
    }
}

impl LinearMap {
    /// The matrix of given size with these entries.
    pub(crate) fn new(rows: usize, columns: usize, at: impl Fn(usize, usize) -> f64) -> Self {
        let filled = |j: usize| (0..rows).filter(|&i| at(i, j) != 0.0).count();
        let filled: Vec<usize> = (0..columns).map(filled).collect();
        let is_full: Vec<bool> = filled.iter().map(|&count| 4 * count > rows).collect();
        let is_sparse = |j: usize| filled[j] > 0 && !is_full[j];
        let any_sparse = (0..columns).any(is_sparse);
        let starts = (1..rows).rev().map(|i| (i, 0)).chain((0..columns).map(|j| (0, j)));
        let starts = starts.filter(|_| any_sparse);
        let diagonal = |(i, j): (usize, usize)| {
            let length = (rows - i).min(columns - j);
            let entry = |k: usize| if is_full[j + k] { 0.0 } else { at(i + k, j + k) };
            Diagonal::of((i, j), (0..length).map(entry).collect())
        };
        let diagonals: Vec<Diagonal> = starts.filter_map(diagonal).collect();
        let mut full: Vec<usize> = (0..columns).filter(|&j| is_full[j]).collect();
        let mut entries: Vec<f64> = full
            .iter()
            .flat_map(|&j| (0..rows).map(move |i| (i, j)))
            .map(|(i, j)| at(i, j))
            .collect();
        let missing = full.len().next_multiple_of(TOGETHER) - full.len();
        full.extend(vec![0; missing]);
        entries.extend(vec![0.0; missing * rows]);
        let in_diagonals: usize = diagonals.iter().map(|it| it.entries.len()).sum();
        let size = entries.len() + in_diagonals;
        Self { diagonals, full, entries, size }
    }

    /// How many numbers it consists of.
    pub(crate) fn len(&self) -> usize {
        self.size
    }

    /// Adds the product with a vector.
    #[inline]
    pub(crate) fn add(&self, x: &[f64], out: &mut [f64]) {
        if self.size < WIDE {
            self.add_by_columns(x, out);
        } else {
            pulp::Arch::new().dispatch(Product { map: self, x, out });
        }
    }

    /// The same by the registers that the caller has.
    #[inline(always)]
    pub(crate) fn add_by_columns(&self, x: &[f64], out: &mut [f64]) {
        for Diagonal { i, j, entries } in &self.diagonals {
            let pairs = entries.iter().zip(&x[*j..]);
            out[*i..].iter_mut().zip(pairs).for_each(|(out, (entry, x))| *out += entry * x);
        }
        // of a size that the compiler knows the loops are unrolled
        match out.len() {
            1 => self.add_first::<1>(1, x, out),
            2 => self.add_first::<2>(2, x, out),
            3 => self.add_first::<3>(3, x, out),
            4 => self.add_first::<4>(4, x, out),
            _ => self.add_full_columns(x, out),
        }
    }

    /// The first numbers of the product of a matrix that has full columns alone.
    #[inline(always)]
    pub(crate) fn first_of_product<const FEW: usize>(
        &self,
        rows: usize,
        x: &[f64],
    ) -> Option<[f64; FEW]> {
        if !self.diagonals.is_empty() || rows < FEW {
            return None;
        }
        let mut out = [0.0; FEW];
        self.add_first::<FEW>(rows, x, &mut out);
        Some(out)
    }

    /// Adds the contribution of full columns to the first rows.
    #[inline(always)]
    fn add_first<const FEW: usize>(&self, rows: usize, x: &[f64], out: &mut [f64]) {
        let blocks = self.entries.chunks_exact(TOGETHER * rows);
        for (columns, block) in self.full.chunks_exact(TOGETHER).zip(blocks) {
            let [x0, x1, x2, x3] = [0, 1, 2, 3].map(|k| x[columns[k]]);
            let [c0, c1, c2, c3] = [0, 1, 2, 3].map(|k| &block[k * rows..][..FEW]);
            for (i, out) in out.iter_mut().enumerate().take(FEW) {
                *out += (c0[i] * x0 + c1[i] * x1) + (c2[i] * x2 + c3[i] * x3);
            }
        }
    }

    #[inline(always)]
    fn add_full_columns(&self, x: &[f64], out: &mut [f64]) {
        let rows = out.len();
        let blocks = self.entries.chunks_exact((TOGETHER * rows).max(1));
        for (columns, block) in self.full.chunks_exact(TOGETHER).zip(blocks) {
            let [x0, x1, x2, x3] = [0, 1, 2, 3].map(|k| x[columns[k]]);
            let (first, last) = block.split_at(2 * rows);
            let ((c0, c1), (c2, c3)) = (first.split_at(rows), last.split_at(rows));
            let pairs = c0.iter().zip(c1).zip(c2.iter().zip(c3));
            for (out, ((c0, c1), (c2, c3))) in out.iter_mut().zip(pairs) {
                *out += (c0 * x0 + c1 * x1) + (c2 * x2 + c3 * x3);
            }
        }
    }
}

/// A product that is to be added.
struct Product<'a> {
    map: &'a LinearMap,
    x: &'a [f64],
    out: &'a mut [f64],
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.map.add_by_columns(self.x, self.out);
    }
}

#[cfg(test)]
mod linear_map_tests {
    use super::*;

    #[test]
    fn products_are_those_of_the_rows() {
        for (rows, columns) in [(1, 1), (3, 5), (20, 41), (26, 7), (40, 44)] {
            // full, sparse and empty columns mixed, some of them in diagonals
            let at = |i: usize, j: usize| match j % 4 {
                0 => 1.0 / (1 + i + 2 * j) as f64,
                1 | 2 if i == j % rows || i + 1 == j % rows => (j as f64).cos(),
                _ => 0.0,
            };
            let map = LinearMap::new(rows, columns, at);
            let x: Vec<f64> = (0..columns).map(|j| (j as f64).sin() + 0.1).collect();
            let mut out: Vec<f64> = (0..rows).map(|i| i as f64).collect();
            map.add(&x, &mut out);
            for (i, found) in out.iter().enumerate() {
                let exact = i as f64 + (0..columns).map(|j| at(i, j) * x[j]).sum::<f64>();
                assert!((found - exact).abs() < 1e-13, "{rows} {columns} {i}");
            }
        }
    }
}
