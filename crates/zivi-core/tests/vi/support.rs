//! What the tests of the box VI solver share: random numbers, a solve with its own memory, and a
//! residual written anew.

use zivi_core::vi::{self, EvaluationError, InvalidInput, Problem, Report, Settings, Workspace};

/// A small generator of its own: xorshift64*.
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        let mut random = Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
        random.uniform();
        random
    }

    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Nearly normal: the sum of twelve uniforms.
    pub(crate) fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    pub(crate) fn below(&mut self, n: usize) -> usize {
        (self.uniform() * n as f64) as usize
    }
}

/// `F` and its Jacobian as closures.
pub(crate) struct Maps<F, J>(pub(crate) F, pub(crate) J);

impl<F: FnMut(&[f64], &mut [f64]), J: FnMut(&[f64], &mut [f64])> Problem for Maps<F, J> {
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        (self.0)(z, f);
        Ok(())
    }

    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        (self.1)(z, jacobian);
        Ok(())
    }
}

/// Solves in memory of its own, filled with NaN to show that nothing of it is read first.
pub(crate) fn solve(
    problem: &mut dyn Problem,
    lower: &[f64],
    upper: &[f64],
    z: &mut [f64],
    settings: &Settings<'_>,
) -> Result<Report, InvalidInput> {
    let (reals, indices) = vi::workspace_len(z.len());
    let (mut reals, mut indices) = (vec![f64::NAN; reals], vec![usize::MAX; indices]);
    let mut work = Workspace::new(z.len(), &mut reals, &mut indices).unwrap();
    vi::solve(problem, (lower, upper), z, settings, &mut work)
}

/// `max |max(z - u, min(z - l, F))|`, sharing no code with the solver; NaN where `F` is not finite.
pub(crate) fn residual(problem: &mut dyn Problem, lower: &[f64], upper: &[f64], z: &[f64]) -> f64 {
    let mut f = vec![0.0; z.len()];
    problem.map(z, &mut f).unwrap();
    let mut worst = 0.0;
    for i in 0..z.len() {
        let (below, above) = (z[i] - lower[i], z[i] - upper[i]);
        let median = if f[i] < below { f[i] } else { below };
        let component = if median > above { median } else { above };
        if component.is_nan() || !f[i].is_finite() {
            return f64::NAN;
        }
        worst = f64::max(worst, component.abs());
    }
    worst
}

/// A matrix with positive principal minors, by one of four constructions.
pub(crate) fn p_matrix(kind: usize, n: usize, random: &mut Random) -> Vec<f64> {
    let raw: Vec<f64> = (0..n * n).map(|_| random.normal()).collect();
    let mut m = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..n {
            m[i * n + j] = match kind {
                // symmetric part positive definite
                0 => {
                    let gram: f64 = (0..n).map(|k| raw[i * n + k] * raw[j * n + k]).sum();
                    let skew = raw[i * n + j] - raw[j * n + i];
                    gram / n as f64 + skew + if i == j { 0.1 } else { 0.0 }
                }
                // triangular with positive diagonal
                1 if i == j => 0.1 + raw[i * n + j].abs(),
                1 if j < i => 3.0 * raw[i * n + j] / n as f64,
                1 => 0.0,
                // diagonally dominant
                2 if i == j => 0.1 + (0..n).map(|k| raw[i * n + k].abs()).sum::<f64>(),
                _ => raw[i * n + j],
            };
        }
    }
    if kind == 3 {
        // a dominant diagonal survives positive scaling of rows and columns as a P-matrix
        m = p_matrix(2, n, random);
        let scale: Vec<f64> = (0..2 * n).map(|_| 10f64.powf(random.within(-2.0, 2.0))).collect();
        for i in 0..n {
            for j in 0..n {
                m[i * n + j] *= scale[i] * scale[n + j];
            }
        }
    }
    m
}

/// `(q, lower, upper, z)`: an affine VI with the solution `z`; free, fixed, one- and two-sided
/// components, some of them with `F_i = 0` at their bound.
pub(crate) fn planted(m: &[f64], n: usize, random: &mut Random) -> [Vec<f64>; 4] {
    let (mut lower, mut upper) = (vec![f64::NEG_INFINITY; n], vec![f64::INFINITY; n]);
    let mut z: Vec<f64> = (0..n).map(|_| random.normal()).collect();
    let mut f = vec![0.0; n];
    for i in 0..n {
        let kind = random.below(5);
        let push = if random.uniform() < 0.2 { 0.0 } else { random.within(0.0, 2.0) };
        let place = random.uniform();
        if kind == 0 {
            (lower[i], upper[i], f[i]) = (z[i], z[i], random.normal());
            continue;
        }
        if kind == 1 || kind == 3 {
            lower[i] = z[i] - random.within(0.1, 2.0);
        }
        if kind == 2 || kind == 3 {
            upper[i] = z[i] + random.within(0.1, 2.0);
        }
        if lower[i].is_finite() && place < 0.4 {
            (z[i], f[i]) = (lower[i], push);
        } else if upper[i].is_finite() && place > 0.6 {
            (z[i], f[i]) = (upper[i], -push);
        }
    }
    let q = (0..n).map(|i| f[i] - (0..n).map(|j| m[i * n + j] * z[j]).sum::<f64>()).collect();
    [q, lower, upper, z]
}
