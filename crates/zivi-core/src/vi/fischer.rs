//! The Fischer-Burmeister merit function on a box.
//!
//! ```text
//! fb(a, b) = a + b - sqrt(a^2 + b^2) = 0   <=>   a >= 0, b >= 0, a b = 0
//! Phi_i = fb(z_i - l_i, -fb(u_i - z_i, -F_i)),     merit = |Phi|^2 / 2
//! ```
//!
//! Fischer, *Optimization* 24 (1992) 269-284; the box form is Billups' (PhD thesis, Wisconsin
//! 1995). `fb(inf, b) = b`, so infinite bounds drop out.

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
pub(super) fn component(z: f64, f: f64, lower: f64, upper: f64) -> f64 {
    if lower == upper {
        return 0.0;
    }
    fb(z - lower, -fb(upper - z, -f))
}

/// `(a, b)` such that `dPhi_i = a dz_i + b dF_i`; `(1, 0)` holds a fixed variable in place.
pub(super) fn slopes(z: f64, f: f64, lower: f64, upper: f64) -> (f64, f64) {
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
    0.5 * terms.map(|((&z, &f), (&l, &u))| square(component(z, f, l, u))).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    const INF: f64 = f64::INFINITY;

    #[test]
    fn zero_exactly_at_solutions() {
        for (z, f, lower, upper) in [
            (0.0, 3.0, 0.0, 1.0),
            (1.0, -3.0, 0.0, 1.0),
            (0.4, 0.0, 0.0, 1.0),
            (-7.0, 0.0, -INF, INF),
            (2.0, -1.0, -INF, 2.0),
            (0.0, 0.0, 0.0, INF),
        ] {
            assert_eq!(component(z, f, lower, upper), 0.0, "{z} {f} {lower} {upper}");
        }
        assert_eq!(component(5.0, 0.25, -INF, INF), 0.25);
        assert!(component(0.0, -1.0, 0.0, 1.0).abs() > 0.5);
    }

    #[test]
    fn no_cancellation_for_a_large_gap() {
        let phi = component(1e12, 1e-3, 0.0, INF);
        assert!((phi - 1e-3).abs() < 1e-12 * 1e-3, "{phi}");
    }

    #[test]
    fn slopes_are_the_derivatives() {
        let step = 1e-6;
        for lower in [-INF, -0.5] {
            for upper in [0.9, INF] {
                for z in [-0.4, 0.1, 0.7] {
                    for f in [-2.0, -0.1, 0.3, 4.0] {
                        let phi = |z, f| component(z, f, lower, upper);
                        let by_z = (phi(z + step, f) - phi(z - step, f)) / (2.0 * step);
                        let by_f = (phi(z, f + step) - phi(z, f - step)) / (2.0 * step);
                        let (a, b) = slopes(z, f, lower, upper);
                        assert!((a - by_z).abs() < 1e-8 && (b - by_f).abs() < 1e-8);
                    }
                }
            }
        }
    }
}
