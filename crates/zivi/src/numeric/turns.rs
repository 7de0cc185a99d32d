//! Angles in turns, with their whole turns apart: sines, cosines and clocks that do not drift.
//!
//! ```text
//! omega t/(2 pi) = n + psi      n whole, |psi| <= 1/2      t = (n + psi) 2 pi/omega          (1)
//! ```
//!
//! Only `+ - * /` take part, which every processor rounds alike: no result depends on a library or
//! on the machine.

use std::f64::consts::TAU;

/// `2^52 + 2^51`: what is added to it is rounded to a whole number.
const WHOLE: f64 = 6_755_399_441_055_744.0;
/// `2 pi` and `1/(2 pi)` less the numbers next to them.
const TAU_REST: f64 = 2.449_293_598_294_706_4e-16;
const PER_TAU: f64 = 0.159_154_943_091_895_35;
const PER_TAU_REST: f64 = -9.839_338_337_591_243e-18;

/// `(-1)^k/(2 k + 1)!`, `k = 1 ..= 7`, and `(-1)^k/(2 k)!`, `k = 2 ..= 8`: at `pi/4` the first
/// term left out is below rounding.
const SIN: [f64; 7] = [
    -1.0 / 6.0,
    1.0 / 120.0,
    -1.0 / 5_040.0,
    1.0 / 362_880.0,
    -1.0 / 39_916_800.0,
    1.0 / 6_227_020_800.0,
    -1.0 / 1_307_674_368_000.0,
];
const COS: [f64; 7] = [
    1.0 / 24.0,
    -1.0 / 720.0,
    1.0 / 40_320.0,
    -1.0 / 3_628_800.0,
    1.0 / 479_001_600.0,
    -1.0 / 87_178_291_200.0,
    1.0 / 20_922_789_888_000.0,
];

/// The nearest whole number, for less than `2^51`.
#[inline]
pub(crate) fn nearest(x: f64) -> f64 {
    (x + WHOLE) - WHOLE
}

/// Sine and cosine of so many turns, at most a few.
#[inline]
pub(crate) fn sin_cos(turns: f64) -> (f64, f64) {
    let quarter = nearest(4.0 * turns);
    let y = TAU * (turns - 0.25 * quarter);
    let z = y * y;
    // even and odd powers apart, which a processor sums side by side
    let zz = z * z;
    let of = |c: &[f64; 7]| {
        let even = ((c[6] * zz + c[4]) * zz + c[2]) * zz + c[0];
        even + z * ((c[5] * zz + c[3]) * zz + c[1])
    };
    let sin = y + y * (z * of(&SIN));
    let cos = 1.0 - (0.5 * z - z * z * of(&COS));
    match quarter as i64 & 3 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// A number as the sum of two, the second below the rounding of the first.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Double {
    hi: f64,
    lo: f64,
}

impl Double {
    /// Their sum where the first is the larger.
    #[inline]
    fn ordered(hi: f64, lo: f64) -> Self {
        let sum = hi + lo;
        Self { hi: sum, lo: lo - (sum - hi) }
    }

    /// `a b`, exactly (T. J. Dekker, *A floating-point technique for extending the available
    /// precision*, Numer. Math. 18, 1971).
    #[inline]
    fn product(a: f64, b: f64) -> Self {
        let hi = a * b;
        let ((a1, a2), (b1, b2)) = (halves(a), halves(b));
        Self { hi, lo: ((a1 * b1 - hi) + a1 * b2 + a2 * b1) + a2 * b2 }
    }
}

/// The upper 26 bits of a number, and the rest.
#[inline]
fn halves(a: f64) -> (f64, f64) {
    let scaled = 134_217_729.0 * a;
    let upper = scaled - (scaled - a);
    (upper, a - upper)
}

/// Whole turns and the part of one, within half a turn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Phase {
    pub(crate) turns: f64,
    pub(crate) part: f64,
    /// What rounding leaves out of the part: a slow wave turns by less than that in a short flight.
    pub(crate) rest: f64,
}

impl Phase {
    /// After so many turns more, at most `2^51`.
    #[inline]
    pub(crate) fn after(self, turns: f64) -> Self {
        let whole = nearest(turns);
        let Double { hi, lo } = Double::sum(self.part, turns - whole);
        let over = nearest(hi);
        let Double { hi, lo } = Double::sum(hi - over, lo + self.rest);
        Self { turns: self.turns + whole + over, part: hi, rest: lo }
    }
}

/// Between time and phase at an angular frequency `> 0`, equation (1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Clock {
    /// Turns a second.
    rate: Double,
    /// Seconds a turn.
    period: Double,
}

