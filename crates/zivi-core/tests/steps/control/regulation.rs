//! The regulator's step: residuals recomputed, uniqueness by enumeration, exact rest, and the
//! settling time of the regulated mass against its closed form.

use crate::common::control::{random_wall, signed, stable};
use crate::common::Rng;
use zivi_core::control::regulation::{Regulation, RegulationStep};
use zivi_core::control::Gains;
use zivi_core::{transform, Branch, Lifted, Physical, Restitution};

#[derive(Clone, Copy, Debug)]
struct Instance {
    step: RegulationStep,
    z: Lifted,
    f: f64,
}

impl Instance {
    /// Anywhere, near the wall, or crossing it; some numbers exactly zero.
    fn draw(rng: &Rng, gains: Gains, f: f64) -> Self {
        let step =
            RegulationStep { h: rng.log_between(1e-5, 1e-1), restitution: random_wall(rng), gains };
        let reach = step.h * gains.mu1();
        let z = match rng.pick(&[0, 1, 2]) {
            0 => Lifted { s: signed(rng, 1e-12, 1e3), v: signed(rng, 1e-12, 1e3) },
            1 => Lifted {
                s: step.h * reach * signed(rng, 1e-4, 10.0),
                v: reach * signed(rng, 1e-4, 10.0),
            },
            _ => {
                let v = signed(rng, 1e-3, 1e2);
                Lifted { s: -v * step.h * rng.between(0.0, 2.0), v }
            }
        };
        let kept = |value: f64| if rng.chance(0.05) { 0.0 } else { value };
        Instance { step, z: Lifted { s: kept(z.s), v: kept(z.v) }, f }
    }

    /// `(s+, v+)` for these signs and the magnitudes of their terms.
    ///
    /// ```text
    /// v+ = v + h ( ls F - mu1 ls - mu2 lv )/R      s+ = s + h R v+      R = 1 - kappa ls lv
    /// ```
    fn end(&self, [ls, lv]: [f64; 2]) -> ([f64; 2], [f64; 2]) {
        let RegulationStep { h, restitution, gains } = self.step;
        let r = 1.0 - restitution.kappa() * ls * lv;
        let pushes = [ls * self.f * h / r, -gains.mu1() * ls * h / r, -gains.mu2() * lv * h / r];
        let v = self.z.v + pushes.iter().sum::<f64>();
        let of_v = self.z.v.abs() + pushes.iter().map(|it| it.abs()).sum::<f64>();
        ([self.z.s + h * r * v, v], [self.z.s.abs() + h * r * of_v, of_v])
    }

    /// Natural residual and the defect of the returned end, relative to the terms, times
    /// `1 - kappa`: the absolute accuracy of `R` is inherited by a small one.
    fn misfit(&self, found: &Regulation) -> f64 {
        let signs = [found.lambda_s, found.lambda_v];
        let (rows, terms) = self.end(signs);
        let mut worst: f64 = 0.0;
        for (index, end) in [found.end.s, found.end.v].into_iter().enumerate() {
            let scale = if terms[index] == 0.0 { 1.0 } else { terms[index] };
            let towards = -rows[index] / scale;
            let inclusion = (signs[index] - 1.0).max((signs[index] + 1.0).min(towards)).abs();
            let update = (end - rows[index]).abs() / scale;
            let both = if inclusion.is_nan() { f64::NAN } else { inclusion.max(update) };
            worst = if both > worst || both.is_nan() { both } else { worst };
        }
        worst * (1.0 - self.step.restitution.kappa())
    }

    fn solve(&self) -> Regulation {
        self.step.solve(self.z, self.f)
    }

    /// All solutions with one of the nine patterns of signs, coincident states merged.
    fn enumerated(&self) -> Vec<Lifted> {
        let RegulationStep { h, restitution, gains } = self.step;
        let (k, Lifted { s, v }) = (restitution.kappa(), self.z);
        let (push, brake) = (h * (self.f - gains.mu1()), h * gains.mu2());
        let mut tried: Vec<[f64; 2]> = Vec::new();
        for one in [-1.0, 1.0] {
            tried.extend([[one, 1.0], [one, -1.0]]);
            // v+ = 0:  R v + ls push - lv brake = 0, linear in lv
            tried.push([one, (v + one * push) / (k * one * v + brake)]);
            // s+ = 0:  R v + ls push - lv brake = -s/h, linear in ls
            tried.push([(v - one * brake + s / h) / (k * one * v - push), one]);
        }
        let mut states: Vec<Lifted> = Vec::new();
        if s == 0.0 && self.can_stop() {
            states.push(Lifted::default());
        }
        for signs in tried {
            if signs.iter().all(|it| it.abs() <= 1.0) {
                let ([s, v], terms) = self.end(signs);
                let s = if signs[0].abs() < 1.0 { 0.0 } else { s };
                let v = if signs[1].abs() < 1.0 { 0.0 } else { v };
                let state = Lifted { s, v };
                let fits = signs[0] * s >= -1e-13 * terms[0] && signs[1] * v >= -1e-13 * terms[1];
                if fits && !states.iter().any(|other| self.coincide(*other, state)) {
                    states.push(state);
                }
            }
        }
        states
    }

