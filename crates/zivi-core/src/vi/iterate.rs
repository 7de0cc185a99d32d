//! The iterate of the outer methods, detection of stagnation, random numbers.
//!
//! The iterate of the outer methods: position, cost, best point so far.

use super::natural::{natural_component, natural_residual, worst_component};
use super::pivotal::PivotalWorkspace;
use super::problem::{Interruption, Problem, Progress};
use super::settings::{Budget, Counts, RowScale, Settings, Stage, Status};
use super::{dense, natural};

/// Result of a stage; only the caller interrupts it from within.
pub(super) type Outcome<T> = Result<T, Interruption>;

/// Half-widths by which a start is pushed off its bounds while `F` is not finite there.
const PUSHES: [f64; 5] = [0.0, 1e-6, 1e-3, 1e-1, 1.0];

/// A point `z` in the box with `F(z)`, its merit and, once linearised, its Jacobian.
pub(super) struct Iterate<'a, 'w> {
    pub(super) problem: &'a mut dyn Problem,
    pub(super) settings: &'a Settings<'a>,
    pub(super) lower: &'a [f64],
    pub(super) upper: &'a [f64],
    pub(super) work: &'a mut Workspace<'w>,
    pub(super) z: &'a mut [f64],
    pub(super) merit: f64,
    pub(super) residual: f64,
    pub(super) convergence_ratio: f64,
    pub(super) best_residual: f64,
    /// Largest residual of a solution: `tol`, or `rtol` times the residual of the start.
    pub(super) tol: f64,
    pub(super) stage: Stage,
    /// `work.jacobian` was filled in this stage, or is that of an affine `F`.
    pub(super) jacobian_is_known: bool,
    /// `work.jacobian` is regular on the rows that the active set holds inside, by the pivots there.
    pub(super) inside_is_regular: bool,
    /// The proximal point method was tried before the paths.
    pub(super) was_proximal: bool,
    /// The smoothing Newton method was tried before the paths.
    pub(super) was_smoothed: bool,
    /// It was tried to prove that there is no solution.
    pub(super) proof_was_sought: bool,
    rows_await_scaling: bool,
    tolerance_awaits_start: bool,
    pub(super) budget: Budget,
    pub(super) counts: Counts,
}

impl<'a, 'w> Iterate<'a, 'w> {
    pub(super) fn new(
        problem: &'a mut dyn Problem,
        settings: &'a Settings<'a>,
        (lower, upper): (&'a [f64], &'a [f64]),
        work: &'a mut Workspace<'w>,
        z: &'a mut [f64],
    ) -> Self {
        let n = z.len();
        work.scale.fill(1.0);
        if let RowScale::Given(scale) = settings.row_scale {
            dense::copy(work.scale, scale);
        }
        work.f.fill(f64::NAN);
        dense::copy(work.best, z);
        Self {
            problem,
            settings,
            lower,
            upper,
            work,
            z,
            merit: f64::NAN,
            residual: f64::NAN,
            convergence_ratio: f64::NAN,
            best_residual: f64::INFINITY,
            tol: settings.tol,
            stage: Stage::JosephyNewton,
            jacobian_is_known: false,
            inside_is_regular: false,
            was_proximal: false,
            was_smoothed: false,
            proof_was_sought: false,
            rows_await_scaling: settings.row_scale == RowScale::Jacobian,
            tolerance_awaits_start: settings.rtol > 0.0,
            budget: Budget::new(settings.total_pivot_limit(n)),
            counts: Counts::default(),
        }
    }

    pub(super) fn n(&self) -> usize {
        self.z.len()
    }

    /// True when the iterate solves the problem: by its residual, nothing else.
    pub(super) fn is_solved(&self) -> bool {
        self.residual <= self.tol
    }

    pub(super) fn out_of_iterations(&self) -> bool {
        self.counts.iterations >= self.settings.max_iterations
    }

    /// Pivots left for one affine solve.
    pub(super) fn pivots_left(&self) -> usize {
        self.budget.left().min(self.settings.pivot_limit(self.n(), self.counts.iterations <= 1))
    }

