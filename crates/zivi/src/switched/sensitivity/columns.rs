//! The variational columns, carried through the Runge-Kutta steps of the motion.
//!
//! With `X = dx/dq` and `V = dx'/dq` at a fixed time
//!
//! ```text
//! X' = V        V' = f_x X + f_v V + f_q
//! ```
//!
//! is integrated by the pair of the motion in its own steps, with the Jacobian once at each of its
//! stages: the columns are the exact derivative of the step that was made.

use crate::numeric::bernstein::Bernstein;
use crate::numeric::coordinates::{Beyond, Row, MOST_STAGES};
use crate::numeric::dense::polynomials;
use crate::numeric::stages::{worse, Node, StepError, Tolerances};
use crate::numeric::tableau::{ErrorEstimate, Interpolant, Weights};
use crate::record::status::Failure;
use crate::switched::mode::Point;
use crate::switched::sensitivity::validity::Nearest;
use crate::switched::stages::{Counted, Stages};
use crate::system::slopes::{DifferentiableForce, Place, Slopes};

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
