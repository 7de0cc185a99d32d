//! A whole run of a mechanical system: samples, occurrences, events, dense output.

use super::integrator::MechanicalIntegrator;
use super::kinetics::Model;
use super::output::{MechanicalOutput, MechanicalRun};
use super::recording::running;
use crate::piecewise::method::NoSink;
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::switched::SwitchedRk;
use crate::system::dynamics::{Dynamics, Layout, MOST};
use crate::system::friction::Friction;
use crate::{AnyImpactLaw, GridError, Monitor, SetupError, Status};

/// Simulates a mechanical system over a span by the switched Runge-Kutta method.
///
/// ```text
/// M q'' = F + N^T lambda      0 <= g  perp  lambda >= 0      impacts: g+ = g- + D P,
///                                                  0 <= P  perp  g+ + e g- >= 0
/// ```
///
/// with `e = e(-g-)` of the impact law of each gap.
///
/// # Errors
/// [`SetupError`] before anything is computed, for settings, sizes or a start out of range.
///
/// ```
/// use std::convert::Infallible;
/// use zivi::mechanics::{simulate_mechanical, MechanicalOutput};
/// use zivi::system::dynamics::{FunctionDynamics, Layout};
/// use zivi::system::impact_law::newton_impacts;
/// use zivi::{Silent, Status, SwitchedRk};
///
/// // a ball of 2 kg above a floor at y = 0, with drift in x
/// let layout = Layout::smooth(2, 1);
/// let function = |_: f64, q: &[f64], _: &[f64], out: &mut [f64]| {
///     out[layout.mass()].copy_from_slice(&[2.0, 0.0, 0.0, 2.0]);
///     out[layout.force()].copy_from_slice(&[0.0, -2.0 * 9.81]);
///     out[layout.gap()].copy_from_slice(&[q[1]]);
///     out[layout.gradient()].copy_from_slice(&[0.0, 1.0]);
///     out[layout.curvature()].fill(0.0);
///     out[layout.rate()].fill(0.0);
///     Ok::<(), Infallible>(())
/// };
/// let run = simulate_mechanical(
///     SwitchedRk::default(), &mut FunctionDynamics { layout, function }, &newton_impacts(&[0.5])?,
///     (0.0, 3.0), (&[0.0, 1.0], &[1.0, 0.0]), MechanicalOutput::default(), &mut Silent,
/// )?;
/// assert_eq!(run.status, Status::Completed);
/// // at rest on the floor, 3 m further on
/// let last = run.samples.x.len() - 3;
/// assert!((run.samples.x[last] - 3.0).abs() < 1e-9 && run.samples.x[last + 2] == 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn simulate_mechanical<E, D: Dynamics<E>>(
    settings: SwitchedRk,
    dynamics: &mut D,
    laws: &[AnyImpactLaw],
    (t0, t1): (f64, f64),
    (q, w): (&[f64], &[f64]),
    output: MechanicalOutput<'_, E>,
    monitor: &mut impl Monitor<E>,
) -> Result<MechanicalRun<E>, SetupError> {
    let settings = settings.validated()?;
    let layout = dynamics.layout();
    check_sizes(layout, laws.len(), q, w)?;
    check_span(t0, t1)?;
    let friction = dynamics.friction().clone();
    check_friction(layout, &friction)?;
    let mut model = Model::new(dynamics);
    let mut machine = MechanicalIntegrator::new(settings, layout, laws, &friction);
    let begun = started(machine.start(t0, (q, w), &mut model))?;
    let mut running = running(machine, t1, output);
    let ending = match begun {
        Err(failure) => failure.into(),
        Ok(()) => running.go(&mut NoSink, &mut model, monitor),
    };
    Ok(running.finish(ending, model.count))
}

