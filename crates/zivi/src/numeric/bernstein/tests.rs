use super::*;

/// `prod (theta - r)` up to a factor, positive at zero, by its values at equidistant points.
fn through(values: impl Fn(f64) -> f64, n: usize) -> Bernstein {
    // Newton's divided differences on degree-n nodes, then to Bernstein by nested products
    let nodes: Vec<f64> = (0..=n).map(|i| i as f64 / n as f64).collect();
    let mut d: Vec<f64> = nodes.iter().map(|&x| values(x)).collect();
    for level in 1..=n {
        for i in (level..=n).rev() {
            d[i] = (d[i] - d[i - 1]) / (nodes[i] - nodes[i - level]);
        }
    }
    let mut p = Bernstein::new(&[d[n]]);
    for i in (0..n).rev() {
        p = p.times_root(nodes[i]).plus(d[i]);
    }
    p
}

fn first(roots: &[f64]) -> Option<f64> {
    let sign = roots.iter().map(|r| -r).product::<f64>().signum();
    through(|x| sign * roots.iter().map(|r| x - r).product::<f64>(), roots.len()).first_negative()
}

#[test]
fn the_last_term_is_that_of_the_highest_power() {
    for f6 in [0.0, 3.0, -0.7] {
        let p = Bernstein::from_nested(1.0, [2.0, -1.0, 0.5, 4.0, -3.0, 2.5, f6]);
        assert!((p.last_term() - f6.abs() / 128.0).abs() < 1e-15, "{f6}");
    }
    let p = Bernstein::from_quartic([1.0, -2.0, 3.0, 0.5, -4.0]);
    assert_eq!(p.last_term(), 0.25);
}

#[test]
fn the_first_of_several_roots_is_found_and_touches_are_none() {
    for (roots, expected) in [
        (&[0.3][..], Some(0.3)),
        (&[0.3, 0.300001, 0.9], Some(0.3)),
        (&[0.9, 0.2, 0.6, 0.7, 0.95], Some(0.2)),
        (&[0.5, 0.5], None),
        (&[0.4, 0.4, 0.8], Some(0.8)),
        (&[-0.5, 1.5, 2.0], None),
        (&[1e-3, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0], Some(1e-3)),
    ] {
        let found = first(roots);
        let fits = match (found, expected) {
            (Some(a), Some(b)) => (a - b).abs() < 1e-8,
            (a, b) => a == b,
        };
        assert!(fits, "{roots:?}: {found:?}");
    }
}

#[test]
fn dips_far_below_the_values_at_the_ends_are_found() {
    // 1 + d - 2 d (1 - cos) like: (theta - 1/2)^2 - w^2, of depth w^2
    for w in [1e-1, 1e-3, 1e-5, 1e-7] {
        let dip = Bernstein::new(&[0.25 - w * w, -0.25 - w * w, 0.25 - w * w]);
        let found = dip.first_negative().unwrap();
        assert!((found - (0.5 - w)).abs() < 1e-2 * w, "{w}: {found}");
    }
    // the same about 0.3, where no halving meets it
    for w in [1e-1, 1e-3, 1e-5, 1e-6] {
        let (first, last) = (0.09 - w * w, 0.49 - w * w);
        let dip = Bernstein::new(&[first, first - 0.3, last]);
        let found = dip.first_negative().unwrap();
        assert!((found - (0.3 - w)).abs() < 1e-2 * w, "{w}: {found}");
    }
}

#[test]
fn all_crossings_of_a_level_are_found() {
    let p = through(|x| (x - 0.1) * (x - 0.1001) * (x - 0.6) * (x - 0.9) + 0.3, 4);
    let found = p.crossings(0.3);
    let exact = [0.1, 0.1001, 0.6, 0.9];
    let near = |a: &f64, b: &f64| (a - b).abs() < 1e-9;
    assert!(exact.iter().all(|a| found.iter().any(|b| near(a, b))), "{found:?}");
    assert!(found.iter().all(|a| exact.iter().any(|b| near(a, b))), "{found:?}");
    // a touch is none, and neither is a zero at an end
    assert!(Bernstein::new(&[1.0, -1.0, 1.0]).crossings(0.0).is_empty());
    assert!(Bernstein::new(&[0.0, 1.0]).crossings(0.0).is_empty());
    assert!(Bernstein::new(&[-1.0, 0.0]).crossings(0.0).is_empty());
}

