//! How far a point is from solving a box VI: the natural residual, by which solutions are accepted, and
//! the Fischer-Burmeister merit, which falls along a search.
//!
//! ```text
//! fb(a, b) = a + b - sqrt(a^2 + b^2) = 0   <=>   a >= 0, b >= 0, a b = 0
//! Phi_i = fb(z_i - l_i, -fb(u_i - z_i, -F_i)),     merit = |Phi|^2 / 2
//! ```
//!
//! Fischer, *Optimization* 24 (1992) 269-284; the box form is Billups' (PhD thesis, Wisconsin
//! 1995). `fb(inf, b) = b`, so infinite bounds drop out.

/// One component of the natural map, `max(z - u, min(z - l, F))`, zero at a solution.
///
/// The median form is used because `z - clip(z - F, l, u)` cancels to zero when `|z|` is large,
/// whatever `F` is.
///
/// ```
/// use zivi_core::vi::natural_component;
/// assert_eq!(natural_component(1.0, -3.0, -1.0, 1.0), 0.0); // F < 0 at the upper bound
/// assert_eq!(natural_component(0.2, -0.5, -1.0, 1.0), -0.5); // inside the box: F itself
/// ```
#[inline]
#[must_use]
pub fn natural_component(z: f64, f: f64, lower: f64, upper: f64) -> f64 {
    // written with comparisons so that NaN in F stays NaN (f64::max and min would drop it)
    let from_below = z - lower;
    let inner = if from_below < f { from_below } else { f };
    let from_above = z - upper;
    if from_above > inner {
        from_above
    } else {
        inner
    }
}

/// The natural residual `max_i |max(z_i - u_i, min(z_i - l_i, F_i))|`; NaN if any `F_i` is NaN.
///
/// The slices are read together up to the length of the shortest; callers pass equal lengths.
#[must_use]
pub fn natural_residual(z: &[f64], f: &[f64], lower: &[f64], upper: &[f64]) -> f64 {
    let bounds = lower.iter().zip(upper);
    z.iter().zip(f).zip(bounds).fold(0.0, |worst: f64, ((&z, &f), (&lower, &upper))| {
        let component = natural_component(z, f, lower, upper).abs();
        if worst.is_nan() || component <= worst {
            worst
        } else {
            component
        }
    })
}

/// The index of the component with the largest residual, the first of equals; NaN is the largest.
pub(super) fn worst_component(z: &[f64], f: &[f64], lower: &[f64], upper: &[f64]) -> usize {
    let bounds = lower.iter().zip(upper);
    let sizes = z.iter().zip(f).zip(bounds).map(|((&z, &f), (&lower, &upper))| {
        let size = natural_component(z, f, lower, upper).abs();
        if size.is_nan() {
            f64::INFINITY
        } else {
            size
        }
    });
    let first = (0, f64::NEG_INFINITY);
    sizes.enumerate().fold(first, |worst, it| if it.1 > worst.1 { it } else { worst }).0
}

/// `fb(a, b)`; `2ab/(a + b + r)` where the plain form would cancel.
fn fb(a: f64, b: f64) -> f64 {
    if a == f64::INFINITY {
        return b;
    }
    let r = libm::hypot(a, b);
    if a + b > 0.0 {
        2.0 * (a / (a + b + r)) * b
    } else {
        a + b - r
    }
}

/// An element of the generalised gradient of `fb`.
fn fb_gradient(a: f64, b: f64) -> (f64, f64) {
    if a == f64::INFINITY {
        return (0.0, 1.0);
    }
    let r = libm::hypot(a, b);
    if r > 0.0 {
        (1.0 - a / r, 1.0 - b / r)
    } else {
        let kink = 1.0 - core::f64::consts::FRAC_1_SQRT_2;
        (kink, kink)
    }
}

/// One component `Phi_i`; a fixed variable (`lower = upper`) has none.
pub(super) fn fischer_component(z: f64, f: f64, lower: f64, upper: f64) -> f64 {
    if lower == upper {
        return 0.0;
    }
    fb(z - lower, -fb(upper - z, -f))
}

