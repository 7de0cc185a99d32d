//! The complementarity problem of closed gaps: which stay so.

use super::kinetics::Kinetics;
use super::lcp;
use super::mode::Contacts;
use crate::record::gap_set::GapSet;
use crate::record::status::Failure;
use crate::Status;

/// Which of the gaps that touch without a speed stay closed, and which the forces open, where the
/// system has just been evaluated: `0 <= lambda  perp  b + D lambda >= 0`.
pub(super) fn settle<E>(kinetics: &mut Kinetics, touching: GapSet) -> Result<Contacts, Failure<E>> {
    if touching.is_empty() {
        return Ok(Contacts::default());
    }
    let (matrix, b) = problem(kinetics, touching, |at, i| at.b(i));
    let solution = lcp::solve(&matrix, &b).ok_or(Failure::Status(Status::ContactNotSolved))?;
    let k = b.len();
    let mut left = GapSet::EMPTY;
    for (row, i) in touching.iter().enumerate() {
        let pushed: f64 = (0..k).map(|column| matrix[row * k + column] * solution.z[column]).sum();
        if !solution.positive.has(row) && b[row] + pushed > kinetics.noise(i) {
            left = left.with(GapSet::of(i));
        }
    }
    let mode = touching.without(left).into();
    Ok(Contacts { mode, left, ..Contacts::default() })
}

/// `D_CC` row by row and the right side of a complementarity problem.
pub(super) fn problem(
    kinetics: &mut Kinetics,
    set: GapSet,
    right: impl Fn(&Kinetics, usize) -> f64,
) -> (Vec<f64>, Vec<f64>) {
    let mut matrix = Vec::with_capacity(set.len() * set.len());
    let diagonal: Vec<f64> = set.iter().map(|i| kinetics.d(i, i)).collect();
    for (i, of_i) in set.iter().zip(&diagonal) {
        let beside = set.iter().zip(&diagonal);
        matrix.extend(beside.map(|(j, of_j)| kinetics.coupling_beside(i, j, [*of_i, *of_j])));
    }
    (matrix, set.iter().map(|i| right(kinetics, i)).collect())
}
