//! How high and fast a run is, and into how many parts lines divide its steps.

use super::{FLATNESS, LOW, MOST_PARTS};
use crate::switched::path::DensePath;

/// The largest distance and speed of a run.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    pub(super) x: f64,
    pub(super) xdot: f64,
}

impl Scale {
    /// By what the steps start from, and how high a parabola goes from there.
    #[inline(always)]
    pub(super) fn of(path: &DensePath) -> Self {
        let (mut highest, mut fastest) = (0.0, 0.0);
        for segment in &path.segments {
            let Some([x, v, bend]) = path.first_powers(segment) else { continue };
            let top = if bend < 0.0 && v < -2.0 * bend { -0.5 * v / bend } else { 1.0 };
            let above = if v > 0.0 { top * (v + bend * top) } else { 0.0 };
            highest = larger(x + above, highest);
            fastest = larger(v.abs() / path.length_of(segment), fastest);
        }
        Self { x: highest, xdot: fastest }
    }

    /// Into how many parts lines divide so much of a step.
    #[inline(always)]
    pub(super) fn parts(&self, part: f64, bends: [f64; 2], [x, xdot]: [[f64; 2]; 2]) -> f64 {
        let of_x = bends[0] / height(x, LOW * self.x);
        let of_xdot = bends[1] / height(xdot, LOW * self.xdot);
        // sqrt(max |p''|/(8 FLATNESS height))
        let parts = (larger(of_x, of_xdot) * (0.125 / FLATNESS)).sqrt();
        (part * parts).ceil().clamp(1.0, MOST_PARTS)
    }
}

/// The largest absolute value in a range.
#[inline(always)]
pub(super) fn largest([least, most]: [f64; 2]) -> f64 {
    larger(least.abs(), most.abs())
}

/// The smaller of two numbers, the second unless the first is smaller than it.
#[inline(always)]
pub(super) fn smaller(a: f64, b: f64) -> f64 {
    if a < b {
        a
    } else {
        b
    }
}

#[inline(always)]
pub(super) fn larger(a: f64, b: f64) -> f64 {
    if a > b {
        a
    } else {
        b
    }
}

/// The least and the largest of some numbers.
#[inline(always)]
pub(super) fn range(all: impl Iterator<Item = f64>) -> [f64; 2] {
    all.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], it| {
        [smaller(it, least), larger(it, most)]
    })
}

/// The range of both.
#[inline(always)]
pub(super) fn joined(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [smaller(a[0], b[0]), larger(a[1], b[1])]
}

/// The height of what is drawn, at least `low`.
#[inline(always)]
fn height([least, most]: [f64; 2], low: f64) -> f64 {
    larger(larger(most - least, low), f64::MIN_POSITIVE)
}
