//! The sampled loop itself: what is measured, told, delayed, held and recorded.

use zivi::drive::closed_loop::{
    simulate_closed_loop, AnyController, Controller, Forces, Loop, LoopRun, Motion, Sensor, Tick,
    TickError, REFUSED,
};
use zivi::{Grid, LinearForce, Monitor, Physical, Restitution, SetupError, Status, SwitchedRk};
use zivi_core::control::{Gains, TickStatus, TwistingRegulator};
use zivi_core::SettingError;

const U: usize = 5;

/// Errors of a controller or a force.
type Raised = &'static str;

struct Nobody;

impl Monitor<Raised> for Nobody {
    fn poll(&mut self, _: usize, _: usize) -> Result<(), Raised> {
        Ok(())
    }
}

/// Gives prepared controls: `None` refuses the sample.
struct Scripted {
    controls: Vec<Option<f64>>,
    seen: Vec<Tick>,
    reference: Option<Physical>,
}

impl Scripted {
    fn new(controls: &[Option<f64>]) -> Self {
        Self { controls: controls.to_vec(), seen: Vec::new(), reference: None }
    }

    fn given(controls: &[f64]) -> Self {
        Self::new(&controls.iter().copied().map(Some).collect::<Vec<_>>())
    }
}

impl Controller<Raised> for Scripted {
    fn tick(&mut self, tick: Tick) -> Result<f64, TickError<Raised>> {
        let control = self.controls[self.seen.len() % self.controls.len()];
        self.seen.push(tick);
        let refusal = SettingError { name: "x", value: tick.measured.x, range: "another" };
        let u = control.ok_or(TickError::Refused(refusal))?;
        if u.is_nan() {
            return Err(TickError::Raised("no control"));
        }
        Ok(u)
    }

    fn reference(&self) -> Option<Physical> {
        self.reference
    }
}

fn pull(gravity: f64) -> LinearForce {
    spring(0.0, gravity)
}

fn spring(stiffness: f64, gravity: f64) -> LinearForce {
    LinearForce { stiffness, damping: 0.0, gravity, amplitude: 0.0, omega: 0.0, phase: 0.0 }
}

const SCHEME: Motion = Motion::Scheme { theta: 1.0, gamma: 1.0 };

fn motions() -> [Motion; 3] {
    let precise = SwitchedRk::with_tol(1e-11);
    [Motion::Exact(precise), Motion::Switched(precise), SCHEME]
}

fn around(motion: Motion, end: f64, h: f64, initial: Physical) -> Loop<'static> {
    let restitution = Restitution::from_e(0.5).expect("in range");
    let grid = Grid::new(0.0, end, h).expect("a grid");
    Loop { restitution, grid, initial, motion, sensor: Sensor::default(), observer: None, delay: 0 }
}

/// The loop with the same force for plant, model and reference.
fn run(controller: &mut Scripted, around: Loop<'_>, force: LinearForce) -> LoopRun<Raised> {
    let [mut plant, mut model, mut reference] = [force; 3];
    let forces = Forces { plant: &mut plant, model: &mut model, reference: &mut reference };
    simulate_closed_loop(controller, around, forces, &mut Nobody).expect("a good set-up")
}

const HIGH: Physical = Physical { x: 10.0, xdot: 0.0 };

/// The control of sample `k` acts `delay` periods later, and nothing until the first does.
#[test]
fn a_control_acts_after_its_delay() {
    let controls = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    for (delay, acting) in [
        (0, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 6.0]),
        (1, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 5.0]),
        (4, [0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 2.0]),
    ] {
        let it = Loop { delay, ..around(SCHEME, 0.6, 0.1, HIGH) };
        assert_eq!(run(&mut Scripted::given(&controls), it, pull(9.81)).columns[U], acting);
    }
    let it = Loop { delay: 7, ..around(SCHEME, 0.6, 0.1, HIGH) };
    let [mut plant, mut model, mut reference] = [pull(1.0); 3];
    let forces = Forces { plant: &mut plant, model: &mut model, reference: &mut reference };
    let refused = simulate_closed_loop(&mut Scripted::given(&controls), it, forces, &mut Nobody);
    assert!(matches!(refused, Err(SetupError::Count("delay", 7, _))), "longer than the run");
}

