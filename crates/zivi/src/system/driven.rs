//! A mechanical system under a control that acts through a matrix of inputs.
//!
//! ```text
//! M q'' = F + B(t, q) u + N^T lambda
//! ```

use std::sync::Arc;

use crate::system::dynamics::{Dynamics, Layout};
use crate::system::friction::Friction;
use crate::system::linear_system::LinearSystem;

/// The matrix `B`, `n x r` row by row.
#[derive(Clone, Debug)]
pub enum InputMatrix<F> {
    /// Constant.
    Constant(Vec<f64>),
    /// A function of time and coordinates that fills it in.
    Function(F),
}

/// A system with the force `B u` of a control that is held.
#[derive(Clone, Debug)]
pub struct Driven<D, F> {
    dynamics: D,
    inputs: InputMatrix<F>,
    u: Vec<f64>,
    /// `B`, where it is a function.
    matrix: Vec<f64>,
    /// `B u`.
    force: Vec<f64>,
    /// How much nearer walls are than the system says; of no gap if empty.
    offsets: Vec<f64>,
}

impl<D, F> Driven<D, F> {
    /// A system of `n` coordinates with `r` inputs, which are zero; `None` if a constant matrix has
    /// another size.
    pub fn new(dynamics: D, (n, r): (usize, usize), inputs: InputMatrix<F>) -> Option<Self> {
        if let InputMatrix::Constant(matrix) = &inputs {
            if matrix.len() != n * r {
                return None;
            }
        }
        let (matrix, force) = (vec![0.0; n * r], vec![0.0; n]);
        Some(Self { dynamics, inputs, u: vec![0.0; r], matrix, force, offsets: Vec::new() })
    }

    /// Holds this control from here on.
    pub fn hold(&mut self, u: &[f64]) {
        self.u.copy_from_slice(u);
        if let InputMatrix::Constant(matrix) = &self.inputs {
            product(matrix, &self.u, &mut self.force);
        }
    }

    /// Holds none.
    pub fn release(&mut self) {
        self.u.fill(0.0);
        self.force.fill(0.0);
    }

    /// From here on gaps are smaller by these numbers than the system says; those of none if empty.
    pub fn offset(&mut self, by: &[f64]) {
        self.offsets.clear();
        self.offsets.extend_from_slice(by);
    }

    /// `B`, `n x r` row by row, where it was last evaluated.
    pub fn matrix(&self) -> &[f64] {
        match &self.inputs {
            InputMatrix::Constant(matrix) => matrix,
            InputMatrix::Function(_) => &self.matrix,
        }
    }

    /// The control that is held.
    pub fn control(&self) -> &[f64] {
        &self.u
    }
}

/// `to = B u`.
fn product(matrix: &[f64], u: &[f64], to: &mut [f64]) {
    for (i, to) in to.iter_mut().enumerate() {
        let row = &matrix[i * u.len()..][..u.len()];
        *to = row.iter().zip(u).map(|(b, u)| b * u).sum();
    }
}

impl<E, D, F> Dynamics<E> for Driven<D, F>
where
    D: Dynamics<E>,
    F: FnMut(f64, &[f64], &mut [f64]) -> Result<(), E>,
{
    fn layout(&self) -> Layout {
        self.dynamics.layout()
    }

    fn friction(&self) -> &Friction {
        self.dynamics.friction()
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> Result<(), E> {
        self.dynamics.evaluate(t, q, w, out)?;
        if let InputMatrix::Function(function) = &mut self.inputs {
            function(t, q, &mut self.matrix)?;
            product(&self.matrix, &self.u, &mut self.force);
        }
        let force = &mut out[self.dynamics.layout().force()];
        force.iter_mut().zip(&self.force).for_each(|(to, force)| *to += force);
        let gaps = &mut out[self.dynamics.layout().gap()];
        gaps.iter_mut().zip(&self.offsets).for_each(|(gap, offset)| *gap -= offset);
        Ok(())
    }

    fn is_steady(&self) -> bool {
        self.dynamics.is_steady() && matches!(self.inputs, InputMatrix::Constant(_))
    }

    /// None: the control is no load of the linear system.
    fn linear(&self) -> Option<&Arc<LinearSystem>> {
        None
    }
}
