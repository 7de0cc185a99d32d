//! Many masses under linear forces by Moreau-Jean time stepping, side by side.
//!
//! Everyday are the steps of a flight above the wall, where the predicted gap is open, and those of
//! rest, which need an impulse; all others are taken by the stepper of runs alone. The arithmetic is
//! that of such a run, operation by operation.

use pulp::{Simd, WithSimd};
use zivi_core::Physical;

use super::flight::Waves;
use super::flight::{vectors, vectors_mut, Lane, HUGE, WIDTH};
use super::PIECE;
use crate::drive::batch::pool::{Outcome, Saved};
use crate::drive::batch::{Save, Stopped};
use crate::stepping::moreau_jean::{Mover, TOLERANCE};
use crate::{Dependence, Failure, Force, Grid, SetupError, Status, Summary};

/// A mass, its force, its wall and where it starts.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Mass<F> {
    pub(in super::super) e: f64,
    pub(in super::super) force: F,
    pub(in super::super) initial: Physical,
}

/// Whether a mass can be moved side by side with others, at this weight of the end of a step.
pub(in super::super) fn takes<F: Force<Stopped>>(force: &F, theta: f64) -> bool {
    // a constant force takes no evaluations, and where the mass rests no steps
    let varies = force.dependence() != Dependence::Constant;
    varies && theta > 0.0 && force.as_linear_force().is_some()
}

