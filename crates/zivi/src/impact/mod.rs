//! Impacts: the speeds after them, and which gaps they close and open.
//!
//! On the set `C` of the gaps that are zero, closed ones and those that are hit, with the speeds
//! `g-` before,
//!
//! ```text
//! g+ = g- + D P      0 <= P  perp  g+ + e g- >= 0      q'+ = q'- + M^-1 N_C^T P          (1)
//! ```
//!
//! with `e_i = e_i(-g-_i)` of the law of the gap. Energy never rises, whatever the `e_i`:
//! `E+ - E- = 1/2 sum_(P_i > 0) (1 - e_i) P_i g-_i <= 0`. Where a gap of `C` has friction the impact
//! is that of [`crate::friction`].

pub(crate) mod accumulation;
mod chain;
mod corner;
mod corner_descent;

use crate::friction::Collision;
use crate::kinetics::lcp::problem;
use crate::kinetics::mode::Key;
use crate::kinetics::{lcp, Model};
use crate::motion::state::MechanicalState;
use crate::numeric::dense::largest;
use crate::record::events::{FlagKind, Occurrence};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::switched::SwitchedRk;
use crate::system::dynamics::Dynamics;
use crate::system::force::{Friction, FrictionalImpact};
use crate::zeno::arc::restored;
use crate::{AnyImpactLaw, Status};

/// Gaps with a kinetic cosine above this are coupled.
const COUPLED: f64 = 1e-9;
/// The order of impacts is uncertain within this number of time tolerances.
const UNCERTAIN: f64 = 100.0;
/// The last flight must have been longer by this factor.
const LONGER: f64 = 1e3;
/// A gain of energy below this part of that of the impact is rounding.
const GAIN: f64 = 1e-12;
/// A speed below this part of that of the impact is none.
const STILL: f64 = 1e-12;

/// The impacts of a run.
#[derive(Clone, Debug)]
pub(crate) struct Impacts {
    /// The laws by gap, and their coefficients of restitution for slow impacts.
    laws: Vec<AnyImpactLaw>,
    /// Speeds below the tolerance (m/s).
    slow: f64,
    e: Vec<f64>,
    friction: Friction,
    rtol: f64,
    /// When the last one was, or the start.
    last: f64,
    count: u64,
    /// The gaps that were hit, and those that were last noted to share the impact.
    shared: (GapSet, GapSet),
}

/// Result of an impact.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Struck {
    pub(crate) hit: GapSet,
    /// The gaps that were closed before it.
    pub(crate) closed: GapSet,
    /// The mode before it, and the friction modes during it.
    before: ContactMode,
    pattern: ContactMode,
    /// Those of them that it opened.
    pub(crate) opened: GapSet,
    /// Whether other gaps are closed after it.
    pub(crate) changes_contacts: bool,
    /// Whether friction does something else after it, at closed gaps or in joints.
    pub(crate) kicks: bool,
    /// Whether it has pushed off all gaps that were hit, and these alone.
    all_bounce: bool,
    /// Whether the coefficients of restitution were those of all slower impacts.
    pub(crate) is_slow: bool,
    /// The sum of the speeds after it and all later impacts, for slow ones without a geometric impact sequence.
    sum: Option<f64>,
}

impl Struck {
    /// Modes of friction during it.
    pub(crate) fn pattern(&self) -> ContactMode {
        self.pattern
    }

    /// Key of the bouncing gap, if the impact may belong to an impact sequence.
    pub(crate) fn key(&self) -> Option<Key> {
        self.is_slow.then(|| self.repeats()).flatten()
    }

    /// The same of one whose speeds are in no geometric impact sequence, and their sum.
    pub(crate) fn spent(&self) -> Option<(Key, f64)> {
        self.repeats().zip(self.sum)
    }

