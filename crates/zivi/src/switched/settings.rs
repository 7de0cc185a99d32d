//! Settings of the switched method.

use std::collections::TryReserveError;
use std::ops::Bound;

use pulp::{Simd, WithSimd};
use zivi_core::setting::{Setting, Value, Values};
use zivi_core::{sgn, transform, Branch, Restitution};

use super::mode::Counts;
use super::path::{DensePath, FlightCurve};
use super::plot_samples::{row, PlotSamples, Row, SampleRun, SampleSource, TIMES_AT_ONCE};
use crate::numeric::coordinates::Coordinates;
use crate::numeric::stages::Tolerances;
use crate::numeric::tableau::{Pair, DOP853, DORMAND_PRINCE_5};
use crate::piecewise::running::Kick;
use crate::piecewise::steps::StepLimits;
use crate::record::columns::{Columns, Quantity, Reserve, QUANTITIES};
use crate::record::trajectory::Values as ReferencePoint;
use crate::record::trajectory::{checked_count, SetupError, Trajectory};
use crate::record::user_events::{LocatedEvent, UserEvent};
use crate::zeno::arc::Bounce;
use crate::zeno::chain::Chain;
use crate::zeno::tail::Tail;
use crate::{Force, Impact, LinearLaw, PathPoint, Physical};

/// Order of the Runge-Kutta pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// Dormand-Prince 5(4): 6 evaluations of the force a step.
    Five,
    /// DOP853, order 8: 11 evaluations of the force a step, 3 more for dense output.
    #[default]
    Eight,
}

impl Order {
    /// The order of a number.
    #[must_use]
    pub fn of(number: i64) -> Option<Self> {
        match number {
            5 => Some(Order::Five),
            8 => Some(Order::Eight),
            _ => None,
        }
    }

    pub(crate) fn pair(self) -> &'static Pair {
        match self {
            Order::Five => &DORMAND_PRINCE_5,
            Order::Eight => &DOP853,
        }
    }
}

/// How free flight is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Flights {
    /// By power series where the force is linear ([`crate::Force::linear`]) and steps are adapted,
    /// else by the pair.
    #[default]
    Auto,
    /// By the embedded pair.
    RungeKutta,
    /// By power series to rounding; the force must be linear.
    Series,
}

impl Flights {
    /// The way of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "auto" => Some(Flights::Auto),
            "rk" => Some(Flights::RungeKutta),
            "series" => Some(Flights::Series),
            _ => None,
        }
    }

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Flights::Auto => "auto",
            Flights::RungeKutta => "rk",
            Flights::Series => "series",
        }
    }
}

/// The switched Runge-Kutta method: settings.
///
/// The local error of a step of the pair is kept below `atol_i + rtol |y_i|` in `x` (m) and `x'` (m/s), and the
/// estimated error of a Zeno time below
///
/// ```text
/// rtol T + min(atol_x/U, atol_x'/g),
/// ```
///
/// with `T` the time that the impacts before it took, `U` the largest of their speeds and `g` the
/// acceleration towards the wall at the last: the absolute tolerance over the duration of such a motion.
///
/// ```
/// use zivi::{Order, SwitchedRk};
/// let precise = SwitchedRk { rtol: 1e-10, atol: [1e-12; 2], ..SwitchedRk::default() };
/// assert!(precise.validated().is_ok());
/// let error = SwitchedRk { rtol: 0.0, ..precise }.validated().unwrap_err();
/// assert_eq!(error.to_string(), "rtol must be a number from 1e-14 to below 1, got 0.0");
/// assert_eq!(precise.order, Order::Eight);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SwitchedRk {
    /// Relative tolerance, from 1e-14 to below 1 (default 1e-6).
    pub rtol: f64,
    /// Absolute tolerances of `x` (m) and `x'` (m/s), positive and finite (default 1e-9 each).
    pub atol: [f64; 2],
    /// Order of the pair (default 8).
    pub order: Order,
    /// Longest step of the pair (s), positive, may be infinite (the default). Also the longest part
    /// of the motion that events sample in one, the longest look ahead at rest, and the longest time
    /// between two probes of the flights that a Zeno extrapolation would skip: a
    /// pulse of the force that is shorter can be overlooked.
    pub max_step: f64,
    /// The first step (s), positive and finite. `None` (the default): from the force and its
    /// change at the start, for one more evaluation.
    pub first_step: Option<f64>,
    /// Steps, taken and rejected, after which [`crate::Status::StepBudget`] ends the run, at least
    /// 1 (default 1 000 000).
    pub max_steps: usize,
    /// Impacts at falling speeds in one impact sequence, or without loss (`e = 1`) since the last rest, after
    /// which [`crate::Status::ZenoBudget`] ends the run, at least 3 (default 1 000 000). An impact sequence is
    /// followed for at most `30 / ln(1/e)` impacts, 30 000 for `e = 0.999`, and in practice for far
    /// fewer.
    pub max_impacts: usize,
    /// Whether steps are adapted to the tolerances (the default). If not, every step is
    /// `max_step` long, which must be finite then, and the tolerances only decide when a
    /// chain of impacts is ended: for studies of convergence.
    pub adaptive: bool,
    /// How free flight is computed.
    pub flights: Flights,
}

