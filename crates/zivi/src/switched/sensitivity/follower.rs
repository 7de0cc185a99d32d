//! Follows a run of the switched method with the columns: each step, impact, Zeno point, rest and
//! lift-off.
//!
//! ```text
//! impact    dt = -X-/v-      dv- = V- + a- dt      du = -e dv- - v- de
//!           X+ = -u dt       V+ = du - a+ dt       a+- = f(t, 0, x'+-)
//! rest      X = V = 0
//! lift-off  dt = -f_q/f_t at (t, 0, 0),  X = V = 0
//! ```

use super::columns::{ColumnStep, Wrt};
use super::validity::{Limit, Validity};
use super::zeno::{ChainRates, ZenoRates};
use crate::record::failure::Failure;
use crate::switched::integrator::{Mode, Piece, SwitchedIntegrator};
use crate::switched::stages::{Counted, Point, Stages};
use crate::switched::stepper::Stepper;
use crate::system::slopes::{DifferentiableForce, Place};
use crate::{Dependence, Impact, Status};

/// Smallest and largest factor between two steps, and what keeps the next from being rejected.
const FACTORS: (f64, f64) = (0.2, 5.0);
const SAFETY: f64 = 0.9;
/// Steps that are given up for the columns before one is taken as it is.
const RETRIES: u32 = 40;
/// How far the step onto an impact may be moved to it, relative to its length.
const NUDGE: f64 = 1e-4;
/// Looks at the slope of the force over a part of a rest.
const LOOKS: u32 = 8;

/// The derivatives of the events, one row for each.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::switched) struct EventRates {
    pub(in crate::switched) impact_dt: Vec<f64>,
    pub(in crate::switched) impact_du: Vec<f64>,
    pub(in crate::switched) zeno: Vec<f64>,
    pub(in crate::switched) lift_off: Vec<f64>,
}

/// The columns of a run under way.
pub(in crate::switched) struct Follower {
    wrt: Vec<Wrt>,
    by_e: Option<usize>,
    /// Magnitudes of what the columns are derivatives by.
    sizes: Vec<f64>,
    /// Whether the steps are adapted to the columns too.
    controlled: bool,
    pub(in crate::switched) step: ColumnStep,
    rates: ChainRates,
    pub(in crate::switched) events: EventRates,
    pub(in crate::switched) validity: Validity,
    pub(in crate::switched) path: Option<super::path::ColumnPath>,
    /// `dt` and `du` of the last impact; of the arrival at rest.
    dt: Vec<f64>,
    du: Vec<f64>,
    /// Of the Zeno point that the chain is about to reach.
    zeno: ZenoRates,
    /// Since when the mass rests.
    resting: Option<f64>,
    /// The largest distance so far, and when the run ends.
    pub(in crate::switched) highest: f64,
    end: f64,
}

impl Follower {
    pub(in crate::switched) fn new(
        wrt: &[Wrt],
        sizes: &[f64],
        controlled: bool,
        end: f64,
        dense: bool,
    ) -> Self {
        let m = wrt.len();
        let zeros = vec![0.0; m];
        Self {
            wrt: wrt.to_vec(),
            by_e: wrt.iter().position(|&it| it == Wrt::E),
            sizes: sizes.to_vec(),
            controlled,
            step: ColumnStep::new(wrt),
            rates: ChainRates::new(m),
            events: EventRates::default(),
            validity: Validity::new(m),
            path: dense.then(|| super::path::ColumnPath::new(m)),
            dt: zeros.clone(),
            du: zeros,
            zeno: ZenoRates::default(),
            resting: None,
            highest: 0.0,
            end,
        }
    }

