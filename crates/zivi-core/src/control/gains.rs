//! Gains of twisting controllers, their conditions, and contact-establishing law.
//!
//! The gains of a twisting controller and the conditions for its stability.
//!
//! With `|d| <= M` the force that the controller does not know:
//!
//! ```text
//! tracker     M/R < mu2 < mu1 - M/R        R = 1 - kappa = 2e/(1 + e)
//! regulator   M - mu1 (1 - e^2)/(1 + e^2) < mu2 < mu1 - M
//! ```
//!
//! The tracker's gains act in the transform's coordinates, `e_s'' = R (..) + d`, and `R` is smallest
//! while the mass rises. The regulator falls with `D - M` at least (`D = mu1 - mu2`), and loses
//! energy from impact to impact if `e^2 (D + M)/(U - M) < 1` (`U = mu1 + mu2`): impacts help it.

use crate::control::cubic::cut;
use crate::setting::{is_not_negative, is_positive, require};
use crate::{sgn, Physical, Real, Restitution, SettingError};
use core::fmt;

/// `mu1 > mu2 > 0`: the gains on the sign of the position and of the velocity (m/s^2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    mu1: Real,
    mu2: Real,
}

/// A gain out of range, or too small for a bound of the unknown force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GainError {
    /// A setting is out of range.
    Setting(SettingError),
    /// A gain does not exceed the minimum for the bound.
    TooSmall {
        /// Name of the gain.
        name: &'static str,
        /// Its value (m/s^2).
        value: Real,
        /// The minimum (m/s^2).
        least: Real,
        /// The same as a formula.
        formula: &'static str,
        /// The bound of the unknown force (m/s^2).
        bound: Real,
    },
    /// The acceleration of a mass at rest towards the wall would not exceed the unknown force.
    Press {
        /// The acceleration towards the wall (m/s^2).
        value: Real,
        /// The bound of the unknown force (m/s^2).
        bound: Real,
    },
}

impl GainError {
    /// Name of the rejected gain.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            GainError::Setting(error) => error.name,
            GainError::TooSmall { name, .. } => name,
            GainError::Press { .. } => "press",
        }
    }
}

impl From<SettingError> for GainError {
    fn from(error: SettingError) -> Self {
        GainError::Setting(error)
    }
}

impl fmt::Display for GainError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            GainError::Setting(error) => error.fmt(out),
            GainError::TooSmall { name, value, least, formula, bound } => write!(
                out,
                "{name} must be greater than {formula} = {:?} m/s^2 for bound = {bound:?}, \
                 got {value:?}",
                rounded(*least)
            ),
            GainError::Press { value, bound } => write!(
                out,
                "press must be at least the bound of the unknown force, {bound:?} m/s^2, got {value:?}"
            ),
        }
    }
}

/// A number in a message, rounded to six decimals unless it is too large for them.
fn rounded(value: Real) -> Real {
    const SCALE: Real = 1e6;
    if value.abs() < 1e6 {
        // half away from zero; conversion truncates
        ((value * SCALE + if value < 0.0 { -0.5 } else { 0.5 }) as i64) as Real / SCALE
    } else {
        value
    }
}

impl core::error::Error for GainError {}

/// Larger gains overflow within an update.
const LARGEST: Real = crate::real::LARGE;

impl Gains {
    /// Gains with `0 < mu2 < mu1`.
    ///
    /// # Errors
    /// [`SettingError`] names the gain that is out of range.
    pub fn new(mu1: Real, mu2: Real) -> Result<Self, SettingError> {
        let range = if cfg!(feature = "single") {
            "a gain > 0 and at most 1e18 (m/s^2)"
        } else {
            "a gain > 0 and at most 1e150 (m/s^2)"
        };
        require(mu1 > 0.0 && mu1 <= LARGEST, "mu1", mu1, range)?;
        require(mu2 > 0.0 && mu2 < mu1, "mu2", mu2, "a gain with 0 < mu2 < mu1 (m/s^2)")?;
        Ok(Self { mu1, mu2 })
    }

    /// Gains that were checked before and are not checked again.
    #[inline]
    #[must_use]
    pub fn trusted(mu1: Real, mu2: Real) -> Self {
        Self { mu1, mu2 }
    }

