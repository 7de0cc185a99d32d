//! What a mechanical system does: on which contacts it moves, and what comes next.
//!
//! The mode is the set of closed gaps, and what friction does. Flight is motion without any contact,
//! and one equation serves all modes, so that there are no two cases with data of their own as there
//! are for a mass, whose rest needs no equation.

use crate::record::contact_mode::ContactMode;
use crate::record::gap_set::GapSet;
use crate::zeno::table::Landing;

/// What the gaps do that touch, or touched when the last step began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Contacts {
    /// Some stay closed; what friction does.
    pub(super) mode: ContactMode,
    /// They open: they are not looked out for in the first step.
    pub(super) left: GapSet,
    /// The channels that begin to slip: their slip does not end in the first step.
    pub(super) released: GapSet,
}

/// What limits a mode: a number that must stay positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Limit {
    /// The contact force of a gap.
    Force(usize),
    /// The force of a channel that sticks, in this direction.
    Stick(usize, f64),
    /// The margin that all inequalities leave undetermined forces.
    Margin,
    /// The determinant of `K`.
    Regularity,
}

/// What comes next.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Next {
    /// A step, or the part of it up to an event.
    Step,
    /// The impact of these gaps, here.
    LocatedEvent(GapSet),
    /// The opening of a contact whose force vanishes here, or the end of sticking, in a step of the
    /// length `h`.
    Release { limit: Limit, h: f64 },
    /// The end of the slip in some channels.
    Stop(GapSet),
    /// The jump to where the impacts accumulate.
    Jump(Ahead),
}

impl Next {
    /// The jump, if the accumulation is known.
    pub(super) fn jump(ahead: Option<Ahead>) -> Self {
        ahead.map_or(Self::Step, Self::Jump)
    }

    /// Whether something happens before the time moves on beyond `t_end`.
    pub(super) fn is_due(&self, t_end: f64) -> bool {
        match self {
            Self::LocatedEvent(_) | Self::Release { .. } | Self::Stop(_) => true,
            Self::Jump(ahead) => ahead.landing.t <= t_end,
            Self::Step => false,
        }
    }
}

/// What bounces on what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Key {
    /// The gaps that are hit together.
    pub(super) hit: GapSet,
    /// The mode of the flight between the impacts: which gaps stay closed.
    pub(super) flight: ContactMode,
    /// The mode to which they lead: what friction does at the gaps that are hit is what it does in
    /// the impacts.
    pub(super) landed: ContactMode,
}

/// Where impacts accumulate.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ahead {
    pub(super) landing: Landing<Vec<f64>>,
    /// The gaps that close together, if it is no Zeno point of a chain.
    pub(super) corner: Option<GapSet>,
}
