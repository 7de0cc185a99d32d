//! Rest of a mass, and the time of lift-off.
//!
//! When the mass at rest leaves the wall: the first `t` with `phi(t) = f(t, 0, 0) > 0`.
//!
//! Over a window the polynomial of degree 5 through `phi` at Chebyshev's points stands for it.
//! Its coefficients in Bernstein form bound it, and two more evaluations measure its error; an
//! undecided window is halved, and each accepted one is probed between its nodes ([`Probes`]).

use crate::numeric::bernstein::{evaluate, Bernstein};
use crate::numeric::grid::Probes;
use crate::numeric::root;
use crate::record::status::Failure;
use crate::switched::flight::FreeFlight;
use crate::switched::mode::{Mode, Point, Rest};
use crate::switched::stages::Counted;
use crate::{Dependence, Force, Status};

/// `(1 - cos(pi i/5))/2`.
const NODES: [f64; 6] =
    [0.0, 0.09549150281252629, 0.3454915028125263, 0.6545084971874737, 0.9045084971874737, 1.0];

/// Bernstein coefficients from the values at [`NODES`]: the inverse of the matrix of the Bernstein
/// polynomials there.
const FROM_VALUES: [[f64; 6]; 6] = [
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-2.4, 4.188854381999832, -1.1577708763999663, 0.6111456180001682, -0.44222912360003364, 0.2],
    [2.52, -5.294427190999916, 5.8499689437998486, -3.505572809000084, 2.6300310562001514, -1.2],
    [-1.2, 2.6300310562001514, -3.505572809000084, 5.8499689437998486, -5.294427190999916, 2.52],
    [0.2, -0.44222912360003364, 0.6111456180001682, -1.1577708763999663, 4.188854381999832, -2.4],
    [0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
];

/// Where the fit is checked.
const CHECKS: [f64; 2] = [0.2, 0.55];

/// Largest distance between two of all these places.
const APART: f64 = 0.25;

/// Misfit, relative to the values, above which a window is halved, and below which the next one
/// is twice as long.
const MISFIT: (f64, f64) = (1e-4, 1e-6);

/// Misfit that is rounding, relative to the largest force at the wall so far.
const ROUNDING: f64 = 4e-16;

/// Shortest window, relative to the longest so far: where the force jumps.
const SHORTEST: f64 = 1e-6;

/// Result of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Window {
    /// Rest up to this time.
    RestUntil(f64),
    /// The mass lifts off at this time, just after which the force is positive.
    LiftOff(f64),
    /// The force is not finite here or immediately after.
    NotFinite,
}

/// The force at rest over one window.
struct ForceFit {
    values: [f64; 6],
    p: Bernstein,
    scale: f64,
    misfit: f64,
    /// Misfit that is rounding.
    noise: f64,
}

impl ForceFit {
    fn new<E>(
        t: f64,
        first: f64,
        h: f64,
        phi: &mut impl FnMut(f64) -> Result<f64, E>,
    ) -> Result<Self, E> {
        let mut values = [first; 6];
        for (value, node) in values.iter_mut().zip(NODES).skip(1) {
            *value = phi(t + node * h)?;
        }
        let c: [f64; 6] = std::array::from_fn(|i| {
            FROM_VALUES[i].iter().zip(values).map(|(m, value)| m * value).sum()
        });
        let scale = values.iter().fold(0.0_f64, |scale, value| scale.max(value.abs()));
        let mut misfit = 0.0_f64;
        for check in CHECKS {
            let difference = (evaluate(&c, check) - phi(t + check * h)?).abs();
            // f64::max would drop NaN
            misfit = if difference > misfit || difference.is_nan() { difference } else { misfit };
        }
        Ok(Self { values, p: Bernstein::new(&c), scale, misfit, noise: 0.0 })
    }

    fn is_finite(&self) -> bool {
        self.misfit.is_finite() && self.values.iter().all(|value| value.is_finite())
    }

    fn is_poor(&self) -> bool {
        self.misfit > MISFIT.0 * self.scale + self.noise
    }

    /// Whether the misfit leaves open if the force becomes positive.
    fn is_undecided(&self) -> bool {
        let clearly_positive = self.values.iter().any(|&value| value > 5.0 * self.misfit);
        let highest = self.p.coefficients().iter().fold(f64::NEG_INFINITY, |a, &b| a.max(b));
        !clearly_positive && highest > -5.0 * self.misfit && self.misfit > self.noise
    }

