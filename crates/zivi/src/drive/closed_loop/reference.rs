//! Given references, and their branch at each sample.

use zivi_core::control::Waypoint;
use zivi_core::{Branch, Physical, Restitution};

use crate::stepping::ballistic;
use crate::Events;

/// A given reference at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferencePoint {
    /// Distance from the wall (m) and velocity (m/s).
    pub state: Physical,
    /// The side of the wall on which it is followed, where that is known.
    pub branch: Option<Branch>,
    /// Its acceleration from then on, where that is known (m/s^2).
    pub acceleration: Option<f64>,
}

/// A given reference of a loop.
pub trait Reference<E> {
    /// The reference at the `k`-th sample, the time `t`.
    ///
    /// # Errors
    /// What the function of the user raises.
    fn at(&mut self, k: usize, t: f64) -> Result<ReferencePoint, E>;
}

/// A reference that is known at all samples.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a>(pub &'a [ReferencePoint]);

impl<E> Reference<E> for Samples<'_> {
    fn at(&mut self, k: usize, _: f64) -> Result<ReferencePoint, E> {
        let missing = Physical { x: f64::NAN, xdot: f64::NAN };
        let unknown = ReferencePoint { state: missing, branch: None, acceleration: None };
        Ok(self.0.get(k).copied().unwrap_or(unknown))
    }
}

/// Input of an update from a reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferencePeriod {
    /// Where it is at the sample.
    pub now: Waypoint,
    /// Where it is at the next one.
    pub next: Waypoint,
    /// Its acceleration over the period (m/s^2), if known.
    pub acceleration: Option<f64>,
}

/// A reference and the wall above which it moves.
pub struct ReferenceWithWall<'a, E> {
    /// The reference.
    pub reference: &'a mut dyn Reference<E>,
    /// Its wall.
    pub restitution: Restitution,
}

/// Follows a given reference from sample to sample.
pub(super) struct ReferenceTracker<'a, E> {
    followed: ReferenceWithWall<'a, E>,
    branch: Branch,
    /// Its acceleration over the last period without an impact (m/s^2).
    pull: f64,
}

impl<'a, E> ReferenceTracker<'a, E> {
    pub(super) fn new(followed: ReferenceWithWall<'a, E>) -> Self {
        Self { followed, branch: Branch::Positive, pull: 0.0 }
    }

    /// The reference at a sample.
    pub(super) fn state(&mut self, k: usize, t: f64) -> Result<Physical, E> {
        Ok(self.followed.reference.at(k, t)?.state)
    }

    /// The reference over the period from the `k`-th sample on.
    pub(super) fn period(
        &mut self,
        k: usize,
        (t, t_next): (f64, f64),
    ) -> Result<ReferencePeriod, E> {
        let from = self.followed.reference.at(k, t)?;
        let to = self.followed.reference.at(k + 1, t_next)?;
        let now = from.branch.unwrap_or(self.branch);
        let pull = from.acceleration.unwrap_or(self.pull);
        let next = to.branch.unwrap_or_else(|| {
            if bounces(from.state, to.state, pull, self.followed.restitution, t_next - t) {
                other(now)
            } else {
                now
            }
        });
        if next == now {
            self.pull = (to.state.xdot - from.state.xdot) / (t_next - t);
        }
        self.branch = next;
        Ok(ReferencePeriod {
            now: Waypoint { state: from.state, branch: now },
            next: Waypoint { state: to.state, branch: next },
            acceleration: from.acceleration,
        })
    }
}

fn other(branch: Branch) -> Branch {
    match branch {
        Branch::Positive => Branch::Negative,
        Branch::Negative => Branch::Positive,
    }
}

/// Whether a reference has an odd number of impacts between two samples: whether its last
/// acceleration explains the second better with the impacts that it makes than without.
fn bounces(from: Physical, to: Physical, pull: f64, restitution: Restitution, h: f64) -> bool {
    let mut events = Events::default();
    let bounced = ballistic::advance(from, pull, restitution, (0.0, h), &mut events);
    if events.impacts.len() % 2 == 0 {
        return false;
    }
    let free =
        Physical { x: from.x + h * (from.xdot + 0.5 * pull * h), xdot: from.xdot + pull * h };
    let off = |it: Physical| (it.x - to.x).abs() + h * (it.xdot - to.xdot).abs();
    off(bounced) < off(free)
}
