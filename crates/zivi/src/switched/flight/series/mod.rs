//! Flights under linear forces, to rounding: power series over steps, their first roots certified.
//!
//! A step evaluates no force and has no error to control. The clock of the first wave counts whole
//! turns and the part of one, and the time is read from it: phase and time cannot drift relative to
//! each other.

mod law;
mod level;
mod period;
mod root;
mod step;
mod table;

pub(crate) use crate::numeric::power_series::{derivative, value, value_and_slope};
pub(crate) use law::{column, wave, Linear, Series, SeriesStart, TERMS};
pub(crate) use root::{first_fall, polished};
pub(crate) use step::Step;
use step::{Outlook, StepAhead};
pub(crate) use table::{Table, WaveReading};

use std::sync::Arc;

use crate::numeric::power_series::{stretch, stretch_and_size};
use crate::switched::mode::Point;
use crate::LinearLaw;
use period::RepeatedFlight;

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

    /// Of how many power series the last piece consists.
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

    /// A flight under a pull of `gravity` and a wave.
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
