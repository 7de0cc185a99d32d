//! The controllers as they are used: a sequence of updates.

use crate::common::control::{random_wall, stable};
use crate::common::Rng;
use zivi_core::control::{
    Approach, ExplicitTwisting, Gains, Port, TickStatus, TwistingRegulator, TwistingTracker,
};
use zivi_core::{Physical, Restitution, SettingError};

/// A sample that is missing before the first one: the actuator cannot give 0.
#[test]
fn a_missing_sample_holds_a_control_within_the_limits() {
    let port = Port::default().with_actuator(2.0, 5.0).expect("admissible");
    for it in Controller::of_the_paper(port) {
        let held = match it {
            Controller::Regulator(mut it) => it.miss(),
            Controller::Tracker(mut it) => it.miss(-9.81).expect("admissible"),
            Controller::Explicit(mut it) => it.miss(-9.81).expect("admissible"),
        };
        assert_eq!(held, 2.0);
    }
}

/// What an update is given.
#[derive(Clone, Copy, Debug)]
struct Sample {
    x: f64,
    xdot: f64,
    force: f64,
    force_ref: f64,
}

/// One of the controllers.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Controller {
    Regulator(TwistingRegulator),
    Tracker(TwistingTracker),
    Explicit(ExplicitTwisting),
}

impl Controller {
    /// One of each kind, the tracker with both approaches, all with the same settings.
    fn all(
        gains: Gains,
        h: f64,
        restitutions: [Restitution; 2],
        port: Port,
        start: Physical,
    ) -> [Self; 4] {
        let [restitution, restitution_ref] = restitutions;
        let tracker = |approach| {
            let new = TwistingTracker::new(gains, h, restitution, restitution_ref, approach);
            let mut it = new.expect("admissible").with_port(port);
            it.reset(start).expect("admissible");
            Self::Tracker(it)
        };
        let regulator = TwistingRegulator::new(gains, h, restitution).expect("admissible");
        let explicit =
            ExplicitTwisting::new(gains, h, restitution, restitution_ref).expect("admissible");
        let mut explicit = explicit.with_port(port);
        explicit.reset(start).expect("admissible");
        [
            Self::Regulator(regulator.with_port(port)),
            tracker(Approach::Positive),
            tracker(Approach::Nearest),
            Self::Explicit(explicit),
        ]
    }

    /// All with the paper's settings.
    fn of_the_paper(port: Port) -> [Self; 4] {
        let restitutions = [half(), half()];
        Self::all(gains_of_the_paper(), 1e-3, restitutions, port, Physical { x: 3.0, xdot: 3.0 })
    }

    fn tick(&mut self, at: Sample) -> Result<f64, SettingError> {
        let measured = Physical { x: at.x, xdot: at.xdot };
        match self {
            Self::Regulator(it) => it.tick(measured, at.force),
            Self::Tracker(it) => it.tick(measured, at.force, at.force_ref),
            Self::Explicit(it) => it.tick(measured, at.force, at.force_ref),
        }
    }

    fn status(&self) -> TickStatus {
        match self {
            Self::Regulator(it) => it.state().status,
            Self::Tracker(it) => it.state().status,
            Self::Explicit(it) => it.state().status,
        }
    }

    /// Every number of the state.
    fn numbers(&self) -> Vec<f64> {
        let all = |s: f64, v: f64, rest: [f64; 2], signs: &[f64]| {
            [s, v].into_iter().chain(rest).chain(signs.iter().copied()).collect()
        };
        let tracker = |it: zivi_core::control::TrackerState| {
            all(it.reference.s, it.reference.v, [it.side, it.u], &it.signs)
        };
        match self {
            Self::Regulator(it) => all(0.0, 0.0, [0.0, it.state().u], &it.state().signs),
            Self::Tracker(it) => tracker(it.state()),
            Self::Explicit(it) => tracker(it.state()),
        }
    }

    fn bits(&self) -> Vec<u64> {
        let status = u64::from(self.status().bits());
        self.numbers().into_iter().map(f64::to_bits).chain([status]).collect()
    }

    fn has_reference(&self) -> bool {
        !matches!(self, Self::Regulator(_))
    }
}

fn half() -> Restitution {
    Restitution::from_kappa(0.5).expect("in range")
}

fn gains_of_the_paper() -> Gains {
    Gains::new(30.0, 17.0).expect("stable")
}

/// Controls, `None` where the sample was refused.
fn run(controller: &mut Controller, samples: &[Sample]) -> Vec<Option<u64>> {
    samples.iter().map(|&at| controller.tick(at).ok().map(f64::to_bits)).collect()
}

