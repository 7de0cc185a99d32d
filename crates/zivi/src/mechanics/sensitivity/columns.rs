//! The variational columns of a mechanical system, in the Runge-Kutta steps of the motion.
//!
//! A column holds the derivatives of coordinates and gaps, and those of their rates, at a fixed
//! time. The gaps are carried along as in the motion itself: the shift of an impact is the ratio of
//! a small derivative to a small speed.

use std::sync::Arc;

use crate::friction::Edges;
use crate::kinetics::mode::{Stages, State};
use crate::kinetics::{Kinetics, Model};
use crate::numeric::dense::{axpy, dot};
use crate::numeric::stages::{worse, Equation, Tolerances};
use crate::numeric::tableau::{ErrorEstimate, Interpolant};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::system::dynamics::{FunctionDynamics, Layout};
use crate::system::force::Friction;
use crate::system::impact_law::AnyImpactLaw;
use crate::system::partials::{
    DifferentiableDynamics, DirectionalDerivative, MovedLaws, MovedNumber, StateDirection,
    TimedState,
};
use crate::Status;

/// Variable of differentiation of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MechanicalWrt {
    /// An initial coordinate.
    Q0(usize),
    /// An initial velocity.
    Qdot0(usize),
    /// The time of the initial state.
    T0,
    /// The first parameter of the impact laws of all gaps together, of Newton's the coefficient of
    /// restitution.
    AllE,
    /// A parameter of the impact law of a gap, by its number.
    Law {
        /// The gap.
        gap: usize,
        /// The parameter.
        parameter: usize,
    },
    /// A parameter of the system, by its number.
    Parameter(usize),
    /// A number of dry friction.
    Friction {
        /// The channel.
        channel: usize,
        /// Which of its numbers.
        number: FrictionNumber,
    },
    /// A number of the contact force of a compliant gap, in the order of
    /// [`crate::system::force::ContactForce`].
    Contact {
        /// The gap.
        gap: usize,
        /// Which of its numbers.
        number: usize,
    },
}

/// The numbers of a channel of dry friction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrictionNumber {
    /// The coefficient or force in slip alone.
    Slip,
    /// The same while it sticks.
    Static,
    /// Both numbers if they are equal.
    Both,
    /// The speed of the counter-surface.
    Velocity,
    /// The tangential restitution in impacts.
    Restitution,
}

/// A number of friction with its channel; none for a number of a contact force.
type RoughNumber = Option<(usize, FrictionNumber)>;

impl MechanicalWrt {
    /// Derivative of the law of a gap with respect to it: for a parameter of the law, otherwise
    /// zero.
    pub(super) fn of_law(self, of: usize, by: impl Fn(usize) -> f64) -> f64 {
        match self {
            Self::AllE => by(0),
            Self::Law { gap, parameter } if gap == of => by(parameter),
            _ => 0.0,
        }
    }

    /// Derivative of the tangential restitution of a channel with respect to it.
    pub(super) fn of_restitution(self, of: usize) -> f64 {
        let is_it = matches!(self, Self::Friction { channel, number: FrictionNumber::Restitution } if channel == of);
        f64::from(u8::from(is_it))
    }
}

/// The columns of the run in progress.
#[derive(Clone, Debug)]
pub(super) struct Columns {
    pub(super) wrt: Vec<MechanicalWrt>,
    /// Which of the parameters of `local` a column is by.
    pub(super) parameter: Vec<Option<usize>>,
    /// How parameters move the laws of the gaps, by column.
    moved: Vec<Option<MovedLaws>>,
    pub(super) layout: Layout,
    pub(super) local: Local,
    /// All columns, one after the other, and the last step of them.
    pub(super) now: State,
    pub(super) steps: Stages,
    /// The mode of the last step, and how many of its stages are known.
    pub(super) mode: ContactMode,
    known: usize,
    /// Where the system was last evaluated, if that is known.
    pub(super) visited: Option<Place>,
}

/// A time, the mode, and between which times the system is smooth.
type Place = (f64, ContactMode, (f64, f64));

/// The variational equations along the stages of a step of the motion: with `J` the Jacobian at
/// each of them the columns are the exact derivative of the step that was made.
struct Variation<'r, 'm, D> {
    motion: &'r Stages,
    mode: ContactMode,
    parameter: &'r [Option<usize>],
    layout: Layout,
    local: &'r mut Local,
    known: &'r mut usize,
    model: &'r mut Model<'m, D>,
}

impl<E, D: DifferentiableDynamics<E>> Equation<Vec<f64>, Failure<E>> for Variation<'_, '_, D> {
    fn acceleration(&mut self, state: &State, into: &mut Vec<f64>) -> Result<(), Failure<E>> {
        let (motion, i, n) = (self.motion, *self.known, self.layout.n);
        let last = motion.pair.b.len();
        let node = match motion.pair.interpolant {
            _ if i == last => motion.end.clone(),
            Interpolant::Nested { a, .. } if i > last => motion.node(i, &a[i - last - 1]),
            _ => motion.node(i, &motion.pair.a[i - 1]),
        };
        let at = (node.t, &node.x[..n], &node.xdot[..n]);
        let size = self.layout.size().min(state.x.len());
        let first = (&state.x[..size], &state.xdot[..size], self.parameter.first().copied());
        self.local.visit_along(self.model, at, self.mode, first)?;
        *self.known += 1;
        accelerations(self.local, (self.layout, self.parameter), self.mode, state, into)
    }
}

