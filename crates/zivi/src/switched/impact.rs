//! Impacts, what follows from them, and the jump to rest.

use super::integrator::{Piece, SwitchedIntegrator};
use super::lookahead::Lookahead;
use super::mode::{Flight, Mode};
use super::point::Point;
use super::stages::Counted;
use crate::record::failure::Failure;
use crate::zeno::bounce::{restored, Bounce};
use crate::{Dependence, Force, Impact, Status};

impl SwitchedIntegrator {
    /// The impact with the velocity `xdot < 0`: `x'+ = -e x'-`.
    pub(super) fn strike(&mut self, from: Point, contact: Point) -> Piece {
        let Point { t, xdot, .. } = contact;
        let after = restored(self.restitution.e(), xdot);
        let impact = Impact { t, xdot_before: xdot, xdot_after: after };
        let sigma = self.sigma;
        self.counts.impacts += 1;
        self.now = Point { x: 0.0, xdot: after, ..contact };
        self.sigma = -sigma;
        self.mode = Mode::Flight(Flight::Weigh);
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
            // the impact stops the mass, which stays in the origin or is pulled off at once
            let stays = self.at_wall(force)? <= 0.0;
            self.mode = if stays { Mode::FLIGHT } else { Mode::LIFT_OFF };
            self.chain.clear();
            return Ok(());
        }
        let mut zeno = None;
        if self.restitution.e() < 1.0 {
            let bounce = Bounce { t, u, g: -self.at_wall(force)? };
            // where errors of the tolerance in each flight keep the speed up
            let slow = 10.0 * self.settings.atol[1] / (1.0 - self.restitution.e());
            if self.stalling.goes_on(bounce, slow) {
                return Err(Failure::Status(Status::ZenoBudget));
            }
            self.chain.note(bounce, &[], &[])?;
            if bounce.g > 0.0 {
                zeno = self.end_of_chain(bounce, t_end, force)?;
            }
        }
        self.mode = zeno.map_or(Mode::FLIGHT, |zeno| Mode::Flight(Flight::Jump { zeno }));
        Ok(())
    }

    /// Where the chain comes to rest, if that is known to the tolerance and lies before `t_end`.
    fn end_of_chain<E, F: Force<E>>(
        &mut self,
        last: Bounce,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Option<f64>, Failure<E>> {
        let t = last.t;
        if self.chain.is_over() {
            return Ok(Some((t + self.chain.remaining(last)).min(t_end)));
        }
        let tolerance = self.settings.zeno_tolerance(&self.chain, last.g);
        let is_constant = force.dependence::<E>() == Dependence::Constant;
        let exact = self.chain.end_under_constant_pull().filter(|_| is_constant);
        let known = exact.or_else(|| {
            let landing = self.chain.landing(&[1.0]);
            landing.filter(|landing| landing.size <= tolerance).map(|landing| landing.t)
        });
        let ahead = known.filter(|&zeno| zeno > t && zeno <= t_end);
        let Some(zeno) = ahead else { return Ok(None) };
        if is_constant {
            return Ok(Some(zeno));
        }
        let (e, max_step) = (self.restitution.e(), self.settings.max_step);
        let tail = self.chain.tail(zeno, self.sigma);
        let period = force.shortest_period::<E>();
        let lookahead = Lookahead { tail: &tail, e, tolerance, max_step, period };
        self.obstacle = lookahead.obstacle(self.obstacle, force)?;
        Ok(self.obstacle.is_none().then_some(zeno))
    }

    /// Through the rest of the chain, to rest at `zeno`.
    pub(super) fn jump(&mut self, zeno: f64) -> Piece {
        let tail = self.chain.tail(zeno, self.sigma);
        self.now = Point { t: zeno, ..Point::default() };
        self.mode = Mode::REST;
        self.chain.clear();
        self.lookout.length = self.control.h.take().or(self.lookout.length);
        Piece::Tail(tail)
    }
}
