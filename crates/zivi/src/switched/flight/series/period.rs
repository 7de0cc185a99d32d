//! Flights of one length again and again, such as the periods of a control that is held.
//!
//! Over a part `p` of a step, up to `q = p + delta` in truth, what a flight adds to its start is
//! linear in it, with a matrix that is the same each time,
//!
//! ```text
//! x(q) = x + q V + sum_(n>=2) a_n p^n + delta d,    d = sum_(n>=2) n a_n p^(n-1),
//! V(q) = V + d + delta V'(p),                       z(q) = z e^(i W p) (1 + i W delta),
//! ```
//!
//! where `delta` is the rounding of times: its square is below rounding. The matrix minus the
//! identity is small, and so is its accumulated rounding.

use super::table::Table;
use crate::numeric::root::sin_cos;
use crate::switched::flight::series::law::{LinearColumns, SeriesStart, COLUMNS, TERMS, WAVES};

/// Largest `delta/p`: its square is rounding.
const CLOSE: f64 = 1e-8;

/// Periods over which waves are turned before they are read off the clock again.
const TURNED: u32 = 16;

/// A length of flights that came twice in a row, and the waves at the end of the last.
#[derive(Clone, Debug, Default)]
pub(super) struct RepeatedFlight {
    /// The last length (steps of the table).
    last: f64,
    ends: Option<Ends>,
    /// The waves, their time, and the number of periods of rotation.
    waves: [[f64; 2]; WAVES],
    at: (f64, f64),
    turned: u32,
}

/// How the end depends on the start.
#[derive(Clone, Debug)]
struct Ends {
    length: f64,
    /// Increments of `x` and `V`, and `V'`.
    by: LinearColumns<3>,
    /// `e^(i W p)` as cosine and sine, and `W`.
    turn: [[f64; 2]; WAVES],
    rate: [f64; WAVES],
}

/// Whether two lengths are the same but for rounding.
#[inline(always)]
fn close(a: f64, b: f64) -> bool {
    // false for NaN
    (a - b).abs() <= CLOSE * b
}

impl RepeatedFlight {
    /// Takes note of a flight without an impact. Those of more than a step are not learnt, nor
    /// parabolas, whose ends are known.
    #[inline]
    pub(super) fn note(&mut self, length: f64, table: &Table) {
        let short = length <= 1.0 && !table.is_parabola();
        if short && close(length, self.last) && !self.knows(length) {
            self.ends = Some(Ends::new(length, table));
        }
        self.last = length;
    }

    /// Whether the end of a flight of this length is known.
    #[inline(always)]
    pub(super) fn knows(&self, length: f64) -> bool {
        self.ends.as_ref().is_some_and(|ends| close(length, ends.length))
    }

    /// The waves at a time, where they were turned up to there.
    #[inline(always)]
    pub(super) fn waves_at(&self, at: (f64, f64)) -> Option<[[f64; 2]; WAVES]> {
        (self.at == at && self.turned < TURNED).then_some(self.waves)
    }

    /// Position, and velocity times the step of the table, at the end of a flight whose length is
    /// known, and turns the waves up to that time; `read`: whether the initial ones were read off
    /// the clock.
    #[inline(always)]
    pub(super) fn fly<const W: usize>(
        &mut self,
        start: &SeriesStart,
        length: f64,
        read: bool,
        end: (f64, f64),
    ) -> Option<[f64; 2]> {
        let ends = self.ends.as_ref()?;
        let delta = length - ends.length;
        let ([x, v, bend], SeriesStart { x: x0, v: v0, .. }) = (ends.by.of::<W, 3>(start), *start);
        for m in 0..W {
            let ([cos, sin], [re, im]) = (ends.turn[m], start.waves[m]);
            let [re, im] = [re * cos - im * sin, im * cos + re * sin];
            let angle = ends.rate[m] * delta;
            self.waves[m] = [re - im * angle, im + re * angle];
        }
        self.turned = if read { 1 } else { self.turned + 1 };
        self.at = end;
        Some([x0 + (length * v0 + (x + delta * v)), v0 + (v + delta * bend)])
    }
}

