//! A plant as a controller believes it to be.

use crate::mechanics::{simulate_mechanical_loop, Sampling};
use crate::switched::{Order, SwitchedRk};
use crate::system::driven::Driven;
use crate::system::dynamics::{Dynamics, Layout};
use crate::{AnyImpactLaw, Monitor, Status};

use super::kinetics::GapKinetics;
use super::law_error::LawError;
use super::tasks::Tasks;

/// One step of the pair of order 5 between two of these times, whose length no error controls.
#[must_use]
pub fn one_step_each(settings: SwitchedRk, times: &[f64]) -> SwitchedRk {
    let longest = times.windows(2).map(|it| it[1] - it[0]).fold(0.0, f64::max);
    SwitchedRk { adaptive: false, max_step: longest, order: Order::Five, ..settings }
}

/// Nobody watches.
struct Unwatched;

impl<E> Monitor<E> for Unwatched {
    fn poll(&mut self, _: usize, _: usize) -> Result<(), E> {
        Ok(())
    }
}

/// Steps of Newton's method onto closed gaps.
const PROJECTIONS: usize = 4;

/// A system that is evaluated at states, and moves under held controls, with its impacts and contacts.
#[derive(Debug)]
pub struct BelievedPlant<'a, D, F> {
    /// The system.
    pub driven: &'a mut Driven<D, F>,
    /// Functions of its coordinates that may follow a reference.
    pub tasks: Option<&'a mut Tasks<D>>,
    /// Impact laws of the gaps.
    pub laws: &'a [AnyImpactLaw],
    /// Length of a period (s).
    pub h: f64,
}

/// Coordinates, velocities, contacts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moved {
    /// Coordinates.
    pub q: Vec<f64>,
    /// Velocities.
    pub w: Vec<f64>,
    /// Which gaps are closed.
    pub closed: Vec<bool>,
    /// Whether the motion was computed to its end; it stays where it was lost otherwise.
    pub completed: bool,
}

impl<D, F> BelievedPlant<'_, D, F> {
    /// How many coordinates and gaps there are.
    pub fn layout<E>(&self) -> Layout
    where
        Driven<D, F>: Dynamics<E>,
    {
        Dynamics::<E>::layout(self.driven)
    }

    /// Evaluates the system without controls, and its kinetics; the matrix of inputs is that of this
    /// state from now on.
    ///
    /// # Errors
    /// [`LawError`].
    pub fn look<E>(
        &mut self,
        t: f64,
        (q, w): (&[f64], &[f64]),
        kinetics: &mut GapKinetics,
    ) -> Result<(), LawError<E>>
    where
        Driven<D, F>: Dynamics<E>,
    {
        self.look_at_any(t, (q, w), kinetics)?;
        kinetics.check_independent()
    }

    /// The same of gaps that may depend on each other.
    fn look_at_any<E>(
        &mut self,
        t: f64,
        (q, w): (&[f64], &[f64]),
        kinetics: &mut GapKinetics,
    ) -> Result<(), LawError<E>>
    where
        Driven<D, F>: Dynamics<E>,
    {
        self.driven.release();
        self.driven.evaluate_again(t, q, w, &mut kinetics.row).map_err(LawError::Raised)?;
        kinetics.renew(w)
    }

    /// Moves on by as many periods as there are controls, by one step of order five a period.
    ///
    /// # Errors
    /// [`LawError`], for a state with a gap below 0, too.
    pub fn moved<E>(
        &mut self,
        t: f64,
        (q, w): (&[f64], &[f64]),
        controls: &[f64],
    ) -> Result<Moved, LawError<E>>
    where
        D: Dynamics<E>,
        Driven<D, F>: Dynamics<E>,
    {
        let (h, r, layout) = (self.h, self.driven.control().len(), self.layout::<E>());
        let times: Vec<f64> = (0..=controls.len() / r).map(|k| t + h * k as f64).collect();
        let settings = SwitchedRk { rtol: 1e-9, atol: [1e-12; 2], ..SwitchedRk::DEFAULT };
        let settings = one_step_each(settings, &times);
        let sampling = Sampling { times: &times, stops: &times[1..times.len() - 1] };
        let mut ticks = |k: usize, _: f64, _: (&[f64], &[f64]), u: &mut [f64]| -> Result<(), E> {
            u.copy_from_slice(&controls[k * r..][..r]);
            Ok(())
        };
        let (system, start) = ((&mut *self.driven, self.laws), (&controls[..r], &mut ticks));
        let (run, _) = simulate_mechanical_loop(
            settings,
            system,
            sampling,
            (q, w),
            start,
            false,
            &mut Unwatched,
        )
        .map_err(LawError::Setup)?;
        if let Some(raised) = run.raised {
            return Err(LawError::Raised(raised));
        }
        let last = run.samples.x.len() - layout.size();
        let picked = |of: &[f64]| of[last..][..layout.n].to_vec();
        let mode = run.samples.modes.last().map(|mode| mode.closed).unwrap_or_default();
        let closed = (0..layout.m).map(|i| mode.has(i)).collect();
        let completed = run.status == Status::Completed;
        Ok(Moved { q: picked(&run.samples.x), w: picked(&run.samples.v), closed, completed })
    }

    /// Where a state will be after these controls, from where it fits the contacts that are held.
    ///
    /// # Errors
    /// [`LawError`].
    pub(super) fn ahead<E>(
        &mut self,
        t: f64,
        (q, w): (&[f64], &[f64]),
        held: &[bool],
        controls: Vec<f64>,
        kinetics: &mut GapKinetics,
    ) -> Result<(Vec<f64>, Vec<f64>), LawError<E>>
    where
        D: Dynamics<E>,
        Driven<D, F>: Dynamics<E>,
    {
        let (mut q, mut w) = (q.to_vec(), w.to_vec());
        self.onto(t, (&mut q, &mut w), held, kinetics)?;
        let moved = self.moved(t, (&q, &w), &controls)?;
        Ok((moved.q, moved.w))
    }

    /// Moves a state, M-orthogonally, to where contacts are closed and no gap is below 0.
    ///
    /// # Errors
    /// [`LawError`].
    pub fn onto<E>(
        &mut self,
        t: f64,
        (q, w): (&mut [f64], &mut [f64]),
        closed: &[bool],
        kinetics: &mut GapKinetics,
    ) -> Result<(), LawError<E>>
    where
        Driven<D, F>: Dynamics<E>,
    {
        let mut moved = Vec::with_capacity(closed.len());
        for _ in 0..PROJECTIONS {
            self.look_at_any(t, (q, w), kinetics)?;
            let gaps = kinetics.gaps().to_vec();
            moved.clear();
            moved.extend(closed.iter().zip(&gaps).map(|(closed, gap)| *closed || *gap < 0.0));
            if moved.iter().zip(&gaps).all(|(moved, gap)| !moved || *gap == 0.0) {
                break;
            }
            kinetics.push(&moved, gaps, q);
        }
        if closed.contains(&true) {
            self.look_at_any(t, (q, w), kinetics)?;
            let rates = kinetics.rates.clone();
            kinetics.push(closed, rates, w);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_prediction_takes_steps_of_order_five_whatever_was_set() {
        let settings = SwitchedRk { order: Order::Eight, ..SwitchedRk::DEFAULT };
        let found = one_step_each(settings, &[0.0, 1.0, 3.0]);
        assert_eq!((found.order, found.max_step, found.adaptive), (Order::Five, 2.0, false));
    }
}
