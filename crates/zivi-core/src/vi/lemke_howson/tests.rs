extern crate std;
use super::*;
use std::vec;
use std::vec::Vec;

/// Strategies that sum to 1, and the pivots.
fn equilibrium(
    a: &[f64],
    b: &[f64],
    m: usize,
    limit: usize,
) -> Option<(Vec<f64>, Vec<f64>, usize)> {
    let n = a.len() / m;
    let (reals, indices) = lemke_howson_len(m, n);
    let (mut reals, mut indices) = (vec![f64::NAN; reals], vec![usize::MAX; indices]);
    let (mut x, mut y) = (vec![f64::NAN; m], vec![f64::NAN; n]);
    let work = (&mut reals[..], &mut indices[..]);
    let pivots = lemke_howson((a, b), (&mut x, &mut y), limit, work, &mut || Ok(())).unwrap()?;
    for it in [&mut x, &mut y] {
        let total: f64 = it.iter().sum();
        it.iter_mut().for_each(|v| *v /= total);
    }
    Some((x, y, pivots))
}

/// The most that either player gains by a pure strategy, relative to the payoffs.
fn regret(a: &[f64], b: &[f64], x: &[f64], y: &[f64]) -> f64 {
    let (m, n) = (x.len(), y.len());
    let rows: Vec<f64> = (0..m).map(|i| (0..n).map(|j| a[i * n + j] * y[j]).sum()).collect();
    let columns: Vec<f64> = (0..n).map(|j| (0..m).map(|i| b[i * n + j] * x[i]).sum()).collect();
    let worth = |v: &[f64], p: &[f64]| v.iter().zip(p).map(|(v, p)| v * p).sum::<f64>();
    let best = |v: &[f64]| v.iter().fold(0.0, |m: f64, v| m.max(*v));
    f64::max(best(&rows) - worth(&rows, x), best(&columns) - worth(&columns, y))
}

#[test]
fn random_games_of_all_shapes_end_in_an_equilibrium() {
    let mut random = super::super::iterate::Random::new(7);
    for trial in 0..400 {
        let (m, n) = (1 + trial % 7, 1 + trial / 7 % 6);
        // few different payoffs: ties everywhere
        let levels = [2.0, 5.0, 1e6][trial % 3];
        let mut draw = || -> Vec<f64> {
            (0..m * n).map(|_| 1.0 + (levels * random.uniform()).floor() / levels).collect()
        };
        let (a, b) = (draw(), draw());
        let (x, y, pivots) = equilibrium(&a, &b, m, 10_000).unwrap();
        assert!(x.iter().chain(&y).all(|p| *p >= 0.0));
        assert!(regret(&a, &b, &x, &y) < 1e-12, "{m} {n} {trial}");
        assert!(pivots >= 2);
    }
}

/// Ratios that differ by rounding alone are a tie, which the next label breaks.
#[test]
fn ties_are_not_broken_by_rounding() {
    let thirds = [0.3, 0.1 + 0.2];
    assert_ne!(thirds[0], thirds[1]);
    for (of_first, first) in [(thirds[0], thirds[1]), (thirds[1], thirds[0])] {
        // both slacks have left the basis, to columns 0 and 1; the rates are those of column 2
        let mut reals = [of_first, 2.0, 1.0, 2.0 * first, 2.0, 2.0, 1.0, 1.0, 0.0, 0.0];
        let mut indices = [2, 3, 0, 1, 4, 2, 3, 0, 1, 4];
        let it = Dictionary::new(2, 3, 0..2, (&mut reals, &mut indices));
        assert!(it.precedes(1, 0, 2) && !it.precedes(0, 1, 2));
    }
}

/// A variable that vanishes together with the leaving one becomes exactly zero.
#[test]
fn constants_that_cancel_are_zero() {
    for rates in [[0.3, 0.1 + 0.2], [0.1 + 0.2, 0.3]] {
        let mut reals = [rates[0], 2.0, rates[1], 1.0, 0.15, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0];
        let mut indices = [0, 1, 2, 3, 4, 0, 1, 2, 3, 4];
        let mut it = Dictionary::new(3, 2, 0..3, (&mut reals, &mut indices));
        it.pivot(0, 0);
        assert_eq!(it.constant[1], 0.0, "{rates:?}");
        assert!((it.constant[2] - 0.5).abs() < 1e-15 && it.constant[0] > 3.0);
    }
}