    /// Key of the bouncing gap, if the impacts that follow may be like this one.
    fn repeats(&self) -> Option<Key> {
        let alike = self.all_bounce && !self.changes_contacts && !self.kicks;
        alike.then(|| {
            let flight = self.before;
            let mut landed = flight;
            landed.closed = landed.closed.with(self.hit);
            landed.stick = landed.stick.with(self.pattern.stick);
            landed.slip_plus = landed.slip_plus.with(self.pattern.slip_plus);
            landed.slip_minus = landed.slip_minus.with(self.pattern.slip_minus);
            Key { hit: self.hit, flight, landed }
        })
    }
}

/// Right-hand side of equation (1): the normal velocities that the impact law prescribes.
struct Exchanged {
    /// Those with an impulse.
    positive: GapSet,
    /// Rates before it, and impulses, by gap.
    before: Vec<f64>,
    impulses: Vec<f64>,
    /// Modes of friction.
    pattern: ContactMode,
}

impl Impacts {
    pub(crate) fn new(laws: &[AnyImpactLaw], friction: &Friction, settings: &SwitchedRk) -> Self {
        let (laws, friction) = (laws.to_vec(), friction.clone());
        let e = laws.iter().map(|law| law.ratio(0.0)).collect();
        let shared = (GapSet::EMPTY, GapSet::EMPTY);
        let (rtol, slow) = (settings.rtol, settings.atol[1]);
        Self { laws, e, friction, rtol, slow, last: f64::NEG_INFINITY, count: 0, shared }
    }

    /// A run starts at a time.
    pub(crate) fn start(&mut self, t: f64) {
        self.last = t;
    }

    /// The coefficients of restitution of slow impacts, by gap: those of accumulations.
    pub(crate) fn e(&self) -> &[f64] {
        &self.e
    }

    /// The law of a gap.
    pub(crate) fn law(&self, gap: usize) -> &AnyImpactLaw {
        &self.laws[gap]
    }

    /// The coefficients of restitution of an impact with these rates before it.
    fn ratios(&self, before: &[f64]) -> Vec<f64> {
        self.laws
            .iter()
            .zip(before)
            .map(|(law, rate)| law.ratio_unless_slow(-rate, self.slow))
            .collect()
    }

    /// The speed after an impact and all that follow, if that is below the tolerance and they are in no
    /// geometric impact sequence.
    fn sum_of_speeds(&self, gap: usize, u: f64) -> Option<f64> {
        let law = &self.laws[gap];
        let spent = 0.0 < u && u <= self.slow && law.geometric_up_to() == 0.0;
        spent.then(|| law.sum_of_speeds(u)).flatten()
    }

    /// The gaps whose impacts lose an ever smaller part of their speed: their time may be long although
    /// they are slow.
    pub(crate) fn lingering(&self) -> GapSet {
        let lingers = |law: &AnyImpactLaw| law.limit() == Some(1.0) && law.geometric_up_to() == 0.0;
        (0..self.laws.len()).filter(|&gap| lingers(&self.laws[gap])).collect()
    }

    /// How many there were.
    pub(crate) fn count(&self) -> u64 {
        self.count
    }

    /// Whether an impact without a collision follows where no motion obeys the law of friction.
    pub(crate) fn continues_where_jammed(&self) -> bool {
        self.friction.impact_without_collision
    }

