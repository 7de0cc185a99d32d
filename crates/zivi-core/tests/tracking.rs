//! The tracker's exact step: no failure on random instances, residuals recomputed.

mod common;

use common::Rng;
use zivi_core::control::inclusion::{Inclusion, PlantInclusion};
use zivi_core::control::tracking::{Place, Target, Tracking, TrackingStep};
use zivi_core::control::Gains;
use zivi_core::{Lifted, Restitution};

/// A step of the plant to be solved.
#[derive(Clone, Copy, Debug)]
struct Instance {
    step: TrackingStep,
    z: Lifted,
    f: f64,
    target: Target,
}

#[derive(Clone, Copy, Debug)]
enum Draw {
    /// Plant and reference anywhere.
    Wide,
    /// Both within a few steps of the wall and of each other.
    Near,
    /// The plant crosses the wall within the step.
    Crossing,
}

fn settings(rng: &Rng) -> (TrackingStep, f64) {
    let bound = rng.log_between(1e-2, 1e2);
    let mu2 = bound * (1.0 + rng.log_between(1e-3, 10.0));
    let mu1 = (mu2 + bound) * (1.0 + rng.log_between(1e-3, 10.0));
    let wall = Restitution::from_kappa(rng.between(0.01, 0.99)).unwrap();
    let gains = Gains::for_bound(mu1, mu2, bound).unwrap();
    let h = rng.log_between(1e-5, 1e-1);
    (TrackingStep { h, wall, gains }, rng.between(-bound, bound))
}

fn signed(rng: &Rng, low: f64, high: f64) -> f64 {
    rng.sign() * rng.log_between(low, high)
}

fn draw(rng: &Rng, kind: Draw) -> Instance {
    let (step, f) = settings(rng);
    let acceleration = signed(rng, 1e-3, 1e2);
    let reach = step.h * step.gains.mu1();
    let (z, end) = match kind {
        Draw::Wide => {
            let state = || Lifted { s: signed(rng, 1e-12, 1e3), v: signed(rng, 1e-12, 1e3) };
            (state(), state())
        }
        Draw::Near => {
            let small =
                |unit: f64| if rng.chance(0.1) { 0.0 } else { unit * signed(rng, 1e-4, 10.0) };
            let z = Lifted { s: small(step.h * reach), v: small(reach) };
            let end = Lifted { s: z.s + small(step.h * reach), v: z.v + small(reach) };
            let at = |part: f64| if rng.chance(part) { 0.0 } else { 1.0 };
            (z, Lifted { s: end.s * at(0.1), v: end.v * at(0.1) })
        }
        Draw::Crossing => {
            let v = signed(rng, 1e-3, 1e2);
            let z = Lifted { s: -v * step.h * rng.between(0.0, 2.0), v };
            let aim =
                Lifted { s: v * step.h * rng.between(-2.0, 2.0), v: v * rng.between(-1.5, 1.5) };
            (z, aim)
        }
    };
    Instance { step, z, f, target: Target { end, acceleration } }
}

fn signs(it: &Tracking) -> [f64; 4] {
    [it.lambda_s, it.lambda_v, it.lambda_es, it.lambda_ev]
}

#[test]
fn ten_million_random_steps_are_solved() {
    let rng = Rng::new(41);
    for kind in [Draw::Wide, Draw::Near, Draw::Crossing] {
        let (mut worst, mut places, mut iterations, mut total) = (0.0_f64, [0_u32; 3], 0, 0);
        for _ in 0..3_400_000 {
            let it = draw(&rng, kind);
            let found = it.step.solve(it.z, it.f, it.target);
            let Instance { ref step, z, f, target } = it;
            let residual = PlantInclusion { step, z, f, target }.residual(signs(&found));
            if residual > worst || residual.is_nan() {
                worst = residual;
            }
            places[match found.place {
                Place::Same => 0,
                Place::Other => 1,
                Place::Wall => 2,
            }] += 1;
            total += found.iterations;
            iterations = iterations.max(found.iterations);
        }
        eprintln!("{kind:?}: {worst:e}, {places:?}, {iterations} {total}");
    }
}
