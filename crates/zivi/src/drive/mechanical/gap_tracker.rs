//! The tracker of gaps.
//!
//! ```text
//! g_i'' = a_i      a_i the control of a twisting tracker on gap i alone
//! Z q'' = Z (q_r'' - kp (q - q_r) - kd (q' - q_r'))
//! a_A   = -W_AA lambda_d      of contacts A that are held
//! ```

use std::collections::VecDeque;

use zivi_core::control::TwistingTracker;
use zivi_core::{Physical, SettingError};

use super::believed_plant::{
    gaps_of, waypoint, BelievedPlant, MechanicalReference, ReferenceSample, SentControls,
};
use super::{controls, press_of, reach, usual_forces, weakest_of, GapKinetics, LawError};
use crate::mechanics::Ticks;
use crate::numeric::dense::dot;
use crate::numeric::elimination::Singular;
use crate::system::dynamics::{Driven, Dynamics};

/// Part of the least acceleration towards the wall by which other contacts may push a gap that closes.
const PUSHED: f64 = 0.8;

/// Constant settings.
#[derive(Clone, Debug, PartialEq)]
pub struct GapTrackerSettings {
    /// Sampling period (s).
    pub h: f64,
    /// `kp` (1/s^2) and `kd` (1/s).
    pub posture: (f64, f64),
    /// Range of each control.
    pub limits: Option<Vec<(f64, f64)>>,
    /// Below which gap and rate a contact is held; without them the noise says.
    pub latch: Option<[f64; 2]>,
    /// Periods from a measurement to the moment when its control acts.
    pub delay: usize,
    /// Whether gaps measured in contact calibrate the wall positions.
    pub learn_offsets: bool,
}

/// State that changes at each update, without the trackers.
#[derive(Clone, Debug, PartialEq)]
pub struct GapTrackerState {
    /// Contacts.
    pub latch: Latch,
    /// Commanded accelerations of the gaps, without contact forces.
    pub accelerations: Vec<f64>,
    /// Controls.
    pub sent: SentControls,
    /// Where the rest stays without a reference.
    pub place: Option<Vec<f64>>,
    /// Bits of [`GapTracker::SATURATED`], [`GapTracker::REFUSED`], [`GapTracker::LATCH_LOST`].
    pub status: u8,
    /// The least singular value so far of `W^-1/2 N M^-1 B`, in parts of limits.
    pub least: f64,
    /// How many directions have no actuator of their own.
    pub uncontrolled: usize,
}

impl GapTrackerState {
    fn start(m: usize) -> Self {
        Self {
            latch: Latch::open(m),
            accelerations: vec![0.0; m],
            sent: SentControls::default(),
            place: None,
            status: 0,
            least: f64::INFINITY,
            uncontrolled: 0,
        }
    }
}

/// Lets the gaps of a mechanism follow bouncing references through impacts, rest and lift-off.
#[derive(Clone, Debug)]
pub struct GapTracker {
    /// One for each gap.
    pub trackers: Vec<TwistingTracker>,
    /// Constant settings.
    pub settings: GapTrackerSettings,
    /// The state.
    pub state: GapTrackerState,
    /// Noise of the sensor.
    pub noise: Noise,
    kinetics: Option<GapKinetics>,
}

/// Both ends of a period of a reference.
type Ends<'a> = [ReferenceSample<'a>; 2];

impl GapTracker {
    /// The controls were cut to their limits.
    pub const SATURATED: u8 = crate::drive::SATURATED;
    /// The sample was rejected, and the last controls held.
    pub const REFUSED: u8 = crate::drive::REFUSED;
    /// A contact that was held opened.
    pub const LATCH_LOST: u8 = crate::drive::LATCH_LOST;

    /// One that has measured nothing yet.
    #[must_use]
    pub fn new(trackers: Vec<TwistingTracker>, settings: GapTrackerSettings) -> Self {
        let state = GapTrackerState::start(trackers.len());
        Self { trackers, settings, state, noise: Noise::default(), kinetics: None }
    }

    /// By gap: the acceleration with which its tracker presses it at rest, and the least one with which
    /// it accelerates the gap towards the wall while it closes.
    #[must_use]
    pub fn pulls(&self) -> Vec<(f64, f64)> {
        self.trackers.iter().map(|it| (press_of(it), weakest_of(it))).collect()
    }

