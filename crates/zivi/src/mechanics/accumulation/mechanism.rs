//! The mechanism after an impact and its validity ahead, for the extrapolation of an accumulation.

use super::tail::EndOfArcs;
use crate::mechanics::kinetics::{Kinetics, Model};
use crate::mechanics::mode::Limit;
use crate::mechanics::state::MechanicalState;
use crate::numeric::bernstein::Bernstein;
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::switched::SwitchedRk;
use crate::system::dynamics::{Dynamics, Layout};
use crate::zeno::table::ExtrapolatedEnd;

/// Speeds below which a corner is reached for any pattern and slips after an accumulation vanish,
/// relative to `1 + |q'|` and in tolerances.
const FLOOR: (f64, f64) = (1e-12, 1e-2);
/// A jump passes no other gap that is nearer than so many of its estimated errors.
pub(in crate::mechanics) const CLEAR: f64 = 100.0;

/// A mechanical system at its state, and evaluated elsewhere.
pub(in crate::mechanics) struct Mechanism<'r, 'm, D> {
    pub(in crate::mechanics) settings: &'r SwitchedRk,
    /// Restitutions by gap.
    pub(in crate::mechanics) e: &'r [f64],
    pub(in crate::mechanics) state: &'r mut MechanicalState,
    /// The mechanics where they were evaluated last, away from the state.
    pub(in crate::mechanics) aside: &'r mut Kinetics,
    pub(in crate::mechanics) model: &'r mut Model<'m, D>,
}

/// The tolerances of the time of a jump and of the state after it. Slips and the work of friction come
/// of the rest.
pub(in crate::mechanics) fn scales(
    settings: &SwitchedRk,
    state: &MechanicalState,
    of_time: f64,
) -> Vec<f64> {
    let Layout { n, m, .. } = state.layout();
    let of = |values: &[f64], atol: f64| -> Vec<f64> {
        let scale = |(c, value): (usize, &f64)| match c < n + m {
            true => atol + settings.rtol * value.abs(),
            false => f64::INFINITY,
        };
        values.iter().enumerate().map(scale).collect()
    };
    let (now, [atol_x, atol_v]) = (state.now(), settings.atol);
    [vec![of_time], of(&now.x, atol_x), of(&now.xdot, atol_v)].concat()
}

/// A speed below all tolerances.
pub(in crate::mechanics) fn slow(settings: &SwitchedRk, state: &MechanicalState) -> f64 {
    let w = &state.now().xdot[..state.layout().n];
    let speed = w.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    FLOOR.0.max(FLOOR.1 * settings.rtol) * (1.0 + speed)
}

impl<D> Mechanism<'_, '_, D> {
    /// Whether the gaps outside of a mode stay open on the way to the landing: the cubic between
    /// both ends stays clear of zero; and whether what slips in it slips at both ends.
    pub(in crate::mechanics) fn is_clear(
        &self,
        landing: &ExtrapolatedEnd<Vec<f64>>,
        mode: impl Into<ContactMode>,
    ) -> bool {
        let mode = mode.into();
        let (Layout { n, m, .. }, now) = (self.state.layout(), self.state.now());
        let (set, size) = (mode.closed, now.x.len());
        let (h, z, errors) = (landing.t - now.t, landing.state(), landing.errors());
        let kinetics = self.state.kinetics();
        let slips = |channel: usize| {
            if let Some(other) = kinetics.other_of(channel) {
                let of = |values: &[f64], from: usize| {
                    [channel, other].map(|channel| values[from + n + m + channel])
                };
                let [[x, y], [a, b]] = [of(&now.xdot, 0), of(z, size)];
                let [p, q] = of(errors, size);
                return a * x + b * y > 0.0 && a.hypot(b) > CLEAR * p.hypot(q);
            }
            let (c, sign) = (n + m + channel, mode.sign(channel));
            sign * now.xdot[c] > 0.0 && sign * z[size + c] > CLEAR * errors[size + c]
        };
        mode.slipping().iter().all(slips)
            && (0..m).filter(|&k| !set.has(k)).all(|k| {
                let (c, error) = (n + k, errors[n + k]);
                let (first, last) = (now.x[c], z[c]);
                let (slope, end) = (h * now.xdot[c], h * z[size + c]);
                let p = Bernstein::hermite((first, slope), (last, end));
                p.coefficients().iter().all(|&c| c > CLEAR * error)
            })
    }