    /// From `s = 0` to `(0, 0)`: some `(ls, lv)` with `R v + ls push - lv brake = 0`. The left-hand
    /// side is linear in each sign: its extremes are at the corners.
    fn can_stop(&self) -> bool {
        let RegulationStep { h, restitution, gains } = self.step;
        let (push, brake) = (h * (self.f - gains.mu1()), h * gains.mu2());
        let at = |ls: f64, lv: f64| {
            (1.0 - restitution.kappa() * ls * lv) * self.z.v + ls * push - lv * brake
        };
        let corners = [at(1.0, 1.0), at(1.0, -1.0), at(-1.0, 1.0), at(-1.0, -1.0)];
        corners.iter().any(|it| *it >= 0.0) && corners.iter().any(|it| *it <= 0.0)
    }

    fn coincide(&self, a: Lifted, b: Lifted) -> bool {
        let (_, [of_s, of_v]) = self.end([1.0, 1.0]);
        let blur = 1e-10 / (1.0 - self.step.restitution.kappa());
        (a.s - b.s).abs() <= blur * of_s && (a.v - b.v).abs() <= blur * of_v
    }
}

fn check(it: &Instance, found: &Regulation) -> f64 {
    let misfit = it.misfit(found);
    assert!(misfit < 4.0 * f64::EPSILON, "{misfit:e}: {found:?} of {it:?}");
    let (mu1, mu2) = (it.step.gains.mu1(), it.step.gains.mu2());
    assert_eq!(found.u, -mu1 - mu2 * (found.lambda_s * found.lambda_v));
    assert!(found.u.abs() <= mu1 + mu2);
    misfit
}

#[test]
fn a_million_random_steps_are_solved() {
    let rng = Rng::new(71);
    let mut worst: f64 = 0.0;
    for _ in 0..1_000_000 {
        let (gains, f) = stable(&rng);
        let it = Instance::draw(&rng, gains, f);
        worst = worst.max(check(&it, &it.solve()));
    }
    println!("(1 - kappa) times the largest misfit: {worst:.1e}");
}

/// Beyond the gain condition stability is lost, not the step: there is a solution for any force.
#[test]
fn a_force_beyond_the_gains_is_stepped_too() {
    let rng = Rng::new(72);
    let (mut worst, mut beyond): (f64, u32) = (0.0, 0);
    for _ in 0..1_000_000 {
        let (gains, _) = stable(&rng);
        let f = rng.sign() * gains.mu1() * rng.log_between(1e-2, 1e2);
        let it = Instance::draw(&rng, gains, f);
        beyond += u32::from(f.abs() > gains.mu1());
        worst = worst.max(check(&it, &it.solve()));
    }
    println!("(1 - kappa) times the largest misfit: {worst:.1e}");
    assert!(beyond > 300_000);
}

#[test]
fn within_the_gain_condition_the_solution_is_unique() {
    let rng = Rng::new(73);
    for _ in 0..200_000 {
        let (gains, f) = stable(&rng);
        let it = Instance::draw(&rng, gains, f);
        let (states, found) = (it.enumerated(), it.solve());
        assert_eq!(states.len(), 1, "{it:?}: {states:?}");
        assert!(it.coincide(states[0], found.end), "{it:?}: {states:?}, {found:?}");
    }
}

#[test]
fn rest_stays_exactly() {
    let rng = Rng::new(74);
    for _ in 0..10_000 {
        let (gains, f) = stable(&rng);
        let it = Instance { z: Lifted::default(), ..Instance::draw(&rng, gains, f) };
        let found = it.solve();
        assert_eq!((found.end, found.lambda_s, found.lambda_v), (Lifted::default(), 0.0, 0.0));
        assert_eq!(found.u, -gains.mu1());
    }
}