    /// Forgets all that was measured.
    ///
    /// # Errors
    /// None that happens: the references can be at rest.
    pub fn reset(&mut self) -> Result<(), SettingError> {
        self.state = GapTrackerState::start(self.trackers.len());
        let rest = Physical { x: 0.0, xdot: 0.0 };
        self.trackers.iter_mut().try_for_each(|tracker| tracker.reset(rest))
    }

    /// Writes the controls for the period that starts now into `u`, for a reference at this sample and
    /// at the next one, as many periods ahead as the delay; without one all gaps land and rest.
    /// `asked` gives the force with which a contact is pressed at a time, if one is requested.
    ///
    /// # Errors
    /// [`LawError`]; the controls are unchanged.
    pub fn tick<E, D, F>(
        &mut self,
        plant: &mut BelievedPlant<'_, D, F>,
        t: f64,
        measured: (&[f64], &[f64]),
        reference: Option<Ends<'_>>,
        asked: &mut dyn FnMut(usize, f64) -> Result<Option<f64>, E>,
        u: &mut [f64],
    ) -> Result<(), LawError<E>>
    where
        D: Dynamics<E>,
        Driven<D, F>: Dynamics<E>,
    {
        let is_finite = |of: &[f64]| of.iter().all(|it| it.is_finite());
        let GapTrackerState { sent, place, .. } = &self.state;
        let is_own = |of: &Vec<f64>| of.len() == plant.layout().n && is_finite(of);
        if !(sent.fits(u.len()) && place.iter().all(is_own)) {
            return Err(LawError::Foreign);
        }
        if !(is_finite(measured.0) && is_finite(measured.1)) {
            self.state.status = Self::REFUSED;
            self.state.sent.hold(u);
            self.state.sent.send(u, self.settings.delay);
            return Ok(());
        }
        self.state.status = 0;
        if reference.is_none() {
            self.state.place.get_or_insert_with(|| measured.0.to_vec());
        }
        let place = self.state.place.clone();
        let layout = plant.layout();
        let zeros = vec![0.0; layout.n.max(layout.m)];
        let (ones, closed) = (vec![1.0; layout.m], vec![true; layout.m]);
        let (still, of_gaps) = (&zeros[..layout.n], &zeros[..layout.m]);
        let resting = ReferenceSample {
            q: place.as_deref().unwrap_or(still),
            w: still,
            sides: &ones,
            contacts: &closed,
            gaps: Some((of_gaps, of_gaps)),
            accelerations: Some(of_gaps),
            turning: None,
            tasks: None,
        };
        let ends = reference.unwrap_or([resting; 2]);
        let mut kinetics = self.kinetics.take().unwrap_or_else(|| GapKinetics::new(layout));
        let done = self.follow(plant, t, measured, ends, asked, &mut kinetics, u);
        self.kinetics = Some(kinetics);
        done?;
        if !is_finite(u) {
            self.state.status |= Self::REFUSED;
            self.state.sent.hold(u);
        }
        self.state.sent.send(u, self.settings.delay);
        Ok(())
    }

