//! Interface of controllers for the sampled loop, with the controllers of `zivi_core`.

use super::predicting::{Predictable, Predicting};
use super::reference::ReferencePeriod;
use super::solved::Solved;
use zivi_core::control::regulation::RegulationStep;
use zivi_core::control::{ExplicitTwisting, TickStatus, TwistingRegulator, TwistingTracker};
use zivi_core::{Physical, SettingError};

/// Number of signs that are recorded: `ls, lv, lsr, lvr, les, lev`.
pub const SIGNS: usize = 6;

/// Input of a controller at a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tick {
    /// The time of the sample (s).
    pub t: f64,
    /// The measured state.
    pub measured: Physical,
    /// The force on the mass in the controller's model (m/s^2).
    pub force: f64,
    /// The force on its reference (m/s^2).
    pub force_ref: f64,
}

/// Why a tick gave no control.
#[derive(Clone, Debug, PartialEq)]
pub enum TickError<E> {
    /// The sample was refused; the last control stays and the run continues.
    Refused(SettingError),
    /// The controller raised an error; the run ends.
    Raised(E),
}

impl<E> From<SettingError> for TickError<E> {
    fn from(error: SettingError) -> Self {
        TickError::Refused(error)
    }
}

/// A sampled controller.
pub trait Controller<E> {
    /// The control (m/s^2) for the period that starts now; a reference inside advances by one
    /// period.
    ///
    /// # Errors
    /// [`TickError`]: the sample was refused, or the controller raised an error.
    fn tick(&mut self, tick: Tick) -> Result<f64, TickError<E>>;

    /// The control for the period that starts now, for a reference that is given.
    ///
    /// # Errors
    /// As [`Controller::tick`]; a controller that follows no given reference refuses.
    fn tick_to(&mut self, _: Tick, _: ReferencePeriod) -> Result<f64, TickError<E>> {
        let text = "a controller that follows one";
        Err(TickError::Refused(SettingError { name: "reference", value: f64::NAN, range: text }))
    }

    /// The present reference, if any.
    fn reference(&self) -> Option<Physical> {
        None
    }

    /// Periods after which it knows its controls to act.
    fn delay(&self) -> usize {
        0
    }

    /// The reference then, which is that many periods ahead of [`Controller::reference`].
    fn reference_ahead(&self) -> Option<Physical> {
        self.reference()
    }

    /// Periods by which its own reference is not that far ahead yet, before the first tick.
    fn due(&self) -> usize {
        0
    }

    /// Brings the reference ahead by one of them, under this force (m/s^2).
    ///
    /// # Errors
    /// [`SettingError`] for a force that is not finite or too large.
    fn bring_ahead(&mut self, _: f64) -> Result<(), SettingError> {
        Ok(())
    }

    /// Whether its updates require the force on the reference.
    fn takes_force_ref(&self) -> bool {
        true
    }

    /// The signs of the last tick (NaN where it has none).
    fn signs(&self) -> [f64; SIGNS] {
        [f64::NAN; SIGNS]
    }

    /// Status of the last update.
    fn status(&self) -> TickStatus {
        TickStatus::default()
    }

    /// The implicit step of the closed system, (12)-(13), whose signs its control is made of, if
    /// the plant takes it as well in the paper's loop.
    fn closed_step(&self) -> Option<RegulationStep> {
        None
    }
}

impl<E> Controller<E> for Solved<TwistingRegulator> {
    fn tick(&mut self, tick: Tick) -> Result<f64, TickError<E>> {
        Ok(Solved::<TwistingRegulator>::tick(self, tick.measured, tick.force)?)
    }

    fn signs(&self) -> [f64; SIGNS] {
        Controller::<E>::signs(&self.controller)
    }

    fn status(&self) -> TickStatus {
        self.controller.state().status
    }

    fn closed_step(&self) -> Option<RegulationStep> {
        Controller::<E>::closed_step(&self.controller)
    }
}

