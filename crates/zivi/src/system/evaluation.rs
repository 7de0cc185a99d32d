//! One value of the force, or why there is none.

use zivi_core::Physical;

use crate::record::failure::Failure;
use crate::{Force, SetupError, Status};

/// Evaluates the force, turning NaN and infinity into a failure. Behind the wall, where a law of
/// contact need not have a value, a force that fails is asked at the wall instead.
#[inline]
pub(crate) fn finite_force<E>(
    force: &mut impl Force<E>,
    t: f64,
    state: Physical,
) -> Result<f64, Failure<E>> {
    match evaluate(force, t, state) {
        Err(failure) if ends_at_the_wall(force, state, &failure) => {
            evaluate(force, t, Physical { x: 0.0, ..state })
        }
        value => value,
    }
}

/// Whether a force that failed may have a value at the wall.
#[cold]
pub(crate) fn ends_at_the_wall<E>(
    force: &impl Force<E>,
    state: Physical,
    failure: &Failure<E>,
) -> bool {
    state.x < 0.0
        && match failure {
            Failure::Raised(error) => !force.is_interruption(error),
            Failure::Status(_) => true,
        }
}

/// Evaluates the force, turning NaN and infinity into a failure.
#[inline]
pub(crate) fn evaluate<E>(
    force: &mut impl Force<E>,
    t: f64,
    state: Physical,
) -> Result<f64, Failure<E>> {
    let value = force.at(t, state.x, state.xdot).map_err(Failure::Raised)?;
    if value.is_finite() {
        Ok(value)
    } else {
        Err(Failure::Status(Status::ForceNotFinite))
    }
}

/// Refuses a state that is not finite or behind the wall.
pub(crate) fn check_initial(initial: Physical) -> Result<(), SetupError> {
    if !(initial.x >= 0.0 && initial.x.is_finite()) {
        return Err(SetupError::Setting("x0", initial.x, "a finite distance >= 0 from the wall"));
    }
    if !initial.xdot.is_finite() {
        return Err(SetupError::Setting("xdot0", initial.xdot, "a finite velocity"));
    }
    Ok(())
}
