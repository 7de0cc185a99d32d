//! Tails as plain numbers, within those of a motion ([`crate::record::stored`]).
//!
//! ```text
//! tail  [ e, start, zeno, until, sigma,  C,  D,  A at the starts of arcs,  A at their ends ]
//! ```

use super::fit::TERMS;
use super::tail::Tail;
use crate::record::point::is_sigma;
use crate::record::stored::Reader;

/// Numbers that a tail consists of.
pub(crate) const TAIL_NUMBERS: usize = 5 + 4 * TERMS;

impl Tail {
    /// All that it consists of.
    pub(crate) fn to_numbers(&self) -> Vec<f64> {
        let Self { e, start, zeno, until, sigma, c, d, bends } = self;
        let head = [*e, *start, *zeno, *until, *sigma];
        head.iter().chain(c).chain(d).chain(bends.iter().flatten()).copied().collect()
    }

    /// What [`Tail::to_numbers`] came from; `None` for numbers that are none of a tail.
    pub(crate) fn read(from: &mut Reader<'_>) -> Option<Self> {
        /// The first format with equation (2), and how many terms (1) had before.
        const BENT: (f64, usize) = (4.0, 4);
        if from.format() >= BENT.0 {
            return Self::from_numbers(from.take(TAIL_NUMBERS)?);
        }
        let mut numbers = [0.0; TAIL_NUMBERS];
        for (at, length) in [(0, 5), (5, BENT.1), (5 + TERMS, BENT.1)] {
            numbers[at..][..length].copy_from_slice(from.take(length)?);
        }
        Self::from_numbers(&numbers)
    }

    fn from_numbers(numbers: &[f64]) -> Option<Self> {
        let (head, series) = numbers.split_at_checked(5)?;
        let &[e, start, zeno, until, sigma] = head else { return None };
        let mut all = [[0.0; TERMS]; 4];
        for (one, numbers) in all.iter_mut().zip(series.chunks(TERMS)) {
            *one = numbers.try_into().ok()?;
        }
        let [c, d, bends @ ..] = all;
        let finite = numbers.iter().all(|number| number.is_finite());
        let ordered = start <= until && until <= zeno && 0.0 < e && e < 1.0 && is_sigma(sigma);
        let tail = Self { e, start, zeno, until, sigma, c, d, bends };
        (finite && ordered).then_some(tail)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::stored::{Kind, MotionError, Reader, Writer};

    /// A tail behind the header of a motion, in a format.
    fn read(format: f64, numbers: &[f64]) -> Result<Tail, MotionError> {
        let mut out = Writer::new(Kind::Point);
        out.numbers(numbers);
        let mut all = out.finish().unwrap();
        all[0] = format;
        Reader::read(Kind::Point, &all, Tail::read)
    }

    #[test]
    fn tails_of_both_formats_are_read() {
        let head = [0.5, 1.0, 3.0, 2.5, -1.0];
        let before: Vec<f64> = head.into_iter().chain((0..8).map(f64::from)).collect();
        let old = read(3.0, &before).unwrap();
        assert_eq!(
            (old.c, old.d),
            ([0.0, 1.0, 2.0, 3.0, 0.0, 0.0], [4.0, 5.0, 6.0, 7.0, 0.0, 0.0])
        );
        assert_eq!((old.until, old.bends), (2.5, [[0.0; TERMS]; 2]));
        let now: Vec<f64> = head.into_iter().chain((0..24).map(f64::from)).collect();
        let tail = read(4.0, &now).unwrap();
        assert_eq!(tail.to_numbers(), now);
        assert_eq!(tail.bends[1][5], 23.0);
        assert_eq!(read(4.0, &before), Err(MotionError::Damaged));
        assert_eq!(read(3.0, &now), Err(MotionError::Damaged));
    }
}
