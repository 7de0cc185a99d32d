//! Strikes a body, or a wall, through the gap before it: the law of [`zivi_core::control::Aim`] for
//! mechanical systems.
//!
//! ```text
//! g'' = x_body'' - a      a of the aim      Z q'' = -k Z q'
//! ```

use zivi_core::control::{Aim, StrikeMeasurement};

use super::believed_plant::BelievedPlant;
use super::controls;
use super::gap_tracker::GapTracker;
use super::gap_tracker::MechanicalController;
use super::GapKinetics;
use super::LawError;
use crate::drive::mechanical::believed_plant::SentControls;
use crate::numeric::cholesky;
use crate::system::dynamics::{Driven, Dynamics, Layout};

/// Constant settings, without those of the aim.
#[derive(Clone, Debug, PartialEq)]
pub struct StrikerSettings {
    /// The gap.
    pub gap: usize,
    /// The coordinate of the body, none before a wall.
    pub body: Option<usize>,
    /// Coefficient of restitution of the gap.
    pub e: f64,
    /// Range of each control.
    pub limits: Option<Vec<(f64, f64)>>,
    /// Damping of the motion in the null space of the gap (1/s).
    pub posture: f64,
    /// Periods from a measurement to the moment when its control acts.
    pub delay: usize,
}

/// State that changes at each update, without that of the aim.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StrikerState {
    /// Commanded accelerations of the striker that may still act, the oldest first; NaN where
    /// limits cut the controls.
    pub acting: Vec<f64>,
    /// Controls.
    pub sent: SentControls,
    /// Bits of [`GapTracker::SATURATED`] and [`GapTracker::REFUSED`].
    pub status: u8,
}

/// Meets a body, or a wall, with the speed that is requested.
#[derive(Clone, Debug)]
pub struct Striker {
    /// The law.
    pub aim: Aim,
    /// Constant settings.
    pub settings: StrikerSettings,
    /// The state.
    pub state: StrikerState,
    kinetics: Option<[GapKinetics; 2]>,
}

impl Striker {
    /// One that has measured nothing yet.
    #[must_use]
    pub fn new(aim: Aim, settings: StrikerSettings) -> Self {
        Self { aim, settings, state: StrikerState::default(), kinetics: None }
    }

    /// Forgets all that was measured and learnt.
    pub fn reset(&mut self) {
        self.aim.state = Aim::new(self.aim.settings).state;
        self.state = StrikerState::default();
    }

    /// Writes the controls for the period that starts now into `u`; `target` gives the height or the
    /// speed of a stroke.
    ///
    /// # Errors
    /// [`LawError`].
    pub fn tick<E, D, F>(
        &mut self,
        plant: &mut BelievedPlant<'_, D, F>,
        t: f64,
        measured: (&[f64], &[f64]),
        target: &mut dyn FnMut(u32) -> Result<f64, E>,
        u: &mut [f64],
    ) -> Result<(), LawError<E>>
    where
        D: Dynamics<E>,
        Driven<D, F>: Dynamics<E>,
    {
        if !self.state.sent.fits(u.len()) {
            return Err(LawError::Foreign);
        }
        let is_finite = |of: &[f64]| of.iter().all(|it| it.is_finite());
        self.state.status = 0;
        if is_finite(measured.0) && is_finite(measured.1) {
            let layout = plant.layout();
            let of = |m| GapKinetics::new(Layout::smooth(layout.n, m));
            let mut kinetics =
                self.kinetics.take().unwrap_or_else(|| [GapKinetics::new(layout), of(1)]);
            let done = self.strike(plant, t, measured, target, &mut kinetics, u);
            self.kinetics = Some(kinetics);
            done?;
        } else {
            u.fill(f64::NAN);
        }
        if !is_finite(u) {
            self.state.status |= GapTracker::REFUSED;
            self.state.sent.hold(u);
        }
        self.state.sent.send(u, self.settings.delay);
        Ok(())
    }

