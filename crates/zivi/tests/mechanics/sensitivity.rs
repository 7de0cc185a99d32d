//! Derivatives of runs, against differences of runs.

use std::convert::Infallible;

use zivi::mechanics::sensitivity::{mechanical_sensitivity, Derivatives, MechanicalWrt, Question};
use zivi::mechanics::{MechanicalOutput, MechanicalRun};
use zivi::switched::sensitivity::Limit;
use zivi::system::dynamics::Layout;
use zivi::system::impact_law::newton_impacts;
use zivi::system::partials::{parameter_step, DifferencedDynamics, Neighbours, MOVES};
use zivi::{Silent, Status, SwitchedRk};

use crate::models::{of_function, Model};
use crate::problems::{events_of, last_state, parameters, Problem};

/// A problem and the parameters of its model to differentiate by.
struct Case {
    problem: Problem,
    by: Vec<&'static str>,
}

fn differentiate(
    case: &Case,
    settings: SwitchedRk,
    wrt: &[MechanicalWrt],
) -> (MechanicalRun<Infallible>, Derivatives) {
    let Problem { model, par, e, q0, w0, t1 } = &case.problem;
    let system = |name: Option<(&str, f64)>| {
        let mut par = par.clone();
        if let Some((name, value)) = name {
            par.insert(name.into(), value);
        }
        Model::new(model, par)
    };
    let neighbours = case.by.iter().map(|name| {
        let step = parameter_step(par[*name]);
        let systems = MOVES.map(|k| system(Some((name, par[*name] + k * step))));
        Neighbours { step, systems }
    });
    let mut dynamics = DifferencedDynamics::new(system(None), neighbours.collect(), *t1);
    let sizes = vec![1.0; wrt.len()];
    let question = Question { wrt, sizes: &sizes, controlled: true, times: &[] };
    let (span, output) = ((0.0, *t1), MechanicalOutput::default());
    let start = (&q0[..], &w0[..]);
    mechanical_sensitivity(
        settings,
        &mut dynamics,
        &newton_impacts(e).unwrap(),
        span,
        start,
        output,
        &question,
        &mut Silent,
    )
    .unwrap()
}

/// The problem with one number moved by `h`.
fn moved(case: &Case, wrt: MechanicalWrt, h: f64) -> Problem {
    let Problem { model, par, e, q0, w0, t1 } = &case.problem;
    let (mut par, mut e, mut q0, mut w0) = (par.clone(), e.clone(), q0.clone(), w0.clone());
    match wrt {
        MechanicalWrt::Q0(i) => q0[i] += h,
        MechanicalWrt::Qdot0(i) => w0[i] += h,
        MechanicalWrt::AllE => e.iter_mut().for_each(|e| *e += h),
        MechanicalWrt::Law { gap, .. } => e[gap] += h,
        MechanicalWrt::Parameter(k) => *par.get_mut(case.by[k]).unwrap() += h,
        MechanicalWrt::T0 | MechanicalWrt::Friction { .. } | MechanicalWrt::Contact { .. } => {
            unreachable!()
        }
    }
    Problem { model, par, e, q0, w0, t1: *t1 }
}

/// The state at the end, then the times of the Zeno points and of the lift-offs.
fn quantities(run: &MechanicalRun<Infallible>) -> Vec<f64> {
    assert_eq!(run.status, Status::Completed);
    let events = events_of(run);
    let times = |kind: &'static str| {
        events.iter().filter(move |it| it.0 == kind).map(|it| it.1).collect::<Vec<f64>>()
    };
    [last_state(run), times("zeno"), times("lift")].concat()
}

/// Central differences of sixth order of runs at a tolerance of 1e-13, if all have the same events.
fn differences(case: &Case, wrt: MechanicalWrt, h: f64) -> Option<Vec<f64>> {
    let at = |k: f64| quantities(&moved(case, wrt, k * h).run(SwitchedRk::with_tol(1e-13)));
    let mut sum: Vec<f64> = Vec::new();
    for (k, weight) in [(1.0, 45.0), (2.0, -9.0), (3.0, 1.0)] {
        let (up, down) = (at(k), at(-k));
        sum.resize(up.len(), 0.0);
        if up.len() != down.len() || up.len() != sum.len() {
            return None;
        }
        for (sum, (up, down)) in sum.iter_mut().zip(up.iter().zip(&down)) {
            *sum += weight * (up - down) / (60.0 * h);
        }
    }
    Some(sum)
}

