//! Which of several solutions a step takes.

use crate::common::{scaled_problem, Problem, Rng, Scheme};
use zivi_core::step::{selection::exact_motion, PATTERNS};
use zivi_core::{Case, Lifted, StepSolution};

/// The exact motion over `h` under a constant `f > 0`, in `(s, v)`, told from the physical side:
/// a parabola that turns at most once and meets the wall at most once before.
fn exact(problem: &Problem, side: f64) -> (f64, f64) {
    let Scheme { h, kappa, .. } = problem.scheme;
    let (f, Lifted { s, v }) = (problem.f, problem.z);
    let side = if s != 0.0 {
        s.signum()
    } else if v != 0.0 {
        v.signum()
    } else {
        side
    };
    let e = (1.0 - kappa) / (1.0 + kappa);
    let x = s.abs();
    let towards = side * v < 0.0;
    let w = side * v * if towards { 1.0 + kappa } else { 1.0 - kappa };
    let lowest = x - w * w / (2.0 * f);
    let hit = (-w - (2.0 * f * (0.0 - lowest).max(0.0)).sqrt()) / f;
    let (side, x, w) = if towards && lowest <= 0.0 && hit <= h {
        let (rebound, rest) = (-e * (w + f * hit), h - hit);
        (-side, rebound * rest + f * rest * rest / 2.0, rebound + f * rest)
    } else {
        (side, x + w * h + f * h * h / 2.0, w + f * h)
    };
    (side * x, side * w / (1.0 - kappa * f64::from(w > 0.0) + kappa * f64::from(w < 0.0)))
}

fn distance(problem: &Problem, side: f64, it: &StepSolution) -> f64 {
    let unit = problem.scheme.h * problem.f;
    let (s, v) = exact(problem, side);
    (it.s - s).abs() / (problem.scheme.h * unit) + (it.v - v).abs() / unit
}

#[test]
fn the_exact_motion_of_the_library_is_the_one_of_this_file() {
    let rng = Rng::new(48);
    let mut impacts = 0;
    for _ in 0..40_000 {
        let scheme = Scheme::implicit_euler(rng.log_between(1e-2, 1e1), rng.between(0.0, 0.95));
        let state = [rng.between(0.0, 4.0), rng.between(-4.0, 4.0)];
        let problem = scaled_problem(scheme, state, rng.log_between(1e-2, 1e2));
        let restitution = scheme.build().restitution();
        let theirs = exact_motion(problem.z, problem.f, scheme.h, restitution);
        let (s, v) = exact(&problem, 1.0);
        impacts += u32::from(s < 0.0);
        let unit = scheme.h * problem.f / (1.0 - scheme.kappa);
        // near grazing the impact time is a square root of a difference: half the digits
        assert!((theirs.s - s).abs() < 1e-7 * scheme.h * unit, "{problem:?}: {theirs:?}, {s}, {v}");
        assert!((theirs.v - v).abs() < 1e-7 * unit, "{problem:?}: {theirs:?}, {s}, {v}");
    }
    assert!(impacts > 2_000, "{impacts}");
}

/// The chosen one is among the solutions, and none is nearer.
fn assert_nearest(problem: &Problem, side: f64) {
    let chosen = problem.solve(side).expect("a solution");
    let own = distance(problem, side, &chosen);
    let mut listed = false;
    for other in problem.scheme.build().solutions(problem.z, problem.f) {
        listed |= (other.s, other.v) == (chosen.s, chosen.v);
        let its = distance(problem, side, &other);
        assert!(
            own <= its + 1e-9 * (1.0 + its),
            "{own} > {its}\n{problem:?}\n{chosen:?}\n{other:?}"
        );
    }
    assert!(listed, "{chosen:?} is not listed for {problem:?}");
}

#[test]
fn pulled_off_the_wall_the_nearest_to_the_exact_motion_is_taken() {
    let rng = Rng::new(41);
    let mut tally = [0; 6];
    for _ in 0..40_000 {
        let kappa = rng.pick(&[0.1, 0.41, 0.8, rng.between(0.0, 0.95)]);
        let scheme = Scheme::implicit_euler(rng.log_between(1e-4, 1e-1), kappa);
        let state = [rng.between(-4.0, 4.0), rng.between(-4.0, 4.0)];
        let problem = scaled_problem(scheme, state, rng.log_between(1e-2, 1e2));
        tally[problem.distinct(1e-8).len().min(5)] += 1;
        assert_nearest(&problem, rng.sign());
    }
    println!("draws by number of solutions: {tally:?}");
    assert!(tally[3] > 5_000 && tally[5] > 500, "too few with a choice: {tally:?}");
}

