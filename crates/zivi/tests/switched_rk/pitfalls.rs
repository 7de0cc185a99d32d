//! Where event-driven integrators go wrong.

use std::convert::Infallible;
use std::f64::consts::PI;

use zivi::{
    ConstantForce, FunctionForce, LinearForce, Order, Physical, Restitution, Status, SwitchedRk,
};

use crate::closed;
use crate::problems::{end, settings, simulate, Random, Reference};

const ORDERS: [Order; 2] = [Order::Five, Order::Eight];

fn restitution(e: f64) -> Restitution {
    Restitution::from_e(e).unwrap()
}

/// `-stiffness x - damping x' - gravity`.
fn spring(stiffness: f64, damping: f64, gravity: f64) -> LinearForce {
    LinearForce { stiffness, damping, gravity, amplitude: 0.0, omega: 1.0, phase: 0.0 }
}

#[test]
fn no_dip_behind_the_wall_is_missed() {
    // x = 1 + (1 + d) cos(t + phase) is behind the wall for a short time
    for (d, tol) in
        [(1e-2, 1e-4), (1e-3, 1e-4), (1e-3, 1e-6), (1e-3, 1e-9), (1e-5, 1e-9), (1e-6, 1e-11)]
    {
        for order in ORDERS {
            for i in 0..40 {
                let phase = -PI + 0.1 + 2.0 * (PI - 0.1) / 40.0 * f64::from(i);
                let (sin, cos) = phase.sin_cos();
                let start = Physical { x: 1.0 + (1.0 + d) * cos, xdot: -(1.0 + d) * sin };
                if start.x < 0.0 {
                    continue;
                }
                let first = (-1.0 / (1.0 + d)).acos() - phase;
                let half = (1.0 / (1.0 + d)).acos();
                let mut force = spring(1.0, 0.0, -1.0);
                let run =
                    simulate(settings(order, tol), restitution(0.5), &mut force, (0.0, 8.0), start);
                let found = run.trajectory.events.impacts.first().expect("an impact").t;
                // an error of x of some tolerances moves the shallow crossing
                let allowed = (100.0 * tol / half).min(half) + 1e-9;
                assert!((found - first).abs() < allowed, "{d:e} {tol:e} {order:?} {phase}");
            }
        }
    }
}

#[test]
fn a_near_miss_is_no_impact() {
    for (d, tol) in [(1e-2, 1e-4), (1e-3, 1e-6), (1e-5, 1e-9)] {
        for order in ORDERS {
            for i in 0..40 {
                let phase = -PI + 2.0 * PI / 40.0 * f64::from(i);
                let (sin, cos) = phase.sin_cos();
                let start = Physical { x: 1.0 + (1.0 - d) * cos, xdot: -(1.0 - d) * sin };
                let mut force = spring(1.0, 0.0, -1.0);
                let run =
                    simulate(settings(order, tol), restitution(0.5), &mut force, (0.0, 8.0), start);
                assert!(run.trajectory.events.impacts.is_empty(), "{d:e} {order:?} {phase}");
            }
        }
    }
}

#[test]
fn grazing_within_the_tolerance_is_passed() {
    // the height of the closest approach is up to some tolerances, on both sides of the wall
    for order in ORDERS {
        for i in -40..=40 {
            let d = f64::from(i) * 1e-6;
            let start = Physical { x: 2.0 + d, xdot: 0.0 };
            let mut force = spring(1.0, 0.0, -1.0);
            let run =
                simulate(settings(order, 1e-5), restitution(0.5), &mut force, (0.0, 4.0), start);
            // the speed of an impact would be up to sqrt(2 d)
            let end = end(&run);
            assert!((end.x - 1.0 - 4f64.cos()).abs() < 2e-2, "{d:e} {end:?}");
            assert!(run.counts.accepted + run.counts.rejected < 60, "{:?}", run.counts);
        }
    }
}

