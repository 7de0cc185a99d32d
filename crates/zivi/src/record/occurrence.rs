//! What happens at the gaps, in one stream.

use super::gap_set::GapSet;
use super::impact::Impact;

/// What happens at the gaps of a system; a mass above a wall has one, number 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Occurrence {
    /// An impulse at a gap: it was hit, or it was closed and passes on the impact of another.
    Impact {
        /// Time (s).
        t: f64,
        /// The gap.
        gap: usize,
        /// Speed of the gap before, `<= 0`; zero where it was closed.
        before: f64,
        /// Speed of the gap after, `>= 0`.
        after: f64,
        /// The impulse along the gradient of the gap (of a mass: by its mass).
        impulse: f64,
        /// Impulses of one impact have the same number.
        group: u64,
    },
    /// A gap closed: through infinitely many impacts, or by one that stops it.
    Zeno {
        /// Time (s).
        t: f64,
        /// The gap.
        gap: usize,
        /// The gaps that are closed after it.
        closed: GapSet,
    },
    /// A gap is closed from the start on, or closed without an impact.
    Contact {
        /// Time (s).
        t: f64,
        /// The gap.
        gap: usize,
    },
    /// A contact opened because its force vanished.
    LiftOff {
        /// Time (s).
        t: f64,
        /// The gap.
        gap: usize,
    },
    /// A contact was opened by an impact on another gap.
    Opened {
        /// Time (s).
        t: f64,
        /// The gap.
        gap: usize,
    },
    /// Several gaps closed together, by accumulations of accumulations.
    Corner {
        /// Time (s).
        t: f64,
        /// The gaps.
        gaps: GapSet,
    },
    /// The friction of an impact in a channel of a gap, after the `Impact` of that.
    Tangential {
        /// Time (s).
        t: f64,
        /// The channel.
        channel: usize,
        /// Slip speed before.
        before: f64,
        /// Slip speed after.
        after: f64,
        /// The impulse along the tangent.
        impulse: f64,
        /// Whether it sticks in the impact.
        sticks: bool,
        /// As that of the impact.
        group: u64,
    },
    /// A channel of friction sticks from now on, or slips, or slips the other way.
    Transition {
        /// Time (s).
        t: f64,
        /// The channel.
        channel: usize,
        /// What it did: 1 and -1 slip, 0 stick, 2 the gap was open.
        before: i8,
        /// What it does.
        after: i8,
    },
    /// What is said of an impact or lift-off that the data do not determine continuously.
    Flag {
        /// Which.
        kind: FlagKind,
        /// Time (s).
        t: f64,
        /// The gaps.
        gaps: GapSet,
        /// How strong: the kinetic cosine, or the time by which the order is uncertain (s).
        size: f64,
    },
}

impl Occurrence {
    /// The impact of this number of a mass above a wall.
    #[must_use]
    pub fn of_mass(impact: Impact, number: u64) -> Self {
        let Impact { t, xdot_before: before, xdot_after: after } = impact;
        Occurrence::Impact { t, gap: 0, before, after, impulse: after - before, group: number }
    }

    /// When it happened (s).
    #[must_use]
    pub fn t(&self) -> f64 {
        match *self {
            Occurrence::Impact { t, .. }
            | Occurrence::Zeno { t, .. }
            | Occurrence::Contact { t, .. }
            | Occurrence::LiftOff { t, .. }
            | Occurrence::Opened { t, .. }
            | Occurrence::Tangential { t, .. }
            | Occurrence::Transition { t, .. }
            | Occurrence::Corner { t, .. }
            | Occurrence::Flag { t, .. } => t,
        }
    }

    /// Whether it happened at a gap, perhaps among others.
    #[must_use]
    pub fn concerns(&self, number: usize) -> bool {
        match *self {
            Occurrence::Impact { gap, .. }
            | Occurrence::Zeno { gap, .. }
            | Occurrence::Contact { gap, .. }
            | Occurrence::LiftOff { gap, .. }
            | Occurrence::Opened { gap, .. } => gap == number,
            Occurrence::Corner { gaps, .. } | Occurrence::Flag { gaps, .. } => gaps.has(number),
            Occurrence::Tangential { .. } | Occurrence::Transition { .. } => false,
        }
    }

    /// A mass comes to rest at a wall at time `t` (s), through impacts.
    #[must_use]
    pub fn rest_of_mass(t: f64) -> Self {
        Occurrence::Zeno { t, gap: 0, closed: GapSet::of(0) }
    }

    /// A mass leaves rest at a wall at time `t` (s).
    #[must_use]
    pub fn lift_off_of_mass(t: f64) -> Self {
        Occurrence::LiftOff { t, gap: 0 }
    }
}

/// Why an impact or lift-off is not determined continuously by the data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlagKind {
    /// Coupled gaps were hit, or opened, together.
    Simultaneous,
    /// A coupled gap would have been hit within the tolerance of the time.
    OrderUncertain,
    /// An impact with friction raised the energy; the size is by how much (J).
    EnergyGain,
    /// Several impulses solve an impact with friction.
    ImpactNotUnique,
    /// The forces of contact are not unique, the motion is; the size is how far they may vary.
    UndeterminedForces,
    /// The motion depends on how contacts share their forces: gaps carry a load before joints do, with the
    /// least forces that press, and what can stick sticks.
    UndeterminedMotion,
    /// A slip speed touched zero: whether it sticks is not decided by the data.
    SlipGraze,
    /// No motion in contact obeyed the law of friction: an impact that no collision made.
    ImpactWithoutCollision,
    /// An accumulation was ended at the smallest speed, not extrapolated.
    ForcedLanding,
}

impl FlagKind {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            FlagKind::Simultaneous => "simultaneous",
            FlagKind::OrderUncertain => "order_uncertain",
            FlagKind::EnergyGain => "energy_gain",
            FlagKind::ImpactNotUnique => "impact_not_unique",
            FlagKind::UndeterminedForces => "undetermined_forces",
            FlagKind::UndeterminedMotion => "undetermined_motion",
            FlagKind::SlipGraze => "slip_graze",
            FlagKind::ImpactWithoutCollision => "impact_without_collision",
            FlagKind::ForcedLanding => "forced_landing",
        }
    }
}
