//! The mechanics at one state: free accelerations, mobilities of the gaps, forces of contact.
//!
//! ```text
//! A = M^-1 F      b_i = n_i . A + h_i      D_ij = n_i . M^-1 n_j                          (1)
//! contacts C:     lambda_C = -D_CC^-1 b_C      q'' = A + M^-1 N_C^T lambda_C              (2)
//!                 g_k'' = b_k + D_kC lambda_C
//! ```
//!
//! The force of a compliant gap is no unknown of (2): while it is pressed, `N^T lambda` belongs to `F`.
//!
//! The slip in a channel of friction is one more row below those of the gaps, with `B_c` for `n_i`. How
//! friction enters (2) is [`crate::friction`]. Equality rows are eliminated from `A` and `M^-1 n_i`
//! ([`equalities`]).

pub(crate) mod equalities;
pub(crate) mod lcp;
mod manifold;
pub(crate) mod mode;
pub(crate) mod shares;

use crate::kinetics::equalities::Equalities;
use crate::numeric::cholesky;
use crate::numeric::cholesky::Factor;
use crate::numeric::dense::{axpy, dot, largest, sum_of_products};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::system::dynamics::{Dynamics, Layout};
use crate::system::force::{ContactForce, Friction, Smooth};
use crate::Status;

/// A system whose evaluations are counted, between its non-smooth times.
pub(crate) struct Model<'a, D> {
    pub(crate) dynamics: &'a mut D,
    pub(crate) count: u64,
    /// It is evaluated at no times outside.
    pub(crate) smooth: Smooth,
}

impl<'a, D> Model<'a, D> {
    pub(crate) fn new(dynamics: &'a mut D) -> Self {
        Self { dynamics, count: 0, smooth: Smooth::ALWAYS }
    }

    /// The equality rows at a state, which are no evaluation where they need no forces.
    pub(crate) fn evaluate_equalities<E>(
        &mut self,
        t: f64,
        (q, w): (&[f64], &[f64]),
        values: &mut [f64],
    ) -> Result<(), Failure<E>>
    where
        D: Dynamics<E>,
    {
        let t = self.smooth.nearest(t);
        self.count += u64::from(!self.dynamics.has_separate_equalities());
        self.dynamics.evaluate_equalities(t, q, w, values).map_err(Failure::Raised)?;
        check_finite(values)
    }

    /// The contact force of a compliant gap whose law is a function. Above zero, where the law need not have a
    /// value, its values below are reflected at that at zero, so that no step sees a kink there.
    pub(crate) fn contact_force<E>(
        &mut self,
        gap: usize,
        depth: f64,
        rate: f64,
    ) -> Result<f64, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let mut at = |depth: f64| {
            let force = self.dynamics.contact_force(gap, depth, rate);
            force.map_err(Failure::Raised)
        };
        match depth >= 0.0 {
            true => at(depth),
            false => Ok(2.0 * at(0.0)? - at(-depth)?),
        }
    }
}

/// Contact forces by gap, then those of friction by channel and the multipliers of equality rows, with velocities
/// in a mode, whose closed gaps are those in contact: of those that the motion does not determine the least within their limits. The system
/// gives its numbers at one state.
///
/// # Errors
///
/// Why there are none.
pub fn contact_forces<E>(
    system: &mut impl Dynamics<E>,
    w: &[f64],
    mode: ContactMode,
) -> Result<Vec<f64>, Failure<E>> {
    let mut kinetics = Kinetics::new(system.layout(), system.friction());
    let compliant = kinetics.compliant();
    let pressed = mode.closed.iter().filter(|&gap| compliant.has(gap)).collect();
    let mode = ContactMode { closed: mode.closed.without(pressed), pressed, ..mode };
    kinetics.carry(pressed);
    kinetics.evaluate(&mut Model::new(system), 0.0, w, w)?;
    let rates: Vec<f64> = (0..kinetics.layout.rows()).map(|row| kinetics.rate(row, w)).collect();
    kinetics.turn(&rates);
    kinetics.contact(mode)?;
    kinetics.share_least(mode);
    Ok(kinetics.forces().to_vec())
}

