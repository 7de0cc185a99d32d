//! Zeno accumulation of impacts, and the check that the force allows it.
//!
//! Accumulating impacts, and the extrapolated end of the accumulation.

use super::mode::Counted;
use super::settings::StallingImpacts;
use crate::record::status::Failure;
use crate::switched::settings::SwitchedRk;
use crate::zeno::arc::{Bounce, TailArc};
use crate::zeno::chain::Chain;
use crate::zeno::tail::Tail;
use crate::{Dependence, Force, Status};

use std::collections::TryReserveError;

/// Columns of the table of the Zeno time after the first. In 160 random runs with `e` up to 0.9995
/// 3 need 15 % more impacts before the jump; 5 save 8 % of them, but the error of the Zeno time is
/// twice as large in the median where `e` is near 1.
pub(crate) const COLUMNS: usize = 4;

/// The last impacts.
#[derive(Clone, Debug)]
pub(super) struct LastImpacts {
    chain: Chain<f64>,
    /// Whether the ratio of speeds in it is that of all of them.
    exactly: bool,
    /// Where the force last kept the mass from jumping to the end of it.
    obstacle: Option<Deviation>,
    /// Evaluations of the last examination of a tail, and impacts before the next one.
    examined: u64,
    patience: u64,
    stalling: StallingImpacts,
    /// Impacts without loss (`e = 1`) since the last rest: no impact sequence has them.
    elastic: usize,
}

impl LastImpacts {
    /// Of impacts whose slow ones have this restitution, exactly or in the limit.
    pub(super) fn new((e, exactly): (f64, bool)) -> Self {
        let stalling = StallingImpacts::default();
        let chain = Chain::new((), e, 0, COLUMNS);
        Self { chain, exactly, obstacle: None, examined: 0, patience: 0, stalling, elastic: 0 }
    }

    /// A run starts at a time.
    pub(super) fn start(&mut self, t: f64) {
        self.stalling = StallingImpacts::starting_at(t);
    }

    /// The impacts.
    pub(super) fn chain(&self) -> &Chain<f64> {
        &self.chain
    }

    /// Where the force last kept the mass from jumping.
    #[inline]
    pub(super) fn obstacle(&self) -> Option<Deviation> {
        self.obstacle
    }

    /// After an extrapolation that was cancelled: a long tail is not examined again at every impact.
    pub(super) fn note_cancelled(&mut self) {
        if self.examined > LONG {
            self.patience = self.examined / PER_IMPACT;
        }
    }

    /// Starts a new impact sequence.
    #[inline]
    pub(super) fn clear(&mut self) {
        self.chain.clear();
        self.patience = 0;
        self.elastic = 0;
    }

    /// Counts an impact without loss.
    #[inline]
    pub(super) fn note_elastic(&mut self) {
        self.elastic += 1;
    }

    /// From here on the force is another one.
    #[inline]
    pub(super) fn forget_force(&mut self) {
        self.obstacle = None;
        self.clear();
    }

    /// An error where there were too many impacts without an end.
    #[inline]
    pub(super) fn check_budget<E>(&mut self, most: usize) -> Result<(), Failure<E>> {
        if self.chain.bounces().len().max(self.elastic) > most {
            self.clear();
            return Err(Failure::Status(Status::ZenoBudget));
        }
        Ok(())
    }

    /// The flights from the last impact to the end.
    pub(super) fn tail(&self, zeno: f64, sigma: f64) -> Tail {
        self.chain.tail(zeno, sigma)
    }

    /// Appends an impact, after which the mass is on the branch `sigma`: where the impacts come to
    /// rest, if that is known to the tolerance and lies before `t_end`.
    pub(super) fn note<E, F: Force<E>>(
        &mut self,
        bounce: Bounce,
        (sigma, t_end): (f64, f64),
        settings: &SwitchedRk,
        force: &mut Counted<'_, F>,
    ) -> Result<Option<f64>, Failure<E>> {
        self.check_stalling(bounce, self.chain.e(), settings)?;
        self.chain.note(bounce, &[], &[])?;
        if bounce.g > 0.0 {
            self.end(bounce, (sigma, t_end), settings, force)
        } else {
            Ok(None)
        }
    }

    /// An error where the impacts, each of which leaves the part `e < 1` of the speed, go on at a wall
    /// without an acceleration towards it.
    fn check_stalling<E>(
        &mut self,
        bounce: Bounce,
        e: f64,
        settings: &SwitchedRk,
    ) -> Result<(), Failure<E>> {
        // where errors of the tolerance in each flight keep the speed up
        let slow = 10.0 * settings.atol[1] / (1.0 - e);
        if self.stalling.goes_on(bounce, slow) {
            return Err(Failure::Status(Status::ZenoBudget));
        }
        Ok(())
    }