    /// The same with a reference.
    #[allow(clippy::too_many_arguments)]
    fn follow<E, D, F>(
        &mut self,
        plant: &mut BelievedPlant<'_, D, F>,
        mut t: f64,
        measured: (&[f64], &[f64]),
        ends: Ends<'_>,
        asked: &mut dyn FnMut(usize, f64) -> Result<Option<f64>, E>,
        kinetics: &mut GapKinetics,
        u: &mut [f64],
    ) -> Result<(), LawError<E>>
    where
        D: Dynamics<E>,
        Driven<D, F>: Dynamics<E>,
    {
        plant.driven.offset(&[]);
        let rows: Vec<_> = ends.iter().map(|end| gaps_of(plant, end)).collect::<Result<_, _>>()?;
        let mut ends = ends;
        // walls are elsewhere for the plant, not for the reference
        plant.driven.offset(&self.state.latch.offsets.by);
        for (end, row) in ends.iter_mut().zip(&rows) {
            if let Some((gaps, rates)) = row {
                end.gaps = Some((gaps, rates));
            }
        }
        let ahead;
        let (mut q, mut w) = measured;
        let mut seen = None;
        if self.settings.delay > 0 {
            if self.settings.learn_offsets {
                // the prediction stays on the side where the wall is thought to be
                plant.look(t, measured, kinetics)?;
                seen = Some((kinetics.gaps().to_vec(), kinetics.rates.clone()));
            }
            let GapTrackerState { sent, latch, .. } = &self.state;
            let until = sent.until(self.settings.delay, u.len());
            ahead = plant.ahead(t, measured, &latch.held, until, kinetics)?;
            (q, w) = (&ahead.0, &ahead.1);
            t += self.settings.delay as f64 * self.settings.h;
        }
        plant.look(t, (q, w), kinetics)?;
        let a = self.wanted(t, kinetics, seen, ends, asked)?;
        let (now, (kp, kd)) = (&ends[0], self.settings.posture);
        let mut rest: Vec<f64> = (0..q.len())
            .map(|j| {
                let back = -kp * (q[j] - now.q[j]) - kd * (w[j] - now.w[j]);
                back + now.turning.map_or(0.0, |turning| turning[j])
            })
            .collect();
        if let (Some(tasks), Some(goal)) = (&mut plant.tasks, now.tasks) {
            let goal = (goal, self.settings.posture);
            tasks.steer(t, (q, w), goal, kinetics, &mut rest).map_err(LawError::Raised)?;
        }
        self.state.accelerations = a;
        let matrix = plant.driven.matrix();
        let limits = self.settings.limits.as_deref();
        let found = controls(kinetics, matrix, &self.state.accelerations, &rest, limits, u)?;
        let least = match found.least {
            None if self.state.least == f64::INFINITY => Some(reach(kinetics, matrix, u.len())?),
            known => known,
        };
        if let Some(least) = least {
            self.state.least = self.state.least.min(least);
            self.state.uncontrolled = q.len() - rank(matrix, q.len(), u.len());
        }
        if found.limited {
            self.state.status |= Self::SATURATED;
        }
        Ok(())
    }

    /// The accelerations of the gaps; `seen` are gaps and rates as they are measured, if these tell
    /// other contacts than the prediction.
    fn wanted<E>(
        &mut self,
        t: f64,
        kinetics: &mut GapKinetics,
        seen: Option<(Vec<f64>, Vec<f64>)>,
        [now, end]: Ends<'_>,
        asked: &mut dyn FnMut(usize, f64) -> Result<Option<f64>, E>,
    ) -> Result<Vec<f64>, LawError<E>> {
        let m = self.trackers.len();
        let resting: Vec<bool> =
            now.contacts.iter().zip(end.contacts).map(|(now, end)| *now && *end).collect();
        let Self { trackers, settings, state, noise, .. } = self;
        let pulls: Option<Vec<f64>> = settings
            .learn_offsets
            .then(|| trackers.iter().map(|it| settings.h * weakest_of(it)).collect());
        let seen = match &seen {
            Some((gaps, rates)) => (gaps.as_slice(), rates.as_slice()),
            None => (kinetics.gaps(), kinetics.rates.as_slice()),
        };
        if state.latch.look(kinetics, seen, &resting, settings.latch, noise, pulls.as_deref()) {
            state.status |= Self::LATCH_LOST;
        }
        let held = &state.latch.held;
        let mut a = vec![0.0; m];
        for (i, tracker) in trackers.iter_mut().enumerate() {
            let (x, xdot) =
                if held[i] { (0.0, 0.0) } else { (kinetics.gaps()[i].max(0.0), kinetics.rates[i]) };
            let [from, to] = [waypoint("now", &now, i)?, waypoint("next", &end, i)?];
            let pull = now.accelerations.map(|all| all[i]).filter(|it| !it.is_nan());
            a[i] = tracker.tick_to(Physical { x, xdot }, 0.0, from, to, pull)?;
        }
        if !held.contains(&true) {
            return Ok(a);
        }
        let press: Vec<f64> = trackers.iter().map(press_of).collect();
        let usual = usual_forces(kinetics, held, &press);
        // while others land, all are pressed alike: forces that change with the contacts would feed
        // the impulses between coupled gaps
        let landing = (0..m).any(|i| resting[i] && !held[i]);
        let mut forces = usual.clone();
        if !landing {
            for i in (0..m).filter(|&i| held[i]) {
                if let Some(force) = asked(i, t).map_err(LawError::Raised)? {
                    forces[i] = force;
                }
            }
        }
        for i in 0..m {
            let row = &kinetics.d[i * m..][..m];
            let (by, by_usual) = (dot(row, &forces), dot(row, &usual));
            if held[i] {
                a[i] = -by;
                continue;
            }
            // a gap that lands is pushed by the other contacts as by a constant force, or impacts on
            // coupled gaps would not end, as long as that leaves it a part of its own pull, or it
            // would not come back; one that follows has its reference's own pushes
            a[i] -= if resting[i] {
                let excess = by_usual - PUSHED * weakest_of(&trackers[i]);
                by - by_usual + excess.max(0.0)
            } else {
                by
            };
        }
        Ok(a)
    }
}

