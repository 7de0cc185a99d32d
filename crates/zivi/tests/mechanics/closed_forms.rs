//! Small systems with closed forms: look-ahead, budgets, flags, drift, reactions.

use std::convert::Infallible;

use zivi::mechanics::{
    simulate_mechanical, simulate_mechanical_moreau_jean, simulate_mechanical_theta_gamma,
    FlagKind, GapSet, MechanicalOutput, MechanicalRun, Occurrence,
};
use zivi::system::dynamics::Layout;
use zivi::system::impact_law::newton_impacts;
use zivi::{Grid, MoreauJean, Silent, Status, SwitchedRk};

use crate::line::Linear;
use crate::problems::events_of;

use crate::models::of_function;

const G: f64 = 9.81;

/// A ball of 2 kg, dropped from 1 m.
fn ball(e: f64) -> Linear {
    let gaps = vec![(vec![1.0], 0.0)];
    Linear { mass: vec![2.0], gaps, e: vec![e], q: vec![1.0], w: vec![0.0] }
}

#[test]
fn a_change_of_the_forces_among_the_arcs_that_a_jump_would_skip_is_seen() {
    // half the pull from the apex of the seventh arc on; the jump comes after three impacts
    let (e, fall) = (0.6, (2.0 / G).sqrt());
    let speed = |k: i32| e * G * fall * e.powi(k);
    let start = fall + (0..6).map(|k| 2.0 * speed(k) / G).sum::<f64>();
    let (apex, height) = (start + speed(6) / G, speed(6).powi(2) / (2.0 * G));
    let down = (4.0 * height / G).sqrt();
    let exact = apex + down + 2.0 * e * down / (1.0 - e);
    let force = |t: f64| vec![if t < apex { -2.0 * G } else { -G }];
    let run = ball(e).run(force, 4.0, SwitchedRk::default());
    let zeno = events_of(&run);
    assert_eq!((run.status, zeno.len()), (Status::Completed, 1));
    assert!((zeno[0].1 - exact).abs() < 1e-5, "{} {exact}", zeno[0].1);
    // without the change it is far from that
    let plain = events_of(&ball(e).run(|_| vec![-2.0 * G], 4.0, SwitchedRk::default()))[0].1;
    assert!((plain - fall - 2.0 * e * fall / (1.0 - e)).abs() < 1e-12);
    assert!((plain - exact).abs() > 0.01);
}

#[test]
fn an_accumulation_has_a_budget_of_impacts() {
    // the pull varies by a tenth, so the Zeno time takes more than three impacts
    let run = |max_impacts: usize| {
        let force = |t: f64| vec![-2.0 * G * (1.0 + 0.1 * (3.0 * t).sin())];
        ball(0.9).run(force, 20.0, SwitchedRk { max_impacts, ..SwitchedRk::default() })
    };
    let free = run(1_000_000);
    assert_eq!((free.status, events_of(&free).len()), (Status::Completed, 1));
    assert!(free.counts.impacts > 12, "{}", free.counts.impacts);
    for budget in [5, 9] {
        let run = run(budget);
        assert_eq!(run.status, Status::ZenoBudget);
        assert_eq!(run.counts.impacts, budget as u64 + 1);
    }
}

#[test]
fn rest_ends_the_count_of_the_impacts_of_an_accumulation() {
    // lifted and dropped again and again: each time it takes some impacts
    let force = |t: f64| vec![2.0 * G * (-0.9 + (2.0 * t).sin())];
    let free = ball(0.3).run(force, 60.0, SwitchedRk::default());
    let rests: Vec<f64> =
        events_of(&free).iter().filter(|it| it.0 == "zeno").map(|it| it.1).collect();
    assert!(rests.len() > 8, "{rests:?}");
    let (mut most, mut before) = (0, 0);
    let mut since = 0;
    for it in &free.occurrences {
        match it {
            Occurrence::Impact { .. } => (since, before) = (since + 1, before + 1),
            Occurrence::Zeno { .. } | Occurrence::LiftOff { .. } => since = 0,
            _ => (),
        }
        most = most.max(since);
    }
    assert!(before > 2 * most, "{before} {most}");
    let settings = SwitchedRk { max_impacts: most.max(3), ..SwitchedRk::default() };
    let run = ball(0.3).run(force, 60.0, settings);
    assert_eq!((run.status, run.counts.impacts), (Status::Completed, before as u64));
}

