//! A motion as plain numbers, and back.
//!
//! ```text
//! version, n, m, segments, coefficients, skipped
//! segments: start, closed (two halves), kind (0 motion, 1 skipped), first, degree, h
//! coefficients; skipped arcs: start, end, whether a tail follows, 8 numbers a component; end: t, closed, x, v
//! ```

use super::path::{Kind, MechanicalPath, Segment};
use super::tail::SkippedArcs;
use crate::numeric::bernstein::MOST_DEGREE;
use crate::record::gap_set::GapSet;
use crate::record::point::MotionPoint;
use crate::system::dynamics::{Layout, MOST};
use crate::zeno::tail::{Tail, TAIL_NUMBERS};

const VERSION: f64 = 1.0;
const HEAD: usize = 6;
const SEGMENT: usize = 7;

/// A set as two numbers that hold 32 gaps each exactly.
fn halves(set: GapSet) -> [f64; 2] {
    [(set.0 & 0xffff_ffff) as f64, (set.0 >> 32) as f64]
}

fn set_of(low: f64, high: f64) -> Option<GapSet> {
    let half = |value: f64| count(value).filter(|&bits| bits <= 0xffff_ffff);
    Some(GapSet(half(low)? as u64 | (half(high)? as u64) << 32))
}

/// A number that is a count.
fn count(value: f64) -> Option<usize> {
    ((0.0..1e15).contains(&value) && value.fract() == 0.0).then_some(value as usize)
}

impl MechanicalPath {
    /// All that it consists of.
    #[must_use]
    pub fn to_numbers(&self) -> Vec<f64> {
        let Layout { n, m } = self.layout;
        let counts = [n, m, self.segments.len(), self.coefficients.len(), self.skipped.len()];
        let mut numbers = vec![VERSION];
        numbers.extend(counts.iter().map(|&count| count as f64));
        for Segment { start, closed, kind } in &self.segments {
            let [low, high] = halves(*closed);
            numbers.extend([*start, low, high]);
            numbers.extend(match *kind {
                Kind::Motion { first, degree, h } => [0.0, first as f64, degree as f64, h],
                Kind::Skipped(number) => [1.0, number as f64, 0.0, 0.0],
            });
        }
        numbers.extend(&self.coefficients);
        for arcs in &self.skipped {
            numbers.extend([arcs.start, arcs.end, f64::from(u8::from(arcs.arcs.is_some()))]);
            numbers.extend(arcs.arcs.iter().flat_map(Tail::to_numbers));
            numbers.extend(arcs.rows.iter().flatten());
        }
        if let Some((t, point)) = &self.end {
            numbers.push(*t);
            numbers.extend(halves(point.closed));
            numbers.extend(point.x.iter().chain(&point.v));
        }
        numbers
    }

    /// What [`MechanicalPath::to_numbers`] came from; `None` for numbers that are none of a motion.
    #[must_use]
    pub fn from_numbers(numbers: &[f64]) -> Option<Self> {
        let (head, mut rest) = numbers.split_at_checked(HEAD)?;
        let counts: Vec<usize> = head[1..].iter().map(|&it| count(it)).collect::<Option<_>>()?;
        let &[n, m, segments, coefficients, skipped] = &counts[..] else { return None };
        if head[0] != VERSION || n == 0 || n > MOST || m > MOST {
            return None;
        }
        let (layout, size) = (Layout { n, m }, n + m);
        let mut path = Self::new(layout);
        for segment in take(&mut rest, segments.checked_mul(SEGMENT)?)?.chunks_exact(SEGMENT) {
            path.segments.push(segment_of(segment, size, coefficients, skipped)?);
        }
        path.coefficients = take(&mut rest, coefficients)?.to_vec();
        for _ in 0..skipped {
            let &[start, end, known] = take(&mut rest, 3)? else { return None };
            let arcs = match known {
                0.0 => None,
                _ => Some(Tail::from_numbers(take(&mut rest, TAIL_NUMBERS)?)?),
            };
            let rows = take(&mut rest, 8 * size)?.chunks_exact(8);
            let rows = rows.map(|row| row.try_into().ok()).collect::<Option<Vec<[f64; 8]>>>()?;
            path.skipped.push(SkippedArcs { start, end, arcs, rows });
        }
        if let [t, low, high, state @ ..] = rest {
            let (x, v) = state.split_at_checked(size).filter(|(_, v)| v.len() == size)?;
            let point = MotionPoint { x: x.to_vec(), v: v.to_vec(), closed: set_of(*low, *high)? };
            path.end = Some((*t, point));
        } else if !rest.is_empty() {
            return None;
        }
        let ordered = path.segments.windows(2).all(|pair| pair[0].start < pair[1].start);
        (ordered && numbers.iter().all(|number| number.is_finite())).then_some(path)
    }
}

fn segment_of(
    numbers: &[f64],
    size: usize,
    coefficients: usize,
    skipped: usize,
) -> Option<Segment> {
    let &[start, low, high, kind, first, degree, h] = numbers else { return None };
    let first = count(first)?;
    let kind = if kind == 0.0 {
        let degree = count(degree).filter(|degree| (1..=MOST_DEGREE).contains(degree))?;
        let end = first.checked_add(2 * size * (degree + 1))?;
        (end <= coefficients && h > 0.0).then_some(Kind::Motion { first, degree, h })?
    } else {
        (kind == 1.0 && first < skipped).then_some(Kind::Skipped(first))?
    };
    Some(Segment { start, closed: set_of(low, high)?, kind })
}

/// The first `length` numbers of the rest, which keeps the others.
fn take<'n>(rest: &mut &'n [f64], length: usize) -> Option<&'n [f64]> {
    let (head, tail) = rest.split_at_checked(length)?;
    *rest = tail;
    Some(head)
}
