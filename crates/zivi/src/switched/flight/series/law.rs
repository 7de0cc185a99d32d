//! A linear force with its waves on clocks of their own.

use super::terms::{Law, WAVES};
use crate::numeric::turns::{of_angle, sin_cos, Clock, Phase};
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
    /// What waves that do not turn add to it.
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
