//! Which contacts stay closed and which channels stick: every combination of a few, judged by its forces; of
//! many that of [`crate::friction::coulomb`].
//!
//! A gap that touches without a speed stays closed or opens, a channel without a slip speed sticks or
//! begins to slip one way. A combination obeys the laws where
//!
//! ```text
//! closed: lambda >= 0    open: g'' >= 0    stick: |f| <= mu_s lambda, L_s    slip: sigma w' >= 0
//! ```
//!
//! At one contact with `det K > 0` exactly one does, at the limits two with the same motion, and where
//! `mu_s > mu` sticking continues: most closed, then most sticking, then most that stuck before.

use crate::friction::coulomb::{
    Coulomb, CoulombSolution, Rough, Site, SiteMode, ALL_PATTERNS, MOST_PATTERNS,
};
use crate::kinetics::mode::{Contacts, Limit};
use crate::kinetics::Kinetics;
use crate::numeric::dense::{dot, largest};
use crate::numeric::elimination::Elimination;
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::Status;

/// Tolerances of the violation of a combination relative to the terms: first, and if none is
/// better.
const VIOLATIONS: (f64, f64) = (1e-11, 1e-7);
/// Rows that depend on each other agree to this part of their terms; where they do not, that is this part of
/// a violation: a gap that the others open like the square of a small speed opens, if it can.
const AGREES: (f64, f64) = (1e-9, 0.1);
/// Accelerations that differ by less are the same.
const SAME: f64 = 1e-8;

/// Undecided mode of a site.
enum Choice {
    /// A gap, and its channel with the sign of its slip.
    Gap(usize, Option<(usize, f64)>),
    /// A joint that has stopped.
    Joint(usize),
    /// A gap and both channels of its cone, and whether it slips already.
    Cone(usize, [usize; 2], bool),
}

/// Most repetitions for the directions of several contacts, and a turn of them that is rounding.
pub(super) const REFINED: usize = 300;
pub(super) const TURNED: f64 = 1e-15;
/// Newton steps for directions that depend on shared loads, their halvings, and the angle of a difference.
const TURNS: usize = 40;
const HALVINGS: i32 = 24;
const DIFFERENCE: f64 = 1e-7;
/// Most directions in which a contact may begin to slip.
pub(super) const DIRECTIONS: usize = 4;

impl Choice {
    /// How many ways there are.
    fn count(&self) -> usize {
        match self {
            Self::Gap(_, Some((_, 0.0))) => 4,
            Self::Gap(..) => 2,
            Self::Joint(_) => 3,
            Self::Cone(.., true) => 2,
            Self::Cone(.., false) => 2 + DIRECTIONS,
        }
    }

    /// The direction, by its number, in which a contact begins to slip in one of the ways.
    fn direction(&self, way: usize) -> Option<(usize, [usize; 2], usize)> {
        match *self {
            Self::Cone(gap, pair, false) if (1..=DIRECTIONS).contains(&way) => {
                Some((gap, pair, way - 1))
            }
            _ => None,
        }
    }

    /// The mode with one of the ways, the first of which sticks, the last opens a gap.
    fn take(&self, way: usize, mode: ContactMode) -> ContactMode {
        let sign = [0.0, 1.0, -1.0];
        match *self {
            Self::Joint(channel) => mode.with_channel(channel, sign[way]),
            Self::Cone(..) if way + 1 == self.count() => mode,
            // the direction is found once all else is known
            Self::Cone(gap, pair, slips) => match self.direction(way) {
                Some(_) => mode,
                None => with_cone(mode, gap, pair, slips),
            },
            Self::Gap(..) if way + 1 == self.count() => mode,
            Self::Gap(gap, friction) => {
                let mode = ContactMode { closed: mode.closed.with(GapSet::of(gap)), ..mode };
                match friction {
                    None => mode,
                    Some((channel, slip)) if slip != 0.0 => mode.with_channel(channel, slip),
                    Some((channel, _)) => mode.with_channel(channel, sign[way]),
                }
            }
        }
    }
}

/// A mode with one more closed gap, both channels of which slip or stick.
pub(super) fn with_cone(
    mode: ContactMode,
    gap: usize,
    pair: [usize; 2],
    slips: bool,
) -> ContactMode {
    let mode = ContactMode { closed: mode.closed.with(GapSet::of(gap)), ..mode };
    let sign = f64::from(u8::from(slips));
    pair.into_iter().fold(mode, |mode, channel| mode.with_channel(channel, sign))
}

