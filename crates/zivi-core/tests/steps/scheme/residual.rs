//! Every solved step, put back into the equations, satisfies them to rounding.
//!
//! The library accepts a candidate whose signs are violated by `1e-13` of the terms, and clips a
//! multiplier that exceeds one by `1e-13`. Both can happen at once, and a few roundings come on
//! top: [`TOLERANCE`] is three times that.

use crate::common::{Problem, Rng, Scheme};
use zivi_core::{Lifted, StepFailure};

const TOLERANCE: f64 = 3e-13;

fn weight(rng: &Rng) -> f64 {
    match rng.pick(&[0, 0, 0, 1, 2]) {
        0 => 1.0 - rng.unit(),
        1 => 1.0,
        _ => rng.pick(&[1e-3, 0.25, 0.5, 0.999]),
    }
}

fn scheme(rng: &Rng) -> Scheme {
    let theta = weight(rng);
    let gamma = if rng.chance(0.3) { theta } else { weight(rng) };
    let kappa = if rng.chance(0.1) { 0.0 } else { rng.between(0.0, 0.999) };
    Scheme { h: rng.log_between(1e-5, 1e-1), theta, gamma, kappa }
}

/// Zero, or of any size, with either sign.
fn wide(rng: &Rng) -> f64 {
    if rng.chance(0.15) {
        0.0
    } else {
        rng.sign() * rng.log_between(1e-12, 1e3)
    }
}

/// Solves, and puts the solution back into the equations; keeps the largest misfit.
fn check(problem: &Problem, side: f64, worst: &mut f64) {
    let solution = match problem.solve(side) {
        Ok(solution) => solution,
        Err(StepFailure::NoSolution) => panic!("no solution: {problem:?}"),
        Err(StepFailure::NotFinite) => panic!("not finite: {problem:?}"),
    };
    let misfit = problem.misfit(&solution);
    assert!(misfit.inclusion <= TOLERANCE, "{misfit:?}\n{problem:?}\n{solution:?}");
    assert!(misfit.update <= TOLERANCE, "{misfit:?}\n{problem:?}\n{solution:?}");
    *worst = worst.max(misfit.inclusion).max(misfit.update);
    let own = problem.scheme.build().vi_residual(
        problem.z,
        problem.f,
        [solution.lambda_s, solution.lambda_v],
    );
    let allowed = TOLERANCE / (1.0 - problem.scheme.kappa);
    assert!(own <= allowed, "vi_residual {own:e} for {problem:?}\n{solution:?}");
}

#[test]
fn over_fifteen_decades() {
    let rng = Rng::new(21);
    let mut worst = 0.0;
    for _ in 0..100_000 {
        let scheme = scheme(&rng);
        let z = Lifted { s: wide(&rng), v: wide(&rng) };
        let problem = Problem { scheme, z, f: wide(&rng) };
        check(&problem, rng.sign(), &mut worst);
    }
    println!("worst {worst:e}");
}

/// `v` against `h f`, and `s` against `h v` and `h^2 f`: where the switches are.
fn at_the_switches(rng: &Rng, scheme: Scheme) -> Problem {
    let f = rng.sign() * rng.log_between(1e-3, 1e3);
    let kick = scheme.h * f.abs();
    let spread = rng.pick(&[1.0, 4.0, 1.0 / (1.0 - scheme.kappa), 1.0 / scheme.gamma]);
    let v = spread * kick * rng.between(-2.0, 2.0);
    let s = match rng.pick(&[0, 1, 2, 3]) {
        0 => scheme.h * v * rng.between(-2.5, 2.5),
        1 => scheme.h * kick * rng.between(-4.0, 4.0),
        2 => 0.0,
        _ => scheme.h * (kick + v.abs()) * rng.sign() * rng.log_between(1e-16, 1.0),
    };
    Problem { scheme, z: Lifted { s, v }, f }
}

#[test]
fn at_every_switch() {
    let rng = Rng::new(22);
    let mut worst = 0.0;
    for _ in 0..100_000 {
        let scheme = scheme(&rng);
        let problem = at_the_switches(&rng, scheme);
        check(&problem, rng.sign(), &mut worst);
    }
    println!("worst {worst:e}");
}