    /// The impact on the gaps `hit` at a state, which becomes that after it.
    pub(crate) fn solve<E, D: Dynamics<E>>(
        &mut self,
        hit: GapSet,
        state: &mut MechanicalState,
        occurrences: &mut Vec<Occurrence>,
        model: &mut Model<'_, D>,
    ) -> Result<Struck, Failure<E>> {
        let (t, before, mode) = (state.now().t, state.closed(), state.mode());
        state.evaluate_walls(model)?;
        let hit = hit.with(self.arriving(state, hit));
        let touched = touched(state, hit);
        let set = before.with(hit).with(touched);
        let newton = self.friction.law == FrictionalImpact::Newton;
        let rough = !newton || set.iter().any(|gap| state.kinetics().channel_of(gap).is_some());
        if rough {
            state.complete(model)?;
        } else if let Some(gap) = set.only().filter(|&gap| hit.has(gap) && state.layout().p == 0) {
            return self.strike_alone(gap, state, occurrences, model);
        }
        self.note_flags(hit, touched, state, occurrences);
        self.count += 1;
        let exchanged = match rough {
            true => {
                // feet of one body slip as one only where all gaps are zero
                state.project(set, model)?;
                state.take_slips(None);
                state.evaluate_limits_at_rest(set, model)?;
                self.exchange_with_friction(set, hit, state, occurrences)?
            }
            false => {
                let exchanged = self.exchange(set, hit, state)?;
                self.note_impacts(set, hit, &exchanged, state, occurrences);
                exchanged
            }
        };
        let sticking =
            state.kinetics().rows_of(ContactMode { closed: GapSet::EMPTY, ..exchanged.pattern });
        state.project(set.with(sticking), model)?;
        if rough {
            state.take_slips(None);
        }
        let touching: GapSet = set.iter().filter(|&i| state.gap(i).1 == 0.0).collect();
        state.settle(touching)?;
        state.refresh()?;
        self.last = t;
        let closed = state.closed();
        let opened = before.without(closed).without(hit);
        let zeno = |gap| Occurrence::Zeno { t, gap, closed };
        occurrences.extend(closed.without(before).iter().map(zeno));
        let opened_by = |gap| match touching.has(gap) {
            true => Occurrence::LiftOff { t, gap },
            false => Occurrence::Opened { t, gap },
        };
        occurrences.extend(opened.iter().map(opened_by));
        let pattern = exchanged.pattern;
        let is_elastic = pattern.stick.iter().any(|c| self.friction.channels[c].e_t > 0.0);
        let all_bounce =
            hit.without(exchanged.positive).is_empty() && touched.is_empty() && !is_elastic;
        let changes_contacts = closed != before;
        // other laws make ratios of their own
        let kicks = (!changes_contacts && state.mode() != mode) || !newton || is_elastic;
        state.note_transitions(mode, occurrences);
        let is_slow = hit.iter().all(|i| -exchanged.before[i] <= self.laws[i].geometric_up_to());
        let sum = hit.only().and_then(|gap| self.sum_of_speeds(gap, state.gap(gap).1));
        Ok(Struck {
            hit,
            closed: before,
            before: mode,
            pattern,
            opened,
            changes_contacts,
            kicks,
            all_bounce,
            is_slow,
            sum,
        })
    }

    /// The same where a gap without friction is hit alone and no other is closed: it has one impulse.
    fn strike_alone<E, D: Dynamics<E>>(
        &mut self,
        gap: usize,
        state: &mut MechanicalState,
        occurrences: &mut Vec<Occurrence>,
        model: &mut Model<'_, D>,
    ) -> Result<Struck, Failure<E>> {
        let (t, hit) = (state.now().t, GapSet::of(gap));
        state.parts().0.impulse(gap, 0.0)?;
        self.note_flags(hit, GapSet::EMPTY, state, occurrences);
        self.count += 1;
        let (kinetics, now) = state.parts();
        let rates = &mut now.xdot[kinetics.coordinates()..];
        let before = rates[gap].min(0.0);
        let law = &self.laws[gap];
        let e = law.ratio_unless_slow(-before, self.slow);
        let wanted = (1.0 + e) * before;
        let bounces = wanted < 0.0;
        let impulse = if bounces { kinetics.impulse(gap, -wanted)? } else { 0.0 };
        if !impulse.is_finite() {
            return Err(Failure::Status(Status::ImpactNotSolved));
        }
        let after = restored(e, before);
        for (k, rate) in rates.iter_mut().enumerate() {
            if k == gap {
                *rate = if bounces { after } else { before.max(after) };
            } else if bounces {
                *rate += kinetics.coupling(k, gap) * impulse;
            }
        }
        let (after, group, is_slow) = (rates[gap], self.count, -before <= law.geometric_up_to());
        occurrences.push(Occurrence::Impact { t, gap, before, after, impulse, group });
        state.project_gaps(hit, model)?;
        let touching = if state.gap(gap).1 == 0.0 { hit } else { GapSet::EMPTY };
        if touching.is_empty() && state.kinetics().is_constant() {
            state.fly_off();
        } else {
            state.complete(model)?;
            state.settle(touching)?;
            state.refresh()?;
        }
        self.last = t;
        let closed = state.closed();
        occurrences.extend(closed.iter().map(|gap| Occurrence::Zeno { t, gap, closed }));
        Ok(Struck {
            hit,
            closed: GapSet::EMPTY,
            before: ContactMode::default(),
            pattern: ContactMode::default(),
            opened: GapSet::EMPTY,
            changes_contacts: !closed.is_empty(),
            kicks: false,
            all_bounce: bounces,
            is_slow,
            sum: self.sum_of_speeds(gap, after),
        })
    }

