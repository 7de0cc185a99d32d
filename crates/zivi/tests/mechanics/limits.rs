//! Budgets, refusals and flags, on systems whose motion is written down by hand.

use std::convert::Infallible;

use zivi::mechanics::{
    simulate_mechanical, simulate_mechanical_theta_gamma, FlagKind, MechanicalOutput,
    MechanicalRun, Occurrence,
};
use zivi::system::dynamics::{Dynamics, Layout};
use zivi::system::impact_law::newton_impacts;
use zivi::{Grid, Silent, Status, SwitchedRk};

use crate::models::of_function;

type Run = MechanicalRun<Infallible>;
type Gap = (f64, Vec<f64>);

/// A system with a constant diagonal mass, forces and gaps with their normals.
fn system<'a>(
    masses: &'a [f64],
    m: usize,
    force: impl Fn(f64, &[f64]) -> Vec<f64> + 'a,
    gaps: impl Fn(&[f64]) -> Vec<Gap> + 'a,
) -> impl Dynamics<Infallible> + 'a {
    let n = masses.len();
    let layout = Layout::smooth(n, m);
    let function = move |t: f64, q: &[f64], _: &[f64], out: &mut [f64]| {
        out.fill(0.0);
        for (i, mass) in masses.iter().enumerate() {
            out[layout.mass()][i * (n + 1)] = *mass;
        }
        out[layout.force()].copy_from_slice(&force(t, q));
        for (i, (gap, normal)) in gaps(q).into_iter().enumerate() {
            out[layout.gap()][i] = gap;
            out[layout.gradient()][i * n..][..n].copy_from_slice(&normal);
        }
        Ok(())
    };
    of_function(layout, function)
}

fn switched(
    settings: SwitchedRk,
    dynamics: &mut impl Dynamics<Infallible>,
    e: &[f64],
    t1: f64,
    start: (&[f64], &[f64]),
) -> Run {
    let output = MechanicalOutput::default();
    simulate_mechanical(
        settings,
        dynamics,
        &newton_impacts(e).unwrap(),
        (0.0, t1),
        start,
        output,
        &mut Silent,
    )
    .unwrap()
}

fn implicit(
    dynamics: &mut impl Dynamics<Infallible>,
    e: &[f64],
    (t1, h): (f64, f64),
    start: (&[f64], &[f64]),
) -> Run {
    let grid = Grid::new(0.0, t1, h).unwrap();
    simulate_mechanical_theta_gamma(dynamics, e, grid, start, Vec::new(), &mut Silent).unwrap()
}

#[test]
fn the_floor_carries_the_weight_in_implicit_steps() {
    let mut ball = system(&[2.0], 1, |_, _| vec![-2.0 * 9.81], |q| vec![(q[0], vec![1.0])]);
    let run = implicit(&mut ball, &[0.5], (2.0, 1e-3), (&[0.1], &[0.0]));
    assert_eq!(run.status, Status::Completed);
    assert!((run.samples.lambda.last().unwrap() - 2.0 * 9.81).abs() < 1e-12);
    // P = m (g'+ - g'-), and none carries while the ball flies
    let mut impacts = 0;
    for it in &run.occurrences {
        if let Occurrence::Impact { before, after, impulse, .. } = *it {
            assert!((impulse - 2.0 * (after - before)).abs() < 1e-12 * impulse, "{it:?}");
            impacts += 1;
        }
    }
    assert!(impacts > 3 && run.samples.lambda[0] == 0.0);
}

#[test]
fn implicit_steps_end_where_gaps_cease_to_be_at_right_angles() {
    // the wall turns about the origin as the ball moves along the floor: cos = a q0/|n|
    let gaps = |q: &[f64]| {
        let wall = (5.0 - q[0] + 0.1 * q[0] * q[1], vec![-1.0 + 0.1 * q[1], 0.1 * q[0]]);
        vec![(q[1], vec![0.0, 1.0]), wall]
    };
    let mut turning = system(&[1.0, 1.0], 2, |_, _| vec![0.0, -9.81], gaps);
    let run = implicit(&mut turning, &[0.5, 0.5], (1.0, 1e-2), (&[0.0, 1.0], &[1.0, 0.0]));
    assert_eq!(run.status, Status::StepNotSolved);
    assert!(*run.samples.t.last().unwrap() < 0.05, "{:?}", run.samples.t.last());
    let run = implicit(&mut turning, &[0.5, 0.5], (0.2, 1e-2), (&[0.0, 1.0], &[0.0, 0.0]));
    assert_eq!(run.status, Status::Completed);
}

#[test]
fn a_budget_of_impacts_is_kept() {
    // an elastic ball between walls at 0 and 1, once a unit of time
    let walls = |q: &[f64]| vec![(q[0], vec![1.0]), (1.0 - q[0], vec![-1.0])];
    let mut ball = system(&[1.0], 2, |_, _| vec![0.0], walls);
    let budget = |max_impacts: usize, t1: f64, ball: &mut _| {
        let settings = SwitchedRk { max_impacts, ..SwitchedRk::default() };
        switched(settings, ball, &[1.0, 1.0], t1, (&[0.5], &[1.0]))
    };
    let run = budget(7, 20.0, &mut ball);
    assert_eq!(run.status, Status::ZenoBudget);
    assert_eq!(run.counts.impacts, 8);
    let end = *run.samples.t.last().unwrap();
    assert!((end - 7.5).abs() < 1e-9, "{end}");
    assert_eq!(budget(8, 8.4, &mut ball).status, Status::Completed);
}

