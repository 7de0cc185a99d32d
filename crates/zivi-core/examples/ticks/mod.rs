//! Updates to be counted or timed, each with its controller in the state in which it meets a sample.
#![allow(dead_code)] // each example uses a part

#[path = "../../tests/steps/common/mod.rs"]
mod common;

use common::control::{random_wall, signed, stable};
pub(crate) use common::Rng;
use zivi_core::control::tracking::{Target, Tracking};
use zivi_core::control::{
    Approach, ExplicitTwisting, Gains, TrackerState, TwistingRegulator, TwistingTracker,
};
use zivi_core::observer::{ImpactObserver, Measurement, ObserverSettings};
use zivi_core::{transform, Branch, Lifted, Physical, Restitution, SettingError, ThetaGammaStep};

pub(crate) type Failure = Box<dyn std::error::Error>;

/// A controller in the state in which it meets a sample.
#[derive(Clone, Copy)]
pub(crate) struct Tick<C> {
    controller: C,
    measured: Physical,
    force: f64,
    force_ref: f64,
}

pub(crate) trait Controller: Copy {
    fn tick(&mut self, measured: Physical, f: f64, f_ref: f64) -> Result<f64, SettingError>;
}

impl Controller for TwistingTracker {
    #[inline(always)]
    fn tick(&mut self, measured: Physical, f: f64, f_ref: f64) -> Result<f64, SettingError> {
        TwistingTracker::tick(self, measured, f, f_ref)
    }
}

impl Controller for ExplicitTwisting {
    #[inline(always)]
    fn tick(&mut self, measured: Physical, f: f64, f_ref: f64) -> Result<f64, SettingError> {
        ExplicitTwisting::tick(self, measured, f, f_ref)
    }
}

impl Controller for TwistingRegulator {
    #[inline(always)]
    fn tick(&mut self, measured: Physical, f: f64, _: f64) -> Result<f64, SettingError> {
        TwistingRegulator::tick(self, measured, f)
    }
}

/// An observer, whose control is the last argument and whose answer is the unknown force.
impl Controller for ImpactObserver {
    #[inline(always)]
    fn tick(&mut self, measured: Physical, f: f64, u: f64) -> Result<f64, SettingError> {
        let measured = Measurement { x: measured.x, xdot: Some(measured.xdot) };
        Ok(ImpactObserver::tick(self, measured, f, u)?.d)
    }
}

/// Every update of an observer of the paper's loop.
pub(crate) fn observed(
    tracker: TwistingTracker,
    count: usize,
) -> Result<Vec<Tick<ImpactObserver>>, Failure> {
    let settings = ObserverSettings::new(tracker.step().restitution, H)?;
    let mut observer = ImpactObserver::new(settings);
    let mut ticks = Vec::with_capacity(count);
    let mut u = 0.0;
    for it in closed_loop(tracker, count)? {
        let Tick { mut controller, measured, force, force_ref } = it;
        ticks.push(Tick { controller: observer, measured, force, force_ref: u });
        Controller::tick(&mut observer, measured, force, u)?;
        u = controller.tick(measured, force, force_ref)?;
    }
    Ok(ticks)
}

#[inline(never)]
pub(crate) fn one_tick<C: Controller>(it: &mut Tick<C>) -> Result<f64, SettingError> {
    it.controller.tick(it.measured, it.force, it.force_ref)
}

/// The paper's closed loop: every update's controller and sample.
pub(crate) fn closed_loop<C: Controller>(
    mut controller: C,
    count: usize,
) -> Result<Vec<Tick<C>>, Failure> {
    let restitution = Restitution::from_kappa(0.5)?;
    let plant = ThetaGammaStep::new(H, 1.0, 1.0, restitution)?;
    let (force, force_ref) = (-9.81, -19.81);
    let mut z = transform::lift(Physical { x: 6.0, xdot: 5.0 }, Branch::Positive, restitution);
    let mut side = 1.0;
    let mut ticks = Vec::with_capacity(count);
    for _ in 0..count {
        let measured = transform::project(z, restitution);
        ticks.push(Tick { controller, measured, force, force_ref });
        let u = controller.tick(measured, force, force_ref)?;
        z = plant.solve(z, force + u, side).map_err(|it| format!("{it:?}"))?.end();
        side = transform::side(z, side);
    }
    Ok(ticks)
}