/// A mass that falls and bounces under its regulator.
#[derive(Clone, Copy, Debug)]
struct Fall {
    gains: Gains,
    f: f64,
    e: f64,
    start: Physical,
}

impl Fall {
    fn draw(rng: &Rng) -> Self {
        let bound = rng.between(0.0, 3.0);
        let mu2 = bound + rng.between(0.5, 3.0);
        let mu1 = mu2 + bound + rng.between(0.5, 3.0);
        let gains = Gains::new(mu1, mu2).expect("stable by construction");
        let start = Physical { x: rng.between(0.1, 2.0), xdot: rng.between(-3.0, 3.0) };
        Fall { gains, f: rng.between(-bound, bound), e: rng.between(0.05, 0.9), start }
    }

    /// Towards the wall while it moves up, and while it falls: `U = mu1 - F + mu2` and
    /// `D = mu1 - F - mu2`.
    fn decelerations(&self) -> (f64, f64) {
        let (middle, mu2) = (self.gains.mu1() - self.f, self.gains.mu2());
        (middle + mu2, middle - mu2)
    }

    /// `t_c + e V_c (1/U + 1/sqrt(U D))/(1 - rho)` for a first contact at `t_c` with speed `V_c`;
    /// `rho = e sqrt(D/U)` is the ratio of the speeds of two impacts.
    fn settling_time(&self) -> f64 {
        let Physical { x, xdot } = self.start;
        let (up, down) = self.decelerations();
        let (contact, speed) = if xdot >= 0.0 {
            let top = x + xdot * xdot / (2.0 * up);
            (xdot / up + (2.0 * top / down).sqrt(), (2.0 * top * down).sqrt())
        } else {
            let speed = (xdot * xdot + 2.0 * down * x).sqrt();
            ((speed + xdot) / down, speed)
        };
        let rho = self.e * (down / up).sqrt();
        contact + self.e * speed * (1.0 / up + 1.0 / (up * down).sqrt()) / (1.0 - rho)
    }

    /// When the step, iterated, first ends at `(0, 0)`.
    fn stepped(&self, h: f64) -> Option<f64> {
        let restitution = Restitution::from_e(self.e).expect("in range");
        let step = RegulationStep { h, restitution, gains: self.gains };
        let mut z = transform::lift(self.start, Branch::Positive, restitution);
        let most = (3.0 * self.settling_time() / h) as u32;
        for count in 1..=most {
            z = step.solve(z, self.f).end;
            if z == Lifted::default() {
                assert_eq!(step.solve(z, self.f).end, Lifted::default());
                return Some(f64::from(count) * h);
            }
        }
        None
    }
}

#[test]
fn the_closed_form_is_the_one_of_the_documentation() {
    let gains = Gains::new(3.0, 2.0).expect("in range");
    let e = Restitution::from_kappa(0.5).expect("in range").e();
    let fall = Fall { gains, f: 0.0, e, start: Physical { x: 1.0, xdot: 0.0 } };
    assert!((fall.settling_time() - 1.772_762_3).abs() < 1e-7, "{}", fall.settling_time());
}

/// The error is of order `h log(1/h)`: about `n = 1 + log(1/h)/log(1/rho)` bounces are longer than
/// a step. At an apex and at a contact the step's velocity is off by `h U` or so, which lengthens
/// the fall by `h U/D`, and what follows it by `e (1/U + 1/sqrt(U D))/(1 - rho)` times `h U`.
#[test]
fn the_mass_settles_in_the_time_of_the_closed_form() {
    let rng = Rng::new(75);
    let (mut largest, mut smallest): (f64, f64) = (0.0, f64::INFINITY);
    for round in 0..300 {
        let fall = Fall::draw(&rng);
        let (up, down) = fall.decelerations();
        let rho = fall.e * (down / up).sqrt();
        let each = 1.0 + up / down + fall.e * (1.0 + (up / down).sqrt()) / (1.0 - rho);
        for h in [1e-3, 1e-4, 1e-5] {
            if h < 1e-4 && round >= 30 {
                continue;
            }
            let settled = fall.stepped(h).expect("rest");
            let bounces = 1.0 + h.ln() / rho.ln();
            let ratio = (fall.settling_time() - settled) / (h * each * bounces);
            assert!(ratio.abs() < 1.0, "h = {h}: {ratio} times the estimate of {fall:?}");
            largest = largest.max(ratio);
            smallest = smallest.min(ratio);
        }
    }
    println!("error between {smallest:.2} and {largest:.2} of the estimate C h log(1/h)");
    // and the estimate is no idle one
    assert!(largest > 0.1, "{largest}");
}
