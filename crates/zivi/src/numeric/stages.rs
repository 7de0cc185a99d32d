//! Steps of embedded pairs: stages, error norm, step-size control.
//!
//! One step of an embedded pair on `x'' = a(t, x, x')`, for one coordinate or for several.
//!
//! With `y = (x, x')` the stages are velocities `V_i` and accelerations `k_i`:
//!
//! ```text
//! X_i = x + h sum_j a_ij V_j     V_i = x' + h sum_j a_ij k_j     k_i = a(t + c_i h, X_i, V_i)
//! ```
//!
//! The effect of a uniform acceleration is known exactly, and the sums run over the deviation from
//! it, `k_j - k_0` and `V_j - x' - c_j h k_0`: with rounded coefficients up to 50 all flights of a
//! ball would be wrong by the same part of `1e-14`, which long accumulations add up.
//!
//! Only `a` is evaluated, and it is evaluated where the stages are: in a step that ends in an
//! impact they may lie slightly past it.

use crate::numeric::bernstein::Bernstein;
use crate::numeric::coordinates::{Coordinates, Row, State};
use crate::numeric::dense;
use crate::numeric::root::touchdown;
use crate::numeric::tableau::{ErrorEstimate, Interpolant, Pair, Weights};

/// The equation `x'' = a(t, x, x')`, with an error `X` if `a` is undefined.
pub(crate) trait Equation<Q, X> {
    /// Writes `a` at a state.
    fn acceleration(&mut self, at: &State<Q>, into: &mut Q) -> Result<(), X>;

    /// Called after the evaluation of `a` at the end of a step.
    fn is_at_end(&mut self, _at: &State<Q>) {}

    /// Whether `a` is known not to depend on time: no pulse of it can hide between two looks.
    fn is_autonomous(&self) -> bool {
        false
    }

    /// Whether states are projected after each step: [`Self::project_errors`] is called then.
    fn has_projection(&self) -> bool {
        false
    }

    /// Takes out of the estimated errors of a step, by coordinate, what the projection removes.
    fn project_errors(&self, _errors: &mut [StepError]) {}
}

impl<Q, X, A: Equation<Q, X>> Equation<Q, X> for &mut A {
    #[inline(always)]
    fn acceleration(&mut self, at: &State<Q>, into: &mut Q) -> Result<(), X> {
        (**self).acceleration(at, into)
    }

    #[inline(always)]
    fn is_at_end(&mut self, at: &State<Q>) {
        (**self).is_at_end(at);
    }

    fn is_autonomous(&self) -> bool {
        (**self).is_autonomous()
    }

    #[inline(always)]
    fn has_projection(&self) -> bool {
        (**self).has_projection()
    }

    fn project_errors(&self, errors: &mut [StepError]) {
        (**self).project_errors(errors);
    }
}

/// The last step that was computed: its stages and both of its ends.
#[derive(Clone, Debug)]
pub(crate) struct Stages<Q: Coordinates> {
    pub(crate) pair: &'static Pair,
    pub(crate) from: State<Q>,
    pub(crate) h: f64,
    pub(crate) end: State<Q>,
    /// The accelerations at the start.
    slope: Q,
    /// Deviations of the stages.
    rows: Q::Rows,
    /// The accelerations at the end of the step, once it is finished.
    last: Q,
    /// Stages known: those of the step, the one at its end, further ones.
    known: usize,
    /// Memory for the stage that is computed: state and accelerations.
    work: [Q; 3],
    /// The polynomials of position and velocity by coordinate, of a step of another method.
    curves: Vec<[Bernstein; 2]>,
}

impl<Q: Coordinates> Stages<Q> {
    /// For a number of coordinates.
    pub(crate) fn new(pair: &'static Pair, count: usize) -> Self {
        let zeros = State::zeros(count);
        Self {
            pair,
            from: zeros.clone(),
            h: 0.0,
            end: zeros.clone(),
            slope: Q::zeros(count),
            rows: Q::rows(count),
            last: Q::zeros(count),
            known: 0,
            work: std::array::from_fn(|_| Q::zeros(count)),
            curves: Vec::new(),
        }
    }

