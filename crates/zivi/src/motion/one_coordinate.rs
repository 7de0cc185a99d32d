//! Free flights of a system of one coordinate: those of a mass above a wall, for each gap.
//!
//! ```text
//! g = a q + c - w(t)      g'' = -(K/M) g - (C/M) g' + (a p + K (c - w) - C w')/M - w''
//! ```
//!
//! The gap that was hit last leads, and the coordinate is that for which it has its value: with one
//! gap, `a = 1` and `c = 0` every bit is that of the mass.

use std::convert::Infallible;

use crate::motion::state::MechanicalState;
use crate::numeric::power_series::Series;
use crate::switched::flight::series::{FlightPart, Linear, Reach, SeriesFlight};
use crate::switched::flight::Arrival;
use crate::switched::mode::Point;
use crate::system::linear_system::{GapMotion, LinearGap, LinearSystem};
use crate::{Force, HarmonicWall, LinearLaw, Wave};

/// The flights, by gap.
#[derive(Clone, Debug)]
pub(super) struct OneCoordinate {
    gaps: Vec<OneGap>,
    /// The gap whose flight that of the coordinate is.
    lead: usize,
    /// Rest of its last flight, if that had several steps.
    ahead: Option<SeveralSteps>,
    /// The gap that is closed, and when its contact force vanishes, once that is known.
    lift_off: Option<(usize, Option<f64>)>,
    /// By gap the end of the last step.
    ends: Vec<[f64; 2]>,
}

#[derive(Clone, Debug)]
struct OneGap {
    normal: f64,
    offset: f64,
    wall: HarmonicWall,
    flight: SeriesFlight,
}

/// Acceleration of a gap alone towards its wall (m/s^2), zero included, and the force.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pull {
    pub(crate) g: f64,
    pub(crate) force: Linear,
}

/// A flight of several steps, given one by one.
#[derive(Clone, Copy, Debug)]
struct SeveralSteps {
    /// The next step and its start.
    step: usize,
    from: Point,
    end: Point,
}

/// A step, or the part of it up to an impact.
pub(super) struct FlownStep {
    /// Its end (s) with the rounding error.
    pub(super) t: f64,
    pub(super) late: f64,
    /// Its length (s).
    pub(super) length: f64,
    /// The gap that closes.
    pub(super) closing: Option<usize>,
    /// Whether it goes up to the end of the run.
    pub(super) arrives: bool,
}

impl OneCoordinate {
    /// None where a system has not one coordinate, or a gap another motion than such masses have.
    pub(super) fn of(system: &LinearSystem) -> Option<Self> {
        if system.load.len() != 1 || !system.tables.is_empty() || system.gaps.is_empty() {
            return None;
        }
        let gaps: Option<Vec<_>> = system.gaps.iter().map(|gap| OneGap::of(system, gap)).collect();
        let gaps = gaps?;
        let h = gaps[0].flight.h();
        let alike = gaps.iter().all(|gap| gap.flight.h() == h);
        let ends = vec![[0.0; 2]; gaps.len()];
        alike.then_some(Self { gaps, lead: 0, ahead: None, lift_off: None, ends })
    }

    /// The length of a step (s).
    pub(super) fn h(&self) -> f64 {
        self.gaps[0].flight.h()
    }

    /// The shortest period of the loads and walls (s), infinite without any.
    pub(super) fn period(&self) -> f64 {
        let of = |gap: &OneGap| Force::<Infallible>::shortest_period(gap.flight.linear());
        self.gaps.iter().filter_map(of).fold(f64::INFINITY, f64::min)
    }

    /// The gap whose flight determines the coordinate, preferably one at its wall.
    pub(super) fn lead(&mut self, state: &MechanicalState) -> usize {
        if let Some(hit) = (0..self.gaps.len()).find(|&i| state.gap(i).0 == 0.0) {
            self.lead = hit;
        }
        self.lead
    }

    /// The next step from a state with the given number of vanishing derivatives of each gap.
    pub(super) fn fly(
        &mut self,
        t_end: f64,
        known: impl Fn(usize) -> usize,
        state: &MechanicalState,
    ) -> FlownStep {
        self.lift_off = None;
        let lead = self.lead;
        let from = |i: usize| {
            let ((x, xdot), now) = (state.gap(i), state.now());
            Point { t: now.t, late: now.late, x, xdot }
        };
        let (mut end, mut length, lands) = self.leading(t_end, (from(lead), known(lead)));
        let mut closing = lands.then_some(lead);
        self.ends[lead] = [end.x, end.xdot];
        for i in (0..self.gaps.len()).filter(|&i| i != lead) {
            let at = self.fly_along(i, end.t, (from(i), known(i)));
            if at.lands && (closing.is_none() || at.end.t < end.t) {
                (closing, end) = (Some(i), at.end);
            }
        }
        if let Some(gap) = closing.filter(|&gap| gap != lead) {
            self.ahead = None;
            for i in (0..self.gaps.len()).filter(|&i| i != gap) {
                self.fly_along(i, end.t, (from(i), known(i)));
            }
            let now = state.now();
            length = (end.t - now.t) + (end.late - now.late);
        }
        let arrives = closing.is_none() && end.t >= t_end;
        FlownStep { t: end.t, late: end.late, length, closing, arrives }
    }

