//! Sampled control of mechanical systems: one tracker a gap, the rest at right angles to impacts.
//!
//! ```text
//! M q'' = F + B u + N^T lambda      W = N M^-1 N^T      g'' = a + W lambda
//! q'  = M^-1 N^T W^-1 g' + T w      N T = 0             w: no impact changes it
//! ```
//!
//! `kinetics` computes gap coordinates of a state, `allocation` the controls for accelerations,
//! `in_box` controls within limits, `gap_tracker` is the law, `latch` its held contacts,
//! `believed_plant` its model of the plant, `tasks` the task functions, `tracking` the law in a
//! loop, `striker` the law that aims at impacts, `sampled` the operations at a sample.

mod believed_plant;
mod gap_tracker;
mod striker;

use std::fmt;

use zivi_core::control::TwistingTracker;
use zivi_core::SettingError;

use crate::mechanics::shortest;
use crate::numeric::cholesky;
use crate::numeric::dense::dot;
use crate::numeric::elimination::{Elimination, Singular};
use crate::system::dynamics::Layout;
use crate::SetupError;

pub use believed_plant::{
    one_step_each, BelievedPlant, MechanicalReference, Moved, ReferenceSample, SentControls, Tasks,
};
pub use gap_tracker::{
    GapTracker, GapTrackerSettings, GapTrackerState, Latch, MechanicalController, MechanicalSensor,
    Noise, Observing, Offsets, SampledLoop, TickRecord, Tracking, EXACT,
};
pub use striker::{Striker, StrikerSettings, StrikerState, Striking};

// A state of a mechanical system by its gaps.

/// Least relative mobility of a gap given the others.
const REDUNDANT: f64 = 1e-10;

/// Kinetics of gaps and controls at a state.
#[derive(Clone, Debug)]
pub struct GapKinetics {
    layout: Layout,
    /// The evaluation of the system, as [`Layout`] says.
    row: Vec<f64>,
    /// `g'`.
    rates: Vec<f64>,
    /// `L L^T = M`.
    mass: Vec<f64>,
    /// The rows `M^-1 n_i`.
    mobility: Vec<f64>,
    /// `W`, and `L L^T = W`.
    d: Vec<f64>,
    d_factor: Vec<f64>,
    /// Whether the gaps are independent of each other.
    is_independent: bool,
    /// The same of some of the gaps.
    small: Vec<f64>,
    right: Vec<f64>,
}

impl GapKinetics {
    /// Of no state yet.
    #[must_use]
    pub fn new(layout: Layout) -> Self {
        let Layout { n, m, .. } = layout;
        let zeros = |count| vec![0.0; count];
        Self {
            layout,
            row: zeros(layout.len()),
            rates: zeros(m),
            mass: zeros(n * n),
            mobility: zeros(m * n),
            d: zeros(m * m),
            d_factor: zeros(m * m),
            is_independent: true,
            small: Vec::with_capacity(m * m),
            right: Vec::with_capacity(m),
        }
    }

    /// Of one evaluation. The gaps may depend on each other, as both limits of a joint do.
    ///
    /// # Errors
    /// [`LawError::Indefinite`].
    pub fn of<E>(layout: Layout, row: &[f64], w: &[f64]) -> Result<Self, LawError<E>> {
        let mut it = Self::new(layout);
        it.row.copy_from_slice(row);
        it.renew(w).map(|()| it)
    }

    /// Those of one gap of a system alone, of the same evaluation.
    fn alone<E>(&mut self, of: &Self, gap: usize, w: &[f64]) -> Result<(), LawError<E>> {
        let (all, own) = (of.layout, self.layout);
        self.row[own.mass()].copy_from_slice(&of.row[all.mass()]);
        self.row[own.force()].copy_from_slice(of.force());
        self.row[own.gap()].copy_from_slice(&of.gaps()[gap..=gap]);
        self.row[own.gradient()].copy_from_slice(of.normal(gap));
        self.row[own.curvature()].copy_from_slice(&of.curvatures()[gap..=gap]);
        self.row[own.rate()].copy_from_slice(&of.row[all.rate()][gap..=gap]);
        self.renew(w)?;
        self.check_independent()
    }

