//! The force at the end of a step that itself depends on the force.
//!
//! With the force frozen at a trial value the step has a closed form; what is left is one scalar
//! equation for that value, `mismatch(f) = f(t, x(f), x'(f)) - f = 0`. Within one sign pattern `x`
//! and `x'` are affine in the trial, hence one secant step is exact for a linear force. The slope
//! is carried from step to step, and a bracket is kept wherever the mismatch has changed sign.

use crate::record::status::Failure;
use crate::stepping::fixed_step::Start;
use crate::stepping::step_solver::StepSolver;
use crate::system::dynamics::finite_force;
use crate::{Force, Status};
use zivi_core::step::PATTERNS;
use zivi_core::transform::project;
use zivi_core::{Physical, StepSolution, ThetaGammaStep};

/// The mismatch that is accepted, relative to the force of the step or of the one before.
pub(crate) const TOLERANCE: f64 = 1e-12;
/// Trial forces along the selected solutions.
const SELECTED_TRIALS: usize = 20;
/// Trial forces along one sign pattern.
const PATTERN_TRIALS: usize = 60;
/// From this trial on a mismatch at the rounding of the force is accepted too.
const SLOW_TRIALS: usize = 3;

/// Solver state carried over the steps of a run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ImplicitForce {
    /// The force of the last step: the first trial of the next.
    pub(crate) last: Option<f64>,
    /// Slope of the mismatch at the last solution, about -1 for small steps.
    pub(crate) slope: f64,
    pub(crate) nfev: u64,
}

/// A step with an unknown force.
struct ImplicitStep<'a> {
    step: &'a ThetaGammaStep,
    start: Start,
    t: f64,
}

/// A force evaluated at several states at one time.
struct AtOneTime<'a, F> {
    force: &'a mut F,
    /// Its excitation there.
    excitation: Option<f64>,
}

impl<'a, F> AtOneTime<'a, F> {
    #[inline]
    fn new<E>(force: &'a mut F, t: f64) -> Self
    where
        F: Force<E>,
    {
        let excitation = force.excitation(t);
        Self { force, excitation }
    }
}

impl<E, F: Force<E>> Force<E> for AtOneTime<'_, F> {
    #[inline]
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        match self.excitation {
            Some(excitation) => self.force.excited(excitation, t, x, xdot),
            None => self.force.at(t, x, xdot),
        }
    }

    fn is_interruption(&self, error: &E) -> bool {
        self.force.is_interruption(error)
    }
}

type Found<E> = Result<(f64, StepSolution), Failure<E>>;

const NOT_CONVERGED: Status = Status::ForceNotConverged;

impl Default for ImplicitForce {
    fn default() -> Self {
        Self { last: None, slope: DEFAULT_SLOPE, nfev: 0 }
    }
}

impl ImplicitForce {
    /// The step from `start` and its force, consistent to [`TOLERANCE`].
    ///
    /// The equation is solved along the solution that the selection rule takes for each trial.
    /// Where that solution jumps (`f > 0`), the root may lie on a pattern that the rule leaves
    /// before it is reached; then every pattern is followed separately.
    #[inline]
    pub(crate) fn solve<E>(
        &mut self,
        step: &ThetaGammaStep,
        solver: &mut impl StepSolver,
        start: Start,
        force: &mut impl Force<E>,
    ) -> Found<E> {
        let sought = ImplicitStep { step, start, t: start.t + step.theta() * step.h() };
        let first = match self.last {
            Some(last) => last,
            None => self.evaluate(force, start.t, project(start.z, step.restitution()))?,
        };
        self.last = Some(first);
        let force = &mut AtOneTime::new(force, sought.t);
        let mut opening = Opening::from(first, self.slope);
        let found = match self.at_once(&sought, solver, force, &mut opening) {
            Ok(Some(found)) => return Ok(found),
            Ok(None) => self.follow(&sought, force, opening.search(SELECTED_TRIALS), |f| {
                solver.solve(step, start.z, f, start.sigma).map_err(Failure::from)
            }),
            Err(failed) => Err(failed),
        };
        let found = match found {
            Err(Failure::Status(why)) => {
                solver.replaced();
                self.on_any_pattern(&sought, force, first, why)?
            }
            found => found?,
        };
        self.last = Some(found.0);
        Ok(found)
    }

