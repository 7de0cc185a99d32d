//! Implicit Euler comes to rest: exactly, in finite time, from everywhere.

use crate::common::{Rng, Scheme};
use zivi_core::{transform, Branch, Lifted, Physical, Restitution, StepSolution};

const G: f64 = 9.81;

/// Steps until the state is exactly `(0, 0)`; the number of steps and the last one.
fn run_to_rest(scheme: Scheme, start: Physical, limit: u32) -> Option<(u32, StepSolution)> {
    let step = scheme.build();
    let restitution = Restitution::from_kappa(scheme.kappa).expect("in range");
    let mut z = transform::lift(start, Branch::Positive, restitution);
    let mut side = 1.0;
    for number in 1..=limit {
        let end = step.solve(z, -G, side).expect("a solution");
        z = Lifted { s: end.s, v: end.v };
        side = transform::side(z, side);
        if (z.s, z.v) == (0.0, 0.0) {
            return Some((number, end));
        }
    }
    None
}

fn assert_stays(scheme: Scheme) {
    let mut z = Lifted::default();
    for _ in 0..50 {
        let end = scheme.build().solve(z, -G, -1.0).expect("a solution");
        assert_eq!((end.s, end.v), (0.0, 0.0));
        assert!(end.lambda_s.abs() < 1.0 && end.lambda_v.abs() <= 1.0);
        z = Lifted { s: end.s, v: end.v };
    }
}

const PAPER: Physical = Physical { x: 1.0, xdot: 6.0 };

/// The ball of the paper. The exact time is `t1 + 2 e V/(g (1 - e))`, from the flight to the
/// first impact (`t1 = (6 + V)/g`, speed `V = sqrt(36 + 2 g)`); the scheme is early by
/// `O(h log 1/h)`.
#[test]
fn the_ball_of_the_paper_rests_at_the_known_steps() {
    let e = (1.0 - 0.41) / 1.41;
    let speed = (36.0 + 2.0 * G).sqrt();
    let exact = (6.0 + speed) / G + 2.0 * e * speed / (G * (1.0 - e));
    assert!((exact - 2.465_846_631_559_044).abs() < 1e-14);
    for (h, expected) in [(1e-2, 234), (1e-3, 2444), (1e-4, 24626)] {
        let scheme = Scheme::implicit_euler(h, 0.41);
        let (steps, last) = run_to_rest(scheme, PAPER, 100_000).expect("rest");
        assert_eq!(steps, expected, "h = {h}");
        assert!(last.lambda_s.abs() < 1.0, "h = {h}: {last:?}");
        let early = exact - f64::from(steps) * h;
        println!("h = {h}: early by {:.1} h", early / h);
        assert!(early > 0.0 && early < 20.0 * h * (1.0 / h).log10());
        assert_stays(scheme);
    }
}

#[test]
fn the_ball_rests_exactly_for_every_step_size() {
    let rng = Rng::new(61);
    for _ in 0..200 {
        let scheme = Scheme::implicit_euler(rng.log_between(3e-4, 1e-1), 0.41);
        let limit = (3.0 / scheme.h) as u32;
        assert!(run_to_rest(scheme, PAPER, limit).is_some(), "no rest with {scheme:?}");
        assert_stays(scheme);
    }
}

#[test]
fn every_ball_on_every_wall_rests_exactly() {
    let rng = Rng::new(62);
    for _ in 0..200 {
        let kappa = rng.between(0.05, 0.95);
        let scheme = Scheme::implicit_euler(rng.log_between(1e-3, 1e-1), kappa);
        let start = Physical { x: rng.between(0.0, 5.0), xdot: rng.between(-10.0, 10.0) };
        // flight, then the geometric series of the bounces; the scheme loses energy on top
        let e = (1.0 - kappa) / (1.0 + kappa);
        let speed = (start.xdot.powi(2) + 2.0 * G * start.x).sqrt();
        let bound = (start.xdot + speed) / G + 2.0 * e * speed / (G * (1.0 - e));
        let limit = (bound / scheme.h) as u32 + 20;
        let case = format!("{scheme:?} from {start:?}");
        assert!(run_to_rest(scheme, start, limit).is_some(), "no rest with {case}");
        assert_stays(scheme);
    }
}

/// The tests above can fail: the midpoint member of the family never comes to rest.
#[test]
fn the_midpoint_member_chatters_instead() {
    let rng = Rng::new(63);
    for _ in 0..5 {
        let h = rng.between(1e-3, 1.1e-3);
        let scheme = Scheme { h, theta: 0.5, gamma: 0.5, kappa: 0.41 };
        assert!(run_to_rest(scheme, PAPER, (4.0 / h) as u32).is_none());
    }
}