impl<E> Controller<E> for TwistingRegulator {
    fn tick(&mut self, tick: Tick) -> Result<f64, TickError<E>> {
        Ok(TwistingRegulator::tick(self, tick.measured, tick.force)?)
    }

    fn signs(&self) -> [f64; SIGNS] {
        let [lambda_s, lambda_v] = self.state().signs;
        let none = f64::NAN;
        [lambda_s, lambda_v, none, none, none, none]
    }

    fn status(&self) -> TickStatus {
        self.state().status
    }

    fn closed_step(&self) -> Option<RegulationStep> {
        self.landing().is_none().then(|| *self.step())
    }
}

/// The controllers with a reference have one interface.
macro_rules! controller_with_reference {
    ($controller:ty, $it:ident, $inner:expr $(, $tick_to:item)?) => {
        impl<E> Controller<E> for $controller {
            fn tick(&mut self, tick: Tick) -> Result<f64, TickError<E>> {
                Ok(<$controller>::tick(self, tick.measured, tick.force, tick.force_ref)?)
            }

            $($tick_to)?

            fn reference(&self) -> Option<Physical> {
                let $it = self;
                Some($inner.reference())
            }

            fn signs(&self) -> [f64; SIGNS] {
                let $it = self;
                $inner.state().signs
            }

            fn status(&self) -> TickStatus {
                let $it = self;
                $inner.state().status
            }
        }
    };
}

controller_with_reference!(
    TwistingTracker,
    it,
    it,
    fn tick_to(&mut self, tick: Tick, course: ReferencePeriod) -> Result<f64, TickError<E>> {
        let (Tick { measured, force, .. }, ReferencePeriod { now, next, acceleration }) =
            (tick, course);
        Ok(TwistingTracker::tick_to(self, measured, force, now, next, acceleration)?)
    }
);
controller_with_reference!(ExplicitTwisting, it, it);
controller_with_reference!(
    Solved<TwistingTracker>,
    it,
    it.controller,
    fn tick_to(&mut self, tick: Tick, course: ReferencePeriod) -> Result<f64, TickError<E>> {
        let (Tick { measured, force, .. }, ReferencePeriod { now, next, acceleration }) =
            (tick, course);
        Ok(Solved::<TwistingTracker>::tick_to(self, measured, force, [now, next], acceleration)?)
    }
);
controller_with_reference!(Solved<ExplicitTwisting>, it, it.controller);

impl<E> Controller<E> for Predicting<Solved<TwistingRegulator>> {
    fn tick(&mut self, tick: Tick) -> Result<f64, TickError<E>> {
        self.late(tick.measured, tick.force, |it, measured| {
            Controller::<E>::tick(it, Tick { measured, ..tick })
        })
    }

    fn signs(&self) -> [f64; SIGNS] {
        Controller::<E>::signs(&self.controller)
    }

    fn status(&self) -> TickStatus {
        Controller::<E>::status(&self.controller)
    }

    fn delay(&self) -> usize {
        self.under_way.controls.periods()
    }
}

impl<E> Controller<E> for Predicting<Solved<TwistingTracker>> {
    fn tick(&mut self, tick: Tick) -> Result<f64, TickError<E>> {
        let ready = Self::bring_ahead(self, tick.force_ref);
        let here = self.controller.controller.reference();
        let done = self.late(tick.measured, tick.force, |it, measured| {
            ready?;
            Controller::<E>::tick(it, Tick { measured, ..tick })
        });
        if done.is_ok() {
            self.under_way.references.push(here);
        }
        done
    }

    fn tick_to(&mut self, tick: Tick, course: ReferencePeriod) -> Result<f64, TickError<E>> {
        self.under_way.due = 0;
        self.late(tick.measured, tick.force, |it, measured| {
            Controller::<E>::tick_to(it, Tick { measured, ..tick }, course)
        })
    }

