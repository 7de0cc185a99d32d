//! Slip in two directions: graded steps near its end, an implicit step where it starts or is slow.
//!
//! Near the end the direction converges like a power of the time that is left:
//!
//! ```text
//! rho = |W|    rho' = d . W' = -alpha    rho theta' = d_perp . W'    tau = rho/alpha
//! h <= 0.8 tau near the end      h <= 3 rho/b, b the deceleration by friction          (1)
//! ```
//!
//! Steps of one length would meet the singular end with an error of their own size. Those of (1) shrink with
//! the slip, and the last keeps the direction, once what that could still turn is below the tolerance.

use std::cmp::Ordering;

use crate::friction::{LocalContact, LocalSlip};
use crate::kinetics::mode::{Next, State};
use crate::motion::state::MechanicalState;
use crate::motion::{Flying, Slides, SmoothMotion, PART};
use crate::numeric::bernstein::Bernstein;
use crate::numeric::dense::largest;
use crate::numeric::elimination::Elimination;
use crate::numeric::stages::{factor, worse, Equation, Plan, RETREAT};
use crate::piecewise::flight::{StepDecision, SteppedFlight};
use crate::piecewise::steps::StepHistory;
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::system::dynamics::Dynamics;
use crate::Status;

/// A step near the end of a slip covers this part of the remaining time.
const GRADED: f64 = 0.8;
/// The end is near if the remaining time is shorter than a step by this factor.
const NEAR: f64 = 1.5;
/// The direction turns with the rate `b/rho`: explicit steps are at most this multiple of its inverse.
const STABLE: f64 = 3.0;
/// Implicit steps are cheaper than this number of explicit ones.
const STIFF: f64 = 8.0;
/// The last step is a little longer than the time that is left.
const LAST: f64 = 1.2;
/// Largest residual of a maintained direction, relative to the tolerance, and its floor.
const KEPT: (f64, f64) = (1e-2, 1e-13);
/// Relative tolerance from which on `max_step` limits the steps, not the error.
const UNCONTROLLED: f64 = 1e-1;
/// This number of last steps of a slip shrink with the remaining time.
const AHEAD_OF_END: f64 = 4.0;

impl SmoothMotion {
    /// A slip speed that is below the tolerance for these velocities.
    pub(super) fn kept(&self, velocities: &[f64]) -> f64 {
        let limits = self.steps.limits();
        let controlled = limits.adaptive && limits.tolerances.rtol < UNCONTROLLED;
        let part = if controlled { KEPT.0 * limits.tolerances.rtol } else { 0.0 };
        part.max(KEPT.1) * (1.0 + largest(velocities))
    }

    /// Near the end of a slip the error of a step depends on its part of the time left: steps shrink in proportion.
    fn expect_end(&mut self, plan: &mut Plan, state: &MechanicalState) {
        let first = state.layout().n + state.layout().m;
        let left = |pair: [usize; 2]| {
            let [x, y] = pair.map(|channel| state.now().xdot[first + channel]);
            let [a, b] = pair.map(|channel| state.slope()[first + channel]);
            let slows = -(x * a + y * b);
            if slows > 0.0 {
                (x * x + y * y) / slows
            } else {
                f64::INFINITY
            }
        };
        let cones = state.kinetics().cones(state.mode().slipping());
        let (before, now) = (self.slip_left, cones.map(left).fold(f64::INFINITY, f64::min));
        self.slip_left = now;
        let known = self.experience != StepHistory::NONE && self.steps.limits().adaptive;
        if known && now < before && now < AHEAD_OF_END * plan.h {
            // where the run ends before, the step is cut already
            plan.h = plan.h.min(plan.wanted * (now / before));
        }
    }

