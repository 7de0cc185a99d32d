//! Events at a gap: occurrences, their reader, impacts.
//!
//! Impacts, Zeno points, rest and lift-off at one gap, read from occurrences or from the steps of a
//! fixed-step run.

use crate::record::columns::Reserve;
use crate::record::gap_set::GapSet;
use std::collections::TryReserveError;
use zivi_core::transform::impact_velocities;
use zivi_core::{Lifted, Restitution};

/// Events at the wall in a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Events {
    /// The impacts that the steps resolve, in order.
    pub impacts: Vec<Impact>,
    /// Times at which rest was reached through impacts (s): the Zeno points as the scheme sees them.
    pub zeno_times: Vec<f64>,
    /// Times at which the mass left rest (s): the last instant at rest.
    pub liftoff_times: Vec<f64>,
    /// The time from which the mass is at rest until the end of the run (s), if any.
    pub rest_time: Option<f64>,
}

impl Events {
    /// Those of a mass that is at rest from the start on, at time `t` (s), or is not.
    #[must_use]
    pub fn starting(t: f64, at_rest: bool) -> Self {
        Self { rest_time: at_rest.then_some(t), ..Self::default() }
    }

    /// Reads what happened next. A gap that is closed does not close again, one that is open does
    /// not open.
    ///
    /// ```
    /// use zivi::{Events, Impact, Occurrence};
    ///
    /// let mut events = Events::default();
    /// let impact = Impact { t: 1.0, xdot_before: -2.0, xdot_after: 1.0 };
    /// events.note(Occurrence::of_mass(impact, 1));
    /// events.note(Occurrence::rest_of_mass(2.0));
    /// assert_eq!((events.impacts[0], events.rest_time), (impact, Some(2.0)));
    /// events.note(Occurrence::lift_off_of_mass(3.0));
    /// assert_eq!((events.zeno_times, events.liftoff_times), (vec![2.0], vec![3.0]));
    /// assert_eq!(events.rest_time, None);
    /// ```
    pub fn note(&mut self, occurrence: Occurrence) {
        match occurrence {
            Occurrence::Impact { t, before, after, .. } => {
                self.impacts.push(Impact { t, xdot_before: before, xdot_after: after });
            }
            Occurrence::Zeno { t, .. } => {
                if self.rest_time.is_none() {
                    self.zeno_times.push(t);
                    self.rest_time = Some(t);
                }
            }
            Occurrence::Contact { t, .. } | Occurrence::Corner { t, .. } => {
                self.rest_time.get_or_insert(t);
            }
            Occurrence::LiftOff { t, .. } => {
                if self.rest_time.take().is_some() {
                    self.liftoff_times.push(t);
                }
            }
            Occurrence::Opened { .. } => self.rest_time = None,
            Occurrence::Flag { .. }
            | Occurrence::Tangential { .. }
            | Occurrence::Transition { .. } => (),
        }
    }

    /// Reads what happened at one gap off the stream of all of them.
    ///
    /// ```
    /// use zivi::mechanics::GapSet;
    /// use zivi::{Events, Occurrence};
    ///
    /// let closed = GapSet::of(0).with(GapSet::of(1));
    /// let all = [
    ///     Occurrence::Zeno { t: 1.0, gap: 0, closed: GapSet::of(0) },
    ///     Occurrence::Zeno { t: 2.0, gap: 1, closed },
    ///     Occurrence::Opened { t: 3.0, gap: 0 },
    /// ];
    /// assert_eq!(Events::of_gap(0, &all).rest_time, None);
    /// assert_eq!(Events::of_gap(1, &all).rest_time, Some(2.0));
    /// ```
    #[must_use]
    pub fn of_gap(gap: usize, all: &[Occurrence]) -> Self {
        let mut events = Self::default();
        all.iter().filter(|it| it.concerns(gap)).for_each(|it| events.note(*it));
        events
    }

