//! The columns at rest: where it begins, what limits it, the lift-off that ends it.
//!
//! ```text
//! rest      X = V = 0
//! lift-off  dt = -f_q/f_t at (t, 0, 0),  X = V = 0
//! ```

use super::VariationalRun;
use crate::record::failure::Failure;
use crate::switched::sensitivity::validity::Limit;
use crate::switched::stages::Counted;
use crate::system::slopes::DifferentiableForce;
use crate::Dependence;

/// Looks at the slope of the force over a part of a rest.
const LOOKS: u32 = 8;

impl VariationalRun {
    /// At rest, where the Zeno time moves by `self.dt`.
    pub(super) fn came_to_rest<E, F: DifferentiableForce<E>>(
        &mut self,
        t: f64,
        through_chain: bool,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        self.step.end.clear();
        self.events.zeno_times.extend_from_slice(&self.dt);
        self.note_neighbours(t);
        if through_chain {
            let pull = -force.at_wall(t)?;
            let mut rates = vec![0.0; self.dt.len()];
            self.wall_rates(t, &self.dt.clone(), force, &mut rates)?;
            self.validity.note(Limit::Zeno, t, pull, rates);
        }
        self.resting = Some(t);
        Ok(())
    }

    /// At rest by an impact that stops the mass: with `e > 0` it would go on for `2 u/g` more.
    fn stopped<E, F: DifferentiableForce<E>>(
        &mut self,
        t: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let pull = -force.at_wall(t)?;
        if pull > 0.0 {
            for (dt, du) in self.dt.iter_mut().zip(&self.du) {
                *dt += 2.0 * du / pull;
            }
        }
        self.came_to_rest(t, false, force)
    }

    /// A part of a rest, and the lift-off at its end.
    pub(super) fn rest<E, F: DifferentiableForce<E>>(
        &mut self,
        (from, to): (f64, f64),
        lifted: bool,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let since = match self.resting {
            Some(since) => since,
            None => {
                self.stopped(from, force)?;
                from
            }
        };
        if force.dependence_at_rest::<E>() != Dependence::Constant {
            self.maxima_at_rest(from, to, force)?;
        } else if !lifted {
            let pull = -force.at_wall(from)?;
            let mut rates = vec![0.0; self.dt.len()];
            self.wall_rates(from, &vec![0.0; rates.len()], force, &mut rates)?;
            self.validity.note(Limit::Rest, from, pull, rates);
        }
        if lifted {
            // at once where the force jumps to a pull: at a fixed time
            let jumped = from == to && since < to && self.stops.contains(&to);
            if jumped {
                self.dt.fill(0.0);
            }
            self.lift_off(to, to > since && !jumped, force)?;
        }
        Ok(())
    }

    fn lift_off<E, F: DifferentiableForce<E>>(
        &mut self,
        t: f64,
        smoothly: bool,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        self.step.end.clear();
        if smoothly {
            let mut rates = vec![0.0; self.dt.len()];
            let zeros = rates.clone();
            let mut rise = self.wall_rates(t, &zeros, force, &mut rates)?;
            // the run has the time to a few roundings; the derivatives are those at the root
            let off = force.at_wall(t)? / rise;
            if off.abs() <= 64.0 * f64::EPSILON * t.abs() {
                rise = self.wall_rates(t - off, &zeros, force, &mut rates)?;
            }
            for (dt, rate) in self.dt.iter_mut().zip(&rates) {
                *dt = if *rate == 0.0 { 0.0 } else { -rate / rise };
            }
            // a maximum of f_t^2/(2 |f_tt|) above zero: f_tt over the time in which f_t changes
            let ahead = 1e-4 * (self.end - t).min(1.0);
            let mut unused = zeros.clone();
            let later = self.wall_rates(t + ahead, &zeros, force, &mut unused)?;
            let curvature = ((later - rise) / ahead).abs();
            let height = rise * rise / (2.0 * curvature);
            if height.is_finite() {
                self.validity.note(Limit::LiftOff, t, height, rates.iter().copied());
            }
        } else {
            let pull = force.at_wall(t)?;
            for (v, dt) in self.step.end.v.iter_mut().zip(&self.dt) {
                *v = -pull * dt;
            }
        }
        self.note_neighbours(t);
        self.events.liftoff_times.extend_from_slice(&self.dt);
        self.resting = None;
        Ok(())
    }

    /// Where the force at rest is at a maximum below zero: its slope changes from + to -.
    fn maxima_at_rest<E, F: DifferentiableForce<E>>(
        &mut self,
        from: f64,
        to: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let zeros = vec![0.0; self.dt.len()];
        let mut rates = zeros.clone();
        let (mut before, mut rise) = (from, self.wall_rates(from, &zeros, force, &mut rates)?);
        for look in 1..=LOOKS {
            let at = from + (to - from) * f64::from(look) / f64::from(LOOKS);
            let next = self.wall_rates(at, &zeros, force, &mut rates)?;
            if rise > 0.0 && next <= 0.0 {
                let slope = |t: f64| self.wall_rates(t, &zeros, force, &mut rates);
                let top = crate::numeric::root::between((before, rise), (at, next), slope)?.best;
                let pull = -force.at_wall(top)?;
                self.wall_rates(top, &zeros, force, &mut rates)?;
                self.validity.note(Limit::Rest, top, pull, rates.iter().copied());
            }
            (before, rise) = (at, next);
        }
        Ok(())
    }
}