/// The largest difference, relative to `1 + |derivative|`, of a run's derivatives to differences:
/// of those with the steps given the best, entry by entry.
fn worst(case: &Case, wrt: &[MechanicalWrt], tol: f64, steps: &[f64]) -> f64 {
    let (run, found) = differentiate(case, SwitchedRk::with_tol(tol), wrt);
    assert_eq!((run.status, found.lost_at), (Status::Completed, None));
    let (n, count) = (run.layout.n, wrt.len());
    let mut worst = 0.0_f64;
    for (column, &by) in wrt.iter().enumerate() {
        let events = found.events.zeno_times.iter().chain(found.events.liftoff_times.iter());
        let mine: Vec<f64> = (found.q[column * n..][..n].iter())
            .chain(&found.qdot[column * n..][..n])
            .chain(events.skip(column).step_by(count))
            .copied()
            .collect();
        let mut best = vec![f64::INFINITY; mine.len()];
        for &h in steps {
            // not where the list of events changes within the step
            let wanted = differences(case, by, h).filter(|wanted| wanted.len() == mine.len());
            let Some(wanted) = wanted else { continue };
            for (best, (mine, wanted)) in best.iter_mut().zip(mine.iter().zip(&wanted)) {
                *best = best.min((mine - wanted).abs() / (1.0 + wanted.abs()));
            }
        }
        worst = best.iter().fold(worst, |a, &b| if b > a || b.is_nan() { b } else { a });
    }
    worst
}

fn sine(t1: f64) -> Case {
    let par = parameters(&[("a", 0.3), ("k", 3.0), ("G", 9.81)]);
    let (q0, w0) = (vec![0.1, 0.8], vec![1.1, 0.0]);
    let problem = Problem { model: "sine", par, e: vec![0.4], q0, w0, t1 };
    Case { problem, by: vec!["a", "k", "G"] }
}

#[test]
fn the_columns_are_differences_of_runs() {
    use MechanicalWrt::{AllE, Parameter, Qdot0, Q0};
    let wrt = [Q0(0), Q0(1), Qdot0(0), Qdot0(1), AllE, Parameter(0), Parameter(1), Parameter(2)];
    for t1 in [0.35, 0.55, 0.9] {
        let error = worst(&sine(t1), &wrt, 1e-10, &[3e-4]);
        assert!(error < 1e-8, "{t1}: {error:e}");
    }
}

#[test]
fn an_impact_that_opens_another_contact_or_not_has_no_derivative() {
    // a wall that turns is met when it is at a right angle to the floor: what comes later lifts off
    // the floor, and what comes earlier is pressed onto it
    let layout = Layout::smooth(3, 2);
    let function = |t: f64, q: &[f64], w: &[f64], out: &mut [f64]| {
        let ([y, _, x], turn) = ([q[0], q[1], q[2]], t - 1.0);
        out.fill(0.0);
        (0..3).for_each(|i| out[layout.mass()][4 * i] = 1.0);
        out[layout.gap()].copy_from_slice(&[1.0 - x + turn * y, y]);
        out[layout.gradient()].copy_from_slice(&[turn, 0.0, -1.0, 1.0, 0.0, 0.0]);
        out[layout.curvature()].copy_from_slice(&[2.0 * w[0], 0.0]);
        out[layout.rate()].copy_from_slice(&[y, 0.0]);
        Ok(())
    };
    let differentiate = |x: f64, times: &[f64]| {
        let system = of_function(layout, function);
        let (wrt, sizes) = (&[MechanicalWrt::Q0(2)][..], &[1.0][..]);
        mechanical_sensitivity(
            SwitchedRk::with_tol(1e-10),
            &mut DifferencedDynamics::new(system, vec![], 2.0),
            &newton_impacts(&[0.5; 2]).unwrap(),
            (0.0, 2.0),
            (&[0.0, 0.0, x], &[0.0, 0.2, 1.0]),
            MechanicalOutput::default(),
            &Question { wrt, sizes, controlled: true, times },
            &mut Silent,
        )
        .unwrap()
    };
    let height = |moved: f64| last_state(&differentiate(moved, &[]).0)[0];
    let impulse = |later: f64| 1.5 / (1.0 + later * later);
    assert!(height(1e-3).abs() < 1e-12);
    assert!((height(-1e-3) - 1e-3 * impulse(1e-3) * (1.0 - 1e-3)).abs() < 1e-12);
    let (run, found) = differentiate(0.0, &[0.5, 1.25, 1.5, 2.0]);
    assert_eq!(run.status, Status::Completed);
    assert!(found.lost_at.is_some_and(|t| (t - 1.0).abs() < 1e-9), "{:?}", found.lost_at);
    assert_eq!(found.samples.len(), 4 * 6);
    assert!(found.samples[..6].iter().zip([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]).all(|(a, b)| *a == b));
    assert!(found.samples[6..].iter().all(|rate| rate.is_nan()), "{:?}", found.samples);
}

