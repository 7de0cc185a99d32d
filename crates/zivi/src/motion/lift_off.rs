//! The end of a mode: the force of a contact vanishes, or a sticking channel begins to slip.
//!
//! Within a step the force of a contact along the dense polynomials of the state is replaced by a
//! polynomial of degree 7 through its values at Chebyshev's points; its Bernstein coefficients
//! certify that there is no change of sign, two more values how well it fits. Long steps are probed
//! between these points ([`Probes`]).

use crate::friction::{decide, LimitLevel};
use crate::kinetics::lcp::settle;
use crate::kinetics::mode::{AlongStep, ContactProbes, Contacts, Limit, Rows};
use crate::kinetics::shares::Shares;
use crate::kinetics::{Kinetics, Model};
use crate::motion::state::MechanicalState;
use crate::numeric::bernstein::{Bernstein, MOST_DEGREE};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::system::dynamics::{Dynamics, Layout};
use crate::Status;

/// Nodes of the polynomial of a contact force: `(1 - cos(pi k/7))/2`.
const NODES: [f64; MOST_DEGREE + 1] = [
    0.0,
    0.049_515_566_048_790_43,
    0.188_255_099_070_633_23,
    0.388_739_533_021_842_8,
    0.611_260_466_978_157_2,
    0.811_744_900_929_366_8,
    0.950_484_433_951_209_6,
    1.0,
];
/// Where its fit is checked.
const CHECKS: [f64; 2] = [0.279, 0.893];
/// Largest distance between two of all these places.
const APART: f64 = 0.223;
/// Misfit relative to the largest force: above the first the step is too long, below the second
/// what is undecided is decided as the polynomial has it.
const MISFIT: (f64, f64) = (1e-3, 1e-10);
/// Forces below this part of their terms change hands within a step: where the motion depends on which gap carries,
/// no polynomial fits the forces there.
const HANDED: f64 = 1e-9;
/// Simultaneous lift-offs are decided this fraction of a step later.
const LATER: f64 = 1e-4;
/// So many times later they are decided again, where nothing changes.
const LATER_AGAIN: f64 = 10.0;

/// Where the force of a contact vanishes in a step.
pub(crate) enum Release {
    /// Nowhere.
    None,
    /// After this part of it, by the limit of this number.
    At(f64, usize),
    /// The step is too long to tell.
    Unclear,
    /// The forces vary between the nodes: a step of this length (s) ends before that.
    Varies(f64),
}

/// Values of a contact force at the nodes and at the checks.
type Values = [f64; MOST_DEGREE + 3];

/// A limit of the mode over a step: a contact force, or one of the sums of which the margin is the least.
struct Fit {
    /// The number of the limit.
    number: usize,
    p: Bernstein,
    scale: f64,
    /// The least value at the nodes and checks.
    least: f64,
    misfit: f64,
    /// Its rounding error.
    noise: f64,
}

impl Fit {
    fn new(number: usize, values: &Values, noise: f64) -> Self {
        let scale = values.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        let least = values.iter().fold(f64::INFINITY, |a, &b| a.min(b));
        let p = through(values);
        let misfit = (0..CHECKS.len())
            .map(|k| (p.at(CHECKS[k]) - values[NODES.len() + k]).abs())
            .fold(0.0, f64::max);
        Self { number, p, scale, least, misfit, noise }
    }

    /// Whether a force at `theta` agrees with the polynomial.
    fn conforms(&self, force: f64, theta: f64) -> bool {
        (force - self.p.at(theta)).abs() <= 5.0 * MISFIT.0 * self.scale + self.noise
    }
}

/// The first contact whose force vanishes in a step, in its part up to `end`, if it is short enough
/// for a decision. The probes look between the nodes, if there are any.
pub(crate) fn first_release<E, D: Dynamics<E>>(
    along: &mut AlongStep<'_, '_, D>,
    end: f64,
    probes: Option<&mut ContactProbes>,
) -> Result<Release, Failure<E>> {
    let rows = along.rows(along.aside.coordinates());
    let Some(mut fits) = fits_along(&rows, along)? else { return Ok(Release::Unclear) };
    if along.aside.is_shared_motion {
        fits.retain(|fit| !along.is_handed_over(fit));
    }
    let mut first: Option<(f64, usize)> = None;
    for fit in &fits {
        if fit.misfit > MISFIT.0 * fit.scale + fit.noise {
            if along.aside.is_shared_motion && along.is_below(HANDED, fit) {
                continue;
            }
            return Ok(Release::Unclear);
        }
        let least = fit.p.coefficients().iter().fold(f64::INFINITY, |a, &b| a.min(b));
        if least > 2.0 * fit.misfit || fit.scale == 0.0 {
            continue;
        }
        match fit.p.first_negative() {
            Some(theta) if first.is_none_or(|(before, _)| theta < before) => {
                first = Some((theta, fit.number));
            }
            None if fit.misfit > MISFIT.1 * fit.scale + fit.noise => {
                return Ok(Release::Unclear);
            }
            _ => (),
        }
    }
    let end = first.map_or(end, |(theta, _)| theta.min(end));
    if let Some(probes) = probes.filter(|_| !along.model.dynamics.is_steady()) {
        if let Some(length) = deviation(&rows, &fits, end, along, probes)? {
            return Ok(Release::Varies(length));
        }
    }
    Ok(first.map_or(Release::None, |(theta, number)| Release::At(theta, number)))
}