    /// The columns where the integrator starts, through an impact if it starts with one.
    pub(in crate::switched) fn begin<E, F: DifferentiableForce<E>>(
        &mut self,
        start: Point,
        e: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let pull = force.at(start.t, start.x, start.xdot)?;
        self.step.end.clear();
        self.highest = start.x;
        if start.x == 0.0 && start.xdot == 0.0 {
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
                Wrt::E | Wrt::Parameter(_) => (0.0, 0.0),
            };
            (self.step.end.x[column], self.step.end.v[column]) = (x, v);
        }
        if start.x == 0.0 && start.xdot < 0.0 {
            let impact =
                Impact { t: start.t, xdot_before: start.xdot, xdot_after: -e * start.xdot };
            return self.strike(&impact, e, force);
        }
        Ok(())
    }

    /// Through an impact, from the columns before it to those after it.
    fn strike<E, F: DifferentiableForce<E>>(
        &mut self,
        impact: &Impact,
        e: f64,
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
        let Self { step, dt, du, by_e, .. } = self;
        for column in 0..dt.len() {
            let (x, xdot) = (&mut step.end.x[column], &mut step.end.v[column]);
            dt[column] = -*x / v;
            let dv = *xdot + before * dt[column];
            du[column] = -e * dv - if *by_e == Some(column) { v } else { 0.0 };
            (*x, *xdot) = (-u * dt[column], du[column] - after * dt[column]);
        }
        self.validity.note(Limit::End, t, self.end - t, self.dt.iter().copied());
        self.events.impact_dt.extend_from_slice(&self.dt);
        self.events.impact_du.extend_from_slice(&self.du);
        Ok(())
    }

    /// Once the last impact has been thought about: its part in the chain, and whether the
    /// derivatives of a Zeno time are known as well as the time.
    fn weigh<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let Some(&last) = integrator.chain.bounces().last() else { return Ok(()) };
        if last.t != integrator.now.t {
            return Ok(());
        }
        let mut dg = vec![0.0; self.dt.len()];
        self.wall_rates(last.t, &self.dt.clone(), force, &mut dg)?;
        dg.iter_mut().for_each(|dg| *dg = -*dg);
        self.rates.note(&integrator.chain, [&self.dt, &self.du, &dg]);
        if integrator.zeno.is_none() {
            return Ok(());
        }
        let e = integrator.wall.e();
        self.zeno = self.rates.zeno(&integrator.chain, e, self.by_e);
        let rest = integrator.chain.remaining(last);
        let spent = integrator.chain.is_spent() || rest <= 4.0 * f64::EPSILON * last.t.abs();
        let tolerance = integrator.zeno_tolerance(&integrator.chain, last.g);
        let rtol = integrator.settings.rtol;
        let known = self.zeno.dt.iter().zip(&self.zeno.error).zip(&self.sizes);
        let mut all =
            known.map(|((dt, error), size)| error * size <= tolerance + rtol * size * dt.abs());
        if self.controlled && !spent && !all.all(|known| known) {
            integrator.zeno = None;
        }
        Ok(())
    }

    /// The derivatives of `f(t, 0, 0)` along a time that moves by `dt`; also `f_t`.
    fn wall_rates<E, F: DifferentiableForce<E>>(
        &mut self,
        t: f64,
        dt: &[f64],
        force: &mut Counted<'_, F>,
        out: &mut [f64],
    ) -> Result<f64, Failure<E>> {
        let place = Place { t, x: 0.0, xdot: 0.0 };
        let slopes = self.step.forcing.slopes(place, true, force)?;
        for (out, dt) in out.iter_mut().zip(dt) {
            *out = slopes.t * dt;
        }
        self.step.forcing.add_to(out, 1.0);
        Ok(slopes.t)
    }

    /// At rest, where the Zeno time moves by `self.dt`.
    fn came_to_rest<E, F: DifferentiableForce<E>>(
        &mut self,
        t: f64,
        through_chain: bool,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        self.step.end.clear();
        self.events.zeno.extend_from_slice(&self.dt);
        self.validity.note(Limit::End, t, self.end - t, self.dt.iter().copied());
        if through_chain {
            let pull = -force.at_wall(t)?;
            let mut rates = vec![0.0; self.dt.len()];
            self.wall_rates(t, &self.dt.clone(), force, &mut rates)?;
            self.validity.note(Limit::Zeno, t, pull, rates);
        }
        self.resting = Some(t);
        Ok(())
    }

    /// At rest by an impact that stops the mass: with `e > 0` it would go on for `2 u/g` more.
    fn stopped<E, F: DifferentiableForce<E>>(
        &mut self,
        t: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let pull = -force.at_wall(t)?;
        if pull > 0.0 {
            for (dt, du) in self.dt.iter_mut().zip(&self.du) {
                *dt += 2.0 * du / pull;
            }
        }
        self.came_to_rest(t, false, force)
    }

    /// A part of a rest, and the lift-off at its end.
    fn rest<E, F: DifferentiableForce<E>>(
        &mut self,
        (from, to): (f64, f64),
        lifted: bool,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let since = match self.resting {
            Some(since) => since,
            None => {
                self.stopped(from, force)?;
                from
            }
        };
        if force.dependence_at_rest::<E>() != Dependence::Constant {
            self.maxima_at_rest(from, to, force)?;
        } else if !lifted {
            let pull = -force.at_wall(from)?;
            let mut rates = vec![0.0; self.dt.len()];
            self.wall_rates(from, &vec![0.0; rates.len()], force, &mut rates)?;
            self.validity.note(Limit::Rest, from, pull, rates);
        }
        if lifted {
            self.lift_off(to, to > since, force)?;
        }
        Ok(())
    }

    fn lift_off<E, F: DifferentiableForce<E>>(
        &mut self,
        t: f64,
        smoothly: bool,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        self.step.end.clear();
        if smoothly {
            let mut rates = vec![0.0; self.dt.len()];
            let zeros = rates.clone();
            let mut rise = self.wall_rates(t, &zeros, force, &mut rates)?;
            // the run has the time to a few roundings; the derivatives are those at the root
            let off = force.at_wall(t)? / rise;
            if off.abs() <= 64.0 * f64::EPSILON * t.abs() {
                rise = self.wall_rates(t - off, &zeros, force, &mut rates)?;
            }
            for (dt, rate) in self.dt.iter_mut().zip(&rates) {
                *dt = if *rate == 0.0 { 0.0 } else { -rate / rise };
            }
            // a maximum of f_t^2/(2 |f_tt|) above zero: f_tt over the time in which f_t changes
            let ahead = 1e-4 * (self.end - t).min(1.0);
            let mut unused = zeros.clone();
            let later = self.wall_rates(t + ahead, &zeros, force, &mut unused)?;
            let curvature = ((later - rise) / ahead).abs();
            let height = rise * rise / (2.0 * curvature);
            if height.is_finite() {
                self.validity.note(Limit::LiftOff, t, height, rates.iter().copied());
            }
        } else {
            let pull = force.at_wall(t)?;
            for (v, dt) in self.step.end.v.iter_mut().zip(&self.dt) {
                *v = -pull * dt;
            }
        }
        self.validity.note(Limit::End, t, self.end - t, self.dt.iter().copied());
        self.events.lift_off.extend_from_slice(&self.dt);
        self.resting = None;
        Ok(())
    }

    /// Where the force at rest is at a maximum below zero: its slope changes from + to -.
    fn maxima_at_rest<E, F: DifferentiableForce<E>>(
        &mut self,
        from: f64,
        to: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let zeros = vec![0.0; self.dt.len()];
        let mut rates = zeros.clone();
        let (mut before, mut rise) = (from, self.wall_rates(from, &zeros, force, &mut rates)?);
        for look in 1..=LOOKS {
            let at = from + (to - from) * f64::from(look) / f64::from(LOOKS);
            let next = self.wall_rates(at, &zeros, force, &mut rates)?;
            if rise > 0.0 && next <= 0.0 {
                let slope = |t: f64| self.wall_rates(t, &zeros, force, &mut rates);
                let top = crate::numeric::root::between((before, rise), (at, next), slope)?.best;
                let pull = -force.at_wall(top)?;
                self.wall_rates(top, &zeros, force, &mut rates)?;
                self.validity.note(Limit::Rest, top, pull, rates.iter().copied());
            }
            (before, rise) = (at, next);
        }
        Ok(())
    }

    /// The columns over a piece of flight; by how much the step was too long for them.
    fn fly<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &SwitchedIntegrator,
        force: &mut Counted<'_, F>,
    ) -> Result<f64, Failure<E>> {
        self.step.step(&integrator.stages, force)?;
        if !self.controlled || !integrator.settings.adaptive {
            return Ok(0.0);
        }
        let settings = &integrator.settings;
        let tolerances = (settings.rtol, settings.atol);
        self.step.error(&integrator.stages, tolerances, &self.sizes, force)
    }

    /// What a piece of flight that was taken adds: a minimum, the dense output, an impact.
    fn flew<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        impact: Option<Impact>,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        self.highest = self.highest.max(integrator.stages.from.x.abs());
        if impact.is_none() {
            self.minimum(integrator, force)?;
        }
        let length = integrator.landing.filter(|_| impact.is_some()).map(|landing| landing.0);
        let mut onto = None;
        if let Some(total) = length.filter(|&total| far(total, &integrator.stages)) {
            // the impact was found on the polynomials, away from the end of the step
            let mut stages = integrator.stages.clone();
            stages.step(stages.from, stages.slope_at_start(), total, force)?;
            self.step.step(&stages, force)?;
            onto = Some(stages);
        }
        let stages = onto.as_ref().unwrap_or(&integrator.stages);
        if let Some(path) = &mut self.path {
            self.step.all_stages(stages, force)?;
            path.push_flight(stages, &self.step, length);
        }
        if let Some(total) = length {
            self.step.polish(stages, total - stages.h, force)?;
        }
        match impact {
            Some(impact) => self.strike(&impact, integrator.wall.e(), force),
            None => Ok(()),
        }
    }

    /// A minimum of the distance within the step, above the wall.
    fn minimum<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let stages = &mut integrator.stages;
        if !(stages.from.xdot < 0.0 && stages.end.xdot > 0.0) {
            return Ok(());
        }
        let [x, xdot] = stages.polynomials(force)?;
        let Some(theta) = xdot.negated().first_negative() else { return Ok(()) };
        self.step.all_stages(stages, force)?;
        let rates: Vec<f64> = (0..self.sizes.len())
            .map(|column| self.step.polynomials(stages, column)[0].at(theta))
            .collect();
        let t = stages.from.t + theta * stages.h;
        self.validity.note(Limit::Minimum, t, x.at(theta), rates);
        Ok(())
    }

    /// A step of flight, shorter ones until the columns are within the tolerances too.
    fn fly_within<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        std::mem::swap(&mut self.step.from, &mut self.step.end);
        let before = integrator.clone();
        let order = integrator.stages.order_of_error();
        let shortest = 16.0 * f64::EPSILON * before.now.t.abs();
        for retry in 0.. {
            let piece = integrator.proceed(t_end, force)?;
            let Piece::Flight { impact, .. } = piece else {
                // rest follows an impact that stopped the mass
                std::mem::swap(&mut self.step.from, &mut self.step.end);
                return self.other(integrator, piece, force);
            };
            if let Some(impact) = impact.filter(|_| integrator.landing.is_none()) {
                // the last step ended at the wall
                std::mem::swap(&mut self.step.from, &mut self.step.end);
                self.strike(&impact, integrator.wall.e(), force)?;
                return Ok(piece);
            }
            let h = integrator.stages.h;
            let error = self.fly(integrator, force)?;
            let factor = SAFETY * error.powf(-1.0 / order);
            if error <= 1.0 || retry == RETRIES || h <= shortest {
                if error > 0.0 {
                    let longest = h * factor.clamp(FACTORS.0, FACTORS.1);
                    integrator.h = integrator.h.map(|next| next.min(longest));
                }
                self.flew(integrator, impact, force)?;
                return Ok(piece);
            }
            let factor = if factor > FACTORS.0 { factor.min(SAFETY) } else { FACTORS.0 };
            let rejected = integrator.counts.rejected + 1;
            integrator.clone_from(&before);
            integrator.counts.rejected = rejected;
            integrator.h = Some(factor * h);
        }
        Err(Failure::Status(Status::Internal))
    }

    /// A tail or a rest.
    fn other<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &SwitchedIntegrator,
        piece: Piece,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        let t = integrator.now.t;
        match piece {
            Piece::Tail(ref tail) => {
                self.dt.clone_from(&self.zeno.dt);
                self.came_to_rest(t, true, force)?;
                if let Some(path) = &mut self.path {
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

impl<E, F: DifferentiableForce<E>> Stepper<E, F> for Follower {
    fn step(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        if integrator.struck {
            integrator.settle(t_end, force)?;
            self.weigh(integrator, force)?;
        }
        let jumps = integrator.zeno.is_some_and(|zeno| zeno <= t_end);
        if jumps || integrator.mode == Mode::Rest {
            let piece = integrator.proceed(t_end, force)?;
            return self.other(integrator, piece, force);
        }
        self.fly_within(integrator, t_end, force)
    }
}

/// Whether an impact lies away from the end of the step that was made onto it.
fn far(total: f64, stages: &Stages) -> bool {
    (total - stages.h).abs() > NUDGE * stages.h
}
