//! The natural residual, which measures how far a point is from solving a box VI.

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

#[cfg(test)]
mod tests {
    use super::*;

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
}