    /// Flies a gap up to a time or the wall.
    fn fly_along(&mut self, i: usize, t_end: f64, (from, known): (Point, usize)) -> Arrival {
        let reach = Reach { t_end, look: f64::INFINITY, steps: usize::MAX };
        let arrival = self.gaps[i].flight.fly(from, known, reach);
        self.ends[i] = [arrival.end.x, arrival.end.xdot];
        arrival
    }

    /// The next step of the leading gap: its end, its length, and whether that is at the wall.
    fn leading(&mut self, t_end: f64, (from, known): (Point, usize)) -> (Point, f64, bool) {
        let ahead = self.ahead.take().filter(|it| it.from == from && it.end.t <= t_end);
        let flight = &mut self.gaps[self.lead].flight;
        let (step, end, lands) = match ahead {
            Some(SeveralSteps { step, end, .. }) => (step, end, false),
            None => {
                let reach = Reach { t_end, look: f64::INFINITY, steps: 1 };
                let arrival = flight.fly(from, known, reach);
                (0, arrival.end, arrival.lands)
            }
        };
        let length = flight.part(step).1.length * flight.h();
        if step + 1 == flight.parts() {
            return (end, length, lands);
        }
        let (t, FlightPart { start, xdot, .. }) = flight.part(step + 1);
        let next = Point { x: start.x, xdot, ..from.after(t - from.t, 0.0, 0.0) };
        self.ahead = Some(SeveralSteps { step: step + 1, from: next, end });
        (next, length, false)
    }

    /// The series of a gap over the last step, in steps of full length, and over its part.
    pub(super) fn series(&self, gap: usize) -> [Series; 2] {
        let flight = &self.gaps[gap].flight;
        let step = match &self.ahead {
            Some(ahead) if gap == self.lead => ahead.step - 1,
            _ if gap == self.lead => flight.parts() - 1,
            _ => 0,
        };
        flight.series(step)
    }

    /// By gap the end of the last step: the gap and its rate.
    pub(super) fn ends(&self) -> &[[f64; 2]] {
        &self.ends
    }

    /// The coordinate and its velocity at the end of the last step, at a time.
    pub(super) fn coordinate(&self, t: f64) -> [f64; 2] {
        let OneGap { normal, offset, wall, .. } = &self.gaps[self.lead];
        let ([gap, rate], [w, wdot, _]) = (self.ends[self.lead], GapMotion::Harmonic(*wall).at(t));
        [(gap - offset + w) / normal, (rate + wdot) / normal]
    }

    /// The series of the coordinate where the leading gap has this one, from `t` on over a time.
    pub(super) fn coordinate_series(&self, of_gap: &Series, t: f64, length: f64) -> Series {
        let OneGap { normal, offset, wall, .. } = &self.gaps[self.lead];
        let (sin, cos) = (wall.omega * t + wall.phase).sin_cos();
        let turned = [cos, -sin, -cos, sin];
        let (mut power, mut a) = (wall.amplitude, *of_gap);
        a[0] += wall.offset - offset;
        for (k, a) in a.iter_mut().enumerate() {
            *a = (*a + power * turned[k % 4]) / normal;
            power *= wall.omega * length / (k + 1) as f64;
        }
        a
    }

    /// Acceleration of a zero gap towards its wall, without closed gaps.
    pub(super) fn pull(&self, gap: usize, state: &MechanicalState) -> Pull {
        let (now, flight) = (state.now(), &self.gaps[gap].flight);
        let at = Point { t: now.t, late: now.late, x: 0.0, xdot: 0.0 };
        let mut force = *flight.linear();
        let known = flight.at_wall(at).filter(|f| f.is_finite());
        match known.map_or_else(|| force.at(now.t, 0.0, 0.0), Ok) {
            Ok(f) => Pull { g: -f, force },
            Err::<_, Infallible>(never) => match never {},
        }
    }

