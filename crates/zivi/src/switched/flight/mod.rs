//! Free flight: what gives its next piece, and the motion over it.

mod rk;
pub(crate) mod series;

use std::sync::Arc;

use super::mode::{Mode, NextInFlight};
use super::path::{DensePath, FlightCurve};
use super::settings::SwitchedRk;
use super::stages::{Counted, Stages};
use crate::piecewise::steps::Steps;
use crate::record::status::Failure;
use crate::switched::accumulation::Deviation;
use crate::switched::mode::Point;
use crate::{Force, Status};
use rk::PairSteps;
use series::{FlightPart, Linear, Reach, SeriesFlight, Table};

pub(crate) use series::Arrival;

/// Steps of power series that are taken in one go where nobody samples their ends.
const AT_ONCE: usize = 1000;

/// Flights of a run: steps of an embedded pair; power series for a linear force.
#[derive(Clone, Debug)]
pub(super) struct FreeFlight {
    pair: PairSteps,
    series: Option<Box<SeriesFlight>>,
    /// Whether all ends of steps are inspected.
    by_steps: bool,
}

impl FreeFlight {
    pub(super) fn new(settings: &SwitchedRk) -> Self {
        Self { pair: PairSteps::new(settings), series: None, by_steps: false }
    }

    /// The steps, of whatever kind.
    #[inline]
    pub(super) fn steps(&self) -> &Steps<f64> {
        &self.pair.steps
    }

    /// The same, mutable, for step limits and inspection.
    #[inline]
    pub(super) fn steps_mut(&mut self) -> &mut Steps<f64> {
        &mut self.pair.steps
    }

    /// The last step of the pair, to have its polynomials computed.
    pub(super) fn last_mut(&mut self) -> &mut Stages {
        self.pair.last_mut()
    }

    /// The time from the start of that to the impact with which it ends.
    pub(super) fn landing(&self) -> Option<f64> {
        self.pair.landing()
    }

    /// Whether all ends of steps are inspected.
    pub(super) fn look_at_steps(&mut self, by_steps: bool) {
        self.by_steps = by_steps;
    }

    /// Another run starts: its last bits do not depend on those before.
    pub(super) fn start(&mut self) {
        self.series.iter_mut().for_each(|series| series.start());
    }

    /// Chooses the flight integrator for the settings and the force.
    pub(super) fn adopt<E, F: Force<E>>(&mut self, settings: &SwitchedRk, force: &F) {
        let law = settings.law_of(force);
        let same = match (&mut self.series, &law) {
            (Some(series), Some(law)) => series.under(law),
            (series, law) => series.is_none() && law.is_none(),
        };
        if !same {
            self.series = law.and_then(SeriesFlight::new).map(Box::new);
        }
    }

    /// The force by its numbers, if flights are power series.
    pub(super) fn linear(&self) -> Option<&Linear> {
        self.series.as_ref().map(|series| series.linear())
    }

    /// The force on the mass at rest at the wall.
    #[inline]
    pub(super) fn at_wall<E, F: Force<E>>(
        &self,
        now: Point,
        force: &mut Counted<'_, F>,
    ) -> Result<f64, Failure<E>> {
        let known = self.series.as_ref().and_then(|series| series.at_wall(now));
        known.filter(|f| f.is_finite()).map_or_else(|| force.at_wall(now.t), Ok)
    }

    /// The next lift-off if known in closed form; the inner value is `None` without one.
    pub(super) fn lift_off(&mut self, now: Point, t_end: f64) -> Option<Option<f64>> {
        self.series.as_mut()?.lift_off(now, t_end)
    }

    /// The next segment of a flight from x > 0 or from the wall, up to an impact if any.
    #[inline]
    pub(super) fn next<E, F: Force<E>>(
        &mut self,
        now: Point,
        mode: &mut Mode,
        obstacle: Option<Deviation>,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Arrival, Failure<E>> {
        match &mut self.series {
            Some(series) => {
                let most = if self.by_steps { 1 } else { AT_ONCE };
                by_series(series, &mut self.pair.steps, now, mode, (t_end, most))
            }
            None => self.pair.fly(now, mode, obstacle, t_end, force),
        }
    }

    /// Of how many curves the last piece consists.
    pub(super) fn curves(&self) -> usize {
        self.series.as_ref().map_or(1, |series| series.parts())
    }

    /// One of them, in order, up to the impact if there was one.
    pub(super) fn curve<E, F: Force<E>>(
        &mut self,
        k: usize,
        sigma: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<FlightCurve, Failure<E>> {
        match self.part(k) {
            Some((t, part, table)) => Ok(FlightCurve::of_part(t, sigma, &part, table)),
            None => self.pair.curve(sigma, force),
        }
    }

    /// Adds a segment to a path by its initial data; returns whether these determine it.
    #[inline]
    pub(super) fn keep(&self, k: usize, sigma: f64, path: &mut DensePath) -> bool {
        let part = self.part(k);
        if let Some((start, part, table)) = part {
            path.push_part(start, sigma, (part, table));
        }
        part.is_some()
    }

    /// The same of a piece that is one of them under a linear force.
    #[inline(always)]
    pub(super) fn keep_alone(&self, sigma: f64, path: &mut DensePath) -> bool {
        let Some(series) = &self.series else { return false };
        let Some((start, part)) = series.alone() else { return false };
        path.push_part(start, sigma, (part, series.table()));
        true
    }

    /// A segment by its initial time and data, which determine it under a linear force.
    pub(super) fn part(&self, k: usize) -> Option<(f64, FlightPart, &Arc<Table>)> {
        let series = self.series.as_ref()?;
        let (t, part) = series.part(k);
        Some((t, part, series.table()))
    }
}

/// Up to a number of power-series steps.
#[inline]
fn by_series<E>(
    series: &mut SeriesFlight,
    counts: &mut Steps<f64>,
    now: Point,
    mode: &mut Mode,
    (t_end, most): (f64, usize),
) -> Result<Arrival, Failure<E>> {
    let steps = most.min(counts.left()?);
    let known = match *mode {
        Mode::Flight(NextInFlight::Leave { order }) => order,
        _ => usize::from(now.x == 0.0),
    };
    let reach = Reach { t_end, look: counts.dense_from(), steps };
    let mut arrival = series.fly(now, known, reach);
    if !(arrival.end.x.is_finite() && arrival.end.xdot.is_finite()) {
        if arrival.steps == 1 {
            return Err(Failure::Status(Status::StateNotFinite));
        }
        // a run that samples every step ends with the last finite one: so does this, next time
        let Arrival { from, steps, .. } = arrival;
        arrival = Arrival { from, end: from, lands: false, steps: steps - 1 };
    }
    counts.count(arrival.steps);
    if !arrival.lands {
        *mode = Mode::FLIGHT;
    }
    Ok(arrival)
}
