//! Affine VIs with planted solutions.

use crate::support::{p_matrix, planted, residual, solve, Random};
use proptest::prelude::*;
use zivi_core::vi::{Affine, Settings, Stage, Start};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// A P-matrix gives exactly one solution, and Lemke's method finds it.
    #[test]
    fn every_p_matrix_is_solved_and_the_planted_solution_found(
        seed in any::<u64>(), n in 1_usize..20, kind in 0_usize..4, ray in any::<bool>(),
    ) {
        let mut random = Random::new(seed);
        let m = p_matrix(kind, n, &mut random);
        let [q, lower, upper, expected] = planted(&m, n, &mut random);
        let mut affine = Affine { matrix: &m, q: &q };
        let mut z: Vec<f64> = (0..n).map(|_| 3.0 * random.normal()).collect();
        let first_start = if ray { Start::Ray } else { Start::Regular };
        let settings = Settings { first_start, smoothing: false, ..Settings::default() };
        let report = solve(&mut affine, &lower, &upper, &mut z, &settings).unwrap();
        prop_assert!(report.status.is_success(), "{report:?}");
        prop_assert_eq!(report.stage, Stage::JosephyNewton);
        let left = residual(&mut affine, &lower, &upper, &z);
        prop_assert!(left <= report.tolerance, "{left} {report:?}");
        let error = z.iter().zip(&expected).fold(0.0, |e, (a, b)| f64::max(e, (a - b).abs()));
        let scaled = kind == 3; // condition numbers to 1e8
        prop_assert!(error < if scaled { 1e-4 } else { 1e-7 }, "{error} {report:?}");
        prop_assert_eq!(report.residual.to_bits(), left.to_bits(), "the report recomputes it");
    }

    /// The exact end of a path: components at a bound are there to the last bit.
    #[test]
    fn the_solution_is_in_the_box_and_exactly_on_its_bounds(
        seed in any::<u64>(), n in 1_usize..12,
    ) {
        let mut random = Random::new(seed);
        let m = p_matrix(0, n, &mut random);
        let [q, lower, upper, expected] = planted(&m, n, &mut random);
        let mut affine = Affine { matrix: &m, q: &q };
        let mut z = vec![0.0; n];
        let report = solve(&mut affine, &lower, &upper, &mut z, &Settings::default()).unwrap();
        prop_assert!(report.status.is_success());
        let mut f = vec![0.0; n];
        zivi_core::vi::Problem::map(&mut affine, &z, &mut f).unwrap();
        for i in 0..n {
            prop_assert!(lower[i] <= z[i] && z[i] <= upper[i]);
            if f[i] > 1e-6 && lower[i] < upper[i] {
                prop_assert_eq!(z[i], lower[i], "expected {}", expected[i]);
            }
            if f[i] < -1e-6 && lower[i] < upper[i] {
                prop_assert_eq!(z[i], upper[i], "expected {}", expected[i]);
            }
        }
    }
}

/// The pivotal solver alone: one Josephy-Newton iteration is one affine solve.
fn solved_by_one_path(m: &[f64], n: usize, random: &mut Random) -> bool {
    let [q, lower, upper, _] = planted(m, n, random);
    let settings = Settings { max_iterations: 1, enumerate_up_to: 0, ..Settings::default() };
    let mut z = vec![0.0; n];
    let mut affine = Affine { matrix: m, q: &q };
    solve(&mut affine, &lower, &upper, &mut z, &settings).unwrap().status.is_success()
}

#[test]
fn large_p_matrices_take_one_path() {
    for n in [50, 120, 200] {
        for kind in 0..4 {
            let mut random = Random::new((n + kind) as u64);
            let m = p_matrix(kind, n, &mut random);
            assert!(solved_by_one_path(&m, n, &mut random), "n = {n}, kind {kind}");
        }
    }
}

/// Condition numbers to 1e10: `Q' diag(d) Q` with `Q` a product of reflections.
#[test]
fn ill_conditioned_definite_matrices() {
    for seed in 0..200 {
        let mut random = Random::new(seed);
        let n = 2 + random.below(40);
        let spread = random.within(2.0, 5.0);
        let mut m = vec![0.0; n * n];
        for i in 0..n {
            let end = if i == 0 {
                -spread
            } else if i == 1 {
                spread
            } else {
                0.0
            };
            let power = if i < 2 { end } else { random.within(-spread, spread) };
            m[i * n + i] = 10f64.powf(power);
        }
        for _ in 0..3 {
            let v: Vec<f64> = (0..n).map(|_| random.normal()).collect();
            reflect(&mut m, &v);
        }
        let [q, lower, upper, _] = planted(&m, n, &mut random);
        let mut affine = Affine { matrix: &m, q: &q };
        let mut z = vec![0.0; n];
        let report = solve(&mut affine, &lower, &upper, &mut z, &Settings::default()).unwrap();
        assert!(report.status.is_success(), "seed {seed}, n = {n}: {report:?}");
        let left = residual(&mut affine, &lower, &upper, &z);
        assert!(left <= report.tolerance && report.tolerance < 1e-7, "{left} {report:?}");
    }
}

