//! Aiming at the next impact: a racket that throws a body as high as requested, a hammer that meets a
//! wall with a requested speed.
//!
//! ```text
//! v- = -sqrt(v^2 + 2 G (x - z))      V = sqrt(2 G H)      w = v- + (V - v-)/gamma
//! ```
//!
//! The body comes to the place `z` with `v-`, in a time that its flight tells; met with the speed `w` it
//! leaves with `V` and rises by `H`. The striker moves there with minimal effort, on a cubic in
//! time. Errors of the model in masses and restitution are lumped in `gamma`, learnt from each
//! impact; errors in forces are a constant acceleration of the striker, learnt between impacts.

use crate::real::sqrt;
use crate::Real;

/// Periods before an impact in which the plan is executed without replanning.
const FINAL: Real = 4.0;
/// A relative change of a body's speed above this (of the desired one) is an impact.
const JUMP: Real = 1e-3;

/// Measurement of a body and of the striker.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StrikeMeasurement {
    /// Time (s).
    pub t: Real,
    /// The gap between them (m).
    pub gap: Real,
    /// Its rate (m/s).
    pub rate: Real,
    /// Place of the body (m), 0 of a wall, as its speed and its acceleration.
    pub x: Real,
    /// Speed of the body (m/s).
    pub v: Real,
    /// Its acceleration without contact (m/s^2).
    pub pull: Real,
    /// Acceleration of the gap from here on (m/s^2).
    pub relative: Real,
}

impl StrikeMeasurement {
    /// Speed of the striker (m/s).
    #[must_use]
    pub fn w(&self) -> Real {
        self.v - self.rate
    }
}

/// How what is measured is averaged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Learning {
    /// Weight of the latest impact in the estimate.
    pub share: Real,
    /// The same of late impacts under noise.
    pub least: Real,
    /// Samples of the unknown acceleration, without noise and with it.
    pub pushes: [u32; 2],
    /// Samples of a noisy speed in flight.
    pub mean: u32,
}

/// Constant settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AimSettings {
    /// Sampling period (s).
    pub h: Real,
    /// Whether there is a wall in place of a body.
    pub of_wall: bool,
    /// Where the body is met (m).
    pub place: Real,
    /// Time between two blows on a wall (s).
    pub interval: Real,
    /// Whether anything is learnt.
    pub learns: bool,
    /// How.
    pub learning: Learning,
}

/// State, which changes at each update.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AimState {
    /// Impacts of the state in which controls act.
    pub strokes: u32,
    /// Change of the body's speed by an impact, as a part of the closing speed; NaN before.
    pub gamma: Real,
    /// Acceleration of the striker in this period, and its slope.
    pub plan: [Real; 2],
    /// Measurement of the last update.
    pub last: Option<StrikeMeasurement>,
    /// Samples of the body's speed in this flight, and their mean.
    pub flight: (u32, Real),
    /// When a wall is hit next (s).
    pub strike_at: Option<Real>,
    /// Raw measurement of the last update.
    pub seen: Option<StrikeMeasurement>,
    /// Samples of the unknown acceleration, and their mean (m/s^2).
    pub push: (u32, Real),
    /// Impacts that were measured.
    pub impacts: u32,
}

impl AimState {
    /// Nothing was seen yet.
    pub const START: Self = Self {
        strokes: 0,
        gamma: Real::NAN,
        plan: [0.0; 2],
        last: None,
        flight: (0, 0.0),
        strike_at: None,
        seen: None,
        push: (0, 0.0),
        impacts: 0,
    };
}

/// The law: settings, state, and the noise of the measured speeds.
///
/// ```
/// use zivi_core::control::{Aim, AimSettings, Learning, StrikeMeasurement};
/// let learning = Learning { share: 0.7, least: 0.1, pushes: [50, 500], mean: 50 };
/// let (h, of_wall, place, interval) = (1e-3, true, 0.0, 0.5);
/// let mut aim = Aim::new(AimSettings { h, of_wall, place, interval, learns: true, learning });
/// // at rest 0.1 m before a wall that is hit with 1 m/s in half a second
/// let now = StrikeMeasurement { gap: 0.1, ..StrikeMeasurement::default() };
/// let (a, j) = (6.0 * 0.1 / 0.25 - 2.0 / 0.5, 6.0 / 0.25 - 12.0 * 0.1 / 0.125);
/// let found = aim.acceleration(&now, 0.0, &mut |_| Ok::<_, ()>(1.0));
/// assert!((found.unwrap() - (a + 0.5 * h * j)).abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Constant settings.
    pub settings: AimSettings,
    /// The state.
    pub state: AimState,
    /// Changes of a speed up to this are noise (m/s).
    pub noise: Real,
}

impl Aim {
    /// One that has seen nothing yet.
    #[must_use]
    pub fn new(settings: AimSettings) -> Self {
        Self { settings, state: AimState::START, noise: 0.0 }
    }

