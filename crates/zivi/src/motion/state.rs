//! A mechanical system at a time: state, contacts, and accelerations.

use crate::friction::decide;
use crate::kinetics::lcp::settle;
use crate::kinetics::mode::{AtEnd, Contacts, InContact, Stages, State};
use crate::kinetics::{without_rounding, Kinetics, Model};
use crate::numeric::dense::{dot, largest};
use crate::record::events::Occurrence;
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::system::dynamics::{Dynamics, Layout};
use crate::system::force::Friction;

/// The state of a mechanical system.
#[derive(Clone, Debug)]
pub(crate) struct MechanicalState {
    layout: Layout,
    now: State,
    contacts: Contacts,
    /// Accelerations and contact forces here, if known.
    slope: Vec<f64>,
    lambda: Vec<f64>,
    levels: Vec<f64>,
    undetermined: Option<f64>,
    is_known: bool,
    /// Whether the gaps are as an impact left them: they stay so.
    is_struck: bool,
    /// The kinetics of the last evaluation, here or at a stage of a step from here.
    kinetics: Kinetics,
}

/// Result of the start of a run.
pub(crate) enum Start {
    /// The gaps that are hit, maybe none.
    At(GapSet),
    /// A gap is not open: its value. NaN where the state does not obey the equality rows.
    Overlap(f64),
}

/// A gap of this part of the unit of length is closed at the start.
const NEAR: f64 = 1e-15;
/// Newton iterations of a projection.
const PROJECTIONS: usize = 4;
/// A gap is as its function says while that is larger than this part of its terms.
const ANCHOR: f64 = 1e-5;
/// The least ratio of `v^2/|g''|`, twice the height of a bounce, to the rounding of its gap at which the time of the
/// impact is determined.
const HEIGHTS: f64 = 100.0;

impl MechanicalState {
    pub(crate) fn new(layout: Layout, friction: &Friction) -> Self {
        let size = layout.size();
        Self {
            layout,
            now: State::zeros(size),
            contacts: Contacts::default(),
            slope: vec![0.0; size],
            lambda: vec![0.0; layout.forces()],
            levels: Vec::new(),
            undetermined: None,
            is_known: false,
            is_struck: false,
            kinetics: Kinetics::new(layout, friction),
        }
    }

    /// Starts with gaps open or closed to rounding, relative to the coordinates and velocities or
    /// to their units.
    pub(crate) fn start<E, D: Dynamics<E>>(
        &mut self,
        t: f64,
        (q, w): (&[f64], &[f64]),
        [of_x, of_v]: [f64; 2],
        model: &mut Model<'_, D>,
    ) -> Result<Start, Failure<E>> {
        let Layout { n, m, .. } = self.layout;
        (self.now.t, self.now.late) = (t, 0.0);
        self.now.x[..n].copy_from_slice(q);
        self.now.xdot[..n].copy_from_slice(w);
        self.kinetics.evaluate(model, t, q, w)?;
        let held = match self.layout.k {
            0 => None,
            _ if !self.kinetics.obeys_equalities(q, w) => return Ok(Start::Overlap(f64::NAN)),
            _ => Some(self.start_on_manifold(model)?),
        };
        let (q, w) = held.as_ref().map_or((q, w), |(q, w)| (q, w));
        let (mut touching, mut hit, still) = (GapSet::EMPTY, GapSet::EMPTY, vec![0.0; n]);
        for i in 0..m {
            let (gap, rate) = (self.kinetics.gap(i), self.kinetics.rate(i, w));
            let (of_gap, of_rate) = self.kinetics.rounding(i, q, w);
            // a gap that vanishes by cancellation leaves rounding of its terms, which may be larger
            // than what the coordinates tell
            let of_gap = of_gap.max(NEAR * self.kinetics.steepness(i));
            // walls move with the rounding of the time
            let of_gap = of_gap + 16.0 * f64::EPSILON * (t * self.kinetics.rate(i, &still)).abs();
            // of a state at rest the velocities are all rounding: that of a fall through the terms of the gap
            let of_fall = (16.0 * f64::EPSILON * of_gap * self.kinetics.b(i).abs()).sqrt();
            let is_soft = self.kinetics.compliant().has(i);
            if gap < -8.0 * of_gap && !is_soft {
                return Ok(Start::Overlap(gap));
            }
            let zero = |value: f64, noise: f64| if value.abs() <= noise { 0.0 } else { value };
            let of_rate = (4.0 * of_rate + of_v).max(of_fall);
            let (x, v) = (zero(gap, 8.0 * of_gap + of_x), zero(rate, of_rate));
            (self.now.x[n + i], self.now.xdot[n + i]) = (x, v);
            if is_soft {
                self.press_at_start(i, model)?;
            } else if x == 0.0 && v <= 0.0 {
                let set = if v < 0.0 { &mut hit } else { &mut touching };
                *set = set.with(GapSet::of(i));
            }
        }
        for row in m..self.layout.rows() {
            let (rate, noise) = (self.kinetics.rate(row, w), self.kinetics.rounding(row, q, w).1);
            self.now.xdot[n + row] = if rate.abs() <= 4.0 * noise + of_v { 0.0 } else { rate };
        }
        self.enter(Contacts { mode: touching.into(), ..Contacts::default() });
        if hit.is_empty() && !(touching.is_empty() && self.layout.p == 0) {
            self.project(touching, model)?;
            self.settle(touching)?;
        }
        Ok(Start::At(hit))
    }

