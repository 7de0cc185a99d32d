//! Linear mechanical systems of several coordinates, within linear gaps over walls that may move.
//!
//! ```text
//! M q'' + C q' + K q = p + sum_j p_j cos(w_j t + phi_j) + sum_j u_j(t)      g_i = n_i . q + c_i - w_i(t) >= 0
//! ```

use std::sync::Arc;

use crate::system::time_table::{weighted, TimeTable};
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
    #[inline]
    #[must_use]
    pub fn at(&self, t: f64) -> [f64; 3] {
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
    /// Whether loads and walls are as smooth as waves: no table has breakpoints in them.
    pub(crate) fn is_smooth(&self) -> bool {
        let is_table = |gap: &LinearGap| matches!(gap.motion, GapMotion::Table(_));
        self.tables.is_empty() && !self.gaps.iter().any(is_table)
    }

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

    /// A linear combination of systems number by number, as a difference of them is; none where they
    /// differ in more than numbers.
    #[must_use]
    pub fn combination(parts: &[(f64, &Self)]) -> Option<Self> {
        let first = parts.first()?.1;
        let sum = |of: fn(&Self) -> &[f64]| weighted(parts, of);
        let wave = |k: usize| {
            let amplitude = parts.iter().map(|(w, it)| Some((*w, &it.waves.get(k)?.amplitude[..])));
            Some(LoadWave {
                amplitude: weighted(&amplitude.collect::<Option<Vec<_>>>()?, |it| it)?,
                omega: parts.iter().map(|(w, it)| w * it.waves[k].omega).sum(),
                phase: parts.iter().map(|(w, it)| w * it.waves[k].phase).sum(),
            })
        };
        let table = |k: usize| {
            let tables = parts.iter().map(|(w, it)| Some((*w, &**it.tables.get(k)?)));
            TimeTable::combination(&tables.collect::<Option<Vec<_>>>()?).map(Arc::new)
        };
        let gap = |k: usize| {
            let gaps = parts.iter().map(|(w, it)| Some((*w, it.gaps.get(k)?)));
            LinearGap::combination(&gaps.collect::<Option<Vec<_>>>()?)
        };
        let alike = |it: &Self| {
            (it.waves.len(), it.tables.len(), it.gaps.len())
                == (first.waves.len(), first.tables.len(), first.gaps.len())
        };
        if !parts.iter().all(|(_, it)| alike(it)) {
            return None;
        }
        Some(Self {
            mass: sum(|it| &it.mass)?,
            damping: sum(|it| &it.damping)?,
            stiffness: sum(|it| &it.stiffness)?,
            load: sum(|it| &it.load)?,
            waves: (0..first.waves.len()).map(wave).collect::<Option<_>>()?,
            tables: (0..first.tables.len()).map(table).collect::<Option<_>>()?,
            gaps: (0..first.gaps.len()).map(gap).collect::<Option<_>>()?,
        })
    }
}

impl LinearGap {
    fn combination(parts: &[(f64, &Self)]) -> Option<Self> {
        let wall = |(w, it): &(f64, &Self)| match it.motion {
            GapMotion::Harmonic(wall) => Some((*w, wall)),
            _ => None,
        };
        let table = |(w, it): &(f64, &'_ Self)| match &it.motion {
            GapMotion::Table(table) => Some((*w, table.clone())),
            _ => None,
        };
        let motion = match parts.first()?.1.motion {
            GapMotion::Fixed if parts.iter().all(|(_, it)| it.motion == GapMotion::Fixed) => {
                GapMotion::Fixed
            }
            GapMotion::Fixed => return None,
            GapMotion::Harmonic(_) => {
                let walls = parts.iter().map(wall).collect::<Option<Vec<_>>>()?;
                let sum =
                    |of: fn(&HarmonicWall) -> f64| walls.iter().map(|(w, it)| w * of(it)).sum();
                GapMotion::Harmonic(HarmonicWall {
                    amplitude: sum(|it| it.amplitude),
                    omega: sum(|it| it.omega),
                    phase: sum(|it| it.phase),
                    offset: sum(|it| it.offset),
                })
            }
            GapMotion::Table(_) => {
                let tables = parts.iter().map(table).collect::<Option<Vec<_>>>()?;
                let parts: Vec<_> = tables.iter().map(|(w, it)| (*w, &**it)).collect();
                GapMotion::Table(Arc::new(TimeTable::combination(&parts)?))
            }
        };
        Some(Self {
            normal: weighted(parts, |it| &it.normal)?,
            offset: parts.iter().map(|(w, it)| w * it.offset).sum(),
            motion,
        })
    }
}
