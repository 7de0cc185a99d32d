//! Accumulations of several gaps at once.
//!
//! They are self-similar: impacts, or impacts that open contacts, repeat in a pattern, and times
//! and states of one phase of it approach the corner in powers of a ratio `r` that is in general
//! none of the `e`. So it is measured,
//!
//! ```text
//! r = (t_3 - t_2)/(t_2 - t_1)      S^(j) = (S_k^(j-1) - r^j S_(k-1)^(j-1))/(1 - r^j)     (1)
//! ```
//!
//! An inexact `r` costs no order: its error is of the order of the speeds. Where no pattern shows,
//! `L = 1/2 g' . D^-1 g' + lambda . g`, constant in flight and falling at impacts, tells when what
//! is left of the motion is below the tolerance.

use super::corner_descent::{descent, CornerEntry};
use super::impact::Struck;
use super::mechanism::{scales, slow, Mechanism, CLEAR};
use super::piece::Flight;
use super::state::{MechanicalState, TOLERANCE};
use crate::mechanics::corner_descent::{
    landing, pattern, time_of_corner, CornerLog, Mark, LONGEST,
};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::switched::SwitchedRk;
use crate::system::dynamics::{Dynamics, Layout};
use crate::zeno::table::ExtrapolatedEnd;

/// Heights and speeds at a corner are zero but for so many tolerances; in a sequence at one instant speeds
/// are no more than so many times those that are below all tolerances.
const STILL: f64 = 100.0;
/// In such a sequence speeds fall over so many impacts of one phase, each to less than this part.
const FALLS: usize = 4;
const LEFT: f64 = 0.98;
/// An accumulation within one flight of another gap has speeds of this part of its speed at most.
const NESTED: f64 = 1e-3;

/// A corner ahead: the state there, and the gaps that are closed in it.
type Corner = (ExtrapolatedEnd<Vec<f64>>, GapSet);

/// The approach to a corner, known by the last impacts.
#[derive(Clone, Debug, Default)]
pub(super) struct CornerApproach {
    log: CornerLog,
    /// Whether friction changed since the last impact.
    changed: bool,
    /// Modes of friction in the last impacts.
    patterns: Vec<ContactMode>,
}

impl CornerApproach {
    /// Starts a new one.
    pub(super) fn clear(&mut self) {
        self.log.clear();
        self.changed = false;
        self.patterns.clear();
    }

    /// Whether it knows no impacts.
    pub(super) fn has_no_impacts(&self) -> bool {
        self.log.is_empty()
    }

    /// A gap came to rest alone: what comes next may be a part of an accumulation of several gaps.
    pub(super) fn end_one_gap(&mut self) {
        self.log.clear_impacts();
        self.patterns.clear();
    }

    /// Friction changed in flight.
    pub(super) fn note_transition(&mut self) {
        self.changed = true;
    }

    /// Whether friction gives the impacts of one gap a ratio of their own, so that it may come to rest alone.
    pub(super) fn may_be_of_one_gap(&self) -> bool {
        self.log.fewest() == 1
    }

    /// Appends an impact, after which the state is that.
    pub(super) fn note(&mut self, struck: &Struck, state: &MechanicalState) {
        self.log.note_kick(struck.kicks || self.changed);
        self.changed = false;
        self.log.note(struck.hit, struck.closed, struck.opened, state.now());
        if self.patterns.len() == LONGEST {
            self.patterns.remove(0);
        }
        self.patterns.push(struck.pattern());
    }

