//! Moreau-Jean time stepping: its equations put back, its order, its rest, its known faults.

use zivi::{
    simulate_moreau_jean, ConstantForce, Events, Force, FunctionForce, Grid, LinearForce, Monitor,
    MoreauJean, Physical, Quantity, Restitution, Silent, Status, Trajectory,
};

fn simulate(theta: f64, e: f64, force: LinearForce, grid: Grid, start: Physical) -> Trajectory {
    let restitution = Restitution::from_e(e).unwrap();
    let method = MoreauJean { theta };
    simulate_moreau_jean(method, restitution, &mut force.clone(), grid, start, &mut Silent)
        .unwrap()
        .trajectory
}

fn gravity(g: f64) -> LinearForce {
    LinearForce { stiffness: 0.0, damping: 0.0, gravity: g, amplitude: 0.0, omega: 1.0, phase: 0.0 }
}

/// Uniform numbers in [0, 1) (xorshift64*).
struct Random(u64);

impl Random {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        let bits = self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11;
        low + (high - low) * bits as f64 / (1u64 << 53) as f64
    }
}

#[test]
fn every_step_satisfies_the_equations() {
    let mut random = Random(1);
    for case in 0..300 {
        let force = LinearForce {
            stiffness: 10f64.powf(random.between(-2.0, 5.0)),
            damping: 10f64.powf(random.between(-2.0, 3.0)),
            gravity: random.between(-5.0, 20.0),
            amplitude: random.between(0.0, 30.0),
            omega: random.between(0.1, 20.0),
            phase: 0.0,
        };
        let force = if case % 3 == 0 {
            LinearForce { stiffness: 0.0, damping: 0.0, ..force }
        } else {
            force
        };
        let (theta, e) = (random.between(0.5, 1.0), random.between(0.0, 1.0));
        let theta = if case % 10 == 0 { 1.0 } else { theta };
        let (h, start) =
            (1e-3, Physical { x: random.between(0.0, 0.1), xdot: random.between(-2.0, 2.0) });
        let sol = simulate(theta, e, force, Grid::new(0.0, 0.4, h).unwrap(), start);
        assert_eq!(sol.status, Status::Completed, "{force:?} {theta}");
        let of = |quantity| sol.columns.of(quantity);
        let (t, x, v) = (of(Quantity::T), of(Quantity::X), of(Quantity::Xdot));
        let at = |k: usize| {
            let Ok::<f64, ()>(f) = force.clone().at(t[k], x[k], v[k]) else { unreachable!() };
            f
        };
        for k in 1..t.len() {
            let f = theta * at(k) + (1.0 - theta) * at(k - 1);
            let impulse = v[k] - v[k - 1] - h * f;
            let scale =
                1e-12 * (v[k].abs() + v[k - 1].abs() + h * at(k).abs() + h * at(k - 1).abs());
            if x[k - 1] + 0.5 * h * v[k - 1] <= 0.0 {
                let gap = v[k] + e * v[k - 1];
                assert!(impulse >= -scale && gap >= -scale, "{case} {k}");
                assert!(impulse.min(gap) <= scale, "{case} {k}: {impulse:e} {gap:e}");
            } else {
                assert!(impulse.abs() <= scale, "{case} {k}: {impulse:e} {scale:e}");
            }
            let moved = x[k] - x[k - 1] - h * (theta * v[k] + (1.0 - theta) * v[k - 1]);
            assert!(moved.abs() < 1e-15 + 1e-15 * x[k].abs());
        }
        for impact in &sol.events.impacts {
            assert!(
                (impact.xdot_after + e * impact.xdot_before).abs()
                    < 1e-15 * impact.xdot_before.abs()
            );
        }
    }
}

#[test]
fn flight_is_of_second_order_at_one_half_and_impacts_are_of_first() {
    // x'' = -x - 0.1 x' + sin-like forcing, in flight only
    let force = LinearForce {
        stiffness: 1.0,
        damping: 0.1,
        gravity: -3.0,
        amplitude: 0.5,
        omega: 2.0,
        phase: 0.3,
    };
    let end = |theta, h| {
        let sol = simulate(
            theta,
            0.5,
            force,
            Grid::new(0.0, 4.0, h).unwrap(),
            Physical { x: 2.0, xdot: 1.0 },
        );
        *sol.columns.of(Quantity::X).last().unwrap()
    };
    for (theta, order) in [(0.5, 2.0), (1.0, 1.0), (0.0, 1.0), (0.8, 1.0)] {
        let (a, b, c) = (end(theta, 0.02), end(theta, 0.01), end(theta, 0.005));
        let seen = ((a - b) / (b - c)).log2();
        assert!((seen - order).abs() < 0.1, "{theta}: {seen}");
    }
    // ball: the position after two impacts
    let error = |h| {
        let sol = simulate(
            0.5,
            0.5,
            gravity(2.0),
            Grid::new(0.0, 2.25, h).unwrap(),
            Physical { x: 1.0, xdot: 0.0 },
        );
        (*sol.columns.of(Quantity::X).last().unwrap() - 0.0625).abs()
    };
    let jittered =
        |h: f64| (0..7).map(|i| error(h * (1.0 + 0.037 * f64::from(i)))).sum::<f64>() / 7.0;
    let order = (jittered(1e-2) / jittered(1e-4)).log2() / 100f64.log2();
    assert!((order - 1.0).abs() < 0.3, "{order}");
}

