//! Semismooth Newton on the Fischer-Burmeister function, with the projected gradient behind it.
//!
//! ```text
//! (H'H + lambda |H|^2 I) d = -H' Phi     H an element of the generalised Jacobian of Phi
//! z <- P(z + t d),   theta falling
//! ```
//!
//! De Luca, Facchinei & Kanzow, *Math. Program.* 75 (1996) 407-439, on the box.

use super::dense;
use super::iterate::{Iterate, Outcome};
use super::stagnation::Stagnation;
use super::status::Status;

/// Levenberg-Marquardt weights, tried in turn; 0 is the Newton step itself.
const WEIGHTS: [f64; 4] = [0.0, 1e-8, 1e-4, 1e-1];
/// Sufficient decrease of the merit.
const ARMIJO: f64 = 1e-4;
/// Halvings of a semismooth step and of a gradient step.
const HALVINGS: usize = 12;
const GRADIENT_HALVINGS: usize = 40;

/// Stage S1: monotone semismooth Newton from where [`Iterate::begin`] has left the iterate.
pub(super) fn semismooth_newton(at: &mut Iterate<'_, '_>) -> Outcome<Status> {
    let mut progress = Stagnation::new(at.merit);
    for iteration in 0..at.settings.stage_iterations {
        if at.is_solved() {
            return Ok(Status::Solved);
        }
        if at.out_of_iterations() {
            return Ok(Status::IterationLimit);
        }
        if at.budget.is_spent() {
            return Ok(Status::PivotLimit);
        }
        at.counts.iterations += 1;
        if iteration > 0 && !at.linearise()? {
            return Ok(Status::DomainError);
        }
        if !step(at)? {
            return Ok(at.why_stuck());
        }
        at.report()?;
        if at.has_stalled(&mut progress) {
            return Ok(Status::Stalled);
        }
    }
    Ok(if at.is_solved() { Status::Solved } else { Status::IterationLimit })
}

/// One step that lowers the merit; false where none was found.
pub(super) fn step(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    for weight in WEIGHTS {
        if at.budget.is_spent() {
            return Ok(false);
        }
        if direction(at, weight)? && projected_search(at, HALVINGS)? {
            at.counts.semismooth_steps += 1;
            return Ok(true);
        }
    }
    let slope = dense::dot(at.work.gradient, at.work.gradient);
    if slope <= 0.0 || !slope.is_finite() {
        return Ok(false);
    }
    // the length at which the linear model of theta reaches zero
    let length = 2.0 * at.merit / slope;
    for (d, g) in at.work.step.iter_mut().zip(at.work.gradient.iter()) {
        *d = -length * g;
    }
    let moved = projected_search(at, GRADIENT_HALVINGS)?;
    at.counts.gradient_steps += usize::from(moved);
    Ok(moved)
}

/// `work.step <- d` for one weight; false where the matrix is singular.
fn direction(at: &mut Iterate<'_, '_>, weight: f64) -> Outcome<bool> {
    let n = at.n();
    at.budget.spend_on_factors(n);
    at.problem.poll()?;
    let work = &mut *at.work;
    let matrix = &mut *work.pivotal.inverse;
    if weight == 0.0 {
        for (i, row) in matrix.chunks_exact_mut(n).enumerate() {
            row.fill(0.0);
            dense::put(row, i, dense::at(work.slope_z, i));
            dense::axpy(row, dense::at(work.slope_f, i), dense::row(work.jacobian, n, i));
        }
        work.step.iter_mut().zip(work.phi.iter()).for_each(|(d, phi)| *d = -phi);
    } else {
        let slopes = (&*work.slope_z, &*work.slope_f);
        let poll = &mut || at.problem.poll();
        normal_matrix(matrix, work.jacobian, slopes, work.pivotal.column, poll)?;
        let largest = (0..n).fold(0.0, |size, i| f64::max(size, dense::at(matrix, i * n + i)));
        for i in 0..n {
            let damped = dense::at(matrix, i * n + i) + weight * largest;
            dense::put(matrix, i * n + i, damped);
        }
        work.step.iter_mut().zip(work.gradient.iter()).for_each(|(d, g)| *d = -g);
    }
    if at.problem.factor(matrix, n, work.pivotal.members)? <= 0.0 {
        return Ok(false);
    }
    dense::solve(matrix, n, work.pivotal.members, work.step);
    Ok(dense::is_finite(work.step))
}

/// `H'H`, summed over the rows of `H = diag(slope_z) + diag(slope_f) J`.
fn normal_matrix(
    out: &mut [f64],
    jacobian: &[f64],
    (slope_z, slope_f): (&[f64], &[f64]),
    row: &mut [f64],
    poll: &mut dyn FnMut() -> Outcome<()>,
) -> Outcome<()> {
    let n = row.len();
    out.fill(0.0);
    for (i, entries) in dense::rows(jacobian, n).enumerate() {
        if dense::is_time_to_poll(i, n) {
            poll()?;
        }
        row.fill(0.0);
        dense::put(row, i, dense::at(slope_z, i));
        dense::axpy(row, dense::at(slope_f, i), entries);
        for (out, &h) in out.chunks_exact_mut(n).zip(row.iter()) {
            if h != 0.0 {
                dense::axpy(out, h, row);
            }
        }
    }
    Ok(())
}

/// Halves the step until the merit falls by its share of the slope to the projected point.
fn projected_search(at: &mut Iterate<'_, '_>, halvings: usize) -> Outcome<bool> {
    let mut t = 1.0;
    for _ in 0..halvings {
        let work = &mut *at.work;
        for ((trial, z), d) in work.trial.iter_mut().zip(at.z.iter()).zip(work.step.iter()) {
            *trial = z + t * d;
        }
        dense::project(work.trial, at.lower, at.upper);
        let moves = work.trial.iter().zip(at.z.iter()).map(|(trial, z)| trial - z);
        let slope: f64 = work.gradient.iter().zip(moves).map(|(g, d)| g * d).sum();
        if slope < 0.0 {
            let merit = at.merit_of_trial()?;
            if merit <= at.merit + ARMIJO * slope {
                at.accept(merit);
                return Ok(true);
            }
        }
        t *= 0.5;
    }
    Ok(false)
}
