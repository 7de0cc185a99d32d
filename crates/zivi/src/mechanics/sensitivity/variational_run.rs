//! Follows a run of the machine with the columns: each step, impact, Zeno point and lift-off.

use crate::kinetics::mode::{InContact, Next, Stages, State};
use crate::kinetics::Model;
use crate::mechanics::integrator::MechanicalIntegrator;
use crate::mechanics::sensitivity::columns::{
    hold_rows, Columns, Direction, Exchange, FrictionalImpulses, MechanicalWrt, RoughImpact,
};
use crate::motion::linear_flight::FlightRates;
use crate::motion::path::Piece;
use crate::motion::tolerances;
use crate::numeric::coordinates::Coordinates;
use crate::numeric::stages::{factor, shorter, FACTORS};
use crate::numeric::tableau::Pair;
use crate::piecewise::steps::Driver;
use crate::record::events::{FlagKind, Occurrence};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::switched::sensitivity::{EventRates, Limit, Validity};
use crate::system::dynamics::Layout;
use crate::system::force::Friction;
use crate::system::partials::{DifferentiableDynamics, MovedLaws};
use crate::zeno::arc::Bounce;
use crate::zeno::chain::{Chain, ChainRates, Rate};
use crate::zeno::table::ExtrapolatedEnd;
use crate::{AnyImpactLaw, Status};

/// Changes of a contact whose times have derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Change {
    /// A gap opens, or the law of a compliant one changes its sign.
    Opening(usize),
    /// A channel of friction begins to slip or stick.
    Friction(usize),
}

/// The columns of a run in progress.
pub(super) struct VariationalRun<'a> {
    pub(super) columns: Columns,
    /// Magnitudes of the variables of differentiation.
    pub(super) sizes: &'a [f64],
    /// Whether the steps are adapted to the columns too.
    pub(super) controlled: bool,
    /// Times at which the columns are wanted, increasing, and the columns there.
    times: &'a [f64],
    pub(super) samples: Vec<f64>,
    pub(super) chains: Vec<ChainRates>,
    /// Of the Zeno point that the impact sequence is about to reach.
    pub(super) zeno: Vec<ExtrapolatedEnd<Vec<f64>>>,
    pub(super) events: EventRates,
    pub(super) validity: Validity,
    /// Since when some column is not known, and which of them are not known now.
    pub(super) lost_at: Option<f64>,
    pub(super) lost: Vec<bool>,
    /// Whether the order of coupled impacts is decided by the tolerance.
    pub(super) uncertain: bool,
    /// Tangential restitutions by channel.
    pub(super) e_t: Vec<f64>,
    /// How parameters move the flights of a linear system, once there are some.
    pub(super) exact: Option<FlightRates>,
    /// The largest gap so far, and when the run ends.
    pub(super) highest: f64,
    pub(super) end: f64,
}

impl<'a> VariationalRun<'a> {
    pub(super) fn new(
        (wrt, moved, sizes): (&[MechanicalWrt], Vec<Option<MovedLaws>>, &'a [f64]),
        controlled: bool,
        times: &'a [f64],
        end: f64,
        (layout, friction, pair): (Layout, &Friction, &'static Pair),
    ) -> Self {
        Self {
            columns: Columns::new((wrt, moved), (layout, friction), pair),
            sizes,
            controlled,
            times,
            samples: Vec::new(),
            chains: vec![ChainRates::default(); sizes.len()],
            zeno: Vec::new(),
            events: EventRates::default(),
            validity: Validity::new(sizes.len()),
            lost_at: None,
            lost: vec![false; sizes.len()],
            uncertain: false,
            e_t: friction.channels.iter().map(|channel| channel.e_t).collect(),
            exact: None,
            highest: 0.0,
            end,
        }
    }

    pub(super) fn count(&self) -> usize {
        self.sizes.len()
    }

    /// The columns where the machine starts, before an impact if it starts with one.
    pub(super) fn begin<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (Layout { n, .. }, now) = (self.columns.layout, machine.state().now());
        let (size, mode) = (self.columns.size(), machine.state().mode());
        self.set_extent(machine, model)?;
        // what opens at the start does so whatever the parameters are
        let is_t0 = |it: &MechanicalWrt| f64::from(u8::from(matches!(it, MechanicalWrt::T0)));
        let opened: Vec<f64> = self.columns.wrt.iter().map(is_t0).collect();
        self.note_events(machine, 0, |_| None, |_| Some(opened.clone()), &[]);
        self.columns.visit(model, now, mode)?;
        self.note_height(machine);
        let acceleration = self.columns.local.kinetics.acceleration.clone();
        for column in 0..self.count() {
            let (mut q, mut w) = (vec![0.0; n], vec![0.0; n]);
            match self.columns.wrt[column] {
                MechanicalWrt::Q0(i) => q[i] = 1.0,
                MechanicalWrt::Qdot0(i) => w[i] = 1.0,
                MechanicalWrt::T0 => {
                    q.iter_mut().zip(&now.xdot).for_each(|(q, v)| *q = -v);
                    w.iter_mut().zip(&acceleration).for_each(|(w, a)| *w = -a);
                }
                _ => (),
            }
            let local = &self.columns.local;
            let parameter = self.columns.parameter[column];
            let row = local.along(Direction { t: 0.0, q: &q, w: &w, parameter });
            let gaps = local.gaps(&row, &now.xdot[..n], &w);
            let end = &mut self.columns.now;
            let (x, v) =
                (&mut end.x[column * size..][..size], &mut end.xdot[column * size..][..size]);
            x[..n].copy_from_slice(&q);
            v[..n].copy_from_slice(&w);
            for (k, [gap, rate]) in gaps.into_iter().enumerate() {
                (x[n + k], v[n + k]) = (gap, rate);
            }
        }
        if mode.closed.is_empty() && mode.stick.is_empty() {
            return Ok(());
        }
        self.columns.project(mode, now)?;
        if self.columns.layout.p > 0 {
            self.columns.renew_rows(mode, now);
        }
        Ok(())
    }

    /// Extent of the motion in a second or in a shorter run.
    fn set_extent<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (n, State { t, x, xdot: v, .. }) = (self.columns.layout.n, machine.state().now());
        let local = &mut self.columns.local;
        local.carry(machine.state().mode());
        local.kinetics.evaluate(model, *t, &x[..n], &v[..n])?;
        local.contact(machine.state().mode())?;
        let (duration, a) = ((self.end - t).min(1.0), &local.kinetics.acceleration);
        let of_w: Vec<f64> = (0..n).map(|c| v[c].abs() + duration * a[c].abs()).collect();
        let of_q: Vec<f64> = (0..n).map(|c| x[c].abs() + duration * of_w[c]).collect();
        model.dynamics.set_extent(&of_q, &of_w);
        Ok(())
    }