    /// Takes an impact that is in no geometric impact sequence, after which each leaves at most the part `e` of the
    /// speed: whether the time that is left of all of them, at most `2 u/(g (1 - e))`, is below rounding.
    pub(super) fn note_alone<E>(
        &mut self,
        bounce: Bounce,
        e: f64,
        settings: &SwitchedRk,
    ) -> Result<bool, Failure<E>> {
        self.chain.clear();
        if e < 1.0 {
            self.check_stalling(bounce, e, settings)?;
        }
        let Bounce { t, u, g } = bounce;
        let (flight, rounding) = (2.0 * u / g, f64::EPSILON * t.abs());
        let over = g > 0.0 && flight <= 4.0 * rounding * (1.0 - e);
        if g > 0.0 && !over && flight <= 0.25 * rounding {
            // impacts that do not end, at one time
            return Err(Failure::Status(Status::ZenoBudget));
        }
        Ok(over)
    }

    /// Slow impacts outside of a geometric impact sequence end at `zeno`: a chain of that duration stands for
    /// them.
    pub(super) fn end_alone(&mut self, bounce: Bounce, zeno: f64) -> Result<(), TryReserveError> {
        let lost = 2.0 * bounce.u / (bounce.g * (zeno - bounce.t));
        self.chain.turn_to((), 1.0 - lost);
        self.chain.note(bounce, &[], &[])
    }

    /// Where the impact sequence comes to rest, if that is known.
    fn end<E, F: Force<E>>(
        &mut self,
        last: Bounce,
        (sigma, t_end): (f64, f64),
        settings: &SwitchedRk,
        force: &mut Counted<'_, F>,
    ) -> Result<Option<f64>, Failure<E>> {
        let t = last.t;
        if self.chain.is_over() {
            return Ok(Some((t + self.chain.remaining(last)).min(t_end)));
        }
        let tolerance = settings.zeno_tolerance(&self.chain, last.g);
        let is_constant = force.dependence::<E>() == Dependence::Constant;
        let exact = self.chain.end_under_constant_pull().filter(|_| is_constant && self.exactly);
        let known = exact.or_else(|| {
            let landing = self.chain.landing(&[1.0]);
            landing.filter(|landing| landing.size <= tolerance).map(|landing| landing.t)
        });
        let ahead = known.filter(|&zeno| zeno > t && zeno <= t_end);
        let Some(zeno) = ahead else { return Ok(None) };
        if is_constant {
            return Ok(Some(zeno));
        }
        if self.patience > 0 {
            self.patience -= 1;
            return Ok(None);
        }
        let (e, max_step) = (self.chain.e(), settings.max_step);
        let before = force.count();
        let tail = self.chain.tail(zeno, sigma);
        let period = force.shortest_period::<E>();
        let lookahead = Lookahead { tail: &tail, e, tolerance, max_step, period };
        self.obstacle = lookahead.obstacle(self.obstacle, force)?;
        self.examined = force.count() - before;
        Ok(self.obstacle.is_none().then_some(zeno))
    }
}

// Whether the force makes the motion that a tail describes.
//
// The expansion of a tail holds for smooth forces, and an impact sequence carries no information
// about the force ahead of it. So before a jump the flights that it would skip are put back into the
// equation. On the flight of duration `h` between the speeds `u` and `w`
//
// ```text
// r = f(t, x, x') - x''                                                               (1)
// ```
//
// is taken at Gauss's two points: `x''` of the cubic is a line, and there a smooth force differs
// from its best line by the third order in `h` only. To first order `r` moves the end of the flight,
// the speed after it and, with the mean pull `g = (u + w)/h`, the Zeno point by
//
// ```text
// dt = 1/w int r (h - tau) dtau      du = e (g dt - int r dtau)
// dt_inf = dt + 2 du/(g (1 - e))                                                      (2)
// ```
//
// The sum of `|dt_inf|` over the flights measures the distance of the tail from the motion; for
// smooth forces it is a small part of the tolerance. The long flights at the start of the tail are
// examined most closely. Where little of the tail is left, one flight stands for several: a pulse
// between two of them is overlooked, a change that lasts is not.

/// Where a smooth force and its best line meet, as parts of the way from the middle to an end.
const GAUSS: f64 = 0.577_350_269_189_625_8;

