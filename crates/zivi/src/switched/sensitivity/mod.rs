//! Derivatives of a run of the switched method by its initial state, the coefficient of
//! restitution and parameters of the force: through impacts, Zeno points, rest and lift-off.
//!
//! The columns `(dx/dq, dx'/dq)` are carried in the same Runge-Kutta steps; an impact multiplies
//! them by the saltation matrix, a Zeno point has the derivative of its extrapolation, they vanish
//! at rest and are reinitialised at lift-off.

mod flights;
mod run;

use zivi_core::Physical;

use super::integrator::SwitchedIntegrator;
use super::mode::{Counted, Piece, Point, Stages};
use super::recording::simulate_with;
use super::settings::{Output, SwitchedRun};
use super::SwitchedRk;
use crate::numeric::bernstein::{evaluate, Bernstein};
use crate::numeric::coordinates::{Beyond, Row, MOST_STAGES};
use crate::numeric::dense::polynomials;
use crate::numeric::stages::{worse, Node, StepError, Tolerances};
use crate::numeric::tableau::{ErrorEstimate, Interpolant, Weights};
use crate::piecewise::steps::Driver;
use crate::record::status::Failure;
use crate::record::user_events::Level;
use crate::system::slopes::{DifferentiableForce, Place, Slopes};
use crate::{AnyImpactLaw, Force, Monitor, SetupError};

pub use flights::{
    correct, fly_apart, sequence_equations, Corrected, Flight, Flown, Hyperplane, ImpactSequence,
    IndependentFlights, Limits, NotCorrected, SequenceEquations,
};
pub use run::sensitivity;

// The variational columns, carried through the Runge-Kutta steps of the motion.
//
// With `X = dx/dq` and `V = dx'/dq` at a fixed time
//
// ```text
// X' = V        V' = f_x X + f_v V + f_q
// ```
//
// is integrated by the pair of the motion in its own steps, with the Jacobian once at each of its
// stages: the columns are the exact derivative of the step that was made.

/// Variable of differentiation of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrt {
    /// The initial distance.
    X0,
    /// The initial velocity.
    Xdot0,
    /// The time of the initial state.
    T0,
    /// A parameter of the impact law, by its number.
    Law(usize),
    /// A parameter of the force, by its number.
    Parameter(usize),
}

impl Wrt {
    /// The coefficient of restitution of Newton's law.
    pub const E: Self = Self::Law(0);

    /// A derivative by it that only the impact law has, `by` its parameter.
    pub(in crate::switched) fn of_law(self, by: impl FnOnce(usize) -> f64) -> f64 {
        match self {
            Self::Law(parameter) => by(parameter),
            _ => 0.0,
        }
    }
}

/// The columns at one point of the motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::switched) struct Columns {
    /// `dx/dq`, one for each column.
    pub(in crate::switched) x: Vec<f64>,
    /// `dx'/dq`.
    pub(in crate::switched) v: Vec<f64>,
}

impl Columns {
    pub(in crate::switched) fn zeros(m: usize) -> Self {
        Self { x: vec![0.0; m], v: vec![0.0; m] }
    }

    pub(in crate::switched) fn clear(&mut self) {
        self.x.fill(0.0);
        self.v.fill(0.0);
    }
}

/// Span and parameters of the derivatives of a force, and their destination.
#[derive(Clone, Debug)]
pub(in crate::switched) struct Forcing {
    /// Numbers of the parameters.
    by: Vec<usize>,
    /// The column of each.
    to: Vec<usize>,
    /// `f_q` of each.
    values: Vec<f64>,
    /// Evaluations of the Jacobian.
    pub(in crate::switched) count: u64,
}

impl Forcing {
    pub(in crate::switched) fn new(wrt: &[Wrt]) -> Self {
        let (to, by): (Vec<usize>, Vec<usize>) = wrt
            .iter()
            .enumerate()
            .filter_map(|(column, wrt)| match wrt {
                Wrt::Parameter(index) => Some((column, *index)),
                _ => None,
            })
            .unzip();
        let values = vec![0.0; by.len()];
        Self { by, to, values, count: 0 }
    }