impl Ends {
    fn new(length: f64, table: &Table) -> Self {
        let columns: [[f64; TERMS]; COLUMNS] = table.columns();
        let by = columns.map(|mut a| {
            (a[0], a[1]) = (0.0, 0.0);
            let mut sums = [0.0; 3];
            // Horner's scheme for the value and the first two derivatives
            for a in a.iter().rev() {
                sums[2] = sums[2] * length + sums[1];
                sums[1] = sums[1] * length + sums[0];
                sums[0] = sums[0] * length + a;
            }
            [sums[0], sums[1], 2.0 * sums[2]]
        });
        let omega = table.law().omega;
        let turn = omega.map(|omega| {
            let (sin, cos) = sin_cos(omega * table.h() * length / std::f64::consts::TAU);
            [cos, sin]
        });
        let rate = omega.map(|omega| omega * table.h());
        Self { length, by: LinearColumns(by), turn, rate }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::power_series::{derivative, value};
    use crate::switched::flight::series::law::Law;

    const LAW: Law = Law { stiffness: 2.0, damping: 0.3, omega: [1.7, 0.9] };
    const START: SeriesStart =
        SeriesStart { x: 0.4, v: -0.7, force: 1.1, waves: [[0.5, -0.8], [-1.2, 0.3]] };

    /// A period that came twice.
    fn learnt(length: f64, table: &Table) -> RepeatedFlight {
        let mut period = RepeatedFlight::default();
        period.note(length, table);
        assert!(!period.knows(length));
        period.note(length, table);
        period
    }

    #[test]
    fn the_end_of_a_period_is_that_of_the_series() {
        let table = Table::new(LAW, f64::INFINITY);
        let (a, mut waves) = (table.series(&START), START.waves);
        for length in [1e-3, 0.07, 0.5, 1.0] {
            let mut period = learnt(length, &table);
            for part in [1.0, 1.0 + 0.9e-8, 1.0 - 0.9e-8] {
                let q = part * length;
                assert!(period.knows(q));
                let [x, v] = period.fly::<2>(&START, q, true, (q, 0.0)).unwrap();
                assert!((x - value(&a, q)).abs() < 1e-15, "{q}: {:e}", x - value(&a, q));
                let slope = value(&derivative(&a), q);
                assert!((v - slope).abs() < 2e-15, "{q}: {:e}", v - slope);
                for ((z, start), omega) in waves.iter_mut().zip(START.waves).zip(LAW.omega) {
                    let (sin, cos) = (omega * q * table.h()).sin_cos();
                    *z = [start[0] * cos - start[1] * sin, start[1] * cos + start[0] * sin];
                }
                let pairs = period.waves_at((q, 0.0)).unwrap();
                for (z, exact) in pairs.iter().flatten().zip(waves.iter().flatten()) {
                    assert!((z - exact).abs() < 1e-15, "{q}");
                }
            }
            assert!(!period.knows(length * (1.0 + 2e-8)) && !period.knows(f64::NAN));
        }
    }

    #[test]
    fn waves_are_read_off_the_clock_again() {
        let table = Table::new(LAW, f64::INFINITY);
        let mut period = learnt(0.1, &table);
        for k in 0..TURNED {
            assert!(period.fly::<2>(&START, 0.1, k == 0, (f64::from(k), 0.0)).is_some());
            let known = period.waves_at((f64::from(k), 0.0)).is_some();
            assert_eq!(known, k + 1 < TURNED);
            // not at another time
            assert!(period.waves_at((f64::from(k), 1e-20)).is_none());
        }
    }

    #[test]
    fn long_flights_and_parabolas_are_not_learnt() {
        assert!(!learnt(1.5, &Table::new(LAW, f64::INFINITY)).knows(1.5));
        let free = Law { stiffness: 0.0, damping: 0.0, omega: [0.0; 2] };
        assert!(!learnt(0.5, &Table::new(free, f64::INFINITY)).knows(0.5));
    }
}
