//! What a drawing needs to know of a step: ranges, how far it is from straight, and apexes.

use pulp::Simd;

use super::scale::{larger, largest, range, smaller};
use crate::numeric::bernstein::Bernstein;
use crate::switched::flight::series::{Series, TERMS};
use crate::switched::path::{Curve, Form};

/// What a drawing needs to know of a flight.
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
        curve: &'a Curve,
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
fn of_polynomials(curve: &Curve, [x, xdot]: &[Bernstein; 2], apexes: &mut Vec<f64>) -> Outline {
    /// What may be rounding, relative to the largest coefficient.
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

/// What is asked of a series in the middle of a step and at its end: the series and its first three
/// derivatives.
const ORDERS: usize = 4;
const ASKED: usize = 2 * ORDERS;
/// Terms of which they are made: beyond there is a millionth of a third derivative.
const ENOUGH: usize = 16;

/// What each power adds to them.
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
    curve: &Curve,
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
pub(super) fn all_apexes(curve: &Curve, apexes: &mut Vec<f64>) {
    let xdot = curve.velocity();
    // a step that falls has its first turn at the bottom
    let skipped = usize::from(xdot.starts_negative());
    let turns = xdot.crossings(0.0).into_iter().skip(skipped).step_by(2);
    apexes.extend(turns.map(|theta| curve.start + theta * curve.h));
}
