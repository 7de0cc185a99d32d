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
        self.without_known_root(c, x).first_negative()
    }

    /// The part of the step after which a coordinate that was negative is positive, if it comes to that.
    pub(crate) fn first_rise<X>(
        &mut self,
        c: usize,
        equation: &mut impl Equation<Q, X>,
    ) -> Result<Option<f64>, X> {
        let below = |(p, slack): (Bernstein, f64)| p.coefficients().iter().all(|&c| c < -slack);
        if self.screen(c).is_some_and(below) {
            return Ok(None);
        }
        self.complete(equation)?;
        Ok(self.rise_of_polynomial(c))
    }

    /// The same by the polynomial of a complete step.
    pub(crate) fn rise_of_polynomial(&self, c: usize) -> Option<f64> {
        let [x, _] = self.polynomials_of(c);
        self.without_known_root(c, x.negated()).first_negative()
    }

    /// After an impact `theta = 0` is a root, and known.
    #[inline]
    fn without_known_root(&self, c: usize, x: Bernstein) -> Bernstein {
        match self.from.x.as_slice()[c] == 0.0 {
            true => x.without_root_at_zero(),
            false => x,
        }
    }

    /// The root of the coordinate nearest to the end of the finished step, if close: the time
    /// offset and the rate there. It comes from above, with -1 for `side` from below.
    #[inline(always)]
    pub(crate) fn root_at_end(&self, c: usize, side: f64) -> Option<(f64, f64)> {
        let (x, xdot) = (side * self.end.x.as_slice()[c], side * self.end.xdot.as_slice()[c]);
        let root = touchdown(x, xdot, side * self.end_slope(c));
        root.filter(|it| it.0.abs() < 0.5 * self.h).map(|(delta, rate)| (delta, side * rate))
    }
}
