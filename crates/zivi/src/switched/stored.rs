//! The motion of a mass as plain numbers, after the header of [`crate::record::stored`].
//!
//! ```text
//! motion  [ e, kappa, tails, whether there is a path,  the tails,  the path ]
//! path    [ segments, coefficients, tails, ended,  t, x, x', sigma of the end,
//!           start, sigma, kind, first, degree, h  of each segment,  the coefficients,  the tails ]
//! ```
//!
//! The `degree` of a power series is how many terms it has, its second coefficient the velocity at the
//! start. Before format 4 tails had no accelerations, format 1 had no power series.

use zivi_core::Restitution;

use super::flight::series::TERMS;
use super::path::{DensePath, MotionSegment, SegmentKind};
use crate::numeric::bernstein::MOST_DEGREE;
use crate::record::recorder::is_sigma;
use crate::record::stored::{as_count, MotionError, Reader, StoredKind, Writer};
use crate::zeno::tail::Tail;
use crate::PathPoint;

/// The motion of a run between its samples: the dense output, if stored, and the extrapolated
/// flights.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// The motion as a function of time.
    pub path: Option<DensePath>,
    /// The arcs that jumps to rest skipped.
    pub tails: Vec<Tail>,
    /// The wall.
    pub restitution: Restitution,
}

impl Motion {
    /// All that it consists of.
    #[must_use]
    pub fn to_numbers(&self) -> Option<Vec<f64>> {
        let mut out = Writer::new(StoredKind::Point);
        out.numbers(&[self.restitution.e(), self.restitution.kappa()]);
        out.count(self.tails.len());
        out.flag(self.path.is_some());
        write_tails(&mut out, &self.tails);
        if let Some(path) = &self.path {
            path.write(&mut out);
        }
        out.finish()
    }

    /// Inverse of [`Motion::to_numbers`].
    ///
    /// # Errors
    /// [`MotionError`] for numbers that are none of a motion.
    pub fn from_numbers(numbers: &[f64]) -> Result<Self, MotionError> {
        Reader::read(StoredKind::Point, numbers, Self::read)
    }

    fn read(from: &mut Reader<'_>) -> Option<Self> {
        let [e, kappa] = from.row()?;
        let (tails, dense) = (from.count()?, from.flag()?);
        let tails = read_tails(from, tails)?;
        let path = if dense { Some(DensePath::read(from)?) } else { None };
        let restitution = Restitution::from_both(e, kappa).ok()?;
        Some(Self { path, tails, restitution })
    }
}

fn write_tails(out: &mut Writer, tails: &[Tail]) {
    tails.iter().for_each(|tail| out.numbers(&tail.to_numbers()));
}

fn read_tails(from: &mut Reader<'_>, n: usize) -> Option<Vec<Tail>> {
    (0..n).map(|_| Tail::read(from)).collect()
}

impl DensePath {
    fn write(&self, out: &mut Writer) {
        if !self.linear.is_empty() {
            // tables are not written
            return self.in_powers().write(out);
        }
        let (t, end) = self.end.unwrap_or((f64::NAN, PathPoint { x: 0.0, xdot: 0.0, sigma: 1.0 }));
        for count in [self.segments.len(), self.coefficients.len(), self.tails.len()] {
            out.count(count);
        }
        out.flag(self.end.is_some());
        out.numbers(&[t, end.x, end.xdot, end.sigma]);
        for MotionSegment { start, sigma, kind } in &self.segments {
            let (code, first, degree, h) = match *kind {
                SegmentKind::Rest => (0.0, 0, 0, 0.0),
                SegmentKind::Tail(number) => (1.0, number, 0, 0.0),
                SegmentKind::Flight { first, degree, h } => (2.0, first, degree, h),
                SegmentKind::Series { first, terms, h, lands: false } => (3.0, first, terms, h),
                SegmentKind::Series { first, terms, h, lands: true } => (4.0, first, terms, h),
                SegmentKind::Linear(_) => unreachable!("a path in powers has no tables"),
            };
            out.numbers(&[*start, *sigma, code, first as f64, degree as f64, h]);
        }
        out.numbers(&self.coefficients);
        write_tails(out, &self.tails);
    }

    /// Inverse of [`DensePath::write`]; `None` if the numbers do not fit together.
    fn read(from: &mut Reader<'_>) -> Option<Self> {
        let [segments, coefficients, tails] = from.counts()?;
        let ended = from.flag()?;
        let [t, x, xdot, sigma] = from.row()?;
        let segments = from.rows(segments)?.into_iter().map(segment).collect::<Option<_>>()?;
        let coefficients = from.take(coefficients)?.to_vec();
        let tails = read_tails(from, tails)?;
        let end = ended.then_some((t, PathPoint { x, xdot, sigma }));
        let path = Self { segments, coefficients, tails, end, ..Self::default() };
        path.fits_together().then_some(path)
    }

