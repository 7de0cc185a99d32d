//! The plan of an update: reference and target, which are private.

use super::regulation::RegulationStep;
use super::tracking::{Place, Target, TrackingStep};
use super::{Approach, Gains, ReferencePeriod, TickStatus, TwistingTracker, Waypoint};
use crate::control::reference::ReferenceState;
use crate::{transform, Branch, Lifted, Physical, Restitution, SettingError, ThetaGammaStep};

fn half() -> Restitution {
    Restitution::from_kappa(0.5).expect("in range")
}

fn tracker(h: f64) -> TwistingTracker {
    let gains = Gains::new(30.0, 17.0).expect("in range");
    TwistingTracker::new(gains, h, half(), half(), Approach::Nearest).expect("admissible")
}

/// In the air the acceleration of a given reference is the difference quotient of its velocities;
/// at rest it is zero; over an impact it is the force.
#[test]
fn the_acceleration_of_a_given_reference_is_that_of_its_velocities() {
    let h = 1e-2;
    let at = |x: f64, xdot: f64, branch| Waypoint { state: Physical { x, xdot }, branch };
    let (one, other) = (Branch::Positive, Branch::Negative);
    for (now, next, acceleration) in [
        (at(1.0, 0.5, one), at(1.0048, 0.46, one), (0.46 - 0.5) / h),
        (at(1.0, -0.5, other), at(0.9952, -0.46, other), (0.5 - 0.46) / h),
        (at(0.0, 0.0, one), at(0.0, 0.0, other), 0.0),
        (at(0.01, -2.0, one), at(0.005, 1.0, other), -9.81),
    ] {
        let course =
            ReferencePeriod::between((half(), h), -9.81, [now, next], None).expect("in range");
        assert!((course.force - acceleration).abs() < 1e-11, "{now:?}: {}", course.force);
        let given = ReferencePeriod::between((half(), h), 0.0, [now, next], Some(acceleration));
        assert!((given.expect("in range").back - course.back).abs() < 1e-13);
        let flies = now.branch == next.branch && now.state.x > 0.0;
        assert!((course.back - if flies { 0.5 * h * acceleration } else { 0.0 }).abs() < 1e-13);
    }
}

/// Half a period of the reference's force, where it stays off the wall for the period.
#[test]
fn the_velocity_is_taken_half_a_period_back_only_in_the_air() {
    let (h, force) = (1e-2, -9.81);
    let below = -(0.5_f64 / h) + force * -h; // x + h (x' + h F) = 0 at x = 1/2
    for (x, xdot, flies) in [
        (0.5, 0.0, true),
        (0.5, below + 1e-9, true),
        (0.5, below - 1e-9, false),
        (0.5, 3.0, true),
        (0.0, 3.0, false),
        (0.0, 0.0, false),
        (0.2, -30.0, false),
    ] {
        let mut it = tracker(h).with_shift(true);
        it.reset(Physical { x, xdot }).expect("in range");
        let back = it.own_period(force).back;
        assert_eq!(back, if flies { 0.5 * h * force } else { 0.0 }, "{x} {xdot}");
        assert_eq!(it.with_shift(false).own_period(force).back, 0.0);
    }
}

/// Planned over several periods, the plant follows the reference over all of them; the reference
/// itself advances by one.
#[test]
fn a_longer_horizon_plans_towards_a_later_reference() {
    let (h, force_ref) = (1e-2, -9.81);
    let start = Physical { x: 1.0, xdot: 0.3 };
    let after = |h: f64| ThetaGammaStep::new(h, 1.0, 1.0, half()).expect("admissible");
    for horizon in [1.0, 2.0, 5.0] {
        let mut it = tracker(h).with_shift(false).with_horizon(horizon).expect("in range");
        it.reset(start).expect("in range");
        let z = transform::lift(start, Branch::Positive, half());
        let own = |it: &TwistingTracker| Ok::<_, SettingError>(it.own_period(force_ref));
        let planned = it.plan(start, -9.81, own).expect("a good sample");
        let late = after(h * horizon).solve(z, force_ref, 1.0).expect("a step").end();
        let next = after(h).solve(z, force_ref, 1.0).expect("a step").end();
        let close = |one: Lifted, other: Lifted| (one.s - other.s).abs() + (one.v - other.v).abs();
        assert!(close(planned.target.end, late) < 1e-14, "{horizon}");
        assert_eq!(planned.next.z, next);
    }
}

