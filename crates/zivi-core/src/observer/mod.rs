//! An observer of position, velocity and an unknown force through impacts: an extended Kalman
//! filter on the exact sampled map.
//!
//! ```text
//! z = (x, x', d)       x'' = F + u + d,   x >= 0,   x'+ = -e x'-,   d' is noise
//! flight of t          P <- A P A^T        A  = [[1, t, t^2/2], [0, 1, t], [0, 0, 1]]
//! impact               P <- Xi P Xi^T      Xi = [[-e, 0, 0], [(1 + e) a/v-, -e, 0], [0, 0, 1]]
//! rest                 x = x' = 0, and of P only P_dd stays
//! ```
//!
//! with `a = F + u + d`. `Xi` is the saltation matrix: the derivative of the state after an impact,
//! whose time moves with the state before it. A period may hold several impacts, and a Zeno point.
//! On the wall the force is hidden: the reaction takes it, and with `P_xd = P_vd = 0` so does the
//! filter, which keeps its estimate while `P_dd` grows.
//!
//! A measurement that is further off than 5 standard deviations is not taken (a mass that bounced
//! when the filter thinks it has not, or the other way round); the fifth in a row restarts the
//! filter at the measurement, with the `d` that it has.

mod covariance;
mod settings;

pub use covariance::Covariance;
pub use settings::ObserverSettings;

use crate::setting::{is_positive, require};
use crate::{flight, Physical, SettingError};

/// Impacts of one period that are followed; a mass that has more is taken to rest.
const MAX_IMPACTS: u32 = 20;
/// The square of the standard deviations at which a measurement is refused.
const GATE: f64 = 25.0;
/// So many refused in a row restart the filter.
const PATIENCE: u32 = 5;
/// Grazing: the speed in `(1 + e) a/v-` is taken to be at least this part of `h |a|`.
const GRAZING: f64 = 0.1;
/// Variance of a velocity (m^2/s^2) that nothing is known of; with twice the speed squared, the
/// largest: where the place is vague, an impact would make it boundless.
const UNKNOWN_SPEED: f64 = 25.0;
/// What a period adds to the variances of `x` and `x'`: without it a wrong `e` could never be
/// corrected after a rest.
const FLOOR: [f64; 2] = [1e-18, 1e-14];

/// A measurement: the position, and the velocity if there is one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// Distance from the wall (m); noise may make it negative.
    pub x: f64,
    /// Velocity (m/s).
    pub xdot: Option<f64>,
}

/// What is thought of the mass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// Distance from the wall and velocity.
    pub state: Physical,
    /// The unknown force (m/s^2).
    pub d: f64,
}

