//! Settings of the switched method.

use std::ops::Bound;

use zivi_core::setting::{Setting, Value, Values};

use crate::numeric::coordinates::Coordinates;
use crate::numeric::stages::Tolerances;
use crate::numeric::tableau::{Pair, DOP853, DORMAND_PRINCE_5};
use crate::piecewise::steps::StepLimits;
use crate::record::trajectory::{checked_count, SetupError};
use crate::record::values::Values as ReferencePoint;
use crate::zeno::chain::Chain;
use crate::{Force, LinearLaw};

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
/// pull at the last: what the absolute tolerances allow in the time of a motion as fast as that.
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
    /// between two probes of the arcs that a jump to rest would skip: a
    /// pulse of the force that is shorter can be overlooked.
    pub max_step: f64,
    /// The first step (s), positive and finite. `None` (the default): from the force and its
    /// change at the start, for one more evaluation.
    pub first_step: Option<f64>,
    /// Steps, taken and rejected, after which [`crate::Status::StepBudget`] ends the run, at least
    /// 1 (default 1 000 000).
    pub max_steps: usize,
    /// Impacts at falling speeds in one chain, or without loss (`e = 1`) since the last rest, after
    /// which [`crate::Status::ZenoBudget`] ends the run, at least 3 (default 1 000 000). A chain is
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
    /// largest speed of a chain that lasts `T`.
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