    /// How the slip goes on in the next step, whose length is limited by it.
    pub(super) fn slides(&mut self, plan: &mut Plan, state: &MechanicalState) -> Slides {
        let (layout, now, kinetics) = (state.layout(), state.now(), state.kinetics());
        let first = layout.n + layout.m;
        let kept = self.kept(&now.xdot[..layout.n]);
        self.expect_end(plan, state);
        let (mut stiff, mut ending, mut stopping) = (false, false, GapSet::EMPTY);
        let (mut longest, mut last) = (plan.h, f64::INFINITY);
        for pair in kinetics.cones(state.mode().slipping()) {
            let [x, y] = pair.map(|channel| now.xdot[first + channel]);
            let speed = x.hypot(y);
            if speed == 0.0 {
                return Slides::Stiff;
            }
            let [a, b] = pair.map(|channel| state.slope()[first + channel]);
            let (slows, turns) = (-(x * a + y * b) / speed, (x * b - y * a) / speed);
            let left = if slows > 0.0 { speed / slows } else { f64::INFINITY };
            // also what is left of a slip that ends with another
            let is_straight = turns.abs() * left <= kept || slows > 0.0 && speed <= kept;
            if is_straight && left <= NEAR * plan.h {
                stopping = stopping.with(pair.into_iter().collect());
                last = last.min(LAST * left);
                continue;
            }
            if GRADED * left < NEAR * plan.h {
                ending = true;
                longest = longest.min(GRADED * left);
            }
            let stable = STABLE * speed / state.deceleration(pair);
            stiff |= stable < plan.h / STIFF && GRADED * left >= NEAR * plan.h;
            longest = longest.min(stable);
        }
        if stiff && !ending && stopping.is_empty() {
            return Slides::Stiff;
        }
        // slips that go on may need a shorter step than that to the stop
        if !stopping.is_empty() && (longest >= last / LAST || longest >= plan.h) {
            plan.h = longest.min(last);
            return Slides::Stopping(stopping);
        }
        plan.h = longest.min(GRADED * last / LAST);
        Slides::Turning
    }
}

impl<D> Flying<'_, '_, D> {
    /// From here on the directions of slip in these channels stay as they are.
    pub(super) fn freeze(&mut self, channels: GapSet) {
        let (kinetics, now) = self.state.parts();
        kinetics.freeze(GapSet::EMPTY);
        kinetics.turn(&now.xdot[kinetics.coordinates()..]);
        kinetics.freeze(channels);
        let headings = kinetics.headings();
        self.motion.aside.take_headings(headings);
        self.motion.aside.freeze(channels);
    }

    /// The slip along the direction that is kept over the last step, which is complete.
    pub(super) fn frozen_slip(&self, pair: [usize; 2]) -> Bernstein {
        let first = self.state.layout().n + self.state.kinetics().row(0);
        let [x, y] = pair.map(|channel| {
            let [_, slip] = self.motion.last().polynomials_of(first + channel);
            slip.times(self.state.kinetics().headings()[channel])
        });
        x.sum(&y)
    }

    /// The slip in a channel at the end of the last step, in a cone along its direction, and its rate.
    pub(super) fn slip_at_end(&self, channel: usize) -> [f64; 2] {
        let (kinetics, last) = (self.state.kinetics(), self.motion.last());
        let first = self.state.layout().n + kinetics.row(0);
        let of = |channel: usize| [last.end.xdot[first + channel], last.end_slope(first + channel)];
        let Some(other) = kinetics.other_of(channel) else { return of(channel) };
        let ([w, a], [v, b]) = (of(channel), of(other));
        let [c, s] = [channel, other].map(|channel| kinetics.headings()[channel]);
        [c * w + s * v, c * a + s * b]
    }

    /// Whether a slip whose direction is kept ends in the step, or the run before; if not they turn again.
    pub(super) fn frozen_slip_stops<E>(&mut self) -> Result<bool, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let frozen = self.state.kinetics().frozen();
        if frozen.is_empty() || self.motion.steps.reaches(self.t_end) {
            return Ok(true);
        }
        self.complete()?;
        let kinetics = self.state.kinetics();
        let stops = |pair: [usize; 2]| self.frozen_slip(pair).first_negative().is_some();
        if kinetics.cones(frozen).any(stops) {
            return Ok(true);
        }
        self.freeze(GapSet::EMPTY);
        Ok(false)
    }
}