    /// The partial derivatives at a place; those by the parameters are kept.
    pub(in crate::switched) fn slopes<E, F: DifferentiableForce<E>>(
        &mut self,
        at: Place,
        by_time: bool,
        force: &mut Counted<'_, F>,
    ) -> Result<Slopes, Failure<E>> {
        self.count += 1;
        let (force, t, within) = force.smooth_at(at.t);
        force
            .slopes(Place { t, within, ..at }, by_time, &self.by, &mut self.values)
            .map_err(Failure::Raised)
    }

    /// Adds `factor f_q` to the entries of the columns.
    pub(in crate::switched) fn add_to(&self, columns: &mut [f64], factor: f64) {
        for (&column, value) in self.to.iter().zip(&self.values) {
            columns[column] += factor * value;
        }
    }
}

/// A step of the columns.
#[derive(Clone, Debug)]
pub(in crate::switched) struct ColumnStep {
    m: usize,
    /// Where the step starts and where it ends.
    pub(in crate::switched) from: Columns,
    pub(in crate::switched) end: Columns,
    pub(in crate::switched) forcing: Forcing,
    /// Velocities and accelerations of the stages, in the form used for the motion: deviations from
    /// a uniform acceleration, except at the start.
    v: Vec<f64>,
    k: Vec<f64>,
    known: usize,
    /// Position and velocity of the stage that is computed.
    at: Columns,
}

impl ColumnStep {
    pub(in crate::switched) fn new(wrt: &[Wrt]) -> Self {
        let m = wrt.len();
        let zeros = Columns::zeros(m);
        let stages = vec![0.0; m * MOST_STAGES];
        Self {
            m,
            from: zeros.clone(),
            end: zeros.clone(),
            forcing: Forcing::new(wrt),
            v: stages.clone(),
            k: stages,
            known: 0,
            at: zeros,
        }
    }

    /// From `self.from` through the last step of the motion, to `self.end`.
    pub(in crate::switched) fn step<E, F: DifferentiableForce<E>>(
        &mut self,
        stages: &Stages,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        self.known = 0;
        self.at.clone_from(&self.from);
        self.keep_stage(stages.from, force)?;
        for row in stages.pair.a {
            let node = stages.node(self.known, row);
            self.stage(stages, node, row, force)?;
        }
        let Self { end, from, v, k, .. } = self;
        combine(end, from, (v, k), stages, (stages.pair.b.len(), &stages.pair.b));
        Ok(())
    }

    /// The next stage, `from + h sum_j a_j (V_j, K_j)`.
    fn stage<E, F: DifferentiableForce<E>>(
        &mut self,
        stages: &Stages,
        node: Point,
        row: &Weights,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let Self { at, from, v, k, known, .. } = self;
        combine(at, from, (v, k), stages, (*known, row));
        self.keep_stage(node, force)
    }

    /// Velocity and acceleration of the columns `self.at` at a point.
    fn keep_stage<E, F: DifferentiableForce<E>>(
        &mut self,
        node: Point,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let place = Place::new(node.t, node.x, node.xdot);
        let slopes = self.forcing.slopes(place, false, force)?;
        let (before, k) = self.k.split_at_mut(self.known * self.m);
        let k = &mut k[..self.m];
        for ((k, x), v) in k.iter_mut().zip(&self.at.x).zip(&self.at.v) {
            *k = slopes.x * x + slopes.xdot * v;
        }
        self.forcing.add_to(k, 1.0);
        for (k, start) in k.iter_mut().zip(before) {
            *k -= *start;
        }
        self.known += 1;
        Ok(())
    }

    /// The stage at the end of the step.
    pub(in crate::switched) fn stage_at_end<E, F: DifferentiableForce<E>>(
        &mut self,
        stages: &Stages,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        if self.known == stages.pair.b.len() {
            self.at.clone_from(&self.end);
            self.keep_stage(stages.end, force)?;
        }
        Ok(())
    }

    /// The acceleration of a column at the end of the step.
    fn slope_at_end(&self, stages: &Stages, column: usize) -> f64 {
        self.k[column] + self.k[stages.pair.b.len() * self.m + column]
    }

