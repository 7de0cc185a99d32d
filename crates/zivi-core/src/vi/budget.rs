//! The budget of pivots, and the share of it that each stage may use.

use super::settings::Stage;

/// Pivots that may be spent. Other work counts as the pivots it costs: a column that enters a
/// starting basis is one, a factorisation of order `n` (`n^3/3` against `2 n^2` operations) is
/// `n/6`.
#[derive(Debug)]
pub(super) struct Budget {
    total: usize,
    spent: usize,
    /// What may be spent by the end of the stage.
    stage_end: usize,
}

impl Budget {
    pub(super) fn new(total: usize) -> Self {
        Self { total, spent: 0, stage_end: total }
    }

    /// A stage begins: of what is left it may use `weight / weights`, with `weights` the sum over
    /// it and the stages behind it. What it leaves goes to them.
    pub(super) fn open_stage(&mut self, weight: usize, weights: usize) {
        let left = self.total.saturating_sub(self.spent);
        let share = (left as f64 * weight as f64 / weights.max(weight) as f64) as usize;
        self.stage_end = self.spent.saturating_add(share.clamp(usize::from(left > 0), left));
    }

    pub(super) fn spend(&mut self, pivots: usize) {
        self.spent = self.spent.saturating_add(pivots);
    }

    pub(super) fn spent(&self) -> usize {
        self.spent
    }

    pub(super) fn spend_on_factors(&mut self, n: usize) {
        self.spend(n.div_ceil(6));
    }

    /// Pivots left to the stage.
    pub(super) fn left(&self) -> usize {
        self.stage_end.saturating_sub(self.spent)
    }

    /// Pivots left to it and all stages behind it.
    pub(super) fn left_to_all(&self) -> usize {
        self.total.saturating_sub(self.spent)
    }

    pub(super) fn is_spent(&self) -> bool {
        self.spent >= self.stage_end
    }

    pub(super) fn is_spent_by_all(&self) -> bool {
        self.spent >= self.total
    }
}

/// The weight of a stage's share. The first has the best chance; a restart is one of many.
pub(super) fn weight(stage: Stage) -> usize {
    match stage {
        Stage::JosephyNewton => 4,
        Stage::Smoothing | Stage::Semismooth => 3,
        Stage::Proximal => 2,
        Stage::Restart(_) => 1,
        Stage::Enumeration => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stage_gets_its_share_of_what_is_left() {
        let mut budget = Budget::new(100);
        budget.open_stage(1, 4);
        assert_eq!(budget.left(), 25);
        budget.spend(40); // a pivot or two more than allowed
        assert!(budget.is_spent() && !budget.is_spent_by_all());
        budget.open_stage(1, 3);
        assert_eq!(budget.left(), 20);
        budget.spend_on_factors(13);
        assert_eq!((budget.left(), budget.left_to_all()), (17, 57));
        budget.open_stage(1, 1);
        assert_eq!(budget.left(), 57);
        budget.spend(57);
        assert!(budget.is_spent_by_all());
        budget.open_stage(1, 1);
        assert_eq!(budget.left(), 0);
    }

    #[test]
    fn no_stage_starves_while_something_is_left() {
        let mut budget = Budget::new(3);
        budget.open_stage(1, 17);
        assert_eq!(budget.left(), 1);
        let mut unlimited = Budget::new(usize::MAX);
        unlimited.open_stage(4, 17);
        assert!(unlimited.left() > 1 << 60);
    }
}
