//! What holds whatever the numbers: symmetry, scaling, loss of energy, and answers or refusals
//! for any input.

use crate::common::{scaled_problem, Problem, Rng, Scheme};
use zivi_core::{transform, Lifted, Restitution, StepFailure, ThetaGammaStep};

fn draw(rng: &Rng) -> Problem {
    let gamma = rng.pick(&[1.0, 0.5, 1.0 - rng.unit()]);
    let theta = rng.pick(&[1.0, 0.5, gamma, 1.0 - rng.unit()]);
    let kappa = rng.between(0.0, 0.99);
    let scheme = Scheme { h: rng.log_between(1e-4, 1e-1), theta, gamma, kappa };
    let state = match rng.pick(&[0, 1, 2, 3]) {
        0 => [0.0, rng.between(-4.0, 4.0)],
        1 => [rng.between(-4.0, 4.0), 0.0],
        2 => [rng.sign() * rng.log_between(1e-6, 1e6), rng.sign() * rng.log_between(1e-6, 1e6)],
        _ => [rng.between(-4.0, 4.0), rng.between(-4.0, 4.0)],
    };
    let f = rng.sign() * rng.log_between(1e-2, 1e2);
    scaled_problem(scheme, state, f)
}

#[test]
fn the_mirrored_state_takes_the_mirrored_step_bit_for_bit() {
    let rng = Rng::new(51);
    for number in 0..60_000 {
        let mut problem = draw(&rng);
        if number % 50 == 0 {
            problem.z = Lifted::default();
        }
        if number % 51 == 0 {
            problem.f = 0.0;
        }
        let mirror = Problem { z: Lifted { s: -problem.z.s, v: -problem.z.v }, ..problem };
        let (here, there) = (problem.solve(1.0), mirror.solve(-1.0));
        let (here, there) = (here.expect("a solution"), there.expect("a solution"));
        assert_eq!((here.s, here.v, here.case), (-there.s, -there.v, there.case), "{problem:?}");
        assert_eq!((here.lambda_s, here.lambda_v), (-there.lambda_s, -there.lambda_v));
    }
}

/// `x -> L x`, `t -> T t`.
fn rescaled(problem: &Problem, length: f64, time: f64) -> Problem {
    Problem {
        scheme: Scheme { h: problem.scheme.h * time, ..problem.scheme },
        z: Lifted { s: problem.z.s * length, v: problem.z.v * (length / time) },
        f: problem.f * (length / (time * time)),
    }
}

#[test]
fn units_do_not_matter_bit_for_bit_when_they_are_powers_of_two() {
    let rng = Rng::new(52);
    for _ in 0..60_000 {
        let problem = draw(&rng);
        let power = |rng: &Rng| 2_f64.powi(rng.between(-60.0, 60.0) as i32);
        let (length, time) = (power(&rng), power(&rng));
        let here = problem.solve(1.0).expect("a solution");
        let there = rescaled(&problem, length, time).solve(1.0).expect("a solution");
        assert_eq!(here.s * length, there.s, "{problem:?}");
        assert_eq!(here.v * (length / time), there.v, "{problem:?}");
        assert_eq!((here.lambda_s, here.lambda_v), (there.lambda_s, there.lambda_v));
        assert_eq!(here.case, there.case);
    }
}

#[test]
fn other_units_change_only_the_rounding() {
    let rng = Rng::new(53);
    for _ in 0..30_000 {
        let mut problem = draw(&rng);
        problem.scheme.kappa *= 0.9;
        let (length, time) = (rng.log_between(1e-6, 1e6), rng.log_between(1e-6, 1e6));
        let here = problem.solve(1.0).expect("a solution");
        let there = rescaled(&problem, length, time).solve(1.0).expect("a solution");
        let Scheme { h, gamma, .. } = problem.scheme;
        let reach_v = problem.z.v.abs() + h * problem.f.abs();
        let reach_s = problem.z.s.abs() + h * reach_v;
        let (s, v) = (there.s / length, there.v / (length / time));
        assert!((here.s - s).abs() <= 1e-11 * reach_s / gamma, "{problem:?}\n{here:?}\n{there:?}");
        assert!((here.v - v).abs() <= 1e-11 * reach_v / gamma, "{problem:?}\n{here:?}\n{there:?}");
    }
}

fn energy(z: Lifted, restitution: Restitution, g: f64) -> f64 {
    let physical = transform::project(z, restitution);
    physical.xdot * physical.xdot / 2.0 + g * physical.x
}

/// Implicit Euler under `f = -g`: `x'^2/2 + g x` never increases, whatever the step meets.
#[test]
fn implicit_euler_never_gains_energy_under_gravity() {
    let rng = Rng::new(54);
    for _ in 0..100_000 {
        let mut problem = draw(&rng);
        (problem.scheme.theta, problem.scheme.gamma) = (1.0, 1.0);
        problem.f = -problem.f.abs();
        let restitution = Restitution::from_kappa(problem.scheme.kappa).expect("in range");
        let end = problem.solve(1.0).expect("a solution");
        let before = energy(problem.z, restitution, -problem.f);
        let after = energy(Lifted { s: end.s, v: end.v }, restitution, -problem.f);
        let rounding = 1e-13 * (before + (problem.scheme.h * problem.f).powi(2));
        assert!(after <= before + rounding, "{before:e} -> {after:e} in {problem:?}\n{end:?}");
    }
}