    /// True where the stage makes no progress, or can make none for the rounding of `F`.
    pub(super) fn has_stalled(&self, progress: &mut Stagnation) -> bool {
        let stalled = progress.has_stalled(self.merit);
        let at_rounding = || progress.is_slow() && self.is_within_rounding().is_some();
        !self.is_solved() && (stalled || at_rounding())
    }

    /// Why no step could be made: there was none, or its budget is spent.
    pub(super) fn why_stuck(&self) -> Status {
        if self.budget.is_spent() {
            Status::PivotLimit
        } else {
            Status::Stationary
        }
    }

    /// Tells the caller's monitor about the evaluated point at which an iteration has ended:
    /// `work.trial` in all stages.
    pub(super) fn report(&mut self) -> Outcome<()> {
        let (z, f) = (&*self.work.trial, &*self.work.trial_f);
        self.problem.monitor(&Progress {
            iteration: self.counts.iterations,
            residual: natural_residual(z, f, self.lower, self.upper),
            worst: worst_component(z, f, self.lower, self.upper),
            stage: self.stage,
        })
    }

    /// `F` at `work.trial`, scaled, into `work.trial_f`. False if not finite.
    pub(super) fn evaluate_trial(&mut self) -> Outcome<bool> {
        self.problem.poll()?;
        self.counts.f += 1;
        self.problem.map(self.work.trial, self.work.trial_f)?;
        dense::scale(self.work.trial_f, self.work.scale);
        Ok(dense::is_finite(self.work.trial_f))
    }

    /// The merit at `work.trial`; infinite where `F` is not finite.
    pub(super) fn merit_of_trial(&mut self) -> Outcome<f64> {
        let finite = self.evaluate_trial()?;
        let merit = natural::merit(self.work.trial, self.work.trial_f, self.lower, self.upper);
        // squares may overflow where F does not
        Ok(if finite { merit.min(f64::MAX) } else { f64::INFINITY })
    }

    /// Moves to `work.trial`, which has been evaluated.
    pub(super) fn accept(&mut self, merit: f64) {
        dense::copy(self.z, self.work.trial);
        dense::copy(self.work.f, self.work.trial_f);
        let before = self.residual;
        self.merit = merit;
        self.residual = natural_residual(self.z, self.work.f, self.lower, self.upper);
        self.convergence_ratio = self.residual / before;
        if self.residual < self.best_residual {
            self.best_residual = self.residual;
            dense::copy(self.work.best, self.z);
        }
    }