/// How far a tail may be from the motion, in tolerances of the Zeno time.
const MOST: f64 = 10.0;

/// A force that differs by no more, in roundings, from the acceleration of a flight is that: summed over
/// the flights of a long tail rounding would look like another motion.
const SAME: f64 = 64.0;

/// Remaining share of a tail from which flights are examined less closely.
const CLOSE: f64 = 0.5;

/// Panels of a flight before that.
const PANELS: usize = 3;

/// Remaining share of a tail from which flights are skipped in the examination.
const SPARSE: f64 = 0.15;

/// From then on one flight represents all flights over which the remaining share decreases by this
/// factor.
const LASTING: f64 = 0.25;

/// Examination interval relative to a known period of the force.
const PART: f64 = 0.25;

/// Steps of a flight where the force is known to do something.
const STEPS: f64 = 4.0;

/// A flight on which the force was seen to make another motion than expected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Deviation {
    from: f64,
    to: f64,
    /// Impacts before all flights are examined again.
    patience: u64,
}

/// Evaluations of a look in vain for which one impact passes before the next: under a force with
/// noise in it every look may be in vain.
const PER_IMPACT: u64 = 32;

/// Number of evaluations above which an examination is long.
const LONG: u64 = 4096;

impl Deviation {
    /// Longest step at `t`: between the stages of one that is a whole flight long there may be enough
    /// room to overlook once more what was seen.
    pub(crate) fn longest_step(&self, t: f64) -> f64 {
        if t >= self.from && t < self.to {
            (self.to - self.from) / STEPS
        } else {
            f64::INFINITY
        }
    }
}

/// The flights of a tail, looked at before they are skipped.
pub(crate) struct Lookahead<'t> {
    pub(crate) tail: &'t Tail,
    pub(crate) e: f64,
    /// Tolerance of the Zeno time (s).
    pub(crate) tolerance: f64,
    /// Longest time between two looks (s).
    pub(crate) max_step: f64,
    /// The shortest period of the force, where that is known (s).
    pub(crate) period: Option<f64>,
}

impl Lookahead<'_> {
    /// The first flight at which the force is known to make another motion; none if it makes that of
    /// the tail. A previous one, `suspect`, is examined first.
    pub(crate) fn obstacle<E, F: Force<E>>(
        &self,
        suspect: Option<Deviation>,
        force: &mut Counted<'_, F>,
    ) -> Result<Option<Deviation>, Failure<E>> {
        let (zeno, most) = (self.tail.zeno_time(), MOST * self.tolerance);
        if let Some(last) = suspect {
            let patience = last.patience.saturating_sub(1);
            if let Some(arc) = self.tail.arc_at(0.5 * (last.from + last.to)) {
                let shift = self.shift(&arc, PANELS, force)?;
                if shift.is_nan() || shift > most {
                    return Ok(Some(Deviation { from: arc.start, to: arc.end, patience }));
                }
            }
            if last.patience > 0 {
                return Ok(Some(Deviation { patience, ..last }));
            }
        }
        let before = force.count();
        let whole = zeno - self.tail.start();
        let (mut shift, mut m) = (0.0, 0);
        while let Some(arc) = self.tail.arc(m).filter(|arc| zeno - arc.start > most) {
            let (panels, arcs) = self.closeness(&arc, (zeno - arc.start) / whole);
            shift += arcs as f64 * self.shift(&arc, panels, force)?;
            if shift.is_nan() || shift > most {
                let patience = (force.count() - before) / PER_IMPACT;
                return Ok(Some(Deviation { from: arc.start, to: arc.end, patience }));
            }
            m += arcs;
        }
        let pulled = match force.at_wall(zeno) {
            Err(Failure::Status(_)) => false,
            pull => pull? <= 0.0,
        };
        Ok((!pulled).then_some(Deviation { from: zeno, to: zeno, patience: 0 }))
    }

    /// Resolution of the examination of a flight when a share `left` of the tail remains: number of
    /// panels, and number of flights that it represents.
    fn closeness(&self, arc: &TailArc, left: f64) -> (usize, usize) {
        let h = arc.end - arc.start;
        let longest = self.period.map_or(self.max_step, |period| self.max_step.min(PART * period));
        let panels = (GAUSS * h / longest).ceil().max(1.0) as usize;
        if left > CLOSE {
            return (if self.period.is_some() { panels } else { panels.max(PANELS) }, 1);
        }
        if left > SPARSE {
            return (panels, 1);
        }
        let arcs = libm::log(LASTING) / libm::log(self.e);
        (panels, arcs.min(longest / h).max(1.0).round() as usize)
    }

    /// As [`Self::deviation`]; NaN where the force is not finite.
    fn shift<E, F: Force<E>>(
        &self,
        arc: &TailArc,
        panels: usize,
        force: &mut Counted<'_, F>,
    ) -> Result<f64, Failure<E>> {
        match self.deviation(arc, panels, force) {
            Err(Failure::Status(_)) => Ok(f64::NAN),
            shift => Ok(shift?.abs()),
        }
    }

    /// By how much the residual on a flight moves the Zeno point, equation (2).
    fn deviation<E, F: Force<E>>(
        &self,
        arc: &TailArc,
        panels: usize,
        force: &mut Counted<'_, F>,
    ) -> Result<f64, Failure<E>> {
        let h = arc.length;
        let parts = panels as f64;
        let (mut impulse, mut moment) = (0.0, 0.0);
        for panel in 0..panels {
            for side in [-GAUSS, GAUSS] {
                let theta = (panel as f64 + 0.5 + 0.5 * side) / parts;
                let t = arc.start + theta * h;
                let at = arc.at(t);
                let expected = arc.acceleration(t);
                let r = force.known_at(t, at.x, at.xdot)? - expected;
                if r.abs() <= SAME * f64::EPSILON * expected.abs() {
                    continue;
                }
                impulse += r;
                moment += r * (1.0 - theta) * h;
            }
        }
        let weight = 0.5 * h / parts;
        let (u, w) = (arc.u, -arc.incoming);
        let g = (u + w) / h;
        let dt = weight * moment / w;
        let du = self.e * (g * dt - weight * impulse);
        Ok(dt + 2.0 * du / (g * (1.0 - self.e)))
    }
}