impl<D> AlongStep<'_, '_, D> {
    /// Whether a limit is nowhere in the step larger than a part of its terms.
    fn is_below(&mut self, part: f64, fit: &Fit) -> bool {
        let levels = self.aside.limits(self.mode);
        let level = levels.get(fit.number);
        level.is_some_and(|level| fit.scale <= part * self.aside.force_scale(level.limit))
    }

    /// Whether joints or other gaps take over the load of a gap where its force would become negative: the gap
    /// stays closed with zero force.
    fn is_handed_over(&mut self, fit: &Fit) -> bool {
        let levels = self.aside.limits(self.mode);
        let Some(&LimitLevel { limit, .. }) = levels.get(fit.number) else { return false };
        let is_gap = matches!(limit, Limit::Force(_));
        is_gap && fit.least.abs() <= HANDED * self.aside.force_scale(limit)
    }
}

/// Where a function becomes negative that is positive (or zero) at the start of a step.
pub(crate) fn first_turn<E>(
    is_zero: bool,
    mut force: impl FnMut(f64) -> Result<f64, Failure<E>>,
) -> Result<Release, Failure<E>> {
    let mut values = [0.0; MOST_DEGREE + 3];
    for (value, theta) in values.iter_mut().zip(NODES.into_iter().chain(CHECKS)) {
        *value = force(theta)?;
    }
    if is_zero {
        values[0] = 0.0;
    }
    let fit = Fit::new(0, &values, 0.0);
    if fit.misfit > MISFIT.0 * fit.scale {
        return Ok(Release::Unclear);
    }
    let p = if is_zero { fit.p.starting_at(0.0).without_root_at_zero() } else { fit.p };
    Ok(p.first_negative().map_or(Release::None, |theta| Release::At(theta, 0)))
}

/// The limits of the mode along a step. A force below what rounding leaves of it is none, as that
/// between bodies in free fall.
fn fits_along<E, D: Dynamics<E>>(
    rows: &Rows,
    along: &mut AlongStep<'_, '_, D>,
) -> Result<Option<Vec<Fit>>, Failure<E>> {
    let mode = along.mode;
    let (mut forces, mut noise) = (Vec::new(), Vec::new());
    let mut shares: Vec<Shares> = Vec::new();
    let mut first: Vec<f64> = Vec::new();
    for (k, theta) in NODES.into_iter().chain(CHECKS).enumerate() {
        along.evaluate(rows, theta)?;
        if !mode.stick.is_empty() {
            let directions = along.aside.directions(mode.stick);
            along.turns |= k > 0 && directions != first;
            first = directions;
        }
        shares.extend(along.aside.shares(mode));
        let levels = along.aside.limits(mode);
        forces.resize(levels.len(), [0.0; MOST_DEGREE + 3]);
        noise.resize(levels.len(), 0.0_f64);
        for (row, level) in levels.iter().enumerate() {
            let none = level.value.abs() <= level.noise;
            forces[row][k] = if none { 0.0 } else { level.value };
            noise[row] = noise[row].max(level.noise);
        }
    }
    let mut fits: Vec<Fit> = Vec::new();
    if !shares.is_empty() {
        // the margin comes first among the limits
        let Some(of_margin) = margin_along(&shares, noise[0]) else { return Ok(None) };
        fits.extend(of_margin);
    }
    let smooth = forces.iter().zip(noise).enumerate().skip(usize::from(!shares.is_empty()));
    fits.extend(smooth.map(|(row, (values, noise))| Fit::new(row, values, noise)));
    Ok(Some(fits))
}