impl Columns {
    pub(super) fn new(
        (wrt, moved): (&[MechanicalWrt], Vec<Option<MovedLaws>>),
        (layout, friction): (Layout, &Friction),
        pair: &'static crate::numeric::tableau::Pair,
    ) -> Self {
        let number = |wrt: &MechanicalWrt| match wrt {
            MechanicalWrt::Parameter(number) => Some(*number),
            _ => None,
        };
        let by: Vec<usize> = wrt.iter().filter_map(number).collect();
        let (mut own, mut rough) = (0.., Vec::new());
        let mut contacts: Vec<Vec<MovedNumber>> = vec![Vec::new(); by.len()];
        let mut place = |(wrt, moved): (&MechanicalWrt, &Option<MovedLaws>)| match *wrt {
            MechanicalWrt::Parameter(_) => {
                let place: Option<usize> = own.next();
                if let (Some(place), Some(moved)) = (place, moved) {
                    contacts[place].clone_from(&moved.contacts);
                }
                place
            }
            MechanicalWrt::Friction { channel, number } => {
                rough.push(Some((channel, number)));
                contacts.push(Vec::new());
                Some(contacts.len() - 1)
            }
            MechanicalWrt::Contact { gap, number } => {
                rough.push(None);
                contacts.push(vec![(gap, number, 1.0)]);
                Some(contacts.len() - 1)
            }
            _ => None,
        };
        let parameter = wrt.iter().zip(&moved).map(&mut place).collect();
        let entries = wrt.len() * layout.size();
        Self {
            wrt: wrt.to_vec(),
            parameter,
            moved,
            layout,
            local: Local::new((layout, friction), by, (&rough, contacts)),
            now: State::zeros(entries),
            steps: Stages::new(pair, entries),
            mode: ContactMode::default(),
            known: 0,
            visited: None,
        }
    }

    /// Coordinates, gaps, slips and the work of friction, which has no derivatives: the length of a column.
    pub(super) fn size(&self) -> usize {
        self.layout.size()
    }

    /// The derivative by a column of the speed after an impact of a gap at the speed `v`.
    pub(super) fn of_law(&self, column: usize, gap: usize, law: &AnyImpactLaw, v: f64) -> f64 {
        let own = self.wrt[column].of_law(gap, |parameter| law.by(parameter, v));
        let moved = self.moved[column].as_ref();
        own + moved.map_or(0.0, |it| it.of_impact(gap, |law| law.after(v)))
    }

    /// The same for the ratio of slow impacts.
    pub(super) fn limit_of_law(&self, column: usize, gap: usize, law: &AnyImpactLaw) -> f64 {
        let own = self.wrt[column].of_law(gap, |parameter| law.limit_by(parameter));
        let moved = self.moved[column].as_ref();
        own + moved.map_or(0.0, |it| it.of_impact(gap, |law| law.limit().unwrap_or(0.0)))
    }

