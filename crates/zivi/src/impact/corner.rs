//! Simultaneous accumulations of several gaps.
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

use crate::impact::corner_descent::{
    descent, landing, pattern, time_of_corner, CornerEntry, CornerLog, Mark, LONGEST,
};
use crate::impact::Struck;
use crate::motion::path::Flight;
use crate::motion::state::{MechanicalState, TOLERANCE};
use crate::motion::tail::{scales, slow, Mechanism, CLEAR};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::switched::SwitchedRk;
use crate::system::dynamics::{Dynamics, Layout};
use crate::zeno::table::ExtrapolatedEnd;

/// Heights and speeds at a corner are zero to this number of tolerances; in a sequence at one instant speeds
/// are at most this multiple of those below all tolerances.
const STILL: f64 = 100.0;
/// In such a sequence speeds fall over this number of impacts of one phase, each to less than this part.
const FALLS: usize = 4;
const LEFT: f64 = 0.98;
/// An accumulation within one flight of another gap has speeds of this part of its speed at most.
const NESTED: f64 = 1e-3;

/// A corner ahead: the state there, and the gaps that are closed in it.
type Corner = (ExtrapolatedEnd<Vec<f64>>, GapSet);

/// The approach to a corner, known by the last impacts.
#[derive(Clone, Debug, Default)]
pub(crate) struct CornerApproach {
    log: CornerLog,
    /// Whether friction changed since the last impact.
    changed: bool,
    /// Modes of friction in the last impacts.
    patterns: Vec<ContactMode>,
}

impl CornerApproach {
    /// Starts a new one.
    pub(crate) fn clear(&mut self) {
        self.log.clear();
        self.changed = false;
        self.patterns.clear();
    }

    /// Whether it knows no impacts.
    pub(crate) fn has_no_impacts(&self) -> bool {
        self.log.is_empty()
    }

    /// A gap came to rest alone: what comes next may be a part of an accumulation of several gaps.
    pub(crate) fn end_one_gap(&mut self) {
        self.log.clear_impacts();
        self.patterns.clear();
    }

    /// Friction changed in flight.
    pub(crate) fn note_transition(&mut self) {
        self.changed = true;
    }

    /// Whether friction gives the impacts of one gap a ratio of their own, so that it may come to rest alone.
    pub(crate) fn may_be_of_one_gap(&self) -> bool {
        self.log.fewest() == 1
    }

    /// Appends an impact, after which the state is that.
    pub(crate) fn note(&mut self, struck: &Struck, state: &MechanicalState) {
        self.log.note_kick(struck.kicks || self.changed);
        self.changed = false;
        self.log.note(struck.hit, struck.closed, struck.opened, state.now());
        if self.patterns.len() == LONGEST {
            self.patterns.remove(0);
        }
        self.patterns.push(struck.pattern());
    }

    /// The corner that the last events approach, if determined to the tolerance.
    pub(crate) fn ahead<E, D: Dynamics<E>>(
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
        let now = state.now();
        let t = end.map_or(now.t, |end| end.max(now.t));
        // the velocities at the end are known to their change in the last impacts
        let before = now.x.iter().chain(&now.xdot);
        let errors = z.iter().zip(before).map(|(after, before)| (after - before).abs());
        Ok(Some((resting(t, &z).with_errors(errors), set)))
    }

