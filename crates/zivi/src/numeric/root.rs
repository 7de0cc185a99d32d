//! Roots of scalar functions, by bracketing and along a step.
//!
//! A root of a function between two points where it has different signs.
//!
//! Chandrupatla's method (T. R. Chandrupatla, *A new hybrid quadratic/bisection algorithm for
//! finding the zero of a nonlinear function without using derivatives*, Adv. Eng. Softw. 28,
//! 1997): inverse quadratic interpolation where the three last points make it safe, else
//! bisection. It needs no more evaluations than Brent's method and has no cases to tune.

use std::f64::consts::TAU;

/// A point and the value there.
type Point = (f64, f64);

/// Where a root was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Root {
    /// The better of the two points.
    pub(crate) best: f64,
    /// The point on the side where the function has the sign that it has at the second end.
    pub(crate) beyond: f64,
}

/// Evaluations after which the bracket is returned unchanged; bisection alone takes 53 for a
/// relative width of rounding.
const MOST_EVALUATIONS: usize = 120;

/// The root between `from` and `to`, whose values have opposite signs (a zero counts as the sign
/// that the other end lacks), to rounding of the abscissa.
pub(crate) fn between<E>(
    from: Point,
    to: Point,
    function: impl FnMut(f64) -> Result<f64, E>,
) -> Result<Root, E> {
    within(f64::MIN_POSITIVE, from, to, function)
}

/// Where a function that is not positive at `from` becomes strictly positive, `to` being positive:
/// a zero counts as not yet. To rounding of the abscissa or of the distance of the ends.
pub(crate) fn becomes_positive<E>(
    from: Point,
    to: Point,
    mut function: impl FnMut(f64) -> Result<f64, E>,
) -> Result<Root, E> {
    let strictly = |value: f64| if value > 0.0 { value } else { value.min(-f64::MIN_POSITIVE) };
    let smallest = f64::EPSILON * (to.0 - from.0).abs();
    within(smallest, (from.0, strictly(from.1)), to, |x| function(x).map(strictly))
}

/// The root to rounding of the abscissa or to `finest`.
fn within<E>(
    finest: f64,
    from: Point,
    to: Point,
    mut function: impl FnMut(f64) -> Result<f64, E>,
) -> Result<Root, E> {
    let rising = to.1 > 0.0 || from.1 < 0.0;
    let is_beyond = |value: f64| (value > 0.0) == rising || value == 0.0;
    let (mut one, mut two) = (to, from);
    if to.1 == 0.0 {
        // mostly the root is there; a function that is zero on an interval became so before
        let x = to.0 - 8.0 * f64::EPSILON * to.0.abs().max((to.0 - from.0).abs());
        let before = (x, function(x)?);
        if !is_beyond(before.1) {
            return Ok(Root { best: to.0, beyond: to.0 });
        }
        one = before;
    }
    let mut part = 0.5;
    for _ in 0..MOST_EVALUATIONS {
        let x = one.0 + part * (two.0 - one.0);
        let new = (x, function(x)?);
        let three = if is_beyond(new.1) == is_beyond(one.1) {
            one
        } else {
            let three = two;
            two = one;
            three
        };
        one = new;
        let best = if one.1.abs() < two.1.abs() { one } else { two };
        let width = (two.0 - one.0).abs();
        let smallest = 2.0 * f64::EPSILON * best.0.abs() + finest;
        if smallest >= 0.5 * width {
            break;
        }
        let margin = smallest / width;
        part = next_part(one, two, three).clamp(margin, 1.0 - margin);
    }
    let best = if one.1.abs() < two.1.abs() { one.0 } else { two.0 };
    let beyond = if is_beyond(one.1) { one.0 } else { two.0 };
    Ok(Root { best, beyond })
}

