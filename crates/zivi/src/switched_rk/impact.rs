//! Impacts, what follows from them, and the jump to rest.

use super::chain::{Bounce, Chain};
use super::integrator::{Mode, Piece, SwitchedIntegrator};
use super::stages::{Counted, Point};
use super::tail::Tail;
use crate::fixed_step::Failure;
use crate::{Dependence, Force, Impact};

/// A Zeno time must lie within so many times the time that a constant pull would take.
const NEAR: f64 = 3.0;

impl SwitchedIntegrator {
    /// The impact at `t` with the velocity `xdot < 0`: `x'+ = -e x'-`.
    pub(super) fn strike(&mut self, from: Point, t: f64, xdot: f64) -> Piece {
        let after = self.wall.e() * xdot.abs();
        // the height of the next arc would underflow
        let after = if after * after < f64::MIN_POSITIVE { 0.0 } else { after };
        let impact = Impact { t, xdot_before: xdot, xdot_after: after };
        let sigma = self.sigma;
        self.counts.impacts += 1;
        self.now = Point { t, x: 0.0, xdot: after };
        self.sigma = -sigma;
        (self.armed, self.continues, self.struck) = (true, false, true);
        Piece::Flight { from, sigma, impact: Some(impact) }
    }

    /// What follows from the last impact: flight, rest, or the end of a chain.
    pub(super) fn weigh_impact<E, F: Force<E>>(
        &mut self,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let Point { t, xdot: u, .. } = self.now;
        if u == 0.0 {
            // the impact stops the mass, which stays or is pulled off
            let stays = force.at_wall(t)? <= 0.0;
            self.armed = stays;
            self.chain.clear();
            return Ok(());
        }
        if self.wall.e() == 1.0 {
            return Ok(()); // nothing accumulates
        }
        let bounce = Bounce { t, u, g: -force.at_wall(t)? };
        self.chain.note(bounce);
        if bounce.g > 0.0 {
            self.zeno = self.end_of_chain(bounce, t_end, force)?;
        }
        Ok(())
    }

    /// Where the chain comes to rest, if that is known to the tolerance and lies before `t_end`.
    fn end_of_chain<E, F: Force<E>>(
        &self,
        last: Bounce,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Option<f64>, Failure<E>> {
        let t = last.t;
        let remaining = self.chain.remaining(last);
        // the floor: what is left of the chain is below rounding
        if remaining <= 4.0 * f64::EPSILON * t.abs() {
            return Ok(Some((t + remaining).min(t_end)));
        }
        if self.chain.is_spent() && t + remaining <= t_end {
            let pulled = is_pulled(t, t + remaining, force)?;
            return Ok(Some(if pulled { t + remaining } else { t }));
        }
        let Some(zeno) = self.chain.zeno_time() else { return Ok(None) };
        let left = zeno.t - t;
        let plausible = left > 0.0 && left < NEAR * remaining && zeno.t <= t_end;
        let known = zeno.error <= self.zeno_tolerance(&self.chain, last.g);
        Ok(if plausible && known && is_pulled(t, zeno.t, force)? { Some(zeno.t) } else { None })
    }

    /// `rtol T + min(atol_x/U, atol_x'/g)`: see [`crate::SwitchedRk`].
    fn zeno_tolerance(&self, chain: &Chain, pull: f64) -> f64 {
        let [atol_x, atol_xdot] = self.settings.atol;
        let absolute = (atol_x / chain.fastest()).min(atol_xdot / pull);
        absolute + self.settings.rtol * chain.duration()
    }

    /// Through the rest of the chain, to rest at `zeno`.
    pub(super) fn jump(&mut self, zeno: f64) -> Piece {
        let tail = Tail::new(&self.chain, self.wall.e(), zeno, self.sigma);
        self.now = Point { t: zeno, x: 0.0, xdot: 0.0 };
        self.mode = Mode::Rest;
        self.continues = false;
        self.chain.clear();
        self.lookout.length = self.h.take().or(self.lookout.length);
        Piece::Tail(tail)
    }
}

/// Whether the force pulls towards the wall all the way from `t` to `end`.
fn is_pulled<E, F: Force<E>>(
    t: f64,
    end: f64,
    force: &mut Counted<'_, F>,
) -> Result<bool, Failure<E>> {
    if force.dependence::<E>() == Dependence::Constant {
        return Ok(true);
    }
    for part in [0.25, 0.5, 0.75, 1.0] {
        if force.at_wall(t + part * (end - t))? >= 0.0 {
            return Ok(false);
        }
    }
    Ok(true)
}
