//! Interface between systems and methods.

use zivi_core::setting::Setting;
use zivi_core::Restitution;

use crate::record::values::Values;
use crate::{AnyImpactLaw, Monitor, Physical, SetupError};

/// A mechanical system: its states, the options and the results of a run.
pub trait System<E> {
    /// Where a run starts.
    type State<'a>;
    /// Data to store.
    type Keep<'a>;
    /// Result of a run.
    type Run;
}

/// The settings of a method.
pub trait Settings {
    /// Rejects settings out of range.
    ///
    /// # Errors
    /// [`SetupError`] names the first that is.
    fn check(&self) -> Result<(), SetupError>;

    /// Rejects a start where no run of a mass above a wall can begin.
    ///
    /// # Errors
    /// [`SetupError`] names what is out of range.
    fn check_start(&self, initial: Physical, law: &AnyImpactLaw) -> Result<(), SetupError>;

    /// The step size (s) of a method of fixed steps.
    fn step(&self) -> Option<f64> {
        None
    }
}

/// Description of a method for generic user interfaces.
pub trait Listed: Settings + Sized {
    /// Its name.
    const NAME: &'static str;
    /// Its description in a few words.
    const MEANING: &'static str;
    /// Its settings.
    const SETTINGS: &'static [Setting];
    /// Whether it knows the motion at its steps only.
    const FIXED_STEPS: bool;
    /// Whether a mass may be below the wall at the end of a step.
    const PENETRATES: bool;

    /// The method with the values of its settings, whose ranges [`Settings::check`] knows.
    ///
    /// # Errors
    /// [`SetupError`] where one is missing.
    fn of(values: &Values) -> Result<Self, SetupError>;
}

/// A method that can run a system.
pub trait Method<E, S: System<E>>: Settings {
    /// Runs over a span, `(t0, t1)`, from a state.
    ///
    /// # Errors
    /// [`SetupError`] before anything is computed. Whatever goes wrong later is in the run's status.
    fn run(
        &self,
        system: S,
        span: (f64, f64),
        y0: S::State<'_>,
        keep: S::Keep<'_>,
        monitor: &mut impl Monitor<E>,
    ) -> Result<S::Run, SetupError>;
}

/// The coefficient of restitution that a scheme of fixed steps needs.
pub(crate) fn newton(law: &AnyImpactLaw) -> Result<Restitution, SetupError> {
    law.constant().ok_or(SetupError::Refused(
        "e must be a number, Newton's impact law: of the methods only SwitchedRK takes another",
    ))
}
