//! Many masses under constant forces, one step of the theta-gamma scheme at a time: a kernel that
//! the compiler vectorises.
//!
//! Nearly all steps of a run are free flight or rest. They are the same arithmetic for every mass
//! and are done side by side, without a branch; the few others (an apex, an impact, the arrival at
//! rest) go one by one through [`ThetaGammaStep::solve`]. The arithmetic is that of
//! [`ThetaGammaStep::everyday`], operation by operation: a mass in a batch moves as it moves
//! alone, to the last bit.

use pulp::{Simd, WithSimd};
use zivi_core::step::SIGN_TOLERANCE;
use zivi_core::{transform, Branch, Lifted, Physical, Restitution, StepFailure, ThetaGammaStep};

use crate::record::events::EventLog;
use crate::stepping::fixed_step::lift;
use crate::{Grid, SetupError, Status, Summary};

use super::outcome::{Outcome, Saved};
use super::Save;

/// Masses that are moved side by side.
pub(super) const WIDTH: usize = 64;

type Lane = [f64; WIDTH];

/// A mass that falls under a constant force.
#[derive(Clone, Copy, Debug)]
pub(super) struct Falling {
    pub(super) step: ThetaGammaStep,
    pub(super) force: f64,
    pub(super) initial: Physical,
}

/// What the kernel works on: states seen from the side of the wall where the mass is, and what is
/// constant over the steps. The signs `lambda_s` are all `+1` from there.
struct Lanes {
    /// `|s|` and `v sgn s`.
    s: Lane,
    v: Lane,
    /// `h (1 - kappa)` and `h (1 + kappa)`.
    reach: [Lane; 2],
    /// `h f/(1 - kappa)` and `h f/(1 + kappa)`.
    kick: [Lane; 2],
    /// `theta h^2 f`.
    drop: Lane,
    /// The same for all.
    gamma: f64,
    /// Below these `s` and, outward, `v` are too near to a switch; `least_s` is infinite where no
    /// step is everyday.
    least_s: Lane,
    least_v: Lane,
    /// What `least_s` is where it is finite.
    near: Lane,
    /// Steps of the run.
    n_steps: f64,
    /// Whether the mass moves, as `1` or `0`: not if it rests or takes no part any more.
    busy: Lane,
    /// `1 - kappa` and `1 + kappa`.
    r: [Lane; 2],
    /// Largest `|s|` and `|x'|` so far.
    x_max: Lane,
    speed_max: Lane,
}

/// What continues beside the states.
struct BatchState {
    falling: Falling,
    log: EventLog,
    sigma: f64,
    status: Status,
    /// When it stopped, if it did.
    ended: Option<f64>,
    saved: Saved,
}

/// Moves up to [`WIDTH`] masses over `grid`.
pub(super) fn run(
    masses: &[Falling],
    grid: Grid,
    (save, slowest): (Save<'_>, f64),
    stop: &dyn Fn() -> bool,
) -> Result<Vec<Outcome>, SetupError> {
    let mut ledgers = Vec::with_capacity(masses.len());
    let gamma = masses.first().map_or(1.0, |falling| falling.step.gamma());
    let mut lanes = Lanes::new(gamma, grid.n_steps());
    for (i, &falling) in masses.iter().enumerate() {
        let z = lift(falling.initial, falling.step.restitution())?;
        let ledger = BatchState::start(falling, z, grid, save)?;
        lanes.place(i, z, &ledger);
        ledgers.push(ledger);
    }
    lanes.prepare(&ledgers, grid.h());
    let arch = pulp::Arch::new();
    arch.dispatch(Start(&mut lanes));
    let (n, every) = (grid.n_steps(), save.every());
    let mut k = 0;
    while k < n && !stop() {
        // a piece is up to the next sample, and short enough to be stopped
        let to_sample = if every > 0 { every - k % every } else { PIECE };
        let until = (k + to_sample.min(PIECE)).min(n - 1).max(k + 1);
        if k + 1 == n {
            lanes.prepare(&ledgers, grid.last_h());
        }
        let pass = Pass { lanes: &mut lanes, ledgers: &mut ledgers, grid, range: (k, until) };
        match (save == Save::Statistics, gamma == 1.0) {
            (false, true) => arch.dispatch(Steps::<false, true>(pass)),
            (false, false) => arch.dispatch(Steps::<false, false>(pass)),
            (true, true) => arch.dispatch(Steps::<true, true>(pass)),
            (true, false) => arch.dispatch(Steps::<true, false>(pass)),
        }
        k = until;
        if every > 0 && k % every == 0 {
            for (i, ledger) in ledgers.iter_mut().enumerate() {
                ledger.sample(lanes.at(i, ledger.sigma));
            }
        }
    }
    let end = grid.t(k);
    let ends = ledgers.into_iter().enumerate();
    Ok(ends.map(|(i, it)| it.finish(&lanes, i, end, (save, slowest))).collect())
}

/// Steps between two checks whether to stop.
const PIECE: usize = 1 << 14;

/// The steps of a range.
struct Pass<'a> {
    lanes: &'a mut Lanes,
    ledgers: &'a mut [BatchState],
    grid: Grid,
    range: (usize, usize),
}

