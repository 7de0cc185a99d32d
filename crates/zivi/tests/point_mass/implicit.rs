//! Forces that depend on the state: found in every step, at the cost that is claimed, and put back
//! into the equation.

use zivi::{
    simulate_theta_gamma, Force, Grid, LinearForce, Physical, Quantity, Restitution, Silent,
    Status, ThetaGamma, Trajectory,
};

/// Uniform numbers in [0, 1) (xorshift64*).
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    fn decades(&mut self, low: f64, high: f64) -> f64 {
        10f64.powf(self.between(low, high))
    }
}

fn simulate(force: LinearForce, e: f64, h: f64, steps: f64, start: Physical) -> Trajectory {
    let restitution = Restitution::from_e(e).unwrap();
    let grid = Grid::new(0.0, h * steps, h).unwrap();
    let method = ThetaGamma::implicit_euler();
    let run =
        simulate_theta_gamma(method, restitution, &mut force.clone(), grid, start, &mut Silent);
    run.unwrap().trajectory
}

/// Largest mismatch between the force that a step used, read off `v+ = v + h lambda_s f/R` and
/// `s+ = s + h R v+`, and the force at its end, relative to the terms of the force.
fn worst_mismatch(sol: &Trajectory, force: LinearForce, kappa: f64, h: f64) -> f64 {
    let of = |quantity| sol.columns.of(quantity);
    let (t, s, v) = (of(Quantity::T), of(Quantity::S), of(Quantity::V));
    let (lambda_s, lambda_v) = (of(Quantity::LambdaS), of(Quantity::LambdaV));
    let mut worst = 0.0_f64;
    for k in 1..t.len() {
        let (ls, lv) = (lambda_s[k], lambda_v[k]);
        if ls.abs() < 1.0 {
            continue; // the sign, not the force, fixes the end
        }
        let r = 1.0 - kappa * ls * lv;
        let used = (v[k] - v[k - 1]) * r / (h * ls);
        let (x, xdot) = (s[k].abs(), r * ls * v[k]);
        let Ok::<f64, ()>(wanted) = force.clone().at(t[k], x, xdot) else { unreachable!() };
        let terms = force.stiffness * x
            + (force.damping * xdot).abs()
            + force.gravity.abs()
            + force.amplitude.abs()
            // rounding of v in the difference
            + 1e-4 * v[k].abs().max(v[k - 1].abs()) * r / h;
        worst = worst.max((used - wanted).abs() / terms);
    }
    worst
}

#[test]
fn a_linear_force_costs_two_evaluations_a_step() {
    let force = LinearForce {
        stiffness: 1.0,
        damping: 0.1,
        gravity: 0.0,
        amplitude: 1.0,
        omega: 0.6,
        phase: 0.0,
    };
    let sol = simulate(force, 0.5, 1e-3, 30_000.0, Physical { x: 0.5, xdot: 0.0 });
    assert_eq!(sol.status, Status::Completed);
    assert!(sol.nfev < 60_600, "{}", sol.nfev);
}

#[test]
fn random_forces_are_found_and_put_back() {
    let mut random = Random(7);
    let (mut steps, mut evaluations) = (0, 0);
    for case in 0..600 {
        let force = LinearForce {
            stiffness: random.decades(-2.0, 6.0),
            damping: if case % 3 == 0 { 0.0 } else { random.decades(-2.0, 4.0) },
            gravity: random.between(-20.0, 20.0),
            amplitude: if case % 2 == 0 { 0.0 } else { random.between(0.0, 40.0) },
            omega: random.decades(-1.0, 2.0),
            phase: 0.0,
        };
        let (h, e) = (random.decades(-5.0, 0.0), random.between(0.02, 1.0));
        let start = Physical { x: random.between(0.0, 2.0), xdot: random.between(-5.0, 5.0) };
        let sol = simulate(force, e, h, 200.0, start);
        assert_eq!(sol.status, Status::Completed, "{force:?} e {e} h {h} {start:?}");
        let kappa = (1.0 - e) / (1.0 + e);
        let worst = worst_mismatch(&sol, force, kappa, h);
        assert!(worst < 1e-10, "{worst:e} {force:?} e {e} h {h} {start:?}");
        let residual = sol.columns.of(Quantity::Residual).iter().fold(0.0, |a: f64, &b| a.max(b));
        assert!(residual < 3e-13, "{residual:e}");
        steps += sol.columns.len() - 1;
        evaluations += sol.nfev;
    }
    let cost = evaluations as f64 / steps as f64;
    assert!(cost < 4.0, "{cost} evaluations a step");
}

#[test]
fn a_small_vibration_about_a_preloaded_equilibrium_is_not_refused() {
    // gravity off the wall, spring back: the terms of f cancel to twelve digits
    for relative in [1e-3, 1e-6, 1e-9, 1e-12] {
        let force = LinearForce {
            stiffness: 1000.0,
            damping: 0.1,
            gravity: -9.81,
            amplitude: 0.0,
            omega: 1.0,
            phase: 0.0,
        };
        let x = 9.81e-3 * (1.0 + relative);
        let sol = simulate(force, 0.5, 1e-3, 2000.0, Physical { x, xdot: 0.0 });
        assert_eq!(sol.status, Status::Completed, "{relative}");
    }
}
