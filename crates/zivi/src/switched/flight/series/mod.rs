//! Flights under linear forces, to rounding: power series over steps, their first roots certified.
//!
//! A step evaluates no force and has no error to control. The clock of the first wave counts whole
//! turns and the part of one, and the time is read from it: phase and time cannot drift relative to
//! each other.

pub(in crate::switched) mod table;

use std::sync::Arc;

use pulp::{Simd, WithSimd};
use table::{screened, LinearColumns, SignTest, COLUMNS, PART, SHORT, WAVES};

use crate::numeric::bernstein::Polynomial;
use crate::numeric::power_series::{of_few, slopes, stretch, stretch_and_size};
use crate::numeric::root::sin_cos;
use crate::switched::mode::Point;
use crate::LinearLaw;

pub(crate) use table::{column, wave, Linear, Series, SeriesStart, Table, WaveReading, TERMS};

pub(crate) use crate::numeric::power_series::{derivative, value, value_and_slope};

/// Flights under one linear force.
#[derive(Clone, Debug)]
pub(crate) struct SeriesFlight {
    law: LinearLaw,
    linear: Linear,
    table: Arc<Table>,
    /// The waves, and the time that they are at.
    clock: WaveReading,
    at: (f64, f64),
    /// The last velocity, and its product with the step length.
    speed: (f64, f64),
    /// Flights of one length again and again.
    period: RepeatedFlight,
    /// The last step.
    piece: FlownSteps,
}

/// How far to fly.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reach {
    /// Up to this time.
    pub(crate) t_end: f64,
    /// Up to the end of the first step that ends later than this.
    pub(crate) look: f64,
    /// So many steps at most.
    pub(crate) steps: usize,
}

/// The end of a flight or of a part of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arrival {
    /// Where the last step started.
    pub(crate) from: Point,
    /// Where it ended.
    pub(crate) end: Point,
    /// Whether that is at the wall.
    pub(crate) lands: bool,
    /// How many steps there were.
    pub(crate) steps: usize,
}

/// The last step of a flight, or several together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct FlownSteps {
    /// Its initial point and data.
    from: Point,
    start: SeriesStart,
    /// How many derivatives of the position were zero there.
    known: usize,
    step: Step,
}

/// A part of a flight by its initial data: a third of the numbers of its power series, which
/// follows from them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct FlightPart {
    pub(crate) start: SeriesStart,
    /// How many derivatives of the position are zero there.
    pub(crate) known: usize,
    /// Its length, in steps of the table.
    pub(crate) length: f64,
    /// The velocity at its start (m/s).
    pub(crate) xdot: f64,
    /// Whether it ends at the wall.
    pub(crate) lands: bool,
}

impl FlightPart {
    /// The position by powers of the part of its length.
    #[inline(always)]
    pub(crate) fn powers(&self, table: &Table) -> Series {
        let mut a = table.series(&self.start);
        a[..self.known].fill(0.0);
        stretch(&mut a, self.length);
        a
    }

    /// Writes them, the second as `second`, and gives the sums of their sizes, as
    /// [`stretch_and_size`] does.
    #[inline(always)]
    pub(crate) fn write_powers(&self, table: &Table, second: f64, to: &mut Series) -> [f64; 4] {
        *to = table.series(&self.start);
        to[..self.known].fill(0.0);
        stretch_and_size(to, self.length, second)
    }

    /// The first of them, up to rounding.
    #[inline(always)]
    pub(crate) fn first_powers(&self, table: &Table) -> [f64; 3] {
        let SeriesStart { x, v, .. } = self.start;
        [x, v * self.length, table.bend(&self.start) * self.length * self.length]
    }
}

impl SeriesFlight {
    /// The flights under a law, unless its numbers are too large.
    pub(crate) fn new(law: LinearLaw) -> Option<Self> {
        let linear = Linear::new(&law);
        let table = Table::shared(linear.table_law());
        let usable = table.h() > 1e-100 && table.h() < 1e100;
        let piece = FlownSteps::default();
        let (clock, at, speed) = (WaveReading::default(), (f64::NAN, f64::NAN), (f64::NAN, 0.0));
        let period = RepeatedFlight::default();
        usable.then_some(Self { law, linear, table, clock, at, speed, period, piece })
    }

    /// Goes over to another law where that differs in its constant alone: a control that is held.
    #[inline]
    pub(crate) fn under(&mut self, law: &LinearLaw) -> bool {
        let LinearLaw { stiffness, damping, gravity, waves } = *law;
        let own = &self.law;
        if (stiffness, damping) != (own.stiffness, own.damping) || waves != own.waves {
            return false;
        }
        self.linear.pulled_by(gravity);
        self.law.gravity = gravity;
        true
    }

    /// Forgets the flights so far.
    pub(crate) fn start(&mut self) {
        (self.at, self.speed) = ((f64::NAN, f64::NAN), (f64::NAN, 0.0));
        self.period = RepeatedFlight::default();
    }

    /// The force.
    pub(crate) fn linear(&self) -> &Linear {
        &self.linear
    }

    /// Reads the clock, unless that was done.
    #[inline(always)]
    fn look_at_clock(&mut self, now: Point) {
        if let Some(wave) = self.linear.first() {
            let at = (now.t, now.late);
            if self.at != at {
                self.clock = WaveReading::new(&self.linear, wave.clock.phase(now.t, now.late), at);
                self.at = at;
            }
        }
    }