    /// Rejects gaps that depend on each other.
    fn check_independent<E>(&self) -> Result<(), LawError<E>> {
        match self.is_independent {
            true => Ok(()),
            false => Err(LawError::Dependent),
        }
    }

    /// Computes them from the evaluation in `row`.
    fn renew<E>(&mut self, w: &[f64]) -> Result<(), LawError<E>> {
        let Self { layout, row, rates, mass, mobility, d, d_factor, is_independent, .. } = self;
        let Layout { n, m, .. } = *layout;
        mass.copy_from_slice(&row[layout.mass()]);
        // written so that a NaN is one, too
        let definite = cholesky::factor(mass, n) > 0.0;
        if !definite {
            return Err(LawError::Indefinite);
        }
        let normals = &row[layout.gradient()][..m * n];
        mobility.copy_from_slice(normals);
        for i in 0..m {
            cholesky::solve(mass, n, &mut mobility[i * n..][..n]);
            rates[i] = dot(&normals[i * n..][..n], w) + row[layout.rate()][i];
        }
        for i in 0..m {
            for j in 0..=i {
                let one = dot(&normals[i * n..][..n], &mobility[j * n..][..n]);
                let other = dot(&normals[j * n..][..n], &mobility[i * n..][..n]);
                let both = 0.5 * (one + other);
                (d[i * m + j], d[j * m + i]) = (both, both);
            }
        }
        d_factor.copy_from_slice(d);
        *is_independent = m == 0 || cholesky::factor(d_factor, m) > REDUNDANT;
        Ok(())
    }

    fn layout(&self) -> Layout {
        self.layout
    }

    fn gaps(&self) -> &[f64] {
        &self.row[self.layout.gap()]
    }

    fn force(&self) -> &[f64] {
        &self.row[self.layout.force()]
    }

    fn curvatures(&self) -> &[f64] {
        &self.row[self.layout.curvature()][..self.layout.m]
    }

    /// The gradient of a gap.
    fn normal(&self, i: usize) -> &[f64] {
        &self.row[self.layout.gradient()][i * self.layout.n..][..self.layout.n]
    }

    /// The row `M^-1 n_i`.
    fn mobility_of(&self, i: usize) -> &[f64] {
        &self.mobility[i * self.layout.n..][..self.layout.n]
    }

    /// `M v`.
    fn momentum(&self, v: &[f64]) -> Vec<f64> {
        let n = self.layout.n;
        self.row[self.layout.mass()].chunks_exact(n).map(|row| dot(row, v)).collect()
    }

    /// `b <- W_AA^-1 b` for the gaps of a set, in order; others stay. Where gaps of it depend on each
    /// other, of all solutions the least without a negative part, or the least of all.
    fn solve_among(&mut self, set: &[bool], b: &mut [f64]) {
        let m = self.layout.m;
        if self.is_independent && set.iter().all(|&it| it) {
            return cholesky::solve(&self.d_factor, m, b);
        }
        let Self { small, right, d, .. } = self;
        let chosen = || (0..m).filter(|&i| set[i]);
        let block = || chosen().flat_map(|i| chosen().map(move |j| i * m + j)).map(|at| d[at]);
        small.clear();
        small.extend(block());
        right.clear();
        right.extend(chosen().map(|i| b[i]));
        let size = right.len();
        if cholesky::factor(small, size) > REDUNDANT {
            cholesky::solve(small, size, right);
        } else {
            let found = Singular::new(&block().collect::<Vec<f64>>(), size, size);
            let rank = found.rank(REDUNDANT);
            *right = found.solve(right, rank);
            let null: Vec<Vec<f64>> =
                found.null_space(rank).chunks_exact(size).map(<[f64]>::to_vec).collect();
            shortest(right, &null, 0..size);
        }
        chosen().zip(&*right).for_each(|(i, x)| b[i] = *x);
    }

