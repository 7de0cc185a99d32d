//! Derivatives through the events of dry friction: slip ends in stick or turns, stick ends, a contact with
//! friction opens, and impacts.
//!
//! ```text
//! slip ends      dt = -dw/w'-            stick, contact end      dt = -dl/l'      l the level that vanishes
//! dq+ = dq       dq'+ = dq' + (q''- - q''+) dt       in the rows of the mode that follows
//! ```

use crate::kinetics::mode::{Limit, Next};
use crate::kinetics::Model;
use crate::mechanics::integrator::MechanicalIntegrator;
use crate::mechanics::sensitivity::columns::{
    hold_rows, CompliantPartials, Direction, Local, RoughImpact,
};
use crate::mechanics::sensitivity::variational_run::{Change, StruckColumns, VariationalRun};
use crate::motion::linear_flight::{FlightRates, FlownPart};
use crate::motion::path::Piece;
use crate::numeric::bernstein::Polynomial;
use crate::numeric::dense::{axpy, dot, largest};
use crate::numeric::power_series::TERMS;
use crate::record::events::{FlagKind, Occurrence};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::switched::sensitivity;
use crate::system::dynamics::Layout;
use crate::system::force::ContactForce;
use crate::system::partials::{DifferentiableDynamics, WEIGHTS};

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
            // it begins with the force of its gap
            Change::Friction(channel) if !ending.mode.slipping().has(channel) => {
                let unknown = || vec![f64::NAN; run.count()];
                let gap = run.columns.local.kinetics.pressing_gap(channel);
                gap.map_or_else(unknown, |gap| ending.release(Limit::Force(gap), run))
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
            Occurrence::LiftOff { gap, .. } | Occurrence::Contact { gap, .. } => {
                Some(Change::Opening(gap))
            }
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

// Compliant gaps: their forces are part of the force of the system, their events move.
//
// ```text
// lambda' = -l_d g' - l_r g'' + l_k k'        F' += N'^T lambda + N^T lambda'      in contact
// dt      = -dg/g'                            dq'+ = dq' + (q''- - q''+) dt        where a gap crosses zero
// dt      = -dlambda/lambda'                                                       where the law vanishes
// ```

/// Steps of differences of a law that is a function: relative to depth or rate, and to the largest gap or
/// rate so far.
const RELATIVE: f64 = 1e-3;
const LEAST: [f64; 2] = [1e-8, 1e-4];
/// Accelerations that differ by less, relative to the largest, are the same.
const SAME_IN_CONTACT: f64 = 1e-12;

impl Local {
    /// From here on the compliant gaps are those of a mode.
    pub(super) fn carry(&mut self, mode: ContactMode) {
        self.kinetics.carry(mode.pressed);
        if let Some(compliant) = &mut self.compliant {
            compliant.pressed = mode.pressed;
            compliant.deep = mode.pressed.with(mode.unloaded);
        }
    }

    /// Adds the contact forces of compliant gaps to the partial derivatives of an evaluation.
    pub(super) fn differentiate_contacts<E, D: DifferentiableDynamics<E>>(
        &mut self,
        w: &[f64],
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let Some(mut compliant) = self.compliant.take() else { return Ok(()) };
        let found = self.differentiate_forces(&mut compliant, w, model);
        self.add_to_forces(&compliant);
        self.compliant = Some(compliant);
        found?;
        for channel in 0..self.layout.p {
            for row in 0..self.partials.len() / self.layout.len() {
                let at = row * self.layout.len();
                let own = [self.layout.limit(), self.layout.static_limit()]
                    .map(|range| at + range.start + channel);
                let [slip, stick] = own.map(|i| self.partials[i]);
                self.partials[own[0]] = self.compliant_limit(channel, row, slip);
                self.partials[own[1]] = self.product_with_force(channel, row, (stick, true));
            }
        }
        Ok(())
    }

    /// The derivatives of the forces.
    fn differentiate_forces<E, D: DifferentiableDynamics<E>>(
        &mut self,
        compliant: &mut CompliantPartials,
        w: &[f64],
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (Layout { n, m, .. }, length) = (self.layout, self.layout.len());
        let constant = self.partials.len() - compliant.constant.len();
        self.partials[constant..].copy_from_slice(&compliant.constant);
        let rows = self.partials.len() / length;
        compliant.forces.clear();
        compliant.forces.resize(rows * m, 0.0);
        for gap in self.kinetics.compliant().iter() {
            let now = [self.kinetics.gap(gap), self.kinetics.rate(gap, w)];
            (0..2).for_each(|k| compliant.extent[k] = compliant.extent[k].max(now[k].abs()));
        }
        for gap in compliant.deep.iter() {
            let (depth, rate) = (-self.kinetics.gap(gap), -self.kinetics.rate(gap, w));
            let law = self.kinetics.law(gap).unwrap_or(ContactForce::Function);
            let [by_depth, by_rate] = match law.slopes(depth, rate) {
                Some(slopes) => slopes,
                None => differences((gap, compliant.extent), (depth, rate), model)?,
            };
            for row in 0..rows {
                let at = &self.partials[row * length..][..length];
                let own = row.checked_sub(1 + n).filter(|&c| c < n);
                let own = own.map_or(0.0, |c| self.kinetics.normal(gap)[c]);
                let of_rate = dot(self.normal(at, gap), w) + at[self.layout.rate()][gap] + own;
                let mut force = -by_depth * at[self.layout.gap()][gap] - by_rate * of_rate;
                let parameter = row.checked_sub(1 + 2 * n);
                let moved = parameter.map_or(&[][..], |it| &compliant.numbers[it]);
                for &(_, number, by) in moved.iter().filter(|it| it.0 == gap) {
                    force += by * law.by(number, depth, rate);
                }
                compliant.forces[row * m + gap] = force;
            }
        }
        Ok(())
    }

    /// `F' += N'^T lambda + N^T lambda'`.
    fn add_to_forces(&mut self, compliant: &CompliantPartials) {
        let (Layout { n, m, .. }, length) = (self.layout, self.layout.len());
        for gap in compliant.pressed.iter() {
            let (force, normal) =
                (self.kinetics.contact_force(gap), self.kinetics.normal(gap).to_vec());
            for (at, forces) in
                self.partials.chunks_exact_mut(length).zip(compliant.forces.chunks_exact(m))
            {
                let turned = at[self.layout.gradient()][gap * n..][..n].to_vec();
                let to = &mut at[self.layout.force()];
                axpy(to, force, &turned);
                axpy(to, forces[gap], &normal);
            }
        }
    }

    /// The derivative of the limit of a channel in slip by that of its coefficient.
    pub(super) fn compliant_limit(&self, channel: usize, row: usize, of_mu: f64) -> f64 {
        self.product_with_force(channel, row, (of_mu, false))
    }

    /// `mu' lambda + mu lambda'`; of other channels the derivative of the limit itself.
    fn product_with_force(&self, channel: usize, row: usize, (of_mu, sticks): (f64, bool)) -> f64 {
        let Some((gap, (slip, stick))) = self.kinetics.compliant_friction(channel) else {
            return of_mu;
        };
        let force = self.kinetics.contact_force(gap);
        let compliant = self.compliant.as_ref().filter(|it| force > 0.0 && it.pressed.has(gap));
        let mu = if sticks { stick } else { slip };
        compliant.map_or(0.0, |it| of_mu * force + mu * it.forces[row * self.layout.m + gap])
    }

    /// Writes the derivatives of the forces along a direction into those by row.
    pub(super) fn add_contact_forces(&self, row: &[f64], forces: &mut [f64]) {
        let Some(compliant) = &self.compliant else { return };
        let own = &row[self.layout.len()..];
        compliant.deep.iter().for_each(|gap| forces[gap] = own[gap]);
    }
}

/// The derivatives of a law that is a function, by depth and rate.
fn differences<E, D: DifferentiableDynamics<E>>(
    (gap, extent): (usize, [f64; 2]),
    (depth, rate): (f64, f64),
    model: &mut Model<'_, D>,
) -> Result<[f64; 2], Failure<E>> {
    let step = |of: usize, value: f64| {
        (RELATIVE * value.abs()).max(LEAST[of] * extent[of]).max(f64::EPSILON)
    };
    let steps = [step(0, depth), step(1, rate)];
    let mut slopes = [0.0; 2];
    for (of, slope) in slopes.iter_mut().enumerate() {
        for (k, weight) in (1..).map(f64::from).zip(WEIGHTS) {
            let h = k * steps[of];
            let mut at = |h: f64| match of {
                0 => model.contact_force(gap, depth + h, rate),
                _ => model.contact_force(gap, depth, rate + h),
            };
            *slope += weight * (at(h)? - at(-h)?) / steps[of];
        }
    }
    Ok(slopes)
}

impl VariationalRun<'_> {
    /// Whether a gap is compliant.
    pub(super) fn is_compliant(&self, gap: usize) -> bool {
        self.columns.local.kinetics.compliant().has(gap)
    }

    /// Where compliant gaps cross zero.
    pub(super) fn cross<E, D: DifferentiableDynamics<E>>(
        &mut self,
        gaps: GapSet,
        machine: &mut MechanicalIntegrator,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let (n, size, from) =
            (self.columns.layout.n, self.columns.size(), machine.occurrences().len());
        let (before, mode) = (machine.state().now().clone(), machine.state().mode());
        self.columns.visit(model, &before, mode)?;
        let slope = self.columns.local.kinetics.acceleration.clone();
        let time = |gap: usize| -> Vec<f64> {
            let columns = self.columns.now.x.chunks_exact(size);
            columns
                .map(|x| if x[n + gap] == 0.0 { 0.0 } else { -x[n + gap] / before.xdot[n + gap] })
                .collect()
        };
        let times: Vec<(usize, Vec<f64>)> = gaps.iter().map(|gap| (gap, time(gap))).collect();
        let piece = machine.advance(t_end, model)?;
        machine.state_mut().know(model)?;
        let of = |change: Change| {
            let gap = match change {
                Change::Opening(gap) => gap,
                // friction begins and ends with the force of its gap
                Change::Friction(channel) => machine.state().kinetics().pressing_gap(channel)?,
            };
            times.iter().find(|it| it.0 == gap).map(|it| it.1.clone())
        };
        self.note_events(machine, from, |_| None, of, &[]);
        let (now, after) = (machine.state().now().clone(), machine.state().mode());
        if gaps.iter().all(|gap| self.is_compliant(gap)) {
            self.shift_crossings((&slope, mode), &times, machine, model)?;
        } else {
            self.lose_all(now.t);
        }
        self.blank();
        self.columns.visit(model, &now, after)?;
        if !(after.closed.is_empty() && after.stick.is_empty()) {
            self.columns.project(after, &now)?;
        }
        Ok(piece)
    }

    /// The columns after gaps have crossed zero: the force of each changes at its own time.
    fn shift_crossings<E, D: DifferentiableDynamics<E>>(
        &mut self,
        (slope, before): (&[f64], ContactMode),
        times: &[(usize, Vec<f64>)],
        machine: &MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (Layout { n, p, .. }, size) = (self.columns.layout, self.columns.size());
        let (now, after) = (machine.state().now(), machine.state().mode());
        let jump: Vec<f64> =
            slope.iter().zip(machine.state().slope()).map(|(old, new)| old - new).collect();
        if largest(&jump[..n]) <= SAME_IN_CONTACT * largest(&slope[..n]) {
            return Ok(());
        }
        let mut jumps = vec![jump];
        if times.len() > 1 && p == 0 {
            jumps.clear();
            for (gap, _) in times {
                let one = GapSet::of(*gap);
                let mode = ContactMode {
                    pressed: match after.pressed.has(*gap) {
                        true => before.pressed.with(one),
                        false => before.pressed.without(one),
                    },
                    ..before
                };
                let local = &mut self.columns.local;
                local.carry(mode);
                local.kinetics.evaluate(model, now.t, &now.x[..n], &now.xdot[..n])?;
                local.contact(mode)?;
                let changed = slope.iter().zip(&local.kinetics.acceleration);
                jumps.push(changed.map(|(old, new)| old - new).collect());
            }
            self.columns.visited = None;
        }
        for column in 0..self.count() {
            let dt = times[0].1[column];
            let apart = |it: &(usize, Vec<f64>)| {
                (it.1[column] - dt).abs() > TOGETHER * (it.1[column].abs() + dt.abs())
            };
            if jumps.len() < times.len() && times.iter().any(apart) {
                self.lose(column, now.t);
            }
            let end = &mut self.columns.now;
            let (x, v) =
                (&mut end.x[column * size..][..size], &mut end.xdot[column * size..][..size]);
            for (jump, (_, dt)) in jumps.iter().zip(times) {
                (0..n + self.columns.layout.rows()).for_each(|c| v[c] += jump[c] * dt[column]);
            }
            hold_rows(after, self.columns.layout, (x, v));
        }
        Ok(())
    }
}

