//! Tolerances have units, and no result depends on which.

use std::convert::Infallible;

use zivi::{FunctionForce, LinearForce, Order, Physical, Restitution, SwitchedRk};

use crate::problems::simulate;

#[test]
fn no_result_depends_on_the_units() {
    // x -> L x, t -> T t with powers of two changes no digit of any result
    let run = |order, l: f64, t: f64| {
        let mut force = FunctionForce(|at: f64, x: f64, v: f64| {
            let (at, x, v) = (at / t, x / l, v * t / l);
            Ok::<f64, Infallible>(
                (-9.81 - 0.3 * v - 2.0 * x + 12.0 * (3.0 * at).cos()) * l / (t * t),
            )
        });
        let settings = SwitchedRk {
            rtol: 1e-7,
            atol: [1e-9 * l, 1e-6 * l / t],
            order,
            first_step: Some(0.01 * t),
            ..SwitchedRk::default()
        };
        let (restitution, start) =
            (Restitution::from_e(0.4).unwrap(), Physical { x: l, xdot: 0.0 });
        simulate(settings, restitution, &mut force, (0.0, 7.0 * t), start)
    };
    for (order, exponents) in
        [(Order::Eight, (-30, 0)), (Order::Five, (30, -20)), (Order::Eight, (0, 30))]
    {
        let (l, t) = (2f64.powi(exponents.0), 2f64.powi(exponents.1));
        let (one, other) = (run(order, 1.0, 1.0), run(order, l, t));
        assert_eq!(one.counts, other.counts);
        let (one, other) = (one.trajectory.events, other.trajectory.events);
        let scaled = |times: &[f64]| times.iter().map(|it| it * t).collect::<Vec<_>>();
        assert!(!one.zeno_times.is_empty() && !one.liftoff_times.is_empty());
        assert_eq!(scaled(&one.zeno_times), other.zeno_times);
        assert_eq!(scaled(&one.liftoff_times), other.liftoff_times);
        let speeds = one.impacts.iter().map(|it| it.xdot_after * l / t);
        assert!(speeds.eq(other.impacts.iter().map(|it| it.xdot_after)));
    }
}

#[test]
fn a_zeno_time_is_known_to_what_the_tolerances_allow_in_any_units() {
    // lengths in nm: the absolute tolerance of 1 nm is 1e-9 m, not a second
    let zeno = |nm: f64, settings| {
        let mut force = LinearForce {
            stiffness: 0.0,
            damping: 0.3,
            gravity: 9.81 * nm,
            amplitude: 0.0,
            omega: 1.0,
            phase: 0.0,
        };
        let (restitution, start) =
            (Restitution::from_e(0.5).unwrap(), Physical { x: nm, xdot: 0.0 });
        simulate(settings, restitution, &mut force, (0.0, 3.0), start).trajectory.events.zeno_times
            [0]
    };
    let exact = zeno(1.0, SwitchedRk::with_tol(1e-12));
    let mine = zeno(1e9, SwitchedRk { atol: [1.0; 2], ..SwitchedRk::default() });
    assert!((mine - exact).abs() < 1e-7, "{mine} {exact}");
}
