//! What a mechanical system does: on which contacts it moves, and what comes next.
//!
//! The mode is the set of closed gaps. Flight is motion without any of them, and one equation
//! serves all sets, so that there are no two cases with data of their own as there are for a mass,
//! whose rest needs no equation.

use crate::record::gap_set::GapSet;
use crate::zeno::table::Landing;

/// What the gaps do that touch, or touched when the last step began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Contacts {
    /// They stay closed.
    pub(super) closed: GapSet,
    /// They open: they are not looked out for in the first step.
    pub(super) left: GapSet,
}

/// What comes next.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Next {
    /// A step, or the part of it up to an event.
    Step,
    /// The impact of these gaps, here.
    LocatedEvent(GapSet),
    /// The opening of a contact whose force vanishes here, in a step of the length `h`.
    Release { gap: usize, h: f64 },
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
            Self::LocatedEvent(_) | Self::Release { .. } => true,
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
    /// The gaps that stay closed.
    pub(super) closed: GapSet,
}

/// Where impacts accumulate.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ahead {
    pub(super) landing: Landing<Vec<f64>>,
    /// The gaps that close together, if it is no Zeno point of a chain.
    pub(super) corner: Option<GapSet>,
}
