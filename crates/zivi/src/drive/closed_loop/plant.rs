//! The mass between two samples, under its force and the control that is held.

use crate::drive::closed_loop::record::LoopPath;
use crate::record::columns::Reserve;
use crate::record::events::{EventLog, EventReader};
use crate::record::status::Failure;
use crate::stepping::ballistic;
use crate::stepping::fixed_step::{FixedStep, Start};
use crate::stepping::step_solver::Exact;
use crate::stepping::theta_gamma::ThetaGammaStepper;
use crate::switched::Trace;
use crate::system::dynamics::finite_force;
use crate::{
    Dependence, Events, Force, Impact, Kick, LinearLaw, Occurrence, PathPoint, SetupError, Status,
    SwitchedIntegrator, SwitchedRk,
};
use zivi_core::control::regulation::RegulationStep;
use zivi_core::{transform, Branch, Lifted, Physical, Restitution, ThetaGammaStep};

/// A sampling period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Period {
    /// Its start (s).
    pub t: f64,
    /// Its end (s).
    pub t_next: f64,
    /// Its length (s).
    pub h: f64,
}

/// Something that moves a mass over a sampling period.
pub trait Plant<E> {
    /// Announces the step on which the control of the next period is based.
    fn expect(&mut self, _: Option<(RegulationStep, f64)>) {}

    /// The state at the end of the period that starts in `state` (the end of the last one), with
    /// the control `u` (m/s^2) held.
    ///
    /// # Errors
    /// Why there is no next state; the run ends at `t`.
    fn advance(&mut self, period: Period, state: Physical, u: f64) -> Result<Physical, Failure<E>>;

    /// The state at a time within the last period (after the impact at an impact time), for a plant
    /// that stores its motion.
    fn at(&self, t: f64) -> Physical;

    /// The impacts so far.
    fn impacts(&self) -> &[Impact];

    /// Events at the wall, after the end of the run.
    fn events(&mut self) -> Events;

    /// The motion of the whole run, once it is over, of a plant that keeps it.
    fn path(&mut self) -> LoopPath;

    /// Number of force evaluations so far.
    fn nfev(&self) -> u64;
}

/// The exact motion where the force does not depend on time or state.
pub(super) struct BallisticPlant<'a, F> {
    restitution: Restitution,
    force: &'a mut F,
    /// Its value, once it is known.
    value: Option<f64>,
    events: Events,
    /// Start of the last period, its state there and the acceleration in it.
    last: (f64, Physical, f64),
}

impl<'a, F> BallisticPlant<'a, F> {
    pub(super) fn new(
        restitution: Restitution,
        force: &'a mut F,
        t0: f64,
        initial: Physical,
    ) -> Self {
        let rests = initial.is_at_origin();
        let events = Events::starting(t0, rests);
        Self { restitution, force, value: None, events, last: (t0, initial, 0.0) }
    }
}

impl<E, F: Force<E>> Plant<E> for BallisticPlant<'_, F> {
    fn advance(
        &mut self,
        Period { t, h, .. }: Period,
        state: Physical,
        u: f64,
    ) -> Result<Physical, Failure<E>> {
        let own = match self.value {
            Some(value) => value,
            None => *self.value.insert(finite_force(self.force, t, state)?),
        };
        self.last = (t, state, own + u);
        Ok(ballistic::advance(state, own + u, self.restitution, (t, h), &mut self.events))
    }

    fn at(&self, time: f64) -> Physical {
        let (t, state, f) = self.last;
        ballistic::advance(state, f, self.restitution, (t, time - t), &mut Events::default())
    }

    fn impacts(&self) -> &[Impact] {
        &self.events.impacts
    }

    fn path(&mut self) -> LoopPath {
        LoopPath::Ballistic(self.value.unwrap_or(f64::NAN))
    }

    fn events(&mut self) -> Events {
        std::mem::take(&mut self.events)
    }

    fn nfev(&self) -> u64 {
        u64::from(self.value.is_some())
    }
}

/// High order between samples, for a force that depends on time or state.
pub(super) struct SwitchedPlant<'a, 'k, F, E> {
    integrator: SwitchedIntegrator,
    force: &'a mut F,
    reader: EventReader,
    /// The motion, if requested: of the last period or of the whole run.
    trace: Option<Trace>,
    all: bool,
    /// Times of future velocity jumps (s), and the velocities after them.
    kicks: Kicks<'k, E>,
}

/// Times of velocity jumps and the velocities after them, if any.
type Kicks<'k, E> = Option<(&'k [f64], Kick<'k, E, PathPoint>)>;

