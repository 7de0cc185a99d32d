//! Properties of impacts and contact that need no reference.

use std::convert::Infallible;

use zivi::mechanics::{simulate_mechanical, FlagKind, MechanicalOutput, MechanicalRun, Occurrence};
use zivi::system::dynamics::Layout;
use zivi::system::impact_law::newton_impacts;
use zivi::{
    simulate_switched_rk, Events, FunctionForce, MotionPoint, Order, Output, Physical, Quantity,
    Restitution, Silent, Status, SwitchedRk, UserEvent,
};

use crate::problems::{events_of, last_state, parameters, Problem};

use crate::models::of_function;

fn flags<E>(run: &MechanicalRun<E>, wanted: FlagKind) -> usize {
    let is = |it: &&Occurrence| matches!(it, Occurrence::Flag { kind, .. } if *kind == wanted);
    run.occurrences.iter().filter(is).count()
}

fn cradle(e: f64, om: f64) -> Problem {
    Problem {
        model: "cradle",
        par: parameters(&[("m1", 1.0), ("m2", 1.0), ("m3", 1.0), ("om", om), ("dl", 0.0)]),
        e: vec![e; 2],
        q0: vec![-1.0, 0.0, 0.0],
        w0: vec![1.0, 0.0, 0.0],
        t1: 2.0,
    }
}

#[test]
fn the_cradle_by_newtons_law() {
    // free balls, the first onto two that touch: -1/3, 2/3, 2/3 and for e = 1/2 0, 1/2, 1/2
    for (e, expected) in [(1.0, [-1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0]), (0.5, [0.0, 0.5, 0.5])] {
        let run = cradle(e, 0.0).run(SwitchedRk::with_tol(1e-9));
        let state = last_state(&run);
        for (one, other) in state[3..].iter().zip(expected) {
            assert!((one - other).abs() < 1e-14, "{e}: {state:?}");
        }
    }
}

/// A bar that drops with one end lower by the angle.
fn bar(angle: f64) -> Problem {
    let par = [("m", 1.0), ("J", 1.0 / 12.0), ("G", 9.81), ("l", 0.5), ("d", 9.0)];
    Problem {
        model: "dumb",
        par: parameters(&par),
        e: vec![0.5; 3],
        q0: vec![0.0, 0.5, angle],
        w0: vec![0.0; 3],
        t1: 1.5,
    }
}

#[test]
fn a_bar_that_drops_flat_is_flagged_and_so_is_one_that_nearly_does() {
    let settings = SwitchedRk::with_tol(1e-6);
    let flat = bar(0.0).run(settings);
    // free fall over 0.5 m, then all arcs with ratio e: t (1 + 2 e/(1 - e))
    let rest = (2.0 * 0.5 / 9.81_f64).sqrt() * 3.0;
    let found = events_of(&flat);
    assert_eq!(found.len(), 2);
    assert!(found.iter().all(|it| (it.1 - rest).abs() < 1e-12), "{found:?} {rest}");
    assert_eq!(flags(&flat, FlagKind::Simultaneous), 4 - 1);
    let nearly = bar(1e-12).run(settings);
    assert!(flags(&nearly, FlagKind::OrderUncertain) + flags(&nearly, FlagKind::Simultaneous) > 0);
    // where the order of the ends decides, the motion is another one: it is not continuous there
    let last = events_of(&nearly).last().unwrap().1;
    assert!((last - 0.685_957).abs() < 2e-6, "{last}");
    let tilted = bar(0.1).run(settings);
    assert_eq!(flags(&tilted, FlagKind::OrderUncertain), 0);
    assert_eq!(tilted.status, Status::Completed);
}

type Run = MechanicalRun<Infallible>;

