//! Products and sums of vectors.

/// Products of so many entries are summed up by lanes, at once.
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