    /// The largest error of a column relative to its scale `atol/size + rtol |column|`, `sizes`
    /// being the magnitudes of the variables of differentiation.
    pub(in crate::switched) fn error<E, F: DifferentiableForce<E>>(
        &mut self,
        stages: &Stages,
        &Tolerances { rtol, atol, rounding }: &Tolerances,
        sizes: &[f64],
        force: &mut Counted<'_, F>,
    ) -> Result<f64, Failure<E>> {
        if let ErrorEstimate::Single(_) = stages.pair.estimate {
            self.stage_at_end(stages, force)?;
        }
        let rounding = rounding * f64::EPSILON * stages.from.t.abs();
        let mut worst = 0.0_f64;
        for (column, size) in sizes.iter().enumerate() {
            let error = self.error_of(stages, column);
            let speed = self.from.v[column].abs().max(self.end.v[column].abs());
            let place = self.from.x[column].abs().max(self.end.x[column].abs());
            let pull = self.k[column].abs();
            let scale_x = atol[0] / size + rtol * place + rounding * speed;
            let scale_v = atol[1] / size + rtol * speed + rounding * pull;
            worst = worse(error.norm([scale_x, scale_v]), worst);
        }
        Ok(worst)
    }

    fn error_of(&self, stages: &Stages, column: usize) -> StepError {
        let h = stages.h;
        let sum = |weights: Weights, of: &[f64]| {
            let stages = of.chunks_exact(self.m).skip(weights.first());
            weights.rest().iter().zip(stages).map(|(w, of)| w * of[column]).sum::<f64>() * h
        };
        match stages.pair.estimate {
            ErrorEstimate::Single(e) => StepError {
                x: [h * sum(e, &self.v), 0.0],
                xdot: [sum(e, &self.k), 0.0],
                double: false,
            },
            ErrorEstimate::Double(e5, e3) => StepError {
                x: [h * sum(e5, &self.v), h * sum(e3, &self.v)],
                xdot: [sum(e5, &self.k), sum(e3, &self.k)],
                double: true,
            },
        }
    }

    /// Extends the step by a time that is short compared with it.
    pub(in crate::switched) fn polish<E, F: DifferentiableForce<E>>(
        &mut self,
        stages: &Stages,
        delta: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        if delta == 0.0 {
            return Ok(());
        }
        self.stage_at_end(stages, force)?;
        for column in 0..self.m {
            let slope = self.slope_at_end(stages, column);
            self.end.x[column] += delta * (self.end.v[column] + 0.5 * delta * slope);
            self.end.v[column] += delta * slope;
        }
        Ok(())
    }

    /// The further stages of the dense output. The motion has its own.
    pub(in crate::switched) fn all_stages<E, F: DifferentiableForce<E>>(
        &mut self,
        stages: &Stages,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        self.stage_at_end(stages, force)?;
        if let Interpolant::Nested { a, .. } = stages.pair.interpolant {
            let last = stages.pair.b.len();
            while self.known - last - 1 < a.len() {
                let row = &a[self.known - last - 1];
                let node = stages.node(self.known, row);
                self.stage(stages, node, row, force)?;
            }
        }
        Ok(())
    }

    /// The polynomials of a column over the step, once all stages are known.
    pub(in crate::switched) fn polynomials(
        &self,
        stages: &Stages,
        column: usize,
    ) -> [Bernstein; 2] {
        let row: Row = std::array::from_fn(|i| {
            let at = i * self.m + column;
            Beyond { v: self.v[at], k: self.k[at] }
        });
        let [from, end] = [&self.from, &self.end].map(|it| [it.x[column], it.v[column]]);
        polynomials(stages.pair, stages.h, (from, self.k[column]), end, &row)
    }
}

/// The columns at the stage `i` with the row `a`, `to = from + h sum_j a_j (V_j, K_j)`. Writes the
/// deviation of their velocities from a uniform acceleration.
#[inline]
fn combine(
    to: &mut Columns,
    from: &Columns,
    (v, k): (&mut [f64], &[f64]),
    stages: &Stages,
    (i, a): (usize, &Weights),
) {
    let (m, node) = (from.x.len(), Node::new(stages.pair, i, stages.h));
    to.clear();
    let rows = v.chunks_exact(m).zip(k.chunks_exact(m)).skip(a.first());
    for (a, (v, k)) in a.rest().iter().zip(rows) {
        for (to, v) in to.x.iter_mut().zip(v) {
            *to += a * v;
        }
        for (to, k) in to.v.iter_mut().zip(k) {
            *to += a * k;
        }
    }
    for (column, beyond) in v[i * m..][..m].iter_mut().enumerate() {
        let (start, sums) =
            ([from.x[column], from.v[column], k[column]], (to.x[column], to.v[column]));
        (to.x[column], to.v[column]) = node.reach(start, sums);
        *beyond = sums.1;
    }
}

