//! Landing: how a controller whose target rests on the wall brings a held control to exact rest.
//!
//! A tick that plans to *end* its period on the wall brakes too early: the mass, under the control
//! it holds, is there before, bounces, and may do so for ever in a cycle of a few periods. The
//! rule here plans no landing. It falls with the law's own net acceleration `D`, and takes as much
//! of the brake as stops a rising mass at the end of the horizon `N h`, not before:
//!
//! ```text
//! x'' = F + u = -g      g = clip((x' - q)/(N h), D, U)
//! regulator             D = mu1 - mu2 - F             U = mu1 + mu2 - F
//! tracker               D = (1 + kappa)(mu1 - mu2)    U = (1 - kappa)(mu1 + mu2)
//! ```
//!
//! Where `U < D` (a tracker on a wall with `e < (mu1 - mu2)/(mu1 + mu2)`) there is nothing between
//! them: `g = U` if `x' - q >= N h U`, else `g = D`. The dead zone `q` bounds the errors of the measured
//! velocity, 0 by default: with it they take no brake of a mass that rests, whose control is still.
//!
//! With `V = x'^2/2 + D x`: `V` is constant while the mass falls and does not grow while it rises
//! (`g >= D`); each impact multiplies it by `e^2` at least; and the last bounces lie within one
//! period of constant `g = D`, which ends them in exact rest. `g >= min(D, U)` whatever is measured:
//! noise cannot lift the mass. (Where `U < D`, `V` grows by `D/U` at most while the mass rises, and
//! `e^2 D/U < 1`.)
//!
//! An unknown force of at most `M`, one that follows the motion included, leaves all of it true of
//! `E = x'^2/2 + (D + M) x` and `v-^2 <= v+^2 (D + M)/(min(U, D) - M)`: the mass rests if
//! `M < (min(U, D) - e^2 D)/(1 + e^2)`, and for `M sgn x'` only then (docs/exact_rest.md).
//!
//! `N = 1 + d` where a control acts `d` periods after its measurement: until then the mass rises on.
//! The brake of such a loop, `v' = -v(t - d h)/(N h)`, does not swing over if
//! `N >= (1 + d)^(1 + d)/d^d`.

use super::monotone::cut;
use super::{GainError, Gains};
use crate::setting::{is_not_negative, is_positive, require};
use crate::Real;
use crate::{sgn, Physical, Restitution, SettingError};

/// The horizon of a landing.
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

/// The tracker's landing, which its control follows while the reference rests.
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
    /// The landing of a tracker with these gains above this wall; a mass at rest is pressed with
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
