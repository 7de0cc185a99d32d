//! Which solution a controller takes where there are several, and which image of a measurement.

use zivi_core::control::regulation::RegulationStep;
use zivi_core::control::{Approach, ExplicitTwisting, Gains, TrackerState, TwistingTracker};
use zivi_core::{transform, Branch, Lifted, Physical, Restitution};

fn half() -> Restitution {
    Restitution::from_kappa(0.5).expect("in range")
}

fn regulation(h: f64, mu1: f64, mu2: f64) -> RegulationStep {
    RegulationStep { h, restitution: half(), gains: Gains::new(mu1, mu2).expect("in range") }
}

/// A force far beyond the gains: of a velocity away from the wall and one towards it, both of which
/// solve the step, the one with the sign of the velocity now.
#[test]
fn of_two_velocities_the_regulators_step_keeps_the_sign() {
    let step = regulation(0.1, 2.0, 1.0);
    let (push, brake) = (2.0, 0.1); // h (F - mu1), h mu2
    let force = 2.0 + push / 0.1;
    for v in [-1.5, -2.0] {
        let (outward, inward) = (0.5 * v + push - brake, 1.5 * v + push + brake); // R v+
        assert!(outward > 0.0 && inward < 0.0, "two solutions");
        let found = step.solve(Lifted { s: 10.0, v }, force);
        assert_eq!((found.lambda_s, found.lambda_v), (1.0, -1.0));
        assert!((found.end.v - inward / 1.5).abs() < 1e-15);
        assert_eq!(found.u, -2.0 + 1.0);
    }
}

/// At `s = 0`: of the signs that stop the mass there those with the smallest `|ls|`: the brake
/// alone up to `|v| = h mu2`, all of it beyond.
#[test]
fn a_slow_mass_at_the_wall_is_stopped_by_the_brake_alone() {
    let step = regulation(0.1, 10.0, 2.0);
    let brake = 0.2;
    for share in [0.1, 0.4, 0.6, 0.75, 0.99, 1.0] {
        for sign in [1.0, -1.0] {
            let found = step.solve(Lifted { s: 0.0, v: sign * share * brake }, 0.0);
            assert_eq!(found.end, Lifted::default());
            assert_eq!(found.lambda_s, 0.0);
            assert!((found.lambda_v - sign * share).abs() < 1e-15, "{share}");
            assert_eq!(found.u, -10.0);
        }
    }
    for share in [1.01, 1.5, 2.0] {
        let v = share * brake;
        let found = step.solve(Lifted { s: 0.0, v }, 0.0);
        assert_eq!((found.end, found.lambda_v), (Lifted::default(), 1.0));
        // R v + ls push - brake = 0 with R = 1 - kappa ls
        let balance = (1.0 - 0.5 * found.lambda_s) * v - found.lambda_s - brake;
        assert!(found.lambda_s > 0.0 && balance.abs() < 1e-15, "{share}: {balance}");
    }
}

/// From either side, and its zero has no sign.
#[test]
fn the_regulators_step_onto_the_wall_is_the_same_from_both_sides() {
    let step = regulation(0.1, 10.0, 2.0);
    let ends = [1.0, -1.0].map(|side| step.solve(Lifted { s: side * 1e-3, v: -side * 0.02 }, 0.0));
    for found in ends {
        assert_eq!(found.end.s.to_bits(), 0, "{found:?}");
    }
    assert_eq!(ends[0].end.v, -ends[1].end.v);
    assert_eq!(ends[0].lambda_s, -ends[1].lambda_s);
    assert_eq!(ends[0].lambda_v, -ends[1].lambda_v);
    assert_eq!(ends[0].u, ends[1].u);
}

/// `u = R [ -mu1 sgn(e_s) - mu2 sgn(e_v) + F_r/R_r ] - F`; on the wall the reference's force counts
/// where it pulls the reference off.
#[test]
fn the_explicit_law_knows_when_its_reference_is_pulled_off() {
    let gains = Gains::new(30.0, 17.0).expect("in range");
    let above = Physical { x: 0.1, xdot: 0.0 };
    for (force_ref, acceleration) in [(5.0, 5.0), (-5.0, 0.0), (0.0, 0.0)] {
        let mut explicit = ExplicitTwisting::new(gains, 1e-3, half(), half()).expect("admissible");
        assert_eq!(explicit.h(), 1e-3);
        let u = explicit.tick(above, -9.81, force_ref).expect("a good sample");
        // at x' = 0 the sign of v is 0: R = 1, and no mu2
        assert!((u - (-30.0 + acceleration + 9.81)).abs() < 1e-13, "{force_ref}: {u}");
    }
}

