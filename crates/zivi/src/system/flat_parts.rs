//! Constant parts of a mechanical system: constants, flat gaps, belts.
//!
//! ```text
//! g_i = n_i . q + c_i - w_i(t)      h_i = -w_i''      g_t,i = -w_i'
//! ```
//!
//! The surface of a channel of friction moves along its tangent with a wall: `beta = -w'`, `k = -w''`.

use crate::numeric::dense::sum_of_products;
use crate::system::dynamics::Layout;
use crate::system::linear_system::{GapMotion, LinearGap};

/// The numbers of an evaluation that need no function.
#[derive(Clone, Debug)]
pub struct FlatParts {
    layout: Layout,
    /// An evaluation with the constants; the places of variable parts are zero.
    row: Vec<f64>,
    /// Flat gaps by their numbers.
    gaps: Vec<(usize, FlatGap)>,
    /// Surfaces that move, by channel.
    belts: Vec<(usize, GapMotion)>,
    /// Channels that hold in stick what they take in slip.
    without_static: Vec<usize>,
    /// Whether `M` and `N` are among the constants.
    has_constant_matrices: bool,
}

/// The value of a flat gap: its normal is among the constants.
#[derive(Clone, Debug)]
struct FlatGap {
    /// Coordinates on which it depends: those from here on.
    first: usize,
    normal: Vec<f64>,
    offset: f64,
    motion: GapMotion,
}

impl FlatGap {
    fn new(gap: LinearGap) -> Self {
        let LinearGap { normal, offset, motion } = gap;
        let is_there = |n: &f64| *n != 0.0;
        let first = normal.iter().position(is_there).unwrap_or(0);
        let end = normal.iter().rposition(is_there).map_or(0, |last| last + 1);
        Self { first, normal: normal[first..end].to_vec(), offset, motion }
    }

    /// `n . q + c`.
    fn value(&self, q: &[f64]) -> f64 {
        sum_of_products(&self.normal, &q[self.first..][..self.normal.len()]) + self.offset
    }
}

impl FlatParts {
    /// Constants in the places of an evaluation, flat gaps by number, moving surfaces and channels
    /// without static limits by channel; `None` where sizes or numbers do not fit together.
    #[must_use]
    pub fn new(
        layout: Layout,
        row: Vec<f64>,
        gaps: Vec<(usize, LinearGap)>,
        belts: Vec<(usize, GapMotion)>,
        without_static: Vec<usize>,
    ) -> Option<Self> {
        let fits = row.len() == layout.len()
            && gaps.iter().all(|(i, gap)| *i < layout.m && gap.normal.len() == layout.n)
            && belts.iter().map(|it| &it.0).chain(&without_static).all(|c| *c < layout.p);
        let gaps = gaps.into_iter().map(|(i, gap)| (i, FlatGap::new(gap))).collect();
        fits.then_some(Self {
            layout,
            row,
            gaps,
            belts,
            without_static,
            has_constant_matrices: false,
        })
    }

    /// The same where no function gives parts of `M`, `N` or `B`.
    #[must_use]
    pub fn with_constant_matrices(self) -> Self {
        Self { has_constant_matrices: true, ..self }
    }

    /// How many coordinates, gaps and channels of friction there are.
    #[must_use]
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// Whether `M` and `N` never change.
    #[must_use]
    pub fn has_constant_matrices(&self) -> bool {
        self.has_constant_matrices
    }

