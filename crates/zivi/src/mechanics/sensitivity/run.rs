//! A whole run of a mechanical system with its derivatives.

use super::columns::MechanicalWrt;
use super::follower::Follower;
use crate::mechanics::kinetics::Model;
use crate::mechanics::machine::Machine;
use crate::mechanics::recording::running;
use crate::mechanics::run::{check_sizes, check_span, started};
use crate::mechanics::{MechanicalOutput, MechanicalRun};
use crate::switched::sensitivity::Nearest;
use crate::switched::SwitchedRk;
use crate::system::partials::DifferentiableDynamics;
use crate::{Monitor, SetupError};

/// What is to be differentiated by what.
#[derive(Clone, Debug)]
pub struct MechanicalQuestion<'a> {
    /// What the columns are derivatives by.
    pub wrt: &'a [MechanicalWrt],
    /// Magnitudes of these, positive: the absolute tolerance of a column is that of the state
    /// divided by its magnitude.
    pub sizes: &'a [f64],
    /// Whether the steps are adapted to the errors of the columns too.
    pub controlled: bool,
    /// Times at which the columns are wanted, increasing, within the span (s).
    pub times: &'a [f64],
}

/// The derivatives of a run, by columns.
#[derive(Clone, Debug, PartialEq)]
pub struct MechanicalDerivatives {
    /// Of the coordinates at the end of the run, at a fixed time: `n` numbers for each column.
    pub q: Vec<f64>,
    /// Of the velocities at the end.
    pub qdot: Vec<f64>,
    /// Of the times of the impacts, for each of them one number a column.
    pub impact_dt: Vec<f64>,
    /// Of the speeds after them.
    pub impact_du: Vec<f64>,
    /// Of the times at which gaps close.
    pub zeno_times: Vec<f64>,
    /// Of the times of the lift-offs.
    pub liftoff_times: Vec<f64>,
    /// To first order, how far each may be moved before an event appears or disappears.
    pub radius: Vec<f64>,
    /// The event that limits each.
    pub nearest: Vec<Option<Nearest>>,
    /// Whether an impact, the want of one, or the order of two is decided by the tolerances.
    pub grazing: bool,
    /// Since when there are none: a corner, impacts or lift-offs of coupled gaps at once. Columns
    /// are NaN from there, until the contacts determine the state.
    pub lost_at: Option<f64>,
    /// At each of the times asked for `n` numbers of `dq` for each column, then those of `dq'`; NaN
    /// where the impacts accumulate.
    pub samples: Vec<f64>,
    /// Evaluations of the partial derivatives.
    pub n_partials: u64,
}

/// Simulates as [`crate::mechanics::simulate_mechanical`], with the derivatives of the run.
///
/// # Errors
/// [`SetupError`] before anything is computed, for settings, sizes or a start out of range.
///
/// ```
/// use std::convert::Infallible;
/// use zivi::mechanics::sensitivity::{
///     mechanical_sensitivity, MechanicalQuestion, MechanicalWrt,
/// };
/// use zivi::mechanics::MechanicalOutput;
/// use zivi::system::dynamics::{FunctionDynamics, Layout};
/// use zivi::system::partials::DifferencedDynamics;
/// use zivi::{Silent, SwitchedRk};
///
/// // a ball is dropped from 1 m: its Zeno time by the height and by e
/// let layout = Layout { n: 1, m: 1 };
/// let function = |_: f64, q: &[f64], _: &[f64], out: &mut [f64]| {
///     out.copy_from_slice(&[1.0, -2.0, q[0], 1.0, 0.0, 0.0]);
///     Ok::<(), Infallible>(())
/// };
/// let ball = FunctionDynamics { layout, function };
/// let wrt = &[MechanicalWrt::Q0(0), MechanicalWrt::AllE];
/// let question = MechanicalQuestion { wrt, sizes: &[1.0, 0.5], controlled: true, times: &[] };
/// let (_, derivatives) = mechanical_sensitivity(
///     SwitchedRk::with_tol(1e-10), &mut DifferencedDynamics::new(ball, Vec::new(), 4.0), &[0.5],
///     (0.0, 4.0), (&[1.0], &[0.0]), MechanicalOutput::default(), &question, &mut Silent,
/// )?;
/// // t = sqrt(2 x/g) (1 + e)/(1 - e), with sqrt(2 x/g) = 1
/// assert!((derivatives.zeno_times[0] - 1.5).abs() < 1e-9);
/// assert!((derivatives.zeno_times[1] - 8.0).abs() < 1e-8);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[allow(clippy::too_many_arguments)]
pub fn mechanical_sensitivity<E, D: DifferentiableDynamics<E>>(
    settings: SwitchedRk,
    dynamics: &mut D,
    e: &[f64],
    (t0, t1): (f64, f64),
    (q, w): (&[f64], &[f64]),
    output: MechanicalOutput<'_, E>,
    question: &MechanicalQuestion<'_>,
    monitor: &mut impl Monitor<E>,
) -> Result<(MechanicalRun<E>, MechanicalDerivatives), SetupError> {
    let settings = settings.validated()?;
    let layout = dynamics.layout();
    check_sizes(layout, e, q, w)?;
    check_span(t0, t1)?;
    let MechanicalQuestion { wrt, sizes, controlled, times } = *question;
    let mut model = Model::new(dynamics);
    let mut machine = Machine::new(settings, layout, e);
    let begun = started(machine.start(t0, (q, w), &mut model))?;
    let mut follower =
        Follower::new((wrt, sizes), controlled, times, t1, (layout, settings.order.pair()));
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

fn gather(follower: Follower<'_>, settings: SwitchedRk) -> MechanicalDerivatives {
    let (n, size) = (follower.columns.layout.n, follower.columns.size());
    let tolerance = settings.atol[0] + settings.rtol * follower.highest;
    let grazing = follower.validity.shallowest <= 10.0 * tolerance || follower.uncertain;
    let end = &follower.columns.now;
    let of = |all: &[f64]| -> Vec<f64> {
        all.chunks_exact(size).flat_map(|column| column[..n].iter().copied()).collect()
    };
    MechanicalDerivatives {
        q: of(&end.x),
        qdot: of(&end.xdot),
        impact_dt: follower.events.impact_dt,
        impact_du: follower.events.impact_du,
        zeno_times: follower.events.zeno,
        liftoff_times: follower.events.lift_off,
        radius: follower.validity.radius,
        nearest: follower.validity.nearest,
        grazing,
        lost_at: follower.lost_at,
        samples: follower.samples,
        n_partials: follower.columns.local.count,
    }
}
