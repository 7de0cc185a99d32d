//! The probes of contact forces along a motion with some gaps closed.

use crate::numeric::probes::Probes;
use crate::record::contact_mode::ContactMode;

/// The probes of the motion with some gaps closed.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ContactProbes {
    pub(super) probes: Probes,
    pub(super) mode: ContactMode,
    /// How far the end of the run was ahead when they closed (s).
    pub(super) horizon: f64,
}

impl ContactProbes {
    /// Where a step from `t` to `until` at most ends at the latest, with these gaps closed.
    pub(super) fn end(&mut self, mode: ContactMode, t: f64, until: f64) -> f64 {
        if mode != self.mode {
            *self = Self { mode, ..Self::default() };
        }
        self.horizon = self.horizon.max(until - t);
        self.probes.end(t, until)
    }

    /// How far the end of the run was ahead when these gaps closed (s).
    pub(super) fn horizon(&self) -> f64 {
        self.horizon
    }
}
