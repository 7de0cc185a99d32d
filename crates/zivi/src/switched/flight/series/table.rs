//! Precomputed data of flights under a linear force, shared by all flights.
//!
//! ```text
//! x'' = -k x - c x' + f + sum_m Re z_m(t),      z_m' = i omega_m z_m                  (1)
//! ```
//!
//! Over a step from `t`, `s = (t' - t)/h`, the position is a power series that is linear in the
//! initial data `x`, `V = h x'`, the constant `f` and the waves `z_m`. With `K = k h^2`, `C = c h`,
//! `W = omega h` the coefficients of each column are
//!
//! ```text
//! a_(n+2) = (d_n - K a_n - C (n + 1) a_(n+1)) / ((n + 1)(n + 2)),                     (2)
//! d = h^2 (1, 0, 0, ...) for f,    h^2 Re, h^2 Im of conj((i W)^n)/n! for a wave.
//! ```
//!
//! No case is special: not `k = 0`, not `c^2 = 4 k`, not `omega^2 = k`.

use crate::numeric::bernstein::Polynomial;
use crate::numeric::power_series::derivative;
use crate::numeric::root::Phase;
use crate::switched::flight::series::law::{
    column, sum_by, wave, Bound, Law, Linear, LinearColumns, Series, SeriesStart, COLUMNS, TERMS,
    WAVES,
};
use crate::switched::flight::series::level::{DoublingLevel, Screen, SignTest, LEVELS};
use std::cell::RefCell;
use std::sync::Arc;

/// Length of a step times the fastest rate of the motion: the truncation error is `1.75^24/24! =
/// 1e-18`, and 24 times that in the velocity.
const STEP: f64 = 1.75;

/// Rounding of the ends of a step, relative to their terms: far more than there is.
const ROUNDING: f64 = 1e-13;

/// Tables that a thread keeps, of some 7 kB each.
const SHARED: usize = 16;

/// Columns of power series, and derived bounds.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Table {
    law: Law,
    /// Length of a step (s).
    h: f64,
    /// How many waves there are.
    n_waves: usize,
    series: LinearColumns<TERMS>,
    /// Of the position, and of the position divided by `s` for a start at the wall.
    screens: [Screen; 2],
    /// Of `sum (n - 1) |a_n|` after the first [`SHORT`].
    beyond: Bound,
    /// Of `|x''''|/384` over a step: how far the cubic with its ends is from the motion.
    off_cubic: Bound,
    /// Turns of the first wave in a step, as a sum.
    turns: [f64; 2],
    /// Whether the bounds of a step are low enough for one to be clear by them.
    leaps: bool,
    levels: Vec<DoublingLevel>,
}