    /// Takes the step of another method: from where and with which accelerations, its length, its end with the
    /// accelerations there, and the polynomials between.
    pub(crate) fn take_curves(
        &mut self,
        (from, slope): (&State<Q>, &Q),
        h: f64,
        (end, last): (&State<Q>, &Q),
        curves: Vec<[Bernstein; 2]>,
    ) {
        self.from.copy_from(from);
        self.end.copy_from(end);
        self.slope.clone_from(slope);
        self.last.clone_from(last);
        self.rows.as_mut().fill(Row::default());
        (self.h, self.known, self.curves) = (h, self.pair.c.len(), curves);
    }

    /// `q` in the local error: a step of length `h` has one of order `h^q`.
    pub(crate) fn order_of_error(&self) -> f64 {
        self.pair.q
    }

    /// The step of length `h` from `from`, where the accelerations are `slope`.
    #[inline]
    pub(crate) fn step<X>(
        &mut self,
        from: &State<Q>,
        slope: &Q,
        h: f64,
        equation: &mut impl Equation<Q, X>,
    ) -> Result<(), X> {
        self.from.copy_from(from);
        self.h = h;
        self.slope.clone_from(slope);
        self.known = 1;
        self.curves.clear();
        let pair = self.pair;
        for row in pair.a {
            self.stage(row, equation)?;
        }
        let Self { from, h, end, slope, rows, .. } = self;
        along(end, (from, slope), *h, rows, pair, (pair.b.len(), &pair.b));
        Ok(())
    }

    /// The state at the stage `i`, whose row of the tableau this is.
    pub(crate) fn node(&self, i: usize, row: &Weights) -> State<Q> {
        let (mut at, node) = (self.from.clone(), Node::new(self.pair, i, self.h));
        at.pass(self.pair.c[i] * self.h);
        let to = at.x.as_mut_slice().iter_mut().zip(at.xdot.as_mut_slice());
        for (c, (x, xdot)) in to.enumerate() {
            let start = [*x, *xdot, self.start_slope(c)];
            (*x, *xdot) = node.reach(start, row.sums(self.row(c)));
        }
        at
    }

    #[inline]
    fn stage<X>(&mut self, row: &Weights, equation: &mut impl Equation<Q, X>) -> Result<(), X> {
        let Self { pair, from, h, slope: start, rows, known, work, .. } = self;
        let [x, xdot, mut slope] = work.each_mut().map(Q::lend);
        let (mut at, i) = (State { t: from.t, late: from.late, x, xdot }, *known);
        along(&mut at, (from, start), *h, rows, pair, (i, row));
        let done = equation.acceleration(&at, &mut slope);
        if done.is_ok() {
            put(rows, i, start, &slope);
            *known = i + 1;
        }
        for (one, place) in [at.x, at.xdot, slope].into_iter().zip(work) {
            one.give_back(place);
        }
        match done {
            Ok(()) => Ok(()), // nothing of an error is copied
            failed => failed,
        }
    }

    /// Evaluates the accelerations at the end of the step, which is the next stage.
    #[inline]
    pub(crate) fn finish<X>(&mut self, equation: &mut impl Equation<Q, X>) -> Result<(), X> {
        let Self { pair, end, slope, rows, last, known, .. } = self;
        let i = pair.b.len();
        if *known == i {
            equation.acceleration(end, last)?;
            equation.is_at_end(end);
            put(rows, i, slope, last);
            *known = i + 1;
        }
        Ok(())
    }

    /// Computes the stages that the polynomials need.
    #[inline]
    pub(crate) fn complete<X>(&mut self, equation: &mut impl Equation<Q, X>) -> Result<(), X> {
        self.finish(equation)?;
        if let Interpolant::Nested { a, .. } = self.pair.interpolant {
            for row in &a[self.known - self.pair.b.len() - 1..] {
                self.stage(row, equation)?;
            }
        }
        Ok(())
    }

