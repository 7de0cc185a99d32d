//! An observer of position, velocity, an unknown force and, if it shall, the restitution, through
//! impacts: an extended Kalman filter on the exact sampled map.
//!
//! ```text
//! z = (x, x', d, e)    x'' = F + u + d,   x >= 0,   x'+ = -e x'-,   d' is noise
//! flight of t          P <- A P A^T        A  = [[1, t, t^2/2, 0], [0, 1, t, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
//! impact               P <- Xi P Xi^T      Xi = [[-e, 0, 0, 0], [(1 + e) a/v-, -e, 0, -v-], [0, 0, 1, 0], [0, 0, 0, 1]]
//! rest                 x = x' = 0; P keeps only the covariance of d and e
//! ```
//!
//! with `a = F + u + d`. `Xi` is the saltation matrix: the derivative of the state after an impact,
//! whose time moves with the state before it. A period may hold several impacts, and a Zeno point.
//! On the wall the force is unobservable since the reaction balances it; with `P_xd = P_vd = 0` the
//! filter accounts for this, which keeps its estimate while `P_dd` grows. Rest is exact: a
//! measurement within the gate does not move it.
//!
//! Every constant is a pure number of the sensor's deviation `s_x`, of `h` and of accelerations: the
//! unit of length or of time does not matter.
//!
//! A measurement that is further off than 5 standard deviations is not taken (a mass that bounced
//! when the filter thinks it has not, or the other way round). With velocities the fifth in a row
//! restarts the filter at the measurement, with the `d` that it has. Of positions alone from the
//! third on those of the last six that agree on a flight do ([`Memory`]), so that an outlier does
//! not; and the fourteenth at the measurement, at rest.

mod covariance;
mod filter;
mod settings;

pub use covariance::Covariance;
pub use covariance::{Memory, Seen, REMEMBERED};
pub use settings::ObserverSettings;

use crate::setting::{is_positive, require};
use crate::{Physical, Real, SettingError};

/// A measurement: the position, optionally the velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// Distance from the wall (m); noise may make it negative, NaN is a missing measurement.
    pub x: Real,
    /// Velocity (m/s); `None` or NaN if not measured.
    pub xdot: Option<Real>,
}

/// Estimate of the state of the mass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// Distance from the wall and velocity.
    pub state: Physical,
    /// The unknown force (m/s^2).
    pub d: Real,
}

/// State of the observer between updates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObserverState {
    /// Whether there was a measurement.
    pub started: bool,
    /// Whether the velocity waits for a second position.
    pub waiting: bool,
    /// The estimate.
    pub estimate: Estimate,
    /// The restitution, or its estimate if learnt.
    pub e: Real,
    /// Covariance of the estimates.
    pub covariance: Covariance,
    /// The last positions.
    pub memory: Memory,
    /// Measurements rejected in a row up to the last one.
    pub in_a_row: u32,
    /// Measurements rejected so far.
    pub refused: u32,
}

/// The observer.
///
/// ```
/// use zivi_core::observer::{ImpactObserver, Measurement, ObserverSettings};
/// use zivi_core::Restitution;
/// let settings = ObserverSettings::new(Restitution::from_e(0.5)?, 1e-2)?;
/// let mut observer = ImpactObserver::new(settings);
/// // a mass that falls from 1 m, under 2 m/s^2 more than is known; positions alone
/// for k in 0..30 {
///     let t = 1e-2 * f64::from(k);
///     let measured = Measurement { x: 1.0 - 0.5 * 11.81 * t * t, xdot: None };
///     observer.tick(measured, -9.81, 0.0)?;
/// }
/// assert!((observer.estimate().d + 2.0).abs() < 0.05);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImpactObserver {
    settings: ObserverSettings,
    state: ObserverState,
}

impl ImpactObserver {
    /// An observer that has seen nothing yet.
    #[must_use]
    pub fn new(settings: ObserverSettings) -> Self {
        Self { settings, state: settings.unseen() }
    }

    /// The estimate at this measurement. `force` is the known force and `u` the control that acted
    /// (limited, delayed) over the period that ends with it (m/s^2). The first measurement starts
    /// the filter, whatever they are.
    ///
    /// # Errors
    /// [`SettingError`] for a number that is not finite or too large to compute with; nothing has
    /// changed then.
    pub fn tick(
        &mut self,
        measured: Measurement,
        force: Real,
        u: Real,
    ) -> Result<Estimate, SettingError> {
        self.tick_after(self.settings.h, Some(measured), force, u)
    }