#[test]
fn zeros_at_the_start() {
    assert_eq!(Bernstein::new(&[0.0, 1.0, 1.0]).first_negative(), None);
    assert_eq!(Bernstein::new(&[0.0, -1.0, 1.0]).first_negative(), Some(0.0));
    assert_eq!(Bernstein::new(&[0.0, 0.0, 0.0]).first_negative(), None);
    let parabola = Bernstein::new(&[0.0, 0.25, -0.5]); // theta/2 - theta^2
    assert!((parabola.first_negative().unwrap() - 0.5).abs() < 1e-15);
    let rest = parabola.without_root_at_zero();
    assert!((rest.at(0.3) - 0.2).abs() < 1e-15);
}

#[test]
fn zero_coefficients_are_no_changes_of_sign() {
    // theta^2 (1 - theta)^2 and (1 - theta)^4: nowhere negative
    for c in [[0.0, 0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0, 0.0]] {
        let p = Bernstein::new(&c);
        assert_eq!((p.sign_changes(), p.first_negative()), (0, None));
    }
}

#[test]
fn a_cubic_has_the_values_and_slopes_at_its_ends() {
    // 1 + 2 theta - 4 theta^2 + 3 theta^3: values 1 and 2, slopes 2 and 3
    let p = Bernstein::hermite((1.0, 2.0), (2.0, 3.0));
    for theta in [0.0, 0.3, 0.8, 1.0] {
        let direct = 1.0 + theta * (2.0 + theta * (-4.0 + theta * 3.0));
        assert!((p.at(theta) - direct).abs() < 1e-15);
    }
}

#[test]
fn forms_and_parts_agree() {
    let f = [0.3, -1.0, 2.0, 0.7, -0.4, 1.1, -2.0];
    let p = Bernstein::from_nested(0.2, f);
    let (left, right) = p.split(0.3);
    for theta in [0.0, 0.17, 0.5, 0.81, 1.0] {
        let mut value = 0.0;
        for (i, f) in f.iter().enumerate().rev() {
            value = (value + f) * if i % 2 == 0 { theta } else { 1.0 - theta };
        }
        assert!((p.at(theta) - value - 0.2).abs() < 1e-14);
        let difference = (p.at(theta + 1e-6) - p.at(theta - 1e-6)) / 2e-6;
        assert!((p.slope(theta) - difference).abs() < 1e-9);
        assert!((left.at(theta) - p.at(0.3 * theta)).abs() < 1e-14);
        assert!((right.at(theta) - p.at(0.3 + 0.7 * theta)).abs() < 1e-14);
        let q = Bernstein::from_quartic([1.0, -2.0, 3.0, 0.5, -0.25]);
        let direct = 1.0 + theta * (-2.0 + theta * (3.0 + theta * (0.5 - 0.25 * theta)));
        assert!((q.at(theta) - direct).abs() < 1e-14);
    }
}

#[test]
fn high_degrees_are_evaluated_as_their_powers_are() {
    let a: [f64; 24] =
        std::array::from_fn(|n| (1.3 * n as f64 + 0.2).sin() * 0.9f64.powi(n as i32));
    let p = Polynomial::<24>::from_powers(a);
    let slopes = p.derivative();
    let size: f64 = a.iter().map(|a| a.abs()).sum();
    for i in 0..=40 {
        let theta = f64::from(i) / 40.0;
        let value = a.iter().rev().fold(0.0, |sum, a| sum * theta + a);
        let terms = (1..24).rev().map(|n| n as f64 * a[n]);
        let slope = terms.fold(0.0, |sum, term| sum * theta + term);
        assert!((p.at(theta) - value).abs() < 1e-15 * size, "{theta}");
        assert!((slopes.at(theta) - slope).abs() < 1e-13 * size, "{theta}");
    }
}

#[test]
fn the_derivative_of_a_constant_is_zero() {
    assert_eq!(Bernstein::new(&[3.0]).derivative().coefficients(), [0.0]);
    assert_eq!(Bernstein::new(&[1.0, 3.0]).derivative().coefficients(), [2.0, 2.0]);
}