/// A combination that may be.
#[derive(Clone)]
struct Candidate {
    mode: ContactMode,
    violation: f64,
    acceleration: Vec<f64>,
    kappa: f64,
    /// The directions of slip, by channel.
    headings: Vec<f64>,
}

/// The touching gaps that stay closed, and the modes of friction with the slip speeds by channel,
/// at the last evaluation of the system. Of several channels one of which must slip, those of
/// `held` go on to stick: their limits are not reached.
pub(crate) fn decide<E>(
    kinetics: &mut Kinetics,
    touching: GapSet,
    slips: &[f64],
    held: GapSet,
) -> Result<Contacts, Failure<E>> {
    let mut choices: Vec<Choice> = Vec::new();
    let mut known = ContactMode::default();
    let rates = [vec![0.0; kinetics.layout.m], slips.to_vec()].concat();
    kinetics.turn(&rates);
    for gap in touching.iter() {
        let channel = kinetics.channel_of(gap);
        let pair = channel.and_then(|c| kinetics.other_of(c).map(|other| [c, other]));
        choices.push(match pair {
            Some(pair) => Choice::Cone(gap, pair, pair.iter().any(|&c| slips[c] != 0.0)),
            None => Choice::Gap(gap, channel.map(|c| (c, slips[c]))),
        });
    }
    for (channel, &slip) in slips.iter().enumerate() {
        if kinetics.gap_of(channel).is_none() && kinetics.is_loaded(channel) {
            if slip == 0.0 {
                choices.push(Choice::Joint(channel));
            } else {
                known = known.with_channel(channel, slip);
            }
        }
    }
    let count = choices.iter().fold(1_usize, |all, it| all.saturating_mul(it.count()));
    let mut candidates: Vec<Candidate> = Vec::new();
    let is_cone = |choice: &&Choice| matches!(choice, Choice::Cone(..));
    let (cones, mut is_ambiguous) = (choices.iter().filter(is_cone).count(), false);
    if cones > 1 {
        let found = by_steps(kinetics, &choices, known);
        let solved = found.filter(|it| it.1.forces.is_some()).and_then(|(mode, solved)| {
            is_ambiguous = solved.is_ambiguous;
            let found = judged(kinetics, (mode, touching), slips);
            if found.as_ref().is_some_and(|it| it.violation <= VIOLATIONS.1) {
                return found;
            }
            let begins = |pair: &[usize; 2]| pair.iter().all(|&c| slips[c] == 0.0);
            let begun = kinetics.cones(mode.slipping()).filter(begins).collect();
            turned_together(kinetics, mode, begun)?;
            judged(kinetics, (mode, touching), slips)
        });
        candidates.extend(solved.filter(|it| it.violation <= VIOLATIONS.1));
    }
    if !candidates.is_empty() {
        // several contacts together have no finite list of patterns
    } else if count <= MOST_PATTERNS {
        candidates = by_patterns(kinetics, (&choices, known), touching, slips);
    } else if choices.iter().any(|choice| matches!(choice, Choice::Cone(..))) {
        let mode = by_steps(kinetics, &choices, known).map(|it| it.0);
        let begun = |it: &&Choice| matches!(it, Choice::Cone(.., false));
        let begun: Vec<(usize, [usize; 2], usize)> = (choices.iter().filter(begun))
            .filter_map(|choice| choice.direction(1))
            .filter(|it| mode.is_some_and(|mode| mode.slip_plus.has(it.1[0])))
            .collect();
        let rest = mode.map(|mode| begun.iter().fold(mode, without_cone));
        let mode = rest.and_then(|rest| match begun.is_empty() {
            true => mode,
            false => refined(kinetics, rest, &begun),
        });
        candidates.extend(mode.and_then(|it| judged(kinetics, (it, touching), slips)));
    } else {
        let mut tried = choices.iter().fold(known, |mode, choice| choice.take(0, mode));
        for _ in 0..=choices.len() {
            let Some(candidate) = judged(kinetics, (tried, touching), slips) else { break };
            let fits = candidate.violation <= VIOLATIONS.0 && candidate.kappa > 0.0;
            candidates.push(candidate);
            let next = kinetics.without_violated(tried);
            if fits || next == tried {
                break;
            }
            tried = next;
        }
        let is_found = |it: &Candidate| it.violation <= VIOLATIONS.1;
        if !candidates.iter().any(is_found) {
            let mode = by_steps(kinetics, &choices, known).map(|it| it.0);
            let found = mode.and_then(|mode| judged(kinetics, (mode, touching), slips));
            candidates.extend(found);
        }
        if !candidates.iter().any(is_found) {
            if count > ALL_PATTERNS {
                return Err(Failure::Status(Status::ContactNotSolved));
            }
            candidates = by_patterns(kinetics, (&choices, known), touching, slips);
        }
    }
    let is_plain = |&c: &usize| kinetics.friction_limits(c).0 == kinetics.friction_limits(c).1;
    if cones == 1 && (0..slips.len()).all(|c| is_plain(&c)) {
        // larger limits in stick have several continuations by themselves
        is_ambiguous = !all_same(&candidates);
    }
    let Candidate { mode, headings, .. } = chosen(candidates, held)?;
    kinetics.take_headings(&headings);
    let left = touching.without(mode.closed);
    let begins = |&c: &usize| slips[c] == 0.0;
    let released: GapSet = mode.slipping().iter().filter(begins).collect();
    let spent = spent(kinetics, mode, released);
    let released = released.without(spent);
    Ok(Contacts { mode, left, released, spent, is_ambiguous, ..Contacts::default() })
}

