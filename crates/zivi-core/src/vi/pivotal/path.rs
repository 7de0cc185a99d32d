//! Following the path: ratio test, pivot or bound flip, complementary variable.

use super::super::dense;
use super::super::interruption::Interruption;
use super::basis::Variable;
use super::tableau::{held, Tableau};
use super::work::Poll;
use super::PathEnd;

/// Rates of change below this, relative to the largest, are rounding.
const NEGLIGIBLE: f64 = 1e-12;
/// Step lengths this near, relatively, are ties.
const TIE: f64 = 1e-11;

/// A variable on its way into the basis.
#[derive(Clone, Copy, Debug)]
struct Entering {
    variable: Variable,
    /// `+1` when it grows, `-1` when it falls.
    sense: f64,
    from: f64,
    /// How far it can go before it meets its own other bound.
    range: f64,
}

/// What stops the entering variable.
#[derive(Clone, Copy, Debug)]
enum Block {
    /// Nothing: the path is a ray.
    Nothing,
    /// Its own other bound.
    OtherBound,
    /// A basic variable, at its upper or lower bound.
    Member { position: usize, length: f64, at_upper: bool },
}

impl Tableau<'_> {
    /// Drives `s` to zero.
    pub(super) fn follow_path(
        &mut self,
        limit: usize,
        poll: &mut Poll<'_>,
    ) -> Result<PathEnd, Interruption> {
        let refactor_every = self.n().max(50);
        let mut entering =
            Entering { variable: Variable::S, sense: -1.0, from: self.s, range: self.s };
        for pivot in 1..=limit {
            self.solve_column(entering.variable);
            entering = match self.block(&entering) {
                Block::Nothing => match self.turn_back(&entering, poll)? {
                    Some(back) => back,
                    None => return Ok(PathEnd::Ray),
                },
                Block::OtherBound if entering.variable == Variable::S => {
                    return Ok(PathEnd::Solution)
                }
                Block::OtherBound => self.flip(&entering),
                Block::Member { position, length, at_upper } => {
                    let leaving = self.basis.member(position);
                    self.pivot(&entering, position, length, at_upper);
                    if leaving == Variable::S {
                        return Ok(PathEnd::Solution);
                    }
                    self.complement(leaving, at_upper)
                }
            };
            self.effort.pivots += 1;
            self.effort.columns += 1;
            if dense::is_time_to_poll(pivot, self.n()) {
                poll()?;
            }
            if pivot % refactor_every == 0 && !self.refactor(poll)? {
                return Ok(PathEnd::Singular);
            }
        }
        Ok(PathEnd::PivotLimit)
    }

    fn refactor(&mut self, poll: &mut Poll<'_>) -> Result<bool, Interruption> {
        let regular = self.rebuild(poll)?;
        if regular {
            self.recompute_values();
        }
        Ok(regular && dense::is_finite(self.values))
    }

    /// The range of a basic variable. That of a fixed component's slack is the whole line.
    fn range(&self, variable: Variable) -> (f64, f64) {
        match variable {
            Variable::Z(i) => self.avi.bounds(i),
            Variable::W(i) | Variable::V(i) if self.avi.is_fixed(i) => {
                (f64::NEG_INFINITY, f64::INFINITY)
            }
            _ => (0.0, f64::INFINITY),
        }
    }

    /// The ratio test.
    fn block(&self, entering: &Entering) -> Block {
        let negligible = NEGLIGIBLE * dense::norm(self.direction);
        let rounding = 1e-15 * (1.0 + dense::norm(self.values));
        let mut first = if entering.range.is_finite() { Block::OtherBound } else { Block::Nothing };
        let mut shortest = entering.range;
        for (position, (&value, &d)) in self.values.iter().zip(self.direction.iter()).enumerate() {
            let rate = -entering.sense * d;
            if rate.abs() <= negligible {
                continue;
            }
            let (lower, upper) = self.range(self.basis.member(position));
            let at_upper = rate > 0.0;
            let room = if at_upper { upper - value } else { value - lower };
            if room == f64::INFINITY {
                continue;
            }
            let length = f64::max(room, 0.0) / rate.abs();
            let tie = TIE * shortest.min(length) + rounding / rate.abs();
            let here = Block::Member { position, length, at_upper };
            let comes_first = if (length - shortest).abs() <= tie {
                self.precedes(here, first)
            } else {
                length < shortest
            };
            if comes_first {
                (first, shortest) = (here, length);
            }
        }
        first
    }

    /// Breaks a tie: `s` before all, so that the path ends; else the lexicographically smaller
    /// `(B^-1)_p / rate_p`, the effect of `q - (eps, eps^2, ..)` on the step length.
    fn precedes(&self, a: Block, b: Block) -> bool {
        let (Block::Member { position: p, .. }, other) = (a, b) else { return false };
        if self.basis.member(p) == Variable::S {
            return true;
        }
        let (weight_p, row_p) = self.perturbation(a);
        match other {
            Block::Member { position, .. } if self.basis.member(position) == Variable::S => false,
            Block::Member { .. } => {
                let (weight, row) = self.perturbation(b);
                let pairs = row_p.iter().map(|x| x * weight_p).zip(row.iter().map(|x| x * weight));
                lexicographically_smaller(pairs)
            }
            _ => lexicographically_smaller(row_p.iter().map(|x| (x * weight_p, 0.0))),
        }
    }

    fn perturbation(&self, block: Block) -> (f64, &[f64]) {
        match block {
            Block::Member { position, at_upper, .. } => {
                let size = dense::at(self.direction, position).abs();
                (if at_upper { -1.0 } else { 1.0 } / size, self.basis.row(position))
            }
            _ => (0.0, &[]),
        }
    }

    /// The entering `z_i` crosses the box to its other bound (or a slack comes back from infinity
    /// to zero); the basis stays.
    fn flip(&mut self, entering: &Entering) -> Entering {
        dense::axpy(self.values, -entering.sense * entering.range, self.direction);
        let rose = entering.sense > 0.0;
        if let Variable::Z(i) = entering.variable {
            let (lower, upper) = self.avi.bounds(i);
            dense::put(self.resting, i, if rose { upper } else { lower });
        }
        self.complement(entering.variable, rose)
    }

    /// On a ray along which `s` stays: takes the cover from the slacks that grow along it, and
    /// comes back on it from far out. `None` where `s` changes, nothing is left to uncover, or the
    /// ray is not one of the path that results.
    fn turn_back(
        &mut self,
        ray: &Entering,
        poll: &mut Poll<'_>,
    ) -> Result<Option<Entering>, Interruption> {
        if !self.uncover(ray) || !self.refactor(poll)? {
            return Ok(None);
        }
        self.solve_column(ray.variable);
        let Some(distance) = self.distance_to_ray(ray) else { return Ok(None) };
        dense::axpy(self.values, -ray.sense * distance, self.direction);
        let from = ray.from + ray.sense * distance;
        Ok(Some(Entering { variable: ray.variable, sense: -ray.sense, from, range: distance }))
    }

    /// `c_i <- 0` for the slacks that grow along the ray; false where none does or `s` changes.
    fn uncover(&mut self, ray: &Entering) -> bool {
        let negligible = NEGLIGIBLE * dense::norm(self.direction);
        let mut uncovered = false;
        for (position, &d) in self.direction.iter().enumerate() {
            let rate = -ray.sense * d;
            match self.basis.member(position) {
                Variable::S if rate.abs() > negligible => return false,
                Variable::W(i) | Variable::V(i)
                    if rate > negligible && dense::at(self.covering, i) != 0.0 =>
                {
                    uncovered |= !self.avi.is_fixed(i);
                    dense::put(self.covering, i, 0.0);
                }
                _ => {}
            }
        }
        uncovered && self.s_is_basic
    }

    /// Beyond this distance from its origin the ray is in the box, with all slacks positive.
    fn distance_to_ray(&self, ray: &Entering) -> Option<f64> {
        let negligible = NEGLIGIBLE * dense::norm(self.direction);
        let rounding = 1e-12 * (1.0 + dense::norm(self.values));
        let mut distance = 0.0;
        for (position, (&value, &d)) in self.values.iter().zip(self.direction.iter()).enumerate() {
            let rate = -ray.sense * d;
            let (lower, upper) = self.range(self.basis.member(position));
            let (behind, room) =
                if rate > 0.0 { (lower - value, upper) } else { (value - upper, -lower) };
            if rate.abs() <= negligible {
                if value < lower - rounding || value > upper + rounding {
                    return None;
                }
            } else if room == f64::INFINITY {
                distance = f64::max(distance, behind / rate.abs());
            } else {
                return None;
            }
        }
        (distance > 0.0 && distance.is_finite()).then_some(2.0 * distance + 1.0)
    }

    /// The entering variable replaces the one that blocks it.
    fn pivot(&mut self, entering: &Entering, position: usize, length: f64, at_upper: bool) {
        dense::axpy(self.values, -entering.sense * length, self.direction);
        dense::put(self.values, position, entering.from + entering.sense * length);
        match self.basis.member(position) {
            Variable::Z(i) => {
                let (lower, upper) = self.avi.bounds(i);
                dense::put(self.resting, i, if at_upper { upper } else { lower });
                dense::put(self.held, i, held::NONE);
            }
            Variable::W(i) | Variable::V(i) => dense::put(self.held, i, held::NONE),
            Variable::S => (self.s, self.s_is_basic) = (0.0, false),
            Variable::Vacant => {}
        }
        match entering.variable {
            Variable::Z(i) => dense::put(self.held, i, held::INSIDE),
            Variable::W(i) => dense::put(self.held, i, held::AT_LOWER),
            Variable::V(i) => dense::put(self.held, i, held::AT_UPPER),
            Variable::S => self.s_is_basic = true,
            Variable::Vacant => {}
        }
        self.basis.exchange(position, self.direction, entering.variable);
    }

    /// What enters after `leaving` has left: `z` at a bound gives way to the slack of that bound,
    /// a slack to its `z`.
    fn complement(&self, leaving: Variable, at_upper: bool) -> Entering {
        let slack = |variable| Entering { variable, sense: 1.0, from: 0.0, range: f64::INFINITY };
        match leaving {
            Variable::Z(i) if at_upper => slack(Variable::V(i)),
            Variable::Z(i) => slack(Variable::W(i)),
            Variable::W(i) | Variable::V(i) => {
                let (lower, upper) = self.avi.bounds(i);
                let rises = matches!(leaving, Variable::W(_));
                let (sense, from) = if rises { (1.0, lower) } else { (-1.0, upper) };
                Entering { variable: Variable::Z(i), sense, from, range: upper - lower }
            }
            Variable::S | Variable::Vacant => slack(leaving),
        }
    }
}

