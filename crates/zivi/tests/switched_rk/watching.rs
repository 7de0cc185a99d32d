//! The user's events, sample times, and dense output.

use std::cell::Cell;
use std::convert::Infallible;

use zivi::{
    simulate_switched_rk, ConstantForce, Direction, Order, Output, PathPoint, Physical, Quantity,
    Restitution, Silent, Status, SwitchedRk, UserEvent,
};

use crate::problems::{settings, simulate, Random, Reference, Run};

const ORDERS: [Order; 2] = [Order::Five, Order::Eight];

/// The ball `x'' = -2` from 1 m with `e = 1/2`: impacts at 1, 2, 2.5, 2.75, ..., rest at 3.
fn ball(output: Output<'_, Infallible>, order: Order, t_end: f64) -> Run {
    let (restitution, start) = (Restitution::from_e(0.5).unwrap(), Physical { x: 1.0, xdot: 0.0 });
    let settings = settings(order, 1e-8);
    let force = &mut ConstantForce(-2.0);
    simulate_switched_rk(settings, restitution, force, (0.0, t_end), start, output, &mut Silent)
        .unwrap()
}

fn event<'a>(g: impl Fn(f64, f64, f64) -> f64 + 'a) -> UserEvent<'a, Infallible> {
    UserEvent::new(move |t, x, xdot| Ok(g(t, x, xdot)))
}

fn times(run: &Run, number: usize) -> Vec<f64> {
    run.hits[number].iter().map(|hit| hit.t).collect()
}

fn near(mine: &[f64], exact: &[f64]) -> bool {
    mine.len() == exact.len() && mine.iter().zip(exact).all(|(a, b)| (a - b).abs() < 1e-12)
}

#[test]
fn levels_apices_and_impacts_are_found_in_their_directions() {
    for order in ORDERS {
        let level = |direction| UserEvent { direction, ..event(|_, x, _| x - 0.1875) };
        let events = vec![
            level(Direction::Either),
            level(Direction::Rising),
            level(Direction::Falling),
            UserEvent { direction: Direction::Falling, ..event(|_, _, xdot| xdot) },
            UserEvent { direction: Direction::Rising, ..event(|_, _, xdot| xdot) },
            event(|_, x, _| x),
            event(|t, _, _| t - 2.2),
        ];
        let run = ball(Output { events, ..Output::default() }, order, 2.6);
        // 1 - t^2 = 3/16; then 1/4 - (t - 3/2)^2 = 3/16
        let fall = 0.8125f64.sqrt();
        assert!(near(&times(&run, 0), &[fall, 1.25, 1.75]), "{:?}", times(&run, 0));
        assert!(near(&times(&run, 1), &[1.25]));
        assert!(near(&times(&run, 2), &[fall, 1.75]));
        // the start at the apex is no event, nor is leaving it
        assert!(near(&times(&run, 3), &[1.5, 2.25]));
        // by its jump at an impact the velocity rises through zero
        assert!(near(&times(&run, 4), &[1.0, 2.0, 2.5]));
        assert_eq!(run.hits[4].iter().map(|hit| hit.at.x).fold(0.0, f64::max), 0.0);
        assert!(run.hits[4].iter().all(|hit| hit.at.xdot > 0.0));
        assert!(near(&times(&run, 5), &[1.0, 2.0, 2.5]));
        assert!(near(&times(&run, 6), &[2.2]));
    }
}

#[test]
fn a_terminal_event_ends_the_run_exactly_there() {
    for order in ORDERS {
        for (number, exact) in [(1, 1.5), (2, 2.25), (3, 2.625)] {
            let apex = UserEvent {
                direction: Direction::Falling,
                terminal: Some(number),
                ..event(|_, _, xdot| xdot)
            };
            let later = event(|t, _, _| t - 2.9);
            let output = Output { dense: true, events: vec![later, apex], ..Output::default() };
            let run = ball(output, order, 4.0);
            assert_eq!(run.trajectory.status, Status::TerminatedByEvent);
            let of = |quantity| *run.trajectory.columns.of(quantity).last().unwrap();
            assert!((of(Quantity::T) - exact).abs() < 1e-12);
            assert_eq!(of(Quantity::T), run.hits[1][number - 1].t);
            assert!(of(Quantity::Xdot).abs() < 1e-12);
            assert!(run.hits[0].is_empty() && run.hits[1].len() == number);
            assert_eq!(run.impacts_down_to(0.0, 1000).len(), number);
            assert_eq!(run.path.unwrap().span().unwrap().1, of(Quantity::T));
            assert_eq!(run.trajectory.events.rest_time, None);
            assert!(run.trajectory.events.zeno_times.is_empty());
        }
    }
}