/// What the observer remembers between ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObserverState {
    /// Whether there was a measurement.
    pub started: bool,
    /// The estimate.
    pub estimate: Estimate,
    /// Its covariance.
    pub covariance: Covariance,
    /// Measurements refused in a row up to the last one.
    pub in_a_row: u32,
    /// Measurements refused so far.
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
        Self { settings, state: ObserverState::default() }
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
        force: f64,
        u: f64,
    ) -> Result<Estimate, SettingError> {
        self.tick_after(self.settings.h, measured, force, u)
    }

    /// The same for a measurement `dt` (s) after the last one; `q_d` is per `h`.
    ///
    /// # Errors
    /// As [`ImpactObserver::tick`], and for a `dt` that is not positive.
    pub fn tick_after(
        &mut self,
        dt: f64,
        measured: Measurement,
        force: f64,
        u: f64,
    ) -> Result<Estimate, SettingError> {
        let velocity = measured.xdot.filter(|_| !self.settings.position_only);
        let measured = Measurement { xdot: velocity, ..measured };
        require(is_positive(dt), "dt", dt, "a finite time > 0 (s)")?;
        require(measured.x.is_finite(), "x", measured.x, "a finite position (m)")?;
        let xdot = measured.xdot.unwrap_or(0.0);
        require(xdot.is_finite(), "xdot", xdot, "a finite velocity (m/s)")?;
        require(force.is_finite(), "force", force, "a finite force per unit mass (m/s^2)")?;
        require(u.is_finite(), "u", u, "a finite control (m/s^2)")?;
        let next = if self.state.started {
            let mut next = self.state;
            self.predict(&mut next, dt, force + u);
            self.correct(next, measured)
        } else {
            self.start(measured)
        };
        let sound = next.covariance.is_finite() && next.estimate.is_finite();
        require(sound, "x", measured.x, "finite: the sample is too large to compute with")?;
        self.state = next;
        Ok(next.estimate)
    }

    fn start(&self, Measurement { x, xdot }: Measurement) -> ObserverState {
        let ObserverSettings { noise: [of_x, of_v], dmax, .. } = self.settings;
        let of_v = if xdot.is_some() { of_v } else { UNKNOWN_SPEED };
        let state = Physical { x: x.max(0.0), xdot: xdot.unwrap_or(0.0) };
        ObserverState {
            started: true,
            estimate: Estimate { state, d: 0.0 },
            covariance: Covariance::diagonal([of_x, of_v, dmax * dmax]),
            ..ObserverState::default()
        }
    }

    /// The state after `dt` under the known force and `d`, through impacts and into rest.
    fn predict(&self, it: &mut ObserverState, dt: f64, known: f64) {
        let a = known + it.estimate.d;
        self.move_on(it, dt, a);
        let ObserverSettings { h, q_d, dmax, .. } = self.settings;
        let [of_x, of_v] = FLOOR;
        it.covariance.xx += of_x;
        it.covariance.vv += of_v;
        it.covariance.dd += q_d * (dt / h);
        it.covariance.bound_d(dmax * dmax);
        let speed = 2.0 * it.estimate.state.xdot;
        it.covariance.bound_v(UNKNOWN_SPEED + speed * speed);
    }

    fn move_on(&self, it: &mut ObserverState, dt: f64, a: f64) {
        let (e, mut left) = (self.settings.restitution.e(), dt);
        let mut at = it.estimate.state;
        if at.arrives() {
            at = self.bounce(&mut it.covariance, at.xdot, a);
        }
        for _ in 0..MAX_IMPACTS {
            let on_the_wall = at.x == 0.0 && a <= 0.0;
            // flights 2v/g, 2ev/g, ... take 2v/(g (1 - e)) in all
            if on_the_wall && 2.0 * at.xdot <= left * (1.0 - e) * -a {
                break;
            }
            match flight::time_to_wall(at, a) {
                Some(t) if t <= left => {
                    it.covariance.fly(t);
                    at = self.bounce(&mut it.covariance, -flight::speed_at_wall(at, a), a);
                    left -= t;
                }
                _ => {
                    it.covariance.fly(left);
                    let x = at.x + left * (at.xdot + 0.5 * a * left);
                    it.estimate.state = Physical { x: x.max(0.0), xdot: at.xdot + a * left };
                    return;
                }
            }
        }
        it.covariance.rest();
        it.estimate.state = Physical::default();
    }

    /// The state after an impact with `before < 0`.
    fn bounce(&self, covariance: &mut Covariance, before: f64, a: f64) -> Physical {
        let ObserverSettings { restitution, h, se, .. } = self.settings;
        let e = restitution.e();
        let speed = before.abs().max(GRAZING * h * a.abs());
        let k = if speed > 0.0 { -(1.0 + e) * a / speed } else { 0.0 };
        covariance.bounce(e, k);
        covariance.vv += (se * before) * (se * before);
        Physical { x: 0.0, xdot: 0.0 - e * before }
    }

    /// The state after this measurement, if it is within the gate.
    fn correct(&self, predicted: ObserverState, measured: Measurement) -> ObserverState {
        let ObserverSettings { noise: [of_x, of_v], dmax, .. } = self.settings;
        let mut it = predicted;
        let (gain, variance) = it.covariance.measure_x(of_x);
        let innovation = measured.x - it.estimate.state.x;
        it.estimate.shift(gain, innovation);
        let mut distance = innovation * innovation / variance;
        if let Some(xdot) = measured.xdot {
            let (gain, variance) = it.covariance.measure_v(of_v);
            let innovation = xdot - it.estimate.state.xdot;
            it.estimate.shift(gain, innovation);
            distance += innovation * innovation / variance;
        }
        if distance <= GATE {
            it.estimate.state.x = it.estimate.state.x.max(0.0);
            it.estimate.d = it.estimate.d.max(-dmax).min(dmax);
            return ObserverState { in_a_row: 0, ..it };
        }
        let (in_a_row, refused) = (predicted.in_a_row + 1, predicted.refused.saturating_add(1));
        if in_a_row < PATIENCE {
            return ObserverState { in_a_row, refused, ..predicted };
        }
        self.restart(ObserverState { in_a_row: 0, refused, ..predicted }, measured)
    }

    /// At the measurement; `d` keeps its value.
    fn restart(&self, it: ObserverState, Measurement { x, xdot }: Measurement) -> ObserverState {
        let ObserverSettings { noise: [of_x, of_v], dmax, .. } = self.settings;
        let of_v = if xdot.is_some() { 4.0 * of_v } else { 1.0 };
        let old = it.estimate.state;
        let state = Physical { x: x.max(0.0), xdot: xdot.unwrap_or(old.xdot) };
        let covariance = Covariance::diagonal([4.0 * of_x, of_v, 0.25 * dmax * dmax]);
        ObserverState { estimate: Estimate { state, ..it.estimate }, covariance, ..it }
    }

    /// The last estimate.
    #[must_use]
    pub fn estimate(&self) -> Estimate {
        self.state.estimate
    }

    /// What is remembered.
    #[must_use]
    pub fn state(&self) -> ObserverState {
        self.state
    }

    /// Restores what [`ImpactObserver::state`] gave: the ticks that follow are the same, to the
    /// last bit.
    pub fn set_state(&mut self, state: ObserverState) {
        self.state = state;
    }

    /// Forgets all measurements.
    pub fn reset(&mut self) {
        self.state = ObserverState::default();
    }

    /// The settings.
    #[must_use]
    pub fn settings(&self) -> &ObserverSettings {
        &self.settings
    }
}

impl Estimate {
    #[inline]
    fn shift(&mut self, [x, v, d]: [f64; 3], innovation: f64) {
        self.state.x += x * innovation;
        self.state.xdot += v * innovation;
        self.d += d * innovation;
    }

    fn is_finite(&self) -> bool {
        self.state.x.is_finite() && self.state.xdot.is_finite() && self.d.is_finite()
    }
}