    /// Deviations of the stages in a coordinate.
    #[inline]
    fn row(&self, c: usize) -> &Row {
        &self.rows.as_ref()[c]
    }

    /// The acceleration of a coordinate at the start of the step.
    #[inline]
    pub(crate) fn start_slope(&self, c: usize) -> f64 {
        self.slope.as_slice()[c]
    }

    /// The acceleration of a coordinate at the end of the step, once it is finished.
    #[inline]
    pub(crate) fn end_slope(&self, c: usize) -> f64 {
        self.last.as_slice()[c]
    }

    /// The accelerations at the end of the step, if known.
    pub(crate) fn copy_end_slope(&self, slope: &mut Q) -> bool {
        slope.clone_from(&self.last);
        self.known > self.pair.b.len()
    }

    /// Whether the step ends in numbers.
    #[inline]
    pub(crate) fn is_finite(&self) -> bool {
        let finite = |of: &Q| of.as_slice().iter().all(|it| it.is_finite());
        finite(&self.end.x) && finite(&self.end.xdot)
    }

    /// Effect of rounding of the time on a coordinate and its rate, in units of `eps t (x', x'')`,
    /// in a longer step.
    #[inline]
    fn rounding(&self, c: usize, of_time: f64) -> [f64; 2] {
        let time = of_time * f64::EPSILON * self.from.t.abs();
        if self.h < 1e4 * time {
            return [0.0; 2];
        }
        let [from, end] = [&self.from, &self.end].map(|it| it.xdot.as_slice()[c].abs());
        let (start, stages) = (self.start_slope(c), &self.row(c)[1..self.pair.b.len()]);
        let pull = stages.iter().fold(start.abs(), |most, it| most.max((start + it.k).abs()));
        [time * from.max(end), time * pull]
    }

    /// The tolerances of a coordinate and its rate in the step, bounded below by rounding of the
    /// time.
    #[inline]
    pub(crate) fn scales(&self, c: usize, tolerances: &Tolerances) -> [f64; 2] {
        let [from, end] =
            [&self.from, &self.end].map(|it| (it.x.as_slice()[c], it.xdot.as_slice()[c]));
        let [scale_x, scale_xdot] = tolerances.scales(from, end);
        let [x, xdot] = self.rounding(c, tolerances.rounding);
        [scale_x + x, scale_xdot + xdot]
    }

    /// The estimated error of the step relative to the tolerances.
    #[inline]
    pub(crate) fn error<X>(
        &mut self,
        tolerances: &Tolerances,
        equation: &mut impl Equation<Q, X>,
    ) -> Result<f64, X> {
        if let ErrorEstimate::Single(_) = self.pair.estimate {
            self.finish(equation)?;
        }
        let all = 0..self.end.x.as_slice().len();
        if equation.has_projection() {
            let mut errors: Vec<StepError> = all.map(|c| self.error_of(c)).collect();
            let largest = |errors: &[StepError]| {
                let each = errors.iter().enumerate();
                let each = each.map(|(c, error)| error.norm(self.scales(c, tolerances)));
                each.reduce(worse).unwrap_or(0.0)
            };
            let whole = largest(&errors);
            equation.project_errors(&mut errors);
            return Ok(worse(PROJECTED * whole, largest(&errors)));
        }
        let each = all.map(|c| self.error_of(c).norm(self.scales(c, tolerances)));
        Ok(each.reduce(worse).unwrap_or(0.0))
    }

    /// The estimated error of a coordinate.
    #[inline]
    pub(crate) fn error_of(&self, c: usize) -> StepError {
        let (row, h) = (self.row(c), self.h);
        match self.pair.estimate {
            ErrorEstimate::Single(e) => {
                let (x, xdot) = e.sums(row);
                StepError { x: [h * h * x, 0.0], xdot: [h * xdot, 0.0], double: false }
            }
            ErrorEstimate::Double(e5, e3) => {
                let ((x5, v5), (x3, v3)) = (e5.sums(row), e3.sums(row));
                StepError { x: [h * h * x5, h * h * x3], xdot: [h * v5, h * v3], double: true }
            }
        }
    }