// The columns along the flights of a linear system: by the same power series, to rounding.

impl VariationalRun<'_> {
    /// A step of a linear system, with the columns.
    pub(super) fn fly_exactly<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        let (from, mode) = (machine.state().now().clone(), machine.state().mode());
        let closed = mode.closed;
        let t = model.smooth.nearest(from.t);
        let piece = machine.advance(t_end, model)?;
        let length = machine.motion().length();
        if machine.motion_mut().linear().is_none() {
            // its contacts are not determined: from here on by steps
            self.columns.advance(machine.motion().last(), mode, model)?;
            self.flew(machine, model)?;
            return Ok(piece);
        }
        self.note_height(machine);
        self.columns.visited = None;
        self.prepare_rates(machine, model);
        let flown = FlownPart { from: &from, t, closed, length };
        if let Next::Step = machine.next() {
            self.exact_minima(flown, machine)?;
        }
        let until = machine.state().now().t;
        while let Some(t) = self.next_time().filter(|&t| t < until) {
            let length = ((t - from.t) - from.late).clamp(0.0, length);
            let (x, v) = self.columns_after(FlownPart { length, ..flown }, machine)?;
            let (n, size) = (self.columns.layout.n, self.columns.size());
            for of in [&x, &v] {
                self.samples.extend(of.chunks_exact(size).flat_map(|column| &column[..n]));
            }
        }
        (self.columns.now.x, self.columns.now.xdot) = self.columns_after(flown, machine)?;
        if !closed.is_empty() {
            self.columns.visit(model, machine.state().now(), mode)?;
            self.columns.project(mode, machine.state().now())?;
        }
        Ok(piece)
    }

    /// How the parameters move the flights.
    fn prepare_rates<E, D: DifferentiableDynamics<E>>(
        &mut self,
        machine: &mut MechanicalIntegrator,
        model: &Model<'_, D>,
    ) {
        if self.exact.is_some() {
            return;
        }
        let (Some(flight), Some(system)) = (machine.motion_mut().linear(), model.dynamics.linear())
        else {
            return;
        };
        let by = self.columns.local.by().iter();
        let rates = by.filter_map(|&parameter| model.dynamics.linear_rate(parameter));
        self.exact = Some(FlightRates::new(flight, system, rates.map(|rate| &**rate)));
    }

    /// The columns, and their rates, after a part of a step that was flown.
    fn columns_after<E>(
        &mut self,
        flown: FlownPart<'_>,
        machine: &mut MechanicalIntegrator,
    ) -> Result<(Vec<f64>, Vec<f64>), Failure<E>> {
        let size = self.columns.size();
        let (mut x, mut v) = (self.columns.now.x.clone(), self.columns.now.xdot.clone());
        if let (Some(flight), Some(rates)) = (machine.motion_mut().linear(), &mut self.exact) {
            let each = x.chunks_exact_mut(size).zip(v.chunks_exact_mut(size));
            for (column, parameter) in each.zip(&self.columns.parameter) {
                flight.differentiate(flown, rates, *parameter, column)?;
            }
        }
        Ok((x, v))
    }

    /// Minima of the gaps within the step.
    fn exact_minima<E>(
        &mut self,
        flown: FlownPart<'_>,
        machine: &mut MechanicalIntegrator,
    ) -> Result<(), Failure<E>> {
        let (Layout { n, m, .. }, size) = (self.columns.layout, self.columns.size());
        for gap in (0..m).filter(|&gap| !flown.closed.has(gap)) {
            let (before, after) = (flown.from.xdot[n + gap], machine.state().now().xdot[n + gap]);
            let falls_and_rises = before < 0.0 && after > 0.0;
            let Some(flight) = machine.motion_mut().linear().filter(|_| falls_and_rises) else {
                continue;
            };
            let (mut series, mut power) = (*flight.series(gap), 1.0);
            for a in &mut series {
                *a *= power;
                power *= flown.length / flight.step();
            }
            let p = Polynomial::<TERMS>::from_powers(series);
            let Some(theta) = p.derivative().negated().first_negative() else { continue };
            let length = theta * flown.length;
            let (x, _) = self.columns_after(FlownPart { length, ..flown }, machine)?;
            let rates: Vec<f64> = x.chunks_exact(size).map(|column| column[n + gap]).collect();
            self.validity.note(
                sensitivity::Limit::Minimum,
                flown.from.t + length,
                p.at(theta),
                rates,
            );
        }
        Ok(())
    }
}
