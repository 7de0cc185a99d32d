//! Masses under forces of time alone, which are known before a step.

use pulp::Simd;

use crate::Force;

use super::alone::{Mass, OneByOne};
use super::flight::{vectors, vectors_mut, Common, Flight, Lane, Lanes, WIDTH};
use super::law::Law;
use super::waves::Waves;
use crate::drive::batch::Stopped;

/// Where the forces of a step come from.
enum Source {
    /// Waves, from which gravity is taken away.
    Waves(Box<(Waves, Lane)>),
    /// Forces are evaluated, those that are the same once: the first that is the same as each.
    Evaluated(Vec<usize>),
}

#[repr(C, align(64))] // lanes begin where vectors of the machine do
pub(super) struct Pulled {
    /// The forces; none (NaN) where nothing moves any more or a step has to be taken alone.
    pull: Lane,
    source: Source,
}

impl Pulled {
    pub(super) fn of<F: Force<Stopped>>(masses: &[Mass<F>]) -> Self {
        let linear = || masses.iter().filter_map(|mass| mass.force.as_linear_force());
        let source = if linear().count() == masses.len() {
            Source::Waves(Box::new((Waves::of(linear()), [f64::NAN; WIDTH])))
        } else {
            let first = |(i, mass): (usize, &Mass<F>)| {
                let same = |other: &Mass<F>| mass.force.is_same(&other.force);
                masses[..i].iter().position(same).unwrap_or(i)
            };
            Source::Evaluated(masses.iter().enumerate().map(first).collect())
        };
        Self { source, pull: [f64::NAN; WIDTH] }
    }
}

impl<F: Force<Stopped>> Law<F> for Pulled {
    fn place(&mut self, i: usize, run: &OneByOne<F>, _: &Lanes) {
        if let Source::Waves(waves) = &mut self.source {
            let gravity = run.force.as_linear_force().map_or(f64::NAN, |it| it.gravity);
            waves.1[i] = if run.ended.is_none() { gravity } else { f64::NAN };
        }
        if run.ended.is_some() {
            self.pull[i] = f64::NAN;
        }
    }

    fn tell(&self, _: usize, _: &mut OneByOne<F>) {}

    #[inline(always)]
    fn begin(&mut self, t: f64, runs: &mut [OneByOne<F>]) {
        match &mut self.source {
            Source::Waves(waves) => {
                let (waves, gravity) = &mut **waves;
                waves.go_to(t);
                let waves = waves.excitation.iter().zip(gravity);
                for (pull, (wave, gravity)) in self.pull.iter_mut().zip(waves) {
                    *pull = wave - *gravity;
                }
            }
            Source::Evaluated(first) => {
                for (i, run) in runs.iter_mut().enumerate() {
                    if run.ended.is_none() {
                        let known = self.pull[first[i]];
                        let shared = first[i] < i && !known.is_nan();
                        self.pull[i] = if shared {
                            known
                        } else {
                            run.force.at(t, 0.0, 0.0).unwrap_or(f64::NAN)
                        };
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn everyday<S: Simd>(&mut self, simd: S, lanes: &mut Lanes, n: usize, hard: &mut Lane) -> bool {
        let of = Common::of(simd, lanes);
        let mut any = of.zero;
        let Lanes { s, v, busy, r, inverse_r, turn, .. } = lanes;
        let (s, v) = (vectors_mut(simd, s), vectors_mut(simd, v));
        let [r_out, r_in] = r.each_ref().map(|lane| vectors(simd, lane));
        let [inverse_out, inverse_in] = inverse_r.each_ref().map(|lane| vectors(simd, lane));
        let (turn, pull) = (vectors(simd, turn), vectors(simd, &self.pull));
        let (busy, hard) = (vectors(simd, busy), vectors_mut(simd, hard));
        for i in 0..n {
            let (r, inverse_r) = ([r_out[i], r_in[i]], [inverse_out[i], inverse_in[i]]);
            let flight = Flight::from(of, (s[i], v[i]), r, inverse_r, turn[i]);
            let push = simd.mul_f64s(of.h, pull[i]);
            let end = flight.end(push);
            let along = simd.mul_f64s(flight.v, push);
            let flies = flight.stays(simd.abs_f64s(push), along, end);
            s[i] = simd.select_f64s(flies, end.0, flight.s);
            v[i] = simd.select_f64s(flies, end.1, flight.v);
            let pressed = simd.less_than_or_equal_f64s(push, of.zero);
            let bounded = simd.greater_than_f64s(push, simd.neg_f64s(of.huge));
            let rests = simd.and_m64s(flight.is_at_origin(), simd.and_m64s(pressed, bounded));
            let taken = simd.or_m64s(flies, rests);
            hard[i] = simd.select_f64s(taken, of.zero, busy[i]);
            any = simd.or_f64s(any, hard[i]);
        }
        simd.first_true_m64s(simd.greater_than_f64s(any, of.zero)) < S::F64_LANES
    }

    fn nfev(&self, _: usize, _: &OneByOne<F>, steps: u64) -> u64 {
        steps
    }
}
