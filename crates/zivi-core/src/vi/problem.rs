//! Problems: maps with Jacobians, finite differences, interruption.
//!
//! A problem: a map and its Jacobian, supplied by the caller.

use super::dense;
use super::settings::Stage;
use core::cell::Cell;
use core::fmt;

/// Where a solve is after one of its iterations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Iterations so far, of all stages.
    pub iteration: usize,
    /// The scaled natural residual of the iterate.
    pub residual: f64,
    /// The component whose natural map is this large.
    pub worst: usize,
    /// The stage.
    pub stage: Stage,
}

/// The map `F` of a box VI and its Jacobian.
pub trait Problem {
    /// Writes `F(z)` into `f`.
    ///
    /// # Errors
    /// [`EvaluationError`] stops the solver immediately; its best point so far is kept.
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError>;

    /// Writes `dF_i/dz_j` into `jacobian[i n + j]`. Entries that are not finite (an infinite slope
    /// at a bound) are replaced by difference quotients of `F`.
    ///
    /// # Errors
    /// [`EvaluationError`] stops the solver immediately; its best point so far is kept.
    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError>;

    /// Called before every evaluation, every few dozen pivots and columns of a factorisation, so
    /// that long work can be interrupted.
    ///
    /// # Errors
    /// [`Interruption`] stops the solver immediately; its best point so far is kept.
    fn poll(&mut self) -> Result<(), Interruption> {
        Ok(())
    }

    /// Overwrites a `k x k` matrix by its factors, as [`super::factor`] does: for those who are faster
    /// at large ones.
    ///
    /// # Errors
    /// [`Interruption`]; see [`Problem::poll`].
    fn factor(
        &mut self,
        matrix: &mut [f64],
        k: usize,
        permutation: &mut [usize],
    ) -> Result<f64, Interruption> {
        dense::factor(matrix, k, permutation, &mut || self.poll())
    }

    /// Called after every iteration.
    ///
    /// # Errors
    /// [`Interruption`] stops the solver immediately; its best point so far is kept.
    fn monitor(&mut self, _progress: &Progress) -> Result<(), Interruption> {
        Ok(())
    }

    /// True when `F` is affine: its values at one point then show whether a row can be satisfied
    /// anywhere in the box.
    fn is_affine(&self) -> bool {
        false
    }

    /// True when the Jacobian is made of differences of `F`: it costs many evaluations, and is
    /// not exact.
    fn is_differenced(&self) -> bool {
        false
    }

    /// Relative rounding error of `F`: that of the type it is computed in.
    fn rounding(&self) -> f64 {
        f64::EPSILON
    }
}

/// The affine map `F(z) = M z + q`, `M` row by row.
#[derive(Clone, Copy, Debug)]
pub struct Affine<'a> {
    /// The matrix, `n^2` entries row by row.
    pub matrix: &'a [f64],
    /// The constant term.
    pub q: &'a [f64],
}

impl Problem for Affine<'_> {
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        if z.iter().all(|z| *z == 0.0) {
            dense::copy(f, self.q); // most starts
            return Ok(());
        }
        for ((f, row), q) in f.iter_mut().zip(dense::rows(self.matrix, z.len())).zip(self.q) {
            *f = dense::dot(row, z) + q;
        }
        Ok(())
    }

    fn jacobian(&mut self, _z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        dense::copy(jacobian, self.matrix);
        Ok(())
    }

    fn is_affine(&self) -> bool {
        true
    }
}

// Why a solve ends from outside.

/// The caller could not evaluate `F` or its Jacobian and wants the solver to stop.
///
/// A point where `F` is merely undefined is reported by a value that is not finite instead: the
/// solver then backs off and continues.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EvaluationError;

impl fmt::Display for EvaluationError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("the map or its Jacobian could not be evaluated")
    }
}

impl core::error::Error for EvaluationError {}

/// Why a solve is broken off from outside. The best point so far is kept either way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interruption {
    /// The caller cannot go on: `F` is not called again.
    Failed,
    /// The caller has had enough: `F` is evaluated once more at the best point.
    Stopped,
}

