//! An observer of position, velocity, an unknown force and, if it shall, the restitution, through
//! impacts: an extended Kalman filter on the exact sampled map.
//!
//! ```text
//! z = (x, x', d, e)    x'' = F + u + d,   x >= 0,   x'+ = -e x'-,   d' is noise
//! flight of t          P <- A P A^T        A  = [[1, t, t^2/2, 0], [0, 1, t, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
//! impact               P <- Xi P Xi^T      Xi = [[-e, 0, 0, 0], [(1 + e) a/v-, -e, 0, -v-], [0, 0, 1, 0], [0, 0, 0, 1]]
//! rest                 x = x' = 0, and of P only what is unknown of d and e stays
//! ```
//!
//! with `a = F + u + d`. `Xi` is the saltation matrix: the derivative of the state after an impact,
//! whose time moves with the state before it. A period may hold several impacts, and a Zeno point.
//! On the wall the force is hidden: the reaction takes it, and with `P_xd = P_vd = 0` so does the
//! filter, which keeps its estimate while `P_dd` grows.
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
mod memory;
mod settings;

pub use covariance::Covariance;
pub use memory::{Memory, Seen, REMEMBERED};
pub use settings::ObserverSettings;

use memory::Fitted;

use crate::setting::{is_positive, require};
use crate::{flight, Physical, SettingError};

