//! Settings of the switched method.

use crate::SetupError;

use crate::numeric::step_error::Tolerances;
use crate::numeric::tableau::{Pair, DOP853, DORMAND_PRINCE_5};

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
    /// of the motion that events look at in one, the longest look ahead at rest, and the longest time between two looks at the arcs that a jump to rest would skip: a
    /// pulse of the force that is shorter can be overlooked.
    pub max_step: f64,
    /// The first step (s), positive and finite. `None` (the default): from the force and its
    /// change at the start, for one more evaluation.
    pub first_step: Option<f64>,
    /// Steps, taken and rejected, after which [`crate::Status::StepBudget`] ends the run, at least
    /// 1 (default 1 000 000).
    pub max_steps: usize,
    /// Impacts at falling speeds in one chain after which [`crate::Status::ZenoBudget`] ends the
    /// run, at least 3 (default 1 000 000). A chain is followed to at most
    /// `30 / ln(1/e)` impacts, 30 000 for `e = 0.999`, and in practice to far fewer.
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
        Self {
            rtol: 1e-6,
            atol: [1e-9; 2],
            order: Order::Eight,
            max_step: f64::INFINITY,
            first_step: None,
            max_steps: 1_000_000,
            max_impacts: 1_000_000,
            adaptive: true,
            flights: Flights::default(),
        }
    }
}

impl SwitchedRk {
    /// With one number for all tolerances.
    #[must_use]
    pub fn with_tol(tol: f64) -> Self {
        Self { rtol: tol, atol: [tol; 2], ..Self::default() }
    }

    pub(crate) fn tolerances(&self) -> Tolerances {
        Tolerances { rtol: self.rtol, atol: self.atol, rounding: 0.25 }
    }

    /// The settings, if each of them is in its range.
    ///
    /// # Errors
    /// [`SetupError::Setting`] names the first that is not, its value and its range.
    pub fn validated(self) -> Result<Self, SetupError> {
        let positive = |value: f64| value > 0.0 && value.is_finite();
        let refuse = |name, value, range| Err(SetupError::Setting(name, value, range));
        if !(self.rtol >= 1e-14 && self.rtol < 1.0) {
            return refuse("rtol", self.rtol, "a number from 1e-14 to below 1");
        }
        if let Some(&atol) = self.atol.iter().find(|&&atol| !positive(atol)) {
            return refuse("atol", atol, "a finite number > 0");
        }
        if self.max_step.is_nan() || self.max_step <= 0.0 {
            return refuse("max_step", self.max_step, "a time > 0, possibly infinite");
        }
        if !self.adaptive && !self.max_step.is_finite() {
            return refuse("max_step", self.max_step, "finite when steps are not adapted");
        }
        if let Some(first) = self.first_step.filter(|&first| !positive(first)) {
            return refuse("first_step", first, "a finite time > 0");
        }
        if self.max_steps == 0 {
            return Err(SetupError::Count("max_steps", 0, "at least 1"));
        }
        if self.max_impacts < 3 {
            return Err(SetupError::Count("max_impacts", self.max_impacts, "at least 3"));
        }
        Ok(self)
    }
}