/// How many columns of `B` are independent.
fn rank(matrix: &[f64], n: usize, r: usize) -> usize {
    Singular::new(matrix, n, r).rank(f64::EPSILON * n.max(r) as f64)
}

// Contacts that rest with their reference and are held.

/// Thresholds of a closed gap without noise: gap and rate.
pub const EXACT: [f64; 2] = [1e-9, 1e-9];
/// A gap within this number of standard deviations may be closed.
const DEVIATIONS: f64 = 20.0;
/// The same in steps of the sensor.
const STEPS: f64 = 5.0;
/// A contact is open after this number of measurements outside.
const OUT: u32 = 5;
/// Largest offset of a wall that is learnt (m).
const FARTHEST: f64 = 5e-3;
/// A contact at an unknown position is closed after at least this number of measurements at rest,
/// and after this multiple of the time in which a free gap would exceed the rate that counts as
/// rest.
const STILL: (f64, f64) = (5.0, 8.0);
/// How many measurements are averaged to the offset of a wall.
const MEAN: u32 = 500;

/// Noise of a sensor, for coordinates and velocities.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Noise {
    /// Standard deviations.
    pub deviations: [f64; 2],
    /// Steps.
    pub steps: [f64; 2],
}

impl Noise {
    /// Gap and rate that noise gives a closed contact, for each unit of the length of its normal.
    #[must_use]
    pub fn of_contacts(&self) -> [f64; 2] {
        [0, 1].map(|k| (DEVIATIONS * self.deviations[k]).max(STEPS * self.steps[k]))
    }
}

/// Offsets of walls from their model positions.
#[derive(Clone, Debug, PartialEq)]
pub struct Offsets {
    /// How much nearer than thought, by gap (m).
    pub by: Vec<f64>,
    /// Measurements that these are the mean of.
    pub seen: Vec<u32>,
    /// Measurements at rest in a row.
    pub still: Vec<u32>,
}

impl Offsets {
    fn none(m: usize) -> Self {
        Self { by: vec![0.0; m], seen: vec![0; m], still: vec![0; m] }
    }

    /// Takes over what is measured of a contact that is held.
    fn learn(&mut self, i: usize, gap: f64) {
        self.seen[i] = (self.seen[i] + 1).min(MEAN);
        let mean = self.by[i] + gap / f64::from(self.seen[i]);
        self.by[i] = mean.clamp(-FARTHEST, FARTHEST);
    }
}

/// Which contacts are held.
#[derive(Clone, Debug, PartialEq)]
pub struct Latch {
    /// By gap.
    pub held: Vec<bool>,
    /// Number of consecutive measurements outside.
    pub beyond: Vec<u32>,
    /// Of the walls.
    pub offsets: Offsets,
}

impl Latch {
    /// No contacts of `m`.
    #[must_use]
    pub fn open(m: usize) -> Self {
        Self { held: vec![false; m], beyond: vec![0; m], offsets: Offsets::none(m) }
    }

