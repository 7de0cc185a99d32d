//! The observer's rules one by one: what starts it, what restarts it, what an impact tells of `e`,
//! what a missing sample leaves, each against its formula or a fit written here.

use crate::common::Rng;
use zivi_core::observer::{
    Covariance, Estimate, ImpactObserver, Measurement, Memory, ObserverSettings, ObserverState,
    Seen,
};
use zivi_core::{Physical, Restitution};

const H: f64 = 1e-3;
const SIGMA: f64 = 1e-4;

fn settings(e: f64) -> ObserverSettings {
    let wall = Restitution::from_e(e).expect("in range");
    ObserverSettings::new(wall, H)
        .and_then(|it| it.with_noise(SIGMA, 1e-2))
        .and_then(|it| it.with_force(1e-3, 5.0))
        .expect("in range")
        .with_position_only(true)
}

fn at(x: f64) -> Option<Measurement> {
    Some(Measurement { x, xdot: None })
}

fn near(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * (1.0 + b.abs())
}

/// Least squares of `x_i = x - v tau_i + a tau_i^2/2` for a known `a`, by the normal equations, with
/// the covariance for noise `SIGMA` and an acceleration that is unknown up to the variance `of_d`.
fn fit(seen: &[(f64, f64)], a: f64, of_d: f64) -> ([f64; 2], [f64; 6]) {
    let (mut m, mut right, mut bend) = ([[0.0; 2]; 2], [0.0; 2], [0.0; 2]);
    for (x, tau) in seen {
        let row = [1.0, -tau];
        for i in 0..2 {
            for j in 0..2 {
                m[i][j] += row[i] * row[j];
            }
            right[i] += row[i] * (x - 0.5 * a * tau * tau);
            bend[i] += row[i] * 0.5 * tau * tau;
        }
    }
    let det = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    let inverse = [[m[1][1] / det, -m[0][1] / det], [-m[1][0] / det, m[0][0] / det]];
    let solve = |b: [f64; 2]| [0, 1].map(|i| inverse[i][0] * b[0] + inverse[i][1] * b[1]);
    let state = solve(right);
    // true state = estimate + by delta
    let by = solve(bend).map(|it| -it);
    let s2 = SIGMA * SIGMA;
    let p = [
        s2 * inverse[0][0] + by[0] * by[0] * of_d,
        s2 * inverse[0][1] + by[0] * by[1] * of_d,
        by[0] * of_d,
        s2 * inverse[1][1] + by[1] * by[1] * of_d,
        by[1] * of_d,
        of_d,
    ];
    (state, p)
}

fn assert_fitted(it: &ObserverState, (state, p): ([f64; 2], [f64; 6])) {
    assert!(near(it.estimate.state.x, state[0], 1e-9), "{it:?} {state:?}");
    assert!(near(it.estimate.state.xdot, state[1], 1e-9), "{it:?} {state:?}");
    let Covariance { xx, xv, xd, vv, vd, dd, xe, ve, de, .. } = it.covariance;
    let size = [xx, (xx * vv).sqrt(), (xx * dd).sqrt(), vv, (vv * dd).sqrt(), dd];
    for ((found, wanted), size) in [xx, xv, xd, vv, vd, dd].into_iter().zip(p).zip(size) {
        assert!((found - wanted).abs() <= 1e-9 * size, "{found} {wanted}");
    }
    assert_eq!([xe, ve, de], [0.0; 3]);
}