impl<'a, 'k, F: Force<E>, E> SwitchedPlant<'a, 'k, F, E> {
    pub(super) fn new(
        settings: SwitchedRk,
        restitution: Restitution,
        force: &'a mut F,
        (t0, initial): (f64, Physical),
        (keep, kicks): (StoredMotion, Kicks<'k, E>),
    ) -> Result<Self, SetupError> {
        let mut integrator = SwitchedIntegrator::new(settings, restitution)?;
        integrator.start(t0, initial)?;
        let rests = initial.is_at_origin();
        let reader = EventReader::starting(t0, rests);
        let trace = (keep != StoredMotion::Nothing).then(Trace::default);
        let all = keep == StoredMotion::Everything;
        Ok(Self { integrator, force, reader, trace, all, kicks })
    }

    /// The state at `t_next` from that at `t`, without velocity jumps between them.
    fn move_on(
        &mut self,
        (t, t_next): (f64, f64),
        state: Physical,
        u: f64,
    ) -> Result<Physical, Failure<E>> {
        // the control or the velocity jumps: nothing that was learnt from the force holds any longer
        let Ok(()) = self.integrator.start_again(t, state) else {
            return Err(Failure::Status(Status::StateNotFinite));
        };
        let Self { integrator, force, reader, trace, .. } = self;
        let mut net = Net { force: &mut **force, u };
        let note = |seen| reader.note(seen);
        match trace {
            Some(trace) => integrator.trace_to(t_next, &mut net, trace, note)?,
            None => integrator.observe_to(t_next, &mut net, note)?,
        }
        Ok(integrator.state())
    }

    /// The time of the next velocity jump before `t`.
    fn next_kick(&mut self, t: f64) -> Option<f64> {
        let (times, _) = self.kicks.as_mut()?;
        let (&first, later) = times.split_first().filter(|(first, _)| **first < t)?;
        *times = later;
        Some(first)
    }

    /// The state after a velocity jump at a time.
    fn kicked(&mut self, t: f64, state: Physical) -> Result<Physical, Failure<E>> {
        let Some((_, kick)) = &mut self.kicks else { return Ok(state) };
        let Physical { x, xdot } = state;
        let mut after = PathPoint { x, xdot, sigma: self.integrator.sigma() };
        kick(t, &mut after).map_err(Failure::Raised)?;
        if self.integrator.is_at_rest() && after.xdot != 0.0 {
            self.reader.note(Occurrence::Opened { t, gap: 0 });
        }
        Ok(Physical { x, xdot: after.xdot })
    }
}

/// Storage of the motion between the samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum StoredMotion {
    /// Nothing.
    Nothing,
    /// That of the last period.
    Period,
    /// All of it.
    Everything,
}

impl<E, F: Force<E>> Plant<E> for SwitchedPlant<'_, '_, F, E> {
    fn advance(
        &mut self,
        Period { t, t_next, .. }: Period,
        state: Physical,
        u: f64,
    ) -> Result<Physical, Failure<E>> {
        if let (Some(trace), false) = (&mut self.trace, self.all) {
            trace.clear();
        }
        let (mut from, mut state) = (t, state);
        while let Some(at) = self.next_kick(t_next) {
            if at > from {
                state = self.move_on((from, at), state, u)?;
                from = at;
            }
            state = self.kicked(at, state)?;
        }
        self.move_on((from, t_next), state, u)
    }

    fn at(&self, t: f64) -> Physical {
        let point = self.trace.as_ref().and_then(|trace| trace.path().at(t));
        point.map_or(self.integrator.state(), |it| Physical { x: it.x, xdot: it.xdot })
    }

    fn impacts(&self) -> &[Impact] {
        &self.reader.events.impacts
    }

    fn path(&mut self) -> LoopPath {
        LoopPath::Switched(self.trace.take().unwrap_or_default().into_path())
    }

    fn events(&mut self) -> Events {
        std::mem::take(&mut self.reader.events)
    }

    fn nfev(&self) -> u64 {
        self.integrator.counts().nfev
    }
}

/// The paper's loop: the plant on the controller's grid, by the implicit theta-gamma scheme.
pub(super) struct SchemePlant<'a, F> {
    stepper: ThetaGammaStepper<Exact>,
    implicit: bool,
    /// The step that the controller planned, and its force.
    planned: Option<(RegulationStep, f64)>,
    force: &'a mut F,
    /// Number of evaluations for the plan.
    asked: u64,
    restitution: Restitution,
    h: f64,
    z: Lifted,
    sigma: f64,
    log: EventLog,
    /// The ends of the last step.
    last: [(f64, Lifted); 2],
    /// All states, if requested.
    states: Option<Vec<Lifted>>,
    reserve: Reserve,
}

impl<'a, F> SchemePlant<'a, F> {
    pub(super) fn new(
        step: ThetaGammaStep,
        force: &'a mut F,
        (t0, initial): (f64, Physical),
        keep: StoredMotion,
    ) -> Self {
        let restitution = step.restitution();
        let z = transform::lift(initial, Branch::Positive, restitution);
        let incoming = initial.arrives();
        let sigma = transform::side(z, Branch::Positive.sigma());
        let log = EventLog::start(t0, z, incoming, restitution);
        let stepper = ThetaGammaStepper::new(step, Exact);
        let implicit = step.theta() == 1.0 && step.gamma() == 1.0;
        let (planned, asked) = (None, 0);
        let (last, reserve) = ([(t0, z); 2], Reserve::default());
        let states = (keep == StoredMotion::Everything).then(|| vec![z]);
        let h = step.h();
        Self {
            stepper,
            implicit,
            planned,
            force,
            asked,
            restitution,
            h,
            z,
            sigma,
            log,
            last,
            states,
            reserve,
        }
    }

