//! The excitations of many linear forces at one time.

use crate::LinearForce;

use super::flight::{Lane, WIDTH};

/// Excitations; masses whose waves have the same frequency and phase share a cosine.
#[repr(C, align(64))] // lanes begin where vectors of the machine do
pub(super) struct Waves {
    amplitude: Lane,
    /// At the time that was asked for last.
    pub(super) excitation: Lane,
    /// Angular frequencies and phases, and which of them a mass has.
    angles: Vec<[f64; 2]>,
    which: [usize; WIDTH],
}

impl Waves {
    pub(super) fn of(forces: impl Iterator<Item = LinearForce>) -> Self {
        let (amplitude, excitation) = ([0.0; WIDTH], [0.0; WIDTH]);
        let mut waves = Self { amplitude, angles: Vec::new(), which: [0; WIDTH], excitation };
        for (i, LinearForce { amplitude, omega, phase, .. }) in forces.enumerate() {
            // a force without a wave takes part in any other's
            if amplitude != 0.0 {
                let same = |angle: &[f64; 2]| *angle == [omega, phase];
                waves.amplitude[i] = amplitude;
                waves.which[i] = waves.angles.iter().position(same).unwrap_or_else(|| {
                    waves.angles.push([omega, phase]);
                    waves.angles.len() - 1
                });
            }
        }
        waves
    }

    /// Goes to a time.
    #[inline(always)]
    pub(super) fn go_to(&mut self, t: f64) {
        let cosine = |[omega, phase]: [f64; 2]| (omega * t + phase).cos();
        match *self.angles {
            [] => (),
            [angle] => {
                let cosine = cosine(angle);
                for (it, amplitude) in self.excitation.iter_mut().zip(&self.amplitude) {
                    *it = amplitude * cosine;
                }
            }
            _ => {
                let mut cosines = [0.0; WIDTH];
                for (it, angle) in cosines.iter_mut().zip(&self.angles) {
                    *it = cosine(*angle);
                }
                for i in 0..WIDTH {
                    self.excitation[i] = self.amplitude[i] * cosines[self.which[i]];
                }
            }
        }
    }
}
