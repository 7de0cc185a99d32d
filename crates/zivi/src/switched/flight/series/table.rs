//! What a flight under a linear force consists of, once for all flights.
//!
//! ```text
//! x'' = -k x - c x' + f + sum_m Re z_m(t),      z_m' = i omega_m z_m                  (1)
//! ```
//!
//! Over a step from `t`, `s = (t' - t)/h`, the position is a power series that is linear in what the
//! step starts from, `x`, `V = h x'`, the constant `f` and the waves `z_m`. With `K = k h^2`,
//! `C = c h`, `W = omega h` the coefficients of each column are
//!
//! ```text
//! a_(n+2) = (d_n - K a_n - C (n + 1) a_(n+1)) / ((n + 1)(n + 2)),                     (2)
//! d = h^2 (1, 0, 0, ...) for f,    h^2 Re, h^2 Im of conj((i W)^n)/n! for a wave.
//! ```
//!
//! No case is special: not `k = 0`, not `c^2 = 4 k`, not `omega^2 = k`.

use crate::numeric::turns::sin_cos;

/// Coefficients of a flight. Over a step of length [`STEP`] the rest is `1.75^24/24! = 1e-18`, and
/// 24 times that in the velocity.
pub(crate) const TERMS: usize = 24;

/// Length of a step times the fastest rate of the motion.
const STEP: f64 = 1.75;

/// Most waves of a force.
pub(crate) const WAVES: usize = 2;

/// Doublings of a step; a larger one is never needed.
const LEVELS: usize = 20;

/// A level whose numbers are larger than this is of no use.
const LARGEST: f64 = 1e100;

/// Coefficients of powers of `s`.
pub(crate) type Series = [f64; TERMS];

/// What a table is for: stiffness, damping and the angular frequencies of the waves, 0 where there
/// is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Law {
    pub(crate) stiffness: f64,
    pub(crate) damping: f64,
    pub(crate) omega: [f64; WAVES],
}

/// Where a step starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Start {
    /// Position (m).
    pub(crate) x: f64,
    /// Velocity times the length of a step (m).
    pub(crate) v: f64,
    /// Constant force (m/s^2).
    pub(crate) force: f64,
    /// Waves: real and imaginary parts (m/s^2).
    pub(crate) waves: [[f64; 2]; WAVES],
}

/// How the end of `2^j` steps depends on their start.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Level {
    /// Of `x` and `V`: by `x`, by `V`, by the constant, by the two parts of each wave.
    rows: [Row; 2],
    /// `i W 2^j` as cosine and sine.
    turn: [[f64; 2]; WAVES],
    /// Bounds of `h^2 |x''|` on the way: by `|x|`, by `|V|`, by the constant, by `|z|` of each wave.
    bound: [f64; 3 + WAVES],
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Row {
    x: f64,
    v: f64,
    force: f64,
    waves: [[f64; 2]; WAVES],
}

/// Columns of power series.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Table {
    law: Law,
    /// Length of a step (s).
    h: f64,
    /// How many waves there are.
    n_waves: usize,
    x: Series,
    v: Series,
    force: Series,
    waves: [[Series; 2]; WAVES],
    /// Turns of each wave in a step.
    turns: [f64; WAVES],
    levels: Vec<Level>,
}

