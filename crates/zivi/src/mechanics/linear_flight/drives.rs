//! What drives a linear system, as the state of a linear equation of its own.
//!
//! ```text
//! 1' = 0      (cos, sin)' = W (-sin, cos)      (c_0, c_1, c_2, c_3)' = (c_1, 2 c_2, 3 c_3, 0)      W = w h
//! ```
//!
//! in the time `s = (t - t_0)/h` since the start of a step: a constant, a wave, a polynomial of a table.

use std::sync::Arc;

use crate::system::linear_system::{GapMotion, LinearSystem};
use crate::system::time_table::TimeTable;

/// One of them.
#[derive(Clone, Debug)]
pub(super) enum Drive {
    One,
    Wave { omega: f64, phase: f64 },
    Column { table: Arc<TimeTable>, column: usize },
}

/// What the rounding of a phase counts beside that of other numbers.
const TURNED: f64 = 1.0 / 64.0;

impl Drive {
    pub(super) fn size(&self) -> usize {
        match self {
            Self::One => 1,
            Self::Wave { .. } => 2,
            Self::Column { table, .. } => table.order(),
        }
    }
}

/// All of them, one after the other.
#[derive(Clone, Debug)]
pub(super) struct Drives {
    pub(super) all: Vec<Drive>,
    /// How many numbers they have.
    pub(super) size: usize,
}

/// Numbers that are multiplied with those of the drives.
type Weights = Vec<(usize, f64)>;

impl Drives {
    /// Those of a system: what each does to the loads of the coordinates, and to the walls of the
    /// gaps, by rows of weights.
    pub(super) fn of(system: &LinearSystem) -> (Self, Vec<Weights>, Vec<Weights>) {
        let n = system.load.len();
        let mut drives = Self { all: vec![Drive::One], size: 1 };
        let mut loads: Vec<Weights> = system.load.iter().map(|&p| vec![(0, p)]).collect();
        for wave in &system.waves {
            let place = drives.add(Drive::Wave { omega: wave.omega, phase: wave.phase });
            for (load, &p) in loads.iter_mut().zip(&wave.amplitude) {
                load.push((place, p));
            }
        }
        for table in &system.tables {
            for (column, load) in loads.iter_mut().enumerate().take(n) {
                let place = drives.add(Drive::Column { table: table.clone(), column });
                load.push((place, 1.0));
            }
        }
        let walls = system.gaps.iter().map(|gap| match &gap.motion {
            GapMotion::Fixed => vec![],
            GapMotion::Harmonic(wall) => {
                let place = drives.add(Drive::Wave { omega: wall.omega, phase: wall.phase });
                vec![(0, wall.offset), (place, wall.amplitude)]
            }
            GapMotion::Table(table) => {
                let drive = Drive::Column { table: table.clone(), column: 0 };
                vec![(drives.add(drive), 1.0)]
            }
        });
        let walls = walls.collect();
        (drives, loads, walls)
    }

    fn add(&mut self, drive: Drive) -> usize {
        let place = self.size;
        self.size += drive.size();
        self.all.push(drive);
        place
    }

    /// The highest angular frequency (rad/s).
    pub(super) fn highest(&self) -> f64 {
        let each = self.all.iter().map(|drive| match drive {
            Drive::Wave { omega, .. } => omega.abs(),
            _ => 0.0,
        });
        each.fold(0.0, f64::max)
    }

    /// Writes the state at the time `t`, from where a step of length `h` begins.
    pub(super) fn write(&self, t: f64, h: f64, out: &mut [f64]) {
        let mut place = 0;
        for drive in &self.all {
            let out = &mut out[place..][..drive.size()];
            place += out.len();
            match drive {
                Drive::One => out[0] = 1.0,
                Drive::Wave { omega, phase } => {
                    (out[1], out[0]) = (omega * t + phase).sin_cos();
                }
                Drive::Column { table, column } => {
                    table.expansion(t, *column, out);
                    let mut power = 1.0;
                    for c in out {
                        *c *= power;
                        power *= h;
                    }
                }
            }
        }
    }

    /// The sizes `|d|` as they bound the rounding of the drives at `t`, in units of that of a number.
    pub(super) fn enlarge(&self, t: f64, sizes: &mut [f64]) {
        let mut place = 0;
        for drive in &self.all {
            let sizes = &mut sizes[place..][..drive.size()];
            place += sizes.len();
            if let Drive::Wave { omega, .. } = drive {
                sizes.fill(1.0 + TURNED * (omega * t).abs());
            }
        }
    }

    /// `d <- factor d'`.
    pub(super) fn advance(&self, h: f64, factor: f64, d: &mut [f64]) {
        let mut place = 0;
        for drive in &self.all {
            let d = &mut d[place..][..drive.size()];
            place += d.len();
            match drive {
                Drive::One => d[0] = 0.0,
                Drive::Wave { omega, .. } => {
                    let turn = factor * omega * h;
                    (d[0], d[1]) = (-turn * d[1], turn * d[0]);
                }
                Drive::Column { .. } => {
                    for k in 0..d.len() {
                        let next = d.get(k + 1).copied().unwrap_or(0.0);
                        d[k] = factor * (k + 1) as f64 * next;
                    }
                }
            }
        }
    }

    /// `r <- r D`: the weights that give the derivative of what the weights `r` give.
    pub(super) fn differentiate(&self, h: f64, r: &mut [f64]) {
        let mut place = 0;
        for drive in &self.all {
            let r = &mut r[place..][..drive.size()];
            place += r.len();
            match drive {
                Drive::One => r[0] = 0.0,
                Drive::Wave { omega, .. } => (r[0], r[1]) = (omega * h * r[1], -omega * h * r[0]),
                Drive::Column { .. } => {
                    for k in (0..r.len()).rev() {
                        r[k] = if k > 0 { k as f64 * r[k - 1] } else { 0.0 };
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::vector::dot;

    #[test]
    fn the_weights_of_a_derivative_are_those_of_a_difference() {
        let table = TimeTable::new(vec![0.0, 2.0], vec![0.3, -0.7, 1.1, 0.4], (4, 1), None);
        let table = Arc::new(table.unwrap());
        let mut drives = Drives { all: vec![Drive::One], size: 1 };
        drives.add(Drive::Wave { omega: 3.0, phase: 0.4 });
        drives.add(Drive::Column { table, column: 0 });
        let (t, h, weights) = (0.6, 0.25, [0.5, -1.2, 0.8, 1.3, -0.4, 0.9, -0.7]);
        let at = |s: f64| {
            let mut d = [0.0; 7];
            drives.write(t + h * s, h, &mut d);
            d
        };
        // of fourth order: exact for the cubic
        let step = 1e-3;
        let pair = |k: f64| dot(&weights, &at(k * step)) - dot(&weights, &at(-k * step));
        let exact = (8.0 * pair(1.0) - pair(2.0)) / (12.0 * step);
        let (mut rates, mut slopes) = (weights, at(0.0));
        drives.differentiate(h, &mut rates);
        drives.advance(h, 1.0, &mut slopes);
        for found in [dot(&rates, &at(0.0)), dot(&weights, &slopes)] {
            assert!((found - exact).abs() < 1e-11, "{found} {exact}");
        }
    }
}
