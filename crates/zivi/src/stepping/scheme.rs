//! What a new scheme of fixed steps brings: its settings, and how it runs over a grid.

use zivi_core::setting::Setting;
use zivi_core::{Physical, Restitution};

use crate::record::trajectory::{Run, SetupError};
use crate::record::values::Values;
use crate::stepping::fixed_step::lift;
use crate::{Force, Grid, Monitor};

/// A scheme of fixed steps: its settings beside the step size.
///
/// One that advances `(s, v)` implements [`FixedStep`](super::fixed_step::FixedStep) and leaves the
/// loop to [`fixed_step::run`](super::fixed_step::run). [`FixedSteps`] makes it a
/// [`Method`](crate::method::Method).
pub trait Scheme: Sized {
    /// Its name, as programs and files have it.
    const NAME: &'static str;

    /// What it is, in a few words.
    const MEANING: &'static str;

    /// Its settings, the step size first.
    const SETTINGS: &'static [Setting];

    /// Whether a mass may be below the wall at the end of a step.
    const PENETRATES: bool = false;

    /// The scheme with the values of its settings.
    ///
    /// # Errors
    /// [`SetupError`] where one is missing.
    fn of(values: &Values) -> Result<Self, SetupError>;

    /// Refuses settings, a step size or a wall out of range.
    ///
    /// # Errors
    /// [`SetupError`] names what is out of range.
    fn check(&self, h: f64, restitution: Restitution) -> Result<(), SetupError>;

    /// Refuses a state where no run can start: one that has no finite image `(s, v)`.
    ///
    /// # Errors
    /// [`SetupError`] names what is out of range.
    fn check_start(&self, initial: Physical, restitution: Restitution) -> Result<(), SetupError> {
        lift(initial, restitution).map(drop)
    }

    /// Runs over a grid.
    ///
    /// # Errors
    /// [`SetupError`] before anything is computed. Whatever goes wrong later is in the status.
    fn run<E, F: Force<E>>(
        &self,
        restitution: Restitution,
        force: &mut F,
        grid: Grid,
        initial: Physical,
        monitor: &mut impl Monitor<E>,
    ) -> Result<Run<E>, SetupError>;
}

/// A scheme with its step size: all of its settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FixedSteps<S> {
    /// Step size (s), positive and finite; the last step of a run may be shorter.
    pub h: f64,
    /// The scheme.
    pub scheme: S,
}

impl<S> FixedSteps<S> {
    /// The steps over a span.
    ///
    /// # Errors
    /// [`SetupError::Grid`] for a span without steps.
    pub fn grid(&self, (t0, t1): (f64, f64)) -> Result<Grid, SetupError> {
        Ok(Grid::new(t0, t1, self.h)?)
    }
}