    /// The forces of closed contacts that keep their gaps closed under the forces of the evaluation, 0
    /// of open ones.
    pub fn contact_forces(&mut self, closed: &[bool]) -> Vec<f64> {
        let free = |i| dot(self.mobility_of(i), self.force()) + self.curvatures()[i];
        let mut forces: Vec<f64> =
            (0..closed.len()).map(|i| if closed[i] { -free(i) } else { 0.0 }).collect();
        self.solve_among(closed, &mut forces);
        forces
    }

    /// Takes from a velocity, or such, `M^-1 N_A^T W_AA^-1 b`.
    fn push(&mut self, set: &[bool], mut b: Vec<f64>, v: &mut [f64]) {
        self.solve_among(set, &mut b);
        for i in (0..self.layout.m).filter(|&i| set[i]) {
            v.iter_mut().zip(self.mobility_of(i)).for_each(|(v, by)| *v -= b[i] * by);
        }
    }

    /// Takes from a velocity, or such, what moves the gaps of a set, M-orthogonally.
    pub fn without_gaps(&mut self, set: &[bool], v: &mut [f64]) {
        let moved = (0..self.layout.m).map(|i| dot(self.normal(i), v)).collect();
        self.push(set, moved, v);
    }
}

// Why a law gives no controls.

/// Why a law gives no controls.
#[derive(Debug)]
pub enum LawError<E> {
    /// The model or a force raised it.
    Raised(E),
    /// The Delassus matrix `N M^-1 N^T` is singular: the gaps are not independent.
    Dependent,
    /// `M` is not positive definite.
    Indefinite,
    /// The controls do not reach all of this number of gaps: the singular values of `W^-1/2 N M^-1
    /// B`.
    Unreached(usize, Vec<f64>),
    /// The state that was put back is of a system with other coordinates or controls.
    Foreign,
    /// The tracker of a gap rejects its reference or its settings.
    Refused(SettingError),
    /// The motion over the delay cannot begin.
    Setup(SetupError),
}

impl<E> LawError<E> {
    /// The raised error, or otherwise the text.
    ///
    /// # Errors
    /// The text.
    pub fn raised(self) -> Result<E, String>
    where
        E: fmt::Debug,
    {
        Err(match self {
            Self::Raised(error) => return Ok(error),
            Self::Dependent => "the gaps must be independent: N M^-1 N^T is singular here".into(),
            Self::Indefinite => "mass must be positive definite at every control update".into(),
            Self::Unreached(gaps, values) => format!(
                "the controls must reach all {gaps} gaps: N M^-1 B has the singular \
                 values {values:?} here, in the metric of the masses"
            ),
            Self::Foreign => "state must be the state of a controller of this system".into(),
            Self::Refused(error) => error.to_string(),
            Self::Setup(error) => error.to_string(),
        })
    }
}

impl<E> From<SettingError> for LawError<E> {
    fn from(error: SettingError) -> Self {
        Self::Refused(error)
    }
}

// From wanted accelerations to the controls of a mechanical system.

/// Singular values below this part of the largest leave a gap without control.
const RANK: f64 = 1e-6;
/// How much heavier the gaps count than the rest, where limits do not leave room for both.
const FIRST: f64 = 1e4;

/// How the controls of an update were found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Allocation {
    /// Whether limits act.
    pub limited: bool,
    /// The least singular value of `W^-1/2 N M^-1 B`, if computed.
    pub least: Option<f64>,
}

