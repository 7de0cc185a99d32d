//! Follows a run of the machine with the columns: each step, impact, Zeno point and lift-off.

use super::columns::{Columns, MechanicalWrt};
use super::local::Direction;
use crate::mechanics::equation::State;
use crate::mechanics::integrator::MechanicalIntegrator;
use crate::mechanics::kinetics::Model;
use crate::mechanics::linear_flight::FlightRates;
use crate::mechanics::mode::Next;
use crate::mechanics::piece::Piece;
use crate::numeric::tableau::Pair;
use crate::piecewise::method::Driver;
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::record::occurrence::{FlagKind, Occurrence};
use crate::switched::sensitivity::{EventRates, Limit, Validity};
use crate::system::dynamics::Layout;
use crate::system::partials::DifferentiableDynamics;
use crate::zeno::rates::ChainRates;
use crate::zeno::table::Landing;

/// The columns of a run under way.
pub(super) struct VariationalRun<'a> {
    pub(super) columns: Columns,
    /// Magnitudes of what the columns are derivatives by.
    pub(super) sizes: &'a [f64],
    /// Whether the steps are adapted to the columns too.
    pub(super) controlled: bool,
    /// Times at which the columns are wanted, increasing, and the columns there.
    times: &'a [f64],
    pub(super) samples: Vec<f64>,
    pub(super) chains: Vec<ChainRates>,
    /// Of the Zeno point that the chain is about to reach.
    pub(super) zeno: Vec<Landing<Vec<f64>>>,
    pub(super) events: EventRates,
    pub(super) validity: Validity,
    /// Since when some column is not known, and which of them are not known now.
    pub(super) lost_at: Option<f64>,
    pub(super) lost: Vec<bool>,
    /// Whether the order of coupled impacts is decided by the tolerance.
    pub(super) uncertain: bool,
    /// How parameters move the flights of a linear system, once there are some.
    pub(super) exact: Option<FlightRates>,
    /// The largest gap so far, and when the run ends.
    pub(super) highest: f64,
    pub(super) end: f64,
}

impl<'a> VariationalRun<'a> {
    pub(super) fn new(
        (wrt, sizes): (&[MechanicalWrt], &'a [f64]),
        controlled: bool,
        times: &'a [f64],
        end: f64,
        (layout, pair): (Layout, &'static Pair),
    ) -> Self {
        Self {
            columns: Columns::new(wrt, layout, pair),
            sizes,
            controlled,
            times,
            samples: Vec::new(),
            chains: vec![ChainRates::default(); wrt.len()],
            zeno: Vec::new(),
            events: EventRates::default(),
            validity: Validity::new(wrt.len()),
            lost_at: None,
            lost: vec![false; wrt.len()],
            uncertain: false,
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
        let (Layout { n, m, .. }, now) = (self.columns.layout, machine.state().now());
        let size = n + m;
        self.set_extent(machine, model)?;
        // what opens at the start does so whatever the parameters are
        let is_t0 = |it: &MechanicalWrt| f64::from(u8::from(matches!(it, MechanicalWrt::T0)));
        let opened: Vec<f64> = self.columns.wrt.iter().map(is_t0).collect();
        self.note_events(machine, 0, |_| None, |_| Some(opened.clone()), &[]);
        self.columns.visit(model, now, machine.state().closed())?;
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
        if machine.state().closed().is_empty() {
            return Ok(());
        }
        self.columns.project(machine.state().closed(), now)
    }

    /// How far the state moves in a second, or in a run that is shorter.
    fn set_extent<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (n, State { t, x, xdot: v, .. }) = (self.columns.layout.n, machine.state().now());
        let kinetics = &mut self.columns.local.kinetics;
        kinetics.evaluate(model, *t, &x[..n], &v[..n])?;
        kinetics.determined_contact(machine.state().closed())?;
        let (duration, a) = ((self.end - t).min(1.0), &kinetics.acceleration);
        let of_w: Vec<f64> = (0..n).map(|c| v[c].abs() + duration * a[c].abs()).collect();
        let of_q: Vec<f64> = (0..n).map(|c| x[c].abs() + duration * of_w[c]).collect();
        model.dynamics.set_extent(&of_q, &of_w);
        Ok(())
    }

    pub(super) fn note_height(&mut self, machine: &MechanicalIntegrator) {
        let n = self.columns.layout.n;
        self.highest =
            machine.state().now().x[n..].iter().fold(self.highest, |a, b| a.max(b.abs()));
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

    /// Rows for what happened since the machine had so many occurrences.
    pub(super) fn note_events(
        &mut self,
        machine: &MechanicalIntegrator,
        from: usize,
        impact: impl Fn(usize) -> Option<(Vec<f64>, Vec<f64>)>,
        lift_off: impl Fn(usize) -> Option<Vec<f64>>,
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
                    let dt = lift_off(gap).unwrap_or(unknown.clone());
                    self.note_end(t, &dt);
                    self.events.liftoff_times.extend(dt);
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

    /// A piece of the motion without columns.
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
        self.columns.visit(model, machine.state().now(), machine.state().closed())?;
        self.columns.project(machine.state().closed(), machine.state().now())
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
            Next::LocatedEvent(_) => self.strike(machine, t_end, model),
            Next::Release { .. } => self.release(machine, t_end, model),
            Next::Jump(ahead) if ahead.landing.t <= t_end => self.jump(machine, t_end, model),
            _ if machine.state().through() != GapSet::EMPTY => self.strike(machine, t_end, model),
            _ if is_linear => self.fly_exactly(machine, t_end, model),
            _ => self.fly_within(machine, t_end, model),
        }
    }
}
