//! Impacts: the saltation of the columns.
//!
//! ```text
//! dt = -dY/Y'-        D z- = dz- + z'- dt        M D w+ - N_S^T DP = ..., N_S D w+ + ... = D g'+
//! D g'+_i = -A_i' D g'-_i + dA_i                 dz+ = D z+ - z'+ dt
//! ```
//!
//! with `A_i(-g'-_i)` the speed after an impact by the law of the gap, by Newton's `-e_i g'-_i`, and
//! `S` the gaps that have an impulse: the solution of the complementarity problem is differentiable
//! where it is strict, every other closed gap opens at a speed or is orthogonal.

use super::local::{Direction, Exchange};
use super::variational_run::VariationalRun;
use crate::mechanics::equation::State;
use crate::mechanics::integrator::MechanicalIntegrator;
use crate::mechanics::kinetics::Model;
use crate::mechanics::mode::Next;
use crate::mechanics::piece::Piece;
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::record::occurrence::Occurrence;
use crate::switched::sensitivity::Limit;
use crate::system::dynamics::Layout;
use crate::system::partials::DifferentiableDynamics;
use crate::zeno::rates::Rate;

/// A rate of a closed gap that an orthogonal impact should leave, relative to the others.
const KINK: f64 = 1e-7;

/// What an impact did.
struct Struck {
    before: State,
    /// Accelerations before it.
    slope: Vec<f64>,
    closed: GapSet,
    /// The gaps that were hit, and those with an impulse.
    hit: GapSet,
    set: GapSet,
    impulses: Vec<f64>,
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
        let (before, closed, from) =
            (machine.state().now().clone(), machine.state().closed(), machine.occurrences().len());
        self.columns.visit(model, &before, closed)?;
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
        let struck = Struck { before, slope, closed, hit, set, impulses };
        let shifted = self.through(&struck, machine)?;
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
        self.weigh(&struck, &shifted, machine, model)?;
        Ok(piece)
    }

    /// The derivatives along the impact of the state after it; the columns are lost where there are
    /// none.
    fn through<E>(
        &mut self,
        struck: &Struck,
        machine: &MechanicalIntegrator,
    ) -> Result<Vec<Shifted>, Failure<E>> {
        let (Layout { n, m, .. }, size) = (self.columns.layout, self.columns.size());
        let (t, Struck { before, slope, closed, hit, set, impulses }) =
            (machine.state().now().t, struck);
        let mut hits = hit.iter();
        let (Some(gap), None) = (hits.next(), hits.next()) else {
            self.lose_all(t);
            return Ok(Vec::new());
        };
        let c = n + gap;
        self.note_depth(struck, c);
        let mut all = Vec::with_capacity(self.count());
        let (rtol, atol) = (machine.settings().rtol, machine.settings().atol);
        for column in 0..self.count() {
            let end = &self.columns.now;
            let (x, v) = (&end.x[column * size..][..size], &end.xdot[column * size..][..size]);
            let dt = -x[c] / before.xdot[c];
            let mut x: Vec<f64> = x.iter().zip(&before.xdot).map(|(x, v)| x + dt * v).collect();
            let mut v: Vec<f64> = v.iter().zip(slope).map(|(v, a)| v + dt * a).collect();
            x[c] = 0.0;
            let largest = |of: &[f64]| of.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
            let tolerance = atol[1] + rtol * largest(&before.xdot);
            let noise = KINK * (largest(&x) + largest(&v)) + 100.0 * tolerance / self.sizes[column];
            let (w, rates) = v.split_at_mut(n);
            let parameter = self.columns.parameter[column];
            let local = &mut self.columns.local;
            let row = local.along(Direction { t: dt, q: &x[..n], w, parameter });
            let wrt = self.columns.wrt[column];
            let after = &machine.state().now().xdot;
            let stays = |i: usize| i == gap && machine.state().closed().has(i);
            let target = |i: usize| match i {
                i if stays(i) || i != gap => 0.0,
                _ => {
                    let (law, v) = (machine.law(i), -before.xdot[n + i]);
                    -law.slope(v) * rates[i] + wrt.of_law(i, |parameter| law.by(parameter, v))
                }
            };
            let wanted: Vec<f64> = (0..m).map(target).collect();
            let how =
                Exchange { set: *set, impulses, before: &before.xdot[..n], after: &after[..n] };
            local.exchange(&how, &row, |i| wanted[i], w, rates)?;
            let kink = |i: usize| rates[i].abs() > noise && after[n + i] == 0.0;
            if closed.without(*set).iter().any(kink) {
                self.lose(column, t);
            }
            all.push(Shifted { dt, x, v });
        }
        Ok(all)
    }

    /// An impact that is pulled off may vanish: `v^2/(2 a)` is how much higher its lowest point may
    /// be.
    fn note_depth(&mut self, struck: &Struck, c: usize) {
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
        struck: &Struck,
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
        kinetics.determined_contact(struck.closed)?;
        self.columns.visited = None;
        let pull = -kinetics.acceleration[n + gap];
        if pull > 0.0 {
            for (column, dt) in dt.iter_mut().enumerate() {
                let (law, v) = (machine.law(gap), -struck.before.xdot[n + gap]);
                let du = self.columns.wrt[column].of_law(gap, |parameter| law.by(parameter, v));
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
            for c in 0..size {
                end.x[column * size + c] = it.x[c] - it.dt * machine.state().now().xdot[c];
                end.xdot[column * size + c] = it.v[c] - it.dt * machine.state().slope()[c];
            }
            close(column * size + self.columns.layout.n, machine.state().closed(), end);
        }
        self.blank();
    }

    /// The part of the impact in its chain, and whether the derivatives of a Zeno point are known as
    /// well as the point.
    fn weigh<E, D: DifferentiableDynamics<E>>(
        &mut self,
        struck: &Struck,
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
        let mut known = true;
        self.zeno.clear();
        for (column, chain) in self.chains.iter().enumerate() {
            let size = self.sizes[column];
            let law = machine.law(gap);
            let de = self.columns.wrt[column].of_law(gap, |parameter| law.limit_by(parameter));
            let scale = |c: usize, rate: f64| scales[c] / size + rtol * rate.abs();
            match chain.landing(machine.chain(), de, scale) {
                Some(zeno) => {
                    known &= self.lost[column] || zeno.size <= 1.0;
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

    /// Notes the last impact of a chain.
    fn note_chain<E, D: DifferentiableDynamics<E>>(
        &mut self,
        shifted: &[Shifted],
        machine: &mut MechanicalIntegrator,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (Layout { n, m, .. }, size, key) =
            (self.columns.layout, self.columns.size(), machine.chain().key());
        let (set, now) = (key.landed.closed, machine.state().now().clone());
        let Some(gap) = key.hit.iter().next() else { return Ok(()) };
        let z = machine.state_mut().without_speeds(set)?;
        let w = &z[size..][..n];
        // the state without the bounce, and how it moves along the event
        let local = &mut self.columns.local;
        local.visit(model, now.t, &now.x[..n], &now.xdot[..n])?;
        local.kinetics.solve_regular(set, |_, i| -now.xdot[n + i])?;
        let impulses = local.kinetics.solved()[..set.len()].to_vec();
        let how = Exchange { set, impulses: &impulses, before: &now.xdot[..n], after: w };
        let mut moved = Vec::with_capacity(shifted.len());
        for (column, it) in shifted.iter().enumerate() {
            let parameter = self.columns.parameter[column];
            let row = local.along(Direction { t: it.dt, q: &it.x[..n], w: &it.v[..n], parameter });
            let mut v = it.v.clone();
            let (of_w, rates) = v.split_at_mut(n);
            local.exchange(&how, &row, |_| 0.0, of_w, rates)?;
            let mut x = it.x.clone();
            set.iter().for_each(|i| x[n + i] = 0.0);
            moved.push([x, v].concat());
        }
        // the pull on the gap, and the motion in contact
        local.visit(model, now.t, &now.x[..n], w)?;
        let mut pulls = Vec::with_capacity(shifted.len());
        local.kinetics.determined_contact(key.flight.closed)?;
        for (column, (it, dz)) in shifted.iter().zip(&moved).enumerate() {
            let (q, w, parameter) = (&dz[..n], &dz[size..][..n], self.columns.parameter[column]);
            let row = local.along(Direction { t: it.dt, q, w, parameter });
            pulls.push(-local.acceleration(key.flight.closed, &row)?.0[n + gap]);
        }
        local.kinetics.determined_contact(set)?;
        let flow = [&z[size..], &local.kinetics.acceleration[..]].concat();
        for (column, (it, dz)) in shifted.iter().zip(&moved).enumerate() {
            let (q, w, parameter) = (&dz[..n], &dz[size..][..n], self.columns.parameter[column]);
            let row = local.along(Direction { t: it.dt, q, w, parameter });
            let (turned, _) = local.acceleration(set, &row)?;
            let by_flow = [&dz[size..], &turned[..]].concat();
            let rate = Rate {
                dt: it.dt,
                du: it.v[n + gap],
                dg: pulls[column],
                de: self.columns.wrt[column].of_law(gap, |by| machine.law(gap).limit_by(by)),
                flow: [&flow, &by_flow],
                dz,
            };
            self.chains[column].note(machine.chain(), &rate);
        }
        debug_assert_eq!(flow.len(), 2 * (n + m));
        self.columns.visited = None;
        Ok(())
    }
}

/// Zeros for the closed gaps of the column whose gaps start at an entry.
fn close(first: usize, closed: GapSet, end: &mut State) {
    for i in closed.iter() {
        (end.x[first + i], end.xdot[first + i]) = (0.0, 0.0);
    }
}