    /// The end of the controller's own step, if it knows the force and the wall: at a step that
    /// ends on the wall the force that the control makes there is `lv`'s whole, not `ls lv`.
    fn as_planned<E>(&mut self, h: f64) -> Result<Option<Lifted>, Failure<E>>
    where
        F: Force<E>,
    {
        let Some((step, force)) = self.planned.take().filter(|_| self.implicit) else {
            return Ok(None);
        };
        if self.force.dependence() != Dependence::Constant {
            return Ok(None);
        }
        self.asked += 1;
        let true_force = finite_force(self.force, 0.0, Physical::default())?;
        // the same wall, given by `e` here and by `kappa` there
        let walls = step.restitution.e() - self.restitution.e();
        let known = true_force == force && step.h == h && walls.abs() <= 4.0 * f64::EPSILON;
        // on the side of the sample that the controller had
        let mirror = |z: Lifted| Lifted { s: self.sigma * z.s, v: self.sigma * z.v };
        Ok(known.then(|| mirror(step.solve(mirror(self.z), force).end)))
    }
}

/// A force with the control added.
struct Net<'a, F> {
    force: &'a mut F,
    u: f64,
}

impl<E, F: Force<E>> Force<E> for Net<'_, F> {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        Ok(self.force.at(t, x, xdot)? + self.u)
    }

    fn dependence(&self) -> Dependence {
        // constant over a period, but not over the run
        match self.force.dependence() {
            Dependence::Constant => Dependence::Time,
            other => other,
        }
    }

    fn linear(&self) -> Option<LinearLaw> {
        let law = self.force.linear()?;
        Some(LinearLaw { gravity: law.gravity - self.u, ..law })
    }
}

impl<E, F: Force<E>> Plant<E> for SchemePlant<'_, F> {
    fn expect(&mut self, planned: Option<(RegulationStep, f64)>) {
        self.planned = planned;
    }

    fn advance(
        &mut self,
        Period { t, t_next, h }: Period,
        _: Physical,
        u: f64,
    ) -> Result<Physical, Failure<E>> {
        if h != self.h {
            FixedStep::<E, Net<'_, F>>::resize(&mut self.stepper, h);
            self.h = h;
        }
        let next = match self.as_planned(h)? {
            Some(next) => next,
            None => {
                let net = &mut Net { force: &mut *self.force, u };
                let start = Start { t, z: self.z, sigma: self.sigma };
                self.stepper.advance(start, net)?.z
            }
        };
        self.log.step((t, self.z), (t_next, next))?;
        self.sigma = transform::side(next, self.sigma);
        self.last = [(t, self.z), (t_next, next)];
        if let Some(states) = &mut self.states {
            self.reserve.room(states, 1, size_of::<Lifted>())?;
            states.push(next);
        }
        self.z = next;
        Ok(transform::project(next, self.restitution))
    }

    fn at(&self, t: f64) -> Physical {
        let [(from, start), (to, end)] = self.last;
        let part = (t - from) / (to - from);
        let z =
            Lifted { s: start.s + part * (end.s - start.s), v: start.v + part * (end.v - start.v) };
        transform::project(z, self.restitution)
    }

    fn impacts(&self) -> &[Impact] {
        self.log.impacts()
    }

    fn path(&mut self) -> LoopPath {
        LoopPath::Lifted(self.states.take().unwrap_or_default())
    }

    fn events(&mut self) -> Events {
        let empty = EventLog::start(0.0, Lifted { s: 1.0, v: 0.0 }, false, self.restitution);
        std::mem::replace(&mut self.log, empty).finish()
    }

    fn nfev(&self) -> u64 {
        FixedStep::<E, F>::nfev(&self.stepper) + self.asked
    }
}

// Measurement of the state: noise, then quantisation.

/// The measurement of the state.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sensor<'a> {
    /// Added to `x` at each sample (m); none if empty.
    pub noise_x: &'a [f64],
    /// Added to `x'` at each sample (m/s); none if empty.
    pub noise_xdot: &'a [f64],
    /// Resolution of the position and of the velocity (m, m/s); `0` is exact.
    pub resolution: (f64, f64),
}

impl Sensor<'_> {
    /// The measurement of the state at the `k`-th sample.
    #[must_use]
    pub fn measure(&self, k: usize, state: Physical) -> Physical {
        let noise = |values: &[f64]| values.get(k).copied().unwrap_or(0.0);
        Physical {
            x: rounded(state.x + noise(self.noise_x), self.resolution.0),
            xdot: rounded(state.xdot + noise(self.noise_xdot), self.resolution.1),
        }
    }
}

/// The nearest multiple of `resolution`.
fn rounded(value: f64, resolution: f64) -> f64 {
    if resolution > 0.0 {
        (value / resolution).round() * resolution
    } else {
        value
    }
}