#[test]
fn lift_off_and_short_arcs_do_not_make_steps_short() {
    for (name, most) in [("T1", 500), ("T3", 250), ("O2", 220)] {
        for order in ORDERS {
            let run = Reference::named(name).simulate(settings(order, 1e-6));
            let steps = run.counts.accepted + run.counts.rejected;
            assert!(steps < most, "{name} {order:?}: {steps}");
        }
    }
    // one step from impact to impact, however short the arcs before were
    let mut drag = spring(0.0, 0.3, 9.81);
    let start = Physical { x: 1.0, xdot: 0.0 };
    let run =
        simulate(settings(Order::Eight, 1e-6), restitution(0.9), &mut drag, (0.0, 30.0), start);
    assert!(run.counts.accepted <= run.counts.impacts + 5, "{:?}", run.counts);
}

#[test]
fn the_root_at_the_start_of_an_arc_is_no_impact() {
    for name in ["O4", "O5", "T1"] {
        let run = Reference::named(name).simulate(settings(Order::Five, 1e-5));
        let impacts = &run.trajectory.events.impacts;
        assert!(impacts.windows(2).all(|pair| pair[1].t > pair[0].t + 1e-9));
    }
}

#[test]
fn rest_is_exact() {
    let mut random = Random(5);
    for i in 0..200 {
        let start = Physical { x: random.between(0.1, 2.0), xdot: random.between(-3.0, 3.0) };
        let settings = settings(ORDERS[i % 2], 1e-4 * 0.5f64.powi(i as i32 % 30));
        let restitution = restitution(random.between(0.05, 0.9));
        let run = simulate(settings, restitution, &mut ConstantForce(-9.81), (0.0, 60.0), start);
        assert_eq!(end(&run), Physical::default());
        assert!(run.trajectory.events.rest_time.is_some());
    }
}

#[test]
fn large_times_terminate() {
    let exact = 2.465_846_631_559_044;
    let e = 0.418_439_716_312_056_73;
    for (t0, tol) in [(0.0, 1e-13), (1e6, 1e-9), (1e9, 1e-6), (1e12, 1e-2), (-1e9, 1e-6)] {
        for order in ORDERS {
            let (span, start) = ((t0, t0 + 3.0), Physical { x: 1.0, xdot: 6.0 });
            for tolerance in [1e-6, 1e-12] {
                let settings = settings(order, tolerance);
                let run =
                    simulate(settings, restitution(e), &mut ConstantForce(-9.81), span, start);
                let rest = run.trajectory.events.rest_time.unwrap() - t0;
                assert!((rest - exact).abs() < tol, "{t0:e} {order:?} {rest}");
            }
        }
    }
}

#[test]
fn many_impacts_far_from_zero_do_not_drift() {
    // x'' = -9.81 from 1 m with e = 0.97: 35 impacts in 9 s; a time is known to half its spacing
    let (e, g) = (0.97_f64, 9.81);
    let fall = (2.0_f64 / g).sqrt();
    for order in ORDERS {
        for t0 in [1e6, 1e8] {
            // a force that says that it may change keeps every impact
            let mut force = FunctionForce(|_: f64, _: f64, _: f64| Ok::<f64, Infallible>(-g));
            let (span, start) = ((t0, t0 + 9.0), Physical { x: 1.0, xdot: 0.0 });
            let run = simulate(settings(order, 1e-12), restitution(e), &mut force, span, start);
            let impacts = &run.trajectory.events.impacts;
            let mut exact = fall;
            for (n, impact) in (1..).zip(impacts) {
                assert!((impact.t - t0 - exact).abs() < 0.51 * f64::EPSILON * t0 + 1e-13, "{n}");
                exact += 2.0 * e.powi(n) * fall;
            }
            assert!(impacts.len() >= 10, "{}", impacts.len());
        }
    }
}

#[test]
fn tolerances_below_rounding_of_the_time_cost_nothing() {
    // a harmonic force 7e6 s from zero: its phase is known to 1e-9
    for order in ORDERS {
        let mut force = LinearForce { amplitude: 1.0, ..spring(1.0, 0.1, 2.0) };
        let (span, start) = ((7e6, 7e6 + 30.0), Physical { x: 1.0, xdot: 0.0 });
        let run = simulate(settings(order, 1e-13), restitution(0.8), &mut force, span, start);
        assert_eq!(run.trajectory.status, Status::Completed);
        assert!(run.counts.nfev < 60_000, "{:?}", run.counts);
    }
}

