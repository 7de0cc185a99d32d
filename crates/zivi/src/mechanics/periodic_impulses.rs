//! Periodic motions of linear systems whose only events are impacts, as impulses.
//!
//! With impulses `P_k` at times `t_k`, once a period `T` each, a gap is the sum of its forced
//! response and the response to all previous impulses,
//!
//! ```text
//! g_i(t) = f_i(t) + sum_j G0_ij(t - t_j) P_j,    Gm_ij(d) = sum_l Re(c_ijl l^m e^(l d)/(1 - e^(l T)))
//! ```
//!
//! summed over the eigenvalues `l` of the free motion, `0 < d <= T` (its own impulse acts a whole
//! period later). The impacts are `g_k = 0` and `(1 + e) v_k + D_k P_k = 0`: two unknowns each,
//! however many coordinates there are. A disturbance that grows by `e^(i th)` a period has the
//! kernels with `1 - e^(l T - i th)` instead. With `kappa = cos th` they are `R + i sin(th) S`.

/// A complex number.
type Pair = (f64, f64);

fn product(a: Pair, b: Pair) -> Pair {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

fn ratio(a: Pair, b: Pair) -> Pair {
    let size = b.0 * b.0 + b.1 * b.1;
    let (re, im) = product(a, (b.0, -b.1));
    (re / size, im / size)
}

/// Modal data of a linear system; one mode of each conjugate pair, counted twice.
#[derive(Clone, Debug, Default)]
pub struct Modes {
    /// `T`.
    pub period: f64,
    /// The eigenvalues `l`.
    pub rates: Vec<Pair>,
    /// `c_ijl l^m` for `m = 0..4`, then `i`, `j`, `l`.
    pub kernels: Vec<Pair>,
    /// Eigenvectors: of each of the `2n` states the part in each mode.
    pub vectors: Vec<Pair>,
    /// Of each gap's unit impulse the part in each mode.
    pub inputs: Vec<Pair>,
    /// Of each gap what a unit impulse adds to the `2n` states.
    pub pushes: Vec<f64>,
    /// Forced response of the gaps, rows of a constant, then cosine and sine of each wave.
    pub forced_gaps: Vec<f64>,
    /// That of the states.
    pub forced_states: Vec<f64>,
    /// Angular frequencies of the waves.
    pub omegas: Vec<f64>,
    /// `D`, by how much the speed of a gap rises with its own unit impulse.
    pub mobilities: Vec<f64>,
    /// Coefficients of restitution.
    pub e: Vec<f64>,
}

/// The equations at some unknowns, rows of `P_k, t_k`.
#[derive(Clone, Debug, Default)]
pub struct ImpulseEquations {
    /// `g_k` and `(1 + e) v_k + D_k P_k`, alternating.
    pub residual: Vec<f64>,
    /// `v_k`, the speeds before the impacts.
    pub rates: Vec<f64>,
    /// The Jacobian, row by row.
    pub matrix: Vec<f64>,
}

/// Of each pair of impacts the kernels of orders 0 to 3.
type Table = Vec<[f64; 4]>;

/// Of one impact the forced gap with three derivatives.
type Forced = Vec<[f64; 4]>;

impl Modes {
    /// Whether all lists have the sizes that the numbers of modes, gaps and waves ask for.
    ///
    /// # Errors
    ///
    /// Which one has not.
    pub fn check(&self, gaps: &[usize]) -> Result<(), String> {
        let (modes, m, width) = (self.rates.len(), self.gaps(), 1 + 2 * self.omegas.len());
        let states = self.vectors.len() / modes.max(1);
        let sizes = [
            ("kernels", self.kernels.len(), 4 * m * m * modes),
            ("vectors", self.vectors.len(), states * modes),
            ("inputs", self.inputs.len(), m * modes),
            ("pushes", self.pushes.len(), m * states),
            ("forced_gaps", self.forced_gaps.len(), m * width),
            ("forced_states", self.forced_states.len(), states * width),
            ("mobilities", self.mobilities.len(), m),
        ];
        for (name, size, wanted) in sizes {
            if size != wanted {
                return Err(format!("{name} must have {wanted} numbers, got {size}"));
            }
        }
        match gaps.iter().find(|&&gap| gap >= m) {
            Some(gap) => Err(format!("gaps must be below {m}, got {gap}")),
            None if gaps.is_empty() => Err("gaps must have at least one".into()),
            None => Ok(()),
        }
    }

    fn gaps(&self) -> usize {
        self.e.len()
    }

    /// `e^(l T)` of a mode.
    fn growth(&self, mode: usize) -> Pair {
        let (a, b) = self.rates[mode];
        let size = (a * self.period).exp();
        let (sin, cos) = (b * self.period).sin_cos();
        (size * cos, size * sin)
    }

    /// The factors of the modes in `R` and `S`, for impulses of this period (earlier in the event sequence)
    /// and of the one before.
    fn factors(&self, kappa: f64) -> [[Vec<Pair>; 2]; 2] {
        let mut all: [[Vec<Pair>; 2]; 2] = Default::default();
        for mode in 0..self.rates.len() {
            let g = self.growth(mode);
            let square = product(g, g);
            let den = (1.0 - 2.0 * kappa * g.0 + square.0, square.1 - 2.0 * kappa * g.1);
            let [now, before] = if kappa.abs() == 1.0 {
                // the common factor of both sides cancels
                let one = ratio((1.0, 0.0), (1.0 - kappa * g.0, -kappa * g.1));
                [one, (kappa * one.0, kappa * one.1)]
            } else {
                [ratio((1.0 - kappa * g.0, -kappa * g.1), den), ratio((kappa - g.0, -g.1), den)]
            };
            all[0][0].push(now);
            all[0][1].push(before);
            all[1][0].push(ratio((-g.0, -g.1), den));
            all[1][1].push(ratio((-1.0, 0.0), den));
        }
        all
    }

    /// `e^(l d)` of the modes between two impacts, times their factors.
    fn decays(&self, y: &[f64], (k, j): (usize, usize), factors: &[Vec<Pair>; 2]) -> Vec<Pair> {
        let wraps = usize::from(j >= k);
        let time = y[2 * k + 1] - y[2 * j + 1] + wraps as f64 * self.period;
        let each = self.rates.iter().zip(&factors[wraps]);
        each.map(|(&(a, b), &factor)| {
            let size = (a * time).exp();
            let (sin, cos) = (b * time).sin_cos();
            product((size * cos, size * sin), factor)
        })
        .collect()
    }

    fn table(&self, gaps: &[usize], y: &[f64], factors: &[Vec<Pair>; 2]) -> Table {
        let (count, m, width) = (gaps.len(), self.gaps(), self.rates.len());
        let mut all = Vec::with_capacity(count * count);
        for k in 0..count {
            for j in 0..count {
                let decays = self.decays(y, (k, j), factors);
                all.push(std::array::from_fn(|order| {
                    let at = ((order * m + gaps[k]) * m + gaps[j]) * width;
                    let row = &self.kernels[at..at + width];
                    row.iter().zip(&decays).map(|(c, h)| c.0 * h.0 - c.1 * h.1).sum()
                }));
            }
        }
        all
    }

    /// Derivatives of the forced response of a row of coefficients.
    fn forced(&self, row: &[f64], t: f64) -> [f64; 4] {
        let mut found = [row[0], 0.0, 0.0, 0.0];
        for (wave, &w) in self.omegas.iter().enumerate() {
            let (sin, cos) = (w * t).sin_cos();
            let (a, b) = (row[1 + 2 * wave], row[2 + 2 * wave]);
            let (value, rate) = (a * cos + b * sin, w * (b * cos - a * sin));
            found[0] += value;
            found[1] += rate;
            found[2] -= w * w * value;
            found[3] -= w * w * rate;
        }
        found
    }

    /// The gap of each impact with three derivatives, without its own last impulse and with it.
    fn motions(&self, gaps: &[usize], y: &[f64], table: &Table) -> (Forced, Forced) {
        let (count, width) = (gaps.len(), 1 + 2 * self.omegas.len());
        let (mut others, mut all) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for k in 0..count {
            let row = &self.forced_gaps[gaps[k] * width..][..width];
            let mut found = self.forced(row, y[2 * k + 1]);
            for j in (0..count).filter(|&j| j != k) {
                (0..4).for_each(|m| found[m] += table[k * count + j][m] * y[2 * j]);
            }
            others.push(found);
            (0..4).for_each(|m| found[m] += table[k * count + k][m] * y[2 * k]);
            all.push(found);
        }
        (others, all)
    }

    /// The equations and their Jacobian.
    pub fn equations(&self, gaps: &[usize], y: &[f64]) -> ImpulseEquations {
        let [periodic, _] = self.factors(1.0);
        let table = self.table(gaps, y, &periodic);
        let (_, motions) = self.motions(gaps, y, &table);
        let mut residual = Vec::with_capacity(y.len());
        for (k, &gap) in gaps.iter().enumerate() {
            residual.push(motions[k][0]);
            residual.push((1.0 + self.e[gap]) * motions[k][1] + self.mobilities[gap] * y[2 * k]);
        }
        let rates = motions.iter().map(|it| it[1]).collect();
        ImpulseEquations { residual, rates, matrix: self.matrix(gaps, y, &table, Some(&motions)) }
    }

    /// `R` and `S` of the Jacobian for disturbances that turn by `th` a period, `kappa = cos th`.
    pub fn turned(&self, gaps: &[usize], y: &[f64], kappa: f64) -> [Vec<f64>; 2] {
        let [real, sine] = self.factors(kappa);
        let (_, motions) = self.motions(gaps, y, &self.table(gaps, y, &self.factors(1.0)[0]));
        [
            self.matrix(gaps, y, &self.table(gaps, y, &real), Some(&motions)),
            self.matrix(gaps, y, &self.table(gaps, y, &sine), None),
        ]
    }

    fn matrix(
        &self,
        gaps: &[usize],
        y: &[f64],
        table: &Table,
        motions: Option<&Forced>,
    ) -> Vec<f64> {
        let count = gaps.len();
        let size = 2 * count;
        let mut matrix = vec![0.0; size * size];
        for k in 0..count {
            let factor = 1.0 + self.e[gaps[k]];
            for j in 0..count {
                let [g0, g1, g2, _] = table[k * count + j];
                let (first, second) = (2 * k * size + 2 * j, (2 * k + 1) * size + 2 * j);
                matrix[first] = g0;
                matrix[first + 1] = -g1 * y[2 * j];
                matrix[second] = factor * g1;
                matrix[second + 1] = -factor * g2 * y[2 * j];
            }
            if let Some(motions) = motions {
                let (first, second) = (2 * k * size + 2 * k, (2 * k + 1) * size + 2 * k);
                matrix[first + 1] += motions[k][1];
                matrix[second] += self.mobilities[gaps[k]];
                matrix[second + 1] += factor * motions[k][2];
            }
        }
        matrix
    }

    /// Gradients of `w^T R v` and `w^T S v` by the unknowns, for given `w` and `v`.
    pub fn curvature(
        &self,
        gaps: &[usize],
        y: &[f64],
        kappa: f64,
        (w, v): (&[f64], &[f64]),
    ) -> [Vec<f64>; 2] {
        let count = gaps.len();
        let periodic = self.table(gaps, y, &self.factors(1.0)[0]);
        let (others, _) = self.motions(gaps, y, &periodic);
        let mut found = self.factors(kappa).map(|factors| {
            let table = self.table(gaps, y, &factors);
            let mut gradient = vec![0.0; y.len()];
            for k in 0..count {
                let (w1, w2) = (w[2 * k], (1.0 + self.e[gaps[k]]) * w[2 * k + 1]);
                for j in 0..count {
                    let [_, g1, g2, g3] = table[k * count + j];
                    let (p, vp, vt) = (y[2 * j], v[2 * j], v[2 * j + 1]);
                    gradient[2 * j] -= (w1 * g1 + w2 * g2) * vt;
                    if j != k {
                        let slope = w1 * (g1 * vp - g2 * p * vt) + w2 * (g2 * vp - g3 * p * vt);
                        gradient[2 * k + 1] += slope;
                        gradient[2 * j + 1] -= slope;
                    }
                }
            }
            gradient
        });
        let gradient = &mut found[0];
        for k in 0..count {
            let vt = v[2 * k + 1];
            let (w1, w2) = (w[2 * k] * vt, (1.0 + self.e[gaps[k]]) * w[2 * k + 1] * vt);
            gradient[2 * k + 1] += w1 * others[k][2] + w2 * others[k][3];
            for j in 0..count {
                let [_, g1, g2, g3] = periodic[k * count + j];
                gradient[2 * j] += w1 * g1 + w2 * g2;
                if j != k {
                    gradient[2 * j + 1] -= (w1 * g2 + w2 * g3) * y[2 * j];
                }
            }
        }
        found
    }

    /// The states after the impacts, `2n` each.
    pub fn states(&self, gaps: &[usize], y: &[f64]) -> Vec<f64> {
        let [periodic, _] = self.factors(1.0);
        let (count, width) = (gaps.len(), self.rates.len());
        let (size, waves) = (self.pushes.len() / self.gaps(), 1 + 2 * self.omegas.len());
        let mut found = Vec::with_capacity(count * size);
        for k in 0..count {
            let mut held = vec![(0.0, 0.0); width];
            for j in 0..count {
                let decays = self.decays(y, (k, j), &periodic);
                let input = &self.inputs[gaps[j] * width..][..width];
                for (sum, (&h, &b)) in held.iter_mut().zip(decays.iter().zip(input)) {
                    let (re, im) = product(h, b);
                    *sum = (sum.0 + y[2 * j] * re, sum.1 + y[2 * j] * im);
                }
            }
            for s in 0..size {
                let forced = self.forced(&self.forced_states[s * waves..][..waves], y[2 * k + 1]);
                let row = &self.vectors[s * width..][..width];
                let free: f64 = row.iter().zip(&held).map(|(v, h)| v.0 * h.0 - v.1 * h.1).sum();
                found.push(forced[0] + free + self.pushes[gaps[k] * size + s] * y[2 * k]);
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two masses between walls, each a damped oscillator that pushes the other's gap by a part.
    const OSCILLATORS: [Pair; 2] = [(0.3, 2.1), (0.15, 3.7)];
    /// By gap and oscillator the contribution of its speed to the gap and its response to an
    /// impulse.
    const SEEN: [[f64; 2]; 2] = [[1.0, 0.4], [-0.7, 0.9]];
    const PERIOD: f64 = 2.3;
    const OMEGAS: [f64; 2] =
        [2.0 * std::f64::consts::PI / PERIOD, 4.0 * std::f64::consts::PI / PERIOD];
    const FORCED: [[f64; 5]; 2] = [[0.3, 0.2, -0.1, 0.05, 0.07], [0.5, -0.3, 0.15, 0.02, -0.04]];
    const FORCED_STATES: [[f64; 5]; 4] = [
        [0.1, 0.2, 0.3, 0.4, 0.5],
        [0.7, -0.6, 0.5, -0.4, 0.3],
        [0.2, 0.1, 0.0, -0.1, 0.6],
        [-0.3, 0.4, 0.8, 0.1, 0.2],
    ];
    const GAPS: [usize; 3] = [0, 1, 0];
    /// Impulses and times.
    const UNKNOWNS: [f64; 6] = [0.8, 0.3, 1.3, 1.1, 0.5, 1.9];

    /// The states are position and velocity of the first and of the second oscillator.
    fn modes() -> Modes {
        let rates: Vec<Pair> = OSCILLATORS.iter().map(|&(a, b)| (-a, b)).collect();
        let mut kernels = Vec::new();
        for order in 0..4 {
            for of in SEEN {
                for by in SEEN {
                    for (mode, &l) in rates.iter().enumerate() {
                        // sin(b t)/b is the real part of -i e^(i b t)/b
                        let c = (0.0, -of[mode] * by[mode] / l.1);
                        kernels.push((0..order).fold(c, |c, _| product(c, l)));
                    }
                }
            }
        }
        let mut vectors = vec![(0.0, 0.0); 8];
        for (mode, &l) in rates.iter().enumerate() {
            vectors[2 * mode * 2 + mode] = (1.0, 0.0);
            vectors[(2 * mode + 1) * 2 + mode] = l;
        }
        let part = |by: [f64; 2]| [0, 1].map(|mode| (0.0, -by[mode] / OSCILLATORS[mode].1));
        let pushes = SEEN.iter().flat_map(|by| [0.0, by[0], 0.0, by[1]]).collect();
        Modes {
            period: PERIOD,
            rates,
            kernels,
            vectors,
            inputs: SEEN.into_iter().flat_map(part).collect(),
            pushes,
            forced_gaps: FORCED.concat(),
            forced_states: FORCED_STATES.concat(),
            omegas: OMEGAS.to_vec(),
            mobilities: SEEN.iter().map(|by| by[0] * by[0] + by[1] * by[1]).collect(),
            e: vec![0.6, 0.8],
        }
    }

    /// A row of a forced response and its derivative.
    fn forced(row: &[f64; 5], t: f64) -> [f64; 2] {
        let mut found = [row[0], 0.0];
        for (i, w) in OMEGAS.iter().enumerate() {
            let (a, b) = (row[1 + 2 * i], row[2 + 2 * i]);
            found[0] += a * (w * t).cos() + b * (w * t).sin();
            found[1] += w * (b * (w * t).cos() - a * (w * t).sin());
        }
        found
    }

    /// Position and velocity of an oscillator after all impulses of 200 periods before an impact.
    fn struck(mode: usize, k: usize, y: &[f64]) -> [f64; 2] {
        let (a, b) = OSCILLATORS[mode];
        let mut found = [0.0; 2];
        for period in 0..200 {
            for (j, &gap) in GAPS.iter().enumerate() {
                let d = y[2 * k + 1] - y[2 * j + 1] + f64::from(period) * PERIOD;
                if d <= 0.0 {
                    continue;
                }
                let size = SEEN[gap][mode] * y[2 * j] * (-a * d).exp();
                found[0] += size * (b * d).sin() / b;
                found[1] += size * ((b * d).cos() - a / b * (b * d).sin());
            }
        }
        found
    }

    #[test]
    fn the_equations_are_those_of_all_impulses_so_far() {
        let modes = modes();
        modes.check(&GAPS).unwrap();
        let found = modes.equations(&GAPS, &UNKNOWNS);
        let states = modes.states(&GAPS, &UNKNOWNS);
        for (k, &gap) in GAPS.iter().enumerate() {
            let [mut place, mut speed] = forced(&FORCED[gap], UNKNOWNS[2 * k + 1]);
            for (mode, part) in SEEN[gap].iter().enumerate() {
                let [x, v] = struck(mode, k, &UNKNOWNS);
                place += part * x;
                speed += part * v;
                let pushed = v + part * UNKNOWNS[2 * k];
                for (s, value) in [(2 * mode, x), (2 * mode + 1, pushed)] {
                    let all = value + forced(&FORCED_STATES[s], UNKNOWNS[2 * k + 1])[0];
                    assert!((states[4 * k + s] - all).abs() < 1e-13, "{k} {s}");
                }
            }
            let law = (1.0 + modes.e[gap]) * speed + modes.mobilities[gap] * UNKNOWNS[2 * k];
            assert!((found.rates[k] - speed).abs() < 1e-13);
            assert!((found.residual[2 * k] - place).abs() < 1e-13);
            assert!((found.residual[2 * k + 1] - law).abs() < 1e-13);
        }
    }

    /// `f` differenced by each unknown, of fourth order.
    fn differenced(f: impl Fn(&[f64]) -> Vec<f64>) -> Vec<Vec<f64>> {
        const D: f64 = 1e-3;
        let moved = |j: usize, by: f64| {
            let mut y = UNKNOWNS;
            y[j] += by * D;
            f(&y)
        };
        (0..UNKNOWNS.len())
            .map(|j| {
                let [near, far] = [1.0, 2.0].map(|by: f64| (moved(j, -by), moved(j, by)));
                let pairs = near.0.iter().zip(&near.1).zip(far.0.iter().zip(&far.1));
                pairs.map(|((a, b), (c, d))| (8.0 * (b - a) - (d - c)) / (12.0 * D)).collect()
            })
            .collect()
    }

    #[test]
    fn the_jacobian_is_that_of_the_equations() {
        let modes = modes();
        let matrix = modes.equations(&GAPS, &UNKNOWNS).matrix;
        let columns = differenced(|y| modes.equations(&GAPS, y).residual);
        for (j, column) in columns.iter().enumerate() {
            for (i, rate) in column.iter().enumerate() {
                assert!((matrix[6 * i + j] - rate).abs() < 1e-9, "{i} {j} {rate}");
            }
        }
        // a disturbance that repeats is that of the equations themselves
        for (one, other) in modes.turned(&GAPS, &UNKNOWNS, 1.0)[0].iter().zip(&matrix) {
            assert!((one - other).abs() < 1e-13);
        }
    }

    #[test]
    fn gradients_of_the_turned_jacobian_are_its_differences() {
        let modes = modes();
        let (w, v) = ([0.3, -0.7, 0.2, 0.9, -0.4, 0.6], [0.5, 0.8, -0.6, 0.7, 0.1, -0.9]);
        let kappa = 0.35;
        let found = modes.curvature(&GAPS, &UNKNOWNS, kappa, (&w, &v));
        let columns = differenced(|y| {
            let form = |matrix: &Vec<f64>| {
                (0..36).map(|at| w[at / 6] * matrix[at] * v[at % 6]).sum::<f64>()
            };
            modes.turned(&GAPS, y, kappa).iter().map(form).collect()
        });
        for (j, column) in columns.iter().enumerate() {
            for (part, rate) in column.iter().enumerate() {
                assert!((found[part][j] - rate).abs() < 1e-9, "{part} {j}: {rate}");
            }
        }
    }

    #[test]
    fn lists_of_a_wrong_length_are_named() {
        let short = Modes { pushes: vec![0.0; 7], ..modes() };
        assert_eq!(short.check(&GAPS), Err("pushes must have 8 numbers, got 7".into()));
        assert_eq!(modes().check(&[0, 2]), Err("gaps must be below 2, got 2".into()));
        assert_eq!(modes().check(&[]), Err("gaps must have at least one".into()));
    }
}