    pub(super) fn note_height(&mut self, machine: &MechanicalIntegrator) {
        let Layout { n, m, .. } = self.columns.layout;
        self.highest =
            machine.state().now().x[n..n + m].iter().fold(self.highest, |a, b| a.max(b.abs()));
    }

    /// From here on a column is not known.
    pub(super) fn lose(&mut self, column: usize, t: f64) {
        self.lost[column] = true;
        self.lost_at.get_or_insert(t);
    }

    /// From here on none is.
    pub(super) fn lose_all(&mut self, t: f64) {
        (0..self.count()).for_each(|column| self.lose(column, t));
        self.blank();
    }

    /// NaN for the columns that are not known.
    pub(super) fn blank(&mut self) {
        let size = self.columns.size();
        for column in (0..self.count()).filter(|&column| self.lost[column]) {
            self.columns.now.x[column * size..][..size].fill(f64::NAN);
            self.columns.now.xdot[column * size..][..size].fill(f64::NAN);
        }
        self.columns.visited = None;
    }

    /// Whether no column is known.
    fn is_blind(&self) -> bool {
        self.lost.iter().all(|&lost| lost)
    }

    /// Adds rows for the events after a number of occurrences.
    pub(super) fn note_events(
        &mut self,
        machine: &MechanicalIntegrator,
        from: usize,
        impact: impl Fn(usize) -> Option<(Vec<f64>, Vec<f64>)>,
        change: impl Fn(Change) -> Option<Vec<f64>>,
        zeno: &[f64],
    ) {
        let unknown = vec![f64::NAN; self.count()];
        for it in &machine.occurrences()[from..] {
            match *it {
                Occurrence::Impact { gap, t, .. } => {
                    let (dt, du) = impact(gap).unwrap_or((unknown.clone(), unknown.clone()));
                    self.note_end(t, &dt);
                    self.events.impact_dt.extend(dt);
                    self.events.impact_du.extend(du);
                }
                Occurrence::Zeno { t, .. } => {
                    self.note_end(t, zeno);
                    self.events.zeno_times.extend_from_slice(zeno);
                }
                Occurrence::LiftOff { gap, t } => {
                    let dt = change(Change::Opening(gap)).unwrap_or(unknown.clone());
                    self.note_end(t, &dt);
                    self.events.liftoff_times.extend(dt);
                }
                Occurrence::Contact { gap, t } => {
                    let dt = change(Change::Opening(gap)).unwrap_or(unknown.clone());
                    self.note_end(t, &dt);
                    self.events.touchdown_times.extend(dt);
                }
                Occurrence::Transition { channel, .. } => {
                    let dt = change(Change::Friction(channel)).unwrap_or(unknown.clone());
                    self.events.transition_times.extend(dt);
                }
                Occurrence::Flag { kind: FlagKind::OrderUncertain, .. } => self.uncertain = true,
                _ => (),
            }
        }
    }

    /// An event near the end of the run may pass it.
    fn note_end(&mut self, t: f64, dt: &[f64]) {
        self.validity.note(Limit::End, t, self.end - t, dt.iter().copied());
    }

