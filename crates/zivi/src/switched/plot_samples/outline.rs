//! Drawing data of a step: ranges, deviation from a straight line, apexes.

use crate::numeric::bernstein::Bernstein;
use crate::numeric::power_series::{all_slopes, all_values, LANES};
use crate::switched::flight::series::{derivative, polished, value, Series, TERMS};
use crate::switched::path::{FlightCurve, Form};
use crate::switched::plot_samples::{larger, largest, range, smaller, BLOCK};
use pulp::Simd;

/// Drawing data of a flight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outline {
    /// Least and largest values.
    pub(super) x: [f64; 2],
    pub(super) xdot: [f64; 2],
    /// Bounds of the second derivatives of both by the part of the step.
    pub(super) bends: [f64; 2],
    /// How many apexes it has.
    pub(super) apexes: usize,
}

impl Outline {
    /// None yet.
    pub(super) const NONE: Self = Self { x: [0.0; 2], xdot: [0.0; 2], bends: [0.0; 2], apexes: 0 };

    /// That of a curve, where the velocity changes its sign downwards being noted, or near where it
    /// does so, if it does so once.
    #[inline(always)]
    pub(super) fn of<'a, S: Simd>(
        simd: S,
        curve: &'a FlightCurve,
        apexes: &mut Vec<f64>,
    ) -> (Self, Option<(&'a Series, f64)>) {
        match &curve.form {
            Form::Both(both) => (of_polynomials(curve, both, apexes), None),
            Form::Powers(a, ..) => {
                let (outline, guess) = of_powers(simd, curve, a, apexes);
                (outline, guess.map(|guess| (a, guess)))
            }
        }
    }
}

#[inline(always)]
fn of_polynomials(
    curve: &FlightCurve,
    [x, xdot]: &[Bernstein; 2],
    apexes: &mut Vec<f64>,
) -> Outline {
    /// Rounding threshold relative to the largest coefficient.
    const ROUNDING: f64 = 1e-12;
    let (x, xdot) = (x.coefficients(), xdot.coefficients());
    let n = x.len() as f64 - 1.0;
    let all = |c: &[f64]| range(c.iter().copied());
    let bend =
        |c: &[f64]| n * (n - 1.0) * largest(range(c.windows(3).map(|c| c[0] - 2.0 * c[1] + c[2])));
    let (x, velocity, bends) = (all(x), all(xdot), [bend(x), bend(xdot)]);
    let clear = ROUNDING * largest(velocity);
    if !(velocity[0] > clear || velocity[1] < -clear) {
        all_apexes(curve, apexes);
    }
    Outline { x, xdot: velocity, bends, apexes: 0 }
}

/// Evaluated orders of a series in the middle of a step and at its end: the series and its first
/// three derivatives.
const ORDERS: usize = 4;
const ASKED: usize = 2 * ORDERS;
/// Number of terms used: the truncation error is a millionth of a third derivative.
const ENOUGH: usize = 16;

/// Weights of each power.
const WEIGHTS: [[f64; ASKED]; TERMS] = {
    let (mut weights, mut at) = ([[0.0; ASKED]; TERMS], 0);
    while at < TERMS * ORDERS {
        let (n, order) = (at / ORDERS, at % ORDERS);
        let (mut factor, mut k) = (1.0, 0);
        while k < order {
            factor *= n as f64 - k as f64;
            k += 1;
        }
        weights[n][ORDERS + order] = factor;
        while k < n {
            factor *= 0.5;
            k += 1;
        }
        weights[n][order] = factor;
        at += 1;
    }
    weights
};

/// They, by vectors of the machine.
#[inline(always)]
fn asked_of<S: Simd>(simd: S, a: &Series) -> [f64; ASKED] {
    let mut asked = [0.0; ASKED];
    for (k, asked) in S::as_mut_simd_f64s(&mut asked).0.iter_mut().enumerate() {
        let term = |n: usize| {
            let weights = S::as_simd_f64s(&WEIGHTS[n]).0[k];
            simd.mul_f64s(simd.splat_f64s(a[n]), weights)
        };
        let (mut even, mut odd) = (term(0), term(1));
        for n in (2..ENOUGH).step_by(2) {
            even = simd.add_f64s(even, term(n));
            odd = simd.add_f64s(odd, term(n + 1));
        }
        *asked = simd.add_f64s(even, odd);
    }
    asked
}

/// Whether what has these values at the start, in the middle and at the end of a step certainly has
/// one sign: between two of them a wave of the fastest rate leaves the line by a tenth of its
/// height, of which twice as much is allowed for.
#[inline(always)]
fn is_one_sign([a, b, c]: [f64; 3]) -> bool {
    let [least, most] = [smaller(smaller(a, b), c), larger(larger(a, b), c)];
    let off = 0.2 * larger(least.abs(), most.abs());
    least > off || most < -off
}

