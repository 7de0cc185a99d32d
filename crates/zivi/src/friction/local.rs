//! One contact with friction in two directions: all its solutions.
//!
//! ```text
//! (g, w) = b + D (p, f)      0 <= p  perp  g >= 0      f = -mu p w/|w|, or |f| <= mu p where w = 0   (1)
//! slip along d:  K(d) = D_nn - mu D_nt d    p = -b_n/K    w = b_t + p (D_tn - mu D_tt d)             (2)
//! d x [b_t K(d) - b_n (D_tn - mu D_tt d)] = 0                                                        (3)
//! ```
//!
//! with rates and impulses of an impact, or with accelerations and forces. Equation (3), that the slip has the
//! direction `d`, is a trigonometric polynomial of degree two: a quartic in the tangent of half the angle. Where
//! `K(d) > 0` for all `d` there is one solution, open, sticking or slipping, but for about one random contact in
//! 20 000, which has three.

use crate::kinetics::{Kinetics, Undetermined};
use crate::numeric::dense::dot;
use crate::record::gap_set::ContactMode;

/// Real roots of polynomials lie between those of the derivative; this number of halvings reaches rounding.
const HALVINGS: usize = 200;
/// Newton steps that polish an angle.
const POLISH: usize = 12;
/// A polynomial that comes this close to zero without a change of sign, relative to its terms, has a double root.
const TOUCHES: f64 = 1e-13;
/// Angles that differ by less are one.
const SAME: f64 = 1e-7;
/// Number of trial angles for a quartic without a root at infinity.
const TURNS: usize = 5;

/// Equation (1) of a contact: the row of the normal first, then those of both tangents.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LocalContact {
    pub(crate) d: [[f64; 3]; 3],
    pub(crate) b: [f64; 3],
    pub(crate) mu: f64,
}

/// A solution with slip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LocalSlip {
    /// The direction of the slip, of length one.
    pub(crate) heading: [f64; 2],
    /// The normal force or impulse.
    pub(crate) pressed: f64,
    /// The slip along the direction, not negative.
    pub(crate) speed: f64,
    /// `K` of the direction.
    pub(crate) k: f64,
}

impl LocalContact {
    /// The force that keeps the contact closed without slip, if `D` is regular.
    pub(crate) fn held(&self) -> Option<[f64; 3]> {
        let [a, b, c] = self.d;
        let minor = |i: usize, j: usize, p: [f64; 3], q: [f64; 3]| p[i] * q[j] - p[j] * q[i];
        let of = [minor(1, 2, b, c), -minor(0, 2, b, c), minor(0, 1, b, c)];
        let determinant = a[0] * of[0] + a[1] * of[1] + a[2] * of[2];
        let [x, y, z] = self.b;
        let column = |k: usize| {
            let with = |row: [f64; 3], value: f64| {
                let mut row = row;
                row[k] = -value;
                row
            };
            let [a, b, c] = [with(a, x), with(b, y), with(c, z)];
            a[0] * minor(1, 2, b, c) - a[1] * minor(0, 2, b, c) + a[2] * minor(0, 1, b, c)
        };
        let force = [column(0), column(1), column(2)].map(|it| it / determinant);
        force.iter().all(|it| it.is_finite()).then_some(force)
    }

    /// The same where that is within the cone.
    pub(crate) fn stick(&self) -> Option<[f64; 3]> {
        self.held().filter(|[p, f, g]| *p >= 0.0 && f.hypot(*g) <= self.mu * p)
    }

    /// `K` of a direction.
    pub(crate) fn k(&self, [c, s]: [f64; 2]) -> f64 {
        self.d[0][0] - self.mu * (c * self.d[0][1] + s * self.d[0][2])
    }

    /// The slip with a direction and a normal force, equation (2).
    fn slip(&self, heading: [f64; 2], pressed: f64) -> [f64; 2] {
        let [c, s] = heading;
        [1, 2].map(|i| {
            let [n, t, r] = self.d[i];
            self.b[i] + pressed * (n - self.mu * (t * c + r * s))
        })
    }

