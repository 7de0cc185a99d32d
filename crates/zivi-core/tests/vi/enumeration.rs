//! An independent route for small problems: all patterns of active bounds, with many Newton
//! starts each, on random nonlinear maps.

use crate::support::{residual, solve, Maps, Random};
use zivi_core::vi::{Settings, Stage};

/// `F(z) = M z + q + a g(B z)` with `g` the arctangent, sine or cube of each entry.
struct Instance {
    n: usize,
    m: Vec<f64>,
    b: Vec<f64>,
    q: Vec<f64>,
    kind: usize,
    lower: Vec<f64>,
    upper: Vec<f64>,
}

impl Instance {
    fn new(seed: u64, monotone: bool) -> Self {
        let mut random = Random::new(seed);
        let n = 1 + random.below(if monotone { 6 } else { 3 });
        let raw: Vec<f64> = (0..n * n).map(|_| random.normal()).collect();
        let (mut m, mut b) = (raw.clone(), vec![0.0; n * n]);
        for i in 0..n {
            for j in 0..n {
                if monotone {
                    let gram: f64 = (0..n).map(|k| raw[i * n + k] * raw[j * n + k]).sum();
                    m[i * n + j] = gram + raw[i * n + j] - raw[j * n + i];
                    m[i * n + j] += if i == j { 0.2 } else { 0.0 };
                    b[i * n + j] = if i == j { random.within(0.2, 2.0) } else { 0.0 };
                } else {
                    b[i * n + j] = random.normal();
                }
            }
        }
        let (mut lower, mut upper) = (vec![f64::NEG_INFINITY; n], vec![f64::INFINITY; n]);
        for i in 0..n {
            // a nonmonotone map needs a bounded box to have a solution for certain
            let kind = if monotone { random.below(4) } else { 3 };
            let centre = random.normal();
            if kind & 1 == 1 {
                lower[i] = centre - random.within(0.0, 2.0);
            }
            if kind & 2 == 2 {
                upper[i] = centre + random.within(0.0, 2.0);
            }
        }
        let q = (0..n).map(|_| 3.0 * random.normal()).collect();
        let kind = random.below(if monotone { 2 } else { 3 });
        Self { n, m, b, q, kind, lower, upper }
    }

    fn f(&self, z: &[f64], f: &mut [f64]) {
        for i in 0..self.n {
            let row = |a: &[f64]| (0..self.n).map(|j| a[i * self.n + j] * z[j]).sum::<f64>();
            let inner = row(&self.b);
            f[i] = row(&self.m)
                + self.q[i]
                + match self.kind {
                    0 => inner.atan(),
                    1 => inner.powi(3),
                    _ => 2.0 * inner.sin(),
                };
        }
    }

    fn jacobian(&self, z: &[f64], out: &mut [f64]) {
        for i in 0..self.n {
            let inner: f64 = (0..self.n).map(|j| self.b[i * self.n + j] * z[j]).sum();
            let slope = match self.kind {
                0 => 1.0 / (1.0 + inner * inner),
                1 => 3.0 * inner * inner,
                _ => 2.0 * inner.cos(),
            };
            for j in 0..self.n {
                let k = i * self.n + j;
                out[k] = self.m[k] + slope * self.b[k];
            }
        }
    }

    /// All distinct solutions that any pattern and any start leads to.
    fn enumerate(&self, starts: usize) -> Vec<Vec<f64>> {
        let mut found: Vec<Vec<f64>> = Vec::new();
        let mut random = Random::new(99);
        for code in 0..3_usize.pow(self.n as u32) {
            let digit = |i: usize| code / 3_usize.pow(i as u32) % 3;
            let bound = |i: usize| [f64::NAN, self.lower[i], self.upper[i]][digit(i)];
            if (0..self.n).any(|i| digit(i) > 0 && !bound(i).is_finite()) {
                continue;
            }
            let free: Vec<usize> = (0..self.n).filter(|&i| digit(i) == 0).collect();
            for _ in 0..if free.is_empty() { 1 } else { starts } {
                let mut z: Vec<f64> = (0..self.n)
                    .map(|i| if digit(i) > 0 { bound(i) } else { 2.0 * random.normal() })
                    .collect();
                self.newton(&free, &mut z);
                let left = residual(&mut self.maps(), &self.lower, &self.upper, &z);
                let is_new = found.iter().all(|s| distance(s, &z) > 1e-6);
                if left < 1e-9 && is_new {
                    found.push(z);
                }
            }
        }
        found
    }

