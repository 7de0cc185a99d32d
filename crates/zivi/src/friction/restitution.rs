//! Other laws of impact with friction: Poisson's restitution of the impulse, Stronge's of the work.
//!
//! ```text
//! Poisson   compression: (1) of [`crate::friction::impact`] with e = e_t = 0 gives P_C and (g_C, w_C)
//!           restitution: 0 <= P_N - e P_C,N  perp  g+ >= 0,   -P_T in mu P_N Sign(w+)
//! Stronge   dg'/dP_N = D_nn - mu sigma D_nt,  dw/dP_N = D_nt - mu sigma D_tt  (it slips)
//!           up to g' = 0 with the work W, then until -e^2 W is given back; one contact
//! ```
//!
//! Stronge's cannot raise the energy. Nor can Poisson's with one `e`: with `|P|^2 = P . D P` and as `P_N >= e
//! P_C,N` in Coulomb's law, `E+ - E- <= -1/2 |P_C|^2 - 1/2 |P|^2 + e P_C . D P <= 0`. Poisson's impulses come in two steps, Stronge's as a path along which
//! the slip may stop or turn inside of the impact.

use crate::friction::impact::{rate_after, unsolved, Collision, FrictionalExchange, Violation};
use crate::kinetics::Kinetics;
use crate::numeric::dense::{axpy, dot};
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::system::force::{Channel, Friction};
use crate::Status;

/// Most patterns of restitution that are tried.
const MOST_PATTERNS: usize = 1 << 14;
/// Pieces of the path of an impact: slip, stop, stick or slip the other way, in each phase.
const PIECES: usize = 16;

/// Behaviours of a contact in restitution.
#[derive(Clone, Copy)]
struct ContactBehaviour {
    gap: usize,
    channel: Option<usize>,
    /// `e P_C,N`.
    kept: f64,
}

impl ContactBehaviour {
    /// Their number: the gap bounces or rests, and sticks or slips if pressed.
    fn count(self) -> usize {
        match (self.channel, self.kept > 0.0) {
            (None, _) => 2,
            (Some(_), true) => 6,
            // a gap without an impulse has no friction
            (Some(_), false) => 4,
        }
    }

    /// Whether it rests, and the sign of the slip with friction.
    fn take(self, way: usize) -> (bool, Option<f64>) {
        let sign = |k: usize| [0.0, 1.0, -1.0][k];
        match (self.channel, self.kept > 0.0) {
            (None, _) => (way == 0, None),
            (Some(_), true) => (way < 3, Some(sign(way % 3))),
            (Some(_), false) => (way < 3, (way < 3).then(|| sign(way))),
        }
    }
}

