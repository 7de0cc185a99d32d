//! The polynomial of one coordinate over a step, from its stages.

use super::bernstein::Bernstein;
use super::coordinates::Row;
use super::tableau::{Interpolant, Pair};

/// The polynomial from `y` to `end` over a step of length `h` with the slopes `k` of all stages.
pub(crate) fn polynomial(pair: &Pair, [y, end]: [f64; 2], h: f64, k: &Row) -> Bernstein {
    let p = match pair.interpolant {
        Interpolant::Monomials(p) => Bernstein::from_quartic(quartic(y, h, k, p)),
        Interpolant::Nested { d, .. } => {
            Bernstein::from_nested(y, nested([y, end], h, k, pair.b.len(), &d))
        }
    };
    // what rounding leaves at the ends would be on the wrong side of the wall
    p.with_ends(y, end)
}

/// Coefficients of `y + h sum_i k_i p_i(theta)`.
fn quartic(y: f64, h: f64, k: &Row, p: &[[f64; 4]]) -> [f64; 5] {
    let mut a = [y, 0.0, 0.0, 0.0, 0.0];
    for (k, row) in k.iter().zip(p) {
        for (a, p) in a[1..].iter_mut().zip(row) {
            *a += h * k * p;
        }
    }
    a
}

/// Coefficients of the nested form: the Hermite part from the ends, the rest from all stages.
fn nested([y, end]: [f64; 2], h: f64, k: &Row, last: usize, d: &[&[f64]; 4]) -> [f64; 7] {
    let rise = end - y;
    let mut f = [rise, h * k[0] - rise, 2.0 * rise - h * (k[0] + k[last]), 0.0, 0.0, 0.0, 0.0];
    for (f, row) in f[3..].iter_mut().zip(d) {
        *f = h * row.iter().zip(k).map(|(d, k)| d * k).sum::<f64>();
    }
    f
}

/// The cubic through the ends of a step with accelerations `k`, and by how much the coordinate may
/// differ from it (relative to `theta` if the step starts at zero): the accelerations of the stages
/// say how far the motion is from one with a linear acceleration. None where more stages would not
/// tell more.
pub(crate) fn screen(
    pair: &Pair,
    h: f64,
    (x0, v0): (f64, f64),
    (x1, v1): (f64, f64),
    k: &Row,
) -> Option<(Bernstein, f64)> {
    let Interpolant::Nested { .. } = pair.interpolant else { return None };
    let cubic = Bernstein::hermite((x0, h * v0), (x1, h * v1));
    let &[c0, c1, c2, c3] = cubic.coefficients() else { return None };
    let (first, last) = (6.0 * (c0 - 2.0 * c1 + c2), 6.0 * (c1 - 2.0 * c2 + c3));
    let mut worst = 0.0_f64;
    for (c, k) in pair.c.iter().zip(k).take(pair.b.len()) {
        worst = worst.max((h * h * k - first - c * (last - first)).abs());
    }
    // |e''| <= worst and e = 0 at both ends: |e| <= worst/8, |e'| <= worst/2
    Some(if x0 == 0.0 {
        (cubic.without_root_at_zero(), 0.5 * worst)
    } else {
        (cubic, 0.125 * worst)
    })
}

#[cfg(test)]
mod tests {
    use super::super::coordinates::State;
    use super::super::stages::{Equation, Stages};
    use super::super::tableau::DOP853;

    /// `x'' = 6 cos(4 t)`: far from a cubic within a step of 0.5.
    struct Pulled;

    impl Equation<f64, ()> for Pulled {
        fn acceleration(&mut self, at: &State<f64>, into: &mut f64) -> Result<(), ()> {
            *into = 6.0 * (4.0 * at.t).cos();
            Ok(())
        }
    }

    #[test]
    fn the_screen_bounds_the_motion() {
        // the polynomials show by how much
        let equation = &mut Pulled;
        for x in [0.0, 0.3] {
            let mut stages = Stages::<f64>::new(&DOP853, 1);
            let from = State { t: 0.2, late: 0.0, x, xdot: 1.0 };
            assert_eq!(stages.step(&from, &(6.0 * 0.8f64.cos()), 0.5, equation), Ok(()));
            let Some((cubic, slack)) = stages.screen(0) else { panic!("no screen") };
            assert_eq!(stages.complete(equation), Ok(()));
            let [p, _] = stages.polynomials_of(0);
            let p = if x == 0.0 { p.without_root_at_zero() } else { p };
            let apart = |i: i32| {
                let theta = f64::from(i) / 20.0;
                (p.at(theta) - cubic.at(theta)).abs()
            };
            let worst = (0..=20).map(apart).fold(0.0, f64::max);
            // a bound, and not a needless one
            assert!(worst > 1e-3 && worst <= slack && slack < 20.0 * worst, "{worst} {slack}");
        }
    }
}
