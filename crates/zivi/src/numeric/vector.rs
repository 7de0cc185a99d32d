//! Products and sums of vectors.

/// Products of so many entries are summed up by lanes, at once.
const MANY: usize = 32;
const LANES: usize = 4;

/// The sum of the products.
#[inline]
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    if x.len() < MANY {
        return x.iter().zip(y).map(|(x, y)| x * y).sum();
    }
    dot_by_lanes(x, y)
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
pub(crate) fn axpy(y: &mut [f64], a: f64, x: &[f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x);
}