#[test]
fn games_whose_equilibrium_is_known() {
    // an inspector and a worker, with 5 added: the worker is indifferent at 1/4, she at 4/5
    let (x, y, _) = equilibrium(&[4.0, 6.0, 5.0, 2.0], &[7.0, 1.0, 7.0, 9.0], 2, 100).unwrap();
    assert!((x[0] - 0.25).abs() < 1e-15 && (y[0] - 0.8).abs() < 1e-15, "{x:?} {y:?}");
    // the prisoners' dilemma: both defect, each after one pivot of either
    let found = equilibrium(&[3.0, 1.0, 4.0, 2.0], &[3.0, 4.0, 1.0, 2.0], 2, 100).unwrap();
    assert_eq!((found.0, found.1), (vec![0.0, 1.0], vec![0.0, 1.0]));
    assert_eq!(equilibrium(&[1.0], &[1.0], 1, 10), Some((vec![1.0], vec![1.0], 2)));
}

#[test]
fn limits_and_lengths() {
    let pennies = ([3.0, 1.0, 1.0, 3.0], [1.0, 3.0, 3.0, 1.0]);
    let (.., pivots) = equilibrium(&pennies.0, &pennies.1, 2, 100).unwrap();
    assert_eq!(pivots, 4);
    assert!(equilibrium(&pennies.0, &pennies.1, 2, 4).is_some());
    assert!(equilibrium(&pennies.0, &pennies.1, 2, 3).is_none());
    let short = |reals: usize, indices: usize, m: usize| {
        let (mut reals, mut indices) = (vec![0.0; reals], vec![0; indices]);
        let (mut x, mut y) = (vec![0.0; m], vec![0.0; 2]);
        let work = (&mut reals[..], &mut indices[..]);
        let (a, b) = (&pennies.0[..], &pennies.1[..]);
        lemke_howson((a, b), (&mut x, &mut y), 100, work, &mut || Ok(()))
    };
    assert_eq!(lemke_howson_len(2, 2), (16, 16));
    assert_eq!(short(16, 16, 2), Ok(Some(4)));
    assert_eq!([short(15, 16, 2), short(16, 15, 2), short(16, 16, 1)], [Ok(None); 3]);
    assert_eq!([short(99, 99, 0), short(99, 99, 3)], [Ok(None); 2]);
}

#[test]
fn it_can_be_stopped() {
    let game = [1.0; 4];
    let (mut reals, mut indices) = ([0.0; 16], [0; 16]);
    let (mut x, mut y) = ([0.0; 2], [0.0; 2]);
    let work = (&mut reals[..], &mut indices[..]);
    let stop = &mut || Err(Interruption::Stopped);
    let end = lemke_howson((&game, &game), (&mut x, &mut y), 100, work, stop);
    assert_eq!(end, Err(Interruption::Stopped));
}

#[test]
fn budgets_and_labels_take_turns() {
    let budgets: Vec<usize> = (1..=15).map(luby).collect();
    assert_eq!(budgets, [1, 1, 2, 1, 1, 2, 4, 1, 1, 2, 1, 1, 2, 4, 8]);
    for labels in 1..40 {
        let mut met: Vec<usize> = (0..labels).map(|turn| spread(turn, labels)).collect();
        met.sort_unstable();
        assert_eq!(met, (0..labels).collect::<Vec<_>>());
    }
    // the first ones are of both players
    let first: Vec<usize> = (0..5).map(|turn| spread(turn, 100)).collect();
    assert_eq!(first, [0, 61, 22, 83, 44]);
}

#[test]
fn labels_race() {
    // for some labels of such games the path is a hundred times longer
    let mut random = super::super::iterate::Random::new(3);
    let m = 60;
    let mut draw = || -> Vec<f64> { (0..m * m).map(|_| 1.0 + random.uniform()).collect() };
    let games: Vec<_> = (0..12).map(|_| (draw(), draw())).collect();
    let most = games.iter().map(|(a, b)| {
        let (x, y, pivots) = equilibrium(a, b, m, 100_000).unwrap();
        assert!(regret(a, b, &x, &y) < 1e-10);
        pivots
    });
    let most: Vec<usize> = most.collect();
    assert!(most.iter().max() < Some(&4000));
    // a path is given up after half a pivot a label at first: after twice that this one takes 233
    assert!(most[1] < 180, "{most:?}");
}
