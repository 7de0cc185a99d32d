//! The stages of the solver: each fall-back is needed somewhere, every end has its status, and
//! nothing but the residual makes a solution.

use crate::support::{residual, solve, Maps};
use zivi_core::vi::{
    Affine, EvaluationError, Interruption, InvalidInput, Problem, RowScale, Settings, Stage, Status,
};

const INF: f64 = f64::INFINITY;

type Scalar = fn(f64) -> f64;

fn scalar(f: Scalar, slope: Scalar) -> impl Problem {
    Maps(
        move |z: &[f64], out: &mut [f64]| out[0] = f(z[0]),
        move |z: &[f64], out: &mut [f64]| out[0] = slope(z[0]),
    )
}

const ONLY_S0: Settings<'static> = Settings {
    tol: 1e-9,
    rtol: 0.0,
    row_scale: RowScale::Unit,
    max_iterations: 10_000,
    stage_iterations: 200,
    max_pivots: None,
    total_pivots: None,
    line_search: true,
    memory: 8,
    descent_steps: true,
    active_set: true,
    first_start: zivi_core::vi::Start::Regular,
    josephy_newton: true,
    smoothing: false,
    semismooth: false,
    proximal: false,
    restarts: 0,
    enumerate_up_to: 0,
    test_isolation: true,
};

#[test]
fn the_line_search_is_needed() {
    let atan = || scalar(f64::atan, |z| 1.0 / (1.0 + z * z));
    let run = |problem: &mut dyn Problem, line_search| {
        let mut z = [20.0];
        let settings = Settings { line_search, descent_steps: false, ..ONLY_S0 };
        solve(problem, &[-INF], &[INF], &mut z, &settings).unwrap()
    };
    let damped = run(&mut atan(), true);
    assert_eq!(damped.status, Status::Solved);
    // without it Newton's method diverges, and says so
    let undamped = run(&mut atan(), false);
    assert!(!undamped.status.is_success() && undamped.residual > 1.0, "{undamped:?}");
}

#[test]
fn restarts_or_enumeration_are_needed_on_billups() {
    let billups = || scalar(|z| (z - 1.0) * (z - 1.0) - 1.01, |z| 2.0 * (z - 1.0));
    let run = |settings: Settings<'_>| {
        let mut z = [0.0];
        let report = solve(&mut billups(), &[0.0], &[INF], &mut z, &settings).unwrap();
        (report, z[0])
    };
    let (stuck, _) = run(ONLY_S0);
    assert_eq!(stuck.status, Status::Stationary);
    for (settings, by_restart) in [
        (Settings { restarts: 8, ..ONLY_S0 }, true),
        (Settings { enumerate_up_to: 6, ..ONLY_S0 }, false),
    ] {
        let (report, z) = run(settings);
        assert_eq!(report.status, Status::Solved);
        assert_eq!(matches!(report.stage, Stage::Restart(_)), by_restart, "{report:?}");
        assert!((z - (1.0 + 1.01_f64.sqrt())).abs() < 1e-9);
    }
}

#[test]
fn without_a_solution_no_success() {
    let nowhere = scalar(|z| -1.0 - z * z, |z| -2.0 * z);
    let mut z = [0.0];
    let report = solve(&mut { nowhere }, &[0.0], &[INF], &mut z, &Settings::default()).unwrap();
    assert!(!report.status.is_success() && report.residual >= 1.0, "{report:?}");
    assert_eq!(report.counts.restarts, 8);
}

/// Slopes that are right in the rows that are solved and far too steep in the one that is not make
/// its residual look like rounding.
#[test]
fn slopes_are_compared_with_f_in_the_rows_that_are_not_solved() {
    let mut problem = Maps(
        |z: &[f64], f: &mut [f64]| (f[0], f[1]) = (z[0] - 1.0 + 1e-3, z[1] - 2.0),
        |_: &[f64], j: &mut [f64]| j.copy_from_slice(&[1e13, 0.0, 0.0, 1.0]),
    );
    let mut z = [1.0, 0.0];
    let settings = Settings { restarts: 0, enumerate_up_to: 0, ..Settings::default() };
    let report = solve(&mut problem, &[-INF; 2], &[INF; 2], &mut z, &settings).unwrap();
    assert!(!report.status.is_success() || report.residual <= 1e-9, "{report:?}");
}

