//! Watching a run from outside: progress, and the wish to stop.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use super::dense_step::DenseStep;
use crate::{Keep, Status};

/// Something that is told how far a run is and may end it.
pub trait Monitor<E> {
    /// Called about 30 times a second with the number of steps done, out of `of`.
    ///
    /// # Errors
    /// An error ends the run; what was computed is kept.
    fn poll(&mut self, done: usize, of: usize) -> Result<(), E>;

    /// Which samples a method of fixed steps shall keep.
    fn keep(&self) -> Keep {
        Keep::All
    }

    /// Whether a method of fixed steps shall tell each of its steps; asked often.
    fn follows(&self) -> bool {
        false
    }

    /// Called after each step of a method of fixed steps if [`Monitor::follows`] says so. `Break`
    /// ends the run with that status, after the step.
    ///
    /// # Errors
    /// An error ends the run; what was computed is kept.
    fn follow(&mut self, _step: &DenseStep) -> Result<ControlFlow<Status>, E> {
        Ok(ControlFlow::Continue(()))
    }

    /// Called once with the address and the length of the record's memory before it is touched: a
    /// chance to tell the operating system how it will be used.
    fn record_allocated(&mut self, _start: *const f64, _len: usize) {}
}

/// Nobody watches.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Monitor<std::convert::Infallible> for Silent {
    fn poll(&mut self, _: usize, _: usize) -> Result<(), std::convert::Infallible> {
        Ok(())
    }
}

/// Chooses how many steps pass between polls, so that the time between polls stays near
/// [`PollInterval::PERIOD`] whatever a step costs, and a step pays nothing for being watched.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PollInterval {
    chunk: usize,
    since: Instant,
}

impl PollInterval {
    const PERIOD: Duration = Duration::from_millis(30);

    pub(crate) fn start() -> Self {
        Self { chunk: 16, since: Instant::now() }
    }

    /// Steps until the next poll.
    pub(crate) fn chunk(&self) -> usize {
        self.chunk
    }

    /// Adjusts the chunk to the time that the last one took.
    pub(crate) fn adjust(&mut self) {
        let took = self.since.elapsed();
        if took < Self::PERIOD / 2 {
            self.chunk = (self.chunk * 2).min(1 << 22);
        } else if took > Self::PERIOD * 2 {
            self.chunk = (self.chunk / 4).max(1);
        }
        self.since = Instant::now();
    }
}