impl Collision<'_> {
    /// Poisson's law.
    pub(super) fn poisson<E>(
        &self,
        kinetics: &mut Kinetics,
    ) -> Result<FrictionalExchange, Failure<E>> {
        let channels = self.friction.channels.iter().map(|it| Channel { e_t: 0.0, ..*it });
        let friction = Friction { channels: channels.collect(), ..Friction::default() };
        let none = vec![0.0; self.e.len()];
        let compression = Collision { e: &none, friction: &friction, ..*self };
        let pressed = compression.newton(kinetics)?;
        let ways: Vec<ContactBehaviour> = self
            .set
            .iter()
            .map(|gap| {
                let (channel, kept) =
                    (kinetics.channel_of(gap), self.e[gap] * pressed.impulses[gap]);
                ContactBehaviour { gap, channel, kept }
            })
            .collect();
        let count = ways.iter().fold(1_usize, |all, way| all.saturating_mul(way.count()));
        if count > MOST_PATTERNS {
            return Err(Failure::Status(Status::ImpactNotSolved));
        }
        let mut found: Vec<FrictionalExchange> = Vec::new();
        for number in 0..count {
            found.extend(self.restitution(&pressed, &ways, number, kinetics));
        }
        let fastest = self.fastest(kinetics);
        let cones = ways.iter().filter_map(|way| kinetics.other_of(way.channel?)).count();
        self.chosen(found, &fastest).ok_or(Failure::Status(unsolved(cones == 0)))
    }

    /// The restitution after a compression, of one pattern.
    fn restitution(
        &self,
        pressed: &FrictionalExchange,
        ways: &[ContactBehaviour],
        number: usize,
        kinetics: &mut Kinetics,
    ) -> Option<FrictionalExchange> {
        let n = kinetics.coordinates();
        let (mut mode, mut all, mut rest) =
            (ContactMode::default(), ContactMode::default(), number);
        let mut push = vec![0.0; n];
        let mut impulses = vec![0.0; kinetics.layout.rows()];
        for way in ways {
            let (rests, sign) = way.take(rest % way.count());
            rest /= way.count();
            if rests {
                mode.closed = mode.closed.with(GapSet::of(way.gap));
            } else {
                impulses[way.gap] = way.kept;
                let along = kinetics.mobility(way.gap).to_vec();
                axpy(&mut push, way.kept, &along);
            }
            let (Some(channel), Some(sign)) = (way.channel, sign) else { continue };
            all = all.with_channel(channel, sign);
            if rests || sign == 0.0 {
                mode = mode.with_channel(channel, sign);
            } else {
                let row = kinetics.row(channel);
                impulses[row] = -kinetics.friction_limits(channel).0 * sign * way.kept;
                let along = kinetics.mobility(row).to_vec();
                axpy(&mut push, impulses[row], &along);
            }
        }
        let edges = kinetics.edges(mode).ok()?;
        let at = &*kinetics;
        let forces = edges.solve(|row| -(pressed.rates[row] + dot(at.normal(row), &push)));
        edges.push(&forces, &mut push);
        for (&row, force) in edges.rows().iter().zip(&forces) {
            impulses[row] = *force;
        }
        for channel in mode.slipping().iter() {
            let Some(gap) = kinetics.gap_of(channel) else { continue };
            let pull = -kinetics.friction_limits(channel).0 * mode.sign(channel);
            impulses[kinetics.row(channel)] = pull * impulses[gap];
        }
        let held = kinetics.rows_of(mode);
        let rates: Vec<f64> = (0..impulses.len())
            .map(|row| match held.has(row) {
                true => 0.0,
                false => rate_after(row, pressed.rates[row], (&push, &impulses), kinetics),
            })
            .collect();
        let violation =
            self.restitution_violation(ways, (mode, all), (&impulses, &rates), kinetics);
        let misfit = self.misfit(mode, |row| pressed.rates[row], &push, kinetics);
        let violation = violation.max(misfit);
        push.iter_mut().zip(&pressed.push).for_each(|(push, before)| *push += before);
        impulses.iter_mut().zip(&pressed.impulses).for_each(|(p, before)| *p += before);
        let positive = self.set.iter().filter(|&gap| impulses[gap] > 0.0).collect();
        let pattern = ContactMode { closed: positive, ..all };
        Some(self.exchange(pattern, impulses, push, rates, violation))
    }

    fn restitution_violation(
        &self,
        ways: &[ContactBehaviour],
        (mode, all): (ContactMode, ContactMode),
        (impulses, rates): (&[f64], &[f64]),
        kinetics: &mut Kinetics,
    ) -> f64 {
        let fastest = self.fastest(kinetics);
        let mut worst = Violation::default();
        for way in ways {
            let (gap, d) = (way.gap, kinetics.d(way.gap, way.gap));
            match mode.closed.has(gap) {
                true => worst.take(impulses[gap] - way.kept, fastest[gap] / d),
                false => worst.take(rates[gap], fastest[gap]),
            }
            let Some(channel) = way.channel else { continue };
            let (row, mu) = (kinetics.row(channel), kinetics.friction_limits(channel).0);
            if all.stick.has(channel) {
                let scale = fastest[row] / kinetics.d(row, row) + mu * fastest[gap] / d;
                worst.take(mu * impulses[gap] - impulses[row].abs(), scale);
            } else {
                worst.take(all.sign(channel) * rates[row], fastest[row]);
            }
        }
        worst.0
    }

    /// Stronge's law, of one contact.
    pub(super) fn stronge<E>(
        &self,
        kinetics: &mut Kinetics,
    ) -> Result<FrictionalExchange, Failure<E>> {
        let mut gaps = self.set.iter();
        let (Some(gap), None) = (gaps.next(), gaps.next()) else {
            return Err(Failure::Status(Status::ImpactNotSolved));
        };
        let Some(channel) = kinetics.channel_of(gap) else { return self.newton(kinetics) };
        let row = kinetics.row(channel);
        let path = Path {
            normal: kinetics.d(gap, gap),
            tangent: kinetics.d(row, row),
            both: kinetics.d(gap, row),
            mu: kinetics.friction_limits(channel).0,
            e: self.e[gap],
        };
        let end = path.follow(self.before[gap], self.before[row]);
        let end = end.ok_or(Failure::Status(Status::ImpactNotSolved))?;
        let n = kinetics.coordinates();
        let (mut push, mut impulses) = (vec![0.0; n], vec![0.0; self.before.len()]);
        (impulses[gap], impulses[row]) = (end.pressed, end.pulled);
        for (at, impulse) in [(gap, end.pressed), (row, end.pulled)] {
            let along = kinetics.mobility(at).to_vec();
            axpy(&mut push, impulse, &along);
        }
        let mut rates: Vec<f64> = (0..self.before.len())
            .map(|row| self.before[row] + dot(kinetics.normal(row), &push))
            .collect();
        (rates[gap], rates[row]) = (end.g, end.w);
        let pattern = ContactMode::from(GapSet::of(gap)).with_channel(channel, end.w);
        Ok(self.exchange(pattern, impulses, push, rates, 0.0))
    }
}

