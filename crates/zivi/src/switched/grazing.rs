//! Whether a run of the switched method passed a grazing: an impact, or the want of one, that is
//! decided by the tolerances.
//!
//! An impact with the velocity `v` that the force pulls off, `a = f(t, 0, v) > 0`, would not be one
//! if its flight went higher by `v^2/(2 a)`; a minimum of a flight at the height `x` would be one if
//! it went lower by `x`. Low speeds at `a < 0`, those of a chain of impacts, are no grazing.

use super::integrator::SwitchedIntegrator;
use super::output::{Output, SwitchedRun};
use super::settings::SwitchedRk;
use super::stages::Counted;
use crate::piecewise::steps::Driver;
use crate::record::status::Failure;
use crate::record::user_events::Level;
use crate::switched::mode::Piece;
use crate::switched::recording::simulate_with;
use crate::{AnyImpactLaw, Force, Monitor, SetupError};
use zivi_core::Physical;

/// A depth that is decided by the tolerances, in units of those of the distance.
const DECIDED: f64 = 10.0;

/// Whether the tolerances decided over the shallowest event of a run that is up to so high (m).
pub(super) fn is_undecided(shallowest: f64, highest: f64, settings: &SwitchedRk) -> bool {
    shallowest <= DECIDED * (settings.atol[0] + settings.rtol * highest)
}

/// Distance of a run from a grazing.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Grazing {
    /// The smallest depth of an impact or a minimum (m).
    shallowest: f64,
    /// The largest distance at the end of a step (m).
    highest: f64,
}

impl Default for Grazing {
    fn default() -> Self {
        Self { shallowest: f64::INFINITY, highest: 0.0 }
    }
}

impl Grazing {
    fn note(&mut self, depth: f64) {
        self.shallowest = self.shallowest.min(depth);
    }

    /// A minimum of the distance within the last piece of flight.
    fn minimum<E, F: Force<E>>(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        // a piece of several curves is far from the wall
        if integrator.flight().curves() != 1 {
            return Ok(());
        }
        let (end, sigma) = (integrator.t(), integrator.sigma());
        let curve = integrator.flight().curve(0, sigma, force)?;
        for t in curve.crossings(Level::Velocity(0.0), end) {
            self.note(curve.at(t).x);
        }
        Ok(())
    }
}

/// Runs [`crate::simulate_switched_rk`] and returns whether the run passed a grazing that the
/// tolerances decided.
///
/// # Errors
/// [`SetupError`] before anything is computed.
pub(crate) fn simulate_watching<E, F: Force<E>>(
    settings: SwitchedRk,
    law: AnyImpactLaw,
    force: &mut F,
    (span, tstops): ((f64, f64), &[f64]),
    initial: Physical,
    monitor: &mut impl Monitor<E>,
) -> Result<(SwitchedRun<E>, bool), SetupError> {
    let mut grazing = Grazing::default();
    let output = Output { tstops, ..Output::default() };
    let run = simulate_with(&mut grazing, settings, law, force, span, initial, output, monitor)?;
    Ok((run, is_undecided(grazing.shallowest, grazing.highest, &settings)))
}

impl<'f, E, F: Force<E>> Driver<SwitchedIntegrator, Counted<'f, F>, E> for Grazing {
    fn step(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        t_end: f64,
        force: &mut Counted<'f, F>,
    ) -> Result<Piece, Failure<E>> {
        let before = integrator.now();
        self.highest = self.highest.max(before.x);
        let piece = integrator.step(t_end, force)?;
        match piece {
            Piece::Flight { impact: Some(impact), .. } => {
                let v = impact.xdot_before;
                let pull = force.known_at(impact.t, 0.0, v)?;
                if pull > 0.0 {
                    self.note(v * v / (2.0 * pull));
                }
            }
            Piece::Flight { impact: None, .. } => {
                if before.xdot < 0.0 && integrator.now().xdot > 0.0 {
                    self.minimum(integrator, force)?;
                }
            }
            Piece::Tail | Piece::Rest { .. } => {}
        }
        Ok(piece)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{FunctionForce, Restitution, Silent};

    /// Whether the tolerances decide over a run that starts at rest at `x0` under `f = 3 (t - 1)`:
    /// its lowest point is `x0 - 2`, at `t = 2`.
    fn grazes(x0: f64) -> bool {
        let pull = 3.0;
        let mut force = FunctionForce(|t: f64, _: f64, _: f64| {
            Ok::<f64, std::convert::Infallible>(pull * (t - 1.0))
        });
        let start = Physical { x: x0, xdot: 0.0 };
        let (settings, law) = (SwitchedRk::with_tol(1e-9), Restitution::from_e(0.5).unwrap());
        let (run, found) = simulate_watching(
            settings,
            law.into(),
            &mut force,
            ((0.0, 2.5), &[]),
            start,
            &mut Silent,
        )
        .unwrap();
        assert_eq!(run.trajectory.status, crate::Status::Completed);
        found
    }

    #[test]
    fn a_wall_that_is_just_touched_or_just_missed_is_noticed() {
        assert!(grazes(2.0 + 1e-10));
        assert!(grazes(2.0 - 1e-10));
        assert!(!grazes(2.0 + 1e-3));
        assert!(!grazes(2.0 - 1e-3));
    }
}
