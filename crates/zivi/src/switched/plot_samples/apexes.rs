//! Apexes of power series, found side by side.

use pulp::Simd;

use super::outline::Outline;
use super::scale::larger;
use super::BLOCK;
use crate::numeric::power_series::{all_slopes, all_values, LANES};
use crate::switched::flight::series::{derivative, polished, value, Series, TERMS};
use crate::switched::path::{Curve, Form};

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
        block: &mut [(Curve, Outline)],
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
fn alone(curve: &Curve, guess: f64) -> (f64, f64) {
    let Form::Powers(a, ..) = &curve.form else { return (guess, 0.0) };
    let theta = polished(&derivative(a), guess, |step, _| step.abs() < LAST);
    (theta, value(a, theta))
}

/// The velocities at such places, how long a step by Halley's formula is from there, and where it
/// leads.
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
mod tests {
    use super::*;

    /// A part of cos(rate theta - rate place), whose apex is at that place.
    fn curve(rate: f64, place: f64) -> Curve {
        let mut term = 1.0;
        let a: Series = std::array::from_fn(|n| {
            let own = term * (n as f64 * std::f64::consts::FRAC_PI_2 - rate * place).cos();
            term *= rate / (n as f64 + 1.0);
            own
        });
        Curve { start: 0.0, h: 1.0, sigma: 1.0, form: Form::Powers(a, a[1], false) }
    }

    struct Polished<'a>(&'a mut Guesses, &'a mut [(Curve, Outline)], &'a mut [f64]);

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
                let mut block = [(Curve::NONE, Outline::NONE); BLOCK];
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