    /// Evaluates the system at a state in a mode.
    pub(super) fn visit<E, D: DifferentiableDynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        at: &State,
        mode: ContactMode,
    ) -> Result<(), Failure<E>> {
        let n = self.layout.n;
        self.local.visit_mode(model, (at.t, &at.x[..n], &at.xdot[..n]), mode)?;
        self.visited = Some((at.t, mode, model.smooth.ends()));
        Ok(())
    }

    /// The equations along a step of the motion, and the step of the columns.
    fn along<'r, 'm, D>(
        &'r mut self,
        motion: &'r Stages,
        model: &'r mut Model<'m, D>,
    ) -> (Variation<'r, 'm, D>, &'r mut Stages) {
        let Self { steps, mode, parameter, layout, local, known, visited, .. } = self;
        *visited = None;
        let (mode, layout) = (*mode, *layout);
        (Variation { motion, mode, parameter, layout, local, known, model }, steps)
    }

    /// From `self.now` through a step of the motion in a mode, to `self.steps.end`.
    pub(super) fn advance<E, D: DifferentiableDynamics<E>>(
        &mut self,
        motion: &Stages,
        mode: ContactMode,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        if self.visited != Some((motion.from.t, mode, model.smooth.ends())) {
            let (n, size) = (self.layout.n, self.size().min(self.now.x.len()));
            let (at, now) = (&motion.from, &self.now);
            let first = (&now.x[..size], &now.xdot[..size], self.parameter.first().copied());
            self.local.visit_along(model, (at.t, &at.x[..n], &at.xdot[..n]), mode, first)?;
        }
        (self.now.t, self.now.late) = (motion.from.t, motion.from.late);
        let mut slope = vec![0.0; self.now.x.len()];
        let (of, now) = ((self.layout, &self.parameter[..]), &self.now);
        accelerations(&mut self.local, of, mode, now, &mut slope)?;
        (self.mode, self.known) = (mode, 1);
        let from = self.now.clone();
        let (mut equation, steps) = self.along(motion, model);
        steps.step(&from, &slope, motion.h, &mut equation)
    }

    /// All stages of the dense output. The motion has its own.
    pub(super) fn complete<E, D: DifferentiableDynamics<E>>(
        &mut self,
        motion: &Stages,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let (mut equation, steps) = self.along(motion, model);
        steps.complete(&mut equation)
    }

    /// The largest error relative to `atol/size + rtol |entry|`, `sizes` being the magnitudes of
    /// the variables of differentiation; lost columns are ignored, and slips, which follow from the
    /// coordinates where they are needed.
    pub(super) fn error<E, D: DifferentiableDynamics<E>>(
        &mut self,
        motion: &Stages,
        tolerances: &Tolerances,
        (sizes, lost): (&[f64], &[bool]),
        model: &mut Model<'_, D>,
    ) -> Result<f64, Failure<E>> {
        if let ErrorEstimate::Single(_) = motion.pair.estimate {
            let (mut equation, steps) = self.along(motion, model);
            steps.finish(&mut equation)?;
        }
        let (size, steps) = (self.size(), &self.steps);
        let mut worst = 0.0_f64;
        let followed = self.layout.n + self.layout.m;
        let counts = |entry: &usize| !lost[entry / size] && entry % size < followed;
        for entry in (0..self.now.x.len()).filter(counts) {
            let atol = tolerances.atol.map(|atol| atol / sizes[entry / size]);
            let scales = steps.scales(entry, &Tolerances { atol, ..*tolerances });
            worst = worse(steps.error_of(entry).norm(scales), worst);
        }
        Ok(worst)
    }

    /// Appends the last step, up to a time `delta` after its end that is short relative to the step.
    pub(super) fn take<E, D: DifferentiableDynamics<E>>(
        &mut self,
        motion: &Stages,
        delta: f64,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        if delta != 0.0 {
            let (mut equation, steps) = self.along(motion, model);
            steps.finish(&mut equation)?;
        }
        self.now.copy_from(&self.steps.end);
        if delta != 0.0 {
            for entry in 0..self.now.x.len() {
                let slope = self.steps.end_slope(entry);
                self.now.x[entry] += delta * (self.now.xdot[entry] + 0.5 * delta * slope);
                self.now.xdot[entry] += delta * slope;
            }
        }
        Ok(())
    }

    /// Moves the columns into the manifold of the contacts, at a state where the system has just
    /// been evaluated.
    pub(super) fn project<E>(&mut self, mode: ContactMode, at: &State) -> Result<(), Failure<E>> {
        let Layout { n, .. } = self.layout;
        let size = self.size();
        for (column, parameter) in self.parameter.iter().enumerate() {
            let x = &mut self.now.x[column * size..][..size];
            let v = &mut self.now.xdot[column * size..][..size];
            self.local.project(mode, &at.xdot[..n], *parameter, (&mut x[..n], &mut v[..n]))?;
            hold_rows(mode, self.layout, (x, v));
        }
        Ok(())
    }

    /// Gaps and slips of the columns from the coordinates, which were moved, where the system has just been
    /// evaluated.
    pub(super) fn renew_rows(&mut self, mode: ContactMode, at: &State) {
        let (Layout { n, .. }, size) = (self.layout, self.size());
        for (column, parameter) in self.parameter.iter().enumerate() {
            let x = &mut self.now.x[column * size..][..size];
            let v = &mut self.now.xdot[column * size..][..size];
            let row = self.local.along(Direction {
                t: 0.0,
                q: &x[..n],
                w: &v[..n],
                parameter: *parameter,
            });
            let rows = self.local.gaps(&row, &at.xdot[..n], &v[..n]);
            for (k, [gap, rate]) in rows.into_iter().enumerate() {
                (x[n + k], v[n + k]) = (gap, rate);
            }
            hold_rows(mode, self.layout, (x, v));
        }
    }
}

/// Zeros for the closed gaps and sticking contacts of a column.
pub(super) fn hold_rows(mode: ContactMode, layout: Layout, (x, v): (&mut [f64], &mut [f64])) {
    let Layout { n, m, .. } = layout;
    for i in mode.closed.iter() {
        (x[n + i], v[n + i]) = (0.0, 0.0);
    }
    for channel in mode.stick.iter() {
        (x[n + m + channel], v[n + m + channel]) = (0.0, 0.0);
    }
}

/// The accelerations of the columns, where the system has just been evaluated.
fn accelerations<E>(
    local: &mut Local,
    (layout, parameter): (Layout, &[Option<usize>]),
    mode: ContactMode,
    at: &State,
    out: &mut [f64],
) -> Result<(), Failure<E>> {
    let (n, size) = (layout.n, layout.size());
    for (column, parameter) in parameter.iter().enumerate() {
        let (q, w) = (&at.x[column * size..][..n], &at.xdot[column * size..][..n]);
        let row = match local.first.take().filter(|_| column == 0) {
            Some(row) => row,
            None => local.along(Direction { t: 0.0, q, w, parameter: *parameter }),
        };
        local.check_along(&row, (q, w))?;
        let (change, _) = local.acceleration(mode, &row)?;
        out[column * size..][..change.len()].copy_from_slice(&change);
    }
    Ok(())
}

// The mechanics at one state and its derivatives along any direction.
//
// With `r'` for the derivative of `r` along the direction, contacts `C` and forces `lambda` on
// them, the accelerations `a = q''` of `M a - N_C^T lambda = F`, `N_C a + h_C = 0` change by
//
// ```text
// M a' - N_C^T lambda' = F' - M' a + N_C'^T lambda
// N_C a'               = -h_C' - N_C' a                                                   (1)
// ```
//
// and the velocities after impulses `P` on a set `S`, `M (w+ - w-) = N_S^T P`, `N_S w+ + g_t = u`,
//
// ```text
// M w+' - N_S^T P' = M w-' - M' (w+ - w-) + N_S'^T P
// N_S w+'          = u' - N_S' w+ - g_t'                                                  (2)
// ```
//
// With friction they are those of [`crate::mechanics::sensitivity::columns`].