pub(crate) const H: f64 = 1e-3;

pub(crate) fn of_the_paper(approach: Approach) -> Result<TwistingTracker, Failure> {
    let restitution = Restitution::from_kappa(0.5)?;
    let gains = Gains::new(30.0, 17.0)?;
    let mut tracker = TwistingTracker::new(gains, H, restitution, restitution, approach)?;
    tracker.reset(Physical { x: 3.0, xdot: 3.0 })?;
    Ok(tracker)
}

/// Plant and reference anywhere (`wide`), within some steps of the wall and of each other (`near`),
/// or the plant about to cross the wall (`crossing`).
pub(crate) fn drawn(kind: &str, rng: &Rng) -> Result<Tick<TwistingTracker>, Failure> {
    let (gains, force) = stable(rng);
    let restitution = random_wall(rng);
    let h = rng.log_between(1e-5, 1e-1);
    let mut controller =
        TwistingTracker::new(gains, h, restitution, restitution, Approach::Nearest)?;
    let reach = h * gains.mu1();
    let (measured, reference) = match kind {
        "wide" => {
            let state = || Lifted { s: signed(rng, 1e-12, 1e3), v: signed(rng, 1e-12, 1e3) };
            (state(), state())
        }
        "near" => {
            let small = |unit: f64| unit * signed(rng, 1e-4, 10.0);
            let z = Lifted { s: small(h * reach), v: small(reach) };
            (z, Lifted { s: z.s + small(h * reach), v: z.v + small(reach) })
        }
        "crossing" => {
            let v = signed(rng, 1e-3, 1e2);
            let z = Lifted { s: -v * h * rng.between(0.0, 2.0), v };
            (z, Lifted { s: v * h * rng.between(-2.0, 2.0), v: v * rng.between(-1.5, 1.5) })
        }
        _ => return Err("unknown case".into()),
    };
    controller.set_state(TrackerState { reference, ..controller.state() });
    let measured = transform::project(measured, restitution);
    Ok(Tick { controller, measured, force, force_ref: -rng.log_between(1e-3, 1e2) })
}

/// How often the plant's step iterates in this update.
fn iterations(it: &Tick<TwistingTracker>) -> Result<u32, Failure> {
    let (step, reference) = (it.controller.step(), it.controller.state().reference);
    let solved = it.controller.reference_step().solve(reference, it.force_ref, 1.0);
    let next = solved.map_err(|failure| format!("{failure:?}"))?;
    let r = it.controller.reference_step().restitution().r(next.lambda_s, next.lambda_v);
    let target = Target { end: next.end(), acceleration: next.lambda_s * it.force_ref / r };
    let branches = [Branch::Positive, Branch::Negative];
    let near = |z: &Lifted| z.s * reference.s + z.v * reference.v >= 0.0;
    let lifted = branches.map(|branch| transform::lift(it.measured, branch, step.restitution));
    let z = lifted.into_iter().find(near).ok_or("no branch")?;
    let Tracking { iterations, .. } = step.solve(z, it.force, target);
    Ok(iterations)
}

/// Of many draws of all kinds those that iterate most.
pub(crate) fn hard(count: usize, rng: &Rng) -> Result<Vec<Tick<TwistingTracker>>, Failure> {
    let mut all = Vec::new();
    for kind in ["wide", "near", "crossing"] {
        for _ in 0..200_000 {
            let it = drawn(kind, rng)?;
            all.push((iterations(&it)?, it));
        }
        all.sort_by_key(|(iterations, _)| std::cmp::Reverse(*iterations));
        all.truncate(count);
    }
    println!("{} iterations and less", all[0].0);
    Ok(all.into_iter().map(|(_, it)| it).collect())
}
