//! A scalar root search that asks for one trial at a time: secant steps, held inside a range and,
//! once the sign has changed, inside a bracket that is halved where the secant is slow.

/// Slope of the mismatch where the end of the step does not depend on the force (`h -> 0`).
pub(crate) const DEFAULT_SLOPE: f64 = -1.0;
/// From this trial on every second one halves the bracket.
const SLOW: usize = 6;
/// From this trial on a search without a bracket looks for one by growing steps.
const BLIND: usize = 3;
/// A trial this many times larger than the first ones has run away.
const RUNAWAY: f64 = 1e9;

/// The state of one search.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Search {
    trial: f64,
    slope: f64,
    previous: Option<(f64, f64)>,
    range: (f64, f64),
    positive: Option<f64>,
    negative: Option<f64>,
    largest: f64,
    trials: usize,
    cap: usize,
    open: bool,
}

impl Search {
    /// A search from `first` with the slope of the last one.
    #[inline]
    pub(crate) fn from(first: f64, slope: f64, cap: usize) -> Self {
        Self {
            trial: first,
            slope,
            previous: None,
            range: (f64::NEG_INFINITY, f64::INFINITY),
            positive: None,
            negative: None,
            largest: f64::INFINITY,
            trials: 0,
            cap,
            open: true,
        }
    }

    /// A search inside `range` from the point there that is nearest to `first`.
    pub(crate) fn within(range: (f64, f64), first: f64, cap: usize) -> Self {
        let nearest = first.max(range.0).min(range.1);
        Self { range, ..Self::from(nearest, DEFAULT_SLOPE, cap) }
    }

    /// The trial after the first one of [`Search::from`], if that is a plain one.
    #[inline(always)]
    pub(crate) fn second(first: f64, mismatch: f64, slope: f64) -> Option<f64> {
        let next = first - mismatch / slope;
        // false for NaN
        let usual = next != first && next.abs() <= RUNAWAY * (first.abs() + mismatch.abs());
        usual.then_some(next)
    }

    /// The next trial, or none when nothing is left to try.
    #[inline]
    pub(crate) fn trial(&mut self) -> Option<f64> {
        self.trials += 1;
        (self.open && self.trials <= self.cap).then_some(self.trial)
    }

    /// Number of trials asked for.
    pub(crate) fn trials(&self) -> usize {
        self.trials
    }

    /// The slope by the last secant.
    pub(crate) fn slope(&self) -> f64 {
        self.slope
    }

    /// Takes the mismatch of the last trial and chooses the next.
    #[inline]
    pub(crate) fn learn(&mut self, mismatch: f64) {
        let trial = self.trial;
        let end = if mismatch > 0.0 { &mut self.positive } else { &mut self.negative };
        *end = Some(trial);
        match self.previous {
            Some((other, its)) => self.update_slope((mismatch - its) / (trial - other)),
            None => self.largest = RUNAWAY * (trial.abs() + mismatch.abs()),
        }
        self.previous = Some((trial, mismatch));
        let mut next = self.inside(trial - mismatch / self.slope);
        if !self.is_bracketed() && (self.trials > BLIND || next == trial) {
            // a force that stays bounded while the trial grows: the root lies where the mismatch
            // points, however the secant turns
            let growth = 1_u32 << (2 * self.trials.saturating_sub(BLIND)).min(30);
            next = self.inside(trial + mismatch * f64::from(growth));
        }
        // standing still: at an end of the range, or no number left in the bracket
        self.open = next != trial && next.abs() <= self.largest;
        self.trial = next;
    }

    /// A secant that is nearly level leads nowhere; then the default is tried.
    fn update_slope(&mut self, secant: f64) {
        let usable = secant.is_finite() && secant.abs() > 1e-3;
        self.slope = if usable { secant } else { DEFAULT_SLOPE };
    }

    /// The point nearest to the proposal that the range and the bracket allow.
    fn inside(&self, proposal: f64) -> f64 {
        self.inside_bracket(proposal.max(self.range.0).min(self.range.1))
    }

    fn is_bracketed(&self) -> bool {
        self.positive.is_some() && self.negative.is_some()
    }

    fn inside_bracket(&self, proposal: f64) -> f64 {
        let (Some(a), Some(b)) = (self.positive, self.negative) else {
            return proposal;
        };
        let (low, high) = if a < b { (a, b) } else { (b, a) };
        let slow = self.trials > SLOW && self.trials.is_multiple_of(2);
        if proposal > low && proposal < high && !slow {
            proposal
        } else {
            0.5 * (low + high)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn root(mismatch: impl Fn(f64) -> f64, mut search: Search) -> (Option<f64>, usize) {
        while let Some(trial) = search.trial() {
            if mismatch(trial).abs() <= 1e-12 {
                return (Some(trial), search.trials());
            }
            search.learn(mismatch(trial));
        }
        (None, search.trials())
    }

    #[test]
    fn an_affine_mismatch_takes_three_trials_then_two_with_its_slope() {
        let mismatch = |f: f64| 3.0 - 1.5 * f;
        assert_eq!(root(mismatch, Search::from(0.0, DEFAULT_SLOPE, 20)).1, 3);
        assert_eq!(root(mismatch, Search::from(0.0, -1.5, 20)).1, 2);
    }

    #[test]
    fn a_stiff_and_a_steep_mismatch_are_found_by_bracketing() {
        for mismatch in [
            (|f: f64| (-1e6 * f).min(1e9) - f + 3.0) as fn(f64) -> f64,
            |f| -1e3 * f * f * f - f - 7.0,
            |f| -100.0 * (f / 1e-3).tanh() - f + 10.0,
        ] {
            assert!(root(mismatch, Search::from(50.0, DEFAULT_SLOPE, 200)).0.is_some());
        }
    }

    #[test]
    fn it_ends_when_there_is_no_root() {
        let jump = |f: f64| if f < 1.0 { 2.0 } else { -2.0 };
        assert_eq!(root(jump, Search::from(0.0, DEFAULT_SLOPE, 1000)).0, None);
        let away = |f: f64| 1.0 + f * f;
        let (found, trials) = root(away, Search::from(0.0, DEFAULT_SLOPE, 1000));
        assert!(found.is_none() && trials <= 1001);
    }

    #[test]
    fn it_never_leaves_its_range() {
        let mut search = Search::within((1.0, 2.0), 5.0, 20);
        while let Some(trial) = search.trial() {
            assert!((1.0..=2.0).contains(&trial));
            search.learn(10.0 - trial); // the root lies outside
        }
        assert!(search.trials() < 20);
    }
}