#[test]
fn two_positions_are_a_start() {
    for (dt, waits) in [(H, 0), (2.5 * H, 0), (H, 3)] {
        let mut it = ImpactObserver::new(settings(0.5));
        // before the first one nothing moves
        it.tick_after(dt, None, -9.81, 0.0).expect("finite");
        assert_eq!(it.state(), ImpactObserver::new(settings(0.5)).state());
        it.tick_after(dt, at(1.0), 5.0, 3.0).expect("finite");
        let first = it.state();
        assert!(first.started && first.waiting);
        assert_eq!(first.estimate, Estimate { state: Physical { x: 1.0, xdot: 0.0 }, d: 0.0 });
        // the velocity by the energy of a fall from there, and the noise of one period
        let highest = 8.0 * 5.0 * (1.0 + 6.0 * SIGMA) + 100.0 * (SIGMA / H).powi(2);
        assert!(near(first.covariance.vv, highest, 1e-12));
        assert_eq!((first.covariance.xx, first.covariance.dd), (SIGMA * SIGMA, 25.0));
        for _ in 0..waits {
            it.tick_after(dt, None, -9.0, -0.81).expect("finite");
            assert!(it.state().waiting);
        }
        it.tick_after(dt, at(1.002), -9.0, -0.81).expect("finite");
        let age = dt * f64::from(waits + 1);
        assert!(!it.state().waiting);
        assert_fitted(&it.state(), fit(&[(1.002, 0.0), (1.0, age)], -9.81, 25.0));
    }
}

#[test]
fn a_velocity_ends_the_wait_at_once() {
    let settings = settings(0.5).with_position_only(false);
    let mut it = ImpactObserver::new(settings);
    it.tick_after(H, at(1.0), -9.81, 0.0).expect("finite");
    let measured = Measurement { x: 0.9, xdot: Some(-2.0) };
    it.tick(measured, -9.81, 0.0).expect("finite");
    let ObserverState { estimate, covariance, waiting, .. } = it.state();
    assert!(!waiting);
    assert_eq!(estimate.state, Physical { x: 0.9, xdot: -2.0 });
    let Covariance { xx, xv, vv, dd, .. } = covariance;
    assert_eq!([xx, xv, vv, dd], [SIGMA * SIGMA, 0.0, 1e-4, 25.0]);
    // and so does one at the start
    let mut it = ImpactObserver::new(settings);
    it.tick(Measurement { x: -0.1, xdot: Some(1.0) }, -9.81, 0.0).expect("finite");
    assert_eq!(it.estimate().state, Physical { x: 0.0, xdot: 1.0 });
    assert!(!it.state().waiting && it.state().started);
}

/// A filter that believes in a mass far from where it is: the third position that is refused is the
/// first that can agree with those before; four of six must, whatever two of them are.
#[test]
fn positions_that_agree_restart_it() {
    let rng = Rng::new(5);
    for outliers in [0_usize, 1, 2] {
        for _ in 0..200 {
            let mut it = ImpactObserver::new(settings(0.5));
            let (x0, v0, a) = (rng.between(3.0, 5.0), rng.between(-5.0, 5.0), -9.81);
            let d = rng.between(-3.0, 3.0);
            // sure of another place
            let state = ObserverState {
                started: true,
                estimate: Estimate { state: Physical { x: 1.0, xdot: 0.0 }, d },
                covariance: Covariance { xx: 1e-10, vv: 1e-10, dd: 1e-6, ..Covariance::default() },
                ..it.state()
            };
            it.set_state(state);
            let mut seen: Vec<(f64, f64)> = Vec::new();
            let wrong: Vec<usize> = match outliers {
                0 => vec![],
                1 => vec![1],
                _ => vec![0, 2],
            };
            let good_ones = |k: usize| (0..=k).filter(|j| !wrong.contains(j)).count();
            for k in 0..6 {
                let t = H * k as f64;
                let mut x = x0 + v0 * t + 0.5 * (a + d) * t * t;
                if wrong.contains(&k) {
                    x += rng.sign() * rng.between(0.2, 1.0);
                }
                for it in &mut seen {
                    it.1 += H;
                }
                if !wrong.contains(&k) {
                    seen.push((x, 0.0));
                }
                it.tick_after(H, at(x), a, 0.0).expect("finite");
                let now = it.state();
                let enough = good_ones(k) >= 4 && good_ones(k) + 2 > k && !wrong.contains(&k);
                assert_eq!(now.refused, k as u32 + 1);
                if enough {
                    assert_eq!((now.in_a_row, now.estimate.d), (0, d));
                    assert_fitted(&now, fit(&seen, a + d, 6.25));
                    break;
                }
                assert_eq!(now.in_a_row, k as u32 + 1, "{k} {outliers}");
                assert!(k < 5, "four of six agree");
            }
        }
    }
}