    /// Holds contacts that rest with their reference, and lets go of those that do not: whether one
    /// was lost. With `pulls`, the changes of the rates of gaps in flight by a period, walls may be
    /// elsewhere than thought: contacts are judged by their rates, and the gaps of those that are held
    /// are the offsets. `seen` are gaps and rates.
    pub(super) fn look(
        &mut self,
        kinetics: &GapKinetics,
        seen: (&[f64], &[f64]),
        resting: &[bool],
        within: Option<[f64; 2]>,
        noise: &Noise,
        pulls: Option<&[f64]>,
    ) -> bool {
        let Self { held, beyond, offsets } = self;
        let mut any = false;
        for (i, &rests) in resting.iter().enumerate() {
            let [near, slow] = within.unwrap_or_else(|| limits_of(kinetics, i, noise));
            let (gap, is_slow) = (seen.0[i], seen.1[i].abs() <= slow);
            let (stays, settles) = match pulls {
                None => (gap.abs() <= near, gap.abs() <= near && is_slow),
                Some(pulls) => {
                    let still = rests && is_slow && (gap + offsets.by[i]).abs() <= FARTHEST;
                    offsets.still[i] = if still { offsets.still[i].saturating_add(1) } else { 0 };
                    let enough = STILL.0.max(STILL.1 * slow / pulls[i]);
                    (is_slow, f64::from(offsets.still[i]) >= enough)
                }
            };
            let closes = rests && !held[i] && settles;
            beyond[i] = if held[i] && !stays { beyond[i] + 1 } else { 0 };
            let lost = held[i] && rests && beyond[i] >= OUT;
            any |= lost;
            held[i] = (held[i] && rests && !lost) || closes;
            if held[i] && stays && pulls.is_some() {
                offsets.learn(i, gap);
            }
        }
        any
    }
}

/// Below which gap and rate a contact may be closed, by the noise.
fn limits_of(kinetics: &GapKinetics, i: usize, noise: &Noise) -> [f64; 2] {
    let normal = kinetics.normal(i);
    let size = dot(normal, normal).sqrt();
    let by_noise = noise.of_contacts();
    [0, 1].map(|k| EXACT[k].max(size * by_noise[k]))
}

// Operations at a sample of a closed loop: sensor, observer, controller, delay.

/// A sampled controller of a mechanical system.
pub trait MechanicalController<E> {
    /// Writes the controls for the period that starts at sample `k` into `u`, which has the last ones,
    /// and gives the bits of its status.
    ///
    /// # Errors
    /// Whatever ends the run.
    fn tick(&mut self, k: usize, t: f64, state: (&[f64], &[f64]), u: &mut [f64]) -> Result<u8, E>;

    /// Writes which contacts it holds.
    ///
    /// # Errors
    /// Whatever ends the run.
    fn latched(&self, to: &mut [bool]) -> Result<(), E>;
}

/// Interface of observers.
pub trait Observing<E> {
    /// Replaces what was measured by the estimate; `u` acted since the last sample.
    ///
    /// # Errors
    /// Whatever ends the run.
    fn estimate(&mut self, t: f64, state: (&mut [f64], &mut [f64]), u: &[f64]) -> Result<(), E>;
}

/// Sensor of coordinates and velocities.
#[derive(Clone, Copy, Debug, Default)]
pub struct MechanicalSensor<'a> {
    /// Added at each sample: `n` numbers of the coordinates, then `n` of the velocities; none if
    /// empty.
    pub noise: &'a [f64],
    /// Steps of the sensor; `0` is exact.
    pub steps: [f64; 2],
}

impl MechanicalSensor<'_> {
    fn read(&self, k: usize, q: &mut [f64], w: &mut [f64]) {
        let n = q.len();
        for (part, values) in [q, w].into_iter().enumerate() {
            if let Some(noise) = self.noise.get((2 * k + part) * n..(2 * k + part + 1) * n) {
                values.iter_mut().zip(noise).for_each(|(value, noise)| *value += noise);
            }
            let step = self.steps[part];
            if step > 0.0 {
                values.iter_mut().for_each(|it| *it = step * (*it / step).round_ties_even());
            }
        }
    }
}

/// Record of the samples of a loop, row by row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TickRecord {
    /// Status bits of sample and controls.
    pub status: Vec<u8>,
    /// Contacts that are held.
    pub latched: Vec<bool>,
    /// Coordinates and velocities passed to the controller.
    pub told: [Vec<f64>; 2],
}

/// All that happens at a sample.
#[derive(Debug)]
pub struct SampledLoop<'a, C, O> {
    /// It runs.
    pub controller: C,
    observer: Option<O>,
    sensor: MechanicalSensor<'a>,
    /// Controls that do not act yet, the oldest first.
    queue: VecDeque<Vec<f64>>,
    acting: Vec<f64>,
    asked: Vec<f64>,
    /// Of all samples so far.
    pub record: TickRecord,
    m: usize,
}

