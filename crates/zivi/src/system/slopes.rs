//! Forces with their partial derivatives: by time, by the state, by parameters.
//!
//! Parameters are numbered: those of [`LinearForce`] in the order of its fields, those of a moving
//! wall after those of the force.

use super::force::WallMotion;
use crate::{
    ConstantForce, Force, HarmonicWall, LinearForce, LinearLaw, LinearRate, OnMovingWall, Wave,
};

/// The partial derivatives of a force `f(t, x, x')` at a point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Slopes {
    /// By time (m/s^3).
    pub t: f64,
    /// By the distance (1/s^2).
    pub x: f64,
    /// By the velocity (1/s).
    pub xdot: f64,
}

/// A point in time and state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Time (s).
    pub t: f64,
    /// Distance from the wall (m).
    pub x: f64,
    /// Velocity (m/s).
    pub xdot: f64,
    /// Times between which the force is smooth: it is evaluated at no others (s).
    pub within: (f64, f64),
}

impl Place {
    /// A point of a force that is smooth at all times.
    #[must_use]
    pub const fn new(t: f64, x: f64, xdot: f64) -> Self {
        Self { t, x, xdot, within: (f64::NEG_INFINITY, f64::INFINITY) }
    }
}

/// A force whose partial derivatives are known.
pub trait DifferentiableForce<E>: Force<E> {
    /// How many parameters it has.
    fn parameters(&self) -> usize;

    /// The partial derivatives by time (zero may be returned where `by_time` is false) and state,
    /// and into `out` those by the parameters `by`, one for each.
    ///
    /// # Errors
    /// Whatever the implementation raises.
    fn slopes(
        &mut self,
        at: Place,
        by_time: bool,
        by: &[usize],
        out: &mut [f64],
    ) -> Result<Slopes, E>;

    /// The derivative by a parameter as a linear force, where it and the force are that.
    fn linear_rate(&self, _index: usize) -> Option<LinearRate> {
        None
    }
}

impl<E, F: DifferentiableForce<E> + ?Sized> DifferentiableForce<E> for &mut F {
    fn parameters(&self) -> usize {
        (**self).parameters()
    }

    fn slopes(
        &mut self,
        at: Place,
        by_time: bool,
        by: &[usize],
        out: &mut [f64],
    ) -> Result<Slopes, E> {
        (**self).slopes(at, by_time, by, out)
    }

    fn linear_rate(&self, index: usize) -> Option<LinearRate> {
        (**self).linear_rate(index)
    }
}

impl<E> DifferentiableForce<E> for ConstantForce {
    fn parameters(&self) -> usize {
        1
    }

    fn slopes(&mut self, _: Place, _: bool, _: &[usize], out: &mut [f64]) -> Result<Slopes, E> {
        out.fill(1.0);
        Ok(Slopes::default())
    }

    fn linear_rate(&self, _: usize) -> Option<LinearRate> {
        Some(LinearRate {
            law: LinearLaw { gravity: -1.0, ..LinearLaw::default() },
            ..LinearRate::default()
        })
    }
}

impl<E> DifferentiableForce<E> for LinearForce {
    fn parameters(&self) -> usize {
        6
    }

    #[inline]
    fn slopes(
        &mut self,
        at: Place,
        by_time: bool,
        by: &[usize],
        out: &mut [f64],
    ) -> Result<Slopes, E> {
        let excited = by_time || by.iter().any(|&index| index > 2);
        let (sin, cos) =
            if excited { (self.omega * at.t + self.phase).sin_cos() } else { (0.0, 0.0) };
        for (out, index) in out.iter_mut().zip(by) {
            *out = match index {
                0 => -at.x,
                1 => -at.xdot,
                2 => -1.0,
                3 => cos,
                4 => -self.amplitude * at.t * sin,
                _ => -self.amplitude * sin,
            };
        }
        let t = -self.amplitude * self.omega * sin;
        Ok(Slopes { t, x: -self.stiffness, xdot: -self.damping })
    }

