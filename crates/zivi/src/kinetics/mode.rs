//! Mode of a mechanical system: contacts, and the next operation.
//!
//! The mode is the set of closed gaps and the modes of friction. Flight is motion without any
//! contact, and one equation serves all modes, so that there are no two cases with data of their
//! own as there are for a mass, whose rest needs no equation.

use crate::kinetics::equalities::Equalities;
use crate::kinetics::{Kinetics, Model};
use crate::numeric::bernstein::Bernstein;
use crate::numeric::coordinates;
use crate::numeric::grid::Probes;
use crate::numeric::stages::{worse, Equation, StepError, Tolerances};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::system::dynamics::{Dynamics, Layout};
use crate::zeno::table::ExtrapolatedEnd;

/// State of the gaps that touch or touched at the start of the last step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Contacts {
    /// Some stay closed; what friction does.
    pub(crate) mode: ContactMode,
    /// They open: they are not looked out for in the first step.
    pub(crate) left: GapSet,
    /// The channels that begin to slip: their slip does not end in the first step.
    pub(crate) released: GapSet,
    /// The channels with the force of slip whose slip speed stays zero, as the others hold them.
    pub(crate) spent: GapSet,
    /// The compliant gaps whose law changes its sign here: it does not change back immediately.
    pub(crate) turned: GapSet,
    /// Whether other modes with another motion obey the laws of contact.
    pub(crate) is_ambiguous: bool,
}

/// Limit of a mode: a number that must stay positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Limit {
    /// The contact force of a gap.
    Force(usize),
    /// The force of a channel that sticks, in this direction.
    Stick(usize, f64),
    /// The margin that all inequalities leave undetermined forces.
    Margin,
    /// The determinant of `K`.
    Regularity,
    /// The sign of the law of a compliant gap.
    Law(usize),
}

/// Next operation.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Next {
    /// A step, or the part of it up to an event.
    Step,
    /// The impact of these gaps, here.
    LocatedEvent(GapSet),
    /// The opening of a contact whose force vanishes here, or the end of sticking, in a step of the
    /// length `h`.
    Release { limit: Limit, h: f64 },
    /// The end of the slip in some channels.
    Stop(GapSet),
    /// The jump to where the impacts accumulate.
    Jump(Ahead),
}

impl Next {
    /// The jump, if the accumulation is known.
    pub(crate) fn jump(ahead: Option<Ahead>) -> Self {
        ahead.map_or(Self::Step, Self::Jump)
    }

    /// Whether something happens before the time moves on past `t_end`.
    pub(crate) fn is_due(&self, t_end: f64) -> bool {
        match self {
            Self::LocatedEvent(_) | Self::Release { .. } | Self::Stop(_) => true,
            Self::Jump(ahead) => ahead.landing.t <= t_end,
            Self::Step => false,
        }
    }
}

/// Key of bouncing gaps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Key {
    /// The gaps that are hit together.
    pub(crate) hit: GapSet,
    /// The mode of the flight between the impacts: which gaps stay closed.
    pub(crate) flight: ContactMode,
    /// The resulting mode; friction at the gaps that are hit has the mode of the impacts.
    pub(crate) landed: ContactMode,
}

/// Where impacts accumulate.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Ahead {
    pub(crate) landing: ExtrapolatedEnd<Vec<f64>>,
    /// The gaps that close together, except at a Zeno point of an impact sequence.
    pub(crate) corner: Option<GapSet>,
}

// The probes of contact forces along a motion with some gaps closed.

/// The probes of the motion with some gaps closed.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ContactProbes {
    pub(crate) probes: Probes,
    pub(crate) mode: ContactMode,
    /// How far the end of the run was ahead when they closed (s).
    pub(crate) horizon: f64,
}

/// The largest distance of two stages of a step that is explicit with order 8, or implicit.
const STAGES_APART: f64 = 0.31;

impl ContactProbes {
    /// Where a step from `t` to `until` at most ends at the latest, with these gaps closed.
    pub(crate) fn end(&mut self, mode: ContactMode, t: f64, until: f64) -> f64 {
        if mode != self.mode {
            *self = Self { mode, ..Self::default() };
        }
        self.horizon = self.horizon.max(until - t);
        self.probes.end(t, until)
    }

    /// How far the end of the run was ahead when these gaps closed (s).
    pub(crate) fn horizon(&self) -> f64 {
        self.horizon
    }

    /// Whether a step of length `h` from `t` is probed, up to `end` (s) after that, between its stages.
    pub(crate) fn want(&self, t: f64, end: f64, h: f64) -> bool {
        self.probes.wants(self.horizon, (t, end), STAGES_APART * h)
    }
}