const STRANGE: [f64; 15] = [
    0.0,
    -0.0,
    5e-324,
    -5e-324,
    1e-300,
    -1e-300,
    1.0,
    -1.0,
    1e154,
    -1e154,
    1e300,
    -1e300,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::NAN,
];

/// Every combination of strange numbers gets finite numbers or a failure, and what is not
/// finite on entry is rejected as such.
#[test]
fn strange_input_gets_finite_numbers_or_a_failure() {
    let (mut solved, mut not_finite, mut none) = (0, 0, 0);
    for h in [5e-324, 1e-300, 1e-3, 1.0, 1e300] {
        for weight in [5e-324, 1e-300, 0.5, 1.0] {
            for (theta, gamma) in [(weight, weight), (1.0, weight), (weight, 1.0)] {
                for kappa in [0.0, 1e-300, 0.5, 1.0 - f64::EPSILON / 2.0] {
                    let step = Scheme { h, theta, gamma, kappa }.build();
                    for s in STRANGE {
                        for v in STRANGE {
                            for f in STRANGE {
                                let z = Lifted { s, v };
                                let answer = step.solve(z, f, 1.0);
                                if !(s.is_finite() && v.is_finite() && f.is_finite()) {
                                    let refused = answer == Err(StepFailure::NotFinite);
                                    assert!(refused, "{step:?} {z:?} {f}: {answer:?}");
                                }
                                match answer {
                                    Ok(it) => {
                                        let finite = it.s.is_finite() && it.v.is_finite();
                                        assert!(finite, "{step:?} {z:?} {f}: {it:?}");
                                        let signs =
                                            it.lambda_s.abs() <= 1.0 && it.lambda_v.abs() <= 1.0;
                                        assert!(signs, "{step:?} {z:?} {f}: {it:?}");
                                        solved += 1;
                                    }
                                    Err(StepFailure::NotFinite) => not_finite += 1,
                                    Err(StepFailure::NoSolution) => none += 1,
                                }
                                assert!(step.solutions(z, f).count() <= 9);
                            }
                        }
                    }
                }
            }
        }
    }
    println!("solved {solved}, not finite {not_finite}, no solution {none}");
    assert!(solved > 100_000);
}

/// The last side is only asked for at the origin; there, nonsense must not become a state.
#[test]
fn a_strange_side_does_no_harm() {
    let step = Scheme::implicit_euler(1e-2, 0.41).build();
    for side in STRANGE {
        for f in [-9.81, 0.0, 9.81] {
            for z in [Lifted { s: 1.0, v: -2.0 }, Lifted { s: 0.0, v: -2.0 }] {
                assert_eq!(step.solve(z, f, side), step.solve(z, f, 1.0));
            }
            if let Ok(it) = step.solve(Lifted::default(), f, side) {
                assert!(it.s.is_finite() && it.v.is_finite(), "side {side}: {it:?}");
            }
        }
    }
}

#[test]
fn settings_out_of_range_are_refused_by_name() {
    let restitution = Restitution::from_e(0.5).expect("in range");
    let refused = |h: f64, theta: f64, gamma: f64, restitution: Restitution| {
        let error = ThetaGammaStep::new(h, theta, gamma, restitution).expect_err("out of range");
        let text = error.to_string();
        assert!(text.contains(error.name) && text.contains(error.range), "{text}");
        (error.name, error.value.to_bits())
    };
    let out_of_range = [0.0, -0.0, -1.0, -5e-324, f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    for bad in out_of_range {
        assert_eq!(refused(bad, 1.0, 1.0, restitution), ("h", bad.to_bits()));
        assert_eq!(refused(1e-3, bad, 1.0, restitution), ("theta", bad.to_bits()));
        assert_eq!(refused(1e-3, 1.0, bad, restitution), ("gamma", bad.to_bits()));
        let step = ThetaGammaStep::new(1e-3, 1.0, 1.0, restitution).expect("admissible");
        assert_eq!(step.with_h(bad).expect_err("out of range").name, "h");
    }
    for bad in [1.0 + f64::EPSILON, 2.0] {
        assert_eq!(refused(1e-3, bad, 1.0, restitution), ("theta", bad.to_bits()));
        assert_eq!(refused(1e-3, 1.0, bad, restitution), ("gamma", bad.to_bits()));
    }
    let plastic = Restitution::from_e(0.0).expect("in range");
    assert_eq!(refused(1e-3, 1.0, 1.0, plastic), ("e", 0.0_f64.to_bits()));
    for bad in [-1e-300, 1.0 + f64::EPSILON, f64::NAN, f64::INFINITY] {
        assert_eq!(Restitution::from_e(bad).expect_err("out of range").name, "e");
        assert_eq!(Restitution::from_kappa(bad).expect_err("out of range").name, "kappa");
    }
}

#[test]
fn the_limits_of_the_settings_are_admitted() {
    let restitution = Restitution::from_kappa(1.0 - f64::EPSILON / 2.0).expect("in range");
    for (h, weight) in [(5e-324, 5e-324), (f64::MAX, 1.0)] {
        let step = ThetaGammaStep::new(h, weight, weight, restitution).expect("admissible");
        assert_eq!((step.h(), step.theta(), step.gamma()), (h, weight, weight));
        assert_eq!(step.with_h(0.25).map(|it| it.h()), Ok(0.25));
    }
}