    /// Speeds after the impact, equation (1).
    fn exchange<E>(
        &self,
        set: GapSet,
        hit: GapSet,
        state: &mut MechanicalState,
    ) -> Result<Exchanged, Failure<E>> {
        let (kinetics, now) = state.parts();
        let (n, rows) = (kinetics.coordinates(), kinetics.layout.rows());
        let rates = &mut now.xdot[n..n + rows];
        let before = approach(rates, set, hit);
        let e = self.ratios(&before);
        let (matrix, right) = problem(kinetics, set, |_, i| (1.0 + e[i]) * before[i]);
        let is_redundant = kinetics.solve_regular(set, |_, _| 0.0).is_err();
        let solution = lcp::solve(&matrix, &right);
        let unsolved = match is_redundant {
            true => Status::RedundantContacts,
            false => Status::ImpactNotSolved,
        };
        let mut solution = solution.ok_or(Failure::Status(unsolved))?;
        let mut positive = GapSet::EMPTY;
        let fastest = before.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        for k in 0..rates.len() {
            let change: f64 = set
                .iter()
                .zip(&solution.z)
                .map(|(i, p)| if *p == 0.0 { 0.0 } else { kinetics.coupling(k, i) * p })
                .sum();
            rates[k] = match set.iter().position(|i| i == k) {
                Some(row) if solution.positive.has(row) => {
                    positive = positive.with(GapSet::of(k));
                    restored(e[k], before[k])
                }
                Some(_) => {
                    let least = restored(e[k], before[k]);
                    let rate = (before[k] + change).max(least);
                    // those that bounce with the others have a part in their impulses
                    if is_redundant && rate - least <= STILL * fastest {
                        positive = positive.with(GapSet::of(k));
                    }
                    rate
                }
                None => before[k] + change,
            };
        }
        if is_redundant {
            for k in positive.iter() {
                rates[k] = restored(e[k], before[k]);
            }
            kinetics.solve(positive, |_, i| restored(e[i], before[i]) - before[i])?;
            let part = kinetics.least_impulses(positive)?;
            let of = |i: usize| positive.iter().position(|it| it == i).map_or(0.0, |at| part[at]);
            solution.z = set.iter().map(of).collect();
        }
        let pattern = ContactMode::default();
        Ok(Exchanged { positive, before, impulses: solution.z, pattern })
    }

