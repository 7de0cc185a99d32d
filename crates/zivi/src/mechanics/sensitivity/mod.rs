//! Derivatives of a run of a mechanical system by its initial state, the coefficients of restitution
//! and parameters: through impacts, Zeno points, sliding contact and lift-off.
//!
//! ```text
//! flight, contact   columns (dq, dq') of the equations of motion, in the steps of the run
//! impact            dz+ = R_z dz- + (R_z F- + R_t - F+) dt        R the impact, dt its shift
//! Zeno point        the table of times and states, differentiated: dz = D z_inf - F dt_inf
//! lift-off          dt = -dlambda/lambda', no jump of the columns
//! ```

mod columns;
mod events;
mod variational_run;

use crate::kinetics::Model;
use crate::mechanics::integrator::MechanicalIntegrator;
use crate::mechanics::recording::{
    check_differentiable, check_free, check_sizes, check_span, running, started,
};
use crate::mechanics::sensitivity::variational_run::VariationalRun;
use crate::mechanics::{MechanicalOutput, MechanicalRun};
use crate::switched::SwitchedRk;
use crate::system::partials::DifferentiableDynamics;
use crate::{AnyImpactLaw, Monitor, SetupError};

pub use columns::{FrictionNumber, MechanicalWrt};

pub use crate::switched::sensitivity::{Derivatives, EventRates, Question};

// A whole run of a mechanical system with its derivatives.

/// Simulates as [`crate::mechanics::simulate_mechanical`], with the derivatives of the run.
///
/// # Errors
/// [`SetupError`] before anything is computed, for settings, sizes or a start out of range.
///
/// ```
/// use std::convert::Infallible;
/// use zivi::mechanics::sensitivity::{
///     mechanical_sensitivity, MechanicalWrt, Question,
/// };
/// use zivi::mechanics::MechanicalOutput;
/// use zivi::system::dynamics::{FunctionDynamics, Layout};
/// use zivi::system::impact_law::newton_impacts;
/// use zivi::system::partials::DifferencedDynamics;
/// use zivi::{Silent, SwitchedRk};
///
/// // a ball is dropped from 1 m: its Zeno time by the height and by e
/// let layout = Layout::smooth(1, 1);
/// let function = |_: f64, q: &[f64], _: &[f64], out: &mut [f64]| {
///     out.copy_from_slice(&[1.0, -2.0, q[0], 1.0, 0.0, 0.0]);
///     Ok::<(), Infallible>(())
/// };
/// let ball = FunctionDynamics { layout, function };
/// let wrt = &[MechanicalWrt::Q0(0), MechanicalWrt::AllE];
/// let question = Question { wrt, sizes: &[1.0, 0.5], controlled: true, times: &[] };
/// let (_, derivatives) = mechanical_sensitivity(
///     SwitchedRk::with_tol(1e-10), &mut DifferencedDynamics::new(ball, Vec::new(), 4.0),
///     &newton_impacts(&[0.5])?, (0.0, 4.0), (&[1.0], &[0.0]), MechanicalOutput::default(),
///     &question, &mut Silent,
/// )?;
/// // t = sqrt(2 x/g) (1 + e)/(1 - e), with sqrt(2 x/g) = 1
/// assert!((derivatives.events.zeno_times[0] - 1.5).abs() < 1e-9);
/// assert!((derivatives.events.zeno_times[1] - 8.0).abs() < 1e-8);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[allow(clippy::too_many_arguments)]
pub fn mechanical_sensitivity<E, D: DifferentiableDynamics<E>>(
    settings: SwitchedRk,
    dynamics: &mut D,
    laws: &[AnyImpactLaw],
    (t0, t1): (f64, f64),
    (q, w): (&[f64], &[f64]),
    output: MechanicalOutput<'_, E>,
    question: &Question<'_, MechanicalWrt>,
    monitor: &mut impl Monitor<E>,
) -> Result<(MechanicalRun<E>, Derivatives), SetupError> {
    let settings = settings.validated()?;
    let layout = dynamics.layout();
    check_sizes(layout, laws.len(), q, w)?;
    check_free(layout)?;
    check_differentiable(dynamics.friction())?;
    check_span(t0, t1)?;
    let Question { wrt, sizes, controlled, times } = *question;
    let moved = |wrt: &MechanicalWrt| match wrt {
        MechanicalWrt::Parameter(number) => dynamics.moved_laws(*number).cloned(),
        _ => None,
    };
    let moved = wrt.iter().map(moved).collect();
    let friction = dynamics.friction().clone();
    let mut model = Model::new(dynamics);
    let mut machine = MechanicalIntegrator::new(settings, layout, laws, &friction);
    machine.probe_flights(t1 - t0);
    let begun = started(machine.start(t0, (q, w), &mut model))?;
    let of = (layout, &friction, settings.order.pair());
    let mut follower = VariationalRun::new((wrt, moved, sizes), controlled, times, t1, of);
    follower.columns.local.prefer_directions(wrt.len(), &*model.dynamics);
    let room = times.len().saturating_mul(2 * layout.n * sizes.len());
    follower.samples.try_reserve_exact(room).map_err(|_| SetupError::Memory(times.len()))?;
    let begun = begun.and_then(|()| follower.begin(&machine, &mut model));
    let mut running = running(machine, t1, output);
    let ending = match begun {
        Err(failure) => failure.into(),
        Ok(()) => running.go(&mut follower, &mut model, monitor),
    };
    let run = running.finish(ending, model.count);
    let reached = run.samples.t.last().copied().unwrap_or(t0);
    follower.sample_end(reached);
    Ok((run, gather(follower, settings)))
}

fn gather(follower: VariationalRun<'_>, settings: SwitchedRk) -> Derivatives {
    let (n, size) = (follower.columns.layout.n, follower.columns.size());
    let grazing = follower.validity.is_undecided(&settings, follower.highest) || follower.uncertain;
    let end = &follower.columns.now;
    let of = |all: &[f64]| -> Vec<f64> {
        all.chunks_exact(size).flat_map(|column| column[..n].iter().copied()).collect()
    };
    Derivatives {
        q: of(&end.x),
        qdot: of(&end.xdot),
        events: follower.events,
        radius: follower.validity.radius,
        nearest: follower.validity.nearest,
        grazing,
        lost_at: follower.lost_at,
        samples: follower.samples,
        n_slopes: follower.columns.local.count,
    }
}
