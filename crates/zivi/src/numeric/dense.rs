//! The polynomial of one coordinate over a step, from its stages.

use super::bernstein::Bernstein;
use super::coordinates::Row;
use super::tableau::{Interpolant, Pair, Weights};

/// The polynomials of position and velocity over a step of length `h` from `(x, v)`, where the
/// acceleration is `k`, to `(x1, v1)`. The weights of all powers but the first two have `sum_i d_i =
/// sum_i c_i d_i = 0`: a uniform acceleration has no part in them.
pub(crate) fn polynomials(
    pair: &Pair,
    h: f64,
    ([x, v], k): ([f64; 2], f64),
    [x1, v1]: [f64; 2],
    row: &Row,
) -> [Bernstein; 2] {
    let of_stages = |d: &Weights| {
        let (of_x, of_v) = d.sums(row);
        [h * h * of_x, h * of_v]
    };
    let both = match &pair.interpolant {
        Interpolant::Monomials([_, second, third, fourth]) => {
            let [[x2, v2], [x3, v3], [x4, v4]] = [second, third, fourth].map(of_stages);
            [[x, h * v, 0.5 * h * h * k + x2, x3, x4], [v, h * k, v2, v3, v4]]
                .map(Bernstein::from_quartic)
        }
        Interpolant::Nested { d, .. } => {
            let [[x3, v3], [x4, v4], [x5, v5], [x6, v6]] = d.each_ref().map(of_stages);
            let [x0, x1, x2] = hermite(x1 - x, [h * v, h * v1]);
            let [v0, v1, v2] = hermite(v1 - v, [h * k, h * (k + row[pair.b.len()].k)]);
            [
                Bernstein::from_nested(x, [x0, x1, x2, x3, x4, x5, x6]),
                Bernstein::from_nested(v, [v0, v1, v2, v3, v4, v5, v6]),
            ]
        }
    };
    // what rounding leaves at the ends would be on the wrong side of the wall
    let [of_x, of_v] = both;
    [of_x.with_ends(x, x1), of_v.with_ends(v, v1)]
}

/// The first coefficients of the nested form, by the slopes at both ends.
fn hermite(rise: f64, [first, last]: [f64; 2]) -> [f64; 3] {
    [rise, first - rise, 2.0 * rise - (first + last)]
}

/// The cubic through the ends of a step with accelerations `k`, and by how much the coordinate may
/// differ from it (relative to `theta` if the step starts at zero): the accelerations of the stages
/// say how far the motion is from one with a linear acceleration. None where more stages would not
/// tell more.
pub(crate) fn screen(
    pair: &Pair,
    h: f64,
    ((x0, v0), k): ((f64, f64), f64),
    (x1, v1): (f64, f64),
    row: &Row,
) -> Option<(Bernstein, f64)> {
    let Interpolant::Nested { .. } = pair.interpolant else { return None };
    let cubic = Bernstein::hermite((x0, h * v0), (x1, h * v1));
    let &[c0, c1, c2, c3] = cubic.coefficients() else { return None };
    let (first, last) = (6.0 * (c0 - 2.0 * c1 + c2), 6.0 * (c1 - 2.0 * c2 + c3));
    let (beyond, growth) = (first - h * h * k, last - first);
    let mut worst = beyond.abs();
    for (c, stage) in pair.c[1..pair.b.len()].iter().zip(&row[1..]) {
        worst = worst.max((h * h * stage.k - beyond - c * growth).abs());
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
