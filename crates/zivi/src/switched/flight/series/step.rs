//! A step of a flight: as far as nothing can happen, or up to the wall.

use pulp::{Simd, WithSimd};

use super::root::{first_root, of_short_arc, only_root, SeriesRoot};
use super::table::{Table, PART, SHORT};
use crate::numeric::power_series::{of_few, stretch, value_and_slope};
use crate::switched::flight::series::law::{Series, SeriesStart, TERMS};
use crate::switched::flight::series::level::SignTest;

/// A step that ends at most this part of it after its end is no longer: what rounding makes of it.
const OVER: f64 = 1.0 + 1e-9;

/// By how much a step near the wall is longer than the arc under a constant force.
const ARC: f64 = 1.3;

/// A step, or several together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Step {
    /// Its length, in steps of the table.
    pub(crate) length: f64,
    /// `2^j` whole steps.
    pub(crate) doublings: Option<usize>,
    /// Position, and velocity times the step of the table, at its end.
    pub(crate) x: f64,
    pub(crate) v: f64,
    /// Whether that is at the wall.
    pub(crate) lands: bool,
    /// Whether it has the full allowed length.
    pub(crate) complete: bool,
}

/// How a step ends: where, as `x` and `V`, and whether at the wall.
type End = (f64, [f64; 2], bool);

impl Step {
    /// The next step of a flight with one wave, however long.
    #[inline]
    pub(crate) fn next(table: &Table, start: &SeriesStart, known: usize, far: bool) -> Self {
        let left = f64::INFINITY;
        let outlook = StepAhead::of::<1>(table, start, known, left).map(|ahead| ahead.outlook);
        Self::with_waves::<1>(table, start, known, left, far, outlook)
    }

    /// The next step of a flight, at most `left` long: many at once where they stay far from the
    /// wall and `far` allows it, else one, or the part of one up to the wall. The first `known`
    /// derivatives of the position are zero at its start. `outlook` is the result of
    /// [`StepAhead::of`].
    #[inline(always)]
    pub(super) fn with_waves<const W: usize>(
        table: &Table,
        start: &SeriesStart,
        known: usize,
        left: f64,
        far: bool,
        outlook: Option<Outlook>,
    ) -> Self {
        let mut doublings = None;
        let jump = |doublings: &mut Option<usize>| {
            *doublings = if far { table.far::<W>(start, left) } else { None };
            doublings.map(|j| (f64::from(1u32 << j), table.ends::<W>(start, j), false))
        };
        let (length, [x, v], root) = if let Some(outlook) = outlook {
            judged::<W>(table, start, known, left, outlook)
        } else if let Some(end) = of_parabola(table, start, known, left) {
            end
        } else if known > 1 {
            searched(table, start, known, left)
        } else if let Some(end) = jump(&mut doublings) {
            end
        } else if left <= 1.0 && table.is_clear::<W>(start, left) {
            (left, part_of::<W>(table, start, left), false)
        } else {
            single::<W>(table, start, known, left)
        };
        Self {
            length,
            doublings,
            // not max, which would drop NaN
            x: if x < 0.0 { 0.0 } else { x },
            v,
            // less than rounding above the wall, and moving to it
            lands: root || (x <= 0.0 && v < 0.0),
            complete: !root && left <= length * OVER,
        }
    }
}

/// Of one step of an ordinary flight.
#[inline(always)]
fn single<const W: usize>(table: &Table, start: &SeriesStart, known: usize, left: f64) -> End {
    if known == 1 && table.is_short::<W>(start) {
        let a = table.first::<W, SHORT>(start);
        let root = of_short_arc(&a, table.beyond::<W>(start)).filter(|root| root.at <= left);
        if let Some(SeriesRoot { at, slope }) = root {
            return (at, [0.0, slope], true);
        }
    }
    judged::<W>(table, start, known, left, Outlook::of::<W>(table, start, known))
}

/// A whole step of an ordinary flight: where it ends if nothing is in the way, and whether something
/// is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StepAhead {
    pub(super) ends: [f64; 2],
    pub(super) outlook: Outlook,
}