    /// The solutions with slip in the direction of which they press.
    pub(crate) fn slips(&self) -> Vec<LocalSlip> {
        let mut all: Vec<LocalSlip> = Vec::new();
        for angle in self.angles() {
            let heading = [angle.cos(), angle.sin()];
            let k = self.k(heading);
            let pressed = -self.b[0] / k;
            let [x, y] = self.slip(heading, pressed);
            let speed = heading[0] * x + heading[1] * y;
            if pressed >= 0.0 && speed >= 0.0 && pressed.is_finite() {
                all.push(LocalSlip { heading, pressed, speed, k });
            }
        }
        all
    }

    /// The coefficients of (3): of `cos`, `sin`, `cos^2`, `cos sin` and `sin^2`.
    fn trigonometric(&self) -> [f64; 5] {
        let ([n, u, v], [of_n, x, y], mu) = (self.d[0], self.b, self.mu);
        let ([p, p1, p2], [q, q1, q2]) = (self.d[1], self.d[2]);
        [
            n * y - of_n * q,
            of_n * p - n * x,
            mu * (of_n * q1 - y * u),
            mu * (x * u - y * v + of_n * (q2 - p1)),
            mu * (x * v - of_n * p2),
        ]
    }

    /// The angles that solve (3).
    fn angles(&self) -> Vec<f64> {
        let a = self.trigonometric();
        let scale = a.iter().fold(0.0_f64, |most, it| most.max(it.abs()));
        if scale == 0.0 || !scale.is_finite() {
            return Vec::new();
        }
        let a = a.map(|it| it / scale);
        let value = |angle: f64| {
            let (s, c) = angle.sin_cos();
            let value = c * (a[0] + a[2] * c + a[3] * s) + s * (a[1] + a[4] * s);
            let slope = a[1] * c - a[0] * s + 2.0 * (a[4] - a[2]) * s * c + a[3] * (c * c - s * s);
            (value, slope)
        };
        // the angle opposite to the one at which the half-angle tangent is infinite
        let turn = (0..TURNS).map(|k| 0.7 + 1.3 * k as f64).reduce(|one, other| {
            let far = |turn: f64| value(turn + std::f64::consts::PI).0.abs();
            if far(other) > far(one) {
                other
            } else {
                one
            }
        });
        let turn = turn.unwrap_or(0.0);
        let (s, c) = turn.sin_cos();
        // the same polynomial of the angle from there on
        let first = [a[0] * c + a[1] * s, a[1] * c - a[0] * s];
        let mean = 0.5 * (a[2] + a[4]);
        let (half, skew) = (0.5 * (a[2] - a[4]), 0.5 * a[3]);
        let (c2, s2) = (c * c - s * s, 2.0 * s * c);
        let (half, skew) = (half * c2 + skew * s2, skew * c2 - half * s2);
        let turned = [first[0], first[1], mean + half, 2.0 * skew, mean - half];
        let quartic = [
            turned[0] + turned[2],
            2.0 * (turned[1] + turned[3]),
            4.0 * turned[4] - 2.0 * turned[2],
            2.0 * (turned[1] - turned[3]),
            turned[2] - turned[0],
        ];
        let mut angles: Vec<f64> = Vec::new();
        for x in real_roots(&quartic) {
            let mut angle = turn + 2.0 * x.atan();
            for _ in 0..POLISH {
                let (f, slope) = value(angle);
                let step = f / slope;
                if !step.is_finite() || step.abs() > SAME {
                    break;
                }
                angle -= step;
                if step.abs() <= 4.0 * f64::EPSILON {
                    break;
                }
            }
            let apart = |other: &f64| (0.5 * (angle - other)).sin().abs() > 0.5 * SAME;
            if angles.iter().all(apart) {
                angles.push(angle);
            }
        }
        angles
    }
}

impl Kinetics {
    /// Of some solutions the one whose direction is nearest to that before: by how much it has turned.
    pub(crate) fn head_near(
        &mut self,
        pair: [usize; 2],
        slips: &[LocalSlip],
        [c, s]: [f64; 2],
    ) -> Option<f64> {
        let far = |it: &LocalSlip| (it.heading[0] - c).hypot(it.heading[1] - s);
        let nearest = slips.iter().min_by(|one, other| far(one).total_cmp(&far(other)))?;
        self.head(pair, nearest.heading);
        Some(far(nearest))
    }

