//! Extrapolated flights and their impacts.
//!
//! One of the flights that a Zeno extrapolation skips.

use crate::numeric::bernstein::{quintic, Bernstein};
use crate::record::user_events::Level;
use crate::PathPoint;

/// One flight: where it starts and ends, and the velocities there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TailArc {
    pub(crate) start: f64,
    pub(crate) end: f64,
    pub(crate) u: f64,
    pub(crate) incoming: f64,
    pub(crate) sigma: f64,
    /// `end - start` with the precision of the speeds: near the end of a long tail and for `e` near
    /// 1, rounding of the times dominates that difference.
    pub(crate) length: f64,
    /// By how much the accelerations at both ends differ from those of the cubic.
    pub(crate) bends: [f64; 2],
}

impl TailArc {
    /// The polynomial of degree 5 with `x = 0`, the velocities and the accelerations at both ends.
    pub(crate) fn at(&self, t: f64) -> PathPoint {
        self.after(((t - self.start) / (self.end - self.start)).clamp(0.0, 1.0))
    }

    /// The same after a part of the flight.
    pub(crate) fn after(&self, theta: f64) -> PathPoint {
        let (h, rest) = (self.end - self.start, 1.0 - theta);
        let (u, w, [a, b]) = (self.u, self.incoming, self.bends);
        let both = theta * rest;
        let bend = 0.5 * h * both * (a * rest + b * theta);
        let x = h * theta * rest * (u * rest - w * theta + bend);
        let cubic = u * rest * (1.0 - 3.0 * theta) + w * theta * (3.0 * theta - 2.0);
        let bend = h * both * (a * rest * (1.0 - 2.5 * theta) + b * theta * (1.5 - 2.5 * theta));
        PathPoint { x, xdot: cubic + bend, sigma: self.sigma }
    }

    /// The time after a part of the flight, and the acceleration there.
    pub(crate) fn acceleration_after(&self, theta: f64) -> (f64, f64) {
        let h = self.end - self.start;
        let t = if theta < 1.0 { self.start + theta * h } else { self.end };
        (t, self.quintic(h).derivative().slope(theta) / (h * h))
    }

    /// Of the cubic.
    pub(crate) fn acceleration(&self, t: f64) -> f64 {
        let h = self.length;
        let theta = ((t - self.start) / h).clamp(0.0, 1.0);
        let (u, w) = (self.u, self.incoming);
        (u * (6.0 * theta - 4.0) + w * (6.0 * theta - 2.0)) / h
    }

    /// Of the cubic at both ends.
    pub(super) fn accelerations(&self) -> [f64; 2] {
        let (u, w) = (self.u, self.incoming);
        [-(4.0 * u + 2.0 * w) / self.length, (2.0 * u + 4.0 * w) / self.length]
    }

    /// Whether an acceleration at an end may differ so much from that of the cubic: such a flight stays
    /// above the wall.
    pub(super) fn allows(&self, bend: f64) -> bool {
        bend.abs() * self.length < self.u.min(-self.incoming)
    }

    /// When a level is crossed.
    pub(crate) fn crossings(&self, level: Level) -> Vec<f64> {
        let h = self.end - self.start;
        let (u, w) = (self.u, self.incoming);
        let all = match level {
            Level::Position(c) if self.bends == [0.0; 2] => {
                Bernstein::hermite((0.0, h * u), (0.0, h * w)).crossings(c)
            }
            Level::Velocity(c) if self.bends == [0.0; 2] => {
                Bernstein::new(&[u, -(u + w), w]).crossings(c)
            }
            Level::Position(c) => self.quintic(h).crossings(c),
            Level::Velocity(c) => self.quintic(h).derivative().times(1.0 / h).crossings(c),
        };
        all.iter().map(|theta| (self.start + theta * h).min(self.end)).collect()
    }

    /// The position, by the part of the flight.
    fn quintic(&self, h: f64) -> Bernstein {
        let (u, w, [a, b]) = (self.u, self.incoming, self.bends);
        let (first, last) = (-(4.0 * u + 2.0 * w) / h + a, (2.0 * u + 4.0 * w) / h + b);
        Bernstein::new(&quintic([0.0, u, first], [0.0, w, last], h))
    }
}

// An impact of an impact sequence, and the speed that a next one gives back.

