//! Random linear forces against the closed form.

use zivi::{LinearForce, Order, Physical, Restitution};

use crate::closed::{self, Story};
use crate::problems::{end, settings, simulate, Random};

struct Problem {
    force: LinearForce,
    e: f64,
    span: (f64, f64),
    start: (f64, f64),
}

impl Problem {
    fn random(random: &mut Random, number: usize) -> Self {
        let free = number.is_multiple_of(4);
        let stiffness = if free { 0.0 } else { random.between(0.05, 4.0) };
        let damping = if free { 0.0 } else { random.between(0.0, 0.9) * stiffness.sqrt() };
        let gravity = random.between(0.5, 10.0);
        let force = LinearForce {
            stiffness,
            damping,
            gravity,
            amplitude: random.between(0.0, 2.5) * gravity,
            omega: random.between(0.5, 7.0),
            phase: random.between(-3.0, 3.0),
        };
        let t0 = random.between(-2.0, 2.0);
        let start = (random.between(0.05, 1.5), random.between(-3.0, 3.0));
        let e = random.between(0.05, 0.85);
        Self { force, e, span: (t0, t0 + 6.0), start }
    }

    fn closed(&self) -> Story {
        closed::simulate(self.force, self.e, self.span, self.start)
    }
}

fn worst(mine: &[f64], exact: &[f64]) -> f64 {
    mine.iter().zip(exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn a_thousand_random_forces_have_the_events_of_the_closed_form() {
    const SLOWEST: f64 = 1e-5;
    let mut random = Random(3);
    let (mut zenos, mut lifts, mut impacts, mut loose) = (0, 0, 0, 0);
    for number in 0..1000 {
        let problem = Problem::random(&mut random, number);
        let (story, mut force) = (problem.closed(), problem.force);
        let order = if number % 2 == 0 { Order::Eight } else { Order::Five };
        let restitution = Restitution::from_e(problem.e).unwrap();
        let initial = Physical { x: problem.start.0, xdot: problem.start.1 };
        let run = simulate(settings(order, 1e-11), restitution, &mut force, problem.span, initial);

        let events = &run.trajectory.events;
        let (zeno, lift) = (&events.zeno_times, &events.liftoff_times);
        let mine = run.impacts_down_to(SLOWEST, 100_000);
        let exact: Vec<_> = story.impacts.iter().filter(|it| it[1] >= SLOWEST).collect();
        let what = format!("{number} {force:?} e {} {:?} {initial:?}", problem.e, problem.span);
        assert_eq!(mine.len(), exact.len(), "impacts of {what}");
        assert_eq!(zeno.len(), story.zeno.len(), "Zeno points of {what}");
        assert_eq!(lift.len(), story.lift.len(), "lift-offs of {what}");
        zenos += zeno.len();
        lifts += lift.len();
        impacts += mine.len();

        // motions that nearly graze the wall magnify every error
        let near = mine
            .iter()
            .zip(&exact)
            .map(|(a, b)| (a.t - b[0]).abs().max((a.xdot_after - b[1]).abs()));
        let state = end(&run);
        let at_end = (state.x - story.end[0]).abs();
        let error = near.fold(worst(zeno, &story.zeno).max(at_end), f64::max);
        loose += usize::from(error > 1e-9);
        assert!(error < 1e-6, "{error:e} {what}");
        assert!(worst(lift, &story.lift) < 1e-13, "{what}");
    }
    println!("{loose} errors above 100 tolerances");
    assert!(zenos > 1000 && lifts > 700 && impacts > 15_000, "{zenos} {lifts} {impacts}");
    assert!(loose < 20, "{loose}");
}

#[test]
fn loose_tolerances_do_not_change_what_happens() {
    // restitution up to 0.99 in the last family, whose impact sequences add up many flights
    for (tol, low, high) in [(1e-4, 0.05, 0.85), (1e-6, 0.05, 0.85), (1e-6, 0.85, 0.99)] {
        for order in [Order::Five, Order::Eight] {
            let mut random = Random(5);
            let (mut errors, mut different) = (Vec::new(), 0);
            for number in 0..300 {
                let mut problem = Problem::random(&mut random, number);
                problem.e = random.between(low, high);
                let (story, mut force) = (problem.closed(), problem.force);
                let restitution = Restitution::from_e(problem.e).unwrap();
                let initial = Physical { x: problem.start.0, xdot: problem.start.1 };
                let settings = settings(order, tol);
                let run = simulate(settings, restitution, &mut force, problem.span, initial);
                // what happens at the very end may happen before it or behind
                let last = problem.span.1 - 0.05;
                let early = |times: &[f64]| times.iter().filter(|&&t| t < last).copied().collect();
                let (zeno, exact): (Vec<f64>, Vec<f64>) =
                    (early(&run.trajectory.events.zeno_times), early(&story.zeno));
                let lift: Vec<f64> = early(&run.trajectory.events.liftoff_times);
                let exact_lift: Vec<f64> = early(&story.lift);
                if (zeno.len(), lift.len()) != (exact.len(), exact_lift.len()) {
                    different += 1;
                    continue;
                }
                errors.extend(zeno.iter().zip(&exact).map(|(a, b)| (a - b).abs() / tol));
            }
            errors.sort_by(f64::total_cmp);
            let [half, most] = [0.5, 0.9].map(|part| errors[(part * errors.len() as f64) as usize]);
            // an accumulation may end just before or just after the pull does: then errors decide
            assert!(different <= 1, "{tol:e} {order:?} {different}");
            let typical = if high < 0.9 { 1.0 } else { 10.0 };
            assert!(half < typical && most < 20.0, "{tol:e} {order:?} {half} {most}");
        }
    }
}
