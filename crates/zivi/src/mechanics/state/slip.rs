//! The slips of a mechanical system, which have a place in its state.

use super::MechanicalState;
use crate::mechanics::kinetics::{without_rounding, Model};
use crate::record::contact_mode::ContactMode;
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::record::occurrence::Occurrence;
use crate::system::dynamics::{Dynamics, Layout};

/// A slip speed is as its direction says while that is larger than this part of the velocities.
const ANCHOR: f64 = 1e-6;
/// A slip speed of so many estimated errors after an accumulation may be none.
const STILL: f64 = 100.0;
/// What is left of an integrated slip speed where other rows leave none: its part that is rounding.
const HELD: f64 = 1e-3;

impl MechanicalState {
    /// The channels that begin to slip.
    pub(in crate::mechanics) fn released(&self) -> GapSet {
        self.contacts.released
    }

    /// Moves the coordinates back by how far a step has drifted along the channels that stick.
    pub(in crate::mechanics) fn undo_drift<E, D: Dynamics<E>>(
        &mut self,
        drift: &[f64],
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        if drift.iter().all(|drift| *drift == 0.0) {
            return Ok(());
        }
        self.evaluate(model)?;
        let Self { kinetics, now, layout: Layout { n, m, .. }, contacts, .. } = self;
        let rows = kinetics.rows_of(contacts.mode);
        let rows = kinetics.independent(rows);
        kinetics
            .solve(rows, |_, row| row.checked_sub(*m).map_or(0.0, |channel| -drift[channel]))?;
        kinetics.apply(rows, &mut now.x[..*n]);
        Ok(())
    }

    /// The least of what some channels could hold more than they do, relative to their limits, where the
    /// forces are known.
    pub(in crate::mechanics) fn least_hold(&self, channels: GapSet) -> Option<f64> {
        let hold = |channel: usize| {
            let limit = self.kinetics.friction_limits(channel).1;
            let most = self.kinetics.gap_of(channel).map_or(limit, |gap| limit * self.lambda[gap]);
            1.0 - self.lambda[self.kinetics.row(channel)].abs() / most
        };
        channels.iter().map(hold).reduce(f64::min)
    }

    /// The slip speeds, by channel.
    pub(in crate::mechanics) fn slips(&self) -> &[f64] {
        let Layout { n, m, p } = self.layout;
        &self.now.xdot[n + m..n + m + p]
    }

    /// Gives the channels at the gaps of a set the limits of friction that they have without slip, where
    /// the system has just been evaluated: impulses know no other.
    pub(in crate::mechanics) fn evaluate_limits_at_rest<E, D: Dynamics<E>>(
        &mut self,
        set: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let Self { kinetics, now, layout: Layout { n, .. }, .. } = self;
        let channels: GapSet = set.iter().filter_map(|gap| kinetics.channel_of(gap)).collect();
        let varies = |c: usize| {
            let (slip, stick) = kinetics.friction_limits(c);
            slip != stick
        };
        if !channels.iter().any(varies) {
            return Ok(());
        }
        let rows = channels.iter().map(|channel| kinetics.row(channel)).collect();
        let rows = kinetics.independent(rows);
        let (q, mut w) = (&now.x[..*n], now.xdot[..*n].to_vec());
        kinetics.solve(rows, |at, row| -at.rate(row, &now.xdot[..*n]))?;
        kinetics.apply(rows, &mut w);
        kinetics.evaluate(model, now.t, q, &w)?;
        let limits: Vec<f64> = channels.iter().map(|c| kinetics.friction_limits(c).0).collect();
        kinetics.evaluate(model, now.t, q, &now.xdot[..*n])?;
        for (channel, limit) in channels.iter().zip(limits) {
            kinetics.set_friction_limit(channel, limit);
        }
        Ok(())
    }

    /// Sets a slip speed that was integrated to what its direction says, where that has enough digits.
    pub(super) fn anchor_slip(&mut self, row: usize, rate: f64) {
        let n = self.layout.n;
        let size = self.now.xdot[..n].iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        let sticks = self.contacts.mode.stick.has(row - self.layout.m);
        if !sticks && rate.abs() > ANCHOR * (size + rate.abs()) {
            self.now.xdot[n + row] = rate;
        }
    }

    /// The slip in some channels is zero.
    pub(in crate::mechanics) fn stop_slip(&mut self, channels: GapSet) {
        let Layout { n, m, .. } = self.layout;
        channels.iter().for_each(|channel| self.now.xdot[n + m + channel] = 0.0);
    }

