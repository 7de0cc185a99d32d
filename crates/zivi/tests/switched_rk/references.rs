//! The stored trajectories, computed in closed form between events with 50 digits.

use zivi::{Order, Quantity};

use crate::problems::{end, settings, Reference, Run};

fn worst(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Errors of Zeno times, of impacts, and of states at the end and at the stored samples.
fn errors(reference: &Reference, run: &Run) -> [f64; 3] {
    let zeno = &run.trajectory.events.zeno_times;
    let impacts = run.impacts_down_to(0.0, 100);
    let impacts = reference.impacts.iter().map(|&[t, u]| {
        // a skipped impact may be slower than the tail resolves
        let near = impacts.iter().map(|it| (it.t - t).abs().max((it.xdot_after - u).abs()));
        near.fold(f64::INFINITY, f64::min)
    });
    let (path, end) = (run.path.as_ref().unwrap(), end(run));
    let samples = reference.samples.iter().map(|&[t, x, v]| {
        let point = path.at(t).unwrap();
        (point.x - x).abs().max((point.xdot - v).abs())
    });
    let at_end = (end.x - reference.end.x).abs().max((end.xdot - reference.end.xdot).abs());
    [
        worst(zeno.iter().copied().zip(reference.zeno.iter().copied())),
        impacts.fold(0.0, f64::max),
        samples.fold(at_end, f64::max),
    ]
}

#[test]
fn events_and_states_are_the_stored_ones_at_every_tolerance() {
    // largest errors over the tolerance that are allowed: Zeno times, impacts, states
    let bounds = [
        ("B1", [1.0, 1.0, 1.0]),
        ("B3", [1.0, 1.0, 3.0]),
        ("T1", [30.0, 30.0, 30.0]),
        ("T2", [10.0, 10.0, 10.0]),
        ("T3", [3.0, 30.0, 30.0]),
        ("O1", [30.0, 30.0, 1.0]),
        ("O2", [40.0, 40.0, 3.0]),
        ("O4", [0.0, 0.0, 3.0]),
        ("O5", [0.0, 0.0, 3.0]),
    ];
    for (name, bounds) in bounds {
        let reference = Reference::named(name);
        for order in [Order::Five, Order::Eight] {
            for tol in [1e-4, 1e-6, 1e-8, 1e-10, 1e-12] {
                let run = reference.simulate(settings(order, tol));
                let events = &run.trajectory.events;
                let what = format!("{name} {order:?} {tol:e}");
                assert_eq!(events.zeno_times.len(), reference.zeno.len(), "{what}");
                assert_eq!(events.liftoff_times.len(), reference.lift.len(), "{what}");
                assert_eq!(events.rest_time.is_some(), reference.rests_at_end, "{what}");
                let errors = errors(&reference, &run);
                println!("{what} {:?}", errors.map(|error| error / tol));
                for (error, bound) in errors.iter().zip(bounds) {
                    assert!(*error <= bound * tol + 3e-13, "{what}: {errors:?}");
                }
                // lift-off depends on the force at the wall alone, not on the tolerance
                let lifts = events.liftoff_times.iter().copied();
                assert!(worst(lifts.zip(reference.lift.iter().copied())) < 2e-14, "{what}");
            }
        }
    }
}

#[test]
fn the_evaluations_of_the_force_are_those_of_the_method() {
    // no dense output: 6 evaluations a step of order 5, 11 of order 8
    let count = |name: &str, order, tol| {
        let reference = Reference::named(name);
        let run = reference.simulate_bare(settings(order, tol));
        (run.counts.nfev, run.counts.accepted + run.counts.rejected)
    };
    for (name, order, tol, most) in [
        ("B1", Order::Five, 1e-6, 70),
        ("B1", Order::Eight, 1e-6, 130),
        ("O4", Order::Five, 1e-6, 2200),
        ("O4", Order::Eight, 1e-6, 1900),
        ("O4", Order::Eight, 1e-12, 6800),
        ("T1", Order::Eight, 1e-8, 4400),
        ("T3", Order::Eight, 1e-8, 1900),
        ("O2", Order::Eight, 1e-8, 1750),
    ] {
        let (nfev, steps) = count(name, order, tol);
        println!("{name} {order:?} {tol:e} nfev {nfev} steps {steps}");
        assert!(nfev <= most, "{name} {order:?} {tol:e}: {nfev}");
    }
}

#[test]
fn samples_are_consistent() {
    let run = Reference::named("T3").simulate(settings(Order::Eight, 1e-8));
    let of = |quantity| run.trajectory.columns.of(quantity);
    let (t, x, xdot) = (of(Quantity::T), of(Quantity::X), of(Quantity::Xdot));
    let (s, v) = (of(Quantity::S), of(Quantity::V));
    let (lambda_s, lambda_v) = (of(Quantity::LambdaS), of(Quantity::LambdaV));
    let kappa = 0.7 / 1.3;
    let path = run.path.as_ref().unwrap();
    for k in 0..t.len() {
        assert!(k == 0 || t[k] > t[k - 1]);
        let (ls, lv) = (lambda_s[k], lambda_v[k]);
        assert!((s[k].abs() - x[k]).abs() == 0.0 && (s[k] == 0.0 || s[k].signum() == ls));
        assert!(((1.0 - kappa * ls * lv) * v[k] * ls - xdot[k]).abs() < 1e-13);
        assert!(if x[k] == 0.0 && xdot[k] == 0.0 { ls == 0.0 } else { ls.abs() == 1.0 });
        let point = path.at(t[k]).unwrap();
        assert!((point.x - x[k]).abs() < 1e-12 && (point.xdot - xdot[k]).abs() < 1e-11, "{}", t[k]);
    }
    // every impact is a sample, on the wall, with the velocity after it
    for impact in &run.trajectory.events.impacts {
        let k = t.iter().position(|&t| t == impact.t).unwrap();
        assert_eq!((x[k], xdot[k]), (0.0, impact.xdot_after));
        assert_eq!(path.at(impact.t).unwrap().xdot, impact.xdot_after);
    }
    // v does not jump at an impact: it is the same function of both velocities
    for impact in &run.trajectory.events.impacts {
        let (before, after) = (impact.xdot_before.abs(), impact.xdot_after);
        assert!((before / (1.0 + kappa) - after / (1.0 - kappa)).abs() < 1e-13 * before);
    }
}