/// The extremes of the initial states.
struct Start<'a>(&'a mut Lanes);

impl WithSimd for Start<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.0.note_extremes(simd);
    }
}

/// A pass, compiled for what the machine can do; whether the extremes are noted and whether
/// `gamma` is 1.
struct Steps<'a, const EXTREMES: bool, const PLAIN: bool>(Pass<'a>);

impl<const EXTREMES: bool, const PLAIN: bool> WithSimd for Steps<'_, EXTREMES, PLAIN> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Pass { lanes, ledgers, grid, range: (k, until) } = self.0;
        let mut hard = [0.0; WIDTH];
        let mut moving = lanes.any_busy();
        for k in k..until {
            if !moving {
                break;
            }
            if lanes.everyday::<S, PLAIN>(simd, &mut hard) {
                let h = if k + 1 == grid.n_steps() { grid.last_h() } else { grid.h() };
                let times = (grid.t(k), grid.t(k + 1));
                for (i, ledger) in ledgers.iter_mut().enumerate() {
                    if hard[i] != 0.0 {
                        let z = lanes.at(i, ledger.sigma);
                        let end = ledger.step(z, h, times);
                        lanes.place(i, end.unwrap_or(z), ledger);
                        lanes.guard(i);
                        moving = lanes.busy[i] != 0.0 || lanes.any_busy();
                    }
                }
            }
            if EXTREMES {
                lanes.note_extremes(simd);
            }
        }
    }
}

impl Lanes {
    /// Masses that do not exist.
    fn new(gamma: f64, n_steps: usize) -> Self {
        let zero = [0.0; WIDTH];
        Self {
            s: zero,
            v: zero,
            reach: [zero; 2],
            kick: [zero; 2],
            drop: zero,
            gamma,
            least_s: zero,
            least_v: zero,
            near: zero,
            n_steps: n_steps as f64,
            busy: zero,
            r: [zero; 2],
            x_max: zero,
            speed_max: zero,
        }
    }

    fn any_busy(&self) -> bool {
        self.busy.iter().any(|&busy| busy != 0.0)
    }

    /// The state of a mass that is on this branch.
    fn at(&self, i: usize, sigma: f64) -> Lifted {
        // adding 0.0 turns the -0.0 of a mirrored zero into 0.0
        Lifted { s: sigma * self.s[i] + 0.0, v: sigma * self.v[i] + 0.0 }
    }

    /// Puts a mass where it is.
    fn place(&mut self, i: usize, z: Lifted, ledger: &BatchState) {
        // no negative zeros
        (self.s[i], self.v[i]) = (ledger.sigma * z.s + 0.0, ledger.sigma * z.v + 0.0);
        let rests = z == Lifted::default() && ledger.falling.force <= 0.0;
        self.busy[i] = f64::from(u8::from(!rests && ledger.ended.is_none()));
    }