/// Of least `mu1 |e_s| + e_v^2/2`: near the wall the velocity decides, whatever the positions say.
#[test]
fn the_nearest_image_looks_at_the_velocity_too() {
    let gains = Gains::new(30.0, 17.0).expect("in range");
    let (measured, force, force_ref) = (Physical { x: 1e-3, xdot: -3.0 }, -9.81, -9.81);
    // the reference has just passed the wall at the same speed
    let reference = Lifted { s: -1e-3, v: -2.0 };
    let new = TwistingTracker::new(gains, 1e-3, half(), half(), Approach::Nearest);
    let mut tracker = new.expect("admissible");
    tracker.set_state(TrackerState { reference, side: -1.0, ..tracker.state() });
    let target = {
        let next = tracker.reference_step().solve(reference, force_ref, -1.0).expect("a step");
        let r = half().r(next.lambda_s, next.lambda_v);
        zivi_core::control::tracking::Target {
            end: next.end(),
            acceleration: next.lambda_s * force_ref / r,
        }
    };
    let step = *tracker.step();
    let of = |branch| step.solve(transform::lift(measured, branch, half()), force, target).u;
    let u = tracker.tick(measured, force, force_ref).expect("a good sample");
    assert_eq!(u, of(Branch::Positive), "the image on the side from which both come");
    assert!((u - of(Branch::Negative)).abs() > 1.0, "the other image is another control");
    // the mass has bounced as well: now its image is on the reference's side
    let bounced = Physical { x: 1e-3, xdot: 1.0 };
    tracker.set_state(TrackerState { reference, side: -1.0, ..tracker.state() });
    let u = tracker.tick(bounced, force, force_ref).expect("a good sample");
    assert_eq!(u, step.solve(transform::lift(bounced, Branch::Negative, half()), force, target).u);
}

fn tracker(h: f64) -> TwistingTracker {
    let gains = Gains::new(30.0, 17.0).expect("in range");
    TwistingTracker::new(gains, h, half(), half(), Approach::Nearest).expect("admissible")
}

/// A press below the bound of the unknown force is rejected, and so is one that is not finite.
#[test]
fn a_press_bears_the_unknown_force() {
    let it = tracker(1e-3);
    assert!(it.descent().is_some());
    for (press, bound, good) in
        [(2.0, 2.0, true), (3.0, 2.0, true), (1.9, 2.0, false), (f64::NAN, 0.0, false)]
    {
        assert_eq!(it.with_press(press, bound).is_ok(), good, "{press} {bound}");
        assert!(it.with_landing(None).with_press(press, bound).is_ok());
    }
}

/// While its reference rests a mass is let down with `g`, and the signs stand for it:
/// `(1 - kappa lv)(mu1 + mu2 lev) = g` with the brake in part.
#[test]
fn the_signs_of_a_landing_stand_for_its_acceleration() {
    let (h, force) = (1e-2, -9.81);
    let mut inside = 0;
    for k in 0..200 {
        let xdot = -2.0 + 0.02 * f64::from(k);
        let mut it = tracker(h);
        it.reset(Physical::default()).expect("in range");
        let u = it.tick(Physical { x: 0.1, xdot }, force, -9.81).expect("a good sample");
        let (g, [ls, lv, _, _, les, lev]) = (-force - u, it.state().signs);
        assert_eq!((ls, les, lv), (1.0, 1.0, zivi_core::sgn(xdot)), "{xdot}");
        if lev.abs() < 1.0 {
            assert!(((1.0 - 0.5 * lv) * (30.0 + 17.0 * lev) - g).abs() < 1e-12, "{xdot}: {lev}");
            inside += 1;
        }
    }
    assert!(inside > 5, "{inside}");
}
