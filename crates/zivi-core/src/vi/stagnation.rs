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

#[cfg(test)]
mod tests {
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
