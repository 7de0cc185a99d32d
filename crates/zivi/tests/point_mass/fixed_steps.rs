//! Residuals of fixed steps in their equations, and their records.

use std::convert::Infallible;

use zivi::{
    simulate_explicit_euler, simulate_theta_gamma, ConstantForce, FunctionForce, Grid, Physical,
    Quantity, Restitution, Silent, Status, ThetaGamma, Trajectory,
};
use zivi_core::{Lifted, ThetaGammaStep};

const KAPPA: f64 = 0.5;
const H: f64 = 1e-3;

fn restitution() -> Restitution {
    Restitution::from_kappa(KAPPA).unwrap()
}

fn explicit(f: impl FnMut(f64, f64, f64) -> f64, grid: Grid, start: Physical) -> Trajectory {
    let mut f = f;
    let mut force = FunctionForce(|t, x, v| Ok::<f64, Infallible>(f(t, x, v)));
    simulate_explicit_euler(restitution(), &mut force, grid, start, &mut Silent).unwrap().trajectory
}

#[test]
fn every_step_is_explicit_euler_on_the_transformed_field() {
    // v+ = v + h ls f/R, s+ = s + h R v, ls = sgn s, lv = sgn v with sgn 0 = 1; the last step is
    // shorter
    let law = |t: f64, x: f64, v: f64| -9.81 + 3.0 * (5.0 * t).sin() - 0.4 * x - 0.3 * v;
    let grid = Grid::new(0.0, 1.0005, H).unwrap();
    let sol = explicit(law, grid, Physical { x: 0.3, xdot: -1.0 });
    assert_eq!((sol.status, sol.nfev, sol.columns.len()), (Status::Completed, 1001, 1002));
    let of = |quantity| sol.columns.of(quantity);
    let (t, s, v) = (of(Quantity::T), of(Quantity::S), of(Quantity::V));
    let sign = |z: f64| if z < 0.0 { -1.0 } else { 1.0 };
    for k in 0..1001 {
        assert!((t[k] - H * k as f64).abs() < 1e-15);
        let h = if k == 1000 { 5e-4 } else { H };
        let (ls, lv) = (sign(s[k]), sign(v[k]));
        let r = 1.0 - KAPPA * ls * lv;
        let f = law(t[k], s[k].abs(), r * v[k] * ls);
        assert!((v[k + 1] - v[k] - h * ls * f / r).abs() < 1e-13, "{k}");
        assert!((s[k + 1] - s[k] - h * r * v[k]).abs() < 1e-13, "{k}");
        assert_eq!((of(Quantity::LambdaS)[k + 1], of(Quantity::LambdaV)[k + 1]), (ls, lv));
        assert_eq!(of(Quantity::X)[k + 1], s[k + 1].abs());
        assert!(of(Quantity::Residual)[k + 1].is_nan());
    }
    assert!(!sol.events.impacts.is_empty());
}

#[test]
fn the_sign_of_zero_is_positive() {
    let grid = Grid::new(0.0, 1.0, H).unwrap();
    let sol = explicit(|_, _, _| -1.0, grid, Physical::default());
    let of = |quantity| sol.columns.of(quantity)[1];
    assert_eq!((of(Quantity::S), of(Quantity::V)), (0.0, -H / (1.0 - KAPPA)));
    assert_eq!((of(Quantity::LambdaS), of(Quantity::LambdaV)), (1.0, 1.0));
}

#[test]
fn overflow_ends_the_run() {
    // v+ = h f/R = 2 f
    let grid = Grid::new(0.0, 10.0, 1.0).unwrap();
    let sol = explicit(|_, _, _| 1.5e308, grid, Physical { x: 1.0, xdot: 0.0 });
    assert_eq!((sol.status, sol.columns.len()), (Status::StateNotFinite, 1));
}

#[test]
fn the_first_sample_is_the_initial_state() {
    let grid = Grid::new(2.0, 3.0, H).unwrap();
    let sol = explicit(|_, _, _| -1.0, grid, Physical { x: 1.0, xdot: -3.0 });
    let first = Quantity::ALL.map(|quantity| sol.columns.of(quantity)[0]);
    assert_eq!(first, [2.0, 1.0, -3.0, 1.0, -3.0 / (1.0 + KAPPA), 1.0, -1.0, 0.0]);
}

#[test]
fn the_residual_is_that_of_the_step_from_the_sample_before() {
    // 0.2 m above the wall: on the other branch when the first block of the record is full
    let (g, grid) = (9.81, Grid::new(0.0, 1.0, H).unwrap());
    let start = Physical { x: 0.2, xdot: 0.0 };
    let method = ThetaGamma::implicit_euler();
    let run = simulate_theta_gamma(
        method,
        restitution(),
        &mut ConstantForce(-g),
        grid,
        start,
        &mut Silent,
    );
    let sol = run.unwrap().trajectory;
    let step = ThetaGammaStep::new(H, 1.0, 1.0, restitution()).unwrap();
    let of = |quantity| sol.columns.of(quantity);
    let (s, v) = (of(Quantity::S), of(Quantity::V));
    for k in 1..s.len() {
        let before = Lifted { s: s[k - 1], v: v[k - 1] };
        let lambda = [of(Quantity::LambdaS)[k], of(Quantity::LambdaV)[k]];
        assert_eq!(of(Quantity::Residual)[k], step.vi_residual(before, -g, lambda), "{k}");
    }
    assert!(s[257] < 0.0 && of(Quantity::Residual).iter().all(|&it| it < 1e-13));
}