    /// Writes constants, flat gaps and belts.
    pub fn write(&self, t: f64, q: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&self.row);
        self.write_gaps(t, q, out);
        self.write_belts(t, out);
    }

    /// The same over an earlier evaluation, whose `M`, `N` and `B` stay.
    pub fn write_again(&self, t: f64, q: &[f64], out: &mut [f64]) {
        if !self.has_constant_matrices {
            return self.write(t, q, out);
        }
        let (force, limits) = (self.layout.force(), self.layout.curvature().start..self.row.len());
        out[force.clone()].copy_from_slice(&self.row[force]);
        out[limits.clone()].copy_from_slice(&self.row[limits]);
        self.write_gaps(t, q, out);
        self.write_belts(t, out);
    }

    /// Writes values, curvatures and rates of the flat gaps alone.
    pub fn write_gaps(&self, t: f64, q: &[f64], out: &mut [f64]) {
        let (value, curvature, rate) =
            (self.layout.gap().start, self.layout.curvature().start, self.layout.rate().start);
        for (i, gap) in &self.gaps {
            let along = gap.value(q);
            if let GapMotion::Fixed = gap.motion {
                out[value + i] = along;
            } else {
                let [position, speed, acceleration] = gap.motion.at(t);
                out[value + i] = along - position;
                out[curvature + i] = -acceleration;
                out[rate + i] = -speed;
            }
        }
    }

    fn write_belts(&self, t: f64, out: &mut [f64]) {
        let m = self.layout.m;
        let (curvature, rate) = (self.layout.curvature().start + m, self.layout.rate().start + m);
        for (channel, motion) in &self.belts {
            let [_, speed, acceleration] = motion.at(t);
            out[curvature + channel] = -acceleration;
            out[rate + channel] = -speed;
        }
    }

    /// Copies the limits while slipping to those while sticking, where there are no others. Functions
    /// write before that.
    pub fn finish(&self, out: &mut [f64]) {
        let (slip, stick) = (self.layout.limit().start, self.layout.static_limit().start);
        for channel in &self.without_static {
            out[stick + channel] = out[slip + channel];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::HarmonicWall;

    const WALL: HarmonicWall =
        HarmonicWall { amplitude: 0.5, omega: 2.0, phase: 0.25, offset: 0.125 };

    fn parts() -> FlatParts {
        let layout = Layout { n: 2, m: 2, p: 1, k: 0 };
        let mut row = vec![0.0; layout.len()];
        row[layout.mass()].copy_from_slice(&[2.0, 0.5, 0.5, 1.0]);
        row[layout.limit().start] = 0.75;
        let flat =
            LinearGap { normal: vec![0.0, 3.0], offset: 1.0, motion: GapMotion::Harmonic(WALL) };
        let belts = vec![(0, GapMotion::Harmonic(WALL))];
        FlatParts::new(layout, row, vec![(1, flat)], belts, vec![0]).unwrap()
    }

    #[test]
    fn flat_gaps_and_belts_move_as_their_walls() {
        let (parts, t) = (parts(), 0.7);
        let layout = parts.layout();
        let mut out = vec![f64::NAN; layout.len()];
        parts.write(t, &[9.0, 0.25], &mut out);
        parts.finish(&mut out);
        let angle: f64 = 2.0 * t + 0.25;
        let (speed, acceleration) = (-angle.sin(), -2.0 * angle.cos());
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-15, "{a} {b}");
        near(out[layout.gap()][1], 0.75 + 1.0 - 0.125 - 0.5 * angle.cos());
        for row in [1, 2] {
            near(out[layout.rate()][row], -speed);
            near(out[layout.curvature()][row], -acceleration);
        }
        assert_eq!(out[layout.mass()], [2.0, 0.5, 0.5, 1.0]);
        assert_eq!((out[layout.limit().start], out[layout.static_limit().start]), (0.75, 0.75));
    }

    #[test]
    fn a_second_evaluation_forgets_what_others_wrote() {
        let (parts, q) = (parts().with_constant_matrices(), [1.0, 2.0]);
        let (mut once, mut again) =
            (vec![0.0; parts.layout().len()], vec![0.0; parts.layout().len()]);
        parts.write(0.5, &q, &mut once);
        parts.write(0.1, &[3.0, 4.0], &mut again);
        again[parts.layout().force()].fill(7.0);
        again[parts.layout().limit()].fill(7.0);
        parts.write_again(0.5, &q, &mut again);
        assert_eq!(once, again);
    }

    #[test]
    fn sizes_that_do_not_fit_are_told() {
        let layout = Layout { n: 1, m: 1, p: 0, k: 0 };
        let gap = |normal| LinearGap { normal, offset: 0.0, motion: GapMotion::Fixed };
        let with = |row, gaps, belts| FlatParts::new(layout, row, gaps, belts, vec![]);
        let row = || vec![0.0; layout.len()];
        assert!(with(row(), vec![(0, gap(vec![1.0]))], vec![]).is_some());
        assert!(with(vec![0.0], vec![], vec![]).is_none());
        assert!(with(row(), vec![(1, gap(vec![1.0]))], vec![]).is_none());
        assert!(with(row(), vec![(0, gap(vec![1.0, 2.0]))], vec![]).is_none());
        assert!(with(row(), vec![], vec![(0, GapMotion::Fixed)]).is_none());
    }
}