    pub(crate) fn layout(&self) -> Layout {
        self.layout
    }

    /// Coordinates and gaps, and their rates.
    pub(crate) fn now(&self) -> &State {
        &self.now
    }

    /// The gaps that are closed.
    pub(crate) fn closed(&self) -> GapSet {
        self.contacts.mode.closed
    }

    /// The same with the modes of friction.
    pub(crate) fn mode(&self) -> ContactMode {
        self.contacts.mode
    }

    /// The gaps that are just opening.
    pub(crate) fn left(&self) -> GapSet {
        self.contacts.left
    }

    /// The rigid gaps that are not closed.
    pub(crate) fn open_gaps(&self) -> impl Iterator<Item = usize> {
        let others = self.closed().with(self.kinetics.compliant());
        (0..self.layout.m).filter(move |&i| !others.has(i))
    }

    /// The compliant gaps.
    pub(crate) fn compliant(&self) -> GapSet {
        self.kinetics.compliant()
    }

    /// The compliant gaps whose law changes its sign here.
    pub(crate) fn turned(&self) -> GapSet {
        self.contacts.turned
    }

    /// Whether a rigid gap is zero, up to heights that a speed takes it to.
    pub(crate) fn is_still(&self, gap: usize, speed: f64) -> bool {
        let (n, (x, v), now) = (self.layout.n, self.gap(gap), &self.now);
        let (rounding, _) = self.kinetics.rounding(gap, &now.x[..n], &now.xdot[..n]);
        let low =
            x.abs() <= rounding || 2.0 * x.abs() * self.kinetics.b(gap).abs() <= speed * speed;
        !self.compliant().has(gap) && v.abs() <= speed && low
    }

    /// Whether a compliant gap is below zero.
    pub(crate) fn is_deep(&self, gap: usize) -> bool {
        self.contacts.mode.is_deep(gap)
    }

    /// A gap and its rate.
    pub(crate) fn gap(&self, i: usize) -> (f64, f64) {
        let c = self.layout.n + i;
        (self.now.x[c], self.now.xdot[c])
    }

    /// Accelerations of coordinates and gaps, if known.
    pub(crate) fn slope(&self) -> &Vec<f64> {
        &self.slope
    }

    /// Contact forces by gap and friction forces by channel, if known.
    pub(crate) fn lambda(&self) -> &[f64] {
        &self.lambda
    }

    /// Limits of the mode, if the forces are known.
    pub(crate) fn levels(&self) -> &[f64] {
        &self.levels
    }

    /// The mechanics where they were evaluated last.
    pub(crate) fn kinetics(&self) -> &Kinetics {
        &self.kinetics
    }

    /// The same, to be solved for impulses or forces, and the state.
    pub(crate) fn parts(&mut self) -> (&mut Kinetics, &mut State) {
        (&mut self.kinetics, &mut self.now)
    }

    /// The state, the accelerations there and the equation for a step from it. Data at its end are
    /// written to `at_end`.
    pub(crate) fn equation<'r, 'm, D>(
        &'r mut self,
        model: &'r mut Model<'m, D>,
        at_end: &'r mut AtEnd,
    ) -> (&'r State, &'r Vec<f64>, InContact<'r, 'm, D>) {
        let Self { now, slope, kinetics, contacts, .. } = self;
        let mode = contacts.mode;
        (now, slope, InContact { mode, kinetics, model, at_end: Some(at_end) })
    }

    /// The gaps of a simultaneous impact, although their approach was not detected.
    pub(crate) fn through(&self) -> GapSet {
        let hit = |&i: &usize| matches!(self.gap(i), (x, v) if x <= 0.0 && v < 0.0);
        let crossed = |&i: &usize| match self.contacts.mode.pressed.has(i) {
            true => matches!(self.gap(i), (x, v) if x >= 0.0 && v > 0.0),
            false => !self.is_deep(i) && hit(&i),
        };
        let soft = self.compliant().iter().filter(crossed);
        self.open_gaps().filter(hit).chain(soft).collect()
    }

    /// Whether a gap is zero but for rounding, where the system has just been evaluated.
    pub(crate) fn touches(&self, i: usize) -> bool {
        self.gap(i).0 <= self.rounding_of_gap(i)
    }

    /// Whether a gap has its speed from a height that is large relative to its rounding: `v^2 > HEIGHTS |g''| rounding`.
    pub(crate) fn falls(&self, i: usize) -> bool {
        let (speed, pull) =
            (self.gap(i).1, self.slope.get(self.layout.n + i).map_or(0.0, |a| a.abs()));
        speed * speed > HEIGHTS * pull * self.rounding_of_gap(i)
    }

    fn rounding_of_gap(&self, i: usize) -> f64 {
        let n = self.layout.n;
        let (q, w) = (&self.now.x[..n], &self.now.xdot[..n]);
        8.0 * self.kinetics.rounding(i, q, w).0
    }

    /// Forgets the forces: from here on they are others.
    pub(crate) fn forget_forces(&mut self) {
        (self.is_known, self.is_struck) = (false, false);
    }