    /// Whether the velocities hardly change in the step: across a jump of the acceleration they
    /// change by no more than rounding of the time explains, at a pole by any amount.
    pub(crate) fn is_smooth_to_rounding(&self) -> bool {
        const HARDLY: f64 = 1e-3;
        let (from, end) = (self.from.xdot.as_slice(), self.end.xdot.as_slice());
        let change = from.iter().zip(end).fold(0.0_f64, |a, (v, w)| a.max((w - v).abs()));
        let speed = from.iter().chain(end).fold(0.0_f64, |a, v| a.max(v.abs()));
        change <= HARDLY * speed
    }

    /// Whether all stages and the end of a coordinate move away from zero, or are pushed away from
    /// it: so the whole step from there moves away. (Where the force grows like a high power of
    /// the time, the velocities of some stages are negative for every step size.)
    pub(crate) fn rises(&self, c: usize) -> bool {
        let [from, end] = [&self.from, &self.end].map(|it| it.x.as_slice()[c]);
        if end <= from || self.end.xdot.as_slice()[c] <= 0.0 {
            return false;
        }
        let (v, k, h) = (self.from.xdot.as_slice()[c], self.start_slope(c), self.h);
        let stages = self.pair.c.iter().zip(self.row(c)).take(self.pair.b.len());
        stages.clone().all(|(c, beyond)| v + h * (c * k + beyond.v) >= 0.0)
            || stages.map(|(_, beyond)| k + beyond.k).all(|k| k >= 0.0)
    }

    /// As [`dense::screen`], for a coordinate.
    #[inline]
    pub(crate) fn screen(&self, c: usize) -> Option<(Bernstein, f64)> {
        if !self.curves.is_empty() {
            return None;
        }
        let [from, end] =
            [&self.from, &self.end].map(|it| (it.x.as_slice()[c], it.xdot.as_slice()[c]));
        dense::screen(self.pair, self.h, (from, self.start_slope(c)), end, self.row(c))
    }

    /// Whether `a + b x + c x'` of a coordinate is surely positive in the step: the rate deviates
    /// from that of the cubic by half the deviation of the second derivatives (see
    /// [`dense::screen`]).
    pub(crate) fn is_surely_positive(&self, i: usize, [a, b, c]: [f64; 3]) -> bool {
        if !self.curves.is_empty() {
            return false;
        }
        let [from, end] =
            [&self.from, &self.end].map(|it| (it.x.as_slice()[i], it.xdot.as_slice()[i]));
        let start = (from, self.start_slope(i));
        let Some((x, worst)) = dense::near_cubic(self.pair, self.h, start, end, self.row(i)) else {
            return false;
        };
        let slack = worst * (0.125 * b.abs() + 0.5 * (c / self.h).abs());
        let p = x.derivative().times(c / self.h).sum(&x.times(b)).plus(a);
        p.coefficients().iter().all(|&it| it > slack)
    }

    /// The polynomials of a coordinate and of its rate over the step, once it is complete.
    #[inline]
    pub(crate) fn polynomials_of(&self, c: usize) -> [Bernstein; 2] {
        if let Some(curve) = self.curves.get(c) {
            return *curve;
        }
        let [from, end] =
            [&self.from, &self.end].map(|it| [it.x.as_slice()[c], it.xdot.as_slice()[c]]);
        dense::polynomials(self.pair, self.h, (from, self.start_slope(c)), end, self.row(c))
    }
}

/// Writes the accelerations of the stage `i`, those at the start being known.
#[inline]
fn put<Q: Coordinates>(rows: &mut Q::Rows, i: usize, start: &Q, slope: &Q) {
    let slopes = start.as_slice().iter().zip(slope.as_slice());
    for (row, (start, slope)) in rows.as_mut().iter_mut().zip(slopes) {
        row[i].k = slope - start;
    }
}