impl StepAhead {
    /// The usual case: a step is shorter than the rest, starts at x <= 0 with a flight that is not
    /// short, and no bound allows more than a step.
    #[inline(always)]
    pub(super) fn of<const W: usize>(
        table: &Table,
        start: &SeriesStart,
        known: usize,
        left: f64,
    ) -> Option<Self> {
        if !(left > OVER && known < 2) || table.leaps() {
            return None;
        }
        let ends = table.ends::<W>(start, 0);
        if table.is_clear_between::<W>(start, known, ends) {
            return Some(Self { ends, outlook: Outlook::Clear });
        }
        let is_short = known == 1 && table.is_short::<W>(start);
        (!is_short).then(|| Self { ends, outlook: Outlook::of::<W>(table, start, known) })
    }
}

/// Outcome of a full step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Outlook {
    /// It stays above the wall.
    Clear,
    /// It meets the wall once, here.
    Wall(SeriesRoot),
    Open,
}

impl Outlook {
    /// By the Bernstein coefficients of the step.
    #[inline(always)]
    fn of<const W: usize>(table: &Table, start: &SeriesStart, known: usize) -> Self {
        pulp::Arch::new().dispatch(Looked::<W> { table, start, known })
    }
}

/// [`Outlook::of`], compiled for the vectors that the machine has.
struct Looked<'a, const W: usize> {
    table: &'a Table,
    start: &'a SeriesStart,
    known: usize,
}

impl<const W: usize> WithSimd for Looked<'_, W> {
    type Output = Outlook;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Outlook {
        let Self { table, start, known } = self;
        match table.screened::<W>(start, known) {
            SignTest::Clear => Outlook::Clear,
            SignTest::One(guess) => {
                let SeriesRoot { at, slope } =
                    only_root(&series_of::<W>(table, start, known), guess);
                Outlook::Wall(SeriesRoot { at, slope: slope.min(0.0) })
            }
            SignTest::Open => Outlook::Open,
        }
    }
}

/// The series of a step, at most the first of whose derivatives is zero at its start.
#[inline(always)]
fn series_of<const W: usize>(table: &Table, start: &SeriesStart, known: usize) -> Series {
    let mut a = table.first::<W, TERMS>(start);
    if known == 1 {
        a[0] = 0.0;
    }
    a
}

/// Of one step of which that is known.
#[inline(always)]
fn judged<const W: usize>(
    table: &Table,
    start: &SeriesStart,
    known: usize,
    left: f64,
    outlook: Outlook,
) -> End {
    match outlook {
        Outlook::Clear if left > 1.0 => (1.0, table.ends::<W>(start, 0), false),
        Outlook::Clear => (left, part_of::<W>(table, start, left), false),
        Outlook::Open => searched(table, start, known, left),
        Outlook::Wall(SeriesRoot { at, slope }) if at <= left => (at, [0.0, slope], true),
        Outlook::Wall(_) => (left, short_of_the_wall::<W>(table, start, known, left), false),
    }
}

/// Position and velocity after a part of a step that ends before the wall.
#[cold]
fn short_of_the_wall<const W: usize>(
    table: &Table,
    start: &SeriesStart,
    known: usize,
    left: f64,
) -> [f64; 2] {
    value_and_slope(&series_of::<W>(table, start, known), left)
}

/// Position and velocity after a part of a step.
#[inline(always)]
fn part_of<const W: usize>(table: &Table, start: &SeriesStart, part: f64) -> [f64; 2] {
    if part <= PART {
        of_few(&table.first::<W, SHORT>(start), part)
    } else {
        value_and_slope(&table.first::<W, TERMS>(start), part)
    }
}

/// The root of a parabola at the wall, in a form without cancellation, unless it is not a parabola
/// or its numbers are too large to be squared.
#[inline]
fn of_parabola(table: &Table, start: &SeriesStart, known: usize, left: f64) -> Option<End> {
    const USUAL: std::ops::Range<f64> = 1e-290..1e290;
    if !table.is_parabola() {
        return None;
    }
    let (x, v, bend) = (start.x, start.v, 0.5 * table.h() * table.h() * start.force);
    let square = v * v - 4.0 * bend * x;
    let (at, slope) = match known {
        0 if !USUAL.contains(&square.abs()) => return None,
        0 if square < 0.0 => (f64::INFINITY, 0.0),
        0 if v < 0.0 => (2.0 * x / (square.sqrt() - v), -square.sqrt()),
        0 if bend < 0.0 => ((v + square.sqrt()) / (-2.0 * bend), -square.sqrt()),
        1 if bend < 0.0 => (-v / bend, -v),
        _ => (f64::INFINITY, 0.0),
    };
    if at <= left {
        return Some((at, [0.0, slope], true));
    }
    let (x, v) = (if known > 0 { 0.0 } else { x }, if known > 1 { 0.0 } else { v });
    Some((left, [x + left * (v + bend * left), v + 2.0 * bend * left], false))
}