    fn linear_rate(&self, index: usize) -> Option<LinearRate> {
        let Self { amplitude, omega, phase, .. } = *self;
        let wave = |amplitude| [Wave { amplitude, omega, phase }, Wave::default()];
        let mut rate = LinearRate::default();
        match index {
            0 => rate.law.stiffness = 1.0,
            1 => rate.law.damping = 1.0,
            2 => rate.law.gravity = 1.0,
            3 => rate.law.waves = wave([1.0, 0.0]),
            4 => rate.growing = wave([0.0, amplitude]),
            _ => rate.law.waves = wave([0.0, amplitude]),
        }
        Some(rate)
    }
}

/// How a moving wall depends on time and on its parameters.
pub trait DifferentiableWall<E>: WallMotion<E> {
    /// How many parameters it has.
    fn parameters(&self) -> usize;

    /// `w'''(t)` (m/s^3).
    fn jerk(&self, t: f64) -> f64;

    /// The derivatives of `[w, w', w'']` by a parameter.
    fn by(&self, index: usize, t: f64) -> [f64; 3];
}

impl<E> DifferentiableWall<E> for HarmonicWall {
    fn parameters(&self) -> usize {
        4
    }

    fn jerk(&self, t: f64) -> f64 {
        self.amplitude * self.omega.powi(3) * (self.omega * t + self.phase).sin()
    }

    fn by(&self, index: usize, t: f64) -> [f64; 3] {
        let Self { amplitude: a, omega: w, phase, .. } = *self;
        let (sin, cos) = (w * t + phase).sin_cos();
        match index {
            0 => [cos, -w * sin, -w * w * cos],
            1 => [-a * t * sin, -a * (sin + w * t * cos), -a * w * (2.0 * cos - w * t * sin)],
            2 => [-a * sin, -a * w * cos, a * w * w * sin],
            _ => [1.0, 0.0, 0.0],
        }
    }
}

impl<E, F: DifferentiableForce<E>, W: DifferentiableWall<E>> DifferentiableForce<E>
    for OnMovingWall<F, W>
{
    fn parameters(&self) -> usize {
        self.force.parameters() + self.wall.parameters()
    }

    /// `f_rel = f(t, y + w, y' + w') - w''`, so for any parameter `q` of the wall
    /// `f_rel,q = f_x w_q + f_v w'_q - w''_q`, and `f_rel,t = f_t + f_x w' + f_v w'' - w'''`.
    fn slopes(
        &mut self,
        at: Place,
        by_time: bool,
        by: &[usize],
        out: &mut [f64],
    ) -> Result<Slopes, E> {
        let [w, wdot, wddot] = self.wall.at(at.t)?;
        let fixed = Place { x: at.x + w, xdot: at.xdot + wdot, ..at };
        let own = self.force.parameters();
        let mut slopes = Slopes::default();
        let mut known = false;
        for (out, &index) in out.iter_mut().zip(by) {
            if index < own {
                slopes = self.force.slopes(fixed, by_time, &[index], std::slice::from_mut(out))?;
                known = true;
            }
        }
        if !known {
            slopes = self.force.slopes(fixed, by_time, &[], &mut [])?;
        }
        for (out, &index) in out.iter_mut().zip(by) {
            if index >= own {
                let [w, wdot, wddot] = self.wall.by(index - own, at.t);
                *out = slopes.x * w + slopes.xdot * wdot - wddot;
            }
        }
        slopes.t += slopes.x * wdot + slopes.xdot * wddot - self.wall.jerk(at.t);
        Ok(slopes)
    }

    fn linear_rate(&self, index: usize) -> Option<LinearRate> {
        let (wall, own) = (self.wall.harmonic()?, self.force.parameters());
        if let Some(of_wall) = index.checked_sub(own) {
            return Some(wall.frame_by(of_wall, &self.force.linear()?));
        }
        let rate = self.force.linear_rate(index)?;
        Some(LinearRate { law: wall.frame_of_rate(rate.law)?, ..rate })
    }
}

