//! A whole run with its derivatives.

use super::variational_run::VariationalRun;
use crate::record::trajectory::SetupError;
use crate::switched::output::{Output, SwitchedRun};
use crate::switched::recording::{check_span, check_stops, running};
use crate::switched::sensitivity::columns::{Derivatives, Question};
use crate::switched::settings::SwitchedRk;
use crate::switched::stages::Counted;
use crate::switched::SwitchedIntegrator;
use crate::system::force::Stops;
use crate::system::slopes::DifferentiableForce;
use crate::{AnyImpactLaw, Monitor, Physical, Status};

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
    let mut run = run.finish(ending, nfev, |start, len| monitor.record_allocated(start, len))?;
    let mut samples = Vec::new();
    let room = times.len().saturating_mul(2 * wrt.len());
    samples.try_reserve_exact(room).map_err(|_| SetupError::Memory(times.len()))?;
    if let Some(path) = &follower.path {
        for (k, &t) in times.iter().enumerate() {
            if k % BETWEEN_POLLS == 0 {
                if let Err(raised) = monitor.poll(k, times.len()) {
                    run.raised = Some(raised);
                    run.trajectory.status = Status::Raised;
                    break;
                }
            }
            let at = path.at(t);
            samples.extend_from_slice(&at.x);
            samples.extend_from_slice(&at.v);
        }
    }
    Ok((run, gather(follower, settings, samples)))
}

/// Samples of derivatives between two checks for interruption.
const BETWEEN_POLLS: usize = 1 << 12;

fn gather(mut follower: VariationalRun, settings: SwitchedRk, samples: Vec<f64>) -> Derivatives {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::switched::sensitivity::Wrt;
    use crate::switched::Order;
    use crate::system::slopes::{Place, Slopes};
    use crate::{ConstantForce, Force, LinearForce, Restitution, Silent};
    use std::convert::Infallible;

    fn run<F: DifferentiableForce<Infallible>>(
        settings: SwitchedRk,
        mut force: F,
        to: f64,
        (x, xdot): (f64, f64),
        (wrt, size): (Wrt, f64),
    ) -> (SwitchedRun<Infallible>, Derivatives) {
        let law = Restitution::from_e(0.5).unwrap();
        let question = Question { wrt: &[wrt], sizes: &[size], controlled: true, times: &[] };
        let (initial, output) = (Physical { x, xdot }, Output::default());
        sensitivity(settings, law, &mut force, (0.0, to), initial, output, &question, &mut Silent)
            .unwrap()
    }

    #[test]
    fn a_mass_that_is_pulled_off_where_it_starts_goes_with_its_start() {
        // x = (t - t0)^2, x' = 2 (t - t0), at t = 1
        let (force, wrt) = (ConstantForce(2.0), (Wrt::T0, 1.0));
        let (_, found) = run(SwitchedRk::default(), force, 1.0, (0.0, 0.0), wrt);
        assert_eq!(found.events.liftoff_times, [1.0]);
        assert!((found.q[0] + 2.0).abs() < 1e-14 && (found.qdot[0] + 2.0).abs() < 1e-14);
    }

    /// `p (t - 1)`, below it by 1 until `t = 1`, above it by 1/2 from then on.
    struct Thrown(f64);

    impl Force<Infallible> for Thrown {
        fn at(&mut self, t: f64, _: f64, _: f64) -> Result<f64, Infallible> {
            Ok(if t < 1.0 { -1.0 } else { 0.5 } + self.0 * (t - 1.0))
        }
    }

    impl DifferentiableForce<Infallible> for Thrown {
        fn parameters(&self) -> usize {
            1
        }

        fn slopes(
            &mut self,
            place: Place,
            _: bool,
            _: &[usize],
            out: &mut [f64],
        ) -> Result<Slopes, Infallible> {
            out.fill(place.t - 1.0);
            Ok(Slopes { t: self.0, x: 0.0, xdot: 0.0 })
        }
    }

    #[test]
    fn a_jump_that_was_not_told_throws_off_at_its_own_time() {
        let (force, wrt) = (Thrown(1.0), (Wrt::Parameter(0), 1.0));
        let (run, found) = run(SwitchedRk::default(), force, 2.0, (0.0, 0.0), wrt);
        assert!((run.trajectory.events.liftoff_times[0] - 1.0).abs() < 1e-14);
        assert!(found.events.liftoff_times[0].abs() < 1e-12);
        // x = (t - 1)^2/4 + p (t - 1)^3/6
        assert!((found.q[0] - 1.0 / 6.0).abs() < 1e-9);
    }

    /// `-x - g`
    fn spring(gravity: f64) -> LinearForce {
        let [damping, amplitude, omega, phase] = [0.0; 4];
        LinearForce { stiffness: 1.0, damping, gravity, amplitude, omega, phase }
    }

    #[test]
    fn columns_do_not_shorten_steps_of_a_fixed_length() {
        let settings = SwitchedRk {
            rtol: 1e-13,
            atol: [1e-16; 2],
            order: Order::Five,
            max_step: 0.5,
            adaptive: false,
            ..SwitchedRk::DEFAULT
        };
        let force = spring(0.0);
        let (run, found) = run(settings, force, 1.0, (1.0, 0.0), (Wrt::Parameter(0), 1.0));
        assert_eq!((run.counts.accepted, run.counts.rejected), (2, 0));
        // x = cos(sqrt(k) t)
        assert!((found.q[0] + 0.5 * 1.0_f64.sin()).abs() < 1e-4);
    }

    #[test]
    fn the_derivative_of_a_zeno_time_is_known_relative_to_itself() {
        let settings = SwitchedRk { rtol: 1e-6, atol: [1e-9; 2], ..SwitchedRk::DEFAULT };
        let of = |size: f64| {
            let force = spring(1.0);
            let (run, found) = run(settings, force, 9.0, (1.0, 0.0), (Wrt::X0, size));
            (run.trajectory.events.impacts.len(), found.events.zeno_times.len())
        };
        // the absolute tolerance, which is divided by the size, is nothing beside it
        assert_eq!(of(1e4), of(1e10));
    }
}
