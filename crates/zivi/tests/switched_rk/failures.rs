//! Runs that fail: the reason is reported, and their results up to then are valid.

use zivi::{
    simulate_switched_rk, ConstantForce, Failure, Flights, Force, FunctionForce, LinearForce,
    Monitor, Order, Output, Physical, Quantity, Restitution, Silent, Status, SwitchedIntegrator,
    SwitchedRk, SwitchedRun,
};

use crate::problems::{settings, AnyForce};

const START: Physical = Physical { x: 1.0, xdot: 0.0 };
const ORDERS: [Order; 2] = [Order::Five, Order::Eight];

fn restitution() -> Restitution {
    Restitution::from_e(0.5).unwrap()
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Stop(f64);

struct Unobserved;

impl Monitor<Stop> for Unobserved {
    fn poll(&mut self, _: usize, _: usize) -> Result<(), Stop> {
        Ok(())
    }
}

fn run(settings: SwitchedRk, force: &mut dyn Force<Stop>, t_end: f64) -> SwitchedRun<Stop> {
    let output = Output { dense: true, ..Output::default() };
    let force = &mut AnyForce(force);
    simulate_switched_rk(
        settings,
        restitution(),
        force,
        (0.0, t_end),
        START,
        output,
        &mut Unobserved,
    )
    .unwrap()
}

fn last_time(run: &SwitchedRun<Stop>) -> f64 {
    *run.trajectory.columns.of(Quantity::T).last().unwrap()
}

/// Samples and dense output end at the same valid state.
fn assert_valid(run: &SwitchedRun<Stop>) {
    let of = |quantity| run.trajectory.columns.of(quantity);
    for (&t, (&x, &xdot)) in
        of(Quantity::T).iter().zip(of(Quantity::X).iter().zip(of(Quantity::Xdot)))
    {
        assert!(x >= 0.0 && x.is_finite() && xdot.is_finite(), "{t} {x} {xdot}");
    }
    let span = run.path.as_ref().unwrap().span().unwrap();
    assert_eq!(span, (0.0, last_time(run)));
}

#[test]
fn a_force_that_is_not_finite_ends_the_run_just_before() {
    for order in ORDERS {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            // in flight, at rest, and from the start
            for (from, first) in [(0.7, 0.69), (4.0, 3.0), (0.0, 0.0)] {
                let mut count = 0;
                let mut force = FunctionForce(|t: f64, _: f64, v: f64| {
                    count += 1;
                    Ok(if t >= from { bad } else { -9.81 - 0.1 * v })
                });
                let run = run(settings(order, 1e-8), &mut force, 5.0);
                assert_eq!(run.trajectory.status, Status::ForceNotFinite);
                assert!((first..=from).contains(&last_time(&run)), "{from} {}", last_time(&run));
                assert_valid(&run);
                assert!(count < 2000, "{count}");
            }
        }
    }
}

#[test]
fn an_error_of_the_force_is_handed_out_with_the_trajectory_so_far() {
    for order in ORDERS {
        for at in [0.0, 0.2, 0.6, 0.95, 4.5] {
            let mut force = FunctionForce(
                |t: f64, _: f64, _: f64| {
                    if t > at {
                        Err(Stop(t))
                    } else {
                        Ok(-9.81)
                    }
                },
            );
            let run = run(SwitchedRk { max_step: 0.1, ..settings(order, 1e-8) }, &mut force, 5.0);
            assert_eq!(run.trajectory.status, Status::Raised);
            let Some(Stop(t)) = run.raised else { panic!("nothing raised") };
            assert!(t > at && last_time(&run) <= t);
            assert!(last_time(&run) > at - 0.1001);
            assert_valid(&run);
        }
    }
}

#[test]
fn a_monitor_can_end_the_run_and_is_told_the_progress() {
    struct Curious(Vec<usize>, usize);
    impl Monitor<Stop> for Curious {
        fn poll(&mut self, done: usize, of: usize) -> Result<(), Stop> {
            self.0.push(done);
            self.1 = of;
            if self.0.len() == 3 {
                Err(Stop(done as f64))
            } else {
                Ok(())
            }
        }
    }
    let mut monitor = Curious(Vec::new(), 0);
    let settings = SwitchedRk { max_step: 1e-4, ..settings(Order::Eight, 1e-6) };
    let run = simulate_switched_rk(
        settings,
        restitution(),
        &mut ConstantForce(-9.81),
        (0.0, 0.4),
        START,
        Output::default(),
        &mut monitor,
    )
    .unwrap();
    assert_eq!(run.trajectory.status, Status::Raised);
    assert!(monitor.0.windows(2).all(|pair| pair[0] <= pair[1]) && monitor.0[2] < monitor.1);
    assert_eq!(run.raised, Some(Stop(monitor.0[2] as f64)));
    let progress = last_time(&run) / 0.4 * monitor.1 as f64;
    assert!((progress - monitor.0[2] as f64).abs() < 2.0);
}

#[test]
fn a_long_chain_exhausts_its_budget_and_can_be_resumed() {
    let restitution = Restitution::from_e(0.99).unwrap();
    let settings = SwitchedRk { max_impacts: 50, ..settings(Order::Eight, 1e-8) };
    let mut force = LinearForce {
        stiffness: 0.0,
        damping: 0.3,
        gravity: 9.81,
        amplitude: 3.0,
        omega: 5.0,
        phase: 0.0,
    };
    let mut integrator = SwitchedIntegrator::new(settings, restitution).unwrap();
    integrator.start(0.0, START).unwrap();
    let mut budgets = 0;
    loop {
        match integrator.resume_to::<Stop, _>(50.0, &mut force) {
            Ok(()) => break,
            Err(failure) => assert_eq!(failure, Failure::Status(Status::ZenoBudget)),
        }
        assert_eq!(integrator.state().x, 0.0);
        assert!(integrator.state().xdot > 0.0);
        budgets += 1;
        assert!(budgets < 100);
    }
    // every 50 impacts the impact sequence starts again: the floor ends it
    assert!(budgets > 5 && integrator.is_at_rest() && integrator.t() == 50.0);
    // within its budget the same run needs none of that
    let whole = SwitchedRk { max_impacts: 3000, ..settings };
    let mut integrator = SwitchedIntegrator::new(whole, restitution).unwrap();
    integrator.start(0.0, START).unwrap();
    assert_eq!(integrator.advance_to::<Stop, _>(50.0, &mut force), Ok(()));
    assert!(integrator.is_at_rest());
}