/// One impact of an impact sequence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounce {
    /// Time (s).
    pub(crate) t: f64,
    /// Speed after the impact (m/s).
    pub(crate) u: f64,
    /// Pull towards the wall, `-f(t, 0, 0)` (m/s^2).
    pub(crate) g: f64,
}

/// The speed after an impact under Newton's law; none where the height of the next flight would underflow.
#[inline]
pub(crate) fn restored(e: f64, before: f64) -> f64 {
    unless_underflowing(e * before.abs())
}

/// A speed after an impact; none where the height of the next flight would underflow.
#[inline]
pub(crate) fn unless_underflowing(after: f64) -> f64 {
    if after * after < f64::MIN_POSITIVE {
        0.0
    } else {
        after
    }
}

#[cfg(test)]
mod arc_tests {
    use super::*;

    /// `x = theta (1 - theta) (2 + theta + 3 theta^2 + theta^3)`, of degree 5, over a length of 1/2.
    fn arc() -> (TailArc, impl Fn(f64) -> [f64; 2]) {
        let powers = [0.0, 2.0, -1.0, 2.0, -2.0, -1.0];
        let value = move |theta: f64, k: usize| -> f64 {
            let term = |n: usize| {
                let factor: usize = (0..k).map(|i| n - i).product();
                powers[n] * factor as f64 * theta.powi((n - k) as i32)
            };
            (k..6).map(term).sum()
        };
        let (u, w) = (2.0 * value(0.0, 1), 2.0 * value(1.0, 1));
        let cubic = [-(4.0 * u + 2.0 * w) / 0.5, (2.0 * u + 4.0 * w) / 0.5];
        let bends = [4.0 * value(0.0, 2) - cubic[0], 4.0 * value(1.0, 2) - cubic[1]];
        let arc = TailArc { start: 1.0, end: 1.5, u, incoming: w, sigma: 1.0, length: 0.5, bends };
        (arc, move |t: f64| {
            let theta = 2.0 * (t - 1.0);
            [value(theta, 0), 2.0 * value(theta, 1)]
        })
    }

    #[test]
    fn a_polynomial_of_degree_five_is_reproduced() {
        let (arc, exact) = arc();
        for k in 0..=20 {
            let t = 1.0 + f64::from(k) / 40.0;
            let (found, [x, xdot]) = (arc.at(t), exact(t));
            assert!((found.x - x).abs() < 1e-14 && (found.xdot - xdot).abs() < 1e-13, "{t}");
        }
        assert!(arc.bends.iter().all(|bend| bend.abs() > 1.0), "{arc:?}");
    }

    #[test]
    fn levels_are_crossed_where_the_motion_has_them() {
        let (arc, exact) = arc();
        let found = arc.crossings(Level::Position(0.5));
        assert!(found.len() == 2 && found.iter().all(|&t| (exact(t)[0] - 0.5).abs() < 1e-14));
        let found = arc.crossings(Level::Velocity(-1.0));
        assert!(found.len() == 1 && found.iter().all(|&t| (exact(t)[1] + 1.0).abs() < 1e-13));
        let cubic = TailArc { bends: [0.0; 2], ..arc };
        let far = cubic.crossings(Level::Position(0.5));
        assert!(far.len() == 2 && (far[0] - arc.crossings(Level::Position(0.5))[0]).abs() > 1e-3);
        for level in [1.0, -1.0] {
            let found = cubic.crossings(Level::Velocity(level));
            assert!(!found.is_empty());
            assert!(found.iter().all(|&t| (cubic.at(t).xdot - level).abs() < 1e-13), "{level}");
        }
    }
}

#[cfg(test)]
mod bounce_tests {
    use super::*;

    #[test]
    fn speeds_of_arcs_whose_height_underflows_are_none() {
        let least = f64::MIN_POSITIVE.sqrt();
        assert_eq!(least * least, f64::MIN_POSITIVE);
        for after in [0.0, 1e-300, 0.5 * least, least.next_down()] {
            assert_eq!(unless_underflowing(after), 0.0, "{after:e}");
        }
        for after in [least, 1e-150, 1.0] {
            assert_eq!(unless_underflowing(after), after, "{after:e}");
        }
        assert_eq!(restored(0.5, -3.0), 1.5);
        assert_eq!(restored(0.5, -1.9 * least), 0.0);
    }
}