#[test]
fn the_ball_passes_its_zeno_point_and_penetrates() {
    // x0 = 1, x0' = 6, kappa = 0.41: rest at 2.46584...
    let e = 0.59 / 1.41;
    for (theta, deepest, rest) in [(0.5, 3.3e-3, 2.477), (1.0, 3.6e-4, 2.47)] {
        let grid = Grid::new(0.0, 4.0, 1e-3).unwrap();
        let sol = simulate(theta, e, gravity(9.81), grid, Physical { x: 1.0, xdot: 6.0 });
        let low = sol.columns.of(Quantity::X).iter().fold(0.0_f64, |a, &b| a.min(b));
        assert!((low / -deepest - 1.0).abs() < 0.6, "{theta}: {low}");
        assert!(
            (sol.events.rest_time.unwrap() - rest).abs() < 0.02,
            "{theta} {:?}",
            sol.events.rest_time
        );
        assert_eq!(sol.events.zeno_times.len(), 1);
        assert_eq!(sol.nfev, 1);
        assert!(sol.columns.of(Quantity::Xdot).last().unwrap().abs() < 1e-12);
    }
}

#[test]
fn rest_ends_with_the_force_that_lifts() {
    // f = -1 + t
    let restitution = Restitution::from_e(0.5).unwrap();
    let grid = Grid::new(0.0, 2.0, 1e-3).unwrap();
    let mut ramp = FunctionForce(|t: f64, _: f64, _: f64| Ok(t - 1.0));
    let run = simulate_moreau_jean(
        MoreauJean::default(),
        restitution,
        &mut ramp,
        grid,
        Physical::default(),
        &mut Silent,
    );
    let sol = run.unwrap().trajectory;
    assert!((sol.events.liftoff_times[0] - 1.0).abs() < 5e-4, "{:?}", sol.events);
    assert_eq!((sol.events.zeno_times.len(), sol.events.rest_time), (0, None));
    assert!((sol.columns.of(Quantity::X).last().unwrap() - 1.0 / 6.0).abs() < 1e-3);
    // two evaluations a step: a force that is not said to depend on time alone is checked
    assert!(sol.nfev < 2 * 2000 + 10, "{}", sol.nfev);
}

#[test]
fn an_elastic_ball_keeps_its_energy_at_one_half() {
    let grid = Grid::new(0.0, 20.0, 1e-3).unwrap();
    let sol = simulate(0.5, 1.0, gravity(9.81), grid, Physical { x: 1.0, xdot: 0.0 });
    let (x, v) = (sol.columns.of(Quantity::X), sol.columns.of(Quantity::Xdot));
    for (x, v) in x.iter().zip(v) {
        // the velocity turns at the end of a step: h |v| g at most is lost or won, and won again
        assert!((0.5 * v * v + 9.81 * x - 9.81).abs() < 0.15);
    }
    assert!(sol.events.impacts.len() > 20 && sol.events.rest_time.is_none());
}

#[test]
fn samples_are_on_a_branch() {
    let e = 0.5;
    let sol = simulate(
        0.5,
        e,
        gravity(9.81),
        Grid::new(0.0, 3.0, 1e-3).unwrap(),
        Physical { x: 1.0, xdot: 0.0 },
    );
    let kappa = (1.0 - e) / (1.0 + e);
    let of = |quantity| sol.columns.of(quantity);
    let (x, xdot, s, v) = (of(Quantity::X), of(Quantity::Xdot), of(Quantity::S), of(Quantity::V));
    let (lambda_s, lambda_v) = (of(Quantity::LambdaS), of(Quantity::LambdaV));
    let mut sigma = 1.0;
    for k in 0..x.len() {
        let t = of(Quantity::T)[k];
        sigma = if sol.events.impacts.iter().filter(|it| it.t <= t).count() % 2 == 0 {
            1.0
        } else {
            -1.0
        };
        assert_eq!(s[k], sigma * x[k] + 0.0);
        assert!(
            (v[k] - sigma * xdot[k] / (1.0 - kappa * xdot[k].signum())).abs() <= 1e-15 * v[k].abs()
        );
        assert!(
            lambda_s[k] == 0.0
                || (lambda_s[k] == sigma
                    && lambda_v[k] * sigma == if xdot[k] == 0.0 { 0.0 } else { xdot[k].signum() })
        );
        assert!(of(Quantity::Residual)[k].is_nan());
    }
    assert!(sigma.abs() == 1.0 && lambda_s.last() == Some(&0.0));
}