    /// The rows of a gap and both of its tangents.
    pub(crate) fn rows_of_cone(&self, gap: usize, [first, second]: [usize; 2]) -> [usize; 3] {
        [gap, self.row(first), self.row(second)]
    }

    /// How the slips of some contacts are accelerated by a force of one along the first, then the second of its
    /// tangents, while the rows of a mode stay as they are.
    pub(crate) fn slip_response(
        &mut self,
        mode: ContactMode,
        pair: [usize; 2],
        of: &[[usize; 2]],
    ) -> Result<Vec<f64>, Undetermined> {
        let edges = self.edges(mode)?;
        let mut all = Vec::with_capacity(4 * of.len());
        for channel in pair {
            let mut along = self.mobility(self.row(channel)).to_vec();
            let held = edges.solve(|row| -dot(self.normal(row), &along));
            edges.push(&held, &mut along);
            all.extend(of.iter().flatten().map(|&it| dot(self.normal(self.row(it)), &along)));
        }
        Ok(all)
    }

    /// Equation (1) of one contact whose rows have the rates `b` without it, while the rows of a mode stay as they
    /// are.
    pub(crate) fn local_contact(
        &mut self,
        mode: ContactMode,
        (gap, pair): (usize, [usize; 2]),
        b: [f64; 3],
    ) -> Option<LocalContact> {
        let rows = self.rows_of_cone(gap, pair);
        let edges = match self.rows_of(mode).is_empty() {
            true => None,
            false => Some(self.edges(mode).ok()?),
        };
        let mut d = [[0.0; 3]; 3];
        for (j, &row) in rows.iter().enumerate() {
            let mut along = self.mobility(row).to_vec();
            if let Some(edges) = &edges {
                let held = edges.solve(|held| -dot(self.normal(held), &along));
                edges.push(&held, &mut along);
            }
            for (i, &row) in rows.iter().enumerate() {
                d[i][j] = dot(self.normal(row), &along);
            }
        }
        Some(LocalContact { d, b, mu: self.friction_limits(pair[0]).0 })
    }
}

