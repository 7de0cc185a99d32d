//! Landing: how a controller whose target rests on the wall brings a held control to exact rest.
//!
//! A tick that plans to *end* its period on the wall brakes too early: the mass, under the control
//! it holds, is there before, bounces, and may do so for ever in a cycle of a few periods. The
//! rule here plans no landing. It falls with the law's own net acceleration `D`, and takes as much
//! of the brake as stops a rising mass at the end of the horizon `N h`, not before:
//!
//! ```text
//! x'' = F + u = -g      g = clip(x'/(N h), D, U)
//! regulator             D = mu1 - mu2 - F             U = mu1 + mu2 - F
//! tracker               D = (1 + kappa)(mu1 - mu2)    U = (1 - kappa)(mu1 + mu2)
//! ```
//!
//! Where `U < D` (a tracker on a wall with `e < (mu1 - mu2)/(mu1 + mu2)`) there is nothing between
//! them: `g = U` if `x' >= N h U`, else `g = D`.
//!
//! With `V = x'^2/2 + D x`: `V` is constant while the mass falls and does not grow while it rises
//! (`g >= D`); each impact multiplies it by `e^2` at least; and the last bounces lie within one
//! period of constant `g = D`, which ends them in exact rest. `g >= min(D, U)` whatever is measured:
//! noise cannot lift the mass. (Where `U < D`, `V` grows by `D/U` at most while the mass rises, and
//! `e^2 D/U < 1`.)
//!
//! `N = 1 + d` where a control acts `d` periods after its measurement: until then the mass rises on.

use super::monotone::cut;
use super::{GainError, Gains};
use crate::setting::{is_positive, require};
use crate::{sgn, Physical, Restitution, SettingError};

/// The horizon of a landing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landing {
    ahead: u32,
    /// `N h` (s).
    horizon: f64,
}

impl Landing {
    /// The horizon `ahead` sampling periods `h` (s), `1 + d` where a control acts `d` periods after
    /// its measurement.
    ///
    /// # Errors
    /// [`SettingError`] unless `ahead >= 1` and `ahead h` is finite and positive.
    pub fn new(ahead: u32, h: f64) -> Result<Self, SettingError> {
        let range = "at least 1 period: 1 + the periods of delay";
        require(ahead >= 1, "ahead", f64::from(ahead), range)?;
        let horizon = f64::from(ahead) * h;
        let range = "a sampling period > 0 with a finite product ahead h";
        require(is_positive(horizon), "h", h, range)?;
        Ok(Self { ahead, horizon })
    }

    /// The same of numbers that were checked before and are not checked again.
    #[inline]
    #[must_use]
    pub fn trusted(ahead: u32, h: f64) -> Self {
        Self { ahead, horizon: f64::from(ahead) * h }
    }

    /// The horizon in periods.
    #[must_use]
    pub fn ahead(&self) -> u32 {
        self.ahead
    }

    /// The regulator's sign of the velocity under the force `f`: the `lv` in `[-1, 1]` with
    /// `mu1 - F + mu2 lv = x'/(N h)`, cut to that range.
    #[inline]
    pub(super) fn lambda_v(&self, xdot: f64, f: f64, gains: Gains) -> f64 {
        cut((xdot / self.horizon - (gains.mu1() - f)) / gains.mu2())
    }
}

/// `Ok` if `press` is a `g` of a mass that rests: at least the bound of the unknown force.
pub(super) fn checked_press(press: f64, bound: f64) -> Result<(), GainError> {
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
    falling: f64,
    /// `U` (m/s^2).
    braking: f64,
    /// `g` of a mass that rests (m/s^2).
    press: f64,
}

impl Descent {
    /// The landing of a tracker with these gains above this wall; a mass at rest is pressed with
    /// `press`, by default `D`.
    #[inline]
    pub(super) fn new(
        landing: Landing,
        gains: Gains,
        restitution: Restitution,
        press: Option<f64>,
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
    pub fn accelerations(&self) -> [f64; 3] {
        [self.falling, self.braking, self.press]
    }

    /// `g`: the acceleration towards the wall, control and force together.
    #[inline]
    pub(super) fn towards_wall(&self, state: Physical) -> f64 {
        let (horizon, xdot) = (self.landing.horizon, state.xdot);
        if state.is_at_origin() {
            self.press
        } else if xdot >= horizon * self.braking {
            self.braking
        } else {
            // below U: also where U < D
            let share = xdot / horizon;
            if share > self.falling {
                share
            } else {
                self.falling
            }
        }
    }

    /// `ls, lv, les, lev` that stand for `g` in the law: both errors above, the brake in part.
    #[inline]
    pub(super) fn signs(xdot: f64, g: f64, gains: Gains, restitution: Restitution) -> [f64; 4] {
        let lambda_v = sgn(xdot);
        let lambda_ev = cut((g / restitution.r(1.0, lambda_v) - gains.mu1()) / gains.mu2());
        [1.0, lambda_v, 1.0, lambda_ev]
    }
}
