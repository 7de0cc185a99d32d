//! Fitted orders of convergence at fixed steps, through impacts, Zeno points, rest and lift-off.

use zivi::{Order, SwitchedRk};

use crate::problems::{end, Reference};

/// Errors of the final state for steps `h`, `h/2`, ...
fn errors(reference: &Reference, order: Order, h: f64, halvings: i32) -> Vec<f64> {
    let error = |i| {
        let max_step = h * 0.5f64.powi(i);
        let fixed = SwitchedRk { order, adaptive: false, max_step, ..SwitchedRk::with_tol(1e-13) };
        let run = reference.simulate(fixed);
        assert_eq!(run.trajectory.events.zeno_times.len(), reference.zeno.len());
        assert_eq!(run.trajectory.events.liftoff_times.len(), reference.lift.len());
        let end = end(&run);
        (end.x - reference.end.x).abs() + (end.xdot - reference.end.xdot).abs()
    };
    (0..=halvings).map(error).collect()
}

/// The slope of the line through `log error` over `log h`, for steps halved each time.
fn fitted_order(errors: &[f64]) -> f64 {
    let n = errors.len() as f64;
    let middle = (n - 1.0) / 2.0;
    let points = errors.iter().enumerate().map(|(i, e)| (middle - i as f64, e.log2()));
    let (over, under) = points.fold((0.0, 0.0), |(a, b), (u, y)| (a + u * y, b + u * u));
    over / under
}

#[test]
fn the_order_is_that_of_the_pair() {
    // name, order, largest step, halvings above rounding, order to be seen
    let cases = [
        ("O4", Order::Five, 0.2, 3, 4.7),  // 20 impacts
        ("O5", Order::Five, 0.1, 2, 4.7),  // 20 impacts
        ("T3", Order::Five, 0.16, 3, 4.7), // 3 Zeno points, 4 lift-offs
        ("O2", Order::Five, 0.2, 3, 4.7),  // 3 Zeno points, 3 lift-offs
        ("O4", Order::Eight, 0.4, 2, 7.0),
        ("O5", Order::Eight, 0.3, 1, 7.0),
        ("T3", Order::Eight, 0.2, 2, 7.0),
        ("O2", Order::Eight, 0.8, 2, 7.0),
    ];
    for (name, order, h, halvings, expected) in cases {
        let errors = errors(&Reference::named(name), order, h, halvings);
        let fitted = fitted_order(&errors);
        println!("{name} {order:?} {fitted} {errors:?}");
        assert!(fitted > expected, "{name} {order:?}: order {fitted}, {errors:?}");
    }
}
