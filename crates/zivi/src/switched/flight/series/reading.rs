//! The waves of a flight from step to step.

use super::law::Linear;
use super::table::Table;
use super::terms::WAVES;
use crate::numeric::turns::Phase;

/// Whole steps over which waves are turned by what the table says before they are read off the
/// clock again.
const TURNED: u32 = 16;

/// The waves at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Reading {
    pub(crate) waves: [[f64; 2]; WAVES],
    /// Phase of the first wave when they were read.
    phase: Phase,
    /// Whole steps since then.
    turned: u32,
}

impl Reading {
    /// At a phase of the first wave that stands for a time, and what rounding leaves out of it.
    #[inline]
    pub(crate) fn new(linear: &Linear, phase: Phase, (t, late): (f64, f64)) -> Self {
        let first = linear.first().map_or([0.0; 2], |wave| wave.at(phase));
        let second = linear.second().map_or([0.0; 2], |wave| wave.at(wave.clock.phase(t, late)));
        Self { waves: [first, second], phase, turned: 0 }
    }

    /// The phase of the first wave after some steps more.
    #[inline]
    pub(crate) fn phase(&self, length: f64, table: &Table) -> Phase {
        let ([high, low], whole) = (table.turns_in_two(), f64::from(self.turned));
        // the products of the whole steps are exact
        self.phase.after(whole * high).after(whole * low + length * (high + low))
    }

    /// After some steps with `W` waves, at the end of which the time is `at`.
    #[inline(always)]
    pub(crate) fn after<const W: usize>(
        &self,
        length: f64,
        at: (f64, f64),
        linear: &Linear,
        table: &Table,
    ) -> Self {
        if length != 1.0 {
            return self.read(length, at, linear, table);
        }
        let mut next = *self;
        next.step::<W>(at, linear, table);
        next
    }

    /// The same in place, after one step.
    #[inline(always)]
    pub(super) fn step<const W: usize>(&mut self, at: (f64, f64), linear: &Linear, table: &Table) {
        if self.turned < TURNED {
            (self.waves, self.turned) = (table.turned::<W>(self.waves), self.turned + 1);
        } else {
            *self = self.read(1.0, at, linear, table);
        }
    }

    #[cold]
    fn read(&self, length: f64, at: (f64, f64), linear: &Linear, table: &Table) -> Self {
        Self::new(linear, self.phase(length, table), at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LinearLaw, Wave};

    #[test]
    fn steps_turn_the_phase_and_the_waves() {
        let wave = Wave { amplitude: [0.6, 0.2], omega: 0.9, phase: 0.4 };
        let waves = [wave, Wave { omega: 2.3, ..wave }];
        let linear = Linear::new(&LinearLaw { waves, stiffness: 1.0, ..LinearLaw::default() });
        let table = Table::new(linear.table_law(), f64::INFINITY);
        let clock = linear.first().unwrap().clock;
        let read = |t: f64| Reading::new(&linear, clock.phase(t, 0.0), (t, 0.0));
        let mut reading = read(5.0);
        for k in 1..=40 {
            let t = 5.0 + f64::from(k) * table.h();
            reading = reading.after::<2>(1.0, (t, 0.0), &linear, &table);
            let (phase, direct) = (reading.phase(0.0, &table), read(t));
            let off = (phase.turns - direct.phase.turns) + (phase.part - direct.phase.part);
            assert!((off + phase.rest - direct.phase.rest).abs() < 2e-15, "{k}: {off:e}");
            let pairs = reading.waves.iter().flatten().zip(direct.waves.iter().flatten());
            pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-14, "{k}: {:e}", a - b));
            assert!(reading.turned <= TURNED);
        }
    }
}