    /// The same with friction; what it did is noted.
    fn exchange_with_friction<E>(
        &self,
        set: GapSet,
        hit: GapSet,
        state: &mut MechanicalState,
        occurrences: &mut Vec<Occurrence>,
    ) -> Result<Exchanged, Failure<E>> {
        let (kinetics, now) = state.parts();
        let (n, rows) = (kinetics.coordinates(), kinetics.layout.rows());
        let rates = &mut now.xdot[n..n + rows];
        let before = approach(rates, set, hit);
        let (e, friction) = (&self.ratios(&before)[..], &self.friction);
        let is_jammed = hit.is_empty();
        let (free, duration) = (&before[..], 0.0);
        let collision = Collision { set, e, friction, before: &before, free, duration, is_jammed };
        let found = collision.solve(kinetics)?;
        rates.copy_from_slice(&found.rates);
        // a speed towards zero that is left is rounding of the slips
        set.iter().for_each(|gap| rates[gap] = rates[gap].max(0.0));
        now.xdot[..n].iter_mut().zip(&found.push).for_each(|(w, push)| *w += push);
        let work = |row: usize| -0.5 * found.impulses[row] * (before[row] + found.rates[row]);
        now.xdot[n + rows] += (kinetics.layout.m..rows).map(work).sum::<f64>();
        let impulses = set.iter().map(|gap| found.impulses[gap]).collect();
        // impulses of rounding are none, whatever the coordinates
        let sizes: Vec<f64> =
            set.iter().map(|gap| found.impulses[gap] * kinetics.d(gap, gap).sqrt()).collect();
        let least = STILL * largest(&sizes);
        let positive =
            set.iter().zip(&sizes).filter(|(_, &size)| size > least).map(|it| it.0).collect();
        let exchanged = Exchanged { positive, before, impulses, pattern: found.pattern };
        let energy: f64 =
            exchanged.before[..].iter().zip(&found.impulses).map(|(v, p)| (v * p).abs()).sum();
        self.note_impacts(set, hit, &exchanged, state, occurrences);
        let t = state.now().t;
        // without an impulse of its gap a channel has none
        let is_noted = |gap: usize| hit.has(gap) || exchanged.positive.has(gap);
        for channel in found.pattern.slipping().with(found.pattern.stick).iter() {
            if !state.kinetics().gap_of(channel).is_some_and(is_noted) {
                continue;
            }
            let row = state.kinetics().row(channel);
            let (before, after) = (exchanged.before[row], found.rates[row]);
            let (impulse, sticks) = (found.impulses[row], found.pattern.stick.has(channel));
            let group = self.count;
            let it = Occurrence::Tangential { t, channel, before, after, impulse, sticks, group };
            occurrences.push(it);
        }
        let flags = [
            (FlagKind::EnergyGain, found.gain, found.gain > GAIN * energy),
            (FlagKind::ImpactNotUnique, 0.0, found.is_ambiguous),
            (FlagKind::UndeterminedMotion, 0.0, found.is_shared),
            (FlagKind::ImpactWithoutCollision, 0.0, is_jammed),
        ];
        for (kind, size, _) in flags.into_iter().filter(|flag| flag.2) {
            occurrences.push(Occurrence::Flag { kind, t, gaps: set, size });
        }
        Ok(exchanged)
    }

    fn note_impacts(
        &self,
        set: GapSet,
        hit: GapSet,
        Exchanged { positive, before, impulses, .. }: &Exchanged,
        state: &MechanicalState,
        occurrences: &mut Vec<Occurrence>,
    ) {
        let (t, group) = (state.now().t, self.count);
        for (gap, &impulse) in set.iter().zip(impulses) {
            if hit.has(gap) || positive.has(gap) {
                let (before, after) = (before[gap], state.gap(gap).1);
                occurrences.push(Occurrence::Impact { t, gap, before, after, impulse, group });
            }
        }
    }

    /// Coupled gaps that are hit together, or might be hit in another order.
    fn note_flags(
        &mut self,
        hit: GapSet,
        touched: GapSet,
        state: &mut MechanicalState,
        occurrences: &mut Vec<Occurrence>,
    ) {
        let t = state.now().t;
        flag_together(hit, state, occurrences);
        self.note_shared(hit, touched, state, occurrences);
        let flight = t - self.last;
        let near = (UNCERTAIN * self.rtol).min(1.0 / LONGER) * flight;
        for j in state.open_gaps().filter(|&j| !hit.has(j)) {
            let (x, v) = state.gap(j);
            let later = -x / v;
            let kinetics = state.parts().0;
            let mut coupled = || hit.iter().any(|i| kinetics.cosine(i, j).abs() > COUPLED);
            if v < 0.0 && later <= near && coupled() {
                let (kind, gaps) = (FlagKind::OrderUncertain, hit.with(GapSet::of(j)));
                occurrences.push(Occurrence::Flag { kind, t, gaps, size: later });
            }
        }
    }