#[test]
fn so_it_is_for_every_member_of_the_family() {
    let rng = Rng::new(42);
    for _ in 0..20_000 {
        let (theta, gamma) = (1.0 - rng.unit(), 1.0 - rng.unit());
        let kappa = rng.between(0.0, 0.95);
        let scheme = Scheme { h: rng.log_between(1e-4, 1e-1), theta, gamma, kappa };
        let problem = scaled_problem(scheme, [rng.between(-4.0, 4.0), rng.between(-4.0, 4.0)], 1.3);
        assert_nearest(&problem, rng.sign());
    }
}

/// Under `f <= 0` the solver has shortcuts; what it takes is the first of the list, to the last bit,
/// also where a step just reaches the wall or just turns.
#[test]
fn pressed_to_the_wall_the_first_of_the_list_is_taken() {
    let rng = Rng::new(53);
    let mut cases = [0; 4];
    for k in 0..60_000 {
        let euler = k % 3 > 0;
        let weight = || if euler { 1.0 } else { 1.0 - rng.unit() };
        let (theta, gamma) = (weight(), weight());
        let kappa = rng.pick(&[0.0, 0.41, 0.9, rng.between(0.0, 0.95)]);
        let scheme = Scheme { h: rng.log_between(1e-4, 1e-1), theta, gamma, kappa };
        let grid = |z: f64| if k % 2 == 0 { (2.0 * z).round() / 2.0 } else { z };
        let state = [grid(rng.between(-4.0, 4.0)), grid(rng.between(-4.0, 4.0))];
        let mut problem = scaled_problem(scheme, state, -grid(rng.between(0.0, 3.0)).abs());
        if k % 5 == 0 {
            // ends on the wall, up to a few roundings, with the signs of a fall
            let fall = scheme.h * ((1.0 + kappa) * problem.z.v - scheme.h * problem.f.abs());
            problem.z.s = -fall * (1.0 + f64::from(k % 7) * f64::EPSILON);
        }
        let step = scheme.build();
        let Some(first) = step.solutions(problem.z, problem.f).next() else { continue };
        let found = step.solve(problem.z, problem.f, 1.0).expect("there is one");
        cases[match found.case {
            Case::Origin => 0,
            Case::Wall => 1,
            Case::Apex => 2,
            Case::Regular => 3,
        }] += 1;
        // a step with room to spare may be listed after one that coincides with it
        let same = [found.s.to_bits(), found.v.to_bits()] == [first.s.to_bits(), first.v.to_bits()];
        let unique = theta >= gamma;
        assert!(
            same || !unique && found.case == Case::Regular,
            "{problem:?}: {found:?}, {first:?}"
        );
    }
    println!("{cases:?}");
    assert!(cases.iter().all(|&count| count > 500), "{cases:?}");
}

/// Hand-computed: `kappa = 1/2`, `h = f = 1`, `s = 10`, `v = -5/4`. The exact velocity is
/// `x' = 3/2 v + 1 = -7/8`, so `v = -7/12`, `s = 10 - 15/8 + 1/2`. Going on inwards gives
/// `v+ = v + 2/3 = -7/12` (a solution), turning outwards `v+ = v + 2 = 3/4` (another), and
/// `v+ = 0` a third.
#[test]
fn an_apex_with_three_solutions_by_hand() {
    let problem = scaled_problem(Scheme::implicit_euler(1.0, 0.5), [10.0, -1.25], 1.0);
    assert_eq!(problem.distinct(1e-9).len(), 3);
    let chosen = problem.solve(1.0).expect("a solution");
    assert_eq!((chosen.case, chosen.lambda_s, chosen.lambda_v), (Case::Regular, 1.0, -1.0));
    assert!((chosen.v + 7.0 / 12.0).abs() < 1e-15);
    assert!((chosen.s - (10.0 - 1.5 * 7.0 / 12.0)).abs() < 1e-14);
}

#[test]
fn at_the_origin_it_lifts_off_to_the_side_where_it_was() {
    let rng = Rng::new(43);
    for _ in 0..20_000 {
        let (theta, gamma) =
            rng.pick(&[(1.0, 1.0), (0.5, 0.5), (1.0 - rng.unit(), 1.0 - rng.unit())]);
        let kappa = rng.between(0.0, 0.999);
        let scheme = Scheme { h: rng.log_between(1e-6, 1.0), theta, gamma, kappa };
        let problem = Problem { scheme, z: Lifted::default(), f: rng.log_between(1e-9, 1e9) };
        for side in [1.0, -1.0] {
            let up = problem.solve(side).expect("a solution");
            let kick = scheme.h * problem.f / (1.0 - kappa);
            assert!((side * up.v - kick).abs() <= 1e-14 * kick, "{problem:?}: {up:?}");
            let rise = theta * scheme.h * scheme.h * problem.f;
            assert!((side * up.s - rise).abs() <= 1e-14 * rise, "{problem:?}: {up:?}");
            assert_eq!((up.lambda_s, up.lambda_v), (side, side));
        }
    }
}

