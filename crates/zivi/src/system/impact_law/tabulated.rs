//! A coefficient of restitution that is linear between measured speeds.
//!
//! ```text
//! x'+ = e(v) v      e linear between (v_i, e_i), e_1 below v_1, e_n above v_n                (1)
//! ```
//!
//! Below the first speed that is not zero the coefficient is `e(0) + O(v)`: there a chain of impacts
//! is extrapolated as for Newton's law. Faster impacts are followed one by one.

use super::law::ImpactLaw;
use zivi_core::SettingError;

use std::sync::Arc;

/// The law (1).
///
/// ```
/// use zivi::system::impact_law::{ImpactLaw, TabulatedImpact};
/// let law = TabulatedImpact::new(&[0.0, 1.0, 4.0], &[0.8, 0.6, 0.4])?;
/// assert_eq!((law.after(2.5), law.after(8.0)), (0.5 * 2.5, 0.4 * 8.0));
/// assert_eq!((law.limit(), law.geometric_up_to()), (Some(0.8), 1.0));
/// # Ok::<(), zivi_core::SettingError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct TabulatedImpact {
    /// Speeds, coefficients.
    nodes: Arc<[(f64, f64)]>,
}

impl TabulatedImpact {
    /// The law through these nodes.
    ///
    /// # Errors
    /// [`SettingError`] names the first speed or coefficient that is out of range.
    pub fn new(v: &[f64], e: &[f64]) -> Result<Self, SettingError> {
        let error = |name, value, range| Err(SettingError { name, value, range });
        if v.len() != e.len() || v.len() < 2 {
            let range = "as many coefficients as speeds, two or more";
            return error("e", e.len() as f64, range);
        }
        let mut before = None;
        for &speed in v {
            if !(speed.is_finite() && speed >= 0.0 && before.is_none_or(|it| speed > it)) {
                return error("v", speed, "finite, increasing speeds >= 0");
            }
            before = Some(speed);
        }
        if let Some(&wrong) = e.iter().find(|&&e| !(0.0..=1.0).contains(&e)) {
            return error("e", wrong, "numbers from 0 to 1");
        }
        Ok(Self { nodes: v.iter().copied().zip(e.iter().copied()).collect() })
    }

    /// The coefficient at a speed and its derivative, from above at a node.
    fn at(&self, v: f64) -> (f64, f64) {
        let k = self.nodes.partition_point(|&(node, _)| node <= v);
        match (k.checked_sub(1).map(|i| self.nodes[i]), self.nodes.get(k)) {
            (Some((v0, e0)), Some(&(v1, e1))) => {
                let slope = (e1 - e0) / (v1 - v0);
                (e0 + slope * (v - v0), slope)
            }
            (Some((_, e)), None) | (None, Some(&(_, e))) => (e, 0.0),
            (None, None) => (f64::NAN, f64::NAN),
        }
    }
}

impl ImpactLaw for TabulatedImpact {
    fn after(&self, v: f64) -> f64 {
        self.at(v).0 * v
    }

    fn slope(&self, v: f64) -> f64 {
        let (e, slope) = self.at(v);
        e + slope * v
    }

    /// By the coefficients in their order: a hat function between the neighbours.
    fn by(&self, parameter: usize, v: f64) -> f64 {
        let k = self.nodes.partition_point(|&(node, _)| node <= v);
        let upper = match (k.checked_sub(1), self.nodes.get(k)) {
            (Some(i), Some(&(v1, _))) => (v - self.nodes[i].0) / (v1 - self.nodes[i].0),
            (None, _) => 1.0,
            (Some(_), None) => 0.0,
        };
        match parameter {
            i if i == k => upper * v,
            i if i + 1 == k => (1.0 - upper) * v,
            _ => 0.0,
        }
    }

    fn limit_by(&self, parameter: usize) -> f64 {
        f64::from(u8::from(parameter == 0))
    }

    fn limit(&self) -> Option<f64> {
        self.nodes.first().map(|&(_, e)| e)
    }

    fn is_newton_when_slow(&self) -> bool {
        let first = self.nodes.first().map_or(0.0, |&(v, _)| v);
        first > 0.0 || self.at(0.0).1 == 0.0
    }

    fn geometric_up_to(&self) -> f64 {
        self.nodes.iter().map(|&(v, _)| v).find(|&v| v > 0.0).unwrap_or(f64::INFINITY)
    }
}