/// The control law and the motion of the plant under it, for any signs.
#[test]
fn a_step_of_given_signs_is_the_law_and_the_motion_under_it() {
    let (h, f, mu1, mu2, kappa) = (1e-2, -9.81, 30.0, 17.0, 0.5);
    let gains = Gains::new(mu1, mu2).expect("in range");
    let step = TrackingStep { h, restitution: half(), gains };
    let target = Target { end: Lifted { s: 0.3, v: -0.2 }, acceleration: 4.0 };
    let grid = [-1.0, -0.6, 0.0, 0.25, 1.0];
    for (ls, lv) in grid.into_iter().flat_map(|ls| grid.map(|lv| (ls, lv))) {
        for (s, v) in [(0.2, -0.7), (-0.1, 0.4), (0.0, 0.0)] {
            let (les, lev) = (0.5 * lv, -0.3);
            let found = step.of_signs(Lifted { s, v }, f, target, [ls, lv, les, lev]);
            let r = 1.0 - kappa * ls * lv;
            let wanted = 4.0 - mu1 * les - mu2 * lev;
            // u = R ls A - ls^2 F and v+ = v + h ls (F + u)/R
            let u = r * ls * wanted - ls * ls * f;
            let ahead = v + h * ls * (f + u) / r;
            assert!((found.u - u).abs() < 1e-13 * mu1, "{ls} {lv}: {} {u}", found.u);
            assert!((found.end.v - ahead).abs() < 1e-14, "{ls} {lv}: {} {ahead}", found.end.v);
            assert!((found.end.s - (s + h * r * ahead)).abs() < 1e-15, "{ls} {lv}");
            let place = match ls * s {
                _ if ls.abs() < 1.0 => Place::Wall,
                side if side < 0.0 => Place::Other,
                _ => Place::Same,
            };
            assert_eq!(found.place, place, "{ls} {s}");
        }
    }
}

/// The same of the regulator: `v+ = v + h (ls (F - mu1) - mu2 lv)/R`, `s+ = s + h R v+`.
#[test]
fn a_regulators_step_of_given_signs() {
    let (h, f, mu1, mu2, kappa) = (1e-2, -9.81, 30.0, 17.0, 0.5);
    let gains = Gains::new(mu1, mu2).expect("in range");
    let step = RegulationStep { h, restitution: half(), gains };
    for (ls, lv) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 0.4), (0.3, -0.8), (0.0, 0.0)] {
        let found = step.of_signs(Lifted { s: 0.2, v: -0.7 }, f, [ls, lv]);
        let r = 1.0 - kappa * ls * lv;
        let v = -0.7 + h * (ls * (f - mu1) - mu2 * lv) / r;
        assert!((found.end.v - v).abs() < 1e-15, "{ls} {lv}: {} {v}", found.end.v);
        assert!((found.end.s - (0.2 + h * r * v)).abs() < 1e-16, "{ls} {lv}");
        assert_eq!((found.lambda_s, found.lambda_v), (ls, lv));
    }
}

/// Both images of a measurement are as near where the reference is at rest on the wall: it is the
/// side then from which the reference came.
#[test]
fn of_two_images_as_near_the_one_on_the_references_side_is_taken() {
    let measured = Physical { x: 0.1, xdot: 0.0 };
    for (side, sign) in [(1.0, 1.0), (-1.0, -1.0)] {
        let reference = ReferenceState { z: Lifted { s: 0.0, v: 0.0 }, side };
        assert_eq!(tracker(1e-2).lifted(measured, reference).s, sign * 0.1);
    }
}

#[test]
fn a_status_is_its_bits() {
    for bits in [0, 1, 2, 8, 3, 9, 10, 11] {
        let status = TickStatus::from_bits(bits);
        assert_eq!(status.bits(), bits);
        assert_eq!(
            [status.clamped, status.saturated, status.unsolved],
            [1, 2, 8].map(|bit| bits & bit > 0)
        );
        assert_eq!(TickStatus::from_bits(bits | 4), status);
    }
}