/// The state at the stage `i` with the row `a`, `at <- from + h sum_j a_j (V_j, k_j)`. Writes the
/// velocities of the stage.
#[inline(always)]
fn along<Q: Coordinates>(
    at: &mut State<Q>,
    (from, slope): (&State<Q>, &Q),
    h: f64,
    rows: &mut Q::Rows,
    pair: &Pair,
    (i, a): (usize, &Weights),
) {
    let node = Node::new(pair, i, h);
    (at.t, at.late) = (from.t, from.late);
    at.pass(pair.c[i] * h);
    let to = at.x.as_mut_slice().iter_mut().zip(at.xdot.as_mut_slice());
    let start = from.x.as_slice().iter().zip(from.xdot.as_slice()).zip(slope.as_slice());
    for (((x, xdot), ((x0, v0), k0)), row) in to.zip(start).zip(rows.as_mut()) {
        let beyond = a.sums(row);
        (*x, *xdot) = node.reach([*x0, *v0, *k0], beyond);
        row[i].v = beyond.1;
    }
}

/// A stage in a step of length `h`: how it is reached from the start.
#[derive(Clone, Copy)]
pub(crate) struct Node {
    h: f64,
    /// `c_i` and `sum_j a_ij c_j`.
    uniform: [f64; 2],
}

impl Node {
    #[inline]
    pub(crate) fn new(pair: &Pair, i: usize, h: f64) -> Self {
        Self { h, uniform: pair.uniform(i) }
    }

    /// Position and velocity, from the start and the sums over the stages.
    #[inline(always)]
    pub(crate) fn reach(&self, [x, v, k]: [f64; 3], (of_x, of_v): (f64, f64)) -> (f64, f64) {
        let Self { h, uniform: [c, fall] } = *self;
        (x + h * (c * v + h * (fall * k + of_x)), v + h * (c * k + of_v))
    }
}

// The error of a step, and its bound.

/// Tolerances of the local error of a step: `atol + rtol |y|`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Tolerances {
    pub(crate) rtol: f64,
    /// Of a coordinate and of its rate.
    pub(crate) atol: [f64; 2],
    /// Rounding of the time, in units of `eps t`, the lower limit of the tolerances.
    pub(crate) rounding: f64,
}

impl Tolerances {
    /// Those of a coordinate and its rate, with the larger of the values at both ends of a step.
    #[inline]
    pub(crate) fn scales(&self, one: (f64, f64), other: (f64, f64)) -> [f64; 2] {
        let [atol_x, atol_xdot] = self.atol;
        [
            atol_x + self.rtol * one.0.abs().max(other.0.abs()),
            atol_xdot + self.rtol * one.1.abs().max(other.1.abs()),
        ]
    }
}

/// Error of a coordinate and its rate in a step, before scaling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StepError {
    pub(crate) x: [f64; 2],
    pub(crate) xdot: [f64; 2],
    /// Whether there are two estimates, of orders 5 and 3.
    pub(crate) double: bool,
}

impl StepError {
    /// The larger of the two components, each by its scale.
    #[inline]
    pub(crate) fn norm(&self, [scale_x, scale_xdot]: [f64; 2]) -> f64 {
        let one = |[first, second]: [f64; 2], scale: f64| {
            let (first, second) = ((first / scale).abs(), second / scale);
            if !self.double || first == 0.0 {
                return first;
            }
            // of the orders 5 and 3, together of order 7: e5^2/sqrt(e5^2 + 0.01 e3^2)
            first * (first / first.hypot(0.1 * second))
        };
        worse(one(self.x, scale_x), one(self.xdot, scale_xdot))
    }
}

/// The larger of two errors; one that is not a number is the largest.
#[inline]
pub(crate) fn worse(one: f64, other: f64) -> f64 {
    // f64::max would drop NaN
    if one > other || one.is_nan() {
        one
    } else {
        other
    }
}

// Error control: how long a step may be.

/// The weight of errors that a projection removes: it must start near the manifold.
const PROJECTED: f64 = 0.05;

/// Factor that keeps the next step from being rejected.
pub(crate) const SAFETY: f64 = 0.9;
/// Smallest and largest factor between two steps.
pub(crate) const FACTORS: (f64, f64) = (0.2, 5.0);
/// Factor after a step that could not be judged.
pub(crate) const RETREAT: f64 = 0.25;

