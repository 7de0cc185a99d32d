//! When a stage no longer makes progress.

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

    /// True where the merit has not fallen over the last iterations: a time to ask whether
    /// rounding forbids it.
    pub(super) fn is_slow(&self) -> bool {
        self.since >= 3
    }
}