    /// A segment of the motion without columns.
    fn blindly<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let from = machine.occurrences().len();
        let piece = machine.advance(t_end, model)?;
        let unknown = vec![f64::NAN; self.count()];
        self.note_events(machine, from, |_| None, |_| None, &unknown);
        self.fill_samples(machine.state().now().t);
        self.hold(machine, model)?;
        Ok(piece)
    }

    /// Where the contacts determine the state the columns are known whatever came before.
    pub(super) fn hold<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        if machine.state().closed().len() < self.columns.layout.n || !self.lost.contains(&true) {
            return Ok(());
        }
        let size = self.columns.size();
        for column in 0..self.count() {
            if std::mem::take(&mut self.lost[column]) {
                self.columns.now.x[column * size..][..size].fill(0.0);
                self.columns.now.xdot[column * size..][..size].fill(0.0);
            }
        }
        let mode = machine.state().mode();
        self.columns.visit(model, machine.state().now(), mode)?;
        self.columns.project(mode, machine.state().now())
    }

    /// Samples up to a time where the columns are not known.
    pub(super) fn fill_samples(&mut self, until: f64) {
        let (n, count) = (self.columns.layout.n, self.count());
        while self.next_time().is_some_and(|t| t < until) {
            self.samples.extend(std::iter::repeat_n(f64::NAN, 2 * n * count));
        }
    }

    /// The first wanted time that has no sample.
    pub(super) fn next_time(&self) -> Option<f64> {
        let row = 2 * self.columns.layout.n * self.count();
        self.times.get(self.samples.len().checked_div(row)?).copied()
    }

    /// The columns of the present state for the times that are left.
    pub(super) fn sample_end(&mut self, t: f64) {
        let (n, size) = (self.columns.layout.n, self.columns.size());
        while self.next_time().is_some_and(|wanted| wanted <= t) {
            for of in [&self.columns.now.x, &self.columns.now.xdot] {
                self.samples.extend(of.chunks_exact(size.max(1)).flat_map(|column| &column[..n]));
            }
        }
    }
}

impl<'f, E, D: DifferentiableDynamics<E>> Driver<MechanicalIntegrator, Model<'f, D>, E>
    for VariationalRun<'_>
{
    fn step(
        &mut self,
        machine: &mut MechanicalIntegrator,
        t_end: f64,
        model: &mut Model<'f, D>,
    ) -> Result<Piece, Failure<E>> {
        if self.is_blind() {
            return self.blindly(machine, t_end, model);
        }
        let is_linear = machine.motion_mut().linear_period(model).is_some();
        match machine.next() {
            Next::LocatedEvent(hit) if hit.iter().any(|gap| self.is_compliant(gap)) => {
                let hit = *hit;
                self.cross(hit, machine, t_end, model)
            }
            Next::LocatedEvent(_) => self.strike(machine, t_end, model),
            Next::Stop(_) => self.change_friction(machine, t_end, model),
            Next::Release { .. } if self.columns.layout.p > 0 => {
                self.change_friction(machine, t_end, model)
            }
            Next::Release { .. } => self.release(machine, t_end, model),
            Next::Jump(ahead) if ahead.landing.t <= t_end => self.jump(machine, t_end, model),
            _ if machine.state().through() != GapSet::EMPTY => {
                let through = machine.state().through();
                match through.iter().any(|gap| self.is_compliant(gap)) {
                    true => self.cross(through, machine, t_end, model),
                    false => self.strike(machine, t_end, model),
                }
            }
            _ if is_linear => self.fly_exactly(machine, t_end, model),
            _ => self.fly_within(machine, t_end, model),
        }
    }
}

// The columns in flight and in contact: through the steps of the motion, shorter ones where the
// columns need them.

/// Steps rejected for the columns before one is accepted regardless.
const RETRIES: u32 = 40;
/// How far the step onto an impact may be moved to it, relative to its length.
const NUDGE: f64 = 1e-4;

