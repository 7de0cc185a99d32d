//! What reaches the solver from outside: slopes and values that do not exist, rounding, the
//! monitor, and problems that have no solution.

use crate::support::{p_matrix, planted, residual, solve, Maps, Random};
use zivi_core::vi::{Affine, EvaluationError, Interruption, Problem, Progress};
use zivi_core::vi::{Settings, Stage, Status};

const INF: f64 = f64::INFINITY;

/// `F = (z_0^0.8 + z_1 - 0.2, z_1 + 1 - z_0)` on `z >= 0`, whose slope at `z_0 = 0` is infinite.
fn rooted() -> impl Problem {
    Maps(
        |z: &[f64], f: &mut [f64]| {
            (f[0], f[1]) = (z[0].powf(0.8) + z[1] - 0.2, z[1] + 1.0 - z[0]);
        },
        |z: &[f64], j: &mut [f64]| {
            j.copy_from_slice(&[0.8 * z[0].powf(-0.2), 1.0, -1.0, 1.0]);
        },
    )
}

#[test]
fn slopes_that_are_infinite_at_a_bound_are_differenced() {
    let mut z = [0.0, 0.0];
    let report = solve(&mut rooted(), &[0.0; 2], &[INF; 2], &mut z, &Settings::default()).unwrap();
    assert_eq!(report.status, Status::Solved, "{report:?}");
    assert!((z[0] - 0.2_f64.powf(1.25)).abs() < 1e-8 && z[1] == 0.0, "{z:?}");
    // the finite ones are those that were given: one more evaluation for the one that is not
    let mut calls = 0;
    let mut counted = Maps(
        |z: &[f64], f: &mut [f64]| {
            calls += 1;
            rooted().map(z, f).unwrap();
        },
        |z: &[f64], j: &mut [f64]| rooted().jacobian(z, j).unwrap(),
    );
    let mut z = [0.0, 0.0];
    let report = solve(&mut counted, &[0.0; 2], &[INF; 2], &mut z, &Settings::default()).unwrap();
    assert_eq!(report.counts.f, calls);
}

#[test]
fn a_fixed_component_may_have_no_slopes() {
    let mut rows = Maps(
        |z: &[f64], f: &mut [f64]| (f[0], f[1]) = (3.0 * z[0] - z[1], 0.0),
        |_: &[f64], j: &mut [f64]| j.copy_from_slice(&[3.0, f64::NAN, f64::NAN, INF]),
    );
    let mut z = [5.0, 6.0];
    let (lower, upper) = ([-INF, 6.0], [INF, 6.0]);
    let report = solve(&mut rows, &lower, &upper, &mut z, &Settings::default()).unwrap();
    assert!(report.status.is_success(), "{report:?}");
    assert!((z[0] - 2.0).abs() < 1e-12);
}

/// A problem under observation.
struct Watched<P> {
    problem: P,
    seen: Vec<Progress>,
    polls: usize,
    stop: fn(&Progress) -> Option<Interruption>,
    polls_allowed: usize,
}

fn watched<P>(problem: P) -> Watched<P> {
    Watched { problem, seen: Vec::new(), polls: 0, stop: |_| None, polls_allowed: usize::MAX }
}

impl<P: Problem> Problem for Watched<P> {
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        self.problem.map(z, f)
    }

    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        self.problem.jacobian(z, jacobian)
    }

    fn poll(&mut self) -> Result<(), Interruption> {
        self.polls += 1;
        if self.polls > self.polls_allowed {
            return Err(Interruption::Stopped);
        }
        Ok(())
    }

    fn monitor(&mut self, progress: &Progress) -> Result<(), Interruption> {
        self.seen.push(*progress);
        (self.stop)(progress).map_or(Ok(()), Err)
    }
}

fn atan() -> impl Problem {
    Maps(
        |z: &[f64], f: &mut [f64]| f[0] = z[0].atan(),
        |z: &[f64], j: &mut [f64]| j[0] = 1.0 / (1.0 + z[0] * z[0]),
    )
}

