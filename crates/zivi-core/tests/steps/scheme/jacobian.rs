//! `vi_map` is the equation of the step and `vi_jacobian` is its derivative, for every setting.

use crate::common::{Problem, Rng, Scheme};
use zivi_core::Lifted;

fn draw(rng: &Rng) -> (Problem, [f64; 2]) {
    let scheme = Scheme {
        h: rng.log_between(1e-5, 1.0),
        theta: 1.0 - rng.unit(),
        gamma: 1.0 - rng.unit(),
        kappa: rng.between(0.0, 0.99),
    };
    let s = rng.sign() * rng.log_between(1e-6, 1e3);
    let v = rng.sign() * rng.log_between(1e-6, 1e3);
    let f = rng.sign() * rng.log_between(1e-6, 1e3);
    let lambda = [rng.between(-1.0, 1.0), rng.between(-1.0, 1.0)];
    (Problem { scheme, z: Lifted { s, v }, f }, lambda)
}

/// `-(s_gamma, v_gamma)` through `v+` and `s+`, and the magnitudes of the terms.
fn written_out(problem: &Problem, [ls, lv]: [f64; 2]) -> ([f64; 2], [f64; 2]) {
    let Scheme { h, theta, gamma, kappa } = problem.scheme;
    let Lifted { s, v } = problem.z;
    let r = 1.0 - kappa * ls * lv;
    let kick = h * ls * problem.f / r;
    let v_plus = v + kick;
    let s_plus = s + h * r * (theta * v_plus + (1.0 - theta) * v);
    (
        [-(gamma * s_plus + (1.0 - gamma) * s), -(gamma * v_plus + (1.0 - gamma) * v)],
        [s.abs() + h * r * (v.abs() + kick.abs()), v.abs() + kick.abs()],
    )
}

#[test]
fn the_map_is_the_equation_of_the_step() {
    let rng = Rng::new(11);
    for _ in 0..20_000 {
        let (problem, lambda) = draw(&rng);
        let map = problem.scheme.build().vi_map(problem.z, problem.f, lambda);
        let (expected, terms) = written_out(&problem, lambda);
        for row in 0..2 {
            let error = (map[row] - expected[row]).abs() / terms[row];
            assert!(error < 1e-14, "row {row}: {error:e} for {problem:?} at {lambda:?}");
        }
    }
}

/// Central differences with `d` and `2 d`, `d = R/1000`, combined to fourth order: truncation
/// about `(d/R)^4 = 1e-12` of the derivative, rounding about `1e-13` of the terms.
#[test]
fn the_jacobian_is_the_difference_quotient() {
    let rng = Rng::new(12);
    let mut worst: f64 = 0.0;
    for _ in 0..20_000 {
        let (problem, lambda) = draw(&rng);
        let step = problem.scheme.build();
        let jacobian = step.vi_jacobian(problem.z, problem.f, lambda);
        let r = 1.0 - problem.scheme.kappa * lambda[0] * lambda[1];
        let (_, terms) = written_out(&problem, [1.0, lambda[1]]);
        for column in 0..2 {
            let quotient = |d: f64| {
                let (mut ahead, mut behind) = (lambda, lambda);
                ahead[column] += d;
                behind[column] -= d;
                let width = ahead[column] - behind[column];
                let (ahead, _) = written_out(&problem, ahead);
                let (behind, _) = written_out(&problem, behind);
                [(ahead[0] - behind[0]) / width, (ahead[1] - behind[1]) / width]
            };
            let d = 1e-3 * r;
            let (fine, coarse) = (quotient(d), quotient(2.0 * d));
            for row in 0..2 {
                let expected = (4.0 * fine[row] - coarse[row]) / 3.0;
                let difference = (jacobian[row][column] - expected).abs();
                let error = difference / (expected.abs() + 1e-2 * terms[row] / d * 1e-3);
                worst = worst.max(error);
                assert!(error < 1e-9, "[{row}][{column}]: {error:e} for {problem:?} at {lambda:?}");
            }
        }
    }
    println!("largest relative difference {worst:e}");
}