/// The first pair that differs decides.
fn lexicographically_smaller(pairs: impl Iterator<Item = (f64, f64)>) -> bool {
    for (a, b) in pairs {
        if (a - b).abs() > 1e-12 * (a.abs() + b.abs()) {
            return a < b;
        }
    }
    false
}

#[cfg(test)]
#[allow(clippy::indexing_slicing, clippy::unwrap_used)]
mod tests {
    extern crate std;
    use super::super::super::random::Random;
    use super::super::super::workspace::{workspace_len, Workspace};
    use super::super::work::AffineVi;
    use super::*;
    use std::vec;
    use std::vec::Vec;

    #[test]
    fn the_first_pair_that_differs_by_more_than_rounding_decides() {
        let thirds = (0.3, 0.1 + 0.2);
        for first in [thirds, (thirds.1, thirds.0), (0.0, 0.0)] {
            assert!(lexicographically_smaller([first, (1.0, 2.0)].into_iter()));
            assert!(!lexicographically_smaller([first, (2.0, 1.0)].into_iter()));
        }
        assert!(!lexicographically_smaller([(-1.0, -2.0), (1.0, 2.0)].into_iter()));
        assert!(!lexicographically_smaller([(1.0, 1.0)].into_iter()));
    }

    /// Of two members in a tie exactly one comes first, and three have an order.
    #[test]
    fn ties_have_an_order() {
        let n = 5;
        let mut random = Random::new(9);
        let (q, lower, upper) = (vec![1.0; n], vec![0.0; n], vec![f64::INFINITY; n]);
        for _ in 0..100 {
            let matrix: Vec<f64> = (0..n * n).map(|_| random.uniform() - 0.5).collect();
            let avi = AffineVi { matrix: &matrix, shift: 3.0, q: &q, lower: &lower, upper: &upper };
            let (reals, indices) = workspace_len(n);
            let (mut reals, mut indices) = (vec![0.0; reals], vec![0; indices]);
            let mut work = Workspace::new(n, &mut reals, &mut indices).unwrap();
            let mut tableau = Tableau::new(&avi, &mut work.pivotal);
            // some of the variables are inside
            let z: Vec<f64> = (0..n).map(|i| if i % 2 == 0 { 1.0 } else { 0.0 }).collect();
            assert!(tableau.start_at(&z, &mut || Ok(())).unwrap());
            for rate in tableau.direction.iter_mut() {
                *rate = random.uniform() - 0.5;
            }
            let member =
                |position| Block::Member { position, length: 0.0, at_upper: position % 3 == 1 };
            let mut places: Vec<usize> = (0..n).collect();
            places.sort_by(|&a, &b| {
                let (first, second) = (
                    tableau.precedes(member(a), member(b)),
                    tableau.precedes(member(b), member(a)),
                );
                assert!(a == b || first != second, "{a} {b}");
                if first {
                    core::cmp::Ordering::Less
                } else {
                    core::cmp::Ordering::Greater
                }
            });
            for (i, &a) in places.iter().enumerate() {
                for &b in &places[i + 1..] {
                    assert!(tableau.precedes(member(a), member(b)));
                }
            }
        }
    }
}