/// The references that have no corner, by everything: about ten seconds.
#[test]
#[ignore = "a sweep"]
fn all_references_against_differences() {
    use MechanicalWrt::{Law, Parameter, Qdot0, Q0};
    for case in crate::references::cases().into_iter().filter(|case| !case.nested) {
        // neither the balls of the cradle that touch at the start, nor wedges at right angles, have
        // derivatives by everything
        if case.name == "cradle" || case.name == "wedge_orth" {
            continue;
        }
        let of_model = |name: &&String| !["e", "T", "t0"].contains(&name.as_str());
        let by: Vec<&'static str> =
            case.par.keys().filter(of_model).map(|name| &*name.clone().leak()).collect();
        let n = case.q0.len();
        let mut wrt: Vec<MechanicalWrt> = (0..n).map(Q0).chain((0..n).map(Qdot0)).collect();
        wrt.extend(
            (0..case.e.len()).filter(|&i| case.e[i] > 0.01).map(|gap| Law { gap, parameter: 0 }),
        );
        wrt.extend((0..by.len()).map(Parameter));
        let (name, t1) = (case.name, case.t1);
        let (model, par) = (&*case.model.leak(), case.par);
        let problem = Problem { model, par, e: case.e, q0: case.q0, w0: case.w0, t1 };
        let error = worst(&Case { problem, by }, &wrt, 1e-10, &[1e-3, 2e-4, 4e-5, 1e-5]);
        println!("{name}: {error:.1e}");
        assert!(error < 2e-8, "{name}: {error:e}");
    }
}

/// A ball that is pulled the more the faster it goes along the floor, which drives it on: how fast it
/// may go until the pull where it comes to rest vanishes.
#[test]
fn the_pull_at_a_zeno_point_bounds_derivatives() {
    const K: f64 = 0.2;
    let layout = Layout::smooth(2, 1);
    let function = |_: f64, q: &[f64], w: &[f64], out: &mut [f64]| {
        let numbers = [1.0, 0.0, 0.0, 1.0, K * w[0], -(2.0 + 0.5 * w[0]), q[1], 0.0, 1.0, 0.0, 0.0];
        out.copy_from_slice(&numbers);
        Ok(())
    };
    let run = |speed: f64| {
        let (wrt, sizes) = (&[MechanicalWrt::Qdot0(0)][..], &[1.0][..]);
        let (run, found) = mechanical_sensitivity(
            SwitchedRk::with_tol(1e-11),
            &mut DifferencedDynamics::new(of_function(layout, function), vec![], 6.0),
            &newton_impacts(&[0.5]).unwrap(),
            (0.0, 6.0),
            (&[0.0, 0.0], &[speed, 1.0]),
            MechanicalOutput::default(),
            &Question { wrt, sizes, controlled: true, times: &[] },
            &mut Silent,
        )
        .unwrap();
        let zeno = events_of(&run).iter().find(|it| it.0 == "zeno").unwrap().1;
        (zeno, 2.0 + 0.5 * speed * (K * zeno).exp(), found)
    };
    let (zeno, pull, found) = run(1.0);
    let h = 1e-3;
    let slope = (run(1.0 + h).1 - run(1.0 - h).1) / (2.0 * h);
    let nearest = found.nearest[0].unwrap();
    assert_eq!(nearest.limit, Limit::Zeno);
    assert!((nearest.t - zeno).abs() < 1e-9 && (nearest.depth - pull).abs() < 1e-8);
    assert!((found.radius[0] * slope / pull - 1.0).abs() < 1e-5, "{}", found.radius[0]);
}
