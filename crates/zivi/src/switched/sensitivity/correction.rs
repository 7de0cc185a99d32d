//! A guess corrected towards a branch of orbits: Newton's iteration for the equations of a sequence of
//! impacts and a parameter, in a hyperplane.
//!
//! ```text
//! F(y, p) = 0,        n . (z - z_guess) = 0,        z = (y, p) in scaled unknowns
//! ```

use super::impulses::SequenceEquations;
use crate::numeric::elimination::Elimination;
use crate::record::status::Failure;

/// Hyperplane of the corrector: scaled unknowns and parameter as one vector.
#[derive(Clone, Copy, Debug)]
pub struct Hyperplane<'a> {
    /// A point of the plane, near the solution.
    pub guess: &'a [f64],
    /// Its normal.
    pub normal: &'a [f64],
    /// Magnitudes of the unknowns and of the parameter.
    pub scale: &'a [f64],
    /// Those of the equations.
    pub sizes: &'a [f64],
}

/// When the iteration ends.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// The most evaluations.
    pub evaluations: usize,
    /// The required scaled residual.
    pub tolerance: f64,
    /// The one with which an iteration that stalls has found what rounding allows.
    pub enough: f64,
    /// Where the residual falls by less, the derivative by the parameter is computed again.
    pub stale: f64,
}

/// A solution.
#[derive(Clone, Debug, PartialEq)]
pub struct Corrected {
    /// The scaled unknowns and the parameter.
    pub z: Vec<f64>,
    /// The unit tangent of the branch, along the normal.
    pub tangent: Vec<f64>,
    /// The steps of Newton's iteration.
    pub steps: usize,
    /// The scaled residual.
    pub residual: f64,
    /// The equations there.
    pub equations: SequenceEquations,
}

/// Why there is no solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NotCorrected<E> {
    /// A flight cannot be computed, or its force raises.
    Flight(Failure<E>),
    /// The iteration did not converge.
    Diverged,
}

/// Seeks the solution in a hyperplane. `equations` evaluates them at unknowns and a parameter, on
/// request with the derivative with respect to the parameter, period included.
///
/// # Errors
/// An error of the equations; a singular system; too many evaluations.
pub fn correct<E>(
    plane: Hyperplane<'_>,
    limits: Limits,
    mut equations: impl FnMut(&[f64], f64, bool) -> Result<(SequenceEquations, Vec<f64>), Failure<E>>,
) -> Result<Corrected, NotCorrected<E>> {
    let Hyperplane { guess, normal, scale, sizes } = plane;
    let (n, mut z) = (sizes.len(), guess.to_vec());
    let (mut column, mut before, mut stalled) = (Vec::new(), f64::INFINITY, false);
    for steps in 0..limits.evaluations {
        let full: Vec<f64> = z.iter().zip(scale).map(|(z, scale)| z * scale).collect();
        let mut at =
            |derives| equations(&full[..n], full[n], derives).map_err(NotCorrected::Flight);
        let (found, derived) = at(column.is_empty())?;
        let scaled = || found.residual.iter().zip(sizes).map(|(it, size)| it / size);
        let residual = scaled().fold(0.0, |most: f64, it| most.max(it.abs()));
        if !scaled().all(f64::is_finite) {
            return Err(NotCorrected::Diverged);
        }
        if column.is_empty() {
            column = derived;
        } else if limits.stale * before < residual {
            // only the convergence depends on it
            column = at(true)?.1;
        }
        let factors = bordered(plane, &found, &column).ok_or(NotCorrected::Diverged)?;
        // beside a grazing one step may stall before the next ones converge
        let stalls = residual >= 0.5 * before;
        if residual <= limits.tolerance || (stalls && stalled && residual <= limits.enough) {
            let tangent = tangent(&factors, n).ok_or(NotCorrected::Diverged)?;
            return Ok(Corrected { z, tangent, steps, residual, equations: found });
        }
        (before, stalled) = (residual, stalls);
        let away = z.iter().zip(guess).zip(normal).map(|((z, guess), by)| by * (z - guess)).sum();
        let right: Vec<f64> = scaled().chain([away]).collect();
        let step = factors.solve(&right);
        z.iter_mut().zip(step).for_each(|(z, step)| *z -= step);
        // false for NaN, too
        if !z.iter().zip(guess).all(|(z, guess)| (z - guess).abs() <= 1.0) {
            return Err(NotCorrected::Diverged);
        }
    }
    Err(NotCorrected::Diverged)
}