    /// The same if the first or second trial is the root, the case of nearly every step.
    #[inline(always)]
    fn at_once<E>(
        &mut self,
        sought: &ImplicitStep<'_>,
        solver: &impl StepSolver,
        force: &mut impl Force<E>,
        opening: &mut Opening,
    ) -> Result<Option<(f64, StepSolution)>, Failure<E>> {
        opening.root(|trial| {
            let Some(end) = solver.everyday(sought.step, sought.start.z, trial) else {
                return Ok(Shown::Nothing);
            };
            let value = self.evaluate(force, sought.t, sought.state_at_theta(&end))?;
            if !self.is_consistent(value, trial) {
                return Ok(Shown::Mismatch(value - trial));
            }
            self.last = Some(trial);
            Ok(Shown::Root((trial, end)))
        })
    }

    /// Whether a trial is the force that it leads to.
    #[inline(always)]
    fn is_consistent(&self, value: f64, trial: f64) -> bool {
        let scale = value.abs().min(trial.abs()).max(self.last.map_or(0.0, f64::abs));
        (value - trial).abs() <= TOLERANCE * scale
    }

    /// Solves `mismatch = 0` along the ends of step that `end` gives for each trial force.
    #[inline]
    fn follow<E>(
        &mut self,
        sought: &ImplicitStep<'_>,
        force: &mut impl Force<E>,
        mut search: SignSearch,
        mut end: impl FnMut(f64) -> Result<StepSolution, Failure<E>>,
    ) -> Found<E> {
        while let Some(trial) = search.trial() {
            let reached = end(trial)?;
            let value = self.evaluate(force, sought.t, sought.state_at_theta(&reached))?;
            let mismatch = value - trial;
            if self.is_consistent(value, trial)
                || (search.trials() > SLOW_TRIALS
                    && mismatch.abs() <= self.rounding(sought, force, (trial, &reached), value)?)
            {
                self.slope = search.slope();
                return Ok((trial, reached));
            }
            search.learn(mismatch);
        }
        Err(Failure::Status(NOT_CONVERGED))
    }

    /// Solves `mismatch = 0` on every pattern and takes the solution nearest to the exact motion
    /// under its own force (the first, where that presses to the wall). `why` the selected
    /// solutions did not do is reported if no pattern does either.
    #[cold]
    fn on_any_pattern<E>(
        &mut self,
        sought: &ImplicitStep<'_>,
        force: &mut impl Force<E>,
        first: f64,
        why: Status,
    ) -> Found<E> {
        let ImplicitStep { step, start: Start { z, sigma, .. }, .. } = *sought;
        let mut failure = Failure::Status(why);
        let mut best = None;
        let mut least = f64::INFINITY;
        for pattern in PATTERNS {
            for range in step.force_ranges(pattern, z, sigma).into_iter().flatten() {
                let search = SignSearch::within(range, first, PATTERN_TRIALS);
                let f = match self.follow(sought, force, search, |f| {
                    let end = step.continued(pattern, z, f, sigma);
                    end.ok_or(Failure::Status(NOT_CONVERGED))
                }) {
                    Ok((f, _)) => f,
                    Err(Failure::Status(NOT_CONVERGED)) => continue,
                    Err(raised @ Failure::Raised(_)) => return Err(raised),
                    Err(status) => {
                        failure = status;
                        continue;
                    }
                };
                let Some(end) = step.accepted(pattern, z, f, sigma) else { continue };
                let away = step.inconsistency(&end, z, f, sigma);
                if away < least {
                    (best, least) = (Some((f, end)), away);
                }
            }
        }
        self.slope = DEFAULT_SLOPE;
        best.ok_or(failure)
    }

    /// One counted evaluation; NaN and infinity are failures.
    #[inline]
    pub(crate) fn evaluate<E>(
        &mut self,
        force: &mut impl Force<E>,
        t: f64,
        state: Physical,
    ) -> Result<f64, Failure<E>> {
        self.nfev += 1;
        finite_force(force, t, state)
    }

    /// How much the force changes when the state at which it is taken changes by its rounding:
    /// no trial can do better.
    #[cold]
    fn rounding<E>(
        &mut self,
        sought: &ImplicitStep<'_>,
        force: &mut impl Force<E>,
        (trial, end): (f64, &StepSolution),
        value: f64,
    ) -> Result<f64, Failure<E>> {
        let state = sought.state_at_theta(end);
        let Physical { x, xdot } = sought.rounding_at_theta(trial, end);
        let by_x = Physical { x: state.x + x, ..state };
        let by_xdot = Physical { xdot: state.xdot + xdot, ..state };
        let change_x = (self.evaluate(force, sought.t, by_x)? - value).abs();
        let change_xdot = (self.evaluate(force, sought.t, by_xdot)? - value).abs();
        Ok(change_x + change_xdot)
    }
}