    /// Takes rotations farther than `far` from the middle of their chart into the other one.
    pub(crate) fn change_charts<E, D: Dynamics<E>>(
        &mut self,
        far: f64,
        model: &Model<'_, D>,
    ) -> bool {
        let (n, now) = (self.layout.n, &mut self.now);
        let is_changed = model.dynamics.change_charts(far, &mut now.x[..n], &mut now.xdot[..n]);
        self.is_known &= !is_changed;
        is_changed
    }

    /// Evaluates the system here.
    pub(crate) fn evaluate<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let n = self.layout.n;
        self.kinetics.evaluate(model, self.now.t, &self.now.x[..n], &self.now.xdot[..n])
    }

    /// The same without quantities for forces only; a linear system also omits the values of the
    /// gaps.
    pub(crate) fn evaluate_walls<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let n = self.layout.n;
        self.kinetics.evaluate_walls(model, self.now.t, &self.now.x[..n], &self.now.xdot[..n])
    }

    /// Evaluates the forces, where the system has just been evaluated without them.
    pub(crate) fn complete<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let n = self.layout.n;
        self.kinetics.complete(model, self.now.t, &self.now.x[..n], &self.now.xdot[..n])
    }

    /// Computes accelerations and contact forces of the present state.
    pub(crate) fn know<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        match self.is_known {
            true => Ok(()),
            false => self.evaluate(model).and_then(|()| self.refresh()),
        }
    }

    /// Accelerations and contact forces here.
    pub(crate) fn prepare<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        if !self.is_known {
            self.evaluate(model)?;
            self.refresh()?;
            if !self.is_struck {
                self.anchor_all();
            }
        }
        Ok(())
    }

    /// The same, where the system has just been evaluated.
    pub(crate) fn refresh<E>(&mut self) -> Result<(), Failure<E>> {
        let (mode, n, rows) = (self.contacts.mode, self.layout.n, self.layout.rows());
        self.kinetics.turn(&self.now.xdot[n..]);
        self.kinetics.contact(mode)?;
        self.slope.copy_from_slice(&self.kinetics.acceleration);
        self.levels.clear();
        self.undetermined = None;
        self.lambda.copy_from_slice(self.kinetics.forces());
        if mode.is_frictionless() && self.kinetics.undetermined.is_empty() {
            self.levels.extend(mode.closed.iter().map(|gap| self.lambda[gap]));
        } else {
            self.levels.extend(self.kinetics.limits(mode).iter().map(|it| it.value));
            self.undetermined = self.kinetics.share_least(mode);
            if self.undetermined.is_some() {
                self.lambda.copy_from_slice(self.kinetics.forces());
            }
        }
        if let Some(power) = self.slope.get_mut(n + rows) {
            *power = self.kinetics.friction_power(mode, &self.now.xdot[n..]);
        }
        self.is_known = true;
        Ok(())
    }

    /// Recomputes the integrated gaps from their functions at the last evaluation of the system.
    fn anchor_all(&mut self) {
        for i in 0..self.layout.m {
            let rate = self.kinetics.rate(i, &self.now.xdot[..self.layout.n]);
            self.anchor(i, self.kinetics.gap(i), rate);
        }
        for row in self.layout.m..self.layout.rows() {
            let rate = self.kinetics.rate(row, &self.now.xdot[..self.layout.n]);
            self.anchor_slip(row, rate);
        }
    }

    /// Recomputes an integrated gap from its function, if that has enough digits.
    pub(crate) fn anchor(&mut self, i: usize, gap: f64, rate: f64) {
        self.anchor_beside(self.size(), i, (gap, rate));
    }

    /// The largest coordinate.
    pub(crate) fn size(&self) -> f64 {
        largest(&self.now.x[..self.layout.n])
    }

    /// The same, where the largest coordinate is known.
    #[inline]
    pub(crate) fn anchor_beside(&mut self, size: f64, i: usize, (gap, rate): (f64, f64)) {
        let n = self.layout.n;
        let beside = self.now.x[n + i] > 0.0 || gap < 0.0 && self.is_deep(i);
        let clear = gap.abs() > ANCHOR * (size + gap.abs()) && beside;
        if clear && !self.closed().has(i) {
            (self.now.x[n + i], self.now.xdot[n + i]) = (gap, rate);
        }
    }

    /// Moves the coordinates and velocities, along the directions of the impulses, to where the
    /// gaps of a set are zero and its rows have the rates of the state. The system is evaluated there.
    pub(crate) fn project<E, D: Dynamics<E>>(
        &mut self,
        set: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        self.project_gaps(set, model)?;
        self.complete(model)
    }

    /// The same without what only forces need.
    pub(crate) fn project_gaps<E, D: Dynamics<E>>(
        &mut self,
        set: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        self.is_known = false;
        if let Some(gap) = set.only().filter(|&gap| gap < self.layout.m && self.layout.k == 0) {
            return self.project_alone(gap, model);
        }
        let Self { kinetics, now, layout, .. } = self;
        let Layout { n, m, .. } = *layout;
        let mut set = set;
        for iteration in 0..=PROJECTIONS {
            let (q, gaps) = now.x.split_at_mut(n);
            let (w, speeds) = now.xdot.split_at_mut(n);
            kinetics.evaluate_gaps(model, now.t, q, w)?;
            let is_off = iteration < PROJECTIONS && kinetics.pull_back(q, w);
            let (mut far, mut fast) = (false, false);
            for i in set.iter() {
                let (of_gap, of_rate) = kinetics.rounding(i, q, w);
                if i < m {
                    gaps[i] = 0.0;
                    far |= kinetics.gap(i).abs() > of_gap;
                }
                fast |= (speeds[i] - kinetics.rate(i, w)).abs() > of_rate;
            }
            if !(far || fast || is_off) || iteration == PROJECTIONS {
                break;
            }
            if layout.p > 0 && (fast || far) {
                // sticking feet of one body: what some rows say the others say, too
                set = kinetics.independent(set);
            }
            if fast {
                kinetics.solve(set, |at, i| speeds[i] - at.rate(i, w))?;
                kinetics.apply(set, w);
            }
            if far {
                kinetics.solve(set, |at, i| if i < m { -at.gap(i) } else { 0.0 })?;
                kinetics.apply(set, q);
            }
        }
        Ok(())
    }

    /// The same of a gap alone.
    fn project_alone<E, D: Dynamics<E>>(
        &mut self,
        gap: usize,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let Self { kinetics, now, layout, .. } = self;
        for iteration in 0..=PROJECTIONS {
            let (q, gaps) = now.x.split_at_mut(layout.n);
            let (w, speeds) = now.xdot.split_at_mut(layout.n);
            kinetics.evaluate_gap(model, gap, (now.t, q, w))?;
            let (of_gap, of_rate) = kinetics.rounding(gap, q, w);
            gaps[gap] = 0.0;
            let (distance, missing) = (kinetics.gap(gap), speeds[gap] - kinetics.rate(gap, w));
            let (far, fast) = (distance.abs() > of_gap, missing.abs() > of_rate);
            if !(far || fast) || iteration == PROJECTIONS {
                break;
            }
            if fast {
                kinetics.push(gap, missing, w)?;
            }
            if far {
                kinetics.push(gap, -distance, q)?;
            }
        }
        Ok(())
    }

    /// Of the gaps that touch without a speed some stay closed, and the forces open the others,
    /// where the system has just been evaluated: `0 <= lambda  perp  b + D lambda >= 0`.
    pub(crate) fn settle<E>(&mut self, touching: GapSet) -> Result<(), Failure<E>> {
        let contacts = match self.layout.p {
            0 => settle(&mut self.kinetics, touching)?,
            _ => {
                let slips = self.slips().to_vec();
                decide(&mut self.kinetics, touching, &slips, self.contacts.mode.stick)?
            }
        };
        self.enter(contacts);
        Ok(())
    }

    /// Sets the contacts of rigid gaps and the modes of friction.
    pub(crate) fn enter(&mut self, contacts: Contacts) {
        let ContactMode { pressed, unloaded, .. } = self.contacts.mode;
        self.contacts = contacts;
        (self.contacts.mode.pressed, self.contacts.mode.unloaded) = (pressed, unloaded);
    }

    /// The same after an impact that leaves no contact; the forces are evaluated once they are asked for.
    pub(crate) fn fly_off(&mut self) {
        self.enter(Contacts::default());
        self.is_struck = true;
    }

    /// Whether the last decision was ambiguous; it is told once.
    pub(crate) fn take_ambiguity(&mut self) -> bool {
        std::mem::take(&mut self.contacts.is_ambiguous)
    }

    /// Undetermined part of the contact forces: the range of their variation.
    pub(crate) fn undetermined(&self) -> Option<f64> {
        self.undetermined
    }

    /// Whether the motion here depends on how contacts share their forces.
    pub(crate) fn is_shared_motion(&mut self) -> bool {
        self.kinetics.is_shared_motion || self.kinetics.may_slip_otherwise(self.contacts.mode)
    }

    /// Some of the closed gaps open.
    pub(crate) fn open(&mut self, left: GapSet) {
        let mode = self.closed().without(left).into();
        self.enter(Contacts { mode, left, ..Contacts::default() });
    }

    /// To a time and a state, `x` before `x'`, in which the gaps of a mode are closed, and those
    /// that are closed with them to within `rounding` of gaps and rates: all of these. The system
    /// is evaluated there.
    pub(crate) fn move_to<E, D: Dynamics<E>>(
        &mut self,
        (t, z): (f64, &[f64]),
        ContactMode { closed: set, stick, .. }: ContactMode,
        rounding: [f64; 2],
        model: &mut Model<'_, D>,
    ) -> Result<GapSet, Failure<E>> {
        let (x, xdot) = z.split_at(self.now.x.len());
        (self.now.t, self.now.late) = (t, 0.0);
        self.now.x.copy_from_slice(x);
        self.now.xdot.copy_from_slice(xdot);
        self.stop(set);
        let sticking = self.stop_rows(stick);
        self.project(set.with(sticking), model)?;
        let more = self.closed_along(set, rounding);
        self.stop(more);
        Ok(set.with(more))
    }

    /// The gaps that are closed to rounding with those of a set, where the system has just been
    /// evaluated. If the set determines them they never move, and no impact would tell.
    fn closed_along(&self, set: GapSet, [of_x, of_v]: [f64; 2]) -> GapSet {
        let Layout { n, m, .. } = self.layout;
        let (q, w) = (&self.now.x[..n], &self.now.xdot[..n]);
        let touches = |&i: &usize| {
            let (of_gap, of_rate) = self.kinetics.rounding(i, q, w);
            let (gap, rate) = (self.kinetics.gap(i), self.kinetics.rate(i, w));
            !set.has(i) && gap.abs() <= of_gap + of_x && rate.abs() <= of_rate + of_v
        };
        (0..m).filter(touches).collect()
    }

    /// The gaps of a set are zero, without a speed.
    fn stop(&mut self, set: GapSet) {
        let n = self.layout.n;
        for i in set.iter() {
            (self.now.x[n + i], self.now.xdot[n + i]) = (0.0, 0.0);
        }
    }

    /// To the end of a step, at the time `end` if that is given: back by how far it drifted along the
    /// channels that stick, and onto the manifold of the closed gaps, with the slope for the next step.
    pub(crate) fn take<E, D: Dynamics<E>>(
        &mut self,
        (step, at_end): (&Stages, &AtEnd),
        (end, drift): (Option<f64>, &[f64]),
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        self.now.copy_from(&step.end);
        if let Some(end) = end {
            (self.now.t, self.now.late) = (end, 0.0);
        }
        self.contacts.left = GapSet::EMPTY;
        (self.contacts.released, self.contacts.turned) = (GapSet::EMPTY, GapSet::EMPTY);
        self.stop_slip(self.contacts.spent);
        self.undo_drift(drift, model)?;
        let rows = self.kinetics.rows_of(self.contacts.mode);
        if !rows.is_empty() {
            self.project(rows, model)?;
            self.refresh()?;
            self.anchor_all();
            return Ok(());
        }
        (self.is_known, self.is_struck) = (step.copy_end_slope(&mut self.slope), false);
        if self.layout.k > 0 {
            return self.take_on_manifold(at_end, model);
        }
        self.lambda.fill(0.0);
        self.levels.clear();
        if self.is_known {
            self.lambda.copy_from_slice(&at_end.lambda);
            for i in 0..self.layout.m {
                self.anchor(i, at_end.gap[i], at_end.rate[i]);
            }
            for row in self.layout.m..self.layout.rows() {
                self.anchor_slip(row, at_end.rate[row]);
            }
        }
        Ok(())
    }

    /// Advances the time by the length of a flight (to `t_end` if `arrives`) whose end is the
    /// state.
    pub(crate) fn pass(&mut self, (length, t_end): (f64, f64), arrives: bool) {
        self.now.pass(length);
        if arrives || self.now.t > t_end {
            (self.now.t, self.now.late) = (t_end, 0.0);
        }
        self.contacts.left = GapSet::EMPTY;
        (self.is_known, self.is_struck) = (false, false);
    }

    /// To an event at the time `total` after the start of a step, `delta` after its end; not
    /// past `t_end`.
    pub(crate) fn move_along(&mut self, step: &Stages, (total, delta): (f64, f64), t_end: f64) {
        let end = &step.end;
        self.now.pass(total);
        if self.now.t > t_end {
            (self.now.t, self.now.late) = (t_end, 0.0);
        }
        for c in 0..self.now.x.len() {
            let slope = step.end_slope(c);
            self.now.x[c] = end.x[c] + delta * (end.xdot[c] + 0.5 * delta * slope);
            self.now.xdot[c] = end.xdot[c] + delta * slope;
        }
        self.stop_slip(self.contacts.spent);
        (self.is_known, self.is_struck) = (false, false);
    }

    /// The state without the speeds of the rows of a mode, taken out along the impulses: that from
    /// which its gaps would stay closed. With friction the impulses lie on the edges of its cones.
    pub(crate) fn without_speeds<E>(
        &mut self,
        mode: impl Into<ContactMode>,
    ) -> Result<Vec<f64>, Failure<E>> {
        let mut z = vec![];
        self.without_speeds_to(mode, &mut z)?;
        Ok(z)
    }

    /// The same into memory that is there.
    pub(crate) fn without_speeds_to<E>(
        &mut self,
        mode: impl Into<ContactMode>,
        z: &mut Vec<f64>,
    ) -> Result<(), Failure<E>> {
        let (mode, rows) = (mode.into(), self.layout.rows());
        if !mode.is_frictionless() {
            *z = self.without_speeds_along_edges(mode)?;
            return Ok(());
        }
        let set = mode.closed;
        let Self { kinetics, now, layout: Layout { n, .. }, .. } = self;
        let n = *n;
        z.clear();
        z.extend_from_slice(&now.x);
        z.extend_from_slice(&now.xdot);
        let (x, v) = z.split_at_mut(now.x.len());
        if let Some(gap) = set.only() {
            for _ in 0..2 {
                let rate = kinetics.rate(gap, &v[..n]);
                kinetics.push(gap, -rate, &mut v[..n])?;
            }
            without_rounding(&mut v[..n], &now.xdot);
            let impulse = kinetics.alone(gap, -now.xdot[n + gap])?;
            for k in 0..rows {
                v[n + k] += kinetics.coupling(k, gap) * impulse;
            }
            (x[n + gap], v[n + gap]) = (0.0, 0.0);
            return Ok(());
        }
        // twice: the first leaves rounding of the speeds
        for _ in 0..2 {
            let w = &v[..n];
            kinetics.solve(set, |at, i| -at.rate(i, w))?;
            kinetics.apply(set, &mut v[..n]);
        }
        without_rounding(&mut v[..n], &now.xdot);
        let speeds = &now.xdot[n..];
        kinetics.solve(set, |_, i| -speeds[i])?;
        for k in 0..rows {
            v[n + k] = if set.has(k) { 0.0 } else { v[n + k] + kinetics.passed_on(k, set) };
        }
        for i in set.iter() {
            x[n + i] = 0.0;
        }
        Ok(())
    }
}

