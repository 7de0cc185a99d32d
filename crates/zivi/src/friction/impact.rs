//! Impacts with friction: Newton's restitution and Coulomb's law between the impulses, in Moreau's form.
//!
//! On the gaps `C` that are zero, with the speeds `(g-, w-)` before,
//!
//! ```text
//! (g+, w+) = (g-, w-) + D P      0 <= P_N  perp  g+ + e g- >= 0
//!                                -P_T in mu P_N Sign(w+ + e_t w-)                          (1)
//! E+ - E- = 1/2 P . (v+ + v-)    v = (g', w)                                               (2)
//! ```
//!
//! Each contact opens, sticks, or slips one way: a linear system for each pattern, of which the one that
//! obeys the inequalities is the impact. At one contact there is exactly one. Energy cannot grow where
//! all `e_t` are the common `e`, nor at one contact with `e_t = 0` and `e^2 <= 1 - c^2`, where `c` is the
//! kinetic cosine of normal and tangent; elsewhere it may, which is reported.

use crate::friction::coulomb::{Coulomb, Rough, Site, ALL_PATTERNS, MOST_PATTERNS};
use crate::friction::decide::{with_cone, without_cone, DIRECTIONS, REFINED, TURNED};
use crate::friction::local::LocalSlip;
use crate::kinetics::Kinetics;
use crate::numeric::dense::{axpy, dot};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::system::force::{Friction, FrictionalImpact};
use crate::zeno::arc::restored;
use crate::Status;

/// Tolerances of the violation of a pattern relative to the speeds.
const MISFIT: (f64, f64) = (1e-11, 1e-9);
/// Rows that depend on each other agree to this part of the speeds, or there is no such impact.
const AGREES: f64 = 1e-6;
/// Speeds after an impact that differ by less are the same.
const SAME: f64 = 1e-9;
/// A slip that is left so little of its terms is rounding.
const ROUNDING: f64 = 256.0 * f64::EPSILON;
/// An impulse below this fraction of the speeds' scale counts as zero.
const PRESSED: f64 = 1e-9;

/// An impact with friction.
#[derive(Clone, Debug)]
pub(crate) struct FrictionalExchange {
    /// The contacts with an impulse and their modes; the slip of an open one has no sign.
    pub(crate) pattern: ContactMode,
    /// Impulses by row.
    pub(crate) impulses: Vec<f64>,
    /// The change of the velocities, and rates after it by row.
    pub(crate) push: Vec<f64>,
    pub(crate) rates: Vec<f64>,
    /// The change of the energy (2).
    pub(crate) gain: f64,
    /// Whether another pattern obeys (1) with other speeds.
    pub(crate) is_ambiguous: bool,
    /// Whether the speeds depend on how contacts share their impulses.
    pub(crate) is_shared: bool,
    violation: f64,
}

/// Data of equation (1).
pub(crate) struct Collision<'r> {
    /// The gaps that are zero.
    pub(crate) set: GapSet,
    /// Restitutions by gap and by channel.
    pub(crate) e: &'r [f64],
    pub(crate) friction: &'r Friction,
    /// Rates by row before the impact, and those that there are without it: the same, but over a step
    /// of time.
    pub(crate) before: &'r [f64],
    pub(crate) free: &'r [f64],
    /// The length of the step over which joints have an impulse; in an impact they have none.
    pub(crate) duration: f64,
    /// Whether there is no collision: the impulses are those without which no motion obeys the law.
    pub(crate) is_jammed: bool,
}