impl VariationalRun<'_> {
    /// A step, shorter ones until the columns are within the tolerances too.
    pub(super) fn fly_within<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let (visited, mode) = (self.columns.visited, machine.state().mode());
        let before = machine.save();
        let order = machine.motion().last().order_of_error();
        let shortest = 16.0 * f64::EPSILON * before.state().now().t.abs();
        for retry in 0.. {
            let piece = machine.advance(t_end, model)?;
            let h = machine.motion().last().h;
            self.columns.visited = visited.filter(|_| retry == 0);
            self.columns.advance(machine.motion().last(), mode, model)?;
            let error = self.error(machine, model)?;
            let factor = factor(error, order);
            if error <= 1.0 || retry == RETRIES || h <= shortest {
                if error > 0.0 {
                    let longest = h * factor.clamp(FACTORS.0, FACTORS.1);
                    machine.motion_mut().steps_mut().limit_next(longest);
                }
                self.flew(machine, model)?;
                return Ok(piece);
            }
            machine.give_up_step(&before, shorter(factor) * h);
        }
        Err(Failure::Status(Status::Internal))
    }

    fn error<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<f64, Failure<E>> {
        if !self.controlled || !machine.settings().adaptive {
            return Ok(0.0);
        }
        let tolerances = tolerances(machine.settings());
        self.columns.error(machine.motion().last(), &tolerances, (self.sizes, &self.lost), model)
    }

    /// Contributions of an accepted step: samples, minima, the end of the columns.
    pub(super) fn flew<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        self.note_height(machine);
        let (total, t) = (machine.motion().length(), machine.state().now().t);
        let mut onto = None;
        let mode = self.columns.mode;
        if (total - machine.motion().last().h).abs() > NUDGE * machine.motion().last().h {
            // the event was found on the polynomials, away from the end of the step
            let mut stages = machine.motion().last().clone();
            let (from, size) = (stages.from.clone(), self.columns.size());
            let slope: Vec<f64> = (0..size).map(|c| stages.start_slope(c)).collect();
            stages.step(&from, &slope, total, &mut self.motion(mode, model))?;
            self.columns.visited = None;
            self.columns.advance(&stages, mode, model)?;
            onto = Some(stages);
        }
        if let Next::Step = machine.next() {
            self.minima(machine, model)?;
        }
        let stages = onto.as_ref().unwrap_or(machine.motion().last());
        self.sample(stages, t, model)?;
        self.columns.take(stages, total - stages.h, model)?;
        if !(mode.closed.is_empty() && mode.stick.is_empty()) {
            self.columns.visit(model, machine.state().now(), mode)?;
            self.columns.project(mode, machine.state().now())?;
        }
        Ok(())
    }

    /// The motion itself, evaluated aside.
    fn motion<'r, 'm, D>(
        &'r mut self,
        mode: ContactMode,
        model: &'r mut Model<'m, D>,
    ) -> InContact<'r, 'm, D> {
        InContact { mode, kinetics: &mut self.columns.local.kinetics, model, at_end: None }
    }

    /// Minima of the gaps within the step.
    fn minima<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (Layout { n, m, .. }, size) = (self.columns.layout, self.columns.size());
        let mode = self.columns.mode;
        let deep = mode.closed.with(mode.pressed).with(mode.unloaded);
        for gap in (0..m).filter(|&gap| !deep.has(gap)) {
            let (from, end) = (
                machine.motion().last().from.xdot[n + gap],
                machine.motion().last().end.xdot[n + gap],
            );
            if !(from < 0.0 && end > 0.0) {
                continue;
            }
            let stages = machine.motion_mut().steps_mut().last_mut();
            stages.complete(&mut self.motion(mode, model))?;
            let [x, rate] = stages.polynomials_of(n + gap);
            let Some(theta) = rate.negated().first_negative() else { continue };
            self.columns.complete(stages, model)?;
            let rates: Vec<f64> = (0..self.count())
                .map(|column| {
                    let entry = column * size + n + gap;
                    self.columns.steps.polynomials_of(entry)[0].at(theta)
                })
                .collect();
            let t = stages.from.t + theta * stages.h;
            self.validity.note(Limit::Minimum, t, x.at(theta), rates);
        }
        Ok(())
    }

    /// Samples within the last step, before `until`.
    fn sample<E, D: DifferentiableDynamics<E>>(
        &mut self,
        stages: &Stages,
        until: f64,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (n, size) = (self.columns.layout.n, self.columns.size());
        while let Some(t) = self.next_time().filter(|&t| t < until) {
            self.columns.complete(stages, model)?;
            let theta = ((t - stages.from.t) / stages.h).clamp(0.0, 1.0);
            for part in 0..2 {
                for column in 0..self.count() {
                    for c in 0..n {
                        let entry = column * size + c;
                        let curves = self.columns.steps.polynomials_of(entry);
                        self.samples.push(curves[part].at(theta));
                    }
                }
            }
        }
        Ok(())
    }
}

// Impacts: the saltation of the columns.
//
// ```text
// dt = -dY/Y'-        D z- = dz- + z'- dt        M D w+ - N_S^T DP = ..., N_S D w+ + ... = D g'+
// D g'+_i = -A_i' D g'-_i + dA_i                 dz+ = D z+ - z'+ dt
// ```
//
// with `A_i(-g'-_i)` the speed after an impact by the law of the gap, by Newton's `-e_i g'-_i`, and
// `S` the gaps that have an impulse: the solution of the complementarity problem is differentiable
// where it is strict, every other closed gap opens at a speed or is orthogonal.

/// A rate of a closed gap that an orthogonal impact should leave, relative to the others.
const KINK: f64 = 1e-7;

/// Result of an impact for the columns.
pub(super) struct StruckColumns {
    pub(super) before: State,
    /// Accelerations before it.
    slope: Vec<f64>,
    mode: ContactMode,
    /// The gaps that were hit, and those with an impulse.
    hit: GapSet,
    pub(super) set: GapSet,
    impulses: Vec<f64>,
    /// Effect of friction in it.
    pub(super) rough: Option<RoughImpact>,
}

/// Derivatives along an event, by one column.
#[derive(Clone, Debug, Default)]
struct Shifted {
    dt: f64,
    /// Coordinates and gaps, velocities and rates.
    x: Vec<f64>,
    v: Vec<f64>,
}