#[test]
fn a_solution_at_infinity_shows_in_size_and_ratio() {
    let mut exp = scalar(|z| -(-z).exp(), |z| (-z).exp());
    let mut z = [0.0];
    let report = solve(&mut exp, &[0.0], &[INF], &mut z, &Settings::default()).unwrap();
    // the residual is small: nothing else can be said from values of F
    assert_eq!(report.status, Status::Solved);
    assert!(report.size > 20.0, "{report:?}");
    assert!(report.convergence_ratio > 0.3, "no quadratic convergence: {report:?}");
}

#[test]
fn a_continuum_is_told_from_an_isolated_solution() {
    let run = |m: &[f64], q: &[f64]| {
        let mut z = [0.3, 0.1];
        solve(&mut Affine { matrix: m, q }, &[-1.0; 2], &[1.0; 2], &mut z, &Settings::default())
            .unwrap()
            .status
    };
    assert_eq!(run(&[1.0, 1.0, 1.0, 1.0], &[-0.5, -0.5]), Status::SolvedNotIsolated);
    assert_eq!(run(&[1.0, 1.0, 0.0, 1.0], &[-0.5, -0.5]), Status::Solved);
}

/// An affine problem of many unknowns that counts what is done with its matrix.
struct Counted<'a> {
    affine: Affine<'a>,
    jacobians: usize,
    factors: usize,
}

impl Problem for Counted<'_> {
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        self.affine.map(z, f)
    }

    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        self.jacobians += 1;
        self.affine.jacobian(z, jacobian)
    }

    fn factor(
        &mut self,
        matrix: &mut [f64],
        k: usize,
        permutation: &mut [usize],
    ) -> Result<f64, Interruption> {
        self.factors += 1;
        self.affine.factor(matrix, k, permutation)
    }

    fn is_affine(&self) -> bool {
        true
    }
}

/// The status of a complementarity problem of 20 unknowns, of which 10 are `1` and the others `0`
/// but for what the leading `2 x 2` block and its constants change; how many matrices were factored.
fn with_block(block: [f64; 4], constants: [f64; 2]) -> (Status, usize) {
    const N: usize = 20;
    let (mut matrix, mut q) = ([0.0; N * N], [1.0; N]);
    (0..N).for_each(|i| matrix[i * N + i] = 1.0);
    q[..10].fill(-1.0);
    matrix[..2].copy_from_slice(&block[..2]);
    matrix[N..N + 2].copy_from_slice(&block[2..]);
    q[..2].copy_from_slice(&constants);
    let affine = Affine { matrix: &matrix, q: &q };
    let mut problem = Counted { affine, jacobians: 0, factors: 0 };
    let (mut z, settings) = ([0.0; N], Settings::default());
    let report = solve(&mut problem, &[0.0; N], &[INF; N], &mut z, &settings).unwrap();
    assert_eq!((report.stage, report.counts.jacobian), (Stage::JosephyNewton, 1));
    assert_eq!(problem.jacobians, 1);
    (report.status, problem.factors)
}

#[test]
fn the_factors_that_found_a_solution_tell_whether_it_is_isolated() {
    // regular: nothing is factored again
    assert_eq!(with_block([1.0, 0.5, 0.0, 1.0], [-1.0, -1.0]), (Status::Solved, 1));
    // a row of small numbers is looked at more closely
    assert_eq!(with_block([1e-9, 0.0, 0.0, 1.0], [-1e-9, -1.0]), (Status::Solved, 2));
    let nearly = [1.0, 1.0, 1.0, 1.0 + 1e-13];
    assert_eq!(with_block(nearly, [-2.0, -2.0]), (Status::SolvedNotIsolated, 2));
    // the second unknown stays at its bound with F = 0: it counts as inside
    assert_eq!(with_block([1.0, 0.5, -1.0, 1.0], [-1.0, 1.0]), (Status::Solved, 2));
    assert_eq!(with_block([1.0, 1.0, -1.0, -1.0], [-1.0, 1.0]), (Status::SolvedNotIsolated, 2));
}

