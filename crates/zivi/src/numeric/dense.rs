//! The polynomial of one coordinate over a step, from its stages.

use crate::numeric::bernstein::Bernstein;
use crate::numeric::coordinates::Row;
use crate::numeric::tableau::{Interpolant, Pair, Weights};

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

/// The cubic through the ends of a step with accelerations `k`, and the largest possible deviation
/// of the coordinate from it (relative to `theta` if the step starts at zero). None where more
/// stages would not tell more.
#[inline]
pub(crate) fn screen(
    pair: &Pair,
    h: f64,
    from: ((f64, f64), f64),
    end: (f64, f64),
    row: &Row,
) -> Option<(Bernstein, f64)> {
    let (cubic, worst) = near_cubic(pair, h, from, end, row)?;
    // e = 0 at both ends: |e| <= worst/8, |e'| <= worst/2
    Some(if from.0 .0 == 0.0 {
        (cubic.without_root_at_zero(), 0.5 * worst)
    } else {
        (cubic, 0.125 * worst)
    })
}

/// The cubic, and how large the second derivative of the difference `e` may be: the accelerations
/// of the stages bound the deviation from a linear acceleration.
#[inline]
pub(crate) fn near_cubic(
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
    Some((cubic, worst))
}

// Products and sums of vectors.

/// Sums of this number of products are vectorised.
const MANY: usize = 32;
const LANES: usize = 4;

/// The sum of the products.
#[inline]
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    match x.len() {
        ..MANY => sum_of_products(x, y),
        _ => dot_by_lanes(x, y),
    }
}

/// The same, one product after the other.
#[inline]
pub(crate) fn sum_of_products(x: &[f64], y: &[f64]) -> f64 {
    // of a size that the compiler knows the loops are unrolled
    match x.len() {
        1 => dot_few::<1>(x, y),
        2 => dot_few::<2>(x, y),
        3 => dot_few::<3>(x, y),
        4 => dot_few::<4>(x, y),
        _ => x.iter().zip(y).map(|(x, y)| x * y).sum(),
    }
}

#[inline(always)]
fn dot_few<const N: usize>(x: &[f64], y: &[f64]) -> f64 {
    match (x.first_chunk::<N>(), y.first_chunk::<N>()) {
        (Some(x), Some(y)) => x.iter().zip(y).map(|(x, y)| x * y).sum(),
        _ => x.iter().zip(y).map(|(x, y)| x * y).sum(),
    }
}

/// The largest absolute value; numbers that are none do not count.
#[inline]
pub(crate) fn largest(x: &[f64]) -> f64 {
    let of = |x: &[f64]| x.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    match x.len() {
        2 => x.first_chunk::<2>().map_or(0.0, |x| of(x)),
        3 => x.first_chunk::<3>().map_or(0.0, |x| of(x)),
        _ => of(x),
    }
}

#[inline(never)]
fn dot_by_lanes(x: &[f64], y: &[f64]) -> f64 {
    let (x, y) = (x.chunks_exact(LANES), y.chunks_exact(LANES));
    let rest = x.remainder().iter().zip(y.remainder()).map(|(x, y)| x * y).sum::<f64>();
    let mut lanes = [0.0; LANES];
    for (x, y) in x.zip(y) {
        for k in 0..LANES {
            lanes[k] += x[k] * y[k];
        }
    }
    lanes.iter().sum::<f64>() + rest
}

/// `y <- y + a x`.
#[inline]
pub(crate) fn axpy(y: &mut [f64], a: f64, x: &[f64]) {
    match y.len() {
        2 => axpy_few::<2>(y, a, x),
        3 => axpy_few::<3>(y, a, x),
        _ => y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x),
    }
}

#[inline(always)]
fn axpy_few<const N: usize>(y: &mut [f64], a: f64, x: &[f64]) {
    match (y.first_chunk_mut::<N>(), x.first_chunk::<N>()) {
        (Some(y), Some(x)) => y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x),
        (_, _) => y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x),
    }
}

#[cfg(test)]
mod dense_tests {
    use super::super::coordinates::State;
    use super::super::tableau::DOP853;
    use crate::numeric::stages::{Equation, Stages};

    /// `x'' = 6 cos(4 t)`: far from a cubic within a step of 0.5.
    struct CosineForce;

    impl Equation<f64, ()> for CosineForce {
        fn acceleration(&mut self, at: &State<f64>, into: &mut f64) -> Result<(), ()> {
            *into = 6.0 * (4.0 * at.t).cos();
            Ok(())
        }
    }

    #[test]
    fn the_screen_bounds_the_motion() {
        // the polynomials show by how much
        let equation = &mut CosineForce;
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
