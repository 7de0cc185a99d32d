//! How many solutions a step has, counted, and found again by a search that knows no cases.
//!
//! Pressed to the wall (`f < 0`) the solution is unique whenever `theta >= gamma`. Why: for given
//! `ls` the equation of `lv` has one root, because `v_gamma` decreases in `lv`. Along it
//! `s_gamma` has, as a function of `ls`, the slope `-gamma h (kappa |v| + theta h |f|)` where
//! `sgn(lv) = sgn(v)`; `-gamma h (theta h |f| - kappa |v|)` where the signs differ, and there
//! `|v| < gamma h |f|`; and `-gamma (theta - gamma) h^2 |f|` where `v_gamma = 0`. None is
//! positive when `theta >= gamma`, so `s_gamma` meets the graph of the sign once (or, for
//! `theta = gamma` and `s = 0`, along a segment that is one and the same state).

use crate::common::{apart, scaled_problem, Problem, Rng, Scheme};
use zivi_core::Lifted;

/// States nearer than this (in units of `h^2 |f|`, `h |f|`) count as one.
fn merging(scheme: Scheme) -> f64 {
    1e-9 / (scheme.gamma * (1.0 - scheme.kappa))
}

fn count(problem: &Problem) -> usize {
    problem.distinct(merging(problem.scheme)).len()
}

/// `(S, V)` of every kind: moderate, of any size, on an axis, at the origin, or on a switch of
/// the scheme (`v_gamma = 0` or `s_gamma = 0` for some pattern of signs) up to a relative
/// distance between rounding and one.
fn state(rng: &Rng, scheme: Scheme, f: f64) -> [f64; 2] {
    let Scheme { theta, gamma, kappa, .. } = scheme;
    let any = |rng: &Rng| rng.sign() * rng.log_between(1e-9, 1e9);
    let (ls, lv) = (rng.sign(), rng.sign());
    let r = 1.0 - kappa * ls * lv;
    let off = |rng: &Rng| 1.0 + rng.sign() * rng.log_between(1e-16, 1.0);
    let apex = -gamma * ls * f.signum() / r;
    match rng.pick(&[0, 1, 2, 3, 4, 5, 6, 7]) {
        0 => [rng.between(-4.0, 4.0), rng.between(-4.0, 4.0)],
        1 => [any(rng), any(rng)],
        2 => [0.0, rng.pick(&[any(rng), rng.between(-3.0, 3.0)])],
        3 => [rng.pick(&[any(rng), rng.between(-3.0, 3.0)]), 0.0],
        4 => [rng.between(-1.0, 1.0), apex * off(rng)],
        5 => [0.0, apex * off(rng)],
        _ => {
            let v = apex * rng.between(-2.0, 2.0);
            [-gamma * (r * v + theta * ls * f.signum()) * off(rng), v]
        }
    }
}

#[test]
fn pressed_to_the_wall_implicit_euler_has_one_solution() {
    let rng = Rng::new(31);
    for kappa in [0.0, 0.1, 0.41, 0.8, 0.99] {
        let scheme = Scheme::implicit_euler(rng.log_between(1e-5, 1e-1), kappa);
        for _ in 0..20_000 {
            let f = -rng.log_between(1e-3, 1e3);
            let problem = scaled_problem(scheme, state(&rng, scheme, f), f);
            assert_eq!(count(&problem), 1, "{problem:?}: {:?}", problem.distinct(0.0));
        }
        for side in [1.0, -1.0] {
            let origin = scaled_problem(scheme, [0.0, 0.0], -9.81);
            assert_eq!(count(&origin), 1);
            assert!(origin.solve(side).is_ok_and(|it| (it.s, it.v) == (0.0, 0.0)));
        }
    }
}

