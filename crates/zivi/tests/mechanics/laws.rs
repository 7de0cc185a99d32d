//! Impacts and contacts of random systems, against every pattern of their complementarity problems
//! tried by Gaussian elimination.

use std::convert::Infallible;

use zivi::mechanics::{simulate_mechanical, MechanicalOutput, MechanicalRun, Occurrence};
use zivi::system::dynamics::Layout;
use zivi::system::impact_law::newton_impacts;
use zivi::{Silent, Status, SwitchedRk};

use crate::random::Random;

use crate::models::of_function;

/// `M`, `F`, the normals of the gaps and the accelerations of their walls, all constant; gaps are
/// zero at the origin at the start.
struct Drawn {
    n: usize,
    m: usize,
    mass: Vec<f64>,
    force: Vec<f64>,
    normals: Vec<Vec<f64>>,
    bend: Vec<f64>,
    e: Vec<f64>,
    w: Vec<f64>,
}

fn draw(random: &mut Random, n: usize, m: usize) -> Drawn {
    let mut numbers =
        |count: usize| -> Vec<f64> { (0..count).map(|_| random.within(-1.0, 1.0)).collect() };
    let root = numbers(n * n);
    let mass = (0..n * n)
        .map(|k| {
            let (i, j) = (k / n, k % n);
            let product: f64 = (0..n).map(|l| root[i * n + l] * root[j * n + l]).sum();
            product + if i == j { 0.5 } else { 0.0 }
        })
        .collect();
    let force = numbers(n).into_iter().map(|f| 10.0 * f).collect();
    let normals = (0..m).map(|_| numbers(n)).collect();
    let (bend, w) = (numbers(m), numbers(n));
    let e = numbers(m).into_iter().map(f64::abs).collect();
    Drawn { n, m, mass, force, normals, bend, e, w }
}

/// `a x = b` by elimination with pivots.
fn eliminate(a: &[f64], b: &[f64]) -> Vec<f64> {
    let n = b.len();
    let mut rows: Vec<Vec<f64>> = (0..n).map(|i| [&a[i * n..][..n], &b[i..=i]].concat()).collect();
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| rows[i][k].abs().total_cmp(&rows[j][k].abs())).unwrap();
        rows.swap(k, pivot);
        let chosen = rows[k].clone();
        for (_, row) in rows.iter_mut().enumerate().filter(|&(i, _)| i != k) {
            let factor = row[k] / chosen[k];
            row.iter_mut().zip(&chosen).skip(k).for_each(|(to, from)| *to -= factor * from);
        }
    }
    (0..n).map(|i| rows[i][n] / rows[i][i]).collect()
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

impl Drawn {
    fn mobility(&self) -> Vec<f64> {
        let ways: Vec<Vec<f64>> = self.normals.iter().map(|n| eliminate(&self.mass, n)).collect();
        (0..self.m * self.m).map(|k| dot(&self.normals[k / self.m], &ways[k % self.m])).collect()
    }

    fn run(&self, w: &[f64], e: &[f64], t1: f64) -> MechanicalRun<Infallible> {
        let layout = Layout::smooth(self.n, self.m);
        let function = |t: f64, q: &[f64], _: &[f64], out: &mut [f64]| {
            out.fill(0.0);
            out[layout.mass()].copy_from_slice(&self.mass);
            out[layout.force()].copy_from_slice(&self.force);
            for (i, normal) in self.normals.iter().enumerate() {
                out[layout.gap()][i] = dot(normal, q) + 0.5 * self.bend[i] * t * t;
                out[layout.rate()][i] = self.bend[i] * t;
                out[layout.gradient()][i * self.n..][..self.n].copy_from_slice(normal);
            }
            out[layout.curvature()].copy_from_slice(&self.bend);
            Ok::<(), Infallible>(())
        };
        let mut system = of_function(layout, function);
        let (q, settings) = (vec![0.0; self.n], SwitchedRk::default());
        let output = MechanicalOutput::default();
        simulate_mechanical(
            settings,
            &mut system,
            &newton_impacts(e).unwrap(),
            (0.0, t1),
            (&q, w),
            output,
            &mut Silent,
        )
        .unwrap()
    }
}