    /// Whether the segments are consecutive up to the end, and their references exist.
    fn fits_together(&self) -> bool {
        let starts = self.segments.iter().map(|segment| segment.start);
        let times: Vec<f64> = starts.chain(self.end.map(|(t, _)| t)).collect();
        let ended = match self.end {
            Some((_, PathPoint { x, xdot, sigma })) => {
                x >= 0.0 && x.is_finite() && xdot.is_finite() && is_sigma(sigma)
            }
            None => self.segments.is_empty(),
        };
        ended
            && times.iter().all(|t| t.is_finite())
            && times.windows(2).all(|pair| pair[0] <= pair[1])
            && self.coefficients.iter().all(|c| c.is_finite())
            && self.segments.iter().all(|segment| self.holds(segment))
    }

    /// Whether what a segment refers to is there.
    fn holds(&self, segment: &MotionSegment) -> bool {
        is_sigma(segment.sigma)
            && match segment.kind {
                SegmentKind::Rest => true,
                SegmentKind::Linear(number) => number < self.linear.len(),
                SegmentKind::Tail(number) => number < self.tails.len(),
                SegmentKind::Flight { first, degree, h } => {
                    // `first` is below 2^53: no overflow
                    degree <= MOST_DEGREE
                        && first + 2 * degree + 2 <= self.coefficients.len()
                        && h > 0.0
                        && h.is_finite()
                }
                SegmentKind::Series { first, terms, h, .. } => {
                    (2..=TERMS).contains(&terms)
                        && first + terms <= self.coefficients.len()
                        && h > 0.0
                        && h.is_finite()
                }
            }
    }
}

