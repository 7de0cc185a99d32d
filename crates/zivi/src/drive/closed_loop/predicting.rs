//! Controllers that know that their controls act late: each tick is one for the state of then.

use zivi_core::control::{DelayLine, TickStatus, TwistingRegulator, TwistingTracker, Waypoint};
use zivi_core::{Physical, Restitution, SettingError};

use super::solved::Solved;

/// Delayed controls between their sample and the time at which they act.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnderWay {
    /// The controls that do not act yet.
    pub controls: DelayLine<f64>,
    /// A reference of its own, from the sample until then.
    pub references: DelayLine<Physical>,
    /// Periods by which that is not ahead yet.
    pub due: usize,
}

impl UnderWay {
    /// An empty delay line of a length in periods.
    ///
    /// # Errors
    /// [`SettingError`] for a delay out of range.
    pub fn nothing(delay: usize) -> Result<Self, SettingError> {
        let references = DelayLine::new(delay, Physical::default())?;
        Ok(Self { controls: DelayLine::new(delay, 0.0)?, references, due: delay })
    }

    /// As before the first tick.
    pub fn forget(&mut self) {
        self.due = self.controls.periods();
        for _ in 0..self.due {
            self.controls.push(0.0);
            self.references.push(Physical::default());
        }
    }
}

/// A controller whose controls act late.
#[derive(Clone, Debug, PartialEq)]
pub struct Predicting<C> {
    /// The controller.
    pub controller: C,
    /// The delay line.
    pub under_way: Box<UnderWay>,
}

/// Interface of controllers for the prediction.
pub trait Predictable {
    /// Sampling period (s).
    fn h(&self) -> f64;
    /// The plant's wall.
    fn wall(&self) -> Restitution;
    /// The state of a measurement; true if clamped to the wall.
    ///
    /// # Errors
    /// [`SettingError`] for a sample that is refused.
    fn sense(&self, measured: Physical) -> Result<(Physical, bool), SettingError>;
    /// The last control.
    fn u(&self) -> f64;
    /// Records that the measurement was clamped to the wall.
    fn clamp(&mut self);
}

macro_rules! predictable {
    ($kind:ty, |$it:ident| $h:expr, $wall:expr) => {
        impl Predictable for Solved<$kind> {
            fn h(&self) -> f64 {
                let $it = &self.controller;
                $h
            }

            fn wall(&self) -> Restitution {
                let $it = &self.controller;
                $wall
            }

            fn sense(&self, measured: Physical) -> Result<(Physical, bool), SettingError> {
                self.controller.sense(measured)
            }

            fn u(&self) -> f64 {
                self.controller.state().u
            }

            fn clamp(&mut self) {
                let mut state = self.controller.state();
                state.status = TickStatus { clamped: true, ..state.status };
                self.controller.set_state(state);
            }
        }
    };
}

predictable!(TwistingRegulator, |it| it.step().h, it.step().restitution);
predictable!(TwistingTracker, |it| it.h(), it.restitution());

impl<C: Predictable> Predicting<C> {
    /// A tick for the state in which its control will act. Controls that were sent, including
    /// repeated ones after a rejected sample, are then in the delay line.
    pub(super) fn late<E: From<SettingError>>(
        &mut self,
        measured: Physical,
        force: f64,
        then: impl FnOnce(&mut C, Physical) -> Result<f64, E>,
    ) -> Result<f64, E> {
        let h = self.controller.h();
        let it = &mut self.controller;
        let done = match it.sense(measured) {
            Ok((state, clamped)) => {
                let state = self.under_way.controls.ahead(state, it.wall(), force, h);
                let done = then(it, state);
                if clamped && done.is_ok() {
                    it.clamp();
                }
                done
            }
            Err(error) => Err(error.into()),
        };
        self.under_way.controls.push(self.controller.u());
        done
    }
}

impl Predicting<Solved<TwistingRegulator>> {
    /// A period without a sample: the control is held.
    pub fn miss(&mut self) -> f64 {
        let u = self.controller.controller.miss();
        self.under_way.controls.push(u);
        u
    }
}

impl Predicting<Solved<TwistingTracker>> {
    /// Advances the reference under this force (m/s^2), if necessary.
    pub(super) fn bring_ahead(&mut self, force_ref: f64) -> Result<(), SettingError> {
        while self.under_way.due > 0 {
            self.one_ahead(force_ref)?;
        }
        Ok(())
    }

    /// Brings it ahead by one period.
    pub(super) fn one_ahead(&mut self, force_ref: f64) -> Result<(), SettingError> {
        let here = self.controller.controller.reference();
        self.controller.controller.miss(force_ref)?;
        self.under_way.references.push(here);
        self.under_way.due -= 1;
        Ok(())
    }

    /// A period without a sample: the control is held, the reference moves on.
    ///
    /// # Errors
    /// [`SettingError`] for a force that is not finite or too large.
    pub fn miss(&mut self, force_ref: f64) -> Result<f64, SettingError> {
        self.bring_ahead(force_ref)?;
        let here = self.controller.controller.reference();
        let u = self.controller.controller.miss(force_ref)?;
        self.under_way.references.push(here);
        self.under_way.controls.push(u);
        Ok(u)
    }

    /// The same of a reference that is given.
    ///
    /// # Errors
    /// [`SettingError`] for a waypoint that is not finite or has x < 0.
    pub fn miss_to(&mut self, next: Waypoint) -> Result<f64, SettingError> {
        let u = self.controller.controller.miss_to(next)?;
        self.under_way.due = 0;
        self.under_way.controls.push(u);
        Ok(u)
    }
}
