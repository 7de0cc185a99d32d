//! A coefficient of restitution that is a power of the speed of the impact.
//!
//! ```text
//! x'+ = e(v) v      e(v) = min(e0 (v/v0)^-k, e_max)      v = -x'- > 0                       (1)
//! ```
//!
//! `k = 1/4` is that of plastic contacts far above the yield point (Johnson, Contact Mechanics,
//! 1985); below it the contact is elastic, which the cap stands for. In `log v` the
//! power law alone is the line
//!
//! ```text
//! log v_(n+1) - log v* = (1 - k) (log v_n - log v*)      v* = v0 e0^(1/k)                   (2)
//! ```
//!
//! from one impact to the next. For `0 < k < 1` speeds decrease to `v*`, where `e = 1`: with `e_max
//! = 1` the mass keeps bouncing and never rests. With `e_max < 1` the cap is reached after a few
//! impacts; then the impact sequence is geometric. For `k < 0` the point `v*` repels: speeds below it fall
//! faster than any geometric impact sequence, to rest after a few impacts.

use std::fmt;
use std::ops::Bound;
use std::sync::Arc;

use zivi_core::setting::{Setting, Value, Values};
use zivi_core::{Restitution, SettingError};

use super::law::{value, ImpactLaw, ParametricLaw};

/// The law (1).
///
/// ```
/// use zivi::system::impact_law::{ImpactLaw, ParametricLaw, SpeedDependentImpact};
/// let law = SpeedDependentImpact::of(&[0.5, 1.0, 0.25, 1.0])?;
/// assert!((law.after(16.0) - 4.0).abs() < 1e-15); // 0.5 * 16^(-1/4) = 0.25
/// assert_eq!((law.after(1e-3), law.limit()), (1e-3, Some(1.0)));
/// # Ok::<(), zivi_core::SettingError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedDependentImpact {
    e0: f64,
    v0: f64,
    k: f64,
    e_max: f64,
}

impl SpeedDependentImpact {
    const E0: Setting = Setting {
        name: "e0",
        meaning: "coefficient of restitution at the speed v0",
        unit: "1",
        values: Values::UNIT,
        range: "a number from 0 to 1",
        default: Value::Required,
    };
    const V0: Setting = Setting {
        name: "v0",
        meaning: "speed at which the coefficient is e0",
        unit: "m/s",
        values: Values::POSITIVE,
        range: "a finite number > 0",
        default: Value::Required,
    };
    /// From 1 on a faster impact would have no faster rebound.
    const K: Setting = Setting {
        name: "k",
        meaning: "exponent, e = e0 (v/v0)^-k",
        unit: "1",
        values: Values::Numbers(Bound::Excluded(f64::NEG_INFINITY), Bound::Excluded(1.0)),
        range: "a finite number below 1",
        default: Value::Required,
    };
    const E_MAX: Setting = Setting {
        name: "e_max",
        meaning: "largest coefficient, at low speeds for k > 0, at high ones for k < 0",
        unit: "1",
        values: Values::UNIT,
        range: "a number from e0 to 1",
        default: Value::Number(1.0),
    };

    /// The coefficient before the cap.
    fn power(&self, v: f64) -> f64 {
        if self.e0 == 0.0 {
            0.0
        } else {
            self.e0 * libm::pow(v / self.v0, -self.k)
        }
    }
}

impl ParametricLaw for SpeedDependentImpact {
    const PARAMETERS: &'static [Setting] = &[Self::E0, Self::V0, Self::K, Self::E_MAX];

    fn of(values: &[f64]) -> Result<Self, SettingError> {
        for (i, parameter) in Self::PARAMETERS.iter().enumerate() {
            parameter.check(value(values, i))?;
        }
        let [e0, v0, k, e_max] = [0, 1, 2, 3].map(|i| value(values, i));
        if e_max < e0 {
            let Setting { name, range, .. } = Self::E_MAX;
            return Err(SettingError { name, value: e_max, range });
        }
        Ok(Self { e0, v0, k, e_max })
    }
}

impl ImpactLaw for SpeedDependentImpact {
    fn after(&self, v: f64) -> f64 {
        self.power(v).min(self.e_max) * v
    }

    fn slope(&self, v: f64) -> f64 {
        let e = self.power(v);
        if e < self.e_max {
            (1.0 - self.k) * e
        } else {
            self.e_max
        }
    }

    fn by(&self, parameter: usize, v: f64) -> f64 {
        let e = self.power(v);
        if e >= self.e_max {
            return if parameter == 3 { v } else { 0.0 };
        }
        match parameter {
            0 => libm::pow(v / self.v0, -self.k) * v,
            1 => self.k * e * v / self.v0,
            2 => -libm::log(v / self.v0) * e * v,
            _ => 0.0,
        }
    }

    fn limit(&self) -> Option<f64> {
        Some(if self.e0 == 0.0 || self.k < 0.0 {
            0.0
        } else if self.k > 0.0 {
            self.e_max
        } else {
            self.e0
        })
    }

    fn limit_by(&self, parameter: usize) -> f64 {
        let (moves, of) = if self.k > 0.0 { (self.e0 > 0.0, 3) } else { (self.k == 0.0, 0) };
        f64::from(moves && parameter == of)
    }

    fn geometric_up_to(&self) -> f64 {
        if self.e0 == 0.0 || self.k == 0.0 {
            f64::INFINITY
        } else if self.k < 0.0 {
            0.0
        } else {
            // where the power law meets the cap
            self.v0 * libm::pow(self.e0 / self.e_max, 1.0 / self.k)
        }
    }

    fn constant(&self) -> Option<Restitution> {
        None
    }
}

// A coefficient of restitution that is a function of the speed.
//
// For `e = 1 - x(v)` with `x ~ c v^p`, `0 < p < 1` (viscoelastic spheres have `p = 1/5`)
// (Schwager and Poschel, Phys. Rev. E 57, 1998), speeds fall as `n^(-1/p)`. They have the sum
//
// ```text
// S(u) = u + S(e(u) u) = u (1/((1 - p) x) - p/2 - p x/6 + O(x^2))                           (1)
// ```
//
// so that impacts end after a finite time although no chain of them is geometric.

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
        let [x, half, quarter] = [1.0, 0.5, 0.25].map(|part| lost(part * u));
        let p = libm::log2(x / half);
        let mean = mean_of_inverse([x, half, quarter]).unwrap_or(1.0 / ((1.0 - p) * x));
        (x > 0.0 && p < 0.95).then(|| u * (mean - p / 2.0 - p * x / 6.0))
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

/// The mean of `1/x` over the speeds below `u` from `x` at `u`, `u/2` and `u/4`, for `1/x = a v^-p + b`: the first
/// term of (1). `None` for other curves.
fn mean_of_inverse(x: [f64; 3]) -> Option<f64> {
    let [one, half, quarter] = x.map(|x| 1.0 / x);
    let growth = (quarter - half) / (half - one);
    let (p, a) = (libm::log2(growth), (half - one) / (growth - 1.0));
    let falls = p > 0.0 && p < 0.95 && a > 0.0;
    falls.then(|| one + a * p / (1.0 - p))
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