#[test]
fn pressed_to_the_wall_every_member_with_theta_at_least_gamma_has_one_solution() {
    let rng = Rng::new(32);
    for _ in 0..150_000 {
        let gamma = rng.pick(&[1.0 - rng.unit(), 1.0, 0.5, 1e-2]);
        let theta = match rng.pick(&[0, 1, 2, 3]) {
            0 => gamma,
            1 => (gamma * (1.0 + rng.log_between(1e-12, 1.0))).min(1.0),
            2 => 1.0,
            _ => rng.between(gamma, 1.0),
        };
        let kappa = rng.pick(&[rng.between(0.0, 0.99), 0.0, 0.41, 0.99]);
        let scheme = Scheme { h: rng.log_between(1e-5, 1e-1), theta, gamma, kappa };
        let f = -rng.log_between(1e-3, 1e3);
        let problem = scaled_problem(scheme, state(&rng, scheme, f), f);
        assert_eq!(count(&problem), 1, "{problem:?}: {:?}", problem.distinct(0.0));
    }
}

/// Where the pattern of the present side and velocity holds, nothing else does: for every member
/// of the family, also those with `theta < gamma`.
#[test]
fn pressed_to_the_wall_an_undisturbed_step_is_the_only_solution() {
    let rng = Rng::new(39);
    let mut undisturbed = 0;
    for _ in 0..150_000 {
        let (theta, gamma) = (1.0 - rng.unit(), rng.pick(&[1.0, 1.0 - rng.unit()]));
        let scheme = Scheme { h: 1e-2, theta, gamma, kappa: rng.between(0.0, 0.99) };
        let f = -rng.log_between(1e-3, 1e3);
        let state = state(&rng, scheme, f);
        if state[0] == 0.0 || state[1] == 0.0 {
            continue;
        }
        let (side, lv) = (state[0].signum(), state[1].signum());
        let r = 1.0 - scheme.kappa * side * lv;
        let s_gamma = side * state[0] + gamma * (side * r * state[1] - theta);
        let v_gamma = state[1].abs() - lv * gamma * side / r;
        if s_gamma > 1e-9 * state[0].abs() && v_gamma > 1e-9 * state[1].abs() {
            undisturbed += 1;
            let problem = scaled_problem(scheme, state, f);
            assert_eq!(count(&problem), 1, "{problem:?}: {:?}", problem.distinct(0.0));
        }
    }
    assert!(undisturbed > 20_000, "{undisturbed}");
}

/// The condition is not idle: with `theta < gamma` there are states with three solutions.
#[test]
fn with_theta_below_gamma_it_is_not_always_unique() {
    let rng = Rng::new(33);
    for theta in [0.5, 0.55, 0.75] {
        let scheme = Scheme { h: 1e-3, theta, gamma: 1.0, kappa: 0.41 };
        let mut several = 0;
        for _ in 0..40_000 {
            let state = [rng.between(-4.0, 4.0), rng.between(-4.0, 4.0)];
            match count(&scaled_problem(scheme, state, -9.81)) {
                1 => {}
                3 => several += 1,
                other => panic!("{other} solutions at {state:?}, theta = {theta}"),
            }
        }
        let share = f64::from(several) / 40_000.0;
        println!("theta = {theta}: three solutions in {:.2} %", 100.0 * share);
        assert!((0.001..0.01).contains(&share), "{share}");
    }
}