impl Default for SwitchedRk {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl SwitchedRk {
    /// Rounding errors of a position and a velocity of the size of the absolute tolerances.
    pub(crate) fn rounding(&self) -> [f64; 2] {
        self.atol.map(|atol| f64::EPSILON * atol)
    }

    /// Default of each setting.
    pub const DEFAULT: Self = Self {
        rtol: 1e-6,
        atol: [1e-9; 2],
        order: Order::Eight,
        max_step: f64::INFINITY,
        first_step: None,
        max_steps: 1_000_000,
        max_impacts: 1_000_000,
        adaptive: true,
        flights: Flights::Auto,
    };

    /// Relative tolerance.
    pub const RTOL: Setting = Setting {
        name: "rtol",
        meaning: "relative tolerance of a step",
        unit: "1",
        values: Values::Numbers(Bound::Included(1e-14), Bound::Excluded(1.0)),
        range: "a number from 1e-14 to below 1",
        default: Value::Number(Self::DEFAULT.rtol),
    };
    /// Absolute tolerances.
    pub const ATOL: Setting = Setting {
        name: "atol",
        meaning: "absolute tolerance of a step",
        unit: "m, m/s",
        values: Values::Pairs(Bound::Excluded(0.0), Bound::Excluded(f64::INFINITY)),
        range: "a finite number > 0",
        default: Value::Number(Self::DEFAULT.atol[0]),
    };
    /// Order of the pair.
    pub const ORDER: Setting = Setting {
        name: "order",
        meaning: "order of the Runge-Kutta pair",
        unit: "1",
        values: Values::Choice(&[Value::Count(8), Value::Count(5)]),
        range: "5 or 8",
        default: Value::Count(8),
    };
    /// Longest step.
    pub const MAX_STEP: Setting = Setting {
        name: "max_step",
        meaning: "longest step",
        unit: "s",
        values: Values::Numbers(Bound::Excluded(0.0), Bound::Included(f64::INFINITY)),
        range: "a time > 0, possibly infinite",
        default: Value::Number(Self::DEFAULT.max_step),
    };
    /// First step.
    pub const FIRST_STEP: Setting = Setting {
        name: "first_step",
        meaning: "first step",
        unit: "s",
        values: Values::POSITIVE,
        range: "a finite time > 0",
        default: Value::Open("from the force at the start"),
    };
    /// Budget of steps.
    pub const MAX_STEPS: Setting = Setting {
        name: "max_steps",
        meaning: "steps after which the run ends",
        unit: "1",
        values: Values::Counts(1, usize::MAX),
        range: "at least 1",
        default: Value::Count(Self::DEFAULT.max_steps),
    };
    /// Budget of impacts.
    pub const MAX_IMPACTS: Setting = Setting {
        name: "max_impacts",
        meaning: "impacts without a rest between them, after which the run ends",
        unit: "1",
        values: Values::Counts(3, usize::MAX),
        range: "at least 3",
        default: Value::Count(Self::DEFAULT.max_impacts),
    };
    /// Way of flight.
    pub const FLIGHTS: Setting = Setting {
        name: "flights",
        meaning: "how free flight is computed",
        unit: "",
        values: Values::Choice(&[Value::Name("auto"), Value::Name("rk"), Value::Name("series")]),
        range: "'auto', 'rk' or 'series'",
        default: Value::Name(Self::DEFAULT.flights.name()),
    };
    /// The settings.
    pub const SETTINGS: &'static [Setting] = &[
        Self::RTOL,
        Self::ATOL,
        Self::ORDER,
        Self::MAX_STEP,
        Self::FIRST_STEP,
        Self::MAX_STEPS,
        Self::MAX_IMPACTS,
        Self::FLIGHTS,
    ];

    /// The method with the values of its settings.
    ///
    /// # Errors
    /// [`SetupError`] where one is missing.
    pub fn of(values: &ReferencePoint) -> Result<Self, SetupError> {
        let order = i64::try_from(values.count(&Self::ORDER)?).ok().and_then(Order::of);
        Ok(Self {
            rtol: values.number(&Self::RTOL)?,
            atol: values.pair(&Self::ATOL)?,
            order: order.ok_or(SetupError::Unset(Self::ORDER.name, Self::ORDER.range))?,
            max_step: values.number(&Self::MAX_STEP)?,
            first_step: values.optional(&Self::FIRST_STEP)?,
            max_steps: values.count(&Self::MAX_STEPS)?,
            max_impacts: values.count(&Self::MAX_IMPACTS)?,
            adaptive: true,
            flights: values.choice(&Self::FLIGHTS, Flights::named)?,
        })
    }