    /// Into the corner of a set: what is closed there, and the way, if it ends after `drawn_from`.
    pub(crate) fn jump<E, D: Dynamics<E>>(
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
mod tests {
    //! Extrapolation of corners from synthetic states and impacts.

    use std::convert::Infallible;

    use super::*;
    use crate::kinetics::mode::State;
    use crate::kinetics::{Kinetics, Model};
    use crate::system::force::{Channel, Friction};

    /// Bodies with walls of their own, `g_i = q_i`, which their masses couple. The forces turn round at a time.
    struct Bodies {
        mass: Vec<f64>,
        force: Vec<f64>,
        until: f64,
        /// In joints, that of channel `i` along the body `i`.
        friction: Friction,
    }

    impl Bodies {
        /// Of one kilogram each.
        fn apart(force: &[f64]) -> Self {
            let n = force.len();
            let entry = |k: usize| if k / n == k % n { 1.0 } else { 0.0 };
            Self {
                mass: (0..n * n).map(entry).collect(),
                force: force.to_vec(),
                until: f64::INFINITY,
                friction: Friction::none().clone(),
            }
        }
    }

    impl Dynamics<Infallible> for Bodies {
        fn layout(&self) -> Layout {
            let n = self.force.len();
            Layout { n, m: n, p: self.friction.channels.len(), k: 0 }
        }

        fn friction(&self) -> &Friction {
            &self.friction
        }

        fn evaluate(
            &mut self,
            t: f64,
            q: &[f64],
            _: &[f64],
            out: &mut [f64],
        ) -> Result<(), Infallible> {
            let layout = Dynamics::<Infallible>::layout(self);
            let (n, sign) = (layout.n, if t <= self.until { 1.0 } else { -1.0 });
            out.fill(0.0);
            out[layout.mass()].copy_from_slice(&self.mass);
            for (i, force) in self.force.iter().enumerate() {
                out[layout.force()][i] = sign * force;
                out[layout.gradient()][i * n + i] = 1.0;
            }
            for i in 0..layout.p {
                out[layout.gradient()][(n + i) * n + i] = 1.0;
            }
            out[layout.gap()].copy_from_slice(q);
            Ok(())
        }
    }

    /// Asks something where a system is, all of its gaps open, with these restitutions.
    fn ask<D: Dynamics<Infallible>, T>(
        (settings, e): (SwitchedRk, &[f64]),
        mut system: D,
        (t, q, w): (f64, &[f64], &[f64]),
        question: impl FnOnce(&mut Mechanism<'_, '_, D>) -> T,
    ) -> T {
        let (layout, friction) = (system.layout(), system.friction().clone());
        let mut state = MechanicalState::new(layout, &friction);
        let mut aside = Kinetics::new(layout, &friction);
        let mut model = Model::new(&mut system);
        state.start(t, (q, w), [0.0; 2], &mut model).unwrap();
        state.fly_off();
        let (state, aside, model) = (&mut state, &mut aside, &mut model);
        question(&mut Mechanism { settings: &settings, e, state, aside, model })
    }

    fn all_of(gaps: &[usize]) -> GapSet {
        gaps.iter().copied().collect()
    }

    /// A log of impacts at times, one gap each.
    fn of_impacts(size: usize, impacts: impl IntoIterator<Item = (usize, f64)>) -> CornerApproach {
        let mut approach = CornerApproach::default();
        for (gap, t) in impacts {
            let now = State { t, ..State::zeros(size) };
            approach.log.note(GapSet::of(gap), GapSet::EMPTY, GapSet::EMPTY, &now);
        }
        approach
    }

    /// The corner that a log of slow impacts approaches in a state, as its gaps.
    fn gaps_ahead(
        approach: &CornerApproach,
        of: (SwitchedRk, &[f64]),
        bodies: Bodies,
        now: (f64, &[f64], &[f64]),
    ) -> Option<GapSet> {
        ask(of, bodies, now, |at| approach.ahead(at).unwrap()).map(|(_, gaps)| gaps)
    }

    /// Impacts on two gaps in turn at times given by a function of the period and of the order in it;
    /// heights and speeds fall like `q^2` and `q`, where `q` is halved from period to period.
    fn in_turn(time: impl Fn(i32, f64) -> f64) -> Vec<Mark> {
        let mark = |k: i32| {
            let (first, q) = (k % 2 == 0, 0.5f64.powi(k / 2));
            let (hit, other) = (k % 2, if first { 1 } else { 0 });
            let t = time(k / 2, if first { 1.0 } else { 0.8 });
            let mut heights = [0.0; 2];
            heights[other] = 0.01 * q * q;
            let speeds = [0.3 * q, 0.2 * q];
            let z = [heights, heights, speeds, speeds].concat();
            Mark { hit: GapSet::of(hit as usize), with: GapSet::EMPTY, t, z }
        };
        (0..14).map(mark).collect()
    }

    /// The same, accumulating at the time 1000 in 10 ms.
    fn in_ten_milliseconds(period: i32, part: f64) -> f64 {
        1000.0 - 0.01 * part * 0.5f64.powi(period)
    }

    /// Where the pattern of a log leads, with tolerances of the states that ask for nothing.
    fn end_of(approach: &CornerApproach, last: &Mark, until: f64) -> Option<f64> {
        let settings = SwitchedRk { atol: [1.0; 2], ..SwitchedRk::default() };
        let now = (last.t, &last.z[..2], &last.z[4..6]);
        let bodies = Bodies { until, ..Bodies::apart(&[-1.0, -1.0]) };
        let found = ask((settings, &[0.5; 2]), bodies, now, |at| approach.ahead(at).unwrap());
        found.map(|(landing, gaps)| {
            assert_eq!(gaps, all_of(&[0, 1]));
            landing.t
        })
    }

    fn of_marks(impacts: Vec<Mark>, openings: Vec<Mark>) -> CornerApproach {
        let mut approach = CornerApproach::default();
        (approach.log.impacts, approach.log.openings) = (impacts.into(), openings.into());
        approach
    }

    /// For any time offset: 1e-6 of the 10 ms since the first impact, independent of the absolute time.
    #[test]
    fn the_time_of_a_corner_is_known_to_the_tolerance_of_the_accumulation() {
        let found = |jitter: f64| {
            let sign = |period: i32| if period % 2 == 0 { 1.0 } else { -1.0 };
            let time = |period, part| in_ten_milliseconds(period, part) + jitter * sign(period);
            let marks = in_turn(time);
            end_of(&of_marks(marks.clone(), vec![]), &marks[13], f64::INFINITY)
        };
        for jitter in [0.0, 1e-10] {
            assert!((found(jitter).unwrap() - 1000.0).abs() < 1e-8, "{jitter}");
        }
        assert_eq!(found(1e-7), None);
    }

    #[test]
    fn forces_that_turn_round_before_the_corner_leave_none() {
        let marks = in_turn(in_ten_milliseconds);
        let found = |until| end_of(&of_marks(marks.clone(), vec![]), &marks[13], until);
        let ahead = 1000.0 - marks[13].t;
        assert!(found(1000.0 + 0.1 * ahead).is_some());
        // in its last part, where it holds both gaps closed
        assert_eq!(found(1000.0 - 0.1 * ahead), None);
    }

    #[test]
    fn impacts_that_opened_contacts_tell_a_corner_only_if_the_last_one_did() {
        let openings = in_turn(in_ten_milliseconds);
        let approach = |later: f64| {
            let last = Mark { t: openings[13].t + later, ..openings[13].clone() };
            let impacts = vec![openings[12].clone(), last.clone()];
            end_of(&of_marks(impacts, openings.clone()), &last, f64::INFINITY)
        };
        assert!((approach(0.0).unwrap() - 1000.0).abs() < 1e-8);
        assert_eq!(approach(1e-6), None);
    }

    /// The last impacts of a gap have distances of 1024, 256, 64, 16, 4 and 1 units: a third of one is left.
    #[test]
    fn a_corner_is_ahead() {
        let left = |unit: f64| {
            let marks = in_turn(|period, part| match part < 1.0 {
                true => 1.1 + unit * (4096.0 - 4.0f64.powi(6 - period)) / 3.0,
                false => 1.0,
            });
            let found = end_of(&of_marks(marks.clone(), vec![]), &marks[13], f64::INFINITY);
            found.map(|t| (t - marks[13].t) / unit)
        };
        assert!((left(1e3 * f64::EPSILON).unwrap() - 1.0 / 3.0).abs() < 1e-3);
        // no time that there is
        assert_eq!(left(f64::EPSILON), None);
    }

    /// 1e-8 m/s are slow where bodies rest.
    const SLOW: f64 = 1e-8;

    #[test]
    fn elastic_gaps_alone_come_to_no_rest() {
        let now = (1.0, &[0.0, 0.0][..], &[0.1 * SLOW, 0.1 * SLOW][..]);
        let of = |e: [f64; 2]| {
            let approach = of_impacts(4, [(0, 0.9), (1, 1.0)]);
            gaps_ahead(&approach, (SwitchedRk::default(), &e), Bodies::apart(&[-1.0, -1.0]), now)
        };
        assert_eq!(of([1.0, 1.0]), None);
        assert_eq!(of([1.0, 0.5]), Some(all_of(&[0, 1])));
    }

    /// Under a force that presses all bodies to their walls.
    #[test]
    fn an_elastic_gap_that_still_bounces_keeps_those_of_its_accumulation_open() {
        let found = |e: f64, height: f64, speed: f64| {
            let approach = of_impacts(6, [(0, 0.9), (1, 0.95), (2, 1.0)]);
            let now = (1.0, &[0.0, 0.0, height][..], &[0.0, 0.0, speed][..]);
            let of = (SwitchedRk::default(), &[0.5, 0.5, e][..]);
            gaps_ahead(&approach, of, Bodies::apart(&[-1.0; 3]), now)
        };
        assert_eq!(found(1.0, 0.1, 0.3), None);
        assert_eq!(found(0.5, 0.1, 0.3), Some(all_of(&[0, 1])));
        assert_eq!(found(1.0, 0.0, 0.1 * SLOW), Some(all_of(&[0, 1, 2])));
    }

    /// Hit .1 s ago, before 42 impacts of the others: 1e-7 m are as low as these.
    #[test]
    fn an_elastic_gap_is_of_a_corner_if_it_is_as_low_as_the_last_impacts() {
        let found = |height: f64| {
            let others = (0..42).map(|k| (k % 2, 4.9 + 0.1 * k as f64 / 41.0));
            let approach = of_impacts(6, std::iter::once((2, 4.0)).chain(others));
            // so light a pull would bring it down no faster
            let (e, bodies) = ([0.5, 0.5, 1.0], Bodies::apart(&[-1.0, -1.0, -1e-10]));
            let now = (5.0, &[0.0, 0.0, height][..], &[0.0, 0.0, 0.0][..]);
            gaps_ahead(&approach, (SwitchedRk::default(), &e), bodies, now)
        };
        assert_eq!(found(0.5e-7), Some(all_of(&[0, 1, 2])));
        assert_eq!(found(3e-7), Some(all_of(&[0, 1])));
    }

    /// The second body nearly carries the first: what both hold at rest says little of the height of one.
    #[test]
    fn a_gap_is_of_a_corner_if_it_falls_to_its_wall_slowly() {
        let settings = SwitchedRk { rtol: 1e-3, ..SwitchedRk::default() };
        let slow = 1e-5;
        let found = |height: f64| {
            // mobilities 1 and .9
            let mass = [1.0, -0.9, -0.9, 1.0].map(|entry| entry / 0.19).to_vec();
            let bodies = Bodies { mass, ..Bodies::apart(&[-1e-6, -1.0]) };
            let now = (1.0, &[height, 0.0][..], &[0.0, 0.0][..]);
            gaps_ahead(&of_impacts(4, [(0, 0.9), (1, 1.0)]), (settings, &[0.5; 2]), bodies, now)
        };
        // falling at .9 m/s^2
        assert_eq!(found(0.9 * slow * slow / 1.8), Some(all_of(&[0, 1])));
        assert_eq!(found(0.9 * slow / 1.8), None);
    }

    #[test]
    fn what_is_left_of_a_corner_is_not_faster_than_a_slow_speed() {
        // a third body goes on, far from its wall: twice as much is slow
        let found = |speeds: [f64; 2]| {
            let now = (1.0, &[0.0, 0.0, 5.0][..], &[speeds[0], speeds[1], 1.0][..]);
            let approach = of_impacts(6, [(0, 0.9), (1, 1.0)]);
            let bodies = Bodies::apart(&[-1.0, -1.0, 0.0]);
            gaps_ahead(&approach, (SwitchedRk::default(), &[0.5; 3]), bodies, now)
        };
        assert_eq!(found([2.0 * SLOW, 0.0]), Some(all_of(&[0, 1])));
        // together they are
        assert_eq!(found([2.0 * SLOW, 2.0 * SLOW]), None);
    }

    #[test]
    fn gaps_that_forces_pull_open_are_a_corner_once_all_of_an_accumulation_touch() {
        let found = |height: f64, others: &[usize]| {
            let impacts = [0, 1].iter().chain(others).map(|&gap| (gap, 1.0));
            let now = (1.0, &[height, 0.0, 0.1][..], &[0.0, 0.0, 0.3][..]);
            let bodies = Bodies::apart(&[1e-6, -1.0, -1.0]);
            let approach = of_impacts(6, impacts);
            gaps_ahead(&approach, (SwitchedRk::default(), &[0.5; 3]), bodies, now)
        };
        assert_eq!(found(0.0, &[]), Some(all_of(&[0, 1])));
        // that one strikes them again
        assert_eq!(found(0.0, &[2]), None);
        assert_eq!(found(1e-11, &[]), None);
    }

    #[test]
    fn friction_that_changes_in_four_flights_gives_one_gap_a_ratio_of_its_own() {
        let may_be_of_one_gap = |flights: &[bool]| {
            let struck = Struck::default();
            let bodies = Bodies::apart(&[-1.0]);
            let of = (SwitchedRk::default(), &[0.5][..]);
            let mut approach = CornerApproach::default();
            ask(of, bodies, (0.0, &[1.0], &[0.0]), |at| {
                for &changes in flights {
                    if changes {
                        approach.note_transition();
                    }
                    approach.note(&struck, at.state);
                }
            });
            approach.may_be_of_one_gap()
        };
        assert!(may_be_of_one_gap(&[true; 4]));
        assert!(!may_be_of_one_gap(&[true; 3]));
        assert!(!may_be_of_one_gap(&[true, true, true, true, false]));
    }

    #[test]
    fn heights_and_speeds_at_a_corner_vanish_to_a_hundred_tolerances() {
        let (n, m) = (2, 3);
        let rests = |index: usize, value: f64| {
            // of coordinates and gaps, then of their rates; those of the time come first
            let scales: Vec<f64> = (0..=2 * (n + m)).map(|c| 10.0f64.powi(-(c as i32))).collect();
            let mut z = vec![0.0; 2 * (n + m)];
            z[index] = value;
            let state = MechanicalState::new(Layout::smooth(n, m), Friction::none());
            rests(all_of(&[0, 2]), &resting(1.0, &z), &scales, &state)
        };
        // gaps 0 and 2, and their rates
        for index in [2, 4, 7, 9] {
            let scale = 10.0f64.powi(-(index as i32) - 1);
            assert!(rests(index, 99.0 * scale), "{index}");
            assert!(!rests(index, -101.0 * scale), "{index}");
        }
        // the remaining state is not tested
        for index in [0, 1, 3, 5, 6, 8] {
            assert!(rests(index, 1.0), "{index}");
        }
    }

    /// Marks of one gap in turn with another: the rates of gaps 0 and 1 in those of the last one's phase.
    fn of_rates(rates: &[[f64; 2]]) -> Vec<Mark> {
        let of_phase = |&[a, b]: &[f64; 2]| {
            // what else the state has grows or stays
            let mark = |a: f64, b: f64| {
                let z = vec![3.0, 1.0 / a, 2.0, 1.0 / b, 5.0, 1.0 / b, a, b];
                Mark { hit: GapSet::of(0), with: GapSet::EMPTY, t: 0.0, z }
            };
            [mark(9.0, 9.0), mark(a, b)]
        };
        rates.iter().flat_map(of_phase).collect()
    }

    #[test]
    fn speeds_fall_from_period_to_period_of_a_pattern() {
        let (both, of_gap) = (all_of(&[0, 1]), GapSet::of);
        let fall = |rates: &[[f64; 2]], set: GapSet| speeds_fall(&of_rates(rates), 2, (2, set));
        let falling = [[0.8, 0.1], [-0.7, 0.2], [0.5, 0.3], [0.4, -0.3]];
        assert!(fall(&falling, both));
        assert!(fall(&falling, of_gap(0)));
        assert!(!fall(&falling, of_gap(1)));
        // over four periods
        assert!(!fall(&falling[1..], both));
        let before = [&[[0.1, 0.1]][..], &falling].concat();
        assert!(fall(&before, both));
        // of which all fall, to less than 98 %
        assert!(!fall(&[[0.5; 2]; 4], both));
        for (part, falls) in [(0.97, true), (LEFT, false), (0.99, false)] {
            let mut rates = vec![[0.1; 2]];
            for _ in 0..3 {
                let last = rates[rates.len() - 1];
                rates.push(last.map(|rate| part * rate));
            }
            assert_eq!(fall(&rates, both), falls, "{part}");
        }
    }

    /// End of a sequence of impacts at one instant after which forces separate the bodies.
    #[test]
    fn impacts_at_one_instant_end_in_the_limit_of_their_times() {
        let end = |speed: f64, pull: f64, height: f64, joints: usize| {
            let mut marks = in_turn(in_ten_milliseconds);
            for mark in &mut marks {
                let none = vec![0.0; joints + joints.min(1)];
                let heights = [0.0, height];
                let speeds = [&mark.z[4..6], &mark.z[4..6]].concat();
                let speeds: Vec<f64> = speeds.iter().map(|v| speed * v).collect();
                mark.z = [&heights, &heights, &none[..], &speeds, &none].concat();
            }
            let channels = vec![Channel::default(); joints];
            let friction = Friction { channels, ..Friction::default() };
            let bodies = Bodies { friction, ..Bodies::apart(&[pull; 2]) };
            let (last, half) = (&marks[13], marks[13].z.len() / 2);
            let now = (last.t, &last.z[..2], &last.z[half..half + 2]);
            let of = (SwitchedRk::default(), &[0.5; 2][..]);
            let set = all_of(&[0, 1]);
            let found = ask(of, bodies, now, |at| at_one_instant(&marks, (2, 2), set, at).unwrap());
            found.map(|landing| {
                assert_eq!(landing.state(), [0.0; 8]);
                landing.t
            })
        };
        let speed = 1e-4; // 5e-7 m/s are left: 100 slow speeds are more
        let pull = 1e-5; // a tenth of a slow speed in the 0.1 ms that are left
        assert!((end(speed, pull, 0.0, 0).unwrap() - 1000.0).abs() < 1e-9);
        for (speed, pull, height, joints) in [
            (10.0 * speed, pull, 0.0, 0),
            (speed, 20.0 * pull, 0.0, 0),
            (speed, pull, 1e-9, 0),
            (speed, pull, 0.0, 1),
        ] {
            assert_eq!(end(speed, pull, height, joints), None, "{speed} {pull} {height} {joints}");
        }
    }

    #[test]
    fn the_way_into_a_corner_is_drawn_if_it_ends_after_a_time() {
        let n_flights = |after: f64| {
            let now = (1.0, &[1e-3, 0.0][..], &[0.1, 0.2][..]);
            let bodies = Bodies::apart(&[-10.0, -10.0]);
            ask((SwitchedRk::default(), &[0.5; 2]), bodies, now, |at| {
                let corner = (resting(1.07, &[0.0; 8]), all_of(&[0, 1]));
                let jumped = CornerApproach::default().jump(corner, 1.07 - after, at);
                let (flights, closed) = jumped.unwrap();
                assert_eq!((closed, at.state.now().t), (all_of(&[0, 1]), 1.07));
                flights.len()
            })
        };
        assert!(n_flights(1e-9) > 1);
        assert_eq!(n_flights(0.0), 0);
    }

    /// A particle on a floor with friction.
    struct Particle(Friction);

    impl Dynamics<Infallible> for Particle {
        fn layout(&self) -> Layout {
            Layout { n: 2, m: 1, p: 1, k: 0 }
        }

        fn friction(&self) -> &Friction {
            &self.0
        }

        fn evaluate(
            &mut self,
            _: f64,
            q: &[f64],
            _: &[f64],
            out: &mut [f64],
        ) -> Result<(), Infallible> {
            let layout = Dynamics::<Infallible>::layout(self);
            out.fill(0.0);
            out[layout.mass()].copy_from_slice(&[1.0, 0.0, 0.0, 1.0]);
            out[layout.force()].copy_from_slice(&[0.0, -10.0]);
            out[layout.gap()].copy_from_slice(&q[1..]);
            // up, then along the floor
            out[layout.gradient()].copy_from_slice(&[0.0, 1.0, 1.0, 0.0]);
            out[layout.limit()].fill(0.5);
            out[layout.static_limit()].fill(0.5);
            Ok(())
        }
    }

    /// Its speed there is extrapolated, and the slip that all impacts have left none.
    #[test]
    fn what_sticks_in_all_impacts_before_a_corner_has_no_speed_in_it() {
        let channels = vec![Channel { gap: Some(0), e_t: 0.0 }];
        let floor = Particle(Friction { channels, ..Friction::default() });
        let now = (1.0, &[3.0, 1e-3][..], &[0.1, 0.1][..]);
        ask((SwitchedRk::default(), &[0.5]), floor, now, |at| {
            let size = at.state.now().x.len();
            let mut z = vec![0.0; 2 * size];
            (z[0], z[size]) = (3.0, 1e-3);
            let corner = (resting(1.02, &z), GapSet::of(0));
            CornerApproach::default().jump(corner, f64::INFINITY, at).unwrap();
            assert_eq!(at.state.now().xdot, vec![0.0; size]);
            assert_eq!(at.state.now().x[0], 3.0);
        });
    }
}