#[test]
fn the_monitor_sees_every_iteration_and_may_stop() {
    let run = |stop| {
        let mut problem = Watched { stop, ..watched(atan()) };
        let mut z = [20.0];
        let report = solve(&mut problem, &[-INF], &[INF], &mut z, &Settings::default()).unwrap();
        (report, z[0], problem.seen)
    };
    let (report, _, seen) = run(|_| None);
    let numbers: Vec<usize> = seen.iter().map(|it| it.iteration).collect();
    assert_eq!(numbers, (1..=report.counts.iterations).collect::<Vec<_>>());
    assert_eq!(
        seen.last().map(|it| (it.residual, it.stage)),
        Some((report.residual, report.stage))
    );

    let second = |why: Interruption| -> fn(&Progress) -> Option<Interruption> {
        match why {
            Interruption::Stopped => |it| (it.iteration == 2).then_some(Interruption::Stopped),
            Interruption::Failed => |it| (it.iteration == 2).then_some(Interruption::Failed),
        }
    };
    let (report, z, seen) = run(second(Interruption::Stopped));
    assert_eq!((report.status, seen.len()), (Status::Stopped, 2));
    assert_eq!(report.residual, z.atan().abs());
    let (report, _, _) = run(second(Interruption::Failed));
    assert_eq!(report.status, Status::EvaluationError);
    assert!(report.residual.is_nan());
}

/// Wherever a poll stops it, the solve ends at once with its best point; a solution remains one.
#[test]
fn every_poll_may_stop_the_solve() {
    let n = 70; // several blocks of columns and of pivots
    let mut random = Random::new(3);
    let m: Vec<f64> = (0..n * n).map(|_| random.normal()).collect();
    let q: Vec<f64> = (0..n).map(|_| random.normal()).collect();
    let (lower, upper) = (vec![0.0; n], vec![INF; n]);
    let settings = Settings { total_pivots: Some(3000), ..Settings::default() };
    for polls_allowed in (0..12).chain([20, 50, 150]) {
        let affine = Affine { matrix: &m, q: &q };
        let mut problem = Watched { polls_allowed, ..watched(affine) };
        let mut z = vec![0.5; n];
        let report = solve(&mut problem, &lower, &upper, &mut z, &settings).unwrap();
        if report.status == Status::Stopped {
            assert_eq!(problem.polls, polls_allowed + 1);
            let left = residual(&mut Affine { matrix: &m, q: &q }, &lower, &upper, &z);
            let unknown = report.residual.is_nan() && report.counts.f == 0;
            assert!(unknown || report.residual == left, "{report:?}");
        }
    }
    let mut stopped = 0;
    for polls_allowed in 0.. {
        let mut problem = Watched { polls_allowed, ..watched(atan()) };
        let mut z = [2.0];
        let report = solve(&mut problem, &[-INF], &[INF], &mut z, &Settings::default()).unwrap();
        if problem.polls <= polls_allowed {
            break;
        }
        // the last polls are those of the isolation test
        let is_solution = z[0].atan().abs() <= 1e-9;
        let expected = if is_solution { Status::Solved } else { Status::Stopped };
        assert_eq!(report.status, expected, "{polls_allowed}");
        stopped += usize::from(is_solution);
    }
    assert!(stopped > 0, "no poll after the solution");
}

/// No block of work between two polls is longer than 32 columns, 32 pivots or one evaluation.
#[test]
fn long_factorisations_are_polled() {
    let n = 256;
    let mut random = Random::new(8);
    let m = p_matrix(0, n, &mut random);
    let [q, lower, upper, _] = planted(&m, n, &mut random);
    let affine = Affine { matrix: &m, q: &q };
    let mut problem = watched(affine);
    let mut z = vec![0.0; n];
    let settings = Settings {
        josephy_newton: false,
        smoothing: false,
        proximal: false,
        ..Settings::default()
    };
    let report = solve(&mut problem, &lower, &upper, &mut z, &settings).unwrap();
    assert!(report.status.is_success() && report.stage == Stage::Semismooth, "{report:?}");
    let evaluations = report.counts.f + report.counts.jacobian;
    assert!(problem.polls >= evaluations + report.counts.semismooth_steps * (n / 32), "{report:?}");
}