    /// Gaps that touch without a force, and that an impact on others presses: had they been open by ever so
    /// little, they would be hit after it. Noted once for impacts that are alike.
    fn note_shared(
        &mut self,
        hit: GapSet,
        touched: GapSet,
        state: &mut MechanicalState,
        occurrences: &mut Vec<Occurrence>,
    ) {
        let (closed, t) = (state.closed().without(hit).with(touched), state.now().t);
        if closed.is_empty() {
            return;
        }
        let forces = state.lambda().to_vec();
        let (kinetics, mut strongest) = (state.parts().0, 0.0_f64);
        let mut is_loose = |j: &usize| forces[*j] * kinetics.d(*j, *j) <= kinetics.noise(*j);
        let loose: GapSet = closed.iter().filter(&mut is_loose).collect();
        let mut pressed = GapSet::EMPTY;
        for (i, j) in hit.iter().flat_map(|i| loose.iter().map(move |j| (i, j))) {
            let cosine = kinetics.cosine(i, j);
            if cosine < -COUPLED {
                pressed = pressed.with(GapSet::of(j));
                strongest = strongest.max(-cosine);
            }
        }
        if !pressed.is_empty() && self.shared != (hit, pressed) {
            self.shared = (hit, pressed);
            let (kind, gaps) = (FlagKind::Simultaneous, hit.with(pressed));
            occurrences.push(Occurrence::Flag { kind, t, gaps, size: strongest });
        }
    }

    /// The open gaps that are zero but for rounding and close, where they and gaps that are hit act on each other
    /// and have friction. Whether rounding has them hit first, last or at once depends on the coordinates, and with
    /// friction so would the motion. Gaps in bounces lower than rounding do not count: they would be zero at all times.
    fn arriving(&self, state: &mut MechanicalState, hit: GapSet) -> GapSet {
        let is_rough = |state: &MechanicalState, gap| state.kinetics().channel_of(gap).is_some();
        let mut all = GapSet::EMPTY;
        if hit.is_empty() || state.layout().p == 0 {
            return all;
        }
        let stays = |j: usize| self.laws[j].limit() == Some(0.0);
        let closes = |&j: &usize| {
            !hit.has(j) && state.gap(j).1 < 0.0 && state.touches(j) && (stays(j) || state.falls(j))
        };
        let near: GapSet = state.open_gaps().filter(closes).collect();
        for j in near.iter() {
            let is_coupled = |i: usize, state: &mut MechanicalState| {
                (is_rough(state, i) || is_rough(state, j))
                    && state.parts().0.cosine(i, j).abs() > COUPLED
            };
            if hit.iter().any(|i| is_coupled(i, state)) {
                all = all.with(GapSet::of(j));
            }
        }
        all
    }
}

/// Makes the rates those of an impact: gaps that are hit close, other contacts rest.
fn approach(rates: &mut [f64], set: GapSet, hit: GapSet) -> Vec<f64> {
    for i in set.iter() {
        rates[i] = if hit.has(i) { rates[i].min(0.0) } else { 0.0 };
    }
    rates.to_vec()
}

/// The open gaps that are zero without speed up to rounding when others are hit: they have just
/// opened. Without them the impact would be passed on to them and back, again and again.
fn touched(state: &MechanicalState, hit: GapSet) -> GapSet {
    let fastest = hit.iter().fold(0.0_f64, |v, i| v.max(-state.gap(i).1));
    let still = |i: usize| state.gap(i).1.abs() <= STILL * fastest;
    let open = state.open_gaps().filter(|&i| !hit.has(i));
    open.filter(|&i| still(i) && state.touches(i)).collect()
}

/// Flags coupled gaps that are hit or open together, at the last evaluation of the system.
pub(crate) fn flag_together(
    gaps: GapSet,
    state: &mut MechanicalState,
    occurrences: &mut Vec<Occurrence>,
) {
    let (kinetics, now) = state.parts();
    let mut strongest = 0.0_f64;
    for i in gaps.iter() {
        for j in gaps.iter().filter(|&j| j < i) {
            strongest = strongest.max(kinetics.cosine(i, j).abs());
        }
    }
    if strongest > COUPLED {
        let (kind, t) = (FlagKind::Simultaneous, now.t);
        occurrences.push(Occurrence::Flag { kind, t, gaps, size: strongest });
    }
}