#[test]
fn stages_look_behind_the_wall_only_a_little() {
    // the force ends not far behind the wall: a step that goes there is tried again, shorter
    for order in ORDERS {
        let mut deepest = 0.0_f64;
        let f = |_: f64, x: f64, v: f64| {
            deepest = deepest.min(x);
            Ok::<f64, Infallible>(-9.81 - 0.1 * v + (x + 0.05).sqrt())
        };
        let start = Physical { x: 1.0, xdot: 0.0 };
        let mut force = FunctionForce(f);
        let run = simulate(settings(order, 1e-8), restitution(0.6), &mut force, (0.0, 5.0), start);
        assert_eq!(run.trajectory.events.zeno_times.len(), 1);
        assert!(deepest < 0.0);
    }
}

#[test]
fn an_end_within_the_accumulation_is_the_state_there() {
    // x'' = -2 from 1 m: impacts at 1, 2, 2.5, 2.75, ..., rest at 3
    for order in ORDERS {
        for n in 1..20 {
            let part = 0.3 * 0.5f64.powi(n);
            let t_end = 3.0 - 2.0 * 0.5f64.powi(n) + part;
            let u = 2.0 * 0.5f64.powi(n + 1);
            let start = Physical { x: 1.0, xdot: 0.0 };
            let mut force = ConstantForce(-2.0);
            let run =
                simulate(settings(order, 1e-6), restitution(0.5), &mut force, (0.0, t_end), start);
            let end = end(&run);
            assert!((end.x - u * part + part * part).abs() < 1e-12, "{n} {end:?}");
            assert!((end.xdot - u + 2.0 * part).abs() < 1e-12, "{n} {end:?}");
            assert_eq!(run.trajectory.events.rest_time, None);
            assert_eq!(run.counts.impacts, n as u64 + 1);
        }
    }
}

#[test]
fn decay_without_accumulation_is_not_rest() {
    // wall at the equilibrium of a damped oscillator: equal flight times, never a Zeno point
    for order in ORDERS {
        let mut force = spring(1.0, 0.2, 0.0);
        let start = Physical { x: 1.0, xdot: 0.0 };
        let run =
            simulate(settings(order, 1e-12), restitution(0.5), &mut force, (0.0, 60.0), start);
        let events = &run.trajectory.events;
        assert!(events.zeno_times.is_empty() && events.rest_time.is_none());
        assert_eq!(events.impacts.len(), 19);
        let flight = PI / (1.0f64 - 0.01).sqrt();
        for pair in events.impacts[..8].windows(2) {
            assert!((pair[1].t - pair[0].t - flight).abs() < 1e-8, "{order:?} {pair:?}");
        }
    }
    // nor is a motion that has decayed far below the tolerance
    let (mut force, start) = (spring(1.0, 0.2, 0.0), Physical { x: 1.0, xdot: 0.0 });
    let run =
        simulate(settings(Order::Eight, 1e-8), restitution(0.5), &mut force, (0.0, 1e3), start);
    assert!(run.trajectory.events.rest_time.is_none() && end(&run).x < 1e-7);
    assert!(run.counts.accepted < 20_000, "{:?}", run.counts);
}

#[test]
fn a_rocking_block_comes_to_rest() {
    // f = -(alpha - x), e = 1 - 1.5 sin^2 alpha, alpha = 0.2
    let e = 1.0 - 1.5 * 0.2f64.sin().powi(2);
    for order in ORDERS {
        let start = Physical { x: 0.1, xdot: 0.0 };
        let mut force = spring(-1.0, 0.0, 0.2);
        let run = simulate(settings(order, 1e-11), restitution(e), &mut force, (0.0, 40.0), start);
        let rest = run.trajectory.events.rest_time.unwrap();
        assert!((rest - 31.902_716).abs() < 6e-7, "{rest}");
    }
}