/// From the values at the start, in the middle and at the end. A step is at most 1.75 of its
/// fastest rate long: what a wave of that rate has between them is a tenth more at most.
#[inline(always)]
pub(super) fn of_powers<S: Simd>(
    simd: S,
    curve: &FlightCurve,
    a: &Series,
    apexes: &mut Vec<f64>,
) -> (Outline, Option<f64>) {
    const MORE: f64 = 1.1;
    let mut guess = None;
    let [x1, v1, b1, j1, x2, v2, b2, j2] = asked_of(simd, a);
    let [x0, v0, b0, j0] = [a[0], a[1], 2.0 * a[2], 6.0 * a[3]];
    let bend = MORE * larger(larger(b0.abs(), b1.abs()), b2.abs());
    let jerk = MORE * larger(larger(j0.abs(), j1.abs()), j2.abs());
    let mut x = [smaller(smaller(x0, x1), x2), larger(larger(x0, x1), x2)];
    let [least, most] = [smaller(smaller(v0, v1), v2), larger(larger(v0, v1), v2)];
    if !is_one_sign([v0, v1, v2]) {
        // a velocity whose slope changes its sign once has one root between ends of other signs
        let once = is_one_sign([b0, b1, b2]) || is_one_sign([j0, j1, j2]);
        if once && v0 > 0.0 && v2 < 0.0 {
            guess = Some(of_parabola(v0, b0, v2));
        } else if !(once && v0 < 0.0 && v2 > 0.0 || is_one_sign([b0, b1, b2]) && v0 * v2 > 0.0) {
            let known = apexes.len();
            all_apexes(curve, apexes);
            for &t in &apexes[known..] {
                x[1] = larger(curve.at(t).x, x[1]);
            }
        }
    }
    let xdot = [least / curve.h, most / curve.h];
    (Outline { x, xdot, bends: [bend, jerk / curve.h], apexes: 0 }, guess)
}

/// The root in `(0, 1)` of the parabola with two values at its ends, of opposite signs, and a slope
/// at its start.
pub(super) fn of_parabola(first: f64, slope: f64, last: f64) -> f64 {
    let bend = last - first - slope;
    let root = 2.0 * first / ((slope * slope - 4.0 * bend * first).sqrt() - slope);
    // false for NaN, too
    if root > 0.0 && root < 1.0 {
        root
    } else {
        0.5
    }
}

/// Where the velocity changes its sign downwards, however often.
pub(super) fn all_apexes(curve: &FlightCurve, apexes: &mut Vec<f64>) {
    let xdot = curve.velocity();
    // a step that falls has its first turn at the bottom
    let skipped = usize::from(xdot.starts_negative());
    let turns = xdot.crossings(0.0).into_iter().skip(skipped).step_by(2);
    apexes.extend(turns.map(|theta| curve.start + theta * curve.h));
}

// Apexes of power series, found side by side.

/// A step by Halley's formula towards an apex that is so short is the last.
const LAST: f64 = 1e-4;

/// Flights whose velocity has one root downwards: their powers, and near where that is.
pub(super) struct Guesses {
    count: usize,
    /// Which of the curves each is, and which of all apexes.
    of: [(usize, usize); BLOCK],
    /// By the part of the step.
    theta: [f64; BLOCK],
    /// By powers: written long before vectors of them are read.
    powers: [[f64; BLOCK]; TERMS],
}

impl Guesses {
    pub(super) const NONE: Self =
        Self { count: 0, of: [(0, 0); BLOCK], theta: [0.0; BLOCK], powers: [[0.0; BLOCK]; TERMS] };

    /// Takes note of one.
    #[inline(always)]
    pub(super) fn push(&mut self, of: (usize, usize), a: &Series, theta: f64) {
        let k = self.count;
        (self.of[k], self.theta[k], self.count) = (of, theta, k + 1);
        for (powers, a) in self.powers.iter_mut().zip(a) {
            powers[k] = *a;
        }
    }