// The mechanics along a step, between its stages.

/// Threshold for missed features in units of the tolerance, the accuracy of the polynomials.
pub(crate) const DEFECT: f64 = 100.0;

/// A complete step, evaluated at any part of it.
pub(crate) struct AlongStep<'r, 'm, D> {
    pub(crate) step: &'r Stages,
    pub(crate) mode: ContactMode,
    pub(crate) tolerances: &'r Tolerances,
    /// Whether directions in which something sticks turn or move in the step.
    pub(crate) turns: bool,
    /// The mechanics where they were evaluated last.
    pub(crate) aside: &'r mut Kinetics,
    pub(crate) model: &'r mut Model<'m, D>,
}

/// The polynomials of position and velocity over a step, of the coordinates and then the gaps.
pub(crate) type Rows = Vec<[Bernstein; 2]>;

impl<D> AlongStep<'_, '_, D> {
    /// The first `n` polynomials of the step.
    pub(crate) fn rows(&self, count: usize) -> Rows {
        (0..count).map(|c| self.step.polynomials_of(c)).collect()
    }

    /// Evaluates the system at a part of the step.
    pub(crate) fn evaluate<E>(&mut self, rows: &Rows, theta: f64) -> Result<(), Failure<E>>
    where
        D: Dynamics<E>,
    {
        let coordinates = rows[..self.aside.coordinates()].iter();
        let (q, w): (Vec<f64>, Vec<f64>) =
            coordinates.map(|[x, v]| (x.at(theta), v.at(theta))).unzip();
        let t = self.step.from.t + theta * self.step.h;
        self.aside.carry(self.mode.pressed);
        self.aside.evaluate(self.model, t, &q, &w)?;
        if self.aside.has_cones() {
            let Layout { n, .. } = self.aside.layout;
            let rate = |row: usize| self.step.polynomials_of(n + row)[1].at(theta);
            let rates: Vec<f64> = (0..self.aside.layout.rows()).map(rate).collect();
            self.aside.turn(&rates);
        }
        Ok(self.aside.contact(self.mode)?)
    }

    /// Defect of the polynomials in the equation of motion at a part of the step, as an error at
    /// its end relative to the tolerance. The system is evaluated there.
    pub(crate) fn defect<E>(&mut self, rows: &Rows, theta: f64) -> Result<f64, Failure<E>>
    where
        D: Dynamics<E>,
    {
        self.evaluate(rows, theta)?;
        let h = self.step.h;
        let defects = rows.iter().enumerate().map(|(c, [_, v])| {
            let defect = h * self.aside.acceleration[c] - v.slope(theta);
            let error = StepError { x: [h * defect, 0.0], xdot: [defect, 0.0], double: false };
            error.norm(self.step.scales(c, self.tolerances)) / DEFECT
        });
        Ok(defects.fold(0.0, worse))
    }
}

// The equation of motion with a set of gaps closed, `x'' = a(t, x, x')`, where `x` are the
// coordinates and the gaps.
//
// The gaps are integrated along: `g_k'' = b_k + D_kC lambda_C` costs no further evaluation, and
// keeps its relative precision where the difference `g(q)` has none left. With friction the slips `s`
// with `s' = w` follow them, and a last component whose rate is the work of friction.

/// A state at a time: `x` are the coordinates, then the gaps, `xdot` their rates.
pub(crate) type State = coordinates::State<Vec<f64>>;

/// A step.
pub(crate) type Stages = crate::numeric::stages::Stages<Vec<f64>>;

/// Data at the end of the last step: contact forces by row, limits of the mode; gaps, rates and
/// sums of gradients by row, from their functions.
#[derive(Clone, Debug)]
pub(crate) struct AtEnd {
    pub(crate) lambda: Vec<f64>,
    pub(crate) levels: Vec<f64>,
    pub(crate) gap: Vec<f64>,
    pub(crate) rate: Vec<f64>,
    pub(crate) steepness: Vec<f64>,
    /// Equality rows there, and the gradients of gaps and slips.
    pub(crate) equalities: Option<Box<(Equalities, Vec<f64>)>>,
    /// The limits at the stages, where contacts have two directions.
    pub(crate) ranges: StageRanges,
}

/// The least and the largest of each limit of the mode at the stages of a step and of its attempts, and whether
/// directions that stick turned.
#[derive(Clone, Debug, Default)]
pub(crate) struct StageRanges {
    limits: Vec<[f64; 2]>,
    directions: Option<Vec<f64>>,
    turns: bool,
    is_unknown: bool,
}

