//! A dense output as plain numbers, for storing it and for sending it to another process.
//!
//! ```text
//! [ segments, coefficients, tails, ended,  t, x, x', sigma of the end,
//!   start, sigma, kind, first, degree, h  of each segment,  the coefficients,  the tails ]
//! ```
//!
//! Counts are below 2^53 and exact.

use super::path::{DensePath, Kind, PathPoint, Segment};
use super::tail::{Tail, TAIL_NUMBERS};

const HEAD: usize = 8;
const OF_SEGMENT: usize = 6;

impl DensePath {
    /// All that it consists of.
    #[must_use]
    pub fn to_numbers(&self) -> Vec<f64> {
        let count = |n: usize| n as f64;
        let (t, end) = self.end.unwrap_or((f64::NAN, PathPoint { x: 0.0, xdot: 0.0, sigma: 1.0 }));
        let mut numbers = vec![
            count(self.segments.len()),
            count(self.coefficients.len()),
            count(self.tails.len()),
            f64::from(u8::from(self.end.is_some())),
        ];
        numbers.extend([t, end.x, end.xdot, end.sigma]);
        for Segment { start, sigma, kind } in &self.segments {
            let (code, first, degree, h) = match *kind {
                Kind::Rest => (0.0, 0, 0, 0.0),
                Kind::Tail(number) => (1.0, number, 0, 0.0),
                Kind::Flight { first, degree, h } => (2.0, first, degree, h),
            };
            numbers.extend([*start, *sigma, code, count(first), count(degree), h]);
        }
        numbers.extend_from_slice(&self.coefficients);
        numbers.extend(self.tails.iter().flat_map(Tail::to_numbers));
        numbers
    }

    /// What [`DensePath::to_numbers`] came from; `None` if the numbers do not fit together.
    #[must_use]
    pub fn from_numbers(numbers: &[f64]) -> Option<Self> {
        let (head, rest) = numbers.split_at_checked(HEAD)?;
        let &[segments, coefficients, tails, ended, t, x, xdot, sigma] = head else { return None };
        let (segments, rest) = rest.split_at_checked(OF_SEGMENT.checked_mul(count(segments)?)?)?;
        let (coefficients, rest) = rest.split_at_checked(count(coefficients)?)?;
        let tails = count(tails)?;
        if rest.len() != TAIL_NUMBERS.checked_mul(tails)? {
            return None;
        }
        let tails = rest.chunks_exact(TAIL_NUMBERS).map(Tail::from_numbers);
        let path = Self {
            segments: segments.chunks_exact(OF_SEGMENT).map(segment).collect::<Option<_>>()?,
            coefficients: coefficients.to_vec(),
            tails: tails.collect::<Option<_>>()?,
            end: (ended != 0.0).then_some((t, PathPoint { x, xdot, sigma })),
        };
        let fits = |segment: &Segment| match segment.kind {
            Kind::Rest => true,
            Kind::Tail(number) => number < path.tails.len(),
            Kind::Flight { first, degree, .. } => {
                // both are below 2^53: no overflow
                first + 2 * degree + 2 <= path.coefficients.len()
            }
        };
        path.segments.iter().all(fits).then_some(path)
    }
}

fn count(number: f64) -> Option<usize> {
    ((0.0..9e15).contains(&number) && number.fract() == 0.0).then_some(number as usize)
}

fn segment(numbers: &[f64]) -> Option<Segment> {
    let &[start, sigma, code, first, degree, h] = numbers else { return None };
    let kind = match count(code)? {
        0 => Kind::Rest,
        1 => Kind::Tail(count(first)?),
        2 => Kind::Flight { first: count(first)?, degree: count(degree)?, h },
        _ => return None,
    };
    Some(Segment { start, sigma, kind })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        simulate_switched_rk, LinearForce, Output, Physical, Restitution, Silent, SwitchedRk,
    };

    fn path() -> DensePath {
        let mut table = LinearForce {
            stiffness: 0.0,
            damping: 0.0,
            gravity: 9.81,
            amplitude: 14.7,
            omega: 6.3,
            phase: 0.0,
        };
        let (start, wall) = (Physical { x: 0.2, xdot: 0.0 }, Restitution::from_e(0.5).unwrap());
        let output = Output { dense: true, ..Output::default() };
        let method = SwitchedRk::default();
        simulate_switched_rk(method, wall, &mut table, (0.0, 3.0), start, output, &mut Silent)
            .unwrap()
            .path
            .unwrap()
    }

    #[test]
    fn a_path_comes_back_as_it_was() {
        let path = path();
        assert!(!path.tails.is_empty());
        assert_eq!(DensePath::from_numbers(&path.to_numbers()), Some(path));
        let none = DensePath::default();
        assert_eq!(DensePath::from_numbers(&none.to_numbers()), Some(none));
    }

    #[test]
    fn numbers_that_do_not_fit_together_are_refused() {
        let numbers = path().to_numbers();
        for n in [0, 3, 7, numbers.len() - 1] {
            assert_eq!(DensePath::from_numbers(&numbers[..n]), None, "{n}");
        }
        for (k, wrong) in [(0, 1e9), (1, -1.0), (2, 0.5), (0, f64::NAN), (HEAD + 2, 7.0)] {
            let mut numbers = numbers.clone();
            numbers[k] = wrong;
            assert_eq!(DensePath::from_numbers(&numbers), None, "{k}");
        }
        let flight = (0..).find(|i| numbers[HEAD + OF_SEGMENT * i + 2] == 2.0).unwrap();
        let mut numbers = numbers.clone();
        numbers[HEAD + OF_SEGMENT * flight + 3] = 1e6; // coefficients that are not there
        assert_eq!(DensePath::from_numbers(&numbers), None);
    }
}