/// The real roots of a polynomial, the constant first, in their order: they lie between those of its derivative.
pub(super) fn real_roots(a: &[f64]) -> Vec<f64> {
    let mut degree = a.len() - 1;
    while degree > 0 && a[degree] == 0.0 {
        degree -= 1;
    }
    let a = &a[..=degree];
    match degree {
        0 => return Vec::new(),
        1 => return vec![-a[0] / a[1]],
        _ => (),
    }
    let value = |x: f64| a.iter().rev().fold(0.0, |sum, a| sum * x + a);
    let terms = |x: f64| a.iter().rev().fold(0.0, |sum, a| sum * x.abs() + a.abs());
    let derivative: Vec<f64> = a.iter().enumerate().skip(1).map(|(k, a)| k as f64 * a).collect();
    // Cauchy's bound
    let bound = 1.0 + a[..degree].iter().fold(0.0_f64, |m, it| m.max((it / a[degree]).abs()));
    let mut ends = vec![-bound];
    ends.extend(real_roots(&derivative).into_iter().filter(|x| x.abs() < bound));
    ends.push(bound);
    let mut roots: Vec<f64> = Vec::new();
    for (k, pair) in ends.windows(2).enumerate() {
        let (mut low, mut high) = (pair[0], pair[1]);
        let (at_low, at_high) = (value(low), value(high));
        if k > 0 && at_low.abs() <= TOUCHES * terms(low) {
            if roots.last().is_none_or(|last| *last != low) {
                roots.push(low);
            }
            continue;
        }
        if at_low * at_high > 0.0 || at_high.abs() <= TOUCHES * terms(high) && k + 2 < ends.len() {
            continue;
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if value(middle) * at_low > 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        roots.push(0.5 * (low + high));
    }
    roots
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers from -1 to 1, always the same.
    struct Draws(u64);

    impl Draws {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        }

        /// About normally distributed.
        fn normal(&mut self) -> f64 {
            (0..6).map(|_| self.next()).sum::<f64>() / 2.0_f64.sqrt()
        }

        /// A contact with `D = A A^T`.
        fn contact(&mut self) -> LocalContact {
            let a: [[f64; 4]; 3] = [(); 3].map(|()| [(); 4].map(|()| self.normal()));
            let d = [0, 1, 2].map(|i| [0, 1, 2].map(|j| dot(&a[i], &a[j])));
            let b = [-self.normal().abs(), 3.0 * self.normal(), 3.0 * self.normal()];
            LocalContact { d, b, mu: 0.4 + 0.4 * self.next() }
        }
    }

    fn least_k(it: &LocalContact) -> f64 {
        it.d[0][0] - it.mu * it.d[0][1].hypot(it.d[0][2])
    }

    /// Whether friction may raise the energy in an impact with any restitution up to this one.
    fn cosine_squared(it: &LocalContact) -> f64 {
        let [[n, u, v], [_, p, q], [_, _, r]] = it.d;
        (u * (r * u - q * v) + v * (p * v - q * u)) / (p * r - q * q) / n
    }

    /// Rates after the forces, and the forces.
    fn outcome(it: &LocalContact) -> Vec<([f64; 3], [f64; 3])> {
        let after = |f: [f64; 3]| [0, 1, 2].map(|i| it.b[i] + dot(&it.d[i], &f));
        let stick = it.stick().into_iter();
        let slips = it.slips().into_iter().map(|slip| {
            let [c, s] = slip.heading;
            [slip.pressed, -it.mu * slip.pressed * c, -it.mu * slip.pressed * s]
        });
        stick.chain(slips).map(|f| (after(f), f)).collect()
    }

    #[test]
    fn a_pressed_contact_without_a_paradox_sticks_or_slips_in_one_way() {
        let (mut draws, mut regular, mut several, mut worst) = (Draws(7), 0, 0, 0.0_f64);
        for _ in 0..100_000 {
            let contact = draws.contact();
            if least_k(&contact) <= 0.0 {
                continue;
            }
            regular += 1;
            let found = outcome(&contact);
            if found.len() != 1 {
                // normal and tangents are coupled strongly
                assert_eq!(found.len(), 3, "{contact:?}");
                several += 1;
                continue;
            }
            let ([g, x, y], [p, f, h]) = found[0];
            let scale = contact.b.iter().fold(0.0_f64, |a, b| a.max(b.abs()))
                + (0..3).map(|i| contact.d[i][i]).fold(0.0, f64::max) * p;
            let speed = x.hypot(y);
            let across = if contact.stick().is_some() { speed } else { (x * h - y * f) / p };
            worst = worst.max(g.abs() / scale).max(across.abs() / scale);
            assert!(p >= 0.0 && f.hypot(h) <= contact.mu * p * (1.0 + 1e-12));
            // friction acts against the slip
            assert!(x * f + y * h <= 1e-12 * scale * p);
        }
        assert!(regular > 60_000 && worst < 1e-13, "{regular} {worst}");
        assert!(several < 30, "{several}");
    }

    #[test]
    fn the_slip_is_where_a_grid_of_directions_has_it() {
        let mut draws = Draws(11);
        for _ in 0..200 {
            let contact = draws.contact();
            if least_k(&contact) <= 0.0 || contact.stick().is_some() {
                continue;
            }
            // the direction is that of the slip which it makes
            let misses = |angle: f64| {
                let d = [angle.cos(), angle.sin()];
                let [x, y] = contact.slip(d, -contact.b[0] / contact.k(d));
                ((d[0] * y - d[1] * x) / x.hypot(y), d[0] * x + d[1] * y)
            };
            let step = 1e-4;
            let count = (2.0 * std::f64::consts::PI / step) as usize + 1;
            let mut crossings = Vec::new();
            for i in 0..count {
                let (angle, next) = (i as f64 * step, (i + 1) as f64 * step);
                let ((one, along), (other, _)) = (misses(angle), misses(next));
                if one * other <= 0.0 && along > 0.0 && (one - other).abs() < 0.1 {
                    crossings.push(angle + 0.5 * step);
                }
            }
            let [c, s] = contact.slips()[0].heading;
            let near = |angle: &f64| (angle.cos() - c).hypot(angle.sin() - s) < 2.0 * step;
            assert!(crossings.iter().any(near), "{crossings:?} {c} {s} {contact:?}");
        }
    }

    #[test]
    fn impacts_lose_energy_up_to_the_restitution_of_the_kinetic_cosine() {
        let (mut draws, mut gains, mut beyond) = (Draws(13), 0, 0);
        for _ in 0..100_000 {
            let before = draws.contact();
            let e = 0.5 + 0.5 * draws.next();
            let contact =
                LocalContact { b: [(1.0 + e) * before.b[0], before.b[1], before.b[2]], ..before };
            if least_k(&contact) <= 0.0 {
                continue;
            }
            let (after, impulse) = outcome(&contact)[0];
            let after = [after[0] - e * before.b[0], after[1], after[2]];
            let pairs = impulse.iter().zip(after.iter().zip(&before.b));
            let terms: Vec<f64> = pairs.map(|(p, (v, u))| 0.5 * p * (v + u)).collect();
            let size: f64 = terms.iter().map(|it| it.abs()).sum();
            let gain = terms.iter().sum::<f64>() > 1e-12 * size;
            match e * e <= 1.0 - cosine_squared(&before) {
                true => gains += usize::from(gain),
                false => beyond += usize::from(gain),
            }
        }
        assert!(gains == 0 && beyond > 0, "{gains} {beyond}");
    }

    #[test]
    fn two_impacts_are_those_of_forty_digits() {
        let a = [[-0.8, -1.32, -0.25, 0.42], [1.14, 0.11, -0.55, -0.78], [0.75, 1.63, 0.27, -1.23]];
        let b = [[-0.04, -0.3, -1.05, -0.4], [-1.09, -1.36, 0.22, -1.11], [1.17, 0.72, -2.0, 0.27]];
        let cases = [
            (
                a,
                0.37,
                [-2.4, 0.61, -5.2],
                1.752_722_109_871_716,
                [-0.321_764_394_138_204_8, -7.884_144_799_783_544],
            ),
            (
                b,
                0.52,
                [-0.05, 0.13, -5.97],
                0.022_254_959_226_417_716,
                [0.109_215_146_499_501_59, -5.861_908_333_725_224],
            ),
        ];
        for (a, mu, b, pressed, slip) in cases {
            let d = [0, 1, 2].map(|i: usize| [0, 1, 2].map(|j: usize| dot(&a[i], &a[j])));
            let contact = LocalContact { d, b, mu };
            let all = contact.slips();
            assert_eq!(all.len(), 1);
            let [x, y] = contact.slip(all[0].heading, all[0].pressed);
            assert!((all[0].pressed - pressed).abs() < 1e-14, "{}", all[0].pressed);
            assert!((x - slip[0]).abs() < 1e-14 && (y - slip[1]).abs() < 1e-14, "{x} {y}");
        }
    }

    #[test]
    fn roots_of_polynomials_are_found_also_where_they_are_double() {
        let near = |a: &[f64], roots: &[f64]| {
            let found = real_roots(a);
            let pairs = found.iter().zip(roots);
            found.len() == roots.len() && pairs.into_iter().all(|(x, y)| (x - y).abs() < 1e-7)
        };
        // (x + 2)(x - 1)(x - 3)(x - 1/2), (x^2 + 1)(x - 1)^2, x^2 + 1
        assert!(near(&[-3.0, 8.5, -4.0, -2.5, 1.0], &[-2.0, 0.5, 1.0, 3.0]));
        assert!(near(&[1.0, -2.0, 2.0, -2.0, 1.0], &[1.0]));
        assert!(near(&[1.0, 0.0, 1.0], &[]));
    }
}
