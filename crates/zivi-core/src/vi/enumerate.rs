//! Small problems by brute force: every pattern of active bounds, Newton on the rows between.
//!
//! A pattern holds each component at its lower bound, at its upper bound, or inside; inside,
//! `F_i = 0`. Whatever Newton finds must pass the natural residual of the whole problem.

use super::dense;
use super::iterate::{Iterate, Outcome};

/// Most unknowns for which patterns are enumerated: `3^6 = 729` of them.
pub(super) const MOST: usize = 6;
/// Newton iterations for one pattern.
const ITERATIONS: usize = 40;
/// Halvings of one Newton step.
const HALVINGS: usize = 10;
/// Beyond this an iterate is on its way to infinity.
const FAR: f64 = 1e15;

/// Where a component is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    Inside,
    Lower,
    Upper,
}

/// Tries all patterns from the starting point and from two of the restarts; true when the iterate
/// is a solution.
pub(super) fn enumerate(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    for scattered in [None, Some(3), Some(4)] {
        dense::copy(at.work.trial, at.work.start);
        if let Some(k) = scattered {
            at.scatter(k);
        }
        dense::copy(at.work.centre, at.work.trial);
        if all_patterns(at)? {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Tries all patterns from `work.centre`.
fn all_patterns(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    let mut pattern = [Place::Inside; MOST];
    loop {
        if is_admissible(at, &pattern) && newton_on_pattern(at, &pattern)? {
            return Ok(true);
        }
        if at.out_of_iterations() || !advance(&mut pattern, at.n()) {
            return Ok(false);
        }
    }
}

/// The next pattern, counting in base three; false after the last.
fn advance(pattern: &mut [Place; MOST], n: usize) -> bool {
    for place in pattern.iter_mut().take(n) {
        *place = match *place {
            Place::Inside => Place::Lower,
            Place::Lower => Place::Upper,
            Place::Upper => Place::Inside,
        };
        if *place != Place::Inside {
            return true;
        }
    }
    false
}

/// No component at an infinite bound; a fixed one at its bound, once.
fn is_admissible(at: &Iterate<'_, '_>, pattern: &[Place; MOST]) -> bool {
    at.lower.iter().zip(at.upper).zip(pattern).all(|((&lower, &upper), place)| match place {
        Place::Inside => lower < upper,
        Place::Lower => lower.is_finite(),
        Place::Upper => upper.is_finite() && lower < upper,
    })
}

/// Damped Newton on the rows inside; true when its end solves the whole problem.
fn newton_on_pattern(at: &mut Iterate<'_, '_>, pattern: &[Place; MOST]) -> Outcome<bool> {
    dense::copy(at.work.trial, at.work.centre);
    for (i, place) in pattern.iter().enumerate().take(at.n()) {
        match place {
            Place::Lower => dense::put(at.work.trial, i, dense::at(at.lower, i)),
            Place::Upper => dense::put(at.work.trial, i, dense::at(at.upper, i)),
            Place::Inside => {}
        }
    }
    if !at.evaluate_trial()? {
        return Ok(false);
    }
    let mut size = inside_norm(at, pattern);
    for _ in 0..ITERATIONS {
        if trial_is_solution(at)? {
            return Ok(true);
        }
        if at.out_of_iterations() {
            return Ok(false);
        }
        at.counts.iterations += 1;
        if !inside_direction(at, pattern)? {
            return Ok(false);
        }
        match damped_step(at, pattern, size)? {
            Some(smaller) => size = smaller,
            None => return trial_is_solution(at),
        }
        at.report()?;
        if dense::norm(at.work.trial) > FAR {
            return Ok(false);
        }
    }
    trial_is_solution(at)
}

/// True, and the iterate moved there, when the evaluated trial solves the problem.
fn trial_is_solution(at: &mut Iterate<'_, '_>) -> Outcome<bool> {
    let work = &*at.work;
    let residual = super::natural_residual(work.trial, work.trial_f, at.lower, at.upper);
    if residual.is_nan() || residual > at.tol || dense::norm(work.trial) > FAR {
        return Ok(false);
    }
    dense::project(at.work.trial, at.lower, at.upper);
    let merit = at.merit_of_trial()?;
    if !merit.is_finite() {
        return Ok(false);
    }
    at.accept(merit);
    Ok(at.is_solved())
}

/// `max |F_i|` over the rows inside.
fn inside_norm(at: &Iterate<'_, '_>, pattern: &[Place; MOST]) -> f64 {
    at.work.trial_f.iter().zip(pattern).fold(0.0, |size, (f, place)| match place {
        Place::Inside => f64::max(size, f.abs()),
        _ => size,
    })
}

/// `work.step <- -J_II^-1 F_I`, zero on the rows held; false where `J_II` is singular.
fn inside_direction(at: &mut Iterate<'_, '_>, pattern: &[Place; MOST]) -> Outcome<bool> {
    let n = at.n();
    if !at.jacobian_at_trial()? {
        return Ok(false);
    }
    let work = &mut *at.work;
    for (i, row) in work.pivotal.inverse.chunks_exact_mut(n).enumerate() {
        let inside = pattern.get(i) == Some(&Place::Inside);
        row.fill(0.0);
        if inside {
            dense::copy(row, dense::row(work.jacobian, n, i));
            row.iter_mut().zip(pattern).for_each(|(entry, place)| {
                if *place != Place::Inside {
                    *entry = 0.0;
                }
            });
        } else {
            dense::put(row, i, 1.0);
        }
        dense::put(work.step, i, if inside { -dense::at(work.trial_f, i) } else { 0.0 });
    }
    let regular = at.problem.factor(work.pivotal.inverse, n, work.pivotal.members)? > 0.0;
    if regular {
        dense::solve(work.pivotal.inverse, n, work.pivotal.members, work.step);
    }
    Ok(regular && dense::is_finite(work.step))
}

/// Halves the step until the rows inside shrink; `None`, and back where it was, if they do not.
fn damped_step(
    at: &mut Iterate<'_, '_>,
    pattern: &[Place; MOST],
    size: f64,
) -> Outcome<Option<f64>> {
    dense::copy(at.work.point, at.work.trial);
    let mut t = 1.0;
    for _ in 0..HALVINGS {
        dense::copy(at.work.trial, at.work.point);
        dense::axpy(at.work.trial, t, at.work.step);
        if at.evaluate_trial()? {
            let smaller = inside_norm(at, pattern);
            if smaller < size {
                return Ok(Some(smaller));
            }
        }
        t *= 0.5;
    }
    dense::copy(at.work.trial, at.work.point);
    at.evaluate_trial()?;
    Ok(None)
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;

    #[test]
    fn all_patterns_come_once() {
        for n in 0..=4 {
            let (mut pattern, mut seen) = ([Place::Inside; MOST], [0; 81]);
            loop {
                let number = pattern.iter().take(n).fold(0, |number, place| {
                    let digit = match place {
                        Place::Inside => 0,
                        Place::Lower => 1,
                        Place::Upper => 2,
                    };
                    3 * number + digit
                });
                seen[number] += 1;
                if !advance(&mut pattern, n) {
                    break;
                }
            }
            let all = 3_usize.pow(n as u32);
            assert!(seen[..all].iter().all(|&count| count == 1), "{n} {seen:?}");
        }
    }
}
