//! A stage alone, without those that come to its help: what it solves, and in how many steps.

use crate::support::{p_matrix, planted, residual, solve, Maps, Random};
use zivi_core::vi::{Affine, Settings, Stage};

/// No stage but those before Newton's methods.
fn none() -> Settings<'static> {
    Settings {
        josephy_newton: false,
        smoothing: false,
        semismooth: false,
        proximal: false,
        restarts: 0,
        enumerate_up_to: 0,
        test_isolation: false,
        ..Settings::default()
    }
}

/// The smoothing Newton method takes a handful of factorisations, whatever the size and the scale.
#[test]
fn smoothing_solves_affine_problems_in_few_steps() {
    let settings = Settings { smoothing: true, ..none() };
    for seed in 0..120 {
        let mut random = Random::new(seed);
        let n = 2 + random.below(30);
        let m = p_matrix((seed % 3) as usize, n, &mut random);
        let [q, lower, upper, expected] = planted(&m, n, &mut random);
        let mut affine = Affine { matrix: &m, q: &q };
        let mut z = vec![0.0; n];
        let report = solve(&mut affine, &lower, &upper, &mut z, &settings).unwrap();
        assert!(report.status.is_success(), "seed {seed}: {report:?}");
        assert_eq!((report.stage, report.counts.pivots), (Stage::Smoothing, 0));
        let error = z.iter().zip(&expected).fold(0.0, |e: f64, (a, b)| e.max((a - b).abs()));
        assert!(error < 1e-6, "seed {seed}: {error}");
        assert!(report.counts.smoothing_steps <= 5, "seed {seed}: {report:?}");
    }
}

/// Monotone, without a strict part: the set of active bounds shows late.
#[test]
fn smoothing_solves_skew_problems() {
    let settings = Settings { smoothing: true, ..none() };
    let mut steps = Vec::new();
    for seed in 0..60 {
        let mut random = Random::new(seed);
        let n = 4 + 2 * random.below(15);
        let raw: Vec<f64> = (0..n * n).map(|_| random.normal()).collect();
        let m: Vec<f64> = (0..n * n).map(|k| raw[k] - raw[k % n * n + k / n]).collect();
        let (lower, upper) = (vec![-1.0; n], vec![1.0; n]);
        let q: Vec<f64> = (0..n).map(|_| random.normal()).collect();
        let mut affine = Affine { matrix: &m, q: &q };
        let mut z = vec![0.0; n];
        let report = solve(&mut affine, &lower, &upper, &mut z, &settings).unwrap();
        if report.status.is_success() {
            assert!(residual(&mut affine, &lower, &upper, &z) <= 1e-9, "seed {seed}");
            steps.push(report.counts.smoothing_steps);
        }
    }
    // measured: 58 of 60, at most 15 steps, 5 in the mean
    assert!(steps.len() >= 56, "{steps:?}");
    assert!(steps.iter().all(|&steps| steps <= 20), "{steps:?}");
    assert!(steps.iter().sum::<usize>() <= 6 * steps.len(), "{steps:?}");
}

/// Newton's methods all: `F_i = z_i + z_i^3 + (M z)_i + q_i` with a planted solution.
fn monotone(seed: u64, settings: &Settings<'_>) -> (zivi_core::vi::Report, f64) {
    let mut random = Random::new(seed);
    let n = 2 + random.below(12);
    let m = p_matrix(0, n, &mut random);
    let [_, lower, upper, expected] = planted(&m, n, &mut random);
    let row = |z: &[f64], i: usize| {
        let linear: f64 = (0..n).map(|j| m[i * n + j] * z[j]).sum();
        linear + z[i] + z[i].powi(3)
    };
    // zero inside, of the right sign at a bound
    let q: Vec<f64> = (0..n)
        .map(|i| {
            let push = if expected[i] == lower[i] {
                0.3
            } else if expected[i] == upper[i] {
                -0.3
            } else {
                0.0
            };
            push - row(&expected, i)
        })
        .collect();
    let mut problem = Maps(
        |z: &[f64], f: &mut [f64]| (0..n).for_each(|i| f[i] = row(z, i) + q[i]),
        |z: &[f64], j: &mut [f64]| {
            j.copy_from_slice(&m);
            (0..n).for_each(|i| j[i * n + i] += 1.0 + 3.0 * z[i] * z[i]);
        },
    );
    let mut z = vec![0.0; n];
    let report = solve(&mut problem, &lower, &upper, &mut z, settings).unwrap();
    let error = z.iter().zip(&expected).fold(0.0, |e: f64, (a, b)| e.max((a - b).abs()));
    (report, error)
}

/// Where the matrix is singular a damped step is taken, which needs no gradient steps.
#[test]
fn semismooth_steps_are_damped_where_the_matrix_is_singular() {
    let (m, q) = ([1.0; 4], [-2.0; 2]);
    let mut z = [0.5, 0.0];
    let settings = Settings { semismooth: true, ..none() };
    let mut affine = Affine { matrix: &m, q: &q };
    let (lower, upper) = ([f64::NEG_INFINITY; 2], [f64::INFINITY; 2]);
    let report = solve(&mut affine, &lower, &upper, &mut z, &settings).unwrap();
    assert!(report.status.is_success() && (z[0] + z[1] - 2.0).abs() < 1e-9, "{report:?} {z:?}");
    assert!(report.counts.semismooth_steps > 0, "{report:?}");
    assert_eq!(report.counts.gradient_steps, 0, "{report:?}");
}

/// Slopes that are far too small: every Newton step is too long, even after its halvings.
#[test]
fn gradient_steps_help_where_no_newton_step_is_short_enough() {
    let mut problem = Maps(
        |z: &[f64], f: &mut [f64]| f[0] = z[0] - 1.0,
        |_: &[f64], j: &mut [f64]| j[0] = 2_f64.powi(-20),
    );
    let settings = Settings { semismooth: true, ..none() };
    let mut z = [0.0];
    let (lower, upper) = ([f64::NEG_INFINITY], [f64::INFINITY]);
    let report = solve(&mut problem, &lower, &upper, &mut z, &settings).unwrap();
    assert!(report.status.is_success() && (z[0] - 1.0).abs() < 1e-9, "{report:?} {z:?}");
    let counts = report.counts;
    assert_eq!((counts.iterations, counts.gradient_steps, counts.semismooth_steps), (1, 1, 0));
}

#[test]
fn each_stage_solves_monotone_problems_alone() {
    let alone = [
        (Stage::JosephyNewton, Settings { josephy_newton: true, ..none() }),
        (Stage::Smoothing, Settings { smoothing: true, ..none() }),
        (Stage::Semismooth, Settings { semismooth: true, ..none() }),
        (Stage::Proximal, Settings { proximal: true, ..none() }),
    ];
    for (stage, settings) in alone {
        let mut iterations = 0;
        for seed in 0..60 {
            let (report, error) = monotone(seed, &settings);
            assert!(report.status.is_success() && error < 1e-7, "{stage:?} {seed}: {report:?}");
            assert_eq!(report.stage, stage);
            assert!((1..=12).contains(&report.counts.iterations), "{stage:?} {seed}: {report:?}");
            iterations += report.counts.iterations;
        }
        // smoothing tries the set of active bounds on its way, else it takes 465
        let most = if stage == Stage::Smoothing { 300 } else { 450 };
        assert!(iterations <= most, "{stage:?} {iterations}");
    }
}