/// `0 <= z  perp  d z + q >= 0` by all patterns, the one that violates least.
fn patterns(d: &[f64], q: &[f64]) -> Vec<f64> {
    let m = q.len();
    let solve = |pattern: usize| {
        let set: Vec<usize> = (0..m).filter(|i| pattern >> i & 1 == 1).collect();
        let matrix: Vec<f64> =
            set.iter().flat_map(|i| set.iter().map(move |j| d[i * m + j])).collect();
        let right: Vec<f64> = set.iter().map(|&i| -q[i]).collect();
        let mut z = vec![0.0; m];
        set.iter().zip(eliminate(&matrix, &right)).for_each(|(&i, value)| z[i] = value);
        z
    };
    let violation = |z: &Vec<f64>| {
        let rows = (0..m).map(|i| dot(&d[i * m..][..m], z) + q[i]);
        rows.zip(z).fold(0.0_f64, |worst, (row, z)| worst.max(-row).max(-z))
    };
    let all = (0..1 << m).map(solve);
    all.min_by(|one, other| violation(one).total_cmp(&violation(other))).unwrap()
}

#[test]
fn impacts_solve_their_complementarity_problem() {
    let mut random = Random::new(11);
    let mut bounced = 0;
    for round in 0..300 {
        let (n, m) = (3 + round % 2, 2 + round % 2);
        let mut it = draw(&mut random, n, m);
        // all gaps are hit at the start
        it.normals.iter_mut().for_each(|normal| {
            let sign = if dot(normal, &it.w) > 0.0 { -1.0 } else { 1.0 };
            normal.iter_mut().for_each(|x| *x *= sign);
        });
        let d = it.mobility();
        let speeds: Vec<f64> = it.normals.iter().map(|normal| dot(normal, &it.w)).collect();
        let right: Vec<f64> = speeds.iter().zip(&it.e).map(|(v, e)| (1.0 + e) * v).collect();
        let wanted = patterns(&d, &right);
        let run = it.run(&it.w, &it.e, 1e-9);
        let mut seen = 0;
        for occurrence in &run.occurrences {
            let Occurrence::Impact { t, gap, before, after, impulse, group } = *occurrence else {
                continue;
            };
            if group > 1 {
                continue;
            }
            let passed: f64 = dot(&d[gap * m..][..m], &wanted);
            assert_eq!(t, 0.0);
            assert!(
                (impulse - wanted[gap]).abs() < 1e-10 * (1.0 + impulse),
                "{round} {occurrence:?}"
            );
            assert!((before - speeds[gap]).abs() < 1e-13, "{round}");
            assert!((after - before - passed).abs() < 1e-10, "{round} {occurrence:?}");
            seen += 1;
        }
        assert_eq!(seen, m, "{round}");
        bounced += wanted.iter().filter(|z| **z > 0.0).count();
    }
    assert!(bounced > 400);
}

#[test]
fn forces_of_contacts_solve_theirs() {
    let mut random = Random::new(12);
    let (mut closed, mut opened) = (0, 0);
    for round in 0..300 {
        let (n, m) = (3 + round % 3, 1 + round % 3);
        let it = draw(&mut random, n, m);
        let run = it.run(&vec![0.0; n], &it.e, 1e-3);
        let (d, free) = (it.mobility(), eliminate(&it.mass, &it.force));
        let b: Vec<f64> =
            it.normals.iter().zip(&it.bend).map(|(normal, h)| dot(normal, &free) + h).collect();
        let wanted = patterns(&d, &b);
        assert_eq!(run.status, Status::Completed, "{round}");
        let set = run.samples.modes[0].closed;
        for i in 0..m {
            let got = run.samples.lambda[i];
            assert!((got - wanted[i]).abs() < 1e-9 * (1.0 + got.abs()), "{round} {i}: {got}");
            assert_eq!(set.has(i), wanted[i] > 0.0, "{round} {i}");
            let row = dot(&d[i * m..][..m], &wanted) + b[i];
            // what opens has moved by half its acceleration times the square of the time
            let end = run.samples.x[run.samples.x.len() - m + i];
            assert!((end - 0.5 * row.max(0.0) * 1e-6).abs() < 1e-12, "{round} {i}: {end:e}");
            if set.has(i) {
                closed += 1;
            } else {
                opened += 1;
            }
        }
    }
    assert!(closed > 100 && opened > 100);
}
