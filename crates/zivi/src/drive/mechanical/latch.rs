//! Contacts that rest with their reference and are held.

use super::kinetics::GapKinetics;
use crate::numeric::vector::dot;

/// What is closed without noise: a gap, and its rate.
const EXACT: [f64; 2] = [1e-9, 1e-9];
/// A gap within so many deviations of its measurement may be closed.
const DEVIATIONS: f64 = 20.0;
/// The same in steps of the sensor.
const STEPS: f64 = 5.0;
/// A contact is open after so many measurements beyond that.
const OUT: u32 = 5;

/// What is known of a sensor, of coordinates and of velocities.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Noise {
    /// Standard deviations.
    pub deviations: [f64; 2],
    /// Steps.
    pub steps: [f64; 2],
}

/// Which contacts are held.
#[derive(Clone, Debug, PartialEq)]
pub struct Latch {
    /// By gap.
    pub held: Vec<bool>,
    /// Measurements in a row that were beyond.
    pub beyond: Vec<u32>,
}

impl Latch {
    /// None of so many.
    #[must_use]
    pub fn open(m: usize) -> Self {
        Self { held: vec![false; m], beyond: vec![0; m] }
    }

    /// Holds contacts that rest with their reference, and lets go of those that do not: whether one
    /// was lost.
    pub(super) fn look(
        &mut self,
        kinetics: &GapKinetics,
        resting: &[bool],
        within: Option<[f64; 2]>,
        noise: &Noise,
    ) -> bool {
        let mut any = false;
        for (i, &rests) in resting.iter().enumerate() {
            let [near, slow] = within.unwrap_or_else(|| {
                let normal = kinetics.normal(i);
                let size = dot(normal, normal).sqrt();
                let part = |k: usize| {
                    let Noise { deviations, steps } = noise;
                    EXACT[k].max(size * (DEVIATIONS * deviations[k]).max(STEPS * steps[k]))
                };
                [part(0), part(1)]
            });
            let at = kinetics.gaps()[i].abs() <= near;
            let closes = rests && !self.held[i] && at && kinetics.rates[i].abs() <= slow;
            self.beyond[i] = if self.held[i] && !at { self.beyond[i] + 1 } else { 0 };
            let lost = self.held[i] && rests && self.beyond[i] >= OUT;
            any |= lost;
            self.held[i] = (self.held[i] && rests && !lost) || closes;
        }
        any
    }
}