/// Kinetic quantities at one state.
#[derive(Clone, Debug)]
pub(crate) struct Kinetics {
    pub(crate) layout: Layout,
    /// Gaps of the channels, and channels of the gaps.
    gap_of: Vec<Option<usize>>,
    channel_of: Vec<Option<usize>>,
    /// The other channel of a gap with friction in two directions, by channel.
    other: Vec<Option<usize>>,
    /// The direction of slip in such a pair, by channel, and those that do not turn.
    heading: Vec<f64>,
    frozen: GapSet,
    pub(crate) values: Vec<f64>,
    /// Where the gradients begin in them, and the curvatures.
    gradient: usize,
    curvature: usize,
    /// The same for forces and partial time derivatives of the gaps.
    force: usize,
    of_time: usize,
    /// `L L^T = M`.
    pub(crate) factor: Factor,
    /// Whether `M` and the normals never change and are known.
    is_constant: bool,
    /// Whether the forces, `A` and `b` are those of the last evaluation.
    has_forces: bool,
    /// Time and coordinates of the last evaluation, where `M` and the normals never change.
    place: Vec<f64>,
    /// `A`.
    free: Vec<f64>,
    /// `b`, by row.
    b: Vec<f64>,
    /// The rows `M^-1 n_i` and `D_ii`, with the number of their evaluation.
    mobility: Vec<f64>,
    diagonal: Vec<f64>,
    /// Their square roots, NaN if undefined.
    pub(crate) roots: Vec<f64>,
    known: Vec<u64>,
    evaluation: u64,
    /// Cached values of [`Self::coupling`] by row, for constant `M` and normals; otherwise NaN.
    couplings: Vec<f64>,
    /// `D_CC` of some set, then its factor.
    small: Vec<f64>,
    /// Of which rows the factor of `D` is in it.
    factored: Option<GapSet>,
    right: Vec<f64>,
    /// The rows of that set.
    order: Vec<usize>,
    /// Contact forces by gap, zero without contact, then friction forces by channel.
    pub(crate) lambda: Vec<f64>,
    /// `q''`, `g''` and `w'`, followed by a place for the friction power.
    pub(crate) acceleration: Vec<f64>,
    /// Directions by row in which contact forces may change without changing the motion.
    pub(crate) undetermined: Vec<Vec<f64>>,
    /// Whether the motion depends on how contacts share their forces.
    pub(crate) is_shared_motion: bool,
    /// The compliant gaps, if there are any.
    compliant: Option<Box<Compliant>>,
    /// The equality rows, if there are any.
    equalities: Option<Box<Equalities>>,
}

/// The compliant gaps of a system at one state.
#[derive(Clone, Debug)]
struct Compliant {
    laws: Vec<(usize, ContactForce)>,
    /// The same gaps.
    all: GapSet,
    /// Those whose forces are in `A` and `b`.
    pressed: GapSet,
    /// Contact forces by gap.
    forces: Vec<f64>,
    /// `A` and `b` without these forces.
    free: Vec<f64>,
    b: Vec<f64>,
    /// The gaps of channels at compliant gaps: `mu` times the force is the limit of such a channel.
    gap_of: Vec<Option<usize>>,
    /// The coefficients of these channels, in slip and in stick.
    coefficients: Vec<(f64, f64)>,
}

impl Compliant {
    fn new(layout: Layout, friction: &Friction) -> Option<Box<Self>> {
        if friction.compliant.is_empty() {
            return None;
        }
        let all: GapSet = friction.compliant.iter().map(|it| it.0).collect();
        let is_soft = |gap: Option<usize>| gap.filter(|&gap| all.has(gap));
        Some(Box::new(Self {
            laws: friction.compliant.clone(),
            all,
            pressed: GapSet::EMPTY,
            forces: vec![0.0; layout.m],
            free: vec![0.0; layout.n],
            b: vec![0.0; layout.rows()],
            gap_of: friction.channels.iter().map(|it| is_soft(it.gap)).collect(),
            coefficients: vec![(0.0, 0.0); layout.p],
        }))
    }
}

/// Left of a diagonal entry of `D_CC` by the other gaps: below this they determine it.
const REDUNDANT: f64 = 1e-10;
/// A mass matrix is rejected if its asymmetry exceeds this, relative to its diagonal.
const SKEW: f64 = 1e-8;
/// Kinetic cosines below this are rounding.
const ORTHOGONAL: f64 = 1e-12;
/// Rounding of an acceleration or a speed of a gap, relative to its terms.
const NOISE: f64 = 256.0 * f64::EPSILON;
/// Rounding of accelerations and velocities in contact, relative to those without.
const LEFT: f64 = 16.0 * f64::EPSILON;

/// Sets to zero what is rounding of the numbers that it comes from.
pub(crate) fn without_rounding(values: &mut [f64], of: &[f64]) {
    for (value, of) in values.iter_mut().zip(of) {
        if value.abs() <= LEFT * of.abs() {
            *value = 0.0;
        }
    }
}

/// An error where a number is not finite.
#[inline]
fn check_finite<E>(values: &[f64]) -> Result<(), Failure<E>> {
    // without an early end several are tested at once
    match values.iter().fold(true, |finite, value| finite & value.is_finite()) {
        true => Ok(()),
        false => Err(Failure::Status(Status::ForceNotFinite)),
    }
}

