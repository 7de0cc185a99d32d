//! The samples of a run: at the ends of steps, at given times, or so that they draw the motion.

use pulp::{Simd, WithSimd};
use zivi_core::{sgn, transform, Branch, Restitution};

use std::collections::TryReserveError;

use super::path::{DensePath, FlightCurve};
use super::plot_samples::{row, PlotSamples, Row, SampleRun, SampleSource, LANES};
use crate::record::columns::{Columns, Quantity, Reserve, QUANTITIES};
use crate::record::trajectory::SetupError;
use crate::{PathPoint, Physical};

/// The samples of a run, as they were recorded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    rows: Vec<Row>,
}

impl Samples {
    /// Makes room for more samples.
    pub(super) fn make_room(
        &mut self,
        count: usize,
        reserve: &mut Reserve,
    ) -> Result<(), TryReserveError> {
        reserve.room(&mut self.rows, count, QUANTITIES * size_of::<f64>())
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there is no sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The time of the last one.
    #[must_use]
    pub fn last(&self) -> Option<f64> {
        self.rows.last().map(|row| row[0])
    }

    pub(super) fn push(&mut self, t: f64, point: PathPoint) {
        self.rows.push(row(t, point));
    }

    /// All samples in the order of time, with those between them that draw the motion where that is
    /// given and there is memory for them; `advise` learns where their memory is.
    ///
    /// # Errors
    /// There is no memory for the columns.
    pub fn columns(
        &self,
        drawn: Option<&DensePath>,
        restitution: Restitution,
        advise: impl FnOnce(*const f64, usize),
    ) -> Result<Columns, SetupError> {
        let rows = &self.rows;
        let failed = |_| SetupError::Memory(rows.len());
        let drawn = drawn.and_then(|path| {
            let [t, x] = [0, 1].map(|k| rows.iter().map(|row| row[k]).collect::<Vec<f64>>());
            Some((path, PlotSamples::of(path, [&t, &x]).ok()?))
        });
        let sample = |k: usize| quantities(&rows[k], restitution);
        if let Some((path, plotted)) = drawn {
            return plotted.columns(path, sample, restitution, advise).map_err(failed);
        }
        let mut columns = Columns::with_room(rows.len().max(1), advise).map_err(failed)?;
        let mut to = columns.extend(rows.len());
        for k in 0..rows.len() {
            for (to, value) in to.iter_mut().zip(sample(k)) {
                to[k] = value;
            }
        }
        Ok(columns)
    }
}

impl DensePath {
    /// Samples at the ends of the steps of a run, of which these are the times and positions, and
    /// more between them, so that lines through all of them draw its motion; `None` without the
    /// memory for them.
    ///
    /// ```
    /// use zivi::{
    ///     simulate_switched_rk, ConstantForce, Output, Physical, Quantity, Restitution, Silent,
    ///     SwitchedRk,
    /// };
    ///
    /// let (ball, restitution) = (Physical { x: 1.0, xdot: 0.0 }, Restitution::from_e(0.5)?);
    /// let output = Output { dense: true, ..Output::default() };
    /// let run = simulate_switched_rk(
    ///     SwitchedRk::default(), restitution, &mut ConstantForce(-2.0), (0.0, 4.0), ball, output,
    ///     &mut Silent,
    /// )?;
    /// let (path, columns) = (run.path.unwrap(), run.trajectory.columns);
    /// let steps = Quantity::ALL.map(|it| columns.of(it));
    /// let samples = path.plot_samples([steps[0], steps[1]]).unwrap();
    /// let x = samples.column(Quantity::X, &path, steps, restitution).unwrap();
    /// assert!(x.len() > 2 * columns.len());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn plot_samples(&self, steps: [&[f64]; 2]) -> Option<PlotSamples> {
        PlotSamples::of(self, steps).ok()
    }
}

impl PlotSamples {
    /// One quantity at all samples of a path, given all of them at the ends of its steps; `None`
    /// without the memory for it.
    #[must_use]
    pub fn column(
        &self,
        quantity: Quantity,
        path: &DensePath,
        steps: [&[f64]; QUANTITIES],
        restitution: Restitution,
    ) -> Option<Vec<f64>> {
        match quantity {
            Quantity::T => return copied(&self.t),
            Quantity::X if !self.x.is_empty() => return copied(&self.x),
            _ => (),
        }
        let [column] = self.some([quantity], path, steps, restitution)?;
        Some(column)
    }