impl ImplicitStep<'_> {
    /// `(x, x')` at `t + theta h`.
    #[inline]
    fn state_at_theta(&self, end: &StepSolution) -> Physical {
        let (step, z) = (self.step, self.start.z);
        let mean = |new: f64, old: f64| step.theta() * new + (1.0 - step.theta()) * old;
        let r = step.restitution().r(end.lambda_s, end.lambda_v);
        Physical { x: mean(end.s, z.s).abs(), xdot: r * end.lambda_s * mean(end.v, z.v) }
    }

    /// Rounding of that state: a few units in the last place of the summed terms.
    fn rounding_at_theta(&self, f: f64, end: &StepSolution) -> Physical {
        let lambda = [end.lambda_s, end.lambda_v];
        let [scale_s, scale_v] = self.step.vi_scales(self.start.z, f, lambda);
        let r = self.step.restitution().r(end.lambda_s, end.lambda_v);
        Physical { x: 8.0 * f64::EPSILON * scale_s, xdot: 8.0 * f64::EPSILON * r * scale_v }
    }
}

// The first two trials of a search, one of which is the root in nearly every step: taken without
// the book-keeping of a search, which learns afterwards what they have shown.

/// Result of a trial.
pub(crate) enum Shown<T> {
    /// It is the root, with its result.
    Root(T),
    /// Its mismatch.
    Mismatch(f64),
    /// Nothing: it has to be tried with more care.
    Nothing,
}

/// The first trials of [`SignSearch::from`], and their mismatches.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Opening {
    first: f64,
    slope: f64,
    mismatches: [Option<f64>; 2],
}

impl Opening {
    /// Before the trial `first`, with the slope of the last search.
    #[inline]
    pub(crate) fn from(first: f64, slope: f64) -> Self {
        Self { first, slope, mismatches: [None; 2] }
    }

    /// Takes the trials until one of them is the root; none if neither is.
    #[inline(always)]
    pub(crate) fn root<T, E>(
        &mut self,
        mut show: impl FnMut(f64) -> Result<Shown<T>, E>,
    ) -> Result<Option<T>, E> {
        let mut trial = self.first;
        for place in &mut self.mismatches {
            let mismatch = match show(trial)? {
                Shown::Root(root) => return Ok(Some(root)),
                Shown::Mismatch(mismatch) => mismatch,
                Shown::Nothing => break,
            };
            *place = Some(mismatch);
            let Some(next) = SignSearch::second(trial, mismatch, self.slope) else { break };
            trial = next;
        }
        Ok(None)
    }

    /// The search that has made these trials.
    #[inline]
    pub(crate) fn search(&self, cap: usize) -> SignSearch {
        let mut search = SignSearch::from(self.first, self.slope, cap);
        for mismatch in self.mismatches.into_iter().flatten() {
            if search.trial().is_some() {
                search.learn(mismatch);
            }
        }
        search
    }
}

// A scalar root search that asks for one trial at a time: secant steps, held inside a range and,
// once the sign has changed, inside a bracket that is halved where the secant is slow.

/// Slope of the mismatch where the end of the step does not depend on the force (`h -> 0`).
pub(crate) const DEFAULT_SLOPE: f64 = -1.0;
/// From this trial on every second one halves the bracket.
const SLOW_SEARCH: usize = 6;
/// From this trial on, a search without a bracket uses growing steps to find one.
const BLIND: usize = 3;
/// A trial this many times larger than the first ones has run away.
const RUNAWAY: f64 = 1e9;

/// The state of one search.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SignSearch {
    trial: f64,
    slope: f64,
    previous: Option<(f64, f64)>,
    range: (f64, f64),
    positive: Option<f64>,
    negative: Option<f64>,
    largest: f64,
    trials: usize,
    cap: usize,
    open: bool,
}

impl SignSearch {
    /// A search from `first` with the slope of the last one.
    #[inline]
    pub(crate) fn from(first: f64, slope: f64, cap: usize) -> Self {
        Self {
            trial: first,
            slope,
            previous: None,
            range: (f64::NEG_INFINITY, f64::INFINITY),
            positive: None,
            negative: None,
            largest: f64::INFINITY,
            trials: 0,
            cap,
            open: true,
        }
    }

    /// A search inside `range` from the point there that is nearest to `first`.
    pub(crate) fn within(range: (f64, f64), first: f64, cap: usize) -> Self {
        let nearest = first.max(range.0).min(range.1);
        Self { range, ..Self::from(nearest, DEFAULT_SLOPE, cap) }
    }

    /// The trial after the first one of [`SignSearch::from`], if that is a plain one.
    #[inline(always)]
    pub(crate) fn second(first: f64, mismatch: f64, slope: f64) -> Option<f64> {
        let next = first - mismatch / slope;
        // false for NaN
        let usual = next != first && next.abs() <= RUNAWAY * (first.abs() + mismatch.abs());
        usual.then_some(next)
    }