impl Table {
    /// The table of a law, for steps of at most `longest` (s).
    pub(crate) fn new(law: Law, longest: f64) -> Self {
        let Law { stiffness, damping, omega } = law;
        let rate = 0.5 * (damping.abs() + (damping * damping + 4.0 * stiffness.abs()).sqrt());
        let fastest = omega.iter().fold(rate, |fastest, &omega| fastest.max(omega));
        // nothing but a constant force: a parabola, for which every step is as good
        let h = if fastest > 0.0 { (STEP / fastest).min(longest) } else { 1.0 };
        let step = |x, v, d: &Series| column(stiffness * h * h, damping * h, x, v, d);
        let none = [0.0; TERMS];
        let mut constant = none;
        constant[0] = h * h;
        let n_waves = omega.iter().filter(|&&omega| omega != 0.0).count();
        let waves = omega.map(|omega| {
            let [cos, sin] = wave(omega * h, h);
            [step(0.0, 0.0, &cos), step(0.0, 0.0, &sin)]
        });
        let turns = omega.map(|omega| omega * h / std::f64::consts::TAU);
        let mut table = Self {
            law,
            h,
            n_waves,
            x: step(1.0, 0.0, &none),
            v: step(0.0, 1.0, &none),
            force: step(0.0, 0.0, &constant),
            waves,
            turns,
            levels: Vec::with_capacity(LEVELS),
        };
        table.levels.push(table.first_level());
        while table.levels.len() < LEVELS {
            let whole = f64::from(2u32.pow(table.levels.len() as u32));
            let turn = turns.map(|turns| turn(turns * whole));
            match table.levels.last().map(|level| level.doubled(n_waves, turn)) {
                Some(next) if next.is_tame() => table.levels.push(next),
                _ => break,
            }
        }
        table
    }

    pub(crate) fn law(&self) -> Law {
        self.law
    }

    /// Length of a step (s).
    pub(crate) fn h(&self) -> f64 {
        self.h
    }

    /// Turns of each wave in a step.
    pub(crate) fn turns(&self) -> [f64; WAVES] {
        self.turns
    }

    /// Whether the motion is a parabola, so that its coefficients hold for any length.
    pub(crate) fn is_parabola(&self) -> bool {
        let Law { stiffness, damping, omega } = self.law;
        stiffness == 0.0 && damping == 0.0 && omega == [0.0; WAVES]
    }

    /// The position over the step, as a power series.
    #[inline]
    pub(crate) fn series(&self, start: &Start) -> Series {
        match self.n_waves {
            0 => self.combined::<0>(start),
            1 => self.combined::<1>(start),
            _ => self.combined::<2>(start),
        }
    }

    #[inline]
    fn combined<const W: usize>(&self, start: &Start) -> Series {
        let Start { x, v, force, waves } = *start;
        std::array::from_fn(|n| {
            let mut a = x * self.x[n] + v * self.v[n] + force * self.force[n];
            for (of, z) in self.waves.iter().zip(&waves).take(W) {
                a += z[0] * of[0][n] + z[1] * of[1][n];
            }
            a
        })
    }

    /// The largest `j` for which `2^j` steps, at most `most`, certainly stay above the wall:
    /// `x + s V - s^2 B/2 > 0` at their end is so on the way.
    #[inline]
    pub(crate) fn far(&self, start: &Start, most: f64) -> Option<usize> {
        let (mut found, mut length) = (None, 1.0);
        for (j, level) in self.levels.iter().enumerate() {
            let lowest = start.x + length * (start.v - 0.5 * length * level.bound(start));
            // false for NaN too
            let clear = lowest > 1e-9 * (start.x + length * start.v.abs());
            if !(clear && length <= most) {
                break;
            }
            (found, length) = (Some(j), 2.0 * length);
        }
        found
    }

    /// The start of the step after `2^j` ones, the waves turned.
    #[inline]
    pub(crate) fn jump(&self, start: &Start, j: usize) -> Start {
        let level = &self.levels[j.min(self.levels.len() - 1)];
        let mut waves = start.waves;
        for (z, [cos, sin]) in waves.iter_mut().zip(level.turn) {
            *z = [z[0] * cos - z[1] * sin, z[1] * cos + z[0] * sin];
        }
        let [x, v] = level.rows.map(|row| row.of(start));
        Start { x, v, force: start.force, waves }
    }