/// A direction in time, state and parameters.
#[derive(Clone, Copy, Debug)]
pub(super) struct Direction<'a> {
    pub(super) t: f64,
    pub(super) q: &'a [f64],
    pub(super) w: &'a [f64],
    /// Which of the parameters that the derivatives are taken by.
    pub(super) parameter: Option<usize>,
}

/// A change of the velocities by impulses, and how it moves with the data.
pub(super) struct Exchange<'a> {
    /// The gaps with impulses.
    pub(super) set: GapSet,
    /// The impulses, in the order of the set.
    pub(super) impulses: &'a [f64],
    /// `w-` and `w+`.
    pub(super) before: &'a [f64],
    pub(super) after: &'a [f64],
}

/// Derivatives of the contact forces of compliant gaps.
#[derive(Clone, Debug)]
pub(super) struct CompliantPartials {
    /// The gaps below zero, and those of them that push.
    pub(super) deep: GapSet,
    pub(super) pressed: GapSet,
    /// For each parameter the numbers of laws that it moves.
    pub(super) numbers: Vec<Vec<MovedNumber>>,
    /// The derivatives by numbers of friction, without contact forces.
    pub(super) constant: Vec<f64>,
    /// The derivatives of the forces by gap, one row for each of the partial derivatives.
    pub(super) forces: Vec<f64>,
    /// The largest gap and rate so far.
    pub(super) extent: [f64; 2],
}

impl CompliantPartials {
    fn new(
        friction: &Friction,
        numbers: Vec<Vec<MovedNumber>>,
        constant: Vec<f64>,
    ) -> Option<Box<Self>> {
        let (deep, pressed, extent) = (GapSet::EMPTY, GapSet::EMPTY, [0.0; 2]);
        let own = Self { deep, pressed, numbers, constant, forces: Vec::new(), extent };
        (!friction.compliant.is_empty()).then(|| Box::new(own))
    }
}

/// Values and partial derivatives at one time and state.
#[derive(Clone, Debug)]
pub(super) struct Local {
    pub(super) layout: Layout,
    pub(super) kinetics: Kinetics,
    /// `K` of the last mode, with friction.
    pub(super) edges: Option<Edges>,
    /// The parameters that the derivatives are taken by.
    by: Vec<usize>,
    /// Data of compliant gaps, if any.
    pub(super) compliant: Option<Box<CompliantPartials>>,
    /// The derivatives by time, state and parameters, then those by numbers of friction.
    pub(super) partials: Vec<f64>,
    /// The derivatives along single directions where they take the place of those by time, state and
    /// parameters, and the coordinates and velocities of the last visit.
    directional: Option<Arc<dyn DirectionalDerivative>>,
    here: Vec<f64>,
    /// The derivative along the first column, where the last visit found it.
    first: Option<Vec<f64>>,
    /// How often they were evaluated.
    pub(super) count: u64,
}

impl Local {
    pub(super) fn new(
        (layout, friction): (Layout, &Friction),
        by: Vec<usize>,
        (rough, contacts): (&[RoughNumber], Vec<Vec<MovedNumber>>),
    ) -> Self {
        let mut partials = vec![0.0; layout.len() * (1 + 2 * layout.n + by.len())];
        let known = partials.len();
        for number in rough {
            let (first, rate) = (partials.len(), layout.rate().start + layout.m);
            partials.resize(first + layout.len(), 0.0);
            let Some((channel, number)) = *number else { continue };
            let own = &mut partials[first..];
            if let FrictionNumber::Slip | FrictionNumber::Both = number {
                own[layout.limit()][channel] = 1.0;
            }
            if let FrictionNumber::Static | FrictionNumber::Both = number {
                own[layout.static_limit()][channel] = 1.0;
            }
            if number == FrictionNumber::Velocity {
                own[rate + channel] = -1.0;
            }
        }
        let kinetics = Kinetics::new(layout, friction);
        let constant = partials[known..].to_vec();
        let compliant = CompliantPartials::new(friction, contacts, constant);
        let (directional, here, first) = (None, Vec::new(), None);
        let (edges, count) = (None, 0);
        Self { layout, kinetics, edges, by, compliant, partials, directional, here, first, count }
    }

    /// From here on derivatives are taken along the directions of `columns` columns if these are
    /// fewer than the coordinates.
    pub(super) fn prefer_directions<E, D: DifferentiableDynamics<E>>(
        &mut self,
        columns: usize,
        dynamics: &D,
    ) {
        if self.compliant.is_none() && columns <= self.layout.n {
            self.directional = dynamics.directional();
        }
    }

    /// The parameters that the derivatives are taken by.
    pub(super) fn by(&self) -> &[usize] {
        &self.by
    }

