//! A mechanical system under a control that is sampled and held: one run whose forces change at the
//! samples.

use super::integrator::MechanicalIntegrator;
use super::kinetics::Model;
use super::recording::running;
use crate::mechanics::recording::{
    check_friction, check_sizes, check_span, started, MechanicalOutput, MechanicalRun,
    MechanicalSamples,
};
use crate::piecewise::steps::Driver;
use crate::record::gap_set::ContactMode;
use crate::record::status::Failure;
use crate::switched::SwitchedRk;
use crate::system::dynamics::{Driven, Dynamics, Layout};
use crate::{AnyImpactLaw, Kick, Monitor, MotionPoint, SetupError};

/// Sampling times of a control, and other times at which the forces are not smooth.
#[derive(Clone, Copy, Debug)]
pub struct Sampling<'a> {
    /// Times of the samples, from the start to the end of the run (s).
    pub times: &'a [f64],
    /// These and all others at which the forces are not smooth, increasing (s).
    pub stops: &'a [f64],
}

/// The samples of a loop: state, contact forces under the control that begins there, control.
#[derive(Default)]
struct LoopSamples {
    motion: MechanicalSamples,
    u: Vec<f64>,
}

/// A sampled controller: the control at sample `k` for time, coordinates and velocities.
pub trait Ticks<E> {
    /// Writes the control into `u`.
    ///
    /// # Errors
    /// Whatever ends the run.
    fn tick(&mut self, k: usize, t: f64, state: (&[f64], &[f64]), u: &mut [f64]) -> Result<(), E>;
}

impl<E, T> Ticks<E> for T
where
    T: FnMut(usize, f64, (&[f64], &[f64]), &mut [f64]) -> Result<(), E>,
{
    fn tick(&mut self, k: usize, t: f64, state: (&[f64], &[f64]), u: &mut [f64]) -> Result<(), E> {
        self(k, t, state, u)
    }
}

/// Takes the pieces of a run as they come, and changes the control at the samples.
struct Held<'a, C> {
    ticks: &'a mut C,
    times: &'a [f64],
    /// Samples so far.
    k: usize,
    u: Vec<f64>,
    samples: LoopSamples,
}

impl<C> Held<'_, C> {
    /// A sample at the present state, with the contact forces of the control that is held.
    fn sample<E, D: Dynamics<E>, F>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        model: &mut Model<'_, Driven<D, F>>,
    ) -> Result<(), Failure<E>>
    where
        Driven<D, F>: Dynamics<E>,
    {
        let (t, layout) = (machine.state().now().t, machine.state().layout());
        let pending = machine.is_pending(t);
        if !pending {
            machine.state_mut().prepare(model)?;
        }
        let state = machine.state();
        let none = vec![0.0; layout.forces()];
        let lambda = if pending { &none } else { state.lambda() };
        let (now, mode) = (state.now(), state.mode());
        let (lambda, mode) = pressed(layout, lambda, mode);
        self.samples.motion.push(t, (&now.x, &now.xdot), &lambda, mode);
        self.samples.u.extend_from_slice(&self.u);
        Ok(())
    }
}

/// Contact forces and contacts from here on: a gap that is pulled opens.
fn pressed(layout: Layout, lambda: &[f64], mode: ContactMode) -> (Vec<f64>, ContactMode) {
    let mut lambda = lambda.to_vec();
    let closed = mode.closed.iter().filter(|&i| lambda[i] >= 0.0).collect();
    lambda[..layout.m].iter_mut().for_each(|it| *it = it.max(0.0));
    (lambda, ContactMode { closed, ..mode })
}

impl<'f, E, D, F, C> Driver<MechanicalIntegrator, Model<'f, Driven<D, F>>, E> for Held<'_, C>
where
    D: Dynamics<E>,
    Driven<D, F>: Dynamics<E>,
    C: Ticks<E>,
{
    fn step(
        &mut self,
        machine: &mut MechanicalIntegrator,
        t_end: f64,
        model: &mut Model<'f, Driven<D, F>>,
    ) -> Result<super::path::Piece, Failure<E>> {
        machine.advance(t_end, model)
    }

    fn enter(
        &mut self,
        machine: &mut MechanicalIntegrator,
        model: &mut Model<'f, Driven<D, F>>,
    ) -> Result<(), Failure<E>> {
        let now = machine.state().now();
        if !self.times.get(self.k).is_some_and(|&t| now.t >= t) {
            return Ok(()); // the forces have a break of their own here
        }
        let n = machine.state().layout().n;
        let state = (&now.x[..n], &now.xdot[..n]);
        self.ticks.tick(self.k, now.t, state, &mut self.u).map_err(Failure::Raised)?;
        self.k += 1;
        model.dynamics.hold(&self.u);
        self.sample(machine, model)
    }
}

/// Simulates a mechanical system by the switched Runge-Kutta method under a control that changes at
/// the samples; `u` is the control from the start on, the ticks begin with the next sample.
///
/// The samples of the run are those of the loop, with the contact forces under the control that begins
/// there. A kick at a sample follows it. Beside the run its controls, `r` numbers a sample; the last is repeated at the end.
///
/// # Errors
/// [`SetupError`] before anything is computed, for settings, sizes or a start out of range.
pub fn simulate_mechanical_loop<E, D, F>(
    settings: SwitchedRk,
    system: (&mut Driven<D, F>, &[AnyImpactLaw]),
    sampling: Sampling<'_>,
    (q, w): (&[f64], &[f64]),
    (u, ticks): (&[f64], &mut impl Ticks<E>),
    (dense, kicks): (bool, Option<Kick<'_, E, MotionPoint>>),
    monitor: &mut impl Monitor<E>,
) -> Result<(MechanicalRun<E>, Vec<f64>), SetupError>
where
    D: Dynamics<E>,
    Driven<D, F>: Dynamics<E>,
{
    let settings = settings.validated()?;
    let (driven, laws) = system;
    let layout = Dynamics::<E>::layout(driven);
    let [t0, .., t1] = *sampling.times else {
        return Err(SetupError::Count("times", sampling.times.len(), "at least 2"));
    };
    check_sizes(layout, laws.len(), q, w)?;
    check_span(t0, t1)?;
    if u.len() != driven.control().len() {
        return Err(SetupError::Count("u", u.len(), "one number for each input"));
    }
    let friction = Dynamics::<E>::friction(driven).clone();
    check_friction(layout, &friction)?;
    driven.hold(u);
    let mut model = Model::new(driven);
    let mut machine = MechanicalIntegrator::new(settings, layout, laws, &friction);
    let begun = started(machine.start(t0, (q, w), &mut model))?;
    let samples = LoopSamples::default();
    let mut held = Held { ticks, times: sampling.times, k: 1, u: u.to_vec(), samples };
    let begun = match begun {
        Ok(()) => held.sample(&mut machine, &mut model),
        failed => failed,
    };
    let output = MechanicalOutput {
        t_eval: Some(&[]),
        tstops: sampling.stops,
        dense,
        kicks,
        ..MechanicalOutput::default()
    };
    let mut running = running(machine, t1, output);
    let ending = match begun {
        Err(failure) => failure.into(),
        Ok(()) => running.go(&mut held, &mut model, monitor),
    };
    if running.method.state().now().t >= t1 {
        // the last control is repeated; where the forces there fail, the run is what it is
        let _: Result<(), Failure<E>> = held.sample(&mut running.method, &mut model);
    }
    let LoopSamples { motion, u } = held.samples;
    let run = running.finish(ending, model.count);
    Ok((MechanicalRun { samples: motion, ..run }, u))
}
