//! Optional records of a closed loop: the motion between samples, and user events.

use zivi_core::Physical;

use super::plant::Plant;
use super::reference::ReferenceWithWall;
use super::Period;
use crate::record::columns::Reserve;
use crate::record::status::Failure;
use crate::record::user_events::{unknown, EventLocator, SmoothPart};
use crate::{Impact, Kick, LocatedEvent, PathPoint, UserEvent};

/// Options of a closed loop: optional inputs and records.
pub struct LoopOptions<'a, E> {
    /// The given reference, if any: the controller then does not advance its own.
    pub reference: Option<ReferenceWithWall<'a, E>>,
    /// Whether to keep the motion between the samples.
    pub dense: bool,
    /// The user's events. A level is a function as others are.
    pub events: Vec<UserEvent<'a, E>>,
    /// Increasing times of kicks (s) and the velocities after them; those at a sample follow it.
    pub kicks: Option<(&'a [f64], Kick<'a, E, PathPoint>)>,
}

impl<E> Default for LoopOptions<'_, E> {
    fn default() -> Self {
        Self { reference: None, dense: false, events: Vec::new(), kicks: None }
    }
}

/// The events of the user along the plant.
pub(super) struct LoopEvents<'a, E> {
    seeker: EventLocator<'a, E, PathPoint>,
    reserve: Reserve,
    started: bool,
    /// Impacts that were seen.
    impacts: usize,
}

impl<'a, E> LoopEvents<'a, E> {
    /// Events of a run that takes a time (s).
    pub(super) fn new(events: Vec<UserEvent<'a, E>>, duration: f64) -> Self {
        let seeker = EventLocator::new(events, point(Physical::default()), duration);
        Self { seeker, reserve: Reserve::default(), started: false, impacts: 0 }
    }

    /// Follows a period that is over; whether an event ends the run.
    pub(super) fn follow(
        &mut self,
        Period { t, t_next, .. }: Period,
        (from, to): (Physical, Physical),
        plant: &impl Plant<E>,
    ) -> Result<bool, Failure<E>> {
        if self.seeker.is_idle() {
            return Ok(false);
        }
        self.seeker.make_room(&mut self.reserve)?;
        if !self.started {
            self.seeker.start(t, &point(from)).map_err(Failure::Raised)?;
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
    ) -> Result<Option<LocatedEvent>, E> {
        for &Impact { t: at, xdot_before, xdot_after } in impacts {
            let contact = point(Physical { x: 0.0, xdot: xdot_before });
            let motion = |time: f64, to: &mut PathPoint| {
                *to = if time >= at { contact } else { point(plant.at(time)) };
            };
            let mut stop = None;
            if at > t {
                let part = SmoothPart { span: (t, at), motion, crossings: unknown };
                stop = self.seeker.along(&part)?;
            }
            if stop.is_none() {
                stop = self.seeker.across(at, &point(Physical { x: 0.0, xdot: xdot_after }))?;
            }
            if stop.is_some() {
                return Ok(stop);
            }
            t = at;
        }
        let motion = |time: f64, to: &mut PathPoint| {
            *to = point(if time >= t_next { end } else { plant.at(time) });
        };
        self.seeker.along(&SmoothPart { span: (t, t_next), motion, crossings: unknown })
    }

    /// Occurrences of each event.
    pub(super) fn into_hits(self) -> Vec<Vec<LocatedEvent>> {
        self.seeker.into_hits()
    }
}

fn point(Physical { x, xdot }: Physical) -> PathPoint {
    PathPoint { x, xdot, sigma: 1.0 }
}
