//! Zeno points: their times, the work that they take, and the tails behind them.

use zivi::{LinearForce, Order, Physical, Restitution};

use crate::closed;
use crate::problems::{settings, simulate, Random, Run};

struct Episode {
    force: LinearForce,
    restitution: Restitution,
    start: Physical,
    zeno: f64,
}

impl Episode {
    /// A random force that pulls at any time, so that there is a Zeno point.
    fn random(random: &mut Random) -> Self {
        let stiffness: f64 = random.between(0.01, 3.0);
        let gravity = random.between(3.0, 10.0);
        let force = LinearForce {
            stiffness,
            damping: random.between(0.0, 0.8) * stiffness.sqrt(),
            gravity,
            amplitude: random.between(0.0, 0.6) * gravity,
            omega: random.between(0.5, 6.0),
            phase: random.between(-3.0, 3.0),
        };
        let e = random.between(0.15, 0.98);
        let start = Physical { x: random.between(0.2, 1.5), xdot: random.between(-1.0, 1.0) };
        let story = closed::simulate(force, e, (0.0, 500.0), (start.x, start.xdot));
        Self { force, restitution: Restitution::from_e(e).unwrap(), start, zeno: story.zeno[0] }
    }

    fn simulate(&self, order: Order, tol: f64) -> Run {
        let span = (0.0, self.zeno + 0.5);
        simulate(settings(order, tol), self.restitution, &mut self.force.clone(), span, self.start)
    }
}

fn episodes() -> Vec<Episode> {
    let mut random = Random(80);
    (0..80).map(|_| Episode::random(&mut random)).collect()
}

#[test]
fn zeno_times_are_within_the_tolerance() {
    let episodes = episodes();
    for order in [Order::Five, Order::Eight] {
        for tol in [1e-3, 1e-4, 1e-6, 1e-8, 1e-10] {
            let (mut errors, mut impacts) = (Vec::new(), 0);
            for episode in &episodes {
                let run = episode.simulate(order, tol);
                let zeno = &run.trajectory.events.zeno_times;
                assert_eq!(zeno.len(), 1);
                errors.push((zeno[0] - episode.zeno).abs() / tol);
                impacts += run.counts.impacts;
            }
            errors.sort_by(f64::total_cmp);
            // order 5 loses more to the errors of its flights, which add up over an impact sequence
            let most = if order == Order::Eight { 5.0 } else { 100.0 };
            let what = format!("{order:?} {tol:e}: {} {}", errors[40], errors[76]);
            assert!(errors[40] < 1.0 && errors[76] < most, "{what}");
            // down to rounding it would be 116 impacts
            assert!(impacts < 30 * 80, "{what}: {impacts}");
        }
    }
}

#[test]
fn the_number_of_impacts_before_the_jump() {
    let force = LinearForce {
        stiffness: 0.0,
        damping: 0.3,
        gravity: 9.81,
        amplitude: 3.0,
        omega: 5.0,
        phase: 0.0,
    };
    // e, and the impacts at tolerances 1e-4, 1e-6, 1e-8, 1e-10
    let table = [
        (0.1, [3, 4, 4, 5]),
        (0.5, [6, 8, 9, 10]),
        (0.7, [9, 12, 14, 16]),
        (0.9, [38, 46, 53, 59]),
        (0.97, [129, 157, 177, 218]),
        (0.99, [373, 459, 545, 629]),
        (0.997, [1296, 1577, 1969, 2306]),
    ];
    let start = Physical { x: 1.0, xdot: 0.0 };
    for (e, impacts) in table {
        let restitution = Restitution::from_e(e).unwrap();
        let until_rest = |tol| {
            let settings = settings(Order::Eight, tol);
            let run = simulate(settings, restitution, &mut force.clone(), (0.0, 600.0), start);
            (run.counts.impacts, run.trajectory.events.zeno_times[0])
        };
        let (_, exact) = until_rest(1e-13);
        for (tol, expected) in [1e-4, 1e-6, 1e-8, 1e-10].into_iter().zip(impacts) {
            let (impacts, zeno) = until_rest(tol);
            let expected = f64::from(expected);
            assert!((impacts as f64 - expected).abs() <= 1.0 + 0.25 * expected, "{e} {tol:e}");
            assert!((zeno - exact).abs() < 6.0 * tol, "{e} {tol:e} {:e}", zeno - exact);
        }
    }
}

/// Largest error of position and velocity in the tail, at points that lie at least 2 % of their
/// arc from its ends, in arcs of at least `shortest`.
fn tail_error(episode: &Episode, run: &Run, shortest: f64) -> [f64; 2] {
    let (path, tail) = (run.path.as_ref().unwrap(), &run.tails[0]);
    let start = (episode.start.x, episode.start.xdot);
    let (e, zeno) = (episode.restitution.e(), episode.zeno);
    let story = closed::simulate(episode.force, e, (0.0, zeno + 0.1), start);
    let mut worst = [0.0_f64; 2];
    for pair in story.impacts.windows(2).filter(|pair| pair[0][0] > tail.start() - 1e-9) {
        let ([t, u], [end, _]) = (pair[0], pair[1]);
        if end - t < shortest {
            break;
        }
        let flight = closed::Flight::new(episode.force, t, 0.0, u);
        for i in 0..=10 {
            let tau = (0.02 + 0.096 * f64::from(i)) * (end - t);
            let ([x, v], point) = (flight.at(tau), path.at(t + tau).unwrap());
            worst[0] = worst[0].max((point.x - x).abs());
            worst[1] = worst[1].max((point.xdot - v).abs());
        }
    }
    worst
}

#[test]
fn the_tail_is_the_motion_that_the_jump_skips() {
    let episodes = episodes();
    for order in [Order::Five, Order::Eight] {
        for tol in [1e-4, 1e-6, 1e-8, 1e-10] {
            let mut velocities = Vec::new();
            for episode in &episodes {
                let run = episode.simulate(order, tol);
                // where the Zeno time is late, all of the last arcs are
                let late = (run.tails[0].zeno_time() - episode.zeno).abs().max(tol);
                let [x, v] = tail_error(episode, &run, 50.0 * late);
                assert!(x < 10.0 * tol, "{order:?} {tol:e}: {x:e}");
                velocities.push(v / late);
            }
            velocities.sort_by(f64::total_cmp);
            assert!(velocities[40] < 10.0 && velocities[72] < 100.0, "{order:?} {tol:e}");
            assert!(velocities[79] < 1000.0, "{order:?} {tol:e} {}", velocities[79]);
        }
    }
}

#[test]
fn without_the_tail_the_skipped_interval_would_be_wrong() {
    // the motion in the tail is 1e4 tolerances high: a jump that reports x = 0 there is not of
    // high order, however good the time is
    let tol = 1e-8;
    let episodes = episodes();
    let highest = episodes.iter().map(|episode| {
        let run = episode.simulate(Order::Eight, tol);
        let (path, tail) = (run.path.as_ref().unwrap(), &run.tails[0]);
        let (start, length) = (tail.start(), tail.zeno_time() - tail.start());
        let heights = (1..200).map(|i| path.at(start + f64::from(i) / 200.0 * length).unwrap().x);
        heights.fold(0.0, f64::max)
    });
    assert!(highest.fold(0.0, f64::max) > 1e3 * tol);
}