/// Nothing agrees: the fourteenth is believed, at rest, with the speed of its height.
#[test]
fn the_fourteenth_restarts_it_anyway() {
    let mut it = ImpactObserver::new(settings(0.5));
    let sure = Covariance { xx: 1e-10, vv: 1e-10, dd: 1e-6, ..Covariance::default() };
    let estimate = Estimate { state: Physical { x: 100.0, xdot: 0.0 }, d: 0.5 };
    it.set_state(ObserverState { started: true, estimate, covariance: sure, ..it.state() });
    let places = [1.0, 7.0, 2.0, 9.0, 4.0, 0.5, 8.0, 3.0, 6.5, 1.5, 5.0, 2.5, 7.5, 3.5];
    for (k, x) in places.into_iter().enumerate() {
        it.tick_after(H, at(x), -9.81, 1.0).expect("finite");
        let ObserverState { in_a_row, estimate, covariance, .. } = it.state();
        if k < 13 {
            assert_eq!(in_a_row, k as u32 + 1);
            continue;
        }
        assert_eq!((in_a_row, estimate.d), (0, 0.5));
        assert_eq!(estimate.state, Physical { x: 3.5, xdot: 0.0 });
        let a = -9.81 + 1.0 + 0.5;
        let vv = 8.0 * -a * (3.5 + 6.0 * SIGMA) + 100.0 * (SIGMA / H).powi(2);
        assert!(near(covariance.vv, vv, 1e-12));
        assert!(near(covariance.xx / (SIGMA * SIGMA), 4.0, 1e-12) && covariance.dd == 6.25);
    }
}

/// A gate of five standard deviations, to the last per cent; what is refused leaves the prediction.
#[test]
fn the_gate_is_at_five_deviations() {
    for (part, taken) in [(4.99, true), (5.01, false)] {
        let mut it = ImpactObserver::new(settings(0.5));
        let (xx, vv) = (3e-8, 1e-6);
        let covariance = Covariance { xx, vv, ..Covariance::default() };
        let estimate = Estimate { state: Physical { x: 1.0, xdot: 0.5 }, d: 0.0 };
        it.set_state(ObserverState { started: true, estimate, covariance, ..it.state() });
        let predicted = 1.0 + 0.5 * H - 0.5 * 9.81 * H * H;
        let of_x = xx + vv * H * H + 1e-10 * SIGMA * SIGMA + SIGMA * SIGMA;
        it.tick_after(H, at(predicted + part * of_x.sqrt()), -9.81, 0.0).expect("finite");
        assert_eq!(it.state().refused == 0, taken);
        let gain = (of_x - SIGMA * SIGMA) / of_x;
        let moved = if taken { gain * part * of_x.sqrt() } else { 0.0 };
        assert!(near(it.estimate().state.x, predicted + moved, 1e-12));
    }
}

/// What an impact leaves: `Xi` with its column of `e` where it is fast; where it is slow, or `e` is not
/// learnt, what is unknown of `e` is noise of the velocity.
#[test]
fn only_fast_impacts_tell_of_e() {
    let fast = 10.0 * SIGMA / H;
    for (speed, learn, se) in
        [(1.01 * fast, true, 0.07), (0.99 * fast, true, 0.07), (3.0, false, 0.07), (3.0, true, 0.0)]
    {
        let e = 0.6;
        let it =
            settings(e).with_restitution_error(se).and_then(|it| it.with_learning(learn, 1e-5));
        let mut it = ImpactObserver::new(it.expect("in range"));
        let deviation = if se > 0.0 { se } else { 0.1 };
        let prior = if learn { deviation * deviation } else { 0.0 };
        assert!(near(it.state().covariance.ee, prior, 1e-14) && it.state().e == e);
        // at the wall, without a force: the impact alone, then a flight of a period
        let estimate = Estimate { state: Physical { x: 0.0, xdot: -speed }, d: 0.0 };
        it.set_state(ObserverState { started: true, estimate, ..it.state() });
        it.tick_after(H, None, 0.0, 0.0).expect("finite");
        let Covariance { vv, ve, xe, ee, .. } = it.state().covariance;
        assert!(near(it.estimate().state.xdot, e * speed, 1e-14));
        let of_e = if learn { prior } else { se * se };
        let floor = 1e-12 * (SIGMA / H).powi(2);
        assert!((vv - of_e * speed * speed - floor).abs() <= 1e-12 * vv, "{vv}");
        let tells = learn && speed > fast;
        let wanted = if tells { prior * speed } else { 0.0 };
        assert!((ve - wanted).abs() <= 1e-12 && (xe - wanted * H).abs() <= 1e-14);
        let after = if learn { prior + 1e-5 } else { 0.0 };
        assert!((ee - after).abs() <= 1e-15);
    }
}