/// The mobilities of a contact, its friction and restitution.
struct Path {
    normal: f64,
    tangent: f64,
    both: f64,
    mu: f64,
    e: f64,
}

/// A place on the path of an impact: speeds, and impulses so far.
#[derive(Clone, Copy)]
struct Place {
    g: f64,
    w: f64,
    pressed: f64,
    pulled: f64,
}

impl Path {
    /// How normal and slip speed and the tangential impulse change with the normal impulse.
    fn slopes(&self, w: f64) -> [f64; 3] {
        let Self { normal, tangent, both, mu, .. } = *self;
        if w == 0.0 && both.abs() <= mu * tangent {
            let pull = -both / tangent;
            return [normal + pull * both, 0.0, pull];
        }
        let sign = if w == 0.0 { both.signum() } else { w.signum() };
        [normal - mu * sign * both, both - mu * sign * tangent, -mu * sign]
    }

    /// The end of the impact with these speeds before it.
    fn follow(&self, before: f64, slip: f64) -> Option<Place> {
        let mut at = Place { g: before, w: slip, pressed: 0.0, pulled: 0.0 };
        let (mut work, mut left) = (0.0, None);
        for _ in 0..PIECES {
            let [of_g, of_w, of_pull] = self.slopes(at.w);
            let until_stop = if at.w * of_w < 0.0 { -at.w / of_w } else { f64::INFINITY };
            let until_phase = match left {
                None if of_g > 0.0 => -at.g / of_g,
                None => f64::INFINITY,
                Some(left) => restored(at.g, of_g, left),
            };
            let length = until_stop.min(until_phase);
            if !length.is_finite() {
                return None;
            }
            let done = length * (at.g + 0.5 * length * of_g);
            work += done;
            at.g += length * of_g;
            at.w += length * of_w;
            at.pressed += length;
            at.pulled += length * of_pull;
            if until_stop <= until_phase {
                at.w = 0.0;
            }
            left = match left {
                _ if until_phase > until_stop => left.map(|left: f64| left - done),
                None => {
                    at.g = 0.0;
                    Some(-self.e * self.e * work)
                }
                Some(_) => return Some(at),
            };
        }
        None
    }
}

/// The normal impulse after which so much work is given back, from the speed `g` on that changes at
/// the rate `slope`: `g p + 1/2 slope p^2 = left`.
fn restored(g: f64, slope: f64, left: f64) -> f64 {
    if left <= 0.0 {
        return 0.0;
    }
    let root = g * g + 2.0 * slope * left;
    if root < 0.0 {
        f64::INFINITY
    } else {
        2.0 * left / (g + root.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The path by small steps.
    fn by_steps(path: &Path, g: f64, w: f64) -> (f64, f64) {
        let (mut g, mut w, mut work, mut least) = (g, w, 0.0_f64, 0.0_f64);
        let dp = 1e-6;
        loop {
            let small = if w.abs() < 2e-6 { 0.0 } else { w };
            let [of_g, of_w, _] = path.slopes(small);
            work += g * dp;
            least = least.min(work);
            (g, w) = (g + dp * of_g, w + dp * of_w);
            if g > 0.0 && work >= least * (1.0 - path.e * path.e) {
                return (g, w);
            }
        }
    }

    #[test]
    fn the_path_of_an_impact_is_that_of_small_steps() {
        for (both, mu, e, w) in [
            (0.0, 0.3, 0.5, 0.4),
            (-1.5, 0.7, 1.0, 0.6),
            (1.2, 0.2, 0.6, -0.5),
            (1.2, 0.1, 0.6, 0.1),
            (-0.8, 0.4, 0.0, -2.0),
        ] {
            let path = Path { normal: 2.5, tangent: 2.5, both, mu, e };
            let end = path.follow(-1.0, w).unwrap();
            let (g, slip) = by_steps(&path, -1.0, w);
            assert!((end.g - g).abs() < 1e-4 && (end.w - slip).abs() < 1e-4, "{both} {g} {slip}");
            // speeds are those of the impulses
            let of_g = -1.0 + 2.5 * end.pressed + both * end.pulled;
            let of_w = w + 2.5 * end.pulled + both * end.pressed;
            assert!((end.g - of_g).abs() < 1e-14 && (end.w - of_w).abs() < 1e-14);
        }
    }
}
