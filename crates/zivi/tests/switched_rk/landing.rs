//! Steps onto the wall and their consequences.

use std::convert::Infallible;

use zivi::{FunctionForce, LinearForce, Order, Physical, Restitution, SwitchedRk};

use crate::problems::{settings, simulate, Random};

#[test]
fn what_only_the_step_onto_the_impact_sees_is_not_passed_over() {
    // x'' = -2 from 1 m, and a push of 5 m/s^2 from a to a + b: x(1) = 0 without it. The first step
    // goes beyond 1 with no stage in the push; the one onto the wall has stages there.
    let (b, p) = (0.04, 5.0);
    let cases = [
        (Order::Five, 1.1, 0.88),
        (Order::Eight, 1.05, 0.58),
        (Order::Eight, 1.05, 0.64),
        (Order::Eight, 1.1, 0.82),
        (Order::Eight, 1.2, 0.62),
        (Order::Eight, 1.4, 0.84),
    ];
    for (order, first_step, a) in cases {
        let mut force = FunctionForce(|t: f64, _: f64, _: f64| {
            Ok::<f64, Infallible>(if t >= a && t < a + b { p - 2.0 } else { -2.0 })
        });
        let settings = SwitchedRk { first_step: Some(first_step), ..settings(order, 1e-6) };
        let start = Physical { x: 1.0, xdot: 0.0 };
        let restitution = Restitution::from_e(0.5).unwrap();
        let run = simulate(settings, restitution, &mut force, (0.0, 1.5), start);
        // after the push x = 1 - t^2 + p b (t - a - b/2)
        let (q, r) = (p * b, 1.0 - p * b * (a + 0.5 * b));
        let exact = 0.5 * (q + (q * q + 4.0 * r).sqrt());
        let t = run.trajectory.events.impacts.first().map(|it| it.t);
        let t = t.expect("an impact");
        assert!((t - exact).abs() < 3e-5, "{order:?} {first_step} {a}: {t} {exact}");
    }
}

#[test]
fn no_motion_below_the_tolerance_comes_to_rest_before_its_last_impact() {
    // the estimate of the Zeno time is no better than the tolerance: it may lie in the past
    let mut random = Random(3);
    for i in 0..400 {
        let order = if i % 2 == 0 { Order::Five } else { Order::Eight };
        let height = 10f64.powf(random.between(-12.0, -9.0));
        let fall = (2.0 * height / 9.81).sqrt();
        let (part, phase) = (random.between(0.4, 0.9), random.between(0.0, 6.3));
        let omega = random.between(5.0, 30.0) / fall;
        let mut force = FunctionForce(|t: f64, _: f64, _: f64| {
            Ok::<f64, Infallible>(-9.81 * (1.0 + part * (omega * t + phase).sin()))
        });
        let restitution = Restitution::from_e(random.between(0.4, 0.85)).unwrap();
        let settings = settings(order, 10f64.powf(random.between(-5.0, -2.0)));
        let start = Physical { x: height, xdot: 0.0 };
        let run = simulate(settings, restitution, &mut force, (0.0, 100.0 * fall), start);
        let events = &run.trajectory.events;
        let last = events.impacts.last().expect("an impact").t;
        assert!(events.zeno_times.iter().all(|&zeno| zeno >= last), "{i}: {events:?}");
    }
}

#[test]
fn a_pass_at_half_the_tolerance_is_no_impact() {
    // x = 1 + (1 - d) cos: a long step may see an impact where the one onto it finds none
    for tol in [1e-4, 1e-6, 1e-8] {
        for i in 0..200 {
            let (d, phase) = (0.5 * tol, -3.1 + 0.031 * f64::from(i));
            let (sin, cos) = phase.sin_cos();
            let start = Physical { x: 1.0 + (1.0 - d) * cos, xdot: -(1.0 - d) * sin };
            let mut force = LinearForce {
                stiffness: 1.0,
                damping: 0.0,
                gravity: -1.0,
                amplitude: 0.0,
                omega: 1.0,
                phase: 0.0,
            };
            let settings = SwitchedRk { first_step: Some(3.0), ..settings(Order::Eight, tol) };
            let restitution = Restitution::from_e(0.5).unwrap();
            let run = simulate(settings, restitution, &mut force, (0.0, 6.0), start);
            assert!(run.trajectory.events.impacts.is_empty(), "{tol:e} {phase}");
        }
    }
}
