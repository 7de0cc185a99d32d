//! The excitations of many linear forces at one time.

use zivi_core::cosine::{cos, turn_into_cosines};

use crate::LinearForce;

use super::flight::{Lane, WIDTH};

/// Excitations; masses whose waves have the same frequency and phase share a cosine.
#[repr(C, align(64))] // lanes begin where vectors of the machine do
pub(super) struct Waves {
    amplitude: Lane,
    /// At the time that was asked for last.
    pub(super) excitation: Lane,
    /// Angular frequencies and phases, the first so many, and which of them a mass has.
    omega: Lane,
    phase: Lane,
    different: usize,
    which: [usize; WIDTH],
}

impl Waves {
    pub(super) fn of(forces: impl Iterator<Item = LinearForce>) -> Self {
        let zero = [0.0; WIDTH];
        let mut waves = Self {
            amplitude: zero,
            excitation: zero,
            omega: zero,
            phase: zero,
            different: 0,
            which: [0; WIDTH],
        };
        for (i, LinearForce { amplitude, omega, phase, .. }) in forces.enumerate() {
            // a force without a wave takes part in any other's
            if amplitude != 0.0 {
                let n = waves.different;
                let known = waves.omega[..n].iter().zip(&waves.phase);
                let mut known = known.map(|(omega, phase)| [*omega, *phase]);
                let place = known.position(|angle| angle == [omega, phase]).unwrap_or(n);
                (waves.omega[place], waves.phase[place]) = (omega, phase);
                waves.different = n.max(place + 1);
                (waves.amplitude[i], waves.which[i]) = (amplitude, place);
            }
        }
        waves
    }

    /// Goes to a time.
    #[inline(always)]
    pub(super) fn go_to(&mut self, t: f64) {
        if self.different <= 1 {
            // none: times no amplitude
            let cosine = cos(self.omega[0] * t + self.phase[0]);
            for (it, amplitude) in self.excitation.iter_mut().zip(&self.amplitude) {
                *it = amplitude * cosine;
            }
            return;
        }
        // whole vectors of any machine
        let n = self.different.next_multiple_of(8).min(WIDTH);
        let mut cosines = [0.0; WIDTH];
        let angles = self.omega.iter().zip(&self.phase);
        for (it, (omega, phase)) in cosines[..n].iter_mut().zip(angles) {
            *it = omega * t + phase;
        }
        turn_into_cosines(&mut cosines[..n]);
        for i in 0..WIDTH {
            self.excitation[i] = self.amplitude[i] * cosines[self.which[i]];
        }
    }
}
