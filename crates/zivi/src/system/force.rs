//! Forces, dry friction, and declared breaks of forces.
//!
//! Forces per unit mass, `f(t, x, x')` in m/s^2.

use zivi_core::cosine;

/// Arguments on which a force depends, which determine the implicit part of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dependence {
    /// On nothing: evaluated once a run.
    Constant,
    /// On time only: evaluated once a step.
    Time,
    /// On the state: the step is implicit in it.
    State,
}

/// One wave of a linear force, `Re (p + i q) e^(i (omega t + phase))`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wave {
    /// `p` and `q` (m/s^2).
    pub amplitude: [f64; 2],
    /// Angular frequency (rad/s).
    pub omega: f64,
    /// Phase (rad).
    pub phase: f64,
}

/// A force that is linear in the state, with waves of time:
///
/// ```text
/// f = -stiffness x - damping x' - gravity + sum_m Re (p_m + i q_m) e^(i (omega_m t + phase_m))
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinearLaw {
    /// Stiffness per unit mass (1/s^2).
    pub stiffness: f64,
    /// Damping per unit mass (1/s).
    pub damping: f64,
    /// Constant acceleration towards the wall (m/s^2).
    pub gravity: f64,
    /// Waves; those that are not there have no amplitude.
    pub waves: [Wave; 2],
}

/// The derivative of a linear force by a parameter, a linear force whose waves may grow:
///
/// ```text
/// f_q = -k_q x - c_q x' - g_q + sum_m Re (a_m + b_m t) e^(i (omega_m t + phase_m))
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinearRate {
    /// The constant part.
    pub law: LinearLaw,
    /// The waves that are multiplied by the time, their amplitudes in m/s^3.
    pub growing: [Wave; 2],
}

/// A force per unit mass. `E` is the error type of an evaluation (an exception of a callable).
pub trait Force<E> {
    /// `f(t, x, x')` in m/s^2, `t` in s, `x` in m, `xdot` in m/s.
    ///
    /// # Errors
    /// Errors of the implementation; they end the run, which keeps its results so far.
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E>;

    /// Arguments on which the value depends.
    fn dependence(&self) -> Dependence {
        Dependence::State
    }

    /// Dependence of the force `f(t, 0, 0)` on the mass at rest at the wall.
    fn dependence_at_rest(&self) -> Dependence {
        match self.shortest_period() {
            Some(f64::INFINITY) => Dependence::Constant,
            _ => self.dependence(),
        }
    }

    /// The shortest period in how it depends on time (s), where that is known, infinite where it
    /// does not: between looks that are closer than that it holds no surprise, such as a pulse.
    fn shortest_period(&self) -> Option<f64> {
        (self.dependence() == Dependence::Constant).then_some(f64::INFINITY)
    }

    /// The linear law of a linear force, whose flights are known to rounding.
    fn linear(&self) -> Option<LinearLaw> {
        None
    }

    /// Whether another one has the same values, where that is certain: masses of a batch share them.
    fn is_same(&self, _other: &Self) -> bool
    where
        Self: Sized,
    {
        false
    }

    /// The force as a bit-identical [`LinearForce`], if possible.
    fn as_linear_force(&self) -> Option<LinearForce> {
        None
    }

    /// The time-dependent part, for [`Force::excited`], if the force is a function of it and the
    /// state: a step may evaluate several states at one time.
    #[inline]
    fn excitation(&self, _t: f64) -> Option<f64> {
        None
    }

    /// `f(t, x, x')` by the excitation at that time, to the last bit what [`Force::at`] gives.
    ///
    /// # Errors
    /// As [`Force::at`].
    #[inline]
    fn excited(&mut self, _excitation: f64, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        self.at(t, x, xdot)
    }

    /// Whether an error has nothing to do with the state (an interruption): for x < 0 the force is
    /// then not evaluated again at the wall.
    fn is_interruption(&self, _error: &E) -> bool {
        false
    }
}

/// A borrowed force, possibly of dynamic type (`dyn`).
impl<E, F: Force<E> + ?Sized> Force<E> for &mut F {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        (**self).at(t, x, xdot)
    }

    fn dependence(&self) -> Dependence {
        (**self).dependence()
    }

    fn dependence_at_rest(&self) -> Dependence {
        (**self).dependence_at_rest()
    }

    fn shortest_period(&self) -> Option<f64> {
        (**self).shortest_period()
    }

    fn linear(&self) -> Option<LinearLaw> {
        (**self).linear()
    }

    fn as_linear_force(&self) -> Option<LinearForce> {
        (**self).as_linear_force()
    }

    fn excitation(&self, t: f64) -> Option<f64> {
        (**self).excitation(t)
    }

    fn excited(&mut self, excitation: f64, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        (**self).excited(excitation, t, x, xdot)
    }

    fn is_interruption(&self, error: &E) -> bool {
        (**self).is_interruption(error)
    }
}

