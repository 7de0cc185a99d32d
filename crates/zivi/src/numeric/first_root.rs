//! Where a coordinate that was positive vanishes in a step.

use super::bernstein::Bernstein;
use super::coordinates::Coordinates;
use super::root::touchdown;
use super::stages::{Equation, Stages};

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
    pub(crate) fn root_at_end(&self, c: usize) -> Option<(f64, f64)> {
        let (x, xdot) = (self.end.x.as_slice()[c], self.end.xdot.as_slice()[c]);
        touchdown(x, xdot, self.end_slope(c)).filter(|it| it.0.abs() < 0.5 * self.h)
    }
}
