//! The times at which samples are wanted.

/// Times at which samples are wanted, one after the other; without them there are samples at the
/// ends of steps.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OutputTimes<'a> {
    /// Increasing.
    times: Option<&'a [f64]>,
    /// How many of them are passed.
    passed: usize,
}

impl<'a> OutputTimes<'a> {
    pub(crate) fn new(times: Option<&'a [f64]>) -> Self {
        Self { times, passed: 0 }
    }

    /// Whether samples are at the ends of steps.
    pub(crate) fn is_by_steps(&self) -> bool {
        self.times.is_none()
    }

    /// The next of the times.
    pub(crate) fn next(&self) -> Option<f64> {
        self.times.and_then(|times| times.get(self.passed).copied())
    }

    /// Passes the next of the times, if it is before `t`.
    pub(crate) fn pass_before(&mut self, t: f64) -> Option<f64> {
        let next = self.next().filter(|&next| next < t)?;
        self.passed += 1;
        Some(next)
    }

    /// Whether there is a sample at the end `t` of a step; passes that time.
    pub(crate) fn pass_at(&mut self, t: f64) -> bool {
        let here = self.next() == Some(t);
        self.passed += usize::from(here);
        self.is_by_steps() || here
    }

    /// Whether a sample is missing where the run ends, after the last one at `last`.
    pub(crate) fn is_missing_at(&self, t: f64, last: Option<f64>) -> bool {
        match self.times {
            Some(_) => self.next() == Some(t),
            None => last.is_none_or(|last| last < t),
        }
    }

    /// How many samples there may be yet: at the ends of a piece, or at all of the times and at the
    /// end.
    pub(crate) fn at_most(&self) -> usize {
        const OF_A_PIECE: usize = 4;
        self.times.map_or(OF_A_PIECE, |times| times.len() - self.passed + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_passed_one_after_the_other() {
        let mut wanted = OutputTimes::new(Some(&[1.0, 2.0, 3.0]));
        assert_eq!(wanted.at_most(), 4);
        assert_eq!((wanted.pass_before(2.0), wanted.pass_before(2.0)), (Some(1.0), None));
        assert!(wanted.pass_at(2.0) && !wanted.pass_at(2.0) && !wanted.pass_at(2.5));
        assert!(wanted.is_missing_at(3.0, None) && !wanted.is_missing_at(2.5, None));
        assert_eq!((wanted.next(), wanted.at_most()), (Some(3.0), 2));
    }

    #[test]
    fn without_times_each_end_of_a_step_is_one() {
        let mut wanted = OutputTimes::new(None);
        assert!(wanted.is_by_steps() && wanted.pass_at(0.5) && wanted.pass_at(0.5));
        assert_eq!((wanted.next(), wanted.pass_before(9.0)), (None, None));
        assert!(wanted.is_missing_at(1.0, Some(0.5)) && !wanted.is_missing_at(1.0, Some(1.0)));
    }
}
