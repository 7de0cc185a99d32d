//! The observer against differences of the exact map, a mass that it has to see, and noise.

use crate::common::Rng;
use zivi_core::observer::{
    Covariance, Estimate, ImpactObserver, Measurement, ObserverSettings, ObserverState,
};
use zivi_core::{Physical, Restitution};

/// The state after `left` seconds, by its own recursion over flights, their number and the speed of
/// the slowest impact; `None` where there are many.
fn exact([x, v, d]: [f64; 3], known: f64, e: f64, mut left: f64) -> Option<([f64; 3], usize, f64)> {
    let (mut x, mut v, a, mut slowest) = (x, v, known + d, f64::INFINITY);
    for impacts in 0..5 {
        // roots of x + v t + a t^2/2
        let (half, root) = (-v / a, (v * v - 2.0 * a * x).max(0.0).sqrt() / a.abs());
        let later = |t: &f64| *t > 1e-9 * left;
        let next = [half - root, half + root].into_iter().filter(later).reduce(f64::min);
        match next.filter(|_| v * v - 2.0 * a * x >= 0.0) {
            Some(t) if t <= left => {
                slowest = slowest.min((v + a * t).abs());
                (x, v, left) = (0.0, -e * (v + a * t), left - t);
            }
            _ => {
                return Some((
                    [x + v * left + 0.5 * a * left * left, v + a * left, d],
                    impacts,
                    slowest,
                ))
            }
        }
    }
    None
}

fn observer(e: f64, h: f64, q_d: f64) -> ImpactObserver {
    let restitution = Restitution::from_e(e).expect("in range");
    let settings = ObserverSettings::new(restitution, h).and_then(|it| it.with_force(q_d, 1e3));
    ImpactObserver::new(settings.expect("in range"))
}

/// `J P J^T` with `J` by central differences of the exact map, against the filter's prediction: a
/// measurement beyond the gate leaves it as it is.
#[test]
fn the_covariance_is_that_of_the_exact_map() {
    let rng = Rng::new(7);
    let (mut seen, mut worst) = ([0; 5], 0.0_f64);
    while seen.iter().sum::<u32>() < 3000 {
        let (e, h) = (rng.between(0.1, 0.95), rng.log_between(1e-4, 1e-2));
        let (known, d) = (-rng.between(2.0, 30.0), rng.between(-1.5, 1.5));
        let speed = h * known.abs() * rng.log_between(0.2, 5.0);
        let (x, v) = (speed * h * rng.between(0.05, 1.5), rng.between(-1.0, 1.0) * speed);
        let z = [x, v, d, e];
        let moves = |[x, v, d, e]: [f64; 4]| exact([x, v, d], known, e, h);
        let Some((end, impacts, slowest)) = moves(z) else { continue };
        let step = [1e-5 * x, 1e-5 * speed, 1e-5 * known.abs(), 1e-5];
        let mut jacobian = [[0.0; 4]; 4];
        let mut smooth = true;
        for column in 0..4 {
            let moved = |sign: f64| {
                let mut z = z;
                z[column] += sign * step[column];
                moves(z)
            };
            let (Some((plus, n, _)), Some((minus, m, _))) = (moved(1.0), moved(-1.0)) else {
                smooth = false;
                break;
            };
            smooth &= n == impacts && m == impacts;
            for row in 0..3 {
                jacobian[row][column] = (plus[row] - minus[row]) / (2.0 * step[column]);
            }
        }
        jacobian[3][3] = 1.0;
        // slow impacts are where the filter's derivative is cut
        if !smooth || slowest < 0.1 * h * (known + d).abs() {
            continue;
        }
        // positions so exact that every impact tells of e, and no variance is cut
        let wall = Restitution::from_e(e).expect("in range");
        let sensor = 1e-3 * h * slowest.min(speed);
        let settings = ObserverSettings::new(wall, h)
            .and_then(|it| it.with_noise(sensor, 1e-2))
            .and_then(|it| it.with_force(0.0, 1e3))
            .and_then(|it| it.with_learning(true, 0.0));
        let mut it = ImpactObserver::new(settings.expect("in range"));
        let size = [x, speed, known.abs(), 1.0];
        // small against what the velocity's variance is cut to
        let part = 1e-4;
        let of = |i: usize, j: usize, share: f64| part * share * size[i] * size[j];
        let covariance = Covariance {
            xx: of(0, 0, 1.0),
            vv: of(1, 1, 1.0),
            dd: of(2, 2, 1.0),
            ee: of(3, 3, 1.0),
            xv: of(0, 1, 0.3),
            xd: of(0, 2, -0.2),
            vd: of(1, 2, 0.1),
            xe: of(0, 3, -0.25),
            ve: of(1, 3, 0.15),
            de: of(2, 3, 0.35),
        };
        let estimate = Estimate { state: Physical { x, xdot: v }, d };
        it.set_state(ObserverState { started: true, estimate, covariance, ..it.state() });
        let far = Measurement { x: 1e9, xdot: None };
        let found = it.tick(far, known, 0.0).expect("finite");
        assert_eq!(it.state().refused, 1);
        let near = |a: f64, b: f64, size: f64| (a - b).abs() <= 1e-9 * size;
        assert!(near(found.state.x, end[0].max(0.0), x) && near(found.state.xdot, end[1], speed));
        let (p, q) = (covariance.rows(), it.state().covariance.rows());
        for row in 0..4 {
            for column in 0..4 {
                let terms = (0..16).map(|k| (k / 4, k % 4));
                let term =
                    |(i, j): (usize, usize)| jacobian[row][i] * p[i][j] * jacobian[column][j];
                let wanted: f64 = terms.clone().map(term).sum();
                let size: f64 = terms.map(|it| term(it).abs()).sum();
                let unit = [1e-10 * sensor * sensor, 1e-12 * (sensor / h).powi(2), 0.0, 0.0];
                let floor = if row == column { unit[row] } else { 0.0 };
                let off = (q[row][column] - floor - wanted).abs() / (size + floor);
                worst = worst.max(off);
            }
        }
        seen[impacts] += 1;
    }
    println!("{seen:?}, largest difference {worst:.1e}");
    assert!(seen[0] > 300 && seen[1] > 300 && seen[2] > 20, "{seen:?}");
    assert!(worst < 1e-6, "{worst}");
}