/// The same force everywhere and always.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConstantForce(
    /// The force (m/s^2).
    pub f64,
);

impl<E> Force<E> for ConstantForce {
    fn at(&mut self, _: f64, _: f64, _: f64) -> Result<f64, E> {
        Ok(self.0)
    }

    fn dependence(&self) -> Dependence {
        Dependence::Constant
    }

    fn linear(&self) -> Option<LinearLaw> {
        Some(LinearLaw { gravity: -self.0, ..LinearLaw::default() })
    }

    fn is_same(&self, other: &Self) -> bool {
        self == other
    }
}

/// `f = -stiffness x - damping x' - gravity + amplitude cos(omega t + phase)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearForce {
    /// Stiffness per unit mass (1/s^2).
    pub stiffness: f64,
    /// Damping per unit mass (1/s).
    pub damping: f64,
    /// Constant acceleration towards the wall (m/s^2).
    pub gravity: f64,
    /// Amplitude of the excitation (m/s^2).
    pub amplitude: f64,
    /// Angular frequency of the excitation (rad/s).
    pub omega: f64,
    /// Phase of the excitation (rad).
    pub phase: f64,
}

impl LinearForce {
    /// The excitation at a time.
    #[inline]
    fn wave(&self, t: f64) -> f64 {
        if self.amplitude == 0.0 {
            0.0
        } else {
            self.amplitude * cosine::cos(self.omega * t + self.phase)
        }
    }

    /// The force by the excitation.
    #[inline]
    fn by(&self, excitation: f64, x: f64, xdot: f64) -> f64 {
        -self.stiffness * x - self.damping * xdot - self.gravity + excitation
    }
}

impl<E> Force<E> for LinearForce {
    #[inline]
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        Ok(self.by(self.wave(t), x, xdot))
    }

    #[inline]
    fn excitation(&self, t: f64) -> Option<f64> {
        Some(self.wave(t))
    }

    #[inline]
    fn excited(&mut self, excitation: f64, _: f64, x: f64, xdot: f64) -> Result<f64, E> {
        Ok(self.by(excitation, x, xdot))
    }

    fn dependence(&self) -> Dependence {
        if self.stiffness != 0.0 || self.damping != 0.0 {
            Dependence::State
        } else {
            Force::<E>::dependence_at_rest(self)
        }
    }

    fn dependence_at_rest(&self) -> Dependence {
        if self.amplitude != 0.0 {
            Dependence::Time
        } else {
            Dependence::Constant
        }
    }

    fn shortest_period(&self) -> Option<f64> {
        let varies = self.amplitude != 0.0 && self.omega != 0.0;
        Some(if varies { std::f64::consts::TAU / self.omega.abs() } else { f64::INFINITY })
    }

    fn is_same(&self, other: &Self) -> bool {
        self == other
    }

    fn as_linear_force(&self) -> Option<LinearForce> {
        Some(*self)
    }

    #[inline]
    fn linear(&self) -> Option<LinearLaw> {
        let Self { stiffness, damping, gravity, amplitude, omega, phase } = *self;
        let wave = Wave { amplitude: [amplitude, 0.0], omega, phase };
        Some(LinearLaw { stiffness, damping, gravity, waves: [wave, Wave::default()] })
    }
}

/// Any function `f(t, x, x')`.
pub struct FunctionForce<F>(
    /// The function.
    pub F,
);

impl<E, F: FnMut(f64, f64, f64) -> Result<f64, E>> Force<E> for FunctionForce<F> {
    #[inline]
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        (self.0)(t, x, xdot)
    }
}

// Dry friction: forces along directions in which a system slips, or sticks.
//
// ```text
// w_c = B_c q' + beta_c      f_c = -mu_c lambda_i sigma_c  at a gap i,   f_c = -L_c sigma_c  in a joint
// slip: sigma_c = sign w_c      stick: w_c = 0, |f_c| <= mu_s,c lambda_i,  |f_c| <= L_s,c
// ```
//
// A channel `c` is one such direction. The tangent `B_c` of a gap must have the scale of its
// gradient: where the gap is a distance both are unit vectors pulled back.