    /// Evaluates the system and its partial derivatives.
    pub(super) fn visit<E, D: DifferentiableDynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        t: f64,
        q: &[f64],
        w: &[f64],
    ) -> Result<(), Failure<E>> {
        self.kinetics.evaluate(model, t, q, w)?;
        let t = model.smooth.nearest(t);
        self.count += 1;
        if self.directional.is_some() {
            self.stand_at(q, w);
            return Ok(());
        }
        let at = TimedState { t, q, w };
        let known = self.layout.len() * (1 + 2 * self.layout.n + self.by.len());
        let partials = &mut self.partials[..known];
        model.dynamics.partials(at, &self.by, partials).map_err(Failure::Raised)?;
        self.differentiate_contacts(w, model)?;
        if self.partials.iter().all(|value| value.is_finite()) {
            Ok(())
        } else {
            Err(Failure::Status(Status::ForceNotFinite))
        }
    }

    /// The same in a mode, where the motion determines it.
    pub(super) fn visit_mode<E, D: DifferentiableDynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        (t, q, w): (f64, &[f64], &[f64]),
        mode: ContactMode,
    ) -> Result<(), Failure<E>> {
        self.carry(mode);
        self.visit(model, t, q, w)?;
        self.contact(mode)?;
        match mode.slipping().is_empty() {
            true => Ok(()),
            false => self.differentiate_limits(model, (t, q, w), mode),
        }
    }

    fn stand_at(&mut self, q: &[f64], w: &[f64]) {
        self.first = None;
        self.here.clear();
        self.here.extend(q.iter().chain(w));
    }

    /// As [`Self::visit_mode`]; where derivatives are taken along directions that of the first column
    /// comes with the evaluation.
    fn visit_along<E, D: DifferentiableDynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        (t, q, w): (f64, &[f64], &[f64]),
        mode: ContactMode,
        (x, v, parameter): (&[f64], &[f64], Option<Option<usize>>),
    ) -> Result<(), Failure<E>> {
        let (Some(directional), Some(parameter)) = (self.directional.clone(), parameter) else {
            return self.visit_mode(model, (t, q, w), mode);
        };
        let Layout { n, .. } = self.layout;
        self.stand_at(q, w);
        let direction = Direction { t: 0.0, q: &x[..n], w: &v[..n], parameter };
        let (values, row) = self.along_directly(&*directional, direction);
        let layout = self.layout;
        let function = |_: f64, _: &[f64], _: &[f64], out: &mut [f64]| {
            out.copy_from_slice(&values);
            Ok(())
        };
        let mut known = FunctionDynamics { layout, function };
        self.kinetics.evaluate(&mut Model::new(&mut known), t, q, w)?;
        (self.first, self.count, model.count) = (Some(row), self.count + 1, model.count + 1);
        self.contact(mode)
    }

    /// The derivatives of the numbers of an evaluation along a direction, then of the forces of compliant
    /// gaps.
    pub(super) fn along(&self, direction: Direction<'_>) -> Vec<f64> {
        let (n, length) = (self.layout.n, self.layout.len());
        if let Some(directional) = &self.directional {
            return self.along_directly(&**directional, direction).1;
        }
        let (forces, m) = (self.compliant.as_ref().map(|it| &it.forces), self.layout.m);
        let mut row = vec![0.0; length + forces.map_or(0, |_| m)];
        let mut add = |index: usize, factor: f64| {
            if factor != 0.0 {
                axpy(&mut row[..length], factor, &self.partials[index * length..][..length]);
                if let Some(forces) = forces {
                    axpy(&mut row[length..], factor, &forces[index * m..][..m]);
                }
            }
        };
        add(0, direction.t);
        for c in 0..n {
            add(1 + c, direction.q[c]);
            add(1 + n + c, direction.w[c]);
        }
        if let Some(parameter) = direction.parameter {
            add(1 + 2 * n + parameter, 1.0);
        }
        row
    }

    /// The numbers of an evaluation at the last visit, and their derivatives along a direction.
    fn along_directly(
        &self,
        system: &dyn DirectionalDerivative,
        direction: Direction<'_>,
    ) -> (Vec<f64>, Vec<f64>) {
        let (n, length, known) = (self.layout.n, self.layout.len(), self.by.len());
        let Direction { q, w, parameter, .. } = direction;
        let parameter = parameter.filter(|&it| it < known).map(|it| self.by[it]);
        let (mut values, mut row) = (vec![0.0; length], vec![0.0; length]);
        let out = (&mut values[..], &mut row[..]);
        system.along(self.here.split_at(n), StateDirection { q, w, parameter }, out);
        if let Some(rough) = direction.parameter.filter(|&it| it >= known) {
            axpy(&mut row, 1.0, &self.partials[(1 + 2 * n + rough) * length..][..length]);
        }
        (values, row)
    }

    /// An error where the derivative along a direction is not finite.
    fn check_along<E>(&self, row: &[f64], (q, w): (&[f64], &[f64])) -> Result<(), Failure<E>> {
        let is_finite = |of: &[f64]| of.iter().all(|it| it.is_finite());
        match self.directional.is_none() || is_finite(row) || !(is_finite(q) && is_finite(w)) {
            true => Ok(()),
            false => Err(Failure::Status(Status::ForceNotFinite)),
        }
    }

    pub(super) fn normal<'r>(&self, row: &'r [f64], i: usize) -> &'r [f64] {
        let n = self.layout.n;
        &row[self.layout.gradient()][i * n..][..n]
    }

    /// `x - M' y`.
    pub(super) fn less_mass(&self, row: &[f64], y: &[f64], x: &mut [f64]) {
        let n = self.layout.n;
        for (x, mass) in x.iter_mut().zip(row[self.layout.mass()].chunks_exact(n)) {
            *x -= dot(mass, y);
        }
    }

    /// Solves `M x - N_S^T y = right`, `N_S x = of_gap(i)`: `x` takes the place of `right`, `y` is
    /// returned.
    fn solve<E>(
        &mut self,
        set: GapSet,
        right: &mut [f64],
        of_gap: impl Fn(usize) -> f64,
    ) -> Result<Vec<f64>, Failure<E>> {
        self.kinetics.solve_mass(right);
        if set.is_empty() {
            return Ok(Vec::new());
        }
        let free = &*right;
        self.kinetics.solve_regular(set, |at, i| of_gap(i) - dot(at.normal(i), free))?;
        self.kinetics.apply(set, right);
        Ok(self.kinetics.solved()[..set.len()].to_vec())
    }

    /// Accelerations and forces in a mode, where the motion determines it.
    pub(super) fn contact<E>(&mut self, mode: ContactMode) -> Result<(), Failure<E>> {
        self.edges = None;
        if mode.is_frictionless() {
            return Ok(self.kinetics.determined_contact(mode.closed)?);
        }
        self.frictional_contact(mode)
    }

    /// Equations (1) for the mode of the last kinetics: derivatives of the accelerations of
    /// coordinates and rows and of the forces by row.
    pub(super) fn acceleration<E>(
        &mut self,
        mode: ContactMode,
        row: &[f64],
    ) -> Result<(Vec<f64>, Vec<f64>), Failure<E>> {
        if !mode.is_frictionless() {
            return self.frictional_acceleration(mode, row);
        }
        let (n, rows, closed) = (self.layout.n, self.layout.rows(), mode.closed);
        let at = self.kinetics.acceleration[..n].to_vec();
        let mut change = row[self.layout.force()].to_vec();
        self.less_mass(row, &at, &mut change);
        for i in closed.iter() {
            axpy(&mut change, self.kinetics.lambda[i], self.normal(row, i));
        }
        let bend = |i: usize| row[self.layout.curvature()][i];
        let turned: Vec<f64> = (0..rows).map(|i| bend(i) + dot(self.normal(row, i), &at)).collect();
        let pressed = self.solve(closed, &mut change, |i| -turned[i])?;
        let mut forces = vec![0.0; rows];
        closed.iter().zip(pressed).for_each(|(i, force)| forces[i] = force);
        self.add_contact_forces(row, &mut forces);
        let gap = |k: usize| {
            if closed.has(k) {
                0.0
            } else {
                turned[k] + dot(self.kinetics.normal(k), &change)
            }
        };
        let gaps: Vec<f64> = (0..rows).map(gap).collect();
        change.extend(gaps);
        Ok((change, forces))
    }

    /// Equations (2), with `w-'` in `velocities`, which `w+'` takes the place of, and the rates of
    /// the gaps: those of the set become `target`, the others change by the impulses.
    pub(super) fn exchange<E>(
        &mut self,
        how: &Exchange<'_>,
        row: &[f64],
        target: impl Fn(usize) -> f64,
        velocities: &mut [f64],
        rates: &mut [f64],
    ) -> Result<(), Failure<E>> {
        let Exchange { set, impulses, before, after } = *how;
        let jump: Vec<f64> =
            after.iter().zip(before).map(|(after, before)| after - before).collect();
        let mut change = vec![0.0; self.layout.n];
        self.less_mass(row, &jump, &mut change);
        for (i, impulse) in set.iter().zip(impulses) {
            axpy(&mut change, *impulse, self.normal(row, i));
        }
        // the part of M w-' is solved for already
        let old = velocities.to_vec();
        let moves = |i: usize| dot(self.normal(row, i), after) + row[self.layout.rate()][i];
        let wanted: Vec<f64> = (0..self.layout.m)
            .map(|i| target(i) - moves(i) - dot(self.kinetics.normal(i), &old))
            .collect();
        self.solve(set, &mut change, |i| wanted[i])?;
        axpy(velocities, 1.0, &change);
        for (k, rate) in rates.iter_mut().enumerate().take(self.layout.rows()) {
            *rate = if set.has(k) {
                target(k)
            } else {
                let turned = dot(self.normal(row, k), &jump);
                *rate + turned + dot(self.kinetics.normal(k), &change)
            };
        }
        Ok(())
    }

    /// The derivatives of the gaps and of their rates, by those of the state; of slips those of the rates.
    pub(super) fn gaps(&self, row: &[f64], w: &[f64], by_w: &[f64]) -> Vec<[f64; 2]> {
        let gaps = &row[self.layout.gap()];
        let one = |i: usize| {
            let rate = dot(self.normal(row, i), w) + row[self.layout.rate()][i];
            let gap = gaps.get(i).copied().unwrap_or(0.0);
            [gap, rate + dot(self.kinetics.normal(i), by_w)]
        };
        (0..self.layout.rows()).map(one).collect()
    }

    /// Moves the derivatives of a state, along the directions of the impulses, into the manifold
    /// where the gaps of a set stay zero.
    pub(super) fn project<E>(
        &mut self,
        mode: ContactMode,
        w: &[f64],
        parameter: Option<usize>,
        (q, v): (&mut [f64], &mut [f64]),
    ) -> Result<(), Failure<E>> {
        let direction =
            |q: &[f64], v: &[f64], at: &Self| at.along(Direction { t: 0.0, q, w: v, parameter });
        let (gaps, set) = (direction(q, v, self)[self.layout.gap()].to_vec(), mode.closed);
        self.kinetics.solve_regular(set, |_, i| -gaps[i])?;
        self.kinetics.apply(set, q);
        let row = direction(q, v, self);
        let rates = self.gaps(&row, w, v);
        let set = match mode.stick.is_empty() {
            true => set,
            // feet of one body that stick determine each other
            false => self.kinetics.independent(self.kinetics.rows_of(mode)),
        };
        self.kinetics.solve_regular(set, |_, i| -rates[i][1])?;
        self.kinetics.apply(set, v);
        Ok(())
    }
}

