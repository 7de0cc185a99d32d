//! One step of an embedded pair on `x'' = a(t, x, x')`, with `x` the coordinates and the gaps.
//!
//! The gaps are integrated along: `g_k'' = b_k + D_kC lambda_C` costs no further evaluation, and
//! keeps its relative precision where the difference `g(q)` has none left.

use super::gap_set::GapSet;
use super::kinetics::{Kinetics, Model};
use crate::numeric::bernstein::Bernstein;
use crate::numeric::tableau::{Estimate, Interpolant, Pair, MOST_STAGES};
use crate::record::failure::Failure;
use crate::switched::stages::{nested, quartic, screen};
use crate::system::dynamics::{Dynamics, Layout};
use crate::Status;

/// A state at a time: `x` are the coordinates, then the gaps, `v` their rates.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct State {
    pub(super) t: f64,
    /// What rounding leaves out of `t`.
    pub(super) late: f64,
    pub(super) x: Vec<f64>,
    pub(super) v: Vec<f64>,
}

impl State {
    pub(super) fn copy_from(&mut self, other: &State) {
        (self.t, self.late) = (other.t, other.late);
        self.x.clone_from(&other.x);
        self.v.clone_from(&other.v);
    }

    /// Moves the time on by `h`.
    pub(super) fn pass(&mut self, h: f64) {
        let step = h + self.late;
        let t = self.t + step;
        self.late = step - (t - self.t);
        self.t = t;
    }
}

/// Stages of one component, contiguous: sums over the stages are dot products.
type Row = [f64; MOST_STAGES];

/// The last step that was computed.
#[derive(Clone, Debug)]
pub(super) struct Stages {
    pub(super) pair: &'static Pair,
    n: usize,
    pub(super) closed: GapSet,
    pub(super) from: State,
    pub(super) end: State,
    pub(super) h: f64,
    /// Rates and accelerations of the stages.
    v: Vec<Row>,
    k: Vec<Row>,
    known: usize,
    /// Contact forces, gaps and gap rates at the end of the step.
    pub(super) end_lambda: Vec<f64>,
    pub(super) end_gap: Vec<f64>,
    pub(super) end_rate: Vec<f64>,
    at: State,
}

impl Stages {
    pub(super) fn new(pair: &'static Pair, Layout { n, m }: Layout) -> Self {
        let state = State { x: vec![0.0; n + m], v: vec![0.0; n + m], ..State::default() };
        let rows = vec![[0.0; MOST_STAGES]; n + m];
        Self {
            pair,
            n,
            closed: GapSet::EMPTY,
            from: state.clone(),
            end: state.clone(),
            h: 0.0,
            v: rows.clone(),
            k: rows,
            known: 0,
            end_lambda: vec![0.0; m],
            end_gap: vec![0.0; m],
            end_rate: vec![0.0; m],
            at: state,
        }
    }

    /// `q` in the local error: a step of length `h` has one of order `h^q`.
    pub(super) fn order_of_error(&self) -> f64 {
        self.pair.q
    }