    /// The force at rest at the wall, where the clock stands at that time.
    #[inline]
    pub(crate) fn at_wall(&self, now: Point) -> Option<f64> {
        let stands = self.linear.first().is_none() || self.at == (now.t, now.late);
        let [[first, _], [second, _]] = self.clock.waves;
        stands.then_some(self.linear.constant + first + second)
    }

    /// From here as far as that reaches or up to the wall. The first `known` derivatives of the
    /// position are zero at the start.
    #[inline]
    pub(crate) fn fly(&mut self, now: Point, known: usize, reach: Reach) -> Arrival {
        match self.table.n_waves() {
            0 => self.with_waves::<0>(now, known, reach),
            1 => self.with_waves::<1>(now, known, reach),
            _ => self.with_waves::<2>(now, known, reach),
        }
    }

    fn with_waves<const W: usize>(
        &mut self,
        now: Point,
        mut known: usize,
        reach: Reach,
    ) -> Arrival {
        if let Some(arrival) = self.again::<W>(now, known, reach) {
            return arrival;
        }
        self.look_at_clock(now);
        let v = self.times_step(now.xdot);
        let Self { linear, table, clock, piece, .. } = self;
        let (table, h, mut from) = (&**table, table.h(), now);
        let mut start = SeriesStart { x: now.x, v, force: linear.constant, waves: clock.waves };
        let last = reach.t_end.min(reach.look);
        let mut steps = 1;
        loop {
            let left = ((reach.t_end - from.t) - from.late) / h;
            let ahead = StepAhead::of::<W>(table, &start, known, left);
            if let Some(StepAhead { outlook: Outlook::Clear, ends: [x, v] }) = ahead {
                let end = from.after(h, x, v / h);
                // false for NaN, too
                let goes_on = x > 0.0 && x + end.xdot.abs() < f64::INFINITY;
                if goes_on && end.t <= last && steps < reach.steps {
                    clock.step::<W>((end.t, end.late), linear, table);
                    (start.x, start.v, start.waves) = (x, v, clock.waves);
                    (from, known, steps) = (end, 0, steps + 1);
                    continue;
                }
            }
            let outlook = ahead.map(|ahead| ahead.outlook);
            let step = Step::with_waves::<W>(table, &start, known, left, true, outlook);
            let end = from.after(step.length * h, step.x, step.v / h);
            // false for NaN, too
            let goes_on = step.x > 0.0 && step.x + end.xdot.abs() < f64::INFINITY;
            let there = step.lands || step.complete || end.t > last || steps >= reach.steps;
            if goes_on && !there {
                *clock = clock.after::<W>(step.length, (end.t, end.late), linear, table);
                start = SeriesStart { x: step.x, v: step.v, waves: clock.waves, ..start };
                (from, known, steps) = (end, 0, steps + 1);
                continue;
            }
            *piece = FlownSteps { from, start, known, step };
            self.speed = (end.xdot, step.v);
            if step.complete && steps == 1 {
                self.period.note(step.length, &self.table);
            }
            let end = self.arrive::<W>(from, &step, end, reach.t_end);
            return Arrival { from, end, lands: step.lands, steps };
        }
    }

    /// The velocity, times the length of a step.
    #[inline(always)]
    fn times_step(&self, xdot: f64) -> f64 {
        if xdot == self.speed.0 {
            self.speed.1
        } else {
            xdot * self.table.h()
        }
    }

    /// A flight of the length of the last ones that stays away from the wall.
    #[inline(always)]
    fn again<const W: usize>(&mut self, now: Point, known: usize, reach: Reach) -> Option<Arrival> {
        let h = self.table.h();
        let length = ((reach.t_end - now.t) - now.late) / h;
        if known > 0 || !self.period.knows(length) {
            return None;
        }
        let turned = self.period.waves_at((now.t, now.late));
        let waves = turned.unwrap_or_else(|| {
            self.look_at_clock(now);
            self.clock.waves
        });
        let v = self.times_step(now.xdot);
        let start = SeriesStart { x: now.x, v, force: self.linear.constant, waves };
        if !self.table.is_clear::<W>(&start, length) {
            return None;
        }
        let to = (reach.t_end, 0.0);
        let [x, v] = self.period.fly::<W>(&start, length, turned.is_none(), to)?;
        let end = Point { t: to.0, late: to.1, x, xdot: v / h };
        let step = Step { length, doublings: None, x, v, lands: false, complete: true };
        self.piece = FlownSteps { from: now, start, known, step };
        self.speed = (end.xdot, v);
        Some(Arrival { from: now, end, lands: false, steps: 1 })
    }

    /// The time at the end of the last step: at the wall by the clock of the first wave, else by
    /// the sum of the steps.
    #[inline(always)]
    fn arrive<const W: usize>(
        &mut self,
        from: Point,
        step: &Step,
        mut end: Point,
        t_end: f64,
    ) -> Point {
        let Self { linear, table, clock, .. } = self;
        let Some(wave) = linear.first().filter(|_| !step.complete) else {
            if step.complete || end.t > t_end {
                (end.t, end.late) = (t_end, 0.0);
            }
            return end;
        };
        if !step.lands {
            self.at = (end.t, end.late);
            *clock = clock.after::<W>(step.length, self.at, linear, table);
        } else {
            let phase = clock.phase(step.length, table);
            let (t, late) = wave.clock.time(phase);
            // both are the same up to rounding, of which a short flight may be less
            self.at = if t < from.t { (from.t, from.late) } else { (t, late) };
            *clock = WaveReading::new(linear, phase, self.at);
            (end.t, end.late) = self.at;
        }
        if end.t > t_end {
            (end.t, end.late) = (t_end, 0.0);
        }
        end
    }

