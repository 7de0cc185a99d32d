//! Moreau-Jean time stepping against the switched method.

use std::convert::Infallible;

use zivi::mechanics::{
    simulate_mechanical_moreau_jean, simulate_mechanical_theta_gamma, MechanicalRun, Occurrence,
};
use zivi::{Grid, MoreauJean, MotionPoint, SetupError, Silent, Status, SwitchedRk, UserEvent};

use crate::line::Linear;
use crate::models::Model;
use crate::problems::{last_state, parameters, Problem};

fn wedge(t1: f64) -> Problem {
    let par = [("m", 1.0), ("G", 9.81), ("cd", 0.1), ("a1", 1.1), ("a2", 0.9)];
    let (q0, w0) = (vec![0.1, 1.2], vec![0.3, 0.0]);
    Problem { model: "wedge", par: parameters(&par), e: vec![0.5, 0.4], q0, w0, t1 }
}

fn dome(t1: f64) -> Problem {
    let par = [
        ("m", 1.0),
        ("G", 9.81),
        ("cd", 0.2),
        ("fx", 6.0),
        ("om", 2.5),
        ("s", 0.3),
        ("c", 0.1),
        ("d", 0.7),
    ];
    let (q0, w0) = (vec![0.0, 0.4], vec![0.3, 0.0]);
    Problem { model: "dome", par: parameters(&par), e: vec![0.4, 0.5], q0, w0, t1 }
}

fn steps(problem: &Problem, h: f64, theta: f64) -> MechanicalRun<std::convert::Infallible> {
    let mut model = Model::new(problem.model, problem.par.clone());
    let grid = Grid::new(0.0, problem.t1, h).unwrap();
    let start = (&problem.q0[..], &problem.w0[..]);
    let method = MoreauJean { theta };
    simulate_mechanical_moreau_jean(
        method,
        &mut model,
        &problem.e,
        grid,
        start,
        Vec::new(),
        &mut Silent,
    )
    .unwrap()
}

#[test]
fn of_first_order_through_impacts_accumulations_and_contact() {
    // jittered steps: the error of one step size is a matter of luck
    let jitters = [1.0, 1.07, 1.13, 1.21, 1.32];
    for problem in [wedge(0.6), wedge(0.9), dome(3.0)] {
        let exact = last_state(&problem.run(SwitchedRk::with_tol(1e-11)));
        let error = |h: f64| {
            let squares = jitters.iter().map(|jitter| {
                let run = steps(&problem, h * jitter, 0.5);
                assert_eq!(run.status, Status::Completed);
                let state = last_state(&run).into_iter().zip(&exact);
                state.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max).powi(2)
            });
            (squares.sum::<f64>() / jitters.len() as f64).sqrt()
        };
        let (coarse, fine) = (error(2e-3), error(1.25e-4));
        let order = (coarse / fine).log2() / 4.0;
        println!("{} {}: {coarse:e} {fine:e} {order:.2}", problem.model, problem.t1);
        assert!(order > 0.7 && order < 1.6, "{}: {coarse:e} {fine:e} {order}", problem.model);
    }
}

#[test]
fn rest_in_a_corner_and_what_presses_there() {
    let problem = wedge(3.0);
    let run = steps(&problem, 1e-3, 0.5);
    let closed = run.samples.modes.last().unwrap().closed;
    assert!(closed.has(0) && closed.has(1));
    let zeno = run.occurrences.iter().filter(|it| matches!(it, Occurrence::Zeno { .. })).count();
    assert!(zeno >= 2, "{zeno}");
    // lambda_1 n_1 + lambda_2 n_2 carries the weight
    let lambda = &run.samples.lambda[run.samples.lambda.len() - 2..];
    let ((s1, c1), (s2, c2)) = (1.1_f64.sin_cos(), 0.9_f64.sin_cos());
    let sides = lambda[0] * s1 - lambda[1] * s2;
    let up = lambda[0] * c1 + lambda[1] * c2;
    assert!(sides.abs() < 1e-9 && (up - 9.81).abs() < 1e-9, "{lambda:?}");
}

fn implicit(problem: &Problem, h: f64) -> Result<MechanicalRun<Infallible>, SetupError> {
    let mut model = Model::new(problem.model, problem.par.clone());
    let grid = Grid::new(0.0, problem.t1, h).unwrap();
    let start = (&problem.q0[..], &problem.w0[..]);
    simulate_mechanical_theta_gamma(&mut model, &problem.e, grid, start, Vec::new(), &mut Silent)
}

