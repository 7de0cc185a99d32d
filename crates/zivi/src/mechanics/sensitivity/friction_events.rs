//! Derivatives through the events of dry friction: slip ends in stick or turns, stick ends, a contact with
//! friction opens, and impacts.
//!
//! ```text
//! slip ends      dt = -dw/w'-            stick, contact end      dt = -dl/l'      l the level that vanishes
//! dq+ = dq       dq'+ = dq' + (q''- - q''+) dt       in the rows of the mode that follows
//! ```

use super::columns::{hold_rows, Direction, Local};
use super::friction::RoughImpact;
use super::variational_run::{Change, StruckColumns, VariationalRun};
use crate::mechanics::integrator::MechanicalIntegrator;
use crate::mechanics::kinetics::Model;
use crate::mechanics::mode::{Limit, Next};
use crate::mechanics::path::Piece;
use crate::numeric::dense::largest;
use crate::record::events::{FlagKind, Occurrence};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::system::dynamics::Layout;
use crate::system::partials::DifferentiableDynamics;

/// Accelerations that differ by less, relative to the largest, are the same.
const SAME: f64 = 1e-9;
/// Derivatives of times that differ by less, relatively, are the same.
const TOGETHER: f64 = 1e-6;
/// A slip that ends with a smaller deceleration, relative to its terms, touches zero.
const TOUCHES: f64 = 1e-7;

/// How forces by row and static limits by channel change in one direction.
struct Margins {
    forces: Vec<f64>,
    limits: Vec<f64>,
}

/// A mode that ends, and how it moves.
struct EndingMode {
    mode: ContactMode,
    /// Accelerations and forces in it.
    slope: Vec<f64>,
    forces: Vec<f64>,
    /// The sum of levels that vanishes where the motion does not determine the forces.
    margin: Option<Vec<(Limit, f64)>>,
    /// Along the motion, and by each column.
    onwards: Margins,
    columns: Vec<Margins>,
    /// The derivatives of the slips by each column.
    slips: Vec<Vec<f64>>,
}

impl EndingMode {
    /// The derivative of a level that vanishes.
    fn level(&self, limit: Limit, of: &Margins, run: &VariationalRun<'_>) -> f64 {
        match limit {
            Limit::Force(gap) | Limit::Law(gap) => of.forces[gap],
            Limit::Stick(channel, sign) => {
                let kinetics = &run.columns.local.kinetics;
                let (held, row) = (kinetics.friction_limits(channel).1, kinetics.row(channel));
                let most = match kinetics.gap_of(channel) {
                    None => of.limits[channel],
                    Some(gap) => of.limits[channel] * self.forces[gap] + held * of.forces[gap],
                };
                most - sign * of.forces[row]
            }
            Limit::Margin | Limit::Regularity => f64::NAN,
        }
    }

    /// The derivatives of the time at which a level vanishes.
    fn release(&self, limit: Limit, run: &VariationalRun<'_>) -> Vec<f64> {
        let own = [(limit, 1.0)];
        let levels = self.margin.as_deref().unwrap_or(&own);
        let sum = |of: &Margins| -> f64 {
            levels.iter().map(|(limit, weight)| weight * self.level(*limit, of, run)).sum()
        };
        let fall = sum(&self.onwards);
        let one = |of: &Margins| match sum(of) {
            0.0 => 0.0,
            rate => -rate / fall,
        };
        self.columns.iter().map(one).collect()
    }

    /// The derivatives of the time at which a slip ends.
    fn stop(&self, channel: usize, row: usize) -> Vec<f64> {
        let one = |slips: &Vec<f64>| match slips[channel] {
            0.0 => 0.0,
            slip => -slip / self.slope[row],
        };
        self.slips.iter().map(one).collect()
    }
}

