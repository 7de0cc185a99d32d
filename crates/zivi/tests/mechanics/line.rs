//! Systems whose masses are diagonal and whose gaps are linear.

use std::convert::Infallible;

use zivi::mechanics::{simulate_mechanical, MechanicalOutput, MechanicalRun};
use zivi::system::dynamics::{Dynamics, Layout};
use zivi::system::impact_law::newton_impacts;
use zivi::{Silent, SwitchedRk};

use crate::models::of_function;

/// Masses, gaps `n . q + c`, restitutions and a start at `t = 0`.
#[derive(Clone, Debug)]
pub(crate) struct Linear {
    pub(crate) mass: Vec<f64>,
    pub(crate) gaps: Vec<(Vec<f64>, f64)>,
    pub(crate) e: Vec<f64>,
    pub(crate) q: Vec<f64>,
    pub(crate) w: Vec<f64>,
}

impl Linear {
    pub(crate) fn layout(&self) -> Layout {
        Layout::smooth(self.mass.len(), self.gaps.len())
    }

    /// The system under forces of time.
    pub(crate) fn dynamics<'a>(
        &'a self,
        mut force: impl FnMut(f64) -> Vec<f64> + 'a,
    ) -> impl Dynamics<Infallible> + 'a {
        let layout = self.layout();
        let function = move |t: f64, q: &[f64], _: &[f64], out: &mut [f64]| {
            out.fill(0.0);
            for (i, mass) in self.mass.iter().enumerate() {
                out[layout.mass()][i * (layout.n + 1)] = *mass;
            }
            out[layout.force()].copy_from_slice(&force(t));
            for (i, (normal, offset)) in self.gaps.iter().enumerate() {
                out[layout.gap()][i] = dot(normal, q) + offset;
                out[layout.gradient()][i * layout.n..][..layout.n].copy_from_slice(normal);
            }
            Ok(())
        };
        of_function(layout, function)
    }

    pub(crate) fn run(
        &self,
        force: impl FnMut(f64) -> Vec<f64>,
        t1: f64,
        settings: SwitchedRk,
    ) -> MechanicalRun<Infallible> {
        let (start, output) = ((&self.q[..], &self.w[..]), MechanicalOutput::default());
        let mut system = self.dynamics(force);
        simulate_mechanical(
            settings,
            &mut system,
            &newton_impacts(&self.e).unwrap(),
            (0.0, t1),
            start,
            output,
            &mut Silent,
        )
        .unwrap()
    }
}

pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}
