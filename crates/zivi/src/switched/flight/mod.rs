//! Free flight: what gives its next piece, and the motion over it.

mod rk;
pub(crate) mod series;

use super::integrator::{Piece, SwitchedIntegrator};
use super::path::Curve;
use super::settings::Flights;
use super::stages::Counted;
use crate::record::failure::Failure;
use crate::{Force, Status};
use series::{Linear, SeriesFlight};

/// A way to compute free flight.
pub(super) trait FreeFlight<E, F: Force<E>> {
    /// The next piece, up to an impact if there is one.
    fn next(&mut self, t_end: f64, force: &mut Counted<'_, F>) -> Result<Piece, Failure<E>>;

    /// Of how many curves the last piece consists.
    fn curves(&self) -> usize {
        1
    }

    /// One of them, in order.
    fn curve(
        &mut self,
        k: usize,
        sigma: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Curve, Failure<E>>;
}

/// Steps of an embedded pair.
struct RungeKutta<'i>(&'i mut SwitchedIntegrator);

impl<E, F: Force<E>> FreeFlight<E, F> for RungeKutta<'_> {
    fn next(&mut self, t_end: f64, force: &mut Counted<'_, F>) -> Result<Piece, Failure<E>> {
        self.0.runge_kutta(t_end, force)
    }

    fn curve(
        &mut self,
        _: usize,
        sigma: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Curve, Failure<E>> {
        self.0.stages_curve(sigma, force)
    }
}

/// Power series of a linear force.
struct PowerSeries<'i>(&'i mut SwitchedIntegrator);

impl<E, F: Force<E>> FreeFlight<E, F> for PowerSeries<'_> {
    fn next(&mut self, t_end: f64, _: &mut Counted<'_, F>) -> Result<Piece, Failure<E>> {
        self.0.spend()?;
        let SwitchedIntegrator { now: from, sigma, rises, .. } = *self.0;
        let Some(series) = &mut self.0.series else {
            return Err(Failure::Status(Status::Internal));
        };
        let known = if from.x > 0.0 {
            0
        } else if from.xdot > 0.0 {
            1
        } else {
            rises
        };
        let flown = series.next(from, known, t_end);
        let (end, lands) = (flown.end, flown.lands());
        if !(end.x.is_finite() && end.xdot.is_finite()) {
            return Err(Failure::Status(Status::StateNotFinite));
        }
        self.0.counts.accepted += 1;
        self.0.armed = true;
        if lands {
            return Ok(self.0.strike(from, end));
        }
        self.0.now = end;
        Ok(Piece::Flight { from, sigma, impact: None })
    }

    fn curves(&self) -> usize {
        self.0.series.as_ref().map_or(0, |series| series.parts())
    }

    fn curve(&mut self, k: usize, sigma: f64, _: &mut Counted<'_, F>) -> Result<Curve, Failure<E>> {
        let Some(series) = &self.0.series else { return Err(Failure::Status(Status::Internal)) };
        let (a, step, xdot, lands) = series.part(k);
        Ok(Curve::powers(step, sigma, a, xdot, lands))
    }
}

impl SwitchedIntegrator {
    /// Chooses the flights that the settings ask for under this force.
    pub(super) fn adopt<E, F: Force<E>>(&mut self, force: &F) {
        let law = match self.settings.flights {
            Flights::RungeKutta => None,
            Flights::Auto if !self.settings.adaptive => None,
            Flights::Auto | Flights::Series => force.linear(),
        };
        self.series = match (self.series.take(), law) {
            (_, None) => None,
            (None, Some(law)) => SeriesFlight::new(law).map(Box::new),
            (Some(mut series), Some(law)) => series.under(law).map(|()| series),
        };
    }

    /// The force by its numbers, if flights are power series.
    pub(super) fn linear(&self) -> Option<Linear> {
        self.series.as_ref().map(|series| series.linear())
    }

    /// The next piece of free flight.
    pub(super) fn fly<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        if self.now.x == 0.0 && self.now.xdot < 0.0 {
            return Ok(self.strike(self.now, self.now));
        }
        match self.series {
            Some(_) => PowerSeries(self).next(t_end, force),
            None => RungeKutta(self).next(t_end, force),
        }
    }

    /// Of how many curves the last piece of flight consists.
    pub(super) fn curves<E, F: Force<E>>(&mut self) -> usize {
        match self.series {
            Some(_) => FreeFlight::<E, F>::curves(&PowerSeries(self)),
            None => FreeFlight::<E, F>::curves(&RungeKutta(self)),
        }
    }

    /// One of them, up to the impact if there was one.
    pub(super) fn curve<E, F: Force<E>>(
        &mut self,
        k: usize,
        sigma: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Curve, Failure<E>> {
        match self.series {
            Some(_) => PowerSeries(self).curve(k, sigma, force),
            None => RungeKutta(self).curve(k, sigma, force),
        }
    }
}