/// `F = M b + N^T W^-1 (a - h - N b)`, the force with `g'' = a` and `Z q'' = Z b` without contacts;
/// for as many gaps as coordinates `F = N^T W^-1 (a - h)`, in which nothing cancels.
#[must_use]
pub fn decoupling_force(kinetics: &GapKinetics, a: &[f64], wanted: &[f64]) -> Vec<f64> {
    let Layout { n, m, .. } = kinetics.layout();
    let whole = m > 0 && m == n;
    let mut force = if whole { vec![0.0; n] } else { kinetics.momentum(wanted) };
    let moved = |i| if whole { 0.0 } else { dot(kinetics.normal(i), wanted) };
    let mut left: Vec<f64> = (0..m).map(|i| a[i] - kinetics.curvatures()[i] - moved(i)).collect();
    cholesky::solve(&kinetics.d_factor, m, &mut left);
    for (i, left) in left.iter().enumerate() {
        force.iter_mut().zip(kinetics.normal(i)).for_each(|(to, by)| *to += left * by);
    }
    force
}

/// Finds the controls for `g'' = a` and, as far as they can, `Z q'' = Z b`; `matrix` is `B`, `n x r`
/// row by row.
///
/// # Errors
/// [`LawError::Unreached`].
pub fn controls<E>(
    kinetics: &mut GapKinetics,
    matrix: &[f64],
    a: &[f64],
    wanted: &[f64],
    limits: Option<&Limits>,
    u: &mut [f64],
) -> Result<Allocation, LawError<E>> {
    let (Layout { n, .. }, r) = (kinetics.layout(), u.len());
    if n == r {
        let mut force = decoupling_force(kinetics, a, wanted);
        force.iter_mut().zip(kinetics.force()).for_each(|(to, own)| *to -= own);
        let inverse = Elimination::new(matrix.to_vec(), n, 0.0);
        if inverse.rank() == n {
            let found = inverse.solve(&force);
            if limits.is_none_or(|limits| are_within(&found, limits)) {
                u.copy_from_slice(&found);
                return Ok(Allocation::default());
            }
        }
    }
    let size = sizes(limits, r);
    let gaps = of_gaps(kinetics, matrix, a, r);
    let least = reached(&gaps.scaled(&size), gaps.right.len(), r)?;
    let rest = of_rest(kinetics, matrix, wanted, r);
    let limited = allocated(&gaps, &rest, limits, &size, u);
    Ok(Allocation { limited, least: Some(least) })
}

fn are_within(u: &[f64], limits: &Limits) -> bool {
    u.iter().zip(limits).all(|(u, (low, high))| low <= u && u <= high)
}

/// Weight of a control relative to the others.
fn sizes(limits: Option<&Limits>, r: usize) -> Vec<f64> {
    match limits {
        Some(limits) if limits.iter().all(|(low, high)| low.is_finite() && high.is_finite()) => {
            limits.iter().map(|(low, high)| low.abs().max(high.abs())).collect()
        }
        _ => vec![1.0; r],
    }
}

/// An equality constraint on controls: `A u = b`.
struct EqualityConstraint {
    matrix: Vec<f64>,
    right: Vec<f64>,
}

impl EqualityConstraint {
    fn scaled(&self, size: &[f64]) -> Vec<f64> {
        let rows = self.matrix.chunks_exact(size.len());
        rows.flat_map(|row| row.iter().zip(size).map(|(a, size)| a * size)).collect()
    }
}

/// Effect of the controls on the gaps, scaled by `L^-1` with `L L^T = W`.
fn of_gaps(kinetics: &GapKinetics, matrix: &[f64], a: &[f64], r: usize) -> EqualityConstraint {
    let Layout { m, .. } = kinetics.layout();
    let (mut by, mut right) = (vec![0.0; m * r], vec![0.0; m]);
    for i in 0..m {
        let moved = kinetics.mobility_of(i);
        for (row, mobility) in matrix.chunks_exact(r).zip(moved) {
            by[i * r..][..r].iter_mut().zip(row).for_each(|(to, b)| *to += mobility * b);
        }
        right[i] = a[i] - (dot(moved, kinetics.force()) + kinetics.curvatures()[i]);
        let root = &kinetics.d_factor[i * m..][..=i];
        let (above, own) = by.split_at_mut(i * r);
        for (j, part) in root[..i].iter().enumerate() {
            own[..r].iter_mut().zip(&above[j * r..]).for_each(|(to, of)| *to -= part * of);
            right[i] -= part * right[j];
        }
        own[..r].iter_mut().for_each(|it| *it /= root[i]);
        right[i] /= root[i];
    }
    EqualityConstraint { matrix: by, right }
}