    fn strike<E, D, F>(
        &mut self,
        plant: &mut BelievedPlant<'_, D, F>,
        t: f64,
        measured: (&[f64], &[f64]),
        target: &mut dyn FnMut(u32) -> Result<f64, E>,
        [all, own]: &mut [GapKinetics; 2],
        u: &mut [f64],
    ) -> Result<(), LawError<E>>
    where
        D: Dynamics<E>,
        Driven<D, F>: Dynamics<E>,
    {
        let (delay, h) = (self.settings.delay, self.aim.settings.h);
        let mut seen = None;
        let ahead;
        let ((mut q, mut w), mut then) = (measured, t);
        if delay > 0 {
            seen = Some(self.sight(plant, t, measured, all, own)?);
            let open = vec![false; all.layout().m];
            ahead = plant.ahead(t, measured, &open, self.state.sent.until(delay, u.len()), all)?;
            (q, w, then) = (&ahead.0, &ahead.1, t + delay as f64 * h);
        }
        let now = self.sight(plant, then, (q, w), all, own)?;
        if self.aim.state.gamma.is_nan() {
            let moves = |body: usize| own.mobility_of(0)[body] / own.d[0];
            self.aim.state.gamma = (1.0 + self.settings.e) * self.settings.body.map_or(1.0, moves);
        }
        let known = self.state.acting.first().filter(|_| self.state.acting.len() > delay);
        self.aim.learn(seen.unwrap_or(now), known.copied().unwrap_or(f64::NAN));
        let now = self.aim.look(now);
        if delay == 0 {
            self.aim.state.seen = Some(now);
        }
        let a = self.aim.acceleration(&now, delay as f64 * h, target).map_err(LawError::Raised)?;
        let push = self.aim.state.push.1;
        let damped: Vec<f64> = w.iter().map(|w| -self.settings.posture * w).collect();
        let (matrix, limits) = (plant.driven.matrix(), self.settings.limits.as_deref());
        let found = controls(own, matrix, &[now.pull - a + push], &damped, limits, u)?;
        if found.limited {
            self.state.status |= GapTracker::SATURATED;
        }
        if self.state.acting.len() > delay {
            self.state.acting.remove(0);
        }
        self.state.acting.push(if found.limited { f64::NAN } else { a - push });
        self.aim.go_on(now, a);
        Ok(())
    }

    /// Measures the body and the striker; `own` are the kinetics of their gap alone then.
    fn sight<E, D, F>(
        &self,
        plant: &mut BelievedPlant<'_, D, F>,
        t: f64,
        (q, w): (&[f64], &[f64]),
        all: &mut GapKinetics,
        own: &mut GapKinetics,
    ) -> Result<StrikeMeasurement, LawError<E>>
    where
        D: Dynamics<E>,
        Driven<D, F>: Dynamics<E>,
    {
        plant.look(t, (q, w), all)?;
        own.alone(all, self.settings.gap, w)?;
        let (gap, rate) = (own.gaps()[0], own.rates[0]);
        let Some(body) = self.settings.body else {
            return Ok(StrikeMeasurement { t, gap, rate, ..StrikeMeasurement::default() });
        };
        let mut pull = own.force().to_vec();
        cholesky::solve(&own.mass, q.len(), &mut pull);
        Ok(StrikeMeasurement {
            t,
            gap,
            rate,
            x: q[body],
            v: w[body],
            pull: pull[body],
            relative: 0.0,
        })
    }
}

/// A striker with its model of the plant, in a loop.
pub struct Striking<'a, D, F, A, E> {
    /// The law.
    pub law: Striker,
    /// Its model.
    pub plant: BelievedPlant<'a, D, F>,
    /// The height or the speed of a stroke.
    pub target: A,
    /// Converts an error of the law.
    pub wrong: fn(LawError<E>) -> E,
}

impl<E, D, F, A> MechanicalController<E> for Striking<'_, D, F, A, E>
where
    D: Dynamics<E>,
    Driven<D, F>: Dynamics<E>,
    A: FnMut(u32) -> Result<f64, E>,
{
    fn tick(&mut self, _: usize, t: f64, state: (&[f64], &[f64]), u: &mut [f64]) -> Result<u8, E> {
        let Self { law, plant, target, wrong } = self;
        law.tick(plant, t, state, target, u).map_err(*wrong)?;
        Ok(law.state.status)
    }

    fn latched(&self, _: &mut [bool]) -> Result<(), E> {
        Ok(()) // it holds none
    }
}
