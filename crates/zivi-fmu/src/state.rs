//! Everything that changes while a model runs.

use crate::table::{DataType, Role, ScalarVariable};

/// Objects of the models, and the number of values of the largest.
#[cfg(not(feature = "loops"))]
mod objects {
    use zivi_c::{Mass, Observer, Regulator, Tracker};

    pub(crate) const MOST: usize = 40;

    /// The objects of all models.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, Default)]
    pub(crate) struct Objects {
        pub(crate) mass: Mass,
        pub(crate) regulator: Regulator,
        pub(crate) tracker: Tracker,
        pub(crate) observer: Observer,
    }
}

/// Objects of a loop, and the number of values of the largest.
#[cfg(feature = "loops")]
mod objects {
    pub(crate) const MOST: usize = 512;
    /// Numbers of the largest state.
    pub(crate) const ROOM: usize = 1024;

    /// Numbers that change from period to period.
    #[repr(C)]
    #[derive(Clone, Copy, Debug)]
    pub(crate) struct Objects {
        pub(crate) numbers: [f64; ROOM],
    }

    impl Default for Objects {
        fn default() -> Self {
            Self { numbers: [0.0; ROOM] }
        }
    }
}

pub(crate) use objects::*;

/// The mode of an instance.
pub(crate) mod mode {
    pub(crate) const INSTANTIATED: u32 = 0;
    pub(crate) const INITIALISATION: u32 = 1;
    pub(crate) const STEP: u32 = 2;
    pub(crate) const TERMINATED: u32 = 3;
}

/// Plain numbers without gaps between them: stored and restored as bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct FmuState {
    /// The token of the model, 1, 2, ...
    pub(crate) model: u32,
    pub(crate) mode: u32,
    /// Whether an input was set since the last step.
    pub(crate) asked: u32,
    /// The code of the last update.
    pub(crate) code: i32,
    /// By value reference.
    pub(crate) values: [f64; MOST],
    pub(crate) objects: Objects,
}

impl FmuState {
    /// As after instantiation.
    pub(crate) fn new(model: u32, table: &[ScalarVariable]) -> Self {
        let mut values = [0.0; MOST];
        for (value, variable) in values.iter_mut().zip(table) {
            *value = variable.start;
        }
        Self {
            model,
            mode: mode::INSTANTIATED,
            asked: 1,
            code: 0,
            values,
            objects: Objects::default(),
        }
    }

    /// The variable with this reference, if it is of this kind; what an output is now.
    pub(crate) fn get(
        &self,
        table: &[ScalarVariable],
        reference: u32,
        kind: DataType,
    ) -> Option<f64> {
        let variable = table.get(reference as usize)?;
        (variable.kind == kind).then(|| self.value(reference as usize))
    }

    /// Sets a variable where that is allowed.
    pub(crate) fn set(
        &mut self,
        table: &[ScalarVariable],
        reference: u32,
        kind: DataType,
        value: f64,
    ) -> bool {
        let Some(variable) = table.get(reference as usize) else { return false };
        let now = match variable.role {
            Role::Input => self.mode != mode::TERMINATED,
            Role::Parameter => self.mode < mode::STEP,
            Role::Time | Role::Output => false,
        };
        if variable.kind != kind || !now {
            return false;
        }
        self.put(reference as usize, value);
        self.asked = 1;
        true
    }

    pub(crate) fn value(&self, index: usize) -> f64 {
        self.values.get(index).copied().unwrap_or(f64::NAN)
    }

    pub(crate) fn put(&mut self, index: usize, value: f64) {
        if let Some(place) = self.values.get_mut(index) {
            *place = value;
        }
    }
}

// Communication steps: how they are rejected, and how they are cut.

/// How a communication step is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StepRefusal {
    /// It is not a positive number, or has too many steps of `h`.
    Length,
    /// It is not a multiple of `h`.
    Multiple,
    /// The state after a step of the mass is not finite.
    Code(i32),
}

/// A communication step in equal parts.
pub(crate) struct Parts {
    pub(crate) count: u64,
    #[cfg_attr(feature = "loops", allow(dead_code, reason = "a loop keeps its period"))]
    pub(crate) h: f64,
    /// Whether it is a multiple of the step size asked for.
    pub(crate) whole: bool,
}

impl Parts {
    /// As many parts as steps `h` fit, each exactly `h` where the length is a multiple of it, else
    /// a little shorter.
    pub(crate) fn of(length: f64, h: f64) -> Result<Self, StepRefusal> {
        const MOST: f64 = 1e9;
        let ratio = length / h;
        if !(ratio > 0.0 && ratio <= MOST) {
            return Err(StepRefusal::Length);
        }
        let nearest = (ratio + 0.5) as u64;
        if nearest >= 1 && (ratio - nearest as f64).abs() <= 1e-6 {
            return Ok(Self { count: nearest, h, whole: true });
        }
        let count = ratio as u64 + 1;
        Ok(Self { count, h: length / count as f64, whole: false })
    }
}
