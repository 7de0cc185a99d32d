//! Where contact begins and ends: Zeno points, corners, lift-offs.
//!
//! ```text
//! Zeno point   dz = D z_inf - F dt_inf, in the manifold of the contacts
//! lift-off     dt = -dlambda/lambda' along the motion in contact; the columns go on
//! ```

use super::local::Direction;
use super::variational_run::VariationalRun;
use crate::mechanics::integrator::MechanicalIntegrator;
use crate::mechanics::kinetics::Model;
use crate::mechanics::mode::Next;
use crate::mechanics::piece::Piece;
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::record::occurrence::{FlagKind, Occurrence};
use crate::switched::sensitivity::Limit;
use crate::system::dynamics::Layout;
use crate::system::partials::DifferentiableDynamics;

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
            for c in 0..size {
                let entry = column * size + c;
                end.x[entry] = dz[c] - zeno.t * machine.state().now().xdot[c];
                end.xdot[entry] = dz[size + c] - zeno.t * machine.state().slope()[c];
            }
        }
        self.columns.visit(model, machine.state().now(), machine.state().closed())?;
        if let Some(gap) = key.hit.iter().next() {
            self.note_pull(n + gap, machine)?;
        }
        self.columns.project(machine.state().closed(), machine.state().now())?;
        self.hold(machine, model)?;
        self.zeno.clear();
        Ok(piece)
    }

    /// At a Zeno point the pull on the gap has to stay a pull.
    fn note_pull<E>(&mut self, c: usize, machine: &MechanicalIntegrator) -> Result<(), Failure<E>> {
        let n = self.columns.layout.n;
        let key_closed = machine.state().closed().without(GapSet::of(c - n));
        let local = &mut self.columns.local;
        local.kinetics.determined_contact(key_closed)?;
        let pull = -local.kinetics.acceleration[c];
        let mut rates = Vec::with_capacity(self.zeno.len());
        for (column, zeno) in self.zeno.iter().enumerate() {
            let dz = zeno.state();
            let size = dz.len() / 2;
            let (q, w) = (&dz[..n], &dz[size..][..n]);
            let parameter = self.columns.parameter[column];
            let row = local.along(Direction { t: zeno.t, q, w, parameter });
            rates.push(local.acceleration(key_closed, &row)?.0[c]);
        }
        local.kinetics.determined_contact(machine.state().closed())?;
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
        let (closed, now, from) =
            (machine.state().closed(), machine.state().now().clone(), machine.occurrences().len());
        self.columns.visit(model, &now, closed)?;
        let local = &mut self.columns.local;
        let a = local.kinetics.acceleration[..n].to_vec();
        let onwards = Direction { t: 1.0, q: &now.xdot[..n], w: &a, parameter: None };
        let row = local.along(onwards);
        let (_, fall) = local.acceleration(closed, &row)?;
        let mut rates = Vec::with_capacity(self.sizes.len());
        for (column, parameter) in self.columns.parameter.iter().enumerate() {
            let end = &self.columns.now;
            let (q, w) = (&end.x[column * size..][..n], &end.xdot[column * size..][..n]);
            let row = local.along(Direction { t: 0.0, q, w, parameter: *parameter });
            rates.push(local.acceleration(closed, &row)?.1);
        }
        let piece = machine.advance(t_end, model)?;
        let dt = |gap: usize| {
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
