//! The motion of a mechanical system as plain numbers, behind the header of
//! [`crate::record::stored`].
//!
//! ```text
//! path     [ n, m, p, segments, coefficients, skipped arcs,  the segments,  the coefficients,
//!            the skipped arcs,  t, closed, x, v of the end, if there is one ]
//! segment  [ start, mode, kind (0 motion, 1 skipped), first, degree, h ]
//! arcs     [ start, end, whether a tail follows,  the tail,  8 numbers of each component,
//!            how many slips that impacts stop, 2 numbers of each component and 10 of each of them,
//!            how many corrections, the component and 25 numbers of each ]
//! mode     [ closed, slipping up, slipping down, sticking (numbers of 32 gaps each, two at least) ]
//! ```
//!
//! Before format 6 arcs had neither slips nor corrections. Before format 5 there was no friction, nor `p`, before format 4 tails had no accelerations.

use super::path::{Kind, MechanicalPath, Segment, MOST_SEGMENT_DEGREE};
use super::tail::{Correction, SkippedArcs, StoppedSlip};
use crate::record::contact_mode::ContactMode;
use crate::record::gap_set::GapSet;
use crate::record::point::MotionPoint;
use crate::record::stored::{as_count, Kind as Stored, MotionError, Reader, Writer};
use crate::system::dynamics::{Layout, MOST};
use crate::zeno::tail::Tail;

fn numbers_of(mode: ContactMode, rows: usize) -> impl Iterator<Item = f64> {
    let ContactMode { closed, slip_plus, slip_minus, stick } = mode;
    [closed, slip_plus, slip_minus, stick].into_iter().flat_map(move |set| set.halves(rows))
}

fn read_mode(from: &mut Reader<'_>, rows: usize, without_friction: bool) -> Option<ContactMode> {
    let half = |&value: &f64| as_count(value).and_then(|bits| u32::try_from(bits).ok());
    let mut set = || {
        let halves = from.take(GapSet::n_halves(rows))?;
        let halves: Option<Vec<u32>> = halves.iter().map(half).collect();
        halves.map(|halves| GapSet::of_halves(&halves))
    };
    let closed = set()?;
    if without_friction {
        return Some(closed.into());
    }
    let (slip_plus, slip_minus, stick) = (set()?, set()?, set()?);
    Some(ContactMode { closed, slip_plus, slip_minus, stick })
}

impl MechanicalPath {
    /// All that it consists of.
    #[must_use]
    pub fn to_numbers(&self) -> Option<Vec<f64>> {
        let mut out = Writer::new(Stored::Mechanism);
        let Layout { n, m, p } = self.layout;
        for count in [n, m, p, self.segments.len(), self.coefficients.len(), self.skipped.len()] {
            out.count(count);
        }
        for Segment { start, mode, kind } in &self.segments {
            out.number(*start);
            out.numbers(&numbers_of(*mode, m + p).collect::<Vec<_>>());
            out.numbers(&match *kind {
                Kind::Motion { first, degree, h } => [0.0, first as f64, degree as f64, h],
                Kind::Skipped(number) => [1.0, number as f64, 0.0, 0.0],
            });
        }
        out.numbers(&self.coefficients);
        for SkippedArcs { start, end, arcs, rows, slips, corrections } in &self.skipped {
            out.numbers(&[*start, *end]);
            out.flag(arcs.is_some());
            arcs.iter().for_each(|tail| out.numbers(&tail.to_numbers()));
            out.numbers(rows.iter().flatten());
            out.count(slips.len());
            for StoppedSlip { ways, accelerations } in slips {
                out.numbers(ways.iter().flatten());
                out.numbers(accelerations.iter().flatten());
            }
            out.count(corrections.len());
            for Correction { component, accelerations, jumps, .. } in corrections {
                out.count(*component);
                out.numbers(accelerations.iter().flatten().chain(jumps));
            }
        }
        if let Some((t, point)) = &self.end {
            out.number(*t);
            out.numbers(&numbers_of(point.mode, m + p).collect::<Vec<_>>());
            out.numbers(point.x.iter().chain(&point.v));
        }
        out.finish()
    }

    /// What [`MechanicalPath::to_numbers`] came from.
    ///
    /// # Errors
    /// [`MotionError`] for numbers that are none of a motion.
    pub fn from_numbers(numbers: &[f64]) -> Result<Self, MotionError> {
        Reader::read(Stored::Mechanism, numbers, Self::read)
    }

    fn read(from: &mut Reader<'_>) -> Option<Self> {
        let finite = from.is_finite();
        let old = from.format() < 5.0;
        let [n, m] = from.counts()?;
        let [p] = if old { [0] } else { from.counts()? };
        let [segments, coefficients, skipped] = from.counts()?;
        if !finite || n == 0 || n > MOST || m > MOST || p > MOST || m + p > MOST {
            return None;
        }
        let layout = Layout { n, m, p };
        let size = layout.size();
        let mut path = Self::new(layout);
        for _ in 0..segments {
            let [start] = from.row()?;
            let mode = read_mode(from, m + p, old)?;
            path.segments.push(segment_of(
                (start, mode),
                from.row()?,
                size,
                coefficients,
                skipped,
            )?);
        }
        path.coefficients = from.take(coefficients)?.to_vec();
        for _ in 0..skipped {
            let [start, end] = from.row()?;
            let arcs = match from.flag()? {
                false => None,
                true => Some(Box::new(Tail::read(from)?)),
            };
            let bare = SkippedArcs::of_rows(start, end, from.rows(size)?);
            let mut it = SkippedArcs { arcs, ..bare };
            if from.format() >= 6.0 {
                read_additions(from, size, &mut it)?;
            }
            path.skipped.push(it);
        }
        if !from.is_empty() {
            let [t] = from.row()?;
            let mode = read_mode(from, m + p, old)?;
            let (x, v) = (from.take(size)?.to_vec(), from.take(size)?.to_vec());
            path.end = Some((t, MotionPoint { x, v, mode }));
        }
        let ordered = path.segments.windows(2).all(|pair| pair[0].start < pair[1].start);
        ordered.then_some(path)
    }
}

/// What is added along arcs.
fn read_additions(from: &mut Reader<'_>, size: usize, to: &mut SkippedArcs) -> Option<()> {
    let [slips] = from.counts()?;
    for _ in 0..slips {
        let ways = [from.take(size)?.to_vec(), from.take(size)?.to_vec()];
        to.slips.push(StoppedSlip { ways, accelerations: [from.row()?, from.row()?] });
    }
    let [corrections] = from.counts()?;
    for _ in 0..corrections {
        let [component] = from.counts()?;
        let of = ([from.row()?, from.row()?, from.row()?, from.row()?], from.row()?);
        let tail = to.arcs.as_ref().filter(|_| component < size)?;
        to.corrections.push(Correction::new(component, of, tail));
    }
    Some(())
}

fn segment_of(
    (start, mode): (f64, ContactMode),
    [kind, first, degree, h]: [f64; 4],
    size: usize,
    coefficients: usize,
    skipped: usize,
) -> Option<Segment> {
    let first = as_count(first)?;
    let kind = if kind == 0.0 {
        let degree =
            as_count(degree).filter(|degree| (1..=MOST_SEGMENT_DEGREE).contains(degree))?;
        let end = first.checked_add(2 * size * (degree + 1))?;
        (end <= coefficients && h > 0.0).then_some(Kind::Motion { first, degree, h })?
    } else {
        (kind == 1.0 && first < skipped).then_some(Kind::Skipped(first))?
    };
    Some(Segment { start, mode, kind })
}
