//! Pathological forces: runs end, and their reports are consistent.

use std::convert::Infallible;

use zivi::{
    simulate_switched_rk, FunctionForce, Order, Output, Physical, Quantity, Restitution, Silent,
    Status, SwitchedRk,
};

use crate::problems::{Random, Run};

/// A sum of random terms: smooth, stiff, with jumps in time and narrow pulses. If it is `wild` it
/// may also be rough, jump in the velocity (dry friction, for which there need not be a motion)
/// and blow the mass away.
fn force(random: &mut Random, wild: bool) -> impl FnMut(f64, f64, f64) -> Result<f64, Infallible> {
    let mut pick = |chance: f64, low: f64, high: f64| {
        let (toss, value) = (random.uniform(), random.between(low, high));
        if toss < chance {
            value
        } else {
            0.0
        }
    };
    let (g, k, c) = (pick(0.9, -3.0, 12.0), pick(0.5, -2.0, 2000.0), pick(0.4, -0.5, 40.0));
    let (a, w) = (pick(0.7, 0.0, 40.0), pick(1.0, 0.1, 60.0));
    let least = if wild { -1.0 } else { 0.0 };
    let (dry, wind) = (pick(0.3, 0.0, if wild { 4.0 } else { 0.0 }), pick(0.3, 3.0 * least, 3.0));
    let (jump, period) = (pick(0.3, -20.0, 20.0), pick(1.0, 0.05, 1.0));
    let (cubic, pulse) = (pick(0.2, 50.0 * least, 50.0), pick(0.2, 0.0, 1e4));
    let (noise, deep) = (pick(0.1, 0.0, if wild { 1e-6 } else { 0.0 }), pick(0.1, 0.0, 1.0));
    move |t: f64, x: f64, v: f64| {
        let square = if (t / period).rem_euclid(1.0) < 0.5 { jump } else { -jump };
        let friction = if v == 0.0 { 0.0 } else { -dry * v.signum() };
        let narrow = pulse * (-((t - 1.0) / 1e-3).powi(2)).exp();
        let rough = noise * (1e7 * (t + x + v)).sin();
        let restitution = if deep > 0.0 { (x + deep).sqrt() } else { 0.0 };
        let smooth = -g - k * x - c * v + a * (w * t).cos() - wind * v * v.abs();
        Ok(smooth + square + friction - cubic * x.powi(3) + narrow + rough + restitution)
    }
}

fn assert_consistent(run: &Run, what: &str) {
    let of = |quantity| run.trajectory.columns.of(quantity);
    let (t, x, v) = (of(Quantity::T), of(Quantity::X), of(Quantity::Xdot));
    assert!(t.windows(2).all(|pair| pair[1] >= pair[0]), "{what}");
    assert!(x.iter().all(|&x| x >= 0.0 && x.is_finite()), "{what}");
    assert!(v.iter().all(|v| v.is_finite()), "{what}");
    let events = &run.trajectory.events;
    assert!(events.impacts.windows(2).all(|pair| pair[1].t >= pair[0].t), "{what}");
    assert!(
        events.impacts.iter().all(|it| it.xdot_before <= 0.0 && it.xdot_after >= 0.0),
        "{what}"
    );
    let (zeno, lift) = (&events.zeno_times, &events.liftoff_times);
    assert!(zeno.windows(2).all(|pair| pair[1] >= pair[0]), "{what}");
    assert!(lift.windows(2).all(|pair| pair[1] >= pair[0]), "{what}");
    assert!(zeno.len() <= lift.len() + 1, "{what}");
    if let (Some(rest), Some(last)) = (events.rest_time, t.last()) {
        assert!(rest <= *last && (x[x.len() - 1], v[v.len() - 1]) == (0.0, 0.0), "{what}");
    }
    let path = run.path.as_ref().unwrap();
    let (start, end) = path.span().unwrap();
    for i in 0..=200 {
        let point = path.at(start + f64::from(i) / 200.0 * (end - start)).unwrap();
        assert!(point.x >= 0.0 && point.x.is_finite() && point.xdot.is_finite(), "{what}");
    }
}

#[test]
fn odd_forces_end_with_a_status_and_a_valid_record() {
    let mut random = Random(77);
    let mut counts = [0; 10];
    for case in 0..1500 {
        let wild = case % 3 == 0;
        let mut f = force(&mut random, wild);
        let e = [0.0_f64, 1.0, 0.5, 0.9, 0.05][case % 5].min(random.between(0.3, 1.3));
        let settings = SwitchedRk {
            order: if case % 2 == 0 { Order::Eight } else { Order::Five },
            max_steps: 20_000,
            max_impacts: 3_000,
            ..SwitchedRk::with_tol(10f64.powf(random.between(-10.0, -3.0)))
        };
        let restitution = Restitution::from_e(e).unwrap();
        let start = Physical {
            x: if case % 7 == 0 { 0.0 } else { random.between(0.0, 2.0) },
            xdot: if case % 11 == 0 { 0.0 } else { random.between(-5.0, 5.0) },
        };
        let output = Output { dense: true, ..Output::default() };
        let mut evaluations = 0_u64;
        let mut counted = FunctionForce(|t: f64, x: f64, v: f64| {
            evaluations += 1;
            f(t, x, v)
        });
        let run = simulate_switched_rk(
            settings,
            restitution,
            &mut counted,
            (0.0, 3.0),
            start,
            output,
            &mut Silent,
        )
        .unwrap();
        let what = format!("{case} {e} {settings:?} {start:?} {:?}", run.trajectory.status);
        assert_eq!(run.counts.nfev, evaluations, "{what}");
        assert!(evaluations < 1_000_000, "{what} {evaluations}");
        assert_consistent(&run, &what);
        // elastic bouncing under drag: the impacts in a second grow exponentially, without an end
        let status = run.trajectory.status;
        let ends = matches!(status, Status::StepBudget | Status::ZenoBudget);
        let endless = e == 1.0 && ends;
        assert!(wild || endless || status == Status::Completed, "{what}");
        counts[status as usize] += 1;
    }
    assert!(counts[Status::Completed as usize] > 1200, "{counts:?}");
}