/// The least singular value of `W^-1/2 N M^-1 B`.
///
/// # Errors
/// [`LawError::Unreached`].
fn reached<E>(scaled: &[f64], m: usize, r: usize) -> Result<f64, LawError<E>> {
    if m == 0 {
        return Ok(f64::INFINITY);
    }
    let found = Singular::new(scaled, m, r);
    let values = &found.values()[..m.min(r)];
    let least = if r < m { 0.0 } else { values[m - 1] };
    // written so that a NaN is one, too
    let enough = least > RANK * values.first().copied().unwrap_or(0.0);
    if enough {
        Ok(least)
    } else {
        Err(LawError::Unreached(m, values.to_vec()))
    }
}

/// The same at a state.
///
/// # Errors
/// [`LawError::Unreached`].
fn reach<E>(kinetics: &GapKinetics, matrix: &[f64], r: usize) -> Result<f64, LawError<E>> {
    let m = kinetics.layout().m;
    reached(&of_gaps(kinetics, matrix, &vec![0.0; m], r).matrix, m, r)
}

/// Effect of the controls on the motion in the null space of the gaps, in the kinetic-energy
/// metric: scaled by `L^T` with `L L^T = M`.
fn of_rest(
    kinetics: &mut GapKinetics,
    matrix: &[f64],
    wanted: &[f64],
    r: usize,
) -> EqualityConstraint {
    let Layout { n, m, .. } = kinetics.layout();
    let column = |j: usize| (0..n).map(|i| matrix[i * r + j]).collect();
    let mut vectors: Vec<Vec<f64>> = (0..r).map(column).collect();
    vectors.push(kinetics.force().to_vec());
    vectors.iter_mut().for_each(|v| cholesky::solve(&kinetics.mass, n, v));
    // the required change of the motion under the forces alone
    vectors[r].iter_mut().zip(wanted).for_each(|(free, wanted)| *free = wanted - *free);
    let all = vec![true; m];
    for v in &mut vectors {
        kinetics.without_gaps(&all, v);
        let root = &kinetics.mass;
        *v = (0..n).map(|i| (i..n).map(|k| root[k * n + i] * v[k]).sum()).collect();
    }
    let right = vectors.pop().unwrap_or_default();
    EqualityConstraint {
        matrix: (0..n).flat_map(|i| vectors.iter().map(move |v| v[i])).collect(),
        right,
    }
}

/// The controls that do what is requested of the gaps, then as much as they can of the rest:
///
/// ```text
/// min |S u - s|, then min |R u - r|, then min |u/size|, u within limits
/// ```
///
/// Where limits act, which it says, the first two are weighed against each other by 1e8 to 1.
fn allocated(
    gaps: &EqualityConstraint,
    rest: &EqualityConstraint,
    limits: Option<&Limits>,
    size: &[f64],
    u: &mut [f64],
) -> bool {
    let (r, m) = (size.len(), gaps.right.len());
    let (matrix, other) = (gaps.scaled(size), rest.scaled(size));
    let found = Singular::new(&matrix, m, r);
    let rank = found.rank(SMALL);
    let mut x = found.solve(&gaps.right, rank);
    let null = found.null_space(rank);
    if rank < r {
        let rows = other.chunks_exact(r);
        let left: Vec<f64> =
            rows.clone().zip(&rest.right).map(|(row, right)| right - dot(row, &x)).collect();
        let by: Vec<f64> =
            rows.flat_map(|row| null.chunks_exact(r).map(move |v| dot(row, v))).collect();
        let inner = Singular::new(&by, left.len(), r - rank);
        let along = inner.solve(&left, inner.rank(SMALL));
        for (v, part) in null.chunks_exact(r).zip(along) {
            x.iter_mut().zip(v).for_each(|(x, v)| *x += part * v);
        }
    }
    u.iter_mut().zip(size).zip(&x).for_each(|((u, size), x)| *u = size * x);
    let Some(limits) = limits.filter(|limits| !are_within(u, limits)) else {
        return false;
    };
    let largest = |of: &[f64]| of.iter().fold(0.0_f64, |most, it| most.max(it.abs()));
    let scale = FIRST * largest(&other).max(1.0) / largest(&matrix).max(1e-300);
    let first = |of: &[f64], then: &[f64]| -> Vec<f64> {
        of.iter().map(|it| scale * it).chain(then.iter().copied()).collect()
    };
    let (matrix, right) = (first(&matrix, &other), first(&gaps.right, &rest.right));
    let each = limits.iter().zip(size);
    let scaled: Vec<_> = each.map(|((low, high), size)| (low / size, high / size)).collect();
    let x = in_box(&matrix, &right, &scaled);
    for (((u, size), x), (low, high)) in u.iter_mut().zip(size).zip(x).zip(limits) {
        *u = (size * x).max(*low).min(*high); // products round
    }
    true
}