/// A direction of friction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Channel {
    /// The gap whose contact force presses; none for a joint or a guide. Two channels of one gap, one after the
    /// other, are the directions of a cone.
    pub gap: Option<usize>,
    /// The tangential restitution in impacts, from 0 to 1.
    pub e_t: f64,
}

/// The law of impacts with friction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FrictionalImpact {
    /// `0 <= P_N perp g+ + e g- >= 0`, `-P_T in mu P_N Sign(w+ + e_t w-)`: Moreau's form.
    #[default]
    Newton,
    /// Compression, then restitution of the impulse.
    Poisson,
    /// Restitution of the work of compression; one contact.
    Stronge,
}

/// The contact force of a compliant gap as a function of its depth `d = -g >= 0` and rate `d'`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ContactForce {
    /// `k d + c d'`, Kelvin and Voigt.
    SpringDamper {
        /// Stiffness (N/m).
        k: f64,
        /// Damping (N s/m).
        c: f64,
    },
    /// `k d^p`, after Hertz with `p = 3/2`.
    Power {
        /// Stiffness (N/m^p).
        k: f64,
        /// Exponent.
        p: f64,
    },
    /// `k d^p (1 + alpha d')`, Hunt and Crossley.
    HuntCrossley {
        /// Stiffness (N/m^p).
        k: f64,
        /// Exponent.
        p: f64,
        /// Damping by stiffness (s/m).
        alpha: f64,
    },
    /// The value of [`crate::system::dynamics::Dynamics::contact_force`].
    Function,
}

impl ContactForce {
    /// Whether its numbers are in range: stiffness above zero, damping not below, an exponent from 1 to 10.
    pub(crate) fn is_valid(self) -> bool {
        let is_stiff = |k: f64| k > 0.0 && k.is_finite();
        let is_damping = |c: f64| c >= 0.0 && c.is_finite();
        let is_exponent = |p: f64| (1.0..=10.0).contains(&p);
        match self {
            Self::SpringDamper { k, c } => is_stiff(k) && is_damping(c),
            Self::Power { k, p } => is_stiff(k) && is_exponent(p),
            Self::HuntCrossley { k, p, alpha } => {
                is_stiff(k) && is_exponent(p) && is_damping(alpha)
            }
            Self::Function => true,
        }
    }

    /// The force at a depth and a rate, unless it is a function. It is extended smoothly to open
    /// gaps, for the stages of a step that ends there.
    pub(crate) fn at(self, depth: f64, rate: f64) -> Option<f64> {
        let power = |p: f64| depth.abs().powf(p).copysign(depth);
        Some(match self {
            Self::SpringDamper { k, c } => k * depth + c * rate,
            Self::Power { k, p } => k * power(p),
            Self::HuntCrossley { k, p, alpha } => k * power(p) * (1.0 + alpha * rate),
            Self::Function => return None,
        })
    }

    /// The derivatives of the force by depth and rate, unless it is a function.
    pub(crate) fn slopes(self, depth: f64, rate: f64) -> Option<[f64; 2]> {
        let power = |p: f64| depth.abs().powf(p).copysign(depth);
        let slope = |p: f64| p * depth.abs().powf(p - 1.0);
        Some(match self {
            Self::SpringDamper { k, c } => [k, c],
            Self::Power { k, p } => [k * slope(p), 0.0],
            Self::HuntCrossley { k, p, alpha } => {
                [k * slope(p) * (1.0 + alpha * rate), k * power(p) * alpha]
            }
            Self::Function => return None,
        })
    }

    /// The derivative of the force by one of its numbers, in the order of their declaration.
    pub(crate) fn by(self, number: usize, depth: f64, rate: f64) -> f64 {
        let power = |p: f64| depth.abs().powf(p).copysign(depth);
        let logarithm = if depth == 0.0 { 0.0 } else { depth.abs().ln() };
        match (self, number) {
            (Self::SpringDamper { .. }, 0) => depth,
            (Self::SpringDamper { .. }, 1) => rate,
            (Self::Power { p, .. }, 0) => power(p),
            (Self::Power { k, p }, 1) => k * power(p) * logarithm,
            (Self::HuntCrossley { p, alpha, .. }, 0) => power(p) * (1.0 + alpha * rate),
            (Self::HuntCrossley { k, p, alpha }, 1) => {
                k * power(p) * logarithm * (1.0 + alpha * rate)
            }
            (Self::HuntCrossley { k, p, .. }, 2) => k * power(p) * rate,
            _ => 0.0,
        }
    }

