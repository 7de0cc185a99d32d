//! Factorisation of large dense matrices, blocked and vectorised.
//!
//! ```text
//! P A = L U:   columns p .. p + B,   L11 U12 = A12,   A22 <- A22 - L21 U12
//! ```
//!
//! Every entry has the products subtracted from it in the order of [`zivi_core::vi::factor`], none of them
//! fused: the factors are the same to the last bit, on all machines.

use pulp::{Simd, WithSimd};
use zivi_core::vi::{self, EvaluationError, Interruption, Problem, Progress};

/// A problem whose large matrices are factored by blocks.
pub struct ByBlocks<'a>(pub &'a mut dyn Problem);

impl Problem for ByBlocks<'_> {
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        self.0.map(z, f)
    }

    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        self.0.jacobian(z, jacobian)
    }

    fn poll(&mut self) -> Result<(), Interruption> {
        self.0.poll()
    }

    fn factor(
        &mut self,
        matrix: &mut [f64],
        k: usize,
        permutation: &mut [usize],
    ) -> Result<f64, Interruption> {
        factor(matrix, k, permutation, &mut || self.0.poll())
    }

    fn monitor(&mut self, progress: &Progress) -> Result<(), Interruption> {
        self.0.monitor(progress)
    }

    fn is_affine(&self) -> bool {
        self.0.is_affine()
    }

    fn is_differenced(&self) -> bool {
        self.0.is_differenced()
    }

    fn rounding(&self) -> f64 {
        self.0.rounding()
    }
}

/// Matrices with fewer rows are factored row by row.
const LEAST: usize = 48;
/// Columns that are factored before the others follow.
const BLOCK: usize = 16;
/// Rows of a tile, and vectors in one of its rows: as many sums as registers hold.
const ROWS: usize = 6;
const VECTORS: usize = 2;
/// Entries in a row of a tile, with the widest vectors.
const WIDEST: usize = 16;

/// As [`zivi_core::vi::factor`]: overwrites the leading `k x k` matrix (row length `k`) by its factors,
/// gives `min |u_ii| / max |u_ii|`, 0 when singular.
///
/// # Errors
/// Those of `poll`, which is called between blocks.
pub fn factor<E>(
    matrix: &mut [f64],
    k: usize,
    permutation: &mut [usize],
    poll: &mut dyn FnMut() -> Result<(), E>,
) -> Result<f64, E> {
    if k < LEAST {
        return vi::factor(matrix, k, permutation, poll);
    }
    let arch = pulp::Arch::new();
    let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
    // the columns of a block, then the rows next to it
    let mut packed = Vec::new();
    for first in (0..k).step_by(BLOCK) {
        poll()?;
        let last = (first + BLOCK).min(k);
        let block = Block { matrix: &mut *matrix, k, first, last };
        let Some((small, large)) = arch.dispatch(Panel(block, &mut *permutation, &mut packed))
        else {
            return Ok(0.0);
        };
        (least, most) = (least.min(small), most.max(large));
        if last < k {
            let block = Block { matrix: &mut *matrix, k, first, last };
            arch.dispatch(Trailing(block, &mut packed));
        }
    }
    Ok(least / most)
}

/// Columns of a matrix of `k` rows that are factored together.
struct Block<'a> {
    matrix: &'a mut [f64],
    k: usize,
    first: usize,
    last: usize,
}

/// The columns themselves, below the rows that are done, with memory for them: the least and the
/// largest pivot, `None` where the matrix is singular.
struct Panel<'a>(Block<'a>, &'a mut [usize], &'a mut Vec<f64>);

