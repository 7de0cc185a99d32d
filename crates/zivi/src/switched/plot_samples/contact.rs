//! The last moment before an impact.

use super::LANES;
use crate::switched::path::Curve;

/// Moments before an impact that are looked at, each twice as far from it as the one before.
const MOMENTS: usize = 10;

/// The last moment before an impact at the end of a step that can be told from it, above the wall,
/// and how far.
#[cold]
pub(super) fn before_contact(curve: &Curve, end: f64) -> Option<(f64, f64)> {
    let moments = moments(end);
    let mut first = 0;
    while first < MOMENTS {
        let mut t = [end; LANES];
        let count = LANES.min(MOMENTS - first);
        t[..count].copy_from_slice(&moments[first..first + count]);
        let x = curve.positions(&t);
        for k in 0..count {
            if x[k] > 0.0 {
                return Some((t[k], x[k]));
            }
        }
        first += LANES;
    }
    None
}

/// Moments before an impact that are looked at.
#[inline(always)]
pub(super) fn moments(t: f64) -> [f64; MOMENTS] {
    let ulp = t - t.next_down();
    let mut moments = [t; MOMENTS];
    for (k, moment) in moments.iter_mut().enumerate() {
        *moment -= f64::from(1 << k) * ulp;
    }
    moments
}
