//! The first root of a cubic that a bracket is known for: the only iteration of a tick.

/// `((c3 z + c2) z + c1) z + c0`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cubic {
    /// Constant term.
    pub c0: f64,
    /// Coefficient of `z`.
    pub c1: f64,
    /// Coefficient of `z^2`.
    pub c2: f64,
    /// Coefficient of `z^3`.
    pub c3: f64,
}

/// At most so many evaluations for one root.
pub const MAX_ITERATIONS: u32 = 64;

impl Cubic {
    /// The value at `z`, by Horner's rule.
    #[inline]
    #[must_use]
    pub fn at(&self, z: f64) -> f64 {
        ((self.c3 * z + self.c2) * z + self.c1) * z + self.c0
    }

    #[inline]
    fn slope(&self, z: f64) -> f64 {
        (3.0 * self.c3 * z + 2.0 * self.c2) * z + self.c1
    }

    #[inline]
    fn curvature(&self, z: f64) -> f64 {
        6.0 * self.c3 * z + 2.0 * self.c2
    }

    /// The root nearest to `from` on the way to `to`, where the cubic has different signs at
    /// `from` and `to`; and the number of Newton steps and bisections that it took. Where rounding
    /// has left no change of sign the answer is `to`.
    ///
    /// ```
    /// use zivi_core::control::cubic::Cubic;
    /// let cubic = Cubic { c0: -0.006, c1: 0.11, c2: -0.6, c3: 1.0 }; // roots 0.1, 0.2, 0.3
    /// let (root, _) = cubic.first_root(1.0, -1.0);
    /// assert!((root - 0.3).abs() < 1e-15);
    /// ```
    #[must_use]
    pub fn first_root(&self, from: f64, to: f64) -> (f64, u32) {
        self.next_root(from, to).unwrap_or((to, 0))
    }

    /// The same where there need not be a root: none is found when the sign at `from` lasts up to
    /// `to`.
    #[must_use]
    pub fn next_root(&self, from: f64, to: f64) -> Option<(f64, u32)> {
        let start = self.at(from);
        if start == 0.0 {
            return Some((from, 0));
        }
        let (near, far) = self.piece(from, to, start);
        if start * self.at(far) > 0.0 {
            return None;
        }
        Some(self.newton(near, far, start > 0.0))
    }

    /// The first piece between `from` and `to` on which the sign changes: the pieces are bounded
    /// by the extrema and the inflection, so the cubic is monotone and bends one way on each.
    fn piece(&self, from: f64, to: f64, start: f64) -> (f64, f64) {
        let mut near = from;
        for bend in self.bends(from < to) {
            let ahead = if from < to { bend > near && bend < to } else { bend < near && bend > to };
            if ahead {
                if start * self.at(bend) <= 0.0 {
                    return (near, bend);
                }
                near = bend;
            }
        }
        (near, to)
    }

    /// Extremum, inflection, extremum, in the direction of travel (NaN where there is none).
    fn bends(&self, rising: bool) -> [f64; 3] {
        let discriminant = self.c2 * self.c2 - 3.0 * self.c3 * self.c1;
        let root = libm::sqrt(discriminant);
        // the larger numerator without cancellation, the other extremum from their product
        let q = -(self.c2 + if self.c2 < 0.0 { -root } else { root });
        let (a, b) = (q / (3.0 * self.c3), self.c1 / q);
        let middle = -self.c2 / (3.0 * self.c3);
        if (a < b) == rising {
            [a, middle, b]
        } else {
            [b, middle, a]
        }
    }

    /// Newton's method on a monotone piece of one curvature, from the end where it cannot
    /// overshoot (Fourier's condition): it approaches the root from one side, and where it turns
    /// back or overshoots after all, rounding has been reached. A flat end is left by bisection.
    fn newton(&self, near: f64, far: f64, near_positive: bool) -> (f64, u32) {
        let bends_up = self.curvature(0.5 * (near + far)) > 0.0;
        let (start, other) = if bends_up == near_positive { (near, far) } else { (far, near) };
        let (mut before, mut beyond) = (start, other);
        let (mut z, mut cannot_overshoot) = (start, false);
        for count in 1..=MAX_ITERATIONS {
            let value = self.at(z);
            let overshot = (value > 0.0) != bends_up;
            let next = z - value / self.slope(z);
            let onward = if start < other { next > z } else { next < z };
            if value == 0.0 || if overshot { cannot_overshoot } else { !onward } {
                return (z, count);
            }
            if overshot {
                beyond = z;
            } else {
                before = z;
            }
            let (low, high) = if start < other { (before, beyond) } else { (beyond, before) };
            let inside = next >= low && next <= high;
            cannot_overshoot = inside && !overshot;
            z = if inside { next } else { 0.5 * (before + beyond) };
        }
        (z, MAX_ITERATIONS)
    }
}