    /// Learns from the measurement after a period in which the known acceleration of the striker
    /// was `acting` (NaN if unknown): from an impact in the period, otherwise about the unknown
    /// acceleration.
    pub fn learn(&mut self, now: StrikeMeasurement, acting: Real) {
        let Learning { share, least, pushes: [quiet, noisy], .. } = self.settings.learning;
        let Some(last) = self.state.seen.replace(now) else { return };
        if !(self.settings.learns && acting.is_finite()) {
            return;
        }
        let relative = now.pull - acting - self.state.push.1;
        let jump = self.jump(&StrikeMeasurement { relative, ..last }, &now);
        if jump == 0.0 {
            let unasked = (now.w() - last.w()) / (now.t - last.t) - acting;
            let most = if self.noise > 0.0 { noisy } else { quiet };
            self.state.push = averaged(self.state.push, unasked, most);
            return;
        }
        let before = last.rate * last.rate - 2.0 * relative * last.gap.max(0.0);
        let closing = sqrt(before.max(0.0));
        if closing > 10.0 * self.settings.h * relative.abs() && last.rate < 0.0 {
            let late = share / (1.0 + self.state.impacts as Real);
            let part = if self.noise == 0.0 { share } else { late.max(least) };
            self.state.gamma += part * (jump / closing - self.state.gamma);
        }
        self.state.impacts = self.state.impacts.saturating_add(1);
    }

    /// Takes in the state in which the control of this update will act; under noise the speed of the body
    /// is the mean of this flight.
    pub fn look(&mut self, now: StrikeMeasurement) -> StrikeMeasurement {
        if self.state.last.is_some_and(|last| self.jump(&last, &now) > 0.0) {
            self.state.strokes = self.state.strokes.saturating_add(1);
            (self.state.strike_at, self.state.flight) = (None, (0, 0.0));
        }
        if self.noise <= 0.0 || self.settings.of_wall {
            return now;
        }
        let (n, before) = self.state.flight;
        let expected = if n > 0 { before + self.settings.h * now.pull } else { now.v };
        self.state.flight = averaged((n, expected), now.v, self.settings.learning.mean);
        let v = self.state.flight.1;
        StrikeMeasurement { v, rate: v - now.w(), ..now }
    }

    /// The acceleration of the striker; the prediction over `late` (s) excludes the unknown
    /// acceleration. `target` gives the height or the speed of a stroke.
    ///
    /// # Errors
    /// Those of `target`.
    pub fn acceleration<E>(
        &mut self,
        now: &StrikeMeasurement,
        late: Real,
        target: &mut dyn FnMut(u32) -> Result<Real, E>,
    ) -> Result<Real, E> {
        let AimSettings { h, of_wall, place, interval, .. } = self.settings;
        let AimState { push: (_, push), gamma, strokes, .. } = self.state;
        let w = now.w() + push * late;
        let z = now.x - now.gap + 0.5 * push * late * late;
        let (goal, left, meeting) = if of_wall {
            let at = *self.state.strike_at.get_or_insert(now.t + interval);
            (0.0, at - now.t, target(strokes)?)
        } else {
            let (g, goal) = (-now.pull, place);
            let energy = now.v * now.v + 2.0 * g * (now.x - goal);
            if g <= 0.0 || energy < 0.0 {
                self.state.plan = [0.0; 2];
                return Ok(-100.0 * (z - goal) - 20.0 * w); // out of reach: wait
            }
            let coming = -sqrt(energy);
            let leaving = sqrt(2.0 * g * target(strokes)?);
            (goal, (now.v - coming) / g, coming + (leaving - coming) / gamma)
        };
        let [a, j] = self.state.plan;
        self.state.plan = if left < FINAL * h {
            [a + h * j, j]
        } else {
            let square = left * left;
            let a = (6.0 * (goal - z) - 2.0 * left * (2.0 * w + meeting)) / square;
            let j = (6.0 * left * (w + meeting) - 12.0 * (goal - z)) / (square * left);
            [a + 0.5 * h * j, j]
        };
        let [a, _] = self.state.plan;
        Ok(a)
    }

    /// Stores the measurement and the acceleration `a` of the striker from here on.
    pub fn go_on(&mut self, now: StrikeMeasurement, a: Real) {
        self.state.last = Some(StrikeMeasurement { relative: now.pull - a, ..now });
    }

    /// The change of a speed by an impact since the last sample; 0 without one.
    fn jump(&self, last: &StrikeMeasurement, now: &StrikeMeasurement) -> Real {
        let h = now.t - last.t;
        let jump = match self.settings.of_wall {
            true => now.rate - last.rate - h * last.relative,
            false => now.v - last.v - h * last.pull,
        };
        let least = JUMP * last.rate.abs().max(1.0);
        if jump > least.max(self.noise) {
            jump
        } else {
            0.0
        }
    }
}