/// Coefficients for a small part of a step, of length up to [`PART`]: the truncation error is less
/// than `0.035^10/10! = 1e-21`.
pub(super) const SHORT: usize = 10;
pub(super) const PART: f64 = 0.02;

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
        let [[a, b], [c, d]] = omega.map(|omega| {
            let [cos, sin] = wave(omega * h, h);
            [step(0.0, 0.0, &cos), step(0.0, 0.0, &sin)]
        });
        let [x, v] = [step(1.0, 0.0, &none), step(0.0, 1.0, &none)];
        let series = LinearColumns([x, v, step(0.0, 0.0, &constant), a, b, c, d]);
        let turns = omega.map(|omega| omega * h / std::f64::consts::TAU);
        let mut levels = Vec::with_capacity(LEVELS);
        levels.push(DoublingLevel::first(&series, law, h, turns));
        while levels.len() < LEVELS {
            let whole = f64::from(2u32.pow(levels.len() as u32));
            match levels.last().map(|level| level.doubled(turns.map(|turns| turns * whole))) {
                Some(next) if next.is_tame() => levels.push(next),
                _ => break,
            }
        }
        let screens = [Screen::new(&series, 0), Screen::new(&series, 1)];
        let beyond = Bound::sizes(|c| {
            let weighted = |n, a: f64| if n < SHORT as f64 { 0.0 } else { (n - 1.0) * a.abs() };
            sum_by(&series.0[c], weighted)
        });
        let off_cubic = Bound::sizes(|c| {
            let a = &series.0[c];
            let fourth = (0..4).fold(*a, |a, _| derivative(&a));
            // the coefficients enclose it
            let fourth = Polynomial::<TERMS>::from_powers(fourth);
            let largest = fourth.coefficients().iter().fold(0.0, |most, b| b.abs().max(most));
            largest / 384.0 + ROUNDING * sum_by(a, |n, a| (n + 1.0) * a.abs())
        });
        let high = f64::from(turns[0] as f32);
        let turns = [high, turns[0] - high];
        let leaps = levels[0].leaps();
        Self { law, h, n_waves, series, screens, beyond, off_cubic, turns, leaps, levels }
    }

    /// The table of a law, cached for the last flights on this thread.
    /// Runs under the same law share one table, even if they differ in initial states or alternate
    /// between a few parameter values.
    pub(crate) fn shared(law: Law) -> Arc<Self> {
        thread_local! {
            /// The last used first.
            static LAST: RefCell<Vec<Arc<Table>>> = const { RefCell::new(Vec::new()) };
        }
        LAST.with_borrow_mut(|last| {
            match last.iter().position(|table| table.law == law) {
                Some(place) => last[..=place].rotate_right(1),
                None => {
                    last.truncate(SHARED - 1);
                    last.insert(0, Arc::new(Self::new(law, f64::INFINITY)));
                }
            }
            Arc::clone(&last[0])
        })
    }

    pub(crate) fn law(&self) -> Law {
        self.law
    }

    /// Length of a step (s).
    #[inline]
    pub(crate) fn h(&self) -> f64 {
        self.h
    }

    /// Turns of the first wave in a step.
    #[inline]
    pub(crate) fn turns(&self) -> f64 {
        self.turns[0] + self.turns[1]
    }

    /// The same as a sum: the first has no more than 32 bits.
    #[inline]
    pub(super) fn turns_in_two(&self) -> [f64; 2] {
        self.turns
    }

    #[inline]
    pub(crate) fn n_waves(&self) -> usize {
        self.n_waves
    }

    /// Whether the motion is a parabola, so that its coefficients hold for any length.
    #[inline]
    pub(crate) fn is_parabola(&self) -> bool {
        let Law { stiffness, damping, .. } = self.law;
        stiffness == 0.0 && damping == 0.0 && self.n_waves == 0
    }

    /// The power series of all columns.
    pub(super) fn columns(&self) -> [Series; COLUMNS] {
        self.series.0
    }

    /// The position over the step, as a power series.
    #[inline(always)]
    pub(crate) fn series(&self, start: &SeriesStart) -> Series {
        match self.n_waves {
            0 => self.first::<0, TERMS>(start),
            1 => self.first::<1, TERMS>(start),
            _ => self.first::<2, TERMS>(start),
        }
    }

    /// The first coefficients of it, for `W` waves.
    #[inline(always)]
    pub(super) fn first<const W: usize, const N: usize>(&self, start: &SeriesStart) -> [f64; N] {
        self.series.of::<W, N>(start)
    }

    /// Half of the second derivative at the start, by the length of a step.
    #[inline(always)]
    pub(super) fn bend(&self, start: &SeriesStart) -> f64 {
        self.series.one::<WAVES>(start, 2)
    }

    /// Whether the parabola from the wall is back there within [`PART`].
    #[inline(always)]
    pub(super) fn is_short<const W: usize>(&self, start: &SeriesStart) -> bool {
        let [_, v, bend] = self.first::<W, 3>(start);
        v < -PART * bend
    }

    /// A bound of `sum (n - 1) |a_n|` after the first [`SHORT`] coefficients.
    #[inline(always)]
    pub(super) fn beyond<const W: usize>(&self, start: &SeriesStart) -> f64 {
        self.beyond.of::<W>(start)
    }

    /// Sign test by Bernstein coefficients of a step whose first `known` derivatives, at most one,
    /// are zero at its start.
    #[inline(always)]
    pub(super) fn screened<const W: usize>(&self, start: &SeriesStart, known: usize) -> SignTest {
        self.screens[known & 1].of::<W>(start)
    }

    /// Whether a step that ends there, and whose first `known` derivatives, at most one, are zero at
    /// its start, certainly stays above the wall: by the cubic `p` with these ends,
    ///
    /// ```text
    /// |x - p| <= s^2 (1 - s)^2 max |x''''|/24 <= max |x''''|/384,    s max |x''''|/162,
    /// ```
    ///
    /// and the Bernstein coefficients of `p` or `p/s`.
    #[inline(always)]
    pub(super) fn is_clear_between<const W: usize>(
        &self,
        start: &SeriesStart,
        known: usize,
        [x, v]: [f64; 2],
    ) -> bool {
        const THIRD: f64 = 1.0 / 3.0;
        let (off, last) = (self.off_cubic.of::<W>(start), x - THIRD * v);
        // false for NaN, too
        if known == 0 {
            let first = start.x + THIRD * start.v;
            (start.x > off) & (first > off) & (last > off) & (x > off)
        } else {
            let off = 384.0 / 162.0 * off;
            (start.v > off) & (1.5 * last > off) & (x > off)
        }
    }

    /// Whether a bound may be low enough for a step to be clear by it; that of a parabola may.
    #[inline(always)]
    pub(super) fn leaps(&self) -> bool {
        self.leaps
    }

    /// Whether so much of a step certainly stays above the wall.
    #[inline(always)]
    pub(super) fn is_clear<const W: usize>(&self, start: &SeriesStart, part: f64) -> bool {
        self.levels[0].is_clear::<W>(start, part)
    }

    /// The largest `j` for which `2^j` steps, at most `most`, certainly stay above the wall.
    #[inline(always)]
    pub(super) fn far<const W: usize>(&self, start: &SeriesStart, most: f64) -> Option<usize> {
        let (mut found, mut length) = (None, 1.0);
        if !self.leaps {
            return None;
        }
        for (j, level) in self.levels.iter().enumerate() {
            if !(length <= most && level.is_clear::<W>(start, length)) {
                break;
            }
            (found, length) = (Some(j), 2.0 * length);
        }
        found
    }

    /// The start of the step after `2^j` ones, the waves turned.
    pub(crate) fn jump(&self, start: &SeriesStart, j: usize) -> SeriesStart {
        let level = &self.levels[j.min(self.levels.len() - 1)];
        let [x, v] = match self.n_waves {
            0 => level.ends::<0>(start),
            1 => level.ends::<1>(start),
            _ => level.ends::<2>(start),
        };
        SeriesStart { x, v, force: start.force, waves: level.turned::<WAVES>(start.waves) }
    }

    /// Position and velocity, times the length of a step, after `2^j` steps with `W` waves.
    #[inline(always)]
    pub(super) fn ends<const W: usize>(&self, start: &SeriesStart, j: usize) -> [f64; 2] {
        self.levels[j.min(self.levels.len() - 1)].ends::<W>(start)
    }

    /// The waves after a step.
    #[inline(always)]
    pub(super) fn turned<const W: usize>(&self, waves: [[f64; 2]; WAVES]) -> [[f64; 2]; WAVES] {
        self.levels[0].turned::<W>(waves)
    }
}

