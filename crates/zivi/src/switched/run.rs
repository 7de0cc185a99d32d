//! A whole run: steps, samples, events, dense output.

use zivi_core::Restitution;

use super::integrator::{Counts, SwitchedIntegrator};
use super::path::DensePath;
use super::recording::running;
use super::settings::{Flights, SwitchedRk};
use super::stages::Counted;
use crate::piecewise::method::{Driver, Plainly};
use crate::record::trajectory::{SetupError, Trajectory};
use crate::record::user_events::{Hit, UserEvent};
use crate::zeno::tail::Tail;
use crate::{Force, GridError, Impact, Monitor, Physical};

/// What a run shall give, besides its impacts, Zeno points and lift-offs.
pub struct Output<'a, E> {
    /// Times of the samples, increasing and within the span. `None`: a sample at the start, at
    /// the end of each step, at each impact (the state after it, with `x = 0`), Zeno point and
    /// lift-off, and at the end.
    pub t_eval: Option<&'a [f64]>,
    /// Times at which the force is not smooth (s), increasing: steps end there, the force is asked
    /// on either side but never across, chains of impacts and the look ahead at rest begin anew.
    pub tstops: &'a [f64],
    /// Whether to keep the motion as a function of time.
    pub dense: bool,
    /// Whether, where that is kept and no times are given, there are samples between the steps,
    /// before impacts and at apexes too, so that lines through them draw the motion.
    pub drawn: bool,
    /// The user's events.
    pub events: Vec<UserEvent<'a, E>>,
}

impl<E> Default for Output<'_, E> {
    fn default() -> Self {
        Self { t_eval: None, tstops: &[], dense: false, drawn: false, events: Vec::new() }
    }
}

/// A run of the switched method.
#[derive(Clone, Debug, PartialEq)]
pub struct SwitchedRun<E> {
    /// Samples, impacts, Zeno points, lift-offs, status.
    pub trajectory: Trajectory,
    /// The error that the force, an event or the monitor raised (the status is
    /// [`crate::Status::Raised`] then).
    pub raised: Option<E>,
    /// The motion as a function of time, if [`Output::dense`] asked for it.
    pub path: Option<DensePath>,
    /// The arcs that jumps to rest skipped, in order.
    pub tails: Vec<Tail>,
    /// For each event of the user what happened, in order.
    pub hits: Vec<Vec<Hit>>,
    /// How much work was done.
    pub counts: Counts,
    /// The time and the state up to which the motion is known, whatever is sampled.
    pub end: (f64, Physical),
}

impl<E> SwitchedRun<E> {
    /// All impacts with a speed of at least `speed` (m/s) after them, those included that a jump
    /// to rest skipped, in order; at most `at_most` of each tail.
    ///
    /// ```
    /// use zivi::{
    ///     simulate_switched_rk, ConstantForce, Output, Physical, Restitution, Silent, SwitchedRk,
    /// };
    ///
    /// let (ball, restitution) = (Physical { x: 1.0, xdot: 0.0 }, Restitution::from_e(0.5)?);
    /// let run = simulate_switched_rk(
    ///     SwitchedRk::default(), restitution, &mut ConstantForce(-2.0), (0.0, 4.0), ball,
    ///     Output::default(), &mut Silent,
    /// )?;
    /// assert_eq!(run.trajectory.events.impacts.len(), 3);
    /// // 2 m/s at the first impact, 2^-20 m/s after the 21st
    /// assert_eq!(run.impacts_down_to(0.99 * 0.5f64.powi(20), 1000).len(), 21);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn impacts_down_to(&self, speed: f64, at_most: usize) -> Vec<Impact> {
        let fast = |impact: &Impact| impact.xdot_after >= speed;
        let mut all = Vec::new();
        let mut tails = self.tails.iter().peekable();
        for impact in &self.trajectory.events.impacts {
            while let Some(tail) = tails.next_if(|tail| tail.start() < impact.t) {
                all.extend(tail.impacts_down_to(speed, at_most));
            }
            all.extend(Some(*impact).filter(fast));
        }
        all.extend(tails.flat_map(|tail| tail.impacts_down_to(speed, at_most)));
        all
    }
}

/// Simulates `x'' = f`, `x >= 0`, `x'+ = -e x'-` with the switched Runge-Kutta method.
///
/// Samples have `s = sigma x` and `v = sigma x'/(1 - kappa sgn x')` on the branch `sigma` that
/// changes at each impact; their multipliers are the signs, at rest 0, and their residual is NaN:
/// no inclusion is solved. On a plastic wall (`e = 0`) `v` is infinite while the mass moves off.
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
    restitution: Restitution,
    force: &mut F,
    span: (f64, f64),
    initial: Physical,
    output: Output<'_, E>,
    monitor: &mut impl Monitor<E>,
) -> Result<SwitchedRun<E>, SetupError> {
    simulate_with(&mut Plainly, settings, restitution, force, span, initial, output, monitor)
}

/// The same in the steps of somebody else.
#[allow(clippy::too_many_arguments)]
pub(super) fn simulate_with<E, F: Force<E>>(
    driver: &mut impl for<'f> Driver<SwitchedIntegrator, Counted<'f, F>, E>,
    settings: SwitchedRk,
    restitution: Restitution,
    force: &mut F,
    (t0, t1): (f64, f64),
    initial: Physical,
    output: Output<'_, E>,
    monitor: &mut impl Monitor<E>,
) -> Result<SwitchedRun<E>, SetupError> {
    check_span(t0, t1, output.t_eval)?;
    check_stops(output.tstops)?;
    let mut integrator = SwitchedIntegrator::new(settings, restitution)?;
    integrator.start(t0, initial)?;
    integrator.lookout.probing = force.shortest_period().is_none();
    integrator.adopt(force);
    let linear = integrator.linear().copied();
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