impl Collision<'_> {
    /// The impact by the law of the system, where that has just been evaluated.
    pub(crate) fn solve<E>(
        &self,
        kinetics: &mut Kinetics,
    ) -> Result<FrictionalExchange, Failure<E>> {
        match self.friction.law {
            _ if self.is_jammed => self.newton(kinetics),
            FrictionalImpact::Newton => self.newton(kinetics),
            FrictionalImpact::Poisson => self.poisson(kinetics),
            FrictionalImpact::Stronge => self.stronge(kinetics),
        }
    }

    /// The impact by equation (1).
    pub(crate) fn newton<E>(
        &self,
        kinetics: &mut Kinetics,
    ) -> Result<FrictionalExchange, Failure<E>> {
        let joints = (0..kinetics.layout.p)
            .filter(|&channel| self.duration > 0.0 && kinetics.gap_of(channel).is_none());
        let ways: Vec<ContactChannels> = (self.set.iter())
            .map(|gap| {
                let channel = kinetics.channel_of(gap);
                (Some(gap), channel, channel.and_then(|channel| kinetics.other_of(channel)))
            })
            .chain(joints.map(|channel| (None, Some(channel), None)))
            .collect();
        let count = ways.iter().fold(1_usize, |all, &way| all.saturating_mul(count(way)));
        let mut found: Vec<FrictionalExchange> = Vec::new();
        let cones = ways.iter().filter(|way| way.2.is_some()).count();
        if count > MOST_PATTERNS || cones > 1 && !self.is_jammed {
            let stepped = self.by_steps(&ways, kinetics);
            found.extend(stepped.and_then(|it| self.exchange_by_steps(it, &ways, kinetics)));
        }
        let is_found = found.iter().any(|it| it.violation <= MISFIT.1);
        if !is_found && count <= if cones > 1 { MOST_PATTERNS } else { ALL_PATTERNS } {
            for number in 0..count {
                let (mode, begin) = pattern(&ways, number);
                let pattern = match begin[..] {
                    [] => Some(mode),
                    [(gap, pair, number)] => self.slides(mode, (gap, pair), number, kinetics),
                    _ if begin.iter().any(|it| it.2 > 0) => None,
                    _ => self.slide_together(mode, &begin, kinetics),
                };
                found.extend(pattern.and_then(|pattern| self.on_pattern(pattern, kinetics)));
            }
        }
        let fastest = self.fastest(kinetics);
        if self.is_jammed {
            found.retain(|it| {
                let mut least = |gap: usize| PRESSED * fastest[gap] / kinetics.d(gap, gap);
                self.set.iter().any(|gap| it.impulses[gap] > least(gap))
            });
        }
        let tried_all = count <= ALL_PATTERNS && ways.iter().all(|way| way.2.is_none());
        let chosen = self.chosen(found, &fastest).ok_or(Failure::Status(unsolved(tried_all)))?;
        kinetics.turn(&chosen.rates);
        Ok(chosen)
    }

    /// The chosen impact of some; of several with other speeds one that touches no gaps but those that are hit.
    ///
    /// A rod that slides between opposite walls could be stopped by any impact elsewhere, as both may press.
    pub(super) fn chosen(
        &self,
        found: Vec<FrictionalExchange>,
        fastest: &[f64],
    ) -> Option<FrictionalExchange> {
        let is_apart = |it: &&FrictionalExchange| {
            let mut idle = self.set.iter().filter(|&gap| self.before[gap] >= -SAME * fastest[gap]);
            it.violation <= MISFIT.0
                && idle.all(|gap| {
                    let moved = it.rates[gap] - self.before[gap];
                    it.impulses[gap] == 0.0 && moved.abs() <= SAME * fastest[gap]
                })
        };
        let apart = found.iter().find(is_apart).cloned();
        let chosen = chosen(found, fastest)?;
        Some(if chosen.is_ambiguous && !self.is_jammed { apart.unwrap_or(chosen) } else { chosen })
    }

    /// The impact of the steps: with their impulses if these solve the equations, or the exact ones of their pattern.
    fn exchange_by_steps(
        &self,
        stepped: PatternWithImpulses,
        ways: &[ContactChannels],
        kinetics: &mut Kinetics,
    ) -> Option<FrictionalExchange> {
        let pattern = stepped.0;
        let solved = self.with_impulses(stepped, kinetics);
        if let Some(solved) = solved.filter(|it| it.violation <= MISFIT.1) {
            return Some(solved);
        }
        let pattern = self.with_directions(pattern, ways, kinetics)?;
        self.on_pattern(pattern, kinetics)
    }

    /// A pattern with the directions of the contacts with two that slip, which are known roughly.
    fn with_directions(
        &self,
        pattern: ContactMode,
        ways: &[ContactChannels],
        kinetics: &mut Kinetics,
    ) -> Option<ContactMode> {
        let slides = ways.iter().filter_map(|&(gap, channel, other)| {
            let pair = [channel?, other?];
            pattern.slip_plus.has(pair[0]).then_some((gap?, pair, 0))
        });
        let begin: Vec<Slide> = slides.collect();
        if begin.is_empty() {
            return Some(pattern);
        }
        self.refined(begin.iter().fold(pattern, without_cone), &begin, kinetics)
    }

    /// A pattern with one more contact, that slips after the impact in one of the directions in which it can.
    fn slides(
        &self,
        mode: ContactMode,
        (gap, pair): (usize, [usize; 2]),
        number: usize,
        kinetics: &mut Kinetics,
    ) -> Option<ContactMode> {
        let slips = self.slips(mode, (gap, pair), kinetics)?;
        kinetics.head(pair, slips.get(number)?.heading);
        Some(with_cone(mode, gap, pair, true))
    }

    /// The same with several more, in directions that depend on each other.
    fn slide_together(
        &self,
        mode: ContactMode,
        begin: &[Slide],
        kinetics: &mut Kinetics,
    ) -> Option<ContactMode> {
        for &(gap, pair, number) in begin {
            self.slides(mode, (gap, pair), number, kinetics)?;
        }
        self.refined(mode, begin, kinetics)
    }

    /// The same from the directions that are known roughly: each is found while the others stay.
    fn refined(
        &self,
        mode: ContactMode,
        begin: &[Slide],
        kinetics: &mut Kinetics,
    ) -> Option<ContactMode> {
        let with = |mode: ContactMode, it: &Slide| with_cone(mode, it.0, it.1, true);
        let all = begin.iter().fold(mode, with);
        for _ in 0..REFINED {
            let mut moved = 0.0_f64;
            for it in begin {
                let before = it.1.map(|channel| kinetics.headings()[channel]);
                let slips = self.slips(without_cone(all, it), (it.0, it.1), kinetics)?;
                moved = moved.max(kinetics.head_near(it.1, &slips, before)?);
            }
            if moved <= TURNED {
                break;
            }
        }
        Some(all)
    }

    /// The ways in which one more contact slips after the impact with a pattern of the others.
    fn slips(
        &self,
        mode: ContactMode,
        (gap, pair): (usize, [usize; 2]),
        kinetics: &mut Kinetics,
    ) -> Option<Vec<LocalSlip>> {
        let (n, m) = (kinetics.coordinates(), kinetics.layout.m);
        let mut push = vec![0.0; n];
        if !kinetics.rows_of(mode).is_empty() {
            let edges = kinetics.edges(mode).ok()?;
            edges.push(&edges.solve(|row| -(self.back(row, m) + self.free[row])), &mut push);
        }
        let b = kinetics
            .rows_of_cone(gap, pair)
            .map(|row| self.back(row, m) + self.free[row] + dot(kinetics.normal(row), &push));
        Some(kinetics.local_contact(mode, (gap, pair), b)?.slips())
    }

    /// The pattern of many contacts, and the impulses by row that solve its equations, if they are known, with
    /// whether others would move the system otherwise.
    fn by_steps(
        &self,
        ways: &[ContactChannels],
        kinetics: &mut Kinetics,
    ) -> Option<PatternWithImpulses> {
        let m = kinetics.layout.m;
        let mut rows: Vec<usize> = Vec::new();
        let mut at = |row: usize| {
            rows.push(row);
            rows.len() - 1
        };
        let mut sites = Vec::with_capacity(ways.len());
        for &(gap, channel, other) in ways {
            if let (Some(gap), Some(channel), Some(other)) = (gap, channel, other) {
                let (mu, _) = kinetics.friction_limits(channel);
                let rows = kinetics.rows_of_cone(gap, [channel, other]).map(&mut at);
                sites.push(Site::Cone { rows, mu: (mu, mu), heading: None });
                continue;
            }
            let limits = channel.map(|channel| kinetics.friction_limits(channel));
            let channel = channel.map(|channel| kinetics.row(channel)).zip(limits);
            sites.push(match (gap, channel) {
                (Some(gap), channel) => Site::Gap {
                    normal: at(gap),
                    friction: channel.map(|(row, (mu, _))| Rough {
                        row: at(row),
                        mu: (mu, mu),
                        slip: 0.0,
                    }),
                },
                (None, Some((row, (slip, stick)))) => {
                    let limits = (self.duration * slip, self.duration * stick);
                    Site::Joint { row: at(row), limits }
                }
                (None, None) => return None,
            });
        }
        let b: Vec<f64> = rows.iter().map(|&row| self.back(row, m) + self.free[row]).collect();
        let mut d = Vec::with_capacity(rows.len() * rows.len());
        for &i in &rows {
            d.extend(rows.iter().map(|&j| kinetics.d(i, j)));
        }
        let mut mode = ContactMode::default();
        let solved = Coulomb::new(sites, &d, &b).solve()?;
        for (&(gap, channel, other), outcome) in ways.iter().zip(solved.modes) {
            if !outcome.closed {
                continue;
            }
            if let (Some(gap), Some(channel), Some(other)) = (gap, channel, other) {
                if let Some(heading) = outcome.heading {
                    kinetics.head([channel, other], heading);
                }
                mode = with_cone(mode, gap, [channel, other], outcome.heading.is_some());
                continue;
            }
            mode.closed = gap.map_or(mode.closed, |gap| mode.closed.with(GapSet::of(gap)));
            mode = channel.map_or(mode, |channel| mode.with_channel(channel, outcome.slip));
        }
        let impulses = solved.forces.map(|forces| {
            let mut all = vec![0.0; kinetics.layout.rows()];
            rows.iter().zip(forces).for_each(|(&row, force)| all[row] = force);
            (all, [solved.is_shared, solved.is_ambiguous])
        });
        Some((mode, impulses))
    }

    /// The impact with impulses by row that solve the equations of a pattern.
    fn with_impulses(
        &self,
        (pattern, impulses): PatternWithImpulses,
        kinetics: &mut Kinetics,
    ) -> Option<FrictionalExchange> {
        let (impulses, [is_shared, is_ambiguous]) = impulses?;
        let mut push = vec![0.0; kinetics.coordinates()];
        for (row, &impulse) in impulses.iter().enumerate().filter(|(_, &impulse)| impulse != 0.0) {
            let along = kinetics.mobility(row).to_vec();
            axpy(&mut push, impulse, &along);
        }
        let rates = self.rates(pattern, (&push, &impulses), kinetics);
        let m = kinetics.layout.m;
        let violation = self.violation(pattern, &impulses, &rates, kinetics);
        let unpushed = |row: usize| self.back(row, m) + self.free[row];
        let violation = violation.max(self.misfit(pattern, unpushed, &push, kinetics));
        let mut exchange = self.exchange(pattern, impulses, push, rates, violation);
        (exchange.is_shared, exchange.is_ambiguous) = (is_shared, is_ambiguous);
        Some(exchange)
    }

    /// The scale of the rates of each row.
    pub(super) fn fastest(&self, kinetics: &mut Kinetics) -> Vec<f64> {
        let rows = self.before.len();
        let mut momentum = 0.0_f64;
        let slips = (0..kinetics.layout.p)
            .filter(|&c| kinetics.gap_of(c).map_or(self.duration > 0.0, |gap| self.set.has(gap)));
        let slips: Vec<usize> = slips.map(|channel| kinetics.row(channel)).collect();
        for row in self.set.iter().chain(slips) {
            let rate = self.before[row].abs().max(self.free[row].abs());
            momentum = momentum.max(rate / kinetics.d(row, row).sqrt());
        }
        (0..rows).map(|row| momentum * kinetics.d(row, row).sqrt()).collect()
    }

    /// Equation (1) with a pattern of contacts, and how far it violates the inequalities.
    fn on_pattern(
        &self,
        pattern: ContactMode,
        kinetics: &mut Kinetics,
    ) -> Option<FrictionalExchange> {
        let edges = kinetics.edges(pattern).ok()?;
        let n = kinetics.coordinates();
        let mut push = vec![0.0; n];
        let mut pulls = vec![0.0; kinetics.layout.p];
        for channel in pattern.slipping().iter().filter(|_| self.duration > 0.0) {
            if kinetics.gap_of(channel).is_none() {
                let (row, limit) = (kinetics.row(channel), kinetics.friction_limits(channel).0);
                pulls[channel] = -self.duration * limit * pattern.sign(channel);
                let along = kinetics.mobility(row).to_vec();
                axpy(&mut push, pulls[channel], &along);
            }
        }
        let target = |at: &Kinetics, row: usize| {
            self.back(row, at.layout.m) + self.free[row] + dot(at.normal(row), &push)
        };
        let at = &*kinetics;
        let forces = edges.solve(|row| -target(at, row));
        if !forces.iter().all(|force| force.is_finite()) {
            return None;
        }
        let duration = self.duration;
        let most = |channel: usize| match at.gap_of(channel) {
            Some(_) => at.friction_limits(channel).0,
            None => duration * at.friction_limits(channel).1,
        };
        // gaps that are not hit take part only where they must
        let is_idle = |row: usize| match row.checked_sub(at.layout.m) {
            None => self.before[row] >= 0.0,
            Some(channel) => at.gap_of(channel).is_some_and(|gap| self.before[gap] >= 0.0),
        };
        let mut impulses = at.impulses(pattern, (&edges, forces), &most, &is_idle);
        let forces: Vec<f64> = edges.rows().iter().map(|&row| impulses[row]).collect();
        edges.push(&forces, &mut push);
        for (channel, pull) in pulls.into_iter().enumerate().filter(|(_, pull)| *pull != 0.0) {
            impulses[kinetics.row(channel)] = pull;
        }
        let rates = self.rates(pattern, (&push, &impulses), kinetics);
        let violation = self.violation(pattern, &impulses, &rates, kinetics);
        let m = kinetics.layout.m;
        let unpushed = |row: usize| self.back(row, m) + self.free[row];
        let violation = violation.max(self.misfit(pattern, unpushed, &push, kinetics));
        Some(self.exchange(pattern, impulses, push, rates, violation))
    }

    /// An impact with its energy change (2).
    pub(super) fn exchange(
        &self,
        pattern: ContactMode,
        impulses: Vec<f64>,
        push: Vec<f64>,
        rates: Vec<f64>,
        violation: f64,
    ) -> FrictionalExchange {
        let both = rates.iter().zip(self.before).zip(&impulses);
        let gain = both.map(|((after, before), impulse)| 0.5 * impulse * (after + before)).sum();
        let (is_ambiguous, is_shared) = (false, false);
        FrictionalExchange {
            pattern,
            impulses,
            push,
            rates,
            gain,
            is_ambiguous,
            is_shared,
            violation,
        }
    }

    /// Rates by row after the impact: exact where the pattern says them.
    fn rates(
        &self,
        pattern: ContactMode,
        pushed: (&[f64], &[f64]),
        kinetics: &mut Kinetics,
    ) -> Vec<f64> {
        let rows = kinetics.rows_of(pattern);
        let each = self.before.iter().enumerate().map(|(row, &before)| {
            if !rows.has(row) {
                return rate_after(row, self.free[row], pushed, kinetics);
            }
            match row.checked_sub(kinetics.layout.m) {
                None => restored(self.e[row], before),
                // no negative zero
                Some(channel) => 0.0 - self.friction.channels[channel].e_t * before,
            }
        });
        each.collect()
    }

    /// Distance of the velocities from the conditions of a pattern, `unpushed + R push = 0` in its
    /// rows, which may be inconsistent for dependent rows. A disc that the floor throws up along a
    /// wall cannot stick to both.
    pub(super) fn misfit(
        &self,
        pattern: ContactMode,
        unpushed: impl Fn(usize) -> f64,
        push: &[f64],
        kinetics: &mut Kinetics,
    ) -> f64 {
        let fastest = self.fastest(kinetics);
        let mut worst = Violation::default();
        for row in kinetics.rows_of(pattern).iter() {
            let left = unpushed(row) + dot(kinetics.normal(row), push);
            worst.take(-left.abs(), fastest[row]);
        }
        if worst.0 > AGREES {
            worst.0
        } else {
            0.0
        }
    }

    /// The part of the rate before the impact that comes back, by row.
    fn back(&self, row: usize, m: usize) -> f64 {
        match row.checked_sub(m) {
            None => self.e[row] * self.before[row],
            Some(channel) => self.friction.channels[channel].e_t * self.before[row],
        }
    }

    /// The largest violation of the inequalities (1).
    fn violation(
        &self,
        pattern: ContactMode,
        impulses: &[f64],
        rates: &[f64],
        kinetics: &mut Kinetics,
    ) -> f64 {
        let fastest = self.fastest(kinetics);
        let mut worst = Violation::default();
        for gap in self.set.iter() {
            if !pattern.closed.has(gap) {
                worst.take(rates[gap] + self.e[gap] * self.before[gap], fastest[gap]);
                continue;
            }
            let d = kinetics.d(gap, gap);
            worst.take(impulses[gap], fastest[gap] / d);
            let Some(channel) = kinetics.channel_of(gap) else { continue };
            let (row, mu) = (kinetics.row(channel), kinetics.friction_limits(channel).0);
            if let Some(other) = kinetics.other_of(channel) {
                let pair = [channel, other];
                let rows = pair.map(|channel| kinetics.row(channel));
                let [x, y] = rows.map(|row| rates[row]);
                let scale = fastest[rows[0]].max(fastest[rows[1]]);
                if pattern.stick.has(channel) {
                    let scale = scale / kinetics.d(row, row) + mu * fastest[gap] / d;
                    let force = impulses[rows[0]].hypot(impulses[rows[1]]);
                    worst.take(mu * impulses[gap] - force, scale);
                } else {
                    let [c, s] = pair.map(|channel| kinetics.headings()[channel]);
                    worst.take(c * x + s * y, scale);
                    worst.take(-(c * y - s * x).abs(), scale);
                }
                continue;
            }
            let slip = rates[row] + self.friction.channels[channel].e_t * self.before[row];
            if pattern.stick.has(channel) {
                let scale = fastest[row] / kinetics.d(row, row) + mu * fastest[gap] / d;
                worst.take(mu * impulses[gap] - impulses[row].abs(), scale);
            } else {
                worst.take(pattern.sign(channel) * slip, fastest[row]);
            }
        }
        for channel in (0..kinetics.layout.p).filter(|_| self.duration > 0.0) {
            if kinetics.gap_of(channel).is_some() {
                continue;
            }
            let (row, most) =
                (kinetics.row(channel), self.duration * kinetics.friction_limits(channel).1);
            if pattern.stick.has(channel) {
                let scale = fastest[row] / kinetics.d(row, row) + most;
                worst.take(most - impulses[row].abs(), scale);
            } else {
                worst.take(pattern.sign(channel) * rates[row], fastest[row]);
            }
        }
        worst.0
    }
}

