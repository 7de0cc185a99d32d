//! The impacts of several gaps that come to rest together in a corner, each computed: with the
//! mobilities and forces of the corner, which the motion approaches,
//!
//! ```text
//! y'' = b + D lambda,  0 <= lambda  perp  y'' >= 0 on contacts        y+' = y-' + D P       (1)
//! ```
//!
//! All arcs are parabolas. Where a gap has become slow compared with the others, its last impact is
//! plastic: under constant forces that leaves them as the rest of its bounces would.

use super::lcp;
use crate::record::gap_set::GapSet;

/// Data of equations (1): `D` row by row, `b` and the restitutions of the gaps of a corner.
pub(super) struct NestedAccumulation {
    pub(super) d: Vec<f64>,
    pub(super) b: Vec<f64>,
    pub(super) e: Vec<f64>,
}

/// Between two impacts: heights and speeds at the start, accelerations.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct NestedArc {
    pub(super) start: f64,
    pub(super) length: f64,
    pub(super) y: Vec<f64>,
    pub(super) v: Vec<f64>,
    pub(super) a: Vec<f64>,
    /// By the order of the gaps in the corner.
    pub(super) closed: GapSet,
}

/// Most arcs of a corner.
const MOST: usize = 4096;
/// A gap is slow below this part of the speeds of the nest.
const SLOW: f64 = 1e-5;
/// Gaps that are hit within this fraction of a flight are hit together.
const TOGETHER: f64 = 1e-13;

impl NestedAccumulation {
    /// The arcs from heights and speeds, at time zero, until all speeds are below `floor`; empty
    /// where they do not come to rest.
    pub(super) fn arcs(&self, mut y: Vec<f64>, mut v: Vec<f64>, floor: f64) -> Vec<NestedArc> {
        let (mut arcs, mut t) = (Vec::new(), 0.0);
        while arcs.len() < MOST {
            let speed = self.speed(&y, &v);
            if speed <= floor {
                return arcs;
            }
            let Some((closed, a)) = self.contacts(&y, &v) else { break };
            let ends: Vec<f64> = (0..y.len())
                .map(|i| if closed.has(i) { f64::INFINITY } else { flight(y[i], v[i], a[i]) })
                .collect();
            let length = ends.iter().fold(f64::INFINITY, |a, &b| a.min(b));
            if !length.is_finite() {
                break;
            }
            arcs.push(NestedArc {
                start: t,
                length,
                y: y.clone(),
                v: v.clone(),
                a: a.clone(),
                closed,
            });
            t += length;
            let hit: GapSet =
                (0..y.len()).filter(|&i| ends[i] <= length * (1.0 + TOGETHER)).collect();
            for i in 0..y.len() {
                y[i] = (y[i] + length * (v[i] + 0.5 * length * a[i])).max(0.0);
                v[i] += length * a[i];
                if closed.has(i) || hit.has(i) {
                    y[i] = 0.0;
                }
                if closed.has(i) {
                    v[i] = 0.0;
                }
            }
            if self.strike(&mut v, closed, hit, SLOW * speed).is_none() {
                break;
            }
        }
        Vec::new()
    }

    /// The largest speed with which a gap is or will be hit.
    fn speed(&self, y: &[f64], v: &[f64]) -> f64 {
        let of = |i: usize| (v[i] * v[i] + 2.0 * y[i] * self.b[i].abs()).sqrt();
        (0..y.len()).map(of).fold(0.0, f64::max)
    }

    /// `D` of some gaps, row by row.
    fn part(&self, set: GapSet) -> Vec<f64> {
        let k = self.b.len();
        set.iter()
            .flat_map(|i| set.iter().map(move |j| (i, j)))
            .map(|(i, j)| self.d[i * k + j])
            .collect()
    }

    /// The gaps that are closed and pressed, and the accelerations.
    fn contacts(&self, y: &[f64], v: &[f64]) -> Option<(GapSet, Vec<f64>)> {
        let k = y.len();
        let touching: GapSet = (0..k).filter(|&i| y[i] == 0.0 && v[i] == 0.0).collect();
        let b: Vec<f64> = touching.iter().map(|i| self.b[i]).collect();
        let found = lcp::solve(&self.part(touching), &b)?;
        let mut closed = GapSet::EMPTY;
        let mut a = self.b.clone();
        for (row, j) in touching.iter().enumerate() {
            if found.positive.has(row) {
                closed = closed.with(GapSet::of(j));
            }
            (0..k).for_each(|i| a[i] += self.d[i * k + j] * found.z[row]);
        }
        closed.iter().for_each(|i| a[i] = 0.0);
        Some((closed, a))
    }