    fn maps(&self) -> impl zivi_core::vi::Problem + '_ {
        Maps(
            |z: &[f64], f: &mut [f64]| self.f(z, f),
            |z: &[f64], j: &mut [f64]| {
                self.jacobian(z, j);
            },
        )
    }

    /// Newton on the free rows, halving until the largest of them shrinks.
    fn newton(&self, free: &[usize], z: &mut [f64]) {
        let (mut f, mut jac) = (vec![0.0; self.n], vec![0.0; self.n * self.n]);
        let size = |f: &[f64]| free.iter().fold(0.0, |s: f64, &i| s + f[i] * f[i]);
        for _ in 0..60 {
            self.f(z, &mut f);
            self.jacobian(z, &mut jac);
            let before = size(&f);
            if before < 1e-26 {
                return;
            }
            let a: Vec<Vec<f64>> = free
                .iter()
                .map(|&i| free.iter().map(|&j| jac[i * self.n + j]).chain([-f[i]]).collect())
                .collect();
            let Some(d) = gauss(a) else { return };
            let from = z.to_vec();
            let mut t = 1.0;
            while t > 1e-6 {
                free.iter().zip(&d).for_each(|(&i, d)| z[i] = from[i] + t * d);
                self.f(z, &mut f);
                if size(&f) < before {
                    break;
                }
                t *= 0.5;
            }
            if t <= 1e-6 {
                return; // it would turn in its place
            }
        }
    }
}

/// Gaussian elimination on `[A | b]`.
fn gauss(mut a: Vec<Vec<f64>>) -> Option<Vec<f64>> {
    let n = a.len();
    for k in 0..n {
        let p = (k..n).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs()))?;
        a.swap(k, p);
        if a[k][k] == 0.0 {
            return None;
        }
        for i in 0..n {
            if i != k {
                let by = a[i][k] / a[k][k];
                let pivot = a[k].clone();
                a[i].iter_mut().zip(&pivot).skip(k).for_each(|(a, p)| *a -= by * p);
            }
        }
    }
    Some((0..n).map(|i| a[i][n] / a[i][i]).collect())
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |worst, (a, b)| f64::max(worst, (a - b).abs()))
}

fn solve_from(instance: &Instance, start: f64, settings: &Settings<'_>) -> (bool, Stage, Vec<f64>) {
    let mut z = vec![start; instance.n];
    let (lower, upper) = (&instance.lower, &instance.upper);
    let report = solve(&mut instance.maps(), lower, upper, &mut z, settings).unwrap();
    let left = residual(&mut instance.maps(), lower, upper, &z);
    assert!(!report.status.is_success() || left <= 1e-9, "false success: {left}");
    (report.status.is_success(), report.stage, z)
}

/// The stages before the solver's own enumeration.
fn without_enumeration() -> Settings<'static> {
    Settings { enumerate_up_to: 0, ..Settings::default() }
}

#[test]
fn monotone_maps_have_one_solution_and_both_routes_find_it() {
    for seed in 0..2000 {
        let instance = Instance::new(seed, true);
        let known = instance.enumerate(1);
        assert_eq!(known.len(), 1, "seed {seed}");
        let (success, _, z) = solve_from(&instance, 0.5, &without_enumeration());
        assert!(success, "seed {seed}");
        assert!(distance(&known[0], &z) < 1e-7, "seed {seed}: {z:?} {known:?}");
    }
}

#[test]
fn nonmonotone_maps_end_at_an_enumerated_solution() {
    let (mut unlisted, mut unsolved, count) = (0, 0, 3000);
    for seed in 0..count {
        let instance = Instance::new(seed, false);
        let known = instance.enumerate(40);
        let (success, _, z) = solve_from(&instance, 0.5, &without_enumeration());
        unsolved += usize::from(!success);
        // Newton from forty points can miss a solution; the residual has been checked already
        unlisted += usize::from(success && known.iter().all(|s| distance(s, &z) > 1e-6));
        let (solved, ..) = solve_from(&instance, 0.5, &Settings::default());
        assert!(solved, "seed {seed}: a continuous map on a bounded box has a solution");
    }
    println!("{unlisted} unlisted, {unsolved} unsolved before enumeration, of {count}");
    assert!(unlisted <= 3, "{unlisted} of {count} not listed");
    assert!(unsolved <= 3, "{unsolved} of {count} not solved");
}