    /// Gains with which a tracker follows whatever an unknown force does that is bounded by `bound`:
    /// `M/R < mu2 < mu1 - M/R` with `R = 2e/(1 + e)`.
    ///
    /// # Errors
    /// [`GainError`] names the gain that is too small and its minimum.
    ///
    /// ```
    /// use zivi_core::control::Gains;
    /// use zivi_core::Restitution;
    /// let restitution = Restitution::from_e(0.5)?; // R = 2/3
    /// assert!(Gains::for_tracking(30.0, 17.0, 8.6, restitution).is_ok());
    /// assert!(Gains::for_tracking(30.0, 17.0, 8.7, restitution).is_err()); // mu1 - mu2 < M/R
    /// # Ok::<(), zivi_core::RestitutionError>(())
    /// ```
    pub fn for_tracking(
        mu1: Real,
        mu2: Real,
        bound: Real,
        restitution: Restitution,
    ) -> Result<Self, GainError> {
        Self::bounded(mu1, mu2, bound, restitution)?.track(bound, restitution)
    }

    /// The same of [`Gains::bounded`] ones.
    ///
    /// # Errors
    /// [`GainError`] names the gain that is too small and its minimum.
    #[inline]
    pub fn track(self, bound: Real, restitution: Restitution) -> Result<Self, GainError> {
        let image = bound * (1.0 + restitution.e()) / (2.0 * restitution.e());
        self.exceed(bound, ("mu2", "bound (1 + e)/(2 e)"), image)?;
        self.exceed(bound, ("mu1", "mu2 + bound (1 + e)/(2 e)"), self.mu2 + image)?;
        Ok(self)
    }

    /// Gains with which a regulator stops the mass whatever a force does that is bounded by `bound`:
    /// `M - mu1 (1 - e^2)/(1 + e^2) < mu2 < mu1 - M`.
    ///
    /// # Errors
    /// [`GainError`] names the gain that is too small and its minimum.
    ///
    /// ```
    /// use zivi_core::control::Gains;
    /// use zivi_core::Restitution;
    /// let restitution = Restitution::from_e(0.5)?;
    /// assert!(Gains::for_regulation(3.0, 0.5, 2.2, restitution).is_ok()); // mu2 > 2.2 - 1.8
    /// assert!(Gains::for_regulation(3.0, 0.5, 2.2, Restitution::from_e(1.0)?).is_err());
    /// # Ok::<(), zivi_core::RestitutionError>(())
    /// ```
    pub fn for_regulation(
        mu1: Real,
        mu2: Real,
        bound: Real,
        restitution: Restitution,
    ) -> Result<Self, GainError> {
        Self::bounded(mu1, mu2, bound, restitution)?.regulate(bound, restitution)
    }

    /// The same of [`Gains::bounded`] ones.
    ///
    /// # Errors
    /// [`GainError`] names the gain that is too small and its minimum.
    #[inline]
    pub fn regulate(self, bound: Real, restitution: Restitution) -> Result<Self, GainError> {
        let square = restitution.e() * restitution.e();
        let lost = self.mu1 * (1.0 - square) / (1.0 + square);
        self.exceed(bound, ("mu1", "mu2 + bound"), self.mu2 + bound)?;
        let formula = "bound - mu1 (1 - e^2)/(1 + e^2)";
        self.exceed(bound, ("mu2", formula), bound - lost)?;
        Ok(self)
    }

    /// Gains, a `bound` of the unknown force and a restitution, each in its range.
    ///
    /// # Errors
    /// [`GainError`] names what is out of range.
    #[inline]
    pub fn bounded(
        mu1: Real,
        mu2: Real,
        bound: Real,
        restitution: Restitution,
    ) -> Result<Self, GainError> {
        let gains = Self::new(mu1, mu2)?;
        super::checked_wall(restitution, "e")?;
        let range = "a finite bound >= 0 of the unknown force (m/s^2)";
        require(is_not_negative(bound), "bound", bound, range)?;
        Ok(gains)
    }