// The manifold of the equality rows.

impl MechanicalState {
    /// The start, where the system has just been evaluated, moved onto the manifold by rounding.
    fn start_on_manifold<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<(Vec<f64>, Vec<f64>), Failure<E>> {
        let n = self.layout.n;
        self.hold(model)?;
        self.kinetics.land_on_manifold();
        self.evaluate(model)?;
        Ok((self.now.x[..n].to_vec(), self.now.xdot[..n].to_vec()))
    }

    /// Moves coordinates and velocities onto the manifold, where the system was evaluated nearby.
    fn hold<E, D: Dynamics<E>>(&mut self, model: &mut Model<'_, D>) -> Result<(), Failure<E>> {
        let Self { kinetics, now, layout: Layout { n, .. }, .. } = self;
        kinetics.hold(model, now.t, (&mut now.x[..*n], &mut now.xdot[..*n]))
    }

    /// Moves the state onto the manifold.
    pub(crate) fn hold_here<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        if self.layout.k == 0 {
            return Ok(());
        }
        self.evaluate(model)?;
        self.hold(model)
    }

    /// From the end of a step without contacts onto the manifold. Accelerations and gaps change with the
    /// coordinates, to first order.
    fn take_on_manifold<E, D: Dynamics<E>>(
        &mut self,
        at_end: &AtEnd,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let Layout { n, m, .. } = self.layout;
        let known = at_end.equalities.as_ref().filter(|_| self.is_known);
        let Some((rows, normals)) = known.map(|it| &**it) else {
            self.kinetics.land_on_manifold();
            self.evaluate(model)?;
            self.refresh()?;
            self.hold(model)?;
            self.kinetics.hold_acceleration(&mut self.slope[..n]);
            self.anchor_all();
            return Ok(());
        };
        self.kinetics.restore_equalities(rows);
        let before = self.now.clone();
        self.hold(model)?;
        self.kinetics.hold_acceleration(&mut self.slope[..n]);
        let moved = |now: &[f64], before: &[f64]| -> Vec<f64> {
            now[..n].iter().zip(before).map(|(now, before)| now - before).collect()
        };
        let (dx, dv) = (moved(&self.now.x, &before.x), moved(&self.now.xdot, &before.xdot));
        self.lambda.copy_from_slice(&at_end.lambda);
        self.levels.clear();
        for (row, normal) in normals.chunks_exact(n).enumerate() {
            let rate = dot(normal, &dv);
            self.now.xdot[n + row] += rate;
            if row < m {
                let way = dot(normal, &dx);
                self.now.x[n + row] += way;
                self.anchor(row, at_end.gap[row] + way, at_end.rate[row] + rate);
            } else {
                self.anchor_slip(row, at_end.rate[row] + rate);
            }
        }
        Ok(())
    }

    /// Projects the velocities after a jump onto the equality rows, which have impulses.
    pub(crate) fn hold_kick<E, D: Dynamics<E>>(
        &mut self,
        (q, w): (&[f64], &[f64]),
        model: &mut Model<'_, D>,
    ) -> Result<Vec<f64>, Failure<E>> {
        let (mut q, mut w) = (q.to_vec(), w.to_vec());
        if self.layout.k > 0 {
            self.kinetics.evaluate(model, self.now.t, &q, &w)?;
            self.kinetics.hold(model, self.now.t, (&mut q, &mut w))?;
        }
        Ok(w)
    }
}

