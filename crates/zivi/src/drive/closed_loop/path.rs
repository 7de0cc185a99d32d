//! The motion of the plant between samples, if it is kept.

use zivi_core::Lifted;

use crate::DensePath;

/// The motion of the plant between its samples.
#[derive(Clone, Debug, PartialEq)]
pub enum LoopPath {
    /// Exact, from each sample under this force and the control that is held.
    Ballistic(f64),
    /// That of the switched method.
    Switched(DensePath),
    /// `s` and `v` at the samples, linear between them.
    Lifted(Vec<Lifted>),
}