/// The margin of undetermined forces along a step: where other sums `y . a` become the least it has a kink, so
/// each that is the least at a node is followed by itself. None if other forces are undetermined within the
/// step than at its ends.
fn margin_along(shares: &[Shares], noise: f64) -> Option<Vec<Fit>> {
    if shares.len() != NODES.len() + CHECKS.len() {
        return None;
    }
    let mut vertices: Vec<Vec<usize>> = Vec::new();
    for at in shares {
        let mut vertex: Vec<usize> = at.margin().support.iter().map(|it| it.0).collect();
        vertex.sort_unstable();
        if !vertex.is_empty() && !vertices.contains(&vertex) {
            vertices.push(vertex);
        }
    }
    let along = |vertex: &Vec<usize>| {
        let mut values = [0.0; MOST_DEGREE + 3];
        for (value, at) in values.iter_mut().zip(shares) {
            let sum = at.combined(vertex)?;
            *value = if sum.abs() <= noise { 0.0 } else { sum };
        }
        Some(Fit::new(0, &values, noise))
    };
    vertices.iter().map(along).collect()
}

/// Probes a step up to a part of it: the length of one that ends before the forces or accelerations
/// deviate from their interpolation.
fn deviation<E, D: Dynamics<E>>(
    rows: &Rows,
    fits: &[Fit],
    end: f64,
    along: &mut AlongStep<'_, '_, D>,
    ContactProbes { probes, horizon, .. }: &mut ContactProbes,
) -> Result<Option<f64>, Failure<E>> {
    let (t, h) = (along.step.from.t, along.step.h);
    probes.deviation(*horizon, (t, end * h), APART * h, |at| {
        match conforms(rows, fits, at / h, along) {
            Err(Failure::Status(_)) => Ok(false),
            conforms => conforms,
        }
    })
}

fn conforms<E, D: Dynamics<E>>(
    rows: &Rows,
    fits: &[Fit],
    theta: f64,
    along: &mut AlongStep<'_, '_, D>,
) -> Result<bool, Failure<E>> {
    let defect = along.defect(rows, theta)?;
    let (h, at) = (along.step.h, &along.aside);
    let pushed = |c: usize| {
        let v = &rows[c][1];
        let largest = NODES.iter().fold(0.0_f64, |a, &theta| a.max(v.slope(theta).abs()));
        let off = (h * at.acceleration[c] - v.slope(theta)).abs();
        off > 5.0 * MISFIT.0 * largest
    };
    if defect > 1.0 && (0..rows.len()).any(pushed) {
        return Ok(false);
    }
    let levels = along.aside.limits(along.mode);
    // of several fits of the margin the least is meant
    let conforms = |(number, level): (usize, &LimitLevel)| {
        let fits = fits.iter().filter(|fit| fit.number == number);
        let least = fits.min_by(|one, other| one.p.at(theta).total_cmp(&other.p.at(theta)));
        least.is_none_or(|fit| fit.conforms(level.value, theta))
    };
    Ok(levels.iter().enumerate().all(conforms))
}

/// Opens the contacts that open where a limit of the mode is reached, in a step of length `h`: these.
/// If a force returns immediately `again` times, its contact opens nevertheless.
pub(crate) fn open<E, D: Dynamics<E>>(
    (limit, h): (Limit, f64),
    again: bool,
    state: &mut MechanicalState,
    aside: &mut Kinetics,
    model: &mut Model<'_, D>,
) -> Result<GapSet, Failure<E>> {
    let (n, mode, closed) = (state.layout().n, state.mode(), state.closed());
    if limit == Limit::Regularity {
        return Err(Failure::Status(Status::PainleveSingular));
    }
    if let Limit::Law(gap) = limit {
        state.toggle_law(gap, model)?;
        return Ok(state.left());
    }
    state.project(state.kinetics().rows_of(mode), model)?;
    let (kinetics, now) = state.parts();
    kinetics.turn(&now.xdot[n..]);
    kinetics.contact(mode)?;
    let mut later = LATER * h;
    look_later(later, (mode, state), aside, model)?;
    if state.layout().p == 0 {
        let left = settle(aside, closed)?.left;
        let left = match limit {
            Limit::Force(gap) if left.is_empty() && again => GapSet::of(gap),
            _ => left,
        };
        state.open(left);
        return Ok(left);
    }
    let slips = later_slips(state, later);
    let held = match limit {
        Limit::Stick(channel, _) => {
            let other = aside.other_of(channel).into_iter().collect();
            mode.stick.without(GapSet::of(channel)).without(other)
        }
        Limit::Force(_) => mode.stick,
        Limit::Law(_) | Limit::Margin | Limit::Regularity => GapSet::EMPTY,
    };
    let mut contacts = match decide(aside, closed, &slips, held) {
        // a slip that turns in the plane may take `K` of its contact through zero: its force has grown without bound
        Err(Failure::Status(Status::InconsistentContact)) if aside.is_singular(mode) => {
            return Err(Failure::Status(Status::PainleveSingular));
        }
        decided => decided?,
    };
    // soon after the limit of shared loads it is exceeded by less than a decision allows
    while contacts.mode == mode && limit == Limit::Margin && later < h && aside.has_cones() {
        later *= LATER_AGAIN;
        look_later(later, (mode, state), aside, model)?;
        contacts = decide(aside, closed, &later_slips(state, later), held)?;
    }
    if contacts.mode == mode && again {
        aside.contact(mode)?;
        contacts = force(limit, contacts, aside);
    }
    let left = contacts.left;
    state.parts().0.take_headings(aside.headings());
    state.enter(contacts);
    Ok(left)
}

