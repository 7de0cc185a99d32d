//! The integrator driven period by period, under a force that is held.

use std::convert::Infallible;

use zivi::{
    ConstantForce, Flights, FunctionForce, LinearForce, Occurrence, Order, Physical, Restitution,
    SwitchedIntegrator, SwitchedRk,
};

use crate::closed;
use crate::problems::{end, settings, simulate, Random};

const PERIOD: f64 = 0.01;

fn integrator(order: Order, restitution: Restitution) -> SwitchedIntegrator {
    let settings = SwitchedRk { first_step: Some(PERIOD), ..settings(order, 1e-10) };
    SwitchedIntegrator::new(settings, restitution).unwrap()
}

#[test]
fn held_forces_give_the_motion_of_the_closed_form() {
    // a different constant force in every period, up and down: x'' = u_k
    let mut random = Random(21);
    for order in [Order::Five, Order::Eight] {
        let restitution = Restitution::from_e(0.6).unwrap();
        let mut plant = integrator(order, restitution);
        plant.start(0.0, Physical { x: 0.05, xdot: 0.0 }).unwrap();
        let mut state = (0.05, 0.0);
        let (mut impacts, mut exact_impacts) = (0, 0);
        for k in 0..2000 {
            let u = random.between(-12.0, 9.0);
            let t = f64::from(k) * PERIOD;
            let linear = LinearForce {
                stiffness: 0.0,
                damping: 0.0,
                gravity: -u,
                amplitude: 0.0,
                omega: 1.0,
                phase: 0.0,
            };
            let span = (t, f64::from(k + 1) * PERIOD);
            let mut observe = |it| impacts += usize::from(matches!(it, Occurrence::Impact { .. }));
            plant.forget_force();
            let moved =
                plant.observe_to::<Infallible, _>(span.1, &mut ConstantForce(u), &mut observe);
            assert!(moved.is_ok());
            // start the exact motion of the period from the same state
            let from = state;
            let story = if from == (0.0, 0.0) && u <= 0.0 {
                None
            } else {
                Some(closed::simulate(linear, 0.6, span, from))
            };
            state = (plant.state().x, plant.state().xdot);
            let Some(story) = story else {
                assert_eq!(state, (0.0, 0.0));
                continue;
            };
            exact_impacts += story.impacts.len();
            assert!((state.0 - story.end[0]).abs() < 1e-9, "{k} {state:?} {story:?}");
            assert!((state.1 - story.end[1]).abs() < 1e-7, "{k} {state:?} {story:?}");
        }
        assert!(impacts > 40 && exact_impacts >= impacts, "{impacts} {exact_impacts}");
    }
}

/// `x'' = -k x - c x' - g + A cos(omega t)` (k > c^2/4) after `h`, from a state at `t`.
fn oscillation(force: &LinearForce, t: f64, h: f64, [x, v]: [f64; 2]) -> [f64; 2] {
    let LinearForce { stiffness: k, damping: c, gravity: g, amplitude, omega, .. } = *force;
    // Re z e^(i omega t) - g/k and a damped oscillation
    let (re, im) = (k - omega * omega, c * omega);
    let size = amplitude / (re * re + im * im);
    let forced = |t: f64| {
        let (sin, cos) = (omega * t).sin_cos();
        let position = size * (re * cos + im * sin) - g / k;
        [position, omega * size * (im * cos - re * sin)]
    };
    let ([x0, v0], [x1, v1]) = (forced(t), forced(t + h));
    let rate = (k - 0.25 * c * c).sqrt();
    let (sin, cos) = (rate * h).sin_cos();
    let (a, fall) = (x - x0, (-0.5 * c * h).exp());
    let b = (v - v0 + 0.5 * c * a) / rate;
    let (y, w) = (a * cos + b * sin, rate * (b * cos - a * sin));
    [x1 + fall * y, v1 + fall * (w - 0.5 * c * y)]
}

