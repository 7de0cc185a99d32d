//! Impacts that accumulate, and what is known of the end of them.

use super::lookahead::{Deviation, Lookahead};
use super::settings::SwitchedRk;
use super::stages::Counted;
use super::stalling::StallingImpacts;
use crate::record::failure::Failure;
use crate::zeno::bounce::Bounce;
use crate::zeno::chain::Chain;
use crate::zeno::tail::Tail;
use crate::{Dependence, Force, Status};

/// Columns of the table of the Zeno time after the first. In 160 random runs with `e` up to 0.9995
/// 3 need 15 % more impacts before the jump; 5 save 8 % of them, but the error of the Zeno time is
/// twice as large in the median where `e` is near 1.
pub(crate) const COLUMNS: usize = 4;

/// The last impacts.
#[derive(Clone, Debug)]
pub(super) struct Accumulation {
    chain: Chain<f64>,
    /// Where the force last kept the mass from jumping to the end of it.
    obstacle: Option<Deviation>,
    stalling: StallingImpacts,
    /// Impacts without loss (`e = 1`) since the last rest: no chain has them.
    elastic: usize,
}

impl Accumulation {
    /// Of impacts with this restitution.
    pub(super) fn new(e: f64) -> Self {
        let stalling = StallingImpacts::default();
        Self { chain: Chain::new((), e, 0, COLUMNS), obstacle: None, stalling, elastic: 0 }
    }

    /// A run starts at a time.
    pub(super) fn start(&mut self, t: f64) {
        self.stalling = StallingImpacts::starting_at(t);
    }

    /// The impacts.
    pub(super) fn chain(&self) -> &Chain<f64> {
        &self.chain
    }

    /// Where the force last kept the mass from jumping.
    #[inline]
    pub(super) fn obstacle(&self) -> Option<Deviation> {
        self.obstacle
    }

    /// What comes next is another one.
    #[inline]
    pub(super) fn clear(&mut self) {
        self.chain.clear();
        self.elastic = 0;
    }

    /// Counts an impact without loss.
    #[inline]
    pub(super) fn note_elastic(&mut self) {
        self.elastic += 1;
    }

    /// From here on the force is another one.
    #[inline]
    pub(super) fn forget_force(&mut self) {
        self.obstacle = None;
        self.clear();
    }

    /// An error where there were too many impacts without an end.
    #[inline]
    pub(super) fn check_budget<E>(&mut self, most: usize) -> Result<(), Failure<E>> {
        if self.chain.bounces().len().max(self.elastic) > most {
            self.clear();
            return Err(Failure::Status(Status::ZenoBudget));
        }
        Ok(())
    }

    /// The arcs from the last impact to the end.
    pub(super) fn tail(&self, zeno: f64, sigma: f64) -> Tail {
        self.chain.tail(zeno, sigma)
    }

    /// Appends an impact, after which the mass is on the branch `sigma`: where the impacts come to
    /// rest, if that is known to the tolerance and lies before `t_end`.
    pub(super) fn note<E, F: Force<E>>(
        &mut self,
        bounce: Bounce,
        (sigma, t_end): (f64, f64),
        settings: &SwitchedRk,
        force: &mut Counted<'_, F>,
    ) -> Result<Option<f64>, Failure<E>> {
        self.check_stalling(bounce, self.chain.e(), settings)?;
        self.chain.note(bounce, &[], &[])?;
        if bounce.g > 0.0 {
            self.end(bounce, (sigma, t_end), settings, force)
        } else {
            Ok(None)
        }
    }

    /// An error where the impacts, each of which leaves the part `e < 1` of the speed, go on at a wall
    /// without a pull.
    fn check_stalling<E>(
        &mut self,
        bounce: Bounce,
        e: f64,
        settings: &SwitchedRk,
    ) -> Result<(), Failure<E>> {
        // where errors of the tolerance in each flight keep the speed up
        let slow = 10.0 * settings.atol[1] / (1.0 - e);
        if self.stalling.goes_on(bounce, slow) {
            return Err(Failure::Status(Status::ZenoBudget));
        }
        Ok(())
    }

    /// Takes an impact that is in no geometric chain, after which each leaves at most the part `e` of the
    /// speed: whether the time that is left of all of them, at most `2 u/(g (1 - e))`, is below rounding.
    pub(super) fn note_alone<E>(
        &mut self,
        bounce: Bounce,
        e: f64,
        settings: &SwitchedRk,
    ) -> Result<bool, Failure<E>> {
        self.chain.clear();
        if e < 1.0 {
            self.check_stalling(bounce, e, settings)?;
        }
        let Bounce { t, u, g } = bounce;
        let (flight, rounding) = (2.0 * u / g, f64::EPSILON * t.abs());
        let over = g > 0.0 && flight <= 4.0 * rounding * (1.0 - e);
        if g > 0.0 && !over && flight <= 0.25 * rounding {
            // impacts that do not end, at one time
            return Err(Failure::Status(Status::ZenoBudget));
        }
        Ok(over)
    }

    /// Where the chain comes to rest, if that is known.
    fn end<E, F: Force<E>>(
        &mut self,
        last: Bounce,
        (sigma, t_end): (f64, f64),
        settings: &SwitchedRk,
        force: &mut Counted<'_, F>,
    ) -> Result<Option<f64>, Failure<E>> {
        let t = last.t;
        if self.chain.is_over() {
            return Ok(Some((t + self.chain.remaining(last)).min(t_end)));
        }
        let tolerance = settings.zeno_tolerance(&self.chain, last.g);
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
        let (e, max_step) = (self.chain.e(), settings.max_step);
        let tail = self.chain.tail(zeno, sigma);
        let period = force.shortest_period::<E>();
        let lookahead = Lookahead { tail: &tail, e, tolerance, max_step, period };
        self.obstacle = lookahead.obstacle(self.obstacle, force)?;
        Ok(self.obstacle.is_none().then_some(zeno))
    }
}