#[test]
fn events_within_the_tail_are_found() {
    for order in ORDERS {
        for number in [4, 9, 20] {
            let apex = UserEvent {
                direction: Direction::Falling,
                terminal: Some(number),
                ..event(|_, _, xdot| xdot)
            };
            let output = Output { dense: true, events: vec![apex], ..Output::default() };
            let run = ball(output, order, 4.0);
            assert_eq!(run.tails.len(), 1, "{number}");
            let left = 2.0 * 0.5f64.powi(number as i32);
            let apex = run.hits[0][number - 1].t;
            assert!((apex - (3.0 - 1.5 * left)).abs() < 1e-11, "{number} {apex} {left}");
            assert!((run.hits[0][number - 1].at.x - left * left / 4.0).abs() < 1e-11);
            assert_eq!(run.impacts_down_to(0.0, 1000).len(), number);
            let at_end = run.path.as_ref().unwrap().at(3.0 - 2.0 * left);
            assert!(at_end.unwrap().x < 1e-9 && run.path.unwrap().at(3.0).is_none());
        }
    }
    // at rest too
    let run = ball(
        Output { events: vec![event(|t, _, _| t - 3.5)], ..Output::default() },
        Order::Eight,
        4.0,
    );
    assert!(near(&times(&run, 0), &[3.5]));
}

#[test]
fn two_crossings_within_a_step_are_both_found() {
    // high order takes few steps; a band near the apex is crossed twice in one of them
    let run = ball(
        Output { events: vec![event(|_, x, _| x - 0.24)], ..Output::default() },
        Order::Eight,
        1.9,
    );
    assert!(near(&times(&run, 0), &[0.76f64.sqrt(), 1.4, 1.6]), "{:?}", times(&run, 0));
}

#[test]
fn errors_of_events_end_the_run() {
    let calls = Cell::new(0);
    let bad = UserEvent::new(|t: f64, _: f64, _: f64| {
        calls.set(calls.get() + 1);
        if t > 0.5 {
            Err("no more")
        } else {
            Ok(1.0)
        }
    });
    struct Unobserved;
    impl zivi::Monitor<&'static str> for Unobserved {
        fn poll(&mut self, _: usize, _: usize) -> Result<(), &'static str> {
            Ok(())
        }
    }
    let run = simulate_switched_rk(
        SwitchedRk::default(),
        Restitution::from_e(0.5).unwrap(),
        &mut ConstantForce(-2.0),
        (0.0, 4.0),
        Physical { x: 1.0, xdot: 0.0 },
        Output { events: vec![bad], ..Output::default() },
        &mut Unobserved,
    )
    .unwrap();
    assert_eq!(run.trajectory.status, Status::Raised);
    assert_eq!(run.raised, Some("no more"));
    assert!(*run.trajectory.columns.of(Quantity::T).last().unwrap() <= 1.0);
}

#[test]
fn given_sample_times_are_the_samples() {
    let mut random = Random(9);
    for name in ["T1", "T3", "O2", "B1"] {
        let reference = Reference::named(name);
        let (t0, t1) = reference.span;
        let mut times: Vec<f64> = (0..300).map(|_| random.between(t0, t1)).collect();
        times.extend([t0, t1]);
        times.extend(&reference.zeno);
        times.sort_by(f64::total_cmp);
        for order in ORDERS {
            let whole = reference.simulate(settings(order, 1e-8));
            let output = Output { t_eval: Some(&times), ..Output::default() };
            let (force, restitution) = (&mut reference.force.clone(), reference.restitution);
            let settings = settings(order, 1e-8);
            let (span, start) = (reference.span, reference.initial);
            let run = simulate_switched_rk(
                settings,
                restitution,
                force,
                span,
                start,
                output,
                &mut Silent,
            );
            let columns = run.unwrap().trajectory.columns;
            assert_eq!(columns.of(Quantity::T), times);
            let path = whole.path.unwrap();
            for (k, &t) in times.iter().enumerate() {
                let PathPoint { x, xdot, sigma } = path.at(t).unwrap();
                assert_eq!(columns.of(Quantity::X)[k], x, "{name} {t}");
                assert_eq!(columns.of(Quantity::Xdot)[k], xdot);
                assert!((columns.of(Quantity::S)[k] - sigma * x).abs() == 0.0);
            }
        }
    }
}

#[test]
fn the_path_is_continuous_except_for_the_velocity_at_impacts() {
    for order in ORDERS {
        let run = Reference::named("T1").simulate(settings(order, 1e-8));
        let path = run.path.as_ref().unwrap();
        for impact in run.impacts_down_to(1e-3, 1000) {
            let (before, at) = (path.at(impact.t - 1e-9).unwrap(), path.at(impact.t).unwrap());
            assert!(before.x < 1e-7 && at.x < 1e-12);
            assert!((before.xdot - impact.xdot_before).abs() < 1e-6, "{impact:?} {before:?}");
            assert!((at.xdot - impact.xdot_after).abs() < 1e-9);
            assert_eq!(before.sigma, -at.sigma);
        }
        let mut before = path.at(0.0).unwrap();
        for i in 1..=100_000 {
            let point = path.at(f64::from(i) * 1e-4).unwrap();
            assert!(point.x >= 0.0 && (point.x - before.x).abs() < 1.1e-4 * 3.0);
            before = point;
        }
        assert!(path.at(-1e-9).is_none() && path.at(10.0 + 1e-9).is_none());
        assert!(path.at(f64::NAN).is_none());
    }
}