    /// Length of a step (s).
    pub(crate) fn h(&self) -> f64 {
        self.table.h()
    }

    /// Number of power series of the last segment.
    pub(crate) fn parts(&self) -> usize {
        self.piece.step.doublings.map_or(1, |j| 1 << j)
    }

    /// The power series of a part of the last piece in steps of full length, and over its length.
    pub(crate) fn series(&self, k: usize) -> [Series; 2] {
        let (_, part) = self.part(k);
        [FlightPart { length: 1.0, ..part }, part].map(|part| part.powers(&self.table))
    }

    /// The last segment, if a single step.
    #[inline(always)]
    pub(crate) fn alone(&self) -> Option<(f64, FlightPart)> {
        let FlownSteps { from, start, known, step } = &self.piece;
        let (length, xdot, lands) = (step.length, from.xdot, step.lands);
        let part = FlightPart { start: *start, known: *known, length, xdot, lands };
        step.doublings.is_none().then_some((from.t, part))
    }

    /// Initial time and data of a part of the last segment.
    pub(crate) fn part(&self, k: usize) -> (f64, FlightPart) {
        if let Some(alone) = self.alone() {
            return alone;
        }
        let FlownSteps { from, start, step, .. } = self.piece;
        let j = step.doublings.unwrap_or(0);
        let at = (0..j).filter(|bit| k >> bit & 1 == 1);
        let start = at.fold(start, |start, bit| self.table.jump(&start, bit));
        let xdot = if k == 0 { from.xdot } else { start.v / self.h() };
        let from = from.after(k as f64 * self.h(), 0.0, 0.0);
        (from.t, FlightPart { start, known: 0, length: 1.0, xdot, lands: false })
    }

    /// The table of the law.
    pub(crate) fn table(&self) -> &Arc<Table> {
        &self.table
    }

    /// The clock at the next lift-off from rest, up to `t_end`, where that is known in closed form.
    pub(crate) fn lift_off(&mut self, now: Point, t_end: f64) -> Option<Option<f64>> {
        if self.linear.second().is_some() {
            return None;
        }
        self.look_at_clock(now);
        let wave = self.linear.first()?;
        let now_at = self.clock.phase(0.0, &self.table);
        let Some(phase) = self.linear.lift_off(wave, now_at) else { return Some(None) };
        if phase == now_at {
            return Some(Some(now.t));
        }
        let t = wave.clock.time(phase).0.max(now.t);
        if t > t_end {
            return Some(None);
        }
        self.at = (t, 0.0);
        self.clock = WaveReading::new(&self.linear, phase, self.at);
        Some(Some(t))
    }
}

// Flights of one length again and again, such as the periods of a control that is held.
//
// Over a part `p` of a step, up to `q = p + delta` in truth, what a flight adds to its start is
// linear in it, with a matrix that is the same each time,
//
// ```text
// x(q) = x + q V + sum_(n>=2) a_n p^n + delta d,    d = sum_(n>=2) n a_n p^(n-1),
// V(q) = V + d + delta V'(p),                       z(q) = z e^(i W p) (1 + i W delta),
// ```
//
// where `delta` is the rounding of times: its square is below rounding. The matrix minus the
// identity is small, and so is its accumulated rounding.

/// Largest `delta/p`: its square is rounding.
const CLOSE: f64 = 1e-8;

/// Periods over which waves are turned before they are read off the clock again.
const TURNED: u32 = 16;

/// A length of flights that came twice in a row, and the waves at the end of the last.
#[derive(Clone, Debug, Default)]
struct RepeatedFlight {
    /// The last length (steps of the table).
    last: f64,
    ends: Option<Ends>,
    /// The waves, their time, and the number of periods of rotation.
    waves: [[f64; 2]; WAVES],
    at: (f64, f64),
    turned: u32,
}

/// How the end depends on the start.
#[derive(Clone, Debug)]
struct Ends {
    length: f64,
    /// Increments of `x` and `V`, and `V'`.
    by: LinearColumns<3>,
    /// `e^(i W p)` as cosine and sine, and `W`.
    turn: [[f64; 2]; WAVES],
    rate: [f64; WAVES],
}

/// Whether two lengths are the same but for rounding.
#[inline(always)]
fn close(a: f64, b: f64) -> bool {
    // false for NaN
    (a - b).abs() <= CLOSE * b
}

impl RepeatedFlight {
    /// Takes note of a flight without an impact. Those of more than a step are not learnt, nor
    /// parabolas, whose ends are known.
    #[inline]
    fn note(&mut self, length: f64, table: &Table) {
        let short = length <= 1.0 && !table.is_parabola();
        if short && close(length, self.last) && !self.knows(length) {
            self.ends = Some(Ends::new(length, table));
        }
        self.last = length;
    }

    /// Whether the end of a flight of this length is known.
    #[inline(always)]
    fn knows(&self, length: f64) -> bool {
        self.ends.as_ref().is_some_and(|ends| close(length, ends.length))
    }

    /// The waves at a time, where they were turned up to there.
    #[inline(always)]
    fn waves_at(&self, at: (f64, f64)) -> Option<[[f64; 2]; WAVES]> {
        (self.at == at && self.turned < TURNED).then_some(self.waves)
    }