/// Every combination, judged.
fn by_patterns(
    kinetics: &mut Kinetics,
    (choices, known): (&[Choice], ContactMode),
    touching: GapSet,
    slips: &[f64],
) -> Vec<Candidate> {
    let count = choices.iter().fold(1_usize, |all, it| all.saturating_mul(it.count()));
    let mut candidates: Vec<Candidate> = Vec::new();
    for number in 0..count {
        let (mut mode, mut rest, mut begin) = (known, number, Vec::new());
        for choice in choices {
            let way = rest % choice.count();
            mode = choice.take(way, mode);
            begin.extend(choice.direction(way));
            rest /= choice.count();
        }
        let mode = match begin[..] {
            [] => Some(mode),
            [(gap, pair, number)] => begins(kinetics, mode, (gap, pair), number),
            // several by repetition, from each on its own
            _ if begin.iter().any(|it| it.2 > 0) => None,
            _ => begin_together(kinetics, mode, &begin),
        };
        candidates.extend(mode.and_then(|it| judged(kinetics, (it, touching), slips)));
    }
    candidates
}

/// The channels that begin to slip in a mode but that its rows hold: their force is that of slip, their slip
/// speed stays zero.
fn spent(kinetics: &mut Kinetics, mode: ContactMode, released: GapSet) -> GapSet {
    let planar = |&channel: &usize| kinetics.other_of(channel).is_none();
    let released: Vec<usize> = released.iter().filter(planar).collect();
    if released.is_empty() || kinetics.contact(mode).is_err() {
        return GapSet::EMPTY;
    }
    let n = kinetics.coordinates();
    let mut still = |channel: usize| {
        let row = kinetics.row(channel);
        let rate = kinetics.acceleration[n + row].abs();
        rate <= AGREES.0 * kinetics.acceleration_scale(row) && kinetics.is_held(mode, channel)
    };
    released.into_iter().filter(|&channel| still(channel)).collect()
}

/// A mode with one more closed gap, which begins to slip in one of the directions in which it can.
fn begins(
    kinetics: &mut Kinetics,
    mode: ContactMode,
    (gap, pair): (usize, [usize; 2]),
    number: usize,
) -> Option<ContactMode> {
    kinetics.contact(mode).ok()?;
    let first = kinetics.coordinates();
    let b = kinetics.rows_of_cone(gap, pair).map(|row| kinetics.acceleration[first + row]);
    let local = kinetics.local_contact(mode, (gap, pair), b)?;
    let slip = local.slips().into_iter().nth(number)?;
    kinetics.head(pair, slip.heading);
    Some(with_cone(mode, gap, pair, true))
}

/// A mode without a closed gap and both of its channels.
pub(super) fn without_cone(mode: ContactMode, it: &(usize, [usize; 2], usize)) -> ContactMode {
    let mode = ContactMode { closed: mode.closed.without(GapSet::of(it.0)), ..mode };
    it.1.into_iter().fold(mode, ContactMode::without_channel)
}

/// A mode with more closed gaps, all of which begin to slip in directions that depend on each other.
fn begin_together(
    kinetics: &mut Kinetics,
    mode: ContactMode,
    begin: &[(usize, [usize; 2], usize)],
) -> Option<ContactMode> {
    for &(gap, pair, number) in begin {
        begins(kinetics, mode, (gap, pair), number)?;
    }
    refined(kinetics, mode, begin)
}

