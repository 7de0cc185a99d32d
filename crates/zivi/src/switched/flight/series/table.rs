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

use std::cell::RefCell;
use std::sync::Arc;

use crate::numeric::bernstein::Polynomial;
use crate::numeric::power_series::derivative;
use crate::numeric::root::{of_angle, sin_cos, Clock, Phase};
use crate::{Dependence, Force, LinearLaw};

pub(crate) use crate::numeric::power_series::{Series, TERMS};

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

// A linear force with its waves on clocks of their own.

/// A wave `Re z e^(i omega t)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Excitation {
    pub(crate) clock: Clock,
    omega: f64,
    /// Its value at `t = 0`.
    z: [f64; 2],
}

impl Excitation {
    /// Its value at a phase of its clock.
    #[inline]
    pub(crate) fn at(&self, phase: Phase) -> [f64; 2] {
        turned(self.z, phase)
    }
}

/// `z e^(2 pi i part)`.
#[inline]
fn turned([re, im]: [f64; 2], phase: Phase) -> [f64; 2] {
    let (sin, cos) = sin_cos(phase.part);
    [re * cos - im * sin, im * cos + re * sin]
}

/// `f = -k x - c x' + constant + sum_m Re z_m e^(i omega_m t)`, `omega_m > 0` and all different.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Linear {
    stiffness: f64,
    damping: f64,
    /// The part that does not vary (m/s^2).
    pub(crate) constant: f64,
    /// Contribution of waves with zero frequency.
    still: f64,
    waves: [Option<Excitation>; WAVES],
}

impl Linear {
    /// The same force; waves of one frequency are added, one that does not turn is a constant.
    pub(crate) fn new(law: &LinearLaw) -> Self {
        let LinearLaw { stiffness, damping, gravity, waves } = *law;
        let mut all = Self { stiffness, damping, constant: 0.0, still: 0.0, waves: [None; WAVES] };
        for wave in waves.iter().filter(|wave| wave.amplitude != [0.0; 2]) {
            // the conjugate turns the other way
            let sign = if wave.omega < 0.0 { -1.0 } else { 1.0 };
            let [re, im] = wave.amplitude;
            let z = turned([re, sign * im], of_angle(sign * wave.phase));
            all.add(sign * wave.omega, z);
        }
        all.pulled_by(gravity);
        all
    }

    /// Sets the constant acceleration towards the wall (m/s^2).
    #[inline]
    pub(crate) fn pulled_by(&mut self, gravity: f64) {
        self.constant = (0.0 - gravity) + self.still;
    }

    fn add(&mut self, omega: f64, [re, im]: [f64; 2]) {
        if omega == 0.0 {
            self.still += re;
            return;
        }
        for place in &mut self.waves {
            match place {
                Some(wave) if wave.omega == omega => {
                    wave.z[0] += re;
                    wave.z[1] += im;
                    return;
                }
                Some(_) => (),
                None => {
                    *place = Some(Excitation { clock: Clock::new(omega), omega, z: [re, im] });
                    return;
                }
            }
        }
    }

    pub(crate) fn table_law(&self) -> Law {
        let Self { stiffness, damping, waves, .. } = *self;
        let omega = waves.map(|wave| wave.map_or(0.0, |wave| wave.omega));
        Law { stiffness, damping, omega }
    }

    /// The first wave, the clock of the motion.
    #[inline]
    pub(crate) fn first(&self) -> Option<&Excitation> {
        self.waves[0].as_ref()
    }

    #[inline]
    pub(crate) fn second(&self) -> Option<&Excitation> {
        self.waves[1].as_ref()
    }