/// Impacts of one period that are followed; a mass that has more is taken to rest.
const MAX_IMPACTS: u32 = 20;
/// The square of the standard deviations at which a measurement is refused.
const GATE: f64 = 25.0;
/// So many refused in a row restart the filter where the velocity is measured.
const PATIENCE: u32 = 5;
/// From so many on positions that agree do.
const DOUBT: u32 = 3;
/// So many positions do without agreement.
const LOST: u32 = 14;
/// Grazing: the speed in `(1 + e) a/v-` is taken to be at least this part of `h |a|`.
const GRAZING: f64 = 0.1;
/// Impacts slower than so many `s_x/h` tell nothing of `e`.
const SLOW: f64 = 10.0;
/// What a period adds to the variances of `x` and `x'`, of `s_x^2` and `(s_x/h)^2`: without it a
/// wrong `e` could never be corrected after a rest.
const FLOOR: [f64; 2] = [1e-10, 1e-12];
/// The same of the variance of a velocity that nothing is known of.
const UNKNOWN_SPEED: f64 = 100.0;
/// Deviations of the position within which the energy of the mass is bounded.
const HIGHEST: f64 = 6.0;
/// Restitutions that are learnt.
const LEARNT: [f64; 2] = [0.01, 0.999];
/// Largest variance of a restitution.
const UNKNOWN_E: f64 = 0.25;

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
    /// Whether the velocity waits for a second position.
    pub waiting: bool,
    /// The estimate.
    pub estimate: Estimate,
    /// The restitution: the estimate, where it is learnt.
    pub e: f64,
    /// Covariance of the estimates.
    pub covariance: Covariance,
    /// The last positions.
    pub memory: Memory,
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
        force: f64,
        u: f64,
    ) -> Result<Estimate, SettingError> {
        self.tick_after(self.settings.h, Some(measured), force, u)
    }

    /// The same `dt` (s) after the last one, where `q_d` is per `h`; `None` is a measurement that is
    /// missing: the motion is followed, nothing is corrected.
    ///
    /// # Errors
    /// As [`ImpactObserver::tick`], and for a `dt` that is not positive.
    pub fn tick_after(
        &mut self,
        dt: f64,
        measured: Option<Measurement>,
        force: f64,
        u: f64,
    ) -> Result<Estimate, SettingError> {
        let velocity = measured.and_then(|it| it.xdot).filter(|_| !self.settings.position_only);
        let measured = measured.map(|it| Measurement { xdot: velocity, ..it });
        let x = measured.map_or(0.0, |it| it.x);
        let xdot = velocity.unwrap_or(0.0);
        require(is_positive(dt), "dt", dt, "a finite time > 0 (s)")?;
        require(x.is_finite(), "x", x, "a finite position (m)")?;
        require(xdot.is_finite(), "xdot", xdot, "a finite velocity (m/s)")?;
        require(force.is_finite(), "force", force, "a finite force per unit mass (m/s^2)")?;
        require(u.is_finite(), "u", u, "a finite control (m/s^2)")?;
        let next = self.after(dt, measured, force + u);
        let sound = next.covariance.is_finite() && next.estimate.is_finite();
        require(sound, "x", x, "finite: the sample is too large to compute with")?;
        self.state = next;
        Ok(next.estimate)
    }

    /// The state after this time and this measurement, under a known acceleration.
    fn after(&self, dt: f64, measured: Option<Measurement>, known: f64) -> ObserverState {
        let mut next = self.state;
        let a = known + next.estimate.d;
        if next.started {
            next.memory.pass(dt, a);
            self.predict(&mut next, dt, a, velocity_of(measured));
        }
        let Some(measured) = measured else { return next };
        next.memory.see(measured.x);
        let ObserverSettings { noise: [of_x, _], dmax, .. } = self.settings;
        if !next.started {
            return self.start(next, measured);
        }
        if next.waiting && measured.xdot.is_some() {
            return self.start(next, measured);
        }
        if next.waiting {
            let fitted = next.memory.of_two(of_x, dmax * dmax);
            return fitted.map_or(next, |it| restarted(next, it));
        }
        self.correct(next, measured, a)
    }

    /// At the first measurement, or at the first of a velocity.
    fn start(&self, it: ObserverState, Measurement { x, xdot }: Measurement) -> ObserverState {
        let ObserverSettings { noise: [of_x, of_v], dmax, .. } = self.settings;
        let state = Physical { x: x.max(0.0), xdot: xdot.unwrap_or(0.0) };
        let unknown = self.fastest(state, of_x, dmax);
        let of_v = if xdot.is_some() { of_v } else { unknown };
        let covariance = Covariance::diagonal([of_x, of_v, dmax * dmax]);
        let covariance = Covariance { ee: it.covariance.ee, ..covariance };
        let (estimate, waiting) = (Estimate { state, d: it.estimate.d }, xdot.is_none());
        ObserverState { started: true, waiting, estimate, covariance, ..it }
    }

    /// The variance of a velocity of which only the height is known, up to the variance `of_x`, and
    /// the acceleration: by the energy.
    fn fastest(&self, Physical { x, xdot }: Physical, of_x: f64, a: f64) -> f64 {
        let ObserverSettings { noise: [noise, _], h, .. } = self.settings;
        let highest = x + HIGHEST * libm::sqrt(of_x);
        4.0 * (xdot * xdot + 2.0 * a.abs() * highest) + UNKNOWN_SPEED * noise / (h * h)
    }

    /// The state after `dt` under the acceleration `a`, through impacts and into rest; what is
    /// measured of the velocity then matters to what is unknown of it.
    fn predict(&self, it: &mut ObserverState, dt: f64, a: f64, measured: Option<f64>) {
        self.move_on(it, dt, a);
        let ObserverSettings { h, q_d, dmax, noise: [of_x, of_v], .. } = self.settings;
        let (share, [floor_x, floor_v]) = (dt / h, FLOOR);
        it.covariance.xx += floor_x * of_x * share;
        it.covariance.vv += floor_v * of_x / (h * h) * share;
        it.covariance.dd += q_d * share;
        it.covariance.bound_d(dmax * dmax);
        // a sensor that is worse than the motion has its own word
        let sensor = if measured.is_some() { 4.0 * of_v } else { 0.0 };
        it.covariance.bound_v(self.fastest(it.estimate.state, it.covariance.xx, a) + sensor);
    }

    fn move_on(&self, it: &mut ObserverState, dt: f64, a: f64) {
        let (e, mut left) = (it.e, dt);
        let mut at = it.estimate.state;
        if at.arrives() {
            at = self.bounce(it, at.xdot, a);
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
                    at = self.bounce(it, -flight::speed_at_wall(at, a), a);
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

    /// The state after an impact with `before < 0`. A slow one tells nothing of `e`, which is as
    /// uncertain as it was.
    fn bounce(&self, it: &mut ObserverState, before: f64, a: f64) -> Physical {
        let ObserverSettings { h, se, q_e, noise: [of_x, _], learn_e, .. } = self.settings;
        let (e, speed) = (it.e, before.abs());
        let least = speed.max(GRAZING * h * a.abs());
        let k = if least > 0.0 { -(1.0 + e) * a / least } else { 0.0 };
        let tells = learn_e && speed * speed * (h * h) >= SLOW * SLOW * of_x;
        it.covariance.bounce(e, k, if tells { speed } else { 0.0 });
        let of_e = if learn_e { it.covariance.ee } else { se * se };
        if !tells {
            it.covariance.vv += of_e * (before * before);
        }
        it.covariance.ee = (it.covariance.ee + q_e).min(UNKNOWN_E);
        Physical { x: 0.0, xdot: 0.0 - e * before }
    }

    /// The state after this measurement, if it is within the gate; `a` acted before it.
    fn correct(&self, predicted: ObserverState, measured: Measurement, a: f64) -> ObserverState {
        let ObserverSettings { noise: [of_x, of_v], dmax, .. } = self.settings;
        let mut it = predicted;
        let (gain, variance) = it.covariance.measure_x(of_x);
        let innovation = measured.x - it.estimate.state.x;
        it.shift(gain, innovation);
        let mut distance = innovation * innovation / variance;
        if let Some(xdot) = measured.xdot {
            let (gain, variance) = it.covariance.measure_v(of_v);
            let innovation = xdot - it.estimate.state.xdot;
            it.shift(gain, innovation);
            distance += innovation * innovation / variance;
        }
        if distance <= GATE {
            it.estimate.state.x = it.estimate.state.x.max(0.0);
            it.estimate.d = it.estimate.d.max(-dmax).min(dmax);
            if self.settings.learn_e {
                let [least, most] = LEARNT;
                it.e = it.e.max(least).min(most);
            }
            return ObserverState { in_a_row: 0, ..it };
        }
        let (in_a_row, refused) = (predicted.in_a_row + 1, predicted.refused.saturating_add(1));
        self.doubt(ObserverState { in_a_row, refused, ..predicted }, measured, a)
    }

    /// After a measurement that was refused: where the mass is taken to be from now on.
    fn doubt(
        &self,
        it: ObserverState,
        Measurement { x, xdot }: Measurement,
        a: f64,
    ) -> ObserverState {
        let ObserverSettings { noise: [of_x, of_v], dmax, .. } = self.settings;
        let of_d = 0.25 * dmax * dmax;
        let at = |xdot, of_v| Fitted {
            state: Physical { x: x.max(0.0), xdot },
            covariance: Covariance::diagonal([4.0 * of_x, of_v, of_d]),
        };
        match xdot {
            Some(xdot) if it.in_a_row >= PATIENCE => restarted(it, at(xdot, 4.0 * of_v)),
            None if it.in_a_row >= DOUBT => match it.memory.consensus(of_x, dmax) {
                Some(fitted) => restarted(it, fitted),
                None if it.in_a_row >= LOST => {
                    let still = Physical { x: x.max(0.0), xdot: 0.0 };
                    restarted(it, at(0.0, self.fastest(still, of_x, a)))
                }
                None => it,
            },
            _ => it,
        }
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
        self.state = self.settings.unseen();
    }

    /// The settings.
    #[must_use]
    pub fn settings(&self) -> &ObserverSettings {
        &self.settings
    }
}

/// The velocity that is measured.
fn velocity_of(measured: Option<Measurement>) -> Option<f64> {
    measured.and_then(|it| it.xdot)
}

/// From here on; `d` and `e` keep their values, and `e` what is unknown of it.
fn restarted(it: ObserverState, Fitted { state, covariance }: Fitted) -> ObserverState {
    let state = Physical { x: state.x.max(0.0), ..state };
    let covariance = Covariance { ee: it.covariance.ee, ..covariance };
    let estimate = Estimate { state, ..it.estimate };
    ObserverState { waiting: false, in_a_row: 0, estimate, covariance, ..it }
}

impl ObserverState {
    #[inline]
    fn shift(&mut self, [x, v, d, e]: [f64; 4], innovation: f64) {
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