/// The numbers that a force depends on, which a difference may change for a moment.
pub trait Parametrised {
    /// All of them.
    fn values(&mut self) -> &mut [f64] {
        &mut []
    }
}

impl<F> Parametrised for crate::FunctionForce<F> {}

/// A force whose partial derivatives are taken by central differences.
///
/// The steps are `eps^(1/3)` of the largest value seen so far: what rounding and the curvature of
/// the force leave is about `1e-10` of the force.
#[derive(Clone, Debug)]
pub struct Differenced<F> {
    /// The force.
    pub force: F,
    parameters: usize,
    /// Largest magnitudes of time, distance, velocity so far.
    scale: [f64; 3],
}

/// `eps^(1/3)`
const THIRD: f64 = 6.055_454_452_393_343e-6;

impl<F: Parametrised> Differenced<F> {
    /// Finite differences of a force over a duration (s).
    pub fn new(mut force: F, duration: f64) -> Self {
        let parameters = force.values().len();
        Self { force, parameters, scale: [duration.abs().min(1.0), 0.0, 0.0] }
    }
}

/// The step of a central difference about `value`, exact in binary.
pub fn difference_step(value: f64, scale: f64) -> f64 {
    let h = THIRD * if scale > 0.0 { scale } else { 1.0 };
    let up = value + h;
    up - value
}

/// A central difference of `f` about `value`, one-sided (upwards) where the lower side has none.
///
/// # Errors
/// What `f` raises above.
pub fn central<E>(
    value: f64,
    scale: f64,
    mut f: impl FnMut(f64) -> Result<f64, E>,
) -> Result<f64, E> {
    let h = difference_step(value, scale);
    let up = f(value + h)?;
    match f(value - h) {
        Ok(down) if down.is_finite() => Ok((up - down) / (2.0 * h)),
        _ => Ok((up - f(value)?) / h),
    }
}

/// A difference by time that asks within a window only: near its ends that of a parabola.
fn by_time_within<E>(
    t: f64,
    scale: f64,
    (low, high): (f64, f64),
    mut f: impl FnMut(f64) -> Result<f64, E>,
) -> Result<f64, E> {
    let h = difference_step(t, scale);
    if t - h >= low && t + h <= high {
        return central(t, scale, f);
    }
    let side = if t + 2.0 * h <= high { h } else { -h };
    let (here, near, far) = (f(t)?, f(t + side)?, f(t + 2.0 * side)?);
    Ok((4.0 * near - far - 3.0 * here) / (2.0 * side))
}

impl<E, F: Force<E>> Force<E> for Differenced<F> {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        self.force.at(t, x, xdot)
    }

    fn dependence(&self) -> crate::Dependence {
        self.force.dependence()
    }

    fn dependence_at_rest(&self) -> crate::Dependence {
        self.force.dependence_at_rest()
    }

    fn shortest_period(&self) -> Option<f64> {
        self.force.shortest_period()
    }

    fn is_interruption(&self, error: &E) -> bool {
        self.force.is_interruption(error)
    }
}

impl<E, F: Force<E> + Parametrised> DifferentiableForce<E> for Differenced<F> {
    fn parameters(&self) -> usize {
        self.parameters
    }