    fn first_level(&self) -> Level {
        let value = |a: &Series| a.iter().rev().sum::<f64>();
        let slope = |a: &Series| sum_by(a, |n, a| n * a);
        let bend = |a: &Series| sum_by(a, |n, a| n * (n - 1.0) * a.abs());
        let row = |of: &dyn Fn(&Series) -> f64| Row {
            x: of(&self.x),
            v: of(&self.v),
            force: of(&self.force),
            waves: [0, 1].map(|m: usize| [of(&self.waves[m][0]), of(&self.waves[m][1])]),
        };
        let of_wave = |m: usize| {
            let [cos, sin] = &self.waves[m];
            (0..TERMS).map(|n| bends(n) * (cos[n] * cos[n] + sin[n] * sin[n]).sqrt()).sum()
        };
        // without a spring and a damper the force is the acceleration
        let free = self.law.stiffness == 0.0 && self.law.damping == 0.0;
        let wave = |m: usize| if free { self.h * self.h } else { of_wave(m) };
        Level {
            rows: [row(&value), row(&slope)],
            turn: self.turns.map(turn),
            bound: [bend(&self.x), bend(&self.v), bend(&self.force), wave(0), wave(1)],
        }
    }
}

/// Cosine and sine of so many turns.
fn turn(turns: f64) -> [f64; 2] {
    let (sin, cos) = sin_cos(turns);
    [cos, sin]
}

fn bends(n: usize) -> f64 {
    let n = n as f64;
    n * (n - 1.0).max(0.0)
}

/// The sum of `of(n, a_n)`, the smallest first.
fn sum_by(a: &Series, of: impl Fn(f64, f64) -> f64) -> f64 {
    a.iter().enumerate().rev().map(|(n, &a)| of(n as f64, a)).sum()
}

/// Equation (2).
pub(crate) fn column(k: f64, c: f64, x: f64, v: f64, d: &Series) -> Series {
    let mut a = [0.0; TERMS];
    (a[0], a[1]) = (x, v);
    for n in 0..TERMS - 2 {
        let (one, two) = (n as f64 + 1.0, n as f64 + 2.0);
        a[n + 2] = (d[n] - k * a[n] - c * one * a[n + 1]) / (one * two);
    }
    a
}

/// `h^2 Re z e^(i W s)` by powers of `s` for `z = 1` and `z = i`.
fn wave(w: f64, h: f64) -> [Series; 2] {
    let (mut cos, mut sin) = ([0.0; TERMS], [0.0; TERMS]);
    let mut term = h * h;
    for n in 0..TERMS {
        match n % 4 {
            0 => cos[n] = term,
            1 => sin[n] = -term,
            2 => cos[n] = -term,
            _ => sin[n] = term,
        }
        term *= w / (n as f64 + 1.0);
    }
    [cos, sin]
}

impl Row {
    #[inline]
    fn of(&self, start: &Start) -> f64 {
        let mut sum = self.x * start.x + self.v * start.v + self.force * start.force;
        for (of, z) in self.waves.iter().zip(&start.waves) {
            sum += of[0] * z[0] + of[1] * z[1];
        }
        sum
    }
}

impl Level {
    fn bound(&self, start: &Start) -> f64 {
        let [x, v, force, waves @ ..] = self.bound;
        let mut sum = x * start.x.abs() + v * start.v.abs() + force * start.force.abs();
        for (of, z) in waves.iter().zip(&start.waves) {
            // |z| is at most the sum of the absolute values of its parts
            sum += of * (z[0].abs() + z[1].abs());
        }
        sum
    }

    /// Twice as many steps.
    fn doubled(&self, n_waves: usize, turn: [[f64; 2]; WAVES]) -> Self {
        let [of_x, of_v] = self.rows;
        let rows = self.rows.map(|row| {
            let mut waves = [[0.0; 2]; WAVES];
            for (m, wave) in waves.iter_mut().enumerate().take(n_waves) {
                let [cos, sin] = self.turn[m];
                let [re, im] = row.waves[m];
                // the second half starts with the wave turned
                let turned = [re * cos + im * sin, im * cos - re * sin];
                for (i, of) in turned.iter().enumerate() {
                    wave[i] = row.x * of_x.waves[m][i] + row.v * of_v.waves[m][i] + of;
                }
            }
            Row {
                x: row.x * of_x.x + row.v * of_v.x,
                v: row.x * of_x.v + row.v * of_v.v,
                force: row.x * of_x.force + row.v * of_v.force + row.force,
                waves,
            }
        });
        let [x, v, force, of_waves @ ..] = self.bound;
        let later = |by_x: f64, by_v: f64| x * by_x.abs() + v * by_v.abs();
        let size = |z: [f64; 2]| (z[0] * z[0] + z[1] * z[1]).sqrt();
        let wave = |m: usize| {
            let after = later(size(of_x.waves[m]), size(of_v.waves[m])) + of_waves[m];
            of_waves[m].max(after)
        };
        Self {
            rows,
            turn,
            bound: [
                x.max(later(of_x.x, of_v.x)),
                v.max(later(of_x.v, of_v.v)),
                force.max(later(of_x.force, of_v.force) + force),
                wave(0),
                wave(1),
            ],
        }
    }

