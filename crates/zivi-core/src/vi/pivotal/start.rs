//! The two starts of a path.

use super::super::dense;
use super::super::interruption::Interruption;
use super::basis::Variable;
use super::tableau::{held, unit, Tableau};
use super::work::Poll;

/// Distance to a bound, relative to its size, within which a start counts as on it.
const ON_BOUND: f64 = 1e-12;

impl Tableau<'_> {
    /// Makes `z` (nudged where it must be) the end `s = 1` of the path.
    ///
    /// With `y1` the basic values wanted there and `y0` those at `s = 0`, `c = B (y1 - y0)`.
    /// Slacks are given more than they need, each its own share, so that no two vanish together.
    pub(super) fn start_at(
        &mut self,
        z: &[f64],
        poll: &mut Poll<'_>,
    ) -> Result<bool, Interruption> {
        for (i, &z) in z.iter().enumerate() {
            let (held, rest) = self.place(i, z);
            dense::put(self.held, i, held);
            dense::put(self.resting, i, rest);
        }
        if !self.enter_inside(poll)? {
            return Ok(false);
        }
        // F at the start, which the repairs of the basis may have moved
        self.column.copy_from_slice(self.resting);
        self.avi.map(self.column, self.residual);
        let scale = 1.0 + dense::norm(self.residual);
        self.spread_covering(scale);
        self.s = 1.0;
        self.recompute_values();
        Ok(dense::is_finite(self.values))
    }

    /// Starts on the ray where `s` is large and every bounded component at a vertex.
    pub(super) fn start_on_ray(
        &mut self,
        z: &[f64],
        poll: &mut Poll<'_>,
    ) -> Result<bool, Interruption> {
        let n = self.n() as f64;
        for (i, &z) in z.iter().enumerate() {
            let (lower, upper) = self.avi.bounds(i);
            let (held, rest) = if self.is_free(i) {
                (held::INSIDE, 0.0)
            } else if z - lower <= upper - z {
                (held::AT_LOWER, lower)
            } else {
                (held::AT_UPPER, upper)
            };
            let share = 1.0 + 0.1 * i as f64 / n;
            let cover = match held {
                _ if self.avi.is_fixed(i) => 0.0,
                held::AT_LOWER => -share,
                held::AT_UPPER => share,
                _ => 0.0,
            };
            dense::put(self.held, i, held);
            dense::put(self.resting, i, rest);
            dense::put(self.covering, i, cover);
        }
        if !self.rebuild(poll)? {
            return Ok(false);
        }
        self.s = 0.0;
        self.recompute_values();
        self.s = 2.0 * self.leave_ray() + 1.0;
        self.recompute_values();
        Ok(dense::is_finite(self.values))
    }

    /// The largest `s` at which a slack still vanishes on the ray.
    fn leave_ray(&self) -> f64 {
        let slacks = self.values.iter().enumerate().filter_map(|(position, &value)| {
            match self.basis.member(position) {
                Variable::W(i) | Variable::V(i) => Some(value / dense::at(self.covering, i).abs()),
                _ => None,
            }
        });
        slacks.fold(0.0, |s, ratio| if ratio.is_finite() { f64::max(s, -ratio) } else { s })
    }

    /// Where component `i` begins: inside, or at a bound it is on.
    fn place(&self, i: usize, z: f64) -> (usize, f64) {
        let (lower, upper) = self.avi.bounds(i);
        let near = ON_BOUND * (1.0 + z.abs());
        if lower == upper || z - lower <= near {
            (held::AT_LOWER, lower)
        } else if upper - z <= near {
            (held::AT_UPPER, upper)
        } else {
            (held::INSIDE, z)
        }
    }

    /// Enters the columns of what is inside. Where one depends on those before it, a bounded
    /// component moves to its nearer bound, and a free one takes the row of a component at a
    /// bound, which then starts inside instead (saddle points of constrained minimisation need
    /// this).
    fn enter_inside(&mut self, poll: &mut Poll<'_>) -> Result<bool, Interruption> {
        let held = &*self.held;
        self.basis.reset(|i| unit(held, i));
        for i in 0..self.n() {
            if dense::is_time_to_poll(i, self.n()) {
                poll()?;
            }
            if self.held(i) != held::INSIDE || self.is_basic(i) {
                continue;
            }
            let entered = self.enter_vacancy(Variable::Z(i))
                || if self.is_free(i) { self.enter_with_partner(i) } else { self.move_to_bound(i) };
            if !entered {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn is_free(&self, i: usize) -> bool {
        let (lower, upper) = self.avi.bounds(i);
        lower == f64::NEG_INFINITY && upper == f64::INFINITY
    }

    /// Starts the bounded component `i` at its nearer bound.
    fn move_to_bound(&mut self, i: usize) -> bool {
        let (lower, upper) = self.avi.bounds(i);
        let rest = dense::at(self.resting, i);
        let (held, bound) = if rest - lower <= upper - rest {
            (held::AT_LOWER, lower)
        } else {
            (held::AT_UPPER, upper)
        };
        dense::put(self.held, i, held);
        dense::put(self.resting, i, bound);
        self.enter_vacancy(unit(self.held, i))
    }

    fn is_basic(&self, i: usize) -> bool {
        (0..self.n()).any(|position| self.basis.member(position) == Variable::Z(i))
    }

    /// Enters the free `z_i` (its column is in `direction`) in the row of a component at a bound.
    fn enter_with_partner(&mut self, i: usize) -> bool {
        let avi = self.avi;
        let can_leave = |it: Variable| match it {
            Variable::W(k) | Variable::V(k) => !avi.is_fixed(k),
            _ => false,
        };
        let Some(position) = self.largest_pivot(can_leave) else { return false };
        let partner = match self.basis.member(position) {
            Variable::W(k) | Variable::V(k) => k,
            _ => return false,
        };
        self.basis.exchange(position, self.direction, Variable::Z(i));
        self.effort.columns += 1;
        let (lower, upper) = avi.bounds(partner);
        let bound = dense::at(self.resting, partner);
        let nudge = f64::min(1e-2 * (1.0 + bound.abs()), 0.25 * (upper - lower));
        let inside = if bound == lower { bound + nudge } else { bound - nudge };
        dense::put(self.held, partner, held::INSIDE);
        dense::put(self.resting, partner, inside);
        self.enter_vacancy(Variable::Z(partner))
    }

    /// `c = M z + q - w + v` with the slacks of the start; `residual` holds `F`.
    fn spread_covering(&mut self, scale: f64) {
        let n = self.n() as f64;
        for i in 0..self.n() {
            let f = dense::at(self.residual, i);
            let share = scale * (1.0 + 0.1 * i as f64 / n);
            let cover = match self.held(i) {
                _ if self.avi.is_fixed(i) => 0.0,
                held::AT_LOWER => f - (f.max(0.0) + share),
                held::AT_UPPER => f + ((-f).max(0.0) + share),
                _ => f,
            };
            dense::put(self.covering, i, cover);
        }
    }
}