#[test]
fn periodic_orbits_of_the_vibrating_table() {
    // x = (u - a/w sin p) t - g t^2/2 - a/w^2 (cos(w t + p) - cos p) returns after n periods with
    // the velocity -u/e if u = g T e/(1 + e), sin p = (w/a)(u - g T/2)
    let (g, w) = (9.81, 2.0 * PI);
    for (e, n, gamma) in [(0.5, 1.0, 1.3), (0.8, 1.0, 0.8), (0.8, 2.0, 1.2), (0.7, 1.0, 1.0)] {
        let (a, period) = (gamma * g, 2.0 * PI * n / w);
        let u = g * period * e / (1.0 + e);
        let phase = (w / a * (u - 0.5 * g * period)).asin();
        for phase in [phase, PI - phase] {
            let mut force = LinearForce {
                stiffness: 0.0,
                damping: 0.0,
                gravity: g,
                amplitude: a,
                omega: w,
                phase,
            };
            for order in ORDERS {
                let start = Physical { x: 0.0, xdot: u };
                let settings = settings(order, 1e-12);
                let run =
                    simulate(settings, restitution(e), &mut force, (0.0, 4.5 * period), start);
                let impacts = &run.trajectory.events.impacts;
                assert_eq!(impacts.len(), 4);
                for (i, impact) in impacts.iter().enumerate() {
                    assert!(
                        (impact.t - (i + 1) as f64 * period).abs() < 1e-9,
                        "{e} {n} {impact:?}"
                    );
                    assert!((impact.xdot_after - u).abs() < 1e-8);
                }
            }
        }
    }
}

#[test]
fn a_plastic_wall_stops_the_mass_and_lets_it_go() {
    let mut random = Random(11);
    let (mut stops, mut lifts) = (0, 0);
    for i in 0..200 {
        let gravity = random.between(0.5, 10.0);
        let mut force = LinearForce {
            stiffness: random.between(0.05, 4.0),
            damping: random.between(0.0, 0.4),
            gravity,
            amplitude: random.between(0.5, 2.5) * gravity,
            omega: random.between(0.5, 7.0),
            phase: random.between(-3.0, 3.0),
        };
        let start = (random.between(0.05, 1.5), random.between(-3.0, 3.0));
        let story = closed::simulate(force, 0.0, (0.0, 8.0), start);
        let initial = Physical { x: start.0, xdot: start.1 };
        let settings = settings(ORDERS[i % 2], 1e-11);
        let run = simulate(settings, restitution(0.0), &mut force, (0.0, 8.0), initial);
        let events = &run.trajectory.events;
        assert_eq!(events.impacts.len(), story.impacts.len(), "{i} {force:?}");
        assert_eq!(events.zeno_times.len(), story.zeno.len(), "{i} {force:?}");
        assert_eq!(events.liftoff_times.len(), story.lift.len(), "{i} {force:?}");
        for (mine, exact) in events.impacts.iter().zip(&story.impacts) {
            assert!((mine.t - exact[0]).abs() < 1e-8 && mine.xdot_after == 0.0);
        }
        assert!((end(&run).x - story.end[0]).abs() < 1e-8, "{i} {force:?}");
        (stops, lifts) = (stops + events.zeno_times.len(), lifts + events.liftoff_times.len());
    }
    assert!(stops > 200 && lifts > 200, "{stops} {lifts}");
}

#[test]
fn an_elastic_wall_keeps_the_energy() {
    for order in ORDERS {
        for (stiffness, gravity) in [(0.0, 9.81), (4.0, 1.0), (1.0, 0.0), (2.0, -0.5)] {
            let energy = |it: Physical| {
                it.xdot * it.xdot / 2.0 + stiffness * it.x * it.x / 2.0 + gravity * it.x
            };
            let start = Physical { x: 1.0, xdot: -1.0 };
            let mut force = spring(stiffness, 0.0, gravity);
            let run =
                simulate(settings(order, 1e-11), restitution(1.0), &mut force, (0.0, 100.0), start);
            let events = &run.trajectory.events;
            assert!(events.impacts.len() > 15 && events.rest_time.is_none());
            let drift = energy(end(&run)) / energy(start) - 1.0;
            assert!(drift.abs() < 2e-8, "{order:?} {stiffness} {gravity}: {drift:e}");
        }
    }
}