/// Moves up to [`WIDTH`] masses over `grid`, whose forces all depend on the state or none.
pub(in super::super) fn run<F: Force<Stopped> + Copy>(
    masses: &[Mass<F>],
    theta: f64,
    grid: Grid,
    (save, slowest): (Save<'_>, f64),
    stop: &dyn Fn() -> bool,
) -> Result<Vec<Outcome>, SetupError> {
    let mut lanes = MoreauLanes::of(masses, theta, grid);
    let mut runs = Vec::with_capacity(masses.len());
    for (i, mass) in masses.iter().enumerate() {
        let saved = Saved::with_room(save.every(), grid)?;
        let mover = Mover::new(theta, mass.e, (grid.t(0), mass.initial));
        runs.push(MoreauOneByOne {
            mover,
            force: mass.force,
            status: Status::Completed,
            ended: None,
            saved,
        });
        lanes.place(i, mass.initial, &runs[i]);
    }
    let arch = pulp::Arch::new();
    let (n, every) = (grid.n_steps(), save.every());
    let extremes = save == Save::Statistics;
    let mut k = 0;
    lanes.sample(&mut runs, (every, k));
    while k < n && !stop() {
        // a piece is up to the next sample, and short enough to be stopped
        let to_sample = if every > 0 { every - k % every } else { PIECE };
        let until = (k + to_sample.min(PIECE)).min(n - 1).max(k + 1);
        if k + 1 == n {
            lanes.h = grid.last_h();
        }
        let (lanes, runs) = (&mut lanes, &mut *runs);
        arch.dispatch(MoreauSteps { lanes, runs, grid, range: (k, until), extremes });
        k = until;
        lanes.sample(runs, (every, k));
    }
    let finish = |(i, run): (usize, MoreauOneByOne<F>)| {
        let Physical { x, xdot } = lanes.at(i);
        let (x_max, speed_max) = (lanes.x_max[i], lanes.speed_max[i]);
        let summary = Summary { t: grid.t(run.ended.unwrap_or(k)), x, xdot, x_max, speed_max };
        let nfev = run.mover.scheme.nfev + lanes.nfev[i] as u64;
        let events = run.mover.log.finish();
        Outcome::new((events, &[]), run.saved, summary, (run.status, nfev), (save, slowest))
    };
    Ok(runs.into_iter().enumerate().map(finish).collect())
}

/// The run of one mass outside the kernels.
struct MoreauOneByOne<F> {
    mover: Mover,
    force: F,
    status: Status,
    /// After how many steps it stopped, if it did.
    ended: Option<usize>,
    saved: Saved,
}

impl<F: Force<Stopped>> MoreauOneByOne<F> {
    /// The special step after `k`; the mass stops if the step has no solution.
    #[cold]
    #[inline(never)]
    fn step(&mut self, from: Physical, k: usize, times: (f64, f64), h: f64) -> Physical {
        match self.mover.step(from, times, h, &mut self.force) {
            Ok(end) => end,
            Err(failure) => {
                self.ended = Some(k);
                self.status = match failure {
                    Failure::Status(status) => status,
                    Failure::Raised(Stopped) => Status::Raised,
                };
                from
            }
        }
    }
}

#[repr(C, align(64))] // lanes begin where vectors of the machine do
struct MoreauLanes {
    x: Lane,
    v: Lane,
    e: Lane,
    /// Whether the mass moves or may do so, and whether it rests, as `1` or `0`.
    busy: Lane,
    rests: Lane,
    stiffness: Lane,
    damping: Lane,
    gravity: Lane,
    /// The force at the start of a step (no number before the first and after the last), the slope
    /// of its mismatch, and the largest so far.
    here: Lane,
    slope: Lane,
    largest: Lane,
    /// Evaluations of the force side by side.
    nfev: Lane,
    /// Largest `|x|` and `|x'|` so far.
    x_max: Lane,
    speed_max: Lane,
    waves: Waves,
    /// How many masses there are.
    n: usize,
    theta: f64,
    h: f64,
    /// Whether the force at the end of a step depends on where it ends.
    implicit: bool,
}

impl MoreauLanes {
    fn of<F: Force<Stopped>>(masses: &[Mass<F>], theta: f64, grid: Grid) -> Self {
        let forces = || masses.iter().filter_map(|mass| mass.force.as_linear_force());
        let zero = [0.0; WIDTH];
        let mut lanes = Self {
            x: zero,
            v: zero,
            e: zero,
            busy: zero,
            rests: zero,
            stiffness: zero,
            damping: zero,
            gravity: zero,
            here: [f64::NAN; WIDTH],
            slope: zero,
            largest: zero,
            nfev: zero,
            x_max: zero,
            speed_max: zero,
            waves: Waves::of(forces()),
            n: masses.len(),
            theta,
            h: grid.h(),
            implicit: masses.iter().any(|mass| mass.force.dependence() == Dependence::State),
        };
        for (i, (force, mass)) in forces().zip(masses).enumerate() {
            (lanes.stiffness[i], lanes.damping[i]) = (force.stiffness, force.damping);
            (lanes.gravity[i], lanes.e[i]) = (force.gravity, mass.e);
        }
        lanes
    }

    fn at(&self, i: usize) -> Physical {
        Physical { x: self.x[i], xdot: self.v[i] }
    }

    /// Puts a mass where a step of its own has led it.
    fn place<F>(&mut self, i: usize, Physical { x, xdot }: Physical, run: &MoreauOneByOne<F>) {
        let Mover { scheme, log } = &run.mover;
        (self.x[i], self.v[i]) = (x, xdot);
        self.busy[i] = f64::from(u8::from(run.ended.is_none()));
        self.rests[i] = f64::from(u8::from(log.at_rest));
        let here = scheme.here.filter(|_| run.ended.is_none());
        self.here[i] = here.unwrap_or(f64::NAN);
        (self.slope[i], self.largest[i]) = (scheme.slope, scheme.largest);
    }

    /// Tells a mass what the steps side by side have left, before a step of its own.
    fn tell<F>(&self, i: usize, run: &mut MoreauOneByOne<F>) {
        if !self.here[i].is_nan() {
            run.mover.scheme.here = Some(self.here[i]);
        }
        run.mover.scheme.largest = self.largest[i];
    }

    /// Stores the samples after `k` steps, if requested.
    fn sample<F>(&self, runs: &mut [MoreauOneByOne<F>], (every, k): (usize, usize)) {
        if every > 0 && k % every == 0 {
            for (i, run) in runs.iter_mut().enumerate().filter(|(_, run)| run.ended.is_none()) {
                run.saved.push(self.x[i], self.v[i]);
            }
        }
    }

    #[inline(always)]
    fn note_extremes<S: Simd>(&mut self, simd: S, n: usize) {
        let (x, v) = (vectors(simd, &self.x), vectors(simd, &self.v));
        let x_max = vectors_mut(simd, &mut self.x_max);
        let speed_max = vectors_mut(simd, &mut self.speed_max);
        for i in 0..n {
            x_max[i] = simd.max_f64s(x_max[i], simd.abs_f64s(x[i]));
            speed_max[i] = simd.max_f64s(speed_max[i], simd.abs_f64s(v[i]));
        }
    }

    /// Takes the everyday steps of the masses in the first `n` vectors; one whose step is `hard` (not
    /// 0) stays. Gives whether there is one.
    #[inline(always)]
    fn everyday<S: Simd>(&mut self, simd: S, n: usize, hard: &mut Lane) -> bool {
        let (zero, huge) = (simd.splat_f64s(0.0), simd.splat_f64s(HUGE));
        let (one, two) = (simd.splat_f64s(1.0), simd.splat_f64s(2.0));
        let half = simd.splat_f64s(0.5 * self.h);
        let theta = [simd.splat_f64s(self.theta), simd.splat_f64s(1.0 - self.theta)];
        let (x, v) = (vectors_mut(simd, &mut self.x), vectors_mut(simd, &mut self.v));
        let (e, rests) = (vectors(simd, &self.e), vectors(simd, &self.rests));
        let (stiffness, damping) = (vectors(simd, &self.stiffness), vectors(simd, &self.damping));
        let (gravity, slope) = (vectors(simd, &self.gravity), vectors(simd, &self.slope));
        let excitation = vectors(simd, &self.waves.excitation);
        let here = vectors_mut(simd, &mut self.here);
        let largest = vectors_mut(simd, &mut self.largest);
        let nfev = vectors_mut(simd, &mut self.nfev);
        let (busy, hard) = (vectors(simd, &self.busy), vectors_mut(simd, hard));
        let mut any = zero;
        for i in 0..n {
            let predicted = simd.add_f64s(x[i], simd.mul_f64s(half, v[i]));
            let closed = simd.less_than_or_equal_f64s(predicted, zero);
            let at_rest = simd.greater_than_f64s(rests[i], zero);
            let first = here[i];
            let step = MoreauStep {
                simd,
                state: (x[i], v[i]),
                first,
                h: simd.splat_f64s(self.h),
                theta,
                closed,
                bounce: simd.mul_f64s(simd.neg_f64s(e[i]), v[i]),
                stiffness: stiffness[i],
                damping: damping[i],
                gravity: gravity[i],
                excitation: excitation[i],
            };
            let (trial, last, found, most, count) = if self.implicit {
                let once = step.tried(first);
                let mismatch = simd.sub_f64s(once.value, first);
                let second = simd.sub_f64s(first, simd.div_f64s(mismatch, slope[i]));
                let twice = step.tried(second);
                let at_once = step.is_root(once.value, first);
                let found = simd.or_m64s(at_once, step.is_root(twice.value, second));
                let most = simd.abs_f64s(once.value);
                let more = simd.max_f64s(most, simd.abs_f64s(twice.value));
                let usual = simd.and_m64s(once.usual, twice.usual);
                let trial = Trial {
                    end: (
                        simd.select_f64s(at_once, once.end.0, twice.end.0),
                        simd.select_f64s(at_once, once.end.1, twice.end.1),
                    ),
                    usual: simd.or_m64s(usual, simd.and_m64s(at_once, once.usual)),
                    value: once.value,
                };
                let last = simd.select_f64s(at_once, first, second);
                let most = simd.select_f64s(at_once, most, more);
                (trial, last, found, most, simd.select_f64s(at_once, one, two))
            } else {
                let value = step.force(step.state);
                let known = simd.equal_f64s(first, first);
                (step.tried(value), value, known, simd.abs_f64s(value), one)
            };
            // a flight is above the wall, rest is pressed to it
            let kept = simd.xor_m64s(simd.greater_than_f64s(predicted, zero), at_rest);
            let (end, usual) = (trial.end, simd.and_m64s(trial.usual, kept));
            let size = simd.add_f64s(simd.abs_f64s(end.0), simd.abs_f64s(end.1));
            let bounded = simd.less_than_f64s(simd.max_f64s(size, most), huge);
            let taken = simd.and_m64s(simd.and_m64s(found, usual), bounded);
            x[i] = simd.select_f64s(taken, end.0, x[i]);
            v[i] = simd.select_f64s(taken, end.1, v[i]);
            here[i] = simd.select_f64s(taken, last, first);
            largest[i] = simd.select_f64s(taken, simd.max_f64s(largest[i], most), largest[i]);
            nfev[i] = simd.add_f64s(nfev[i], simd.select_f64s(taken, count, zero));
            hard[i] = simd.select_f64s(taken, zero, busy[i]);
            any = simd.or_f64s(any, hard[i]);
        }
        simd.first_true_m64s(simd.greater_than_f64s(any, zero)) < S::F64_LANES
    }
}

/// Some masses at the start of a step. (Functions and no closures: only what is certainly inlined is
/// compiled for the machine's vectors.)
struct MoreauStep<S: Simd> {
    simd: S,
    state: (S::f64s, S::f64s),
    /// The force there.
    first: S::f64s,
    h: S::f64s,
    theta: [S::f64s; 2],
    /// Whether the predicted gap is closed, and the velocity with which the wall lets a mass go.
    closed: S::m64s,
    bounce: S::f64s,
    stiffness: S::f64s,
    damping: S::f64s,
    gravity: S::f64s,
    excitation: S::f64s,
}

/// The end of a step, whether that is in flight or takes an impulse, and the force there.
struct Trial<S: Simd> {
    end: (S::f64s, S::f64s),
    usual: S::m64s,
    value: S::f64s,
}

impl<S: Simd> MoreauStep<S> {
    #[inline(always)]
    fn weighted(&self, new: S::f64s, old: S::f64s) -> S::f64s {
        let (simd, [theta, rest]) = (self.simd, self.theta);
        simd.add_f64s(simd.mul_f64s(theta, new), simd.mul_f64s(rest, old))
    }

    /// Under the force `last` at its end.
    #[inline(always)]
    fn tried(&self, last: S::f64s) -> Trial<S> {
        let Self { simd, state: (x, v), closed, bounce, .. } = *self;
        let free = simd.add_f64s(v, simd.mul_f64s(self.h, self.weighted(last, self.first)));
        let xdot = simd.select_f64s(closed, bounce, free);
        let end = (simd.add_f64s(x, simd.mul_f64s(self.h, self.weighted(xdot, v))), xdot);
        let impulse = simd.sub_f64s(bounce, free);
        let impulse = simd.select_f64s(closed, impulse, simd.splat_f64s(1.0));
        let usual = simd.greater_than_f64s(impulse, simd.splat_f64s(0.0));
        Trial { end, usual, value: self.force(end) }
    }

    #[inline(always)]
    fn force(&self, (x, v): (S::f64s, S::f64s)) -> S::f64s {
        let simd = self.simd;
        let spring = simd.mul_f64s(self.stiffness, x);
        let damper = simd.mul_f64s(self.damping, v);
        let value = simd.sub_f64s(simd.neg_f64s(spring), damper);
        simd.add_f64s(simd.sub_f64s(value, self.gravity), self.excitation)
    }

    #[inline(always)]
    fn is_root(&self, value: S::f64s, last: S::f64s) -> S::m64s {
        let simd = self.simd;
        let most = simd.max_f64s(simd.abs_f64s(value), simd.abs_f64s(self.first));
        let apart = simd.abs_f64s(simd.sub_f64s(value, last));
        simd.less_than_or_equal_f64s(apart, simd.mul_f64s(simd.splat_f64s(TOLERANCE), most))
    }
}

/// The steps of a range, compiled for the instruction set of the machine.
struct MoreauSteps<'a, F> {
    lanes: &'a mut MoreauLanes,
    runs: &'a mut [MoreauOneByOne<F>],
    grid: Grid,
    range: (usize, usize),
    extremes: bool,
}

impl<F: Force<Stopped>> WithSimd for MoreauSteps<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { lanes, runs, grid, range: (k, until), extremes } = self;
        let mut hard = [0.0; WIDTH];
        let n = lanes.n.div_ceil(S::F64_LANES);
        if extremes && k == 0 {
            lanes.note_extremes(simd, n);
        }
        let mut moving = lanes.busy.contains(&1.0);
        for k in k..until {
            if !moving {
                break;
            }
            let times = (grid.t(k), grid.t(k + 1));
            lanes.waves.go_to(times.1);
            if lanes.everyday(simd, n, &mut hard) {
                for (i, run) in runs.iter_mut().enumerate().filter(|(i, _)| hard[*i] != 0.0) {
                    lanes.tell(i, run);
                    let end = run.step(lanes.at(i), k, times, lanes.h);
                    lanes.place(i, end, run);
                }
                moving = lanes.busy.contains(&1.0);
            }
            if extremes {
                lanes.note_extremes(simd, n);
            }
        }
    }
}