/// End of a step with an exhaustive search for the wall.
#[cold]
fn searched(table: &Table, start: &SeriesStart, known: usize, left: f64) -> End {
    let mut a = table.series(start);
    a[..known].fill(0.0);
    let width = width(table, &a, known, left);
    stretch(&mut a, width);
    if let Some(root) = first_root(&a, known).filter(|root| root.at * width <= left) {
        return (root.at * width, [0.0, root.slope.min(0.0) / width], true);
    }
    let part = if left <= width * OVER { left / width } else { 1.0 };
    let [x, slope] = value_and_slope(&a, part);
    (part * width, [x, slope / width], false)
}

/// Range of the search for the wall: a power of two times the step. A step of a motion that hardly
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::power_series::{derivative, value};
    use crate::switched::flight::series::law::Law;

    fn random(draw: &mut u64) -> f64 {
        *draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (*draw >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// Every step, whichever way it took, against values of its series: above the wall before its
    /// end, at the wall there if it lands, its velocity that of a difference.
    fn check(law: Law, seed: u64) -> [u32; 2] {
        let (table, mut draw, mut counts) = (Table::new(law, f64::INFINITY), seed, [0; 2]);
        for _ in 0..4000 {
            let mut r = || random(&mut draw);
            let speed = 10.0_f64.powf(-3.0 + 3.0 * r());
            let known = usize::from(r() > 0.0);
            let x = if known == 1 { 0.0 } else { r().abs() * speed };
            let v = if known == 1 { speed } else { speed * r() };
            let waves = [[r(), r()], [0.0; 2]];
            let start = SeriesStart { x, v, force: r() - 0.5, waves };
            let left = if r() > 0.0 { 0.5 + 0.5 * r() } else { 5.0 };
            let outlook =
                StepAhead::of::<1>(&table, &start, known, left).map(|ahead| ahead.outlook);
            let step = Step::with_waves::<1>(&table, &start, known, left, true, outlook);
            assert!(step.length > 0.0 && step.length <= left);
            counts[usize::from(step.lands)] += 1;
            let whole = step.doublings.map_or(step.length, |j| f64::from(1 << j));
            if whole > 1.0 {
                continue; // levels have tests of their own
            }
            let mut a = table.series(&start);
            a[..known].fill(0.0);
            // divided by what is known to be zero at the start
            let size = a.iter().map(|a| a.abs()).sum::<f64>();
            for k in 1..60 {
                let s = whole * f64::from(k) / 60.0;
                assert!(value(&a, s) > -1e-15 * size, "{start:?} {known} {k} {step:?}");
            }
            let end = value(&a, whole);
            assert!((end - step.x).abs() < 1e-15 * size, "{start:?} {known} {step:?} {end:e}");
            let slope = value(&derivative(&a), whole);
            assert!((slope - step.v).abs() < 4e-15 * size, "{start:?} {known} {step:?} {slope}");
        }
        counts
    }

    #[test]
    fn steps_end_at_the_wall_or_above_it() {
        let laws = [
            Law { stiffness: 2.0, damping: 0.3, omega: [1.7, 0.0] },
            Law { stiffness: -1.0, damping: -0.1, omega: [0.9, 0.0] },
            Law { stiffness: 0.0, damping: 0.0, omega: [30.0, 0.0] },
            Law { stiffness: 0.0, damping: 0.0, omega: [0.0; 2] },
        ];
        for (law, seed) in laws.into_iter().zip(3..) {
            let counts = check(law, seed);
            assert!(counts.iter().all(|&count| count > 300), "{law:?} {counts:?}");
        }
    }

    #[test]
    fn what_is_ahead_is_a_whole_step_and_nothing_else() {
        let law = Law { stiffness: 1.0, damping: 0.1, omega: [0.9, 0.0] };
        let table = Table::new(law, f64::INFINITY);
        let ahead =
            |start: SeriesStart, known, left| StepAhead::of::<1>(&table, &start, known, left);
        let high = SeriesStart { x: 1.0, v: 0.1, force: 1.0, ..SeriesStart::default() };
        let ends = table.ends::<1>(&high, 0);
        let clear = Some(StepAhead { ends, outlook: Outlook::Clear });
        assert_eq!(ahead(high, 0, 1.1), clear);
        // what is left is less, or a step but for rounding
        assert_eq!(ahead(high, 0, 0.9), None);
        assert_eq!(ahead(high, 0, 1.0 + 1e-10), None);
        let from_wall = SeriesStart { x: 0.0, ..high };
        assert!(ahead(from_wall, 1, 1.1).is_some_and(|ahead| ahead.outlook == Outlook::Clear));
        assert_eq!(ahead(from_wall, 2, 1.1), None);
        // down onto the wall, and a short arc
        let down = SeriesStart { v: -1.5, force: -1.0, ..high };
        assert!(ahead(down, 0, 1.1).is_some_and(|it| matches!(it.outlook, Outlook::Wall(_))));
        assert_eq!(ahead(SeriesStart { v: 1e-3, force: -1.0, ..from_wall }, 1, 1.1), None);
        // where a bound is low enough for many steps that is tried first
        let free = Table::new(Law { stiffness: 0.0, ..law }, 0.1);
        assert!(free.leaps() && StepAhead::of::<1>(&free, &high, 0, 1.1).is_none());
    }

    #[test]
    fn a_motion_that_does_not_turn_is_searched_over_a_whole_step() {
        let law = Law { stiffness: 1.0, damping: 0.0, omega: [0.0; 2] };
        let table = Table::new(law, f64::INFINITY);
        let mut a = [0.0; TERMS];
        // from the wall, faster and faster: no arc
        (a[1], a[2]) = (1e-3, 0.5);
        assert_eq!(width(&table, &a, 1, 10.0), 1.0);
        // back at the wall after 1e-3 of a step
        (a[1], a[2]) = (1e-3, -1.0);
        assert!((1e-3..0.1).contains(&width(&table, &a, 1, 10.0)));
    }

    #[test]
    fn the_wall_is_looked_for_beyond_the_end_of_the_parabola() {
        let law = Law { stiffness: 1.0, damping: 0.0, omega: [0.0; 2] };
        let table = Table::new(law, f64::INFINITY);
        // x + v s + bend s^2 = -bend (s + before) (arc - s)
        for (before, arc, bend) in [(0.4, 0.013, -1.0), (1e-4, 3e-3, -2.0), (0.02, 0.02, -0.1)] {
            let mut a = [0.0; TERMS];
            (a[0], a[1], a[2]) = (-bend * before * arc, -bend * (arc - before), bend);
            let found = width(&table, &a, 0, 10.0);
            assert!(found >= ARC * arc * 0.999 && found <= 2.0 * ARC * arc, "{arc} {found}");
            assert_eq!(found.log2().fract(), 0.0);
        }
        // one that turns back before the wall, and one that rises for ever
        for (x, v, bend) in [(1.0, -0.1, 0.5), (1.0, 0.1, 0.5)] {
            let mut a = [0.0; TERMS];
            (a[0], a[1], a[2]) = (x, v, bend);
            assert_eq!(width(&table, &a, 0, 10.0), 1.0);
        }
    }

    #[test]
    fn a_short_arc_has_the_digits_of_its_speed() {
        // x'' = -g: back at the wall after 2 u/g, however small u is; the spring hardly acts
        let law = Law { stiffness: 1.0, damping: 0.0, omega: [0.0; 2] };
        let table = Table::new(law, f64::INFINITY);
        for u in [1e-3, 1e-7, 1e-11] {
            let v = u * table.h();
            let start = SeriesStart { x: 0.0, v, force: -1.0, ..SeriesStart::default() };
            let step = Step::with_waves::<0>(&table, &start, 1, 10.0, true, None);
            // x = -1 + cos t + u sin t: zero at 2 atan u with the velocity -u
            let exact = 2.0 * u.atan();
            assert!((step.length * table.h() / exact - 1.0).abs() < 1e-15, "{u}");
            assert!(step.lands && (step.v / v + 1.0).abs() < 2e-15, "{u} {:e}", step.v / v + 1.0);
        }
    }
}