/// `se` without learning, and `q_e` no more than a deviation of one half.
#[test]
fn what_is_unknown_of_e_is_bounded() {
    let it = settings(0.6).with_learning(true, 0.2).expect("in range");
    let mut it = ImpactObserver::new(it);
    for _ in 0..3 {
        let estimate = Estimate { state: Physical { x: 0.0, xdot: -3.0 }, d: 0.0 };
        it.set_state(ObserverState { started: true, estimate, ..it.state() });
        it.tick_after(H, None, 0.0, 0.0).expect("finite");
    }
    assert_eq!(it.state().covariance.ee, 0.25);
}

/// A restitution that is learnt stays where walls are.
#[test]
fn a_learnt_restitution_is_cut() {
    for (push, end) in [(1e3, 0.999), (-1e3, 0.01)] {
        let it = settings(0.6).with_learning(true, 0.0).expect("in range");
        let mut it = ImpactObserver::new(it);
        let covariance =
            Covariance { xx: 1.0, xe: 0.9 * push / 1e3, ee: 1.0, ..Covariance::default() };
        let estimate = Estimate { state: Physical { x: 10.0, xdot: 0.0 }, d: 0.0 };
        it.set_state(ObserverState { started: true, estimate, covariance, ..it.state() });
        it.tick_after(H, at(13.0), 0.0, 0.0).expect("finite");
        assert_eq!((it.state().e, it.state().refused), (end, 0));
    }
    // and one that is not stays what it is
    let wall = Restitution::from_e(0.0).expect("in range");
    let it = ImpactObserver::new(ObserverSettings::new(wall, H).expect("in range"));
    assert_eq!((it.state().e, it.state().covariance.ee), (0.0, 0.0));
}

/// A period of `dt` adds the noise of `dt/h` periods; many small ones are one long one.
#[test]
fn noise_is_per_period() {
    let start = |it: &mut ImpactObserver| {
        let estimate = Estimate { state: Physical { x: 50.0, xdot: 1.0 }, d: 0.3 };
        let covariance = Covariance { xx: 1e-8, vv: 1e-4, dd: 1.0, ..Covariance::default() };
        it.set_state(ObserverState { started: true, estimate, covariance, ..it.state() });
    };
    let (mut one, mut many) =
        (ImpactObserver::new(settings(0.5)), ImpactObserver::new(settings(0.5)));
    start(&mut one);
    start(&mut many);
    one.tick_after(8.0 * H, None, -9.0, 0.0).expect("finite");
    for _ in 0..8 {
        many.tick_after(H, None, -9.0, 0.0).expect("finite");
    }
    assert!(near(one.state().covariance.dd, 1.0 + 8e-3, 1e-13));
    assert!(near(many.state().covariance.dd, 1.0 + 8e-3, 1e-13));
    assert!(near(one.estimate().state.x, many.estimate().state.x, 1e-13));
    let floor = 8.0 * 1e-10 * SIGMA * SIGMA;
    let t = 8.0 * H;
    let exact = 1e-8 + t * t * 1e-4 + 0.25 * t.powi(4) + floor;
    assert!((one.state().covariance.xx - exact).abs() <= 1e-22, "{}", one.state().covariance.xx);
    assert_eq!(one.state().memory, Memory::default());
}