/// `(a, b)` such that `dPhi_i = a dz_i + b dF_i`; `(1, 0)` holds a fixed variable in place.
pub(super) fn fischer_slopes(z: f64, f: f64, lower: f64, upper: f64) -> (f64, f64) {
    if lower == upper {
        return (1.0, 0.0);
    }
    let inner = -fb(upper - z, -f);
    let (outer_z, outer_inner) = fb_gradient(z - lower, inner);
    let (inner_z, inner_f) = fb_gradient(upper - z, -f);
    (outer_z + outer_inner * inner_z, outer_inner * inner_f)
}

/// The merit `|Phi|^2 / 2` at `z`.
pub(super) fn merit(z: &[f64], f: &[f64], lower: &[f64], upper: &[f64]) -> f64 {
    let bounds = lower.iter().zip(upper);
    let square = |phi: f64| phi * phi;
    let terms = z.iter().zip(f).zip(bounds);
    0.5 * terms.map(|((&z, &f), (&l, &u))| square(fischer_component(z, f, l, u))).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    const INF: f64 = f64::INFINITY;

    #[test]
    fn zero_exactly_at_solutions() {
        let (lower, upper) = ([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]);
        assert_eq!(natural_residual(&[-1.0, 0.3, 1.0], &[2.0, 0.0, -5.0], &lower, &upper), 0.0);
        assert_eq!(natural_residual(&[-1.0, 0.3, 1.0], &[-2.0, 0.0, -5.0], &lower, &upper), 2.0);
    }

    #[test]
    fn far_from_the_origin_f_is_not_lost_to_cancellation() {
        let free = natural_component(1e20, 1.57, f64::NEG_INFINITY, f64::INFINITY);
        assert_eq!(free, 1.57);
    }

    #[test]
    fn the_worst_component_is_the_one_of_the_residual() {
        let (lower, upper) = ([-1.0; 3], [1.0; 3]);
        assert_eq!(worst_component(&[-1.0, 0.3, 1.0], &[-0.1, 0.2, -5.0], &lower, &upper), 1);
        assert_eq!(worst_component(&[0.0; 3], &[-0.1, 0.2, f64::NAN], &lower, &upper), 2);
        // the first of equals
        assert_eq!(worst_component(&[0.0; 3], &[0.1, -0.2, 0.2], &lower, &upper), 1);
    }

    #[test]
    fn nan_is_never_a_small_residual() {
        assert!(natural_residual(&[0.0, 0.0], &[f64::NAN, 0.0], &[-1.0; 2], &[1.0; 2]).is_nan());
        assert!(natural_residual(&[0.0, 0.0], &[0.0, f64::NAN], &[-1.0; 2], &[1.0; 2]).is_nan());
    }

    #[test]
    fn the_merit_is_zero_exactly_at_solutions() {
        for (z, f, lower, upper) in [
            (0.0, 3.0, 0.0, 1.0),
            (1.0, -3.0, 0.0, 1.0),
            (0.4, 0.0, 0.0, 1.0),
            (-7.0, 0.0, -INF, INF),
            (2.0, -1.0, -INF, 2.0),
            (0.0, 0.0, 0.0, INF),
        ] {
            assert_eq!(fischer_component(z, f, lower, upper), 0.0, "{z} {f} {lower} {upper}");
        }
        assert_eq!(fischer_component(5.0, 0.25, -INF, INF), 0.25);
        assert!(fischer_component(0.0, -1.0, 0.0, 1.0).abs() > 0.5);
    }

    #[test]
    fn no_cancellation_for_a_large_gap() {
        let phi = fischer_component(1e12, 1e-3, 0.0, INF);
        assert!((phi - 1e-3).abs() < 1e-12 * 1e-3, "{phi}");
    }

    #[test]
    fn slopes_are_the_derivatives() {
        let step = 1e-6;
        for lower in [-INF, -0.5] {
            for upper in [0.9, INF] {
                for z in [-0.4, 0.1, 0.7] {
                    for f in [-2.0, -0.1, 0.3, 4.0] {
                        let phi = |z, f| fischer_component(z, f, lower, upper);
                        let by_z = (phi(z + step, f) - phi(z - step, f)) / (2.0 * step);
                        let by_f = (phi(z, f + step) - phi(z, f - step)) / (2.0 * step);
                        let (a, b) = fischer_slopes(z, f, lower, upper);
                        assert!((a - by_z).abs() < 1e-8 && (b - by_f).abs() < 1e-8);
                    }
                }
            }
        }
    }
}