    fn is_very_good(&self) -> bool {
        self.misfit <= MISFIT.1 * self.scale + self.noise
    }

    /// Whether a value at `theta` agrees with the polynomial.
    fn conforms(&self, value: f64, theta: f64) -> bool {
        (value - self.p.at(theta)).abs() <= 5.0 * MISFIT.0 * self.scale + self.noise
    }
}

/// The search for lift-offs, with its information about the force from window to window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ForceMonitor {
    /// Length of the next window (s).
    length: Option<f64>,
    /// The longest that was decided (s).
    longest: f64,
    /// The largest force at the wall (m/s^2).
    largest: f64,
    /// Whether windows are probed between their nodes: not if a controller restarts the search in
    /// each of its periods.
    probing: bool,
    probes: Probes,
}

impl ForceMonitor {
    /// The search at the start of a run, with a window of this length first.
    pub(super) fn starting(length: Option<f64>) -> Self {
        Self { length, ..Self::default() }
    }

    /// Forgets what the force was.
    pub(super) fn restart(&mut self) {
        let Self { length, probing, .. } = *self;
        *self = Self { length, probing, ..Self::default() };
    }

    /// Whether there are looks between the nodes of a window.
    pub(super) fn set_probing(&mut self, probing: bool) {
        self.probing = probing;
    }

    /// Length of the next window (s).
    pub(super) fn length(&self) -> Option<f64> {
        self.length
    }

    /// The next window has this length, if one is given.
    pub(super) fn look_as_far_as(&mut self, length: Option<f64>) {
        self.length = length.or(self.length);
    }

    /// Looks at a window from `t` that is at most `longest` long and ends at most at `until`, and
    /// is shorter than that where `phi` demands it. A `phi` that is not finite is NaN or infinite.
    pub(super) fn look<E>(
        &mut self,
        rest: &mut Rest,
        (t, until): (f64, f64),
        longest: f64,
        mut phi: impl FnMut(f64) -> Result<f64, E>,
    ) -> Result<Window, E> {
        let first = phi(t)?;
        if !first.is_finite() {
            return Ok(Window::NotFinite);
        }
        if first > 0.0 {
            return Ok(Window::LiftOff(t));
        }
        rest.horizon = rest.horizon.max(until - t);
        let until = self.probes.end(t, until);
        let mut length = self.length.unwrap_or(until - t).min(longest).min(until - t);
        // at t = 0 there is no rounding of the time yet that ends the search for a jump
        let shortest = (SHORTEST * self.longest)
            .max(32.0 * f64::EPSILON * t.abs())
            .max(f64::EPSILON * rest.horizon);
        let fit = loop {
            let mut fit = ForceFit::new(t, first, length, &mut phi)?;
            if fit.is_finite() {
                self.largest = self.largest.max(fit.scale);
                fit.noise = ROUNDING * self.largest;
                if length <= shortest {
                    break fit;
                }
                if !(fit.is_poor() || fit.is_undecided()) {
                    match self.probe(rest.horizon, (t, length), &fit, &mut phi)? {
                        Some(shorter) => length = shorter,
                        None => break fit,
                    }
                    continue;
                }
            } else if length <= shortest {
                return Ok(Window::NotFinite);
            }
            length *= 0.5;
        };
        self.longest = self.longest.max(length);
        let wanted = self.length.filter(|&wanted| wanted >= length && length >= until - t);
        self.length = Some(if fit.is_very_good() {
            wanted.unwrap_or(length).max(2.0 * length)
        } else {
            length
        });
        let end = if length >= until - t { until } else { t + length };
        if fit.is_poor() {
            return unresolved(t, length, &fit.values, end, &mut phi);
        }
        match fit.p.negated().first_negative() {
            Some(theta) => polish(t, length, theta, end, &mut phi),
            None => Ok(Window::RestUntil(end)),
        }
    }

    /// Looks between the nodes of a window. `None` if the force agrees with them, otherwise the
    /// length of a window that ends at or before the deviation.
    fn probe<E>(
        &mut self,
        horizon: f64,
        (t, length): (f64, f64),
        fit: &ForceFit,
        phi: &mut impl FnMut(f64) -> Result<f64, E>,
    ) -> Result<Option<f64>, E> {
        if !self.probing {
            return Ok(None);
        }
        self.probes.deviation(horizon, (t, length), APART * length, |at| {
            Ok(fit.conforms(phi(t + at)?, at / length))
        })
    }
}