/// At rest nothing is known of the force: its estimate stays, its variance grows to the bound.
#[test]
fn rest_hides_the_force() {
    let mut it = observer(0.5, 1e-3, 1e-2);
    let rest = Measurement { x: 0.0, xdot: Some(0.0) };
    it.tick(rest, -9.81, 0.0).expect("finite");
    let estimate = Estimate { state: Physical::default(), d: 1.25 };
    let covariance =
        Covariance { dd: 4.0, xd: 1e-5, vd: 1e-3, xx: 1e-8, vv: 1e-4, ..Covariance::default() };
    it.set_state(ObserverState { estimate, covariance, ..it.state() });
    for k in 1..=1000 {
        it.tick(rest, -9.81, 0.0).expect("finite");
        let state = it.state();
        assert_eq!((state.estimate.d, state.covariance.xd, state.covariance.vd), (1.25, 0.0, 0.0));
        assert!((state.covariance.dd - (4.0 + 1e-2 * f64::from(k))).abs() < 1e-9);
    }
    // the same with a small bound
    let settings = it.settings().with_force(1.0, 3.0).expect("in range");
    let mut bounded = ImpactObserver::new(settings);
    bounded.set_state(it.state());
    for _ in 0..20 {
        bounded.tick(rest, -9.81, 0.0).expect("finite");
    }
    assert_eq!(bounded.state().covariance.dd, 9.0);
}

#[test]
fn five_measurements_beyond_the_gate_restart_it() {
    let mut it = observer(0.5, 1e-3, 1e-3);
    let at = |x: f64| Measurement { x, xdot: Some(0.0) };
    for _ in 0..50 {
        it.tick(at(1.0), 0.0, 0.0).expect("finite");
    }
    let d = it.estimate().d;
    for k in 1..5 {
        let before = it.estimate().state.x;
        it.tick(at(2.0), 0.0, 0.0).expect("finite");
        assert!((it.estimate().state.x - before).abs() < 1e-3);
        assert_eq!((it.state().in_a_row, it.state().refused), (k, k));
    }
    it.tick(at(2.0), 0.0, 0.0).expect("finite");
    assert_eq!(it.estimate(), Estimate { state: Physical { x: 2.0, xdot: 0.0 }, d });
    assert_eq!((it.state().in_a_row, it.state().refused), (0, 5));
    it.tick(at(2.0), 0.0, 0.0).expect("finite");
    assert_eq!(it.state().in_a_row, 0);
}

#[test]
fn what_is_refused_changes_nothing() {
    let mut it = observer(0.5, 1e-3, 1e-3);
    let good = Measurement { x: 1.0, xdot: Some(0.0) };
    it.tick(good, 0.0, 0.0).expect("finite");
    let before = it.state();
    let bad = f64::NAN;
    for (measured, force, u, dt, name) in [
        (Measurement { x: f64::INFINITY, ..good }, 0.0, 0.0, 1e-3, "x"),
        (Measurement { xdot: Some(f64::INFINITY), ..good }, 0.0, 0.0, 1e-3, "xdot"),
        (good, bad, 0.0, 1e-3, "force"),
        (good, 0.0, bad, 1e-3, "u"),
        (good, 0.0, 0.0, 0.0, "dt"),
        (good, 1e308, 1e308, 1e-3, "x"),
    ] {
        let error = it.tick_after(dt, Some(measured), force, u).expect_err("refused");
        assert_eq!((error.name, it.state()), (name, before));
    }
}

