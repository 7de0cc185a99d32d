//! Contacts that rest with their reference and are held.

use super::kinetics::GapKinetics;
use crate::numeric::vector::dot;

/// What is closed without noise: a gap, and its rate.
pub const EXACT: [f64; 2] = [1e-9, 1e-9];
/// A gap within so many deviations of its measurement may be closed.
const DEVIATIONS: f64 = 20.0;
/// The same in steps of the sensor.
const STEPS: f64 = 5.0;
/// A contact is open after so many measurements beyond that.
const OUT: u32 = 5;
/// Largest offset of a wall that is learnt (m).
const FARTHEST: f64 = 5e-3;
/// A contact at a place that is not known is closed after at least so many measurements at rest, and
/// no fewer than in this multiple of the time in which a gap that flies would pick up the rate below
/// which it counts as resting.
const STILL: (f64, f64) = (5.0, 8.0);
/// How many measurements are averaged to the offset of a wall.
const MEAN: u32 = 500;

/// What is known of a sensor, of coordinates and of velocities.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Noise {
    /// Standard deviations.
    pub deviations: [f64; 2],
    /// Steps.
    pub steps: [f64; 2],
}

impl Noise {
    /// Gap and rate that noise gives a closed contact, for each unit of the length of its normal.
    #[must_use]
    pub fn of_contacts(&self) -> [f64; 2] {
        [0, 1].map(|k| (DEVIATIONS * self.deviations[k]).max(STEPS * self.steps[k]))
    }
}

/// Where walls are that are not where they are thought to be.
#[derive(Clone, Debug, PartialEq)]
pub struct Offsets {
    /// How much nearer than thought, by gap (m).
    pub by: Vec<f64>,
    /// Measurements that these are the mean of.
    pub seen: Vec<u32>,
    /// Measurements at rest in a row.
    pub still: Vec<u32>,
}

impl Offsets {
    fn none(m: usize) -> Self {
        Self { by: vec![0.0; m], seen: vec![0; m], still: vec![0; m] }
    }

    /// Takes over what is measured of a contact that is held.
    fn learn(&mut self, i: usize, gap: f64) {
        self.seen[i] = (self.seen[i] + 1).min(MEAN);
        let mean = self.by[i] + gap / f64::from(self.seen[i]);
        self.by[i] = mean.clamp(-FARTHEST, FARTHEST);
    }
}

/// Which contacts are held.
#[derive(Clone, Debug, PartialEq)]
pub struct Latch {
    /// By gap.
    pub held: Vec<bool>,
    /// Measurements in a row that were beyond.
    pub beyond: Vec<u32>,
    /// Of the walls.
    pub offsets: Offsets,
}

impl Latch {
    /// None of so many.
    #[must_use]
    pub fn open(m: usize) -> Self {
        Self { held: vec![false; m], beyond: vec![0; m], offsets: Offsets::none(m) }
    }

    /// Holds contacts that rest with their reference, and lets go of those that do not: whether one
    /// was lost. With `pulls`, the changes of the rates of gaps in flight by a period, walls may be
    /// elsewhere than thought: contacts are judged by their rates, and the gaps of those that are held
    /// are the offsets. `seen` are gaps and rates.
    pub(super) fn look(
        &mut self,
        kinetics: &GapKinetics,
        seen: (&[f64], &[f64]),
        resting: &[bool],
        within: Option<[f64; 2]>,
        noise: &Noise,
        pulls: Option<&[f64]>,
    ) -> bool {
        let Self { held, beyond, offsets } = self;
        let mut any = false;
        for (i, &rests) in resting.iter().enumerate() {
            let [near, slow] = within.unwrap_or_else(|| limits_of(kinetics, i, noise));
            let (gap, is_slow) = (seen.0[i], seen.1[i].abs() <= slow);
            let (stays, settles) = match pulls {
                None => (gap.abs() <= near, gap.abs() <= near && is_slow),
                Some(pulls) => {
                    let still = rests && is_slow && (gap + offsets.by[i]).abs() <= FARTHEST;
                    offsets.still[i] = if still { offsets.still[i].saturating_add(1) } else { 0 };
                    let enough = STILL.0.max(STILL.1 * slow / pulls[i]);
                    (is_slow, f64::from(offsets.still[i]) >= enough)
                }
            };
            let closes = rests && !held[i] && settles;
            beyond[i] = if held[i] && !stays { beyond[i] + 1 } else { 0 };
            let lost = held[i] && rests && beyond[i] >= OUT;
            any |= lost;
            held[i] = (held[i] && rests && !lost) || closes;
            if held[i] && stays && pulls.is_some() {
                offsets.learn(i, gap);
            }
        }
        any
    }
}

/// Below which gap and rate a contact may be closed, by the noise.
fn limits_of(kinetics: &GapKinetics, i: usize, noise: &Noise) -> [f64; 2] {
    let normal = kinetics.normal(i);
    let size = dot(normal, normal).sqrt();
    let by_noise = noise.of_contacts();
    [0, 1].map(|k| EXACT[k].max(size * by_noise[k]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::dynamics::Layout;

    #[test]
    fn a_contact_is_let_go_after_five_measurements_in_a_row_that_are_beyond() {
        let kinetics = GapKinetics::new(Layout::smooth(1, 1));
        let mut latch = Latch::open(1);
        let mut look = |gap: f64| {
            let (seen, within) = ((&[gap][..], &[0.0][..]), Some([1e-3, 1e-3]));
            let lost = latch.look(&kinetics, seen, &[true], within, &Noise::default(), None);
            (lost, latch.held[0], latch.beyond[0])
        };
        assert_eq!(look(5e-4), (false, true, 0));
        // one that is near again begins anew
        for k in (1..5).chain(0..=0).chain(1..5) {
            let gap = if k == 0 { 5e-4 } else { 2e-3 };
            assert_eq!(look(gap), (false, true, k));
        }
        let (lost, held, _) = look(2e-3);
        assert!(lost && !held);
    }
}