// The start of a slip in two directions, and slow slip, by an implicit step.
//
// The direction of a slip turns with the rate `mu lambda D/|W|`, without a bound where the slip begins. A step of
// collocation at Radau's points (E. Hairer and G. Wanner, *Solving Ordinary Differential Equations II*, section
// IV.5) is stable for any length. Newton's method solves for the slips at the stages,
//
// ```text
// W_i = w_0 + h sum_j A_ij w'(W_j)      dw'/dW = -mu lambda G (I - d d^T)/|W|                 (1)
// ```
//
// with the accelerations `G` by forces along the tangents, while all that is closed stays so, of several contacts for
// all of them together; all else follows by repetition.

/// Radau's points, and the integrals from the start to them of the polynomials that are one at one of them.
const STAGES: usize = 5;
const NODES: [f64; STAGES] = [
    0.057_104_196_114_517_68,
    0.276_843_013_638_123_8,
    0.583_590_432_368_916_8,
    0.860_240_135_656_219_4,
    1.0,
];
const WEIGHTS: [[f64; STAGES]; STAGES] = [
    [
        0.072_998_864_317_903_32,
        -0.026_735_331_107_945_572,
        0.018_676_929_763_984_354,
        -0.012_879_106_093_306_44,
        0.005_042_839_233_882_015,
    ],
    [
        0.153_775_231_479_182_47,
        0.146_214_867_847_493_51,
        -0.036_444_568_905_128_09,
        0.021_233_063_119_304_72,
        -0.007_935_579_902_728_778,
    ],
    [
        0.140_063_045_684_809_87,
        0.298_967_129_491_283_5,
        0.167_585_070_135_248_96,
        -0.033_969_101_686_617_74,
        0.010_944_288_744_192_252,
    ],
    [
        0.144_894_308_109_534_76,
        0.276_500_068_760_159_23,
        0.325_797_922_910_421_03,
        0.128_756_753_254_909_76,
        -0.015_708_917_378_805_328,
    ],
    [
        0.143_713_560_791_225_94,
        0.281_356_015_149_462_06,
        0.311_826_522_975_741_25,
        0.223_103_901_083_570_74,
        0.04,
    ],
];
/// Where the polynomials are compared with the equation of motion.
const BETWEEN: f64 = 0.43;
/// Most repetitions, and those with the direction from the start.
const REPEATED: usize = 25;
const STRAIGHT: usize = 2;
/// Changes below this part of the tolerances end them, or below this part of the largest velocity.
const SETTLED: f64 = 1e-3;
const ROUNDING: f64 = 8.0 * f64::EPSILON;
/// The first step, relative to the time in which the slip would become as fast as its direction turns.
const NATURAL: f64 = 0.1;
/// How far ahead accelerations are compared to find that time, relative to the step.
const AHEAD: f64 = 1e-3;
/// Explicit steps are used for up to this number of shortest steps before an event.
const BRIEF: f64 = 16.0;
/// The error of a step is of this order.
const ORDER: f64 = 6.0;
/// Pivots below this are zero.
const SINGULAR: f64 = 1e-14;

/// States and accelerations at the stages.
struct Collocated {
    x: Vec<Vec<f64>>,
    v: Vec<Vec<f64>>,
    k: Vec<Vec<f64>>,
    /// Velocities of the latest evaluation, and the correction of the slips by Newton's method.
    kept: Vec<Vec<f64>>,
    corrected: f64,
}

/// Part of a slipping contact in Newton's matrix: channels, mobility, and for each stage the normal force and the
/// accelerations of all slips by unit forces along the two tangents.
struct Slipping {
    pair: [usize; 2],
    gap: usize,
    local: LocalContact,
    lambda: [f64; STAGES],
    response: [Vec<f64>; STAGES],
}

