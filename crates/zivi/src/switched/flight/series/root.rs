//! The first root of a flight, certified.
//!
//! The coefficients in Bernstein form enclose the polynomial, and the number of their changes of
//! sign bounds that of its roots. Known roots at the start are divided out of the coefficients
//! first: their values would be rounding. Degree 11 decides nearly always, the terms beyond being a
//! slack; else the whole series is subdivided. A dip below rounding is none.

use crate::numeric::bernstein::Polynomial;
use crate::numeric::power_series::{of_few, slopes, value_and_slope, Series};
use crate::numeric::root::sin_cos;
use crate::switched::flight::series::law::{
    length, sum_by, Bound, Columns, Law, Start, COLUMNS, TERMS, WAVES,
};
use crate::switched::flight::series::table::{PART, SHORT};

// The first root of a flight, certified.
//
// The coefficients in Bernstein form enclose the polynomial, and the number of their changes of
// sign bounds that of its roots. Known roots at the start are divided out of the coefficients
// first: their values would be rounding. Degree 11 decides nearly always, the terms beyond being a
// slack; else the whole series is subdivided. A dip below rounding is none.

/// Rounding of a value, relative to the sum of the absolute values of the terms, where a series is
/// subdivided.
const DIP: f64 = 1e-15;

/// A step by Halley's formula that is so short, relative to the abscissa, is the last.
const LAST: f64 = 3e-6;

/// Steps of the iteration for a root; bisection alone takes 53.
const MOST_STEPS: usize = 120;

/// A root within `[0, 1]`, and the derivative there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Root {
    pub(crate) at: f64,
    pub(crate) slope: f64,
}

/// The first point of `[0, 1]` where the series becomes negative, its first `known` coefficients
/// being zero: a root of that order at 0 that the motion leaves.
pub(crate) fn first_root(a: &Series, known: usize) -> Option<Root> {
    let mut q = [0.0; TERMS];
    match known {
        0 => q = *a,
        1 => q[..TERMS - 1].copy_from_slice(&a[1..]),
        _ => q[..TERMS - known].copy_from_slice(&a[known..]),
    }
    let at = first_fall(&q)?;
    // a = s^known q: at a root of q the derivative is s^known q'
    let slope = value_and_slope(&q, at)[1] * at.powi(known as i32);
    Some(Root { at, slope })
}

/// The same where a root at 0 has been divided out: the point alone.
#[inline(always)]
pub(crate) fn first_fall(q: &Series) -> Option<f64> {
    match screened(q) {
        SignTest::Clear => None,
        SignTest::One(guess) => Some(polished(q, guess, is_near)),
        SignTest::Open => subdivided(q),
    }
}

/// The only root in `(0, 1]` of a series that changes there from positive to negative, near a
/// guess.
#[inline(always)]
pub(super) fn only_root(a: &Series, guess: f64) -> Root {
    let at = polished(a, guess, is_near);
    Root { at, slope: value_and_slope(a, at)[1] }
}

/// Whether a step to there is so short, relative to the abscissa, that it is the last.
#[inline(always)]
fn is_near(step: f64, s: f64) -> bool {
    step.abs() <= LAST * s
}

/// The abscissa of such a root; `is_last` tells of a step and where it starts whether it is the last:
/// the next would be its cube.
#[inline(always)]
pub(crate) fn polished(q: &Series, guess: f64, is_last: impl Fn(f64, f64) -> bool) -> f64 {
    let (mut low, mut high, mut s) = (0.0, 1.0, guess);
    for _ in 0..MOST_STEPS {
        let [value, first, second] = slopes(q, s);
        if value > 0.0 {
            low = s;
        } else {
            high = s;
        }
        // Halley's formula
        let step = 2.0 * value * first / (value * second - 2.0 * first * first);
        let next = s + step;
        if is_last(step, s) && next >= low && next <= high {
            return next;
        }
        s = if next > low && next < high { next } else { 0.5 * (low + high) };
        if s <= low || s >= high {
            return s;
        }
    }
    s
}