fn surface(t1: f64) -> Problem {
    let par =
        [("a", 0.12), ("b", 0.1), ("k", 2.0), ("G", 9.81), ("cd", 0.1), ("f", 1.5), ("om", 3.0)];
    let (q0, w0) = (vec![0.1, -0.2, 0.5], vec![1.0, 0.7, 0.0]);
    Problem { model: "surf3", par: parameters(&par), e: vec![0.45], q0, w0, t1 }
}

fn floor_and_wall(t1: f64) -> Problem {
    let par = [("m", 1.0), ("G", 9.81), ("fx", 2.0), ("om", 1.5), ("d", 0.8)];
    let (q0, w0) = (vec![0.0, 0.5], vec![0.5, 0.0]);
    Problem { model: "corner", par: parameters(&par), e: vec![0.5, 0.3], q0, w0, t1 }
}

#[test]
fn the_implicit_step_is_of_first_order_and_lands_exactly() {
    let jitters = [1.0, 1.07, 1.13, 1.21];
    for problem in [surface(0.2), surface(1.0), floor_and_wall(0.5), floor_and_wall(1.5)] {
        let exact = last_state(&problem.run(SwitchedRk::with_tol(1e-11)));
        let error = |h: f64| {
            let squares = jitters.iter().map(|jitter| {
                let run = implicit(&problem, h * jitter).unwrap();
                assert_eq!(run.status, Status::Completed);
                let state = last_state(&run).into_iter().zip(&exact);
                state.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max).powi(2)
            });
            (squares.sum::<f64>() / jitters.len() as f64).sqrt()
        };
        let (coarse, fine) = (error(4e-3), error(2.5e-4));
        let order = (coarse / fine).log2() / 4.0;
        println!("{} {}: {coarse:e} {fine:e} {order:.2}", problem.model, problem.t1);
        assert!(order > 0.75 && order < 1.4, "{}: {coarse:e} {fine:e} {order}", problem.model);
    }
    let run = implicit(&surface(1.0), 1e-3).unwrap();
    assert!(run.samples.modes.last().unwrap().closed.has(0));
    let last = run.samples.x.len() - 1;
    assert_eq!((run.samples.x[last], run.samples.v[last]), (0.0, 0.0));
    let q = &run.samples.x[last - 3..last];
    let gap = q[2] - 0.12 * (2.0 * q[0]).sin() - 0.1 * (2.0 * q[1]).cos();
    assert!(gap.abs() < 1e-15, "{gap:e}");
}

#[test]
fn the_implicit_step_refuses_coupled_gaps_and_says_why() {
    let error = implicit(&wedge(1.0), 1e-3).unwrap_err().to_string();
    assert!(error.contains("kinetic cosine") && error.contains("right angles"), "{error}");
}

/// A mass at rest on a floor under a force, stepped over 2 s.
fn resting(
    force: impl FnMut(f64) -> Vec<f64>,
    (h, theta): (f64, f64),
    events: Vec<UserEvent<'_, Infallible, MotionPoint>>,
) -> MechanicalRun<Infallible> {
    let (mass, gaps, e) = (vec![1.0], vec![(vec![1.0], 0.0)], vec![0.5]);
    let system = Linear { mass, gaps, e, q: vec![0.0], w: vec![0.0] };
    let (grid, start) = (Grid::new(0.0, 2.0, h).unwrap(), (&system.q[..], &system.w[..]));
    let (method, mut dynamics) = (MoreauJean { theta }, system.dynamics(force));
    let e = &system.e[..];
    simulate_mechanical_moreau_jean(method, &mut dynamics, e, grid, start, events, &mut Silent)
        .unwrap()
}

#[test]
fn a_contact_opens_in_the_step_in_which_the_pull_turns() {
    for theta in [0.5, 0.75, 1.0] {
        let run = resting(|t| vec![t - 1.0], (0.125, theta), vec![]);
        let lift_offs = run.occurrences.iter().filter_map(|it| match *it {
            Occurrence::LiftOff { t, .. } => Some(t),
            _ => None,
        });
        assert_eq!(lift_offs.collect::<Vec<f64>>(), [1.0], "{theta}");
    }
}

#[test]
fn events_within_a_few_long_steps_are_all_seen() {
    use std::f64::consts::PI;
    // ten zeros in each of the two steps
    let wave = UserEvent::of(|t: f64, _: &MotionPoint| Ok((10.0 * PI * t - 0.3).sin()));
    let run = resting(|_| vec![-1.0], (1.0, 0.5), vec![wave]);
    assert_eq!((run.status, run.samples.t.len(), run.hits[0].len()), (Status::Completed, 3, 20));
    for (k, hit) in run.hits[0].iter().enumerate() {
        let exact = (k as f64 * PI + 0.3) / (10.0 * PI);
        assert!((hit.t - exact).abs() < 1e-12, "{} {exact}", hit.t);
    }
}
