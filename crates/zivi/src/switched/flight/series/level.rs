//! Many steps of a flight at once.

use super::columns::{length, Bound, Columns, COLUMNS};
use super::terms::{sum_by, Law, Start, TERMS, WAVES};
use crate::numeric::turns::sin_cos;

/// Doublings of a step; a larger one is never needed.
pub(super) const LEVELS: usize = 20;

/// A level whose numbers are larger than this is of no use.
const LARGEST: f64 = 1e100;

/// How the end of `2^j` steps depends on their start.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Level {
    /// `x` and `V`.
    ends: Columns<2>,
    /// `e^(i W 2^j)` as cosine and sine.
    turn: [[f64; 2]; WAVES],
    /// Of `h^2 |x''|` on the way.
    bend: Bound,
}

impl Level {
    /// One step.
    pub(super) fn first(series: &Columns<TERMS>, law: Law, h: f64, turns: [f64; WAVES]) -> Self {
        let ends = series.0.each_ref().map(|a| [sum_by(a, |_, a| a), sum_by(a, |n, a| n * a)]);
        let bends = |n: f64| n * (n - 1.0).max(0.0);
        let bend = |c: usize| sum_by(&series.0[c], |n, a| bends(n) * a.abs());
        // without a spring and a damper the force is the acceleration
        let free = law.stiffness == 0.0 && law.damping == 0.0;
        let wave = |m: usize| {
            let [cos, sin] = [&series.0[3 + 2 * m], &series.0[4 + 2 * m]];
            let size = |n: usize| length(cos[n], sin[n]);
            if free {
                h * h
            } else {
                (0..TERMS).map(|n| bends(n as f64) * size(n)).sum()
            }
        };
        let bend = Bound([bend(0), bend(1), bend(2), wave(0), wave(1)]);
        Self { ends: Columns(ends), turn: turns.map(turn), bend }
    }

    /// Position and velocity, times the length of a step, at the end.
    #[inline(always)]
    pub(super) fn ends<const W: usize>(&self, start: &Start) -> [f64; 2] {
        self.ends.of::<W, 2>(start)
    }

    /// The waves at the end.
    #[inline(always)]
    pub(super) fn turned<const W: usize>(&self, mut waves: [[f64; 2]; WAVES]) -> [[f64; 2]; WAVES] {
        for (z, [cos, sin]) in waves.iter_mut().zip(self.turn).take(W) {
            *z = [z[0] * cos - z[1] * sin, z[1] * cos + z[0] * sin];
        }
        waves
    }

    /// Whether the motion certainly stays above the wall for `length` steps, no more than those of
    /// the level: `x + s V - s^2 B/2 > 0` at their end is so on the way.
    #[inline(always)]
    pub(super) fn is_clear<const W: usize>(&self, start: &Start, length: f64) -> bool {
        let bend = self.bend.of::<W>(start);
        let lowest = start.x + length * (start.v - 0.5 * length * bend);
        // false for NaN too
        lowest > 1e-9 * (start.x + length * start.v.abs())
    }

    /// Whether a start is thinkable from which a step is clear by its bound: from a height, or away
    /// from the wall.
    pub(super) fn leaps(&self) -> bool {
        let Bound([x, v, ..]) = self.bend;
        x.min(v) < 2.0
    }

    /// Twice as many steps, in which the waves turn by so much.
    pub(super) fn doubled(&self, turns: [f64; WAVES]) -> Self {
        let by = &self.ends.0;
        let after = |[x, v]: [f64; 2], row: usize| x * by[0][row] + v * by[1][row];
        // what the second half adds: the constant again, the waves turned
        let own = |c: usize, row: usize| match c {
            0 | 1 => 0.0,
            2 => by[2][row],
            _ => {
                let [cos, sin] = self.turn[(c - 3) / 2];
                let [re, im] = [by[(c - 1) / 2 * 2 + 1][row], by[(c - 1) / 2 * 2 + 2][row]];
                if c % 2 == 1 {
                    re * cos + im * sin
                } else {
                    im * cos - re * sin
                }
            }
        };
        let ends: [[f64; 2]; COLUMNS] =
            std::array::from_fn(|c| [0, 1].map(|row| after(by[c], row) + own(c, row)));
        let Bound([x, v, force, of_waves @ ..]) = self.bend;
        let later = |by_x: f64, by_v: f64| x * by_x.abs() + v * by_v.abs();
        let size = |m: usize, row: usize| length(by[3 + 2 * m][row], by[4 + 2 * m][row]);
        let wave = |m: usize| of_waves[m].max(later(size(m, 0), size(m, 1)) + of_waves[m]);
        let bend = Bound([
            x.max(later(by[0][0], by[0][1])),
            v.max(later(by[1][0], by[1][1])),
            force.max(later(by[2][0], by[2][1]) + force),
            wave(0),
            wave(1),
        ]);
        Self { ends: Columns(ends), turn: turns.map(turn), bend }
    }

    pub(super) fn is_tame(&self) -> bool {
        let numbers = self.ends.0.iter().flatten().chain(&self.bend.0);
        // not so for NaN
        numbers.into_iter().all(|number| number.abs() < LARGEST)
    }
}

/// Cosine and sine of so many turns.
fn turn(turns: f64) -> [f64; 2] {
    let (sin, cos) = sin_cos(turns);
    [cos, sin]
}

#[cfg(test)]
mod tests {
    use super::super::table::Table;
    use super::*;

    #[test]
    fn a_step_is_clear_that_ends_above_a_billionth_of_the_way() {
        let law = Law { stiffness: 0.0, damping: 0.0, omega: [0.0; 2] };
        let table = Table::new(law, 1.0);
        let level = Level::first(&Columns(table.columns()), law, table.h(), [0.0; 2]);
        // from 1 m down by 1 m, all but a part
        let is_clear = |left: f64, length: f64| {
            let start = Start { x: 1.0, v: -(1.0 - left) / length, ..Start::default() };
            level.is_clear::<0>(&start, length)
        };
        for length in [0.25, 1.0] {
            assert!(is_clear(2.1e-9, length) && is_clear(0.5, length));
            for left in [1.9e-9, 1e-10, 0.0, -1.0] {
                assert!(!is_clear(left, length), "{left:e}");
            }
        }
    }

    #[test]
    fn a_free_mass_is_accelerated_by_its_waves_alone() {
        let omega = [0.4, 0.0];
        let law = Law { stiffness: 0.0, damping: 0.0, omega };
        let table = Table::new(law, f64::INFINITY);
        let h = table.h();
        assert!(h > 2.0);
        let turns = omega.map(|omega| omega * h / std::f64::consts::TAU);
        let level = Level::first(&Columns(table.columns()), law, h, turns);
        let Bound(bend) = level.bend;
        assert!((bend[3] / (h * h) - 1.0).abs() < 1e-15, "{bend:?} {h}");
    }
}