    /// With one number for all tolerances.
    #[must_use]
    pub fn with_tol(tol: f64) -> Self {
        Self { rtol: tol, atol: [tol; 2], ..Self::default() }
    }

    /// The linear law for power-series flights under a force, unless these are disabled.
    pub(crate) fn law_of<E, F: Force<E>>(&self, force: &F) -> Option<LinearLaw> {
        match self.flights {
            Flights::RungeKutta => None,
            Flights::Auto if !self.adaptive => None,
            Flights::Auto | Flights::Series => force.linear(),
        }
    }

    pub(crate) fn tolerances(&self) -> Tolerances {
        Tolerances { rtol: self.rtol, atol: self.atol, rounding: 0.25 }
    }

    /// Step limits from these settings, with the given tolerances.
    pub(crate) fn limits(&self, tolerances: Tolerances) -> StepLimits {
        let Self { adaptive, max_step, max_steps, .. } = *self;
        StepLimits { adaptive, tolerances, max_step, max_steps }
    }

    /// Required accuracy of a Zeno time, `rtol T + min(atol_x/U, atol_x'/g)`, where `U` is the
    /// largest speed of an impact sequence that lasts `T`.
    pub(crate) fn zeno_tolerance<Z: Coordinates, K: Copy + PartialEq>(
        &self,
        chain: &Chain<Z, K>,
        pull: f64,
    ) -> f64 {
        let [atol_x, atol_xdot] = self.atol;
        let absolute = (atol_x / chain.fastest()).min(atol_xdot / pull);
        absolute + self.rtol * chain.duration()
    }

    /// The settings, if each of them is in its range.
    ///
    /// # Errors
    /// [`SetupError::Setting`] names the first that is not, its value and its range.
    pub fn validated(self) -> Result<Self, SetupError> {
        Self::RTOL.check(self.rtol)?;
        for atol in self.atol {
            Self::ATOL.check(atol)?;
        }
        Self::MAX_STEP.check(self.max_step)?;
        if !self.adaptive && !self.max_step.is_finite() {
            let range = "finite when steps are not adapted";
            return Err(SetupError::Setting("max_step", self.max_step, range));
        }
        self.first_step.map_or(Ok(()), |first| Self::FIRST_STEP.check(first))?;
        checked_count(&Self::MAX_STEPS, self.max_steps)?;
        checked_count(&Self::MAX_IMPACTS, self.max_impacts)?;
        Ok(self)
    }
}

// Options and results of a run.

/// Output options of a run, in addition to impacts, Zeno points and lift-offs.
pub struct Output<'a, E> {
    /// Times of the samples, increasing and within the span. `None`: a sample at the start, at
    /// the end of each step, at each impact (the state after it, with `x = 0`), Zeno point and
    /// lift-off, and at the end.
    pub t_eval: Option<&'a [f64]>,
    /// Times at which the force is not smooth (s), increasing: steps end there, the force is
    /// evaluated on either side but never across, and impact sequences and the search at rest
    /// restart.
    pub tstops: &'a [f64],
    /// Whether to keep the motion as a function of time.
    pub dense: bool,
    /// Whether, where that is kept and no times are given, there are samples between the steps,
    /// before impacts and at apexes too, so that lines through them draw the motion.
    pub drawn: bool,
    /// Whether the samples stay in the recorded form, [`SwitchedRun::rows`]: a long run that is
    /// stopped returns immediately; its columns are made at first access.
    pub in_rows: bool,
    /// The user's events.
    pub events: Vec<UserEvent<'a, E>>,
    /// Kicks at some of the declared times: a velocity into the wall is an immediate impact.
    pub kicks: Option<Kick<'a, E, PathPoint>>,
}

impl<E> Default for Output<'_, E> {
    fn default() -> Self {
        let (dense, drawn, in_rows) = (false, false, false);
        Self { t_eval: None, tstops: &[], dense, drawn, in_rows, events: Vec::new(), kicks: None }
    }
}