    /// Of some slipping channels those that the rows just projected on leave no speed but rounding: the
    /// tip of an arm on the floor whose only free joint stops. Their integrated slips say so to the
    /// tolerance only.
    pub(in crate::mechanics) fn held(&self, channels: GapSet) -> GapSet {
        let n = self.layout.n;
        let (q, w) = (&self.now.x[..n], &self.now.xdot[..n]);
        let held = |&channel: &usize| {
            let row = self.kinetics.row(channel);
            let (rate, slip) = (self.kinetics.rate(row, w).abs(), self.now.xdot[n + row].abs());
            rate <= HELD * slip || rate <= self.kinetics.rounding(row, q, w).1
        };
        channels.iter().filter(held).collect()
    }

    /// Sets the slip speeds to those of the velocities, where the system has just been evaluated; to
    /// zero within rounding, and behind an accumulation within errors of the rates and a slow speed.
    pub(in crate::mechanics) fn take_slips(&mut self, errors: Option<(&[f64], f64)>) {
        let Layout { n, m, p } = self.layout;
        let (q, w) = (self.now.x[..n].to_vec(), self.now.xdot[..n].to_vec());
        for row in m..m + p {
            if self.now.xdot[n + row] == 0.0 {
                continue;
            }
            let (rate, noise) =
                (self.kinetics.rate(row, &w), self.kinetics.rounding(row, &q, &w).1);
            let error = errors.map_or(0.0, |(errors, slow)| slow.max(STILL * errors[n + row]));
            let still = rate.abs() <= 4.0 * noise + error;
            self.now.xdot[n + row] = if still { 0.0 } else { rate };
        }
    }

    /// The channels of the gaps of a set that stick in a state, `x` before `x'`: all impacts before a
    /// corner have left them so.
    pub(in crate::mechanics) fn stuck_in(&self, z: &[f64], set: GapSet) -> GapSet {
        let first = z.len() / 2 + self.layout.n;
        let stuck = |gap: usize| {
            let channel = self.kinetics.channel_of(gap)?;
            (z[first + self.kinetics.row(channel)] == 0.0).then_some(channel)
        };
        set.iter().filter_map(stuck).collect()
    }

    /// Notes what friction does otherwise than before.
    pub(in crate::mechanics) fn note_transitions(
        &self,
        before: ContactMode,
        occurrences: &mut Vec<Occurrence>,
    ) {
        let (t, now) = (self.now.t, self.mode());
        for channel in 0..self.layout.p {
            let (before, after) = (before.number(channel), now.number(channel));
            if before != after && after != 2 {
                occurrences.push(Occurrence::Transition { t, channel, before, after });
            }
        }
    }

    /// The channels of a set do not slip: their rows.
    pub(super) fn stop_rows(&mut self, channels: GapSet) -> GapSet {
        self.stop_slip(channels);
        channels.iter().map(|channel| self.kinetics.row(channel)).collect()
    }

    /// The same along the edges of the cones of friction.
    pub(super) fn without_speeds_along_edges<E>(
        &mut self,
        mode: ContactMode,
    ) -> Result<Vec<f64>, Failure<E>> {
        let Self { kinetics, now, layout: Layout { n, .. }, .. } = self;
        let n = *n;
        let (mut x, mut v) = (now.x.clone(), now.xdot.clone());
        let rates = now.xdot[n..].to_vec();
        let moved = kinetics.displacement(mode, |row| -rates[row])?;
        v.iter_mut().zip(&moved).for_each(|(v, moved)| *v += moved);
        // the impulses do work, too
        let (m, pulls) = (kinetics.layout.m, kinetics.friction_impulses(mode, |row| -rates[row])?);
        let work = |(c, pull): (usize, &f64)| -pull * (rates[m + c] + 0.5 * moved[n + m + c]);
        v[n + m + pulls.len()] += pulls.iter().enumerate().map(work).sum::<f64>();
        // the first leaves rounding of the speeds
        let w = v[..n].to_vec();
        let left: Vec<f64> = (0..rates.len() - 1).map(|row| kinetics.rate(row, &w)).collect();
        let more = kinetics.displacement(mode, |row| -left[row])?;
        v[..n].iter_mut().zip(&more).for_each(|(v, more)| *v += more);
        without_rounding(&mut v[..n], &now.xdot);
        for row in kinetics.rows_of(mode).iter() {
            v[n + row] = 0.0;
        }
        for gap in mode.closed.iter() {
            x[n + gap] = 0.0;
        }
        x.append(&mut v);
        Ok(x)
    }
}
