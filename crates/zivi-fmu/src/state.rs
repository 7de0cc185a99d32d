//! Everything that changes while a model runs.

use zivi_c::{Mass, Observer, Regulator, Tracker};

use crate::table::MOST;

/// What an instance may be asked for.
pub(crate) mod mode {
    pub(crate) const INSTANTIATED: u32 = 0;
    pub(crate) const INITIALISATION: u32 = 1;
    pub(crate) const STEP: u32 = 2;
    pub(crate) const TERMINATED: u32 = 3;
}

/// Plain numbers without gaps between them: stored and restored as bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct State {
    /// The token of the model, 1, 2, ...
    pub(crate) model: u32,
    pub(crate) mode: u32,
    /// Whether an input was set since the last step.
    pub(crate) asked: u32,
    /// The code of the last tick.
    pub(crate) code: i32,
    /// By value reference.
    pub(crate) values: [f64; MOST],
    pub(crate) mass: Mass,
    pub(crate) regulator: Regulator,
    pub(crate) tracker: Tracker,
    pub(crate) observer: Observer,
}

impl State {
    pub(crate) fn value(&self, index: usize) -> f64 {
        self.values.get(index).copied().unwrap_or(f64::NAN)
    }

    pub(crate) fn put(&mut self, index: usize, value: f64) {
        if let Some(place) = self.values.get_mut(index) {
            *place = value;
        }
    }
}