/// The sign change of `phi` near `t + theta length`.
fn polish<E>(
    t: f64,
    length: f64,
    theta: f64,
    end: f64,
    phi: &mut impl FnMut(f64) -> Result<f64, E>,
) -> Result<Window, E> {
    let mut width = 1e-6;
    loop {
        let (a, b) = (t + (theta - width).max(0.0) * length, t + (theta + width) * length);
        let b = b.min(end);
        let (phi_a, phi_b) = (phi(a)?, phi(b)?);
        if phi_a <= 0.0 && phi_b > 0.0 {
            let root = root::becomes_positive((a, phi_a), (b, phi_b), phi)?;
            return Ok(Window::LiftOff(root.beyond));
        }
        if width > 0.5 {
            // a touch: the polynomial crosses zero by its misfit, the force does not
            return Ok(Window::RestUntil(b));
        }
        width *= 8.0;
    }
}

/// The first sign change that the nodes show of a force that no polynomial fits: it jumps.
fn unresolved<E>(
    t: f64,
    length: f64,
    values: &[f64; 6],
    end: f64,
    phi: &mut impl FnMut(f64) -> Result<f64, E>,
) -> Result<Window, E> {
    let Some(i) = values.iter().position(|&value| value > 0.0).filter(|&i| i > 0) else {
        return Ok(Window::RestUntil(end));
    };
    let node = |i: usize| (t + NODES[i] * length, values[i]);
    Ok(Window::LiftOff(root::becomes_positive(node(i - 1), node(i), phi)?.beyond))
}

// Rest at the wall, up to the lift-off.

/// The first step off the wall where the force grows from zero, relative to the last window.
const PART: f64 = 1e-2;

/// Rest up to the first lift-off, within one window of the force; returns whether it reached the
/// lift-off. It goes up to `t_end` and, where the force is sampled, is at most `longest` long.
pub(super) fn wait<E, F: Force<E>>(
    (now, mode): (&mut Point, &mut Mode),
    lookout: &mut ForceMonitor,
    flight: &mut FreeFlight,
    (t_end, longest): (f64, f64),
    force: &mut Counted<'_, F>,
) -> Result<bool, Failure<E>> {
    let from = now.t;
    let mut rest = mode.rest();
    let window = window(*now, &mut rest, lookout, flight, (t_end, longest), force)?;
    *mode = Mode::Rest(rest);
    match window {
        Window::NotFinite => Err(Failure::Status(Status::ForceNotFinite)),
        Window::RestUntil(t) => {
            now.t = t;
            Ok(false)
        }
        Window::LiftOff(t) => {
            (now.t, now.late) = (t, 0.0);
            *mode = Mode::LIFT_OFF;
            if t > from {
                // the force grows from zero, on the scale of the window
                *mode = Mode::SMOOTH_LIFT_OFF;
                let length = lookout.length();
                flight.steps_mut().set_next(length.map(|length| PART * length));
            }
            Ok(true)
        }
    }
}

/// How the force on the mass at rest continues: a window of it.
fn window<E, F: Force<E>>(
    now: Point,
    rest: &mut Rest,
    lookout: &mut ForceMonitor,
    flight: &mut FreeFlight,
    (t_end, longest): (f64, f64),
    force: &mut Counted<'_, F>,
) -> Result<Window, Failure<E>> {
    if force.dependence_at_rest::<E>() == Dependence::Constant {
        let lifts = force.at_wall(now.t)? > 0.0;
        return Ok(if lifts { Window::LiftOff(now.t) } else { Window::RestUntil(t_end) });
    }
    if let Some(next) = flight.lift_off(now, t_end) {
        return Ok(next.map_or(Window::RestUntil(t_end), Window::LiftOff));
    }
    lookout.look(rest, (now.t, t_end), longest, |t| match force.at_wall(t) {
        Err(Failure::Status(_)) => Ok(f64::NAN),
        phi => phi,
    })
}

#[cfg(test)]
mod lift_off_tests {
    use super::*;
    use std::convert::Infallible;

    /// The first lift-off up to `until`, and the number of evaluations.
    fn search(h: f64, until: f64, phi: impl Fn(f64) -> f64) -> (Option<f64>, usize) {
        let (mut t, mut n) = (0.0, 0);
        let mut lookout =
            ForceMonitor { length: Some(h), probing: true, ..ForceMonitor::default() };
        let mut rest = Rest::default();
        while t < until {
            let window = lookout.look(&mut rest, (t, until), f64::INFINITY, |t| {
                n += 1;
                Ok::<f64, Infallible>(phi(t))
            });
            match window {
                Ok(Window::LiftOff(at)) => return (Some(at), n),
                Ok(Window::RestUntil(end)) => t = end,
                Ok(Window::NotFinite) => panic!("not finite"),
            }
        }
        (None, n)
    }

