//! The mass between two samples, under its force and the control that is held.

use zivi_core::{transform, Branch, Lifted, Physical, Restitution, ThetaGammaStep};

use crate::record::events::EventLog;
use crate::record::failure::Failure;
use crate::stepping::ballistic;
use crate::stepping::fixed_step::{FixedStep, Start};
use crate::stepping::step_solver::Exact;
use crate::stepping::theta_gamma::Stepper;
use crate::system::evaluation::finite_force;
use crate::{
    Dependence, Events, Force, Occurrence, SetupError, Status, SwitchedIntegrator, SwitchedRk,
};

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
    /// The state at the end of the period that starts in `state` (the end of the last one), with
    /// the control `u` (m/s^2) held.
    ///
    /// # Errors
    /// Why there is no next state; the run ends at `t`.
    fn advance(&mut self, period: Period, state: Physical, u: f64) -> Result<Physical, Failure<E>>;

    /// What happened at the wall so far.
    fn events(&mut self) -> Events;

    /// Number of force evaluations so far.
    fn nfev(&self) -> u64;
}

/// The exact motion where the force does not depend on time or state.
pub(super) struct BallisticPlant<'a, F> {
    wall: Restitution,
    force: &'a mut F,
    /// Its value, once it is known.
    value: Option<f64>,
    events: Events,
}

impl<'a, F> BallisticPlant<'a, F> {
    pub(super) fn new(wall: Restitution, force: &'a mut F, t0: f64, initial: Physical) -> Self {
        let rests = initial == Physical::default();
        let events = Events { rest_time: rests.then_some(t0), ..Events::default() };
        Self { wall, force, value: None, events }
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
        Ok(ballistic::advance(state, own + u, self.wall, (t, h), &mut self.events))
    }

    fn events(&mut self) -> Events {
        std::mem::take(&mut self.events)
    }

    fn nfev(&self) -> u64 {
        u64::from(self.value.is_some())
    }
}

/// High order between samples, for a force that depends on time or state.
pub(super) struct SwitchedPlant<'a, F> {
    integrator: SwitchedIntegrator,
    force: &'a mut F,
    events: Events,
    /// Impacts when the mass was last at rest.
    impacts_before: usize,
}

impl<'a, F> SwitchedPlant<'a, F> {
    pub(super) fn new(
        settings: SwitchedRk,
        wall: Restitution,
        force: &'a mut F,
        (t0, initial): (f64, Physical),
    ) -> Result<Self, SetupError> {
        let mut integrator = SwitchedIntegrator::new(settings, wall)?;
        integrator.start(t0, initial)?;
        let rests = initial == Physical::default();
        let events = Events { rest_time: rests.then_some(t0), ..Events::default() };
        Ok(Self { integrator, force, events, impacts_before: 0 })
    }
}

impl Events {
    /// Notes what the switched method saw; `impacts_before` is how many impacts there were when
    /// the mass was last at rest.
    fn note(&mut self, occurrence: Occurrence, impacts_before: &mut usize) {
        match occurrence {
            Occurrence::Impact(impact) => self.impacts.push(impact),
            Occurrence::Rest(t) => {
                if self.rest_time.is_none() {
                    if self.impacts.len() > *impacts_before {
                        self.zeno_times.push(t);
                    }
                    self.rest_time = Some(t);
                }
            }
            Occurrence::LiftOff(t) => {
                if self.rest_time.take().is_some() {
                    self.liftoff_times.push(t);
                }
                *impacts_before = self.impacts.len();
            }
        }
    }
}

impl<E, F: Force<E>> Plant<E> for SwitchedPlant<'_, F> {
    fn advance(
        &mut self,
        Period { t, t_next, .. }: Period,
        state: Physical,
        u: f64,
    ) -> Result<Physical, Failure<E>> {
        // the control jumps: nothing that was learnt from the force holds any longer
        let Ok(()) = self.integrator.start(t, state) else {
            return Err(Failure::Status(Status::StateNotFinite));
        };
        let Self { integrator, force, events, impacts_before } = self;
        let mut net = Net { force: &mut **force, u };
        integrator.observe_to(t_next, &mut net, |seen| events.note(seen, impacts_before))?;
        Ok(integrator.state())
    }

    fn events(&mut self) -> Events {
        std::mem::take(&mut self.events)
    }

    fn nfev(&self) -> u64 {
        self.integrator.counts().nfev
    }
}

/// The paper's loop: the plant on the controller's grid, by the implicit theta-gamma scheme.
pub(super) struct SchemePlant<'a, F> {
    stepper: Stepper<Exact>,
    force: &'a mut F,
    wall: Restitution,
    h: f64,
    z: Lifted,
    side: f64,
    log: EventLog,
}

impl<'a, F> SchemePlant<'a, F> {
    pub(super) fn new(step: ThetaGammaStep, force: &'a mut F, t0: f64, initial: Physical) -> Self {
        let wall = step.wall();
        let z = transform::lift(initial, Branch::Positive, wall);
        let incoming = initial.x == 0.0 && initial.xdot < 0.0;
        let side = transform::side(z, Branch::Positive.sigma());
        let log = EventLog::start(t0, z, incoming, wall);
        let stepper = Stepper::new(step, Exact);
        Self { stepper, force, wall, h: step.h(), z, side, log }
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
}

impl<E, F: Force<E>> Plant<E> for SchemePlant<'_, F> {
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
        let net = &mut Net { force: &mut *self.force, u };
        let start = Start { t, z: self.z, side: self.side };
        let next = self.stepper.advance(start, net)?.z;
        self.log.step((t, self.z), (t_next, next))?;
        self.side = transform::side(next, self.side);
        self.z = next;
        Ok(transform::project(next, self.wall))
    }

    fn events(&mut self) -> Events {
        let empty = EventLog::start(0.0, Lifted { s: 1.0, v: 0.0 }, false, self.wall);
        std::mem::replace(&mut self.log, empty).finish()
    }

    fn nfev(&self) -> u64 {
        FixedStep::<E, F>::nfev(&self.stepper)
    }
}