    /// The constants of steps of size `h`.
    fn prepare(&mut self, ledgers: &[BatchState], h: f64) {
        for (i, BatchState { falling: Falling { step, force, .. }, .. }) in
            ledgers.iter().enumerate()
        {
            let (restitution, push) = (step.restitution(), h * force);
            for (way, lambda_v) in [1.0, -1.0].into_iter().enumerate() {
                let r = restitution.r(1.0, lambda_v);
                self.r[way][i] = r;
                self.reach[way][i] = h * r;
                self.kick[way][i] = push * (1.0 / r);
            }
            self.drop[i] = step.theta() * h * push;
            // |travel| <= s + s_gamma/gamma + |drop| bounds the terms that a sign is tested against;
            // pulled off the wall there may be several solutions: nothing is everyday then
            let pressed = *force <= 0.0 && force.is_finite();
            self.near[i] = if pressed { MARGIN * self.drop[i].abs() } else { f64::INFINITY };
            self.least_v[i] = MARGIN * self.kick[0][i].abs();
            self.guard(i);
        }
    }

    /// Allows everyday steps, or not: what is at the wall, or could overflow in the steps of the
    /// run, is looked at one by one.
    fn guard(&mut self, i: usize) {
        let fastest = self.v[i].abs() + self.n_steps * self.kick[0][i].abs();
        let in_one_step = self.reach[1][i] * fastest + self.drop[i].abs();
        let bounded = fastest < HUGE && self.s[i] + self.n_steps * in_one_step < HUGE;
        let off = self.s[i] != 0.0 && self.busy[i] != 0.0;
        self.least_s[i] = if off && bounded { self.near[i] } else { f64::INFINITY };
    }

    /// Takes the everyday steps; a mass whose step is `hard` (not 0) stays. Gives whether one is.
    ///
    /// A step counts as everyday with a wider margin than that of [`ThetaGammaStep::everyday`],
    /// which decides about the others again.
    #[inline(always)]
    fn everyday<S: Simd, const PLAIN: bool>(&mut self, simd: S, hard: &mut Lane) -> bool {
        let (margin, gamma) = (simd.splat_f64s(MARGIN), simd.splat_f64s(self.gamma));
        let zero = simd.splat_f64s(0.0);
        let mut any = zero;
        let (s, v) = (vectors_mut(simd, &mut self.s), vectors_mut(simd, &mut self.v));
        let [reach_out, reach_in] = self.reach.each_ref().map(|lane| vectors(simd, lane));
        let [kick_out, kick_in] = self.kick.each_ref().map(|lane| vectors(simd, lane));
        let drop = vectors(simd, &self.drop);
        let (least_s, least_v) = (vectors(simd, &self.least_s), vectors(simd, &self.least_v));
        let (busy, hard) = (vectors(simd, &self.busy), vectors_mut(simd, hard));
        for i in 0..s.len() {
            let (from_s, from_v) = (s[i], v[i]);
            let inward = simd.less_than_f64s(from_v, zero);
            let reach = simd.select_f64s(inward, reach_in[i], reach_out[i]);
            let kick = simd.select_f64s(inward, kick_in[i], kick_out[i]);
            let change = simd.add_f64s(simd.mul_f64s(reach, from_v), drop[i]);
            let (end_s, end_v) = (simd.add_f64s(from_s, change), simd.add_f64s(from_v, kick));
            // only for a comparison with room to spare: it may be fused
            let floor = simd.mul_add_e_f64s(margin, from_s, least_s[i]);
            let keeps_s = simd.greater_than_f64s(end_s, floor);
            // v = 0 fails: its kick is not positive
            let (keeps_s, v_gamma) = if PLAIN {
                (keeps_s, end_v)
            } else {
                let s_gamma = simd.add_f64s(from_s, simd.mul_f64s(gamma, change));
                let v_gamma = simd.add_f64s(from_v, simd.mul_f64s(gamma, kick));
                (simd.and_m64s(keeps_s, simd.greater_than_f64s(s_gamma, floor)), v_gamma)
            };
            let keeps_v = simd.or_m64s(inward, simd.greater_than_f64s(v_gamma, least_v[i]));
            let flies = simd.and_m64s(keeps_s, keeps_v);
            s[i] = simd.select_f64s(flies, end_s, from_s);
            v[i] = simd.select_f64s(flies, end_v, from_v);
            hard[i] = simd.select_f64s(flies, zero, busy[i]);
            any = simd.or_f64s(any, hard[i]);
        }
        simd.first_true_m64s(simd.greater_than_f64s(any, zero)) < S::F64_LANES
    }