// Least squares in a box, by its active sets.

/// Range of each control.
pub type Limits = [(f64, f64)];

/// Singular values below this part of the largest are zero.
const SMALL: f64 = 1e-12;

/// Where a variable is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum VariableSide {
    Low,
    Inside,
    High,
}

/// Minimises `|A x - b|` within limits.
///
/// A set of bounds and the least squares in between are the solution if that is within the bounds and
/// the gradient points out at each of them. Starting from the clipped free solution, active sets
/// change by the most violated bound or multiplier; if a set recurs, all sets are examined.
fn in_box(a: &[f64], b: &[f64], limits: &Limits) -> Vec<f64> {
    let r = limits.len();
    let problem = AllocationProblem { a, b, limits };
    let free = problem.solved(&vec![VariableSide::Inside; r]);
    let side = |(x, (low, high)): (&f64, &(f64, f64))| match () {
        () if x < low => VariableSide::Low,
        () if x > high => VariableSide::High,
        () => VariableSide::Inside,
    };
    let mut places: Vec<VariableSide> = free.iter().zip(limits).map(side).collect();
    let mut seen = Vec::new();
    while !seen.contains(&places) {
        seen.push(places.clone());
        let x = problem.solved(&places);
        let over: Vec<f64> =
            x.iter().zip(limits).map(|(x, (low, high))| (low - x).max(x - high)).collect();
        let size = x.iter().fold(1.0, |size: f64, x| size.max(1.0 + x.abs()));
        let worst = largest(&over);
        if over[worst] > SMALL * size {
            places[worst] =
                if x[worst] < limits[worst].0 { VariableSide::Low } else { VariableSide::High };
            continue;
        }
        let slope = problem.slope(&x);
        let pull: Vec<f64> = (0..r)
            .map(|j| match places[j] {
                VariableSide::Inside => f64::NEG_INFINITY,
                VariableSide::Low => -slope[j],
                VariableSide::High => slope[j],
            })
            .collect();
        let held = largest(&pull);
        let scale: f64 = a.iter().map(|it| it.abs()).sum();
        let right = b.iter().fold(0.0_f64, |size, it| size.max(it.abs()));
        if pull[held] > SMALL * scale * (1.0 + right) {
            places[held] = VariableSide::Inside;
        } else {
            return clipped(x, limits);
        }
    }
    problem.best()
}

fn largest(of: &[f64]) -> usize {
    (1..of.len()).fold(0, |best, j| if of[j] > of[best] { j } else { best })
}

fn clipped(mut x: Vec<f64>, limits: &Limits) -> Vec<f64> {
    x.iter_mut().zip(limits).for_each(|(x, (low, high))| *x = x.max(*low).min(*high));
    x
}

struct AllocationProblem<'a> {
    a: &'a [f64],
    b: &'a [f64],
    limits: &'a Limits,
}