#[test]
fn held_forces_beside_a_spring_give_the_motion_of_the_closed_form() {
    let spring = LinearForce {
        stiffness: 2.0,
        damping: 0.1,
        gravity: 0.0,
        amplitude: 0.6,
        omega: 0.9,
        phase: 0.0,
    };
    let wall = Restitution::from_e(0.6).unwrap();
    let mut random = Random(22);
    let mut plant = SwitchedIntegrator::new(SwitchedRk::default(), wall).unwrap();
    let run = |plant: &mut SwitchedIntegrator, random: &mut Random| {
        plant.start(0.0, Physical { x: 5.0, xdot: 0.0 }).unwrap();
        let mut state = [5.0, 0.0];
        for k in 0..3000 {
            let [t, end] = [k, k + 1].map(|k| f64::from(k) * PERIOD);
            let mut held = LinearForce { gravity: random.between(-20.0, 0.0), ..spring };
            assert!(plant.advance_to::<Infallible, _>(end, &mut held).is_ok());
            state = oscillation(&held, t, end - t, state);
            let Physical { x, xdot } = plant.state();
            let off = (x - state[0]).abs().max((xdot - state[1]).abs());
            assert!(off < 2e-13, "{k}: {off:e}");
        }
        assert_eq!((plant.counts().impacts, plant.counts().nfev), (0, 0));
        plant.state()
    };
    let first = run(&mut plant, &mut Random(22));
    // to the last bit what a run before has left behind is of no account
    assert_eq!(run(&mut plant, &mut random), first);
}

#[test]
fn periods_near_the_wall_are_those_of_the_pair() {
    let wall = Restitution::from_e(0.8).unwrap();
    let drive = |flights| {
        let settings = SwitchedRk { flights, ..settings(Order::Eight, 1e-11) };
        let mut plant = SwitchedIntegrator::new(settings, wall).unwrap();
        plant.start(0.0, Physical { x: 0.2, xdot: 0.0 }).unwrap();
        let mut random = Random(23);
        let states = (1..=1000).map(|k| {
            let gravity = random.between(0.0, 6.0);
            let mut held = LinearForce {
                stiffness: 2.0,
                damping: 0.1,
                gravity,
                amplitude: 3.0,
                omega: 4.0,
                phase: 0.3,
            };
            let t = f64::from(k) * PERIOD;
            assert!(plant.advance_to::<Infallible, _>(t, &mut held).is_ok());
            let Physical { x, xdot } = plant.state();
            [x, xdot]
        });
        let states: Vec<_> = states.collect();
        (states, plant.counts().impacts)
    };
    let (series, pair) = (drive(Flights::Series), drive(Flights::RungeKutta));
    assert!(series.1 > 10 && series.1 == pair.1, "{} {}", series.1, pair.1);
    for (k, (a, b)) in series.0.iter().zip(&pair.0).enumerate() {
        assert!((a[0] - b[0]).abs().max((a[1] - b[1]).abs()) < 1e-8, "{k}: {a:?} {b:?}");
    }
}

#[test]
fn pieces_are_the_whole() {
    // one force over many periods, told to be the same or not
    let force = LinearForce {
        stiffness: 0.0,
        damping: 0.0,
        gravity: 9.81,
        amplitude: 14.715,
        omega: std::f64::consts::TAU,
        phase: -std::f64::consts::FRAC_PI_2,
    };
    let (restitution, start) = (Restitution::from_e(0.5).unwrap(), Physical { x: 0.2, xdot: 0.0 });
    for order in [Order::Five, Order::Eight] {
        let whole =
            simulate(settings(order, 1e-10), restitution, &mut force.clone(), (0.0, 3.7), start);
        let (mut same, mut other) =
            (integrator(order, restitution), integrator(order, restitution));
        same.start(0.0, start).unwrap();
        other.start(0.0, start).unwrap();
        let mut lifts = 0;
        for k in 1..=370 {
            let t = if k == 370 { 3.7 } else { f64::from(k) * PERIOD };
            let lifted = |it| lifts += usize::from(matches!(it, Occurrence::LiftOff { .. }));
            assert!(same.observe_to::<Infallible, _>(t, &mut force.clone(), lifted).is_ok());
            assert!(other.advance_to::<Infallible, _>(t, &mut force.clone()).is_ok());
        }
        for plant in [&same, &other] {
            assert!((plant.state().x - end(&whole).x).abs() < 2e-9, "{:?}", plant.state());
            assert!((plant.state().xdot - end(&whole).xdot).abs() < 2e-8);
        }
        assert_eq!(lifts, 3);
    }
}