/// Where a sample is rejected the newest control is repeated, not the one that acts at the moment.
#[test]
fn a_refused_sample_repeats_the_newest_control() {
    let controls = [Some(1.0), Some(2.0), None, None, Some(5.0), None, Some(7.0), Some(8.0)];
    for (delay, acting) in [
        (0, [1.0, 2.0, 2.0, 2.0, 5.0, 5.0, 7.0, 8.0, 8.0]),
        (1, [0.0, 1.0, 2.0, 2.0, 2.0, 5.0, 5.0, 7.0, 7.0]),
        (2, [0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 5.0, 5.0, 5.0]),
        (3, [0.0, 0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 5.0, 5.0]),
    ] {
        let it = Loop { delay, ..around(SCHEME, 0.8, 0.1, HIGH) };
        let run = run(&mut Scripted::new(&controls), it, pull(9.81));
        assert_eq!(run.columns[U], acting, "delay {delay}");
        assert_eq!(run.ticks, [0, 0, REFUSED, REFUSED, 0, REFUSED, 0, 0, 0]);
    }
    // before there is any: nothing acts
    let run = run(&mut Scripted::new(&[None]), around(SCHEME, 0.2, 0.1, HIGH), pull(1.0));
    assert_eq!(run.columns[U], [0.0; 3]);
}

/// Free fall from 10 m under held controls: the last period has the length of the rest of the span.
#[test]
fn the_last_period_ends_with_the_span() {
    let controls = [0.5, -1.0, 2.0];
    for motion in motions() {
        let it = around(motion, 0.25, 0.1, HIGH);
        let run = run(&mut Scripted::given(&controls), it, pull(1.0));
        let (mut x, mut v, mut t) = (10.0, 0.0, 0.0);
        for (u, h) in controls.into_iter().zip([0.1, 0.1, 0.05]) {
            let (a, before) = (u - 1.0, v);
            v += h * a;
            // implicit Euler moves with the new velocity, the exact motion with the mean
            x += h * if matches!(motion, Motion::Scheme { .. }) { v } else { 0.5 * (v + before) };
            t += h;
        }
        let [times, xs, vs, ..] = &run.columns;
        assert!((times[3] - t).abs() < 1e-15 && times.len() == 4);
        assert!((xs[3] - x).abs() < 1e-13, "{motion:?}: {} but {x}", xs[3]);
        assert!((vs[3] - v).abs() < 1e-13, "{motion:?}: {} but {v}", vs[3]);
    }
}

/// The exact motion and the integrated one of the same loop, through impacts and rest.
#[test]
fn two_ways_of_moving_agree() {
    let controls = [3.0, -8.0, -60.0, -60.0, 15.0, -60.0, -60.0, -60.0];
    let start = Physical { x: 0.4, xdot: -1.0 };
    let [exact, switched, _] = motions().map(|motion| {
        let it = around(motion, 1.6, 0.2, start);
        run(&mut Scripted::given(&controls), it, pull(9.81))
    });
    for (one, other) in exact.columns.iter().zip(&switched.columns).take(3) {
        assert_eq!(one.len(), 9);
        for (a, b) in one.iter().zip(other) {
            assert!((a - b).abs() < 1e-8, "{a} {b}");
        }
    }
    let [one, other] = [&exact.events, &switched.events];
    assert!((one.rest_time.expect("rest") - other.rest_time.expect("rest")).abs() < 1e-8);
    assert_eq!((one.liftoff_times.len(), other.liftoff_times.len()), (1, 1));
    assert_eq!(exact.nfev, 1);
}

/// Inputs of a controller: the measured state, its model's force there, and the reference's
/// force at the reference; while the true force moves the plant.
#[test]
fn a_controller_is_told_of_its_models() {
    let (noise_x, noise_xdot) = ([0.25; 4], [-0.5; 4]);
    let sensor = Sensor { noise_x: &noise_x, noise_xdot: &noise_xdot, resolution: (0.5, 0.0) };
    let it = Loop { sensor, ..around(SCHEME, 0.3, 0.1, HIGH) };
    let mut controller = Scripted::given(&[0.0]);
    controller.reference = Some(Physical { x: 3.0, xdot: 1.0 });
    let [mut plant, mut model, mut reference] = [pull(1.0), spring(2.0, 0.0), spring(4.0, 0.5)];
    let forces = Forces { plant: &mut plant, model: &mut model, reference: &mut reference };
    let run = simulate_closed_loop(&mut controller, it, forces, &mut Nobody).expect("set up");
    for (k, tick) in controller.seen.iter().enumerate() {
        let (x, v) = (run.columns[1][k], run.columns[2][k]);
        let seen = ((x + 0.25) / 0.5).round() * 0.5;
        assert_eq!(tick.measured, Physical { x: seen, xdot: v - 0.5 });
        assert_eq!((tick.force, tick.force_ref), (-2.0 * seen, -12.5));
        assert_eq!((run.columns[3][k], run.columns[4][k]), (3.0, 1.0));
        assert!((v + 0.1 * k as f64).abs() < 1e-14, "the true force moves the plant");
    }
    assert_eq!(controller.seen.len(), 3);
    // without a reference nothing is told of one, and nothing is recorded
    let mut alone = Scripted::given(&[0.0]);
    let run = self::run(&mut alone, around(SCHEME, 0.3, 0.1, HIGH), spring(4.0, 0.5));
    assert!(alone.seen.iter().all(|tick| tick.force_ref == 0.0));
    assert!(run.columns[3..5].iter().flatten().all(|it| it.is_nan()));
}