// The compliant gaps of a mechanical system.

impl MechanicalState {
    /// A compliant gap is pressed, or not, at the start of a run.
    fn press_at_start<E, D: Dynamics<E>>(
        &mut self,
        gap: usize,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (x, v) = self.gap(gap);
        let is_open = x > 0.0 || x == 0.0 && v > 0.0;
        let pulls = !is_open && self.kinetics.pulls(gap, (x, v), model)?;
        self.set_deep(gap, (!is_open).then_some(!pulls));
        Ok(())
    }

    /// A compliant gap is below zero, pressed or not, or above it.
    fn set_deep(&mut self, gap: usize, pressed: Option<bool>) {
        let (one, mode) = (GapSet::of(gap), &mut self.contacts.mode);
        mode.pressed = mode.pressed.without(one);
        mode.unloaded = mode.unloaded.without(one);
        match pressed {
            Some(true) => mode.pressed = mode.pressed.with(one),
            Some(false) => mode.unloaded = mode.unloaded.with(one),
            None => (),
        }
        self.kinetics.carry(mode.pressed);
    }

    /// Unloaded gaps that are above zero are open.
    pub(crate) fn open_unloaded(&mut self) {
        for gap in self.contacts.mode.unloaded.iter() {
            if self.gap(gap).0 > 0.0 {
                self.set_deep(gap, None);
            }
        }
    }

