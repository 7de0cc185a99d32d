//! Undetermined forces within round cones: how far inequalities let them vary.
//!
//! ```text
//! x = x_0 + V alpha    levels  l_j = a_j + s_j . alpha,   l_j = n_j(alpha) - |t_j(alpha)|       (1)
//! margin   max t :  l_j >= t                                                               (2)
//! least    min |alpha|^2 :  l_j >= 0                                                       (3)
//! ```
//!
//! Both are found by Newton's method along the central path of their logarithmic barrier, `-log((n - t)^2 - |t|^2)` for
//! a cone (S. Boyd and L. Vandenberghe, *Convex Optimization*, section 11). The margin is that of
//! [`crate::mechanics::shares`], where cones are intervals.

use crate::numeric::dense::{dot, largest};
use crate::numeric::elimination::Elimination;

/// Bounds of the margin and of the forces, relative to the largest level.
const CAP: f64 = 4.0;
const FAR: f64 = 1e3;
/// The weight of the objective grows by this factor, up to the last: what is left is rounding.
const GROWTH: f64 = 8.0;
const LAST: f64 = 1e13;
/// Newton steps for one weight, and their halvings.
const NEWTON: usize = 40;
const HALVINGS: usize = 50;
/// Where a Newton step lowers the barrier by less, its minimum is reached.
const REACHED: f64 = 1e-9;
/// Pivots below this are zero.
const SINGULAR: f64 = 1e-15;
/// Levels above this part of the largest, below zero, obey the inequality.
const OBEYED: f64 = 1e-9;

/// A number that is affine in `alpha`.
type AffineLevel = (f64, Vec<f64>);

/// The inequalities (1).
#[derive(Clone, Debug, Default)]
pub(in crate::mechanics) struct ConeShares {
    d: usize,
    levels: Vec<AffineLevel>,
    cones: Vec<[AffineLevel; 3]>,
}

/// A barrier at a place: its value, gradient and Hessian.
struct Barrier {
    value: f64,
    gradient: Vec<f64>,
    hessian: Vec<f64>,
}

impl Barrier {
    fn new(size: usize) -> Self {
        Self { value: 0.0, gradient: vec![0.0; size], hessian: vec![0.0; size * size] }
    }

    /// Adds `-log f`. The Hessian of `f` is the sum of `w u u^T`.
    fn add(&mut self, f: f64, gradient: &[f64], curved: &[(f64, &[f64])]) {
        let n = gradient.len();
        self.value -= f.ln();
        for i in 0..n {
            self.gradient[i] -= gradient[i] / f;
            for j in 0..n {
                let outer = gradient[i] * gradient[j] / f;
                let own: f64 = curved.iter().map(|(w, u)| w * u[i] * u[j]).sum();
                self.hessian[i * n + j] += (outer - own) / f;
            }
        }
    }
}

impl ConeShares {
    pub(in crate::mechanics) fn new(d: usize) -> Self {
        Self { d, ..Self::default() }
    }

    /// One more level.
    pub(in crate::mechanics) fn push(&mut self, level: AffineLevel) {
        self.levels.push(level);
    }

    /// One more level that is the distance to the surface of a cone: its limit, then both components.
    pub(in crate::mechanics) fn push_cone(&mut self, cone: [AffineLevel; 3]) {
        self.cones.push(cone);
    }