#[test]
fn periods_are_cheap() {
    let restitution = Restitution::from_e(0.5).unwrap();
    for (order, flight) in [(Order::Five, 7), (Order::Eight, 12)] {
        // in flight one step and the slope at its start
        let mut plant = integrator(order, restitution);
        plant.start(0.0, Physical { x: 100.0, xdot: 0.0 }).unwrap();
        for k in 1..=100 {
            let t = f64::from(k) * PERIOD;
            assert!(plant.advance_to::<Infallible, _>(t, &mut ConstantForce(-1.0)).is_ok());
        }
        assert!(plant.counts().nfev <= 100 * flight, "{:?}", plant.counts());
        // at rest one evaluation if the force is known to be constant
        let mut plant = integrator(order, restitution);
        plant.start(0.0, Physical::default()).unwrap();
        for k in 1..=100 {
            let t = f64::from(k) * PERIOD;
            assert!(plant.advance_to::<Infallible, _>(t, &mut ConstantForce(-1.0)).is_ok());
        }
        assert_eq!(plant.counts().nfev, 100);
        assert!(plant.is_at_rest());
        // else one window a period
        for k in 101..=200 {
            let t = f64::from(k) * PERIOD;
            let mut force = FunctionForce(|_: f64, x: f64, _: f64| Ok::<_, Infallible>(-1.0 - x));
            assert!(plant.advance_to(t, &mut force).is_ok());
        }
        assert_eq!(plant.counts().nfev, 100 + 100 * 8);
    }
}

#[test]
fn a_lift_off_at_the_end_of_a_period_asks_the_next_force() {
    let restitution = Restitution::from_e(0.5).unwrap();
    let mut plant = integrator(Order::Eight, restitution);
    plant.start(0.0, Physical::default()).unwrap();
    for k in 0..20 {
        let t = f64::from(k) * PERIOD;
        // zero at the end of the period, rising
        let mut ramp =
            FunctionForce(|at: f64, _: f64, _: f64| Ok::<f64, Infallible>(at - t - PERIOD));
        assert!(plant.advance_to(t + PERIOD, &mut ramp).is_ok());
        assert_eq!(plant.state(), Physical::default());
    }
    let t = plant.t();
    assert!(plant.advance_to::<Infallible, _>(t + 1.0, &mut ConstantForce(2.0)).is_ok());
    assert!((plant.state().x - 1.0).abs() < 1e-9);
}

#[test]
fn a_chain_is_forgotten_with_its_force() {
    // under a force that changes between impacts none of them is an impact sequence with those before it
    let settings = SwitchedRk { max_impacts: 3, ..settings(Order::Eight, 1e-10) };
    let mut plant = SwitchedIntegrator::new(settings, Restitution::from_e(0.9).unwrap()).unwrap();
    plant.start(0.0, Physical { x: 1.0, xdot: 0.0 }).unwrap();
    for k in 1..=13 {
        let force = &mut ConstantForce(-9.81 - 0.01 * f64::from(k % 2));
        assert!(plant.advance_to::<Infallible, _>(0.3 * f64::from(k), force).is_ok(), "{k}");
    }
    assert!(plant.counts().impacts > 4);
}

#[test]
fn rest_is_told_once_and_only_after_flight() {
    let restitution = Restitution::from_e(0.5).unwrap();
    let mut plant = integrator(Order::Five, restitution);
    plant.start(0.0, Physical::default()).unwrap();
    let mut told = Vec::new();
    for (t, u) in [(1.0, -1.0), (2.0, -2.0), (2.5, 4.0), (9.0, -2.0)] {
        plant.forget_force();
        let force = &mut ConstantForce(u);
        assert!(plant.observe_to::<Infallible, _>(t, force, |it| told.push(it)).is_ok());
    }
    assert_eq!(told[0], Occurrence::lift_off_of_mass(2.0));
    let rests = told.iter().filter(|it| matches!(it, Occurrence::Zeno { .. })).count();
    assert!(rests == 1 && matches!(told.last(), Some(Occurrence::Zeno { .. })), "{told:?}");
}
