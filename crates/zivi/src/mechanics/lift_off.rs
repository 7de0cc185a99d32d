//! Lift-off: where the force of a contact vanishes.
//!
//! Within a step the force of a contact along the dense polynomials of the state is replaced by a
//! polynomial of degree 7 through its values at Chebyshev's points; its Bernstein coefficients
//! certify that there is no change of sign, two more values how well it fits. Long steps are probed
//! between these points ([`Probes`]).

use super::contact_probes::ContactProbes;
use super::contact_problem::settle;
use super::kinetics::Model;
use super::machine::Machine;
use super::mode::{Contacts, Next};
use super::piece::Piece;
use crate::numeric::bernstein::{Bernstein, MOST_DEGREE};
use crate::record::failure::Failure;
use crate::record::gap_set::GapSet;
use crate::record::occurrence::{FlagKind, Occurrence};
use crate::system::dynamics::Dynamics;

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
/// Iterations for the time of lift-off.
const ITERATIONS: usize = 4;
/// What lifts off together is decided this part of a step later.
const LATER: f64 = 1e-4;
/// The first step after a lift-off, relative to that before.
const PART: f64 = 1e-2;

/// Where the force of a contact vanishes in a step.
pub(super) enum Release {
    /// Nowhere.
    None,
    /// After this part of it, at this gap.
    At(f64, usize),
    /// The step is too long to tell.
    Unclear,
    /// The forces vary between the nodes: a step of this length (s) ends before that.
    Varies(f64),
}

/// Values of a contact force at the nodes, then at the checks.
type Values = [f64; MOST_DEGREE + 3];

/// A contact force over a step.
struct Fit {
    p: Bernstein,
    scale: f64,
    misfit: f64,
    /// What is rounding of it.
    noise: f64,
}

impl Fit {
    fn new(values: &Values, noise: f64) -> Self {
        let scale = values.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        let p = through(values);
        let misfit = (0..CHECKS.len())
            .map(|k| (p.at(CHECKS[k]) - values[NODES.len() + k]).abs())
            .fold(0.0, f64::max);
        Self { p, scale, misfit, noise }
    }

    /// Whether a force at `theta` is what the polynomial says.
    fn conforms(&self, force: f64, theta: f64) -> bool {
        (force - self.p.at(theta)).abs() <= 5.0 * MISFIT.0 * self.scale + self.noise
    }
}

/// The polynomials of position and velocity over a step, of the coordinates and then the gaps.
pub(super) type Rows = Vec<[Bernstein; 2]>;