impl StageRanges {
    /// From the start of a step on, where the limits are these.
    pub(crate) fn begin(&mut self, levels: &[f64]) {
        self.limits.clear();
        self.limits.extend(levels.iter().map(|&level| [level; 2]));
        (self.directions, self.turns, self.is_unknown) = (None, false, false);
    }

    /// Includes the limits at a stage, where the forces have been computed.
    fn see(&mut self, kinetics: &mut Kinetics, mode: ContactMode) {
        if self.is_unknown || self.limits.is_empty() {
            return;
        }
        let levels = kinetics.limits(mode);
        self.is_unknown = !kinetics.undetermined.is_empty() || levels.len() != self.limits.len();
        for (range, level) in self.limits.iter_mut().zip(&levels) {
            *range = [range[0].min(level.value), worse(range[1], level.value)];
        }
        if !mode.stick.is_empty() {
            let now = kinetics.directions(mode.stick);
            self.turns |= self.directions.as_ref().is_some_and(|before| *before != now);
            self.directions = Some(now);
        }
    }

    /// Whether all limits stay far from zero: they vary by less than the least of them. Then whether directions turn.
    pub(crate) fn surely_positive(&self) -> Option<bool> {
        let far = |&[least, largest]: &[f64; 2]| least > 0.0 && largest - least < least;
        let is_sure = !self.is_unknown && !self.limits.is_empty();
        (is_sure && self.limits.iter().all(far)).then_some(self.turns)
    }
}

impl AtEnd {
    pub(crate) fn new(layout: Layout) -> Self {
        let (zeros, rate) = (vec![0.0; layout.m], vec![0.0; layout.rows()]);
        let (lambda, levels) = (vec![0.0; layout.forces()], Vec::new());
        let (gap, steepness, equalities) = (zeros.clone(), zeros, None);
        Self { lambda, levels, gap, rate, steepness, equalities, ranges: StageRanges::default() }
    }
}

/// The motion in a mode.
pub(crate) struct InContact<'r, 'm, D> {
    pub(crate) mode: ContactMode,
    pub(crate) kinetics: &'r mut Kinetics,
    pub(crate) model: &'r mut Model<'m, D>,
    /// Where what is known at the end of a step goes.
    pub(crate) at_end: Option<&'r mut AtEnd>,
}

impl<E, D: Dynamics<E>> Equation<Vec<f64>, Failure<E>> for InContact<'_, '_, D> {
    fn acceleration(&mut self, at: &State, into: &mut Vec<f64>) -> Result<(), Failure<E>> {
        let n = self.kinetics.coordinates();
        self.kinetics.carry(self.mode.pressed);
        self.kinetics.evaluate(self.model, at.t, &at.x[..n], &at.xdot[..n])?;
        self.kinetics.turn(&at.xdot[n..]);
        self.kinetics.contact(self.mode)?;
        into.copy_from_slice(&self.kinetics.acceleration);
        if let Some(power) = into.get_mut(n + self.kinetics.layout.rows()) {
            *power = self.kinetics.friction_power(self.mode, &at.xdot[n..]);
        }
        if let Some(end) = self.at_end.as_mut().filter(|_| self.kinetics.has_cones()) {
            end.ranges.see(self.kinetics, self.mode);
        }
        Ok(())
    }

    fn has_projection(&self) -> bool {
        self.kinetics.equalities().is_some()
    }

    fn project_errors(&self, errors: &mut [StepError]) {
        self.kinetics.project_errors(errors);
    }

    fn is_at_end(&mut self, at: &State) {
        let (Some(end), kinetics) = (&mut self.at_end, &mut self.kinetics) else { return };
        end.lambda.copy_from_slice(kinetics.forces());
        if let Some(rows) = kinetics.equalities() {
            let normals = (0..kinetics.layout.rows()).flat_map(|row| kinetics.normal(row));
            end.equalities = Some(Box::new((rows.clone(), normals.copied().collect())));
        }
        if self.mode.is_frictionless() && kinetics.undetermined.is_empty() {
            end.levels.clear();
            end.levels.extend(self.mode.closed.iter().map(|gap| end.lambda[gap]));
        } else {
            end.levels = kinetics.limits(self.mode).iter().map(|it| it.value).collect();
        }
        for gap in 0..end.gap.len() {
            end.gap[gap] = kinetics.gap(gap);
            end.steepness[gap] = kinetics.steepness(gap);
        }
        for row in 0..end.rate.len() {
            end.rate[row] = kinetics.rate(row, &at.xdot[..kinetics.coordinates()]);
        }
    }
}