/// Samples of all kinds, some of them rejected.
fn samples(rng: &Rng, count: usize) -> Vec<Sample> {
    let one = |_| Sample {
        x: rng.pick(&[0.0, -1e-9, -0.5, rng.log_between(1e-9, 10.0), rng.log_between(1e-6, 1.0)]),
        xdot: rng.pick(&[0.0, f64::NAN, rng.between(-5.0, 5.0), rng.between(-5.0, 5.0)]),
        force: rng.between(-9.81, 9.81),
        force_ref: rng.between(-19.81, 1.0),
    };
    (0..count).map(one).collect()
}

const GOOD: Sample = Sample { x: 1.0, xdot: -2.0, force: -9.81, force_ref: -19.81 };

#[test]
fn a_bad_sample_is_refused_by_name_and_changes_nothing() {
    let not_finite = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    let mut bad = vec![("x", Sample { x: -0.100_001, ..GOOD })];
    for value in not_finite {
        bad.push(("x", Sample { x: value, ..GOOD }));
        bad.push(("xdot", Sample { xdot: value, ..GOOD }));
        bad.push(("force", Sample { force: value, ..GOOD }));
        bad.push(("force_ref", Sample { force_ref: value, ..GOOD }));
    }
    for mut controller in Controller::of_the_paper(Port::default()) {
        controller.tick(GOOD).expect("a good sample");
        let (before, twin) = (controller.bits(), controller);
        for (name, sample) in &bad {
            if *name == "force_ref" && !controller.has_reference() {
                continue;
            }
            let refusal = controller.tick(*sample).expect_err("a bad sample");
            assert_eq!(refusal.name, *name, "{sample:?}");
            assert_eq!(controller.bits(), before, "{sample:?}");
        }
        let (mut undisturbed, next) = (twin, Sample { x: 0.9, ..GOOD });
        assert_eq!(run(&mut controller, &[next, GOOD]), run(&mut undisturbed, &[next, GOOD]));
        controller.tick(Sample { xdot: 0.1, ..GOOD }).expect("a good sample");
        assert_ne!(controller.bits(), before, "a good sample does change something");
    }
}

/// Numbers too large to compute with are rejected; whatever is answered is finite.
#[test]
fn huge_input_is_refused_or_answered_with_finite_numbers() {
    let sizes = [0.0, 1e-300, -1e-300, 1.0, -1.0, 1e150, -1e150, 1e300, -1e300, f64::MAX];
    let (mut answered, mut refused) = (0, 0);
    for h in [5e-324, 1e-10, 1e-3, 1e3, 1e300] {
        let start = Physical { x: 3.0, xdot: 3.0 };
        let port = Port::default().with_depth(1e301).expect("admissible");
        let restitutions = [half(), half()];
        for fresh in Controller::all(gains_of_the_paper(), h, restitutions, port, start) {
            for x in sizes {
                for xdot in sizes {
                    for force in sizes {
                        for force_ref in sizes {
                            let mut it = fresh;
                            let sample = Sample { x, xdot, force, force_ref };
                            match it.tick(sample) {
                                Ok(u) => {
                                    let finite = it.numbers().into_iter().all(f64::is_finite);
                                    assert!(u.is_finite() && finite, "{sample:?} h = {h}: {it:?}");
                                    let signs = &it.numbers()[4..];
                                    assert!(signs.iter().all(|it| it.abs() <= 1.0), "{it:?}");
                                    answered += 1;
                                }
                                Err(_) => {
                                    assert_eq!(it.bits(), fresh.bits(), "{sample:?} h = {h}");
                                    refused += 1;
                                }
                            }
                        }
                    }
                }
            }
        }
    }
    println!("{answered} answered, {refused} refused");
    assert!(answered > 10_000 && refused > 1_000);
}