    /// Whether the forces keep all gaps of a set closed along the way to the landing, and those
    /// that stay closed while another one bounces also without it, and under its impacts.
    pub(in crate::mechanics) fn stays_closed<E>(
        &mut self,
        landing: &ExtrapolatedEnd<Vec<f64>>,
        mode: impl Into<ContactMode>,
        meanwhile: impl Into<ContactMode>,
    ) -> Result<bool, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let (mode, meanwhile) = (mode.into(), meanwhile.into());
        let (Layout { n, .. }, closed) = (self.state.layout(), self.state.closed());
        let (set, size) = (mode.closed, self.state.now().x.len());
        let (now, z, at) = (self.state.now(), landing.state(), &mut *self.aside);
        for part in [0.25, 0.5, 0.75, 1.0] {
            let on_the_way = |from: &[f64], to: &[f64]| -> Vec<f64> {
                from.iter().zip(to).map(|(a, b)| a + part * (b - a)).collect()
            };
            let q = on_the_way(&now.x[..n], &z[..n]);
            let w = on_the_way(&now.xdot[..n], &z[size..][..n]);
            let t = now.t + part * (landing.t - now.t);
            match at.evaluate(self.model, t, &q, &w) {
                Err(Failure::Status(_)) => return Ok(false),
                evaluated => evaluated?,
            }
            at.turn(&on_the_way(&now.xdot[n..], &z[size + n..]));
            if at.contact(mode).is_err() {
                return Ok(false);
            }
            let pushes = |at: &mut Kinetics, i: usize| {
                // bodies in free fall touch without a force
                let none = if closed.has(i) { -at.noise(i) / at.d(i, i) } else { 0.0 };
                at.lambda[i] > none || (closed.has(i) && at.lambda[i] >= none)
            };
            if !set.iter().all(|i| pushes(at, i)) || !holds(at, mode) {
                return Ok(false);
            }
            if at.contact(meanwhile).is_err()
                || !meanwhile.closed.iter().all(|i| pushes(at, i))
                || !holds(at, meanwhile)
            {
                return Ok(false);
            }
            let hit = set.without(meanwhile.closed);
            if !at.bounces_hold(hit, mode, self.e) {
                return Ok(false);
            }
            if !meanwhile.closed.is_empty() && !at.impacts_press(hit, mode)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// One end of the arcs that a jump skips: the motion in contact, at a time and a state, `x`
    /// before `x'`. The system is evaluated aside there.
    pub(in crate::mechanics) fn end_of_arcs<E>(
        &mut self,
        t: f64,
        z: &[f64],
        mode: impl Into<ContactMode>,
    ) -> Result<EndOfArcs, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let (mode, n, size) = (mode.into(), self.aside.coordinates(), z.len() / 2);
        let (x, v) = z.split_at(size);
        self.aside.evaluate(self.model, t, &x[..n], &v[..n])?;
        self.aside.turn(&v[n..]);
        self.aside.contact(mode)?;
        let mut acceleration = self.aside.accelerations();
        if let Some(power) = acceleration.get_mut(n + self.aside.layout.rows()) {
            *power = self.aside.friction_power(mode, &v[n..]);
        }
        Ok(EndOfArcs { x: x.to_vec(), v: v.to_vec(), acceleration, way: vec![0.0; size] })
    }

    /// The end of the arcs at the present state.
    pub(in crate::mechanics) fn end_here<E>(
        &mut self,
        mode: impl Into<ContactMode>,
    ) -> Result<EndOfArcs, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let now = self.state.now();
        let (t, z) = (now.t, [&now.x[..], &now.xdot[..]].concat());
        self.end_of_arcs(t, &z, mode)
    }

    /// Moves to a landing, after which the gaps of a mode are closed, and maybe others with them:
    /// all of these. The system is evaluated there.
    pub(in crate::mechanics) fn move_to<E>(
        &mut self,
        landing: &ExtrapolatedEnd<Vec<f64>>,
        mode: impl Into<ContactMode>,
    ) -> Result<GapSet, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let t = landing.t.max(self.state.now().t);
        let (to, rounding) = ((t, landing.state()), self.settings.rounding());
        let closed = self.state.move_to(to, mode.into(), rounding, self.model)?;
        let size = self.state.now().x.len();
        let slow = slow(self.settings, self.state);
        self.state.take_slips(Some((&landing.errors()[size..], slow)));
        Ok(closed)
    }
}

/// Whether friction maintains sticking and no sliding contact is close to the Painlevé paradox, for
/// the computed forces.
fn holds(at: &mut Kinetics, mode: ContactMode) -> bool {
    mode.is_frictionless()
        || at.limits(mode).iter().all(|level| match level.limit {
            Limit::Force(_) | Limit::Law(_) => true,
            Limit::Stick(..) | Limit::Margin | Limit::Regularity => level.value > 0.0,
        })
}
