//! Where a coordinate that was positive vanishes in a step, and the step onto that.

use super::bernstein::Bernstein;
use super::coordinates::Coordinates;
use super::root::touchdown;
use super::stages::{Equation, Stages};

/// How near the end of a step onto a root must be to it, relative to its length.
const NEAR: f64 = 1e-3;

impl<Q: Coordinates> Stages<Q> {
    /// The part of the step after which a coordinate is negative, if it comes to that.
    #[inline(always)]
    pub(crate) fn first_root<X>(
        &mut self,
        c: usize,
        equation: &mut impl Equation<Q, X>,
    ) -> Result<Option<f64>, X> {
        let above = |(p, slack): (Bernstein, f64)| p.coefficients().iter().all(|&c| c > slack);
        if self.screen(c).is_some_and(above) {
            return Ok(None);
        }
        self.complete(equation)?;
        Ok(self.root_of_polynomial(c))
    }

    /// The same by the polynomial of a complete step.
    #[inline]
    pub(crate) fn root_of_polynomial(&self, c: usize) -> Option<f64> {
        let [x, _] = self.polynomials_of(c);
        // after an impact theta = 0 is a root, and known
        let starts_there = self.from.x.as_slice()[c] == 0.0;
        let p = if starts_there { x.without_root_at_zero() } else { x };
        p.first_negative()
    }

    /// The root of the coordinate nearest to the end of the finished step, if it is not too far:
    /// how much later, and the rate there.
    #[inline]
    fn root_at_end(&self, c: usize) -> Option<(f64, f64)> {
        let (x, xdot) = (self.end.x.as_slice()[c], self.end.xdot.as_slice()[c]);
        touchdown(x, xdot, self.end_slope(c)).filter(|it| it.0.abs() < 0.5 * self.h)
    }
}

/// Steps onto the root of a coordinate near a length, at most twice: `step` makes and finishes the
/// step of a length. How much later than the end of the last step the root is, and the rate there.
#[inline]
pub(crate) fn step_onto<S, Q: Coordinates, X>(
    method: &mut S,
    c: usize,
    mut length: f64,
    mut step: impl FnMut(&mut S, f64) -> Result<(), X>,
    stages: impl Fn(&S) -> &Stages<Q>,
) -> Result<Option<(f64, f64)>, X> {
    let mut root = None;
    for _ in 0..2 {
        step(method, length)?;
        root = stages(method).root_at_end(c);
        match root {
            Some((delta, _)) if delta.abs() > NEAR * length => length += delta,
            _ => break,
        }
    }
    Ok(root)
}
