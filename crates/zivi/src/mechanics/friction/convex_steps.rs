//! Coulomb's law as a sequence of convex problems, for contacts whose solution one by one does not converge.
//!
//! ```text
//! minimise  1/2 x . D x + (b + mu s) . x   over the cones, mu s at the normals        s = |v_t|    (1)
//! ```
//!
//! For given `s` the rates `v = b + D x` are unique, and `s` is a fixed point, which exists where some motion opens all
//! contacts (V. Acary, F. Cadoux, C. Lemarechal, J. Malick, A formulation of the linear discrete Coulomb friction
//! problem via convex optimization, ZAMM 91, 2011). Each problem is solved by accelerated projected gradients with
//! restarts, `s` goes half of the way to its next value, and Newton's method takes over as soon as it obeys the laws.

use crate::mechanics::friction::coulomb::{size, Coulomb, CoulombSolution, Site, SiteBranch};
use crate::numeric::dense::dot;

/// Most steps of `s`, and of the descent in one of them.
const STEPS: usize = 80;
const DESCENT: usize = 4000;
/// Changes below this part of the largest force end a descent.
const SETTLED: f64 = 1e-14;
/// Forces below this part of the largest are none, and contacts with so little to the edge of their cone slip.
const NONE: f64 = 1e-9;
const EDGE: f64 = 1e-7;

impl Coulomb {
    /// The solution by convex problems, unless directions of slip are given.
    pub(super) fn by_convex_steps(&self) -> Option<CoulombSolution> {
        if self.sites().iter().any(Site::is_kept) {
            return None;
        }
        let (mut x, mut slips) = (vec![0.0; self.b().len()], vec![0.0; self.sites().len()]);
        for _ in 0..STEPS {
            let mut b = self.b().to_vec();
            for (site, slip) in self.sites().iter().zip(&slips) {
                if let Some((normal, mu)) = site.cone() {
                    b[normal] += mu * slip;
                }
            }
            self.descend(&b, &mut x)?;
            let rates = self.rates(&x);
            let branches: Vec<SiteBranch> =
                self.sites().iter().map(|site| site.branch_of(&x, &rates)).collect();
            if let Some(solved) = self.judged(&x, &branches) {
                return Some(solved);
            }
            for (site, slip) in self.sites().iter().zip(&mut slips) {
                *slip = 0.5 * (*slip + site.speed(&rates));
            }
        }
        None
    }

    /// To the minimum of (1).
    fn descend(&self, b: &[f64], x: &mut Vec<f64>) -> Option<()> {
        let (k, d) = (b.len(), self.d());
        let sums = d.chunks_exact(k).map(|row| row.iter().map(|it| it.abs()).sum::<f64>());
        let steepest = sums.fold(f64::MIN_POSITIVE, f64::max);
        let (mut ahead, mut weight) = (x.clone(), 1.0_f64);
        for _ in 0..DESCENT {
            let slopes = d.chunks_exact(k).zip(b).map(|(row, b)| b + dot(row, &ahead));
            let mut next: Vec<f64> =
                ahead.iter().zip(slopes).map(|(x, slope)| x - slope / steepest).collect();
            self.sites().iter().for_each(|site| site.project(&mut next));
            let turned: f64 = ahead
                .iter()
                .zip(&next)
                .zip(&*x)
                .map(|((y, next), x)| (y - next) * (next - x))
                .sum();
            let last = if turned > 0.0 { 1.0 } else { weight };
            weight = 0.5 * (1.0 + (1.0 + 4.0 * last * last).sqrt());
            let by = (last - 1.0) / weight;
            let moved = next.iter().zip(&*x).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
            ahead = next.iter().zip(&*x).map(|(next, x)| next + by * (next - x)).collect();
            *x = next;
            if moved <= SETTLED * size(x) {
                break;
            }
        }
        x.iter().all(|x| x.is_finite()).then_some(())
    }
}

impl Site {
    /// Whether its slip goes on in a direction that is given.
    fn is_kept(&self) -> bool {
        match *self {
            Self::Gap { friction, .. } => friction.is_some_and(|it| it.slip != 0.0),
            Self::Joint { .. } => false,
            Self::Cone { heading, .. } => heading.is_some(),
        }
    }

    /// Its normal row and the coefficient of friction.
    fn cone(&self) -> Option<(usize, f64)> {
        match *self {
            Self::Gap { normal, friction } => friction.map(|it| (normal, it.mu.0)),
            Self::Joint { .. } => None,
            Self::Cone { rows, mu, .. } => Some((rows[0], mu.0)),
        }
    }

    /// The slip speed.
    pub(super) fn speed(&self, rates: &[f64]) -> f64 {
        match *self {
            Self::Gap { friction, .. } => friction.map_or(0.0, |it| rates[it.row].abs()),
            Self::Joint { .. } => 0.0,
            Self::Cone { rows: [_, one, other], .. } => rates[one].hypot(rates[other]),
        }
    }