    /// The speeds after an impact.
    fn strike(&self, v: &mut [f64], closed: GapSet, hit: GapSet, slow: f64) -> Option<()> {
        let (k, set) = (v.len(), closed.with(hit));
        let e = |i: usize| if -self.e[i] * v[i] <= slow { 0.0 } else { self.e[i] };
        let before: Vec<f64> = set.iter().map(|i| -e(i) * v[i]).collect();
        let right: Vec<f64> = set.iter().map(|i| (1.0 + e(i)) * v[i]).collect();
        let found = lcp::solve(&self.part(set), &right)?;
        for (row, j) in set.iter().enumerate() {
            (0..k).for_each(|i| v[i] += self.d[i * k + j] * found.z[row]);
        }
        for (row, i) in set.iter().enumerate() {
            v[i] = if found.positive.has(row) { before[row] } else { v[i].max(before[row]) };
        }
        Some(())
    }
}

/// When `y + v t + a t^2/2` falls to zero, for `y >= 0`; infinite if it never does.
fn flight(y: f64, v: f64, a: f64) -> f64 {
    let root = (v * v - 2.0 * a * y).sqrt();
    if y == 0.0 && v <= 0.0 {
        return if a < 0.0 || v < 0.0 { 0.0 } else { f64::INFINITY };
    }
    if v > 0.0 {
        if a < 0.0 {
            (v + root) / -a
        } else {
            f64::INFINITY
        }
    } else if root.is_nan() || root == v {
        f64::INFINITY
    } else {
        2.0 * y / (root - v)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In a wedge with `e < c^2 (1 + e)` the gaps come to rest alternately, `c^2` faster each pair.
    #[test]
    fn a_ball_in_an_obtuse_wedge() {
        let c = 2f64.cos().abs();
        let nest =
            NestedAccumulation { d: vec![1.0, c, c, 1.0], b: vec![-1.0, -1.0], e: vec![0.1, 0.1] };
        let arcs = nest.arcs(vec![0.0, 0.0], vec![1.0, 0.0], 1e-9);
        // each contact that an impact opens comes to rest before the next impact of the other gap
        let opened: Vec<f64> = arcs
            .windows(2)
            .filter(|pair| !pair[0].closed.is_empty() && pair[1].closed.is_empty())
            .map(|pair| pair[1].start)
            .collect();
        let end = arcs.last().map_or(0.0, |arc| arc.start + arc.length);
        let ratios: Vec<f64> = opened.windows(3).map(|t| (end - t[2]) / (end - t[0])).collect();
        assert!(ratios.len() > 12, "{opened:?}");
        assert!(ratios[..8].iter().all(|ratio| (ratio - c * c).abs() < 1e-6), "{ratios:?}");
        // energy L = g'.D^-1 g'/2 + lambda.g, lambda = 1/(1 + c), falls from arc to arc
        let depth = |arc: &NestedArc| {
            let [v, w] = [arc.v[0], arc.v[1]];
            let kinetic = (v * v - 2.0 * c * v * w + w * w) / (2.0 * (1.0 - c * c));
            kinetic + (arc.y[0] + arc.y[1]) / (1.0 + c)
        };
        assert!(arcs.windows(2).all(|pair| depth(&pair[1]) <= depth(&pair[0]) * (1.0 + 1e-12)));
    }

    #[test]
    fn one_gap_is_a_ball() {
        let nest = NestedAccumulation { d: vec![1.0], b: vec![-2.0], e: vec![0.5] };
        let arcs = nest.arcs(vec![0.0], vec![1.0], 1e-6);
        let end = arcs.last().map_or(0.0, |arc| arc.start + arc.length);
        assert!((end - 2.0).abs() < 1e-5 && arcs[1].start == 1.0 && arcs[1].v == [0.5], "{arcs:?}");
    }
}