/// The same from the directions that are known roughly: each is found while the others stay.
fn refined(
    kinetics: &mut Kinetics,
    mode: ContactMode,
    begin: &[(usize, [usize; 2], usize)],
) -> Option<ContactMode> {
    let with =
        |mode: ContactMode, it: &(usize, [usize; 2], usize)| with_cone(mode, it.0, it.1, true);
    let all = begin.iter().fold(mode, with);
    for _ in 0..REFINED {
        let mut moved = 0.0_f64;
        for it in begin {
            let (gap, pair) = (it.0, it.1);
            let before = pair.map(|channel| kinetics.headings()[channel]);
            let rest = without_cone(all, it);
            kinetics.contact(rest).ok()?;
            let first = kinetics.coordinates();
            let b = kinetics.rows_of_cone(gap, pair).map(|row| kinetics.acceleration[first + row]);
            let slips = kinetics.local_contact(rest, (gap, pair), b)?.slips();
            moved = moved.max(kinetics.head_near(pair, &slips, before)?);
        }
        if moved <= TURNED {
            break;
        }
    }
    Some(all)
}

/// Turns the contacts of a mode that begin to slip into the directions in which they are accelerated with the loads as
/// dependent contacts share them, by Newton's method.
fn turned_together(
    kinetics: &mut Kinetics,
    mode: ContactMode,
    begun: Vec<[usize; 2]>,
) -> Option<()> {
    let (n, k) = (kinetics.coordinates(), begun.len());
    let mut angles: Vec<f64> = begun
        .iter()
        .map(|pair| {
            let [c, s] = pair.map(|channel| kinetics.headings()[channel]);
            s.atan2(c)
        })
        .collect();
    let misses = |kinetics: &mut Kinetics, angles: &[f64]| -> Option<Vec<f64>> {
        for (pair, angle) in begun.iter().zip(angles) {
            kinetics.head(*pair, [angle.cos(), angle.sin()]);
        }
        kinetics.contact(mode).ok()?;
        let of = |(pair, angle): (&[usize; 2], &f64)| {
            let [x, y] = pair.map(|channel| kinetics.acceleration[n + kinetics.row(channel)]);
            angle.cos() * y - angle.sin() * x
        };
        Some(begun.iter().zip(angles).map(of).collect())
    };
    let mut miss = misses(kinetics, &angles)?;
    for _ in 0..TURNS {
        let mut slopes = vec![0.0; k * k];
        for j in 0..k {
            let mut turned = angles.clone();
            turned[j] += DIFFERENCE;
            let there = misses(kinetics, &turned)?;
            (0..k).for_each(|i| slopes[i * k + j] = (there[i] - miss[i]) / DIFFERENCE);
        }
        let down: Vec<f64> = miss.iter().map(|miss| -miss).collect();
        let step = Elimination::new(slopes, k, f64::EPSILON).solve(&down);
        let shorter = (0..HALVINGS).find_map(|halvings| {
            let part = 0.5_f64.powi(halvings);
            let turned: Vec<f64> = angles.iter().zip(&step).map(|(a, s)| a + part * s).collect();
            let there = misses(kinetics, &turned)?;
            (largest(&there) < largest(&miss)).then_some((turned, there))
        });
        let Some((turned, there)) = shorter else { break };
        (angles, miss) = (turned, there);
    }
    misses(kinetics, &angles).map(|_| ())
}

