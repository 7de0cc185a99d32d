//! Rest at the wall: how the force on it goes on.

use super::flight::FreeFlight;
use super::lift_off::{Lookout, Window};
use super::mode::Rest;
use super::point::Point;
use super::stages::Counted;
use crate::record::failure::Failure;
use crate::{Dependence, Force};

/// A window of the force from now, up to `t_end` and, where the force is sampled, at most
/// `max_step` long.
pub(super) fn window<E, F: Force<E>>(
    (lookout, flight): (&mut Lookout, &mut FreeFlight),
    now: Point,
    (t_end, max_step): (f64, f64),
    rest: &mut Rest,
    force: &mut Counted<'_, F>,
) -> Result<Window, Failure<E>> {
    if force.dependence_at_rest::<E>() == Dependence::Constant {
        let lifts = force.at_wall(now.t)? > 0.0;
        return Ok(if lifts { Window::LiftOff(now.t) } else { Window::RestUntil(t_end) });
    }
    if let Some(next) = flight.lift_off(now, t_end) {
        return Ok(next.map_or(Window::RestUntil(t_end), Window::LiftOff));
    }
    lookout.look(rest, (now.t, t_end), max_step, |t| match force.at_wall(t) {
        Err(Failure::Status(_)) => Ok(f64::NAN),
        phi => phi,
    })
}