    /// Makes room for one more of each.
    pub(crate) fn make_room(&mut self, reserve: &mut Reserve) -> Result<(), TryReserveError> {
        reserve.room(&mut self.impacts, 1, IMPACT_ARRAYS)?;
        reserve.room(&mut self.zeno_times, 1, size_of::<f64>())?;
        reserve.room(&mut self.liftoff_times, 1, size_of::<f64>())
    }
}

/// Reads [`Events`] from a source without Zeno information: rest without an impact since the last
/// lift-off is not a Zeno point.
#[derive(Debug, Default)]
pub(crate) struct EventReader {
    pub(crate) events: Events,
    impacts_at_liftoff: usize,
}

impl EventReader {
    /// From the start on, where the mass is at rest or is not.
    pub(crate) fn starting(t: f64, at_rest: bool) -> Self {
        Self { events: Events::starting(t, at_rest), impacts_at_liftoff: 0 }
    }

    /// As [`Events::note`].
    pub(crate) fn note(&mut self, occurrence: Occurrence) {
        let impacts = self.events.impacts.len();
        self.events.note(match occurrence {
            Occurrence::Zeno { t, gap, .. } if impacts == self.impacts_at_liftoff => {
                Occurrence::Contact { t, gap }
            }
            other => other,
        });
        if let Occurrence::LiftOff { .. } = occurrence {
            self.impacts_at_liftoff = impacts;
        }
    }
}

/// Bytes that an impact takes in arrays that are made of a list: three columns, and one array of
/// records.
const IMPACT_ARRAYS: usize = 2 * size_of::<Impact>();

const ORIGIN: Lifted = Lifted { s: 0.0, v: 0.0 };

/// Reads events off consecutive states.
#[derive(Debug)]
pub(crate) struct EventLog {
    reader: EventReader,
    restitution: Restitution,
    reserve: Reserve,
}

impl EventLog {
    pub(crate) fn start(t0: f64, z: Lifted, incoming: bool, restitution: Restitution) -> Self {
        let reader = EventReader::starting(t0, z == ORIGIN);
        let mut log = Self { reader, restitution, reserve: Reserve::default() };
        if z != ORIGIN && incoming {
            log.impact(t0, z.v);
        }
        log
    }

    /// Notes what happened between two samples; nothing did while `s` keeps its sign.
    ///
    /// # Errors
    /// There is no memory left to note it.
    #[cold]
    #[inline(never)]
    pub(crate) fn step(
        &mut self,
        (t, before): (f64, Lifted),
        (t_next, after): (f64, Lifted),
    ) -> Result<(), TryReserveError> {
        if before.s * after.s > 0.0 {
            return Ok(());
        }
        self.reader.events.make_room(&mut self.reserve)?;
        self.at_the_wall((t, before), (t_next, after));
        Ok(())
    }

    #[cold]
    fn at_the_wall(&mut self, (t, before): (f64, Lifted), (t_next, after): (f64, Lifted)) {
        if before == ORIGIN {
            if after != ORIGIN {
                self.reader.note(Occurrence::lift_off_of_mass(t));
            }
        } else {
            if before.s != 0.0 && after.s == 0.0 {
                self.impact(t_next, if after.v == 0.0 { before.v } else { after.v });
            } else if (before.s > 0.0 && after.s < 0.0) || (before.s < 0.0 && after.s > 0.0) {
                let part = before.s / (before.s - after.s);
                self.impact(t + part * (t_next - t), before.v + part * (after.v - before.v));
            }
            if after == ORIGIN {
                self.reader.note(Occurrence::rest_of_mass(t_next));
            }
        }
    }

    fn impact(&mut self, t: f64, v: f64) {
        let (xdot_before, xdot_after) = impact_velocities(v, self.restitution);
        let number = self.impacts().len() as u64 + 1;
        self.reader.note(Occurrence::of_mass(Impact { t, xdot_before, xdot_after }, number));
    }

    pub(crate) fn impacts(&self) -> &[Impact] {
        &self.reader.events.impacts
    }

    pub(crate) fn finish(self) -> Events {
        self.reader.events
    }
}

// Events at the gaps, in one stream.

