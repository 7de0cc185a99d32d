//! Probes: evaluations of a function between the nodes of a polynomial that stands for it.
//!
//! A polynomial that fits says little about how fast the function may vary between its nodes. So
//! over a span there are [`PROBES`] more evaluations in all, spread over the windows that are
//! accepted, and when one shows something, as many before that, until nothing new is seen.

/// Probes between the start of a search and its farthest end; the most in one window, where the
/// function is known to vary fast.
const PROBES: f64 = 64.0;
const MOST_PROBES: f64 = 1024.0;

/// A deviation this part of a window after its start is not traced back further.
const SHORTEST: f64 = 1e-9;

/// `(sqrt(5) - 1)/2`
const GOLDEN: f64 = 0.618_033_988_749_895;

/// The search for features of a function, from one window to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Probes {
    /// Up to here the probes showed nothing (s).
    clear: f64,
    /// No window goes beyond this time, at which a probe showed that the function varies (s).
    suspect: f64,
    /// Largest distance of two probes, once one of them showed something (s).
    spacing: f64,
}

impl Default for Probes {
    fn default() -> Self {
        let (clear, suspect, spacing) = (f64::NEG_INFINITY, f64::NEG_INFINITY, f64::INFINITY);
        Self { clear, suspect, spacing }
    }
}

impl Probes {
    /// Where a window from `t` to `until` at most ends at the latest.
    pub(crate) fn end(&self, t: f64, until: f64) -> f64 {
        if self.suspect > t {
            until.min(self.suspect)
        } else {
            until
        }
    }

    /// Probes a window between the times `t` and `t + end`, where the farthest end of the search is
    /// `horizon` after its start and the nodes of the polynomial are at most `apart`. `conforms`
    /// tells whether the function is as the polynomial has it, at a time after `t`.
    ///
    /// None if it is so everywhere, else the length of a window that ends before it deviates, or
    /// where it does.
    pub(crate) fn deviation<E>(
        &mut self,
        horizon: f64,
        (t, end): (f64, f64),
        apart: f64,
        mut conforms: impl FnMut(f64) -> Result<bool, E>,
    ) -> Result<Option<f64>, E> {
        if t + end <= self.clear {
            return Ok(None);
        }
        let shortest = SHORTEST * end;
        let (mut end, mut shorter) = (end, None);
        while end > shortest {
            let spacing = self.spacing.min(horizon / PROBES);
            if apart <= (1.0 + GOLDEN) * spacing {
                break;
            }
            let n = (end / spacing).ceil().clamp(1.0, MOST_PROBES);
            let Some((before, at)) = first_deviation(end, n, &mut conforms)? else { break };
            // it varies: how it does before that, no probe so far was close enough to tell
            (end, shorter) = (at, Some(if before > 0.0 { before } else { at }));
            self.spacing = self.spacing.min(end / PROBES);
            self.suspect = t + at;
        }
        self.clear = t + end;
        Ok(shorter)
    }
}

/// The first of `n` places from 0 to `end` where a function does not conform, and the place
/// before that.
fn first_deviation<E>(
    end: f64,
    n: f64,
    conforms: &mut impl FnMut(f64) -> Result<bool, E>,
) -> Result<Option<(f64, f64)>, E> {
    let mut before = 0.0;
    // at 0 there is a node
    for i in 1..n as u32 {
        // one in each part, not equidistant: a periodic function must not be probed in its period
        let i = f64::from(i);
        let at = (i + (i * GOLDEN).fract()) / n * end;
        if !conforms(at)? {
            return Ok(Some((before, at)));
        }
        before = at;
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    /// What probes of the whole of a span find of a pulse, and how many there are.
    fn found(span: f64, pulse: (f64, f64)) -> (Option<f64>, f64, usize) {
        let (mut probes, mut n) = (Probes::default(), 0);
        let shorter = probes.deviation(span, (0.0, span), span, |t| {
            n += 1;
            Ok::<bool, Infallible>(!(t > pulse.0 && t < pulse.1))
        });
        (shorter.unwrap_or(None), probes.end(0.0, span), n)
    }

    #[test]
    fn no_pulse_longer_than_a_golden_section_of_the_distance_is_overlooked() {
        let span = 10.0;
        let width = (1.0 + GOLDEN) * span / PROBES;
        for k in 0..2000 {
            let start = (span - width) * f64::from(k) / 2000.0;
            let (shorter, suspect, n) = found(span, (start, start + 1.001 * width));
            assert!(shorter.is_some_and(|shorter| shorter <= suspect), "{start}");
            assert!(suspect > start && suspect < start + 1.001 * width, "{start}");
            assert!(n < 2 * MOST_PROBES as usize, "{start} {n}");
        }
        assert_eq!(found(span, (20.0, 30.0)), (None, span, PROBES as usize - 1));
    }

    #[test]
    fn what_deviates_from_the_start_on_is_traced_back_to_it() {
        let (shorter, suspect, n) = found(10.0, (0.0, 0.26));
        assert!(shorter == Some(suspect) && suspect <= SHORTEST * 10.0 && n < 100, "{suspect} {n}");
    }

    #[test]
    fn what_was_clear_is_not_probed_again() {
        let mut probes = Probes::default();
        let all_conform = |probes: &mut Probes, t, end| {
            let mut n = 0;
            let found = probes.deviation(10.0, (t, end), end, |_| {
                n += 1;
                Ok::<bool, Infallible>(true)
            });
            assert_eq!(found, Ok(None));
            n
        };
        assert_eq!(all_conform(&mut probes, 0.0, 5.0), 31);
        assert_eq!(all_conform(&mut probes, 2.0, 3.0), 0);
        assert_eq!(all_conform(&mut probes, 5.0, 5.0), 31);
    }

    #[test]
    fn a_window_whose_nodes_are_as_close_as_probes_needs_none() {
        let apart = (1.0 + GOLDEN) * 10.0 / PROBES;
        for (apart, probed) in [(0.99 * apart, false), (1.01 * apart, true)] {
            let found =
                Probes::default().deviation(10.0, (0.0, 10.0), apart, |_| Ok::<_, ()>(false));
            assert_eq!(found.unwrap().is_some(), probed);
        }
    }
}