/// By which factor a step whose error is `error` could be longer, if that is of the order `h^q`.
#[inline]
pub(crate) fn factor(error: f64, q: f64) -> f64 {
    SAFETY * error.powf(-1.0 / q)
}

/// The factor for a step that is rejected, from [`factor`], which may be no number.
#[inline]
pub(crate) fn shorter(factor: f64) -> f64 {
    if factor > FACTORS.0 {
        factor.min(SAFETY)
    } else {
        FACTORS.0
    }
}

/// A step size, and the larger one proposed by the error control, if any.
#[derive(Clone, Copy)]
pub(crate) struct Plan {
    pub(crate) h: f64,
    pub(crate) wanted: f64,
}

impl Plan {
    /// The step of the wanted length, or up to the end where that is `left` away.
    pub(crate) fn up_to(left: f64, h: f64, wanted: f64) -> Self {
        // no sliver of a step is left for the end
        let h = if h >= left * (1.0 - 1e-12) { left } else { h };
        Self { h, wanted }
    }

    /// The step to try after one of length `h`, which may grow by the factor `growth`.
    pub(crate) fn next(self, h: f64, growth: f64) -> f64 {
        if h < self.h {
            h * growth.min(1.0)
        } else if h < self.wanted && growth >= 1.0 {
            // a step that something else cut short says nothing against a longer one
            (h * growth).max(self.wanted)
        } else {
            h * growth
        }
    }
}

/// A step so short that rounding is all that is left of it may have any error: the acceleration
/// jumps there. Not two of them in a row: that is a singularity.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Jump {
    /// Whether the step that is tried is that short.
    pub(crate) allowed: bool,
    /// Whether its error was too large.
    pub(crate) met: bool,
    /// Whether that of the last step was.
    met_before: bool,
}

impl Jump {
    /// That of the next step.
    pub(crate) fn next(self) -> Self {
        Self { met_before: self.met, ..Self::default() }
    }

    /// Whether the shortest step may be tried in spite of its error.
    pub(crate) fn may_be_allowed(self) -> bool {
        !(self.allowed || self.met_before)
    }
}

/// A step whose error should be near the tolerance, from the accelerations `slope` and their change
/// (E. Hairer, S. P. Norsett, G. Wanner, *Solving Ordinary Differential Equations I*, section
/// II.4); an acceleration ahead that cannot be had for a reason that is `harmless` does not count.
pub(crate) fn first_step<Q: Coordinates, X>(
    now: &State<Q>,
    slope: &Q,
    left: f64,
    (tolerances, q): (&Tolerances, f64),
    equation: &mut impl Equation<Q, X>,
    harmless: impl Fn(&X) -> bool,
) -> Result<f64, X> {
    let (x, xdot, slope) = (now.x.as_slice(), now.xdot.as_slice(), slope.as_slice());
    let norm = |of: &dyn Fn(usize) -> (f64, f64)| {
        (0..x.len()).fold(0.0_f64, |worst, c| {
            let at = (x[c], xdot[c]);
            let ([scale_x, scale_xdot], (x, xdot)) = (tolerances.scales(at, at), of(c));
            worst.max((x / scale_x).abs().max((xdot / scale_xdot).abs()))
        })
    };
    let (size, rate) = (norm(&|c| (x[c], xdot[c])), norm(&|c| (xdot[c], slope[c])));
    let known = size > 1e-5 && rate > 1e-5;
    let euler = if known { 1e-2 * size / rate } else { 1e-6 * left }.min(left);
    let mut ahead = now.clone();
    ahead.t = now.t + euler;
    for c in 0..x.len() {
        ahead.x.as_mut_slice()[c] += euler * xdot[c];
        ahead.xdot.as_mut_slice()[c] += euler * slope[c];
    }
    let mut there = Q::zeros(x.len());
    match equation.acceleration(&ahead, &mut there) {
        Err(why) if harmless(&why) => return Ok(euler),
        ahead => ahead?,
    }
    let there = there.as_slice();
    let change = norm(&|c| (euler * slope[c], there[c] - slope[c])) / euler;
    let fastest = rate.max(change);
    let step = if fastest > 1e-15 { (1e-2 / fastest).powf(1.0 / q) } else { left };
    let longest = if equation.is_autonomous() { left } else { left.min(100.0 * euler) };
    Ok(step.min(longest))
}