/// A rigid bar with feet on a floor.
fn on_feet(e: f64, arms: &'static [f64]) -> Run {
    let layout = Layout::smooth(2, arms.len());
    let function = move |_: f64, q: &[f64], _: &[f64], out: &mut [f64]| {
        out.fill(0.0);
        out[layout.mass()].copy_from_slice(&[1.0, 0.0, 0.0, 0.3]);
        out[layout.force()].copy_from_slice(&[-9.81, 0.0]);
        for (i, &arm) in arms.iter().enumerate() {
            out[layout.gap().start + i] = q[0] + arm * q[1];
            out[layout.gradient()][2 * i..][..2].copy_from_slice(&[1.0, arm]);
        }
        Ok::<(), Infallible>(())
    };
    let mut system = of_function(layout, function);
    let (settings, output) = (SwitchedRk::default(), MechanicalOutput::default());
    let start = (&[0.5, 0.0][..], &[0.0, 0.0][..]);
    simulate_mechanical(
        settings,
        &mut system,
        &newton_impacts(&vec![e; arms.len()]).unwrap(),
        (0.0, 2.0),
        start,
        output,
        &mut Silent,
    )
    .unwrap()
}

#[test]
fn feet_bounce_to_rest_as_a_ball_however_many() {
    let fall = (2.0 * 0.5 / 9.81_f64).sqrt();
    for feet in
        [&[-1.0, 0.0, 1.0][..], &[-1.0, -0.4, 0.4, 1.0], &[-1.0, -0.7, -0.1, 0.3, 0.6, 0.9, 1.0]]
    {
        let run = on_feet(0.5, feet);
        assert_eq!(run.status, Status::Completed);
        let rest = |it: &&Occurrence| matches!(**it, Occurrence::Zeno { t, .. } if (t - 3.0 * fall).abs() < 1e-12);
        assert_eq!(run.occurrences.iter().filter(rest).count(), feet.len());
    }
}

#[test]
fn a_mass_that_is_not_symmetric_ends_the_run() {
    let layout = Layout::smooth(2, 0);
    let skew = |late: f64| {
        let function = move |t: f64, _: &[f64], _: &[f64], out: &mut [f64]| {
            let off = if t > late { 0.1 } else { 0.0 };
            out[layout.mass()].copy_from_slice(&[1.0, off, 0.0, 1.0]);
            out[layout.force()].copy_from_slice(&[1.0, -1.0]);
            Ok::<(), Infallible>(())
        };
        let mut system = of_function(layout, function);
        let (settings, output) = (SwitchedRk::default(), MechanicalOutput::default());
        let start = (&[0.0, 0.0][..], &[0.0, 0.0][..]);
        simulate_mechanical(settings, &mut system, &[], (0.0, 2.0), start, output, &mut Silent)
    };
    let run = skew(1.0).unwrap();
    assert_eq!(run.status, Status::MassNotDefinite);
    assert!((run.samples.t.last().unwrap() - 1.0).abs() < 1e-3);
    assert!(skew(-1.0).is_err());
}

/// The last position and velocity of a scalar run.
fn last_sample(trajectory: &zivi::Trajectory) -> [f64; 2] {
    [Quantity::X, Quantity::Xdot].map(|quantity| *trajectory.columns.of(quantity).last().unwrap())
}

#[test]
fn orthogonal_gaps_are_scalar_runs() {
    // floor and wall at right angles, pushed: x and y know nothing of each other
    let par = [("m", 1.0), ("G", 9.81), ("fx", 2.0), ("om", 1.5), ("d", 0.8)];
    let problem = Problem {
        model: "corner",
        par: parameters(&par),
        e: vec![0.5, 0.3],
        q0: vec![0.0, 0.5],
        w0: vec![0.5, 0.0],
        t1: 1.6,
    };
    let settings = SwitchedRk::with_tol(1e-13);
    let run = problem.run(settings);
    let scalar = |e: f64, x: f64, v: f64, f: fn(f64) -> f64| {
        let mut force = FunctionForce(move |t: f64, _: f64, _: f64| Ok::<f64, Infallible>(f(t)));
        let restitution = Restitution::from_e(e).unwrap();
        let (start, output) = (Physical { x, xdot: v }, Output::default());
        let run = simulate_switched_rk(
            settings,
            restitution,
            &mut force,
            (0.0, 1.6),
            start,
            output,
            &mut Silent,
        );
        run.unwrap().trajectory
    };
    let floor = scalar(0.5, 0.5, 0.0, |_| -9.81);
    let wall = scalar(0.3, 0.8, -0.5, |t| -2.0 * (1.5 * t).cos());
    let zeno: Vec<f64> =
        floor.events.zeno_times.iter().chain(&wall.events.zeno_times).copied().collect();
    assert_eq!(flags(&run, FlagKind::Simultaneous) + flags(&run, FlagKind::OrderUncertain), 0);
    let found = events_of(&run);
    for t in zeno {
        assert!(found.iter().any(|it| (it.1 - t).abs() < 1e-12), "{t} {found:?}");
    }
    let state = last_state(&run);
    let last = last_sample(&wall);
    assert!((0.8 - state[0] - last[0]).abs() < 1e-12 && (state[2] + last[1]).abs() < 1e-12);
}