    /// The corner that the last events approach, if determined to the tolerance.
    pub(super) fn ahead<E, D: Dynamics<E>>(
        &self,
        at: &mut Mechanism<'_, '_, D>,
    ) -> Result<Option<Corner>, Failure<E>> {
        let recent = self.log.recent();
        // impacts on elastic gaps keep the energy, but for friction
        let (e, has_friction) = (at.e, at.state.layout().p > 0);
        let lose_energy = |gaps: GapSet| has_friction || gaps.iter().any(|i| e[i] < 1.0);
        let fewest = self.log.fewest();
        if recent.len() < fewest || !lose_energy(recent) {
            return Ok(None);
        }
        let (t, closed, mode) = (at.state.now().t, at.state.closed(), at.state.mode());
        let all = self.patterns.len();
        for (marks, of_last) in [(&self.log.impacts, None), (&self.log.openings, Some(all))] {
            if marks.last().is_none_or(|last| last.t < t) {
                continue;
            }
            let found = pattern(marks, fewest).filter(|&(_, gaps)| lose_energy(gaps));
            let Some((p, gaps)) = found else {
                continue;
            };
            let set = closed.with(gaps);
            if at.state.kinetics().has_cones() {
                break;
            }
            let since = t - marks[0].t;
            let scales = scales(at.settings, at.state, at.settings.rtol * since);
            if let Some(landing) = landing(marks, p, &scales) {
                let landed = ContactMode { closed: set, ..mode };
                if landing.t > t
                    && rests(gaps, &landing, &scales, at.state)
                    && self.slips_on(of_last.unwrap_or(p), (&landing, set), at)
                    && at.is_clear(&landing, set)
                    && at.stays_closed(&landing, landed, GapSet::EMPTY)?
                {
                    return Ok(Some((landing, set)));
                }
            }
            if let Some(landing) = at_one_instant(marks, (p, fewest), set, at)? {
                return Ok(Some((landing, set)));
            }
        }
        // without a slow gap there is none, whatever the forces are
        let (state, slow) = (&*at.state, slow(at.settings, at.state));
        if !state.open_gaps().any(|i| state.gap(i).1.abs() <= slow) {
            return Ok(None);
        }
        at.state.complete(at.model)?;
        self.here(e, at.settings, at.state)
    }

    /// Whether the slip at the closing of a set (joints included) had the same mode in the last
    /// impacts and at present.
    fn slips_on<D>(
        &self,
        count: usize,
        (landing, set): (&ExtrapolatedEnd<Vec<f64>>, GapSet),
        at: &Mechanism<'_, '_, D>,
    ) -> bool {
        let (Layout { n, m, p: channels, .. }, now) = (at.state.layout(), at.state.now());
        let (size, slow) = (now.x.len(), slow(at.settings, at.state));
        let last = &self.patterns[self.patterns.len().saturating_sub(count)..];
        let touches =
            |channel: &usize| at.state.kinetics().gap_of(*channel).is_none_or(|gap| set.has(gap));
        (0..channels).filter(touches).all(|channel| {
            let c = n + m + channel;
            let (slip, error) = (landing.state()[size + c], landing.errors()[size + c]);
            let most = TOLERANCE * (1.0 + at.state.kinetics().steepness(m + channel)) * slow;
            let error = error.min(most);
            let goes_on = |sign: f64| sign * slip > 0.0;
            let by_impacts = |it: &ContactMode| {
                let slips = !it.slipping().has(channel) || goes_on(it.sign(channel));
                slips && !it.stick.has(channel)
            };
            slip.abs() <= slow.max(CLEAR * error)
                || (goes_on(now.xdot[c]) && last.iter().all(by_impacts))
        })
    }

    /// The corner where the system is, if the speeds in it are below all tolerances.
    fn here<E>(
        &self,
        e: &[f64],
        settings: &SwitchedRk,
        state: &mut MechanicalState,
    ) -> Result<Option<Corner>, Failure<E>> {
        let (closed, slow) = (state.closed(), slow(settings, state));
        // an elastic gap as low as those of the last impacts takes part, even if it was not hit by them
        let since = state.now().t - self.log.impacts.first().map_or(f64::NAN, |first| first.t);
        let elastic = |&i: &usize| e[i] >= 1.0 && state.gap(i).0 <= STILL * slow * since;
        let recent = self.log.recent().with(self.log.hit().iter().filter(elastic).collect());
        let has_cones = state.kinetics().has_cones();
        let near = |&i: &usize| {
            if has_cones {
                return closed.has(i) || (recent.has(i) && state.is_still(i, slow));
            }
            let (x, v) = state.gap(i);
            let low = 2.0 * x * state.kinetics().b(i).abs() <= slow * slow;
            closed.has(i) || (recent.has(i) && v.abs() <= slow && low)
        };
        let set: GapSet = (0..state.layout().m).filter(near).collect();
        let speed = |i: usize| if closed.has(i) { 0.0 } else { state.gap(i).1.abs() };
        let fastest = set.iter().map(speed).fold(0.0_f64, f64::max);
        let nested: GapSet = set.iter().filter(|&i| speed(i) <= NESTED * fastest).collect();
        match self.corner_of(set, (recent, slow), (e, state))? {
            None if !nested.is_empty() => self.corner_of(nested, (recent, slow), (e, state)),
            found => Ok(found),
        }
    }