// Where a coordinate that was positive vanishes in a step.

impl<Q: Coordinates> Stages<Q> {
    /// The part of the step after which a coordinate is negative, if it comes to that.
    #[inline(always)]
    pub(crate) fn first_root<X>(
        &mut self,
        c: usize,
        equation: &mut impl Equation<Q, X>,
    ) -> Result<Option<f64>, X> {
        let above = |(p, slack): (Bernstein, f64)| p.coefficients().iter().all(|&c| c > slack);
        if self.screen(c).is_some_and(above) {
            return Ok(None);
        }
        self.complete(equation)?;
        Ok(self.root_of_polynomial(c))
    }

    /// The same by the polynomial of a complete step.
    #[inline]
    pub(crate) fn root_of_polynomial(&self, c: usize) -> Option<f64> {
        let [x, _] = self.polynomials_of(c);
        self.without_known_root(c, x).first_negative()
    }

    /// The part of the step after which a coordinate that was negative is positive, if it comes to that.
    pub(crate) fn first_rise<X>(
        &mut self,
        c: usize,
        equation: &mut impl Equation<Q, X>,
    ) -> Result<Option<f64>, X> {
        let below = |(p, slack): (Bernstein, f64)| p.coefficients().iter().all(|&c| c < -slack);
        if self.screen(c).is_some_and(below) {
            return Ok(None);
        }
        self.complete(equation)?;
        Ok(self.rise_of_polynomial(c))
    }

    /// The same by the polynomial of a complete step.
    pub(crate) fn rise_of_polynomial(&self, c: usize) -> Option<f64> {
        let [x, _] = self.polynomials_of(c);
        self.without_known_root(c, x.negated()).first_negative()
    }

    /// After an impact `theta = 0` is a root, and known.
    #[inline]
    fn without_known_root(&self, c: usize, x: Bernstein) -> Bernstein {
        match self.from.x.as_slice()[c] == 0.0 {
            true => x.without_root_at_zero(),
            false => x,
        }
    }

    /// The root of the coordinate nearest to the end of the finished step, if close: the time
    /// offset and the rate there. It comes from above, with -1 for `side` from below.
    #[inline(always)]
    pub(crate) fn root_at_end(&self, c: usize, side: f64) -> Option<(f64, f64)> {
        let (x, xdot) = (side * self.end.x.as_slice()[c], side * self.end.xdot.as_slice()[c]);
        let root = touchdown(x, xdot, side * self.end_slope(c));
        root.filter(|it| it.0.abs() < 0.5 * self.h).map(|(delta, rate)| (delta, side * rate))
    }
}

#[cfg(test)]
mod stages_tests {
    use super::*;
    use crate::numeric::tableau::{DOP853, DORMAND_PRINCE_5};

    /// `x'' = a(t, x, x')` for each of some coordinates.
    struct Each<A>(A);

    impl<Q: Coordinates, A: Fn(f64, f64, f64) -> f64> Equation<Q, ()> for Each<A> {
        fn acceleration(&mut self, at: &State<Q>, into: &mut Q) -> Result<(), ()> {
            let state = at.x.as_slice().iter().zip(at.xdot.as_slice());
            for (into, (x, v)) in into.as_mut_slice().iter_mut().zip(state) {
                *into = (self.0)(at.t, *x, *v);
            }
            Ok(())
        }
    }