// The waves of a flight from step to step.

/// Full steps over which waves are rotated by the table before they are read off the clock again.
const TURNED: u32 = 16;

/// The waves at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct WaveReading {
    pub(crate) waves: [[f64; 2]; WAVES],
    /// Phase of the first wave when they were read.
    phase: Phase,
    /// Whole steps since then.
    turned: u32,
}

impl WaveReading {
    /// At a phase of the first wave that represents a time with its rounding error.
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
mod table_tests {
    use super::*;

    const LAW: Law = Law { stiffness: 2.0, damping: 0.3, omega: [1.7, 0.9] };
    const START: SeriesStart =
        SeriesStart { x: 0.4, v: -0.7, force: 1.1, waves: [[0.5, -0.8], [-1.2, 0.3]] };

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

    /// Numbers that look random, between -1 and 1.
    fn random(draw: &mut u64) -> f64 {
        *draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (*draw >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    #[test]
    fn a_motion_is_as_near_to_the_cubic_with_its_ends_as_the_bound_says() {
        let (table, mut draw) = (Table::new(LAW, f64::INFINITY), 5);
        let (mut nearest, mut of_rate) = (0.0_f64, 0.0_f64);
        for k in 0..600 {
            let mut r = || random(&mut draw);
            let mut start =
                SeriesStart { x: r(), v: r(), force: r(), waves: [[r(), r()], [r(), r()]] };
            // at times from a position or a speed alone
            match k % 3 {
                0 => start = SeriesStart { x: start.x, ..SeriesStart::default() },
                1 => start = SeriesStart { v: start.v, ..SeriesStart::default() },
                _ => (),
            }
            let (a, [x1, v1]) = (table.series(&start), table.ends::<2>(&start, 0));
            let (x0, v0, off) = (start.x, start.v, table.off_cubic.of::<2>(&start));
            for k in 1..40 {
                let s = f64::from(k) / 40.0;
                let rest = 1.0 - s;
                let cubic = rest * rest * (x0 * (1.0 + 2.0 * s) + v0 * s)
                    + s * s * (x1 * (1.0 + 2.0 * rest) - v1 * rest);
                let apart = (a.iter().rev().fold(0.0, |sum, a| sum * s + a) - cubic).abs();
                assert!(apart <= off && apart / s <= off * (384.0 / 162.0), "{start:?} {s}");
                nearest = nearest.max(apart / off);
                of_rate = of_rate.max(apart / s / off / (384.0 / 162.0));
            }
        }
        // and not far less
        assert!(nearest > 0.5 && of_rate > 0.5, "{nearest} {of_rate}");
    }

    #[test]
    fn a_step_is_clear_if_the_cubic_is_by_more_than_the_bound() {
        let mut table = Table::new(LAW, f64::INFINITY);
        // 1/100 whatever else the step starts from
        table.off_cubic = Bound([0.0, 0.0, 0.01, 0.0, 0.0]);
        let clear = |known, [x0, v0, x1, v1]: [f64; 4]| {
            let start = SeriesStart { x: x0, v: v0, force: -1.0, ..SeriesStart::default() };
            table.is_clear_between::<2>(&start, known, [x1, v1])
        };
        // coefficients x0, x0 + v0/3, x1 - v1/3, x1
        let ends = [1.0, 0.0, 1.0, 0.0];
        assert!(clear(0, ends));
        for (low, high) in [(0.009, false), (0.011, true)] {
            assert_eq!(clear(0, [low, 3.0, 1.0, 0.0]), high, "{low}");
            assert_eq!(clear(0, [1.0, 3.0 * (low - 1.0), 1.0, 0.0]), high, "{low}");
            assert_eq!(clear(0, [1.0, 0.0, 1.0, 3.0 * (1.0 - low)]), high, "{low}");
            assert_eq!(clear(0, [1.0, 0.0, low, -3.0]), high, "{low}");
            // from the wall v0, 3/2 (x1 - v1/3), x1, beyond 64/27 of the bound
            let low = low * 64.0 / 27.0;
            assert_eq!(clear(1, [0.0, low, 1.0, 0.0]), high, "{low}");
            assert_eq!(clear(1, [0.0, 1.0, 1.0, 3.0 * (1.0 - low / 1.5)]), high, "{low}");
            assert_eq!(clear(1, [0.0, 1.0, low, -3.0]), high, "{low}");
        }
        for k in 0..4 {
            let mut none = ends;
            none[k] = f64::NAN;
            assert!(!clear(0, none), "{k}");
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
            let start = SeriesStart { x, v, force, waves: [[random(), random()], [random(), 0.0]] };
            let Some(j) = table.far::<2>(&start, f64::INFINITY) else { continue };
            jumps += 1;
            let mut at = start;
            for _ in 0..1 << j {
                at = table.jump(&at, 0);
                assert!(at.x > 0.0, "{start:?} {j}");
            }
        }
        assert!(jumps > 500, "{jumps}");
    }

    #[test]
    fn equal_laws_share_a_table() {
        let of = |k: usize| Table::shared(Law { damping: 0.3 + k as f64, ..LAW });
        let all: Vec<_> = (0..SHARED).map(of).collect();
        for (k, table) in all.iter().enumerate() {
            assert!(Arc::ptr_eq(table, &of(k)), "{k}");
            assert_eq!(table.law().damping, 0.3 + k as f64);
        }
        assert_eq!(*all[1], Table::new(Law { damping: 1.3, ..LAW }, f64::INFINITY));
        // one more takes the place of the one that was not used for the longest time
        assert!(Arc::ptr_eq(&all[0], &of(0)));
        of(SHARED);
        assert!(Arc::ptr_eq(&all[0], &of(0)) && Arc::ptr_eq(&all[2], &of(2)));
        assert!(!Arc::ptr_eq(&all[1], &of(1)));
    }
}

#[cfg(test)]
mod reading_tests {
    use super::*;
    use crate::{LinearLaw, Wave};

    #[test]
    fn steps_turn_the_phase_and_the_waves() {
        let wave = Wave { amplitude: [0.6, 0.2], omega: 0.9, phase: 0.4 };
        let waves = [wave, Wave { omega: 2.3, ..wave }];
        let linear = Linear::new(&LinearLaw { waves, stiffness: 1.0, ..LinearLaw::default() });
        let table = Table::new(linear.table_law(), f64::INFINITY);
        let clock = linear.first().unwrap().clock;
        let read = |t: f64| WaveReading::new(&linear, clock.phase(t, 0.0), (t, 0.0));
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
