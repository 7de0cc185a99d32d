//! A whole run with its derivatives.

use super::derivatives::{Derivatives, Question};
use super::variational_run::VariationalRun;
use crate::record::trajectory::SetupError;
use crate::switched::output::{Output, SwitchedRun};
use crate::switched::recording::running;
use crate::switched::run::{check_span, check_stops};
use crate::switched::settings::SwitchedRk;
use crate::switched::stages::Counted;
use crate::switched::SwitchedIntegrator;
use crate::system::slopes::DifferentiableForce;
use crate::system::stops::Stops;
use crate::{AnyImpactLaw, Monitor, Physical};

/// Simulates as [`crate::simulate_switched_rk`], with the derivatives of the run.
///
/// # Errors
/// [`SetupError`] before anything is computed. Whatever goes wrong later is in the run's status.
///
/// ```
/// use zivi::switched::sensitivity::{sensitivity, Question, Wrt};
/// use zivi::{ConstantForce, Output, Physical, Restitution, Silent, SwitchedRk};
///
/// // the Zeno time of a ball that is dropped from 1 m, by its height and by e
/// let question =
///     Question { wrt: &[Wrt::X0, Wrt::E], sizes: &[1.0, 0.5], controlled: true, times: &[] };
/// let (_, derivatives) = sensitivity(
///     SwitchedRk::with_tol(1e-10), Restitution::from_e(0.5)?, &mut ConstantForce(-2.0),
///     (0.0, 4.0), Physical { x: 1.0, xdot: 0.0 }, Output::default(), &question, &mut Silent,
/// )?;
/// // t = sqrt(2 x/g) (1 + e)/(1 - e), with sqrt(2 x/g) = 1
/// assert!((derivatives.events.zeno_times[0] - 1.5).abs() < 1e-9);
/// assert!((derivatives.events.zeno_times[1] - 8.0).abs() < 1e-8);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[allow(clippy::too_many_arguments)]
pub fn sensitivity<E, F: DifferentiableForce<E>>(
    settings: SwitchedRk,
    law: impl Into<AnyImpactLaw>,
    force: &mut F,
    (t0, t1): (f64, f64),
    initial: Physical,
    output: Output<'_, E>,
    question: &Question<'_>,
    monitor: &mut impl Monitor<E>,
) -> Result<(SwitchedRun<E>, Derivatives), SetupError> {
    check_span(t0, t1, output.t_eval)?;
    check_stops(output.tstops)?;
    let mut integrator = SwitchedIntegrator::new(settings, law)?;
    integrator.start(t0, initial)?;
    integrator.probe_rest(force.shortest_period().is_none());
    let Question { wrt, sizes, controlled, times } = *question;
    let dense = !times.is_empty();
    let mut follower = VariationalRun::new(wrt, sizes, controlled, t1, output.tstops, dense);
    let mut force = Counted::new(force);
    Stops::new(output.tstops, t1).enter(t0, &mut force.smooth);
    let begun = follower.begin(integrator.now(), integrator.law(), &mut force);
    let mut run = running(integrator, t1, output);
    let ending = match begun {
        Ok(()) => run.go(&mut follower, &mut force, monitor),
        Err(failure) => failure.into(),
    };
    let nfev = force.count();
    follower.ends(run.method.now());
    let run = run.finish(ending, nfev, |start, len| monitor.record_allocated(start, len))?;
    let derivatives = gather(follower, settings, times);
    Ok((run, derivatives))
}

fn gather(mut follower: VariationalRun, settings: SwitchedRk, times: &[f64]) -> Derivatives {
    let mut samples = Vec::new();
    for &t in times {
        if let Some(path) = &follower.path {
            let at = path.at(t);
            samples.extend_from_slice(&at.x);
            samples.extend_from_slice(&at.v);
        }
    }
    let grazing = follower.validity.is_undecided(&settings, follower.highest);
    let end = std::mem::take(&mut follower.step.end);
    Derivatives {
        q: end.x,
        qdot: end.v,
        events: follower.events,
        radius: follower.validity.radius,
        nearest: follower.validity.nearest,
        grazing,
        lost_at: None,
        samples,
        n_slopes: follower.step.forcing.count,
    }
}