/// What a machine says of its start, as an error of the setup or of the run.
pub(super) fn started<E>(
    start: Result<Option<f64>, Failure<E>>,
) -> Result<Result<(), Failure<E>>, SetupError> {
    match start {
        Ok(Some(value)) => {
            Err(SetupError::Setting("q0", value, "such that no gap g(t0, q0) is below 0"))
        }
        Err(Failure::Status(Status::MassNotDefinite)) => {
            let range = "symmetric positive definite at the start";
            Err(SetupError::Setting("mass", f64::NAN, range))
        }
        start => Ok(start.map(|_| ())),
    }
}

pub(super) fn check_sizes(
    Layout { n, m, p }: Layout,
    laws: usize,
    q: &[f64],
    w: &[f64],
) -> Result<(), SetupError> {
    if n == 0 || n > MOST {
        return Err(SetupError::Count("n", n, "from 1 to 256"));
    }
    if m + p > MOST {
        return Err(SetupError::Count("m", m + p, "at most 256, with the channels of friction"));
    }
    for (name, given, wanted) in [("e", laws, m), ("q0", q.len(), n), ("qdot0", w.len(), n)] {
        if given != wanted {
            return Err(SetupError::Count(name, given, "one number each"));
        }
    }
    for (name, state) in [("q0", q), ("qdot0", w)] {
        if let Some(&value) = state.iter().find(|value| !value.is_finite()) {
            return Err(SetupError::Setting(name, value, "finite"));
        }
    }
    Ok(())
}

/// For what does not know friction yet.
pub(super) fn check_smooth(layout: Layout) -> Result<(), SetupError> {
    match layout.p {
        0 => Ok(()),
        p => Err(SetupError::Count("friction", p, "none: derivatives with friction are not known")),
    }
}

pub(super) fn check_friction(
    Layout { m, p, .. }: Layout,
    friction: &Friction,
) -> Result<(), SetupError> {
    if friction.channels.len() != p {
        return Err(SetupError::Count("friction", friction.channels.len(), "one for each channel"));
    }
    let mut seen = GapSet::EMPTY;
    for channel in &friction.channels {
        if !(0.0..=1.0).contains(&channel.e_t) {
            return Err(SetupError::Setting("e_t", channel.e_t, "from 0 to 1"));
        }
        let Some(gap) = channel.gap else { continue };
        if gap >= m || seen.has(gap) {
            return Err(SetupError::Count("friction", gap, "one gap each, at most one channel"));
        }
        seen = seen.with(GapSet::of(gap));
    }
    Ok(())
}

pub(super) fn check_span(t0: f64, t1: f64) -> Result<(), SetupError> {
    if !(t0.is_finite() && t1.is_finite()) {
        return Err(GridError::SpanNotFinite(t0, t1).into());
    }
    if t1 <= t0 {
        return Err(GridError::SpanEmpty(t0, t1).into());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::friction::Channel;

    #[test]
    fn friction_has_its_channels_and_a_gap_one_at_most() {
        let layout = Layout { n: 2, m: 2, p: 2 };
        let check = |gaps: &[Option<usize>], e_t: f64| {
            let channels = gaps.iter().map(|&gap| Channel { gap, e_t }).collect();
            check_friction(layout, &Friction { channels, ..Friction::default() })
        };
        for gaps in [[Some(0), Some(1)], [Some(1), None], [None, None]] {
            for e_t in [0.0, 0.3, 1.0] {
                assert!(check(&gaps, e_t).is_ok(), "{gaps:?} {e_t}");
            }
        }
        let refused = |gaps: &[Option<usize>], wrong: usize| {
            let found = check(gaps, 0.0);
            matches!(found, Err(SetupError::Count("friction", count, _)) if count == wrong)
        };
        assert!(refused(&[Some(0)], 1));
        assert!(refused(&[Some(0), Some(1), None], 3));
        assert!(refused(&[None, Some(2)], 2));
        assert!(refused(&[Some(1), Some(1)], 1));
        for wrong in [-0.1, 1.1, f64::NAN] {
            assert!(matches!(check(&[Some(0), None], wrong), Err(SetupError::Setting("e_t", ..))));
        }
    }
}