impl Machine {
    /// The first contact whose force vanishes in the last step, of which the part up to `end`
    /// counts if it is short enough to tell.
    pub(super) fn first_release<E, D: Dynamics<E>>(
        &mut self,
        end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Release, Failure<E>> {
        if self.contacts.closed.is_empty() {
            return Ok(Release::None);
        }
        if self.control.jump.allowed {
            // across a jump of the forces no polynomial fits
            self.finish_step(model)?;
            let released = self.contacts.closed.iter().find(|&i| self.last.at_end.lambda[i] < 0.0);
            return Ok(released.map_or(Release::None, |i| Release::At(1.0, i)));
        }
        self.complete_step(model)?;
        let rows: Rows = (0..self.layout.n).map(|c| self.last.stages.polynomials_of(c)).collect();
        let fits = self.fits_along(&rows, model)?;
        let mut first: Option<(f64, usize)> = None;
        for (fit, i) in fits.iter().zip(self.contacts.closed.iter()) {
            if fit.misfit > MISFIT.0 * fit.scale + fit.noise {
                return Ok(Release::Unclear);
            }
            let least = fit.p.coefficients().iter().fold(f64::INFINITY, |a, &b| a.min(b));
            if least > 2.0 * fit.misfit || fit.scale == 0.0 {
                continue;
            }
            match fit.p.first_negative() {
                Some(theta) if first.is_none_or(|(before, _)| theta < before) => {
                    first = Some((theta, i));
                }
                None if fit.misfit > MISFIT.1 * fit.scale + fit.noise => {
                    return Ok(Release::Unclear);
                }
                _ => (),
            }
        }
        let end = first.map_or(end, |(theta, _)| theta.min(end));
        if let Some(length) = self.deviation(&rows, &fits, end, model)? {
            return Ok(Release::Varies(length));
        }
        Ok(first.map_or(Release::None, |(theta, i)| Release::At(theta, i)))
    }

    /// The forces of the contacts along the last step. One below what rounding leaves of it is
    /// none, as that between bodies in free fall.
    fn fits_along<E, D: Dynamics<E>>(
        &mut self,
        rows: &Rows,
        model: &mut Model<'_, D>,
    ) -> Result<Vec<Fit>, Failure<E>> {
        let mut forces = vec![[0.0; MOST_DEGREE + 3]; self.contacts.closed.len()];
        let mut noise = vec![0.0_f64; self.contacts.closed.len()];
        for (k, theta) in NODES.into_iter().chain(CHECKS).enumerate() {
            self.evaluate_along(rows, theta, model)?;
            for (row, i) in self.contacts.closed.iter().enumerate() {
                let none = self.aside.noise(i) / self.aside.d(i, i);
                let force = self.aside.lambda[i];
                forces[row][k] = if force.abs() <= none { 0.0 } else { force };
                noise[row] = noise[row].max(none);
            }
        }
        Ok(forces.iter().zip(noise).map(|(values, noise)| Fit::new(values, noise)).collect())
    }

    /// Probes the last step up to a part of it: the length of one that ends before the forces or
    /// the accelerations deviate from what they are at the nodes.
    fn deviation<E, D: Dynamics<E>>(
        &mut self,
        rows: &Rows,
        fits: &[Fit],
        end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Option<f64>, Failure<E>> {
        let ContactProbes { mut probes, horizon, .. } = self.probes;
        let (t, h) = (self.now.t, self.last.stages.h);
        if !self.settings.adaptive || model.dynamics.is_steady() {
            return Ok(None);
        }
        let found = probes.deviation(horizon, (t, end * h), APART * h, |at| {
            match self.conforms(rows, fits, at / h, model) {
                Err(Failure::Status(_)) => Ok(false),
                conforms => conforms,
            }
        });
        self.probes.probes = probes;
        found
    }

    fn conforms<E, D: Dynamics<E>>(
        &mut self,
        rows: &Rows,
        fits: &[Fit],
        theta: f64,
        model: &mut Model<'_, D>,
    ) -> Result<bool, Failure<E>> {
        let defect = self.defect(rows, theta, model)?;
        let h = self.last.stages.h;
        let pushed = |c: usize| {
            let v = &rows[c][1];
            let largest = NODES.iter().fold(0.0_f64, |a, &theta| a.max(v.slope(theta).abs()));
            let off = (h * self.aside.acceleration[c] - v.slope(theta)).abs();
            off > 5.0 * MISFIT.0 * largest
        };
        if defect > 1.0 && (0..rows.len()).any(pushed) {
            return Ok(false);
        }
        let mut closed = fits.iter().zip(self.contacts.closed.iter());
        Ok(closed.all(|(fit, i)| fit.conforms(self.aside.lambda[i], theta)))
    }

    /// Steps to where the force of a contact vanishes, near `now + length`.
    pub(super) fn lift<E, D: Dynamics<E>>(
        &mut self,
        length: f64,
        gap: usize,
        t_end: f64,
        model: &mut Model<'_, D>,
    ) -> Result<(), Failure<E>> {
        let whole = self.last.stages.h;
        let length = self.release(length, gap, model)?;
        if self.now.t + length > self.dense_from {
            self.complete_step(model)?;
        }
        self.counts.accepted += 1;
        self.arrive(length, 0.0, t_end);
        self.next = Next::Release { gap, h: whole };
        Ok(())
    }

    /// Opens the contacts that open where the force of one vanishes, in a step of length `h`.
    pub(super) fn open<E, D: Dynamics<E>>(
        &mut self,
        gap: usize,
        h: f64,
        model: &mut Model<'_, D>,
    ) -> Result<Piece, Failure<E>> {
        self.project(self.contacts.closed, model)?;
        let left = self.released(gap, LATER * h, model)?;
        self.contacts = Contacts { closed: self.contacts.closed.without(left), left };
        self.note_lifted(left);
        self.flag_lifted(left);
        self.gathered.chain.clear();
        self.gathered.corners.clear();
        self.gathered.impacts = 0;
        self.control.h = Some(PART * h);
        self.refresh()?;
        Ok(Piece::Instant)
    }

    /// The length of the step after which the force of a contact vanishes; that step is computed.
    fn release<E, D: Dynamics<E>>(
        &mut self,
        length: f64,
        gap: usize,
        model: &mut Model<'_, D>,
    ) -> Result<f64, Failure<E>> {
        let whole = self.last.stages.h;
        let mut one = (0.0, self.here.lambda[gap]);
        let mut x = length;
        for iteration in 0..ITERATIONS {
            self.try_step(x, model)?;
            self.finish_step(model)?;
            let force = self.last.at_end.lambda[gap];
            let slope = (force - one.1) / (x - one.0);
            let next = x - force / slope;
            one = (x, force);
            let done = (next - x).abs() <= 4.0 * f64::EPSILON * (self.now.t.abs() + x);
            if done || !next.is_finite() || iteration + 1 == ITERATIONS {
                break;
            }
            x = next.clamp(0.0, whole);
        }
        Ok(x)
    }

    /// Which contacts open just after the force of one vanishes.
    fn released<E, D: Dynamics<E>>(
        &mut self,
        gap: usize,
        later: f64,
        model: &mut Model<'_, D>,
    ) -> Result<GapSet, Failure<E>> {
        let n = self.layout.n;
        self.kinetics.contact(self.contacts.closed)?;
        let a = &self.kinetics.acceleration;
        let now = &self.now;
        let (q, w): (Vec<f64>, Vec<f64>) = (0..n)
            .map(|c| {
                let v = now.xdot[c] + later * a[c];
                (now.x[c] + later * (now.xdot[c] + 0.5 * later * a[c]), v)
            })
            .unzip();
        self.aside.evaluate(model, now.t + later, &q, &w)?;
        let left = settle(&mut self.aside, self.contacts.closed)?.left;
        // where the force comes back at once, again and again, the contact opens all the same
        const OFTEN: u32 = 8;
        Ok(if left.is_empty() && self.stalled > OFTEN { GapSet::of(gap) } else { left })
    }

    /// Contacts that open together and are coupled.
    fn flag_lifted(&mut self, left: GapSet) {
        let mut strongest = 0.0_f64;
        for i in left.iter() {
            for j in left.iter().filter(|&j| j < i) {
                strongest = strongest.max(self.kinetics.cosine(i, j).abs());
            }
        }
        if strongest > 1e-9 {
            let (kind, t) = (FlagKind::Simultaneous, self.now.t);
            self.occurrences.push(Occurrence::Flag { kind, t, gaps: left, size: strongest });
        }
    }
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