/// The mean of one more, which counts as one of `most` at least.
fn averaged((n, mean): (u32, Real), value: Real, most: u32) -> (u32, Real) {
    let n = n.saturating_add(1).min(most);
    (n, mean + (value - mean) / n as Real)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn aim(of_wall: bool) -> Aim {
        let learning = Learning { share: 0.7, least: 0.1, pushes: [50, 500], mean: 2 };
        let (h, place, interval) = (1e-3, 0.0, 0.5);
        Aim::new(AimSettings { h, of_wall, place, interval, learns: true, learning })
    }

    const BEFORE: StrikeMeasurement = StrikeMeasurement {
        t: 0.0,
        gap: 0.1,
        rate: -5.0,
        x: 0.1,
        v: -5.0,
        pull: -10.0,
        relative: -10.0,
    };

    #[test]
    fn a_jump_counts_by_the_speed_of_the_impact() {
        for (jump, counts) in [(4.9e-3, false), (5.1e-3, true)] {
            let after = StrikeMeasurement { t: 1e-3, v: -5.01 + jump, ..BEFORE };
            assert_eq!(aim(false).jump(&BEFORE, &after) > 0.0, counts);
            let after = StrikeMeasurement { t: 1e-3, rate: -5.01 + jump, ..BEFORE };
            assert_eq!(aim(true).jump(&BEFORE, &after) > 0.0, counts);
        }
    }

    #[test]
    fn an_impact_tells_gamma_by_the_speed_that_it_had() {
        let mut law = aim(false);
        law.state.gamma = 1.0;
        // the racket rests: from 0.75 mm with 1 m/s under 10 m/s^2 to v-, then 1.5 of it
        let last = StrikeMeasurement { gap: 7.5e-4, rate: -1.0, x: 7.5e-4, v: -1.0, ..BEFORE };
        let v = sqrt(1.0 + 2.0 * 10.0 * 7.5e-4);
        law.learn(last, 0.0);
        law.learn(
            StrikeMeasurement { t: 1e-3, gap: 0.0, rate: 0.5, v: -1.01 + 1.5 * v, ..last },
            0.0,
        );
        assert!((law.state.gamma - (1.0 + 0.7 * 0.5)).abs() < 1e-5, "{}", law.state.gamma);
        assert_eq!((law.state.impacts, law.state.push.0), (1, 0));
    }

    #[test]
    fn what_moves_the_racket_beside_its_control_is_averaged() {
        let mut law = aim(false);
        law.learn(BEFORE, 3.0);
        for k in 1..=200_u32 {
            let t = 1e-3 * k as Real;
            // falls with the ball, the racket is pushed by 2 in addition to 3
            let v = BEFORE.v - 10.0 * t;
            law.learn(StrikeMeasurement { t, v, rate: v - 5.0 * t, ..BEFORE }, 3.0);
        }
        assert_eq!(law.state.push.0, 50);
        assert!((law.state.push.1 - 2.0).abs() < 1e-3, "{}", law.state.push.1);
    }

    #[test]
    fn a_plan_meets_the_body_with_the_speed_that_throws_it_as_high_as_requested() {
        let mut law = aim(false);
        (law.state.gamma, law.state.push, law.settings.place) = (1.7, (1, 0.3), 0.05);
        // .3 m above the racket, both on their ways
        let now = StrikeMeasurement {
            t: 2.0,
            gap: 0.3,
            rate: -0.5,
            x: 0.4,
            v: 0.2,
            pull: -10.0,
            ..BEFORE
        };
        let (h, late, height) = (law.settings.h, 2e-3, 0.8);
        let mean = law.acceleration(&now, late, &mut |_| Ok::<_, ()>(height)).unwrap();
        let [first, j] = law.state.plan;
        assert_eq!(mean, first);
        let a = mean - 0.5 * h * j;
        // the body falls to .05 m; what is unknown has pushed the racket over the delay
        let v = -sqrt(0.2 * 0.2 + 2.0 * 10.0 * 0.35);
        let left = (0.2 - v) / 10.0;
        let (z, w) = (0.1 + 0.5 * 0.3 * late * late, 0.7 + 0.3 * late);
        let end = z + left * (w + left * (a / 2.0 + left * j / 6.0));
        assert!((end - 0.05).abs() < 1e-5, "{end}");
        let met = w + left * (a + left * j / 2.0);
        let leaves = v - law.state.gamma * (v - met);
        assert!((leaves * leaves / 20.0 - height).abs() < 1e-4, "{leaves}");
        // played on over the last periods
        law.settings.h = 0.3 * left;
        let last = law.acceleration(&now, late, &mut |_| Ok::<_, ()>(height)).unwrap();
        assert!((last - (mean + law.settings.h * j)).abs() < 1e-5);
    }

    #[test]
    fn speeds_of_a_flight_are_averaged_under_noise_only() {
        let mut law = aim(false);
        let next = StrikeMeasurement { t: 1e-3, v: -5.01 + 4e-3, ..BEFORE };
        assert_eq!(law.look(next), next);
        law.noise = 1.0;
        law.look(BEFORE);
        assert!((law.look(next).v - (-5.01 + 2e-3)).abs() < 1e-6);
        assert!((law.look(next).w() - next.w()).abs() < 1e-6);
    }
}