impl VariationalRun<'_> {
    /// Through an impact.
    pub(super) fn strike<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let (before, mode, from) =
            (machine.state().now().clone(), machine.state().mode(), machine.occurrences().len());
        self.columns.visit(model, &before, mode)?;
        let slope = self.columns.local.kinetics.acceleration.clone();
        let piece = machine.advance(t_end, model)?;
        machine.state_mut().know(model)?;
        let (mut hit, mut set, mut impulses) = (GapSet::EMPTY, GapSet::EMPTY, Vec::new());
        for it in &machine.occurrences()[from..] {
            if let Occurrence::Impact { gap, before, impulse, .. } = *it {
                if before < 0.0 {
                    hit = hit.with(GapSet::of(gap));
                }
                if impulse > 0.0 {
                    set = set.with(GapSet::of(gap));
                    impulses.push(impulse);
                }
            }
        }
        let rough = self.rough_impact(&machine.occurrences()[from..], set);
        let struck = StruckColumns { before, slope, mode, hit, set, impulses, rough };
        let shifted = self.through(&struck, machine, model)?;
        if shifted.is_empty() {
            let unknown = vec![f64::NAN; self.count()];
            self.note_events(machine, from, |_| None, |_| None, &unknown);
            return Ok(piece);
        }
        let n = self.columns.layout.n;
        let dt: Vec<f64> = shifted.iter().map(|it| it.dt).collect();
        let stops = self.stops(&struck, &shifted, machine, model)?;
        let impact = |gap: usize| {
            let du = shifted.iter().map(|it| it.v[n + gap]).collect();
            Some((dt.clone(), du))
        };
        self.note_events(machine, from, impact, |_| Some(dt.clone()), &stops);
        self.land_columns(&shifted, machine);
        if !machine.state().mode().stick.is_empty() {
            let mode = machine.state().mode();
            self.columns.visit(model, machine.state().now(), mode)?;
            self.columns.project(mode, machine.state().now())?;
        }
        self.weigh(&struck, &shifted, machine, model)?;
        Ok(piece)
    }

    /// The derivatives along the impact of the state after it; the columns are lost where there are
    /// none.
    fn through<E, D: DifferentiableDynamics<E>>(
        &mut self,
        struck: &StruckColumns,
        machine: &MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<Vec<Shifted>, Failure<E>> {
        let (Layout { n, m, .. }, size) = (self.columns.layout, self.columns.size());
        let (t, StruckColumns { before, slope, mode, hit, set, impulses, rough }) =
            (machine.state().now().t, struck);
        let mut hits = hit.iter();
        let (Some(gap), None) = (hits.next(), hits.next()) else {
            self.lose_all(t);
            return Ok(Vec::new());
        };
        let c = n + gap;
        self.note_depth(struck, c);
        let limits = match rough {
            Some(rough) => self.prepare_impact(rough, (struck, c), machine, model)?,
            None => Vec::new(),
        };
        let mut all = Vec::with_capacity(self.count());
        let (rtol, atol) = (machine.settings().rtol, machine.settings().atol);
        for column in 0..self.count() {
            let end = &self.columns.now;
            let (x, v) = (&end.x[column * size..][..size], &end.xdot[column * size..][..size]);
            let dt = -x[c] / before.xdot[c];
            let mut x: Vec<f64> = x.iter().zip(&before.xdot).map(|(x, v)| x + dt * v).collect();
            let mut v: Vec<f64> = v.iter().zip(slope).map(|(v, a)| v + dt * a).collect();
            x[c] = 0.0;
            (n + self.columns.layout.rows()..size).for_each(|work| (x[work], v[work]) = (0.0, 0.0));
            let largest = |of: &[f64]| of.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
            let tolerance = atol[1] + rtol * largest(&before.xdot);
            let noise = KINK * (largest(&x) + largest(&v)) + 100.0 * tolerance / self.sizes[column];
            let (w, rates) = v.split_at_mut(n);
            let parameter = self.columns.parameter[column];
            let local = &mut self.columns.local;
            let row = local.along(Direction { t: dt, q: &x[..n], w, parameter });
            let (wrt, speed) = (self.columns.wrt[column], -before.xdot[c]);
            let of_law = self.columns.of_law(column, gap, machine.law(gap), speed);
            let local = &mut self.columns.local;
            let after = &machine.state().now().xdot;
            let stays = |i: usize| i == gap && machine.state().closed().has(i);
            let target = |i: usize| match i {
                i if stays(i) || i != gap => 0.0,
                _ => {
                    let (law, v) = (machine.law(i), -before.xdot[n + i]);
                    -law.slope(v) * rates[i] + of_law
                }
            };
            let wanted: Vec<f64> = (0..m).map(target).collect();
            let (of, to) = (&before.xdot[..n], &after[..n]);
            if let Some(rough) = rough {
                let limits = limits.get(column).map(|it| &it[..]);
                let how = FrictionalImpulses {
                    mode: rough.pattern,
                    impulses: &rough.impulses,
                    before: of,
                    after: to,
                    limits,
                };
                let back = |channel: usize| {
                    let e_t = self.e_t[channel] * rates[m + channel];
                    -e_t - wrt.of_restitution(channel) * before.xdot[n + m + channel]
                };
                let back: Vec<f64> = (0..self.e_t.len()).map(back).collect();
                let target = |i: usize| if i < m { wanted[i] } else { back[i - m] };
                local.frictional_exchange(&how, &row, target, (w, &mut *rates))?;
            } else {
                let how = Exchange { set: *set, impulses, before: of, after: to };
                local.exchange(&how, &row, |i| wanted[i], w, rates)?;
            }
            let kink = |i: usize| rates[i].abs() > noise && after[n + i] == 0.0;
            let sticks = machine.state().mode().stick.iter().map(|channel| m + channel);
            if mode.closed.without(*set).iter().chain(sticks).any(kink) {
                self.lose(column, t);
            }
            all.push(Shifted { dt, x, v });
        }
        Ok(all)
    }

    /// An impact that is pulled off may vanish: `v^2/(2 a)` is how much higher its lowest point may
    /// be.
    fn note_depth(&mut self, struck: &StruckColumns, c: usize) {
        let (v, a) = (struck.before.xdot[c], struck.slope[c]);
        if a > 0.0 {
            let size = self.columns.size();
            let x = &self.columns.now.x;
            let rates = (0..self.count()).map(|column| x[column * size + c]);
            self.validity.note(Limit::Impact, struck.before.t, v * v / (2.0 * a), rates);
        }
    }

    /// The derivatives of the time at which a gap closes that the impact stops: with `e > 0` it
    /// would bounce for `2 u/a` more.
    fn stops<E, D: DifferentiableDynamics<E>>(
        &mut self,
        struck: &StruckColumns,
        shifted: &[Shifted],
        machine: &MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<Vec<f64>, Failure<E>> {
        let n = self.columns.layout.n;
        let mut dt: Vec<f64> = shifted.iter().map(|it| it.dt).collect();
        let Some(gap) = struck.hit.iter().find(|&gap| machine.state().closed().has(gap)) else {
            return Ok(dt);
        };
        let kinetics = &mut self.columns.local.kinetics;
        let now = machine.state().now();
        kinetics.evaluate(model, now.t, &now.x[..n], &now.xdot[..n])?;
        self.columns.local.contact(struck.mode)?;
        self.columns.visited = None;
        let pull = -self.columns.local.kinetics.acceleration[n + gap];
        if pull > 0.0 {
            for (column, dt) in dt.iter_mut().enumerate() {
                let (law, v) = (machine.law(gap), -struck.before.xdot[n + gap]);
                let du = self.columns.of_law(column, gap, law, v);
                *dt += 2.0 * du / pull;
            }
        }
        Ok(dt)
    }

    /// The columns at a fixed time after an event, from the derivatives along it.
    fn land_columns(&mut self, shifted: &[Shifted], machine: &MechanicalIntegrator) {
        let size = self.columns.size();
        let end = &mut self.columns.now;
        for (column, it) in shifted.iter().enumerate() {
            let (x, v) =
                (&mut end.x[column * size..][..size], &mut end.xdot[column * size..][..size]);
            for c in 0..size {
                x[c] = it.x[c] - it.dt * machine.state().now().xdot[c];
                v[c] = it.v[c] - it.dt * machine.state().slope()[c];
            }
            let known = self.columns.layout.n + self.columns.layout.rows();
            (known..size).for_each(|work| (x[work], v[work]) = (0.0, 0.0));
            hold_rows(machine.state().mode(), self.columns.layout, (x, v));
        }
        self.blank();
    }

    /// The part of the impact in its impact sequence, and whether the derivatives of a Zeno point are known as
    /// well as the point.
    fn weigh<E, D: DifferentiableDynamics<E>>(
        &mut self,
        struck: &StruckColumns,
        shifted: &[Shifted],
        machine: &mut MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let Some(&last) = machine.chain().bounces().last() else { return Ok(()) };
        let key = machine.chain().key();
        if last.t != machine.state().now().t || key.hit != struck.hit {
            return Ok(());
        }
        self.note_chain(shifted, machine, model)?;
        if !matches!(machine.next(), Next::Jump(ahead) if ahead.corner.is_none()) {
            return Ok(());
        }
        let (scales, rtol) = (machine.scales(last), machine.settings().rtol);
        let gap = struck.hit.iter().next().unwrap_or_default();
        let is_alone = machine.law(gap).geometric_up_to() == 0.0;
        let mut known = true;
        self.zeno.clear();
        for (column, chain) in self.chains.iter().enumerate() {
            let size = self.sizes[column];
            let de = self.columns.limit_of_law(column, gap, machine.law(gap));
            let scale = |c: usize, rate: f64| scales[c] / size + rtol * rate.abs();
            match chain.landing(machine.chain(), de, scale) {
                Some(zeno) => {
                    known &= self.lost[column] || zeno.size <= 1.0 || is_alone;
                    self.zeno.push(zeno);
                }
                None => known = false,
            }
        }
        if !known && !machine.chain().is_over() && self.zeno_wanted() {
            machine.cancel_jump();
        }
        Ok(())
    }

    /// Notes the last impact of an impact sequence.
    fn note_chain<E, D: DifferentiableDynamics<E>>(
        &mut self,
        shifted: &[Shifted],
        machine: &mut MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (n, rows) = (self.columns.layout.n, self.columns.layout.rows());
        let (size, key) = (self.columns.size(), machine.chain().key());
        let (set, now) = (key.landed.closed, machine.state().now().clone());
        let Some(gap) = key.hit.iter().next() else { return Ok(()) };
        let z = machine.state_mut().without_speeds(key.landed)?;
        let w = &z[size..][..n];
        // the state without the bounce, and how it moves along the event
        let local = &mut self.columns.local;
        local.visit(model, now.t, &now.x[..n], &now.xdot[..n])?;
        let rough = !key.landed.is_frictionless();
        let impulses = match rough {
            true => local.stopping_impulses(key.landed, &now.xdot[n..])?,
            false => {
                local.kinetics.solve_regular(set, |_, i| -now.xdot[n + i])?;
                local.kinetics.solved()[..set.len()].to_vec()
            }
        };
        let (before, mode) = (&now.xdot[..n], key.landed);
        let how = Exchange { set, impulses: &impulses, before, after: w };
        let pattern =
            FrictionalImpulses { mode, impulses: &impulses, before, after: w, limits: None };
        let mut moved = Vec::with_capacity(shifted.len());
        for (column, it) in shifted.iter().enumerate() {
            let parameter = self.columns.parameter[column];
            let row = local.along(Direction { t: it.dt, q: &it.x[..n], w: &it.v[..n], parameter });
            let mut v = it.v.clone();
            let (of_w, rates) = v.split_at_mut(n);
            match rough {
                true => local.frictional_exchange(&pattern, &row, |_| 0.0, (of_w, rates))?,
                false => local.exchange(&how, &row, |_| 0.0, of_w, rates)?,
            }
            let mut x = it.x.clone();
            hold_rows(mode, local.layout, (&mut x, &mut v));
            moved.push([x, v].concat());
        }
        // the acceleration of the gap, and the motion in contact
        local.visit(model, now.t, &now.x[..n], w)?;
        let mut pulls = Vec::with_capacity(shifted.len());
        local.contact(key.flight)?;
        for (column, (it, dz)) in shifted.iter().zip(&moved).enumerate() {
            let (q, w, parameter) = (&dz[..n], &dz[size..][..n], self.columns.parameter[column]);
            let row = local.along(Direction { t: it.dt, q, w, parameter });
            pulls.push(-local.acceleration(key.flight, &row)?.0[n + gap]);
        }
        local.contact(key.landed)?;
        let slow: Vec<f64> = shifted
            .iter()
            .enumerate()
            .map(|(column, it)| match machine.law(gap).geometric_up_to() {
                0.0 => change_of_ratio(it.v[n + gap], machine.law(gap), machine.chain()),
                _ => self.columns.limit_of_law(column, gap, machine.law(gap)),
            })
            .collect();
        let local = &mut self.columns.local;
        let mut flow = [&z[size..], &local.kinetics.acceleration[..]].concat();
        (n + rows..size).for_each(|work| (flow[work], flow[size + work]) = (0.0, 0.0));
        for (column, (it, dz)) in shifted.iter().zip(&moved).enumerate() {
            let (q, w, parameter) = (&dz[..n], &dz[size..][..n], self.columns.parameter[column]);
            let row = local.along(Direction { t: it.dt, q, w, parameter });
            let (turned, _) = local.acceleration(key.landed, &row)?;
            let mut by_flow = [&dz[size..], &turned[..]].concat();
            by_flow.resize(2 * size, 0.0);
            let rate = Rate {
                dt: it.dt,
                du: it.v[n + gap],
                dg: pulls[column],
                de: slow[column],
                flow: [&flow, &by_flow],
                dz,
            };
            self.chains[column].note(machine.chain(), &rate);
        }
        debug_assert_eq!(flow.len(), 2 * size);
        self.columns.visited = None;
        Ok(())
    }
}

/// How the ratio of an impact sequence changes that stands for impacts in none, with a sum `S` of the speeds: it makes
/// the time to its end change with `S`.
fn change_of_ratio<Z: Coordinates, K: Copy + PartialEq>(
    du: f64,
    law: &AnyImpactLaw,
    chain: &Chain<Z, K>,
) -> f64 {
    const STEP: f64 = 1e-4;
    let Some(&Bounce { u, .. }) = chain.bounces().last() else { return f64::NAN };
    let sum = |u: f64| law.sum_of_speeds(u).unwrap_or(f64::NAN);
    let power = (sum(u * (1.0 + STEP)) / sum(u * (1.0 - STEP)) - 1.0) / (2.0 * STEP);
    (1.0 - chain.e()) * (power - 1.0) * du / u
}

// Where contact begins and ends: Zeno points, corners, lift-offs.
//
// ```text
// Zeno point   dz = D z_inf - F dt_inf, in the manifold of the contacts
// lift-off     dt = -dlambda/lambda' along the motion in contact; the columns go on
// ```

impl VariationalRun<'_> {
    /// Whether a Zeno point has to wait for its derivatives.
    pub(super) fn zeno_wanted(&self) -> bool {
        self.controlled
    }

    /// Through the rest of an accumulation.
    pub(super) fn jump<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let corner = matches!(machine.next(), Next::Jump(ahead) if ahead.corner.is_some());
        let (from, key) = (machine.occurrences().len(), machine.chain().key());
        let piece = machine.advance(t_end, model)?;
        let t = machine.state().now().t;
        self.fill_samples(t);
        if corner || self.zeno.len() != self.count() {
            let unknown = vec![f64::NAN; self.count()];
            self.note_events(machine, from, |_| None, |_| None, &unknown);
            self.lose_all(t);
            self.hold(machine, model)?;
            return Ok(piece);
        }
        let dt: Vec<f64> = self.zeno.iter().map(|zeno| zeno.t).collect();
        self.note_events(machine, from, |_| None, |_| Some(dt.clone()), &dt);
        let (Layout { n, .. }, size) = (self.columns.layout, self.columns.size());
        let end = &mut self.columns.now;
        for (column, zeno) in self.zeno.iter().enumerate() {
            let dz = zeno.state();
            for c in 0..n + self.columns.layout.rows() {
                let entry = column * size + c;
                end.x[entry] = dz[c] - zeno.t * machine.state().now().xdot[c];
                end.xdot[entry] = dz[size + c] - zeno.t * machine.state().slope()[c];
            }
        }
        let mode = machine.state().mode();
        self.columns.visit(model, machine.state().now(), mode)?;
        if let Some(gap) = key.hit.iter().next() {
            self.note_pull(n + gap, (key.flight, mode), machine)?;
        }
        self.columns.project(mode, machine.state().now())?;
        self.hold(machine, model)?;
        self.zeno.clear();
        Ok(piece)
    }

    /// At a Zeno point the acceleration of the gap must keep pointing to the wall.
    fn note_pull<E>(
        &mut self,
        c: usize,
        (flight, mode): (ContactMode, ContactMode),
        machine: &MechanicalIntegrator,
    ) -> Result<(), Failure<E>> {
        let n = self.columns.layout.n;
        let closed = machine.state().closed().without(GapSet::of(c - n));
        let flight = ContactMode { closed, ..flight };
        let local = &mut self.columns.local;
        local.contact(flight)?;
        let pull = -local.kinetics.acceleration[c];
        let mut rates = Vec::with_capacity(self.zeno.len());
        for (column, zeno) in self.zeno.iter().enumerate() {
            let dz = zeno.state();
            let size = dz.len() / 2;
            let (q, w) = (&dz[..n], &dz[size..][..n]);
            let parameter = self.columns.parameter[column];
            let row = local.along(Direction { t: zeno.t, q, w, parameter });
            rates.push(local.acceleration(flight, &row)?.0[c]);
        }
        local.contact(mode)?;
        if pull > 0.0 {
            self.validity.note(Limit::Zeno, machine.state().now().t, pull, rates);
        }
        Ok(())
    }

    /// Where the force of a contact vanishes.
    pub(super) fn release<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let (Layout { n, .. }, size) = (self.columns.layout, self.columns.size());
        let (mode, now, from) =
            (machine.state().mode(), machine.state().now().clone(), machine.occurrences().len());
        self.columns.visit(model, &now, mode)?;
        let local = &mut self.columns.local;
        let a = local.kinetics.acceleration[..n].to_vec();
        let onwards = Direction { t: 1.0, q: &now.xdot[..n], w: &a, parameter: None };
        let row = local.along(onwards);
        let (_, fall) = local.acceleration(mode, &row)?;
        let mut rates = Vec::with_capacity(self.sizes.len());
        for (column, parameter) in self.columns.parameter.iter().enumerate() {
            let end = &self.columns.now;
            let (q, w) = (&end.x[column * size..][..n], &end.xdot[column * size..][..n]);
            let row = local.along(Direction { t: 0.0, q, w, parameter: *parameter });
            rates.push(local.acceleration(mode, &row)?.1);
        }
        let piece = machine.advance(t_end, model)?;
        let dt = |change: Change| {
            let Change::Opening(gap) = change else { return None };
            let one = |rate: &Vec<f64>| match rate[gap] {
                0.0 => 0.0,
                rate => -rate / fall[gap],
            };
            Some(rates.iter().map(one).collect::<Vec<f64>>())
        };
        self.note_events(machine, from, |_| None, dt, &[]);
        let together = machine.occurrences()[from..]
            .iter()
            .any(|it| matches!(it, Occurrence::Flag { kind: FlagKind::Simultaneous, .. }));
        if together {
            self.lose_all(machine.state().now().t);
        }
        Ok(piece)
    }
}
