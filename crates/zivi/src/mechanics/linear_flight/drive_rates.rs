//! Derivatives of what drives a linear system by a parameter, as `a cos(w t + phi)` by `w` and `phi`.

use super::drives::{Drive, Drives};

impl Drives {
    /// The rates of these drives, where `self` has the derivatives of their numbers, at the time `t`,
    /// from where a step of length `h` begins.
    pub(super) fn write_rates(&self, of: &Self, t: f64, h: f64, out: &mut [f64]) {
        self.write(t, h, out);
        for ((of, rate), place) in of.pairs(self) {
            match (of, rate) {
                (Drive::Wave { omega, phase }, Drive::Wave { omega: faster, phase: ahead }) => {
                    let (sin, cos) = (omega * t + phase).sin_cos();
                    let turned = faster * t + ahead;
                    (out[place], out[place + 1]) = (-turned * sin, turned * cos);
                }
                (Drive::One, _) => out[place] = 0.0,
                _ => (),
            }
        }
    }

    /// Adds `factor D_p d`, where `self` has the derivatives of the numbers of `D`.
    pub(super) fn add_advance(&self, h: f64, factor: f64, d: &[f64], out: &mut [f64]) {
        for ((_, rate), place) in self.pairs(self) {
            if let Drive::Wave { omega, .. } = rate {
                let turn = factor * omega * h;
                out[place] -= turn * d[place + 1];
                out[place + 1] += turn * d[place];
            }
        }
    }

    /// Adds `r (D^2)_p`, where `self` has the derivatives of the numbers of the drives `of`.
    pub(super) fn add_differentiated_twice(&self, of: &Self, h: f64, r: &[f64], out: &mut [f64]) {
        for ((of, rate), place) in of.pairs(self) {
            if let (Drive::Wave { omega, .. }, Drive::Wave { omega: faster, .. }) = (of, rate) {
                let factor = -2.0 * omega * faster * h * h;
                (0..2).for_each(|k| out[place + k] += factor * r[place + k]);
            }
        }
    }

    /// Zeros for the weights of tables, whose derivatives are tables that have the same.
    pub(super) fn without_tables(&self, row: &mut [f64]) {
        for ((drive, _), place) in self.pairs(self) {
            if let Drive::Column { .. } = drive {
                row[place..][..drive.size()].fill(0.0);
            }
        }
    }

    /// Each drive with that of others, and where its numbers begin.
    fn pairs<'a>(
        &'a self,
        other: &'a Self,
    ) -> impl Iterator<Item = ((&'a Drive, &'a Drive), usize)> {
        let mut next = 0;
        let place = move |drive: &Drive| {
            next += drive.size();
            next - drive.size()
        };
        let places: Vec<usize> = self.all.iter().map(place).collect();
        self.all.iter().zip(&other.all).zip(places)
    }
}