    /// Position, and velocity times the step of the table, at the end of a flight whose length is
    /// known, and turns the waves up to that time; `read`: whether the initial ones were read off
    /// the clock.
    #[inline(always)]
    fn fly<const W: usize>(
        &mut self,
        start: &SeriesStart,
        length: f64,
        read: bool,
        end: (f64, f64),
    ) -> Option<[f64; 2]> {
        let ends = self.ends.as_ref()?;
        let delta = length - ends.length;
        let ([x, v, bend], SeriesStart { x: x0, v: v0, .. }) = (ends.by.of::<W, 3>(start), *start);
        for m in 0..W {
            let ([cos, sin], [re, im]) = (ends.turn[m], start.waves[m]);
            let [re, im] = [re * cos - im * sin, im * cos + re * sin];
            let angle = ends.rate[m] * delta;
            self.waves[m] = [re - im * angle, im + re * angle];
        }
        self.turned = if read { 1 } else { self.turned + 1 };
        self.at = end;
        Some([x0 + (length * v0 + (x + delta * v)), v0 + (v + delta * bend)])
    }
}

impl Ends {
    fn new(length: f64, table: &Table) -> Self {
        let columns: [[f64; TERMS]; COLUMNS] = table.columns();
        let by = columns.map(|mut a| {
            (a[0], a[1]) = (0.0, 0.0);
            let mut sums = [0.0; 3];
            // Horner's scheme for the value and the first two derivatives
            for a in a.iter().rev() {
                sums[2] = sums[2] * length + sums[1];
                sums[1] = sums[1] * length + sums[0];
                sums[0] = sums[0] * length + a;
            }
            [sums[0], sums[1], 2.0 * sums[2]]
        });
        let omega = table.law().omega;
        let turn = omega.map(|omega| {
            let (sin, cos) = sin_cos(omega * table.h() * length / std::f64::consts::TAU);
            [cos, sin]
        });
        let rate = omega.map(|omega| omega * table.h());
        Self { length, by: LinearColumns(by), turn, rate }
    }
}

// A step of a flight: as far as nothing can happen, or up to the wall.

/// A step that ends at most this part of it after its end is no longer: what rounding makes of it.
const OVER: f64 = 1.0 + 1e-9;