#[test]
fn a_budget_of_steps_ends_the_run_and_can_be_resumed() {
    let flights = Flights::RungeKutta;
    let small = SwitchedRk { max_step: 0.01, flights, ..SwitchedRk::default() };
    let settings = SwitchedRk { max_steps: 40, ..small };
    let stopped = run(settings, &mut ConstantForce(-9.81), 1.0);
    assert_eq!(stopped.trajectory.status, Status::StepBudget);
    assert!((last_time(&stopped) - 0.4).abs() < 1e-12);
    assert_valid(&stopped);
    let mut integrator = SwitchedIntegrator::new(settings, restitution()).unwrap();
    integrator.start(0.0, START).unwrap();
    let mut parts = 1;
    while integrator.resume_to::<Stop, _>(0.9, &mut ConstantForce(-9.81)).is_err() {
        parts += 1;
        assert!(parts < 10);
    }
    let whole = run(small, &mut ConstantForce(-9.81), 0.9);
    let x = *whole.trajectory.columns.of(Quantity::X).last().unwrap();
    assert!(parts > 2 && (integrator.state().x - x).abs() < 1e-13);
}

#[test]
fn a_singularity_ends_the_run() {
    // x'' = x^3 from 10 m escapes to infinity at a finite time
    for order in ORDERS {
        let mut force = FunctionForce(|_: f64, x: f64, _: f64| Ok(x.powi(3)));
        let start = Physical { x: 10.0, xdot: 0.0 };
        let run = simulate_switched_rk(
            settings(order, 1e-6),
            restitution(),
            &mut force,
            (0.0, 10.0),
            start,
            Output::<Stop>::default(),
            &mut Unobserved,
        )
        .unwrap();
        assert_eq!(run.trajectory.status, Status::StepSizeTooSmall, "{order:?}");
        // int_10^inf dx/sqrt((x^4 - 10^4)/2) = 1.31103/10 sqrt 2
        assert!((last_time(&run) - 0.185_407_467_7).abs() < 1e-4, "{}", last_time(&run));
    }
}

#[test]
fn forces_that_jump_in_time_are_passed() {
    // x'' = -1 then +1 from t = 0.5, from 1 m: x(1) = 1 - 0.25 + ...
    for order in ORDERS {
        let mut force =
            FunctionForce(|t: f64, _: f64, _: f64| Ok(if t < 0.5 { -1.0 } else { 1.0 }));
        let run = run(settings(order, 1e-9), &mut force, 1.0);
        let x = *run.trajectory.columns.of(Quantity::X).last().unwrap();
        assert_eq!(run.trajectory.status, Status::Completed);
        assert!((x - 0.75).abs() < 1e-7, "{x}");
    }
}

#[test]
fn spans_and_sample_times_are_checked() {
    let try_with = |span, t_eval: Option<&[f64]>| {
        let output = Output { t_eval, ..Output::default() };
        let force = &mut ConstantForce(-9.81);
        simulate_switched_rk(
            SwitchedRk::default(),
            restitution(),
            force,
            span,
            START,
            output,
            &mut Silent,
        )
        .map(|_| ())
    };
    assert!(try_with((0.0, 1.0), Some(&[0.0, 0.5, 1.0])).is_ok());
    assert!(try_with((0.0, 1.0), Some(&[])).is_ok());
    for span in [(0.0, 0.0), (1.0, 0.0), (0.0, f64::NAN), (0.0, f64::INFINITY)] {
        assert!(try_with(span, None).is_err());
    }
    for bad in [&[-0.1][..], &[1.1], &[0.5, 0.5], &[0.5, 0.4], &[f64::NAN]] {
        let message = try_with((0.0, 1.0), Some(bad)).unwrap_err().to_string();
        assert!(message.starts_with("t_eval must be"), "{message}");
    }
}

#[test]
fn impacts_without_a_pull_at_the_wall_end_with_a_status() {
    // both accumulate, but the pull f(t, 0, 0) that the expansion needs is zero
    type Law = fn(f64) -> f64;
    let laws: [Law; 2] = [|x| if x > 0.0 { -9.81 } else { 0.0 }, |x| -x.abs().sqrt()];
    for order in ORDERS {
        for law in laws {
            let mut count = 0;
            let mut force = FunctionForce(|_: f64, x: f64, _: f64| {
                count += 1;
                Ok(law(x))
            });
            let run = run(settings(order, 1e-8), &mut force, 1000.0);
            assert_eq!(run.trajectory.status, Status::ZenoBudget);
            assert!(run.trajectory.events.zeno_times.is_empty());
            assert_valid(&run);
            assert!(count < 20_000, "{count}");
        }
        // equal flights are none of that, however slow
        let mut spring = FunctionForce(|_: f64, x: f64, _: f64| Ok(-x));
        let run = run(settings(order, 1e-4), &mut spring, 1200.0);
        assert_eq!(run.trajectory.status, Status::Completed);
        assert!(run.trajectory.events.impacts.len() > 150);
    }
}
