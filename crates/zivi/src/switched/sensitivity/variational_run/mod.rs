//! Follows a run of the switched method with the columns: each step, impact, Zeno point, rest and
//! lift-off.
//!
//! ```text
//! impact    dt = -X-/v-      dv- = V- + a- dt      du = -after'(-v-) dv- + after_q(-v-)
//!           X+ = -u dt       V+ = du - a+ dt       a+- = f(t, 0, x'+-)
//! ```

mod flight;
mod rest;

use super::columns::{ColumnStep, Wrt};
use super::derivatives::EventRates;
use super::validity::{Limit, Validity};
use crate::piecewise::method::Driver;
use crate::record::failure::Failure;
use crate::switched::integrator::SwitchedIntegrator;
use crate::switched::mode::{Flight, Mode};
use crate::switched::piece::Piece;
use crate::switched::point::Point;
use crate::switched::stages::Counted;
use crate::system::slopes::{DifferentiableForce, Place};
use crate::zeno::rates::{ChainRates, Rate};
use crate::{AnyImpactLaw, Impact, Status};

/// The columns of a run under way.
pub(in crate::switched) struct VariationalRun {
    wrt: Vec<Wrt>,
    /// Magnitudes of what the columns are derivatives by.
    sizes: Vec<f64>,
    /// Whether the steps are adapted to the columns too.
    controlled: bool,
    pub(in crate::switched) step: ColumnStep,
    chains: Vec<ChainRates>,
    pub(in crate::switched) events: EventRates,
    pub(in crate::switched) validity: Validity,
    pub(in crate::switched) path: Option<super::path::ColumnPath>,
    /// `dt` and `du` of the last impact; of the arrival at rest.
    dt: Vec<f64>,
    du: Vec<f64>,
    /// Of the Zeno point that the chain is about to reach.
    zeno: Vec<f64>,
    /// Since when the mass rests.
    resting: Option<f64>,
    /// The largest distance so far, and when the run ends.
    pub(in crate::switched) highest: f64,
    end: f64,
    /// Times at which the force may jump, increasing.
    stops: Vec<f64>,
}

impl VariationalRun {
    pub(in crate::switched) fn new(
        wrt: &[Wrt],
        sizes: &[f64],
        controlled: bool,
        end: f64,
        stops: &[f64],
        dense: bool,
    ) -> Self {
        let m = wrt.len();
        let zeros = vec![0.0; m];
        Self {
            wrt: wrt.to_vec(),
            sizes: sizes.to_vec(),
            controlled,
            step: ColumnStep::new(wrt),
            chains: vec![ChainRates::default(); m],
            events: EventRates::default(),
            validity: Validity::new(m),
            path: dense.then(|| super::path::ColumnPath::new(m)),
            dt: zeros.clone(),
            du: zeros,
            zeno: Vec::new(),
            resting: None,
            highest: 0.0,
            end,
            stops: stops.to_vec(),
        }
    }

    /// The columns where the integrator starts, through an impact if it starts with one.
    pub(in crate::switched) fn begin<E, F: DifferentiableForce<E>>(
        &mut self,
        start: Point,
        law: &AnyImpactLaw,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let pull = force.at(start.t, start.x, start.xdot)?;
        self.step.end.clear();
        self.highest = start.x;
        if start.physical().is_at_origin() {
            for (dt, wrt) in self.dt.iter_mut().zip(&self.wrt) {
                *dt = if *wrt == Wrt::T0 { 1.0 } else { 0.0 };
            }
            self.resting = Some(start.t);
            return Ok(());
        }
        for (column, wrt) in self.wrt.iter().enumerate() {
            let (x, v) = match wrt {
                Wrt::X0 => (1.0, 0.0),
                Wrt::Xdot0 => (0.0, 1.0),
                Wrt::T0 => (-start.xdot, -pull),
                Wrt::Law(_) | Wrt::Parameter(_) => (0.0, 0.0),
            };
            (self.step.end.x[column], self.step.end.v[column]) = (x, v);
        }
        if start.physical().arrives() {
            let xdot_after = law.after(-start.xdot);
            let impact = Impact { t: start.t, xdot_before: start.xdot, xdot_after };
            return self.strike(&impact, law, force);
        }
        Ok(())
    }

    /// Through an impact, from the columns before it to those after it.
    fn strike<E, F: DifferentiableForce<E>>(
        &mut self,
        impact: &Impact,
        law: &AnyImpactLaw,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let Impact { t, xdot_before: v, xdot_after: u } = *impact;
        let before = force.at(t, 0.0, v)?;
        let after = force.at(t, 0.0, u)?;
        if before > 0.0 {
            // pulled off the wall: v^2/(2 a) is how much higher the lowest point may be
            let depth = v * v / (2.0 * before);
            self.validity.note(Limit::Impact, t, depth, self.step.end.x.iter().copied());
        }
        let slope = law.slope(-v);
        let Self { step, dt, du, wrt, .. } = self;
        for column in 0..dt.len() {
            let (x, xdot) = (&mut step.end.x[column], &mut step.end.v[column]);
            dt[column] = -*x / v;
            let dv = *xdot + before * dt[column];
            du[column] = wrt[column].of_law(|parameter| law.by(parameter, -v)) - slope * dv;
            (*x, *xdot) = (-u * dt[column], du[column] - after * dt[column]);
        }
        self.note_neighbours(t);
        for (list, row) in
            [(&mut self.events.impact_dt, &self.dt), (&mut self.events.impact_du, &self.du)]
        {
            list.try_reserve(row.len()).map_err(|_| Failure::Status(Status::OutOfMemory))?;
            list.extend_from_slice(row);
        }
        Ok(())
    }