#[test]
fn failures_are_reported() {
    struct Unobserved;
    impl Monitor<&'static str> for Unobserved {
        fn poll(&mut self, _: usize, _: usize) -> Result<(), &'static str> {
            Ok(())
        }
    }
    let restitution = Restitution::from_e(0.5).unwrap();
    let (grid, start) = (Grid::new(0.0, 1.0, 1e-2).unwrap(), Physical { x: 1.0, xdot: 0.0 });
    let run = |f: &mut dyn FnMut(f64, f64, f64) -> Result<f64, &'static str>| {
        let run = simulate_moreau_jean(
            MoreauJean::default(),
            restitution,
            &mut FunctionForce(f),
            grid,
            start,
            &mut Unobserved,
        );
        run.unwrap()
    };
    let nan = run(&mut |t, _, _| Ok(if t > 0.5 { f64::NAN } else { -1.0 }));
    assert_eq!(nan.trajectory.status, Status::ForceNotFinite);
    assert!((nan.trajectory.columns.of(Quantity::T).last().unwrap() - 0.5).abs() < 2e-2);
    let raised = run(&mut |t, _, _| if t > 0.5 { Err("no more") } else { Ok(-1.0) });
    assert_eq!((raised.trajectory.status, raised.raised), (Status::Raised, Some("no more")));
    // no force fits the state that it gives
    let mut sign = |_: f64, _: f64, v: f64| Ok(if v < -0.5 { 50.0 } else { -50.0 });
    assert_eq!(run(&mut sign).trajectory.status, Status::ForceNotConverged);
    let blown = run(&mut |_, x, _| Ok(1e200 * x.abs()));
    assert_ne!(blown.trajectory.status, Status::Completed);
    for theta in [-0.1, 1.1, f64::NAN] {
        let refused = simulate_moreau_jean(
            MoreauJean { theta },
            restitution,
            &mut ConstantForce(-1.0),
            grid,
            start,
            &mut Silent,
        );
        assert!(refused.unwrap_err().to_string().starts_with("theta must be"));
    }
}

/// A force that depends on time, and how often it is evaluated.
fn timed(e: f64, t1: f64, start: Physical, law: impl Fn(f64) -> f64) -> (Trajectory, u64) {
    let mut calls = 0;
    let mut force = FunctionForce(|t: f64, _: f64, _: f64| {
        calls += 1;
        Ok::<f64, std::convert::Infallible>(law(t))
    });
    let (restitution, grid) = (Restitution::from_e(e).unwrap(), Grid::new(0.0, t1, 1e-3).unwrap());
    let method = MoreauJean::default();
    let run = simulate_moreau_jean(method, restitution, &mut force, grid, start, &mut Silent);
    (run.unwrap().trajectory, calls)
}

#[test]
fn rest_from_the_start_is_rest_without_a_zeno_point() {
    let grid = Grid::new(0.0, 1.0, 1e-3).unwrap();
    let sol = simulate(0.5, 0.5, gravity(9.81), grid, Physical::default());
    assert!(sol.columns.of(Quantity::X).iter().all(|&x| x == 0.0));
    assert_eq!((sol.events.rest_time, sol.events.zeno_times.len()), (Some(0.0), 0));
    // slower than h g: it settles in a few steps, without an impact
    let sol = simulate(0.5, 0.5, gravity(9.81), grid, Physical { x: 0.0, xdot: 1e-3 });
    let Events { rest_time, zeno_times, impacts, .. } = sol.events;
    assert!(rest_time.is_some_and(|t| t > 0.0 && t < 5e-3), "{rest_time:?}");
    assert!(zeno_times.is_empty() && impacts.is_empty());
}

#[test]
fn rest_again_without_impacts_is_no_second_zeno_point() {
    // at rest from 1.36 s, pulled off for five steps, too gently for an impact
    let pulse = |t: f64| if (2.0..2.005).contains(&t) { 1e-3 } else { -9.81 };
    let (sol, calls) = timed(0.5, 3.0, Physical { x: 1.0, xdot: 0.0 }, pulse);
    let events = &sol.events;
    assert_eq!((events.liftoff_times.len(), events.zeno_times.len()), (1, 1), "{events:?}");
    assert!(events.rest_time.is_some_and(|t| t > 2.0));
    assert!(events.impacts.iter().all(|impact| impact.t < 1.5));
    assert_eq!(sol.nfev, calls);
}