fn segment([start, sigma, code, first, degree, h]: [f64; 6]) -> Option<MotionSegment> {
    let kind = match as_count(code)? {
        0 => SegmentKind::Rest,
        1 => SegmentKind::Tail(as_count(first)?),
        2 => SegmentKind::Flight { first: as_count(first)?, degree: as_count(degree)?, h },
        code @ (3 | 4) => {
            let (first, terms) = (as_count(first)?, as_count(degree)?);
            SegmentKind::Series { first, terms, h, lands: code == 4 }
        }
        _ => return None,
    };
    Some(MotionSegment { start, sigma, kind })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::zeno::table::TAIL_NUMBERS;
    use crate::{
        simulate_switched_rk, Flights, LinearForce, Output, Physical, Restitution, Silent,
        SwitchedRk,
    };

    /// Numbers of the header, before the tails of a motion, of a path and of a segment.
    const HEADER: usize = 3;
    const MOTION_HEAD: usize = HEADER + 4;
    const HEAD: usize = 8;
    const OF_SEGMENT: usize = 6;

    const KINDS: [Flights; 2] = [Flights::RungeKutta, Flights::Series];

    fn path(flights: Flights) -> DensePath {
        let mut table = LinearForce {
            stiffness: 0.0,
            damping: 0.0,
            gravity: 9.81,
            amplitude: 14.7,
            omega: 6.3,
            phase: 0.0,
        };
        let (start, restitution) =
            (Physical { x: 0.2, xdot: 0.0 }, Restitution::from_e(0.5).unwrap());
        let output = Output { dense: true, ..Output::default() };
        let method = SwitchedRk { flights, ..SwitchedRk::default() };
        simulate_switched_rk(
            method,
            restitution,
            &mut table,
            (0.0, 3.0),
            start,
            output,
            &mut Silent,
        )
        .unwrap()
        .path
        .unwrap()
    }

    fn motion(flights: Flights) -> Motion {
        let path = path(flights);
        Motion {
            tails: path.tails.clone(),
            path: Some(path),
            restitution: Restitution::from_e(0.5).unwrap(),
        }
    }

    #[test]
    fn a_motion_comes_back_as_it_was() {
        for dense in KINDS.map(motion) {
            assert!(!dense.tails.is_empty());
            for path in [None, Some(DensePath::default()), dense.path.clone()] {
                for tails in [Vec::new(), dense.tails.clone()] {
                    let motion =
                        Motion { path: path.clone(), tails, restitution: dense.restitution };
                    let again = Motion::from_numbers(&motion.to_numbers().unwrap()).unwrap();
                    let bits = |motion: &Motion| {
                        motion
                            .to_numbers()
                            .unwrap()
                            .into_iter()
                            .map(f64::to_bits)
                            .collect::<Vec<u64>>()
                    };
                    assert_eq!(bits(&again), bits(&motion));
                    let in_powers = motion.path.as_ref().map(DensePath::in_powers);
                    assert_eq!(again, Motion { path: in_powers, ..motion.clone() });
                    let at = |motion: &Motion| {
                        let times = (0..=300).map(|k| 0.01 * f64::from(k));
                        let at = |t| motion.path.as_ref().and_then(|path| path.at(t));
                        times.map(at).collect::<Vec<_>>()
                    };
                    assert_eq!(at(&again), at(&motion));
                }
            }
        }
    }

    #[test]
    fn numbers_that_do_not_fit_together_are_refused() {
        refused(&motion(Flights::RungeKutta), 2.0, &[8.0, 9.0, 1e15]);
        refused(&motion(Flights::Series), 3.0, &[0.0, 1.0, 25.0, 1e15]);
    }

    /// Of a flight of this kind, which never has one of these degrees.
    fn refused(motion: &Motion, kind: f64, degrees: &[f64]) {
        let numbers = motion.to_numbers().unwrap();
        for n in 0..numbers.len() {
            assert_eq!(Motion::from_numbers(&numbers[..n]), Err(MotionError::Damaged), "{n}");
        }
        let path = MOTION_HEAD + TAIL_NUMBERS * motion.tails.len();
        let first = path + HEAD;
        let flight = (0..).find(|i| numbers[first + OF_SEGMENT * i + 2] == kind).unwrap();
        let flight = first + OF_SEGMENT * flight;
        let not_there = [numbers[path + 1] - 1.0, 1e6, 8e15];
        let wrong: Vec<(usize, &[f64])> = vec![
            (HEADER, &[-0.1, 1.1, f64::NAN]),           // e
            (HEADER + 1, &[-0.1, 0.4, f64::NAN]),       // kappa
            (HEADER + 2, &[1e9, -1.0, 0.25, f64::NAN]), // tails
            (HEADER + 3, &[0.0, 2.0]),                  // whether there is a path
            (MOTION_HEAD, &[0.0, 1.0, -1.0, f64::NAN]), // e of a tail
            (path, &[1e9, f64::INFINITY]),              // segments
            (path + 1, &[-1.0, 9e15]),                  // coefficients
            (path + 3, &[0.0, 0.5]),                    // ended
            (path + 4, &[f64::NAN, -1.0]),              // the time of the end
            (path + 5, &[-1.0, f64::NAN]),              // x there
            (first, &[f64::NAN, 1e9]),                  // start of a segment
            (first + 1, &[0.0, 2.0]),                   // its branch
            (first + 2, &[5.0, 7.0]),                   // its kind
            (flight + 3, &not_there),                   // coefficients that are not there
            (flight + 4, degrees),                      // a degree that no step has
            (flight + 5, &[0.0, -1.0, f64::INFINITY]),  // its length
        ];
        for (k, values) in wrong {
            for &value in values {
                let mut numbers = numbers.clone();
                numbers[k] = value;
                assert_eq!(
                    Motion::from_numbers(&numbers),
                    Err(MotionError::Damaged),
                    "{k}: {value}"
                );
            }
        }
        let mut later = numbers.clone();
        later[0] += 1.0;
        assert_eq!(Motion::from_numbers(&later), Err(MotionError::Format(later[0])));
    }

    /// A motion restored from arbitrary numbers supports all queries.
    #[test]
    fn numbers_changed_at_random_give_an_error_or_a_motion() {
        KINDS
            .into_iter()
            .for_each(|flights| changed_at_random(&motion(flights).to_numbers().unwrap()));
    }

    fn changed_at_random(whole: &[f64]) {
        const VALUES: [f64; 12] =
            [0.0, -0.0, 1.0, -1.0, 2.0, 0.5, 8.0, 1e9, 1e300, 5e-324, f64::INFINITY, f64::NAN];
        let mut draw = 5_u64;
        let mut below = |n: usize| {
            draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (draw >> 33) as usize % n
        };
        let mut made = 0;
        for _ in 0..20_000 {
            let mut numbers = whole.to_vec();
            for _ in 0..=below(3) {
                // mostly in the counts, which are at the beginning
                let k = if below(2) == 0 { below(60) } else { below(whole.len()) };
                let near = numbers[k] + 1.0;
                numbers[k] = *VALUES.get(below(VALUES.len() + 1)).unwrap_or(&near);
            }
            let Ok(Motion { path, tails, .. }) = Motion::from_numbers(&numbers) else { continue };
            made += 1;
            let times = [-1.0, 0.0, 0.5, 0.83, 1.1, 1.7, 3.0, f64::NAN];
            let found = times.iter().filter_map(|&t| path.as_ref().and_then(|path| path.at(t)));
            assert!(found.count() <= times.len());
            for tail in &tails {
                assert!(tail.impacts_down_to(1e-3, 100).count() <= 100);
            }
        }
        assert!(made > 1000, "{made}");
    }
}