/// `S, V` uniform in `[-4, 4]^2`, 40000 draws, against the counts of an earlier, separate
/// enumeration of as many draws: the difference of two such counts has the standard deviation
/// `sqrt(2 n p (1 - p))`; four of them are allowed.
#[test]
fn pulled_off_the_wall_there_are_one_three_or_five_in_known_proportions() {
    let rng = Rng::new(34);
    let table =
        [(0.1, [31561, 8021, 418]), (0.41, [32699, 6077, 1224]), (0.8, [19098, 20445, 457])];
    for (kappa, known) in table {
        let scheme = Scheme::implicit_euler(1e-2, kappa);
        let mut counts = [0; 3];
        for _ in 0..40_000 {
            let state = [rng.between(-4.0, 4.0), rng.between(-4.0, 4.0)];
            match count(&scaled_problem(scheme, state, 2.5)) {
                number @ (1 | 3 | 5) => counts[number / 2] += 1,
                other => panic!("{other} solutions at {state:?}, kappa = {kappa}"),
            }
        }
        println!("kappa = {kappa}: {counts:?}, known {known:?}");
        for (counted, known) in counts.into_iter().zip(known) {
            let p = f64::from(known) / 40_000.0;
            let deviation = (2.0 * 40_000.0 * p * (1.0 - p)).sqrt();
            assert!(f64::from(counted - known).abs() < 4.0 * deviation, "{counted} and {known}");
        }
    }
}

#[test]
fn pulled_off_the_wall_the_origin_has_three() {
    let rng = Rng::new(35);
    for _ in 0..2_000 {
        let (theta, gamma) = (1.0 - rng.unit(), rng.pick(&[1.0, 1.0 - rng.unit()]));
        let kappa = rng.between(0.0, 0.99);
        let scheme = Scheme { h: rng.log_between(1e-5, 1e-1), theta, gamma, kappa };
        let problem = scaled_problem(scheme, [0.0, 0.0], rng.log_between(1e-3, 1e3));
        let up = [theta, 1.0 / (1.0 - kappa)];
        let states = problem.distinct(1e-9);
        assert_eq!(states.len(), 3, "{problem:?}: {states:?}");
        for expected in [[0.0, 0.0], up, [-up[0], -up[1]]] {
            let found = states.iter().any(|it| apart(*it, expected) < 1e-12 * up[1]);
            assert!(found, "{expected:?} in {states:?}");
        }
    }
}

/// All solutions by branch and bound on the box of multipliers, in units of `h` and `|f|`:
///
/// ```text
/// s_gamma   = S + gamma (R V + theta ls sgn f)
/// R v_gamma = R V + gamma ls sgn f                   R = 1 - kappa ls lv
/// ```
///
/// are bilinear in `(ls, lv)`, so over a rectangle they lie between their values at its corners.
/// A rectangle is given up when no pair in it can satisfy the two inclusions; what is left after
/// `depth` halvings is returned as states `(S+, V+)`.
fn search(scheme: Scheme, [s, v]: [f64; 2], sgn_f: f64, depth: u32) -> Vec<[f64; 2]> {
    let Scheme { theta, gamma, kappa, .. } = scheme;
    let at = |ls: f64, lv: f64| {
        let rv = (1.0 - kappa * ls * lv) * v;
        [s + gamma * (rv + theta * ls * sgn_f), rv + gamma * ls * sgn_f]
    };
    // can some lambda in [a, b] be a sign of some z in [low, high]?
    let possible = |[a, b]: [f64; 2], low: f64, high: f64| {
        let (low, high) = (low - 1e-14, high + 1e-14);
        (b == 1.0 && high >= 0.0) || (a == -1.0 && low <= 0.0) || (low <= 0.0 && high >= 0.0)
    };
    let mut left = Vec::new();
    let mut open = vec![([-1.0, 1.0], [-1.0, 1.0], 0)];
    while let Some((ls, lv, level)) = open.pop() {
        let corners = [at(ls[0], lv[0]), at(ls[0], lv[1]), at(ls[1], lv[0]), at(ls[1], lv[1])];
        let low = |row: usize| corners.iter().fold(f64::INFINITY, |m, it| m.min(it[row]));
        let high = |row: usize| corners.iter().fold(f64::NEG_INFINITY, |m, it| m.max(it[row]));
        if !(possible(ls, low(0), high(0)) && possible(lv, low(1), high(1))) {
            continue;
        }
        let (mid_s, mid_v) = (0.5 * (ls[0] + ls[1]), 0.5 * (lv[0] + lv[1]));
        if level == depth {
            let r = 1.0 - kappa * mid_s * mid_v;
            let v_plus = v + mid_s * sgn_f / r;
            left.push([s + r * (theta * v_plus + (1.0 - theta) * v), v_plus]);
            continue;
        }
        for half_s in [[ls[0], mid_s], [mid_s, ls[1]]] {
            for half_v in [[lv[0], mid_v], [mid_v, lv[1]]] {
                open.push((half_s, half_v, level + 1));
            }
        }
    }
    left
}