impl AllocationProblem<'_> {
    /// `A x - b`.
    fn residual(&self, x: &[f64]) -> Vec<f64> {
        let rows = self.a.chunks_exact(x.len().max(1));
        rows.zip(self.b).map(|(row, b)| dot(row, x) - b).collect()
    }

    /// `A^T (A x - b)`.
    fn slope(&self, x: &[f64]) -> Vec<f64> {
        let (left, r) = (self.residual(x), x.len());
        (0..r).map(|j| (0..left.len()).map(|i| self.a[i * r + j] * left[i]).sum()).collect()
    }

    /// The least squares with some variables at their bounds.
    fn solved(&self, places: &[VariableSide]) -> Vec<f64> {
        let r = places.len();
        let mut x: Vec<f64> = places
            .iter()
            .zip(self.limits)
            .map(|(place, (low, high))| match place {
                VariableSide::Low => *low,
                VariableSide::Inside => 0.0,
                VariableSide::High => *high,
            })
            .collect();
        let inside: Vec<usize> = (0..r).filter(|&j| places[j] == VariableSide::Inside).collect();
        if inside.is_empty() {
            return x;
        }
        let right: Vec<f64> = self.residual(&x).iter().map(|it| -it).collect();
        let rows = self.b.len();
        let part: Vec<f64> =
            (0..rows).flat_map(|i| inside.iter().map(move |j| self.a[i * r + j])).collect();
        let found = Singular::new(&part, rows, inside.len());
        let rank = found.rank(f64::EPSILON * rows.max(inside.len()) as f64);
        let solved = found.solve(&right, rank);
        inside.iter().zip(solved).for_each(|(&j, value)| x[j] = value);
        x
    }

    /// The best of all sets.
    fn best(&self) -> Vec<f64> {
        let r = self.limits.len();
        let mut places = vec![VariableSide::Low; r];
        let (mut found, mut least) = (clipped(vec![0.0; r], self.limits), f64::INFINITY);
        loop {
            let x = clipped(self.solved(&places), self.limits);
            let left = self.residual(&x);
            let size = dot(&left, &left);
            // no bound on that side: not finite
            if x.iter().all(|x| x.is_finite()) && size < least {
                (found, least) = (x, size);
            }
            let Some(j) = (0..r).find(|&j| places[j] != VariableSide::High) else {
                return found;
            };
            places[..j].fill(VariableSide::Low);
            places[j] = if places[j] == VariableSide::Low {
                VariableSide::Inside
            } else {
                VariableSide::High
            };
        }
    }
}

// Accelerations that trackers command at rest and while they establish contact.

/// The acceleration with which a tracker presses a gap that rests.
fn press_of(tracker: &TwistingTracker) -> f64 {
    tracker.descent().map_or(0.0, |it| it.accelerations()[2])
}

/// The least acceleration towards the wall that a tracker commands while it establishes contact.
fn weakest_of(tracker: &TwistingTracker) -> f64 {
    let pulls = tracker.descent().map_or([0.0; 3], |it| it.accelerations());
    pulls.into_iter().fold(f64::INFINITY, f64::min)
}