    #[inline(always)]
    fn note_extremes<S: Simd>(&mut self, simd: S) {
        let zero = simd.splat_f64s(0.0);
        let (s, v) = (vectors(simd, &self.s), vectors(simd, &self.v));
        let [outward, inward] = self.r.each_ref().map(|lane| vectors(simd, lane));
        let x_max = vectors_mut(simd, &mut self.x_max);
        let speed_max = vectors_mut(simd, &mut self.speed_max);
        for i in 0..s.len() {
            let away = simd.greater_than_f64s(v[i], zero);
            let r = simd.select_f64s(away, outward[i], inward[i]);
            x_max[i] = simd.max_f64s(x_max[i], s[i]);
            speed_max[i] = simd.max_f64s(speed_max[i], simd.mul_f64s(r, simd.abs_f64s(v[i])));
        }
    }
}

/// A lane as the machine's vectors, of which [`WIDTH`] is a multiple.
#[inline(always)]
fn vectors<S: Simd>(_: S, lane: &Lane) -> &[S::f64s] {
    S::as_simd_f64s(lane).0
}

#[inline(always)]
fn vectors_mut<S: Simd>(_: S, lane: &mut Lane) -> &mut [S::f64s] {
    S::as_mut_simd_f64s(lane).0
}

/// Relative distance from a switch from which on a step is everyday without a closer look.
const MARGIN: f64 = 100.0 * SIGN_TOLERANCE;
/// States beyond it are looked at one by one.
const HUGE: f64 = 1e300;

impl BatchState {
    fn start(falling: Falling, z: Lifted, grid: Grid, save: Save<'_>) -> Result<Self, SetupError> {
        let Falling { step, initial, .. } = falling;
        let incoming = initial.arrives();
        let mut ledger = Self {
            falling,
            log: EventLog::start(grid.t(0), z, incoming, step.restitution()),
            sigma: transform::side(z, Branch::Positive.sigma()),
            status: Status::Completed,
            ended: None,
            saved: Saved::with_room(save.every(), grid)?,
        };
        if save.every() > 0 {
            ledger.sample(z);
        }
        Ok(ledger)
    }

    /// A step that is not everyday; `None` where there is none, and the mass stops.
    #[cold]
    #[inline(never)]
    fn step(&mut self, z: Lifted, h: f64, (t, t_next): (f64, f64)) -> Option<Lifted> {
        let Falling { step, force, .. } = self.falling;
        let step = if h == step.h() { step } else { step.with_h(h).ok()? };
        let found = if force.is_finite() {
            step.solve(z, force, self.sigma).map_err(|failure| match failure {
                StepFailure::NotFinite => Status::StateNotFinite,
                StepFailure::NoSolution => Status::StepNotSolved,
            })
        } else {
            Err(Status::ForceNotFinite)
        };
        let noted = found.and_then(|found| {
            let noted = self.log.step((t, z), (t_next, found.end()));
            noted.map(|()| found.end()).map_err(|_| Status::OutOfMemory)
        });
        match noted {
            Ok(end) => {
                self.sigma = transform::side(end, self.sigma);
                Some(end)
            }
            Err(status) => {
                (self.status, self.ended) = (status, Some(t));
                None
            }
        }
    }

    fn restitution(&self) -> Restitution {
        self.falling.step.restitution()
    }

    fn sample(&mut self, z: Lifted) {
        if self.ended.is_none() {
            let Physical { x, xdot } = transform::project(z, self.restitution());
            self.saved.push(x, xdot);
        }
    }

    fn finish(self, lanes: &Lanes, i: usize, end: f64, save: (Save<'_>, f64)) -> Outcome {
        let Physical { x, xdot } = transform::project(lanes.at(i, self.sigma), self.restitution());
        let (x_max, speed_max) = (lanes.x_max[i], lanes.speed_max[i]);
        let summary = Summary { t: self.ended.unwrap_or(end), x, xdot, x_max, speed_max };
        Outcome::new((self.log.finish(), &[]), self.saved, summary, (self.status, 1), save)
    }
}
