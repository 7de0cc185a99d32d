//! A coefficient of restitution that is a function of the speed.
//!
//! For `e = 1 - x(v)` with `x ~ c v^p`, `0 < p < 1` (viscoelastic spheres have `p = 1/5`)
//! (Schwager and Poschel, Phys. Rev. E 57, 1998), speeds fall as `n^(-1/p)`. They have the sum
//!
//! ```text
//! S(u) = u + S(e(u) u) = u (1/((1 - p) x) - p/2 - p x/6 + O(x^2))                           (1)
//! ```
//!
//! so that impacts end after a finite time although no chain of them is geometric.

use super::law::ImpactLaw;

use std::fmt;
use std::sync::Arc;

/// A coefficient of restitution `e(v)`, from any thread; NaN if undefined.
type Ratio = dyn Fn(f64) -> f64 + Send + Sync;

/// The law `x'+ = e(v) v` of a function `e`.
///
/// A value of the function outside of 0 to 1 ends a run, as one that is not finite.
///
/// ```
/// use zivi::system::impact_law::{FunctionImpact, ImpactLaw};
/// let law = FunctionImpact::new(|v| 1.0 / (1.0 + 0.3 * v), None, (1.0, 0.1));
/// assert_eq!(law.after(10.0), 2.5);
/// assert!((law.slope(10.0) - 1.0 / 16.0).abs() < 1e-12);
/// assert!(law.after(-10.0).is_nan());
///
/// let spheres = FunctionImpact::new(|v| 1.0 - 0.2 * v.powf(0.2), None, (1.0, 0.0));
/// let sum = spheres.sum_of_speeds(0.8).unwrap();
/// assert!((2.0 * sum - 10.284940314283).abs() < 1e-6);
/// ```
#[derive(Clone)]
pub struct FunctionImpact {
    shared: Arc<Shared>,
}

struct Shared {
    e: Box<Ratio>,
    /// The derivative of `e`; by differences without one.
    de: Option<Box<Ratio>>,
    limit: f64,
    geometric_up_to: f64,
}

impl FunctionImpact {
    /// The law of a function and its derivative, with its limit as `v -> 0` and the speed up to which
    /// it is smooth, `e(0) + O(v)`: 0 if it is not.
    pub fn new(
        e: impl Fn(f64) -> f64 + Send + Sync + 'static,
        de: Option<Box<dyn Fn(f64) -> f64 + Send + Sync>>,
        (limit, geometric_up_to): (f64, f64),
    ) -> Self {
        Self { shared: Arc::new(Shared { e: Box::new(e), de, limit, geometric_up_to }) }
    }

    /// The right side of (1) with the exponent at the speed; nothing from `p = 1` on.
    fn remainder(&self, u: f64) -> Option<f64> {
        let lost = |v: f64| 1.0 - (self.shared.e)(v);
        let x = lost(u);
        let p = libm::log2(x / lost(0.5 * u));
        (x > 0.0 && p < 0.95).then(|| u * (1.0 / ((1.0 - p) * x) - p / 2.0 - p * x / 6.0))
    }

    fn e(&self, v: f64) -> f64 {
        let e = (self.shared.e)(v);
        if (0.0..=1.0).contains(&e) {
            e
        } else {
            f64::NAN
        }
    }
}

impl ImpactLaw for FunctionImpact {
    fn after(&self, v: f64) -> f64 {
        self.e(v) * v
    }

    fn slope(&self, v: f64) -> f64 {
        if let Some(de) = &self.shared.de {
            return self.e(v) + de(v) * v;
        }
        // central differences of the fourth order
        let h = 1e-3 * v;
        let across = |k: f64| self.after(v + k * h) - self.after(v - k * h);
        (8.0 * across(1.0) - across(2.0)) / (12.0 * h)
    }

    fn limit(&self) -> Option<f64> {
        Some(self.shared.limit)
    }

    fn geometric_up_to(&self) -> f64 {
        self.shared.geometric_up_to
    }

    /// The chain of a function that is only near its limit is not that of Newton's law.
    fn is_newton_when_slow(&self) -> bool {
        let up_to = self.shared.geometric_up_to.min(1.0);
        [1.0, 0.7, 0.1].iter().all(|part| (self.shared.e)(part * up_to) == self.shared.limit)
    }

    /// The first terms one by one, the others by (1), until more terms make no difference.
    fn sum_of_speeds(&self, u: f64) -> Option<f64> {
        const MOST: usize = 1 << 14;
        /// How well the sum is known.
        const ENOUGH: f64 = 1e-7;
        let (mut v, mut sum, mut terms) = (u, 0.0, 0);
        let mut known: Option<f64> = None;
        for next in (6..).map(|k| 1 << k).take_while(|&next| next <= MOST) {
            while terms < next && v > 0.0 {
                (sum, v, terms) = (sum + v, self.after(v), terms + 1);
            }
            let total = if v > 0.0 { sum + self.remainder(v)? } else { sum };
            if known.is_some_and(|known| (total - known).abs() <= ENOUGH * total) {
                return Some(total);
            }
            known = Some(total);
        }
        None
    }
}

impl fmt::Debug for FunctionImpact {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "FunctionImpact(limit {})", self.shared.limit)
    }
}

impl PartialEq for FunctionImpact {
    /// The same function: two of the same values are not known to be equal.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.shared, &other.shared)
    }
}