/// A mass that is lifted in every other period is not at rest; one that stays a whole period is.
#[test]
fn rest_is_what_lasts_a_period() {
    let start = Physical::default();
    let ringing = [5.0, -60.0, 5.0, -60.0, -60.0, -60.0];
    let rest = |periods: f64| {
        let it = around(motions()[0], 0.1 * periods, 0.1, start);
        let run = run(&mut Scripted::given(&ringing), it, pull(0.0));
        assert_eq!(run.columns[1].last(), Some(&0.0));
        (run.events.zeno_times.last().copied(), run.events.rest_time)
    };
    let (zeno, at_the_end) = rest(4.0);
    let zeno = zeno.expect("through impacts");
    assert!((0.3..0.4).contains(&zeno) && at_the_end.is_none());
    assert_eq!((rest(5.0).1, rest(5.5).1), (Some(zeno), Some(zeno)));
    assert_eq!((rest(10.0 * zeno + 0.999).1, rest(10.0 * zeno + 1.001).1), (None, Some(zeno)));
    // at rest from its start, however short the run
    for periods in [0.3, 1.0, 2.5] {
        let it = around(motions()[0], 0.1 * periods, 0.1, start);
        let run = run(&mut Scripted::given(&[-1.0]), it, pull(0.0));
        assert_eq!(run.events.rest_time, Some(0.0));
    }
}

#[test]
fn what_goes_wrong_ends_the_run_and_keeps_it() {
    for motion in motions() {
        let it = around(motion, 1.0, 0.1, HIGH);
        let raised = run(&mut Scripted::given(&[1.0, 1.0, f64::NAN]), it, pull(1.0));
        assert_eq!((raised.status, raised.raised), (Status::Raised, Some("no control")));
        assert_eq!((raised.columns[0].len(), raised.ticks.len()), (3, 3));
        let it = around(motion, 10.0, 1.0, HIGH);
        let overflown = run(&mut Scripted::given(&[1.0, 1.7e308, 1.7e308]), it, pull(1.0));
        assert_ne!(overflown.status, Status::Completed, "{motion:?}");
        assert!(overflown.columns[1].iter().all(|x| x.is_finite()));
    }
    let it = around(SCHEME, 1.0, 0.1, Physical { x: -1.0, xdot: 0.0 });
    let [mut plant, mut model, mut reference] = [pull(1.0); 3];
    let forces = Forces { plant: &mut plant, model: &mut model, reference: &mut reference };
    let refused = simulate_closed_loop(&mut Scripted::given(&[0.0]), it, forces, &mut Nobody);
    assert!(refused.is_err());
}

/// A controller of the library as one of several kinds is the same controller.
#[test]
fn any_controller_is_the_one_it_holds() {
    let restitution = Restitution::from_e(0.5).expect("in range");
    let gains = Gains::new(30.0, 17.0).expect("in range");
    let mut alone = TwistingRegulator::new(gains, 1e-2, restitution).expect("admissible");
    let mut held = AnyController::Regulator(alone);
    assert_eq!(held.h(), 1e-2);
    for (x, xdot) in [(1.0, 0.3), (0.0, 0.0), (-0.01, 0.2), (-1.0, 0.0)] {
        let measured = Physical { x, xdot };
        let tick = Tick { t: 0.0, measured, force: -9.81, force_ref: 0.0 };
        let one = Controller::<Raised>::tick(&mut alone, tick);
        assert_eq!(one, Controller::<Raised>::tick(&mut held, tick));
        assert_eq!(one.is_err(), x < -0.1);
        let bits = |it: &dyn Controller<Raised>| (it.signs().map(f64::to_bits), it.status());
        assert_eq!(bits(&alone), bits(&held));
    }
    let status: TickStatus = Controller::<Raised>::status(&held);
    assert!(status.clamped, "of the last tick that was not refused");
}