/// Evaluates the system some time later, by the accelerations in a mode.
fn look_later<E, D: Dynamics<E>>(
    later: f64,
    (mode, state): (ContactMode, &mut MechanicalState),
    aside: &mut Kinetics,
    model: &mut Model<'_, D>,
) -> Result<(), Failure<E>> {
    let n = state.layout().n;
    let (kinetics, now) = state.parts();
    let a = &kinetics.acceleration;
    let (q, w): (Vec<f64>, Vec<f64>) = (0..n)
        .map(|c| {
            let v = now.xdot[c] + later * a[c];
            (now.x[c] + later * (now.xdot[c] + 0.5 * later * a[c]), v)
        })
        .unzip();
    aside.carry(mode.pressed);
    aside.evaluate(model, now.t + later, &q, &w)
}

/// The slip speeds of a mode some time later: those that are zero stay so.
fn later_slips(state: &MechanicalState, later: f64) -> Vec<f64> {
    let Layout { n, m, .. } = state.layout();
    let slopes = &state.kinetics().acceleration[n + m..];
    let mut slips: Vec<f64> =
        state.slips().iter().zip(slopes).map(|(w, slope)| w + later * slope).collect();
    state.spent().iter().for_each(|channel| slips[channel] = 0.0);
    slips
}

/// The change of one contact that a limit asks for.
fn force(limit: Limit, mut contacts: Contacts, aside: &mut Kinetics) -> Contacts {
    match limit {
        Limit::Force(gap) => {
            let one = GapSet::of(gap);
            contacts.mode.closed = contacts.mode.closed.without(one);
            for channel in aside.channels_of(gap) {
                contacts.mode = contacts.mode.without_channel(channel);
            }
            contacts.left = contacts.left.with(one);
        }
        // it slips against the force that holds it
        Limit::Stick(channel, sign) => {
            contacts.mode = contacts.mode.with_channel(channel, -sign);
            contacts.released = contacts.released.with(GapSet::of(channel));
            if let Some(other) = aside.other_of(channel) {
                let pair = [channel, other];
                let [x, y] = pair.map(|channel| aside.lambda[aside.row(channel)]);
                aside.head(pair, [-x / x.hypot(y), -y / x.hypot(y)]);
                contacts.mode = contacts.mode.with_channel(channel, 1.0).with_channel(other, 1.0);
                contacts.released = contacts.released.with(GapSet::of(other));
            }
        }
        Limit::Law(_) | Limit::Margin | Limit::Regularity => (),
    }
    contacts
}

/// The polynomial through the values at the nodes.
fn through(values: &Values) -> Bernstein {
    let n = NODES.len();
    let mut d = *values;
    for level in 1..n {
        for i in (level..n).rev() {
            d[i] = (d[i] - d[i - 1]) / (NODES[i] - NODES[i - level]);
        }
    }
    let mut p = Bernstein::new(&[d[n - 1]]);
    for i in (0..n - 1).rev() {
        p = p.times_root(NODES[i]).plus(d[i]);
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_distance_between_looks_is_known() {
        let mut all: Vec<f64> = NODES.into_iter().chain(CHECKS).collect();
        all.sort_by(f64::total_cmp);
        let apart = all.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        assert!(apart <= APART && apart > 0.99 * APART, "{apart}");
    }

    #[test]
    fn the_polynomial_takes_the_values_at_the_nodes() {
        let f = |x: f64| 1.0 + x - 3.0 * x.powi(3) + 2.0 * x.powi(7) - x.powi(5);
        let mut values = [0.0; MOST_DEGREE + 3];
        for (value, node) in values.iter_mut().zip(NODES) {
            *value = f(node);
        }
        let p = through(&values);
        for k in 0..=20 {
            let theta = f64::from(k) / 20.0;
            assert!((p.at(theta) - f(theta)).abs() < 1e-13, "{theta}");
        }
        for (k, node) in NODES.into_iter().enumerate() {
            let exact = 0.5 - 0.5 * (std::f64::consts::PI * k as f64 / 7.0).cos();
            assert!((node - exact).abs() < 1e-15, "{k}");
        }
    }
}