/// By how much a step near the wall is longer than the flight under a constant force.
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

    /// The next step of a flight, at most `left` long: many together where they stay far from the
    /// wall and `far` allows it, else one, or the part of one up to the wall. The first `known`
    /// derivatives of the position are zero at its start. `outlook` is the result of
    /// [`StepAhead::of`].
    #[inline(always)]
    fn with_waves<const W: usize>(
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
struct StepAhead {
    ends: [f64; 2],
    outlook: Outlook,
}

impl StepAhead {
    /// The usual case: a step is shorter than the rest, starts at x <= 0 with a flight that is not
    /// short, and no bound allows more than a step.
    #[inline(always)]
    fn of<const W: usize>(
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
enum Outlook {
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
/// turns may be far longer than a flight.
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

// The first root of a flight, certified.
//
// The coefficients in Bernstein form enclose the polynomial, and the number of their changes of
// sign bounds that of its roots. Known roots at the start are divided out of the coefficients
// first: their values would be rounding. Degree 11 nearly always decides, with the remaining terms
// as a slack; otherwise the whole series is subdivided. A dip below rounding is none.

/// Rounding of a value, relative to the sum of the absolute values of the terms, where a series is
/// subdivided.
const DIP: f64 = 1e-15;

/// A step by Halley's formula that is so short, relative to the abscissa, is the last.
const LAST: f64 = 3e-6;

/// Steps of the iteration for a root; bisection alone takes 53.
const MOST_STEPS: usize = 120;

/// A root within `[0, 1]`, and the derivative there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SeriesRoot {
    pub(crate) at: f64,
    pub(crate) slope: f64,
}

/// The first point of `[0, 1]` where the series becomes negative, its first `known` coefficients
/// being zero: a root of that order at 0 that the motion leaves.
pub(crate) fn first_root(a: &Series, known: usize) -> Option<SeriesRoot> {
    let mut q = [0.0; TERMS];
    match known {
        0 => q = *a,
        1 => q[..TERMS - 1].copy_from_slice(&a[1..]),
        _ => q[..TERMS - known].copy_from_slice(&a[known..]),
    }
    let at = first_fall(&q)?;
    // a = s^known q: at a root of q the derivative is s^known q'
    let slope = value_and_slope(&q, at)[1] * at.powi(known as i32);
    Some(SeriesRoot { at, slope })
}

/// The same where a root at 0 has been divided out: the point alone.
#[inline(always)]
pub(crate) fn first_fall(q: &Series) -> Option<f64> {
    match screened(q) {
        SignTest::Clear => None,
        SignTest::One(guess) => Some(polished(q, guess, is_near)),
        SignTest::Open => subdivided(q),
    }
}

/// The only root in `(0, 1]` of a series that changes there from positive to negative, near a
/// guess.
#[inline(always)]
fn only_root(a: &Series, guess: f64) -> SeriesRoot {
    let at = polished(a, guess, is_near);
    SeriesRoot { at, slope: value_and_slope(a, at)[1] }
}

/// Whether a step is short enough, relative to the abscissa, to be the last.
#[inline(always)]
fn is_near(step: f64, s: f64) -> bool {
    step.abs() <= LAST * s
}

/// The abscissa of such a root; `is_last(step, start)` returns whether a step is the last: the next
/// would be its cube.
#[inline(always)]
pub(crate) fn polished(q: &Series, guess: f64, is_last: impl Fn(f64, f64) -> bool) -> f64 {
    let (mut low, mut high, mut s) = (0.0, 1.0, guess);
    for _ in 0..MOST_STEPS {
        let [value, first, second] = slopes(q, s);
        if value > 0.0 {
            low = s;
        } else {
            high = s;
        }
        // Halley's formula
        let step = 2.0 * value * first / (value * second - 2.0 * first * first);
        let next = s + step;
        if is_last(step, s) && next >= low && next <= high {
            return next;
        }
        s = if next > low && next < high { next } else { 0.5 * (low + high) };
        if s <= low || s >= high {
            return s;
        }
    }
    s
}

/// The only root after 0 of a short flight from the wall, if proved unique, from the first
/// coefficients and a bound of `sum (n - 1) |a_n|` over the others.
///
/// ```text
/// q = a/s = a_1 + a_2 s + ...,    s (sum_(n>=3) (n - 1) |a_n| s^(n-3)) <= |a_2|/5 at 1.3 s_0
/// ```
///
/// with `s_0 = -a_1/a_2`: `q` decreases by at least `0.8 |a_2|` up to this point, at which `q < 0`.
#[inline(always)]
fn of_short_arc(a: &[f64; SHORT], beyond: f64) -> Option<SeriesRoot> {
    const FARTHER: f64 = 1.3;
    /// A step by Newton's formula that is so short is the last.
    const NEAR: f64 = 1e-8;
    let mut s = -a[1] / a[2];
    // false for NaN too
    let short = s > 0.0 && FARTHER * s <= PART && a[2] < 0.0;
    let (far, mut sum) = (FARTHER * s, beyond);
    for n in (3..SHORT).rev() {
        sum = sum * far + (n as f64 - 1.0) * a[n].abs();
    }
    if !(short && far * sum <= -0.2 * a[2]) {
        return None;
    }
    let mut q = [0.0; SHORT - 1];
    q.copy_from_slice(&a[1..]);
    for _ in 0..MOST_STEPS {
        let [value, slope] = of_few(&q, s);
        let step = value / slope;
        s -= step;
        if step.abs() <= NEAR * s {
            break;
        }
    }
    Some(SeriesRoot { at: s, slope: s * of_few(&q, s)[1] })
}

/// The first root by subdivision of the whole series, rounding above zero.
#[cold]
fn subdivided(q: &Series) -> Option<f64> {
    let rounding: f64 = DIP * q.iter().map(|a| a.abs()).sum::<f64>();
    let mut p = Polynomial::<TERMS>::from_powers(*q);
    p.add(rounding);
    let found = p.first_negative()?;
    // that of the shifted one comes a little after the root itself
    let (mut s, mut now) = (found, slopes(q, found));
    for _ in 0..8 {
        let next = (s - now[0] / now[1]).clamp(0.0, 1.0);
        let then = slopes(q, next);
        if then[0].abs() < now[0].abs() {
            (s, now) = (next, then);
        } else {
            break;
        }
    }
    Some(s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::root::Phase;
    use crate::Wave;

    /// Speeds and phases of impacts with `e = 0.8` that begin `turns` after `t = 0`.
    fn impacts(turns: f64) -> Vec<[u64; 3]> {
        let excitation = Wave { amplitude: [0.6, 0.0], omega: 0.9, phase: 0.0 };
        let waves = [excitation, Wave::default()];
        let law = LinearLaw { stiffness: 1.0, damping: 0.1, gravity: -1.0, waves };
        let mut flight = SeriesFlight::new(law).unwrap();
        let clock = flight.linear.first().unwrap().clock;
        let phase = Phase { turns, part: 0.123, rest: 0.0 };
        flight.at = clock.time(phase);
        flight.clock = WaveReading::new(&flight.linear, phase, flight.at);
        let (t, late) = flight.at;
        let mut now = Point { t, late, x: 0.0, xdot: 1.3 };
        let reach = Reach { t_end: f64::MAX, look: f64::MAX, steps: 1000 };
        (0..200)
            .map(|_| {
                let Arrival { end, lands, .. } = flight.fly(now, 1, reach);
                assert!(lands);
                now = Point { xdot: -0.8 * end.xdot, ..end };
                let Phase { part, rest, .. } = flight.clock.phase(0.0, &flight.table);
                [now.xdot, part, rest].map(f64::to_bits)
            })
            .collect()
    }

    #[test]
    fn impacts_a_billion_periods_later_are_the_same_to_the_last_bit() {
        let early = impacts(0.0);
        assert_eq!(impacts(1.0), early);
        assert_eq!(impacts(1e9), early);
    }

    #[test]
    fn a_held_control_is_another_constant_and_nothing_else() {
        let still = Wave { amplitude: [0.3, 0.0], ..Wave::default() };
        let waves = [Wave { amplitude: [0.6, 0.0], omega: 0.9, phase: 0.0 }, still];
        let law = LinearLaw { stiffness: 1.0, damping: 0.1, gravity: -1.0, waves };
        let mut flight = SeriesFlight::new(law).unwrap();
        let held = LinearLaw { gravity: 3.0, ..law };
        assert!(flight.under(&held));
        assert_eq!(*flight.linear(), Linear::new(&held));
        assert_eq!(flight.linear().constant, 0.3 - 3.0);
        let mut louder = law;
        louder.waves[0].amplitude = [0.7, 0.0];
        for other in [louder, LinearLaw { damping: 0.2, ..law }] {
            assert!(!flight.under(&other));
        }
    }

    /// A flight under `gravity` towards the wall and a wave.
    fn shaken(gravity: f64, wave: Wave) -> SeriesFlight {
        let waves = [wave, Wave::default()];
        SeriesFlight::new(LinearLaw { stiffness: 1.0, damping: 0.1, gravity, waves }).unwrap()
    }

    fn at_rest(t: f64) -> Point {
        Point { t, late: 0.0, x: 0.0, xdot: 0.0 }
    }

    /// When a force that depends on time alone becomes positive: immediately or on its next rise
    /// within a period; found by small steps and bisection.
    fn rises(force: impl Fn(f64) -> f64, t0: f64, period: f64) -> Option<f64> {
        const STEPS: u32 = 20_000;
        if force(t0) > 0.0 {
            return Some(t0);
        }
        let time = |k: u32| t0 + period * f64::from(k) / f64::from(STEPS);
        let k = (1..=STEPS).find(|k| force(time(*k)) > 0.0)?;
        let (mut below, mut above) = (time(k - 1), time(k));
        for _ in 0..60 {
            let middle = 0.5 * (below + above);
            *if force(middle) > 0.0 { &mut above } else { &mut below } = middle;
        }
        Some(above)
    }

    #[test]
    fn a_mass_at_rest_lifts_off_when_the_force_becomes_positive() {
        let mut seen = [0; 3];
        for k in 1..=240_u32 {
            // spread evenly, in no order
            let part = |step: f64| (f64::from(k) * step).fract();
            let (gravity, size, turn) =
                (3.0 * part(0.618) - 0.5, 0.01 + 3.0 * part(0.755), part(0.57));
            let (sin, cos) = (std::f64::consts::TAU * turn).sin_cos();
            let omega = [0.9, 7.0, -2.3][k as usize % 3];
            let wave = Wave { amplitude: [size * cos, size * sin], omega, phase: 4.0 * part(0.43) };
            let force = |t: f64| {
                let (sin, cos) = (omega * t + wave.phase).sin_cos();
                wave.amplitude[0] * cos - wave.amplitude[1] * sin - gravity
            };
            let (t0, period) = (10.0 * part(0.31), std::f64::consts::TAU / omega.abs());
            let truth = rises(force, t0, period);
            let mut flight = shaken(gravity, wave);
            let found = flight.clone().lift_off(at_rest(t0), f64::MAX);
            let (Some(Some(t)), Some(then)) = (found, truth) else {
                assert_eq!((found, truth), (Some(None), None), "{k}");
                seen[0] += 1;
                continue;
            };
            assert!((t - then).abs() < 1e-7 * period, "{k}: {t}, {then}");
            assert!(t == then || force(t).abs() < 1e-13 * (size + gravity.abs()) * (1.0 + t));
            assert_eq!(t == t0, force(t0) > 0.0, "{k}");
            seen[1 + usize::from(t > t0)] += 1;
            // not beyond the end of the run
            assert_eq!(flight.clone().lift_off(at_rest(t0), t), Some(Some(t)));
            if t > t0 {
                assert_eq!(flight.clone().lift_off(at_rest(t0), 0.5 * (t0 + t)), Some(None));
            }
            // the clock stands there, where the mass still is
            assert_eq!(flight.lift_off(at_rest(t0), f64::MAX), Some(Some(t)));
            let stands = flight.at_wall(at_rest(t)).unwrap();
            assert!((stands - force(t)).abs() < 1e-13 * (size + gravity.abs()) * (1.0 + t));
            let again = flight.lift_off(at_rest(t), f64::MAX).flatten().unwrap();
            assert!(again >= t && again - t < 1e-13 * period, "{k}: {t}, {again}");
        }
        assert!(seen.iter().all(|count| *count > 40), "{seen:?}");
    }

    #[test]
    fn a_force_that_only_touches_zero_lifts_nothing_off() {
        let wave = |amplitude| Wave { amplitude, omega: 2.0, phase: 0.0 };
        // as strong as the pull, and at its largest
        for t0 in [0.0, 1.0] {
            let found = shaken(1.0, wave([1.0, 0.0])).lift_off(at_rest(t0), f64::MAX);
            assert_eq!(found, Some(None), "{t0}");
        }
        // -1 + cos 2t -+ sin 2t is 0 and falls, or rises
        let falls = shaken(1.0, wave([1.0, 1.0])).lift_off(at_rest(0.0), f64::MAX);
        let Some(Some(t)) = falls else { panic!("{falls:?}") };
        assert!((t - 0.75 * std::f64::consts::PI).abs() < 1e-15, "{t}");
        let rises = shaken(1.0, wave([1.0, -1.0])).lift_off(at_rest(0.0), f64::MAX);
        assert_eq!(rises, Some(Some(0.0)));
    }

    #[test]
    fn lift_offs_under_two_waves_or_none_are_not_known_in_closed_form() {
        let wave = |omega| Wave { amplitude: [2.0, 0.0], omega, phase: 0.0 };
        let law = |waves| LinearLaw { gravity: 1.0, waves, ..LinearLaw::default() };
        for waves in [[wave(1.0), wave(2.0)], [Wave::default(); 2]] {
            let mut flight = SeriesFlight::new(law(waves)).unwrap();
            assert_eq!(flight.lift_off(at_rest(0.0), f64::MAX), None);
        }
    }

    #[test]
    fn flights_of_one_length_are_known_after_two() {
        let wave = Wave { amplitude: [0.2, 0.0], omega: 0.9, phase: 0.3 };
        let law = LinearLaw {
            stiffness: 1.0,
            damping: 0.1,
            gravity: -4.0,
            waves: [wave, Wave::default()],
        };
        let mut flight = SeriesFlight::new(law).unwrap();
        let (length, mut now) = (0.1, Point { t: 0.0, late: 0.0, x: 3.0, xdot: 0.5 });
        for period in 1..20 {
            let reach =
                Reach { t_end: length * f64::from(period), look: f64::MAX, steps: usize::MAX };
            let known = flight.clone().again::<1>(now, 0, reach);
            assert_eq!(known.is_some(), period > 2, "{period}");
            // one that begins at the wall is looked at by its series
            let wall = Point { x: 0.0, ..now };
            assert!(flight.clone().again::<1>(wall, 1, reach).is_none(), "{period}");
            let exact = SeriesFlight::new(law).unwrap().fly(now, 0, reach).end;
            if let Some(Arrival { end, lands, .. }) = known {
                assert!(!lands && end.t == reach.t_end);
                assert!((end.x - exact.x).abs() < 1e-15 * exact.x, "{period}");
                assert!((end.xdot - exact.xdot).abs() < 1e-14, "{period}");
            }
            now = flight.fly(now, 0, reach).end;
        }
    }

    #[test]
    fn the_last_part_is_as_long_as_the_flight() {
        // x = cos t - 1/2 above a wall that it meets at pi/3
        let law = LinearLaw { stiffness: 1.0, gravity: 0.5, ..LinearLaw::default() };
        let mut flight = SeriesFlight::new(law).unwrap();
        let mut now = Point { t: 0.0, late: 0.0, x: 0.5, xdot: 0.0 };
        let reach = Reach { t_end: 10.0, look: f64::MAX, steps: 1 };
        for _ in 0..100 {
            let Arrival { from, end, lands, .. } = flight.fly(now, 0, reach);
            let (start, part) = flight.part(flight.parts() - 1);
            let length = part.length * flight.h();
            assert!((start + length - end.t).abs() < 1e-15 && part.lands == lands);
            assert!((part.xdot + start.sin()).abs() < 1e-15);
            if lands {
                assert!((end.t - std::f64::consts::FRAC_PI_3).abs() < 1e-15);
                assert!((end.xdot + 0.75_f64.sqrt()).abs() < 1e-15);
                return;
            }
            assert!(end.t > from.t);
            now = end;
        }
        panic!("never at the wall");
    }
}

#[cfg(test)]
mod period_tests {
    use super::table::Law;
    use super::*;
    use crate::numeric::power_series::{derivative, value};

    const LAW: Law = Law { stiffness: 2.0, damping: 0.3, omega: [1.7, 0.9] };
    const START: SeriesStart =
        SeriesStart { x: 0.4, v: -0.7, force: 1.1, waves: [[0.5, -0.8], [-1.2, 0.3]] };

    /// A period that came twice.
    fn learnt(length: f64, table: &Table) -> RepeatedFlight {
        let mut period = RepeatedFlight::default();
        period.note(length, table);
        assert!(!period.knows(length));
        period.note(length, table);
        period
    }

    #[test]
    fn the_end_of_a_period_is_that_of_the_series() {
        let table = Table::new(LAW, f64::INFINITY);
        let (a, mut waves) = (table.series(&START), START.waves);
        for length in [1e-3, 0.07, 0.5, 1.0] {
            let mut period = learnt(length, &table);
            for part in [1.0, 1.0 + 0.9e-8, 1.0 - 0.9e-8] {
                let q = part * length;
                assert!(period.knows(q));
                let [x, v] = period.fly::<2>(&START, q, true, (q, 0.0)).unwrap();
                assert!((x - value(&a, q)).abs() < 1e-15, "{q}: {:e}", x - value(&a, q));
                let slope = value(&derivative(&a), q);
                assert!((v - slope).abs() < 2e-15, "{q}: {:e}", v - slope);
                for ((z, start), omega) in waves.iter_mut().zip(START.waves).zip(LAW.omega) {
                    let (sin, cos) = (omega * q * table.h()).sin_cos();
                    *z = [start[0] * cos - start[1] * sin, start[1] * cos + start[0] * sin];
                }
                let pairs = period.waves_at((q, 0.0)).unwrap();
                for (z, exact) in pairs.iter().flatten().zip(waves.iter().flatten()) {
                    assert!((z - exact).abs() < 1e-15, "{q}");
                }
            }
            assert!(!period.knows(length * (1.0 + 2e-8)) && !period.knows(f64::NAN));
        }
    }

    #[test]
    fn waves_are_read_off_the_clock_again() {
        let table = Table::new(LAW, f64::INFINITY);
        let mut period = learnt(0.1, &table);
        for k in 0..TURNED {
            assert!(period.fly::<2>(&START, 0.1, k == 0, (f64::from(k), 0.0)).is_some());
            let known = period.waves_at((f64::from(k), 0.0)).is_some();
            assert_eq!(known, k + 1 < TURNED);
            // not at another time
            assert!(period.waves_at((f64::from(k), 1e-20)).is_none());
        }
    }

    #[test]
    fn long_flights_and_parabolas_are_not_learnt() {
        assert!(!learnt(1.5, &Table::new(LAW, f64::INFINITY)).knows(1.5));
        let free = Law { stiffness: 0.0, damping: 0.0, omega: [0.0; 2] };
        assert!(!learnt(0.5, &Table::new(free, f64::INFINITY)).knows(0.5));
    }
}

#[cfg(test)]
mod step_tests {
    use super::table::Law;
    use super::*;
    use crate::numeric::power_series::{derivative, value};

    fn random(draw: &mut u64) -> f64 {
        *draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (*draw >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// Every step, whichever way it took, against values of its series: above the wall before its
    /// end, at the wall there if it ends in an impact, its velocity that of a difference.
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
        // down onto the wall, and a short flight
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
        // from the wall, faster and faster: no flight
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
        // x + v s + bend s^2 = -bend (s + before) (flight - s)
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

#[cfg(test)]
mod root_tests {
    use super::*;
    use crate::numeric::power_series::{derivative, value};

    /// The powers of `+- prod (s - root)`, positive at the start, after `known` roots at 0.
    fn through(roots: &[f64], known: usize) -> Series {
        let mut a = [0.0; TERMS];
        a[0] = roots.iter().map(|root| -root).product::<f64>().signum();
        for (n, &root) in roots.iter().enumerate() {
            for i in (0..=n).rev() {
                a[i + 1] += a[i];
                a[i] *= -root;
            }
        }
        a.rotate_right(known);
        a
    }

    #[test]
    fn the_first_of_several_roots_is_found() {
        let cases: [&[f64]; 5] = [
            &[0.3],
            &[0.3, 0.300_001, 0.9],
            &[0.9, 0.2, 0.6, 0.7, 0.95],
            &[0.001, 2.0, 3.0],
            &[0.5, 0.75, -2.0, 1.5],
        ];
        for roots in cases {
            for known in 0..4 {
                let a = through(roots, known);
                let first = roots.iter().copied().filter(|&r| r > 0.0).fold(1.0, f64::min);
                let found = first_root(&a, known).unwrap();
                // a pair of roots that is this close is known to the root of rounding
                let tol = if roots.contains(&0.300_001) { 1e-8 } else { 1e-14 };
                assert!((found.at - first).abs() < tol, "{roots:?} {known}: {found:?}");
                let slope = value(&derivative(&a), found.at);
                assert!((found.slope - slope).abs() < tol.max(1e-13) && found.slope < 0.0);
            }
        }
    }

    #[test]
    fn a_step_onto_the_start_of_the_interval_is_halved() {
        // from .5 Halley's formula leads to 0 exactly: 2 (-1/4) (-1)/((-1/4) (-4) - 2) = -1/2
        let mut q = [0.0; TERMS];
        // -1/4 - r - 2 r^2 - 8 r^3 with r = s - 1/2
        (q[0], q[1], q[2], q[3]) = (0.75, -5.0, 10.0, -8.0);
        let root = polished(&q, 0.5, is_near);
        let (mut low, mut high) = (0.0, 0.5);
        while high - low > 1e-15 {
            let s: f64 = 0.5 * (low + high);
            let r = s - 0.5;
            if -0.25 - r - 2.0 * r * r - 8.0 * r * r * r > 0.0 {
                low = s;
            } else {
                high = s;
            }
        }
        assert!((root - low).abs() < 1e-14, "{root} {low}");
    }

    #[test]
    fn a_short_arc_is_certified() {
        // s (u - g s/2 + c s^2)
        let (u, g, c): (f64, f64, f64) = (1e-3, 2.0, 0.3);
        let mut a = [0.0; SHORT];
        (a[1], a[2], a[3]) = (u, -0.5 * g, c);
        let exact = 2.0 * u / (0.5 * g + (0.25 * g * g - 4.0 * u * c).sqrt());
        let found = of_short_arc(&a, 0.0).unwrap();
        assert!((found.at / exact - 1.0).abs() < 1e-15, "{found:?} {exact}");
        let slope = u - g * exact + 3.0 * c * exact * exact;
        assert!((found.slope / slope - 1.0).abs() < 1e-14, "{found:?} {slope}");
        // terms beyond that may bring it back, and one that does not fall
        assert_eq!(of_short_arc(&a, f64::INFINITY), None);
        a[2] = 0.5 * g;
        assert_eq!(of_short_arc(&a, 0.0), None);
    }

    #[test]
    fn touches_and_dips_below_rounding_are_none() {
        for roots in [&[0.5, 0.5][..], &[0.3, 0.3, 0.8, 0.8], &[-0.5, 1.5], &[1.0 + 1e-9]] {
            assert_eq!(first_root(&through(roots, 0), 0), None, "{roots:?}");
        }
        // a dip of depth w^2 between two roots
        for (w, seen) in [(1e-3, true), (1e-6, true), (3e-7, true), (1e-9, false)] {
            let found = first_root(&through(&[0.4 - w, 0.4 + w], 0), 0);
            assert_eq!(found.is_some(), seen, "{w}");
            assert!(found.is_none_or(|found| (found.at - 0.4 + w).abs() < 0.02 * w));
        }
    }

    #[test]
    fn numbers_that_are_none_give_no_certificate() {
        let mut a = through(&[0.3], 0);
        a[5] = f64::NAN;
        // whatever is found, it is not lost in a loop
        let found = first_root(&a, 0);
        assert!(found.is_none_or(|found| found.at.is_nan() || found.at <= 1.0));
        assert_eq!(first_root(&[-0.0; TERMS], 0), None);
    }
}
