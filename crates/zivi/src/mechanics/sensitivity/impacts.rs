//! Impacts with dry friction: the pattern that was found, and how its linear system moves with the data.

use super::columns::{Direction, Local};
use super::friction::RoughImpact;
use super::variational_run::{StruckColumns, VariationalRun};
use crate::mechanics::integrator::MechanicalIntegrator;
use crate::mechanics::kinetics::Model;
use crate::record::events::Occurrence;
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::system::dynamics::Layout;
use crate::system::partials::DifferentiableDynamics;

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
