//! How hard trackers press and pull.

use zivi_core::control::TwistingTracker;

use super::kinetics::GapKinetics;

/// The acceleration with which a tracker presses a gap that rests.
pub(super) fn press_of(tracker: &TwistingTracker) -> f64 {
    tracker.descent().map_or(0.0, |it| it.accelerations()[2])
}

/// The least acceleration with which a tracker pulls a gap that lands.
pub(super) fn weakest_of(tracker: &TwistingTracker) -> f64 {
    let pulls = tracker.descent().map_or([0.0; 3], |it| it.accelerations());
    pulls.into_iter().fold(f64::INFINITY, f64::min)
}

/// The forces with which landings press the contacts that are held, 0 elsewhere.
pub(super) fn usual_forces(kinetics: &mut GapKinetics, held: &[bool], press: &[f64]) -> Vec<f64> {
    let m = held.len();
    let mut forces: Vec<f64> =
        held.iter().zip(press).map(|(held, press)| if *held { *press } else { 0.0 }).collect();
    kinetics.solve_among(held, &mut forces);
    if !held.iter().zip(&forces).all(|(held, force)| !held || *force > 0.0) {
        for i in (0..m).filter(|&i| held[i]) {
            forces[i] = press[i] / kinetics.d[i * m + i];
        }
    }
    forces
}