/// Where to look next, as a part of the way from `one` to `two`.
fn next_part(one: Point, two: Point, three: Point) -> f64 {
    let ((x1, f1), (x2, f2), (x3, f3)) = (one, two, three);
    let xi = (x1 - x2) / (x3 - x2);
    let phi = (f1 - f2) / (f3 - f2);
    if phi * phi < xi && (1.0 - phi) * (1.0 - phi) < 1.0 - xi {
        f1 / (f2 - f1) * f3 / (f2 - f3) + (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
    } else {
        0.5
    }
}

/// Time until, and rate at, the downward root of `x + xdot d + pull d^2/2` nearest to zero.
pub(crate) fn touchdown(x: f64, xdot: f64, pull: f64) -> Option<(f64, f64)> {
    let squared = xdot * xdot - 2.0 * pull * x;
    if squared < 0.0 {
        return (x <= 0.0).then_some((0.0, xdot.min(0.0)));
    }
    let speed = squared.sqrt();
    if x == 0.0 && xdot <= 0.0 {
        return Some((0.0, xdot));
    }
    let delta = 2.0 * x / (speed - xdot);
    delta.is_finite().then_some((delta, -speed))
}

// Angles in turns, with separate whole turns: sines, cosines and clocks that do not drift.
//
// ```text
// omega t/(2 pi) = n + psi      n whole, |psi| <= 1/2      t = (n + psi) 2 pi/omega          (1)
// ```
//
// Only `+ - * /` take part, which every processor rounds alike: no result depends on a library or
// on the machine.

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

/// Sine and cosine of an angle in turns, at most a few.
#[inline]
pub(crate) fn sin_cos(turns: f64) -> (f64, f64) {
    let quarter = nearest(4.0 * turns);
    let y = TAU * (turns - 0.25 * quarter);
    let z = y * y;
    // even and odd powers separately, which a processor sums in parallel
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
    /// Rounding error of the fraction: a slow wave turns by less than that in a short flight.
    pub(crate) rest: f64,
}

impl Phase {
    /// After additional turns, at most `2^51`.
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

    /// The time of a phase, and its rounding error.
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
mod root_tests {
    use super::*;
    use std::convert::Infallible;

    fn root(a: f64, b: f64, f: impl Fn(f64) -> f64) -> (Root, usize) {
        let mut n = 0;
        let found = between((a, f(a)), (b, f(b)), |x| {
            n += 1;
            Ok::<f64, Infallible>(f(x))
        });
        let Ok(found) = found;
        (found, n)
    }

    #[test]
    fn roots_to_rounding_within_few_evaluations() {
        type Case = (f64, f64, fn(f64) -> f64, f64);
        let cases: [Case; 7] = [
            (0.0, 2.0, |x| x * x - 2.0, 2f64.sqrt()),
            (0.0, 2.0, |x| 2.0 - x * x, 2f64.sqrt()),
            (-1.0, 4.0, |x| (x - 1.0).powi(9), 1.0),
            (0.0, 3.0, |x| if x < 1.5 { -1.0 } else { 1.0 }, 1.5),
            (1.0, 1e9, |x| x.ln() - 3.0, 3f64.exp()),
            (1e9, 1e9 + 4.0, |x| (x - 1e9).cos(), 1e9 + std::f64::consts::FRAC_PI_2),
            (0.0, 1.0, |x| x - 1e-12, 1e-12),
        ];
        for (a, b, f, exact) in cases {
            let (Root { best, beyond }, n) = root(a, b, f);
            // a root of order nine is known to the ninth root of rounding
            let tol = if f(1.0) == 0.0 && f(2.0) == 1.0 { 1e-2 } else { 4e-16 * exact };
            assert!((best - exact).abs() <= tol, "{best:e} for {exact:e}");
            assert!((f(beyond) > 0.0) == (f(b) > 0.0) || f(beyond) == 0.0);
            assert!(n < 70, "{n}");
        }
    }

    #[test]
    fn a_function_that_becomes_zero_and_stays_so() {
        for end in [1.0, 2.0] {
            let (Root { best, beyond }, n) = root(0.0, end, |x| (0.3 - x).max(0.0));
            assert!((best - 0.3).abs() < 1e-15 && (beyond - 0.3).abs() < 1e-15);
            let (Root { best, .. }, _) = root(0.0, end, |x| if x < 0.3 { 1.0 } else { 0.0 });
            assert!((best - 0.3).abs() < 1e-15 && n < 70);
        }
        let (Root { best, .. }, n) = root(0.0, 1.0, |x| x - 1.0);
        assert!(best == 1.0 && n < 5);
    }

    #[test]
    fn an_interval_of_zeros_is_reached_at_its_start() {
        let (found, _) = root(-1.0, 1.0, |x| if x.abs() < 0.25 { 0.0 } else { x });
        assert!((found.beyond + 0.25).abs() < 1e-15, "{found:?}");
    }

    #[test]
    fn strictly_positive_is_what_comes_after_the_zeros() {
        for start in [0.0, 0.1] {
            let f = |x: f64| Ok::<f64, Infallible>((x - 0.3).max(0.0));
            let Ok(found) = becomes_positive((start, 0.0), (1.0, 0.7), f);
            assert!((found.beyond - 0.3).abs() < 1e-15, "{found:?}");
        }
    }

    #[test]
    fn a_zero_at_the_start_is_left() {
        // the value at 0 is zero and the sign after it differs from the one at the end
        let (Root { best, .. }, _) = root(0.0, 1.0, |x| x * (0.25 - x));
        assert!((best - 0.25).abs() < 1e-15 || best == 0.0);
    }
}

#[cfg(test)]
mod turns_tests {
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