/// The forces with which contact-establishing laws press the contacts that are held, 0 elsewhere.
fn usual_forces(kinetics: &mut GapKinetics, held: &[bool], press: &[f64]) -> Vec<f64> {
    let m = held.len();
    let mut forces: Vec<f64> =
        held.iter().zip(press).map(|(held, press)| if *held { *press } else { 0.0 }).collect();
    kinetics.solve_among(held, &mut forces);
    if !held.iter().zip(&forces).all(|(held, force)| !held || *force > 0.0) {
        for i in (0..m).filter(|&i| held[i]) {
            forces[i] = press[i] / kinetics.d[i * m + i];
        }
    }
    forces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_change_with_the_velocities_and_with_their_walls() {
        // g = (1, 2) . q + 5 t
        let layout = Layout::smooth(2, 1);
        let mut row = vec![0.0; layout.len()];
        row[layout.mass()].copy_from_slice(&[1.0, 0.0, 0.0, 1.0]);
        row[layout.gradient()].copy_from_slice(&[1.0, 2.0]);
        row[layout.rate()].copy_from_slice(&[5.0]);
        let kinetics = GapKinetics::of::<()>(layout, &row, &[3.0, -1.0]).unwrap();
        assert_eq!(kinetics.rates, [6.0]);
    }

    /// A bar of mass 2 and inertia 1 that its weight presses to feet at these places, by height and angle.
    fn bar(feet: &[f64]) -> GapKinetics {
        let layout = Layout::smooth(2, feet.len());
        let mut row = vec![0.0; layout.len()];
        row[layout.mass()].copy_from_slice(&[2.0, 0.0, 0.0, 1.0]);
        row[layout.force()].copy_from_slice(&[-20.0, 0.0]);
        let gradients: Vec<f64> = feet.iter().flat_map(|&at| [1.0, at]).collect();
        row[layout.gradient()].copy_from_slice(&gradients);
        GapKinetics::of::<()>(layout, &row, &[0.0, 0.0]).unwrap()
    }

    #[test]
    fn contact_forces_bear_the_weight_also_where_they_are_not_determined() {
        let close = |found: Vec<f64>, exact: &[f64]| {
            let apart = found.iter().zip(exact).map(|(a, b)| (a - b).abs());
            assert!(found.len() == exact.len() && apart.fold(0.0, f64::max) < 1e-12, "{found:?}");
        };
        // moments about the middle: 3 f = f'
        close(bar(&[-3.0, 1.0]).contact_forces(&[true, true]), &[5.0, 15.0]);
        close(bar(&[-3.0, 0.0]).contact_forces(&[false, true]), &[0.0, 20.0]);
        // of (5, 0, 15) + alpha (-1, 3, -2) the least: alpha = 35/14
        let mut three = bar(&[-3.0, -1.0 / 3.0, 1.0]);
        close(three.contact_forces(&[true; 3]), &[2.5, 7.5, 10.0]);
        close(three.contact_forces(&[true, false, true]), &[5.0, 0.0, 15.0]);
        close(bar(&[-1.0, 0.0, 1.0]).contact_forces(&[true; 3]), &[20.0 / 3.0; 3]);
        // two that are not determined: the least
        close(bar(&[-1.0, -1.0, 1.0, 1.0]).contact_forces(&[true; 4]), &[5.0; 4]);
    }
}

#[cfg(test)]
mod allocation_tests {
    use super::*;

    #[test]
    fn controls_count_by_their_largest_only_where_all_are_limited() {
        let limits = |high: f64| vec![(-3.0, 2.0), (-1.0, high)];
        assert_eq!(sizes(Some(&limits(5.0)), 2), [3.0, 5.0]);
        assert_eq!(sizes(Some(&limits(f64::INFINITY)), 2), [1.0, 1.0]);
        assert_eq!(sizes(Some(&[(f64::NEG_INFINITY, 1.0); 2]), 2), [1.0, 1.0]);
        assert_eq!(sizes(None, 3), [1.0; 3]);
    }
    #[test]
    fn the_reach_is_the_least_singular_value_in_the_metric_of_the_gaps() {
        // M = diag(4, 9), g = q, B = diag(6, 6): W^-1/2 N M^-1 B = diag(3, 2)
        let layout = Layout::smooth(2, 2);
        let mut row = vec![0.0; layout.len()];
        row[layout.mass()].copy_from_slice(&[4.0, 0.0, 0.0, 9.0]);
        row[layout.gradient()].copy_from_slice(&[1.0, 0.0, 0.0, 1.0]);
        let kinetics = GapKinetics::of::<()>(layout, &row, &[0.0; 2]).unwrap();
        let least = reach::<()>(&kinetics, &[6.0, 0.0, 0.0, 6.0], 2).unwrap();
        assert!((least - 2.0).abs() < 1e-14, "{least}");
    }
}