/// Two walls with the kinetic cosine `c`, met with the speed 1 at the times 1 and `1 + later`.
fn two_walls(c: f64, later: f64, settings: SwitchedRk) -> MechanicalRun<Infallible> {
    let normals = [vec![1.0, 0.0], vec![c, (1.0 - c * c).sqrt()]];
    let w = (0..2).map(|i| -(normals[0][i] + normals[1][i]) / (1.0 + c)).collect();
    let gaps = normals.into_iter().zip([1.0, 1.0 + later]).collect();
    let system = Linear { mass: vec![1.0; 2], gaps, e: vec![0.5; 2], q: vec![0.0; 2], w };
    system.run(|_| vec![0.0; 2], 3.0, settings)
}

/// The flags of a run: kind, gaps, size.
fn flags(run: &MechanicalRun<Infallible>) -> Vec<(FlagKind, usize, f64)> {
    let flag = |it: &Occurrence| match *it {
        Occurrence::Flag { kind, gaps, size, .. } => Some((kind, gaps.len(), size)),
        _ => None,
    };
    run.occurrences.iter().filter_map(flag).collect()
}

#[test]
fn coupled_gaps_that_are_hit_together_are_flagged_with_their_cosine() {
    for c in [0.9, 0.1, -0.1, -0.4, 1e-7] {
        let found = flags(&two_walls(c, 0.0, SwitchedRk::default()));
        let [(FlagKind::Simultaneous, 2, size)] = found[..] else { panic!("{c}: {found:?}") };
        assert!((size - c.abs()).abs() < 1e-15, "{c}: {size}");
    }
    for c in [0.0, 1e-11] {
        assert_eq!(flags(&two_walls(c, 0.0, SwitchedRk::default())), []);
    }
}

#[test]
fn coupled_gaps_are_flagged_where_the_tolerance_leaves_their_order_open() {
    // within 100 rtol of the flight, which lasted 1 s; and within 1e-3 of it at most
    let of_rtol = |rtol: f64| SwitchedRk { rtol, ..SwitchedRk::default() };
    for (rtol, near) in [(1e-6, 1e-4), (1e-8, 1e-6), (1e-3, 1e-3)] {
        for c in [0.3, -0.3] {
            let run = two_walls(c, 0.9 * near, of_rtol(rtol));
            let found = flags(&run);
            let [(FlagKind::OrderUncertain, 2, later)] = found[..] else {
                panic!("{rtol} {c}: {found:?}")
            };
            assert!((later - 0.9 * near).abs() < 1e-12, "{later}");
            assert_eq!(flags(&two_walls(c, 1.2 * near, of_rtol(rtol))), [], "{rtol} {c}");
        }
        assert_eq!(flags(&two_walls(0.0, 0.5 * near, of_rtol(rtol))), []);
    }
}

#[test]
fn a_gap_that_leaves_is_in_no_uncertain_order() {
    // the second wall is close, but the mass moves away from it
    let gaps = vec![(vec![1.0, 0.0], 1.0), (vec![0.3, 0.91_f64.sqrt()], 0.31)];
    let w = vec![-1.0, 1.0];
    let system = Linear { mass: vec![1.0; 2], gaps, e: vec![0.5; 2], q: vec![0.0; 2], w };
    assert_eq!(flags(&system.run(|_| vec![0.0; 2], 2.0, SwitchedRk::default())), []);
}

#[test]
fn a_gap_far_from_zero_is_as_its_function_says() {
    // over the ground y = 2 sin x, which a free mass never meets
    let layout = Layout::smooth(2, 1);
    let ground = |q: &[f64]| q[1] - 2.0 * q[0].sin();
    let function = |_: f64, q: &[f64], w: &[f64], out: &mut [f64]| {
        out[layout.mass()].copy_from_slice(&[1.0, 0.0, 0.0, 1.0]);
        out[layout.force()].copy_from_slice(&[0.0, 0.0]);
        out[layout.gap()].copy_from_slice(&[ground(q)]);
        out[layout.gradient()].copy_from_slice(&[-2.0 * q[0].cos(), 1.0]);
        out[layout.curvature()].copy_from_slice(&[2.0 * q[0].sin() * w[0] * w[0]]);
        out[layout.rate()].fill(0.0);
        Ok::<(), Infallible>(())
    };
    let mut system = of_function(layout, function);
    let start = (&[0.0, 5.0][..], &[1.0, 0.0][..]);
    let (settings, output) = (SwitchedRk::default(), MechanicalOutput::default());
    let run = simulate_mechanical(
        settings,
        &mut system,
        &newton_impacts(&[0.5]).unwrap(),
        (0.0, 100.0),
        start,
        output,
        &mut Silent,
    )
    .unwrap();
    assert_eq!(run.status, Status::Completed);
    // between two samples the gap is integrated; at each it is set to its function
    for (k, sample) in run.samples.x.chunks(3).enumerate() {
        let rate = run.samples.v[3 * k + 2];
        assert!((sample[2] - ground(sample)).abs() < 1e-12, "{k}");
        assert!((rate + 2.0 * sample[0].cos() * run.samples.v[3 * k]).abs() < 1e-12, "{k}");
    }
}