/// What is remembered of positions: their ages, and the way that the acceleration has moved the mass.
#[test]
fn positions_are_remembered_with_their_ways() {
    let rng = Rng::new(9);
    let mut it = ImpactObserver::new(settings(0.5));
    let mut seen: Vec<(f64, f64)> = Vec::new();
    let (mut now, mut history) = (0.0, Vec::<(f64, f64, f64)>::new());
    for k in 0..12 {
        let (dt, a) = (H * rng.between(0.2, 3.0), rng.between(-20.0, 5.0));
        let d = it.estimate().d;
        let x = 5.0 + 1e-5 * f64::from(k);
        let measured = if rng.chance(0.7) { at(x) } else { None };
        it.tick_after(dt, measured, a, 0.0).expect("finite");
        history.push((now, now + dt, a + d));
        now += dt;
        if measured.is_some() {
            seen.push((x, now));
        }
        // the integral of a(s) (s - t_i)
        let way = |t: f64| -> f64 {
            let since = history.iter().filter(|(from, _, _)| *from >= t - 1e-15);
            since.map(|(from, to, a)| 0.5 * a * ((to - t).powi(2) - (from - t).powi(2))).sum()
        };
        let kept = it.state().memory;
        assert_eq!(kept.count as usize, seen.len().min(6));
        assert_eq!(kept.seen().count(), seen.len().min(6));
        for (found, (x, t)) in kept.seen().zip(seen.iter().rev()) {
            let Seen { y, age } = found;
            assert!((age - (now - t)).abs() <= 1e-14 && (y - (x - way(*t))).abs() <= 1e-14);
        }
    }
}

/// The largest variance of the velocity: by the energy, the noise, and the velocity's own sensor.
#[test]
fn the_velocity_is_bounded_by_the_energy() {
    for of_velocity in [false, true] {
        let settings = settings(0.5).with_position_only(false);
        let settings = settings.with_noise(SIGMA, 30.0).expect("in range");
        let mut it = ImpactObserver::new(settings);
        let xx = 1e-12;
        let covariance = Covariance { xx, vv: 1e9, ..Covariance::default() };
        let estimate = Estimate { state: Physical { x: 2.0, xdot: 3.0 }, d: 1.0 };
        it.set_state(ObserverState { started: true, estimate, covariance, ..it.state() });
        let mut same = it;
        same.tick_after(H, None, -9.0, -2.0).expect("finite");
        let Estimate { state, .. } = same.estimate();
        let Covariance { xx, vv, .. } = same.state().covariance;
        let energy = state.xdot * state.xdot + 2.0 * 10.0 * (state.x + 6.0 * xx.sqrt());
        let most = 4.0 * energy + 100.0 * (SIGMA / H).powi(2);
        assert!(near(vv, most, 1e-12), "{vv} {most}");
        // a measured velocity is weighed against what its sensor may be off by
        if of_velocity {
            let measured = Measurement { x: state.x, xdot: Some(state.xdot + 1.0) };
            it.tick(measured, -9.0, -2.0).expect("finite");
            assert_eq!(it.state().refused, 0);
            let found = it.state().covariance.vv;
            // no larger than the bound with the sensor's deviation, no smaller than without it
            assert!(found < most + 4.0 * 900.0 && found > 0.0);
        }
    }
}

/// More than twenty impacts in a period, or flights that end within it, are rest.
#[test]
fn rest_keeps_what_is_unknown_of_the_force_and_of_e() {
    let it = settings(0.5).with_learning(true, 0.0).expect("in range");
    let mut it = ImpactObserver::new(it);
    let covariance = Covariance {
        xx: 1e-8,
        vv: 1e-6,
        dd: 2.0,
        ee: 0.04,
        de: 0.1,
        xe: 1e-6,
        ve: 1e-5,
        xd: 1e-6,
        vd: 1e-5,
        ..Covariance::default()
    };
    let estimate = Estimate { state: Physical { x: 0.0, xdot: 1e-4 }, d: 0.0 };
    it.set_state(ObserverState { started: true, estimate, covariance, ..it.state() });
    it.tick_after(H, None, -9.81, 0.0).expect("finite");
    let Covariance { xx, xv, xd, vv, vd, dd, xe, ve, de, ee } = it.state().covariance;
    assert_eq!(it.estimate().state, Physical::default());
    assert_eq!([xv, xd, vd, xe, ve, de, ee], [0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.04]);
    assert!(xx < 1e-17 && vv < 1e-13 && near(dd, 2.001, 1e-12));
}