/// Both sets are one: every found state is near a state of the library, and the reverse.
fn compare(scheme: Scheme, state: [f64; 2], f: f64, depth: u32, tolerance: f64) -> usize {
    let problem = scaled_problem(scheme, state, f);
    let listed = problem.distinct(merging(scheme));
    let found = search(scheme, state, f.signum(), depth);
    let near = |set: &[[f64; 2]], it: &[f64; 2]| set.iter().any(|at| apart(*at, *it) < tolerance);
    for it in &listed {
        assert!(near(&found, it), "{it:?} is no solution of {problem:?} at {state:?}");
    }
    for it in &found {
        assert!(near(&listed, it), "{it:?} is missing in {listed:?} of {problem:?} at {state:?}");
    }
    listed.len()
}

#[test]
fn a_search_without_cases_finds_the_same_solutions() {
    let rng = Rng::new(36);
    let mut tally = [0; 6];
    for number in 0..1_000 {
        let f = if number % 4 == 0 { -3.0 } else { 0.7 };
        let kappa = rng.between(0.05, 0.8);
        let (theta, gamma) = match number % 5 {
            0 => (1.0 - 0.9 * rng.unit(), 1.0 - 0.9 * rng.unit()),
            _ => (1.0, 1.0),
        };
        let scheme = Scheme { h: rng.log_between(1e-4, 1e-1), theta, gamma, kappa };
        let state = [rng.between(-4.0, 4.0), rng.between(-4.0, 4.0)];
        // multipliers to 2^-19, and no state moves faster with them than by 1/(1 - kappa)^2 = 25
        tally[compare(scheme, state, f, 20, 1e-3)] += 1;
    }
    println!("draws by number of solutions: {tally:?}");
    assert!(tally[1] > 400 && tally[3] > 100 && tally[5] >= 10, "{tally:?}");
}

#[test]
fn a_search_without_cases_finds_the_same_solutions_on_the_axes() {
    let rng = Rng::new(37);
    for number in 0..60 {
        let f = if number % 2 == 0 { -3.0 } else { 0.7 };
        let scheme = Scheme::implicit_euler(1e-2, rng.between(0.05, 0.8));
        let state = match number % 3 {
            0 => [0.0, rng.between(-4.0, 4.0)],
            1 => [rng.between(-4.0, 4.0), 0.0],
            _ => [0.0, 0.0],
        };
        // coarser: here whole segments of multipliers may belong to one state
        compare(scheme, state, f, 11, 0.2);
    }
}

#[test]
fn solutions_do_not_depend_on_how_the_force_vanishes() {
    let rng = Rng::new(38);
    for _ in 0..5_000 {
        let gamma = 1.0 - rng.unit();
        let kappa = rng.between(0.0, 0.99);
        let scheme = Scheme { h: 1e-2, theta: rng.between(gamma, 1.0), gamma, kappa };
        let z = Lifted { s: rng.between(-0.05, 0.05), v: rng.between(-1.0, 1.0) };
        let zero = Problem { scheme, z, f: 0.0 }.solve(1.0).expect("a solution");
        let minus = Problem { scheme, z, f: -0.0 }.solve(1.0).expect("a solution");
        let small = Problem { scheme, z, f: -1e-300 }.solve(1.0).expect("a solution");
        assert_eq!((zero.s, zero.v), (minus.s, minus.v));
        assert!((zero.s - small.s).abs() < 1e-15 && (zero.v - small.v).abs() < 1e-15);
    }
}
