//! A wall that moves, seen from the wall: `x >= w(t)` becomes `y = x - w(t) >= 0`.
//!
//! ```text
//! y'' = f(t, y + w, y' + w') - w''        y'+ = -e y'-
//! ```

use crate::{Dependence, Force, LinearLaw, LinearRate, Wave};

/// The motion of a wall: position (m), velocity (m/s), acceleration (m/s^2) at a time.
pub trait WallMotion<E> {
    /// `[w(t), w'(t), w''(t)]`.
    ///
    /// # Errors
    /// Errors of the implementation; they end the run, which keeps its results so far.
    fn at(&mut self, t: f64) -> Result<[f64; 3], E>;

    /// The motion as a harmonic wave, if possible.
    fn harmonic(&self) -> Option<HarmonicWall> {
        None
    }
}

/// `w = offset + amplitude cos(omega t + phase)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HarmonicWall {
    /// Amplitude (m).
    pub amplitude: f64,
    /// Angular frequency (rad/s).
    pub omega: f64,
    /// Phase (rad).
    pub phase: f64,
    /// Mean position (m).
    pub offset: f64,
}

impl HarmonicWall {
    /// A linear force in the frame of the wall `w = a cos(Omega t + chi) + offset`, where it has one more
    /// wave; none if it has too many.
    ///
    /// ```text
    /// -k w - c w' - w'' = Re a (Omega^2 - k - i c Omega) e^(i (Omega t + chi)) - k offset.
    /// ```
    pub(crate) fn frame(self, law: LinearLaw) -> Option<LinearLaw> {
        self.seen(law, 1.0)
    }

    /// The same without `w''` of a derivative of the force, which is linear too.
    pub(crate) fn frame_of_rate(self, law: LinearLaw) -> Option<LinearLaw> {
        self.seen(law, 0.0)
    }

    fn seen(self, mut law: LinearLaw, mass: f64) -> Option<LinearLaw> {
        let Self { amplitude, omega, phase, offset } = self;
        // a wall on a wall is no wave more
        let free = law.waves.iter_mut().rev().find(|wave| wave.amplitude == [0.0; 2])?;
        let inertia = mass * (omega * omega);
        let amplitude = [amplitude * (inertia - law.stiffness), -amplitude * law.damping * omega];
        *free = Wave { amplitude, omega, phase };
        law.gravity += law.stiffness * offset;
        Some(law)
    }

    /// How the wave of the frame depends on the amplitude, the angular frequency, the phase or the
    /// offset of the wall, by their numbers 0 to 3.
    pub(crate) fn frame_by(self, index: usize, law: &LinearLaw) -> LinearRate {
        let Self { amplitude: a, omega, phase, .. } = self;
        let [re, im] = [omega * omega - law.stiffness, -law.damping * omega];
        let wave = |amplitude| [Wave { amplitude, omega, phase }, Wave::default()];
        let turned = wave([-a * im, a * re]);
        let mut rate = LinearRate::default();
        match index {
            0 => rate.law.waves = wave([re, im]),
            1 => {
                rate.law.waves = wave([2.0 * a * omega, -a * law.damping]);
                rate.growing = turned;
            }
            2 => rate.law.waves = turned,
            _ => rate.law.gravity = law.stiffness,
        }
        rate
    }
}

impl<E> WallMotion<E> for HarmonicWall {
    #[inline]
    fn at(&mut self, t: f64) -> Result<[f64; 3], E> {
        let (sin, cos) = (self.omega * t + self.phase).sin_cos();
        let swing = self.amplitude * cos;
        let speed = -self.amplitude * self.omega * sin;
        Ok([self.offset + swing, speed, -self.omega * self.omega * swing])
    }

    fn harmonic(&self) -> Option<HarmonicWall> {
        Some(*self)
    }
}

/// A force of the fixed frame as it acts in the frame of a moving wall.
///
/// ```
/// use std::convert::Infallible;
/// use zivi::{ConstantForce, Force, HarmonicWall, OnMovingWall};
/// let wall = HarmonicWall { amplitude: 0.1, omega: 10.0, phase: 0.0, offset: 0.0 };
/// let mut force = OnMovingWall { force: ConstantForce(-9.81), wall };
/// // w'' = -10 m/s^2 at t = 0: the mass is pushed off the wall
/// let push: Result<f64, Infallible> = force.at(0.0, 0.0, 0.0);
/// assert!((push.unwrap() - 0.19).abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnMovingWall<F, W> {
    /// The force in the fixed frame, `f(t, x, x')`.
    pub force: F,
    /// The wall.
    pub wall: W,
}

impl<E, F: Force<E>, W: WallMotion<E>> Force<E> for OnMovingWall<F, W> {
    #[inline]
    fn at(&mut self, t: f64, y: f64, ydot: f64) -> Result<f64, E> {
        let [position, velocity, acceleration] = self.wall.at(t)?;
        Ok(self.force.at(t, y + position, ydot + velocity)? - acceleration)
    }

    fn dependence(&self) -> Dependence {
        match self.force.dependence() {
            Dependence::Constant => Dependence::Time,
            other => other,
        }
    }

    fn is_same(&self, other: &Self) -> bool {
        let walls = self.wall.harmonic().zip(other.wall.harmonic());
        walls.is_some_and(|(one, two)| one == two) && self.force.is_same(&other.force)
    }

    fn linear(&self) -> Option<LinearLaw> {
        self.wall.harmonic()?.frame(self.force.linear()?)
    }

    fn is_interruption(&self, error: &E) -> bool {
        self.force.is_interruption(error)
    }
}
