//! Operations at a sample of a closed loop: sensor, observer, controller, delay.

use std::collections::VecDeque;

use super::gap_tracker::GapTracker;
use crate::mechanics::Ticks;

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
