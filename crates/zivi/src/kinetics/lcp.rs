//! Linear complementarity problems of impacts and contacts, `0 <= z  perp  D z + q >= 0`, and that of gaps
//! which touch without a speed.
//!
//! For symmetric positive definite `D` the solution is unique; for singular `D`, `D z + q` is equal
//! for all solutions. Few gaps: every pattern of positive unknowns, the one that fits best. Larger
//! sets: patterns that exchange all unknowns of the wrong sign together, and if these do not
//! terminate, the least accelerations that keep all gaps open (Gauss's principle).

use crate::kinetics::mode::Contacts;
use crate::kinetics::shares::Shares;
use crate::kinetics::Kinetics;
use crate::numeric::cholesky;
use crate::record::gap_set::GapSet;
use crate::record::status::Failure;
use crate::Status;

/// Most unknowns whose patterns are tried one by one.
const FEW: usize = 6;
/// A pattern in which one unknown follows from the others but for so much is none: there is a smaller one.
const SINGULAR: f64 = 1e-10;
/// By how much the best pattern may violate a row, relative to its terms.
const MISFIT: f64 = 1e-9;

/// The solution, and which unknowns are positive in it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Solution {
    pub(crate) z: Vec<f64>,
    pub(crate) positive: GapSet,
}

/// Most exchanges of unknowns.
const EXCHANGES: usize = 20;

/// Solves the problem with `D` row by row; `None` if that fails.
pub(crate) fn solve(d: &[f64], q: &[f64]) -> Option<Solution> {
    if q.len() <= FEW {
        by_patterns(d, q)
    } else {
        by_exchanges(d, q).or_else(|| by_distance(d, q))
    }
}

fn by_patterns(d: &[f64], q: &[f64]) -> Option<Solution> {
    let k = q.len();
    let mut best: Option<(f64, Solution)> = None;
    for pattern in 0..1u64 << k {
        let positive = GapSet::of_bits(pattern);
        let Some(z) = on_pattern(d, q, positive) else { continue };
        let worst = violation(d, q, &z, positive);
        if best.as_ref().is_none_or(|(least, _)| worst < *least) {
            best = Some((worst, Solution { z, positive }));
        }
        if worst == 0.0 {
            break;
        }
    }
    best.filter(|(worst, _)| *worst <= MISFIT).map(|(_, solution)| solution)
}

/// `z` with `D z + q = 0` on the pattern and zero elsewhere.
fn on_pattern(d: &[f64], q: &[f64], positive: GapSet) -> Option<Vec<f64>> {
    let (k, p) = (q.len(), positive.len());
    let mut matrix: Vec<f64> = Vec::with_capacity(p * p);
    for i in positive.iter() {
        matrix.extend(positive.iter().map(|j| d[i * k + j]));
    }
    let mut x: Vec<f64> = positive.iter().map(|i| -q[i]).collect();
    if cholesky::factor(&mut matrix, p) <= SINGULAR {
        return None;
    }
    cholesky::solve(&matrix, p, &mut x);
    let mut z = vec![0.0; k];
    for (i, x) in positive.iter().zip(x) {
        z[i] = x;
    }
    z.iter().all(|z| z.is_finite()).then_some(z)
}

/// The largest violation of a sign, relative to the terms of its row.
fn violation(d: &[f64], q: &[f64], z: &[f64], positive: GapSet) -> f64 {
    let k = q.len();
    let mut worst = 0.0_f64;
    for i in 0..k {
        let terms = (0..k).map(|j| d[i * k + j] * z[j]);
        let row = terms.clone().sum::<f64>() + q[i];
        let size = terms.map(f64::abs).sum::<f64>() + q[i].abs();
        let (value, scale) =
            if positive.has(i) { (z[i], size / d[i * k + i]) } else { (row, size) };
        if value < 0.0 {
            worst = worst.max(-value / scale);
        }
    }
    worst
}

/// `z` is positive where the last pattern had it so, or `D z + q` negative.
fn by_exchanges(d: &[f64], q: &[f64]) -> Option<Solution> {
    let k = q.len();
    let mut positive: GapSet = (0..k).filter(|&i| q[i] < 0.0).collect();
    for _ in 0..EXCHANGES {
        let z = on_pattern(d, q, positive)?;
        let row = |i: usize| positive.iter().map(|j| d[i * k + j] * z[j]).sum::<f64>() + q[i];
        let keeps = |&i: &usize| if positive.has(i) { z[i] > 0.0 } else { row(i) < 0.0 };
        let next: GapSet = (0..k).filter(keeps).collect();
        if next == positive {
            return (violation(d, q, &z, positive) <= MISFIT).then_some(Solution { z, positive });
        }
        positive = next;
    }
    None
}

/// As the point nearest to the origin, in the metric of the masses, of those that obey `S x + q >= 0` with
/// `D = S S^T`: `x = S^T z`, of which there is one also where `D` is singular.
fn by_distance(d: &[f64], q: &[f64]) -> Option<Solution> {
    let k = q.len();
    let (s, rank) = root(d, k);
    let mut shares = Shares::new(rank);
    (0..k).for_each(|i| shares.push(q[i], s[i * k..][..rank].iter().copied()));
    let (_, forces) = shares.least()?;
    let mut z = vec![0.0; k];
    forces.into_iter().for_each(|(i, force)| z[i] = force);
    let positive: GapSet = (0..k).filter(|&i| z[i] > 0.0).collect();
    let z = on_pattern(d, q, positive).unwrap_or(z);
    (violation(d, q, &z, positive) <= MISFIT).then_some(Solution { z, positive })
}

