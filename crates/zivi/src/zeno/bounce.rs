//! An impact of a chain, and the speed that a next one gives back.

/// One impact of a chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounce {
    /// Time (s).
    pub(crate) t: f64,
    /// Speed after the impact (m/s).
    pub(crate) u: f64,
    /// Pull towards the wall, `-f(t, 0, 0)` (m/s^2).
    pub(crate) g: f64,
}

/// The speed after an impact under Newton's law; none where the height of the next arc would underflow.
#[inline]
pub(crate) fn restored(e: f64, before: f64) -> f64 {
    unless_underflowing(e * before.abs())
}

/// A speed after an impact; none where the height of the next arc would underflow.
#[inline]
pub(crate) fn unless_underflowing(after: f64) -> f64 {
    if after * after < f64::MIN_POSITIVE {
        0.0
    } else {
        after
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speeds_of_arcs_whose_height_underflows_are_none() {
        let least = f64::MIN_POSITIVE.sqrt();
        assert_eq!(least * least, f64::MIN_POSITIVE);
        for after in [0.0, 1e-300, 0.5 * least, least.next_down()] {
            assert_eq!(unless_underflowing(after), 0.0, "{after:e}");
        }
        for after in [least, 1e-150, 1.0] {
            assert_eq!(unless_underflowing(after), after, "{after:e}");
        }
        assert_eq!(restored(0.5, -3.0), 1.5);
        assert_eq!(restored(0.5, -1.9 * least), 0.0);
    }
}