    /// The next trial, or none when nothing is left to try.
    #[inline]
    pub(crate) fn trial(&mut self) -> Option<f64> {
        self.trials += 1;
        (self.open && self.trials <= self.cap).then_some(self.trial)
    }

    /// Number of trials asked for.
    pub(crate) fn trials(&self) -> usize {
        self.trials
    }

    /// The slope by the last secant.
    pub(crate) fn slope(&self) -> f64 {
        self.slope
    }

    /// Takes the mismatch of the last trial and chooses the next.
    #[inline]
    pub(crate) fn learn(&mut self, mismatch: f64) {
        let trial = self.trial;
        let end = if mismatch > 0.0 { &mut self.positive } else { &mut self.negative };
        *end = Some(trial);
        match self.previous {
            Some((other, its)) => self.update_slope((mismatch - its) / (trial - other)),
            None => self.largest = RUNAWAY * (trial.abs() + mismatch.abs()),
        }
        self.previous = Some((trial, mismatch));
        let mut next = self.inside(trial - mismatch / self.slope);
        if !self.is_bracketed() && (self.trials > BLIND || next == trial) {
            // a force that stays bounded while the trial grows: the root lies where the mismatch
            // points, however the secant turns
            let growth = 1_u32 << (2 * self.trials.saturating_sub(BLIND)).min(30);
            next = self.inside(trial + mismatch * f64::from(growth));
        }
        // standing still: at an end of the range, or no number left in the bracket
        self.open = next != trial && next.abs() <= self.largest;
        self.trial = next;
    }

    /// A secant that is nearly level leads nowhere; then the default is tried.
    fn update_slope(&mut self, secant: f64) {
        let usable = secant.is_finite() && secant.abs() > 1e-3;
        self.slope = if usable { secant } else { DEFAULT_SLOPE };
    }

    /// The point nearest to the proposal that the range and the bracket allow.
    fn inside(&self, proposal: f64) -> f64 {
        self.inside_bracket(proposal.max(self.range.0).min(self.range.1))
    }

    fn is_bracketed(&self) -> bool {
        self.positive.is_some() && self.negative.is_some()
    }

    fn inside_bracket(&self, proposal: f64) -> f64 {
        let (Some(a), Some(b)) = (self.positive, self.negative) else {
            return proposal;
        };
        let (low, high) = if a < b { (a, b) } else { (b, a) };
        let slow = self.trials > SLOW_SEARCH && self.trials.is_multiple_of(2);
        if proposal > low && proposal < high && !slow {
            proposal
        } else {
            0.5 * (low + high)
        }
    }
}

#[cfg(test)]
mod implicit_tests {
    use std::cell::Cell;
    use std::convert::Infallible;

    use super::*;
    use crate::system::force::FunctionForce;
    use crate::{simulate_theta_gamma, Grid, LinearForce, Silent, ThetaGamma};
    use zivi_core::{cosine, Restitution};

    const FORCE: LinearForce = LinearForce {
        stiffness: 2.0,
        damping: 0.3,
        gravity: 1.0,
        amplitude: 1.7,
        omega: 2.1,
        phase: 0.4,
    };

    /// Counts the evaluations of the excitation and of the force.
    struct Counting<'a>(&'a Cell<[u64; 2]>);

    impl Force<Infallible> for Counting<'_> {
        fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, Infallible> {
            FORCE.clone().at(t, x, xdot)
        }

        fn excitation(&self, t: f64) -> Option<f64> {
            let [waves, forces] = self.0.get();
            self.0.set([waves + 1, forces]);
            Force::<Infallible>::excitation(&FORCE, t)
        }

        fn excited(
            &mut self,
            excitation: f64,
            t: f64,
            x: f64,
            xdot: f64,
        ) -> Result<f64, Infallible> {
            let [waves, forces] = self.0.get();
            self.0.set([waves, forces + 1]);
            FORCE.clone().excited(excitation, t, x, xdot)
        }
    }

    #[test]
    fn a_step_asks_for_the_excitation_once_and_moves_as_without_it() {
        for theta in [1.0, 0.5] {
            let method = ThetaGamma { theta, ..ThetaGamma::default() };
            let grid = Grid::new(0.0, 5.0, 1e-2).unwrap();
            let ball = Physical { x: 1.0, xdot: 0.0 };
            let law = Restitution::from_e(0.5).unwrap();
            let counts = Cell::new([0; 2]);
            let kept = &mut Counting(&counts);
            let kept = simulate_theta_gamma(method, law, kept, grid, ball, &mut Silent).unwrap();
            let LinearForce { stiffness, damping, gravity, amplitude, omega, phase } = FORCE;
            let mut whole = FunctionForce(|t: f64, x: f64, xdot: f64| {
                let excitation = amplitude * cosine::cos(omega * t + phase);
                Ok::<_, Infallible>(-stiffness * x - damping * xdot - gravity + excitation)
            });
            let whole = simulate_theta_gamma(method, law, &mut whole, grid, ball, &mut Silent);
            let whole = whole.unwrap();
            assert!(whole.trajectory.events.impacts.len() > 2);
            assert_eq!(kept.trajectory.columns, whole.trajectory.columns);
            assert_eq!(kept.trajectory.nfev, whole.trajectory.nfev);
            let [waves, forces] = counts.get();
            assert_eq!(waves, 500);
            // all but that of the start, which is at another time
            assert_eq!(forces + 1, kept.trajectory.nfev);
        }
    }
}

