//! Runs of the models with shared helpers.

use std::convert::Infallible;

use zivi::mechanics::{simulate_mechanical, MechanicalOutput, MechanicalRun, Occurrence};
use zivi::system::impact_law::newton_impacts;
use zivi::{Silent, SwitchedRk};

use crate::models::{Model, Parameters};

/// An event: what, when, which gap.
pub(crate) type Event = (&'static str, f64, usize);

/// A run over a span from 0.
pub(crate) struct Problem {
    pub(crate) model: &'static str,
    pub(crate) par: Parameters,
    pub(crate) e: Vec<f64>,
    pub(crate) q0: Vec<f64>,
    pub(crate) w0: Vec<f64>,
    pub(crate) t1: f64,
}

pub(crate) fn parameters(pairs: &[(&str, f64)]) -> Parameters {
    pairs.iter().map(|&(name, value)| (name.to_owned(), value)).collect()
}

impl Problem {
    pub(crate) fn run(&self, settings: SwitchedRk) -> MechanicalRun<Infallible> {
        self.run_with(settings, MechanicalOutput::default())
    }

    pub(crate) fn run_with(
        &self,
        settings: SwitchedRk,
        output: MechanicalOutput<'_, Infallible>,
    ) -> MechanicalRun<Infallible> {
        let mut model = Model::new(self.model, self.par.clone());
        let start = (&self.q0[..], &self.w0[..]);
        let span = (0.0, self.t1);
        simulate_mechanical(
            settings,
            &mut model,
            &newton_impacts(&self.e).unwrap(),
            span,
            start,
            output,
            &mut Silent,
        )
        .unwrap()
    }
}

/// Zeno points, lift-offs and corners.
pub(crate) fn events_of<E>(run: &MechanicalRun<E>) -> Vec<Event> {
    let event = |it: &Occurrence| match *it {
        Occurrence::Zeno { t, gap, .. } => Some(("zeno", t, gap)),
        Occurrence::LiftOff { t, gap } => Some(("lift", t, gap)),
        Occurrence::Corner { t, .. } => Some(("corner", t, 0)),
        _ => None,
    };
    run.occurrences.iter().filter_map(event).collect()
}

/// The last coordinates and velocities.
pub(crate) fn last_state<E>(run: &MechanicalRun<E>) -> Vec<f64> {
    let (n, size) = (run.layout.n, run.layout.n + run.layout.m);
    let last = run.samples.x.len() - size;
    [&run.samples.x[last..][..n], &run.samples.v[last..][..n]].concat()
}