    /// The phase of the next lift-off from rest at `phase` of a force with one wave,
    ///
    /// ```text
    /// |z| cos(2 pi psi) = g on the rise:    psi = -acos(g/|z|)/(2 pi).
    /// ```
    pub(crate) fn lift_off(&self, wave: &Excitation, phase: Phase) -> Option<Phase> {
        /// A part of a turn that is rounding: a mass that was left at its lift-off is there still.
        const THERE: f64 = 1e-13;
        let [re, im] = wave.z;
        let (size, pull) = ((re * re + im * im).sqrt(), -self.constant);
        if self.constant + wave.at(phase)[0] > 0.0 {
            return Some(phase);
        }
        if size.is_nan() || size <= pull {
            return None;
        }
        let angle = -(libm::acos(pull / size) + libm::atan2(im, re));
        let ahead = of_angle(angle).part - phase.part;
        let ahead = ahead - ahead.floor();
        Some(if ahead > 1.0 - THERE { phase } else { phase.after(ahead) })
    }
}

impl<E> Force<E> for Linear {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        let mut f = -self.stiffness * x - self.damping * xdot + self.constant;
        for wave in self.waves.iter().flatten() {
            f += wave.at(wave.clock.phase(t, 0.0))[0];
        }
        Ok(f)
    }

    fn dependence(&self) -> Dependence {
        if self.stiffness != 0.0 || self.damping != 0.0 {
            Dependence::State
        } else {
            Force::<E>::dependence_at_rest(self)
        }
    }

    fn dependence_at_rest(&self) -> Dependence {
        if self.waves[0].is_some() {
            Dependence::Time
        } else {
            Dependence::Constant
        }
    }

    fn shortest_period(&self) -> Option<f64> {
        let periods = self.waves.iter().flatten().map(|wave| wave.clock.period());
        Some(periods.fold(f64::INFINITY, f64::min))
    }
}

// Power series, and initial data of a step under a linear force.

/// Most waves of a force.
pub(crate) const WAVES: usize = 2;

/// Parameters of a table: stiffness, damping and the angular frequencies of the waves, 0 for absent
/// waves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Law {
    pub(crate) stiffness: f64,
    pub(crate) damping: f64,
    pub(crate) omega: [f64; WAVES],
}

/// Where a step starts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct SeriesStart {
    /// Position (m).
    pub(crate) x: f64,
    /// Velocity times the length of a step (m).
    pub(crate) v: f64,
    /// Constant force (m/s^2).
    pub(crate) force: f64,
    /// Waves: real and imaginary parts (m/s^2).
    pub(crate) waves: [[f64; 2]; WAVES],
}