/// Events at the gaps of a system; a mass above a wall has one gap, number 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Occurrence {
    /// An impulse at a gap that was hit, or that is closed and transmits the impact on another gap.
    Impact {
        /// Time (s).
        t: f64,
        /// The gap.
        gap: usize,
        /// Speed of the gap before, `<= 0`; zero for a closed gap.
        before: f64,
        /// Speed of the gap after, `>= 0`.
        after: f64,
        /// The impulse along the gradient of the gap (of a mass: by its mass).
        impulse: f64,
        /// Impulses of one impact have the same number.
        group: u64,
    },
    /// A gap closed through infinitely many impacts or by one plastic impact.
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
    /// Several gaps closed together, by nested accumulations.
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
        /// Previous mode: 1 and -1 slip, 0 stick, 2 open gap.
        before: i8,
        /// New mode.
        after: i8,
    },
    /// Warning about an impact or lift-off that depends discontinuously on the data.
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
    /// Several motions obey the laws of contact and friction where contacts begin or end to slip.
    MotionNotUnique,
    /// The forces of contact are not unique, the motion is; the size is how far they may vary.
    UndeterminedForces,
    /// The motion depends on how contacts share their forces: gaps carry a load before joints do,
    /// with the least contact forces, and channels that can stick do.
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
            FlagKind::MotionNotUnique => "motion_not_unique",
            FlagKind::UndeterminedForces => "undetermined_forces",
            FlagKind::UndeterminedMotion => "undetermined_motion",
            FlagKind::SlipGraze => "slip_graze",
            FlagKind::ImpactWithoutCollision => "impact_without_collision",
            FlagKind::ForcedLanding => "forced_landing",
        }
    }
}

// An impact of a mass on its wall.

/// One impact: when, and the velocities on both sides of it (their ratio is `-e`).
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)] // lists of impacts are handed out as numbers
pub struct Impact {
    /// Time (s): where `s` crosses zero, linear within the step.
    pub t: f64,
    /// Velocity before, `-(1 + kappa) |v|` (m/s).
    pub xdot_before: f64,
    /// Velocity after, `(1 - kappa) |v|` (m/s).
    pub xdot_after: f64,
}

#[cfg(test)]
mod events_tests {
    use super::*;

    fn replay(states: &[(f64, f64)]) -> Events {
        let restitution = Restitution::from_kappa(0.5).unwrap();
        let z: Vec<Lifted> = states.iter().map(|&(s, v)| Lifted { s, v }).collect();
        let mut log = EventLog::start(0.0, z[0], false, restitution);
        for (k, pair) in z.windows(2).enumerate() {
            log.step((k as f64, pair[0]), (k as f64 + 1.0, pair[1])).unwrap();
        }
        log.finish()
    }

    #[test]
    fn rest_again_without_an_impact_is_no_zeno_point() {
        let events = replay(&[(1.0, -1.0), (0.0, 0.0), (0.0, 0.1), (0.0, 0.0)]);
        assert_eq!((events.zeno_times, events.liftoff_times), (vec![1.0], vec![1.0]));
        assert_eq!(events.rest_time, Some(3.0));
    }

    #[test]
    fn a_crossing_is_interpolated_and_obeys_restitution() {
        let events = replay(&[(1.0, -2.0), (-3.0, -2.0), (-4.0, -1.0)]);
        assert_eq!(events.impacts, [Impact { t: 0.25, xdot_before: -3.0, xdot_after: 1.0 }]);
    }

    #[test]
    fn a_stop_on_the_wall_is_one_impact_and_then_rest_and_liftoff() {
        let events = replay(&[(1.0, -2.0), (0.0, -2.0), (0.0, 0.0), (0.0, 0.0), (0.1, 1.0)]);
        assert_eq!(events.impacts.len(), 1);
        assert_eq!((events.zeno_times, events.liftoff_times), (vec![2.0], vec![3.0]));
        assert_eq!(events.rest_time, None);
    }

    #[test]
    fn rest_from_the_start_is_no_zeno_point() {
        let events = replay(&[(0.0, 0.0), (0.0, 0.0)]);
        assert_eq!(events, Events { rest_time: Some(0.0), ..Events::default() });
    }
}
