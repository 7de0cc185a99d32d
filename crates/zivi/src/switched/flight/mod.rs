//! Free flight: what gives its next piece, and the motion over it.

mod rk;
pub(crate) mod series;

use super::integrator::{Piece, SwitchedIntegrator};
use super::mode::{Flight, Mode};
use super::path::Curve;
use super::point::Point;
use super::settings::Flights;
use super::stages::Counted;
use crate::record::failure::Failure;
use crate::{Force, Status};
use series::{Arrival, Linear, Reach, SeriesFlight};

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

/// Steps of power series that are taken in one go where nobody looks at their ends.
const AT_ONCE: usize = 1000;

/// Power series of a linear force.
struct PowerSeries<'i>(&'i mut SwitchedIntegrator);

impl PowerSeries<'_> {
    /// Steps that end in the air.
    #[inline]
    fn flown(&mut self, from: Point, end: Point, steps: usize) -> Piece {
        self.0.count(steps);
        self.0.now = end;
        self.0.mode = Mode::FLIGHT;
        Piece::Flight { from, sigma: self.0.sigma, impact: None }
    }
}

impl<E, F: Force<E>> FreeFlight<E, F> for PowerSeries<'_> {
    fn next(&mut self, t_end: f64, _: &mut Counted<'_, F>) -> Result<Piece, Failure<E>> {
        let SwitchedIntegrator { now, mode, looks, .. } = *self.0;
        let steps = if looks.by_steps { 1 } else { AT_ONCE };
        let steps = steps.min(self.0.control.left(&self.0.settings)?);
        let Some(series) = &mut self.0.series else {
            return Err(Failure::Status(Status::Internal));
        };
        let known = match mode {
            Mode::Flight(Flight::Leave { order }) => order,
            _ => usize::from(now.x == 0.0),
        };
        let reach = Reach { t_end, look: looks.dense_from, steps };
        let Arrival { from, end, lands, steps } = series.fly(now, known, reach);
        if !(end.x.is_finite() && end.xdot.is_finite()) {
            if steps == 1 {
                return Err(Failure::Status(Status::StateNotFinite));
            }
            // a run that looks at every step ends with the last finite one: so does this, next time
            return Ok(self.flown(from, from, steps - 1));
        }
        if !lands {
            return Ok(self.flown(from, end, steps));
        }
        self.0.count(steps);
        Ok(self.0.strike(from, end))
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
    /// Counts steps of power series.
    #[inline]
    fn count(&mut self, steps: usize) {
        self.control.spent += steps;
        self.counts.accepted += steps as u64;
    }

    /// Chooses the flights that the settings ask for under this force.
    pub(super) fn adopt<E, F: Force<E>>(&mut self, force: &F) {
        let law = match self.settings.flights {
            Flights::RungeKutta => None,
            Flights::Auto if !self.settings.adaptive => None,
            Flights::Auto | Flights::Series => force.linear(),
        };
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

    /// The force on the mass at rest at the wall, now.
    #[inline]
    pub(super) fn at_wall<E, F: Force<E>>(
        &self,
        force: &mut Counted<'_, F>,
    ) -> Result<f64, Failure<E>> {
        let known = self.series.as_ref().and_then(|series| series.at_wall(self.now));
        known.filter(|f| f.is_finite()).map_or_else(|| force.at_wall(self.now.t), Ok)
    }

    /// The next piece of free flight.
    pub(super) fn fly<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        if self.now.physical().arrives() {
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
