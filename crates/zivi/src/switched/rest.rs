//! Rest at the wall, up to the lift-off.

use super::integrator::{Piece, SwitchedIntegrator};
use super::lift_off::Window;
use super::mode::{Mode, Rest};
use super::stages::Counted;
use crate::record::failure::Failure;
use crate::{Dependence, Force, Status};

impl SwitchedIntegrator {
    /// Rest up to the first lift-off, as far as one look at the force goes.
    pub(super) fn wait<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        self.spend()?;
        let from = self.now.t;
        let mut rest = match self.mode {
            Mode::Rest(rest) => rest,
            Mode::Flight(_) => Rest::default(),
        };
        let window = self.look_ahead(&mut rest, t_end, force)?;
        self.mode = Mode::Rest(rest);
        self.chain.clear();
        let lifted = match window {
            Window::NotFinite => return Err(Failure::Status(Status::ForceNotFinite)),
            Window::RestUntil(t) => {
                self.now.t = t;
                false
            }
            Window::LiftOff(t) => {
                self.now.t = t;
                self.lift_off(t > from);
                true
            }
        };
        Ok(Piece::Rest { from, lifted })
    }

    /// How the force goes on: a window of it.
    fn look_ahead<E, F: Force<E>>(
        &mut self,
        rest: &mut Rest,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Window, Failure<E>> {
        let from = self.now.t;
        Ok(if force.dependence_at_rest::<E>() == Dependence::Constant {
            let lifts = force.at_wall(from)? > 0.0;
            if lifts {
                Window::LiftOff(from)
            } else {
                Window::RestUntil(t_end)
            }
        } else if let Some(next) = self.known_lift_off(t_end) {
            next.map_or(Window::RestUntil(t_end), Window::LiftOff)
        } else {
            let longest = self.settings.max_step;
            self.lookout.look(rest, (from, t_end), longest, |t| match force.at_wall(t) {
                Err(Failure::Status(_)) => Ok(f64::NAN),
                phi => phi,
            })?
        })
    }

    /// The next lift-off where it is known in closed form, and none if there is none.
    fn known_lift_off(&mut self, t_end: f64) -> Option<Option<f64>> {
        let now = self.now;
        self.series.as_mut()?.lift_off(now, t_end)
    }

    /// Leaves rest. Where the force grows from zero, it does so on the scale of the window.
    fn lift_off(&mut self, smoothly: bool) {
        const PART: f64 = 1e-2;
        self.mode = if smoothly { Mode::SMOOTH_LIFT_OFF } else { Mode::LIFT_OFF };
        self.now.late = 0.0;
        if smoothly {
            self.control.h = self.lookout.length.map(|length| PART * length);
        }
    }
}