    /// Once the last impact has been thought about: its part in the chain, and whether the
    /// derivatives of a Zeno time are known as well as the time.
    fn weigh<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let Some(&last) = integrator.chain().bounces().last() else { return Ok(()) };
        if last.t != integrator.t() {
            return Ok(());
        }
        let mut dg = vec![0.0; self.dt.len()];
        self.wall_rates(last.t, &self.dt.clone(), force, &mut dg)?;
        dg.iter_mut().for_each(|dg| *dg = -*dg);
        // flights after it are others, or long, where its speed or the pull has vanished
        self.validity.note(Limit::Chain, last.t, last.g.abs(), dg.iter().copied());
        self.validity.note(Limit::Chain, last.t, last.u, self.du.iter().copied());
        for (column, dg) in dg.into_iter().enumerate() {
            let (dt, du) = (self.dt[column], self.du[column]);
            let de = self.limit_by(column, integrator);
            let rate = Rate { dt, du, dg, de, flow: [&[], &[]], dz: &[] };
            self.chains[column].note(integrator.chain(), &rate);
        }
        let Mode::Flight(Flight::Jump { .. }) = integrator.mode() else { return Ok(()) };
        let tolerance = integrator.settings().zeno_tolerance(integrator.chain(), last.g);
        let (rtol, mut known) = (integrator.settings().rtol, true);
        self.zeno.clear();
        for (column, chain) in self.chains.iter().enumerate() {
            let (de, size) = (self.limit_by(column, integrator), self.sizes[column]);
            let landing = chain.landing(integrator.chain(), de, |_, _| 1.0);
            let (dt, error) = landing.map_or((0.0, f64::INFINITY), |it| (it.t, it.size));
            known &= error * size <= tolerance + rtol * size * dt.abs();
            self.zeno.push(dt);
        }
        if self.controlled && !integrator.chain().is_over() && !known {
            integrator.cancel_jump();
        }
        Ok(())
    }

    /// The derivative of the ratio of speeds in a chain.
    fn limit_by(&self, column: usize, integrator: &SwitchedIntegrator) -> f64 {
        self.wrt[column].of_law(|parameter| integrator.law().limit_by(parameter))
    }

    /// An event at `t` that moves by `self.dt` may pass the end of the run, or a jump of the force.
    fn note_neighbours(&mut self, t: f64) {
        self.validity.note(Limit::End, t, self.end - t, self.dt.iter().copied());
        let after = self.stops.partition_point(|&stop| stop <= t);
        let near = [after.checked_sub(1), Some(after)];
        for stop in near.into_iter().flatten().filter_map(|i| self.stops.get(i)) {
            self.validity.note(Limit::Stop, t, (stop - t).abs(), self.dt.iter().copied());
        }
    }

    /// At the end of the run: an impact shortly behind it may come before it.
    pub(in crate::switched) fn ends(&mut self, end: Point) {
        if end.x > 0.0 && end.xdot < 0.0 {
            let rates: Vec<f64> = self.step.end.x.iter().map(|x| x / end.xdot).collect();
            self.validity.note(Limit::End, end.t, -end.x / end.xdot, rates);
        }
    }

    /// The derivatives of `f(t, 0, 0)` along a time that moves by `dt`; also `f_t`.
    fn wall_rates<E, F: DifferentiableForce<E>>(
        &mut self,
        t: f64,
        dt: &[f64],
        force: &mut Counted<'_, F>,
        out: &mut [f64],
    ) -> Result<f64, Failure<E>> {
        let place = Place::new(t, 0.0, 0.0);
        let slopes = self.step.forcing.slopes(place, true, force)?;
        for (out, dt) in out.iter_mut().zip(dt) {
            *out = slopes.t * dt;
        }
        self.step.forcing.add_to(out, 1.0);
        Ok(slopes.t)
    }

    /// A tail or a rest.
    fn other<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &SwitchedIntegrator,
        piece: Piece,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        let t = integrator.t();
        match piece {
            Piece::Tail => {
                self.dt.clone_from(&self.zeno);
                self.came_to_rest(t, true, force)?;
                if let (Some(path), Some(tail)) = (&mut self.path, integrator.tail()) {
                    path.push_tail(tail.start());
                }
            }
            Piece::Rest { from, lifted } => {
                self.rest((from, t), lifted, force)?;
                if let Some(path) = &mut self.path {
                    path.push_rest(from);
                }
            }
            Piece::Flight { .. } => {}
        }
        Ok(piece)
    }
}

impl<'f, E, F: DifferentiableForce<E>> Driver<SwitchedIntegrator, Counted<'f, F>, E>
    for VariationalRun
{
    fn step(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        t_end: f64,
        force: &mut Counted<'f, F>,
    ) -> Result<Piece, Failure<E>> {
        if let Mode::Flight(Flight::AfterImpact) = integrator.mode() {
            integrator.settle(t_end, force)?;
            self.weigh(integrator, force)?;
        }
        match integrator.mode() {
            Mode::Rest(_) | Mode::Flight(Flight::Jump { .. }) => {
                let piece = integrator.proceed(t_end, force)?;
                self.other(integrator, piece, force)
            }
            Mode::Flight(_) => self.fly_within(integrator, t_end, force),
        }
    }
}