impl VariationalRun<'_> {
    /// Where friction changes or a contact opens.
    pub(super) fn change_friction<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let (next, from) = (machine.next().clone(), machine.occurrences().len());
        let ending = self.ending(machine, model)?;
        let touches = self.touches(&next, &ending);
        let piece = machine.advance(t_end, model)?;
        machine.state_mut().know(model)?;
        let (first, after) =
            (self.columns.layout.n + self.columns.layout.m, machine.state().mode());
        let time = |run: &Self, change: Change| match change {
            Change::Opening(gap) => ending.release(Limit::Force(gap), run),
            Change::Friction(channel) if ending.mode.stick.has(channel) => {
                ending.release(Limit::Stick(channel, -after.sign(channel)), run)
            }
            Change::Friction(channel) => ending.stop(channel, first + channel),
        };
        let dt = match &next {
            Next::Stop(channels) => channels.iter().next().map(Change::Friction),
            Next::Release { limit: Limit::Force(gap) | Limit::Law(gap), .. } => {
                Some(Change::Opening(*gap))
            }
            Next::Release { limit: Limit::Stick(channel, _), .. } => {
                Some(Change::Friction(*channel))
            }
            _ => None,
        };
        let times: Vec<Vec<f64>> = {
            let margin = matches!(next, Next::Release { limit: Limit::Margin, .. });
            let first = margin.then(|| ending.release(Limit::Margin, self));
            let all = dt.into_iter().chain(changed(ending.mode, after, &next));
            first.into_iter().chain(all.map(|change| time(self, change))).collect()
        };
        let changed_times = self.known_times(machine, from, |run, change| time(run, change));
        self.note_events(machine, from, |_| None, changed_times, &[]);
        self.shift_columns(&ending, &times, machine);
        let border = |it: &Occurrence| {
            matches!(
                it,
                Occurrence::Flag { kind: FlagKind::SlipGraze | FlagKind::Simultaneous, .. }
            )
        };
        if touches || machine.occurrences()[from..].iter().any(border) {
            self.lose_all(machine.state().now().t);
        }
        self.blank();
        self.columns.visit(model, machine.state().now(), after)?;
        self.columns.project(after, machine.state().now())?;
        self.hold(machine, model)?;
        Ok(piece)
    }

    /// The derivatives of the times of the changes after a number of occurrences, as a function of them.
    fn known_times<'r>(
        &self,
        machine: &MechanicalIntegrator,
        from: usize,
        time: impl Fn(&Self, Change) -> Vec<f64>,
    ) -> impl Fn(Change) -> Option<Vec<f64>> + 'r {
        let of = |it: &Occurrence| match *it {
            Occurrence::LiftOff { gap, .. } => Some(Change::Opening(gap)),
            Occurrence::Transition { channel, .. } => Some(Change::Friction(channel)),
            _ => None,
        };
        let all: Vec<(Change, Vec<f64>)> = (machine.occurrences()[from..].iter())
            .filter_map(of)
            .map(|change| (change, time(self, change)))
            .collect();
        move |change| all.iter().find(|it| it.0 == change).map(|it| it.1.clone())
    }

    /// The mode that ends here, with the derivatives of its forces.
    fn ending<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<EndingMode, Failure<E>> {
        let (Layout { n, m, p, .. }, size) = (self.columns.layout, self.columns.size());
        let (mode, now) = (machine.state().mode(), machine.state().now());
        self.columns.visit(model, now, mode)?;
        let local = &mut self.columns.local;
        let margin = local.kinetics.margin_levels(mode);
        let (slope, forces) = (local.kinetics.acceleration.clone(), local.kinetics.lambda.clone());
        let along = |local: &mut Local, direction: Direction<'_>| -> Result<Margins, Failure<E>> {
            let row = local.along(direction);
            let (_, forces) = local.acceleration(mode, &row)?;
            Ok(Margins { forces, limits: row[local.layout.static_limit()].to_vec() })
        };
        let (w, a) = (&now.xdot[..n], &slope[..n]);
        let onwards = along(local, Direction { t: 1.0, q: w, w: a, parameter: None })?;
        let (mut columns, mut slips) = (Vec::new(), Vec::new());
        for (column, parameter) in self.columns.parameter.iter().enumerate() {
            let end = &self.columns.now;
            let (q, v) = (&end.x[column * size..][..n], &end.xdot[column * size..][..size]);
            columns.push(along(local, Direction { t: 0.0, q, w: &v[..n], parameter: *parameter })?);
            let row = local.along(Direction { t: 0.0, q, w: &v[..n], parameter: *parameter });
            let rates = local.gaps(&row, w, &v[..n]);
            slips.push(rates[m..m + p].iter().map(|it| it[1]).collect());
        }
        Ok(EndingMode { mode, slope, forces, margin, onwards, columns, slips })
    }

    /// Whether a slip that ends only touches zero: it might as well go on.
    fn touches(&mut self, next: &Next, ending: &EndingMode) -> bool {
        let Next::Stop(channels) = next else { return false };
        let n = self.columns.layout.n;
        let kinetics = &mut self.columns.local.kinetics;
        channels.iter().any(|channel| {
            let row = kinetics.row(channel);
            ending.slope[n + row].abs() <= TOUCHES * kinetics.acceleration_scale(row)
        })
    }

    /// The columns after a change at times that move so, the first of which is that of the change.
    fn shift_columns(
        &mut self,
        ending: &EndingMode,
        times: &[Vec<f64>],
        machine: &MechanicalIntegrator,
    ) {
        let (Layout { n, m, .. }, size) = (self.columns.layout, self.columns.size());
        let (t, mode, after) =
            (machine.state().now().t, machine.state().mode(), machine.state().slope());
        let jump: Vec<f64> =
            (0..n + self.columns.layout.rows()).map(|c| ending.slope[c] - after[c]).collect();
        let scale = largest(&ending.slope[..n]).max(largest(&after[..n]));
        if largest(&jump[..n]) <= SAME * scale {
            // whenever it changes, the motion goes on as it was
            return;
        }
        for column in 0..self.count() {
            let Some(dt) = times.first().map(|dt| dt[column]) else {
                self.lose(column, t);
                continue;
            };
            let differs = |other: &Vec<f64>| {
                (other[column] - dt).abs() > TOGETHER * (other[column].abs() + dt.abs())
            };
            if !dt.is_finite() || times.iter().any(differs) {
                self.lose(column, t);
            }
            let end = &mut self.columns.now;
            let (x, v) =
                (&mut end.x[column * size..][..size], &mut end.xdot[column * size..][..size]);
            v.iter_mut().zip(&jump).for_each(|(v, jump)| *v += jump * dt);
            // a slip that turns leaves zero where it came to it
            for channel in ending.mode.slipping().iter().filter(|&c| turns(ending.mode, mode, c)) {
                v[n + m + channel] = -after[n + m + channel] * dt;
            }
            hold_rows(mode, self.columns.layout, (x, v));
        }
    }
}