// Request and result of a run with derivatives.

/// Request for derivatives.
#[derive(Clone, Debug)]
pub struct Question<'a, W = Wrt> {
    /// Variables of differentiation.
    pub wrt: &'a [W],
    /// Magnitudes of these, positive: the absolute tolerance of a column is that of the state
    /// divided by its magnitude.
    pub sizes: &'a [f64],
    /// Whether the steps are adapted to the errors of the columns too.
    pub controlled: bool,
    /// Output times of the columns, within the span (s), increasing.
    pub times: &'a [f64],
}

/// The derivatives of the events of a run, for each of them a row of one number a column.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EventRates {
    /// Of the times of the impacts that were computed.
    pub impact_dt: Vec<f64>,
    /// Of the speeds after them.
    pub impact_du: Vec<f64>,
    /// Of the times at which gaps close.
    pub zeno_times: Vec<f64>,
    /// Of the times of the lift-offs.
    pub liftoff_times: Vec<f64>,
    /// Of the times at which compliant gaps come into contact.
    pub touchdown_times: Vec<f64>,
    /// Of the times at which dry friction changes between slip and stick.
    pub transition_times: Vec<f64>,
}

/// The derivatives of a run of `n` coordinates; a mass above a wall has one, its distance.
#[derive(Clone, Debug, PartialEq)]
pub struct Derivatives {
    /// Of the coordinates at the end of the run, at a fixed time: `n` numbers for each column.
    pub q: Vec<f64>,
    /// Of the velocities at the end.
    pub qdot: Vec<f64>,
    /// Of the events.
    pub events: EventRates,
    /// To first order, how far each may be moved before an event appears or disappears.
    pub radius: Vec<f64>,
    /// The event that limits each.
    pub nearest: Vec<Option<Nearest>>,
    /// Whether an impact, the want of one, or the order of two is decided by the tolerances.
    pub grazing: bool,
    /// Time from which derivatives do not exist: a corner, simultaneous impacts or lift-offs of
    /// coupled gaps. Columns are NaN from there, until the contacts determine the state.
    pub lost_at: Option<f64>,
    /// At each of the times asked for `n` numbers of `dq` for each column, then those of `dq'`; NaN
    /// where the impacts accumulate.
    pub samples: Vec<f64>,
    /// Evaluations of the partial derivatives.
    pub n_slopes: u64,
}

// The columns as functions of time.

#[derive(Clone, Copy, Debug, PartialEq)]
enum PathPiece {
    /// Polynomials of this degree, their coefficients from here on, over a step of length `h`.
    Step {
        first: usize,
        degree: usize,
        h: f64,
    },
    /// Infinitely many impacts: not known here.
    Tail,
    Rest,
}

/// The columns between the start of a run and its end.
#[derive(Clone, Debug, Default)]
pub(in crate::switched) struct ColumnPath {
    m: usize,
    segments: Vec<(f64, PathPiece)>,
    coefficients: Vec<f64>,
}

impl ColumnPath {
    pub(in crate::switched) fn new(m: usize) -> Self {
        Self { m, ..Self::default() }
    }

    /// A step, up to an impact within it if any.
    pub(in crate::switched) fn push_flight(
        &mut self,
        stages: &Stages,
        step: &ColumnStep,
        length: Option<f64>,
    ) {
        let (first, mut degree) = (self.coefficients.len(), 0);
        let h = length.unwrap_or(stages.h);
        for column in 0..self.m {
            for polynomial in step.polynomials(stages, column) {
                let part = match length {
                    Some(length) => polynomial.split(length / stages.h).0,
                    None => polynomial,
                };
                degree = part.coefficients().len() - 1;
                self.coefficients.extend_from_slice(part.coefficients());
            }
        }
        self.push(stages.from.t, PathPiece::Step { first, degree, h });
    }

    pub(in crate::switched) fn push_tail(&mut self, start: f64) {
        self.push(start, PathPiece::Tail);
    }

    pub(in crate::switched) fn push_rest(&mut self, start: f64) {
        self.push(start, PathPiece::Rest);
    }

    fn push(&mut self, start: f64, kind: PathPiece) {
        if self.segments.last().is_some_and(|last| last.0 == start) {
            self.segments.pop();
        }
        self.segments.push((start, kind));
    }