    /// The corner of a set of gaps here, if the speeds in it are below all tolerances.
    fn corner_of<E>(
        &self,
        set: GapSet,
        (recent, slow): (GapSet, f64),
        (e, state): (&[f64], &mut MechanicalState),
    ) -> Result<Option<Corner>, Failure<E>> {
        let (closed, fewest) = (state.closed(), self.log.fewest());
        let several = set.iter().filter(|&i| recent.has(i)).count() >= fewest;
        if set.without(closed).is_empty() || !several {
            return Ok(None);
        }
        // an elastic gap of the same accumulation that is not slow yet would bounce on for ever, as
        // nothing loses energy any more once the others are closed
        if recent.without(set).iter().any(|i| e[i] >= 1.0) {
            return Ok(None);
        }
        if state.parts().0.solve(set, |at, i| -at.b(i)).is_err() {
            return Ok(None);
        }
        let mut pressed = state.kinetics().solved()[..set.len()].to_vec();
        if state.kinetics().has_cones() && pressed.iter().any(|&force| force <= 0.0) {
            // of dependent contacts some solution has no force at some of them
            pressed = state.parts().0.least_impulses(set)?;
        }
        if pressed.iter().any(|&force| force <= 0.0) {
            // impacts without end at one instant: they go on until there are no speeds, and then
            // the forces open what they pull; another gap that still bounces strikes them again
            if !(set.iter().all(|i| state.touches(i)) && recent.without(set).is_empty()) {
                return Ok(None);
            }
            pressed.fill(0.0);
        }
        if (2.0 * depth(set, &pressed, state)?).sqrt() > slow {
            return Ok(None);
        }
        // what has no slip keeps none: feet that rock to rest would slide by what a normal impulse leaves
        let channels = set.iter().filter_map(|gap| state.kinetics().channel_of(gap));
        let stick: GapSet = channels.filter(|&channel| state.slips()[channel] == 0.0).collect();
        let z = state.without_speeds(ContactMode { stick, ..set.into() })?;
        let of = |marks| time_of_corner(marks, fewest, set);
        let end = of(&self.log.openings).or_else(|| of(&self.log.impacts));
        let now = state.now().t;
        let t = end.map_or(now, |end| end.max(now));
        Ok(Some((resting(t, &z), set)))
    }

    /// Into the corner of a set: what is closed there, and the way, if it ends after `drawn_from`.
    pub(super) fn jump<E, D: Dynamics<E>>(
        &self,
        (landing, set): Corner,
        drawn_from: f64,
        at: &mut Mechanism<'_, '_, D>,
    ) -> Result<(Vec<Flight>, GapSet), Failure<E>> {
        let entry = match landing.t > drawn_from {
            true => Some(CornerEntry::new(set, at.state)?),
            false => None,
        };
        let stick = at.state.stuck_in(landing.state(), set);
        let closed = at.move_to(&landing, ContactMode { stick, ..set.into() })?;
        let flights = match entry {
            Some(entry) => descent(&entry, slow(at.settings, at.state), at)?,
            None => Vec::new(),
        };
        Ok((flights, closed))
    }
}