/// The only root after 0 of a short arc from the wall, if it certainly is that: the first
/// coefficients, and a bound of `sum (n - 1) |a_n|` over those beyond.
///
/// ```text
/// q = a/s = a_1 + a_2 s + ...,    s (sum_(n>=3) (n - 1) |a_n| s^(n-3)) <= |a_2|/5 at 1.3 s_0
/// ```
///
/// with `s_0 = -a_1/a_2`: `q` falls by at least `0.8 |a_2|` up to there, where it is negative.
#[inline(always)]
pub(super) fn of_short_arc(a: &[f64; SHORT], beyond: f64) -> Option<Root> {
    const FARTHER: f64 = 1.3;
    /// A step by Newton's formula that is so short is the last.
    const NEAR: f64 = 1e-8;
    let mut s = -a[1] / a[2];
    // false for NaN too
    let short = s > 0.0 && FARTHER * s <= PART && a[2] < 0.0;
    let (far, mut sum) = (FARTHER * s, beyond);
    for n in (3..SHORT).rev() {
        sum = sum * far + (n as f64 - 1.0) * a[n].abs();
    }
    if !(short && far * sum <= -0.2 * a[2]) {
        return None;
    }
    let mut q = [0.0; SHORT - 1];
    q.copy_from_slice(&a[1..]);
    for _ in 0..MOST_STEPS {
        let [value, slope] = of_few(&q, s);
        let step = value / slope;
        s -= step;
        if step.abs() <= NEAR * s {
            break;
        }
    }
    Some(Root { at: s, slope: s * of_few(&q, s)[1] })
}

/// The first root by subdivision of the whole series, rounding above zero.
#[cold]
fn subdivided(q: &Series) -> Option<f64> {
    let rounding: f64 = DIP * q.iter().map(|a| a.abs()).sum::<f64>();
    let mut p = Polynomial::<TERMS>::from_powers(*q);
    p.add(rounding);
    let found = p.first_negative()?;
    // that of the shifted one comes a little after the root itself
    let (mut s, mut now) = (found, slopes(q, found));
    for _ in 0..8 {
        let next = (s - now[0] / now[1]).clamp(0.0, 1.0);
        let then = slopes(q, next);
        if then[0].abs() < now[0].abs() {
            (s, now) = (next, then);
        } else {
            break;
        }
    }
    Some(s)
}

// Which steps have no root, or one: by Bernstein coefficients.
//
// The coefficients of degree 11 are linear in where the step starts, so a table has their columns.
// They enclose the polynomial, and the number of their changes of sign bounds that of its roots;
// the terms beyond are a slack, which is linear, too.

/// Coefficients of the screen.
pub(super) const SCREEN: usize = 12;

/// Rounding of a value, relative to the sum of the absolute values of the terms.
const ROUNDING: f64 = 2e-15;

/// What the screen says of a polynomial that starts positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SignTest {
    /// It stays so over `[0, 1]`.
    Clear,
    /// It has one root, near here.
    One(f64),
    Open,
}

/// Columns of Bernstein coefficients, and the slack.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Screen {
    coefficients: Columns<SCREEN>,
    slack: Bound,
}

impl Screen {
    /// Of series that are divided by `s^known`.
    pub(super) fn new(series: &Columns<TERMS>, known: usize) -> Self {
        let coefficients = series.0.each_ref().map(|a| {
            let mut low = [0.0; SCREEN];
            low.copy_from_slice(&a[known..known + SCREEN]);
            bernstein(low)
        });
        let slack = Bound::sizes(|c| {
            let (low, high) = series.0[c].split_at(known + SCREEN);
            slack(low, high)
        });
        Self { coefficients: Columns(coefficients), slack }
    }

    #[inline(always)]
    pub(super) fn of<const W: usize>(&self, start: &Start) -> SignTest {
        verdict(&self.coefficients.of::<W, SCREEN>(start), self.slack.of::<W>(start))
    }
}

/// The same of a series, a root of whose has been divided out.
#[inline(always)]
pub(super) fn screened(q: &[f64; TERMS]) -> SignTest {
    let mut low = [0.0; SCREEN];
    low.copy_from_slice(&q[..SCREEN]);
    verdict(&bernstein(low), slack(&low, &q[SCREEN..]))
}

#[inline(always)]
fn bernstein(low: [f64; SCREEN]) -> [f64; SCREEN] {
    let mut b = [0.0; SCREEN];
    b.copy_from_slice(Polynomial::<SCREEN>::from_powers(low).coefficients());
    b
}

#[inline(always)]
fn slack(low: &[f64], high: &[f64]) -> f64 {
    let size = |a: &[f64]| a.iter().map(|a| a.abs()).sum::<f64>();
    size(high) + ROUNDING * (size(low) + size(high))
}

