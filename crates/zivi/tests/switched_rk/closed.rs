//! An event simulation of linear forces in closed form, which shares no code with the library.
//!
//! Between events `x'' = -k x - c x' - g + a cos(w t + phase)` is solved exactly, over short
//! flights by its Taylor series (the closed form cancels there). Impacts are bracketed by a walk in
//! small steps that also looks at every minimum. An impact sequence is closed by the expansion of the Zeno
//! time in the speed, whose error at the speed where it is used is below rounding. The lift-off of
//! `a cos(w t + phase) = g` is elementary.

use zivi::LinearForce;

/// Events in order.
#[derive(Debug, Default)]
pub(crate) struct Story {
    /// Time and speed after each impact, down to [`SLOW`].
    pub(crate) impacts: Vec<[f64; 2]>,
    pub(crate) zeno: Vec<f64>,
    pub(crate) lift: Vec<f64>,
    /// Position and velocity at the end.
    pub(crate) end: [f64; 2],
}

/// Speed below which an impact sequence is closed by its expansion.
const SLOW: f64 = 1e-7;

fn force(f: &LinearForce, t: f64, x: f64, v: f64) -> f64 {
    -f.stiffness * x - f.damping * v - f.gravity + f.amplitude * (f.omega * t + f.phase).cos()
}

/// The motion from `(t, x, v)` without a wall.
pub(crate) struct Flight {
    f: LinearForce,
    t: f64,
    x: f64,
    v: f64,
    /// Taylor coefficients of `x`.
    taylor: [f64; 25],
    fastest: f64,
}

impl Flight {
    pub(crate) fn new(f: LinearForce, t: f64, x: f64, v: f64) -> Self {
        let mut derivative = [0.0; 25];
        (derivative[0], derivative[1]) = (x, v);
        for n in 0..23 {
            let turn = f.omega * t + f.phase + n as f64 * std::f64::consts::FRAC_PI_2;
            let mut forcing = f.amplitude * f.omega.powi(n as i32) * turn.cos();
            if n == 0 {
                forcing -= f.gravity;
            }
            derivative[n + 2] =
                -f.stiffness * derivative[n] - f.damping * derivative[n + 1] + forcing;
        }
        let mut taylor = derivative;
        let mut factorial = 1.0;
        for (n, value) in taylor.iter_mut().enumerate().skip(1) {
            factorial *= n as f64;
            *value /= factorial;
        }
        let fastest = f.omega.max(f.stiffness.sqrt()).max(f.damping);
        Self { f, t, x, v, taylor, fastest }
    }

    /// Position and velocity after `tau`.
    pub(crate) fn at(&self, tau: f64) -> [f64; 2] {
        if tau * self.fastest < 0.5 {
            let (mut x, mut v) = (0.0, 0.0);
            for n in (0..25).rev() {
                x = x * tau + self.taylor[n];
                if n > 0 {
                    v = v * tau + n as f64 * self.taylor[n];
                }
            }
            return [x, v];
        }
        if self.f.stiffness > 0.0 {
            self.spring(tau)
        } else {
            self.free(tau)
        }
    }

    /// `k > 0`, `c^2 < 4 k`.
    fn spring(&self, tau: f64) -> [f64; 2] {
        let LinearForce { stiffness: k, damping: c, gravity: g, amplitude: a, omega: w, phase } =
            self.f;
        let (p, q) = (k - w * w, c * w);
        let scale = a / (p * p + q * q);
        let particular = |t: f64| {
            let (sin, cos) = (w * t + phase).sin_cos();
            [-g / k + scale * (p * cos + q * sin), scale * w * (q * cos - p * sin)]
        };
        let [x0, v0] = particular(self.t);
        let (dx, dv) = (self.x - x0, self.v - v0);
        let (mu, wd) = (0.5 * c, (k - 0.25 * c * c).sqrt());
        let b = (dv + mu * dx) / wd;
        let (sin, cos) = (wd * tau).sin_cos();
        let decay = (-mu * tau).exp();
        let [x1, v1] = particular(self.t + tau);
        let x = decay * (dx * cos + b * sin);
        [x1 + x, v1 - mu * x + decay * wd * (b * cos - dx * sin)]
    }