#[test]
fn what_is_nan_is_not_measured() {
    let mut it = observer(0.5, 1e-3, 1e-3);
    let good = Measurement { x: 1.0, xdot: Some(0.5) };
    it.tick(good, -9.81, 0.0).expect("finite");
    let mut other = it;
    let nan = f64::NAN;
    let pairs = [
        (Some(Measurement { x: nan, ..good }), None),
        (Some(Measurement { x: nan, xdot: Some(nan) }), None),
        (Some(Measurement { xdot: Some(nan), ..good }), Some(Measurement { xdot: None, ..good })),
    ];
    for (one, same) in pairs {
        let found = it.tick_after(1e-3, one, -9.81, 0.0).expect("missing");
        assert_eq!(found, other.tick_after(1e-3, same, -9.81, 0.0).expect("missing"));
        assert_eq!(it.state(), other.state());
    }
}

/// Random masses, forces, settings and measurements, good and senseless: nothing fails, nothing
/// grows without bound.
fn stress(draws: u32, seed: u64) {
    let rng = Rng::new(seed);
    for _ in 0..draws {
        let e = rng.pick(&[0.0, 1.0, rng.between(0.0, 1.0)]);
        let h = rng.log_between(1e-5, 1e-1);
        let restitution = Restitution::from_e(e).expect("in range");
        let dmax = rng.log_between(0.1, 100.0);
        let sensor = [rng.log_between(1e-7, 1e-1), rng.log_between(1e-5, 10.0)];
        let learns = rng.chance(0.5);
        let settings = ObserverSettings::new(restitution, h)
            .and_then(|it| it.with_noise(sensor[0], sensor[1]))
            .and_then(|it| it.with_learning(learns, rng.pick(&[0.0, 1e-6, 0.1])))
            .and_then(|it| it.with_force(rng.log_between(1e-8, 1e2), dmax))
            .and_then(|it| it.with_restitution_error(rng.pick(&[0.0, 0.03, 0.5])));
        let mut it = ImpactObserver::new(settings.expect("in range"));
        let (wild, mut before) = (rng.pick(&[1e-3, 0.1, 10.0]), 0.0_f64);
        let (mut x, mut v) = (rng.between(0.0, 2.0), rng.between(-3.0, 3.0));
        for _ in 0..1000 {
            let a = rng.between(-30.0, 10.0);
            v += h * a;
            x += h * v;
            if !(0.0..=10.0).contains(&x) {
                (x, v) = (x.clamp(0.0, 10.0), -e * v);
            }
            let noise = |size: f64| size * rng.between(-1.0, 1.0);
            let xdot = rng.chance(0.5).then(|| v + noise(wild));
            let found = it.tick(Measurement { x: x + noise(wild), xdot }, a, noise(5.0));
            let found = found.expect("finite");
            assert!(found.state.x >= 0.0 && found.d.abs() <= dmax);
            let believed = it.state().e;
            assert!(if learns {
                (0.01..=0.999).contains(&believed) || believed == e
            } else {
                believed == e
            });
            let covariance = it.state().covariance;
            let Covariance { xx, xv, xd, vv, vd, dd, .. } = covariance;
            assert!(xx >= 0.0 && vv >= 0.0 && dd >= 0.0 && dd <= dmax * dmax, "{covariance:?}");
            // by the energy of the mass that is believed in, and the speed of noise
            let [of_x, of_v] = sensor;
            let fast = found.state.xdot.abs().max(before) + h * (dmax + 40.0);
            let most = fast * fast + 2.0 * (dmax + 40.0) * (found.state.x + 10.0 * wild + 1e3);
            let noise = 100.0 * (of_x / h).powi(2) + 4.0 * of_v * of_v + most;
            assert!(vv <= 5.0 * (most + noise), "{e} {h} {covariance:?}");
            before = found.state.xdot.abs();
            let slack = 1.0 + 1e-6;
            assert!(xv * xv <= slack * xx * vv + 1e-20, "{covariance:?}");
            assert!(xd * xd <= slack * xx * dd + 1e-20, "{covariance:?}");
            assert!(vd * vd <= slack * vv * dd + 1e-12, "{covariance:?}");
        }
    }
}

#[test]
fn random_measurements_leave_it_sound() {
    stress(100, 11);
}

/// A million of them: `cargo test --release -p zivi-core --test observer -- --ignored`.
#[test]
#[ignore = "some seconds"]
fn a_million_random_measurements_leave_it_sound() {
    stress(1000, 12);
}
