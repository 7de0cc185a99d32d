//! The motion of a linear system after a part of a step: by the series of its coordinates, where these are
//! kept, else term by term, by the widest registers of the processor.

use pulp::{Simd, WithSimd};

use super::propagation::{Free, Functional, Propagation};
use super::LinearFlight;
use crate::mechanics::path::Curve;
use crate::numeric::power_series::{value_and_slope, TERMS};
use crate::record::gap_set::GapSet;

/// Terms below this fraction of a sum are rounding.
const NEGLIGIBLE: f64 = 1e-18;

/// Up to these parts of a step 12 and 16 terms are enough: those beyond are below `.2^12/12! = 9e-18` and
/// `.5^16/16! = 7e-19`.
const SHORT: [f64; 2] = [0.1, 0.25];

/// The terms of the series of `q` in the part of the step, if requested.
type Terms<'a> = Option<&'a mut Vec<f64>>;

impl Propagation {
    /// `(q, h q')` after a part of the step from `y`, whose memory is used up.
    pub(super) fn part(
        &self,
        free: &Free,
        step: (f64, f64),
        y: &mut [f64],
        out: &mut [f64],
        terms: Terms<'_>,
    ) {
        let arch = pulp::Arch::new();
        match &self.coordinates {
            Some(coordinates) => {
                arch.dispatch(Reading { coordinates, part: step.1, y, out, terms });
            }
            None => arch.dispatch(Sum { motion: self, free, step, y, out, terms }),
        }
    }
}

impl LinearFlight {
    /// Computes `(q, h q')` after a part of the step, and the motion up to there if that is wanted.
    pub(super) fn end_of(
        &mut self,
        motion: &Propagation,
        part: f64,
        closed: GapSet,
        (start, dense): (f64, bool),
    ) {
        self.curve = None;
        if part == 1.0 && !dense {
            motion.whole(&self.y, &mut self.end);
            return;
        }
        // the same end whether the motion up to there is wanted or not
        let end = (part == 1.0).then(|| {
            motion.whole(&self.y, &mut self.end);
            self.end.clone()
        });
        let mut terms = vec![];
        let wanted = dense.then_some(&mut terms);
        motion.part(&self.free, (self.h, part), &mut self.y, &mut self.end, wanted);
        if let Some(end) = end {
            self.end = end;
        }
        if !dense || part <= 0.0 {
            return;
        }
        let n = self.free.n;
        let mut powers = Vec::with_capacity((n + self.series.len()) * TERMS);
        for i in 0..n {
            powers.extend((0..TERMS).map(|k| terms[k * n + i]));
        }
        for (i, series) in self.series.iter().enumerate() {
            let mut power = if closed.has(i) { 0.0 } else { 1.0 };
            for a in series {
                powers.push(a * power);
                power *= part;
            }
        }
        self.curve = Some(Curve::of_powers(start, part * self.h, powers));
    }
}

/// The series of the coordinates, read.
struct Reading<'a> {
    coordinates: &'a [Functional],
    part: f64,
    y: &'a [f64],
    out: &'a mut [f64],
    terms: Terms<'a>,
}

impl WithSimd for Reading<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { coordinates, part, y, out, mut terms } = self;
        let n = coordinates.len();
        if let Some(terms) = &mut terms {
            terms.resize(n * TERMS, 0.0);
        }
        for (i, coordinate) in coordinates.iter().enumerate() {
            // whether its terms are wanted or not
            let few = if part <= SHORT[0] {
                of_few::<12>(coordinate, y, part)
            } else if part <= SHORT[1] {
                of_few::<16>(coordinate, y, part)
            } else {
                None
            };
            if let Some(few) = few.filter(|_| terms.is_none()) {
                [out[i], out[n + i]] = few;
                continue;
            }
            let a = coordinate.series_by_columns(y);
            [out[i], out[n + i]] = few.unwrap_or_else(|| value_and_slope(&a, part));
            let Some(terms) = &mut terms else { continue };
            let mut power = 1.0;
            for (k, a) in a.iter().enumerate() {
                terms[k * n + i] = power * a;
                power *= part;
            }
        }
    }
}

/// A coordinate and its rate by the first terms, where these are quick to compute alone.
#[inline(always)]
fn of_few<const FEW: usize>(coordinate: &Functional, y: &[f64], part: f64) -> Option<[f64; 2]> {
    coordinate.first_terms::<FEW>(y).map(|a| value_and_slope(&a, part))
}

/// The sum of the terms `y_(k+1) = part/(k + 1) Y y_k`.
struct Sum<'a> {
    motion: &'a Propagation,
    free: &'a Free,
    step: (f64, f64),
    y: &'a mut [f64],
    out: &'a mut [f64],
    terms: Terms<'a>,
}

impl WithSimd for Sum<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { motion, free, step: (h, part), y, out, mut terms } = self;
        let n = free.n;
        let mut acceleration = vec![0.0; n];
        out.copy_from_slice(&y[..2 * n]);
        for k in 0..TERMS {
            if let Some(terms) = &mut terms {
                terms.extend_from_slice(&y[..n]);
            }
            if k + 1 == TERMS {
                break;
            }
            motion.advance(free, (h, part / (k + 1) as f64), y, &mut acceleration);
            let mut negligible = true;
            for (out, y) in out.iter_mut().zip(&*y) {
                negligible &= y.abs() <= NEGLIGIBLE * out.abs();
                *out += y;
            }
            if negligible && terms.is_none() && k > 1 {
                break;
            }
        }
    }
}
