//! Many masses side by side, one step of the theta-gamma scheme at a time: kernels that the
//! compiler vectorises.
//!
//! Nearly all steps of a run are free flight or rest. They are the same arithmetic for every mass
//! and are done side by side, without a branch; the few others (an apex, an impact, the arrival at
//! rest, lift-off) go one by one through the [`Stepper`](crate::stepping::theta_gamma::Stepper) of runs alone. The arithmetic is that of
//! such a run, operation by operation: a mass in a batch moves as it moves alone, to the last bit.
//!
//! Which steps are taken side by side: those whose only solution is the one with the present signs,
//! with room to spare. Seen from the side of the mass, with `u` the larger of `|v|` and 0 if the
//! mass moves away,
//!
//! ```text
//! s > h (1 + kappa) u + h^2 |f|                      no sign of s can change
//! v f > 0  or  |v| > gamma h |f|/(1 - kappa)         no sign of v can change
//! ```
//!
//! Under `f <= 0` these imply the conditions of [`zivi_core::ThetaGammaStep::everyday`]. Under `f >
//! 0`, where there may be several solutions, they exclude the eight other patterns, each by more
//! than its tolerance: the rule of [`zivi_core::step::selection`] has nothing to choose.

mod flight;
pub(super) mod moreau;

use super::pool::Outcome;
pub(super) use crate::drive::batch::lanes::flight::WIDTH;
use crate::drive::batch::lanes::flight::{vectors, vectors_mut, Common, FlyingMasses, Lane, Lanes};
use crate::drive::batch::{Save, Stopped};
use crate::stepping::fixed_step::{lift, FixedStep};
use crate::{Dependence, Force, Grid, SetupError};
use flight::Constant;
use flight::LinearLanes;
pub(super) use flight::Mass;
use flight::{OneByOne, StepLaw, Waves};
use pulp::{Simd, WithSimd};
use zivi_core::Restitution;

/// Walls with a smaller `1 - kappa` leave the patterns too little room between each other.
const LEAST_R: f64 = 1e-9;

/// Whether a mass can be moved side by side with others.
pub(super) fn takes<F: Force<Stopped>>(force: &F, restitution: Restitution) -> bool {
    let known = force.dependence() != Dependence::State || force.as_linear_force().is_some();
    known && restitution.r(1.0, 1.0) >= LEAST_R
}

