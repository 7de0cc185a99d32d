//! Runs of many kinds: a sampled controller with its plant, many runs on all cores.

pub mod batch;
pub mod closed_loop;
pub mod mechanical;

use crate::Status;

// Counts of the control updates of a loop, for one mass or a mechanism.

/// The bit of a saturated control (`zivi_core::control::TickStatus`).
pub const SATURATED: u8 = 2;
/// The bit of a sample or a control that was rejected.
pub const REFUSED: u8 = 4;
/// The bit of a failed general solver (`zivi_core::control::TickStatus`).
pub const UNSOLVED: u8 = 8;
/// The bit of a contact that was held and opened.
pub const LATCH_LOST: u8 = 16;

/// How many control updates a loop had, and how many of them failed in which way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Updates {
    /// All of them.
    pub total: u64,
    /// The sample or the control was rejected, the last control was held.
    pub rejected: u64,
    /// The control was cut to its limits.
    pub saturated: u64,
    /// The general solver found no signs.
    pub unsolved: u64,
    /// A contact that was held opened.
    pub lost: u64,
    /// Whether all of the last tenth were rejected.
    pub ended_rejected: bool,
}

impl Updates {
    /// Of the bits of all updates.
    #[must_use]
    pub fn of(bits: &[u8]) -> Self {
        let count = |bit: u8| bits.iter().filter(|it| **it & bit != 0).count() as u64;
        let last = bits.len().div_ceil(10);
        let (_, end) = bits.split_at(bits.len() - last);
        Self {
            total: bits.len() as u64,
            rejected: count(REFUSED),
            saturated: count(SATURATED),
            unsolved: count(UNSOLVED),
            lost: count(LATCH_LOST),
            ended_rejected: !end.is_empty() && end.iter().all(|it| it & REFUSED != 0),
        }
    }

    /// How a loop ended that otherwise ended with `status`.
    #[must_use]
    pub fn ending(&self, status: Status) -> Status {
        match status {
            Status::Completed if self.ended_rejected => Status::ControlRejected,
            other => other,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_those_of_a_tick() {
        let tick =
            zivi_core::control::TickStatus { clamped: false, saturated: true, unsolved: true };
        assert_eq!(tick.bits(), SATURATED | UNSOLVED);
    }

    #[test]
    fn a_loop_fails_whose_last_tenth_of_updates_was_rejected() {
        let of = |total: usize, last: usize| {
            let bits: Vec<u8> = (0..total).map(|k| if k + last < total { 2 } else { 5 }).collect();
            let it = Updates::of(&bits);
            assert_eq!((it.total, it.rejected), (total as u64, last as u64));
            assert_eq!(it.saturated, (total - last) as u64);
            it.ending(Status::Completed)
        };
        for (total, least) in [(1, 1), (7, 1), (11, 2), (100, 10), (101, 11), (2000, 200)] {
            assert_eq!(of(total, least), Status::ControlRejected, "{total}");
            assert_eq!(of(total, least - 1), Status::Completed, "{total}");
        }
        let none = Updates::of(&[]);
        assert_eq!(none.ending(Status::Completed), Status::Completed);
        let all = Updates::of(&[REFUSED; 20]);
        assert_eq!(all.ending(Status::TerminatedByEvent), Status::TerminatedByEvent);
    }
}
