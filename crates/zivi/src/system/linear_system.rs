//! Linear mechanical systems of several coordinates, within linear gaps over walls that may move.
//!
//! ```text
//! M q'' + C q' + K q = p + sum_j p_j cos(w_j t + phi_j) + sum_j u_j(t)      g_i = n_i . q + c_i - w_i(t) >= 0
//! ```

use std::sync::Arc;

use crate::system::time_table::TimeTable;
use crate::{HarmonicWall, WallMotion};

/// A harmonic part of the load.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadWave {
    /// `p_j`, a number for each coordinate.
    pub amplitude: Vec<f64>,
    /// `w_j` (rad/s).
    pub omega: f64,
    /// `phi_j` (rad).
    pub phase: f64,
}

/// How the wall of a gap moves.
#[derive(Clone, Debug, PartialEq)]
pub enum GapMotion {
    /// It does not.
    Fixed,
    /// It vibrates.
    Harmonic(HarmonicWall),
    /// As the first column of a table.
    Table(Arc<TimeTable>),
}

impl GapMotion {
    /// `[w, w', w'']`.
    pub(crate) fn at(&self, t: f64) -> [f64; 3] {
        let of = |motion: Result<[f64; 3], std::convert::Infallible>| match motion {
            Ok(motion) => motion,
            Err(never) => match never {},
        };
        match self {
            Self::Fixed => [0.0; 3],
            Self::Harmonic(wall) => of({ *wall }.at(t)),
            Self::Table(table) => table.motion(t, 0),
        }
    }
}

/// A gap, `n . q + c - w(t)`.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearGap {
    /// `n`.
    pub normal: Vec<f64>,
    /// `c`.
    pub offset: f64,
    /// `w`.
    pub motion: GapMotion,
}

/// The matrices of a linear system, row by row, its loads and its gaps.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearSystem {
    /// `M`, symmetric and positive definite.
    pub mass: Vec<f64>,
    /// `C`.
    pub damping: Vec<f64>,
    /// `K`.
    pub stiffness: Vec<f64>,
    /// `p`, a number for each coordinate.
    pub load: Vec<f64>,
    /// The harmonic parts of the load.
    pub waves: Vec<LoadWave>,
    /// The parts of the load that are tables, of a column for each coordinate.
    pub tables: Vec<Arc<TimeTable>>,
    /// The gaps.
    pub gaps: Vec<LinearGap>,
}

impl LinearSystem {
    /// The same if its sizes fit together.
    #[must_use]
    pub fn validated(self) -> Option<Self> {
        let n = self.load.len();
        let square = |a: &[f64]| a.len() == n * n;
        let fits = n > 0
            && [&self.mass, &self.damping, &self.stiffness].iter().all(|a| square(a))
            && self.waves.iter().all(|wave| wave.amplitude.len() == n)
            && self.tables.iter().all(|table| table.width() == n)
            && self.gaps.iter().all(|gap| gap.normal.len() == n);
        fits.then_some(self)
    }
}
