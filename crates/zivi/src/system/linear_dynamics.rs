//! A linear system as a model of a run.

use std::sync::Arc;

use crate::system::dynamics::{Dynamics, Layout};
use crate::system::linear_system::LinearSystem;

/// A linear system that is ready to be evaluated.
#[derive(Clone, Debug)]
pub struct LinearDynamics {
    system: Arc<LinearSystem>,
    layout: Layout,
    /// `K` and `C` column by column, one after the other: what a coordinate and its velocity do.
    columns: Vec<f64>,
    /// The values of a table.
    values: Vec<f64>,
}

impl LinearDynamics {
    /// For runs of this system.
    #[must_use]
    pub fn new(system: Arc<LinearSystem>) -> Self {
        let layout = Layout::smooth(system.load.len(), system.gaps.len());
        let n = layout.n;
        let (k, c) = (&system.stiffness, &system.damping);
        let column = |j: usize| {
            let of = move |a: &'_ Vec<f64>| (0..n).map(|i| a[i * n + j]).collect::<Vec<f64>>();
            [of(k), of(c)].concat()
        };
        let columns = (0..n).flat_map(column).collect();
        Self { system, layout, columns, values: vec![0.0; n] }
    }

    /// `p + ... - K q - C q'`.
    fn force(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) {
        let Self { system, columns, values, .. } = self;
        out.copy_from_slice(&system.load);
        for wave in &system.waves {
            let swing = (wave.omega * t + wave.phase).cos();
            for (out, amplitude) in out.iter_mut().zip(&wave.amplitude) {
                *out += amplitude * swing;
            }
        }
        for table in &system.tables {
            table.values(t, values);
            out.iter_mut().zip(&*values).for_each(|(out, value)| *out += value);
        }
        let n = out.len();
        for (pair, (q, w)) in columns.chunks_exact(2 * n).zip(q.iter().zip(w)) {
            let (k, c) = pair.split_at(n);
            for (out, (k, c)) in out.iter_mut().zip(k.iter().zip(c)) {
                *out -= k * q + c * w;
            }
        }
    }
}

impl<E> Dynamics<E> for LinearDynamics {
    fn layout(&self) -> Layout {
        self.layout
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        let layout = self.layout;
        out[layout.mass()].copy_from_slice(&self.system.mass);
        self.force(t, q, w, &mut out[layout.force()]);
        let (gap, gradient) = (layout.gap().start, layout.gradient().start);
        for (i, it) in self.system.gaps.iter().enumerate() {
            let [position, rate, acceleration] = it.motion.at(t);
            let along: f64 = it.normal.iter().zip(q).map(|(n, q)| n * q).sum();
            out[gap + i] = along + it.offset - position;
            out[gradient + i * layout.n..][..layout.n].copy_from_slice(&it.normal);
            out[layout.curvature().start + i] = -acceleration;
            out[layout.rate().start + i] = -rate;
        }
        Ok(())
    }

    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        Some(&self.system)
    }
}
