//! Objects of the models.

use zivi_c::{Mass, Observer, Regulator, Tracker};

/// Values of the largest model.
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