impl Clock {
    pub(crate) fn new(omega: f64) -> Self {
        let exact = Double::product(omega, PER_TAU);
        let rate = Double::ordered(exact.hi, exact.lo + omega * PER_TAU_REST);
        let hi = TAU / omega;
        let back = Double::product(hi, omega);
        let period = Double::ordered(hi, ((TAU - back.hi) - back.lo + TAU_REST) / omega);
        Self { rate, period }
    }

    /// Seconds a turn.
    pub(crate) fn period(&self) -> f64 {
        self.period.hi
    }

    /// The phase at `t + late`.
    #[inline]
    pub(crate) fn phase(&self, t: f64, late: f64) -> Phase {
        let Double { hi, lo } = Double::product(t, self.rate.hi);
        let lo = lo + t * self.rate.lo + late * self.rate.hi;
        let turns = nearest(hi);
        Phase { turns, part: hi - turns, rest: 0.0 }.after(lo)
    }

    /// The time of a phase, and what rounding leaves out of it.
    #[inline]
    pub(crate) fn time(&self, Phase { turns, part, rest }: Phase) -> (f64, f64) {
        let Double { hi, lo } = Double::product(turns, self.period.hi);
        let of_part = Double::product(part, self.period.hi);
        let t = Double::sum(hi, of_part.hi);
        let small = rest * self.period.hi + (turns + part) * self.period.lo;
        let late = lo + of_part.lo + t.lo + small;
        let Double { hi, lo } = Double::ordered(t.hi, late);
        (hi, lo)
    }
}

impl Double {
    /// `a + b`, exactly (D. E. Knuth).
    #[inline]
    fn sum(a: f64, b: f64) -> Self {
        let hi = a + b;
        let of_b = hi - a;
        Self { hi, lo: (a - (hi - of_b)) + (b - of_b) }
    }
}

/// An angle in radians as a phase.
pub(crate) fn of_angle(angle: f64) -> Phase {
    Clock::new(1.0).phase(angle, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Angular frequency, time, whole turns and the part of one, by 60 digits.
    const PHASES: [(f64, f64, f64, f64); 4] = [
        (0.9, 7000000.0, 1002676.0, 0.14147894064008162),
        (30.0, 1000000000.0, 4774648293.0, -0.2431399269334871),
        (10000.0, 12345.678, 19648757.0, -0.20479135793423553),
        (TAU, 1000000000.0, 1000000000.0, -3.8981718325193757e-08),
    ];

    #[test]
    fn sines_and_cosines_are_right_to_rounding() {
        for i in -1500..=1500 {
            let turns = f64::from(i) / 2003.0;
            let (sin, cos) = sin_cos(turns);
            // the library's, of an angle that is off by its rounding
            let angle = TAU * turns;
            let tol = 2.3e-16 + 1.2e-16 * angle.abs();
            assert!((sin - angle.sin()).abs() < tol && (cos - angle.cos()).abs() < tol, "{turns}");
            assert!((sin * sin + cos * cos - 1.0).abs() < 5e-16);
        }
        assert_eq!(sin_cos(0.25), (1.0, 0.0));
        assert_eq!(sin_cos(-0.5), (0.0, -1.0));
    }

    #[test]
    fn phases_far_away_are_exact() {
        for (omega, t, turns, part) in PHASES {
            let phase = Clock::new(omega).phase(t, 0.0);
            assert_eq!(phase.turns, turns);
            assert!((phase.part - part).abs() < 3e-16, "{phase:?} {part}");
        }
    }

    #[test]
    fn time_and_phase_are_inverse() {
        for omega in [0.9, TAU, 1e-3, 1e4] {
            let clock = Clock::new(omega);
            for turns in [0.0, 1.0, -3.0, 1e9, 123_456_789_012.0] {
                for part in [-0.5, -0.1, 0.0, 1e-9, 0.3, 0.499] {
                    let (t, late) = clock.time(Phase { turns, part, rest: 0.0 });
                    let back = clock.phase(t, late);
                    let off = (back.turns - turns) + (back.part - part) + back.rest;
                    assert!(off.abs() < 2e-16, "{omega} {turns} {part}: {off:e}");
                }
            }
        }
    }

    #[test]
    fn a_phase_goes_on_from_turn_to_turn() {
        let phase = Phase { turns: 4.0, part: 0.4, rest: 0.0 }.after(0.2);
        assert!(phase.turns == 5.0 && (phase.part + 0.4).abs() < 1e-15);
        let phase = Phase { turns: 4.0, part: -0.4, rest: 0.0 }.after(1000.25);
        assert!(phase.turns == 1004.0 && (phase.part + 0.15).abs() < 1e-13);
    }
}