#[test]
fn noise_behind_the_wall_is_clamped_down_to_the_depth() {
    for port in [Port::default(), Port::default().with_depth(1e-6).expect("admissible")] {
        let depth = port.depth();
        for mut controller in Controller::of_the_paper(port) {
            let mut at_the_wall = controller;
            let u = controller.tick(Sample { x: -depth, ..GOOD }).expect("noise");
            assert_eq!(controller.status(), TickStatus { clamped: true, ..TickStatus::default() });
            assert_eq!(at_the_wall.tick(Sample { x: 0.0, ..GOOD }), Ok(u));
            assert_eq!(at_the_wall.status(), TickStatus::default());
            let before = controller.bits();
            let deeper = depth * (1.0 + 1e-12);
            assert_eq!(
                controller.tick(Sample { x: -deeper, ..GOOD }).map_err(|it| it.name),
                Err("x")
            );
            assert_eq!(controller.bits(), before);
            controller.tick(GOOD).expect("a good sample");
            assert_eq!(
                controller.status(),
                TickStatus::default(),
                "the status is of the last tick"
            );
        }
    }
    let exact = Port::default().with_depth(0.0).expect("admissible");
    for mut controller in Controller::of_the_paper(exact) {
        assert!(controller.tick(Sample { x: -5e-324, ..GOOD }).is_err());
        assert!(controller.tick(Sample { x: -0.0, ..GOOD }).is_ok());
    }
}

#[test]
fn an_actuator_saturates_and_says_so() {
    let rng = Rng::new(81);
    let port = Port::default().with_actuator(-20.0, 10.0).expect("admissible");
    let free = Controller::of_the_paper(Port::default());
    let limited = Controller::of_the_paper(port);
    let (mut low, mut high, mut inside) = (0, 0, 0);
    for (mut free, mut limited) in free.into_iter().zip(limited) {
        for at in samples(&rng, 4000) {
            let (Ok(wanted), Ok(given)) = (free.tick(at), limited.tick(at)) else { continue };
            assert_eq!(given, wanted.clamp(-20.0, 10.0));
            assert_eq!(limited.status().saturated, !(-20.0..=10.0).contains(&wanted));
            assert!(!free.status().saturated);
            low += u32::from(wanted < -20.0);
            high += u32::from(wanted > 10.0);
            inside += u32::from(wanted == given);
        }
    }
    assert!(low > 100 && high > 100 && inside > 100, "{low} {high} {inside}");
}

#[test]
fn limits_out_of_range_are_refused_by_name() {
    let name = |result: Result<Port, SettingError>| result.expect_err("out of range").name;
    let port = Port::default();
    for depth in [-1e-300, f64::NAN, f64::NEG_INFINITY, f64::INFINITY] {
        assert_eq!(name(port.with_depth(depth)), "depth");
    }
    assert_eq!(name(port.with_actuator(f64::NAN, 1.0)), "u_min");
    for (low, high) in [(1.0, 1.0), (1.0, 0.0), (0.0, f64::NAN)] {
        assert_eq!(name(port.with_actuator(low, high)), "u_max");
    }
    let restitution = half();
    let (plastic, gains) = (Restitution::from_e(0.0).expect("in range"), gains_of_the_paper());
    for h in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let tracker = TwistingTracker::new(gains, h, restitution, restitution, Approach::Positive);
        assert_eq!(tracker.expect_err("out of range").name, "h");
        assert_eq!(
            TwistingRegulator::new(gains, h, restitution).expect_err("out of range").name,
            "h"
        );
    }
    let explicit = |a, b| ExplicitTwisting::new(gains, 1e-3, a, b).expect_err("out of range").name;
    assert_eq!((explicit(plastic, restitution), explicit(restitution, plastic)), ("e", "e_ref"));
    let gains = |mu1, mu2| Gains::new(mu1, mu2).expect_err("out of range").name;
    assert_eq!((gains(0.0, 17.0), gains(30.0, 30.0)), ("mu1", "mu2"));
    assert_eq!((gains(f64::NAN, 1.0), gains(1.1e150, 1.0)), ("mu1", "mu1"));
}

#[test]
fn a_reset_to_a_bad_reference_changes_nothing() {
    let restitution = half();
    let gains = gains_of_the_paper();
    let mut tracker =
        TwistingTracker::new(gains, 1e-3, restitution, restitution, Approach::Nearest).expect("ok");
    tracker.reset(Physical { x: 3.0, xdot: 3.0 }).expect("in range");
    tracker.tick(Physical { x: 6.0, xdot: 5.0 }, -9.81, -19.81).expect("a good sample");
    let before = tracker;
    for (x, xdot, name) in [
        (-1e-9, 0.0, "x_ref"),
        (f64::NAN, 0.0, "x_ref"),
        (f64::INFINITY, 0.0, "x_ref"),
        (1.0, f64::NAN, "xdot_ref"),
        (1.0, f64::MAX, "xdot_ref"),
    ] {
        assert_eq!(tracker.reset(Physical { x, xdot }).expect_err("out of range").name, name);
        assert_eq!(tracker, before);
    }
}

