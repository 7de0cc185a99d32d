//! Any finite matrix, any box: the solver ends within its limits, inside the box, and believes
//! nothing but the residual. Every run of the tests draws other cases.

use crate::support::{residual, solve};
use proptest::prelude::*;
use zivi_core::vi::{Affine, EvaluationError, Problem, Settings, Start};

/// Numbers that break things: zeros, ties, tiny, huge, and anything finite.
fn awkward() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => (-3_i32..=3).prop_map(f64::from),
        2 => -10.0..10.0_f64,
        1 => prop_oneof![Just(0.0), Just(-0.0), Just(1e-300), Just(-1e-12), Just(1e12), Just(-1e150)],
        1 => any::<f64>().prop_map(|x| if x.is_finite() { x } else { 1.0 }),
    ]
}

#[derive(Clone, Debug)]
struct Case {
    m: Vec<f64>,
    q: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    z: Vec<f64>,
}

fn case() -> impl Strategy<Value = Case> {
    (1_usize..7).prop_flat_map(|n| {
        let vector = || prop::collection::vec(awkward(), n);
        let kinds = prop::collection::vec(0_u8..5, n);
        let m = prop::collection::vec(awkward(), n * n);
        (m, vector(), vector(), vector(), vector(), kinds).prop_map(|(m, q, a, b, z, kinds)| {
            let bound = |k: u8, low: f64, high: f64| match k {
                0 => (f64::NEG_INFINITY, f64::INFINITY),
                1 => (low, f64::INFINITY),
                2 => (f64::NEG_INFINITY, high),
                3 => (low, high),
                _ => (low, low),
            };
            let ends = a.iter().zip(&b).map(|(a, b)| (a.min(*b), a.max(*b)));
            let (lower, upper) =
                ends.zip(kinds).map(|((low, high), kind)| bound(kind, low, high)).unzip();
            Case { m, q, lower, upper, z }
        })
    })
}

fn check(
    problem: &mut dyn Problem,
    case: &Case,
    settings: &Settings<'_>,
) -> Result<(), TestCaseError> {
    let mut z = case.z.clone();
    let report = solve(problem, &case.lower, &case.upper, &mut z, settings).unwrap();
    for ((z, lower), upper) in z.iter().zip(&case.lower).zip(&case.upper) {
        prop_assert!(lower <= z && z <= upper && z.is_finite(), "{z} outside [{lower}, {upper}]");
    }
    let left = residual(problem, &case.lower, &case.upper, &z);
    if report.status.is_success() {
        prop_assert!(left <= report.tolerance, "{left} {report:?}");
    } else {
        prop_assert!(left.is_nan() || left > settings.tol, "solved and does not know: {report:?}");
    }
    prop_assert!(report.residual == left || (report.residual.is_nan() && left.is_nan()));
    prop_assert!(report.counts.iterations <= settings.max_iterations);
    let n = z.len();
    prop_assert!(report.counts.pivots <= 200 * n + 100 * n * n + 10_000, "{report:?}");
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6_000))]

    #[test]
    fn affine_problems_of_any_numbers(case in case(), ray in any::<bool>()) {
        let first_start = if ray { Start::Ray } else { Start::Regular };
        let settings = Settings { first_start, max_iterations: 500, ..Settings::default() };
        let mut affine = Affine { matrix: &case.m, q: &case.q };
        check(&mut affine, &case, &settings)?;
    }
}

/// `F = M z + q + |z| z - 1/z_0`, not finite where `z_0 = 0`, with a Jacobian that is wrong.
struct Wild<'a>(&'a Case);

impl Problem for Wild<'_> {
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        Affine { matrix: &self.0.m, q: &self.0.q }.map(z, f)?;
        f.iter_mut().zip(z).for_each(|(f, z)| *f += z.abs() * z - 1.0 / z);
        Ok(())
    }

    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        Affine { matrix: &self.0.m, q: &self.0.q }.jacobian(z, jacobian)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1_500))]

    #[test]
    fn wild_maps_with_wrong_jacobians(case in case()) {
        let settings = Settings { max_iterations: 500, ..Settings::default() };
        check(&mut Wild(&case), &case, &settings)?;
    }
}
