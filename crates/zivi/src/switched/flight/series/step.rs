//! A step of a flight: as far as nothing can happen, or up to the wall.

use super::root::{derivative, first_root, value};
use super::table::{Series, Start, Table, TERMS};

/// A step that ends at most this part of it after its end is no longer: what rounding makes of it.
const OVER: f64 = 1.0 + 1e-9;

/// By how much a step near the wall is longer than the arc under a constant force.
const ARC: f64 = 1.3;

/// A step, or many at once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Step {
    pub(crate) start: Start,
    /// The position by powers of the part of a longer stretch, unless it is several whole steps.
    series: Series,
    /// Which part of that it is.
    part: f64,
    /// Its length, in steps of the table.
    pub(crate) length: f64,
    /// `2^j` whole steps.
    pub(crate) doublings: Option<usize>,
    /// Position, and velocity times the step of the table, at its end.
    pub(crate) x: f64,
    pub(crate) v: f64,
    /// Whether that is at the wall.
    pub(crate) lands: bool,
    /// Whether it goes as far as it was allowed to.
    pub(crate) complete: bool,
}

impl Step {
    pub(crate) const NONE: Self = Self {
        start: Start { x: 0.0, v: 0.0, force: 0.0, waves: [[0.0; 2]; 2] },
        series: [0.0; TERMS],
        part: 1.0,
        length: 0.0,
        doublings: None,
        x: 0.0,
        v: 0.0,
        lands: false,
        complete: false,
    };

    /// The next step of a flight, at most `left` long: many at once where they stay far from the
    /// wall and `far` allows it, else one, or the part of one up to the wall. The first `known`
    /// derivatives of the position are zero at its start.
    #[inline]
    pub(crate) fn next(table: &Table, start: &Start, known: usize, left: f64, far: bool) -> Self {
        if far && known == 0 && !table.is_parabola() {
            if let Some(j) = table.far(start, left) {
                let end = table.jump(start, j);
                let length = f64::from(1u32 << j);
                let (doublings, complete) = (Some(j), left <= length);
                let (start, x, v) = (*start, end.x, end.v);
                return Self { start, length, doublings, x, v, complete, ..Self::NONE };
            }
        }
        let mut a = table.series(start);
        a[..known].fill(0.0);
        let width = width(table, &a, known, left);
        stretch(&mut a, width);
        let root = first_root(&a, known).filter(|root| root.at * width <= left);
        let reaches = left <= width * OVER;
        let (part, x, slope) = match root {
            Some(root) => (root.at, 0.0, root.slope.min(0.0)),
            None if width == 1.0 && left > 1.0 && known < 2 => {
                let end = table.jump(start, 0);
                (1.0, end.x, end.v)
            }
            None => {
                let part = if reaches { left / width } else { 1.0 };
                (part, value(&a, part), value(&derivative(&a), part))
            }
        };
        Self {
            start: *start,
            series: a,
            part,
            length: part * width,
            doublings: None,
            // not max, which would drop NaN
            x: if x < 0.0 { 0.0 } else { x },
            v: slope / width,
            // less than rounding above the wall, and moving to it
            lands: root.is_some() || (x <= 0.0 && slope < 0.0),
            complete: root.is_none() && reaches,
        }
    }
}

impl Step {
    /// The position by powers of the part of the step, which is not several at once.
    pub(crate) fn series(&self) -> Series {
        let mut a = self.series;
        stretch(&mut a, self.part);
        a
    }
}

/// Up to where to look for the wall: a power of two times the step. A step of a motion that hardly
/// turns may be far longer than an arc.
fn width(table: &Table, a: &Series, known: usize, left: f64) -> f64 {
    let [x, v, bend, ..] = *a;
    let arc = match known {
        // the form without cancellation
        0 if v < 0.0 => 2.0 * x / ((v * v - 4.0 * bend * x).sqrt() - v),
        0 if bend < 0.0 => (v + (v * v - 4.0 * bend * x).sqrt()) / (-2.0 * bend),
        1 if bend < 0.0 => -v / bend,
        _ => f64::INFINITY,
    };
    let longest = if table.is_parabola() { f64::INFINITY } else { 1.0 };
    // a root of a negative number is none, and min drops NaN
    let wanted = longest.min(ARC * arc).min(left);
    let power = power_of_two(wanted);
    if wanted > power * OVER {
        2.0 * power
    } else {
        power
    }
}

/// The largest power of two that is not larger, for a positive number.
fn power_of_two(x: f64) -> f64 {
    const EXPONENT: u64 = 0x7ff0_0000_0000_0000;
    let power = f64::from_bits(x.to_bits() & EXPONENT);
    // all of them are finite
    power.clamp(f64::MIN_POSITIVE, 1e300)
}

/// The series of a part of what it was one of.
#[inline]
pub(crate) fn stretch(a: &mut Series, part: f64) {
    if part == 1.0 {
        return;
    }
    let mut power = 1.0;
    for a in a.iter_mut() {
        *a *= power;
        power *= part;
    }
}
