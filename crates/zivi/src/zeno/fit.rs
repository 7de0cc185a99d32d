//! Series in powers of the ratio `e` through impacts of an impact sequence.

/// Most terms of a series.
///
/// With `e` of 0.99 to 0.999 4 leave errors of positions of 100 times `rtol` of the first apex, 5 of one.
pub(super) const TERMS: usize = 6;
/// Parts of the tail at which tails are compared.
pub(super) const PARTS: [f64; 4] = [0.25, 0.5, 0.7, 0.9];

/// Distance in impacts between points of the fit over which the speed decreases by a tenth:
/// neighbours are nearly identical when `e` is near 1, and distant points carry little information
/// about the tail.
pub(super) fn stride(e: f64, terms: usize, last: usize) -> usize {
    if terms < 2 {
        return 1;
    }
    let tenth = (libm::log(0.9) / libm::log(e)).round().max(1.0) as usize;
    tenth.min(last / (terms - 1)).max(1)
}

/// Effect of rounding of all times by one unit in the last place of 1 on the positions, in the
/// units of [`Tail::distance`] with a first flight of length 1: `4 q sum_i |l_i(q)|` with the
/// polynomials `l_i` of Lagrange at the points of [`fit`] and zero.
pub(super) fn rounding(q: &Points, terms: usize) -> f64 {
    let mut weights = [0.0; TERMS];
    for (i, weight) in weights.iter_mut().enumerate().take(terms) {
        let others = (0..terms).filter(|&j| j != i);
        *weight = 1.0 / others.fold(q[i], |product, j| product * (q[i] - q[j]));
    }
    let largest = PARTS.map(|at| {
        let of = |i: usize| {
            let others = (0..terms).filter(|&j| j != i);
            others.fold(at * weights[i], |l, j| l * (at - q[j])).abs()
        };
        4.0 * at * (0..terms).map(of).sum::<f64>()
    });
    f64::EPSILON * largest.into_iter().fold(0.0, f64::max)
}

/// `q_i = e^(-i stride)`.
pub(super) type Points = [f64; TERMS];

/// These, worked out once for each stride that follows another one.
pub(super) struct KnownPoints {
    e: f64,
    stride: usize,
    q: Points,
}

impl KnownPoints {
    /// Of a ratio.
    pub(super) fn new(e: f64) -> Self {
        Self { e, stride: 0, q: [1.0; TERMS] }
    }

    /// With this number of impacts between neighbours.
    pub(super) fn apart(&mut self, stride: usize) -> &Points {
        if stride != self.stride {
            (self.stride, self.q) = (stride, points(self.e, stride));
        }
        &self.q
    }
}

fn points(e: f64, stride: usize) -> Points {
    std::array::from_fn(|i| if i > 0 { libm::pow(e, -((i * stride) as f64)) } else { 1.0 })
}

/// `sum_k a_k q^k`, `k = 1, 2, ...`
pub(super) fn series(a: &[f64; TERMS], q: f64) -> f64 {
    a.iter().rev().fold(0.0, |sum, a| (sum + a) * q)
}

/// The `a` with `sum_k a_k q_i^k = values_i` at `terms` points, by Newton's interpolation of
/// `values/q`.
pub(super) fn fit(q: &Points, terms: usize, values: [f64; TERMS]) -> [f64; TERMS] {
    let mut d: [f64; TERMS] = std::array::from_fn(|i| values[i] / q[i]);
    for level in 1..terms {
        for i in (level..terms).rev() {
            d[i] = (d[i] - d[i - 1]) / (q[i] - q[i - level]);
        }
    }
    // from the Newton form to powers
    let mut a = [0.0; TERMS];
    for i in (0..terms).rev() {
        for k in (1..TERMS).rev() {
            a[k] = a[k - 1] - q[i] * a[k];
        }
        a[0] = d[i] - q[i] * a[0];
    }
    a
}

/// The `a` with `q_i sum_k a_k q_i^k = values_i` at the `q_i = e^m` of the flights `m = (terms - 1 - i) stride`
/// after the impact sequence, the last of them first.
pub(super) fn fit_ahead(
    e: f64,
    stride: usize,
    terms: usize,
    mut values: [f64; TERMS],
) -> [f64; TERMS] {
    // in units of the first of these q
    let q = points(e, stride);
    for (value, q) in values.iter_mut().zip(q) {
        *value /= q;
    }
    let unit = libm::pow(e, ((terms - 1) * stride) as f64);
    let (mut a, mut power) = (fit(&q, terms, values), unit);
    for a in &mut a {
        power *= unit;
        *a /= power;
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fit_reproduces_a_series() {
        let a = [1.0, -0.4, 0.2, 0.05, 0.0, 0.0];
        let values = std::array::from_fn(|i| series(&a, 0.5f64.powi(-(i as i32))));
        let fitted = fit(&points(0.5, 1), 4, values);
        for k in 0..TERMS {
            assert!((fitted[k] - a[k]).abs() < 1e-13);
        }
    }

    #[test]
    fn points_span_the_chain_up_to_a_tenth_of_the_speed_each() {
        // the last of four, three strides back, is the first of ten impacts
        assert_eq!([9, 11, 12].map(|last| stride(0.9999, 4, last)), [3, 3, 4]);
        assert_eq!(stride(0.9999, 4, 1_000_000), 1054);
        assert_eq!([stride(0.9, 4, 100), stride(0.99, 4, 2), stride(0.9999, 1, 100)], [1; 3]);
    }

    #[test]
    fn a_series_in_the_arcs_ahead_is_reproduced() {
        let a = [0.3, 1.0, -0.4, 0.2, 0.0, 0.0];
        for (e, stride) in [(0.1_f64, 1), (0.5, 1), (0.9, 5), (0.9999, 5000)] {
            let q = |m: usize| e.powi(m as i32);
            let mut values = [0.0; TERMS];
            for (i, value) in values.iter_mut().enumerate().take(4) {
                let q = q((3 - i) * stride);
                *value = q * series(&a, q);
            }
            let fitted = fit_ahead(e, stride, 4, values);
            for m in [0, 1, stride, 2 * stride, 7 * stride] {
                let (q, part) = (q(m), q(m) * series(&fitted, q(m)));
                assert!((part - q * series(&a, q)).abs() < 1e-13 * q, "{e} {m}");
            }
        }
    }

    #[test]
    fn rounding_grows_by_the_polynomials_of_lagrange() {
        // in the points 1 and 1/e the values 1 and -1 make a line; with q = 1 - x, 1/e = 1 + d
        let e = 1.0 / 1.01;
        let line = |q: f64| q * ((1.01 - q) / 0.01 + (1.0 - q) / (1.01 * 0.01));
        let largest = PARTS.map(|q| 4.0 * q * line(q)).into_iter().fold(0.0, f64::max);
        let found = rounding(&points(e, 1), 2) / f64::EPSILON;
        assert!((found / largest - 1.0).abs() < 1e-12, "{found} {largest}");
        assert_eq!(rounding(&points(e, 1), 1), 4.0 * 0.9 * 0.9 * f64::EPSILON);
        // far less where the points are apart
        assert!(rounding(&points(0.5, 1), 4) < 40.0 * f64::EPSILON);
        assert!(rounding(&points(0.9999, 1), 3) > 1e7 * f64::EPSILON);
    }
}
