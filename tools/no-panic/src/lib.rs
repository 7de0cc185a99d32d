//! Everything that a controller calls on a target, with arguments that the optimiser cannot see.
//!
//! The panic handler calls a function that exists nowhere. The linker asks for it exactly when
//! optimised code still holds a path to a panic, so a library that links cannot panic.

#![no_std]

use zivi_core::control::{
    Approach, ExplicitTwisting, Gains, Landing, Port, RegulatorState, TrackerState,
    TwistingRegulator, TwistingTracker, Waypoint,
};
use zivi_core::observer::{Estimate, ImpactObserver, Measurement, ObserverSettings, ObserverState};
use zivi_core::{transform, Branch, Lifted, Physical, Restitution, StepSolution, ThetaGammaStep};

extern "C" {
    fn zivi_panic_is_reachable() -> !;
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    // SAFETY: it is never called; a library in which it could be does not link
    unsafe { zivi_panic_is_reachable() }
}

/// Writes a result and says whether there was one.
fn put<T, E>(to: &mut T, result: Result<T, E>) -> bool {
    result.map(|value| *to = value).is_ok()
}

fn walls(e: f64, e_ref: f64) -> Option<(Restitution, Restitution)> {
    Some((Restitution::from_e(e).ok()?, Restitution::from_kappa(e_ref).ok()?))
}

fn gains(mu1: f64, mu2: f64, bound: f64, wall: Restitution) -> Option<Gains> {
    Gains::for_tracking(mu1, mu2, bound, wall)
        .or_else(|_| Gains::for_regulation(mu1, mu2, bound, wall))
        .ok()
        .or_else(|| Gains::new(mu1, mu2).ok())
}

#[no_mangle]
pub extern "C" fn zivi_port(to: &mut Port, depth: f64, low: f64, high: f64) -> bool {
    put(to, Port::default().with_depth(depth).and_then(|it| it.with_actuator(low, high)))
}

#[no_mangle]
pub extern "C" fn zivi_regulator(
    to: &mut TwistingRegulator,
    [mu1, mu2, bound, h, e]: &[f64; 5],
    port: &Port,
    ahead: u32,
) -> bool {
    let Ok(wall) = Restitution::from_e(*e) else { return false };
    let Some(gains) = gains(*mu1, *mu2, *bound, wall) else { return false };
    let landing = Landing::new(ahead, *h).ok();
    let regulator = TwistingRegulator::new(gains, *h, wall);
    put(to, regulator.map(|it| it.with_landing(landing).with_port(*port)))
}

#[no_mangle]
pub extern "C" fn zivi_regulator_tick(
    it: &mut TwistingRegulator,
    x: f64,
    xdot: f64,
    force: f64,
    u: &mut f64,
) -> bool {
    put(u, it.tick(Physical { x, xdot }, force))
}

#[no_mangle]
pub extern "C" fn zivi_regulator_restore(it: &mut TwistingRegulator, state: &RegulatorState) {
    it.set_state(*state);
}

#[no_mangle]
pub extern "C" fn zivi_tracker(
    to: &mut TwistingTracker,
    [mu1, mu2, bound, h, e, e_ref]: &[f64; 6],
    port: &Port,
    nearest: bool,
    [press, horizon]: &[f64; 2],
    ahead: u32,
) -> bool {
    let Some((wall, wall_ref)) = walls(*e, *e_ref) else { return false };
    let Some(gains) = gains(*mu1, *mu2, *bound, wall) else { return false };
    let approach = if nearest { Approach::Nearest } else { Approach::Positive };
    let landing = Landing::new(ahead, *h).ok();
    let tracker = TwistingTracker::new(gains, *h, wall, wall_ref, approach)
        .map(|it| it.with_landing(landing).with_port(*port).with_shift(nearest))
        .and_then(|it| it.with_horizon(*horizon));
    let Ok(tracker) = tracker else { return false };
    put(to, tracker.with_press(*press, *bound))
}