impl WithSimd for Panel<'_> {
    type Output = Option<(f64, f64)>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let Self(Block { matrix, k, first, last }, permutation, packed) = self;
        let (mut least, mut most, width) = (f64::INFINITY, 0.0_f64, last - first);
        // rows below the last that is not zero here stay as they are
        let is_zero = |row: &[f64]| row[first..last].iter().all(|it| *it == 0.0);
        let mut rows = matrix[first * k..].chunks_exact(k);
        let height = rows.rposition(|row| !is_zero(row)).map_or(0, |it| it + 1).max(width);
        // column by column, so that vectors are long
        packed.clear();
        packed.resize(width * height, 0.0);
        for (i, row) in matrix[first * k..].chunks_exact(k).take(height).enumerate() {
            let column = packed.iter_mut().skip(i).step_by(height);
            column.zip(&row[first..last]).for_each(|(to, entry)| *to = *entry);
        }
        for step in 0..width {
            let (mut pivot, mut size) = (step, -1.0);
            let column = &packed[step * height..][..height];
            for (i, entry) in column.iter().enumerate().skip(step) {
                if entry.abs() > size {
                    (pivot, size) = (i, entry.abs());
                }
            }
            permutation[first + step] = first + pivot;
            if size <= 0.0 || !size.is_finite() {
                return None;
            }
            (least, most) = (least.min(size), most.max(size));
            packed.chunks_exact_mut(height).for_each(|column| column.swap(step, pivot));
            swap_rows(matrix, k, first + step, first + pivot);
            let (done, ahead) = packed.split_at_mut((step + 1) * height);
            let (by, below) = done[step * height + step..].split_first_mut()?;
            below.iter_mut().for_each(|entry| *entry /= *by);
            for column in ahead.chunks_exact_mut(height) {
                let (by, column) = column[step..].split_first_mut()?;
                if *by != 0.0 {
                    subtract(column, *by, below);
                }
            }
        }
        for (i, row) in matrix[first * k..].chunks_exact_mut(k).take(height).enumerate() {
            let column = packed.iter().skip(i).step_by(height);
            row[first..last].iter_mut().zip(column).for_each(|(entry, done)| *entry = *done);
        }
        Some((least, most))
    }
}

fn swap_rows(matrix: &mut [f64], width: usize, i: usize, j: usize) {
    if i != j {
        let (above, below) = matrix.split_at_mut(j * width);
        above[i * width..][..width].swap_with_slice(&mut below[..width]);
    }
}

/// `y <- y - a x`.
#[inline(always)]
fn subtract(y: &mut [f64], a: f64, x: &[f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y -= a * x);
}

/// The columns after the block, and memory for a part of them.
struct Trailing<'a>(Block<'a>, &'a mut Vec<f64>);

impl WithSimd for Trailing<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self(Block { matrix, k, first, last }, packed) = self;
        let mut end = last;
        for i in first..last {
            let (above, row) = matrix.split_at_mut(i * k);
            let row = &mut row[..k];
            for j in first..i {
                if row[j] != 0.0 {
                    let (by, tail) = (row[j], &above[j * k..][last..k]);
                    subtract(&mut row[last..], by, tail);
                }
            }
            // what is zero outside a band stays so
            end = end.max(row.iter().rposition(|it| *it != 0.0).map_or(0, |it| it + 1));
        }
        let (depth, width) = (last - first, VECTORS * S::F64_LANES);
        let (above, below) = matrix.split_at_mut(last * k);
        packed.clear();
        for column in (last..end).step_by(width) {
            let columns = column..(column + width).min(end);
            for row in above[first * k..].chunks_exact(k) {
                packed.extend(&row[columns.clone()]);
                packed.resize(packed.len().next_multiple_of(width), 0.0);
            }
        }
        let mut tiles = below.chunks_exact_mut(ROWS * k);
        for rows in &mut tiles {
            Tile { rows, k, by: first..last, end }.update::<S, ROWS>(simd, packed, depth);
        }
        for rows in tiles.into_remainder().chunks_exact_mut(k) {
            Tile { rows, k, by: first..last, end }.update::<S, 1>(simd, packed, depth);
        }
    }
}

/// Some rows of the matrix, the columns whose products are subtracted, and the end of those that change.
struct Tile<'a> {
    rows: &'a mut [f64],
    k: usize,
    by: std::ops::Range<usize>,
    end: usize,
}