    fn is_tame(&self) -> bool {
        let numbers = self.rows.iter().flat_map(|row| {
            [row.x, row.v, row.force].into_iter().chain(row.waves.into_iter().flatten())
        });
        // not so for NaN
        numbers.chain(self.bound).all(|number| number.abs() < LARGEST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAW: Law = Law { stiffness: 2.0, damping: 0.3, omega: [1.7, 0.9] };
    const START: Start = Start { x: 0.4, v: -0.7, force: 1.1, waves: [[0.5, -0.8], [-1.2, 0.3]] };

    /// `x''` by the series against the force on it, equation (1).
    #[test]
    fn a_series_solves_its_equation() {
        let table = Table::new(LAW, f64::INFINITY);
        let (h, a) = (table.h(), table.series(&START));
        for i in 0..=10 {
            let s = f64::from(i) / 10.0;
            let sum = |of: &dyn Fn(f64, f64) -> f64| sum_by(&a, of);
            let power = |n: f64| s.powi(n as i32);
            let x = sum(&|n, a| a * power(n));
            let xdot = sum(&|n, a| n * a * power((n - 1.0).max(0.0))) / h;
            let bend = sum(&|n, a| n * (n - 1.0) * a * power((n - 2.0).max(0.0))) / (h * h);
            let wave = |m: usize| {
                let (sin, cos) = (LAW.omega[m] * h * s).sin_cos();
                START.waves[m][0] * cos - START.waves[m][1] * sin
            };
            let f = START.force - 2.0 * x - 0.3 * xdot + wave(0) + wave(1);
            // the second derivative has the remainder of 22 terms
            assert!((bend - f).abs() < 2e-13, "{s}: {:e}", bend - f);
        }
    }

    #[test]
    fn many_steps_at_once_are_those_one_by_one() {
        let table = Table::new(LAW, 0.3);
        let (mut one_by_one, mut steps) = (START, 0);
        for j in 0..8 {
            while steps < 1 << j {
                one_by_one = table.jump(&one_by_one, 0);
                steps += 1;
            }
            let at_once = table.jump(&START, j);
            assert!((at_once.x - one_by_one.x).abs() < 1e-13, "{j}");
            assert!((at_once.v - one_by_one.v).abs() < 1e-13, "{j}");
            for (z, w) in at_once.waves.iter().zip(one_by_one.waves) {
                assert!((z[0] - w[0]).abs() < 1e-13 && (z[1] - w[1]).abs() < 1e-13);
            }
        }
    }

    #[test]
    fn no_jump_passes_the_wall() {
        // thousands of starts above the wall: the longest jump that is allowed stays above it
        let table = Table::new(LAW, 0.02);
        let (mut draw, mut jumps) = (3_u64, 0);
        let mut random = || {
            draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (draw >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        for _ in 0..2000 {
            let x = 2.0 * random().abs();
            let (v, force) = (0.02 * random(), 3.0 * random());
            let start = Start { x, v, force, waves: [[random(), random()], [random(), 0.0]] };
            let Some(j) = table.far(&start, f64::INFINITY) else { continue };
            jumps += 1;
            let mut at = start;
            for _ in 0..1 << j {
                at = table.jump(&at, 0);
                assert!(at.x > 0.0, "{start:?} {j}");
            }
        }
        assert!(jumps > 500, "{jumps}");
    }
}