    /// Some compliant gaps cross zero here: they come into contact, or leave it.
    pub(crate) fn cross<E, D: Dynamics<E>>(
        &mut self,
        gaps: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let n = self.layout.n;
        for gap in gaps.iter() {
            self.now.x[n + gap] = 0.0;
        }
        for gap in gaps.iter() {
            let pulls = self.kinetics.pulls(gap, self.gap(gap), model)?;
            self.set_deep(gap, (!self.is_deep(gap)).then_some(!pulls));
        }
        self.settle_again(model)
    }

    /// The force of a compliant gap below zero changes its sign here.
    pub(crate) fn toggle_law<E, D: Dynamics<E>>(
        &mut self,
        gap: usize,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        self.set_deep(gap, Some(!self.mode().pressed.has(gap)));
        self.settle_again(model)?;
        self.contacts.turned = GapSet::of(gap);
        Ok(())
    }

    /// Decides again about closed contacts and friction, with new forces of compliant gaps.
    fn settle_again<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (closed, rows) = (self.closed(), self.kinetics.rows_of(self.mode()));
        self.project(rows, model)?;
        self.settle(closed)?;
        self.refresh()
    }
}

// The slips of a mechanical system, which have a place in its state.

/// A slip speed is as its direction says while that is larger than this part of the velocities.
const SLIP_ANCHOR: f64 = 1e-6;
/// A slip speed below this number of estimated errors after an accumulation may be zero.
const STILL: f64 = 100.0;
/// How many speeds below all tolerances are the tolerance.
pub(crate) const TOLERANCE: f64 = 1e2;
/// Rounding share of an integrated slip speed that other rows determine to be zero.
const HELD: f64 = 1e-3;