/// On a switch to the last bit: the state is computed so that one of `s_gamma`, `v_gamma`
/// vanishes for one pattern of signs, then moved by a few units in the last place.
fn on_a_switch(rng: &Rng, scheme: Scheme) -> Problem {
    let Scheme { h, theta, gamma, kappa } = scheme;
    let f = rng.sign() * rng.log_between(1e-3, 1e3);
    let (ls, lv) = (rng.sign(), rng.sign());
    let r = 1.0 - kappa * ls * lv;
    let nudge = |rng: &Rng| 1.0 + f64::EPSILON * rng.between(-4.0, 4.0).round();
    let on_the_apex = -gamma * h * ls * f / r;
    let v = match rng.chance(0.6) {
        true => on_the_apex * nudge(rng),
        false => on_the_apex * rng.between(-3.0, 3.0),
    };
    let on_the_wall = -gamma * h * (r * v + theta * h * ls * f);
    let s = match rng.chance(0.6) {
        true => on_the_wall * nudge(rng),
        false => h * h * f * rng.between(-3.0, 3.0),
    };
    Problem { scheme, z: Lifted { s, v }, f }
}

#[test]
fn on_the_switches_to_the_last_bit() {
    let rng = Rng::new(23);
    let mut worst = 0.0;
    for _ in 0..100_000 {
        let scheme = scheme(&rng);
        let problem = on_a_switch(&rng, scheme);
        check(&problem, rng.sign(), &mut worst);
    }
    println!("worst {worst:e}");
}

/// Far below the scales `h^2 |f|` and `h |f|` of the step a state is as good as any other.
#[test]
fn arbitrarily_near_the_origin() {
    let rng = Rng::new(26);
    let mut worst = 0.0;
    for _ in 0..60_000 {
        let scheme = Scheme { kappa: rng.between(0.0, 0.95), ..scheme(&rng) };
        let small = || if rng.chance(0.2) { 0.0 } else { rng.sign() * rng.log_between(1e-20, 1.0) };
        let f = rng.sign() * rng.log_between(1e-3, 1e3);
        let kick = scheme.h * f.abs();
        let z = Lifted { s: scheme.h * kick * small(), v: kick * small() };
        check(&Problem { scheme, z, f }, rng.sign(), &mut worst);
    }
    println!("worst {worst:e}");
}

#[test]
fn with_nearly_elastic_and_nearly_plastic_walls() {
    let rng = Rng::new(24);
    let mut worst = 0.0;
    for _ in 0..60_000 {
        let kappa = rng.pick(&[1e-15, 1e-9, 1e-4, 0.9999, 1.0 - 1e-6, 1.0 - 1e-9]);
        let scheme = Scheme { kappa, ..scheme(&rng) };
        let problem = match rng.chance(0.5) {
            true => at_the_switches(&rng, scheme),
            false => on_a_switch(&rng, scheme),
        };
        check(&problem, rng.sign(), &mut worst);
    }
    println!("worst {worst:e}");
}

#[test]
fn with_tiny_weights() {
    let rng = Rng::new(25);
    let mut worst = 0.0;
    for _ in 0..60_000 {
        let mut scheme = scheme(&rng);
        match rng.pick(&[0, 1, 2]) {
            0 => scheme.theta = 1e-3,
            1 => scheme.gamma = 1e-3,
            _ => (scheme.theta, scheme.gamma) = (1e-3, 1e-3),
        }
        let problem = match rng.chance(0.5) {
            true => at_the_switches(&rng, scheme),
            false => on_a_switch(&rng, scheme),
        };
        check(&problem, rng.sign(), &mut worst);
    }
    println!("worst {worst:e}");
}

#[test]
fn it_is_that_of_the_worse_row() {
    let step = Scheme::implicit_euler(0.1, 0.5).build();
    // far from every switch: both signs are +1, and a wrong one is off by its distance from 1
    let residual = |lambda| step.vi_residual(Lifted { s: 1.0, v: 1.0 }, -1.0, lambda);
    assert_eq!(residual([1.0, 1.0]), 0.0);
    assert_eq!(residual([0.75, 1.0]), 0.25);
    assert_eq!(residual([1.0, 0.75]), 0.25);
    for z in [Lifted { s: f64::NAN, v: 1.0 }, Lifted { s: 1.0, v: f64::NAN }] {
        assert!(step.vi_residual(z, -1.0, [1.0, 1.0]).is_nan());
    }
}