impl Slipping {
    /// The direction in which a slip would begin with the forces at a stage, where the rates are those of a slip in
    /// the direction `d`.
    fn begins(&self, stage: usize, d: [f64; 2], rates: [f64; 2]) -> Option<[f64; 2]> {
        let (lambda, of, mu) = (self.lambda[stage], &self.local.d, self.local.mu);
        let free = |i: usize| {
            rates[i] - lambda * (of[i + 1][0] - mu * (of[i + 1][1] * d[0] + of[i + 1][2] * d[1]))
        };
        let b = [-lambda * self.local.k(d), free(0), free(1)];
        let far = |it: &LocalSlip| (it.heading[0] - d[0]).hypot(it.heading[1] - d[1]);
        let slips = LocalContact { b, ..self.local }.slips();
        let nearest = slips.iter().min_by(|one, other| far(one).total_cmp(&far(other)))?;
        Some(nearest.heading)
    }

    /// How the accelerations of all slips change with the slip of this contact, which is `w` at a stage: the columns
    /// one after the other.
    fn slope(&self, stage: usize, [x, y]: [f64; 2]) -> Vec<f64> {
        let speed = x.hypot(y);
        let d = [x / speed, y / speed];
        let pull = self.local.mu * self.lambda[stage];
        let response = &self.response[stage];
        let rows = response.len() / 2;
        let across = |j: usize, l: usize| (f64::from(u8::from(j == l)) - d[j] * d[l]) / speed;
        let entry = |l: usize, i: usize| -> f64 {
            (0..2).map(|j| -pull * response[j * rows + i] * across(j, l)).sum()
        };
        (0..2).flat_map(|l| (0..rows).map(move |i| (l, i))).map(|(l, i)| entry(l, i)).collect()
    }
}