#[test]
fn the_matrix_of_an_affine_problem_is_read_once() {
    // without the stages that pivot: some iterations from a start that is far away
    let (matrix, q) = ([4.0, 1.0, 2.0, -1.0, 3.0, 1.0, 0.0, -2.0, 2.0], [-3.0, 4.0, -200.0]);
    let of = |row_scale| Settings {
        josephy_newton: false,
        semismooth: true,
        proximal: true,
        row_scale,
        ..ONLY_S0
    };
    for (row_scale, times) in [(RowScale::Unit, 1), (RowScale::Jacobian, 2)] {
        let affine = Affine { matrix: &matrix, q: &q };
        let mut problem = Counted { affine, jacobians: 0, factors: 0 };
        let (mut z, settings) = ([9.0, -3.0, 0.0], of(row_scale));
        let bounds = ([-INF, -3.0, 0.0], [INF, 20.0, INF]);
        let report = solve(&mut problem, &bounds.0, &bounds.1, &mut z, &settings).unwrap();
        assert_eq!((report.status, problem.jacobians), (Status::Solved, times), "{report:?}");
        assert!(report.counts.iterations > 2 && report.counts.jacobian == times);
        assert!(residual(&mut problem, &bounds.0, &bounds.1, &z) < 4e-9, "rows of up to 4");
    }
}

#[test]
fn an_undefined_start_is_pushed_off_the_bound() {
    let mut log = scalar(|z| z.ln() + z - 1.0, |z| 1.0 / z + 1.0);
    let mut z = [0.0];
    let report = solve(&mut log, &[0.0], &[INF], &mut z, &Settings::default()).unwrap();
    assert_eq!(report.status, Status::Solved);
    assert!((z[0] - 1.0).abs() < 1e-9);
    // the mirror image
    let mut log = scalar(|z| 1.0 + z - (-z).ln(), |z| 1.0 - 1.0 / z);
    let mut z = [0.0];
    let report = solve(&mut log, &[-INF], &[0.0], &mut z, &ONLY_S0).unwrap();
    assert_eq!(report.status, Status::Solved);
    assert!((z[0] + 1.0).abs() < 1e-9);
}

#[test]
fn undefined_everywhere_is_a_domain_error() {
    let mut nan = scalar(|_| f64::NAN, |_| 1.0);
    let mut z = [0.5];
    let report = solve(&mut nan, &[0.0], &[1.0], &mut z, &Settings::default()).unwrap();
    assert_eq!(report.status, Status::DomainError);
    assert!(report.residual.is_nan());
    // defined at the start alone: there is no slope from there, and no other point
    let mut lonely = scalar(|z| if z == 0.5 { 1.0 } else { f64::NAN }, |_| INF);
    let report = solve(&mut lonely, &[-INF], &[INF], &mut z, &ONLY_S0).unwrap();
    assert_eq!(report.status, Status::DomainError);
    assert_eq!((z[0], report.residual), (0.5, 1.0));
}

/// Fails at the k-th evaluation of `F`.
struct Failing {
    at: usize,
    calls: usize,
}

impl Problem for Failing {
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        self.calls += 1;
        f[0] = z[0].atan();
        if self.calls == self.at {
            Err(EvaluationError)
        } else {
            Ok(())
        }
    }

    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        jacobian[0] = 1.0 / (1.0 + z[0] * z[0]);
        Ok(())
    }
}

#[test]
fn a_failed_evaluation_stops_at_once_wherever_it_happens() {
    for at in 1..8 {
        let mut problem = Failing { at, calls: 0 };
        let mut z = [20.0];
        let report = solve(&mut problem, &[-INF], &[INF], &mut z, &Settings::default()).unwrap();
        assert_eq!(report.status, Status::EvaluationError, "call {at}");
        assert_eq!((problem.calls, report.counts.f), (at, at));
        assert!(z[0].abs() <= 20.0, "the best point is kept");
    }
}