    /// Begins a stage at `work.trial`, pushed off its bounds as far as `F` and its Jacobian need.
    /// False if no tried point has finite values.
    pub(super) fn begin(&mut self) -> Outcome<bool> {
        dense::copy(self.work.point, self.work.trial);
        self.jacobian_is_known &= self.problem.is_affine();
        for push in PUSHES {
            self.push_from_bounds(push);
            self.residual = f64::NAN;
            let merit = self.merit_of_trial()?;
            if !merit.is_finite() {
                continue;
            }
            self.accept(merit);
            if self.tolerance_awaits_start && !self.rows_await_scaling {
                self.set_relative_tolerance();
            }
            if self.is_solved() && !self.rows_await_scaling {
                return Ok(true);
            }
            if self.linearise()? {
                if self.rows_await_scaling {
                    self.scale_rows_by_jacobian()?;
                }
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// `trial <- P(c + 10^(k/2 - 1) max(1, |c|) r)`, `r` uniform on `[-1, 1]^n` from a fixed seed;
    /// the centre `c` is `z0` and, for odd `k`, the point of the box nearest to zero (`F` may be
    /// hopeless around `z0`).
    pub(super) fn scatter(&mut self, k: u8) {
        dense::copy(self.work.trial, self.work.start);
        let spread = libm::pow(10.0, 0.5 * f64::from(k) - 1.0);
        let mut random = Random::new(u64::from(k) + 1);
        if k % 2 == 1 {
            self.work.trial.fill(0.0);
            dense::project(self.work.trial, self.lower, self.upper);
        }
        for z in self.work.trial.iter_mut() {
            *z += spread * f64::max(1.0, z.abs()) * (2.0 * random.uniform() - 1.0);
        }
        dense::project(self.work.trial, self.lower, self.upper);
    }

    /// `trial <- point`, at least `push` times the width (at most 1) away from finite bounds.
    fn push_from_bounds(&mut self, push: f64) {
        let bounds = self.lower.iter().zip(self.upper);
        let points = self.work.trial.iter_mut().zip(self.work.point.iter());
        for ((trial, &point), (&lower, &upper)) in points.zip(bounds) {
            let distance = f64::min(push * f64::min(upper - lower, 1.0), 0.5 * (upper - lower));
            *trial = point.max(lower + distance).min(upper - distance).max(lower).min(upper);
        }
    }

    /// Sets `sigma_i = 1/max_j |J_ij|` from the Jacobian at the iterate and re-evaluates there.
    fn scale_rows_by_jacobian(&mut self) -> Outcome<()> {
        for (scale, row) in
            self.work.scale.iter_mut().zip(dense::rows(self.work.jacobian, self.z.len()))
        {
            let size = dense::norm(row);
            *scale = if size > 0.0 && size.is_finite() { 1.0 / size } else { 1.0 };
        }
        self.rows_await_scaling = false;
        self.jacobian_is_known = false;
        self.best_residual = f64::INFINITY;
        dense::copy(self.work.trial, self.z);
        let merit = self.merit_of_trial()?;
        self.accept(merit);
        self.linearise()?;
        if self.tolerance_awaits_start {
            self.set_relative_tolerance();
        }
        Ok(())
    }

    /// `max(tol, rtol r)` with the residual `r` of the start.
    fn set_relative_tolerance(&mut self) {
        self.tol = f64::max(self.settings.tol, self.settings.rtol * self.residual);
        self.tolerance_awaits_start = false;
    }

    /// Makes the best point of all stages the iterate.
    pub(super) fn return_to_best(&mut self) -> Outcome<()> {
        dense::copy(self.work.trial, self.work.best);
        let (merit, ratio) = (self.merit_of_trial()?, self.convergence_ratio);
        self.accept(merit);
        self.convergence_ratio = ratio;
        Ok(())
    }

    /// `F` at the best point of an interrupted solve, whatever the monitor says.
    pub(super) fn evaluate_best(&mut self) -> Outcome<()> {
        dense::copy(self.z, self.work.best);
        self.work.f.fill(f64::NAN);
        if self.best_residual.is_finite() {
            self.counts.f += 1;
            self.problem.map(self.z, self.work.f)?;
            dense::scale(self.work.f, self.work.scale);
        }
        self.residual = natural_residual(self.z, self.work.f, self.lower, self.upper);
        Ok(())
    }

    /// The tolerance raised to rounding, if with it the iterate is a solution: where a component
    /// of the natural map exceeds `tol`, `F_i` is within ten roundings of its row of zero,
    /// `|F_i| <= 10 eps sum_j |J_ij z_j|`, `eps` the rounding of `F`. A user's Jacobian is trusted:
    /// see [`Iterate::rows_are_as_steep`].
    pub(super) fn is_within_rounding(&self) -> Option<f64> {
        let (mut reached, rounding) = (self.tol, 10.0 * self.problem.rounding());
        for (i, row) in dense::rows(self.work.jacobian, self.n()).enumerate() {
            let (z, f) = (dense::at(self.z, i), dense::at(self.work.f, i));
            let (lower, upper) = (dense::at(self.lower, i), dense::at(self.upper, i));
            if natural_component(z, f, lower, upper).abs() <= self.tol {
                continue;
            }
            let size: f64 = row.iter().zip(self.z.iter()).map(|(a, z)| (a * z).abs()).sum();
            let floor = rounding * size;
            if f.is_nan() || f.abs() > floor || !floor.is_finite() {
                return None;
            }
            reached = reached.max(floor);
        }
        Some(reached)
    }

    /// The residual of the caller's `F`, unscaled, which is left in `work.trial_f`.
    pub(super) fn raw_residual(&mut self) -> f64 {
        for ((f, scale), scaled) in
            self.work.trial_f.iter_mut().zip(self.work.scale.iter()).zip(self.work.f.iter())
        {
            *f = scaled / scale;
        }
        natural_residual(self.z, self.work.trial_f, self.lower, self.upper)
    }

    /// The best point, without another evaluation: `F` there is no longer known.
    pub(super) fn give_up(&mut self) {
        dense::copy(self.z, self.work.best);
        self.work.f.fill(f64::NAN);
        self.residual = f64::NAN;
    }
}

/// `trial <- z + t d`, exactly on a bound where the full step ends there.
pub(super) fn advance(at: &mut Iterate<'_, '_>, t: f64) {
    let work = &mut *at.work;
    for i in 0..work.step.len() {
        let (lower, upper) = (dense::at(at.lower, i), dense::at(at.upper, i));
        let (z, d) = (dense::at(at.z, i), dense::at(work.step, i));
        let reached = if t < 1.0 {
            z + t * d
        } else if d == dense::at(work.lower, i) {
            lower
        } else if d == dense::at(work.upper, i) {
            upper
        } else {
            z + d
        };
        dense::put(work.trial, i, reached.max(lower).min(upper));
    }
}

// When a stage no longer makes progress.

/// Watches for a merit that has not fallen by a tenth over twenty iterations.
#[derive(Debug)]
pub(super) struct Stagnation {
    best: f64,
    since: usize,
}

impl Stagnation {
    pub(super) fn new(merit: f64) -> Self {
        Self { best: merit, since: 0 }
    }

    pub(super) fn has_stalled(&mut self, merit: f64) -> bool {
        if merit < 0.9 * self.best {
            (self.best, self.since) = (merit, 0);
        } else {
            self.since += 1;
        }
        self.since >= 20
    }

    /// True where the merit has not fallen over the last iterations: then rounding may prevent it.
    pub(super) fn is_slow(&self) -> bool {
        self.since >= 3
    }
}

// Numbers for restarts: the same in every run.

/// SplitMix64 (Steele, Lea & Flood, *OOPSLA* 2014, 453-472).
#[derive(Debug)]
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x2545_F491_4F6C_DD1D))
    }

    /// Uniform on `[0, 1)`.
    pub(super) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        bits ^= bits >> 31;
        (bits >> 11) as f64 / (1_u64 << 53) as f64
    }
}