/// Moves up to [`WIDTH`] masses over `grid`, whose forces all have this dependence.
pub(super) fn run<F: Force<Stopped> + Copy>(
    masses: &[Mass<F>],
    dependence: Dependence,
    grid: Grid,
    save: (Save<'_>, f64),
    stop: &dyn Fn() -> bool,
) -> Result<Vec<Outcome>, SetupError> {
    match dependence {
        Dependence::Constant => moved(masses, Constant::over(grid.n_steps()), grid, save, stop),
        Dependence::Time => moved(masses, VaryingForce::of(masses), grid, save, stop),
        Dependence::State => moved(masses, LinearLanes::of(masses), grid, save, stop),
    }
}

fn moved<F: Force<Stopped> + Copy, L: StepLaw<F>>(
    masses: &[Mass<F>],
    mut law: L,
    grid: Grid,
    (save, slowest): (Save<'_>, f64),
    stop: &dyn Fn() -> bool,
) -> Result<Vec<Outcome>, SetupError> {
    let steps: Vec<_> = masses.iter().map(|mass| mass.step).collect();
    let mut lanes = Lanes::of(&steps);
    let mut runs = Vec::with_capacity(masses.len());
    for (i, &mass) in masses.iter().enumerate() {
        let z = lift(mass.initial, mass.step.restitution())?;
        let run = OneByOne::start(mass, z, grid, save)?;
        lanes.place(i, z, run.sigma, run.is_busy(z));
        law.place(i, &run, &lanes);
        runs.push(run);
    }
    let arch = pulp::Arch::new();
    let extremes = save == Save::Statistics;
    let (n, every) = (grid.n_steps(), save.every());
    let mut k = 0;
    while k < n && !stop() {
        // a piece is up to the next sample, and short enough to be stopped
        let to_sample = if every > 0 { every - k % every } else { PIECE };
        let until = (k + to_sample.min(PIECE)).min(n - 1).max(k + 1);
        if k + 1 == n {
            lanes.h = grid.last_h();
            for (i, run) in runs.iter_mut().enumerate() {
                FixedStep::<Stopped, F>::resize(&mut run.stepper, grid.last_h());
                law.tell(i, run);
                law.place(i, run, &lanes);
            }
        }
        let (lanes, law, runs) = (&mut lanes, &mut law, &mut runs);
        arch.dispatch(LaneSteps { lanes, law, runs, grid, range: (k, until), extremes });
        k = until;
        if every > 0 && k % every == 0 {
            for (i, run) in runs.iter_mut().enumerate() {
                run.sample(lanes.at(i, run.sigma));
            }
        }
    }
    let finish = |(i, run): (usize, OneByOne<F>)| {
        // the step that failed had its evaluation, too
        let steps = run.ended.map_or(k, |ended| ended + 1);
        let nfev = law.nfev(i, &run, steps as u64);
        run.finish(&lanes, i, (grid, k), nfev, (save, slowest))
    };
    Ok(runs.into_iter().enumerate().map(finish).collect())
}

/// Steps between two checks whether to stop.
const PIECE: usize = 1 << 14;

/// The steps of a range, compiled for the instruction set of the machine.
struct LaneSteps<'a, F, L> {
    lanes: &'a mut Lanes,
    law: &'a mut L,
    runs: &'a mut [OneByOne<F>],
    grid: Grid,
    range: (usize, usize),
    extremes: bool,
}

impl<F: Force<Stopped>, L: StepLaw<F>> WithSimd for LaneSteps<'_, F, L> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { lanes, law, runs, grid, range: (k, until), extremes } = self;
        let mut hard = [0.0; WIDTH];
        let (n, all) = (lanes.vectors(simd), WIDTH / S::F64_LANES);
        let mut moving = lanes.any_busy();
        if extremes && k == 0 {
            lanes.note_extremes(simd);
        }
        for k in k..until {
            if !moving {
                break;
            }
            let t = grid.t(k);
            law.begin(t + lanes.theta * lanes.h, runs);
            // loops of a size that the compiler knows are faster
            let any_hard = if n == all {
                law.everyday(simd, lanes, all, &mut hard)
            } else {
                law.everyday(simd, lanes, n, &mut hard)
            };
            if any_hard {
                for (i, run) in runs.iter_mut().enumerate() {
                    if hard[i] != 0.0 {
                        let z = lanes.at(i, run.sigma);
                        law.tell(i, run);
                        let end = run.step(z, k, (t, grid.t(k + 1)));
                        let z = end.unwrap_or(z);
                        lanes.place(i, z, run.sigma, run.is_busy(z));
                        law.place(i, run, lanes);
                        moving = lanes.busy[i] != 0.0 || lanes.any_busy();
                    }
                }
            }
            if extremes {
                lanes.note_extremes(simd);
            }
        }
    }
}

// Masses under forces of time alone, which are known before a step.

/// Where the forces of a step come from.
enum ForceSource {
    /// Waves, from which gravity is taken away.
    Waves(Box<(Waves, Lane)>),
    /// Forces are evaluated, those that are the same once: the first that is the same as each.
    Evaluated(Vec<usize>),
}

#[repr(C, align(64))] // lanes begin where vectors of the machine do
struct VaryingForce {
    /// The forces; none (NaN) where nothing moves any more or a step has to be taken alone.
    pull: Lane,
    source: ForceSource,
}

impl VaryingForce {
    fn of<F: Force<Stopped>>(masses: &[Mass<F>]) -> Self {
        let linear = || masses.iter().filter_map(|mass| mass.force.as_linear_force());
        let source = if linear().count() == masses.len() {
            ForceSource::Waves(Box::new((Waves::of(linear()), [f64::NAN; WIDTH])))
        } else {
            let first = |(i, mass): (usize, &Mass<F>)| {
                let same = |other: &Mass<F>| mass.force.is_same(&other.force);
                masses[..i].iter().position(same).unwrap_or(i)
            };
            ForceSource::Evaluated(masses.iter().enumerate().map(first).collect())
        };
        Self { source, pull: [f64::NAN; WIDTH] }
    }
}

impl<F: Force<Stopped>> StepLaw<F> for VaryingForce {
    fn place(&mut self, i: usize, run: &OneByOne<F>, _: &Lanes) {
        if let ForceSource::Waves(waves) = &mut self.source {
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
            ForceSource::Waves(waves) => {
                let (waves, gravity) = &mut **waves;
                waves.go_to(t);
                let waves = waves.excitation.iter().zip(gravity);
                for (pull, (wave, gravity)) in self.pull.iter_mut().zip(waves) {
                    *pull = wave - *gravity;
                }
            }
            ForceSource::Evaluated(first) => {
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
            let flight = FlyingMasses::from(of, (s[i], v[i]), r, inverse_r, turn[i]);
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
