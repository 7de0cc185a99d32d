//! Options and results of a run.

use crate::piecewise::running::Kick;
use crate::record::trajectory::Trajectory;
use crate::record::user_events::{LocatedEvent, UserEvent};
use crate::switched::mode::Counts;
use crate::switched::path::DensePath;
use crate::switched::samples::Samples;
use crate::zeno::arc::Bounce;
use crate::zeno::tail::Tail;
use crate::{Impact, PathPoint, Physical};

/// Output options of a run, in addition to impacts, Zeno points and lift-offs.
pub struct Output<'a, E> {
    /// Times of the samples, increasing and within the span. `None`: a sample at the start, at
    /// the end of each step, at each impact (the state after it, with `x = 0`), Zeno point and
    /// lift-off, and at the end.
    pub t_eval: Option<&'a [f64]>,
    /// Times at which the force is not smooth (s), increasing: steps end there, the force is
    /// evaluated on either side but never across, and impact sequences and the search at rest
    /// restart.
    pub tstops: &'a [f64],
    /// Whether to keep the motion as a function of time.
    pub dense: bool,
    /// Whether, where that is kept and no times are given, there are samples between the steps,
    /// before impacts and at apexes too, so that lines through them draw the motion.
    pub drawn: bool,
    /// Whether the samples stay in the recorded form, [`SwitchedRun::rows`]: a long run that is
    /// stopped returns immediately; its columns are made at first access.
    pub in_rows: bool,
    /// The user's events.
    pub events: Vec<UserEvent<'a, E>>,
    /// Kicks at some of the declared times: a velocity into the wall is an immediate impact.
    pub kicks: Option<Kick<'a, E, PathPoint>>,
}

impl<E> Default for Output<'_, E> {
    fn default() -> Self {
        let (dense, drawn, in_rows) = (false, false, false);
        Self { t_eval: None, tstops: &[], dense, drawn, in_rows, events: Vec::new(), kicks: None }
    }
}

/// A run of the switched method.
#[derive(Clone, Debug, PartialEq)]
pub struct SwitchedRun<E> {
    /// Samples, impacts, Zeno points, lift-offs, status.
    pub trajectory: Trajectory,
    /// The error that the force, an event or the monitor raised (the status is
    /// [`crate::Status::Raised`] then).
    pub raised: Option<E>,
    /// The samples, instead of the columns of the trajectory, if [`Output::in_rows`] asked for them.
    pub rows: Option<Samples>,
    /// The motion as a function of time, if [`Output::dense`] asked for it.
    pub path: Option<DensePath>,
    /// The arcs that jumps to rest skipped, in order.
    pub tails: Vec<Tail>,
    /// For each event of the user what happened, in order.
    pub hits: Vec<Vec<LocatedEvent>>,
    /// How much work was done.
    pub counts: Counts,
    /// The time and the state up to which the motion is known, whatever is sampled.
    pub end: (f64, Physical),
}

impl<E> SwitchedRun<E> {
    /// All impacts with a speed of at least `speed` (m/s) after them, those included that a jump
    /// to rest skipped, in order; at most `at_most` of each tail.
    ///
    /// ```
    /// use zivi::{
    ///     simulate_switched_rk, ConstantForce, Output, Physical, Restitution, Silent, SwitchedRk,
    /// };
    ///
    /// let (ball, restitution) = (Physical { x: 1.0, xdot: 0.0 }, Restitution::from_e(0.5)?);
    /// let run = simulate_switched_rk(
    ///     SwitchedRk::default(), restitution, &mut ConstantForce(-2.0), (0.0, 4.0), ball,
    ///     Output::default(), &mut Silent,
    /// )?;
    /// assert_eq!(run.trajectory.events.impacts.len(), 3);
    /// // 2 m/s at the first impact, 2^-20 m/s after the 21st
    /// assert_eq!(run.impacts_down_to(0.99 * 0.5f64.powi(20), 1000).len(), 21);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn impacts_down_to(&self, speed: f64, at_most: usize) -> Vec<Impact> {
        let fast = |impact: &Impact| impact.xdot_after >= speed;
        let mut all = Vec::new();
        let mut tails = self.tails.iter().peekable();
        for impact in &self.trajectory.events.impacts {
            while let Some(tail) = tails.next_if(|tail| tail.start() < impact.t) {
                all.extend(tail.impacts_down_to(speed, at_most));
            }
            all.extend(Some(*impact).filter(fast));
        }
        all.extend(tails.flat_map(|tail| tail.impacts_down_to(speed, at_most)));
        all
    }
}

// Impacts that go on without an accumulation.

/// Impacts below the tolerance in short sequence at a wall without acceleration towards it: if the
/// acceleration vanishes only at the wall, they accumulate, but not geometrically, and errors of
/// the size of the tolerance sustain them indefinitely.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct StallingImpacts {
    last: f64,
    /// The longest flight so far (s).
    longest: f64,
    count: u32,
}

impl StallingImpacts {
    /// Impacts after which it is called that.
    const MOST: u32 = 50;
    /// Ratio of a short flight to the longest.
    const SHORT: f64 = 0.01;

    pub(super) fn starting_at(t: f64) -> Self {
        Self { last: t, ..Self::default() }
    }

    /// Takes the next impact; whether it is one too many.
    pub(super) fn goes_on(&mut self, bounce: Bounce, speed: f64) -> bool {
        let flight = bounce.t - self.last;
        (self.last, self.longest) = (bounce.t, self.longest.max(flight));
        let stalls = bounce.g <= 0.0 && bounce.u <= speed && flight < Self::SHORT * self.longest;
        self.count = if stalls { self.count + 1 } else { 0 };
        self.count > Self::MOST
    }
}