// The memory of the solver, carved from one slice of reals and one of indices.

/// Vectors of length `n` in addition to the two `n x n` matrices.
const VECTORS: usize = 24;

/// Lengths of the two slices a solve with `n` unknowns works in: reals and indices.
///
/// ```
/// let (reals, indices) = zivi_core::vi::workspace_len(3);
/// let (mut reals, mut indices) = (vec![0.0; reals], vec![0; indices]);
/// assert!(zivi_core::vi::Workspace::new(3, &mut reals, &mut indices).is_some());
/// ```
#[must_use]
pub const fn workspace_len(n: usize) -> (usize, usize) {
    (2 * n * n + VECTORS * n, 2 * n)
}

/// The memory of a solve with `n` unknowns. Nothing in it is read before it is written.
#[derive(Debug)]
pub struct Workspace<'a> {
    pub(super) pivotal: PivotalWorkspace<'a>,
    pub(super) jacobian: &'a mut [f64],
    pub(super) f: &'a mut [f64],
    pub(super) phi: &'a mut [f64],
    pub(super) gradient: &'a mut [f64],
    pub(super) slope_z: &'a mut [f64],
    pub(super) slope_f: &'a mut [f64],
    pub(super) step: &'a mut [f64],
    pub(super) trial: &'a mut [f64],
    pub(super) trial_f: &'a mut [f64],
    pub(super) lower: &'a mut [f64],
    pub(super) upper: &'a mut [f64],
    pub(super) scale: &'a mut [f64],
    pub(super) start: &'a mut [f64],
    pub(super) centre: &'a mut [f64],
    pub(super) best: &'a mut [f64],
    pub(super) point: &'a mut [f64],
    pub(super) neighbour: &'a mut [f64],
    pub(super) weights: &'a mut [f64],
}