#[test]
fn a_copy_and_a_restored_state_go_on_with_the_same_bits() {
    let rng = Rng::new(82);
    let [before, after] = [samples(&rng, 500), samples(&rng, 500)];
    for fresh in Controller::of_the_paper(Port::default()) {
        let mut controller = fresh;
        run(&mut controller, &before);
        let mut copy = controller;
        // into an instance that has seen other things
        let mut restored = fresh;
        run(&mut restored, &after);
        match (&mut restored, &controller) {
            (Controller::Regulator(to), Controller::Regulator(from)) => to.set_state(from.state()),
            (Controller::Tracker(to), Controller::Tracker(from)) => to.set_state(from.state()),
            (Controller::Explicit(to), Controller::Explicit(from)) => to.set_state(from.state()),
            _ => unreachable!("of one kind"),
        }
        let expected = run(&mut controller, &after);
        assert_eq!(run(&mut copy, &after), expected);
        assert_eq!(run(&mut restored, &after), expected);
        assert_eq!(restored.bits(), controller.bits());
        assert!(expected.iter().flatten().count() > 200 && expected.contains(&None));
    }
}

#[test]
fn interleaved_instances_do_not_disturb_each_other() {
    let rng = Rng::new(83);
    let [one, other] = [samples(&rng, 500), samples(&rng, 500)];
    for fresh in Controller::of_the_paper(Port::default()) {
        let (mut a, mut b) = (fresh, fresh);
        let (alone_a, alone_b) = (run(&mut a, &one), run(&mut b, &other));
        let (mut a, mut b) = (fresh, fresh);
        for (index, (&at_a, &at_b)) in one.iter().zip(&other).enumerate() {
            assert_eq!(a.tick(at_a).ok().map(f64::to_bits), alone_a[index]);
            assert_eq!(b.tick(at_b).ok().map(f64::to_bits), alone_b[index]);
        }
        assert_ne!(alone_a, alone_b);
    }
}

#[test]
fn a_control_does_not_depend_on_what_comes_later() {
    let rng = Rng::new(84);
    let [past, one, other] = [samples(&rng, 200), samples(&rng, 200), samples(&rng, 200)];
    for fresh in Controller::of_the_paper(Port::default()) {
        let (mut a, mut b) = (fresh, fresh);
        let a = run(&mut a, &[past.clone(), one.clone()].concat());
        let b = run(&mut b, &[past.clone(), other.clone()].concat());
        assert_eq!(a[..200], b[..200]);
        assert_ne!(a[200..], b[200..]);
    }
}

/// `|u| <= (1 + kappa)(mu1 + mu2 + |F_r|/(1 - kappa_r)) + |F|`, the regulator's
/// `|u| <= mu1 + mu2`.
#[test]
fn the_control_is_bounded_by_the_gains_and_the_forces() {
    let rng = Rng::new(85);
    let mut closest: f64 = 0.0;
    for _ in 0..50_000 {
        let (gains, f) = stable(&rng);
        let restitutions = [random_wall(&rng), random_wall(&rng)];
        let start = Physical { x: rng.log_between(1e-6, 10.0), xdot: rng.between(-5.0, 5.0) };
        let h = rng.log_between(1e-5, 1e-1);
        let force_ref = rng.between(-20.0, 5.0);
        let x = start.x * rng.pick(&[0.0, 1.0, rng.unit(), 2.0]);
        let at = Sample { x, xdot: rng.between(-5.0, 5.0), force: f, force_ref };
        let [kappa, kappa_ref] = restitutions.map(Restitution::kappa);
        for mut it in Controller::all(gains, h, restitutions, Port::default(), start) {
            let u = it.tick(at).expect("a good sample").abs();
            let both = gains.mu1() + gains.mu2();
            let bound = if it.has_reference() {
                (1.0 + kappa) * (both + force_ref.abs() / (1.0 - kappa_ref)) + f.abs()
            } else {
                both
            };
            assert!(u <= bound * (1.0 + 4.0 * f64::EPSILON), "{u} > {bound}: {it:?} at {at:?}");
            closest = closest.max(u / bound);
        }
    }
    assert!(closest > 0.9, "the bound is far off: {closest}");
}

