//! What a closed loop keeps beside its samples: the motion between them, and events of the user.

use zivi_core::{Lifted, Physical};

use super::plant::Plant;
use super::reference::Followed;
use super::Period;
use crate::record::failure::Failure;
use crate::record::reserve::Reserve;
use crate::switched::Watch;
use crate::{DensePath, EventHit, Impact, PathPoint, UserEvent};

/// What a closed loop may be given beside its surroundings, and what it shall keep.
pub struct LoopOptions<'a, E> {
    /// The reference, if it is given: the controller does not advance one of its own then.
    pub reference: Option<Followed<'a, E>>,
    /// Whether to keep the motion between the samples.
    pub dense: bool,
    /// The user's events. A level is a function as others are.
    pub events: Vec<UserEvent<'a, E>>,
}

impl<E> Default for LoopOptions<'_, E> {
    fn default() -> Self {
        Self { reference: None, dense: false, events: Vec::new() }
    }
}

/// The motion of the plant between its samples.
#[derive(Clone, Debug, PartialEq)]
pub enum LoopPath {
    /// Exact, from each sample under this force and the control that is held.
    Ballistic(f64),
    /// That of the switched method.
    Switched(DensePath),
    /// `s` and `v` at the samples, linear between them.
    Lifted(Vec<Lifted>),
}

/// Follows the events of the user along the plant.
pub(super) struct Follower<'e, 'a, E> {
    watch: Watch<'e, 'a, E>,
    reserve: Reserve,
    started: bool,
    /// Impacts that were seen.
    impacts: usize,
}

impl<'e, 'a, E> Follower<'e, 'a, E> {
    pub(super) fn new(events: &'e mut [UserEvent<'a, E>]) -> Self {
        // a function that tells the distance from a level has its zeros where the level is crossed
        events.iter_mut().for_each(|event| event.level = None);
        let watch = Watch::new(events);
        Self { watch, reserve: Reserve::default(), started: false, impacts: 0 }
    }

    /// Follows a period that is over; whether an event ends the run.
    pub(super) fn follow(
        &mut self,
        Period { t, t_next, .. }: Period,
        (from, to): (Physical, Physical),
        plant: &impl Plant<E>,
    ) -> Result<bool, Failure<E>> {
        if self.watch.is_idle() {
            return Ok(false);
        }
        self.watch.make_room(&mut self.reserve)?;
        if !self.started {
            self.watch.start(t, point(from)).map_err(Failure::Raised)?;
            self.started = true;
        }
        let impacts = &plant.impacts()[self.impacts..];
        self.impacts += impacts.len();
        let stop = self.pieces((t, t_next), to, impacts, plant).map_err(Failure::Raised)?;
        Ok(stop.is_some())
    }

    /// Follows the smooth pieces between impacts, and the jumps.
    fn pieces(
        &mut self,
        (mut t, t_next): (f64, f64),
        end: Physical,
        impacts: &[Impact],
        plant: &impl Plant<E>,
    ) -> Result<Option<EventHit>, E> {
        for &Impact { t: at, xdot_before, xdot_after } in impacts {
            let contact = point(Physical { x: 0.0, xdot: xdot_before });
            let motion = |time: f64| if time >= at { contact } else { point(plant.at(time)) };
            let mut stop = None;
            if at > t {
                stop = self.watch.along(t, at, motion, |_| Vec::new())?;
            }
            if stop.is_none() {
                stop = self.watch.across(at, point(Physical { x: 0.0, xdot: xdot_after }))?;
            }
            if stop.is_some() {
                return Ok(stop);
            }
            t = at;
        }
        let motion = |time: f64| point(if time >= t_next { end } else { plant.at(time) });
        self.watch.along(t, t_next, motion, |_| Vec::new())
    }

    /// What happened of each event.
    pub(super) fn into_hits(self) -> Vec<Vec<EventHit>> {
        self.watch.into_hits()
    }
}

fn point(Physical { x, xdot }: Physical) -> PathPoint {
    PathPoint { x, xdot, sigma: 1.0 }
}
