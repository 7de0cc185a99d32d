//! A linear system as a model of a run.

use std::sync::Arc;

use crate::numeric::linear_map::LinearMap;
use crate::system::dynamics::{Dynamics, Layout};
use crate::system::linear_system::LinearSystem;

/// A linear system that is ready to be evaluated.
#[derive(Clone, Debug)]
pub struct LinearDynamics {
    system: Arc<LinearSystem>,
    layout: Layout,
    /// `(K, C)`.
    matrix: LinearMap,
    /// `(q, q')`.
    state: Vec<f64>,
    /// The values of a table.
    values: Vec<f64>,
    /// The loads, and the time that they are at: at an impact it stands.
    load: Vec<f64>,
    at: f64,
}

impl LinearDynamics {
    /// For runs of this system.
    #[must_use]
    pub fn new(system: Arc<LinearSystem>) -> Self {
        let layout = Layout::smooth(system.load.len(), system.gaps.len());
        let n = layout.n;
        let entry = |i: usize, j: usize| match j.checked_sub(n) {
            None => -system.stiffness[i * n + j],
            Some(j) => -system.damping[i * n + j],
        };
        let matrix = LinearMap::new(n, 2 * n, entry);
        let [values, load] = [(); 2].map(|()| vec![0.0; n]);
        let state = vec![0.0; 2 * n];
        Self { system, layout, matrix, state, values, load, at: f64::NAN }
    }

    /// Computes the loads.
    fn load_at(&mut self, t: f64) {
        let Self { system, values, load, .. } = self;
        load.copy_from_slice(&system.load);
        for wave in &system.waves {
            let swing = (wave.omega * t + wave.phase).cos();
            for (load, amplitude) in load.iter_mut().zip(&wave.amplitude) {
                *load += amplitude * swing;
            }
        }
        for table in &system.tables {
            table.values(t, values);
            load.iter_mut().zip(&*values).for_each(|(load, value)| *load += value);
        }
        self.at = t;
    }

    /// `p + ... - K q - C q'`.
    fn force(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) {
        if t != self.at {
            self.load_at(t);
        }
        let Self { matrix, state, load, .. } = self;
        out.copy_from_slice(load);
        let (first, second) = state.split_at_mut(q.len());
        first.copy_from_slice(q);
        second.copy_from_slice(w);
        matrix.add(state, out);
    }
}

impl<E> Dynamics<E> for LinearDynamics {
    fn layout(&self) -> Layout {
        self.layout
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        let layout = self.layout;
        out[layout.mass()].copy_from_slice(&self.system.mass);
        for (row, it) in out[layout.gradient()].chunks_exact_mut(layout.n).zip(&self.system.gaps) {
            row.copy_from_slice(&it.normal);
        }
        Dynamics::<E>::evaluate_again(self, t, q, w, out)
    }

    fn evaluate_again(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.force(t, q, w, &mut out[self.layout.force()]);
        Dynamics::<E>::evaluate_gaps(self, t, q, w, out)
    }

    fn evaluate_gaps(&mut self, t: f64, q: &[f64], _: &[f64], out: &mut [f64]) -> Result<(), E> {
        let (m, layout) = (self.layout.m, self.layout);
        let (positions, rest) = out[layout.gap().start..].split_at_mut(m);
        let (_, rest) = rest.split_at_mut(m * layout.n);
        let (curvatures, rates) = rest.split_at_mut(m);
        let numbers = positions.iter_mut().zip(curvatures).zip(rates);
        for (it, ((gap, curvature), of_time)) in self.system.gaps.iter().zip(numbers) {
            let [position, rate, acceleration] = it.motion.at(t);
            let along: f64 = it.normal.iter().zip(q).map(|(n, q)| n * q).sum();
            *gap = along + it.offset - position;
            *curvature = -acceleration;
            *of_time = -rate;
        }
        Ok(())
    }

    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        Some(&self.system)
    }
}