/// A combination with its violation, unless its equations have no solution.
fn judged(
    kinetics: &mut Kinetics,
    (mode, touching): (ContactMode, GapSet),
    slips: &[f64],
) -> Option<Candidate> {
    kinetics.contact(mode).ok()?;
    let n = kinetics.coordinates();
    let mut violation = 0.0_f64;
    let mut kappa = 1.0;
    for level in kinetics.limits(mode) {
        if level.limit == Limit::Regularity {
            kappa = level.value;
            continue;
        }
        violation = violation.max(excess(-level.value, kinetics.force_scale(level.limit)));
    }
    for gap in touching.without(mode.closed).iter() {
        violation = violation
            .max(excess(-kinetics.acceleration[n + gap], kinetics.acceleration_scale(gap)));
    }
    let begun: Vec<[usize; 2]> = kinetics.cones(mode.slipping()).collect();
    for pair in begun.into_iter().filter(|pair| pair.iter().all(|&c| slips[c] == 0.0)) {
        let [x, y] = pair.map(|channel| kinetics.acceleration[n + kinetics.row(channel)]);
        let [c, s] = pair.map(|channel| kinetics.headings()[channel]);
        let scales = pair.map(|channel| kinetics.acceleration_scale(kinetics.row(channel)));
        let scale = scales[0].max(scales[1]);
        violation = violation.max(excess(-(c * x + s * y), scale));
        // where the sharing of loads decides, the direction is found with that in the first step
        let across = if kinetics.is_shared_motion { 0.0 } else { (c * y - s * x).abs() };
        violation = violation.max(excess(across, scale));
    }
    let is_planar = |c: &usize| slips[*c] == 0.0 && kinetics.other_of(*c).is_none();
    let begun: Vec<usize> = mode.slipping().iter().filter(is_planar).collect();
    for channel in begun {
        let row = kinetics.row(channel);
        let rate = mode.sign(channel) * kinetics.acceleration[n + row];
        violation = violation.max(excess(-rate, kinetics.acceleration_scale(row)));
    }
    let acceleration = kinetics.acceleration[..n].to_vec();
    // where the tip of an arm turns back at its full reach, no force keeps it there
    for row in kinetics.rows_of(mode).iter() {
        let left = dot(kinetics.normal(row), &acceleration) + kinetics.curvature(row);
        let misfit = excess(left.abs(), kinetics.acceleration_scale(row));
        violation = violation.max(if misfit > AGREES.0 { AGREES.1 * misfit } else { 0.0 });
    }
    let headings = kinetics.headings().to_vec();
    Some(Candidate { mode, violation, acceleration, kappa, headings })
}

/// The mode of many choices by [`Coulomb`], with its solution; none if numbers overflow.
fn by_steps(
    kinetics: &mut Kinetics,
    choices: &[Choice],
    known: ContactMode,
) -> Option<(ContactMode, CoulombSolution)> {
    let mut rows: Vec<usize> = Vec::new();
    let mut at = |row: usize| {
        rows.push(row);
        rows.len() - 1
    };
    let site = |choice: &Choice| match *choice {
        Choice::Joint(channel) => {
            let limits = kinetics.friction_limits(channel);
            Site::Joint { row: at(kinetics.row(channel)), limits }
        }
        Choice::Cone(gap, pair, slips) => {
            let heading = slips.then(|| pair.map(|channel| kinetics.headings()[channel]));
            let rows = kinetics.rows_of_cone(gap, pair).map(&mut at);
            Site::Cone { rows, mu: kinetics.friction_limits(pair[0]), heading }
        }
        Choice::Gap(gap, friction) => Site::Gap {
            normal: at(gap),
            friction: friction.map(|(channel, slip)| Rough {
                row: at(kinetics.row(channel)),
                mu: kinetics.friction_limits(channel),
                slip,
            }),
        },
    };
    let sites: Vec<Site> = choices.iter().map(site).collect();
    // what slips in joints goes on with its force
    let slipping: Vec<(usize, f64)> = (known.slipping().iter())
        .map(|channel| {
            let force = -kinetics.friction_limits(channel).0 * known.sign(channel);
            (kinetics.row(channel), force)
        })
        .collect();
    let mut b = Vec::with_capacity(rows.len());
    for &row in &rows {
        let pulled: f64 =
            slipping.iter().map(|&(joint, force)| kinetics.d(row, joint) * force).sum();
        b.push(kinetics.b(row) + pulled);
    }
    let d: Vec<f64> = rows
        .iter()
        .flat_map(|&i| rows.iter().map(move |&j| (i, j)))
        .map(|(i, j)| kinetics.d(i, j))
        .collect();
    let solved = Coulomb::new(sites, &d, &b).solve()?;
    let take = |mode: ContactMode, (choice, outcome): (&Choice, SiteMode)| match *choice {
        Choice::Joint(channel) => mode.with_channel(channel, outcome.slip),
        Choice::Gap(..) | Choice::Cone(..) if !outcome.closed => mode,
        Choice::Cone(gap, pair, _) => {
            if let Some(heading) = outcome.heading {
                kinetics.head(pair, heading);
            }
            with_cone(mode, gap, pair, outcome.heading.is_some())
        }
        Choice::Gap(gap, friction) => {
            let mode = ContactMode { closed: mode.closed.with(GapSet::of(gap)), ..mode };
            friction.map_or(mode, |(channel, _)| mode.with_channel(channel, outcome.slip))
        }
    };
    let mode = choices.iter().zip(solved.modes.iter().copied()).fold(known, take);
    Some((mode, solved))
}