// The mechanics with dry friction and its derivatives along any direction.
//
// With the rows `R` and the edges `C` of [`crate::friction`] in a mode, forces `lambda` by row and
// `r'` for the derivative of `r` along the direction
//
// ```text
// M a' - E^T x' = F' - M' a + sum_rows lambda R'^T - sum_slip (mu' lambda, L') sigma B^T      E^T = M C
// R a'          = -r' - R' a                                                                  (1)
// ```
//
// and the velocities after the impulses `P` of a pattern, whose rows have the rates `u` after it,
//
// ```text
// M w+' - E^T x' = M w-' - M' (w+ - w-) + sum_rows P R'^T - sum_slip mu' P sigma B^T
// R w+'          = u' - R' w+ - r_t'                                                          (2)
// ```

/// Weights of values at 1, 2, .. that extrapolate to 0.
const EXTRAPOLATION: [f64; 5] = [5.0, -10.0, 10.0, -5.0, 1.0];
/// So much farther than differences look the first of these values lies.
const APART: f64 = 1.05;

/// Impulses with friction and the data on which they depend.
pub(super) struct FrictionalImpulses<'a> {
    /// The contacts with impulses and the modes of friction there.
    pub(super) mode: ContactMode,
    /// Impulses by row.
    pub(super) impulses: &'a [f64],
    /// `w-` and `w+`.
    pub(super) before: &'a [f64],
    pub(super) after: &'a [f64],
    /// Derivatives of `mu` in impacts, by channel, if other than at the evaluation.
    pub(super) limits: Option<&'a [f64]>,
}

