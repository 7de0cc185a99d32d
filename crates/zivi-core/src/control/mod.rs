//! Twisting controllers for a mass with impacts, discretised implicitly: pure updates.
//!
//! An update takes a measurement `(x, x')` and the controller's own small state and gives the control
//! `u` (a force per unit mass) for the next sampling period. It allocates nothing, its work is
//! bounded by constants, and it cannot panic: the same code runs on a bench and on a target.
//!
//! ```text
//! regulator   s' = R v,  v' = ( sgn(s) F - mu1 sgn(s) - mu2 sgn(v) ) / R            (3)
//! tracker     u = R sgn(s) [ -mu1 sgn(e_s) - mu2 sgn(e_v) + sgn(s_r) F_r/R_r ] - sgn(s)^2 F   (7)
//!             e_s = s - s_r,  e_v = v - v_r
//! ```
//!
//! The rooms: [`TwistingRegulator`] brings the mass to rest at the wall, [`TwistingTracker`] makes
//! it follow a bouncing reference, [`ExplicitTwisting`] is the explicit controller that chatters.
//! [`tracking`] solves the tracker's step exactly (with [`cubic`]), [`regulation`]
//! the regulator's, including held controls that end in exact rest; [`given`](Waypoint) is a
//! reference that is given sample by sample; [`Aim`] strikes bodies and walls as requested;
//! [`inclusion`] writes the same steps as box VIs of two,
//! four and six signs for a general solver ([`TwistingTracker::follow_by`]) and for checking.

mod aim;
pub mod cubic;
pub mod gains;
#[cfg(not(feature = "single"))]
pub mod inclusion;
pub mod port;
mod reference;
pub mod regulation;
mod regulator;
mod tracker;
pub mod tracking;

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests;

pub use aim::{Aim, AimSettings, AimState, Learning, StrikeMeasurement};
pub use gains::{Descent, GainError, Gains, Landing};
pub use port::{DelayLine, Port, TickStatus};
pub use reference::{Planned, ReferencePeriod, Waypoint};
pub use regulator::ExplicitTwisting;
pub use regulator::{RegulatorState, TwistingRegulator};
pub use tracker::{checked_horizon, Approach, TrackerSettings, TrackerState, TwistingTracker};

use crate::setting::{is_positive, require};
use crate::{Real, Restitution, SettingError};

/// Admissible sampling periods and walls, the same for every controller.
fn checked(h: Real, restitution: Restitution, name_of_e: &'static str) -> Result<(), SettingError> {
    require(is_positive(h), "h", h, "a finite sampling period > 0")?;
    checked_wall(restitution, name_of_e)
}

/// Admissible walls: `R = 1 - kappa` must not vanish.
fn checked_wall(restitution: Restitution, name_of_e: &'static str) -> Result<(), SettingError> {
    let range = "> 0 (R = 0 at e = 0; below about 1e-16 kappa rounds to 1)";
    require(restitution.kappa() < 1.0, name_of_e, restitution.e(), range)
}