/// The sum of `of(n, a_n)`, the smallest first.
pub(super) fn sum_by(a: &Series, of: impl Fn(f64, f64) -> f64) -> f64 {
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
pub(crate) fn wave(w: f64, h: f64) -> [Series; 2] {
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

// Quantities linear in the initial data of a step.

/// Quantities in which a flight is linear: `x`, `V`, the constant, the two parts of each wave.
pub(super) const COLUMNS: usize = 3 + 2 * WAVES;

/// Numbers that are linear in the initial data of a step: coefficients of each datum.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct LinearColumns<const N: usize>(pub(super) [[f64; N]; COLUMNS]);

impl<const N: usize> LinearColumns<N> {
    /// The first of them for a start with `W` waves.
    #[inline(always)]
    pub(super) fn of<const W: usize, const FIRST: usize>(
        &self,
        start: &SeriesStart,
    ) -> [f64; FIRST] {
        // a loop is compiled for the vectors of whoever calls, a closure is not
        let mut all = [0.0; FIRST];
        for (n, sum) in all.iter_mut().enumerate() {
            *sum = self.one::<W>(start, n);
        }
        all
    }

    /// One of them.
    #[inline(always)]
    pub(super) fn one<const W: usize>(&self, start: &SeriesStart, n: usize) -> f64 {
        let (SeriesStart { x, v, force, waves }, by) = (*start, &self.0);
        let mut sum = x * by[0][n] + v * by[1][n] + force * by[2][n];
        for m in 0..W {
            let [re, im] = waves[m];
            sum += re * by[3 + 2 * m][n] + im * by[4 + 2 * m][n];
        }
        sum
    }
}

/// A bound that is linear in the sizes of the initial data of a step: coefficients of `|x|`, `|V|`,
/// the constant, and `|z|` of each wave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bound(pub(super) [f64; 3 + WAVES]);

impl Bound {
    /// That of the sizes that columns have; the two of a wave are turned into each other.
    pub(super) fn sizes(of: impl Fn(usize) -> f64) -> Self {
        let wave = |m: usize| length(of(3 + 2 * m), of(4 + 2 * m));
        Self([of(0), of(1), of(2), wave(0), wave(1)])
    }

    #[inline(always)]
    pub(super) fn of<const W: usize>(&self, start: &SeriesStart) -> f64 {
        let Self([x, v, force, waves @ ..]) = self;
        let mut sum = x * start.x.abs() + v * start.v.abs() + force * start.force.abs();
        for (of, z) in waves.iter().zip(&start.waves).take(W) {
            // |z| is at most the sum of the absolute values of its parts
            sum += of * (z[0].abs() + z[1].abs());
        }
        sum
    }
}

/// `sqrt(a^2 + b^2)` for numbers whose squares are some.
pub(super) fn length(a: f64, b: f64) -> f64 {
    (a * a + b * b).sqrt()
}

// Several steps of a flight together.

/// Doublings of a step; a larger one is never needed.
pub(super) const LEVELS: usize = 20;

/// A level whose numbers are larger than this is of no use.
const LARGEST: f64 = 1e100;

/// How the end of `2^j` steps depends on their start.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct DoublingLevel {
    /// `x` and `V`.
    ends: LinearColumns<2>,
    /// `e^(i W 2^j)` as cosine and sine.
    turn: [[f64; 2]; WAVES],
    /// Of `h^2 |x''|` in between.
    bend: Bound,
}

impl DoublingLevel {
    /// One step.
    pub(super) fn first(
        series: &LinearColumns<TERMS>,
        law: Law,
        h: f64,
        turns: [f64; WAVES],
    ) -> Self {
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
        Self { ends: LinearColumns(ends), turn: turns.map(turn), bend }
    }

    /// Position and velocity, times the length of a step, at the end.
    #[inline(always)]
    pub(super) fn ends<const W: usize>(&self, start: &SeriesStart) -> [f64; 2] {
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
    /// the level: `x + s V - s^2 B/2 > 0` at their end implies it in between.
    #[inline(always)]
    pub(super) fn is_clear<const W: usize>(&self, start: &SeriesStart, length: f64) -> bool {
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
        Self { ends: LinearColumns(ends), turn: turns.map(turn), bend }
    }

    pub(super) fn is_tame(&self) -> bool {
        let numbers = self.ends.0.iter().flatten().chain(&self.bend.0);
        // not so for NaN
        numbers.into_iter().all(|number| number.abs() < LARGEST)
    }
}

/// Cosine and sine of an angle in turns.
fn turn(turns: f64) -> [f64; 2] {
    let (sin, cos) = sin_cos(turns);
    [cos, sin]
}

// Which steps have no root, or one: by Bernstein coefficients.
//
// The coefficients of degree 11 are linear in where the step starts, so a table has their columns.
// They enclose the polynomial, and the number of their changes of sign bounds that of its roots;
// the remaining terms are a slack, which is also linear.

/// Coefficients of the screen.
pub(super) const SCREEN: usize = 12;

/// Rounding of a value, relative to the sum of the absolute values of the terms.
const SUM_ROUNDING: f64 = 2e-15;

/// Result of the screen for a polynomial that starts positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SignTest {
    /// It stays so over `[0, 1]`.
    Clear,
    /// It has one root, near here.
    One(f64),
    Open,
}

/// Columns of Bernstein coefficients, and the slack.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Screen {
    coefficients: LinearColumns<SCREEN>,
    slack: Bound,
}

impl Screen {
    /// Of series that are divided by `s^known`.
    pub(super) fn new(series: &LinearColumns<TERMS>, known: usize) -> Self {
        let coefficients = series.0.each_ref().map(|a| {
            let mut low = [0.0; SCREEN];
            low.copy_from_slice(&a[known..known + SCREEN]);
            bernstein(low)
        });
        let slack = Bound::sizes(|c| {
            let (low, high) = series.0[c].split_at(known + SCREEN);
            slack(low, high)
        });
        Self { coefficients: LinearColumns(coefficients), slack }
    }