impl From<EvaluationError> for Interruption {
    fn from(_: EvaluationError) -> Self {
        Self::Failed
    }
}

// The Jacobian by differences of `F`, never outside the box.

/// Which differences are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheme {
    /// First order: one neighbour, `n` evaluations.
    TwoPoint,
    /// Second order: two neighbours, `2 n` evaluations.
    ThreePoint,
}

/// A map without Jacobian; it is taken by differences: central inside the box, one-sided where a
/// bound or the end of the domain of `F` is near, zero for a fixed component.
#[derive(Debug)]
pub struct Differenced<'a, M> {
    map: M,
    lower: &'a [f64],
    upper: &'a [f64],
    /// `z` with one component moved, and `F` at `z` and at two neighbours.
    point: &'a mut [f64],
    here: &'a mut [f64],
    first: &'a mut [f64],
    second: &'a mut [f64],
    here_is_known: bool,
    scheme: Scheme,
    rounding: Option<&'a Cell<f64>>,
    /// The step for `|z_j| <= 1`.
    step: f64,
}

impl<'a, M> Differenced<'a, M>
where
    M: FnMut(&[f64], &mut [f64]) -> Result<(), EvaluationError>,
{
    /// Length of the workspace for `n` unknowns.
    #[must_use]
    pub const fn workspace_len(n: usize) -> usize {
        4 * n
    }

    /// `None` where the workspace is too short.
    #[must_use]
    pub fn new(map: M, lower: &'a [f64], upper: &'a [f64], work: &'a mut [f64]) -> Option<Self> {
        let n = lower.len();
        let (point, rest) = work.split_at_mut_checked(n)?;
        let (here, rest) = rest.split_at_mut_checked(n)?;
        let (first, rest) = rest.split_at_mut_checked(n)?;
        let second = rest.get_mut(..n)?;
        Some(Self {
            map,
            lower,
            upper,
            point,
            here,
            first,
            second,
            here_is_known: false,
            scheme: Scheme::ThreePoint,
            rounding: None,
            step: 0.0,
        })
    }

    /// Takes other differences than those of second order.
    #[must_use]
    pub fn with_scheme(self, scheme: Scheme) -> Self {
        Self { scheme, ..self }
    }

    /// Reads the relative rounding error of `F` before each Jacobian, for instance once `F` has
    /// shown the type that it is computed in.
    #[must_use]
    pub fn with_rounding(self, rounding: &'a Cell<f64>) -> Self {
        Self { rounding: Some(rounding), ..self }
    }

    /// `F` at two neighbours of `z` on the axis `j`; false if not finite.
    fn evaluate(&mut self, j: usize, [a, b]: [f64; 2], zj: f64) -> Result<bool, EvaluationError> {
        dense::put(self.point, j, a);
        (self.map)(self.point, self.first)?;
        dense::put(self.point, j, b);
        (self.map)(self.point, self.second)?;
        dense::put(self.point, j, zj);
        Ok(dense::is_finite(self.first) && dense::is_finite(self.second))
    }

    /// `(F(z_j + h) - F(z_j - h)) / 2h` into column `j`.
    fn central(&mut self, j: usize, zj: f64, out: &mut [f64]) -> Result<bool, EvaluationError> {
        let step = self.step * f64::max(1.0, zj.abs());
        let [a, b] = [zj - step, zj + step];
        if a < dense::at(self.lower, j) || b > dense::at(self.upper, j) {
            return Ok(false);
        }
        let finite = self.evaluate(j, [a, b], zj)?;
        for (i, (fa, fb)) in self.first.iter().zip(self.second.iter()).enumerate() {
            dense::put(out, i * self.lower.len() + j, (fb - fa) / (b - a));
        }
        Ok(finite)
    }

    /// `(F(z_j + h) - F(z_j)) / h` into column `j`, `h` of the given sign and at most half the
    /// room.
    fn two_point(
        &mut self,
        j: usize,
        (zj, room): (f64, f64),
        out: &mut [f64],
    ) -> Result<bool, EvaluationError> {
        let moved = zj + step_into(zj, room, self.step);
        if moved == zj {
            return Ok(false);
        }
        self.know_here()?;
        dense::put(self.point, j, moved);
        (self.map)(self.point, self.first)?;
        dense::put(self.point, j, zj);
        for (i, (f, there)) in self.here.iter().zip(self.first.iter()).enumerate() {
            dense::put(out, i * self.lower.len() + j, (there - f) / (moved - zj));
        }
        Ok(dense::is_finite(self.first))
    }

    /// `F` at the point itself, once for a Jacobian.
    fn know_here(&mut self) -> Result<(), EvaluationError> {
        if !self.here_is_known {
            (self.map)(self.point, self.here)?;
            self.here_is_known = true;
        }
        Ok(())
    }

    /// The slope at `z_j` of the parabola through `z_j`, `z_j + h` and `z_j + 2h`, `h` of the
    /// given sign and at most half the room.
    fn one_sided(
        &mut self,
        j: usize,
        (zj, room): (f64, f64),
        out: &mut [f64],
    ) -> Result<bool, EvaluationError> {
        let step = step_into(zj, room, self.step);
        let (lower, upper) = (dense::at(self.lower, j), dense::at(self.upper, j));
        let (a, b) = (zj + step, (zj + 2.0 * step).max(lower).min(upper));
        let (da, db) = (a - zj, b - zj);
        if da == 0.0 || da == db {
            return Ok(false);
        }
        self.know_here()?;
        let finite = self.evaluate(j, [a, b], zj)?;
        let neighbours = self.first.iter().zip(self.second.iter());
        for (i, (f, (fa, fb))) in self.here.iter().zip(neighbours).enumerate() {
            let (near, far) = ((fa - f) / da, (fb - f) / db);
            dense::put(out, i * self.lower.len() + j, near + (near - far) * da / (db - da));
        }
        Ok(finite)
    }
}