impl Tile<'_> {
    #[inline(always)]
    fn update<S: Simd, const N: usize>(self, simd: S, packed: &[f64], depth: usize) {
        let Self { rows, k, by, end } = self;
        let (width, first) = (VECTORS * S::F64_LANES, by.end);
        // for each of the columns those of all rows
        let mut lower = [[0.0; N]; BLOCK];
        let mut is_zero = true;
        for (i, row) in rows.chunks_exact(k).enumerate() {
            for (lower, entry) in lower.iter_mut().zip(&row[by.clone()]) {
                lower[i] = *entry;
                is_zero &= *entry == 0.0;
            }
        }
        if is_zero {
            return;
        }
        let blocks = packed.chunks_exact(depth * width);
        for (column, block) in (first..end).step_by(width).zip(blocks) {
            let columns = column..(column + width).min(end);
            let mut sums = [[simd.splat_f64s(0.0); VECTORS]; N];
            // a part of a vector goes through a whole one
            let part = (columns.len() < width).then_some(columns.len());
            for i in 0..N {
                let row = &rows[i * k + column..];
                sums[i] = match part {
                    None => loaded::<S>(&row[..width]),
                    Some(part) => {
                        let mut whole = [0.0; WIDEST];
                        whole[..part].copy_from_slice(&row[..part]);
                        loaded::<S>(&whole[..width])
                    }
                };
            }
            let vectors = S::as_simd_f64s(block).0;
            for (vectors, lower) in vectors.chunks_exact(VECTORS).zip(&lower) {
                for i in 0..N {
                    let by = simd.splat_f64s(lower[i]);
                    for v in 0..VECTORS {
                        sums[i][v] = simd.sub_f64s(sums[i][v], simd.mul_f64s(by, vectors[v]));
                    }
                }
            }
            for i in 0..N {
                let row = &mut rows[i * k + column..];
                match part {
                    None => stored::<S>(&mut row[..width], sums[i]),
                    Some(part) => {
                        let mut whole = [0.0; WIDEST];
                        stored::<S>(&mut whole[..width], sums[i]);
                        row[..part].copy_from_slice(&whole[..part]);
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn loaded<S: Simd>(from: &[f64]) -> [S::f64s; VECTORS] {
    let vectors = S::as_simd_f64s(from).0;
    std::array::from_fn(|v| vectors[v])
}

#[inline(always)]
fn stored<S: Simd>(to: &mut [f64], sums: [S::f64s; VECTORS]) {
    for (to, sum) in S::as_mut_simd_f64s(to).0.iter_mut().zip(sums) {
        *to = sum;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    type Factored = (f64, Vec<f64>, Vec<usize>);

    fn factored(
        by: impl Fn(
            &mut [f64],
            usize,
            &mut [usize],
            &mut dyn FnMut() -> Result<(), Infallible>,
        ) -> Result<f64, Infallible>,
        matrix: &[f64],
        n: usize,
    ) -> Factored {
        let (mut matrix, mut permutation) = (matrix.to_vec(), vec![0; n]);
        let Ok(ratio) = by(&mut matrix, n, &mut permutation, &mut || Ok(()));
        (ratio, matrix, permutation)
    }

    /// Numbers that look random, between -1 and 1.
    fn numbers(n: usize) -> Vec<f64> {
        let mut state = 1_u64;
        let next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        std::iter::repeat_with(next).take(n).collect()
    }

    #[test]
    fn every_bit_is_that_of_the_factors_by_rows() {
        for n in [48, 49, 50, 51, 64, 95, 131, 200] {
            let dense = numbers(n * n);
            let mut banded = dense.clone();
            for (k, entry) in banded.iter_mut().enumerate() {
                if (k / n).abs_diff(k % n) > 5 {
                    *entry = 0.0;
                }
            }
            for matrix in [dense, banded] {
                let (one, other) = (factored(factor, &matrix, n), factored(vi::factor, &matrix, n));
                assert!(one == other && one.0 > 0.0, "n = {n}");
            }
        }
    }

    #[test]
    fn a_singular_matrix_is_told() {
        let n = 70;
        let mut matrix = numbers(n * n);
        let (above, below) = matrix.split_at_mut(60 * n);
        below[..n].fill(0.0);
        below[n..2 * n].copy_from_slice(&above[..n]);
        assert!(factored(factor, &matrix, n).0 < 1e-10);
        matrix.iter_mut().skip(40).step_by(n).for_each(|it| *it = 0.0);
        assert_eq!(factored(factor, &matrix, n).0, 0.0);
    }

    #[test]
    fn it_can_be_stopped() {
        let (n, mut looks) = (200, 0);
        let mut poll = || {
            looks += 1;
            if looks < 3 {
                Ok(())
            } else {
                Err("stop")
            }
        };
        let (mut matrix, mut permutation) = (numbers(n * n), vec![0; n]);
        assert_eq!(factor(&mut matrix, n, &mut permutation, &mut poll), Err("stop"));
    }
}