#[inline(always)]
fn verdict(b: &[f64; SCREEN], slack: f64) -> SignTest {
    // written so that NaN and a negative zero never are a certificate
    if b.iter().fold(true, |all, &b| all & (b > slack)) {
        return SignTest::Clear;
    }
    let Some(first) = b.iter().position(|&b| b < 0.0) else { return SignTest::Open };
    let one = b[..first].iter().all(|&b| b > slack) && b[first..].iter().all(|&b| b < -slack);
    if !one || first == 0 {
        return SignTest::Open;
    }
    // where the control polygon crosses zero
    let (before, after) = (b[first - 1], b[first]);
    let crossing = (first - 1) as f64 + before / (before - after);
    SignTest::One(crossing / (SCREEN - 1) as f64)
}

// Many steps of a flight at once.

/// Doublings of a step; a larger one is never needed.
pub(super) const LEVELS: usize = 20;

/// A level whose numbers are larger than this is of no use.
const LARGEST: f64 = 1e100;

/// How the end of `2^j` steps depends on their start.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Level {
    /// `x` and `V`.
    ends: Columns<2>,
    /// `e^(i W 2^j)` as cosine and sine.
    turn: [[f64; 2]; WAVES],
    /// Of `h^2 |x''|` on the way.
    bend: Bound,
}

impl Level {
    /// One step.
    pub(super) fn first(series: &Columns<TERMS>, law: Law, h: f64, turns: [f64; WAVES]) -> Self {
        let ends = series.0.each_ref().map(|a| [sum_by(a, |_, a| a), sum_by(a, |n, a| n * a)]);
        let bends = |n: f64| n * (n - 1.0).max(0.0);
        let bend = |c: usize| sum_by(&series.0[c], |n, a| bends(n) * a.abs());
        // without a spring and a damper the force is the acceleration
        let free = law.stiffness == 0.0 && law.damping == 0.0;
        let wave = |m: usize| {
            let [cos, sin] = [&series.0[3 + 2 * m], &series.0[4 + 2 * m]];
            let size = |n: usize| length(cos[n], sin[n]);
            if free {
                h * h
            } else {
                (0..TERMS).map(|n| bends(n as f64) * size(n)).sum()
            }
        };
        let bend = Bound([bend(0), bend(1), bend(2), wave(0), wave(1)]);
        Self { ends: Columns(ends), turn: turns.map(turn), bend }
    }

    /// Position and velocity, times the length of a step, at the end.
    #[inline(always)]
    pub(super) fn ends<const W: usize>(&self, start: &Start) -> [f64; 2] {
        self.ends.of::<W, 2>(start)
    }

    /// The waves at the end.
    #[inline(always)]
    pub(super) fn turned<const W: usize>(&self, mut waves: [[f64; 2]; WAVES]) -> [[f64; 2]; WAVES] {
        for (z, [cos, sin]) in waves.iter_mut().zip(self.turn).take(W) {
            *z = [z[0] * cos - z[1] * sin, z[1] * cos + z[0] * sin];
        }
        waves
    }

    /// Whether the motion certainly stays above the wall for `length` steps, no more than those of
    /// the level: `x + s V - s^2 B/2 > 0` at their end is so on the way.
    #[inline(always)]
    pub(super) fn is_clear<const W: usize>(&self, start: &Start, length: f64) -> bool {
        let bend = self.bend.of::<W>(start);
        let lowest = start.x + length * (start.v - 0.5 * length * bend);
        // false for NaN too
        lowest > 1e-9 * (start.x + length * start.v.abs())
    }

    /// Whether a start is thinkable from which a step is clear by its bound: from a height, or away
    /// from the wall.
    pub(super) fn leaps(&self) -> bool {
        let Bound([x, v, ..]) = self.bend;
        x.min(v) < 2.0
    }