    /// When the contact force of a gap that is closed alone vanishes, where that is known: none if it
    /// never does.
    pub(super) fn lift_off(&mut self, gap: usize, state: &MechanicalState) -> Option<Option<f64>> {
        if let Some((_, at)) = self.lift_off.filter(|&(of, _)| of == gap) {
            return Some(at);
        }
        let now = state.now();
        let at = Point { t: now.t, late: now.late, x: 0.0, xdot: 0.0 };
        let found = self.gaps[gap].flight.lift_off(at, f64::INFINITY)?;
        self.lift_off = Some((gap, found));
        Some(found)
    }
}

impl OneGap {
    fn of(system: &LinearSystem, gap: &LinearGap) -> Option<Self> {
        let (normal, offset, mass) = (gap.normal[0], gap.offset, system.mass[0]);
        let [stiffness, damping] = [&system.stiffness, &system.damping].map(|it| it[0] / mass);
        let gravity = -(normal * (system.load[0] / mass)) - stiffness * offset;
        let mut law = LinearLaw { stiffness, damping, gravity, ..LinearLaw::default() };
        let loads = system.waves.iter().map(|wave| Wave {
            amplitude: [normal * (wave.amplitude[0] / mass), 0.0],
            omega: wave.omega,
            phase: wave.phase,
        });
        let all: Vec<Wave> = loads.filter(|wave| wave.amplitude != [0.0; 2]).collect();
        law.waves.get_mut(..all.len())?.copy_from_slice(&all);
        let still = HarmonicWall { amplitude: 0.0, omega: 0.0, phase: 0.0, offset: 0.0 };
        let (wall, law) = match &gap.motion {
            GapMotion::Fixed => (still, law),
            GapMotion::Harmonic(wall) => (*wall, wall.frame(law)?),
            GapMotion::Table(_) => return None,
        };
        let known = normal != 0.0 && mass > 0.0;
        let flight = SeriesFlight::new(law).filter(|_| known)?;
        Some(Self { normal, offset, wall, flight })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::power_series::{value, TERMS};
    use crate::system::linear_system::LoadWave;

    /// `1.5 q'' + .3 q' + 6 q = 2 + .8 cos(7 t + .4)`, `g = -2 q + .3 - w(t)`.
    fn system(motion: GapMotion) -> LinearSystem {
        LinearSystem {
            mass: vec![1.5],
            damping: vec![0.3],
            stiffness: vec![6.0],
            load: vec![2.0],
            waves: vec![LoadWave { amplitude: vec![0.8], omega: 7.0, phase: 0.4 }],
            tables: vec![],
            gaps: vec![LinearGap { normal: vec![-2.0], offset: 0.3, motion }],
        }
    }

    #[test]
    fn the_coordinate_is_that_for_which_the_gap_is() {
        let wall = HarmonicWall { amplitude: 0.7, omega: 3.0, phase: 0.9, offset: 0.25 };
        let mut one = OneCoordinate::of(&system(GapMotion::Harmonic(wall))).unwrap();
        let (mut gap, t, length) = ([0.0; TERMS], 0.8, 0.6);
        (gap[0], gap[1], gap[2]) = (0.4, -1.1, 0.5);
        let series = one.coordinate_series(&gap, t, length);
        for s in [0.0, 0.3, 0.7, 1.0] {
            let turned = 3.0 * (t + s * length) + 0.9;
            let w = 0.25 + 0.7 * turned.cos();
            let q = (0.4 - 1.1 * s + 0.5 * s * s - 0.3 + w) / -2.0;
            assert!((value(&series, s) - q).abs() < 1e-14, "{s}");
            one.ends[0] = [0.4, -1.1];
            let [q, rate] = one.coordinate(t + s * length);
            assert!((q - (0.4 - 0.3 + w) / -2.0).abs() < 1e-15);
            assert!((rate - (-1.1 - 2.1 * turned.sin()) / -2.0).abs() < 1e-15);
        }
    }

    #[test]
    fn a_gap_has_the_force_of_the_coordinate() {
        let one = OneCoordinate::of(&system(GapMotion::Fixed)).unwrap();
        let force = one.gaps[0].flight.linear();
        for (t, q, rate) in [(0.3, 0.2, -0.7), (1.9, -0.4, 1.1)] {
            let f: Result<f64, Infallible> = { *force }.at(t, -2.0 * q + 0.3, -2.0 * rate);
            let load = 2.0 + 0.8 * (7.0_f64 * t + 0.4).cos();
            let exact = -2.0 * (load - 0.3 * rate - 6.0 * q) / 1.5;
            assert!((f.unwrap() - exact).abs() < 1e-14, "{t}");
        }
        assert!((one.period() - std::f64::consts::TAU / 7.0).abs() < 1e-15);
    }
}