    /// `dx/dq` and `dx'/dq` at `t`; at an impact, after it; NaN in a tail, and before the
    /// start.
    pub(in crate::switched) fn at(&self, t: f64) -> Columns {
        let after = self.segments.partition_point(|segment| segment.0 <= t);
        let Some(&(start, kind)) = after.checked_sub(1).map(|last| &self.segments[last]) else {
            return Columns { x: vec![f64::NAN; self.m], v: vec![f64::NAN; self.m] };
        };
        match kind {
            PathPiece::Rest => Columns::zeros(self.m),
            PathPiece::Tail => Columns { x: vec![f64::NAN; self.m], v: vec![f64::NAN; self.m] },
            PathPiece::Step { first, degree, h } => {
                let theta = ((t - start) / h).clamp(0.0, 1.0);
                let polynomial = |number: usize| {
                    evaluate(&self.coefficients[first + number * (degree + 1)..][..=degree], theta)
                };
                let of = |part: usize| (0..self.m).map(|j| polynomial(2 * j + part)).collect();
                Columns { x: of(0), v: of(1) }
            }
        }
    }
}

// Validity of the derivatives: the radius, in units of the variables of differentiation, at which
// to first order an event of the run appears, disappears, or passes the end.

/// Reason for the limit of a derivative.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Limit {
    /// An impact that is pulled off the wall: it vanishes.
    Impact = 0,
    /// A minimum of the distance in flight: an impact appears.
    Minimum = 1,
    /// The acceleration towards the wall at a Zeno point vanishes: the impact sequence no longer ends.
    Zeno = 2,
    /// A maximum of the force at rest: a lift-off appears.
    Rest = 3,
    /// The force hardly rises at a lift-off: it vanishes.
    LiftOff = 4,
    /// An event near the end of the run passes it.
    End = 5,
    /// An event near a jump of the force passes it.
    Stop = 6,
    /// The speed after an impact, or the acceleration towards the wall, vanishes.
    Chain = 7,
}

/// The nearest event: what it is, when, and how deep (in its own unit).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// The reason.
    pub limit: Limit,
    /// When (s).
    pub t: f64,
    /// How far the run is from it: a height (m) of an impact or a minimum, a force (m/s^2) at a
    /// Zeno point, at rest or at a lift-off, a time (s) at the end and at jumps, a force or a speed
    /// (m/s) in an impact sequence.
    pub depth: f64,
}

/// The radii of all columns.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Validity {
    pub(crate) radius: Vec<f64>,
    pub(crate) nearest: Vec<Option<Nearest>>,
    /// The smallest depth of an impact or a minimum.
    pub(crate) shallowest: f64,
}

impl Validity {
    pub(crate) fn new(m: usize) -> Self {
        Self { radius: vec![f64::INFINITY; m], nearest: vec![None; m], shallowest: f64::INFINITY }
    }

    /// Whether an impact or a minimum is decided by the tolerances of a run that is up to so high.
    pub(crate) fn is_undecided(&self, settings: &SwitchedRk, highest: f64) -> bool {
        is_undecided(self.shallowest, highest, settings)
    }

    /// An event of this depth, which falls by `rates` for one unit of each column.
    pub(crate) fn note(
        &mut self,
        limit: Limit,
        t: f64,
        depth: f64,
        rates: impl IntoIterator<Item = f64>,
    ) {
        if matches!(limit, Limit::Impact | Limit::Minimum) {
            self.shallowest = self.shallowest.min(depth);
        }
        let known = self.radius.iter_mut().zip(&mut self.nearest);
        for ((radius, nearest), rate) in known.zip(rates) {
            let reach = depth / rate.abs();
            if reach < *radius {
                (*radius, *nearest) = (reach, Some(Nearest { limit, t, depth }));
            }
        }
    }
}

// Whether a run of the switched method passed a grazing: an impact, or the want of one, that is
// decided by the tolerances.
//
// An impact with the velocity `v` that the force pulls off, `a = f(t, 0, v) > 0`, would not be one
// if its flight went higher by `v^2/(2 a)`; a minimum of a flight at the height `x` would be one if
// it went lower by `x`. Low speeds at `a < 0`, those of a chain of impacts, are no grazing.