    /// Twice as many steps, in which the waves turn by so much.
    pub(super) fn doubled(&self, turns: [f64; WAVES]) -> Self {
        let by = &self.ends.0;
        let after = |[x, v]: [f64; 2], row: usize| x * by[0][row] + v * by[1][row];
        // what the second half adds: the constant again, the waves turned
        let own = |c: usize, row: usize| match c {
            0 | 1 => 0.0,
            2 => by[2][row],
            _ => {
                let [cos, sin] = self.turn[(c - 3) / 2];
                let [re, im] = [by[(c - 1) / 2 * 2 + 1][row], by[(c - 1) / 2 * 2 + 2][row]];
                if c % 2 == 1 {
                    re * cos + im * sin
                } else {
                    im * cos - re * sin
                }
            }
        };
        let ends: [[f64; 2]; COLUMNS] =
            std::array::from_fn(|c| [0, 1].map(|row| after(by[c], row) + own(c, row)));
        let Bound([x, v, force, of_waves @ ..]) = self.bend;
        let later = |by_x: f64, by_v: f64| x * by_x.abs() + v * by_v.abs();
        let size = |m: usize, row: usize| length(by[3 + 2 * m][row], by[4 + 2 * m][row]);
        let wave = |m: usize| of_waves[m].max(later(size(m, 0), size(m, 1)) + of_waves[m]);
        let bend = Bound([
            x.max(later(by[0][0], by[0][1])),
            v.max(later(by[1][0], by[1][1])),
            force.max(later(by[2][0], by[2][1]) + force),
            wave(0),
            wave(1),
        ]);
        Self { ends: Columns(ends), turn: turns.map(turn), bend }
    }

    pub(super) fn is_tame(&self) -> bool {
        let numbers = self.ends.0.iter().flatten().chain(&self.bend.0);
        // not so for NaN
        numbers.into_iter().all(|number| number.abs() < LARGEST)
    }
}

/// Cosine and sine of so many turns.
fn turn(turns: f64) -> [f64; 2] {
    let (sin, cos) = sin_cos(turns);
    [cos, sin]
}

#[cfg(test)]
mod root_tests {
    use super::*;
    use crate::numeric::power_series::{derivative, value};

    /// The powers of `+- prod (s - root)`, positive at the start, after `known` roots at 0.
    fn through(roots: &[f64], known: usize) -> Series {
        let mut a = [0.0; TERMS];
        a[0] = roots.iter().map(|root| -root).product::<f64>().signum();
        for (n, &root) in roots.iter().enumerate() {
            for i in (0..=n).rev() {
                a[i + 1] += a[i];
                a[i] *= -root;
            }
        }
        a.rotate_right(known);
        a
    }

    #[test]
    fn the_first_of_several_roots_is_found() {
        let cases: [&[f64]; 5] = [
            &[0.3],
            &[0.3, 0.300_001, 0.9],
            &[0.9, 0.2, 0.6, 0.7, 0.95],
            &[0.001, 2.0, 3.0],
            &[0.5, 0.75, -2.0, 1.5],
        ];
        for roots in cases {
            for known in 0..4 {
                let a = through(roots, known);
                let first = roots.iter().copied().filter(|&r| r > 0.0).fold(1.0, f64::min);
                let found = first_root(&a, known).unwrap();
                // a pair of roots that is this close is known to the root of rounding
                let tol = if roots.contains(&0.300_001) { 1e-8 } else { 1e-14 };
                assert!((found.at - first).abs() < tol, "{roots:?} {known}: {found:?}");
                let slope = value(&derivative(&a), found.at);
                assert!((found.slope - slope).abs() < tol.max(1e-13) && found.slope < 0.0);
            }
        }
    }

    #[test]
    fn a_step_onto_the_start_of_the_interval_is_halved() {
        // from .5 Halley's formula leads to 0 exactly: 2 (-1/4) (-1)/((-1/4) (-4) - 2) = -1/2
        let mut q = [0.0; TERMS];
        // -1/4 - r - 2 r^2 - 8 r^3 with r = s - 1/2
        (q[0], q[1], q[2], q[3]) = (0.75, -5.0, 10.0, -8.0);
        let root = polished(&q, 0.5, is_near);
        let (mut low, mut high) = (0.0, 0.5);
        while high - low > 1e-15 {
            let s: f64 = 0.5 * (low + high);
            let r = s - 0.5;
            if -0.25 - r - 2.0 * r * r - 8.0 * r * r * r > 0.0 {
                low = s;
            } else {
                high = s;
            }
        }
        assert!((root - low).abs() < 1e-14, "{root} {low}");
    }

