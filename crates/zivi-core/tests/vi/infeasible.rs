//! Proofs that an affine problem has no solution, against problems whose proof or solution is
//! planted.

use crate::support::{planted, solve, Random};
use zivi_core::vi::{Affine, Report, Settings, Status};

const INF: f64 = f64::INFINITY;

/// An affine problem in which a sum of some rows, each weighted by the sign that it needs, is below
/// zero on the whole box.
struct Impossible {
    matrix: Vec<f64>,
    q: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
}

/// Draws one of size `n` from `rows` rows, which misses a solution by `margin`. Further rows do not
/// hinder it: they are those of a positive diagonal.
fn impossible(n: usize, rows: usize, margin: f64, random: &mut Random) -> Impossible {
    let (mut lower, mut upper) = (vec![-INF; n], vec![INF; n]);
    for i in 0..n {
        // of the first ones each needs a sign, the others are of all kinds
        let kind = if i < rows { random.below(2) } else { random.below(4) };
        let place = random.normal();
        if kind == 0 || kind == 2 {
            lower[i] = place;
        }
        if kind == 1 || kind == 2 {
            upper[i] = place + random.within(0.5, 2.0);
        }
    }
    let sign: Vec<f64> = lower.iter().map(|l| if l.is_finite() { 1.0 } else { -1.0 }).collect();
    let mut matrix: Vec<f64> = (0..n * n).map(|_| random.normal()).collect();
    let mut q: Vec<f64> = (0..n).map(|_| random.normal()).collect();
    let weights: Vec<f64> = (0..rows).map(|_| random.within(0.2, 5.0)).collect();
    // the sum falls towards each infinite bound; the last row is what makes it so
    let mut most = -margin;
    for j in 0..n {
        let slope = match (lower[j].is_finite(), upper[j].is_finite()) {
            (true, true) => random.normal(),
            (true, false) => -random.uniform(),
            (false, true) => random.uniform(),
            (false, false) => 0.0,
        };
        let others: f64 = (0..rows - 1).map(|i| weights[i] * sign[i] * matrix[i * n + j]).sum();
        matrix[(rows - 1) * n + j] = (slope - others) / (weights[rows - 1] * sign[rows - 1]);
        if slope != 0.0 {
            most -= slope * if slope > 0.0 { upper[j] } else { lower[j] };
        }
    }
    let others: f64 = (0..rows - 1).map(|i| weights[i] * sign[i] * q[i]).sum();
    q[rows - 1] = (most - others) / (weights[rows - 1] * sign[rows - 1]);
    Impossible { matrix, q, lower, upper }
}

impl Impossible {
    fn solve(&self, start: f64, total_pivots: Option<usize>) -> Report {
        let mut z = vec![start; self.q.len()];
        let mut affine = Affine { matrix: &self.matrix, q: &self.q };
        let settings = Settings { active_set: false, total_pivots, ..Settings::default() };
        solve(&mut affine, &self.lower, &self.upper, &mut z, &settings).unwrap()
    }
}

/// Before the first path, and before the simplex method, for which the one pivot is too few.
#[test]
fn two_rows_that_exclude_each_other_are_found_without_a_pivot() {
    for seed in 0..60 {
        let mut random = Random::new(seed);
        let margin = 10_f64.powf(random.within(-5.0, 1.0));
        let drawn = impossible(16 + random.below(8), 2, margin, &mut random);
        let report = drawn.solve(random.normal(), Some(1));
        assert_eq!(report.status, Status::Infeasible, "seed {seed}: {report:?}");
        assert_eq!(report.counts.pivots, 0, "seed {seed}");
    }
}

#[test]
fn several_rows_that_exclude_each_other_are_found() {
    for seed in 0..120 {
        let mut random = Random::new(seed);
        let n = 4 + random.below(24);
        let rows = 3 + random.below(usize::min(n - 3, 6));
        let drawn = impossible(n, rows, 10_f64.powf(random.within(-4.0, 1.0)), &mut random);
        let report = drawn.solve(random.normal(), None);
        assert_eq!(report.status, Status::Infeasible, "seed {seed}: {report:?}");
        assert!(n < 16 || report.counts.pivots <= 12 * n + 50, "seed {seed}: {report:?}");
    }
}

/// In units of the unknowns that make all rates of the simplex method small.
#[test]
fn proofs_do_not_depend_on_the_unit_of_the_unknowns() {
    for seed in 0..40 {
        let mut random = Random::new(seed);
        let n = 6 + random.below(10);
        let mut drawn = impossible(n, 3 + random.below(3), 1.0, &mut random);
        let unit = 1e7;
        drawn.matrix.iter_mut().for_each(|m| *m /= unit);
        drawn.lower.iter_mut().chain(&mut drawn.upper).for_each(|bound| *bound *= unit);
        let report = drawn.solve(unit * random.normal(), None);
        assert_eq!(report.status, Status::Infeasible, "seed {seed}: {report:?}");
    }
}

/// `F_0 + F_1 = -1e-6` and a row that is below zero by as much, by terms of 1e10.
#[test]
fn what_rounding_may_have_made_proves_nothing() {
    let big = 1e10;
    let two =
        [[0.0, 0.0, big, -big], [0.0, 0.0, -big, big], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    let one = [[0.0, 0.0, big, -big], [0.0, 1.0, 0.0, 0.0], two[2], two[3]];
    let none = Settings { restarts: 0, enumerate_up_to: 0, ..Settings::default() };
    for (rows, place) in [(two, 0.0), (one, 1.0)] {
        for (margin, proved) in [(1e-6, false), (1e3, true)] {
            let matrix: Vec<f64> = rows.concat();
            let q = [-margin, 0.0, 0.0, 0.0];
            let lower = [0.0, 0.0, 0.0, place];
            let upper = [INF, INF, 1.0, 1.0 + place];
            let mut z = [0.5, 0.5, 0.5, 0.5 + place];
            let mut affine = Affine { matrix: &matrix, q: &q };
            let report = solve(&mut affine, &lower, &upper, &mut z, &none).unwrap();
            assert_eq!(report.status == Status::Infeasible, proved, "{margin} {report:?}");
        }
    }
}

/// A solution refutes every proof, however far the search for one gets.
#[test]
fn what_has_a_solution_is_never_called_infeasible() {
    for seed in 0..100 {
        let mut random = Random::new(seed);
        let n = 16 + random.below(16);
        let scale = 10_f64.powf(random.within(-8.0, 8.0));
        let matrix: Vec<f64> = (0..n * n).map(|_| scale * random.normal()).collect();
        let [q, lower, upper, _] = planted(&matrix, n, &mut random);
        let report = Impossible { matrix, q, lower, upper }.solve(random.normal(), None);
        assert_ne!(report.status, Status::Infeasible, "seed {seed}");
    }
}