/// Whether the slip in a channel has another sign.
fn turns(before: ContactMode, after: ContactMode, channel: usize) -> bool {
    before.sign(channel) * after.sign(channel) < 0.0
}

/// The channels that do something else after a change, and the gaps that open.
fn changed(before: ContactMode, after: ContactMode, next: &Next) -> Vec<Change> {
    let stops = match next {
        Next::Stop(channels) => *channels,
        _ => GapSet::EMPTY,
    };
    let differs =
        |&c: &usize| stops.has(c) || after.number(c) != 2 && before.number(c) != after.number(c);
    let channels = before.slipping().with(before.stick);
    channels.iter().filter(differs).map(Change::Friction).collect()
}

// Impacts with dry friction: the pattern that was found, and how its linear system moves with the data.

/// A pattern with so little to spare, relative to its terms, is at its border.
const BORDER: f64 = 1e-7;

impl Local {
    /// The impulses by row that stop the rows of a mode with these rates, which is prepared as a pattern.
    pub(super) fn stopping_impulses<E>(
        &mut self,
        mode: ContactMode,
        rates: &[f64],
    ) -> Result<Vec<f64>, Failure<E>> {
        let edges = self.kinetics.edges(mode)?;
        let solved = edges.solve(|row| -rates[row]);
        let mut impulses = vec![0.0; self.layout.rows()];
        edges.rows().iter().zip(&solved).for_each(|(&row, impulse)| impulses[row] = *impulse);
        for channel in mode.slipping().iter() {
            if let Some(gap) = self.kinetics.gap_of(channel) {
                let pull = -self.kinetics.friction_limits(channel).0 * mode.sign(channel);
                impulses[self.kinetics.row(channel)] = pull * impulses[gap];
            }
        }
        self.edges = Some(edges);
        Ok(impulses)
    }
}

impl Local {
    /// Velocities without slips in some channels.
    fn without_slips<E>(&mut self, channels: GapSet, w: &[f64]) -> Result<Vec<f64>, Failure<E>> {
        let rows = channels.iter().map(|channel| self.kinetics.row(channel)).collect();
        let rows = self.kinetics.independent(rows);
        let mut without = w.to_vec();
        self.kinetics.solve_regular(rows, |at, row| -at.rate(row, w))?;
        self.kinetics.apply(rows, &mut without);
        Ok(without)
    }

    /// The derivatives of the limits of friction along a direction in which some channels stay without slip.
    fn limits_at_rest<E>(
        &mut self,
        channels: GapSet,
        (t, q, parameter): (f64, &[f64], Option<usize>),
        w: &[f64],
    ) -> Result<Vec<f64>, Failure<E>> {
        let mut v = vec![0.0; self.layout.n];
        let row = self.along(Direction { t, q, w: &v, parameter });
        let rates = self.gaps(&row, w, &v);
        let rows = channels.iter().map(|channel| self.kinetics.row(channel)).collect();
        let rows = self.kinetics.independent(rows);
        self.kinetics.solve_regular(rows, |_, row| -rates[row][1])?;
        self.kinetics.apply(rows, &mut v);
        let row = self.along(Direction { t, q, w: &v, parameter });
        Ok(row[self.layout.limit()].to_vec())
    }
}