#[test]
fn limits_end_with_their_status() {
    let mut atan = scalar(f64::atan, |z| 1.0 / (1.0 + z * z));
    let mut z = [20.0];
    let settings = Settings { max_iterations: 2, ..Settings::default() };
    let report = solve(&mut atan, &[-INF], &[INF], &mut z, &settings).unwrap();
    assert_eq!((report.status, report.counts.iterations), (Status::IterationLimit, 2));

    // a murty matrix takes many pivots from the vertex at zero
    let n = 12;
    let m: Vec<f64> = (0..n * n)
        .map(|k| {
            [1.0, 2.0, 0.0][if k / n == k % n {
                0
            } else if k % n > k / n {
                1
            } else {
                2
            }]
        })
        .collect();
    let q = vec![-1.0; n];
    let (lower, upper) = (vec![0.0; n], vec![INF; n]);
    let only_pivots = Settings { descent_steps: false, active_set: false, ..ONLY_S0 };
    let settings = Settings { max_pivots: Some(1), ..only_pivots };
    let mut z = vec![0.0; n];
    let mut affine = Affine { matrix: &m, q: &q };
    let report = solve(&mut affine, &lower, &upper, &mut z, &settings).unwrap();
    assert_eq!(report.status, Status::PivotLimit);
    let settings = Settings { total_pivots: Some(3), ..ONLY_S0 };
    let report = solve(&mut affine, &lower, &upper, &mut z, &settings).unwrap();
    assert!(report.counts.pivots <= 3 && !report.status.is_success(), "{report:?}");
}

#[test]
fn row_scaling_changes_the_residual_not_the_solution() {
    let tiny = || scalar(|z| 1e-12 * (z - 0.25), |_| 1e-12);
    let run = |row_scale| {
        let mut z = [0.9];
        let settings = Settings { row_scale, ..Settings::default() };
        let report = solve(&mut tiny(), &[0.0], &[1.0], &mut z, &settings).unwrap();
        assert!(report.status.is_success());
        (z[0], report)
    };
    // unscaled, the row is within the tolerance anywhere: the caller must say what is small
    let (unscaled, _) = run(RowScale::Unit);
    assert_eq!(unscaled, 0.9);
    for scale in [RowScale::Jacobian, RowScale::Given(&[1e12])] {
        let (z, report) = run(scale);
        assert!((z - 0.25).abs() < 1e-9, "{z}");
        assert!(report.residual <= report.scaled_residual, "{report:?}");
    }
}

#[test]
fn the_tolerance_rises_to_rounding_only_where_nothing_better_is_reached() {
    // F = 1e9 (z - 1/3): its rounding, 1e9 eps / 3, is larger than 1e-9
    let mut steep = scalar(|z| 1e9 * (3.0 * z - 1.0 - 3e-17), |_| 3e9);
    let mut z = [7.0];
    let settings = Settings { tol: 1e-12, ..Settings::default() };
    let report = solve(&mut steep, &[-INF], &[INF], &mut z, &settings).unwrap();
    assert!(report.status.is_success(), "{report:?}");
    assert!(report.residual <= report.tolerance && report.tolerance < 1e-5, "{report:?}");
    // a plain miss is not excused by it
    let mut gap = scalar(|z| 1.0 + z * z, |z| 2.0 * z);
    let report = solve(&mut gap, &[-INF], &[INF], &mut z, &Settings::default()).unwrap();
    assert!(!report.status.is_success(), "{report:?}");
    assert_eq!(report.tolerance, 1e-9);
    // nor is a gap to a bound, however large the rounding of F is there
    let growth = |z: f64| ((z - 2.0) * (z - 2.0)).exp();
    let mut huge = Maps(
        move |z: &[f64], f: &mut [f64]| f[0] = 2.0 * (z[0] - 2.0) * growth(z[0]),
        move |z: &[f64], jacobian: &mut [f64]| {
            jacobian[0] = (2.0 + 4.0 * (z[0] - 2.0) * (z[0] - 2.0)) * growth(z[0]);
        },
    );
    let mut z = [12.0];
    let settings = Settings { max_iterations: 3, ..Settings::default() };
    let report = solve(&mut huge, &[0.0], &[INF], &mut z, &settings).unwrap();
    assert_eq!(report.status, Status::IterationLimit, "{report:?} {z:?}");
    assert!(report.residual > 1.0);
}

#[test]
fn fixed_components_keep_their_value_and_their_row_is_free() {
    let m = [2.0, 1.0, 0.0, 1.0, 2.0, 1.0, 0.0, 1.0, 2.0];
    let q = [-4.0, 100.0, -1.0];
    let (lower, upper) = ([0.0, 1.0, 0.0], [INF, 1.0, INF]);
    let mut z = [5.0, 7.0, 5.0];
    let mut affine = Affine { matrix: &m, q: &q };
    let report = solve(&mut affine, &lower, &upper, &mut z, &Settings::default()).unwrap();
    assert!(report.status.is_success() && report.projected);
    assert_eq!(z, [1.5, 1.0, 0.0]);
    assert!(residual(&mut affine, &lower, &upper, &z) < 1e-9);
}