    /// `Ok` if the gain with this name exceeds `least`, which is this formula for the bound.
    fn exceed(
        self,
        bound: Real,
        (name, formula): (&'static str, &'static str),
        least: Real,
    ) -> Result<(), GainError> {
        let value = if name == "mu1" { self.mu1 } else { self.mu2 };
        if value > least {
            Ok(())
        } else {
            Err(GainError::TooSmall { name, value, least, formula, bound })
        }
    }

    /// The gain on the sign of the position (m/s^2).
    #[inline]
    #[must_use]
    pub fn mu1(self) -> Real {
        self.mu1
    }

    /// The gain on the sign of the velocity (m/s^2).
    #[inline]
    #[must_use]
    pub fn mu2(self) -> Real {
        self.mu2
    }
}

// Contact-establishing law: how a controller whose target rests on the wall brings a held control to exact rest.
//
// An update that plans to *end* its period on the wall brakes too early: under the held control the
// mass arrives earlier, bounces, and may continue in a cycle of a few periods. The rule here plans
// no contact-establishing law. It falls with the law's own net acceleration `D`, and takes as much of the brake as
// stops a rising mass at the end of the horizon `N h`, not before:
//
// ```text
// x'' = F + u = -g      g = clip((x' - q)/(N h), D, U)
// regulator             D = mu1 - mu2 - F             U = mu1 + mu2 - F
// tracker               D = (1 + kappa)(mu1 - mu2)    U = (1 - kappa)(mu1 + mu2)
// ```
//
// Where `U < D` (a tracker on a wall with `e < (mu1 - mu2)/(mu1 + mu2)`) there is nothing between
// them: `g = U` if `x' - q >= N h U`, else `g = D`. The dead zone `q` bounds the errors of the measured
// velocity, 0 by default: with it they take no brake of a mass that rests, whose control is still.
//
// With `V = x'^2/2 + D x`: `V` is constant while the mass falls and does not grow while it rises
// (`g >= D`); each impact multiplies it by `e^2` at least; and the last bounces lie within one
// period of constant `g = D`, which ends them in exact rest. `g >= min(D, U)` whatever is measured:
// noise cannot lift the mass. (Where `U < D`, `V` grows by `D/U` at most while the mass rises, and
// `e^2 D/U < 1`.)
//
// For an unknown force of at most `M`, even one that depends on the motion, all of it holds for
// `E = x'^2/2 + (D + M) x` and `v-^2 <= v+^2 (D + M)/(min(U, D) - M)`: the mass rests if
// `M < (min(U, D) - e^2 D)/(1 + e^2)`, and for `M sgn x'` only then (docs/exact_rest.md).
//
// `N = 1 + d` where a control acts `d` periods after its measurement: until then the mass rises on.
// The brake of such a loop, `v' = -v(t - d h)/(N h)`, does not swing over if
// `N >= (1 + d)^(1 + d)/d^d`.

/// The horizon of a contact-establishing law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landing {
    ahead: u32,
    /// `N h` (s).
    horizon: Real,
    /// `q` (m/s).
    quiet: Real,
}

impl Landing {
    /// The horizon `ahead` sampling periods `h` (s), `1 + d` where a control acts `d` periods after
    /// its measurement.
    ///
    /// # Errors
    /// [`SettingError`] unless `ahead >= 1` and `ahead h` is finite and positive.
    pub fn new(ahead: u32, h: Real) -> Result<Self, SettingError> {
        let range = "at least 1 period: 1 + the periods of delay";
        require(ahead >= 1, "ahead", ahead as Real, range)?;
        let horizon = (ahead as Real) * h;
        let range = "a sampling period > 0 with a finite product ahead h";
        require(is_positive(horizon), "h", h, range)?;
        Ok(Self { ahead, horizon, quiet: 0.0 })
    }

    /// The same for a measured velocity whose errors are at most `quiet` (m/s).
    ///
    /// # Errors
    /// [`SettingError`] unless it is finite and `>= 0`.
    pub fn with_quiet(self, quiet: Real) -> Result<Self, SettingError> {
        let range = "a finite bound >= 0 of the velocity's errors (m/s)";
        require(is_not_negative(quiet), "quiet", quiet, range)?;
        Ok(Self { quiet, ..self })
    }