#[cfg(test)]
mod opening_tests {
    use super::{DEFAULT_SLOPE, *};

    /// The trials of a search for the root of `mismatch`, up to 20.
    fn trials(mut search: SignSearch, mismatch: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut trials = Vec::new();
        while let Some(trial) = search.trial() {
            trials.push(trial);
            search.learn(mismatch(trial));
        }
        trials
    }

    #[test]
    fn a_search_goes_on_where_the_opening_ends() {
        let laws: [fn(f64) -> f64; 5] = [
            |f| 3.0 - 1.5 * f,
            |f| (-f).exp() - f,
            |f| -100.0 * (f / 1e-3).tanh() - f + 10.0,
            |_| 0.0,
            |_| f64::NAN,
        ];
        for (number, law) in laws.into_iter().enumerate() {
            for slope in [DEFAULT_SLOPE, -1.5, 1e-12] {
                let mut shown = Vec::new();
                let mut opening = Opening::from(2.5, slope);
                let root: Result<Option<()>, ()> = opening.root(|trial| {
                    shown.push(trial);
                    Ok(Shown::Mismatch(law(trial)))
                });
                assert_eq!(root, Ok(None));
                let whole = trials(SignSearch::from(2.5, slope, 20), law);
                shown.extend(trials(opening.search(20), law));
                assert_eq!(shown, whole, "law {number}, slope {slope}");
            }
        }
    }
}

#[cfg(test)]
mod search_tests {
    use super::*;

    fn root(mismatch: impl Fn(f64) -> f64, mut search: SignSearch) -> (Option<f64>, usize) {
        while let Some(trial) = search.trial() {
            if mismatch(trial).abs() <= 1e-12 {
                return (Some(trial), search.trials());
            }
            search.learn(mismatch(trial));
        }
        (None, search.trials())
    }

    #[test]
    fn an_affine_mismatch_takes_three_trials_then_two_with_its_slope() {
        let mismatch = |f: f64| 3.0 - 1.5 * f;
        assert_eq!(root(mismatch, SignSearch::from(0.0, DEFAULT_SLOPE, 20)).1, 3);
        assert_eq!(root(mismatch, SignSearch::from(0.0, -1.5, 20)).1, 2);
    }

    #[test]
    fn a_stiff_and_a_steep_mismatch_are_found_by_bracketing() {
        for mismatch in [
            (|f: f64| (-1e6 * f).min(1e9) - f + 3.0) as fn(f64) -> f64,
            |f| -1e3 * f * f * f - f - 7.0,
            |f| -100.0 * (f / 1e-3).tanh() - f + 10.0,
        ] {
            assert!(root(mismatch, SignSearch::from(50.0, DEFAULT_SLOPE, 200)).0.is_some());
        }
    }

    #[test]
    fn it_ends_when_there_is_no_root() {
        let jump = |f: f64| if f < 1.0 { 2.0 } else { -2.0 };
        assert_eq!(root(jump, SignSearch::from(0.0, DEFAULT_SLOPE, 1000)).0, None);
        let away = |f: f64| 1.0 + f * f;
        let (found, trials) = root(away, SignSearch::from(0.0, DEFAULT_SLOPE, 1000));
        assert!(found.is_none() && trials <= 1001);
    }

    #[test]
    fn it_never_leaves_its_range() {
        let mut search = SignSearch::within((1.0, 2.0), 5.0, 20);
        while let Some(trial) = search.trial() {
            assert!((1.0..=2.0).contains(&trial));
            search.learn(10.0 - trial); // the root lies outside
        }
        assert!(search.trials() < 20);
    }
}