#[test]
fn one_coordinate_is_the_scalar_mass() {
    let layout = Layout::smooth(1, 1);
    let f = |t: f64, x: f64, v: f64| -9.81 - 0.3 * v - 0.5 * x + 14.0 * (6.0 * t).sin();
    for order in [Order::Five, Order::Eight] {
        // rest, lift-off and a flight at the end: before a Zeno point impacts at ever smaller
        // speeds magnify rounding
        for (tol, near, x) in
            [(1e-8, 1e-7, 1.0), (1e-13, 1e-13, 0.76), (1e-13, 1e-13, 1.0), (1e-13, 1e-13, 1.16)]
        {
            let settings = SwitchedRk { order, ..SwitchedRk::with_tol(tol) };
            let function = |t: f64, q: &[f64], w: &[f64], out: &mut [f64]| {
                out.fill(0.0);
                (out[0], out[1], out[2], out[3]) = (2.0, 2.0 * f(t, q[0], w[0]), q[0], 1.0);
                Ok::<(), Infallible>(())
            };
            let mut system = of_function(layout, function);
            let (q, span) = ([x], (0.0, 3.6));
            let (start, output) = ((&q[..], &[0.0][..]), MechanicalOutput::default());
            let run = simulate_mechanical(
                settings,
                &mut system,
                &newton_impacts(&[0.5]).unwrap(),
                span,
                start,
                output,
                &mut Silent,
            )
            .unwrap();
            let mut force =
                FunctionForce(|t: f64, x: f64, v: f64| Ok::<f64, Infallible>(f(t, x, v)));
            let (restitution, start) =
                (Restitution::from_e(0.5).unwrap(), Physical { x, xdot: 0.0 });
            let scalar = simulate_switched_rk(
                settings,
                restitution,
                &mut force,
                span,
                start,
                Output::default(),
                &mut Silent,
            )
            .unwrap();
            let (ours, theirs) = (Events::of_gap(0, &run.occurrences), &scalar.trajectory.events);
            for (one, other) in
                [(ours.zeno_times, &theirs.zeno_times), (ours.liftoff_times, &theirs.liftoff_times)]
            {
                assert!(!one.is_empty() && one.len() == other.len(), "{order:?} {tol:e} {x}");
                let apart = one.iter().zip(other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                println!("{order:?} {tol:e} times {apart:e}");
                assert!(apart <= near, "{order:?} {tol:e}: {apart:e}");
            }
            let (state, last) = (last_state(&run), last_sample(&scalar.trajectory));
            let apart = (state[0] - last[0]).abs().max((state[1] - last[1]).abs());
            println!("{order:?} {tol:e} state {apart:e}");
            assert!(apart <= near, "{order:?} {tol:e}: {apart:e}");
        }
    }
}

/// `E = T + V` of the double pendulum between walls.
fn energy(p: &Problem, q: &[f64], w: &[f64]) -> f64 {
    let par = |name: &str| p.par[name];
    let (m1, m2, l1, l2, g) = (par("m1"), par("m2"), par("l1"), par("l2"), par("G"));
    let kinetic = 0.5 * (m1 + m2) * l1 * l1 * w[0] * w[0]
        + 0.5 * m2 * l2 * l2 * w[1] * w[1]
        + m2 * l1 * l2 * (q[0] - q[1]).cos() * w[0] * w[1];
    kinetic - (m1 + m2) * g * l1 * q[0].cos() - m2 * g * l2 * q[1].cos()
}

#[test]
fn energy_never_rises_whatever_the_restitutions() {
    for e in [vec![0.5, 0.4, 0.6], vec![1.0, 0.2, 0.9], vec![0.0, 0.9, 0.3], vec![1.0; 3]] {
        let par = [
            ("m1", 1.0),
            ("m2", 0.8),
            ("l1", 1.0),
            ("l2", 0.7),
            ("G", 9.81),
            ("cd", 0.0),
            ("d1", -0.12),
            ("d2", -0.25),
            ("d3", 1.1),
        ];
        let problem = Problem {
            model: "dpend",
            par: parameters(&par),
            e,
            q0: vec![0.5, 0.9],
            w0: vec![0.0; 2],
            t1: 5.0,
        };
        let run = problem.run(SwitchedRk::with_tol(1e-13));
        assert_eq!(run.status, Status::Completed, "{:?}", problem.e);
        let (x, v) = (run.samples.x.chunks(5), run.samples.v.chunks(5));
        let energies: Vec<f64> = x.zip(v).map(|(x, v)| energy(&problem, x, v)).collect();
        let rise = energies.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        assert!(rise < 1e-12 * energies[0].abs(), "{:?}: {rise:e}", problem.e);
    }
}

#[test]
fn a_motion_is_the_same_when_it_is_dense_sampled_and_stored() {
    let par = [("a", 0.25), ("k", 2.0), ("G", 9.81)];
    let problem = Problem {
        model: "sine",
        par: parameters(&par),
        e: vec![0.3],
        q0: vec![0.4, 0.4],
        w0: vec![3.6, 0.0],
        t1: 2.4,
    };
    let settings = SwitchedRk::with_tol(1e-8);
    let (plain, fine) = (problem.run(settings), problem.run(SwitchedRk::with_tol(1e-13)));
    let times: Vec<f64> = (0..=600).map(|k| 2.4 * f64::from(k) / 600.0).collect();
    let output = MechanicalOutput { t_eval: Some(&times), dense: true, ..Default::default() };
    let run = problem.run_with(settings, output);
    assert_eq!(run.occurrences, plain.occurrences);
    assert_eq!((run.samples.t.clone(), last_state(&run)), (times.clone(), last_state(&plain)));
    let output = MechanicalOutput { t_eval: Some(&times), ..Default::default() };
    let exact = problem.run_with(SwitchedRk::with_tol(1e-13), output).samples;
    let path = run.path.unwrap();
    let stored =
        zivi::mechanics::MechanicalPath::from_numbers(&path.to_numbers().unwrap()).unwrap();
    assert_eq!(stored, path);
    let impacts: Vec<f64> = fine
        .occurrences
        .iter()
        .filter_map(|it| match it {
            Occurrence::Impact { t, .. } => Some(*t),
            _ => None,
        })
        .collect();
    let mut worst = [0.0_f64; 2];
    for (k, &t) in times.iter().enumerate() {
        let (point, at) = (path.at(t).unwrap(), 3 * k);
        assert!((0..3).all(|c| (point.x[c] - run.samples.x[at + c]).abs() < 1e-12), "{t}");
        if impacts.iter().any(|it| (it - t).abs() < 1e-4) {
            continue;
        }
        for c in 0..2 {
            worst[0] = worst[0].max((point.x[c] - exact.x[at + c]).abs());
            worst[1] = worst[1].max((point.v[c] - exact.v[at + c]).abs());
        }
    }
    println!("dense {worst:?}");
    assert!(worst[0] < 1e-7 && worst[1] < 1e-4, "{worst:?}");
}

#[test]
fn events_of_coordinates_are_found_and_end_a_run() {
    let problem = bar(0.0);
    let hits = |terminal| {
        let event =
            UserEvent { terminal, ..UserEvent::of(|_, at: &MotionPoint| Ok(at.x[1] - 0.1)) };
        let output = MechanicalOutput { events: vec![event], ..Default::default() };
        problem.run_with(SwitchedRk::with_tol(1e-9), output)
    };
    let first = (2.0 * 0.4 / 9.81_f64).sqrt();
    let run = hits(None);
    // the first arc after the impact rises to e^2 0.5 = 0.125, the next not to 0.1
    assert_eq!(run.hits[0].len(), 3);
    assert!((run.hits[0][0].t - first).abs() < 1e-10);
    let ended = hits(Some(2));
    assert_eq!(ended.status, Status::TerminatedByEvent);
    assert_eq!(ended.samples.t.last(), Some(&run.hits[0][1].t));
}

#[test]
fn an_event_among_the_skipped_arcs_ends_the_run_before_the_zeno_point() {
    let problem = bar(0.0);
    let settings = SwitchedRk::with_tol(1e-6);
    let (_, zeno, _) = events_of(&problem.run(settings))[0];
    let run = |at: f64| {
        let event = UserEvent { terminal: Some(1), ..UserEvent::of(move |t, _| Ok(t - at)) };
        let output = MechanicalOutput { events: vec![event], dense: true, ..Default::default() };
        problem.run_with(settings, output)
    };
    let before = run(zeno - 1e-4);
    assert_eq!(before.status, Status::TerminatedByEvent);
    assert!(events_of(&before).is_empty() && before.path.as_ref().unwrap().at(zeno).is_none());
    // the arcs there are among those that are skipped: the last impact was earlier
    assert!(before.occurrences.iter().all(|it| it.t() < zeno - 1e-4));
    let after = run(zeno + 1e-4);
    assert!(!events_of(&after).is_empty());
}

#[test]
fn a_start_in_contact_to_rounding_is_in_contact() {
    // in the valley of the sine, where cos(pi/2) leaves a speed of 1e-16 into the floor
    let (a, k) = (0.25, 2.0);
    let x = 0.75 * std::f64::consts::PI;
    let par = parameters(&[("a", a), ("k", k), ("G", 9.81)]);
    let (q0, w0) = (vec![x, a * (k * x).sin()], vec![4.0, 0.0]);
    let problem = Problem { model: "sine", par, e: vec![0.3], q0, w0, t1: 0.05 };
    let run = problem.run(SwitchedRk::with_tol(1e-9));
    assert!(run.occurrences.is_empty(), "{:?}", run.occurrences);
    assert!(run.samples.modes.iter().all(|mode| mode.closed.has(0)));
}

#[test]
fn forces_may_jump() {
    // pressed to a wall until t = 1 and pulled off after it; nobody says when the force jumps
    let layout = Layout::smooth(2, 1);
    let function = |t: f64, q: &[f64], _: &[f64], out: &mut [f64]| {
        out.fill(0.0);
        out[layout.mass()].copy_from_slice(&[1.0, 0.0, 0.0, 1.0]);
        out[layout.force()].copy_from_slice(&[if t < 1.0 { -1.0 } else { 2.0 }, 0.5]);
        (out[layout.gap().start], out[layout.gradient().start]) = (q[0], 1.0);
        Ok::<(), Infallible>(())
    };
    for order in [Order::Five, Order::Eight] {
        let mut system = of_function(layout, function);
        let settings = SwitchedRk { order, ..SwitchedRk::with_tol(1e-9) };
        let (start, output) = ((&[0.0; 2][..], &[0.0; 2][..]), MechanicalOutput::default());
        let run = simulate_mechanical(
            settings,
            &mut system,
            &newton_impacts(&[0.5]).unwrap(),
            (0.0, 2.0),
            start,
            output,
            &mut Silent,
        )
        .unwrap();
        assert_eq!(run.status, Status::Completed, "{order:?} {:?}", run.samples.t.last());
        let events = events_of(&run);
        assert!(events.len() == 1 && (events[0].1 - 1.0).abs() < 1e-9, "{events:?}");
        let state = last_state(&run);
        assert!((state[0] - 1.0).abs() < 1e-8 && (state[2] - 2.0).abs() < 1e-8, "{state:?}");
    }
}

#[test]
fn a_force_near_the_apex_is_seen_in_whichever_gap() {
    // beside the pull one that acts where the mass is slow; the other gap opens for ever. A step that
    // is longer than those before it is a whole arc
    let (pull, width, height) = (10.0, 0.02, 10.0);
    let acceleration = |v: f64| -pull * (1.0 + 3.0 * (-(v / width).powi(2)).exp());
    let layout = Layout::smooth(2, 2);
    let first_impact = |up: f64, other: usize| {
        let mut system = of_function(layout, |_, q, v, out| {
            let (mut gaps, mut normals) = ([q[0]; 2], [1.0, 0.0, 1.0, 0.0]);
            gaps[other] = q[1] + 5.0;
            normals[2 * other..2 * other + 2].copy_from_slice(&[0.0, 1.0]);
            out[layout.mass()].copy_from_slice(&[1.0, 0.0, 0.0, 1.0]);
            out[layout.force()].copy_from_slice(&[acceleration(v[0]), 0.0]);
            out[layout.gap()].copy_from_slice(&gaps);
            out[layout.gradient()].copy_from_slice(&normals);
            out[layout.curvature()].fill(0.0);
            out[layout.rate()].fill(0.0);
            Ok(())
        });
        let run = simulate_mechanical(
            SwitchedRk { first_step: Some(3.0), ..SwitchedRk::default() },
            &mut system,
            &newton_impacts(&[0.5, 0.5]).unwrap(),
            (0.0, 3.0),
            (&[height, 0.0], &[up, 0.5]),
            MechanicalOutput::default(),
            &mut Silent,
        )
        .unwrap();
        let time = |it: &Occurrence| match *it {
            Occurrence::Impact { t, .. } => Some(t),
            _ => None,
        };
        run.occurrences.iter().find_map(time).unwrap()
    };
    let mut seen = 0;
    for k in 0..30 {
        let up = 1.0 + 0.2 * f64::from(k);
        let [first, second] = [1, 0].map(|other| first_impact(up, other));
        assert!((first - second).abs() < 1e-12, "{up}: {first} {second}");
        // t = int dv/a, x = int v dv/a from the start down to the speed at the wall
        let (mut t, mut x, mut v): (f64, f64, f64) = (0.0, height, up);
        while x > 0.0 {
            let steps = if v.abs() < 0.2 { 1e-5 } else { 1e-3 };
            let (middle, before) = (v - 0.5 * steps, x);
            let dt = -steps / acceleration(middle);
            (t, x, v) = (t + dt, x + middle * dt, v - steps);
            if x < 0.0 {
                t -= dt * x / (x - before);
            }
        }
        seen += u32::from((first - t).abs() < 1e-5);
    }
    // a look at one point of a step
    assert!(seen >= 27, "{seen}");
}

#[test]
fn no_shorter_step_is_tried_where_contacts_are_redundant() {
    // floor and wall; after a second the wall is the floor again, in contradiction with it
    let layout = Layout::smooth(2, 2);
    let mut system = of_function(layout, |t, q, _, out| {
        let late = t > 1.0;
        out[layout.mass()].copy_from_slice(&[1.0, 0.0, 0.0, 1.0]);
        out[layout.force()].copy_from_slice(&[-1.0, -1.0]);
        out[layout.gap()].copy_from_slice(&[q[1], q[usize::from(late)]]);
        out[layout.gradient()].copy_from_slice(if late {
            &[0.0, 1.0, 0.0, 1.0]
        } else {
            &[0.0, 1.0, 1.0, 0.0]
        });
        out[layout.curvature()].copy_from_slice(&[0.0, if late { 1.0 } else { 0.0 }]);
        out[layout.rate()].fill(0.0);
        Ok(())
    });
    let run = simulate_mechanical(
        SwitchedRk::default(),
        &mut system,
        &newton_impacts(&[0.5, 0.5]).unwrap(),
        (0.0, 3.0),
        (&[0.0, 0.0], &[0.0, 0.0]),
        MechanicalOutput::default(),
        &mut Silent,
    )
    .unwrap();
    assert_eq!(run.status, Status::RedundantContacts);
    assert_eq!(run.counts.rejected, 0, "{:?}", run.counts);
}