#[cfg(test)]
mod lookahead_tests {
    use super::*;
    use crate::zeno::arc::Bounce;
    use crate::zeno::chain::Chain;
    use crate::FunctionForce;

    /// `x'' = -2`, `e = 1/2`: impacts at 0, 1, 1.5, 1.75, ...; the tail follows 1.5.
    const E: f64 = 0.5;
    const PULL: f64 = 2.0;
    const ZENO: f64 = 2.0;
    const TOLERANCE: f64 = 1e-6;

    fn tail() -> Tail {
        let mut chain = Chain::<f64>::new((), E, 0, 4);
        for (t, u) in [(0.0, 1.0), (1.0, 0.5), (1.5, 0.25)] {
            assert!(chain.note(Bounce { t, u, g: PULL }, &[], &[]).is_ok());
        }
        chain.tail(ZENO, 1.0)
    }

    /// Result of the examination of the tail, and the number of force evaluations.
    fn look(
        max_step: f64,
        suspect: Option<Deviation>,
        f: impl Fn(f64) -> f64,
    ) -> (Option<Deviation>, u64) {
        let tail = tail();
        let ahead = Lookahead { tail: &tail, e: E, tolerance: TOLERANCE, max_step, period: None };
        let mut force = FunctionForce(|t: f64, _: f64, _: f64| Ok::<f64, ()>(f(t)));
        let mut force = Counted::new(&mut force);
        let found = ahead.obstacle(suspect, &mut force).unwrap();
        (found, force.count())
    }

    fn start_of(found: Option<Deviation>) -> Option<f64> {
        found.map(|obstacle| obstacle.from)
    }

    /// A push from `from` on, for the time `length`.
    fn push(size: f64, from: f64, length: f64) -> impl Fn(f64) -> f64 {
        move |t| if t >= from && t < from + length { size - PULL } else { -PULL }
    }

    #[test]
    fn the_shift_is_that_of_the_zeno_point() {
        // on the flight from 1.5 the pull is p - c (t - 1.5): x/t = u - p t/2 + c t^2/6 = 0 at its end
        let (tail, u, c) = (tail(), 0.25, 1e-5);
        let p = PULL - 0.25 * c;
        let h = 2.0 * u / (0.5 * p + (0.25 * p * p - 2.0 * c * u / 3.0).sqrt());
        let w = p * h - u - 0.5 * c * h * h;
        let exact = 1.5 + h + 2.0 * E * w / (PULL * (1.0 - E)) - ZENO;
        let mut force = FunctionForce(|t: f64, _: f64, _: f64| Ok::<f64, ()>(c * (t - 1.5) - p));
        let mut force = Counted::new(&mut force);
        let ahead =
            Lookahead { tail: &tail, e: E, tolerance: TOLERANCE, max_step: 1.0, period: None };
        let arc = tail.arc(0).unwrap();
        for panels in [1, 3] {
            let shift = ahead.deviation(&arc, panels, &mut force).unwrap();
            assert!((shift / exact - 1.0).abs() < 1e-4, "{panels}: {shift:e} {exact:e}");
        }
    }