/// `M <- H M H`, `H = I - 2 v v'/v'v`.
fn reflect(m: &mut [f64], v: &[f64]) {
    let n = v.len();
    let norm: f64 = v.iter().map(|v| v * v).sum();
    for transpose in [false, true] {
        let index = |i: usize, j: usize| if transpose { j * n + i } else { i * n + j };
        for j in 0..n {
            let along: f64 = (0..n).map(|i| v[i] * m[index(i, j)]).sum::<f64>() * 2.0 / norm;
            (0..n).for_each(|i| m[index(i, j)] -= along * v[i]);
        }
    }
    // rounding must not cost the symmetry
    for i in 0..n {
        for j in 0..i {
            let mean = 0.5 * (m[i * n + j] + m[j * n + i]);
            (m[i * n + j], m[j * n + i]) = (mean, mean);
        }
    }
}

/// Skew matrices on bounded boxes: monotone, always solvable, highly degenerate for Newton.
#[test]
fn skew_matrices_on_bounded_boxes() {
    for seed in 0..300 {
        let mut random = Random::new(seed);
        let n = 1 + random.below(25);
        let mut m = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..i {
                m[i * n + j] = random.normal();
                m[j * n + i] = -m[i * n + j];
            }
        }
        let q: Vec<f64> = (0..n).map(|_| random.normal()).collect();
        let lower: Vec<f64> = (0..n).map(|_| -random.within(0.1, 2.0)).collect();
        let upper: Vec<f64> = (0..n).map(|_| random.within(0.1, 2.0)).collect();
        let mut affine = Affine { matrix: &m, q: &q };
        let mut z = vec![0.0; n];
        let report = solve(&mut affine, &lower, &upper, &mut z, &Settings::default()).unwrap();
        assert!(report.status.is_success(), "seed {seed}, n = {n}: {report:?}");
        assert!(residual(&mut affine, &lower, &upper, &z) <= 1e-9);
    }
}

/// The classical degenerate LCP on which pivoting without a tie rule can cycle, and all ties:
/// `q = 0`, `q = -1` with integer matrices.
#[test]
fn ties_everywhere() {
    for seed in 0..500 {
        let mut random = Random::new(seed);
        let n = 2 + random.below(7);
        let mut m: Vec<f64> = (0..n * n).map(|_| random.below(3) as f64 - 1.0).collect();
        for i in 0..n {
            m[i * n + i] = n as f64;
        }
        for q in [0.0, -1.0, 1.0] {
            let q = vec![q; n];
            for upper in [f64::INFINITY, 1.0] {
                let (lower, upper) = (vec![0.0; n], vec![upper; n]);
                let mut affine = Affine { matrix: &m, q: &q };
                let mut z = vec![0.0; n];
                let settings = Settings { max_iterations: 1, ..Settings::default() };
                let report = solve(&mut affine, &lower, &upper, &mut z, &settings).unwrap();
                assert!(report.status.is_success(), "seed {seed}: {report:?}");
            }
        }
    }
}

/// Monotone but singular: Gram matrices of half rank, and saddle points of quadratic programs.
#[test]
fn semidefinite_matrices_with_planted_solutions() {
    for seed in 0..400 {
        let mut random = Random::new(seed);
        let n = 2 + random.below(24);
        let half = n / 2;
        let b: Vec<f64> = (0..n * half).map(|_| random.normal()).collect();
        let row = |i: usize| &b[i * half..(i + 1) * half];
        let dot = |i: usize, j: usize| row(i).iter().zip(row(j)).map(|(a, b)| a * b).sum::<f64>();
        let saddle = seed % 2 == 1;
        let mut m = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..n {
                m[i * n + j] = match (saddle, i < half, j < half) {
                    (true, true, false) => b[j * half + i],
                    (true, false, true) => -b[i * half + j],
                    (true, false, false) => 0.0,
                    _ => dot(i, j) / n as f64,
                };
            }
        }
        let [q, lower, upper, _] = planted(&m, n, &mut random);
        let mut affine = Affine { matrix: &m, q: &q };
        let mut z = vec![0.0; n];
        let report = solve(&mut affine, &lower, &upper, &mut z, &Settings::default()).unwrap();
        assert!(report.status.is_success(), "seed {seed}, n = {n}: {report:?}");
        assert!(residual(&mut affine, &lower, &upper, &z) <= report.tolerance);
    }
}

/// No method is sure to solve a general matrix. That most are solved is measured, not promised.
#[test]
fn general_matrices_with_planted_solutions() {
    let (mut solved, count) = (0, 300);
    for seed in 0..count {
        let mut random = Random::new(seed);
        let n = 2 + random.below(14);
        let m: Vec<f64> = (0..n * n).map(|_| random.normal()).collect();
        let [q, lower, upper, _] = planted(&m, n, &mut random);
        let mut affine = Affine { matrix: &m, q: &q };
        let mut z = vec![0.0; n];
        let report = solve(&mut affine, &lower, &upper, &mut z, &Settings::default()).unwrap();
        let left = residual(&mut affine, &lower, &upper, &z);
        assert!(!report.status.is_success() || left <= report.tolerance, "seed {seed}: {left}");
        solved += usize::from(report.status.is_success());
    }
    println!("{solved} of {count} solved");
    assert!(solved >= 295, "{solved} of {count}");
}