    /// Notes when they are and how high, each with the bits of [`polished`] and [`value`], and
    /// forgets them.
    #[inline(always)]
    pub(super) fn polish<S: Simd>(
        &mut self,
        simd: S,
        block: &mut [(FlightCurve, Outline)],
        apexes: &mut [f64],
    ) {
        let [mut above, mut length, mut next] = [[0.0; BLOCK]; 3];
        let [mut later_above, mut later_length, mut theta, mut x] = [[0.0; BLOCK]; 4];
        for r in 0..self.count.div_ceil(S::F64_LANES) {
            let of = |lanes: &[f64; BLOCK]| S::as_simd_f64s(lanes).0[r];
            let to = |all: &mut [f64; BLOCK], it| S::as_mut_simd_f64s(all).0[r] = it;
            let a = self.powers.each_ref().map(of);
            // two steps end it nearly always
            let [value, step, s] = halley(simd, &a, of(&self.theta));
            to(&mut above, value);
            to(&mut length, step);
            to(&mut next, s);
            let [value, step, s] = halley(simd, &a, s);
            to(&mut later_above, value);
            to(&mut later_length, step);
            to(&mut theta, s);
            to(&mut x, all_values(simd, &a, s));
        }
        for k in 0..self.count {
            let ((curve, apex), s) = (self.of[k], self.theta[k]);
            let (curve, outline) = &mut block[curve];
            // as `polished` asks
            let (low, high) = if above[k] > 0.0 { (s, 1.0) } else { (0.0, s) };
            let enclosed = next[k] > low && next[k] < high && length[k] >= LAST;
            let (low, high) = if later_above[k] > 0.0 { (next[k], high) } else { (low, next[k]) };
            let last = later_length[k] < LAST && theta[k] >= low && theta[k] <= high;
            if !(enclosed && last) {
                (theta[k], x[k]) = alone(curve, s);
            }
            apexes[apex] = curve.start + theta[k] * curve.h;
            outline.x[1] = larger(x[k], outline.x[1]);
        }
        self.count = 0;
    }
}

/// One of them.
#[cold]
#[inline(never)]
fn alone(curve: &FlightCurve, guess: f64) -> (f64, f64) {
    let Form::Powers(a, ..) = &curve.form else { return (guess, 0.0) };
    let theta = polished(&derivative(a), guess, |step, _| step.abs() < LAST);
    (theta, value(a, theta))
}

/// The velocities at these places, and length and end of a step of Halley's formula.
#[inline(always)]
fn halley<S: Simd>(simd: S, a: &[S::f64s; TERMS], s: S::f64s) -> [S::f64s; 3] {
    let times = |factor: f64, a| simd.mul_f64s(simd.splat_f64s(factor), a);
    let of = |k: usize| -> [S::f64s; LANES] {
        std::array::from_fn(|i| match LANES * k + i + 1 {
            TERMS => simd.splat_f64s(0.0),
            n => times(n as f64, a[n]),
        })
    };
    let [value, first, second] = all_slopes(simd, of, s);
    let above = simd.mul_f64s(times(2.0, value), first);
    let below =
        simd.sub_f64s(simd.mul_f64s(value, second), simd.mul_f64s(times(2.0, first), first));
    let step = simd.div_f64s(above, below);
    [value, simd.abs_f64s(step), simd.add_f64s(s, step)]
}

#[cfg(test)]
mod apexes_tests {
    use super::*;

    /// A part of cos(rate theta - rate place), whose apex is at that place.
    fn curve(rate: f64, place: f64) -> FlightCurve {
        let mut term = 1.0;
        let a: Series = std::array::from_fn(|n| {
            let own = term * (n as f64 * std::f64::consts::FRAC_PI_2 - rate * place).cos();
            term *= rate / (n as f64 + 1.0);
            own
        });
        FlightCurve { start: 0.0, h: 1.0, sigma: 1.0, form: Form::Powers(a, a[1], false) }
    }

    struct Polished<'a>(&'a mut Guesses, &'a mut [(FlightCurve, Outline)], &'a mut [f64]);

    impl pulp::WithSimd for Polished<'_> {
        type Output = ();

        fn with_simd<S: Simd>(self, simd: S) {
            self.0.polish(simd, self.1, self.2);
        }
    }

    #[test]
    fn side_by_side_they_have_the_bits_of_one_by_one() {
        for count in 1..=BLOCK {
            for k in 0..60 {
                let place = 0.1 + 0.013 * f64::from(k);
                // guessed well, badly, and where a step leads outside
                let guess = |l: usize| match l % 4 {
                    0 => place + 1e-3,
                    1 => place - 0.05,
                    2 => 0.999,
                    _ => (place * (7.3 + l as f64)).fract(),
                };
                let mut guesses = Guesses::NONE;
                let mut block = [(FlightCurve::NONE, Outline::NONE); BLOCK];
                for (l, (own, _)) in block.iter_mut().enumerate().take(count) {
                    *own = curve(0.3 + 0.02 * f64::from(k) + 0.03 * l as f64, place);
                    let Form::Powers(a, ..) = &own.form else { unreachable!() };
                    guesses.push((l, count - 1 - l), a, guess(l));
                }
                let mut apexes = [0.0; BLOCK];
                pulp::Arch::new().dispatch(Polished(&mut guesses, &mut block, &mut apexes));
                assert_eq!(guesses.count, 0);
                for (l, (own, outline)) in block.iter().enumerate().take(count) {
                    let (theta, x) = alone(own, guess(l));
                    assert_eq!((apexes[count - 1 - l], outline.x[1]), (theta, x), "{k} {l}");
                    assert!((theta - place).abs() < 1e-12 && (x - 1.0).abs() < 1e-15, "{k} {l}");
                }
            }
        }
    }
}
