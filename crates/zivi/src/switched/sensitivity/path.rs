//! The columns as functions of time.

use super::columns::{ColumnStep, Columns};
use crate::numeric::bernstein::evaluate;
use crate::switched::stages::Stages;

#[derive(Clone, Copy, Debug, PartialEq)]
enum PathPiece {
    /// Polynomials of this degree, their coefficients from here on, over a step of length `h`.
    Flight {
        first: usize,
        degree: usize,
        h: f64,
    },
    /// Infinitely many impacts: not known here.
    Tail,
    Rest,
}

/// The columns between the start of a run and its end.
#[derive(Clone, Debug, Default)]
pub(in crate::switched) struct ColumnPath {
    m: usize,
    segments: Vec<(f64, PathPiece)>,
    coefficients: Vec<f64>,
}

impl ColumnPath {
    pub(in crate::switched) fn new(m: usize) -> Self {
        Self { m, ..Self::default() }
    }

    /// A step, up to an impact within it if any.
    pub(in crate::switched) fn push_flight(
        &mut self,
        stages: &Stages,
        step: &ColumnStep,
        length: Option<f64>,
    ) {
        let (first, mut degree) = (self.coefficients.len(), 0);
        let h = length.unwrap_or(stages.h);
        for column in 0..self.m {
            for polynomial in step.polynomials(stages, column) {
                let part = match length {
                    Some(length) => polynomial.split(length / stages.h).0,
                    None => polynomial,
                };
                degree = part.coefficients().len() - 1;
                self.coefficients.extend_from_slice(part.coefficients());
            }
        }
        self.push(stages.from.t, PathPiece::Flight { first, degree, h });
    }

    pub(in crate::switched) fn push_tail(&mut self, start: f64) {
        self.push(start, PathPiece::Tail);
    }

    pub(in crate::switched) fn push_rest(&mut self, start: f64) {
        self.push(start, PathPiece::Rest);
    }

    fn push(&mut self, start: f64, kind: PathPiece) {
        if self.segments.last().is_some_and(|last| last.0 == start) {
            self.segments.pop();
        }
        self.segments.push((start, kind));
    }

    /// `dx/dq` and `dx'/dq` at `t`; at an impact, after it; NaN in a tail, and before the
    /// start.
    pub(in crate::switched) fn at(&self, t: f64) -> Columns {
        let after = self.segments.partition_point(|segment| segment.0 <= t);
        let Some(&(start, kind)) = after.checked_sub(1).map(|last| &self.segments[last]) else {
            return Columns { x: vec![f64::NAN; self.m], v: vec![f64::NAN; self.m] };
        };
        match kind {
            PathPiece::Rest => Columns::zeros(self.m),
            PathPiece::Tail => Columns { x: vec![f64::NAN; self.m], v: vec![f64::NAN; self.m] },
            PathPiece::Flight { first, degree, h } => {
                let theta = ((t - start) / h).clamp(0.0, 1.0);
                let polynomial = |number: usize| {
                    evaluate(&self.coefficients[first + number * (degree + 1)..][..=degree], theta)
                };
                let of = |part: usize| (0..self.m).map(|j| polynomial(2 * j + part)).collect();
                Columns { x: of(0), v: of(1) }
            }
        }
    }
}