    /// The same of numbers that were checked before and are not checked again.
    #[inline]
    #[must_use]
    pub fn trusted(ahead: u32, h: Real, quiet: Real) -> Self {
        Self { ahead, horizon: (ahead as Real) * h, quiet }
    }

    /// The same for periods of `h` (s).
    #[inline]
    pub(super) fn of_periods(self, h: Real) -> Self {
        Self { horizon: (self.ahead as Real) * h, ..self }
    }

    /// The horizon in periods.
    #[must_use]
    pub fn ahead(&self) -> u32 {
        self.ahead
    }

    /// The dead zone of the velocity (m/s).
    #[must_use]
    pub fn quiet(&self) -> Real {
        self.quiet
    }

    /// The regulator's sign of the velocity under the force `f`: the `lv` in `[-1, 1]` with
    /// `mu1 - F + mu2 lv = (x' - q)/(N h)`, cut to that range.
    #[inline]
    pub(super) fn lambda_v(&self, xdot: Real, f: Real, gains: Gains) -> Real {
        cut(((xdot - self.quiet) / self.horizon - (gains.mu1() - f)) / gains.mu2())
    }

    /// Whether a measurement tells nothing from rest on the wall: the velocity is within its errors,
    /// the position within what these make of it in the horizon.
    #[inline]
    fn is_at_rest(&self, Physical { x, xdot }: Physical) -> bool {
        xdot.abs() <= self.quiet && x <= self.horizon * self.quiet
    }
}

/// `Ok` if `press` is a `g` of a mass that rests: at least the bound of the unknown force.
pub(super) fn checked_press(press: Real, bound: Real) -> Result<(), GainError> {
    require(press.is_finite(), "press", press, "a finite acceleration (m/s^2)")?;
    if press >= bound {
        Ok(())
    } else {
        Err(GainError::Press { value: press, bound })
    }
}

/// The tracker's contact-establishing law, which its control follows while the reference rests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Descent {
    landing: Landing,
    /// `D` (m/s^2).
    falling: Real,
    /// `U` (m/s^2).
    braking: Real,
    /// `g` of a mass that rests (m/s^2).
    press: Real,
}

impl Descent {
    /// The contact-establishing law of a tracker with these gains above this wall; a mass at rest is pressed with
    /// `press`, by default `D`.
    #[inline]
    pub(super) fn new(
        landing: Landing,
        gains: Gains,
        restitution: Restitution,
        press: Option<Real>,
    ) -> Self {
        let falling = restitution.r(1.0, -1.0) * (gains.mu1() - gains.mu2());
        let braking = restitution.r(1.0, 1.0) * (gains.mu1() + gains.mu2());
        Self { landing, falling, braking, press: press.unwrap_or(falling) }
    }

    /// The horizon.
    #[must_use]
    pub fn landing(&self) -> Landing {
        self.landing
    }

    /// `D`, `U` and the `g` of a mass that rests (m/s^2).
    #[must_use]
    pub fn accelerations(&self) -> [Real; 3] {
        [self.falling, self.braking, self.press]
    }

    /// `g`: the acceleration towards the wall, control and force together.
    #[inline]
    pub(super) fn towards_wall(&self, state: Physical) -> Real {
        let Landing { horizon, quiet, .. } = self.landing;
        let speed = state.xdot - quiet;
        if self.landing.is_at_rest(state) {
            self.press
        } else if speed >= horizon * self.braking {
            self.braking
        } else {
            // below U: also where U < D
            let share = speed / horizon;
            if share > self.falling {
                share
            } else {
                self.falling
            }
        }
    }

    /// `ls, lv, les, lev` that stand for `g` in the law: both errors above, the brake in part.
    #[inline]
    pub(super) fn signs(xdot: Real, g: Real, gains: Gains, restitution: Restitution) -> [Real; 4] {
        let lambda_v = sgn(xdot);
        let lambda_ev = cut((g / restitution.r(1.0, lambda_v) - gains.mu1()) / gains.mu2());
        [1.0, lambda_v, 1.0, lambda_ev]
    }
}