/// An impact with friction.
pub(super) struct RoughImpact {
    /// The contacts with an impulse and their modes.
    pub(super) pattern: ContactMode,
    /// Impulses by row.
    pub(super) impulses: Vec<f64>,
    /// Slips by channel: before it, and after it with their restitution.
    pub(super) slips: Vec<[f64; 2]>,
}

impl Local {
    /// Accelerations and forces in a mode with friction.
    pub(super) fn frictional_contact<E>(&mut self, mode: ContactMode) -> Result<(), Failure<E>> {
        self.kinetics.contact(mode)?;
        if self.kinetics.is_shared_motion {
            return Err(Failure::Status(Status::RedundantContacts));
        }
        self.edges = Some(self.kinetics.edges(mode)?);
        Ok(())
    }

    /// Limits of friction may depend on the size of the slip speed: where differences would look at slips of
    /// both signs, their derivatives are extrapolated from faster slips of the same sign.
    pub(super) fn differentiate_limits<E, D: DifferentiableDynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        (t, q, w): (f64, &[f64], &[f64]),
        mode: ContactMode,
    ) -> Result<(), Failure<E>> {
        let Some(reach) = model.dynamics.reach(self.by()) else { return Ok(()) };
        let (n, length) = (self.layout.n, self.layout.len());
        let t = model.smooth.nearest(t);
        for channel in mode.slipping().iter() {
            let row = self.kinetics.row(channel);
            let moves = |(j, reach): (usize, &f64)| {
                let at = &self.partials[j * length..][..length];
                let turned = dot(self.normal(at, row), w) + at[self.layout.rate()][row];
                let own = j.checked_sub(1 + n).filter(|&i| i < n);
                let own = own.map_or(0.0, |i| self.kinetics.normal(row)[i]);
                reach * (turned + own).abs()
            };
            let moved: Vec<f64> = reach.iter().enumerate().map(moves).collect();
            let span: f64 = moved.iter().sum();
            let slip = mode.sign(channel) * self.kinetics.rate(row, w);
            if slip > span || span == 0.0 {
                continue;
            }
            let push = mode.sign(channel) * APART * span / self.kinetics.d(row, row);
            let along = self.kinetics.mobility(row).to_vec();
            let mut found = vec![0.0; reach.len()];
            let mut partials = vec![0.0; reach.len() * length];
            for (k, weight) in EXTRAPOLATION.into_iter().enumerate() {
                let mut faster = w.to_vec();
                axpy(&mut faster, (k + 1) as f64 * push, &along);
                let at = TimedState { t, q, w: &faster };
                let by = self.by().to_vec();
                model.dynamics.partials(at, &by, &mut partials).map_err(Failure::Raised)?;
                for (found, at) in found.iter_mut().zip(partials.chunks_exact(length)) {
                    *found += weight * at[self.layout.limit()][channel];
                }
            }
            let at = self.layout.limit().start + channel;
            // a difference that does not move the slip does not look at both signs
            let turned = found.into_iter().enumerate().filter(|&(j, _)| moved[j] > 0.0);
            for (j, found) in turned {
                self.partials[j * length + at] = self.compliant_limit(channel, j, found);
            }
        }
        Ok(())
    }

    /// The edges of the last mode.
    fn take_edges<E>(&mut self) -> Result<Edges, Failure<E>> {
        self.edges.take().ok_or(Failure::Status(Status::Internal))
    }

    /// Adds the effect of turning rows and of the limits of friction on the forces.
    fn turn_forces(
        &self,
        mode: ContactMode,
        row: &[f64],
        (forces, limits, joints): (&[f64], &[f64], bool),
        to: &mut [f64],
    ) {
        for (i, force) in forces.iter().enumerate().filter(|it| *it.1 != 0.0) {
            axpy(to, *force, self.normal(row, i));
        }
        for channel in mode.slipping().iter() {
            let pressed = match self.kinetics.gap_of(channel) {
                Some(gap) => forces[gap],
                None if joints => 1.0,
                None => continue,
            };
            let change = -limits[channel] * mode.sign(channel) * pressed;
            if change != 0.0 {
                axpy(to, change, self.kinetics.normal(self.kinetics.row(channel)));
            }
        }
    }

    /// Equations (1) for the mode of the last kinetics: derivatives of the accelerations of
    /// coordinates and rows and of the forces by row.
    pub(super) fn frictional_acceleration<E>(
        &mut self,
        mode: ContactMode,
        row: &[f64],
    ) -> Result<(Vec<f64>, Vec<f64>), Failure<E>> {
        let (layout, edges) = (self.layout, self.take_edges()?);
        let (n, rows, mut forces) = (layout.n, layout.rows(), self.kinetics.lambda.clone());
        // those of compliant gaps are among the forces of the system
        self.kinetics.compliant().iter().for_each(|gap| forces[gap] = 0.0);
        let at = self.kinetics.acceleration[..n].to_vec();
        let limits = &row[layout.limit()];
        let mut change = row[layout.force()].to_vec();
        self.less_mass(row, &at, &mut change);
        self.turn_forces(mode, row, (&forces, limits, true), &mut change);
        self.kinetics.solve_mass(&mut change);
        let bends = &row[layout.curvature()];
        let turned: Vec<f64> =
            (0..rows).map(|i| bends[i] + dot(self.normal(row, i), &at)).collect();
        let kinetics = &self.kinetics;
        let solved = edges.solve(|i| -(turned[i] + dot(kinetics.normal(i), &change)));
        edges.push(&solved, &mut change);
        let mut by_row = vec![0.0; rows];
        edges.rows().iter().zip(&solved).for_each(|(&i, force)| by_row[i] = *force);
        for channel in mode.slipping().iter() {
            let (sign, limit) = (mode.sign(channel), kinetics.friction_limits(channel).0);
            by_row[kinetics.row(channel)] = -sign
                * match kinetics.gap_of(channel) {
                    Some(gap) => limits[channel] * forces[gap] + limit * by_row[gap],
                    None => limits[channel],
                };
        }
        self.add_contact_forces(row, &mut by_row);
        let mut of_rows: Vec<f64> =
            (0..rows).map(|i| turned[i] + dot(kinetics.normal(i), &change)).collect();
        edges.rows().iter().for_each(|&i| of_rows[i] = 0.0);
        change.extend(of_rows);
        self.edges = Some(edges);
        Ok((change, by_row))
    }

    /// `K` of a pattern of impulses.
    pub(super) fn prepare_pattern<E>(&mut self, mode: ContactMode) -> Result<(), Failure<E>> {
        self.edges = Some(self.kinetics.edges(mode)?);
        Ok(())
    }

    /// Equations (2) for a pattern that was prepared, with `w-'` in `velocities`, which `w+'` takes the place
    /// of, and the rates of the rows: those of the pattern become `target`, the others change by the impulses.
    pub(super) fn frictional_exchange<E>(
        &mut self,
        how: &FrictionalImpulses<'_>,
        row: &[f64],
        target: impl Fn(usize) -> f64,
        (velocities, rates): (&mut [f64], &mut [f64]),
    ) -> Result<(), Failure<E>> {
        let FrictionalImpulses { mode, impulses, before, after, limits } = *how;
        let (layout, edges) = (self.layout, self.take_edges()?);
        let jump: Vec<f64> =
            after.iter().zip(before).map(|(after, before)| after - before).collect();
        let mut change = vec![0.0; layout.n];
        self.less_mass(row, &jump, &mut change);
        let limits = limits.unwrap_or(&row[layout.limit()]);
        self.turn_forces(mode, row, (impulses, limits, false), &mut change);
        self.kinetics.solve_mass(&mut change);
        // the part of M w-' is solved for already
        let old = velocities.to_vec();
        let kinetics = &self.kinetics;
        let wanted = |i: usize| {
            let moves = dot(self.normal(row, i), after) + row[layout.rate()][i];
            let normal = kinetics.normal(i);
            target(i) - moves - dot(normal, &old) - dot(normal, &change)
        };
        let solved = edges.solve(wanted);
        edges.push(&solved, &mut change);
        axpy(velocities, 1.0, &change);
        for (i, rate) in rates.iter_mut().enumerate().take(layout.rows()) {
            *rate += dot(self.normal(row, i), &jump) + dot(kinetics.normal(i), &change);
        }
        edges.rows().iter().for_each(|&i| rates[i] = target(i));
        self.edges = Some(edges);
        Ok(())
    }
}