#[test]
fn gaps_are_what_their_functions_say_after_many_steps() {
    // a pendulum of two coordinates above a wavy floor that it never meets
    let gap = |q: &[f64]| 3.0 + q[1] + 0.2 * (5.0 * q[0]).sin();
    let gaps = move |q: &[f64]| vec![(gap(q), vec![(5.0 * q[0]).cos(), 1.0])];
    let layout = Layout::smooth(2, 1);
    let function = |_: f64, q: &[f64], w: &[f64], out: &mut [f64]| {
        out.fill(0.0);
        (out[0], out[3]) = (1.0, 1.0);
        out[layout.force()].copy_from_slice(&[-4.0 * q[0], -9.0 * q[1]]);
        let (value, normal) = gaps(q).remove(0);
        out[layout.gap()][0] = value;
        out[layout.gradient()].copy_from_slice(&normal);
        out[layout.curvature()][0] = -5.0 * (5.0 * q[0]).sin() * w[0] * w[0];
        Ok::<(), Infallible>(())
    };
    let mut pendulum = of_function(layout, function);
    let settings = SwitchedRk::with_tol(1e-6);
    let run = switched(settings, &mut pendulum, &[0.5], 40.0, (&[1.0, 0.5], &[0.0, 0.0]));
    assert!(run.samples.t.len() > 100);
    for (x, v) in run.samples.x.chunks(3).zip(run.samples.v.chunks(3)) {
        assert!((x[2] - gap(x)).abs() < 1e-13, "{:e}", x[2] - gap(x));
        let rate = (5.0 * x[0]).cos() * v[0] + v[1];
        assert!((v[2] - rate).abs() < 1e-12, "{:e}", v[2] - rate);
    }
}

#[test]
fn coupled_gaps_that_are_hit_together_are_flagged_and_those_at_right_angles_are_not() {
    // a flat bar falls on both ends: cos = (1/m - l^2/J)/(1/m + l^2/J)
    for cosine in [0.0, 1e-3, 0.1, -0.2, 0.45, -0.49] {
        let ratio = (1.0 - cosine) / (1.0 + cosine);
        let masses = [1.0, 1.0 / ratio];
        let ends = |q: &[f64]| vec![(q[0] + q[1], vec![1.0, 1.0]), (q[0] - q[1], vec![1.0, -1.0])];
        let mut bar = system(&masses, 2, |_, _| vec![-9.81, 0.0], ends);
        let run =
            switched(SwitchedRk::default(), &mut bar, &[0.5; 2], 0.4, (&[0.5, 0.0], &[0.0; 2]));
        let flags: Vec<f64> = run
            .occurrences
            .iter()
            .filter_map(|it| match it {
                Occurrence::Flag { kind: FlagKind::Simultaneous, size, .. } => Some(*size),
                _ => None,
            })
            .collect();
        assert_eq!(flags.len(), usize::from(cosine != 0.0), "{cosine}: {flags:?}");
        assert!(flags.iter().all(|size| (size - f64::abs(cosine)).abs() < 1e-14), "{flags:?}");
    }
}

#[test]
fn coupled_gaps_whose_order_is_within_the_tolerance_are_flagged() {
    // one end of the bar is lower by 2 tilts: at the first impact the other is that much later
    let fall = |tilt: f64, cosine: f64| {
        let ratio = (1.0 - cosine) / (1.0 + cosine);
        let masses = [1.0, 1.0 / ratio];
        let ends = |q: &[f64]| vec![(q[0] + q[1], vec![1.0, 1.0]), (q[0] - q[1], vec![1.0, -1.0])];
        let mut bar = system(&masses, 2, |_, _| vec![-9.81, 0.0], ends);
        let settings = SwitchedRk::with_tol(1e-8);
        let run = switched(settings, &mut bar, &[0.5; 2], 0.4, (&[0.5, tilt], &[0.0; 2]));
        let first = run.occurrences.iter().position(|it| matches!(it, Occurrence::Impact { .. }));
        let uncertain = run.occurrences[..first.unwrap()].iter().filter_map(|it| match it {
            Occurrence::Flag { kind: FlagKind::OrderUncertain, size, .. } => Some(*size),
            _ => None,
        });
        uncertain.collect::<Vec<f64>>()
    };
    let later = 2e-7 / (2.0 * 9.81 * 0.5_f64).sqrt();
    for cosine in [1e-3, 0.1, -0.2, 0.45, -0.49] {
        for tilt in [1e-7, -1e-7] {
            let found = fall(tilt, cosine);
            assert_eq!(found.len(), 1, "{cosine}: {found:?}");
            assert!((found[0] - later).abs() < 1e-4 * later, "{cosine}: {found:?} {later}");
        }
        assert!(fall(1e-5, cosine).is_empty(), "{cosine}");
    }
    assert!(fall(1e-7, 0.0).is_empty());
}