/// The rate of a row after impulses, and the change of the velocities by them. Feet of one body that slip as one
/// stop as one, and so does a joint along a gap that stays closed: a slip that is rounding is none.
pub(super) fn rate_after(
    row: usize,
    before: f64,
    (push, impulses): (&[f64], &[f64]),
    kinetics: &mut Kinetics,
) -> f64 {
    let after = before + dot(kinetics.normal(row), push);
    if row < kinetics.layout.m {
        return after;
    }
    let acting = impulses.iter().enumerate().filter(|(_, &impulse)| impulse != 0.0);
    let moved: f64 = acting.map(|(by, impulse)| (kinetics.d(row, by) * impulse).abs()).sum();
    if after.abs() <= ROUNDING * (before.abs() + moved) {
        0.0
    } else {
        after
    }
}

/// The largest violation of some inequalities `value >= 0`.
#[derive(Default)]
pub(super) struct Violation(pub(super) f64);

impl Violation {
    /// One more of them, relative to a scale.
    pub(super) fn take(&mut self, value: f64, scale: f64) {
        if value < 0.0 {
            self.0 = self.0.max(-value / scale);
        }
    }
}

/// The first of the impacts that stick most among those that obey the inequalities.
fn chosen(mut found: Vec<FrictionalExchange>, fastest: &[f64]) -> Option<FrictionalExchange> {
    let least = found.iter().fold(f64::INFINITY, |least, it| least.min(it.violation));
    if least.is_nan() || least > MISFIT.1 {
        return None;
    }
    found.retain(|it| it.violation <= MISFIT.0.max(least));
    let order = |it: &FrictionalExchange| it.pattern.stick.len();
    let most = found.iter().map(order).max()?;
    let at = found.iter().position(|it| order(it) == most)?;
    let mut chosen = found.swap_remove(at);
    let differs = |it: &FrictionalExchange| {
        let pairs = it.rates.iter().zip(&chosen.rates).zip(fastest);
        pairs.into_iter().any(|((a, b), fastest)| (a - b).abs() > SAME * fastest)
    };
    chosen.is_ambiguous |= found.iter().any(differs);
    Some(chosen)
}