    #[test]
    fn nodes_and_matrix_fit_together() {
        for degree in 0..=5 {
            let values = NODES.map(|c| c.powi(degree));
            let c: [f64; 6] = std::array::from_fn(|i| {
                FROM_VALUES[i].iter().zip(values).map(|(m, value)| m * value).sum()
            });
            assert!((evaluate(&c, 0.37) - 0.37f64.powi(degree)).abs() < 1e-15);
        }
    }

    #[test]
    fn the_largest_distance_between_looks_is_known() {
        let mut all: Vec<f64> = NODES.into_iter().chain(CHECKS).collect();
        all.sort_by(f64::total_cmp);
        let apart = all.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        assert!(apart <= APART && apart > 0.99 * APART, "{apart}");
    }

    #[test]
    fn weak_lift_off_is_found_down_to_rounding_of_the_certificate() {
        for decade in 1..=12 {
            let excess = 10f64.powi(-decade);
            let (found, n) = search(1.0, 10.0, |t| -1.0 + (1.0 + excess) * (t - 2.0).cos());
            let exact = 2.0 - (1.0 / (1.0 + excess)).acos();
            // the root of a maximum of height `excess` is known to rounding over its slope
            let tol = 1e-15 / excess.sqrt() * 10.0;
            assert!((found.unwrap() - exact).abs() < tol, "1e-{decade}: {found:?} {exact}");
            assert!(n < 200, "{n}");
        }
    }

    #[test]
    fn no_lift_off_where_there_is_none() {
        for excess in [-1e-3, -1e-6, -1e-9, 0.0] {
            let (found, n) = search(1.0, 10.0, |t| -1.0 + (1.0 + excess) * (t - 2.0).cos());
            // at a touch rounding decides
            assert!(found.is_none() || excess == 0.0, "{excess}: {found:?}");
            assert!(n < 5000, "{n}");
        }
        let (found, n) = search(1.0, 1e6, |_| -9.81);
        assert!(found.is_none() && n < 300, "{found:?} {n}");
    }

    #[test]
    fn pulses_are_seen_if_they_are_not_too_short_for_the_look() {
        // of 10 s: a pulse longer than 1/39 always, whatever ripple the force has
        for ripple in [0.0, 1e-5, 1e-4, 3e-4, 1e-3] {
            for phase in 0..20 {
                let start = 0.5 + 0.431 * f64::from(phase);
                let (found, _) = search(10.0, 10.0, |t| {
                    let push = if t > start && t < start + 10.0 / 39.0 { 15.0 } else { 0.0 };
                    push - 9.81 + ripple * (37.0 * t).sin()
                });
                assert!(found.is_some_and(|t| (t - start).abs() < 1e-9), "{start}: {found:?}");
            }
        }
        // one of them is enough to look closer for the first: periodic ones of 0.1 s each second
        let first = |phase: f64| {
            let pulses = |t: f64| if t > phase && (t - phase).fract() < 0.1 { 5.0 } else { -9.81 };
            search(100.0, 100.0, pulses).0.is_some_and(|t| (t - phase).abs() < 1e-9)
        };
        let seen = (1..40).filter(|&i| first(f64::from(i) / 40.0)).count();
        assert!(seen >= 37, "{seen} of 39");
    }

    #[test]
    fn forces_that_start_at_zero_or_jump() {
        let (rising, _) = search(1.0, 10.0, |t| t.sin());
        assert!(rising.unwrap() < 1e-6, "{rising:?}");
        let (falling, _) = search(1.0, 10.0, |t| -t.sin());
        assert!((falling.unwrap() - std::f64::consts::PI).abs() < 1e-14);
        assert_eq!(search(1.0, 10.0, |_| 0.0).0, None);
        let (step, n) = search(1.0, 10.0, |t| if t < 4.7 { -1.0 } else { 2.0 });
        assert!((step.unwrap() - 4.7).abs() < 1e-11 && n < 600, "{step:?} {n}");
        let (at_once, n) = search(1.0, 10.0, |t| if t <= 0.0 { -1.0 } else { 2.0 });
        assert!(at_once.is_some_and(|t| t > 0.0 && t < 1e-15) && n < 600, "{at_once:?} {n}");
    }
}