    #[test]
    fn a_short_arc_is_certified() {
        // s (u - g s/2 + c s^2)
        let (u, g, c): (f64, f64, f64) = (1e-3, 2.0, 0.3);
        let mut a = [0.0; SHORT];
        (a[1], a[2], a[3]) = (u, -0.5 * g, c);
        let exact = 2.0 * u / (0.5 * g + (0.25 * g * g - 4.0 * u * c).sqrt());
        let found = of_short_arc(&a, 0.0).unwrap();
        assert!((found.at / exact - 1.0).abs() < 1e-15, "{found:?} {exact}");
        let slope = u - g * exact + 3.0 * c * exact * exact;
        assert!((found.slope / slope - 1.0).abs() < 1e-14, "{found:?} {slope}");
        // terms beyond that may bring it back, and one that does not fall
        assert_eq!(of_short_arc(&a, f64::INFINITY), None);
        a[2] = 0.5 * g;
        assert_eq!(of_short_arc(&a, 0.0), None);
    }

    #[test]
    fn touches_and_dips_below_rounding_are_none() {
        for roots in [&[0.5, 0.5][..], &[0.3, 0.3, 0.8, 0.8], &[-0.5, 1.5], &[1.0 + 1e-9]] {
            assert_eq!(first_root(&through(roots, 0), 0), None, "{roots:?}");
        }
        // a dip of depth w^2 between two roots
        for (w, seen) in [(1e-3, true), (1e-6, true), (3e-7, true), (1e-9, false)] {
            let found = first_root(&through(&[0.4 - w, 0.4 + w], 0), 0);
            assert_eq!(found.is_some(), seen, "{w}");
            assert!(found.is_none_or(|found| (found.at - 0.4 + w).abs() < 0.02 * w));
        }
    }

    #[test]
    fn numbers_that_are_none_give_no_certificate() {
        let mut a = through(&[0.3], 0);
        a[5] = f64::NAN;
        // whatever is found, it is not lost in a loop
        let found = first_root(&a, 0);
        assert!(found.is_none_or(|found| found.at.is_nan() || found.at <= 1.0));
        assert_eq!(first_root(&[-0.0; TERMS], 0), None);
    }
}

#[cfg(test)]
mod sign_test_tests {
    use super::*;

    #[test]
    fn only_what_is_beyond_the_slack_is_certain() {
        let all = |b: f64| verdict(&[b; SCREEN], 1.0);
        assert_eq!(all(1.5), SignTest::Clear);
        for b in [1.0, 0.5, -0.5, -1.5, f64::NAN] {
            assert_eq!(all(b), SignTest::Open, "{b}");
        }
        assert_eq!(verdict(&[0.0; SCREEN], 0.0), SignTest::Open);
        // the polygon of 2, ..., 2, -2, ..., -2 crosses zero in the middle of the change
        for first in 1..SCREEN {
            let b: [f64; SCREEN] = std::array::from_fn(|k| if k < first { 2.0 } else { -2.0 });
            let place = (first as f64 - 0.5) / (SCREEN - 1) as f64;
            assert_eq!(verdict(&b, 1.0), SignTest::One(place), "{first}");
            assert_eq!(verdict(&b, 2.0), SignTest::Open, "{first}");
        }
    }
}

#[cfg(test)]
mod level_tests {
    use super::*;
    use crate::switched::flight::series::table::Table;

    #[test]
    fn a_step_is_clear_that_ends_above_a_billionth_of_the_way() {
        let law = Law { stiffness: 0.0, damping: 0.0, omega: [0.0; 2] };
        let table = Table::new(law, 1.0);
        let level = Level::first(&Columns(table.columns()), law, table.h(), [0.0; 2]);
        // from 1 m down by 1 m, all but a part
        let is_clear = |left: f64, length: f64| {
            let start = Start { x: 1.0, v: -(1.0 - left) / length, ..Start::default() };
            level.is_clear::<0>(&start, length)
        };
        for length in [0.25, 1.0] {
            assert!(is_clear(2.1e-9, length) && is_clear(0.5, length));
            for left in [1.9e-9, 1e-10, 0.0, -1.0] {
                assert!(!is_clear(left, length), "{left:e}");
            }
        }
    }

    #[test]
    fn a_free_mass_is_accelerated_by_its_waves_alone() {
        let omega = [0.4, 0.0];
        let law = Law { stiffness: 0.0, damping: 0.0, omega };
        let table = Table::new(law, f64::INFINITY);
        let h = table.h();
        assert!(h > 2.0);
        let turns = omega.map(|omega| omega * h / std::f64::consts::TAU);
        let level = Level::first(&Columns(table.columns()), law, h, turns);
        let Bound(bend) = level.bend;
        assert!((bend[3] / (h * h) - 1.0).abs() < 1e-15, "{bend:?} {h}");
    }
}