    /// Takes its forces to the nearest within the cone.
    fn project(&self, x: &mut [f64]) {
        match *self {
            Self::Gap { normal, friction: None } => x[normal] = x[normal].max(0.0),
            Self::Joint { row, limits: (slip, _) } => x[row] = x[row].clamp(-slip, slip),
            Self::Gap { normal, friction: Some(it) } => {
                let (pressed, part) = nearest(x[normal], x[it.row].abs(), it.mu.0);
                (x[normal], x[it.row]) = (pressed, part * x[it.row]);
            }
            Self::Cone { rows: [normal, one, other], mu, .. } => {
                let (pressed, part) = nearest(x[normal], x[one].hypot(x[other]), mu.0);
                (x[normal], x[one], x[other]) = (pressed, part * x[one], part * x[other]);
            }
        }
    }

    /// What it does with these forces and rates.
    fn branch_of(&self, x: &[f64], rates: &[f64]) -> SiteBranch {
        let none = NONE * size(x);
        match *self {
            Self::Joint { row, limits: (slip, _) } => match x[row].abs() < (1.0 - EDGE) * slip {
                true => SiteBranch::Held,
                false => SiteBranch::Slip(-x[row].signum()),
            },
            Self::Gap { normal, .. } if x[normal] <= none => SiteBranch::Open,
            Self::Gap { friction: None, .. } => SiteBranch::Held,
            Self::Gap { normal, friction: Some(it) } => {
                match x[it.row].abs() < (1.0 - EDGE) * it.mu.0 * x[normal] {
                    true => SiteBranch::Held,
                    false => SiteBranch::Slip(-x[it.row].signum()),
                }
            }
            Self::Cone { rows: [normal, ..], .. } if x[normal] <= none => SiteBranch::Open,
            Self::Cone { rows: [normal, one, other], mu, .. } => {
                let force = x[one].hypot(x[other]);
                if force < (1.0 - EDGE) * mu.0 * x[normal] {
                    return SiteBranch::Held;
                }
                let slides = rates[one].hypot(rates[other]) > EDGE * size(rates);
                SiteBranch::Turn(match slides || force == 0.0 {
                    true => rates[other].atan2(rates[one]),
                    false => (-x[other]).atan2(-x[one]),
                })
            }
        }
    }
}

/// The normal force of the nearest point of a cone, and the part of the tangential one that is left.
fn nearest(pressed: f64, pull: f64, mu: f64) -> (f64, f64) {
    if pull <= mu * pressed {
        (pressed, 1.0)
    } else if mu * pull <= -pressed {
        (0.0, 0.0)
    } else {
        let pressed = (pressed + mu * pull) / (1.0 + mu * mu);
        (pressed, mu * pressed / pull)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_point_of_a_cone_is_orthogonal_to_what_is_left() {
        let mu = 0.4;
        for (pressed, pull) in [(1.0, 0.3), (-1.0, 0.5), (1.0, 2.0), (-0.5, 2.0)] {
            let (found, part) = nearest(pressed, pull, mu);
            let left = [pressed - found, pull - part * pull];
            assert!(part * pull <= mu * found + 1e-15);
            assert!((left[0] * found + left[1] * part * pull).abs() < 1e-15);
            // what is left is in the polar cone
            assert!(left[0] + mu * left[1] <= 1e-15, "{pressed} {pull}");
        }
    }

    /// The impact of a box on an edge that steps contact by contact do not solve.
    #[test]
    fn an_impact_on_an_edge_with_little_slip() {
        let rows = |flip: f64| {
            let [a, b, c] = [0.805_937, -0.245_16 * flip, 4.340_224];
            [[1.471_021, 0.980_141 * flip, a], [0.980_141 * flip, 7.352_469, b], [a, b, c]]
        };
        let cross = [
            [1.143_043, 0.980_141, 0.802_983],
            [-0.980_141, 7.352_469, 0.245_16],
            [0.802_983, -0.245_16, 4.015_473],
        ];
        let (own, other) = (rows(1.0), rows(-1.0));
        let mut d = vec![0.0; 36];
        for i in 0..3 {
            for j in 0..3 {
                d[6 * i + j] = own[i][j];
                d[6 * (i + 3) + j + 3] = other[i][j];
                d[6 * i + j + 3] = cross[i][j];
                d[6 * (j + 3) + i] = cross[i][j];
            }
        }
        let b = [1.3 * -4.702_993, 0.723_873, 2.327_886, 1.3 * -4.768_367, 0.723_873, 2.186_515];
        let mu = (0.332_23, 0.332_23);
        let cone =
            |first: usize| Site::Cone { rows: [first, first + 1, first + 2], mu, heading: None };
        let found = Coulomb::new(vec![cone(0), cone(3)], &d, &b).by_convex_steps().unwrap();
        let x = found.forces.unwrap();
        let v: Vec<f64> = (0..6).map(|i| b[i] + dot(&d[6 * i..][..6], &x)).collect();
        for at in [0, 3] {
            let (pull, speed) = (x[at + 1].hypot(x[at + 2]), v[at + 1].hypot(v[at + 2]));
            assert!(v[at].abs() < 1e-9 && (pull - mu.0 * x[at]).abs() < 1e-9, "{v:?} {x:?}");
            let along = x[at + 1] * v[at + 1] + x[at + 2] * v[at + 2];
            assert!((along + pull * speed).abs() < 1e-9 && speed > 1e-4);
        }
    }
}