/// An incoming state at the wall and the one after its impact are the same reference.
#[test]
fn a_reset_into_the_wall_is_on_the_positive_branch() {
    let (restitution, gains) = (Restitution::from_e(0.4).expect("in range"), gains_of_the_paper());
    let tracker = TwistingTracker::new(gains, 1e-3, restitution, restitution, Approach::Positive);
    let explicit = ExplicitTwisting::new(gains, 1e-3, restitution, restitution);
    let start = |xdot| Physical { x: 0.0, xdot };
    for controller in [
        Controller::Tracker(tracker.expect("admissible")),
        Controller::Explicit(explicit.expect("admissible")),
    ] {
        let [into, after] = [-3.0, 1.2].map(|xdot| {
            let mut it = controller;
            match &mut it {
                Controller::Tracker(it) => it.reset(start(xdot)).expect("in range"),
                Controller::Explicit(it) => it.reset(start(xdot)).expect("in range"),
                Controller::Regulator(_) => unreachable!("it has no reference"),
            }
            let u = it.tick(Sample { x: 0.3, ..GOOD }).expect("a good sample");
            (u, it.numbers())
        });
        assert!((into.0 - after.0).abs() < 1e-12, "{into:?} {after:?}");
        assert!(into.1.iter().zip(&after.1).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}

/// `M (1 + e)/(2 e) < mu2 < mu1 - M (1 + e)/(2 e)` of a tracker,
/// `M - mu1 (1 - e^2)/(1 + e^2) < mu2 < mu1 - M` of a regulator.
#[test]
fn gains_hold_what_their_condition_says() {
    let rng = Rng::new(86);
    let mut accepted = [0; 2];
    for _ in 0..20_000 {
        let e = rng.between(0.02, 1.0);
        let restitution = Restitution::from_e(e).expect("in range");
        let mu1 = rng.log_between(1e-2, 1e2);
        let (mu2, bound) = (mu1 * rng.between(0.01, 0.99), mu1 * rng.between(0.0, 1.0));
        let image = bound * (1.0 + e) / (2.0 * e);
        let tracking = Gains::for_tracking(mu1, mu2, bound, restitution);
        assert_eq!(tracking.is_ok(), image < mu2 && mu2 + image < mu1);
        // e^2 (D + M)/(U - M) < 1 with D = mu1 - mu2 > M, U = mu1 + mu2
        let (down, up) = (mu1 - mu2 - bound, mu1 + mu2 - bound);
        let shrinks = e * e * (mu1 - mu2 + bound) / up;
        if (shrinks - 1.0).abs() > 1e-12 && down.abs() > 1e-12 * mu1 {
            let regulation = Gains::for_regulation(mu1, mu2, bound, restitution);
            assert_eq!(regulation.is_ok(), down > 0.0 && shrinks < 1.0);
            accepted[1] += u32::from(regulation.is_ok());
        }
        accepted[0] += u32::from(tracking.is_ok());
    }
    assert!(accepted.iter().all(|it| (500..19_500).contains(it)), "{accepted:?}");
    let restitution = half();
    let refusal = Gains::for_tracking(30.0, 17.0, 13.0, restitution).expect_err("too small");
    assert_eq!(refusal.name(), "mu2");
    let text = refusal.to_string();
    assert!(text.starts_with("mu2 must be greater than bound (1 + e)/(2 e) = 26.0"), "{text}");
    assert!(text.ends_with("for bound = 13.0, got 17.0"), "{text}");
    let text = Gains::for_tracking(30.0, 17.0, 50.0, restitution).expect_err("small").to_string();
    assert!(text.contains("= 100.0 m/s^2"), "{text}");
    for bound in [-1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(
            Gains::for_tracking(30.0, 17.0, bound, restitution).expect_err("range").name(),
            "bound"
        );
    }
    let plastic = Restitution::from_e(0.0).expect("in range");
    assert_eq!(Gains::for_regulation(3.0, 2.0, 0.1, plastic).expect_err("range").name(), "e");
}

#[test]
fn a_missing_sample_holds_the_control_and_moves_the_reference() {
    let start = Physical { x: 3.0, xdot: 3.0 };
    let mut explicit =
        ExplicitTwisting::new(gains_of_the_paper(), 1e-3, half(), half()).expect("admissible");
    explicit.reset(start).expect("admissible");
    let u = explicit.tick(Physical { x: 2.9, xdot: 2.8 }, -9.81, -2.0).expect("finite");
    assert!(u != 0.0);
    let mut seen = explicit;
    for _ in 0..50 {
        assert_eq!(explicit.miss(-2.0), Ok(u));
        seen.tick(start, -9.81, -2.0).expect("finite");
        // under 2 m/s^2 towards the wall, whatever is measured
        assert_eq!(explicit.reference(), seen.reference());
    }
}