impl VariationalRun<'_> {
    /// Friction in an impact, if any.
    pub(super) fn rough_impact(
        &self,
        occurrences: &[Occurrence],
        set: GapSet,
    ) -> Option<RoughImpact> {
        let Layout { m, p, .. } = self.columns.layout;
        let kinetics = &self.columns.local.kinetics;
        let mut pattern = ContactMode::from(set);
        let (mut impulses, mut slips) = (vec![0.0; m + p], vec![[0.0; 2]; p]);
        for it in occurrences {
            match *it {
                Occurrence::Impact { gap, impulse, .. } => impulses[gap] = impulse,
                Occurrence::Tangential { channel, before, after, impulse, sticks, .. }
                    if kinetics.gap_of(channel).is_some_and(|gap| set.has(gap)) =>
                {
                    let slip = after + self.e_t[channel] * before;
                    pattern = pattern.with_channel(channel, if sticks { 0.0 } else { slip });
                    (impulses[m + channel], slips[channel]) = (impulse, [before, slip]);
                }
                _ => (),
            }
        }
        (!pattern.is_frictionless()).then_some(RoughImpact { pattern, impulses, slips })
    }

    /// Makes the pattern of an impact ready for the columns, where the system was evaluated before it: the
    /// derivatives of the coefficients of friction without slip, by column, where they differ from those in slip.
    pub(super) fn prepare_impact<E, D: DifferentiableDynamics<E>>(
        &mut self,
        rough: &RoughImpact,
        (struck, c): (&StruckColumns, usize),
        machine: &MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<Vec<Vec<f64>>, Failure<E>> {
        let (n, size) = (self.columns.layout.n, self.columns.size());
        let (channels, before) =
            (rough.pattern.slipping().with(rough.pattern.stick), &struck.before);
        let local = &mut self.columns.local;
        let limits = |local: &Local| -> Vec<f64> {
            channels.iter().map(|channel| local.kinetics.friction_limits(channel).0).collect()
        };
        let slides = limits(local);
        let mut all = Vec::new();
        if channels.iter().any(|channel| {
            let (slip, stick) = local.kinetics.friction_limits(channel);
            slip != stick
        }) {
            let (q, w) = (&before.x[..n], local.without_slips(channels, &before.xdot[..n])?);
            local.visit(model, before.t, q, &w)?;
            let rests = limits(local);
            if rests != slides {
                // of slips of either sign
                let mode = channels.iter().fold(rough.pattern, |mode, c| mode.with_channel(c, 1.0));
                local.differentiate_limits(model, (before.t, q, &w), mode)?;
                for (column, parameter) in self.columns.parameter.iter().enumerate() {
                    let x = &self.columns.now.x[column * size..][..size];
                    let t = -x[c] / before.xdot[c];
                    let q: Vec<f64> = (0..n).map(|k| x[k] + t * before.xdot[k]).collect();
                    all.push(local.limits_at_rest(channels, (t, &q, *parameter), &w)?);
                }
            }
            local.visit(model, before.t, &before.x[..n], &before.xdot[..n])?;
            let at_rest = channels.iter().zip(rests);
            at_rest.for_each(|(channel, limit)| local.kinetics.set_friction_limit(channel, limit));
        }
        if self.is_at_border(rough) {
            self.lose_all(machine.state().now().t);
        }
        self.columns.visited = None;
        self.columns.local.prepare_pattern(rough.pattern)?;
        Ok(all)
    }

    /// Whether a contact that sticks in an impact might slip, or the other way round.
    fn is_at_border(&self, RoughImpact { pattern, impulses, slips }: &RoughImpact) -> bool {
        let kinetics = &self.columns.local.kinetics;
        let m = self.columns.layout.m;
        let holds = |channel: usize| {
            let Some(gap) = kinetics.gap_of(channel) else { return true };
            let most = kinetics.friction_limits(channel).0 * impulses[gap];
            most - impulses[m + channel].abs() > BORDER * most
        };
        let slides = |channel: usize| {
            let [before, after] = slips[channel];
            after.abs() > BORDER * (before.abs() + after.abs())
        };
        !(pattern.stick.iter().all(holds) && pattern.slipping().iter().all(slides))
    }
}