impl<'a> Workspace<'a> {
    /// `None` where a slice is shorter than [`workspace_len`] says.
    #[must_use]
    pub fn new(n: usize, reals: &'a mut [f64], indices: &'a mut [usize]) -> Option<Self> {
        let (mut reals, mut indices) = (reals, indices);
        let pivotal = PivotalWorkspace {
            inverse: take(&mut reals, n * n)?,
            values: take(&mut reals, n)?,
            direction: take(&mut reals, n)?,
            covering: take(&mut reals, n)?,
            resting: take(&mut reals, n)?,
            column: take(&mut reals, n)?,
            pivot_row: take(&mut reals, n)?,
            residual: take(&mut reals, n)?,
            members: take(&mut indices, n)?,
            held: take(&mut indices, n)?,
        };
        let jacobian = take(&mut reals, n * n)?;
        let mut vector = || take(&mut reals, n);
        Some(Self {
            pivotal,
            jacobian,
            f: vector()?,
            phi: vector()?,
            gradient: vector()?,
            slope_z: vector()?,
            slope_f: vector()?,
            step: vector()?,
            trial: vector()?,
            trial_f: vector()?,
            lower: vector()?,
            upper: vector()?,
            scale: vector()?,
            start: vector()?,
            centre: vector()?,
            best: vector()?,
            point: vector()?,
            neighbour: vector()?,
            weights: vector()?,
        })
    }
}

impl Workspace<'_> {
    /// `F` at the end of the last solve (NaN where unknown).
    #[must_use]
    pub fn map(&self) -> &[f64] {
        self.trial_f
    }
}

/// The first `length` entries of `rest`, which keeps the others.
fn take<'a, T>(rest: &mut &'a mut [T], length: usize) -> Option<&'a mut [T]> {
    let (head, tail) = core::mem::take(rest).split_at_mut_checked(length)?;
    *rest = tail;
    Some(head)
}

#[cfg(test)]
mod stagnation_tests {
    use super::*;

    #[test]
    fn slow_after_three_and_stalled_after_twenty_that_do_not_fall_by_a_tenth() {
        let mut progress = Stagnation::new(1.0);
        let mut told = |merit: f64| (progress.has_stalled(merit), progress.is_slow());
        for merit in [0.95, 0.91] {
            assert_eq!(told(merit), (false, false));
        }
        assert_eq!(told(0.9), (false, true));
        assert_eq!(told(0.89), (false, false));
        for iteration in 1..20 {
            assert_eq!(told(0.85), (false, iteration >= 3));
        }
        assert_eq!(told(0.85), (true, true));
    }
}

#[cfg(test)]
mod random_tests {
    use super::*;

    /// The first numbers of the published generator from the state 0.
    #[test]
    fn it_is_the_published_generator() {
        let mut random = Random::new(0);
        for bits in [0xE220_A839_7B1D_CDAF_u64, 0x6E78_9E6A_A1B9_65F4, 0x06C4_5D18_8009_454F] {
            assert_eq!(random.uniform(), (bits >> 11) as f64 / (1_u64 << 53) as f64);
        }
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;

    #[test]
    fn the_lengths_are_exactly_enough() {
        let (reals, indices) = workspace_len(3);
        let (mut r, mut i) = ([0.0; 200], [0; 20]);
        let fits =
            |reals: &mut [f64], indices: &mut [usize]| Workspace::new(3, reals, indices).is_some();
        assert!(fits(&mut r[..reals], &mut i[..indices]));
        assert!(!fits(&mut r[..reals - 1], &mut i[..indices]));
        assert!(!fits(&mut r[..reals], &mut i[..indices - 1]));
    }
}