/// A step from `z` of the sign of `room`, at most half of it; `relative` is the step for `|z| <= 1`.
fn step_into(z: f64, room: f64, relative: f64) -> f64 {
    f64::min(relative * f64::max(1.0, z.abs()), 0.5 * room.abs()).copysign(room)
}

/// Steps from `z` for second-order differences, towards the wider of two rooms and the narrower:
/// `eps^(1/3)` balances truncation and rounding.
pub(super) fn steps_into(z: f64, [up, down]: [f64; 2], rounding: f64) -> [f64; 2] {
    let rooms = if up >= -down { [up, down] } else { [down, up] };
    rooms.map(|room| step_into(z, room, libm::cbrt(rounding)))
}

impl<M> Problem for Differenced<'_, M>
where
    M: FnMut(&[f64], &mut [f64]) -> Result<(), EvaluationError>,
{
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        (self.map)(z, f)
    }

    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        dense::copy(self.point, z);
        self.here_is_known = false;
        let rounding = self.rounding();
        // balances truncation and rounding
        self.step = match self.scheme {
            Scheme::TwoPoint => libm::sqrt(rounding),
            Scheme::ThreePoint => libm::cbrt(rounding),
        };
        jacobian.fill(0.0);
        for (j, &zj) in z.iter().enumerate() {
            let up = dense::at(self.upper, j) - zj;
            let down = dense::at(self.lower, j) - zj;
            let (wider, narrower) = if up >= -down { (up, down) } else { (down, up) };
            let _done = wider == 0.0
                || match self.scheme {
                    Scheme::TwoPoint => {
                        self.two_point(j, (zj, wider), jacobian)?
                            || self.two_point(j, (zj, narrower), jacobian)?
                    }
                    Scheme::ThreePoint => {
                        self.central(j, zj, jacobian)?
                            || self.one_sided(j, (zj, wider), jacobian)?
                            || self.one_sided(j, (zj, narrower), jacobian)?
                    }
                };
        }
        Ok(())
    }

    fn is_differenced(&self) -> bool {
        true
    }

    fn rounding(&self) -> f64 {
        self.rounding.map_or(f64::EPSILON, Cell::get)
    }
}

#[cfg(test)]
mod difference_tests {
    use super::*;

    const INF: f64 = f64::INFINITY;