impl<D> Flying<'_, '_, D> {
    /// A step of collocation without an event in it.
    pub(super) fn collocate<E>(&mut self, plan: Plan, shortest: f64) -> Result<Next, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let mut h = self.first_length(plan)?;
        let headings = self.state.kinetics().headings().to_vec();
        loop {
            self.motion.steps.spend()?;
            self.state.parts().0.take_headings(&headings);
            let (error, why) = match self.try_collocation(h) {
                Ok(Some(error)) => (error, Status::StepSizeTooSmall),
                Ok(None) => (f64::INFINITY, Status::StepSizeTooSmall),
                Err(Failure::Status(why))
                    if <Self as SteppedFlight<Vec<f64>, E>>::is_curable(why) =>
                {
                    (f64::INFINITY, why)
                }
                Err(failure) => return Err(failure),
            };
            let growth = match error.is_finite() {
                true => factor(error, ORDER).clamp(0.2, 5.0),
                false => RETREAT,
            };
            let by = if error <= 1.0 || !self.motion.steps.limits().adaptive && error.is_finite() {
                match self.search(growth)? {
                    StepDecision::Take(growth) => {
                        self.motion.steps.set_next(Some(h * growth.max(1.0)));
                        return self.take();
                    }
                    StepDecision::Stop(theta, _) => {
                        let by = 0.9 * theta.min(0.5);
                        if by * h <= BRIEF * shortest {
                            // an event so near is met before the direction turns
                            self.state.parts().0.take_headings(&headings);
                            return self.fly(Plan { h, ..plan }, shortest);
                        }
                        by
                    }
                    StepDecision::Shorten(by, _) => by,
                }
            } else {
                growth.min(0.7)
            };
            h *= by;
            if h <= shortest {
                return Err(Failure::Status(why));
            }
        }
    }

    /// The length of the first step to try: of a slip that begins part of the time in which its direction turns.
    fn first_length<E>(&mut self, plan: Plan) -> Result<f64, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let (n, released) = (self.state.layout().n, self.state.released());
        let m = self.state.layout().m;
        let begun: Vec<[usize; 2]> = self.state.kinetics().cones(released).collect();
        if begun.is_empty() || !self.motion.steps.limits().adaptive {
            return Ok(plan.h);
        }
        let longest = (self.t_end - self.state.now().t).min(plan.h / PART);
        let ahead = AHEAD * longest;
        let mut at = self.state.now().clone();
        for c in 0..at.x.len() {
            at.x[c] += ahead * at.xdot[c];
            at.xdot[c] += ahead * self.state.slope()[c];
        }
        at.t += ahead;
        let slope = self.state.slope().clone();
        self.freeze(self.state.mode().slipping());
        let mut later = slope.clone();
        let (_, _, mut equation) = self.state.equation(self.model, &mut self.motion.at_end);
        let evaluated = equation.acceleration(&at, &mut later);
        self.freeze(GapSet::EMPTY);
        evaluated?;
        let mut h = longest;
        for pair in begun {
            let change =
                pair.map(|channel| (later[n + m + channel] - slope[n + m + channel]) / ahead);
            let grows = change[0].hypot(change[1]);
            if grows > 0.0 {
                h = h.min(NATURAL * self.state.deceleration(pair) / grows);
            }
        }
        Ok(h)
    }

    /// The step of collocation of length `h`, with its error relative to the tolerances; none where it is not
    /// found.
    fn try_collocation<E>(&mut self, h: f64) -> Result<Option<f64>, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let (from, slope) = (self.state.now().clone(), self.state.slope().clone());
        let mode = self.state.mode();
        let pairs: Vec<[usize; 2]> = self.state.kinetics().cones(mode.slipping()).collect();
        let frozen: GapSet = pairs.iter().flatten().copied().collect();
        let mut at = Collocated::new(&from, &slope);
        let mut contacts: Vec<Slipping> = Vec::new();
        let headings = self.state.kinetics().headings().to_vec();
        let mut settled = false;
        for sweep in 0..REPEATED {
            let change = at.integrate(&from, h);
            match sweep.cmp(&STRAIGHT) {
                Ordering::Less => (),
                Ordering::Equal => at.aim(&from, &contacts, &headings, self.first_slip()),
                Ordering::Greater => at.correct(h, &contacts, self.first_slip()),
            }
            let change = change.max(at.corrected);
            settled = sweep > STRAIGHT && change <= self.settled(&at);
            self.freeze(if sweep < STRAIGHT { frozen } else { GapSet::EMPTY });
            let found = self.evaluate_stages((&from, h), &mut at, &mut contacts);
            self.freeze(GapSet::EMPTY);
            found?;
            if contacts.is_empty() {
                match self.slipping_contacts(mode, &pairs) {
                    Some(found) => contacts = found,
                    None => return Ok(None),
                }
            }
            if settled || !change.is_finite() {
                break;
            }
        }
        if !settled {
            return Ok(None);
        }
        let mut end = from.clone();
        end.pass(h);
        end.x.copy_from_slice(&at.x[STAGES - 1]);
        end.xdot.copy_from_slice(&at.v[STAGES - 1]);
        let curves = at.curves(&from, h);
        let last = self.motion.steps.last_mut();
        last.take_curves((&from, &slope), h, (&end, &at.k[STAGES - 1]), curves);
        let mut along = self.along();
        let rows = along.rows(along.aside.coordinates() + along.aside.layout.rows());
        Ok(Some(along.defect(&rows, BETWEEN)?))
    }

    /// The place of the first slip in a state.
    fn first_slip(&self) -> usize {
        self.state.layout().n + self.state.layout().m
    }

    /// Changes of the velocities that are none.
    fn settled(&self, at: &Collocated) -> f64 {
        let tolerances = &self.motion.steps.limits().tolerances;
        let last = &at.v[STAGES - 1];
        let fastest = last.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let part = if self.motion.steps.limits().adaptive { SETTLED } else { 0.0 };
        (part * tolerances.atol[1]).max(ROUNDING * fastest)
    }

    /// Evaluates the accelerations at all stages, and the forces of the contacts that slip.
    fn evaluate_stages<E>(
        &mut self,
        (from, h): (&State, f64),
        at: &mut Collocated,
        contacts: &mut [Slipping],
    ) -> Result<(), Failure<E>>
    where
        D: Dynamics<E>,
    {
        let at_end = &mut self.motion.at_end;
        let (_, _, mut equation) = self.state.equation(self.model, at_end);
        for (stage, node) in NODES.into_iter().enumerate() {
            let mut there = from.clone();
            there.pass(node * h);
            there.x.copy_from_slice(&at.x[stage]);
            there.xdot.copy_from_slice(&at.v[stage]);
            equation.acceleration(&there, &mut at.k[stage])?;
            let pairs: Vec<[usize; 2]> = contacts.iter().map(|it| it.pair).collect();
            for contact in contacts.iter_mut() {
                let kinetics = &mut *equation.kinetics;
                contact.lambda[stage] = kinetics.lambda[contact.gap];
                contact.response[stage] =
                    kinetics.slip_response(equation.mode, contact.pair, &pairs)?;
            }
            if stage + 1 == STAGES {
                equation.is_at_end(&there);
            }
        }
        Ok(())
    }

    /// The contacts that slip, with their mobilities while all else is as in the mode.
    fn slipping_contacts(
        &mut self,
        mode: ContactMode,
        pairs: &[[usize; 2]],
    ) -> Option<Vec<Slipping>> {
        let (kinetics, _) = self.state.parts();
        let contact = |&pair: &[usize; 2]| {
            let gap = kinetics.gap_of(pair[0])?;
            let closed = mode.closed.without(GapSet::of(gap));
            let without = |mode: ContactMode, channel: usize| mode.without_channel(channel);
            let rest = pair.into_iter().fold(ContactMode { closed, ..mode }, without);
            let lambda = [kinetics.lambda[gap]; STAGES];
            let local = kinetics.local_contact(rest, (gap, pair), [0.0; 3])?;
            let response = kinetics.slip_response(mode, pair, pairs).ok()?;
            let response = [(); STAGES].map(|()| response.clone());
            Some(Slipping { pair, gap, local, lambda, response })
        };
        pairs.iter().map(contact).collect()
    }
}