#[test]
fn a_mass_that_arrives_at_the_wall_has_its_impact_at_once() {
    let start = Physical { x: 0.0, xdot: -2.0 };
    let mut force = ConstantForce(-2.0);
    let run =
        simulate(settings(Order::Eight, 1e-6), restitution(0.5), &mut force, (0.0, 3.0), start);
    let events = &run.trajectory.events;
    assert_eq!((events.impacts[0].t, events.impacts[0].xdot_after), (0.0, 1.0));
    assert!((events.rest_time.unwrap() - 2.0).abs() < 1e-12);
    assert_eq!(run.path.unwrap().at(0.0).unwrap().xdot, 1.0);
}

#[test]
fn a_force_that_pulls_off_lifts_off_at_once() {
    let mut force = ConstantForce(2.0);
    let start = Physical::default();
    let run =
        simulate(settings(Order::Eight, 1e-6), restitution(0.5), &mut force, (0.0, 3.0), start);
    assert_eq!(run.trajectory.events.liftoff_times, [0.0]);
    assert!((end(&run).x - 9.0).abs() < 1e-12);
    // and one that grows does so at its zero: f = -1 + t lifts at 1, then x = (t - 1)^3/6
    let mut ramp = FunctionForce(|t: f64, _: f64, _: f64| Ok::<f64, Infallible>(t - 1.0));
    let run =
        simulate(settings(Order::Eight, 1e-9), restitution(0.5), &mut ramp, (0.0, 3.0), start);
    assert!((run.trajectory.events.liftoff_times[0] - 1.0).abs() < 1e-15);
    assert!((end(&run).x - 8.0 / 6.0).abs() < 1e-9);
}

#[test]
fn bad_settings_are_refused_by_name() {
    let good = SwitchedRk::default();
    let bad = [
        ("rtol", SwitchedRk { rtol: f64::NAN, ..good }),
        ("rtol", SwitchedRk { rtol: 1.0, ..good }),
        ("atol", SwitchedRk { atol: [0.0, 1e-9], ..good }),
        ("atol", SwitchedRk { atol: [1e-9, f64::INFINITY], ..good }),
        ("max_step", SwitchedRk { max_step: 0.0, ..good }),
        ("max_step", SwitchedRk { max_step: f64::NAN, ..good }),
        ("max_step", SwitchedRk { adaptive: false, ..good }),
        ("first_step", SwitchedRk { first_step: Some(-1.0), ..good }),
        ("max_steps", SwitchedRk { max_steps: 0, ..good }),
        ("max_impacts", SwitchedRk { max_impacts: 2, ..good }),
    ];
    for (name, settings) in bad {
        let message = settings.validated().unwrap_err().to_string();
        assert!(message.starts_with(&format!("{name} must be")), "{message}");
    }
    assert_eq!(
        Status::ALL.map(|it| it as u8),
        [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24]
    );
}

#[test]
fn a_mass_under_no_force_lifts_off_where_the_force_becomes_positive() {
    // f = s max(0, t - 1)^m: x = s (t - 1)^(m + 2)/((m + 1)(m + 2)); m = 0 is a step
    for (order, m) in ORDERS.into_iter().flat_map(|order| [0, 1, 2, 4, 8].map(|m| (order, m))) {
        for (s, t_end) in [(1.0, 3.0), (1e3, 10.0), (1e-3, 1.01)] {
            let mut force = FunctionForce(|t: f64, _: f64, _: f64| {
                Ok::<f64, Infallible>(if t < 1.0 { 0.0 } else { s * (t - 1.0).powi(m) })
            });
            let (restitution, start) = (Restitution::from_e(0.5).unwrap(), Physical::default());
            let settings = SwitchedRk { atol: [1e-16; 2], ..settings(order, 1e-9) };
            let run = simulate(settings, restitution, &mut force, (0.0, t_end), start);
            let lifts = &run.trajectory.events.liftoff_times;
            assert!(lifts.len() == 1 && (lifts[0] - 1.0).abs() < 2e-15, "{order:?} {m}: {lifts:?}");
            let power = f64::from(m);
            let exact = s * (t_end - 1.0).powi(m + 2) / ((power + 1.0) * (power + 2.0));
            let x = end(&run).x;
            assert!((x - exact).abs() < 1e-7 * exact + 1e-13, "{order:?} {m}: {x:e} {exact:e}");
        }
    }
}