/// Whether the gaps of a pattern have no heights and no speeds where its events lead. Two gaps that
/// come to rest separately, one after the other and with one ratio, also repeat in a pattern.
fn rests(
    gaps: GapSet,
    landing: &ExtrapolatedEnd<Vec<f64>>,
    scales: &[f64],
    state: &MechanicalState,
) -> bool {
    let (n, size, z) = (state.layout().n, state.now().x.len(), landing.state());
    let row = |i: usize| [n + i, size + n + i];
    gaps.iter().flat_map(row).all(|c| z[c].abs() <= STILL * scales[1 + c])
}

/// A state in which a corner is reached.
fn resting(t: f64, z: &[f64]) -> ExtrapolatedEnd<Vec<f64>> {
    ExtrapolatedEnd::new(t, &[&[0.0], z].concat(), 0.0)
}

/// Where a pattern of impacts ends that are a sequence at one instant: heights are rounding of the
/// coordinates, the speeds fall, are below the tolerance, and the forces add none. It ends whatever
/// these do then.
fn at_one_instant<E, D: Dynamics<E>>(
    marks: &[Mark],
    (p, fewest): (usize, usize),
    set: GapSet,
    at: &mut Mechanism<'_, '_, D>,
) -> Result<Option<ExtrapolatedEnd<Vec<f64>>>, Failure<E>> {
    let (Layout { n, m, p: channels, .. }, t) = (at.state.layout(), at.state.now().t);
    let end = time_of_corner(marks, fewest, set).filter(|_| channels == 0);
    let Some(end) = end.filter(|_| speeds_fall(marks, p, (n, set))) else { return Ok(None) };
    at.state.complete(at.model)?;
    let (state, slow) = (&*at.state, slow(at.settings, at.state));
    let ends = |i: usize| {
        let forced = state.kinetics().b(i).abs() * (end - t);
        state.gap(i).1.abs() <= STILL * slow && forced <= slow
    };
    if !(0..m).all(|i| set.has(i) == state.touches(i)) || !set.iter().all(ends) {
        return Ok(None);
    }
    // impulses of the set alone that leave no speeds in it: there is one such end
    let landing = resting(end, &at.state.without_speeds(set)?);
    Ok(at.is_clear(&landing, set).then_some(landing))
}

/// Whether the largest speed of the gaps of a set falls from period to period of a pattern.
fn speeds_fall(marks: &[Mark], p: usize, (n, set): (usize, GapSet)) -> bool {
    let speed = |mark: &Mark| {
        let rates = &mark.z[mark.z.len() / 2 + n..];
        set.iter().fold(0.0_f64, |most, i| most.max(rates[i].abs()))
    };
    let last: Vec<f64> = marks.iter().rev().step_by(p).take(FALLS).map(speed).collect();
    last.len() == FALLS && last.windows(2).all(|pair| pair[0] < LEFT * pair[1])
}

/// `L` of the gaps of a set with the forces `lambda`, times the largest of their mobilities.
fn depth<E>(set: GapSet, lambda: &[f64], state: &mut MechanicalState) -> Result<f64, Failure<E>> {
    let (kinetics, now) = state.parts();
    let n = kinetics.coordinates();
    let (mut gaps, speeds) = (now.x[n..].to_vec(), &now.xdot[n..]);
    if kinetics.has_cones() {
        // heights of the corners of a box have the rounding of its place
        let low = |&i: &usize| gaps[i].abs() <= kinetics.rounding(i, &now.x[..n], &now.xdot[..n]).0;
        let low: Vec<usize> = set.iter().filter(low).collect();
        low.into_iter().for_each(|i| gaps[i] = 0.0);
    }
    kinetics.solve(set, |_, i| speeds[i])?;
    let momenta = kinetics.solved()[..set.len()].to_vec();
    let (mut depth, mut widest) = (0.0, 0.0_f64);
    for (row, i) in set.iter().enumerate() {
        depth += 0.5 * speeds[i] * momenta[row] + lambda[row] * gaps[i];
        widest = widest.max(kinetics.d(i, i));
    }
    Ok(depth * widest)
}

#[cfg(test)]
mod tests;