#[test]
fn at_the_origin_under_pressure_it_rests_exactly() {
    let rng = Rng::new(44);
    for _ in 0..20_000 {
        let (theta, gamma) =
            rng.pick(&[(1.0, 1.0), (0.5, 0.5), (1.0 - rng.unit(), 1.0 - rng.unit())]);
        let kappa = rng.between(0.0, 0.999);
        let scheme = Scheme { h: rng.log_between(1e-6, 1.0), theta, gamma, kappa };
        let f = if rng.chance(0.2) { 0.0 } else { -rng.log_between(1e-9, 1e9) };
        let rest =
            Problem { scheme, z: Lifted::default(), f }.solve(rng.sign()).expect("a solution");
        assert_eq!((rest.s, rest.v, rest.case), (0.0, 0.0, Case::Origin));
    }
}

fn degeneracy(case: Case) -> u8 {
    match case {
        Case::Origin => 3,
        Case::Wall => 2,
        Case::Apex => 1,
        Case::Regular => 0,
    }
}

/// With dyadic numbers the switches are hit exactly, so that several candidates coincide to the
/// last bit: the most degenerate is taken, and its zeros are exact.
#[test]
fn of_coincident_candidates_the_most_degenerate_is_taken() {
    let (h, kappa) = (1.0 / 1024.0, 0.5);
    let scheme = Scheme::implicit_euler(h, kappa);
    for f in [-0.5, -2.0, -9.75] {
        for side in [1.0, -1.0] {
            let solve = |s: f64, v: f64| {
                let z = Lifted { s: side * s, v: side * v };
                Problem { scheme, z, f }.solve(side).expect("a solution")
            };
            // inwards, v+ < 0: the step of pattern (1, -1) ends at s+ = 0
            let landing = solve(h * (1.5 * 3.0 - h * f), -3.0);
            assert_eq!((landing.case, landing.s), (Case::Wall, 0.0));
            // the same with pattern (-1, -1)
            let passing = solve(h * (0.5 * 3.0 + h * f), -3.0);
            assert_eq!((passing.case, passing.s), (Case::Wall, 0.0));
            // outwards, pattern (1, 1), and inwards, (1, -1): both end at v+ = 0, far away
            for r in [0.5, 1.5] {
                let apex = solve(7.0, -h * f / r);
                assert_eq!((apex.case, apex.v, apex.s), (Case::Apex, 0.0, side * 7.0));
            }
            // at the wall, with the largest velocity that stops in one step
            let stop = solve(0.0, -h * f / 0.5);
            assert_eq!((stop.case, stop.s, stop.v), (Case::Origin, 0.0, 0.0));
        }
    }
}

/// The same a few units in the last place away from the switches, in general position.
#[test]
fn rounding_does_not_lose_the_exact_zeros() {
    let rng = Rng::new(45);
    for _ in 0..20_000 {
        let kappa = rng.between(0.0, 0.95);
        let scheme = Scheme::implicit_euler(rng.log_between(1e-4, 1e-1), kappa);
        let h = scheme.h;
        let f = -rng.log_between(1e-1, 1e1);
        let nudge = || 1.0 + f64::EPSILON * rng.between(-8.0, 8.0).round();
        let solve =
            |s, v| Problem { scheme, z: Lifted { s, v }, f }.solve(1.0).expect("a solution");
        let v = -3.0 - 2.0 * h * f.abs() / (1.0 - kappa); // does not turn within the step
        let landing = solve(h * ((1.0 + kappa) * -v - h * f) * nudge(), v);
        assert_eq!((landing.case, landing.s), (Case::Wall, 0.0), "{scheme:?}, f = {f}");
        let passing = solve(h * ((1.0 - kappa) * -v + h * f) * nudge(), v);
        assert_eq!((passing.case, passing.s), (Case::Wall, 0.0), "{scheme:?}, f = {f}");
        let apex = solve(7.0, -h * f / (1.0 - kappa) * nudge());
        assert_eq!((apex.case, apex.v), (Case::Apex, 0.0), "{scheme:?}, f = {f}");
        let stop = solve(0.0, -h * f / (1.0 - kappa) * nudge());
        assert_eq!((stop.s, stop.v), (0.0, 0.0), "{scheme:?}, f = {f}: {stop:?}");
    }
}

