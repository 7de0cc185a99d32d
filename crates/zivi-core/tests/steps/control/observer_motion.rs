//! What the observer's motion is: an unknown force that is learnt, and small impacts that end.

use zivi_core::observer::{Estimate, ImpactObserver, Measurement, ObserverSettings, ObserverState};
use zivi_core::{Physical, Restitution};

const H: f64 = 1e-3;

fn settings(e: f64) -> ObserverSettings {
    let wall = Restitution::from_e(e).expect("in range");
    ObserverSettings::new(wall, H)
        .and_then(|it| it.with_noise(1e-4, 1e-2))
        .and_then(|it| it.with_force(1e-3, 5.0))
        .expect("in range")
        .with_position_only(true)
}

/// Beside the known force the plant has 1.5 m/s^2 more; measured without noise, it is found.
#[test]
fn an_unknown_force_is_learnt() {
    for more in [1.5, -1.5] {
        let mut it = ImpactObserver::new(settings(0.5));
        let a = -9.81 + more;
        for k in 0..600 {
            let t = f64::from(k) * H;
            let seen = Measurement { x: 20.0 + 0.5 * a * t * t, xdot: None };
            it.tick_after(H, Some(seen), -9.81, 0.0).expect("finite");
        }
        assert!((it.estimate().d - more).abs() < 0.1, "{:?}", it.estimate());
    }
}

/// Without a measurement: on the wall flights of `2 v/g`, `2 e v/g`, ... and rest after their sum,
/// `2 v/(g (1 - e))`, whatever the force.
#[test]
fn small_impacts_end_after_their_sum() {
    let e = 0.5;
    for g in [0.2, 1.0, 9.81, 50.0] {
        let v = 0.5 * g * 0.03;
        let sum = 2.0 * v / (g * (1.0 - e));
        let after = |dt: f64| {
            let mut it = ImpactObserver::new(settings(e));
            let estimate = Estimate { state: Physical { x: 0.0, xdot: v }, d: 0.0 };
            it.set_state(ObserverState { started: true, estimate, ..it.state() });
            it.tick_after(dt, None, -g, 0.0).expect("finite");
            it.estimate().state
        };
        assert_eq!(after(1.001 * sum), Physical::default());
        // within the second and the fourth flight
        for n in [1, 3] {
            let (begun, u) = (sum * (1.0 - e.powi(n)), v * e.powi(n));
            let into = 0.4 * 2.0 * u / g;
            let state = after(begun + into);
            assert!((state.x - (u * into - 0.5 * g * into * into)).abs() < 1e-12 * g, "{state:?}");
            assert!((state.xdot - (u - g * into)).abs() < 1e-12 * g);
        }
    }
}
