//! The samples of a run: at the ends of steps, or at given times.

use zivi_core::{sgn, transform, Branch, Restitution};

use std::collections::TryReserveError;

use super::path::DensePath;
use super::plot_samples::{between_steps, Row};
use crate::record::columns::{Columns, QUANTITIES};
use crate::record::reserve::Reserve;
use crate::record::trajectory::SetupError;
use crate::{PathPoint, Physical};

/// The samples of a run.
#[derive(Debug, Default)]
pub(super) struct Samples {
    rows: Vec<Row>,
}

impl Samples {
    /// Makes room for so many more.
    pub(super) fn make_room(
        &mut self,
        count: usize,
        reserve: &mut Reserve,
    ) -> Result<(), TryReserveError> {
        reserve.room(&mut self.rows, count, QUANTITIES * size_of::<f64>())
    }

    /// The time of the last one.
    pub(super) fn last(&self) -> Option<f64> {
        self.rows.last().map(|row| row[0])
    }

    pub(super) fn push(&mut self, t: f64, point: PathPoint) {
        self.rows.push([t, point.x, point.xdot, point.sigma]);
    }

    /// Whether there is memory for so many more, and for the arrays that are made of all of them.
    pub(super) fn fits(&mut self, more: &[Row], reserve: &mut Reserve) -> bool {
        self.make_room(more.len(), reserve).is_ok()
    }

    /// All samples, and those `between` them if they are to draw the motion, both in the order of
    /// time; `advise` learns where their memory is.
    pub(super) fn into_columns(
        self,
        between: Option<&[Row]>,
        restitution: Restitution,
        advise: impl FnOnce(*const f64, usize),
    ) -> Result<Columns, SetupError> {
        let rows = &self.rows;
        let sample = |k: usize| quantities(&rows[k], restitution);
        merged((rows.len(), |k| rows[k][0], sample), between, restitution, advise)
            .map_err(|_| SetupError::Memory(rows.len()))
    }
}

impl DensePath {
    /// The samples at the `steps` of a run, and more between them, so that lines through all of them
    /// draw its motion; `None` without the memory for them. `advise` learns where that is.
    #[must_use]
    pub fn drawn(
        &self,
        steps: [&[f64]; QUANTITIES],
        restitution: Restitution,
        advise: impl FnOnce(*const f64, usize),
    ) -> Option<Columns> {
        let between = between_steps(self).ok()?;
        let count = steps.iter().map(|column| column.len()).min().unwrap_or(0);
        let sample = |k: usize| steps.map(|column| column[k]);
        merged((count, |k| steps[0][k], sample), Some(&between), restitution, advise).ok()
    }
}

/// So many samples, by their times and quantities, and those between them: where there is one
/// already it stays.
fn merged(
    (count, time, sample): (usize, impl Fn(usize) -> f64, impl Fn(usize) -> [f64; QUANTITIES]),
    between: Option<&[Row]>,
    restitution: Restitution,
    advise: impl FnOnce(*const f64, usize),
) -> Result<Columns, TryReserveError> {
    let more = between.unwrap_or_default();
    let mut columns = Columns::with_room((count + more.len()).max(1), advise)?;
    if between.is_none() {
        let mut to = columns.extend(count);
        for k in 0..count {
            for (to, value) in to.iter_mut().zip(sample(k)) {
                to[k] = value;
            }
        }
        return Ok(columns);
    }
    let mut more = more.iter().peekable();
    let mut last = f64::NAN;
    for k in 0..count {
        let t = time(k);
        while let Some(row) = more.next_if(|row| row[0] < t) {
            if row[0] != last {
                columns.push(quantities(row, restitution));
                last = row[0];
            }
        }
        if t != last {
            columns.push(sample(k));
            last = t;
        }
    }
    for row in more {
        if row[0] != last {
            columns.push(quantities(row, restitution));
            last = row[0];
        }
    }
    Ok(columns)
}

/// A sample with `s`, `v` and the multipliers of its branch.
#[inline]
fn quantities(&[t, x, xdot, sigma]: &Row, restitution: Restitution) -> [f64; QUANTITIES] {
    let branch = if sigma > 0.0 { Branch::Positive } else { Branch::Negative };
    let state = Physical { x, xdot };
    let z = transform::lift(state, branch, restitution);
    let lambda_s = if state.is_at_origin() { 0.0 } else { sigma };
    // no negative zeros
    let (s, v) = (z.s + 0.0, z.v + 0.0);
    [t, x, xdot, s, v, lambda_s, sigma * sgn(xdot) + 0.0, f64::NAN]
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;
    use crate::{simulate_switched_rk, LinearForce, Output, Quantity, Silent, SwitchedRk};

    #[test]
    fn what_draws_a_motion_later_is_what_draws_it_at_once() {
        let swing =
            LinearForce { stiffness: 1.0, gravity: 2.0, amplitude: 1.5, omega: 0.7, ..FALL };
        for force in [FALL, swing] {
            let restitution = Restitution::from_e(0.6).unwrap();
            let run = |drawn| {
                let start = Physical { x: 1.0, xdot: 0.5 };
                let output = Output::<Infallible> { dense: true, drawn, ..Output::default() };
                let method = SwitchedRk::default();
                let (mut force, span) = (force, (0.0, 40.0));
                simulate_switched_rk(
                    method,
                    restitution,
                    &mut force,
                    span,
                    start,
                    output,
                    &mut Silent,
                )
                .unwrap()
            };
            let (at_once, steps) = (run(true).trajectory.columns, run(false));
            let known = Quantity::ALL.map(|it| steps.trajectory.columns.of(it));
            let later = steps.path.unwrap().drawn(known, restitution, |_, _| ()).unwrap();
            assert!(later.len() > known[0].len() + 20, "{}", later.len());
            for quantity in Quantity::ALL {
                let bits = |it: &Columns| it.of(quantity).iter().map(|it| it.to_bits()).collect();
                let (all, expected): (Vec<u64>, Vec<u64>) = (bits(&later), bits(&at_once));
                assert_eq!(all, expected, "{quantity:?}");
            }
            let t = later.of(Quantity::T);
            assert!(t.windows(2).all(|pair| pair[0] < pair[1]));
            assert!(known[0].iter().all(|step| t.contains(step)));
        }
    }

    const FALL: LinearForce = LinearForce {
        stiffness: 0.0,
        damping: 0.0,
        gravity: 9.81,
        amplitude: 0.0,
        omega: 0.0,
        phase: 0.0,
    };
}