#[no_mangle]
pub extern "C" fn zivi_tracker_tick_to(
    it: &mut TwistingTracker,
    measured: &Physical,
    [force, acceleration]: &[f64; 2],
    [now, next]: &[Waypoint; 2],
    u: &mut f64,
) -> bool {
    let acceleration = (!acceleration.is_nan()).then_some(*acceleration);
    put(u, it.tick_to(*measured, *force, *now, *next, acceleration))
}

#[no_mangle]
pub extern "C" fn zivi_observer(
    to: &mut ImpactObserver,
    [e, h, x, xdot, q_d, se, dmax]: &[f64; 7],
) -> bool {
    let Ok(wall) = Restitution::from_e(*e) else { return false };
    let settings = ObserverSettings::new(wall, *h)
        .and_then(|it| it.with_noise(*x, *xdot))
        .and_then(|it| it.with_force(*q_d, *dmax))
        .and_then(|it| it.with_restitution_error(*se));
    put(to, settings.map(ImpactObserver::new))
}

#[no_mangle]
pub extern "C" fn zivi_observer_tick(
    it: &mut ImpactObserver,
    dt: f64,
    measured: &Option<Measurement>,
    [force, u]: &[f64; 2],
    to: &mut Estimate,
) -> bool {
    put(to, it.tick_after(dt, *measured, *force, *u))
}

#[no_mangle]
pub extern "C" fn zivi_observer_restore(it: &mut ImpactObserver, state: &ObserverState) {
    it.reset();
    it.set_state(*state);
}

#[no_mangle]
pub extern "C" fn zivi_tracker_reset(it: &mut TwistingTracker, x: f64, xdot: f64) -> bool {
    it.reset(Physical { x, xdot }).is_ok()
}

#[no_mangle]
pub extern "C" fn zivi_tracker_tick(
    it: &mut TwistingTracker,
    x: f64,
    xdot: f64,
    force: f64,
    force_ref: f64,
    u: &mut f64,
) -> bool {
    put(u, it.tick(Physical { x, xdot }, force, force_ref))
}

#[no_mangle]
pub extern "C" fn zivi_tracker_restore(
    it: &mut TwistingTracker,
    state: &TrackerState,
    reference: &mut Physical,
) {
    it.set_state(*state);
    *reference = it.reference();
}

#[no_mangle]
pub extern "C" fn zivi_explicit(
    to: &mut ExplicitTwisting,
    [mu1, mu2, bound, h, e, e_ref]: &[f64; 6],
    port: &Port,
) -> bool {
    let Some((wall, wall_ref)) = walls(*e, *e_ref) else { return false };
    let Some(gains) = gains(*mu1, *mu2, *bound, wall) else { return false };
    put(to, ExplicitTwisting::new(gains, *h, wall, wall_ref).map(|it| it.with_port(*port)))
}

#[no_mangle]
pub extern "C" fn zivi_explicit_reset(it: &mut ExplicitTwisting, x: f64, xdot: f64) -> bool {
    it.reset(Physical { x, xdot }).is_ok()
}

#[no_mangle]
pub extern "C" fn zivi_explicit_tick(
    it: &mut ExplicitTwisting,
    x: f64,
    xdot: f64,
    force: f64,
    force_ref: f64,
    u: &mut f64,
) -> bool {
    put(u, it.tick(Physical { x, xdot }, force, force_ref))
}

#[no_mangle]
pub extern "C" fn zivi_step(
    to: &mut ThetaGammaStep,
    h: f64,
    theta: f64,
    gamma: f64,
    e: f64,
) -> bool {
    Restitution::from_e(e).is_ok_and(|wall| put(to, ThetaGammaStep::new(h, theta, gamma, wall)))
}

#[no_mangle]
pub extern "C" fn zivi_step_solve(
    it: &ThetaGammaStep,
    z: &Lifted,
    f: f64,
    side: f64,
    to: &mut StepSolution,
) -> bool {
    put(to, it.solve(*z, f, side))
}

#[no_mangle]
pub extern "C" fn zivi_lift(state: &Physical, wall: &Restitution, to: &mut Lifted) {
    *to = transform::lift(*state, Branch::Positive, *wall);
}

#[cfg(feature = "canary")]
#[no_mangle]
pub extern "C" fn zivi_canary(values: &[f64; 4], index: usize) -> f64 {
    values[index]
}