    /// `k = c = 0`.
    fn free(&self, tau: f64) -> [f64; 2] {
        let LinearForce { gravity: g, amplitude: a, omega: w, phase, .. } = self.f;
        let (s0, c0) = (w * self.t + phase).sin_cos();
        let (s1, c1) = (w * (self.t + tau) + phase).sin_cos();
        let slope = self.v - a / w * s0;
        let x = self.x + slope * tau - g * tau * tau / 2.0 - a / (w * w) * (c1 - c0);
        [x, slope - g * tau + a / w * s1]
    }

    /// Duration of the flight and velocity at its end, if it ends within `longest`.
    pub(crate) fn first_impact(&self, longest: f64) -> Option<[f64; 2]> {
        let base = 0.02 / self.fastest;
        let pull = -force(&self.f, self.t, 0.0, self.v);
        let mut dt = 0.05 * base;
        if self.x == 0.0 && self.v > 0.0 && pull > 0.0 {
            dt = dt.min(2.0 * self.v / pull / 6.0);
        }
        let (mut a, mut va) = (0.0, self.v);
        loop {
            let b = a + dt;
            let [x, v] = self.at(b);
            if x < 0.0 {
                return self.root(a, b, longest);
            }
            if va < 0.0 && v > 0.0 {
                let low = bisect(a, b, |tau| self.at(tau)[1] > 0.0);
                if self.at(low)[0] < 0.0 {
                    return self.root(a, low, longest);
                }
            }
            if b > longest {
                return None;
            }
            (a, va, dt) = (b, v, (1.3 * dt).min(base));
        }
    }

    fn root(&self, a: f64, b: f64, longest: f64) -> Option<[f64; 2]> {
        let tau = bisect(a, b, |tau| tau > 0.0 && self.at(tau)[0] <= 0.0);
        (tau <= longest).then(|| [tau, self.at(tau)[1]])
    }
}

/// Where `after` becomes true between `a` and `b`.
fn bisect(mut a: f64, mut b: f64, after: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..200 {
        let middle = 0.5 * (a + b);
        if middle <= a || middle >= b {
            break;
        }
        if after(middle) {
            b = middle;
        } else {
            a = middle;
        }
    }
    b
}

/// Time from an impact with the small speed `u` after it to rest, up to `u^2`.
fn time_to_rest(f: &LinearForce, e: f64, t: f64, u: f64) -> f64 {
    let g = -force(f, t, 0.0, 0.0);
    let a = -f.amplitude * f.omega * (f.omega * t + f.phase).sin();
    let c = -f.damping;
    let z1 = 2.0 / (g * (1.0 - e));
    let b = 2.0 / (3.0 * g) * (c - a / g);
    let bend = 4.0 * a / (3.0 * g.powi(3)) + 2.0 * c / (3.0 * g * g);
    let z2 = (bend + z1 * e * b + 2.0 * e / g * (2.0 * a / (g * g * (1.0 - e)))) / (1.0 - e * e);
    z1 * u + z2 * u * u
}

/// The first time from `t` at which the force at the wall is positive just after it.
fn lift_off(f: &LinearForce, t: f64) -> Option<f64> {
    if force(f, t, 0.0, 0.0) > 0.0 {
        return Some(t);
    }
    if f.amplitude <= f.gravity {
        return None;
    }
    let turn = 2.0 * std::f64::consts::PI;
    let rising = -(f.gravity / f.amplitude).acos() - f.phase;
    let n = ((f.omega * t - rising) / turn).ceil();
    Some((rising + n * turn) / f.omega)
}

/// The motion from `(t, x, v)` to `t_end`.
pub(crate) fn simulate(f: LinearForce, e: f64, span: (f64, f64), state: (f64, f64)) -> Story {
    let ((mut t, t_end), (mut x, mut v)) = (span, state);
    let mut story = Story::default();
    loop {
        let flight = Flight::new(f, t, x, v);
        let Some([tau, before]) = flight.first_impact(t_end - t) else {
            story.end = flight.at(t_end - t);
            return story;
        };
        (t, x, v) = (t + tau, 0.0, -e * before);
        story.impacts.push([t, v]);
        if v < SLOW && force(&f, t, 0.0, 0.0) < 0.0 {
            t += time_to_rest(&f, e, t, v);
            if t > t_end {
                return story;
            }
            story.zeno.push(t);
            v = 0.0;
            match lift_off(&f, t).filter(|&lift| lift < t_end) {
                Some(lift) => t = lift,
                None => return story,
            }
            story.lift.push(t);
        }
    }
}