/// A depth that is decided by the tolerances, in units of those of the distance.
const DECIDED: f64 = 10.0;

/// Whether the tolerances decided over the shallowest event of a run that is up to so high (m).
pub(super) fn is_undecided(shallowest: f64, highest: f64, settings: &SwitchedRk) -> bool {
    shallowest <= DECIDED * (settings.atol[0] + settings.rtol * highest)
}

/// Distance of a run from a grazing.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Grazing {
    /// The smallest depth of an impact or a minimum (m).
    shallowest: f64,
    /// The largest distance at the end of a step (m).
    highest: f64,
}

impl Default for Grazing {
    fn default() -> Self {
        Self { shallowest: f64::INFINITY, highest: 0.0 }
    }
}

impl Grazing {
    fn note(&mut self, depth: f64) {
        self.shallowest = self.shallowest.min(depth);
    }

    /// A minimum of the distance within the last piece of flight.
    fn minimum<E, F: Force<E>>(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        // a piece of several curves is far from the wall
        if integrator.flight().curves() != 1 {
            return Ok(());
        }
        let (end, sigma) = (integrator.t(), integrator.sigma());
        let curve = integrator.flight().curve(0, sigma, force)?;
        for t in curve.crossings(Level::Velocity(0.0), end) {
            self.note(curve.at(t).x);
        }
        Ok(())
    }
}

/// Runs [`crate::simulate_switched_rk`] and returns whether the run passed a grazing that the
/// tolerances decided.
///
/// # Errors
/// [`SetupError`] before anything is computed.
pub(crate) fn simulate_watching<E, F: Force<E>>(
    settings: SwitchedRk,
    law: AnyImpactLaw,
    force: &mut F,
    (span, tstops): ((f64, f64), &[f64]),
    initial: Physical,
    monitor: &mut impl Monitor<E>,
) -> Result<(SwitchedRun<E>, bool), SetupError> {
    let mut grazing = Grazing::default();
    let output = Output { tstops, ..Output::default() };
    let run = simulate_with(&mut grazing, settings, law, force, span, initial, output, monitor)?;
    Ok((run, is_undecided(grazing.shallowest, grazing.highest, &settings)))
}

impl<'f, E, F: Force<E>> Driver<SwitchedIntegrator, Counted<'f, F>, E> for Grazing {
    fn step(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        t_end: f64,
        force: &mut Counted<'f, F>,
    ) -> Result<Piece, Failure<E>> {
        let before = integrator.now();
        self.highest = self.highest.max(before.x);
        let piece = integrator.step(t_end, force)?;
        match piece {
            Piece::Flight { impact: Some(impact), .. } => {
                let v = impact.xdot_before;
                let pull = force.known_at(impact.t, 0.0, v)?;
                if pull > 0.0 {
                    self.note(v * v / (2.0 * pull));
                }
            }
            Piece::Flight { impact: None, .. } => {
                if before.xdot < 0.0 && integrator.now().xdot > 0.0 {
                    self.minimum(integrator, force)?;
                }
            }
            Piece::Tail | Piece::Rest { .. } => {}
        }
        Ok(piece)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{FunctionForce, Restitution, Silent};

    /// Whether the tolerances decide over a run that starts at rest at `x0` under `f = 3 (t - 1)`:
    /// its lowest point is `x0 - 2`, at `t = 2`.
    fn grazes(x0: f64) -> bool {
        let pull = 3.0;
        let mut force = FunctionForce(|t: f64, _: f64, _: f64| {
            Ok::<f64, std::convert::Infallible>(pull * (t - 1.0))
        });
        let start = Physical { x: x0, xdot: 0.0 };
        let (settings, law) = (SwitchedRk::with_tol(1e-9), Restitution::from_e(0.5).unwrap());
        let (run, found) = simulate_watching(
            settings,
            law.into(),
            &mut force,
            ((0.0, 2.5), &[]),
            start,
            &mut Silent,
        )
        .unwrap();
        assert_eq!(run.trajectory.status, crate::Status::Completed);
        found
    }

    #[test]
    fn a_wall_that_is_just_touched_or_just_missed_is_noticed() {
        assert!(grazes(2.0 + 1e-10));
        assert!(grazes(2.0 - 1e-10));
        assert!(!grazes(2.0 + 1e-3));
        assert!(!grazes(2.0 - 1e-3));
    }
}