impl Kinetics {
    pub(crate) fn new(layout: Layout, friction: &Friction) -> Self {
        let (Layout { n, m, .. }, rows) = (layout, layout.rows());
        let zeros = |length: usize| vec![0.0; length];
        let compliant = Compliant::new(layout, friction);
        let is_rigid = |gap: &usize| !compliant.as_ref().is_some_and(|it| it.all.has(*gap));
        let gap_of: Vec<Option<usize>> =
            friction.channels.iter().map(|c| c.gap.filter(is_rigid)).collect();
        let channel_of = (0..m).map(|i| gap_of.iter().position(|&gap| gap == Some(i))).collect();
        let same = |c: usize, i: usize| i != c && gap_of[i].is_some() && gap_of[i] == gap_of[c];
        let other = (0..gap_of.len()).map(|c| (0..gap_of.len()).find(|&i| same(c, i))).collect();
        let heading = vec![0.0; gap_of.len()];
        Self {
            layout,
            gap_of,
            channel_of,
            other,
            heading,
            frozen: GapSet::EMPTY,
            values: zeros(layout.len()),
            gradient: layout.gradient().start,
            curvature: layout.curvature().start,
            force: layout.force().start,
            of_time: layout.rate().start,
            factor: Factor::new(n),
            is_constant: false,
            has_forces: false,
            place: vec![],
            free: zeros(n),
            b: zeros(rows),
            mobility: zeros(rows * n),
            diagonal: zeros(rows),
            roots: zeros(rows),
            known: vec![0; rows],
            evaluation: 0,
            couplings: vec![],
            small: zeros(rows * rows),
            factored: None,
            right: zeros(rows),
            order: Vec::with_capacity(rows),
            lambda: zeros(rows),
            acceleration: zeros(layout.size()),
            undetermined: Vec::new(),
            is_shared_motion: false,
            compliant,
            equalities: Self::rows_of_equality(layout),
        }
    }

