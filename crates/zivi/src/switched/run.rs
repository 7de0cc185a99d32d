//! A whole run: steps, samples, events, dense output.

use super::integrator::SwitchedIntegrator;
use super::output::{Output, SwitchedRun};
use super::recording::running;
use super::settings::{Flights, SwitchedRk};
use super::stages::Counted;
use crate::piecewise::method::{Driver, NoSink};
use crate::record::trajectory::SetupError;
use crate::{AnyImpactLaw, Force, GridError, Monitor, Physical};

/// Simulates `x'' = f`, `x >= 0`, `x'+ = -e x'-` with the switched Runge-Kutta method.
///
/// Samples have `s = sigma x` and `v = sigma x'/(1 - kappa sgn x')` on the branch `sigma` that
/// changes at each impact, with `kappa = 0` where the impact law has no constant coefficient; their
/// multipliers are the signs, at rest 0, and their residual is NaN: no inclusion is solved. On a plastic wall (`e = 0`) `v` is infinite while the mass moves off.
///
/// # Errors
/// [`SetupError`] before anything is computed. Whatever goes wrong later is in the run's status.
///
/// ```
/// use zivi::{
///     simulate_switched_rk, LinearForce, Output, Physical, Restitution, Silent, Status,
///     SwitchedRk,
/// };
///
/// // a mass on a table that vibrates with 1.5 g
/// let mut force = LinearForce {
///     stiffness: 0.0, damping: 0.0, gravity: 9.81,
///     amplitude: 14.715, omega: 6.283185307179586, phase: -1.5707963267948966,
/// };
/// let (start, restitution) = (Physical { x: 0.2, xdot: 0.0 }, Restitution::from_e(0.5)?);
/// let run = simulate_switched_rk(
///     SwitchedRk::with_tol(1e-9), restitution, &mut force, (0.0, 2.0), start, Output::default(),
///     &mut Silent,
/// )?;
/// assert_eq!(run.trajectory.status, Status::Completed);
/// let events = &run.trajectory.events;
/// assert!((events.zeno_times[0] - 0.8286081107).abs() < 1e-8);
/// assert!((events.liftoff_times[0] - 1.1161397636).abs() < 1e-8);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn simulate_switched_rk<E, F: Force<E>>(
    settings: SwitchedRk,
    law: impl Into<AnyImpactLaw>,
    force: &mut F,
    span: (f64, f64),
    initial: Physical,
    output: Output<'_, E>,
    monitor: &mut impl Monitor<E>,
) -> Result<SwitchedRun<E>, SetupError> {
    simulate_with(&mut NoSink, settings, law.into(), force, span, initial, output, monitor)
}

/// The same in the steps of somebody else.
#[allow(clippy::too_many_arguments)]
pub(super) fn simulate_with<E, F: Force<E>>(
    driver: &mut impl for<'f> Driver<SwitchedIntegrator, Counted<'f, F>, E>,
    settings: SwitchedRk,
    law: AnyImpactLaw,
    force: &mut F,
    (t0, t1): (f64, f64),
    initial: Physical,
    output: Output<'_, E>,
    monitor: &mut impl Monitor<E>,
) -> Result<SwitchedRun<E>, SetupError> {
    check_span(t0, t1, output.t_eval)?;
    check_stops(output.tstops)?;
    let mut integrator = SwitchedIntegrator::new(settings, law)?;
    integrator.start(t0, initial)?;
    integrator.probe_rest(force.shortest_period().is_none());
    integrator.adopt(force);
    let linear = integrator.flight().linear().copied();
    if settings.flights == Flights::Series && linear.is_none() {
        return Err(SetupError::Setting("flights", f64::NAN, "series for a linear force only"));
    }
    let mut run = running(integrator, t1, output);
    let mut force = Counted::known(force, linear.as_ref());
    let ending = run.go(driver, &mut force, monitor);
    let nfev = force.count();
    run.finish(ending, nfev, |start, len| monitor.record_allocated(start, len))
}

pub(super) fn check_stops(tstops: &[f64]) -> Result<(), SetupError> {
    let mut last = f64::NEG_INFINITY;
    for &t in tstops {
        if !(t > last && t.is_finite()) {
            return Err(SetupError::Setting("tstops", t, "increasing finite times"));
        }
        last = t;
    }
    Ok(())
}

pub(crate) fn check_span(t0: f64, t1: f64, t_eval: Option<&[f64]>) -> Result<(), SetupError> {
    if !(t0.is_finite() && t1.is_finite() && (t1 - t0).is_finite()) {
        return Err(GridError::SpanNotFinite(t0, t1).into());
    }
    if t1 <= t0 {
        return Err(GridError::SpanEmpty(t0, t1).into());
    }
    let mut last = f64::NEG_INFINITY;
    for &t in t_eval.unwrap_or_default() {
        if !(t > last && t >= t0 && t <= t1) {
            return Err(SetupError::Setting("t_eval", t, "increasing times within t_span"));
        }
        last = t;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stops_are_finite_and_increase() {
        assert!(check_stops(&[]).is_ok() && check_stops(&[-1.0, 0.5, 2.0]).is_ok());
        for stops in [&[1.0, 0.5][..], &[1.0, 1.0], &[0.0, f64::INFINITY], &[f64::NAN]] {
            assert!(check_stops(stops).is_err(), "{stops:?}");
        }
    }
}