    /// `F = (z0^3 + z1, sin z1 z0, sqrt z2)`, undefined for `z2 < 0`; refuses to leave the box.
    fn differences(z: [f64; 3], lower: [f64; 3], upper: [f64; 3]) -> [f64; 9] {
        let map = |z: &[f64], f: &mut [f64]| {
            for ((z, l), u) in z.iter().zip(lower).zip(upper) {
                assert!((l..=u).contains(z), "{z} outside [{l}, {u}]");
            }
            if let ([x, y, w], [fx, fy, fw]) = (z, f) {
                (*fx, *fy, *fw) = (x * x * x + y, libm::sin(*y) * x, libm::sqrt(*w));
            }
            Ok(())
        };
        let (mut work, mut jacobian) = ([0.0; 12], [0.0; 9]);
        let mut problem = Differenced::new(map, &lower, &upper, &mut work);
        let done = problem.as_mut().map(|problem| problem.jacobian(&z, &mut jacobian));
        assert_eq!(done, Some(Ok(())));
        jacobian
    }

    fn exact([x, y, w]: [f64; 3]) -> [f64; 9] {
        let [sine, cosine] = [libm::sin(y), libm::cos(y)];
        [3.0 * x * x, 1.0, 0.0, sine, cosine * x, 0.0, 0.0, 0.0, 0.5 / libm::sqrt(w)]
    }

    #[test]
    fn inside_at_bounds_in_narrow_boxes_and_at_the_end_of_the_domain() {
        let z = [0.7, -0.4, 1.0];
        let close = |a: [f64; 9], b: [f64; 9], tol: f64| {
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < tol), "{a:?} {b:?}");
        };
        close(differences(z, [-INF; 3], [INF; 3]), exact(z), 1e-9);
        close(differences(z, z, [INF; 3]), exact(z), 1e-9);
        close(differences(z, [-INF; 3], z), exact(z), 1e-9);
        close(differences(z, z.map(|z| z - 1e-8), z.map(|z| z + 1e-8)), exact(z), 1e-6);
        let near_the_end = [0.7, -0.4, 1e-6];
        let [.., slope] = differences(near_the_end, [-INF; 3], [INF; 3]);
        assert!(slope.is_finite() && slope > 0.0, "{slope}");
    }

    #[test]
    fn first_order_differences_and_steps_for_a_coarse_map() {
        // F in single precision: steps of 6e-6 would give noise
        let coarse = |z: &[f64], f: &mut [f64]| {
            if let ([z], [f]) = (z, f) {
                *f = f64::from(libm::sinf(*z as f32));
            }
            Ok(())
        };
        let eps = Cell::new(f64::from(f32::EPSILON));
        for (scheme, tol) in [(Scheme::ThreePoint, 1e-4), (Scheme::TwoPoint, 2e-3)] {
            let (mut work, mut slope) = ([0.0; 4], [0.0]);
            let problem = Differenced::new(coarse, &[-INF], &[INF], &mut work);
            let mut problem = problem.map(|it| it.with_scheme(scheme).with_rounding(&eps));
            let done = problem.as_mut().map(|problem| problem.jacobian(&[0.7], &mut slope));
            assert_eq!(done, Some(Ok(())));
            let [slope] = slope;
            assert!((slope - libm::cos(0.7)).abs() < tol, "{scheme:?} {slope}");
        }
    }

    #[test]
    fn a_fixed_component_has_a_column_of_zeros() {
        let z = [0.7, -0.4, 1.0];
        let jacobian = differences(z, [-INF, -0.4, -INF], [INF, -0.4, INF]);
        let column = jacobian.iter().skip(1).step_by(3);
        assert!(column.into_iter().all(|&entry| entry == 0.0));
    }

    #[test]
    fn steps_go_into_the_wider_room_first() {
        let step = libm::cbrt(1e-15);
        for (rooms, steps) in [
            ([1e-12, -1.0], [-step, 0.5e-12]),
            ([1.0, -1e-12], [step, -0.5e-12]),
            ([2.0, -2.0], [step, -step]),
            ([f64::INFINITY, 0.0], [step, 0.0]),
        ] {
            assert_eq!(steps_into(0.3, rooms, 1e-15), steps, "{rooms:?}");
        }
    }
}
