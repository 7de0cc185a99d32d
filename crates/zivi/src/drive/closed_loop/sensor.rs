//! What the controller sees of the state: noise, then quantisation.

use zivi_core::Physical;

/// The measurement of the state.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sensor<'a> {
    /// Added to `x` at each sample (m); none if empty.
    pub noise_x: &'a [f64],
    /// Added to `x'` at each sample (m/s); none if empty.
    pub noise_xdot: &'a [f64],
    /// Resolution of the position and of the velocity (m, m/s); `0` is exact.
    pub resolution: (f64, f64),
}

impl Sensor<'_> {
    /// The state as it is measured at the `k`-th sample.
    #[must_use]
    pub fn measure(&self, k: usize, state: Physical) -> Physical {
        let noise = |values: &[f64]| values.get(k).copied().unwrap_or(0.0);
        Physical {
            x: rounded(state.x + noise(self.noise_x), self.resolution.0),
            xdot: rounded(state.xdot + noise(self.noise_xdot), self.resolution.1),
        }
    }
}

/// The nearest multiple of `resolution`.
fn rounded(value: f64, resolution: f64) -> f64 {
    if resolution > 0.0 {
        (value / resolution).round() * resolution
    } else {
        value
    }
}