impl MechanicalState {
    /// The channels that begin to slip.
    pub(crate) fn released(&self) -> GapSet {
        self.contacts.released
    }

    /// The channels whose slip speed stays zero under the force of slip.
    pub(crate) fn spent(&self) -> GapSet {
        self.contacts.spent
    }

    /// Moves the coordinates back by how far a step has drifted along the channels that stick.
    pub(crate) fn undo_drift<E, D: Dynamics<E>>(
        &mut self,
        drift: &[f64],
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        if drift.iter().all(|drift| *drift == 0.0) {
            return Ok(());
        }
        self.evaluate(model)?;
        let Self { kinetics, now, layout: Layout { n, m, .. }, contacts, .. } = self;
        let rows = kinetics.rows_of(contacts.mode);
        let rows = kinetics.independent(rows);
        kinetics
            .solve(rows, |_, row| row.checked_sub(*m).map_or(0.0, |channel| -drift[channel]))?;
        kinetics.apply(rows, &mut now.x[..*n]);
        Ok(())
    }

    /// The least relative margin of some channels to their static limits, for known forces.
    pub(crate) fn least_hold(&self, channels: GapSet) -> Option<f64> {
        let force = |channel: usize| self.lambda[self.kinetics.row(channel)];
        let hold = |channel: usize| {
            let limit = self.kinetics.friction_limits(channel).1;
            let most = self.kinetics.gap_of(channel).map_or(limit, |gap| limit * self.lambda[gap]);
            let across = self.kinetics.other_of(channel).map_or(0.0, force);
            1.0 - force(channel).hypot(across) / most
        };
        channels.iter().map(hold).reduce(f64::min)
    }

    /// By how much friction decelerates the slip of a contact with two directions, where the forces are known.
    pub(crate) fn deceleration(&self, pair: [usize; 2]) -> f64 {
        let Some(gap) = self.kinetics.gap_of(pair[0]) else { return 0.0 };
        let roots = pair.map(|channel| self.kinetics.roots[self.kinetics.row(channel)]);
        let limit = self.kinetics.friction_limits(pair[0]).0;
        limit * self.lambda[gap] * roots.into_iter().fold(0.0, |d, root| f64::max(d, root * root))
    }

    /// The slip speeds, by channel.
    pub(crate) fn slips(&self) -> &[f64] {
        let Layout { n, m, p, .. } = self.layout;
        &self.now.xdot[n + m..n + m + p]
    }

    /// Gives the channels at the gaps of a set the limits of friction that they have without slip, where
    /// the system has just been evaluated: impulses know no other.
    pub(crate) fn evaluate_limits_at_rest<E, D: Dynamics<E>>(
        &mut self,
        set: GapSet,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let Self { kinetics, now, layout: Layout { n, .. }, .. } = self;
        let channels: GapSet = set.iter().flat_map(|gap| kinetics.channels_of(gap)).collect();
        let varies = |c: usize| {
            let (slip, stick) = kinetics.friction_limits(c);
            slip != stick
        };
        if !channels.iter().any(varies) {
            return Ok(());
        }
        let rows = channels.iter().map(|channel| kinetics.row(channel)).collect();
        let rows = kinetics.independent(rows);
        let (q, mut w) = (&now.x[..*n], now.xdot[..*n].to_vec());
        kinetics.solve(rows, |at, row| -at.rate(row, &now.xdot[..*n]))?;
        kinetics.apply(rows, &mut w);
        kinetics.evaluate(model, now.t, q, &w)?;
        let limits: Vec<f64> = channels.iter().map(|c| kinetics.friction_limits(c).0).collect();
        kinetics.evaluate(model, now.t, q, &now.xdot[..*n])?;
        for (channel, limit) in channels.iter().zip(limits) {
            kinetics.set_friction_limit(channel, limit);
        }
        Ok(())
    }

    /// Recomputes an integrated slip speed from its direction, if that has enough digits.
    fn anchor_slip(&mut self, row: usize, rate: f64) {
        let n = self.layout.n;
        let size = self.now.xdot[..n].iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        let sticks = self.contacts.mode.stick.has(row - self.layout.m);
        if !sticks && rate.abs() > SLIP_ANCHOR * (size + rate.abs()) {
            self.now.xdot[n + row] = rate;
        }
    }