    /// Computes the step from a state where the accelerations are `slope`.
    pub(super) fn step<E, D: Dynamics<E>>(
        &mut self,
        from: &State,
        slope: &[f64],
        h: f64,
        closed: GapSet,
        (kinetics, model): (&mut Kinetics, &mut Model<'_, D>),
    ) -> Result<(), Failure<E>> {
        self.from.copy_from(from);
        (self.h, self.closed, self.known) = (h, closed, 1);
        for (c, (v, k)) in from.v.iter().zip(slope).enumerate() {
            (self.v[c][0], self.k[c][0]) = (*v, *k);
        }
        for row in self.pair.a {
            self.stage(row, kinetics, model)?;
        }
        self.move_along(self.pair.b, 1.0);
        std::mem::swap(&mut self.at, &mut self.end);
        let finite = |v: &[f64]| v.iter().all(|v| v.is_finite());
        if finite(&self.end.x) && finite(&self.end.v) {
            Ok(())
        } else {
            Err(Failure::Status(Status::StateNotFinite))
        }
    }

    /// `at <- from + h sum_j a_j (v_j, k_j)` at the node `c`.
    fn move_along(&mut self, a: &[f64], c: f64) {
        let Self { at, from, h, v, k, .. } = self;
        (at.t, at.late) = (from.t, from.late);
        at.pass(c * *h);
        for i in 0..from.x.len() {
            at.x[i] = from.x[i] + *h * weighted(a, &v[i]);
            at.v[i] = from.v[i] + *h * weighted(a, &k[i]);
        }
    }

    fn stage<E, D: Dynamics<E>>(
        &mut self,
        row: &[f64],
        kinetics: &mut Kinetics,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        self.move_along(row, self.pair.c[self.known]);
        let (at, n) = (&self.at, self.n);
        kinetics.evaluate(model, at.t, &at.x[..n], &at.v[..n])?;
        kinetics.contact(self.closed)?;
        let i = self.known;
        for (c, (v, k)) in at.v.iter().zip(&kinetics.acceleration).enumerate() {
            (self.v[c][i], self.k[c][i]) = (*v, *k);
        }
        self.known = i + 1;
        Ok(())
    }

    /// Evaluates the system at the end of the step, which is the next stage.
    pub(super) fn finish<E, D: Dynamics<E>>(
        &mut self,
        kinetics: &mut Kinetics,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (i, n) = (self.pair.b.len(), self.n);
        if self.known != i {
            return Ok(());
        }
        let end = &self.end;
        kinetics.evaluate(model, end.t, &end.x[..n], &end.v[..n])?;
        kinetics.contact(self.closed)?;
        for (c, (v, k)) in end.v.iter().zip(&kinetics.acceleration).enumerate() {
            (self.v[c][i], self.k[c][i]) = (*v, *k);
        }
        self.end_lambda.copy_from_slice(&kinetics.lambda);
        for gap in 0..self.end_gap.len() {
            self.end_gap[gap] = kinetics.gap(gap);
            self.end_rate[gap] = kinetics.rate(gap, &end.v[..n]);
        }
        self.known = i + 1;
        Ok(())
    }

    /// The accelerations at the end of the step, if they are known.
    pub(super) fn copy_end_slope(&self, slope: &mut [f64]) -> bool {
        let i = self.pair.b.len();
        for (slope, k) in slope.iter_mut().zip(&self.k) {
            *slope = k[i];
        }
        self.known > i
    }

    /// The acceleration of one component at the end of the step.
    pub(super) fn end_slope(&self, component: usize) -> f64 {
        self.k[component][self.pair.b.len()]
    }

    /// The estimated error of the step relative to `atol_i + rtol |y_i|`, of which more than
    /// rounding of the time cannot be asked.
    pub(super) fn error<E, D: Dynamics<E>>(
        &mut self,
        [atol_x, atol_v]: [f64; 2],
        rtol: f64,
        kinetics: &mut Kinetics,
        model: &mut Model<'_, D>,
    ) -> Result<f64, Failure<E>> {
        if let Estimate::Single(_) = self.pair.estimate {
            self.finish(kinetics, model)?;
        }
        let Self { pair, from, end, h, v, k, .. } = self;
        let late = 4.0 * f64::EPSILON * from.t.abs();
        let mut worst = 0.0_f64;
        for c in 0..from.x.len() {
            let speed = from.v[c].abs().max(end.v[c].abs());
            let of_x = atol_x + rtol * from.x[c].abs().max(end.x[c].abs()) + late * speed;
            let of_v = atol_v + rtol * speed + late * k[c][0].abs();
            for (rows, scale) in [(&v[c], of_x), (&k[c], of_v)] {
                let error = estimate(&pair.estimate, rows, *h / scale);
                // f64::max would drop NaN
                worst = if error > worst || error.is_nan() { error } else { worst };
            }
        }
        Ok(worst)
    }

    /// Whether the velocities hardly change in the step: across a jump of the forces they change by
    /// no more than rounding of the time explains, at a pole by any amount.
    pub(super) fn is_smooth_to_rounding(&self) -> bool {
        const HARDLY: f64 = 1e-3;
        let (from, end) = (&self.from.v, &self.end.v);
        let change = from.iter().zip(end).fold(0.0_f64, |a, (v, w)| a.max((w - v).abs()));
        let speed = from.iter().chain(end).fold(0.0_f64, |a, v| a.max(v.abs()));
        change <= HARDLY * speed
    }

    /// As the screen of the scalar method, for one component.
    pub(super) fn screen(&self, c: usize) -> Option<(Bernstein, f64)> {
        let Interpolant::Nested { .. } = self.pair.interpolant else { return None };
        let (from, end) = (&self.from, &self.end);
        Some(screen(self.pair, self.h, (from.x[c], from.v[c]), (end.x[c], end.v[c]), &self.k[c]))
            .flatten()
    }

    /// Computes the stages that the polynomials need.
    pub(super) fn complete<E, D: Dynamics<E>>(
        &mut self,
        kinetics: &mut Kinetics,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        self.finish(kinetics, model)?;
        if let Interpolant::Nested { a, .. } = self.pair.interpolant {
            for row in &a[self.known - self.pair.b.len() - 1..] {
                self.stage(row, kinetics, model)?;
            }
        }
        Ok(())
    }

    /// The polynomials of a component and of its rate over the step, once it is complete.
    pub(super) fn polynomials(&self, c: usize) -> [Bernstein; 2] {
        let (from, end) = (&self.from, &self.end);
        [
            self.polynomial([from.x[c], end.x[c]], &self.v[c]),
            self.polynomial([from.v[c], end.v[c]], &self.k[c]),
        ]
    }

    fn polynomial(&self, [y, end]: [f64; 2], rows: &Row) -> Bernstein {
        let p = match self.pair.interpolant {
            Interpolant::Monomials(p) => Bernstein::from_quartic(quartic(y, self.h, rows, p)),
            Interpolant::Nested { d, .. } => {
                let last = self.pair.b.len();
                Bernstein::from_nested(y, nested([y, end], self.h, rows, last, &d))
            }
        };
        p.with_ends(y, end)
    }
}

fn weighted(a: &[f64], row: &Row) -> f64 {
    a.iter().zip(row).map(|(a, k)| a * k).sum()
}

/// The error of one component, in units of its scale with `factor = h/scale`.
fn estimate(weights: &Estimate, row: &Row, factor: f64) -> f64 {
    match weights {
        Estimate::Single(e) => (factor * weighted(e, row)).abs(),
        Estimate::Double(e5, e3) => {
            let first = (factor * weighted(e5, row)).abs();
            if first == 0.0 {
                return 0.0;
            }
            // e5^2/sqrt(e5^2 + 0.01 e3^2)
            first * (first / first.hypot(0.1 * factor * weighted(e3, row)))
        }
    }
}