    /// `s`, `v` and both multipliers at all samples, as [`PlotSamples::column`].
    #[must_use]
    pub fn lifted(
        &self,
        path: &DensePath,
        steps: [&[f64]; QUANTITIES],
        restitution: Restitution,
    ) -> Option<[Vec<f64>; LIFTED.len()]> {
        self.some(LIFTED, path, steps, restitution)
    }

    fn some<const N: usize>(
        &self,
        which: [Quantity; N],
        path: &DensePath,
        steps: [&[f64]; QUANTITIES],
        restitution: Restitution,
    ) -> Option<[Vec<f64>; N]> {
        let mut columns = [const { Vec::new() }; N];
        for column in &mut columns {
            column.try_reserve_exact(self.t.len()).ok()?;
        }
        pulp::Arch::new().dispatch(Filled { of: self, which, path, steps, restitution, columns })
    }

    /// All quantities at all samples.
    fn columns(
        &self,
        path: &DensePath,
        sample: impl Fn(usize) -> [f64; QUANTITIES],
        restitution: Restitution,
        advise: impl FnOnce(*const f64, usize),
    ) -> Result<Columns, TryReserveError> {
        let columns = Columns::with_room(self.t.len().max(1), advise)?;
        Ok(pulp::Arch::new().dispatch(AllFilled { of: self, path, sample, restitution, columns }))
    }

    /// The runs, each with its times.
    #[inline(always)]
    fn runs(&self) -> impl Iterator<Item = (SampleRun, &[f64])> {
        let mut t = &self.t[..];
        self.runs.iter().map(move |&run| {
            let (own, rest) = t.split_at(run.count);
            t = rest;
            (run, own)
        })
    }
}

/// A copy if memory suffices.
fn copied(of: &[f64]) -> Option<Vec<f64>> {
    let mut all = Vec::new();
    all.try_reserve_exact(of.len()).ok()?;
    all.extend_from_slice(of);
    Some(all)
}

/// Quantities derived from the state at a sample.
const LIFTED: [Quantity; 4] = [Quantity::S, Quantity::V, Quantity::LambdaS, Quantity::LambdaV];

/// [`PlotSamples::some`], compiled for the vectors that the machine has.
struct Filled<'a, const N: usize> {
    of: &'a PlotSamples,
    which: [Quantity; N],
    path: &'a DensePath,
    steps: [&'a [f64]; QUANTITIES],
    restitution: Restitution,
    columns: [Vec<f64>; N],
}

impl<const N: usize> WithSimd for Filled<'_, N> {
    type Output = Option<[Vec<f64>; N]>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let Self { of, which, path, steps, restitution, mut columns } = self;
        for (SampleRun { source, count }, t) in of.runs() {
            match source {
                SampleSource::Steps(first) => {
                    for (column, it) in columns.iter_mut().zip(which) {
                        let known = steps[it as usize].get(first..first + count)?;
                        column.extend_from_slice(known);
                    }
                }
                SampleSource::Rows(first) => {
                    for row in of.rows.get(first..first + count)? {
                        let all = quantities(row, restitution);
                        for (column, it) in columns.iter_mut().zip(which) {
                            column.push(all[it as usize]);
                        }
                    }
                }
                SampleSource::Flight(number) => {
                    let curve = path.curve(path.segments.get(number)?)?;
                    for t in t.chunks(LANES) {
                        let values = of_curve(&curve, t, which, restitution);
                        for (column, values) in columns.iter_mut().zip(values) {
                            column.extend_from_slice(&values[..t.len()]);
                        }
                    }
                }
            }
        }
        Some(columns)
    }
}

/// Some quantities of a curve at up to [`LANES`] times.
#[inline(always)]
fn of_curve<const N: usize>(
    curve: &FlightCurve,
    t: &[f64],
    which: [Quantity; N],
    restitution: Restitution,
) -> [[f64; LANES]; N] {
    let at = lanes(t);
    if let [only] = which[..] {
        match only {
            Quantity::X => return [curve.positions(&at); N],
            Quantity::Xdot => return [curve.velocities(&at); N],
            _ => (),
        }
    }
    let (x, xdot) = (curve.positions(&at), curve.velocities(&at));
    let mut values = [[0.0; LANES]; N];
    for l in 0..LANES {
        let all = quantities(&[at[l], x[l], xdot[l], curve.sigma], restitution);
        for (values, it) in values.iter_mut().zip(which) {
            values[l] = all[it as usize];
        }
    }
    values
}

/// [`PlotSamples::columns`], compiled in the same way.
struct AllFilled<'a, F> {
    of: &'a PlotSamples,
    path: &'a DensePath,
    sample: F,
    restitution: Restitution,
    columns: Columns,
}