    fn reference(&self) -> Option<Physical> {
        match self.under_way.due {
            0 => self.under_way.references.oldest(),
            _ => Some(self.controller.controller.reference()),
        }
    }

    fn reference_ahead(&self) -> Option<Physical> {
        Some(self.controller.controller.reference())
    }

    fn signs(&self) -> [f64; SIGNS] {
        Controller::<E>::signs(&self.controller)
    }

    fn status(&self) -> TickStatus {
        Controller::<E>::status(&self.controller)
    }

    fn delay(&self) -> usize {
        self.under_way.controls.periods()
    }

    fn due(&self) -> usize {
        self.under_way.due
    }

    fn bring_ahead(&mut self, force_ref: f64) -> Result<(), SettingError> {
        self.one_ahead(force_ref)
    }
}

/// All controllers: of each its meaning, the name of its variant, its type and its sampling period.
macro_rules! controllers {
    ($($meaning:literal $name:ident($kind:ty), |$it:ident| $h:expr;)*) => {
        /// One of the controllers of `zivi_core`.
        #[derive(Clone, Debug, PartialEq)]
        pub enum AnyController {
            $(#[doc = $meaning] $name($kind),)*
        }

        impl AnyController {
            /// Sampling period (s).
            #[must_use]
            pub fn h(&self) -> f64 {
                match self {
                    $(AnyController::$name($it) => $h,)*
                }
            }

            /// The controller itself, for frequent calls.
            pub fn dynamic<E>(&mut self) -> &mut (dyn Controller<E> + Send) {
                match self {
                    $(AnyController::$name(it) => it,)*
                }
            }

            fn inner<E>(&self) -> &dyn Controller<E> {
                match self {
                    $(AnyController::$name(it) => it,)*
                }
            }
        }

        impl<E> Controller<E> for AnyController {
            fn tick(&mut self, tick: Tick) -> Result<f64, TickError<E>> {
                match self {
                    $(AnyController::$name(it) => Controller::<E>::tick(it, tick),)*
                }
            }

            fn tick_to(&mut self, tick: Tick, course: ReferencePeriod) -> Result<f64, TickError<E>> {
                match self {
                    $(AnyController::$name(it) => Controller::<E>::tick_to(it, tick, course),)*
                }
            }

            fn reference(&self) -> Option<Physical> {
                self.inner::<E>().reference()
            }

            fn signs(&self) -> [f64; SIGNS] {
                self.inner::<E>().signs()
            }

            fn status(&self) -> TickStatus {
                self.inner::<E>().status()
            }

            fn delay(&self) -> usize {
                self.inner::<E>().delay()
            }

            fn reference_ahead(&self) -> Option<Physical> {
                self.inner::<E>().reference_ahead()
            }

            fn due(&self) -> usize {
                self.inner::<E>().due()
            }

            fn bring_ahead(&mut self, force_ref: f64) -> Result<(), SettingError> {
                match self {
                    $(AnyController::$name(it) => Controller::<E>::bring_ahead(it, force_ref),)*
                }
            }

            fn closed_step(&self) -> Option<RegulationStep> {
                self.inner::<E>().closed_step()
            }
        }
    };
}

controllers! {
    "The regulator." Regulator(TwistingRegulator), |it| it.step().h;
    "The implicit tracker." Tracker(TwistingTracker), |it| it.h();
    "The explicit baseline." Explicit(ExplicitTwisting), |it| it.h();
    "The regulator with a general solver." SolvedRegulator(Solved<TwistingRegulator>),
        |it| it.controller.step().h;
    "The tracker with a general solver." SolvedTracker(Solved<TwistingTracker>),
        |it| it.controller.h();
    "The regulator whose controls act late." LateRegulator(Predicting<Solved<TwistingRegulator>>),
        |it| it.controller.h();
    "The tracker whose controls act late." LateTracker(Predicting<Solved<TwistingTracker>>),
        |it| it.controller.h();
}
