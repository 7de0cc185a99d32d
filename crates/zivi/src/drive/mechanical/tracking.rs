//! The tracker of gaps in a loop.

use super::believed_plant::BelievedPlant;
use super::gap_tracker::GapTracker;
use super::law_error::LawError;
use super::reference::MechanicalReference;
use super::sampled::MechanicalController;
use crate::system::dynamics::{Driven, Dynamics};

/// A gap tracker with its model of the plant and its reference.
pub struct Tracking<'a, D, F, A, E> {
    /// The law.
    pub law: GapTracker,
    /// Its model.
    pub plant: BelievedPlant<'a, D, F>,
    /// Where it is to be; all gaps land and rest without it.
    pub reference: Option<&'a MechanicalReference>,
    /// The force with which a contact is pressed at a time, if one is requested.
    pub asked: A,
    /// Converts an error of the law.
    pub wrong: fn(LawError<E>) -> E,
}

impl<E, D, F, A> MechanicalController<E> for Tracking<'_, D, F, A, E>
where
    D: Dynamics<E>,
    Driven<D, F>: Dynamics<E>,
    A: FnMut(usize, f64) -> Result<Option<f64>, E>,
{
    fn tick(&mut self, k: usize, t: f64, state: (&[f64], &[f64]), u: &mut [f64]) -> Result<u8, E> {
        let Self { law, plant, reference, asked, wrong } = self;
        let layout = plant.layout();
        let ends = reference.map(|reference| {
            [0, 1].map(|it| reference.sample(k + law.settings.delay + it, (layout.n, layout.m)))
        });
        law.tick(plant, t, state, ends, asked, u).map_err(*wrong)?;
        Ok(law.state.status)
    }

    fn latched(&self, to: &mut [bool]) -> Result<(), E> {
        to.copy_from_slice(&self.law.state.latch.held);
        Ok(())
    }
}
