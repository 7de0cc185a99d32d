//! The first two trials of a search, one of which is the root in nearly every step: taken without
//! the book-keeping of a search, which learns afterwards what they have shown.

use super::search::Search;

/// What a trial has shown.
pub(crate) enum Shown<T> {
    /// It is the root, with what it leads to.
    Root(T),
    /// Its mismatch.
    Mismatch(f64),
    /// Nothing: it has to be tried with more care.
    Nothing,
}

/// The first trials of [`Search::from`], and their mismatches.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Opening {
    first: f64,
    slope: f64,
    mismatches: [Option<f64>; 2],
}

impl Opening {
    /// Before the trial `first`, with the slope of the last search.
    #[inline]
    pub(crate) fn from(first: f64, slope: f64) -> Self {
        Self { first, slope, mismatches: [None; 2] }
    }

    /// Takes the trials until one of them is the root; none if neither is.
    #[inline(always)]
    pub(crate) fn root<T, E>(
        &mut self,
        mut show: impl FnMut(f64) -> Result<Shown<T>, E>,
    ) -> Result<Option<T>, E> {
        let mut trial = self.first;
        for place in &mut self.mismatches {
            let mismatch = match show(trial)? {
                Shown::Root(root) => return Ok(Some(root)),
                Shown::Mismatch(mismatch) => mismatch,
                Shown::Nothing => break,
            };
            *place = Some(mismatch);
            let Some(next) = Search::second(trial, mismatch, self.slope) else { break };
            trial = next;
        }
        Ok(None)
    }

    /// The search that has made these trials.
    #[inline]
    pub(crate) fn search(&self, cap: usize) -> Search {
        let mut search = Search::from(self.first, self.slope, cap);
        for mismatch in self.mismatches.into_iter().flatten() {
            if search.trial().is_some() {
                search.learn(mismatch);
            }
        }
        search
    }
}

#[cfg(test)]
mod tests {
    use super::super::search::DEFAULT_SLOPE;
    use super::*;

    /// The trials of a search for the root of `mismatch`, up to 20.
    fn trials(mut search: Search, mismatch: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut trials = Vec::new();
        while let Some(trial) = search.trial() {
            trials.push(trial);
            search.learn(mismatch(trial));
        }
        trials
    }

    #[test]
    fn a_search_goes_on_where_the_opening_ends() {
        let laws: [fn(f64) -> f64; 5] = [
            |f| 3.0 - 1.5 * f,
            |f| (-f).exp() - f,
            |f| -100.0 * (f / 1e-3).tanh() - f + 10.0,
            |_| 0.0,
            |_| f64::NAN,
        ];
        for (number, law) in laws.into_iter().enumerate() {
            for slope in [DEFAULT_SLOPE, -1.5, 1e-12] {
                let mut shown = Vec::new();
                let mut opening = Opening::from(2.5, slope);
                let root: Result<Option<()>, ()> = opening.root(|trial| {
                    shown.push(trial);
                    Ok(Shown::Mismatch(law(trial)))
                });
                assert_eq!(root, Ok(None));
                let whole = trials(Search::from(2.5, slope, 20), law);
                shown.extend(trials(opening.search(20), law));
                assert_eq!(shown, whole, "law {number}, slope {slope}");
            }
        }
    }
}