impl Collocated {
    fn new(from: &State, slope: &[f64]) -> Self {
        Self {
            x: vec![from.x.clone(); STAGES],
            v: vec![from.xdot.clone(); STAGES],
            k: vec![slope.to_vec(); STAGES],
            kept: Vec::new(),
            corrected: 0.0,
        }
    }

    /// Velocities and positions at the stages by the accelerations there: by how much the velocities change.
    fn integrate(&mut self, from: &State, h: f64) -> f64 {
        self.kept.clone_from(&self.v);
        let mut change = 0.0_f64;
        let sum = |of: &[Vec<f64>], stage: usize, c: usize| -> f64 {
            (0..STAGES).map(|j| WEIGHTS[stage][j] * of[j][c]).sum()
        };
        for stage in 0..STAGES {
            for c in 0..from.x.len() {
                let v = from.xdot[c] + h * sum(&self.k, stage, c);
                change = worse(change, (v - self.v[stage][c]).abs());
                self.v[stage][c] = v;
            }
        }
        for stage in 0..STAGES {
            for c in 0..from.x.len() {
                self.x[stage][c] = from.x[c] + h * sum(&self.v, stage, c);
            }
        }
        self.corrected = 0.0;
        change
    }

    /// Turns the slips that begin to the directions in which they would begin at the stages, by the accelerations in
    /// that from the start.
    fn aim(&mut self, from: &State, contacts: &[Slipping], headings: &[f64], first: usize) {
        for contact in contacts {
            let at = contact.pair.map(|channel| first + channel);
            let d = contact.pair.map(|channel| headings[channel]);
            for stage in 0..STAGES {
                let [x, y] = at.map(|c| self.v[stage][c]);
                let [x0, y0] = at.map(|c| from.xdot[c]);
                // a contact that slipped already keeps its direction
                if x0.hypot(y0) > (x - x0).hypot(y - y0) {
                    continue;
                }
                let speed = d[0] * x + d[1] * y;
                let rates = at.map(|c| self.k[stage][c]);
                let begun = contact.begins(stage, d, rates);
                if let Some(heading) = begun.filter(|_| speed > 0.0) {
                    self.v[stage][at[0]] = speed * heading[0];
                    self.v[stage][at[1]] = speed * heading[1];
                }
            }
        }
    }