/// A run of the switched method.
#[derive(Clone, Debug, PartialEq)]
pub struct SwitchedRun<E> {
    /// Samples, impacts, Zeno points, lift-offs, status.
    pub trajectory: Trajectory,
    /// The error that the force, an event or the monitor raised (the status is
    /// [`crate::Status::Raised`] then).
    pub raised: Option<E>,
    /// The samples, instead of the columns of the trajectory, if [`Output::in_rows`] asked for them.
    pub rows: Option<Samples>,
    /// The motion as a function of time, if [`Output::dense`] asked for it.
    pub path: Option<DensePath>,
    /// The flights that jumps to rest skipped, in order.
    pub tails: Vec<Tail>,
    /// For each event of the user what happened, in order.
    pub hits: Vec<Vec<LocatedEvent>>,
    /// How much work was done.
    pub counts: Counts,
    /// The time and the state up to which the motion is known, whatever is sampled.
    pub end: (f64, Physical),
}

impl<E> SwitchedRun<E> {
    /// All impacts with a speed of at least `speed` (m/s) after them, those included that a jump
    /// to rest skipped, in order; at most `at_most` of each tail.
    ///
    /// ```
    /// use zivi::{
    ///     simulate_switched_rk, ConstantForce, Output, Physical, Restitution, Silent, SwitchedRk,
    /// };
    ///
    /// let (ball, restitution) = (Physical { x: 1.0, xdot: 0.0 }, Restitution::from_e(0.5)?);
    /// let run = simulate_switched_rk(
    ///     SwitchedRk::default(), restitution, &mut ConstantForce(-2.0), (0.0, 4.0), ball,
    ///     Output::default(), &mut Silent,
    /// )?;
    /// assert_eq!(run.trajectory.events.impacts.len(), 3);
    /// // 2 m/s at the first impact, 2^-20 m/s after the 21st
    /// assert_eq!(run.impacts_down_to(0.99 * 0.5f64.powi(20), 1000).len(), 21);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn impacts_down_to(&self, speed: f64, at_most: usize) -> Vec<Impact> {
        let fast = |impact: &Impact| impact.xdot_after >= speed;
        let mut all = Vec::new();
        let mut tails = self.tails.iter().peekable();
        for impact in &self.trajectory.events.impacts {
            while let Some(tail) = tails.next_if(|tail| tail.start() < impact.t) {
                all.extend(tail.impacts_down_to(speed, at_most));
            }
            all.extend(Some(*impact).filter(fast));
        }
        all.extend(tails.flat_map(|tail| tail.impacts_down_to(speed, at_most)));
        all
    }
}

// Impacts that go on without an accumulation.

/// Impacts below the tolerance in short sequence at a wall without acceleration towards it: if the
/// acceleration vanishes only at the wall, they accumulate, but not geometrically, and errors of
/// the size of the tolerance sustain them indefinitely.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct StallingImpacts {
    last: f64,
    /// The longest flight so far (s).
    longest: f64,
    count: u32,
}

impl StallingImpacts {
    /// Impacts after which it is called that.
    const MOST: u32 = 50;
    /// Ratio of a short flight to the longest.
    const SHORT: f64 = 0.01;

    pub(super) fn starting_at(t: f64) -> Self {
        Self { last: t, ..Self::default() }
    }

    /// Takes the next impact; whether it is one too many.
    pub(super) fn goes_on(&mut self, bounce: Bounce, speed: f64) -> bool {
        let flight = bounce.t - self.last;
        (self.last, self.longest) = (bounce.t, self.longest.max(flight));
        let stalls = bounce.g <= 0.0 && bounce.u <= speed && flight < Self::SHORT * self.longest;
        self.count = if stalls { self.count + 1 } else { 0 };
        self.count > Self::MOST
    }
}

// The samples of a run: at the ends of steps, at given times, or so that they draw the motion.

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
                    for t in t.chunks(TIMES_AT_ONCE) {
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

/// Some quantities of a curve at up to [`TIMES_AT_ONCE`] times.
#[inline(always)]
fn of_curve<const N: usize>(
    curve: &FlightCurve,
    t: &[f64],
    which: [Quantity; N],
    restitution: Restitution,
) -> [[f64; TIMES_AT_ONCE]; N] {
    let at = lanes(t);
    if let [only] = which[..] {
        match only {
            Quantity::X => return [curve.positions(&at); N],
            Quantity::Xdot => return [curve.velocities(&at); N],
            _ => (),
        }
    }
    let (x, xdot) = (curve.positions(&at), curve.velocities(&at));
    let mut values = [[0.0; TIMES_AT_ONCE]; N];
    for l in 0..TIMES_AT_ONCE {
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
                    for t in t.chunks(TIMES_AT_ONCE) {
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
fn lanes(t: &[f64]) -> [f64; TIMES_AT_ONCE] {
    let mut at = [t.last().copied().unwrap_or_default(); TIMES_AT_ONCE];
    at[..t.len()].copy_from_slice(t);
    at
}

/// The states of a curve at up to [`TIMES_AT_ONCE`] times.
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