/// `D = S S^T` by pivots on the diagonal, row by row of `k` numbers, and how many columns `S` has.
fn root(d: &[f64], k: usize) -> (Vec<f64>, usize) {
    let mut s = vec![0.0; k * k];
    let mut left: Vec<f64> = (0..k).map(|i| d[i * k + i]).collect();
    for column in 0..k {
        let part = |i: usize| left[i] / d[i * k + i];
        let Some(pivot) = (0..k).max_by(|&i, &j| part(i).total_cmp(&part(j))) else { break };
        if part(pivot).is_nan() || part(pivot) <= SINGULAR {
            return (s, column);
        }
        let length = left[pivot].sqrt();
        for i in 0..k {
            let done: f64 = (0..column).map(|c| s[i * k + c] * s[pivot * k + c]).sum();
            s[i * k + column] = (d[i * k + pivot] - done) / length;
            left[i] -= s[i * k + column] * s[i * k + column];
        }
        left[pivot] = 0.0;
    }
    (s, k)
}

// The complementarity problem of closed gaps: which stay so.

/// Which of the gaps that touch without a speed stay closed, and which the forces open, where the
/// system has just been evaluated: `0 <= lambda  perp  b + D lambda >= 0`.
pub(crate) fn settle<E>(kinetics: &mut Kinetics, touching: GapSet) -> Result<Contacts, Failure<E>> {
    if touching.is_empty() {
        return Ok(Contacts::default());
    }
    let (matrix, b) = problem(kinetics, touching, |at, i| at.b(i));
    let solution = solve(&matrix, &b).ok_or(Failure::Status(Status::ContactNotSolved))?;
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
pub(crate) fn problem(
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

#[cfg(test)]
mod tests {
    use super::*;

    /// `max |min(z, D z + q)|`.
    fn residual(d: &[f64], q: &[f64], z: &[f64]) -> f64 {
        let k = q.len();
        (0..k).fold(0.0, |worst, i| {
            let row: f64 = (0..k).map(|j| d[i * k + j] * z[j]).sum::<f64>() + q[i];
            f64::max(worst, row.min(z[i]).abs())
        })
    }

    #[test]
    fn both_ways_give_the_solution() {
        let wave = |i: usize, s: f64| ((i as f64 + 1.0) * s).sin();
        for k in 1..=FEW {
            for case in 0..40 {
                let b: Vec<f64> =
                    (0..k * k).map(|i| wave(i, 1.3 + f64::from(case) * 0.77)).collect();
                let d: Vec<f64> = (0..k * k)
                    .map(|ij| {
                        let (i, j) = (ij / k, ij % k);
                        let sum: f64 = (0..k).map(|l| b[i * k + l] * b[j * k + l]).sum();
                        sum + if i == j { 0.3 } else { 0.0 }
                    })
                    .collect();
                let q: Vec<f64> = (0..k).map(|i| wave(i, 2.9 + f64::from(case))).collect();
                let (one, two) = (by_patterns(&d, &q).unwrap(), by_distance(&d, &q).unwrap());
                assert!(residual(&d, &q, &one.z) < 1e-12 && residual(&d, &q, &two.z) < 1e-12);
                assert_eq!(one.positive, two.positive, "{k} {case}");
                let exchanged = by_exchanges(&d, &q);
                assert!(exchanged.is_none_or(|it| it == one), "{k} {case}");
                // of speeds near the end of an accumulation, too
                let slow: Vec<f64> = q.iter().map(|q| 1e-15 * q).collect();
                let three = by_distance(&d, &slow).unwrap();
                assert!(residual(&d, &slow, &three.z) < 1e-27, "{k} {case}");
                assert_eq!(one.positive, three.positive, "{k} {case}");
            }
        }
    }
    #[test]
    fn many_unknowns_are_exchanged_at_once() {
        let wave = |i: usize, s: f64| ((i as f64 + 1.0) * s).sin();
        let (mut ended, k) = (0, 60);
        for case in 0..20 {
            let b: Vec<f64> = (0..k * k).map(|i| wave(i, 1.3 + f64::from(case) * 0.77)).collect();
            let entry = |ij: usize| {
                let (i, j) = (ij / k, ij % k);
                let sum: f64 = (0..k).map(|l| b[i * k + l] * b[j * k + l]).sum();
                sum + if i == j { 3.0 } else { 0.0 }
            };
            let d: Vec<f64> = (0..k * k).map(entry).collect();
            let q: Vec<f64> = (0..k).map(|i| wave(i, 2.9 + f64::from(case))).collect();
            let (one, two) = (by_exchanges(&d, &q), by_distance(&d, &q).unwrap());
            ended += usize::from(one.is_some());
            if let Some(one) = one {
                assert!(residual(&d, &q, &one.z) < 1e-11 && one == two, "{case}");
            }
        }
        assert!(ended > 15, "{ended}");
    }
}