    fn slopes(
        &mut self,
        at: Place,
        by_time: bool,
        by: &[usize],
        out: &mut [f64],
    ) -> Result<Slopes, E> {
        let Place { t, x, xdot, within } = at;
        for (out, &index) in out.iter_mut().zip(by) {
            let value = self.force.values()[index];
            let force = &mut self.force;
            let slope = central(value, value.abs(), |moved| {
                force.values()[index] = moved;
                force.at(t, x, xdot)
            });
            self.force.values()[index] = value;
            *out = slope?;
        }
        self.scale[1] = self.scale[1].max(x.abs());
        self.scale[2] = self.scale[2].max(xdot.abs());
        let [of_t, of_x, of_xdot] = self.scale;
        let force = &mut self.force;
        Ok(Slopes {
            t: if by_time {
                by_time_within(t, of_t, within, |t| force.at(t, x, xdot))?
            } else {
                0.0
            },
            x: central(x, of_x, |x| force.at(t, x, xdot))?,
            xdot: central(xdot, of_xdot, |xdot| force.at(t, x, xdot))?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    const PLACE: Place = Place::new(0.7, 0.4, -1.3);

    fn linear(values: [f64; 6]) -> LinearForce {
        let [stiffness, damping, gravity, amplitude, omega, phase] = values;
        LinearForce { stiffness, damping, gravity, amplitude, omega, phase }
    }

    fn wall(values: [f64; 4]) -> HarmonicWall {
        let [amplitude, omega, phase, offset] = values;
        HarmonicWall { amplitude, omega, phase, offset }
    }

    fn value(force: &mut impl Force<Infallible>, at: Place) -> f64 {
        let Ok(value) = force.at(at.t, at.x, at.xdot);
        value
    }

    /// Central differences of fourth order.
    fn difference(f: impl Fn(f64) -> f64) -> f64 {
        let h = 1e-3;
        (8.0 * (f(h) - f(-h)) - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h)
    }

    #[test]
    fn derivatives_of_a_force_above_a_moving_wall_are_those_of_differences() {
        let (forces, walls) = ([1.2, 0.3, 9.0, 2.0, 1.7, 0.4], [0.3, 2.1, -0.6, 0.1]);
        let moving = |f: [f64; 6], w: [f64; 4]| OnMovingWall { force: linear(f), wall: wall(w) };
        let by: Vec<usize> = (0..10).collect();
        let mut out = [0.0; 10];
        let mut force = moving(forces, walls);
        let known: Result<Slopes, Infallible> = force.slopes(PLACE, true, &by, &mut out);
        let Ok(known) = known;
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-9 * (1.0 + b.abs()), "{a} {b}");
        let at = |place| value(&mut moving(forces, walls), place);
        close(known.t, difference(|h| at(Place { t: PLACE.t + h, ..PLACE })));
        close(known.x, difference(|h| at(Place { x: PLACE.x + h, ..PLACE })));
        close(known.xdot, difference(|h| at(Place { xdot: PLACE.xdot + h, ..PLACE })));
        for index in by {
            let moved = |h: f64| {
                let (mut f, mut w) = (forces, walls);
                *f.iter_mut().chain(&mut w).nth(index).unwrap() += h;
                value(&mut moving(f, w), PLACE)
            };
            close(out[index], difference(moved));
        }
    }

    #[test]
    fn differences_are_right_to_their_own_error() {
        let f =
            |t: f64, x: f64, v: f64| Ok::<f64, Infallible>((3.0 * t).sin() * x * x - 0.2 * v * x);
        let mut force = Differenced::new(crate::FunctionForce(f), 1.0);
        let Ok(known) = force.slopes(PLACE, true, &[], &mut []);
        let Place { t, x, xdot, .. } = PLACE;
        let exact =
            [3.0 * (3.0 * t).cos() * x * x, 2.0 * x * (3.0 * t).sin() - 0.2 * xdot, -0.2 * x];
        for (known, exact) in [known.t, known.x, known.xdot].iter().zip(exact) {
            assert!((known - exact).abs() < 1e-9, "{known} {exact}");
        }
    }

    #[test]
    fn differences_by_time_stay_on_their_side_of_a_jump() {
        let f = |t: f64, _: f64, _: f64| Ok::<f64, Infallible>(t.sin() + f64::from(t > 0.7));
        let mut force = Differenced::new(crate::FunctionForce(f), 1.0);
        for (t, within) in [(0.7 - 1e-9, (0.0, 0.7 - 1e-9)), (0.7 + 1e-9, (0.7 + 1e-9, 2.0))] {
            let place = Place { within, ..Place::new(t, 0.4, -1.3) };
            let Ok(known) = force.slopes(place, true, &[], &mut []);
            assert!((known.t - t.cos()).abs() < 1e-8, "{t}: {}", known.t);
        }
    }
}