/// Nor under no force at all, where the nearest to the exact motion would be one or the other.
#[test]
fn without_a_force_the_zeros_are_exact_too() {
    let rng = Rng::new(49);
    for _ in 0..5_000 {
        let scheme = Scheme::implicit_euler(rng.log_between(1e-4, 1e-1), rng.between(0.0, 0.95));
        let nudge = 1.0 + f64::EPSILON * rng.between(-8.0, 8.0).round();
        let v = -rng.log_between(1e-3, 1e3);
        let z = Lifted { s: scheme.h * (1.0 + scheme.kappa) * -v * nudge, v };
        let landing = Problem { scheme, z, f: 0.0 }.solve(1.0).expect("a solution");
        assert_eq!((landing.case, landing.s), (Case::Wall, 0.0), "{scheme:?}, v = {v}");
    }
}

/// With `theta < gamma` there can be three distinct solutions: the same order decides.
#[test]
fn of_three_distinct_ones_under_pressure_the_most_degenerate_is_taken() {
    let rng = Rng::new(47);
    let mut several = 0;
    for _ in 0..60_000 {
        let theta = rng.between(0.1, 0.9);
        let scheme = Scheme { h: 1e-2, theta, gamma: 1.0, kappa: rng.between(0.05, 0.8) };
        let state = [rng.between(-1.0, 1.0), rng.between(-3.0, 3.0)];
        let problem = scaled_problem(scheme, state, -9.81);
        if problem.distinct(1e-6).len() == 1 {
            continue;
        }
        several += 1;
        let chosen = problem.solve(1.0).expect("a solution");
        for other in scheme.build().solutions(problem.z, problem.f) {
            let ordered = degeneracy(other.case) <= degeneracy(chosen.case);
            assert!(ordered, "{problem:?}\n{chosen:?}\n{other:?}");
        }
    }
    println!("{several} states with several solutions");
    assert!(several > 200);
}

/// In general: for `f <= 0` no solution that coincides with the chosen one is more degenerate.
#[test]
fn no_coincident_solution_is_more_degenerate_than_the_chosen() {
    let rng = Rng::new(46);
    for _ in 0..40_000 {
        let gamma = rng.pick(&[1.0, 0.5, 1.0 - rng.unit()]);
        let theta = rng.pick(&[gamma, 1.0, 1.0 - rng.unit()]);
        let scheme = Scheme { h: 1e-2, theta, gamma, kappa: rng.between(0.0, 0.95) };
        let state = [rng.between(-2.0, 2.0), rng.pick(&[0.0, rng.between(-2.0, 2.0)])];
        let problem = scaled_problem(scheme, state, rng.pick(&[-1.0, -9.81]));
        let chosen = problem.solve(1.0).expect("a solution");
        for other in scheme.build().solutions(problem.z, problem.f) {
            let unit = scheme.h * problem.f.abs();
            let gap = (other.s - chosen.s).abs() / scheme.h + (other.v - chosen.v).abs();
            let coincides = gap < 1e-14 * unit;
            let better = degeneracy(other.case) > degeneracy(chosen.case);
            assert!(!(coincides && better), "{problem:?}\n{chosen:?}\n{other:?}");
        }
    }
}

/// On the side `-1` too a zero is `+0`, and prints as one.
#[test]
fn no_zero_is_negative() {
    let scheme = Scheme::implicit_euler(1e-2, 0.5);
    for side in [1.0, -1.0] {
        let z = Lifted { s: 0.0, v: side * 1e-3 };
        let rest = Problem { scheme, z, f: -9.81 }.solve(side).expect("a solution");
        assert_eq!(rest.case, Case::Origin);
        assert!([rest.s, rest.v].iter().all(|z| z.to_bits() == 0), "{rest:?}");
    }
}

/// Wherever the signs of a pattern fit, the force lies in one of the pattern's ranges.
#[test]
fn forces_of_accepted_patterns_lie_in_their_ranges() {
    let rng = Rng::new(48);
    let mut found = [0; 4];
    for _ in 0..20_000 {
        let gamma = rng.pick(&[1.0, 0.5, 1.0 - rng.unit()]);
        let scheme = Scheme { h: 1e-2, theta: rng.pick(&[gamma, 1.0]), gamma, kappa: rng.unit() };
        let f = rng.sign() * rng.log_between(1.0, 100.0);
        let state = [rng.between(-2.0, 2.0), rng.between(-2.0, 2.0)];
        let Problem { z, .. } = scaled_problem(scheme, state, f);
        let step = scheme.build();
        for pattern in PATTERNS {
            let Some(solution) = step.accepted(pattern, z, f, 1.0) else { continue };
            let slack = 1e-9 * f.abs();
            let ranges = step.force_ranges(pattern, z, 1.0);
            let within = |&(low, high): &(f64, f64)| f >= low - slack && f <= high + slack;
            assert!(ranges.iter().flatten().any(within), "{pattern:?} {f} {z:?}: {ranges:?}");
            found[usize::from(degeneracy(solution.case))] += 1;
        }
    }
    assert!(found[..3].iter().all(|&n| n > 500), "{found:?}");
}