    /// The numbers `a`, `b`, `c` with which `a + b g + c g'` has the sign of the force below zero;
    /// `None` for a function and for a law whose force is never negative there.
    pub(crate) fn sign(self) -> Option<[f64; 3]> {
        match self {
            Self::SpringDamper { k, c } if c > 0.0 => Some([0.0, -k, -c]),
            Self::HuntCrossley { alpha, .. } if alpha > 0.0 => Some([1.0, 0.0, -alpha]),
            _ => None,
        }
    }
}

/// The friction of a system, and which of its gaps are compliant.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Friction {
    /// Those of the gaps first, in their order.
    pub channels: Vec<Channel>,
    /// The law of impacts at gaps with friction.
    pub law: FrictionalImpact,
    /// Where no motion in contact is possible: an impact without a collision, instead of an end.
    pub impact_without_collision: bool,
    /// The compliant gaps, ascending, with their laws. The friction of such a gap is `mu` times its force.
    pub compliant: Vec<(usize, ContactForce)>,
}

impl Friction {
    /// None.
    #[must_use]
    pub fn none() -> &'static Self {
        static NONE: Friction = Friction {
            channels: Vec::new(),
            law: FrictionalImpact::Newton,
            impact_without_collision: false,
            compliant: Vec::new(),
        };
        &NONE
    }
}

// Times at which the forces are not smooth, as the user declares them.

/// Times between which a system is smooth: it is evaluated at no others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Smooth {
    from: f64,
    to: f64,
}

impl Smooth {
    pub(crate) const ALWAYS: Self = Self { from: f64::NEG_INFINITY, to: f64::INFINITY };

    /// From here on up to there, by more than rounding within, so that each side of a jump has its
    /// own limit.
    fn between(start: f64, end: f64) -> Self {
        let margin = |t: f64| match t.is_finite() {
            true => (4.0 * f64::EPSILON * t.abs()).max(f64::MIN_POSITIVE),
            false => 0.0,
        };
        Self { from: start + margin(start), to: end - margin(end) }
    }

    /// The time at which the system is evaluated instead of `t`.
    #[inline(always)]
    pub(crate) fn nearest(self, t: f64) -> f64 {
        let t = if t < self.from { self.from } else { t };
        if t > self.to {
            self.to
        } else {
            t
        }
    }

    /// Its ends.
    pub(crate) fn ends(self) -> (f64, f64) {
        (self.from, self.to)
    }
}

/// The intervals between the declared times, one after the other.
#[derive(Debug)]
pub(crate) struct Stops<'a> {
    /// Increasing.
    times: &'a [f64],
    /// End of the run.
    t1: f64,
}

impl<'a> Stops<'a> {
    pub(crate) fn new(times: &'a [f64], t1: f64) -> Self {
        Self { times, t1 }
    }

    /// Enters the interval that begins at `t` and returns its end. The system is evaluated within it only.
    pub(crate) fn enter(&mut self, t: f64, smooth: &mut Smooth) -> f64 {
        let passed = self.times.partition_point(|&stop| stop <= t);
        let start = match self.times[..passed].last() {
            Some(&stop) if stop == t => t,
            _ => f64::NEG_INFINITY,
        };
        self.times = &self.times[passed..];
        let stop = self.times.first().copied().filter(|&stop| stop <= self.t1);
        *smooth = Smooth::between(start, stop.unwrap_or(f64::INFINITY));
        stop.unwrap_or(self.t1)
    }
}

// A wall that moves, seen from the wall: `x >= w(t)` becomes `y = x - w(t) >= 0`.
//
// ```text
// y'' = f(t, y + w, y' + w') - w''        y'+ = -e y'-
// ```

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

#[cfg(test)]
mod stops_tests {
    use super::*;

    #[test]
    fn each_stretch_is_asked_on_its_own_side() {
        let (mut stops, mut smooth) = (Stops::new(&[1.0, 2.0], 1.5), Smooth::ALWAYS);
        assert_eq!((smooth.nearest(-1e300), smooth.nearest(1e300)), (-1e300, 1e300));
        assert_eq!(stops.enter(0.0, &mut smooth), 1.0);
        assert!(smooth.nearest(1.0) < 1.0 && smooth.nearest(-5.0) == -5.0);
        // the next one is after the end of the run
        assert_eq!(stops.enter(1.0, &mut smooth), 1.5);
        assert!(smooth.nearest(1.0) > 1.0 && smooth.nearest(9.0) == 9.0);
        assert_eq!(smooth.ends().1, f64::INFINITY);
    }
}