    /// A step of Newton's method (1) for the slips from those for which the accelerations were evaluated.
    fn correct(&mut self, h: f64, contacts: &[Slipping], first: usize) {
        let channels: Vec<usize> =
            contacts.iter().flat_map(|it| it.pair.map(|channel| first + channel)).collect();
        let s = channels.len();
        let size = s * STAGES;
        let mut matrix = vec![0.0; size * size];
        let mut left = vec![0.0; size];
        for i in 0..STAGES {
            for (a, &c) in channels.iter().enumerate() {
                left[s * i + a] = self.v[i][c] - self.kept[i][c];
                matrix[(s * i + a) * size + s * i + a] = 1.0;
            }
        }
        for (number, contact) in contacts.iter().enumerate() {
            let at = contact.pair.map(|channel| first + channel);
            for j in 0..STAGES {
                let slope = contact.slope(j, at.map(|c| self.kept[j][c]));
                for i in 0..STAGES {
                    for (l, column) in slope.chunks_exact(s).enumerate() {
                        for (a, slope) in column.iter().enumerate() {
                            matrix[(s * i + a) * size + s * j + 2 * number + l] -=
                                h * WEIGHTS[i][j] * slope;
                        }
                    }
                }
            }
        }
        let moved = Elimination::new(matrix, size, SINGULAR).solve(&left);
        for i in 0..STAGES {
            for (a, &c) in channels.iter().enumerate() {
                self.v[i][c] = self.kept[i][c] + moved[s * i + a];
                self.corrected = worse(self.corrected, moved[s * i + a].abs());
            }
        }
    }

    /// The polynomials of position and velocity through start and stages.
    fn curves(&self, from: &State, h: f64) -> Vec<[Bernstein; 2]> {
        let curve = |c: usize| {
            let (x, v) = (from.x[c], from.xdot[c]);
            let [mut places, mut rates] = [vec![x], vec![v]];
            for stage in 0..STAGES {
                places.push(self.x[stage][c]);
                rates.push(self.v[stage][c]);
            }
            let [x1, v1] = [places[STAGES], rates[STAGES]];
            let of_x = through(&places, Some(h * v)).with_ends(x, x1);
            [of_x, through(&rates, None).with_ends(v, v1)]
        };
        (0..from.x.len()).map(curve).collect()
    }
}

/// The polynomial of one degree more than there are stages through values at the start and the stages, with a slope
/// at the start if that is given.
fn through(values: &[f64], slope: Option<f64>) -> Bernstein {
    let mut nodes = vec![0.0];
    nodes.extend(NODES);
    let mut d = values.to_vec();
    if let Some(slope) = slope {
        nodes.insert(0, 0.0);
        d.insert(0, values[0]);
        let count = d.len();
        for i in (1..count).rev() {
            d[i] = if i == 1 { slope } else { (d[i] - d[i - 1]) / (nodes[i] - nodes[i - 1]) };
        }
        for level in 2..count {
            for i in (level..count).rev() {
                d[i] = (d[i] - d[i - 1]) / (nodes[i] - nodes[i - level]);
            }
        }
    } else {
        for level in 1..d.len() {
            for i in (level..d.len()).rev() {
                d[i] = (d[i] - d[i - 1]) / (nodes[i] - nodes[i - level]);
            }
        }
        d.push(0.0);
    }
    let last = d.len() - 1;
    let mut p = Bernstein::new(&[d[last]]);
    for i in (0..last).rev() {
        p = p.times_root(nodes[i]).plus(d[i]);
    }
    p
}