fn grid(t1: f64, h: f64) -> Grid {
    Grid::new(0.0, t1, h).unwrap()
}

#[test]
fn the_reaction_of_a_fixed_step_is_the_force_on_the_body() {
    // 2 kg at rest on the floor, and pulled along it
    let system = Linear {
        mass: vec![2.0, 4.0],
        gaps: vec![(vec![1.0, 0.0], 0.0), (vec![0.0, 0.5], 0.0)],
        e: vec![0.5; 2],
        q: vec![0.0; 2],
        w: vec![0.0; 2],
    };
    let start = (&system.q[..], &system.w[..]);
    let force = |_: f64| vec![-2.0 * G, -4.0 * G];
    let (e, h) = (&system.e[..], grid(1.0, 0.01));
    let implicit = simulate_mechanical_theta_gamma(
        &mut system.dynamics(force),
        e,
        h,
        start,
        vec![],
        &mut Silent,
    );
    let method = MoreauJean { theta: 0.5 };
    let jean = simulate_mechanical_moreau_jean(
        method,
        &mut system.dynamics(force),
        e,
        h,
        start,
        vec![],
        &mut Silent,
    );
    // the normal of the second gap is half a unit: its multiplier is twice the force
    // the first step of Moreau and Jean's falls before there is an impulse
    for (run, depth) in [(implicit.unwrap(), 0.0), (jean.unwrap(), G * 1e-4)] {
        assert_eq!(run.status, Status::Completed);
        let last = &run.samples.lambda[run.samples.lambda.len() - 2..];
        assert!((last[0] - 2.0 * G).abs() < 1e-11 && (last[1] - 8.0 * G).abs() < 1e-11, "{last:?}");
        assert_eq!(run.samples.modes.last().unwrap().closed, GapSet::of(0).with(GapSet::of(1)));
        let drift = run.samples.x.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
        assert!(drift <= depth, "{drift:e}");
    }
    let rk = system.run(force, 1.0, SwitchedRk::default());
    let last = &rk.samples.lambda[rk.samples.lambda.len() - 2..];
    assert!((last[0] - 2.0 * G).abs() < 1e-12 && (last[1] - 8.0 * G).abs() < 1e-12, "{last:?}");
}

#[test]
fn gaps_that_become_coupled_end_a_run_of_the_implicit_scheme() {
    // from t = 1/2 on the second wall turns
    let layout = Layout::smooth(2, 2);
    let turned = |from: f64| {
        let function = move |t: f64, q: &[f64], _: &[f64], out: &mut [f64]| {
            let turn = 0.1 * (t - from).max(0.0);
            out.fill(0.0);
            out[layout.mass()].copy_from_slice(&[1.0, 0.0, 0.0, 1.0]);
            out[layout.gap()].copy_from_slice(&[q[0] + 9.0, q[1] + turn * q[0] + 9.0]);
            out[layout.gradient()].copy_from_slice(&[1.0, 0.0, turn, 1.0]);
            out[layout.rate()].copy_from_slice(&[0.0, if t > from { 0.1 * q[0] } else { 0.0 }]);
            Ok::<(), Infallible>(())
        };
        let mut system = of_function(layout, function);
        let start = (&[0.0, 0.0][..], &[0.1, 0.0][..]);
        let (e, h) = (&[0.5, 0.5][..], grid(1.0, 0.01));
        simulate_mechanical_theta_gamma(&mut system, e, h, start, vec![], &mut Silent)
    };
    let run = turned(0.5).unwrap();
    assert_eq!(run.status, Status::StepNotSolved);
    let last = *run.samples.t.last().unwrap();
    assert!((last - 0.5).abs() < 0.011, "{last}");
    assert_eq!(turned(2.0).unwrap().status, Status::Completed);
    assert!(turned(-1.0).is_err());
}