impl<F: Fn(usize) -> [f64; QUANTITIES]> WithSimd for AllFilled<'_, F> {
    type Output = Columns;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Columns {
        let Self { of, path, sample, restitution, mut columns } = self;
        for (SampleRun { source, count }, t) in of.runs() {
            match source {
                SampleSource::Steps(first) => {
                    (first..first + count).for_each(|k| columns.push(sample(k)));
                }
                SampleSource::Rows(first) => {
                    let rows = of.rows[first..][..count].iter();
                    rows.for_each(|row| columns.push(quantities(row, restitution)));
                }
                SampleSource::Flight(number) => {
                    let Some(curve) = path.curve(&path.segments[number]) else { continue };
                    for t in t.chunks(LANES) {
                        let rows = states(&curve, t).take(t.len());
                        rows.for_each(|row| columns.push(quantities(&row, restitution)));
                    }
                }
            }
        }
        columns
    }
}

/// So many times, and the last ones again.
#[inline(always)]
fn lanes(t: &[f64]) -> [f64; LANES] {
    let mut at = [t.last().copied().unwrap_or_default(); LANES];
    at[..t.len()].copy_from_slice(t);
    at
}

/// The states of a curve at up to [`LANES`] times.
#[inline(always)]
fn states(curve: &FlightCurve, t: &[f64]) -> impl Iterator<Item = Row> {
    let (at, sigma) = (lanes(t), curve.sigma);
    let both = curve.positions(&at).into_iter().zip(curve.velocities(&at));
    at.into_iter().zip(both).map(move |(t, (x, xdot))| [t, x, xdot, sigma])
}

/// A sample with `s`, `v` and the multipliers of its branch.
#[inline(always)]
fn quantities(&[t, x, xdot, sigma]: &Row, restitution: Restitution) -> [f64; QUANTITIES] {
    let branch = if sigma > 0.0 { Branch::Positive } else { Branch::Negative };
    let state = Physical { x, xdot };
    let z = transform::lift(state, branch, restitution);
    let lambda_s = if state.is_at_origin() { 0.0 } else { sigma };
    // no negative zeros
    let (s, v) = (z.s + 0.0, z.v + 0.0);
    [t, x, xdot, s, v, lambda_s, sigma * sgn(xdot) + 0.0, f64::NAN]
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;
    use crate::{simulate_switched_rk, LinearForce, Output, Quantity, Silent, SwitchedRk};

    #[test]
    fn what_draws_a_motion_later_is_what_draws_it_at_once() {
        let swing =
            LinearForce { stiffness: 1.0, gravity: 2.0, amplitude: 1.5, omega: 0.7, ..FALL };
        for force in [FALL, swing] {
            let restitution = Restitution::from_e(0.6).unwrap();
            let run = |drawn| {
                let start = Physical { x: 1.0, xdot: 0.5 };
                let output = Output::<Infallible> { dense: true, drawn, ..Output::default() };
                let method = SwitchedRk::default();
                let (mut force, span) = (force, (0.0, 40.0));
                simulate_switched_rk(
                    method,
                    restitution,
                    &mut force,
                    span,
                    start,
                    output,
                    &mut Silent,
                )
                .unwrap()
            };
            let (at_once, steps) = (run(true).trajectory.columns, run(false));
            let known = Quantity::ALL.map(|it| steps.trajectory.columns.of(it));
            let path = steps.path.unwrap();
            let plotted = path.plot_samples([known[0], known[1]]).unwrap();
            let later = |it| plotted.column(it, &path, known, restitution).unwrap();
            assert!(plotted.len() > known[0].len() + 20, "{}", plotted.len());
            for quantity in Quantity::ALL {
                let bits = |it: &[f64]| it.iter().map(|it| it.to_bits()).collect::<Vec<u64>>();
                assert_eq!(bits(&later(quantity)), bits(at_once.of(quantity)), "{quantity:?}");
            }
            let lifted = plotted.lifted(&path, known, restitution).unwrap();
            assert_eq!(lifted, LIFTED.map(later));
            let t = later(Quantity::T);
            assert!(t.windows(2).all(|pair| pair[0] < pair[1]));
            assert!(known[0].iter().all(|step| t.contains(step)));
        }
    }

    const FALL: LinearForce = LinearForce {
        stiffness: 0.0,
        damping: 0.0,
        gravity: 9.81,
        amplitude: 0.0,
        omega: 0.0,
        phase: 0.0,
    };
}
