//! The signs of many ticks.

use std::collections::TryReserveError;

use super::controller::SIGNS;

/// Bits of the signs that need no more than their code.
const ONE: u64 = 1.0_f64.to_bits();
const MINUS_ONE: u64 = (-1.0_f64).to_bits();

/// What a tick's sign is: one of these, as the last other one at its place, or another one.
const PLUS: u16 = 0;
const MINUS: u16 = 1;
const AGAIN: u16 = 2;
const OTHER: u16 = 3;

/// The signs of many ticks, `ls, lv, lsr, lvr, les, lev` of each. As six numbers a tick they would be
/// half of what a loop remembers, and new memory takes as long as the tick; most are 1, -1, or what
/// they were before.
///
/// ```
/// use zivi::drive::closed_loop::SignRecord;
/// let mut record = SignRecord::default();
/// record.push([1.0, -1.0, 1.0, 1.0, 0.25, f64::NAN])?;
/// let rows: Vec<_> = record.iter().collect();
/// assert_eq!(rows[0][..5], [1.0, -1.0, 1.0, 1.0, 0.25]);
/// assert!(rows[0][5].is_nan());
/// # Ok::<(), std::collections::TryReserveError>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct SignRecord {
    /// Of each tick the codes of its signs, the first in the lowest bits.
    codes: Vec<u16>,
    /// All signs with the code [`OTHER`], in their order.
    others: Vec<f64>,
    /// The last of them at each place.
    last: [f64; SIGNS],
}

impl SignRecord {
    /// Nothing yet, and room for the codes of so many ticks.
    pub(super) fn with_room(ticks: usize) -> Result<Self, TryReserveError> {
        let mut codes = Vec::new();
        codes.try_reserve_exact(ticks)?;
        Ok(Self { codes, ..Self::default() })
    }

    /// Another tick.
    ///
    /// # Errors
    /// There is no memory for it; the record is as it was.
    #[inline]
    pub fn push(&mut self, signs: [f64; SIGNS]) -> Result<(), TryReserveError> {
        self.codes.try_reserve(1)?;
        self.others.try_reserve(SIGNS)?;
        let mut codes = 0;
        for (k, (last, sign)) in self.last.iter_mut().zip(signs).enumerate() {
            let code = match sign.to_bits() {
                ONE => PLUS,
                MINUS_ONE => MINUS,
                bits if bits == last.to_bits() => AGAIN,
                _ => {
                    self.others.push(sign);
                    *last = sign;
                    OTHER
                }
            };
            codes |= code << (2 * k);
        }
        self.codes.push(codes);
        Ok(())
    }

    /// Number of ticks.
    #[must_use]
    pub fn len(&self) -> usize {
        self.codes.len()
    }

    /// Whether there is no tick.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.codes.is_empty()
    }

    /// The signs of each tick, to the last bit.
    pub fn iter(&self) -> impl Iterator<Item = [f64; SIGNS]> + '_ {
        let (mut others, mut last) = (self.others.iter(), [0.0; SIGNS]);
        self.codes.iter().map(move |codes| {
            let mut codes = *codes;
            last.each_mut().map(|last| {
                let code = codes & OTHER;
                codes >>= 2;
                match code {
                    PLUS => return 1.0,
                    MINUS => return -1.0,
                    OTHER => *last = *others.next().unwrap_or(last),
                    _ => {}
                }
                *last
            })
        })
    }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use super::*;

    #[test]
    fn signs_are_given_back_to_the_last_bit() {
        let values =
            [1.0, -1.0, f64::NAN, 0.0, -0.0, 0.3, -f64::NAN, 1.0 - 1e-16, f64::MIN_POSITIVE];
        let mut given = Vec::new();
        // each value at each place, beside all others in turns
        for k in 0..values.len().pow(2) {
            given
                .push(std::array::from_fn(|j| values[(k + j * (k / values.len())) % values.len()]));
        }
        let mut record = SignRecord::with_room(given.len()).expect("room");
        assert!(record.is_empty());
        for signs in &given {
            record.push(*signs).expect("room");
        }
        assert!(record.len() == given.len() && !record.is_empty());
        let bits = |signs: [f64; SIGNS]| signs.map(f64::to_bits);
        let found: Vec<_> = record.iter().map(bits).collect();
        assert_eq!(found, given.into_iter().map(bits).collect::<Vec<_>>());
    }

    #[test]
    fn only_what_is_new_takes_more_than_its_code() {
        let mut record = SignRecord::with_room(1000).expect("room");
        for n in 0..1000 {
            let sign = if n % 3 == 0 { -1.0 } else { 1.0 };
            record.push([sign, 0.25, -sign, f64::NAN, sign, 0.0]).expect("room");
        }
        // the last of each place is zero at first
        assert!(record.others.len() == 2 && record.codes.capacity() == 1000);
    }
}
