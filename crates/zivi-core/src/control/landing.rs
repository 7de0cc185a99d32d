//! Landing: how a controller whose target rests on the wall brings a held control to exact rest.
//!
//! A tick that plans to *end* its period on the wall brakes too early: the mass, under the control
//! it holds, is there before, bounces, and may do so for ever in a cycle of a few periods. The
//! rule here plans no landing. It falls with the law's own net acceleration `D`, and takes as much
//! of the brake as stops a rising mass at the end of the horizon `N h`, not before:
//!
//! ```text
//! x'' = F + u = -g      g = clip(x'/(N h), D, U)      D = mu1 - mu2 - F,  U = mu1 + mu2 - F
//! ```
//!
//! With `V = x'^2/2 + D x`: `V` is constant while the mass falls and does not grow while it rises
//! (`g >= D`); each impact multiplies it by `e^2` at least; and the last bounces lie within one
//! period of constant `g = D`, which ends them in exact rest. `g >= D` whatever is measured: noise
//! cannot lift the mass.
//!
//! `N = 1 + d` where a control acts `d` periods after its measurement: until then the mass rises on.

use super::monotone::cut;
use super::Gains;
use crate::setting::require;
use crate::SettingError;

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
        require(horizon > 0.0 && horizon.is_finite(), "h", h, range)?;
        Ok(Self { ahead, horizon })
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