    /// The same `dt` (s) after the last one, where `q_d` is per `h`. `None`, or a position that is
    /// NaN, is a measurement that is missing: the motion is followed, nothing is corrected.
    ///
    /// # Errors
    /// Those of [`ImpactObserver::tick`]; a `dt` that is not positive.
    pub fn tick_after(
        &mut self,
        dt: Real,
        measured: Option<Measurement>,
        force: Real,
        u: Real,
    ) -> Result<Estimate, SettingError> {
        let before = self.state;
        let found = self.advance(dt, measured, force, u);
        if found.is_err() {
            self.state = before;
        }
        found
    }

    /// The same without a copy: where it fails the observer is of no further use.
    ///
    /// # Errors
    /// As [`ImpactObserver::tick_after`].
    #[inline]
    pub fn advance(
        &mut self,
        dt: Real,
        measured: Option<Measurement>,
        force: Real,
        u: Real,
    ) -> Result<Estimate, SettingError> {
        self.settings.advance(&mut self.state, dt, measured, force, u)?;
        Ok(self.state.estimate)
    }

    /// The last estimate.
    #[must_use]
    pub fn estimate(&self) -> Estimate {
        self.state.estimate
    }

    /// The state.
    #[must_use]
    pub fn state(&self) -> ObserverState {
        self.state
    }

    /// A reference to the state.
    #[must_use]
    pub fn remembered(&self) -> &ObserverState {
        &self.state
    }

    /// An observer that continues from a state of [`ImpactObserver::state`].
    #[inline]
    #[must_use]
    pub fn resumed(settings: ObserverSettings, state: ObserverState) -> Self {
        Self { settings, state }
    }

    /// Restores what [`ImpactObserver::state`] gave: the updates that follow are the same, to the
    /// last bit.
    pub fn set_state(&mut self, state: ObserverState) {
        self.state = state;
    }

    /// Forgets all measurements.
    pub fn reset(&mut self) {
        self.state = self.settings.unseen();
    }

    /// The settings.
    #[must_use]
    pub fn settings(&self) -> &ObserverSettings {
        &self.settings
    }
}

impl ObserverSettings {
    /// [`ImpactObserver::advance`] for an external state.
    ///
    /// # Errors
    /// As [`ImpactObserver::tick_after`]; what is remembered is of no further use then.
    #[inline]
    pub fn advance(
        &self,
        state: &mut ObserverState,
        dt: Real,
        measured: Option<Measurement>,
        force: Real,
        u: Real,
    ) -> Result<(), SettingError> {
        // NaN is not measured
        let measured = measured.filter(|it| !it.x.is_nan());
        let velocity = measured.and_then(|it| it.xdot);
        let velocity = velocity.filter(|it| !(self.position_only || it.is_nan()));
        let measured = measured.map(|it| Measurement { xdot: velocity, ..it });
        let x = measured.map_or(0.0, |it| it.x);
        let xdot = velocity.unwrap_or(0.0);
        require(is_positive(dt), "dt", dt, "a finite time > 0 (s)")?;
        require(x.is_finite(), "x", x, "a finite position (m)")?;
        require(xdot.is_finite(), "xdot", xdot, "a finite velocity (m/s)")?;
        require(force.is_finite(), "force", force, "a finite force per unit mass (m/s^2)")?;
        require(u.is_finite(), "u", u, "a finite control (m/s^2)")?;
        self.follow(state, dt, measured, force + u);
        let sound = state.covariance.is_finite() && state.estimate.is_finite();
        require(sound, "x", x, "finite: the sample is too large to compute with")
    }

    /// The initial state of an observer.
    fn unseen(&self) -> ObserverState {
        let covariance = Covariance { ee: self.prior(), ..Covariance::default() };
        ObserverState { e: self.restitution.e(), covariance, ..ObserverState::default() }
    }
}

impl ObserverState {
    /// From here on; `d` and `e` keep their values, and `e` what is unknown of it.
    fn restart(&mut self, state: Physical, covariance: Covariance) {
        self.estimate.state = Physical { x: state.x.max(0.0), ..state };
        self.covariance = Covariance { ee: self.covariance.ee, ..covariance };
        (self.waiting, self.in_a_row) = (false, 0);
    }

    #[inline]
    fn shift(&mut self, [x, v, d, e]: [Real; 4], innovation: Real) {
        self.estimate.state.x += x * innovation;
        self.estimate.state.xdot += v * innovation;
        self.estimate.d += d * innovation;
        self.e += e * innovation;
    }
}

impl Estimate {
    fn is_finite(&self) -> bool {
        self.state.x.is_finite() && self.state.xdot.is_finite() && self.d.is_finite()
    }
}