    #[inline(always)]
    pub(super) fn of<const W: usize>(&self, start: &SeriesStart) -> SignTest {
        verdict(&self.coefficients.of::<W, SCREEN>(start), self.slack.of::<W>(start))
    }
}

/// The same of a series, a root of whose has been divided out.
#[inline(always)]
pub(super) fn screened(q: &[f64; TERMS]) -> SignTest {
    let mut low = [0.0; SCREEN];
    low.copy_from_slice(&q[..SCREEN]);
    verdict(&bernstein(low), slack(&low, &q[SCREEN..]))
}

#[inline(always)]
fn bernstein(low: [f64; SCREEN]) -> [f64; SCREEN] {
    let mut b = [0.0; SCREEN];
    b.copy_from_slice(Polynomial::<SCREEN>::from_powers(low).coefficients());
    b
}

#[inline(always)]
fn slack(low: &[f64], high: &[f64]) -> f64 {
    let size = |a: &[f64]| a.iter().map(|a| a.abs()).sum::<f64>();
    size(high) + SUM_ROUNDING * (size(low) + size(high))
}

#[inline(always)]
fn verdict(b: &[f64; SCREEN], slack: f64) -> SignTest {
    // written so that NaN and a negative zero never are a certificate
    if b.iter().fold(true, |all, &b| all & (b > slack)) {
        return SignTest::Clear;
    }
    let Some(first) = b.iter().position(|&b| b < 0.0) else { return SignTest::Open };
    let one = b[..first].iter().all(|&b| b > slack) && b[first..].iter().all(|&b| b < -slack);
    if !one || first == 0 {
        return SignTest::Open;
    }
    // where the control polygon crosses zero
    let (before, after) = (b[first - 1], b[first]);
    let crossing = (first - 1) as f64 + before / (before - after);
    SignTest::One(crossing / (SCREEN - 1) as f64)
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

#[cfg(test)]
mod level_tests {
    use super::Table;
    use super::*;

    #[test]
    fn a_step_is_clear_that_ends_above_a_billionth_of_the_way() {
        let law = Law { stiffness: 0.0, damping: 0.0, omega: [0.0; 2] };
        let table = Table::new(law, 1.0);
        let level = DoublingLevel::first(&LinearColumns(table.columns()), law, table.h(), [0.0; 2]);
        // from 1 m down by 1 m, all but a part
        let is_clear = |left: f64, length: f64| {
            let start = SeriesStart { x: 1.0, v: -(1.0 - left) / length, ..SeriesStart::default() };
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
        let level = DoublingLevel::first(&LinearColumns(table.columns()), law, h, turns);
        let Bound(bend) = level.bend;
        assert!((bend[3] / (h * h) - 1.0).abs() < 1e-15, "{bend:?} {h}");
    }
}

#[cfg(test)]
mod sign_test_tests {
    use super::*;

    #[test]
    fn only_what_is_beyond_the_slack_is_certain() {
        let all = |b: f64| verdict(&[b; SCREEN], 1.0);
        assert_eq!(all(1.5), SignTest::Clear);
        for b in [1.0, 0.5, -0.5, -1.5, f64::NAN] {
            assert_eq!(all(b), SignTest::Open, "{b}");
        }
        assert_eq!(verdict(&[0.0; SCREEN], 0.0), SignTest::Open);
        // the polygon of 2, ..., 2, -2, ..., -2 crosses zero in the middle of the change
        for first in 1..SCREEN {
            let b: [f64; SCREEN] = std::array::from_fn(|k| if k < first { 2.0 } else { -2.0 });
            let place = (first as f64 - 0.5) / (SCREEN - 1) as f64;
            assert_eq!(verdict(&b, 1.0), SignTest::One(place), "{first}");
            assert_eq!(verdict(&b, 2.0), SignTest::Open, "{first}");
        }
    }
}