impl Kinetics {
    /// A mode, whose forces have just been computed, without violated inequalities: gaps open, and
    /// sticking channels slip in the direction of the force. Of undetermined forces those that
    /// determine their margin violate them together: the weights of the margin are a motion of the
    /// system.
    fn without_violated(&mut self, mode: ContactMode) -> ContactMode {
        let violated: Vec<Limit> = match self.shares(mode) {
            Some(shares) => {
                let margin = shares.margin();
                let all = self.levels(mode);
                let negative = margin.value < 0.0;
                margin.support.iter().filter(|_| negative).map(|it| all[it.0].limit).collect()
            }
            None => {
                let all = self.limits(mode).into_iter();
                all.filter(|level| level.value < -level.noise).map(|level| level.limit).collect()
            }
        };
        let mut next = mode;
        for limit in &violated {
            if let Limit::Stick(channel, sign) = *limit {
                next = next.with_channel(channel, -sign);
                let other = self.other_of(channel);
                next = other
                    .map_or(next, |other| next.with_channel(channel, 1.0).with_channel(other, 1.0));
            }
        }
        for limit in &violated {
            if let Limit::Force(gap) = *limit {
                next.closed = next.closed.without(GapSet::of(gap));
                for channel in self.channels_of(gap) {
                    next = next.without_channel(channel);
                }
            }
        }
        next
    }
}

/// Violation relative to its scale.
fn excess(violation: f64, scale: f64) -> f64 {
    if violation > 0.0 {
        violation / scale
    } else {
        0.0
    }
}

fn chosen<E>(candidates: Vec<Candidate>, held: GapSet) -> Result<Candidate, Failure<E>> {
    let least = candidates.iter().fold(f64::INFINITY, |least, it| least.min(it.violation));
    if least.is_nan() || least > VIOLATIONS.1 {
        return Err(Failure::Status(Status::InconsistentContact));
    }
    let allowed = VIOLATIONS.0.max(least);
    let admissible = || candidates.iter().filter(|it| it.violation <= allowed);
    if admissible().any(|it| it.kappa <= 0.0) && !all_same(&candidates) {
        return Err(Failure::Status(Status::IndeterminateContact));
    }
    let order = |it: &&Candidate| {
        let ContactMode { closed, stick, .. } = it.mode;
        (closed.len(), stick.len(), stick.iter().filter(|&channel| held.has(channel)).count())
    };
    // the first of equals
    let best = admissible().fold(None, |best: Option<&Candidate>, it| match best {
        Some(best) if order(&best) >= order(&it) => Some(best),
        _ => Some(it),
    });
    best.cloned().ok_or(Failure::Status(Status::InconsistentContact))
}

/// Whether all admissible candidates have one motion, up to rounding.
fn all_same(candidates: &[Candidate]) -> bool {
    let least = candidates.iter().fold(f64::INFINITY, |least, it| least.min(it.violation));
    let allowed = VIOLATIONS.0.max(least);
    let mut admissible = candidates.iter().filter(|it| it.violation <= allowed);
    admissible.all(|it| same(it, candidates, allowed))
}

/// Whether a candidate has the motion of the first admissible one, up to rounding.
fn same(it: &Candidate, candidates: &[Candidate], allowed: f64) -> bool {
    let Some(first) = candidates.iter().find(|it| it.violation <= allowed) else { return true };
    let all = candidates.iter().flat_map(|it| &it.acceleration);
    let scale = all.fold(0.0_f64, |a, b| a.max(b.abs()));
    let pairs = it.acceleration.iter().zip(&first.acceleration);
    pairs.into_iter().all(|(a, b)| (a - b).abs() <= SAME * scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motions_are_the_same_to_rounding_of_the_fastest() {
        let of = |violation: f64, acceleration: [f64; 2]| Candidate {
            mode: ContactMode::default(),
            violation,
            acceleration: acceleration.to_vec(),
            kappa: 1.0,
            headings: vec![],
        };
        let all = [
            of(1.0, [7.0, 7.0]), // is not admissible, but says how large accelerations are
            of(0.0, [3.0, -100.0]),
            of(0.0, [3.0 + 5e-7, -100.0]),
            of(0.0, [3.0 + 2e-6, -100.0]),
        ];
        let found = [0, 1, 2, 3].map(|i| same(&all[i], &all, 1e-11));
        assert_eq!(found, [false, true, true, false]);
    }
}