    /// Evaluates the system, and `A` and `b` of equation (1).
    pub(crate) fn evaluate<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        t: f64,
        q: &[f64],
        w: &[f64],
    ) -> Result<(), Failure<E>> {
        let t = model.smooth.nearest(t);
        model.count += 1;
        if self.is_constant {
            self.stand_at(t, q);
            model.dynamics.evaluate_again(t, q, w, &mut self.values).map_err(Failure::Raised)?;
            check_finite(&self.values[self.force..self.gradient])?;
            check_finite(&self.values[self.curvature..])?;
        } else {
            let layout = self.layout;
            model.dynamics.evaluate(t, q, w, &mut self.values).map_err(Failure::Raised)?;
            check_finite(&self.values)?;
            let mass = &self.values[layout.mass()];
            if !self.factor.is_of(mass) && !self.factor.renew(mass, is_symmetric(mass, layout.n)) {
                return Err(Failure::Status(Status::MassNotDefinite));
            }
            self.evaluation += 1;
            self.factored = None;
            self.renew_equalities();
            self.is_constant = model.dynamics.has_constant_matrices();
        }
        let n = self.layout.n;
        self.free.copy_from_slice(&self.values[self.force..][..n]);
        self.factor.solve(&mut self.free);
        if self.equalities.is_some() {
            self.hold_free()?;
        }
        let normals = self.values[self.gradient..].chunks_exact(n);
        let curvatures = &self.values[self.curvature..];
        for ((b, normal), curvature) in self.b.iter_mut().zip(normals).zip(curvatures) {
            *b = dot(normal, &self.free) + curvature;
        }
        self.has_forces = true;
        match self.compliant.take() {
            None => Ok(()),
            Some(mut compliant) => {
                let evaluated = self.evaluate_compliant(&mut compliant, model, w);
                self.compliant = Some(compliant);
                self.add_compliant();
                evaluated
            }
        }
    }

    /// The forces of the pressed gaps.
    fn evaluate_compliant<E, D: Dynamics<E>>(
        &mut self,
        compliant: &mut Compliant,
        model: &mut Model<'_, D>,
        w: &[f64],
    ) -> Result<(), Failure<E>> {
        compliant.free.copy_from_slice(&self.free);
        compliant.b.copy_from_slice(&self.b);
        for &(gap, law) in compliant.laws.iter().filter(|it| compliant.pressed.has(it.0)) {
            let (depth, rate) = (-self.gap(gap), -self.rate(gap, w));
            let force = match law.at(depth, rate) {
                Some(force) => force,
                None => model.contact_force(gap, depth, rate)?,
            };
            check_finite(&[force])?;
            compliant.forces[gap] = force;
        }
        for (channel, limits) in compliant.coefficients.iter_mut().enumerate() {
            *limits = self.friction_limits(channel);
        }
        Ok(())
    }

    /// The compliant gaps.
    pub(crate) fn compliant(&self) -> GapSet {
        self.compliant.as_ref().map_or(GapSet::EMPTY, |it| it.all)
    }

    /// From here on these compliant gaps push: the next evaluation has their forces.
    #[inline]
    pub(crate) fn carry(&mut self, pressed: GapSet) {
        if let Some(compliant) = &mut self.compliant {
            compliant.pressed = pressed;
        }
    }

    /// `A` and `b` with the forces of the pressed gaps, and the friction limits there.
    fn add_compliant(&mut self) {
        let Some(compliant) = self.compliant.take() else { return };
        self.free.copy_from_slice(&compliant.free);
        self.b.copy_from_slice(&compliant.b);
        let n = self.layout.n;
        for gap in compliant.pressed.iter() {
            self.mobility(gap);
            axpy(&mut self.free, compliant.forces[gap], &self.mobility[gap * n..][..n]);
        }
        if !compliant.pressed.is_empty() {
            for row in 0..self.b.len() {
                self.b[row] = dot(self.normal(row), &self.free) + self.curvature(row);
            }
        }
        for (channel, gap) in compliant.gap_of.iter().enumerate() {
            let Some(gap) = *gap else { continue };
            let force =
                if compliant.pressed.has(gap) { compliant.forces[gap].max(0.0) } else { 0.0 };
            let (slip, stick) = compliant.coefficients[channel];
            self.set_friction_limit(channel, slip * force);
            let at = self.layout.static_limit().start + channel;
            self.values[at] = stick * force;
        }
        self.compliant = Some(compliant);
    }

    /// Writes the forces of the pressed gaps into the contact forces.
    pub(crate) fn note_compliant(&mut self) {
        if let Some(compliant) = &self.compliant {
            for gap in compliant.pressed.iter() {
                self.lambda[gap] = compliant.forces[gap];
            }
        }
    }

    /// The force of a compliant gap at the last evaluation, none unless it is pressed.
    pub(crate) fn contact_force(&self, gap: usize) -> f64 {
        let compliant = self.compliant.as_ref().filter(|it| it.pressed.has(gap));
        compliant.map_or(0.0, |it| it.forces[gap])
    }

    /// The gap whose force a channel has friction with, rigid or compliant; none of a joint.
    pub(crate) fn pressing_gap(&self, channel: usize) -> Option<usize> {
        self.gap_of(channel).or_else(|| self.compliant_friction(channel).map(|it| it.0))
    }

    /// The compliant gap of a channel, and the coefficients in slip and in stick.
    pub(crate) fn compliant_friction(&self, channel: usize) -> Option<(usize, (f64, f64))> {
        let compliant = self.compliant.as_ref()?;
        compliant.gap_of[channel].map(|gap| (gap, compliant.coefficients[channel]))
    }

    /// Whether the law of a closed compliant gap would be tensile with this value and rate.
    pub(crate) fn pulls<E, D: Dynamics<E>>(
        &self,
        gap: usize,
        (value, rate): (f64, f64),
        model: &mut Model<'_, D>,
    ) -> Result<bool, Failure<E>> {
        let Some(law) = self.law(gap) else { return Ok(false) };
        Ok(match (law.sign(), law) {
            // its force vanishes at zero, and its sign does not
            (Some([of_1, of_g, of_rate]), _) => of_1 + of_g * value + of_rate * rate < 0.0,
            (None, ContactForce::Function) => model.contact_force(gap, -value, -rate)? < 0.0,
            (None, _) => false,
        })
    }

    /// The law of a compliant gap.
    pub(crate) fn law(&self, gap: usize) -> Option<ContactForce> {
        let laws = self.compliant.as_ref().map_or(&[][..], |it| &it.laws);
        laws.iter().find(|it| it.0 == gap).map(|it| it.1)
    }

    /// Whether a channel without a rigid gap has friction: a joint or a pressed compliant gap.
    pub(crate) fn is_loaded(&self, channel: usize) -> bool {
        let Some(compliant) = &self.compliant else { return true };
        compliant.gap_of[channel].is_none_or(|gap| compliant.pressed.has(gap))
    }

    /// Keeps where the system is evaluated.
    fn stand_at(&mut self, t: f64, q: &[f64]) {
        self.place.clear();
        self.place.push(t);
        self.place.extend_from_slice(q);
    }

    /// The same, where `M` and the normals never change without the forces: [`Self::complete`] adds them.
    pub(crate) fn evaluate_gaps<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        t: f64,
        q: &[f64],
        w: &[f64],
    ) -> Result<(), Failure<E>> {
        if !self.is_constant {
            return self.evaluate(model, t, q, w);
        }
        let t = model.smooth.nearest(t);
        self.has_forces = false;
        if self.place.first() == Some(&t) && self.place[1..] == *q {
            return Ok(());
        }
        self.stand_at(t, q);
        model.dynamics.evaluate_gaps(t, q, w, &mut self.values).map_err(Failure::Raised)?;
        check_finite(&self.values[self.layout.gap()])?;
        check_finite(&self.values[self.curvature..])
    }

    /// The same where that is asked for by time alone: of a linear system the rates and curvatures of the
    /// gaps. Their values are not known then.
    pub(crate) fn evaluate_walls<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        t: f64,
        q: &[f64],
        w: &[f64],
    ) -> Result<(), Failure<E>> {
        let Some(system) = model.dynamics.linear().filter(|_| self.is_constant) else {
            return self.evaluate_gaps(model, t, q, w);
        };
        let t = model.smooth.nearest(t);
        self.forget_place();
        for (i, gap) in system.gaps.iter().enumerate() {
            let [_, rate, acceleration] = gap.motion.at(t);
            self.values[self.of_time + i] = -rate;
            self.values[self.curvature + i] = -acceleration;
        }
        Ok(())
    }

    /// The same of one gap, the value of which is known then.
    pub(crate) fn evaluate_gap<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        i: usize,
        (t, q, w): (f64, &[f64], &[f64]),
    ) -> Result<(), Failure<E>> {
        let Some(system) = model.dynamics.linear().filter(|_| self.is_constant) else {
            return self.evaluate_gaps(model, t, q, w);
        };
        let gap = &system.gaps[i];
        let [place, rate, _] = gap.motion.at(model.smooth.nearest(t));
        self.forget_place();
        self.values[self.of_time + i] = -rate;
        let value = &mut self.values[self.layout.gap()][i];
        *value = sum_of_products(&gap.normal, q) + gap.offset - place;
        check_finite(std::slice::from_ref(value))
    }

    /// Coordinates move: the gaps and forces are those of another place.
    pub(crate) fn forget_place(&mut self) {
        self.has_forces = false;
        self.place.clear();
    }

    /// Evaluates the forces, where [`Self::evaluate_gaps`] has left them out.
    pub(crate) fn complete<E, D: Dynamics<E>>(
        &mut self,
        model: &mut Model<'_, D>,
        t: f64,
        q: &[f64],
        w: &[f64],
    ) -> Result<(), Failure<E>> {
        match self.has_forces {
            true => Ok(()),
            false => self.evaluate(model, t, q, w),
        }
    }

    /// Whether [`Self::evaluate_gaps`] leaves the forces out.
    pub(crate) fn is_constant(&self) -> bool {
        self.is_constant
    }

    /// `q''`, then `g''`, without what rounding leaves of `q''` in contact: over a long time it is a way.
    pub(crate) fn accelerations(&self) -> Vec<f64> {
        let mut all = vec![];
        self.append_accelerations(&mut all);
        all
    }

    /// The same, appended to the present entries.
    pub(crate) fn append_accelerations(&self, to: &mut Vec<f64>) {
        let first = to.len();
        to.extend_from_slice(&self.acceleration);
        without_rounding(&mut to[first..], &self.free);
    }

    /// How many coordinates there are.
    pub(crate) fn coordinates(&self) -> usize {
        self.layout.n
    }

    /// `x <- M^-1 x`.
    pub(crate) fn solve_mass(&self, x: &mut [f64]) {
        self.factor.solve(x);
    }

    /// `g_i`.
    pub(crate) fn gap(&self, i: usize) -> f64 {
        self.values[self.layout.gap()][i]
    }

    /// `n_i`.
    pub(crate) fn normal(&self, i: usize) -> &[f64] {
        let n = self.layout.n;
        &self.values[self.gradient + i * n..][..n]
    }

    /// The row of a channel.
    pub(crate) fn row(&self, channel: usize) -> usize {
        self.layout.m + channel
    }

    /// The gap of a channel; none for a joint.
    pub(crate) fn gap_of(&self, channel: usize) -> Option<usize> {
        self.gap_of[channel]
    }

    /// The channel of a gap, if it has friction.
    pub(crate) fn channel_of(&self, gap: usize) -> Option<usize> {
        self.channel_of[gap]
    }

    /// The channels of a gap: two of them are the directions of one cone.
    pub(crate) fn channels_of(&self, gap: usize) -> impl Iterator<Item = usize> {
        let first = self.channel_of[gap];
        first.into_iter().chain(first.and_then(|channel| self.other[channel]))
    }

    /// The other direction of the cone of a channel, if there are two.
    pub(crate) fn other_of(&self, channel: usize) -> Option<usize> {
        self.other[channel]
    }

    /// The channels of a set that are the first of two, with the second.
    pub(crate) fn cones(&self, channels: GapSet) -> impl Iterator<Item = [usize; 2]> + '_ {
        let pair = |c: usize| self.other[c].filter(|&other| c < other).map(|other| [c, other]);
        channels.iter().filter_map(pair)
    }

    /// Whether a gap has friction in two directions.
    pub(crate) fn has_cones(&self) -> bool {
        self.other.iter().any(Option::is_some)
    }

    /// The part of a slip in a channel: its sign, or the component of its direction.
    pub(crate) fn sign(&self, mode: ContactMode, channel: usize) -> f64 {
        match self.other[channel] {
            Some(_) if mode.slip_plus.has(channel) => self.heading[channel],
            _ => mode.sign(channel),
        }
    }

    /// The slip in both channels of a cone has this direction.
    pub(crate) fn head(&mut self, [first, second]: [usize; 2], [c, s]: [f64; 2]) {
        (self.heading[first], self.heading[second]) = (c, s);
    }

    /// The directions of slip.
    pub(crate) fn headings(&self) -> &[f64] {
        &self.heading
    }

    /// Takes the directions of slip from elsewhere.
    pub(crate) fn take_headings(&mut self, of: &[f64]) {
        self.heading.copy_from_slice(of);
    }

    /// The directions of slip in these channels stay as they are.
    pub(crate) fn freeze(&mut self, channels: GapSet) {
        self.frozen = channels;
    }

    /// The channels whose directions of slip stay as they are.
    pub(crate) fn frozen(&self) -> GapSet {
        self.frozen
    }

    /// Turns the directions of slip to those of the rates by row, where these are not zero and directions are
    /// not frozen.
    pub(crate) fn turn(&mut self, rates: &[f64]) {
        let m = self.layout.m;
        for c in 0..self.other.len() {
            let Some(other) = self.other[c].filter(|&other| c < other) else { continue };
            if self.frozen.has(c) {
                continue;
            }
            let slip = [rates[m + c], rates[m + other]];
            let speed = slip[0].hypot(slip[1]);
            if speed > 0.0 {
                self.head([c, other], slip.map(|it| it / speed));
            }
        }
    }

    /// Limits of friction in a channel while slipping and while sticking: `mu` of a gap, the force
    /// of a joint.
    pub(crate) fn friction_limits(&self, channel: usize) -> (f64, f64) {
        let [slip, stick] = [self.layout.limit(), self.layout.static_limit()];
        (self.values[slip][channel], self.values[stick][channel])
    }

    /// Until the next evaluation, what limits friction in a channel while it slips.
    pub(crate) fn set_friction_limit(&mut self, channel: usize, limit: f64) {
        let at = self.layout.limit().start + channel;
        self.values[at] = limit;
    }

    /// `h_i`.
    pub(crate) fn curvature(&self, i: usize) -> f64 {
        self.values[self.curvature + i]
    }

    /// `g_i' = n_i . w + g_t`.
    pub(crate) fn rate(&self, i: usize, w: &[f64]) -> f64 {
        dot(self.normal(i), w) + self.values[self.of_time + i]
    }

    /// How much `g_i` may change with the coordinates: the sum of `|n_i|`.
    pub(crate) fn steepness(&self, i: usize) -> f64 {
        self.normal(i).iter().map(|n| n.abs()).sum()
    }

    /// Rounding errors of `g_i` (from the coordinates) and `g_i'` (from the velocities).
    pub(crate) fn rounding(&self, i: usize, q: &[f64], w: &[f64]) -> (f64, f64) {
        let (slope, rate) = (self.steepness(i), self.values[self.of_time + i].abs());
        let scale = 16.0 * f64::EPSILON;
        (scale * slope * largest(q), scale * (slope * largest(w) + rate))
    }

    /// Rounding error of `b_i`. No part of `n . A` is larger than `|n| |A|` in the metric of
    /// the masses, `sqrt(D_ii A . F)`, and also where the forces on the gap itself are nothing but
    /// rounding (drag at a speed that is zero but for it), this is its measure.
    pub(crate) fn noise(&mut self, i: usize) -> f64 {
        let work = dot(&self.free, &self.values[self.layout.force()]);
        let sizes = self.sizes_of_free().unwrap_or(&self.free);
        let terms = self.normal(i).iter().zip(sizes).map(|(n, a)| (n * a).abs());
        let size = terms.sum::<f64>().max((self.d(i, i) * work).sqrt());
        NOISE * (size + self.curvature(i).abs())
    }

    /// The size of the terms of an acceleration of a row.
    pub(crate) fn acceleration_scale(&mut self, row: usize) -> f64 {
        let joints = (0..self.gap_of.len()).filter(|&c| self.gap_of[c].is_none());
        let rows: Vec<(usize, f64)> =
            joints.map(|c| (self.row(c), self.friction_limits(c).1)).collect();
        let of_joints: f64 = rows.into_iter().map(|(j, force)| self.d(row, j).abs() * force).sum();
        self.noise(row) / NOISE + of_joints
    }

    /// `M^-1 n_i`.
    #[inline]
    pub(crate) fn mobility(&mut self, i: usize) -> &[f64] {
        if self.known[i] != self.evaluation {
            self.find_mobility(i);
        }
        self.known_mobility(i)
    }

    fn find_mobility(&mut self, i: usize) {
        let n = self.layout.n;
        let row = &mut self.mobility[i * n..][..n];
        row.copy_from_slice(&self.values[self.gradient + i * n..][..n]);
        self.factor.solve(row);
        if self.equalities.is_some() {
            self.hold_mobility(i);
        }
        let d = dot(self.normal(i), self.known_mobility(i));
        self.diagonal[i] = d;
        self.roots[i] = if d > 0.0 && d < f64::INFINITY { d.sqrt() } else { f64::NAN };
        self.known[i] = self.evaluation;
    }

    fn known_mobility(&self, i: usize) -> &[f64] {
        let n = self.layout.n;
        &self.mobility[i * n..][..n]
    }

    /// `D_ij`.
    #[inline]
    pub(crate) fn d(&mut self, i: usize, j: usize) -> f64 {
        self.mobility(j);
        match i == j {
            true => self.diagonal[i],
            false => dot(self.normal(i), self.known_mobility(j)),
        }
    }

    /// `D_ij`, zero where the gaps are orthogonal to rounding.
    pub(crate) fn coupling(&mut self, i: usize, j: usize) -> f64 {
        let at = i * self.b.len() + j;
        if let Some(known) = self.couplings.get(at).filter(|known| !known.is_nan()) {
            return *known;
        }
        let diagonal = [self.d(i, i), self.d(j, j)];
        let coupling = self.coupling_beside(i, j, diagonal);
        if self.is_constant {
            self.couplings.resize(self.b.len() * self.b.len(), f64::NAN);
            self.couplings[at] = coupling;
        }
        coupling
    }

    /// The same relative to `D_ii` and `D_jj`.
    pub(crate) fn coupling_beside(&mut self, i: usize, j: usize, [of_i, of_j]: [f64; 2]) -> f64 {
        if i == j {
            return of_i;
        }
        let d = self.d(i, j);
        if d.abs() < ORTHOGONAL * (of_i * of_j).sqrt() {
            0.0
        } else {
            d
        }
    }

    /// The kinetic cosine of two gaps.
    pub(crate) fn cosine(&mut self, i: usize, j: usize) -> f64 {
        self.d(i, j) / (self.d(i, i) * self.d(j, j)).sqrt()
    }

    /// `x = D_CC^-1 r` with the right sides by row; where contacts follow from others, one of all
    /// solutions, if there are any.
    pub(crate) fn solve(
        &mut self,
        set: GapSet,
        right: impl Fn(&Self, usize) -> f64,
    ) -> Result<(), Undetermined> {
        match self.solve_regular(set, &right) {
            Ok(()) => Ok(()),
            Err(_) => self.solve_dependent(set, right),
        }
    }

    /// The same where none follows from the others.
    pub(crate) fn solve_regular(
        &mut self,
        set: GapSet,
        right: impl Fn(&Self, usize) -> f64,
    ) -> Result<(), Undetermined> {
        if let Some(gap) = set.only() {
            let right = right(self, gap);
            self.right[0] = self.impulse(gap, right)?;
            return Ok(());
        }
        if self.factored == Some(set) && self.is_constant && self.layout.p == 0 {
            return self.solve_again(set, right);
        }
        self.factored = None;
        self.order.clear();
        self.order.extend(set.iter());
        let k = self.order.len();
        for row in 0..k {
            let i = self.order[row];
            self.mobility(i);
            for column in 0..=row {
                let j = self.order[column];
                self.small[row * k + column] = dot(self.normal(i), self.known_mobility(j));
            }
            self.right[row] = right(self, i);
        }
        let left = cholesky::factor(&mut self.small[..k * k], k);
        if left < REDUNDANT || left.is_nan() {
            return Err(Undetermined::Contacts);
        }
        self.factored = Some(set);
        cholesky::solve(&self.small[..k * k], k, &mut self.right[..k]);
        Ok(())
    }

    /// The same on the set for which [`Self::solve_regular`] has solved last, at the same state.
    fn solve_again(
        &mut self,
        set: GapSet,
        right: impl Fn(&Self, usize) -> f64,
    ) -> Result<(), Undetermined> {
        if set.only().is_some() {
            return self.solve_regular(set, right);
        }
        let k = self.order.len();
        for row in 0..k {
            self.right[row] = right(self, self.order[row]);
        }
        cholesky::solve(&self.small[..k * k], k, &mut self.right[..k]);
        Ok(())
    }

    /// Impulse on a gap alone that changes its rate by `change`.
    #[inline]
    pub(crate) fn impulse(&mut self, gap: usize, change: f64) -> Result<f64, Undetermined> {
        self.mobility(gap);
        let root = self.roots[gap];
        if root.is_nan() {
            return Err(Undetermined::Contacts);
        }
        // to the last bit as by the factor of a matrix
        Ok(change / root / root)
    }

    /// Adds what has to act on a gap alone to change its rate by so much, times `M^-1 n`, to a vector.
    pub(crate) fn push(
        &mut self,
        gap: usize,
        change: f64,
        vector: &mut [f64],
    ) -> Result<(), Undetermined> {
        let size = self.alone(gap, change)?;
        axpy(vector, size, self.known_mobility(gap));
        Ok(())
    }

    /// [`Self::solve`] for one gap.
    pub(crate) fn alone(&mut self, gap: usize, right: f64) -> Result<f64, Undetermined> {
        if let Ok(size) = self.impulse(gap, right) {
            return Ok(size);
        }
        self.solve_dependent(GapSet::of(gap), |_, _| right)?;
        Ok(self.right[0])
    }

    /// Whether impacts on the gaps `hit`, with the friction of a mode, press its other contacts:
    /// the impulses there, `K^-1` times the changes of the speeds, are not negative.
    pub(crate) fn impacts_press(
        &mut self,
        hit: GapSet,
        mode: ContactMode,
    ) -> Result<bool, Undetermined> {
        let (set, rate) = (mode.closed, |row: usize| f64::from(u8::from(hit.has(row))));
        let impulses: Vec<(usize, f64)> = if mode.is_frictionless() {
            let impulses = match self.solve_regular(set, |_, i| rate(i)) {
                Ok(()) => self.right[..set.len()].to_vec(),
                Err(_) => {
                    self.solve_dependent(set, |_, i| rate(i))?;
                    self.least_impulses(set)?
                }
            };
            set.iter().zip(impulses).collect()
        } else {
            let edges = self.edges(mode)?;
            let most = |channel: usize| self.friction_limits(channel).0;
            let impulses = self.impulses(mode, (&edges, edges.solve(rate)), &most, &|_| false);
            set.iter().map(|gap| (gap, impulses[gap])).collect()
        };
        let mut size = |(i, impulse): (usize, f64)| impulse * self.d(i, i).sqrt();
        let sizes: Vec<f64> = impulses.into_iter().map(&mut size).collect();
        let rounding = ORTHOGONAL * sizes.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        Ok(set.iter().zip(&sizes).all(|(i, &size)| hit.has(i) || size >= -rounding))
    }

    /// The same, and an error where the motion does not determine the forces.
    pub(crate) fn determined_contact(&mut self, closed: GapSet) -> Result<(), Undetermined> {
        self.contact(closed)?;
        match self.undetermined.is_empty() {
            false => Err(Undetermined::Contacts),
            true => Ok(()),
        }
    }

    /// Adds `M^-1 N_C^T x` with the last solution to a vector, which changes its gap speeds by the
    /// right-hand sides.
    pub(crate) fn apply(&self, set: GapSet, vector: &mut [f64]) {
        let n = self.layout.n;
        for (i, size) in set.iter().zip(&self.right) {
            axpy(vector, *size, &self.mobility[i * n..][..n]);
        }
    }

    /// The last solution, in the order of the set.
    pub(crate) fn solved(&self) -> &[f64] {
        &self.right
    }

    /// By how much what was solved for last on a set changes the speed of a gap.
    pub(crate) fn passed_on(&mut self, gap: usize, set: GapSet) -> f64 {
        set.iter().enumerate().map(|(row, i)| self.coupling(gap, i) * self.right[row]).sum()
    }

    /// How coordinates and rows move where the impulses of a mode give its rows the rates `rate`.
    pub(crate) fn displacement(
        &mut self,
        mode: impl Into<ContactMode>,
        rate: impl Fn(usize) -> f64,
    ) -> Result<Vec<f64>, Undetermined> {
        let mode = mode.into();
        if !mode.is_frictionless() {
            return self.displacement_along_edges(mode, rate);
        }
        let set = mode.closed;
        let (Layout { n, .. }, rows) = (self.layout, self.layout.rows());
        let mut all = vec![0.0; self.layout.size()];
        self.solve(set, |_, i| rate(i))?;
        self.apply(set, &mut all[..n]);
        for k in 0..rows {
            all[n + k] = if set.has(k) { rate(k) } else { self.passed_on(k, set) };
        }
        Ok(all)
    }

    /// Accelerations and forces with the contacts `C`, equations (2).
    pub(crate) fn contact(&mut self, mode: impl Into<ContactMode>) -> Result<(), Undetermined> {
        let (mode, Layout { n, m, p, .. }) = (mode.into(), self.layout);
        if p > 0 && !mode.is_frictionless() {
            return self.frictional_contact(mode);
        }
        let set = mode.closed;
        self.undetermined.clear();
        self.is_shared_motion = false;
        self.lambda.fill(0.0);
        self.acceleration[..n].copy_from_slice(&self.free);
        self.acceleration[n..n + self.b.len()].copy_from_slice(&self.b);
        if set.is_empty() {
            self.note_compliant();
            return Ok(());
        }
        self.undetermined = self.solve_forces(set)?;
        for (row, i) in set.iter().enumerate() {
            self.lambda[i] = self.right[row];
        }
        self.press(m);
        for i in set.iter() {
            self.acceleration[n + i] = 0.0;
        }
        self.note_compliant();
        Ok(())
    }

    /// `A + M^-1 N^T lambda` and `b + D lambda` with the forces as they are.
    fn press(&mut self, m: usize) {
        let n = self.layout.n;
        for i in (0..m).filter(|&i| self.lambda[i] != 0.0) {
            let (mobility, acceleration) = (&self.mobility[i * n..][..n], &mut self.acceleration);
            axpy(&mut acceleration[..n], self.lambda[i], mobility);
        }
        let (gradients, curvatures) =
            (&self.values[self.gradient..], &self.values[self.curvature..]);
        let (motion, gaps) = self.acceleration.split_at_mut(n);
        for k in 0..self.b.len() {
            gaps[k] = dot(&gradients[k * n..][..n], motion) + curvatures[k];
        }
    }

    /// Writes `A`.
    pub(crate) fn free_to(&self, to: &mut [f64]) {
        to.copy_from_slice(&self.free);
    }

    /// `b_i`.
    pub(crate) fn b(&self, i: usize) -> f64 {
        self.b[i]
    }
}

/// Whether a matrix with a positive diagonal is symmetric up to rounding.
fn is_symmetric(a: &[f64], n: usize) -> bool {
    let is_equal = |i: usize| {
        let (row, column) = (&a[i * n..][..i], a[i..].iter().step_by(n));
        row.iter().zip(column).fold(true, |same, (x, y)| same & (x == y))
    };
    if (1..n).all(is_equal) {
        return true;
    }
    let pairs = (1..n).flat_map(|i| (0..i).map(move |j| (i, j)));
    pairs.into_iter().all(|(i, j)| {
        let skew = a[i * n + j] - a[j * n + i];
        skew * skew <= SKEW * SKEW * (a[i * n + i] * a[j * n + j]).abs()
    })
}

/// Why the equations of contact have no unique solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Undetermined {
    /// Contacts follow from others, and ask for another motion than those.
    Contacts,
    /// The border of Painlevé's paradox.
    Painleve,
}

impl<E> From<Undetermined> for Failure<E> {
    fn from(why: Undetermined) -> Self {
        Failure::Status(match why {
            Undetermined::Contacts => Status::RedundantContacts,
            Undetermined::Painleve => Status::PainleveSingular,
        })
    }
}
