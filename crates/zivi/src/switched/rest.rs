//! Rest at the wall, up to the lift-off.

use super::flight::FreeFlight;
use super::lift_off::{ForceMonitor, Window};
use super::mode::{Mode, Rest};
use super::point::Point;
use super::stages::Counted;
use crate::record::failure::Failure;
use crate::{Dependence, Force, Status};

/// The first step off the wall where the force grows from zero, relative to the last window.
const PART: f64 = 1e-2;

/// Rest up to the first lift-off, as far as one look at the force goes: whether that is as far as
/// the lift-off. It goes up to `t_end` and, where the force is sampled, is at most `longest` long.
pub(super) fn wait<E, F: Force<E>>(
    (now, mode): (&mut Point, &mut Mode),
    lookout: &mut ForceMonitor,
    flight: &mut FreeFlight,
    (t_end, longest): (f64, f64),
    force: &mut Counted<'_, F>,
) -> Result<bool, Failure<E>> {
    let from = now.t;
    let mut rest = mode.rest();
    let window = window(*now, &mut rest, lookout, flight, (t_end, longest), force)?;
    *mode = Mode::Rest(rest);
    match window {
        Window::NotFinite => Err(Failure::Status(Status::ForceNotFinite)),
        Window::RestUntil(t) => {
            now.t = t;
            Ok(false)
        }
        Window::LiftOff(t) => {
            (now.t, now.late) = (t, 0.0);
            *mode = Mode::LIFT_OFF;
            if t > from {
                // the force grows from zero, on the scale of the window
                *mode = Mode::SMOOTH_LIFT_OFF;
                let length = lookout.length();
                flight.steps_mut().set_next(length.map(|length| PART * length));
            }
            Ok(true)
        }
    }
}

/// How the force on the mass at rest continues: a window of it.
fn window<E, F: Force<E>>(
    now: Point,
    rest: &mut Rest,
    lookout: &mut ForceMonitor,
    flight: &mut FreeFlight,
    (t_end, longest): (f64, f64),
    force: &mut Counted<'_, F>,
) -> Result<Window, Failure<E>> {
    if force.dependence_at_rest::<E>() == Dependence::Constant {
        let lifts = force.at_wall(now.t)? > 0.0;
        return Ok(if lifts { Window::LiftOff(now.t) } else { Window::RestUntil(t_end) });
    }
    if let Some(next) = flight.lift_off(now, t_end) {
        return Ok(next.map_or(Window::RestUntil(t_end), Window::LiftOff));
    }
    lookout.look(rest, (now.t, t_end), longest, |t| match force.at_wall(t) {
        Err(Failure::Status(_)) => Ok(f64::NAN),
        phi => phi,
    })
}