/// The derivative of the scaled equations, with the normal as its last row; `None` if singular.
fn bordered(
    Hyperplane { normal, scale, sizes, .. }: Hyperplane<'_>,
    found: &SequenceEquations,
    column: &[f64],
) -> Option<Elimination> {
    let n = sizes.len();
    let mut matrix = Vec::with_capacity((n + 1) * (n + 1));
    for (i, size) in sizes.iter().enumerate() {
        let row = found.own[i * n..][..n].iter().zip(&found.before[i * n..][..n]);
        let whole = row.map(|(own, before)| own + before).chain([column[i]]);
        matrix.extend(whole.zip(scale).map(|(by, scale)| by * scale / size));
    }
    matrix.extend(normal);
    let factors = Elimination::new(matrix, n + 1, 0.0);
    (factors.rank() == n + 1).then_some(factors)
}

/// The unit vector along which the equations do not change; `None` if not finite.
fn tangent(bordered: &Elimination, n: usize) -> Option<Vec<f64>> {
    let mut right = vec![0.0; n];
    right.push(1.0);
    let mut along = bordered.solve(&right);
    let length = along.iter().map(|it| it * it).sum::<f64>().sqrt();
    along.iter_mut().for_each(|it| *it /= length);
    along.iter().all(|it| it.is_finite()).then_some(along)
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::super::{sequence_equations, ImpactSequence, Wrt};
    use super::*;
    use crate::{LinearForce, Status, SwitchedRk};

    const E: f64 = 0.5;
    const LIMITS: Limits = Limits { evaluations: 10, tolerance: 1e-12, enough: 1e-10, stale: 0.05 };

    /// A ball on a table that vibrates with the amplitude `a` and frequency 1.
    fn table(
        y: &[f64],
        a: f64,
        derives: bool,
    ) -> Result<(SequenceEquations, Vec<f64>), Failure<Infallible>> {
        let mut force = LinearForce {
            stiffness: 0.0,
            damping: 0.0,
            gravity: 1.0,
            amplitude: a,
            omega: 1.0,
            phase: -std::f64::consts::FRAC_PI_2,
        };
        let length = 2.0 * std::f64::consts::PI;
        let sequence = ImpactSequence { unknowns: y, last: [y[0], y[1]], length, e: E };
        let wrt = derives.then_some((Wrt::Parameter(3), a));
        let found = sequence_equations(&mut force, sequence, SwitchedRk::default(), wrt)?;
        let column = found.by_parameter(0.0);
        Ok((found, column))
    }

    /// Impulse, time and amplitude of one impact a period, by its time.
    fn exact(t: f64) -> [f64; 3] {
        // x'' = a sin t - 1 from (t, 0, u) to (t + 2 pi, 0, -u/e):
        //   x: (u + a cos t) 2 pi - 2 pi^2 = 0,    x': u - 2 pi = -u/e
        let pi = std::f64::consts::PI;
        let u = 2.0 * pi * E / (1.0 + E);
        [(1.0 + E) / E * u, t, (pi - u) / t.cos()]
    }

    #[test]
    fn a_branch_of_closed_form_is_found_with_its_tangent() {
        let (scale, sizes) = ([6.0, 6.0, 0.6], [3.0, 2.0]);
        for t in [0.3, 0.6, -0.4] {
            let scaled = |y: [f64; 3]| [0, 1, 2].map(|i| y[i] / scale[i]);
            let guess = scaled([exact(t)[0] + 0.2, t + 0.05, exact(t)[2] - 0.05]);
            let normal = [0.0, 0.6, 0.8];
            let plane = Hyperplane { guess: &guess, normal: &normal, scale: &scale, sizes: &sizes };
            let it = correct(plane, LIMITS, table).unwrap();
            let found = exact(it.z[1] * scale[1]);
            for (z, exact) in it.z.iter().zip(scaled(found)) {
                assert!((z - exact).abs() < 1e-11, "{it:?}");
            }
            let apart: f64 = (0..3).map(|i| normal[i] * (it.z[i] - guess[i])).sum();
            assert!(apart.abs() < 1e-14 && it.residual <= 1e-12 && it.steps > 1, "{it:?}");
            // da/dt = a tan t, of a derivative by the parameter at the guess
            let along = [0.0, 1.0 / scale[1], found[2] * found[1].tan() / scale[2]];
            let length = along.iter().map(|it| it * it).sum::<f64>().sqrt();
            let side = (normal[1] * along[1] + normal[2] * along[2]).signum();
            assert_eq!(it.tangent.len(), 3);
            for (tangent, along) in it.tangent.iter().zip(along) {
                assert!((tangent - side * along / length).abs() < 0.05, "{it:?}");
            }
        }
    }

    /// Corrects by residuals that come one after the other; the steps, and whether each evaluation
    /// asked for the derivative.
    fn scripted(residuals: &[f64], limits: Limits) -> (Option<usize>, Vec<bool>) {
        let (mut count, mut asked) = (0, Vec::new());
        let plane = Hyperplane {
            guess: &[0.0; 3],
            normal: &[0.0, 0.0, 1.0],
            scale: &[1.0; 3],
            sizes: &[1.0; 2],
        };
        let found = correct(plane, limits, |_, _, derives| {
            count += usize::from(!derives || asked.is_empty());
            asked.push(derives);
            let found = SequenceEquations {
                flights: Vec::new(),
                residual: vec![residuals[count - 1], 0.0],
                own: vec![1.0, 0.0, 0.0, 1.0],
                before: vec![0.0; 4],
                by: Vec::new(),
            };
            Ok::<_, Failure<Infallible>>((found, vec![0.0; 2]))
        });
        (found.ok().map(|it| it.steps), asked)
    }

    #[test]
    fn the_derivative_by_the_parameter_is_renewed_where_the_residual_falls_slowly() {
        let limits = Limits { stale: 0.3, ..LIMITS };
        let slow = [true, false, true, false];
        assert_eq!(scripted(&[0.1, 0.05, 1e-13], limits), (Some(2), slow.to_vec()));
        let fast = [true, false, false];
        assert_eq!(scripted(&[0.1, 0.02, 1e-13], limits), (Some(2), fast.to_vec()));
    }

    #[test]
    fn what_rounding_allows_is_enough_after_two_steps_that_stall() {
        let steps = |residuals: &[f64]| scripted(residuals, LIMITS).0;
        assert_eq!(steps(&[4e-11, 3e-11, 2e-11]), Some(2));
        assert_eq!(steps(&[4e-11, 1e-11, 8e-12, 7e-12]), Some(3));
        // not yet, or never
        assert_eq!(steps(&[4e-9, 3e-9, 2e-9, 1.5e-9, 1e-12]), Some(4));
        assert_eq!(steps(&[3e-9; 10]), None);
    }

    #[test]
    fn what_cannot_be_corrected_is_told() {
        let (scale, sizes, guess) = ([6.0, 6.0, 0.6], [3.0, 2.0], [1.1, 0.1, 2.0]);
        let plane = |normal| Hyperplane { guess: &guess, normal, scale: &scale, sizes: &sizes };
        let few = Limits { evaluations: 2, ..LIMITS };
        let diverged = Err(NotCorrected::Diverged);
        assert_eq!(correct(plane(&[0.0, 0.0, 1.0]), few, table), diverged);
        assert_eq!(correct(plane(&[0.0; 3]), LIMITS, table), diverged);
        let nan = |y: &[f64], p: f64, derives: bool| {
            let (mut found, column) = table(y, p, derives)?;
            found.residual[0] = f64::NAN;
            Ok((found, column))
        };
        assert_eq!(correct(plane(&[0.0, 0.0, 1.0]), LIMITS, nan), diverged);
        let fails = |_: &[f64], _: f64, _: bool| {
            Err::<_, Failure<Infallible>>(Failure::Status(Status::StepBudget))
        };
        let failed = NotCorrected::Flight(Failure::Status(Status::StepBudget));
        assert_eq!(correct(plane(&[0.0, 0.0, 1.0]), LIMITS, fails), Err(failed));
    }
}