/// Why there is no impact, and whether every pattern was tried.
pub(super) fn unsolved(tried_all: bool) -> Status {
    match tried_all {
        true => Status::InconsistentImpact,
        false => Status::ImpactNotSolved,
    }
}

/// A pattern, and impulses by row if they are known, with whether other shares of them would move the system otherwise,
/// and whether other rates are a solution.
type PatternWithImpulses = (ContactMode, Option<(Vec<f64>, [bool; 2])>);

/// A gap and its channel, or a joint, and the other channel of a gap with two.
type ContactChannels = (Option<usize>, Option<usize>, Option<usize>);

/// How many ways there are: sticking, slipping one way or the other, and open.
fn count((gap, channel, other): ContactChannels) -> usize {
    let slips = if other.is_some() { DIRECTIONS } else { 2 };
    1 + if channel.is_some() { slips } else { 0 } + usize::from(gap.is_some())
}

/// A contact with both of its channels, and the number of the direction in which it slips.
type Slide = (usize, [usize; 2], usize);

/// Contacts with an impulse and their friction modes, by pattern number; in the first all stick. With them those
/// with two directions of friction that slip.
fn pattern(ways: &[ContactChannels], number: usize) -> (ContactMode, Vec<Slide>) {
    let (mut mode, mut rest, mut slides) = (ContactMode::default(), number, Vec::new());
    for &(gap, channel, other) in ways {
        let count = count((gap, channel, other));
        let way = rest % count;
        rest /= count;
        if let (Some(gap), Some(channel), Some(other)) = (gap, channel, other) {
            if way == 0 {
                mode = with_cone(mode, gap, [channel, other], false);
            } else if way + 1 < count {
                slides.push((gap, [channel, other], way - 1));
            }
            continue;
        }
        if let Some(gap) = gap {
            if way + 1 == count {
                continue;
            }
            mode.closed = mode.closed.with(GapSet::of(gap));
        }
        if let Some(channel) = channel {
            mode = mode.with_channel(channel, [0.0, 1.0, -1.0][way]);
        }
    }
    (mode, slides)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinetics::Model;
    use crate::system::dynamics::{FunctionDynamics, Layout};
    use crate::system::force::Channel;
    use std::convert::Infallible;

    fn friction(gap: Option<usize>) -> Friction {
        Friction { channels: vec![Channel { gap, e_t: 0.0 }], ..Friction::default() }
    }

    fn kinetics(layout: Layout, friction: &Friction, row: &[f64]) -> Kinetics {
        let function = |_: f64, _: &[f64], _: &[f64], out: &mut [f64]| {
            out.copy_from_slice(row);
            Ok::<(), Infallible>(())
        };
        let mut dynamics = FunctionDynamics { layout, function };
        let mut kinetics = Kinetics::new(layout, friction);
        let zeros = vec![0.0; layout.n];
        kinetics.evaluate(&mut Model::new(&mut dynamics), 0.0, &zeros, &zeros).unwrap();
        kinetics
    }

    #[test]
    fn rates_are_measured_by_the_root_of_the_energy() {
        // M = diag(1, 4), g = q_2, w = q_1': d = 1/4 and 1
        let row =
            [1.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.3];
        let friction = friction(Some(0));
        let mut at = kinetics(Layout { n: 2, m: 1, p: 1, k: 0 }, &friction, &row);
        let rates = [-1.0, 0.5];
        let collision = Collision {
            set: GapSet::of(0),
            e: &[0.5],
            friction: &friction,
            before: &rates,
            free: &rates,
            duration: 0.0,
            is_jammed: false,
        };
        // max(1/sqrt(1/4), .5/1) = 2, times sqrt(1/4) and 1
        assert_eq!(collision.fastest(&mut at), [1.0, 2.0]);
    }

    #[test]
    fn a_joint_that_sticks_is_measured_by_its_limit_and_by_what_would_stop_it() {
        // M = 4, w = q': d = 1/4; its friction is 3 in slip, 4 at rest
        let friction = friction(None);
        let row = [4.0, 0.0, 1.0, 0.0, 0.0, 3.0, 4.0];
        let mut at = kinetics(Layout { n: 1, m: 0, p: 1, k: 0 }, &friction, &row);
        let collision = Collision {
            set: GapSet::default(),
            e: &[],
            friction: &friction,
            before: &[1.0],
            free: &[1.0],
            duration: 0.5,
            is_jammed: false,
        };
        let stick = ContactMode::default().with_channel(0, 0.0);
        // (5 - 4 * .5)/(4 * 1 + 4 * .5)
        assert_eq!(collision.violation(stick, &[-5.0], &[0.0], &mut at), 0.5);
        assert_eq!(collision.violation(stick, &[-2.0], &[0.0], &mut at), 0.0);
        // it slips back: by .25 of a speed of 1
        let slip = ContactMode::default().with_channel(0, 1.0);
        assert_eq!(collision.violation(slip, &[-1.5], &[-0.25], &mut at), 0.25);
    }
}