    /// The slip in some channels is zero.
    pub(crate) fn stop_slip(&mut self, channels: GapSet) {
        let Layout { n, m, .. } = self.layout;
        channels.iter().for_each(|channel| self.now.xdot[n + m + channel] = 0.0);
    }

    /// Of some slipping channels those that the rows just projected on leave no speed but rounding: the
    /// tip of an arm on the floor whose only free joint stops. Their integrated slips say so to the
    /// tolerance only.
    pub(crate) fn held(&self, channels: GapSet) -> GapSet {
        let n = self.layout.n;
        let (q, w) = (&self.now.x[..n], &self.now.xdot[..n]);
        let held = |&channel: &usize| {
            // of a contact with two directions both
            let all = [Some(channel), self.kinetics.other_of(channel)].map(|channel| {
                channel.map_or([0.0; 3], |channel| {
                    let row = self.kinetics.row(channel);
                    let rounding = self.kinetics.rounding(row, q, w).1;
                    [self.kinetics.rate(row, w), self.now.xdot[n + row], rounding]
                })
            });
            let [rate, slip, rounding] = [0, 1, 2].map(|k| all[0][k].hypot(all[1][k]));
            rate <= HELD * slip || rate <= rounding
        };
        channels.iter().filter(held).collect()
    }

    /// Sets the slip speeds to those of the velocities, where the system has just been evaluated; to
    /// zero within rounding, and after an accumulation within the errors of the rates and a slow speed.
    pub(crate) fn take_slips(&mut self, errors: Option<(&[f64], f64)>) {
        let Layout { n, m, p, .. } = self.layout;
        let (q, w) = (self.now.x[..n].to_vec(), self.now.xdot[..n].to_vec());
        for row in m..m + p {
            if self.now.xdot[n + row] == 0.0 {
                continue;
            }
            let (rate, noise) =
                (self.kinetics.rate(row, &w), self.kinetics.rounding(row, &q, &w).1);
            // what the extrapolation of a slip misses, that of the velocities does not
            let most = TOLERANCE * (1.0 + self.kinetics.steepness(row));
            let error = errors
                .map_or(0.0, |(errors, slow)| slow.max(STILL * errors[n + row].min(most * slow)));
            let still = rate.abs() <= 4.0 * noise + error;
            self.now.xdot[n + row] = if still { 0.0 } else { rate };
        }
    }

    /// The channels of the gaps of a set that stick in a state, `x` before `x'`: all impacts before a
    /// corner have left them so.
    pub(crate) fn stuck_in(&self, z: &[f64], set: GapSet) -> GapSet {
        let first = z.len() / 2 + self.layout.n;
        let channels = set.iter().flat_map(|gap| self.kinetics.channels_of(gap));
        channels.filter(|&channel| z[first + self.kinetics.row(channel)] == 0.0).collect()
    }

    /// Notes what friction does otherwise than before.
    pub(crate) fn note_transitions(&self, before: ContactMode, occurrences: &mut Vec<Occurrence>) {
        let (t, now) = (self.now.t, self.mode());
        for channel in 0..self.layout.p {
            let (before, after) = (before.number(channel), now.number(channel));
            if before != after && after != 2 {
                occurrences.push(Occurrence::Transition { t, channel, before, after });
            }
        }
    }

    /// The channels of a set do not slip: their rows.
    fn stop_rows(&mut self, channels: GapSet) -> GapSet {
        self.stop_slip(channels);
        channels.iter().map(|channel| self.kinetics.row(channel)).collect()
    }

    /// The same along the edges of the cones of friction.
    fn without_speeds_along_edges<E>(&mut self, mode: ContactMode) -> Result<Vec<f64>, Failure<E>> {
        let Self { kinetics, now, layout: Layout { n, .. }, .. } = self;
        let n = *n;
        let (mut x, mut v) = (now.x.clone(), now.xdot.clone());
        let rates = now.xdot[n..].to_vec();
        kinetics.turn(&rates);
        let moved = kinetics.displacement(mode, |row| -rates[row])?;
        v.iter_mut().zip(&moved).for_each(|(v, moved)| *v += moved);
        // the impulses do work, too
        let (m, pulls) = (kinetics.layout.m, kinetics.friction_impulses(mode, |row| -rates[row])?);
        let work = |(c, pull): (usize, &f64)| -pull * (rates[m + c] + 0.5 * moved[n + m + c]);
        v[n + m + pulls.len()] += pulls.iter().enumerate().map(work).sum::<f64>();
        // the first leaves rounding of the speeds
        let w = v[..n].to_vec();
        let left: Vec<f64> = (0..rates.len() - 1).map(|row| kinetics.rate(row, &w)).collect();
        let more = kinetics.displacement(mode, |row| -left[row])?;
        v[..n].iter_mut().zip(&more).for_each(|(v, more)| *v += more);
        without_rounding(&mut v[..n], &now.xdot);
        for row in kinetics.rows_of(mode).iter() {
            v[n + row] = 0.0;
        }
        for gap in mode.closed.iter() {
            x[n + gap] = 0.0;
        }
        x.append(&mut v);
        Ok(x)
    }
}
