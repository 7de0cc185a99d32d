//! Least squares in a box, by its active sets.

use crate::numeric::singular::Singular;
use crate::numeric::vector::dot;

/// Range of each control.
pub type Limits = [(f64, f64)];

/// Singular values below this part of the largest are zero.
pub(super) const SMALL: f64 = 1e-12;

/// Where a variable is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Place {
    Low,
    Inside,
    High,
}

/// Minimises `|A x - b|` within limits.
///
/// A set of bounds and the least squares in between are the solution if that is within the bounds and
/// the gradient points out at each of them. From the clipped free solution sets are followed by the
/// bound that is violated, or let go, most; where that comes back to a set, all are looked at.
pub(super) fn in_box(a: &[f64], b: &[f64], limits: &Limits) -> Vec<f64> {
    let r = limits.len();
    let problem = Problem { a, b, limits };
    let free = problem.solved(&vec![Place::Inside; r]);
    let side = |(x, (low, high)): (&f64, &(f64, f64))| match () {
        () if x < low => Place::Low,
        () if x > high => Place::High,
        () => Place::Inside,
    };
    let mut places: Vec<Place> = free.iter().zip(limits).map(side).collect();
    let mut seen = Vec::new();
    while !seen.contains(&places) {
        seen.push(places.clone());
        let x = problem.solved(&places);
        let over: Vec<f64> =
            x.iter().zip(limits).map(|(x, (low, high))| (low - x).max(x - high)).collect();
        let size = x.iter().fold(1.0, |size: f64, x| size.max(1.0 + x.abs()));
        let worst = largest(&over);
        if over[worst] > SMALL * size {
            places[worst] = if x[worst] < limits[worst].0 { Place::Low } else { Place::High };
            continue;
        }
        let slope = problem.slope(&x);
        let pull: Vec<f64> = (0..r)
            .map(|j| match places[j] {
                Place::Inside => f64::NEG_INFINITY,
                Place::Low => -slope[j],
                Place::High => slope[j],
            })
            .collect();
        let held = largest(&pull);
        let scale: f64 = a.iter().map(|it| it.abs()).sum();
        let right = b.iter().fold(0.0_f64, |size, it| size.max(it.abs()));
        if pull[held] > SMALL * scale * (1.0 + right) {
            places[held] = Place::Inside;
        } else {
            return clipped(x, limits);
        }
    }
    problem.best()
}

fn largest(of: &[f64]) -> usize {
    (1..of.len()).fold(0, |best, j| if of[j] > of[best] { j } else { best })
}

fn clipped(mut x: Vec<f64>, limits: &Limits) -> Vec<f64> {
    x.iter_mut().zip(limits).for_each(|(x, (low, high))| *x = x.max(*low).min(*high));
    x
}

struct Problem<'a> {
    a: &'a [f64],
    b: &'a [f64],
    limits: &'a Limits,
}

impl Problem<'_> {
    /// `A x - b`.
    fn residual(&self, x: &[f64]) -> Vec<f64> {
        let rows = self.a.chunks_exact(x.len().max(1));
        rows.zip(self.b).map(|(row, b)| dot(row, x) - b).collect()
    }

    /// `A^T (A x - b)`.
    fn slope(&self, x: &[f64]) -> Vec<f64> {
        let (left, r) = (self.residual(x), x.len());
        (0..r).map(|j| (0..left.len()).map(|i| self.a[i * r + j] * left[i]).sum()).collect()
    }

    /// The least squares with some variables at their bounds.
    fn solved(&self, places: &[Place]) -> Vec<f64> {
        let r = places.len();
        let mut x: Vec<f64> = places
            .iter()
            .zip(self.limits)
            .map(|(place, (low, high))| match place {
                Place::Low => *low,
                Place::Inside => 0.0,
                Place::High => *high,
            })
            .collect();
        let inside: Vec<usize> = (0..r).filter(|&j| places[j] == Place::Inside).collect();
        if inside.is_empty() {
            return x;
        }
        let right: Vec<f64> = self.residual(&x).iter().map(|it| -it).collect();
        let rows = self.b.len();
        let part: Vec<f64> =
            (0..rows).flat_map(|i| inside.iter().map(move |j| self.a[i * r + j])).collect();
        let found = Singular::new(&part, rows, inside.len());
        let rank = found.rank(f64::EPSILON * rows.max(inside.len()) as f64);
        let solved = found.solve(&right, rank);
        inside.iter().zip(solved).for_each(|(&j, value)| x[j] = value);
        x
    }

    /// The best of all sets.
    fn best(&self) -> Vec<f64> {
        let r = self.limits.len();
        let mut places = vec![Place::Low; r];
        let (mut found, mut least) = (clipped(vec![0.0; r], self.limits), f64::INFINITY);
        loop {
            let x = clipped(self.solved(&places), self.limits);
            let left = self.residual(&x);
            let size = dot(&left, &left);
            // no bound on that side: not finite
            if x.iter().all(|x| x.is_finite()) && size < least {
                (found, least) = (x, size);
            }
            let Some(j) = (0..r).find(|&j| places[j] != Place::High) else {
                return found;
            };
            places[..j].fill(Place::Low);
            places[j] = if places[j] == Place::Low { Place::Inside } else { Place::High };
        }
    }
}