    /// `x'' = -x + 0.3 t - 0.1 x'`: error of one step and of its polynomials, by step size.
    fn errors(pair: &'static Pair, h: f64) -> [f64; 2] {
        let exact = |t: f64| {
            // x = p + q t + e^(-0.05 t) (a cos w t + b sin w t), q = 0.3, p = -0.03
            let w = (1.0 - 0.0025f64).sqrt();
            let (a, b) = (1.03, (0.2 - 0.3 + 0.05 * 1.03) / w);
            let (sin, cos) = (w * t).sin_cos();
            let decay = (-0.05 * t).exp();
            -0.03 + 0.3 * t + decay * (a * cos + b * sin)
        };
        let equation = &mut Each(|t: f64, x: f64, v: f64| -x + 0.3 * t - 0.1 * v);
        let mut stages = Stages::<f64>::new(pair, 1);
        let from = State { x: 1.0, xdot: 0.2, ..State::default() };
        assert_eq!(stages.step(&from, &(-1.0 - 0.02), h, equation), Ok(()));
        assert_eq!(stages.complete(equation), Ok(()));
        let (end, [x, xdot]) = (stages.end, stages.polynomials_of(0));
        assert!((x.at(1.0) - end.x).abs() < 1e-14 && (xdot.at(1.0) - end.xdot).abs() < 1e-14);
        let inside = (1..8).map(|i| f64::from(i) / 8.0);
        let dense = inside.map(|c| (x.at(c) - exact(c * h)).abs()).fold(0.0, f64::max);
        [(end.x - exact(h)).abs(), dense]
    }

    #[test]
    fn steps_and_polynomials_have_their_orders() {
        // local errors: h^(p+1) for the step, h^(q+1) for the polynomial of order q
        for (pair, h, orders) in [(&DORMAND_PRINCE_5, 0.4, [5.9, 4.8]), (&DOP853, 1.6, [8.7, 7.7])]
        {
            let (coarse, fine) = (errors(pair, h), errors(pair, h / 2.0));
            for i in 0..2 {
                let order = (coarse[i] / fine[i]).log2();
                assert!(order > orders[i], "{i}: order {order} {coarse:?} {fine:?}");
            }
        }
    }

    #[test]
    fn several_coordinates_make_the_steps_of_each_of_them_to_the_last_bit() {
        let tolerances = Tolerances { rtol: 1e-6, atol: [1e-9; 2], rounding: 0.25 };
        let starts = [(1.0, 0.2), (-0.4, 3.0), (0.0, -1.0)];
        let equation = &mut Each(|t: f64, x: f64, v: f64| (3.0 * t).sin() - 2.0 * x - 0.1 * v * v);
        for pair in [&DORMAND_PRINCE_5, &DOP853] {
            let (mut many, mut one) =
                (Stages::<Vec<f64>>::new(pair, 3), Stages::<f64>::new(pair, 1));
            let mut from = State::<Vec<f64>>::zeros(3);
            (from.t, from.late) = (7.3, 1e-17);
            (from.x, from.xdot) = starts.into_iter().unzip();
            let mut slopes = vec![0.0; 3];
            assert_eq!(equation.acceleration(&from, &mut slopes), Ok(()));
            assert_eq!(many.step(&from, &slopes, 0.7, equation), Ok(()));
            let (error, mut worst) = (many.error(&tolerances, equation), 0.0);
            assert_eq!(many.complete(equation), Ok(()));
            for (c, slope) in slopes.iter().enumerate() {
                let alone = State { t: 7.3, late: 1e-17, x: from.x[c], xdot: from.xdot[c] };
                assert_eq!(one.step(&alone, slope, 0.7, equation), Ok(()));
                worst = worse(one.error(&tolerances, equation).unwrap_or(f64::NAN), worst);
                assert_eq!(one.complete(equation), Ok(()));
                let end = (many.end.t, many.end.late, many.end.x[c], many.end.xdot[c]);
                assert_eq!((one.end.t, one.end.late, one.end.x, one.end.xdot), end);
                assert_eq!(one.polynomials_of(0), many.polynomials_of(c));
                assert_eq!((one.screen(0), one.rises(0)), (many.screen(c), many.rises(c)));
            }
            assert_eq!(error, Ok(worst));
        }
    }
}