#[test]
fn the_path_starts_and_ends_where_the_run_does() {
    let restitution = Restitution::from_e(0.5).unwrap();
    let start = Physical { x: 0.0, xdot: 3.0 };
    let run =
        simulate(SwitchedRk::default(), restitution, &mut ConstantForce(-2.0), (5.0, 6.0), start);
    let path = run.path.unwrap();
    assert_eq!(path.span(), Some((5.0, 6.0)));
    assert_eq!(path.at(5.0), Some(PathPoint { x: 0.0, xdot: 3.0, sigma: 1.0 }));
    assert!((path.at(6.0).unwrap().x - 2.0).abs() < 1e-12);
    assert!(!path.is_empty() && path.len() < 20);
}

#[test]
fn events_in_late_arcs_of_a_tail_are_seen() {
    // from 1 m at 9.81 m/s^2 with e = 0.99: three impacts are computed, then hundreds are skipped
    let (e, g) = (0.99_f64, 9.81);
    let fall = (2.0_f64 / g).sqrt();
    // the flight after impact k takes 2 e^k fall
    let impact = |n: i32| fall + (1..n).map(|k| 2.0 * e.powi(k) * fall).sum::<f64>();
    let start = Physical { x: 1.0, xdot: 0.0 };
    let restitution = Restitution::from_e(e).unwrap();
    let run = |events, order| {
        let output = Output { events, dense: true, ..Output::default() };
        let (settings, span) = (settings(order, 1e-8), (0.0, 100.0));
        let force = &mut ConstantForce(-g);
        simulate_switched_rk(settings, restitution, force, span, start, output, &mut Silent)
            .unwrap()
    };
    for order in ORDERS {
        // the energy falls below that of 1 mm by impact 344
        let energy = event(move |_, x, v| 0.5 * v * v + g * (x - 1e-3));
        let stopped = run(vec![UserEvent { terminal: Some(1), ..energy }], order);
        assert_eq!(stopped.trajectory.status, Status::TerminatedByEvent);
        assert!((stopped.hits[0][0].t - impact(344)).abs() < 1e-9, "{:?}", stopped.hits);

        let apex = UserEvent { direction: Direction::Falling, ..event(|_, _, xdot| xdot) };
        let late = run(vec![event(|t, _, _| t - 50.0), apex], order);
        let (hit, at) = (late.hits[0][0], late.path.unwrap().at(50.0).unwrap());
        let n = (1..).find(|&n| impact(n + 1) > 50.0).unwrap();
        let (tau, u) = (50.0 - impact(n), e.powi(n) * g * fall);
        for (x, xdot) in [(hit.at.x, hit.at.xdot), (at.x, at.xdot)] {
            assert!((x - (u * tau - g * tau * tau / 2.0)).abs() < 1e-9);
            assert!((xdot - (u - g * tau)).abs() < 1e-9);
        }
        let top = impact(343) + e.powi(343) * fall;
        assert!((late.hits[1][342].t - top).abs() < 1e-9);
    }
}

#[test]
fn a_zeno_point_at_the_end_is_one() {
    for order in ORDERS {
        // at the end of the span, known after three impacts as within it
        let zeno = ball(Output::default(), order, 4.0).trajectory.events.zeno_times[0];
        assert!((zeno - 3.0).abs() < 1e-12);
        let run = ball(Output::default(), order, zeno);
        let events = &run.trajectory.events;
        assert_eq!((events.impacts.len(), &events.zeno_times[..]), (3, &[zeno][..]));
        assert_eq!(events.rest_time, Some(zeno));
        // and where an event ends the run there
        let stop = UserEvent { terminal: Some(1), ..event(move |t, _, _| t - zeno) };
        let run = ball(Output { events: vec![stop], ..Output::default() }, order, 4.0);
        assert_eq!(run.trajectory.status, Status::TerminatedByEvent);
        assert_eq!(run.trajectory.events.zeno_times, [zeno]);
        assert_eq!(run.trajectory.events.rest_time, Some(zeno));
        // but not where it ends just before
        let stop = UserEvent { terminal: Some(1), ..event(|t, _, _| t - 2.99) };
        let run = ball(Output { events: vec![stop], ..Output::default() }, order, 4.0);
        assert!(run.trajectory.events.zeno_times.is_empty());
    }
}