impl<'a, C, O> SampledLoop<'a, C, O> {
    /// Of a system with `m` gaps and `r` controls, which act `delay` periods late.
    pub fn new(
        controller: C,
        observer: Option<O>,
        sensor: MechanicalSensor<'a>,
        (m, r, delay): (usize, usize, usize),
    ) -> Self {
        let zeros = || vec![0.0; r];
        let queue = (0..delay).map(|_| zeros()).collect();
        let (acting, asked, record) = (zeros(), zeros(), TickRecord::default());
        Self { controller, observer, sensor, queue, acting, asked, record, m }
    }
}

impl<E, C: MechanicalController<E>, O: Observing<E>> Ticks<E> for SampledLoop<'_, C, O> {
    fn tick(&mut self, k: usize, t: f64, (q, w): (&[f64], &[f64]), u: &mut [f64]) -> Result<(), E> {
        let (mut q, mut w) = (q.to_vec(), w.to_vec());
        self.sensor.read(k, &mut q, &mut w);
        if let Some(observer) = &mut self.observer {
            observer.estimate(t, (&mut q, &mut w), &self.acting)?;
        }
        let mut given = self.asked.clone();
        let mut status = self.controller.tick(k, t, (&q, &w), &mut given)?;
        if given.iter().all(|u| u.is_finite()) {
            self.asked = given;
        } else {
            status |= GapTracker::REFUSED;
        }
        let Self { record, queue, acting, asked, .. } = self;
        record.status.push(status);
        let from = record.latched.len();
        record.latched.resize(from + self.m, false);
        self.controller.latched(&mut record.latched[from..])?;
        record.told[0].extend_from_slice(&q);
        record.told[1].extend_from_slice(&w);
        queue.push_back(asked.clone());
        if let Some(next) = queue.pop_front() {
            *acting = next;
        }
        u.copy_from_slice(acting);
        Ok(())
    }
}

// The tracker of gaps in a loop.

/// A gap tracker with its model of the plant and its reference.
pub struct Tracking<'a, D, F, A, E> {
    /// The law.
    pub law: GapTracker,
    /// Its model.
    pub plant: BelievedPlant<'a, D, F>,
    /// Where it is to be; all gaps land and rest without it.
    pub reference: Option<&'a MechanicalReference>,
    /// The force with which a contact is pressed at a time, if one is requested.
    pub asked: A,
    /// Converts an error of the law.
    pub wrong: fn(LawError<E>) -> E,
}

impl<E, D, F, A> MechanicalController<E> for Tracking<'_, D, F, A, E>
where
    D: Dynamics<E>,
    Driven<D, F>: Dynamics<E>,
    A: FnMut(usize, f64) -> Result<Option<f64>, E>,
{
    fn tick(&mut self, k: usize, t: f64, state: (&[f64], &[f64]), u: &mut [f64]) -> Result<u8, E> {
        let Self { law, plant, reference, asked, wrong } = self;
        let layout = plant.layout();
        let ends = reference.map(|reference| {
            [0, 1].map(|it| reference.sample(k + law.settings.delay + it, (layout.n, layout.m)))
        });
        law.tick(plant, t, state, ends, asked, u).map_err(*wrong)?;
        Ok(law.state.status)
    }

    fn latched(&self, to: &mut [bool]) -> Result<(), E> {
        to.copy_from_slice(&self.law.state.latch.held);
        Ok(())
    }
}

#[cfg(test)]
mod latch_tests {
    use super::*;
    use crate::system::dynamics::Layout;

    #[test]
    fn a_contact_is_let_go_after_five_measurements_in_a_row_that_are_beyond() {
        let kinetics = GapKinetics::new(Layout::smooth(1, 1));
        let mut latch = Latch::open(1);
        let mut look = |gap: f64| {
            let (seen, within) = ((&[gap][..], &[0.0][..]), Some([1e-3, 1e-3]));
            let lost = latch.look(&kinetics, seen, &[true], within, &Noise::default(), None);
            (lost, latch.held[0], latch.beyond[0])
        };
        assert_eq!(look(5e-4), (false, true, 0));
        // a gap that is near again starts again
        for k in (1..5).chain(0..=0).chain(1..5) {
            let gap = if k == 0 { 5e-4 } else { 2e-3 };
            assert_eq!(look(gap), (false, true, k));
        }
        let (lost, held, _) = look(2e-3);
        assert!(lost && !held);
    }
}
