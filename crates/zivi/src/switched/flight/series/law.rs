//! A linear force with its waves on clocks of their own.

pub(crate) use crate::numeric::power_series::{Series, TERMS};
use crate::numeric::root::{of_angle, sin_cos, Clock, Phase};
use crate::{Dependence, Force, LinearLaw};

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

    /// Sets the constant pull towards the wall (m/s^2).
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