#[test]
fn bad_input_is_refused_before_f_is_called() {
    struct Untouchable;
    impl Problem for Untouchable {
        fn map(&mut self, _: &[f64], _: &mut [f64]) -> Result<(), EvaluationError> {
            panic!("F must not be called")
        }
        fn jacobian(&mut self, _: &[f64], _: &mut [f64]) -> Result<(), EvaluationError> {
            panic!("the Jacobian must not be called")
        }
    }
    let refused = |lower: &[f64], upper: &[f64], z: &[f64], settings: &Settings<'_>| {
        let mut z = z.to_vec();
        let report = solve(&mut Untouchable, lower, upper, &mut z, settings);
        report.expect_err("must be refused").to_string()
    };
    let usual = Settings::default();
    let cases = [
        (refused(&[], &[], &[], &usual), "at least one"),
        (refused(&[0.0], &[1.0, 1.0], &[0.0, 0.0], &usual), "lower must have 2"),
        (refused(&[0.0; 2], &[1.0], &[0.0, 0.0], &usual), "upper must have 2"),
        (refused(&[0.0, f64::NAN], &[1.0; 2], &[0.0; 2], &usual), "lower[1]"),
        (refused(&[0.0; 2], &[f64::NAN, 1.0], &[0.0; 2], &usual), "upper[0]"),
        (refused(&[0.0, INF], &[INF; 2], &[0.0; 2], &usual), "lower[1]"),
        (refused(&[-INF; 2], &[1.0, -INF], &[0.0; 2], &usual), "upper[1]"),
        (refused(&[0.0, 2.0], &[1.0; 2], &[0.0; 2], &usual), "lower[1] must be <= upper[1]"),
        (refused(&[0.0; 2], &[1.0; 2], &[0.0, f64::NAN], &usual), "x0[1]"),
        (refused(&[0.0; 2], &[1.0; 2], &[INF, 0.0], &usual), "x0[0]"),
    ];
    for (message, expected) in cases {
        assert!(message.contains(expected), "{message:?} does not name {expected:?}");
    }
    let one = |settings: Settings<'_>| refused(&[0.0], &[1.0], &[0.5], &settings);
    for tol in [0.0, -1.0, f64::NAN, INF] {
        assert!(one(Settings { tol, ..usual }).contains("tol must be"));
    }
    assert!(one(Settings { max_iterations: 0, ..usual }).contains("max_iterations"));
    assert!(one(Settings { stage_iterations: 0, ..usual }).contains("stage_iterations"));
    assert!(one(Settings { max_pivots: Some(0), ..usual }).contains("max_pivots"));
    assert!(one(Settings { total_pivots: Some(0), ..usual }).contains("total_pivots"));
    assert!(one(Settings { memory: 0, ..usual }).contains("memory"));
    assert!(one(Settings { memory: 17, ..usual }).contains("memory"));
    assert!(one(Settings { restarts: 9, ..usual }).contains("restarts"));
    assert!(one(Settings { enumerate_up_to: 7, ..usual }).contains("enumerate_up_to"));
    for scale in [&[0.0][..], &[-1.0], &[f64::NAN], &[1.0, 1.0]] {
        let message = one(Settings { row_scale: RowScale::Given(scale), ..usual });
        assert!(message.contains("row_scale"), "{message}");
    }
}

#[test]
fn a_workspace_of_another_size_is_refused() {
    let (reals, indices) = zivi_core::vi::workspace_len(3);
    let (mut reals, mut indices) = (vec![0.0; reals], vec![0; indices]);
    let mut work = zivi_core::vi::Workspace::new(3, &mut reals, &mut indices).unwrap();
    let mut problem = scalar(|z| z, |_| 1.0);
    let bounds = (&[0.0][..], &[1.0][..]);
    let report =
        zivi_core::vi::solve(&mut problem, bounds, &mut [0.5], &Settings::default(), &mut work);
    assert_eq!(report, Err(InvalidInput::Workspace));
}