    #[test]
    fn an_arc_is_an_obstacle_where_the_force_moves_the_zeno_point_too_far() {
        assert_eq!(start_of(look(1.0, None, |_| -PULL).0), None);
        // a push r over a flight makes it longer by 2 u r/g^2, with the same speed at its end
        let enough = MOST * TOLERANCE * PULL * PULL;
        let first = |part: f64| push(part * enough / (2.0 * 0.25), 1.5, 0.25);
        assert_eq!(start_of(look(1.0, None, first(0.9)).0), None);
        assert_eq!(start_of(look(1.0, None, first(1.1)).0), Some(1.5));
        let second = |part: f64| push(part * enough / (2.0 * 0.125), 1.75, 0.125);
        assert_eq!(start_of(look(1.0, None, second(0.9)).0), None);
        assert_eq!(start_of(look(1.0, None, second(1.1)).0), Some(1.75));
        // one that the next takes back moves both flights all the same
        let both = |t: f64| if t < 1.75 { first(0.6)(t) } else { second(-0.6)(t) };
        assert_eq!(start_of(look(1.0, None, both).0), Some(1.75));
        // nor is there a motion where the force has no value
        assert_eq!(start_of(look(1.0, None, push(f64::NAN, 1.75, 0.1)).0), Some(1.75));
    }

    #[test]
    fn without_a_pull_at_its_end_there_is_no_rest() {
        for at_zeno in [1.0, f64::NAN] {
            let found = look(1.0, None, push(at_zeno + PULL, ZENO, 1.0)).0;
            assert_eq!(start_of(found), Some(ZENO), "{at_zeno}");
        }
        assert_eq!(start_of(look(1.0, None, push(PULL, ZENO, 1.0)).0), None);
    }

    #[test]
    fn no_pulse_as_long_as_the_longest_step_is_overlooked() {
        let length = 2e-3;
        for from in [1.51, 1.6, 1.62, 1.7, 1.77, 1.8] {
            let found = look(length, None, push(1.0, from, 1.1 * length)).0;
            let arc = if from < 1.75 { 1.5 } else { 1.75 };
            assert_eq!(start_of(found), Some(arc), "{from}");
        }
    }

    #[test]
    fn where_little_is_left_one_arc_stands_for_several() {
        // at 0.99 there are 1400 flights before what is left is 1e-6 of the tail
        let (e, g) = (0.99_f64, 2.0);
        let mut chain = Chain::<f64>::new((), e, 0, 4);
        let zeno = 1.0 / (1.0 - e);
        for n in -100..=0 {
            let q = e.powi(n);
            assert!(chain.note(Bounce { t: zeno * (1.0 - q), u: q, g }, &[], &[]).is_ok());
        }
        let tail = chain.tail(zeno, 1.0);
        let ahead =
            Lookahead { tail: &tail, e, tolerance: 1e-6 * zeno, max_step: 1e3, period: None };
        for (until, lasting) in [(2.0 * zeno, false), (0.999 * zeno, true)] {
            let mut force = FunctionForce(|t: f64, _: f64, _: f64| {
                Ok::<f64, ()>(if t < until { -g } else { -1.1 * g })
            });
            let mut force = Counted::new(&mut force);
            let found = ahead.obstacle(None, &mut force).unwrap();
            assert_eq!(found.is_some(), lasting, "{found:?}");
            assert!(force.count() < 1000, "{}", force.count());
        }
    }

    #[test]
    fn what_was_seen_once_is_looked_at_first_and_the_rest_again_when_patience_ends() {
        let suspect = |patience| Some(Deviation { from: 1.75, to: 1.875, patience });
        let look = |patience, f: &dyn Fn(f64) -> f64| look(1.0, suspect(patience), f);
        let one_arc = 2 * PANELS as u64;
        let (found, asked) = look(2, &push(1.0, 1.75, 0.125));
        assert_eq!((found, asked), (suspect(1), one_arc));
        // where it is gone, the others have to wait
        assert_eq!(look(2, &|_| -PULL), (suspect(1), one_arc));
        let (found, asked) = look(0, &|_| -PULL);
        assert!(found.is_none() && asked > 3 * one_arc, "{found:?} {asked}");
        let (found, _) = look(0, &push(1.0, 1.5, 0.25));
        assert_eq!(start_of(found), Some(1.5));
    }
}
