//! What a tracker is made of and what it remembers, as plain numbers.

use super::reference_state::ReferenceState;
use super::{Gains, Landing, Port, TickStatus};
use crate::{Lifted, Real, Restitution};

/// Which of its two preimages the measured state is lifted to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Approach {
    /// The plant and the reference to `s >= 0`, every period (the paper).
    #[default]
    Positive,
    /// The plant to the image `sigma (s, v)` that is nearer to `(s_r, v_r)`, which itself evolves
    /// continuously, by the energy of the error `mu1 |e_s| + e_v^2/2`: the same in all units. Of two
    /// at equal distance the one on the side of the reference.
    Nearest,
}

/// Everything that a tracker is made of, for one that is stored as plain numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerSettings {
    /// The gains.
    pub gains: Gains,
    /// Sampling period (s).
    pub h: Real,
    /// The plant's wall.
    pub restitution: Restitution,
    /// The reference's wall.
    pub restitution_ref: Restitution,
    /// How measurements are lifted.
    pub approach: Approach,
    /// How it lands; `None` is the paper's tick.
    pub landing: Option<Landing>,
    /// Acceleration towards the wall of a mass at rest (m/s^2), `None` for the law's own.
    pub press: Option<Real>,
    /// Periods that a step is planned over.
    pub horizon: Real,
    /// Whether the measured velocity is taken half a period back in the air.
    pub shift: bool,
    /// The limits of the sensor and of the actuator.
    pub port: Port,
}

/// What the tracker remembers between ticks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerState {
    /// The reference `(s_r, v_r)`.
    pub reference: Lifted,
    /// The side of the wall on which the reference was last, `+1` or `-1`.
    pub side: Real,
    /// The last control (m/s^2).
    pub u: Real,
    /// The last `ls, lv, lsr, lvr, les, lev`.
    pub signs: [Real; 6],
    /// What was done to the last sample and control.
    pub status: TickStatus,
    /// Iterations of the last tick: [`Tracking::iterations`].
    pub iterations: u32,
}

impl TrackerState {
    /// The reference at rest.
    pub(super) const REST: Self = Self {
        reference: Lifted { s: 0.0, v: 0.0 },
        side: 1.0,
        u: 0.0,
        signs: [0.0; 6],
        status: TickStatus { clamped: false, saturated: false, unsolved: false },
        iterations: 0,
    };

    /// Nothing done yet, the reference here.
    pub(super) fn starting(ReferenceState { z, side }: ReferenceState) -> Self {
        Self { reference: z, side, ..Self::REST }
    }

    /// The reference.
    #[inline]
    pub(super) fn followed(&self) -> ReferenceState {
        ReferenceState { z: self.reference, side: self.side }
    }
}