    /// The levels at a place.
    fn values<'a>(&'a self, alpha: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        let at = |(a, s): &AffineLevel| a + dot(s, alpha);
        let lines = self.levels.iter().map(at);
        lines.chain(self.cones.iter().map(move |[n, x, y]| at(n) - at(x).hypot(at(y))))
    }

    fn least_value(&self, alpha: &[f64]) -> f64 {
        self.values(alpha).fold(f64::INFINITY, f64::min)
    }

    fn size(&self) -> f64 {
        let all = self.levels.iter().chain(self.cones.iter().flatten());
        all.fold(0.0, |most, it| most.max(it.0.abs()))
    }

    /// The margin (2) and its place.
    pub(in crate::mechanics) fn margin(&self) -> (f64, Vec<f64>) {
        let (d, size) = (self.d, self.size());
        if size == 0.0 {
            return (0.0, vec![0.0; d]);
        }
        // alpha, then t, both relative to the largest level
        let mut z = vec![0.0; d + 1];
        z[d] = self.least_value(&vec![0.0; d]) / size - 1.0;
        let mut weight = 1.0;
        while weight < LAST {
            weight *= GROWTH;
            let objective = |z: &[f64], to: &mut Barrier| {
                to.value -= weight * z[d];
                to.gradient[d] -= weight;
            };
            self.follow(&mut z, size, &objective);
        }
        let alpha: Vec<f64> = z[..d].iter().map(|z| z * size).collect();
        (self.least_value(&alpha).min(CAP * size), alpha)
    }

    /// The least `alpha` (3), and whether it obeys the inequalities.
    pub(in crate::mechanics) fn least(&self) -> (Vec<f64>, bool) {
        let (d, size) = (self.d, self.size());
        let mut z = vec![0.0; d + 1];
        if self.least_value(&z[..d]) >= -OBEYED * size {
            return (z[..d].to_vec(), true);
        }
        let (margin, alpha) = self.margin();
        if margin <= OBEYED * size {
            return (alpha, margin >= -OBEYED * size);
        }
        z[..d].iter_mut().zip(&alpha).for_each(|(z, alpha)| *z = alpha / size);
        let mut weight = 1.0;
        while weight < LAST {
            weight *= GROWTH;
            let objective = |z: &[f64], to: &mut Barrier| {
                for (i, z) in z[..d].iter().enumerate() {
                    to.value += 0.5 * weight * z * z;
                    to.gradient[i] += weight * z;
                    to.hessian[i * (d + 1) + i] += weight;
                    // t stays as it is
                    (to.hessian[i * (d + 1) + d], to.hessian[d * (d + 1) + i]) = (0.0, 0.0);
                }
                to.hessian[d * (d + 1) + d] += 1.0;
                to.gradient[d] = 0.0;
            };
            self.follow(&mut z, size, &objective);
        }
        (z[..d].iter().map(|z| z * size).collect(), true)
    }

    /// To the minimum of the barrier with an objective.
    fn follow(&self, z: &mut Vec<f64>, size: f64, objective: &dyn Fn(&[f64], &mut Barrier)) {
        let n = z.len();
        for _ in 0..NEWTON {
            let Some(mut here) = self.barrier(z, size) else { return };
            objective(z, &mut here);
            let down: Vec<f64> = here.gradient.iter().map(|g| -g).collect();
            let step = Elimination::new(here.hessian.clone(), n, SINGULAR).solve(&down);
            let slope = dot(&step, &here.gradient);
            if slope.is_nan() || slope >= -REACHED {
                return;
            }
            let mut length = 1.0;
            let found = (0..HALVINGS).find_map(|_| {
                let at: Vec<f64> = z.iter().zip(&step).map(|(z, s)| z + length * s).collect();
                length *= 0.5;
                let mut there = self.barrier(&at, size)?;
                objective(&at, &mut there);
                (there.value <= here.value + 0.25 * 2.0 * length * slope).then_some(at)
            });
            match found {
                Some(at) => *z = at,
                None => return,
            }
        }
    }

    /// The barrier of levels above `t`, within the bounds; none where one is violated.
    fn barrier(&self, z: &[f64], size: f64) -> Option<Barrier> {
        let d = self.d;
        let mut all = Barrier::new(d + 1);
        let (alpha, t) = (&z[..d], z[d]);
        let at = |(a, s): &AffineLevel| a / size + dot(s, alpha);
        let mut row = vec![0.0; d + 1];
        for level in &self.levels {
            let f = at(level) - t;
            (f > 0.0).then_some(())?;
            row[..d].copy_from_slice(&level.1);
            row[d] = -1.0;
            all.add(f, &row, &[]);
        }
        for [n, x, y] in &self.cones {
            let [most, along, across] = [at(n) - t, at(x), at(y)];
            let f = (most - along.hypot(across)) * (most + along.hypot(across));
            (most > 0.0 && f > 0.0).then_some(())?;
            let rows = [n, x, y].map(|it| {
                let mut row = it.1.clone();
                row.push(0.0);
                row
            });
            let [mut of_n, of_x, of_y] = rows;
            of_n[d] = -1.0;
            for i in 0..=d {
                row[i] = 2.0 * (most * of_n[i] - along * of_x[i] - across * of_y[i]);
            }
            all.add(f, &row, &[(2.0, &of_n), (-2.0, &of_x), (-2.0, &of_y)]);
        }
        row.fill(0.0);
        row[d] = -1.0;
        (CAP - t > 0.0).then_some(())?;
        all.add(CAP - t, &row, &[]);
        for i in 0..d {
            for sign in [1.0, -1.0] {
                let f = FAR - sign * z[i];
                (f > 0.0).then_some(())?;
                row.fill(0.0);
                row[i] = -sign;
                all.add(f, &row, &[]);
            }
        }
        Some(all)
    }

    /// Range of one component of the feasible `alpha` within the inequalities.
    pub(in crate::mechanics) fn width(&self, alpha: &[f64], part: usize) -> f64 {
        let largest_slope = self.levels.iter().map(|it| largest(&it.1)).fold(0.0, f64::max);
        let size = self.size().max(largest_slope);
        let reach = |sign: f64| {
            let obeys = |length: f64| {
                let mut at = alpha.to_vec();
                at[part] += sign * length;
                self.least_value(&at) >= -OBEYED * size
            };
            let (mut low, mut high) = (0.0, FAR * size);
            if obeys(high) {
                return f64::INFINITY;
            }
            for _ in 0..HALVINGS {
                let middle = 0.5 * (low + high);
                if obeys(middle) {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            low
        };
        reach(1.0) + reach(-1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One sticking contact whose normal force and tangential force vary: `(p, x, y) = (1 + a, x_0 + b, 0)`.
    #[test]
    fn the_margin_of_one_cone_is_that_of_its_axis() {
        let mut shares = ConeShares::new(1);
        // n = .5 - .2 a, (x, y) = (a - .3, .1): largest distance to the surface
        shares.push_cone([(0.5, vec![-0.2]), (-0.3, vec![1.0]), (0.1, vec![0.0])]);
        let (margin, alpha) = shares.margin();
        let value = |a: f64| 0.5 - 0.2 * a - (a - 0.3_f64).hypot(0.1);
        // (a - .3)/hypot = -.2
        let a = 0.3 - 0.2 * 0.1 / (1.0_f64 - 0.04).sqrt();
        assert!((margin - value(a)).abs() < 1e-12, "{margin} {}", value(a));
        assert!((alpha[0] - a).abs() < 1e-5);
        let (least, obeys) = shares.least();
        assert!(obeys && value(least[0]).abs() < 1e-9 || least[0] == 0.0);
        assert!((shares.width(&alpha, 0) - 2.0 * 0.3).abs() < 0.7);
    }

    #[test]
    fn shares_without_freedom_in_the_cones_are_violated_by_as_much() {
        let mut shares = ConeShares::new(1);
        shares.push((1.0, vec![1.0]));
        shares.push((1.0, vec![-1.0]));
        shares.push_cone([(0.5, vec![0.0]), (0.6, vec![0.0]), (0.8, vec![0.0])]);
        assert!((shares.margin().0 + 0.5).abs() < 1e-12);
        assert!(!shares.least().1);
        let mut shares = ConeShares::new(1);
        shares.push((-1.0, vec![1.0]));
        shares.push((3.0, vec![-1.0]));
        assert!((shares.margin().0 - 1.0).abs() < 1e-12);
        let (least, obeys) = shares.least();
        assert!(obeys && (least[0] - 1.0).abs() < 1e-6, "{least:?}");
        assert!((shares.width(&least, 0) - 2.0).abs() < 1e-5);
    }
}