#[test]
fn a_row_that_no_point_of_the_box_satisfies_is_a_proof() {
    let m = [-1.0, -2.0, 1.0, 1.0];
    let run = |q: &[f64], lower: &[f64], upper: &[f64]| {
        let mut z = [0.5, 0.5];
        let report =
            solve(&mut Affine { matrix: &m, q }, lower, upper, &mut z, &Settings::default());
        (report.unwrap(), z)
    };
    let (report, z) = run(&[-1e-3, 1.0], &[0.0; 2], &[INF; 2]);
    assert_eq!(report.status, Status::Infeasible);
    assert_eq!((report.counts.f, report.counts.pivots, z), (1, 0, [0.5, 0.5]));
    assert!((report.residual - 1.501).abs() < 1e-15);
    // at the upper bound the row may be negative; and zero is enough
    assert!(run(&[-1e-3, 1.0], &[0.0; 2], &[3.0, INF]).0.status.is_success());
    assert!(run(&[0.0, 1.0], &[0.0; 2], &[INF; 2]).0.status.is_success());
    // the same values from a map that is not known to be affine prove nothing
    let mut same = Maps(
        |z: &[f64], f: &mut [f64]| {
            (f[0], f[1]) = (-z[0] - 2.0 * z[1] - 1e-3, z[0] + z[1] + 1.0);
        },
        |_: &[f64], j: &mut [f64]| j.copy_from_slice(&m),
    );
    let mut z = [0.5, 0.5];
    let report = solve(&mut same, &[0.0; 2], &[INF; 2], &mut z, &Settings::default()).unwrap();
    assert!(!report.status.is_success() && report.status != Status::Infeasible);
}

/// Never where a solution is known; sizes from 1e-8 to 1e8.
#[test]
fn no_solvable_problem_is_called_infeasible() {
    for seed in 0..500 {
        let mut random = Random::new(seed);
        let n = 1 + random.below(6);
        let scale = 10_f64.powf(random.within(-8.0, 8.0));
        let m: Vec<f64> = (0..n * n).map(|_| scale * random.normal()).collect();
        let [q, lower, upper, mut z] = planted(&m, n, &mut random);
        z.iter_mut().for_each(|z| *z += random.normal());
        let settings = Settings { max_iterations: 1, ..Settings::default() };
        let mut affine = Affine { matrix: &m, q: &q };
        let report = solve(&mut affine, &lower, &upper, &mut z, &settings).unwrap();
        assert_ne!(report.status, Status::Infeasible, "seed {seed}");
    }
}

#[test]
fn the_tolerance_may_be_relative_to_the_start() {
    let mut z = [3.0];
    let settings = Settings { rtol: 0.5, ..Settings::default() };
    let report = solve(&mut atan(), &[-INF], &[INF], &mut z, &settings).unwrap();
    assert!(report.status.is_success());
    assert_eq!(report.tolerance, 0.5 * 3.0_f64.atan());
    assert!(report.residual <= report.tolerance && report.residual > 1e-9, "{report:?}");
    let refused = Settings { rtol: 1.0, ..Settings::default() };
    let error = solve(&mut atan(), &[-INF], &[INF], &mut z, &refused).unwrap_err();
    assert!(error.to_string().contains("rtol must be at least 0 and below 1, got 1"));
}

/// The map of a grid: Newton's method on the active set ends where pivoting takes one path.
#[test]
fn the_active_set_and_the_path_agree_on_p_matrices() {
    let mut spared = 0;
    for seed in 0..20 {
        let mut random = Random::new(seed);
        let n = 16 + random.below(30);
        let m = p_matrix((seed % 3) as usize, n, &mut random);
        let [q, lower, upper, expected] = planted(&m, n, &mut random);
        let mut ends = Vec::new();
        for active_set in [true, false] {
            let mut affine = Affine { matrix: &m, q: &q };
            let mut z = vec![0.0; n];
            let settings = Settings { active_set, ..Settings::default() };
            let report = solve(&mut affine, &lower, &upper, &mut z, &settings).unwrap();
            assert!(report.status.is_success(), "seed {seed}: {report:?}");
            assert!(z.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-7), "seed {seed}");
            ends.push(report.counts.pivots);
        }
        spared += usize::from(ends[0] == 0 && ends[1] > 0);
    }
    assert!(spared >= 10, "{spared} of 20 without a pivot");
}
