//! Shared by the integration tests: seeded draws, and the equations of the step written a second
//! time, so that nothing is checked against itself.
#![allow(dead_code)] // each test file uses a part

pub(crate) mod control;

use std::cell::Cell;

use zivi_core::{Lifted, Restitution, StepSolution, ThetaGammaStep};

/// A xorshift64* generator: the draws are the same on every run and machine.
pub(crate) struct Rng(Cell<u64>);

impl Rng {
    pub(crate) fn new(seed: u64) -> Self {
        Rng(Cell::new(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1))
    }

    /// Uniform in `[0, 1)`.
    pub(crate) fn unit(&self) -> f64 {
        let mut word = self.0.get();
        word ^= word >> 12;
        word ^= word << 25;
        word ^= word >> 27;
        self.0.set(word);
        let bits = word.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11;
        bits as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn between(&self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub(crate) fn log_between(&self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    pub(crate) fn chance(&self, probability: f64) -> bool {
        self.unit() < probability
    }

    pub(crate) fn sign(&self) -> f64 {
        if self.chance(0.5) {
            1.0
        } else {
            -1.0
        }
    }

    pub(crate) fn pick<T: Copy>(&self, from: &[T]) -> T {
        from[((self.unit() * from.len() as f64) as usize).min(from.len() - 1)]
    }
}

/// The settings of a step as plain numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scheme {
    pub(crate) h: f64,
    pub(crate) theta: f64,
    pub(crate) gamma: f64,
    pub(crate) kappa: f64,
}

impl Scheme {
    pub(crate) fn implicit_euler(h: f64, kappa: f64) -> Self {
        Scheme { h, theta: 1.0, gamma: 1.0, kappa }
    }

    pub(crate) fn build(self) -> ThetaGammaStep {
        let restitution = Restitution::from_kappa(self.kappa).expect("kappa in [0, 1]");
        ThetaGammaStep::new(self.h, self.theta, self.gamma, restitution)
            .expect("admissible settings")
    }
}

/// A step to be solved.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Problem {
    pub(crate) scheme: Scheme,
    pub(crate) z: Lifted,
    pub(crate) f: f64,
}

/// How far a solution is from the equations, in units of the terms they are made of.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Misfit {
    /// Natural residual of the two inclusions.
    pub(crate) inclusion: f64,
    /// Of the returned `(s+, v+)` against the update formulas.
    pub(crate) update: f64,
}

impl Problem {
    pub(crate) fn solve(&self, side: f64) -> Result<StepSolution, zivi_core::StepFailure> {
        self.scheme.build().solve(self.z, self.f, side)
    }

    /// Puts a solution back into the equations
    ///
    /// ```text
    /// v+ = v + h ls f / R      s+ = s + h R (theta v+ + (1 - theta) v)      R = 1 - kappa ls lv
    /// ls in sgn(gamma s+ + (1 - gamma) s)      lv in sgn(gamma v+ + (1 - gamma) v)
    /// ```
    ///
    /// Every defect is divided by the sum of its terms' magnitudes *plus* what one unit of
    /// `kappa ls lv` contributes, because the multipliers are numbers of order one known to an
    /// absolute accuracy: near `ls lv = 1` the small `R` inherits that accuracy, whichever way
    /// it is computed. (At `kappa = 0` the addition is zero.)
    pub(crate) fn misfit(&self, solution: &StepSolution) -> Misfit {
        let Scheme { h, theta, gamma, kappa } = self.scheme;
        let Lifted { s, v } = self.z;
        let (ls, lv) = (solution.lambda_s, solution.lambda_v);
        let r = (1.0 - kappa) + kappa * (1.0 - ls * lv);
        let kick = h * ls * self.f / r;
        let v_plus = v + kick;
        let s_plus = s + h * r * (theta * v_plus + (1.0 - theta) * v);
        let travel = h * r * (v.abs() + theta * kick.abs()) + h * kappa * v.abs();
        let jolt = kick.abs() * (1.0 + kappa / r);
        let natural = |lambda: f64, z_gamma: f64, terms: f64| {
            let row = if terms == 0.0 { 0.0 } else { -z_gamma / terms };
            (lambda - 1.0).max((lambda + 1.0).min(row)).abs()
        };
        let of_s = natural(ls, gamma * s_plus + (1.0 - gamma) * s, s.abs() + gamma * travel);
        let of_v = natural(lv, gamma * v_plus + (1.0 - gamma) * v, v.abs() + gamma * jolt);
        let relative = |defect: f64, terms: f64| match terms == 0.0 {
            true => defect.abs(),
            false => defect.abs() / terms,
        };
        let update_s = relative(solution.s - s_plus, s.abs() + travel);
        let update_v = relative(solution.v - v_plus, v.abs() + jolt);
        let worst = |a: f64, b: f64| if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) };
        Misfit { inclusion: worst(of_s, of_v), update: worst(update_s, update_v) }
    }

    /// All solutions as states `(s+/(h^2 |f|), v+/(h |f|))`, coincident ones merged.
    pub(crate) fn distinct(&self, tolerance: f64) -> Vec<[f64; 2]> {
        let unit = self.scheme.h * self.f.abs();
        let mut states: Vec<[f64; 2]> = Vec::new();
        for it in self.scheme.build().solutions(self.z, self.f) {
            let state = [it.s / (self.scheme.h * unit), it.v / unit];
            if states.iter().all(|other| apart(*other, state) > tolerance) {
                states.push(state);
            }
        }
        states
    }
}

pub(crate) fn apart(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).abs().max((a[1] - b[1]).abs())
}

/// The state `(S h^2 |f|, V h |f|)`: by scaling only `S`, `V`, `sgn f` and `kappa` matter.
pub(crate) fn scaled_problem(scheme: Scheme, state: [f64; 2], f: f64) -> Problem {
    let unit = scheme.h * f.abs();
    Problem { scheme, z: Lifted { s: state[0] * scheme.h * unit, v: state[1] * unit }, f }
}
