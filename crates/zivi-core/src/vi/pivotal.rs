//! A pivotal solver for the affine VI on a box.
//!
//! ```text
//! find l <= z <= u, w >= 0, v >= 0 with   M z + q = w - v,   w _|_ z - l,   v _|_ u - z
//! ```
//!
//! Of the three variables of an index at most one is basic (`z_i` strictly inside, `w_i` with
//! `z_i = l_i`, `v_i` with `z_i = u_i`), and an artificial `s` times a covering vector `c` joins
//! `q`. The path from a known solution at `s = s0` is followed, one complementary pivot after
//! another, until `s = 0`: Lemke's method, in the form of Cao & Ferris, *Mathematics of
//! Operations Research* 21 (1996) 44-60, on the box itself, so the basis stays `n x n`. Ties are
//! broken lexicographically (Cottle, Pang & Stone, *The Linear Complementarity Problem*, 4.9), so
//! no basis comes twice.
//!
//! A path that ends on a ray of constant `s` continues: slacks that grow along the ray need no
//! cover, and with `c_i = 0` in their rows the same ray starts another path. For bimatrix games
//! that second path is Lemke and Howson's (*J. SIAM* 12 (1964) 413-423).

use super::dense;
use super::natural::natural_residual;
use super::problem::Interruption;
use super::settings::Start;

/// How a path ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PathEnd {
    /// At `s = 0`.
    Solution,
    /// On a ray: no solution lies on this path.
    Ray,
    /// The basis became, or was from the outset, numerically singular.
    Singular,
    /// At the limit of pivots.
    PivotLimit,
    /// Nowhere: it is proved that there is no solution.
    Infeasible,
    /// At a solution of the whole problem, without pivots.
    Solved,
}

/// Follows the path from `z`; at [`PathEnd::Solution`] `z` is the end of it, in the box, for the
/// caller to check. Returns the end and the cost; `poll` may stop it.
pub(super) fn follow(
    avi: &AffineVi<'_>,
    start: Start,
    limit: usize,
    work: &mut PivotalWorkspace<'_>,
    z: &mut [f64],
    poll: &mut Poll<'_>,
) -> Result<(PathEnd, WorkCounts), Interruption> {
    let mut tableau = Tableau::new(avi, work);
    let begun = match start {
        Start::Regular => tableau.start_at(z, poll)?,
        Start::Ray => tableau.start_on_ray(z, poll)?,
    };
    if !begun {
        return Ok((PathEnd::Singular, tableau.effort));
    }
    let end = tableau.follow_path(limit, poll)?;
    if end == PathEnd::Solution {
        tableau.refine(poll)?;
        tableau.extract(z);
    }
    Ok((end, tableau.effort))
}

// The tableau: which variable is basic, at which value, and where the others rest.

/// Which variable of an index is basic, as kept in the caller's slice of indices.
mod held {
    pub(super) const INSIDE: usize = 0;
    pub(super) const AT_LOWER: usize = 1;
    pub(super) const AT_UPPER: usize = 2;
    pub(super) const NONE: usize = 3;
}

/// Smallest pivot, relative to its column, with which a column may enter a fresh basis.
const SINGULAR: f64 = 1e-13;
/// Rounds of iterative refinement at the end of a path.
const REFINEMENTS: usize = 3;

/// The unit column that is basic for index `i`, if one is.
fn unit(held: &[usize], i: usize) -> Variable {
    match held.get(i) {
        Some(&held::AT_LOWER) => Variable::W(i),
        Some(&held::AT_UPPER) => Variable::V(i),
        _ => Variable::Vacant,
    }
}

#[derive(Debug)]
struct Tableau<'a> {
    avi: &'a AffineVi<'a>,
    basis: Basis<'a>,
    /// Values of the basic variables.
    values: &'a mut [f64],
    /// `B^-1 a` of the entering column.
    direction: &'a mut [f64],
    /// The covering vector `c`.
    covering: &'a mut [f64],
    /// Where each `z_i` rests while it is not basic.
    resting: &'a mut [f64],
    column: &'a mut [f64],
    residual: &'a mut [f64],
    /// The basic variable of each index.
    held: &'a mut [usize],
    /// The value of `s` while it is not basic.
    s: f64,
    s_is_basic: bool,
    effort: WorkCounts,
}

impl<'a> Tableau<'a> {
    fn new(avi: &'a AffineVi<'a>, work: &'a mut PivotalWorkspace<'_>) -> Self {
        Self {
            avi,
            basis: Basis::new(work.inverse, work.members, work.pivot_row),
            values: work.values,
            direction: work.direction,
            covering: work.covering,
            resting: work.resting,
            column: work.column,
            residual: work.residual,
            held: work.held,
            s: 0.0,
            s_is_basic: false,
            effort: WorkCounts::default(),
        }
    }

    fn n(&self) -> usize {
        self.avi.n()
    }

    fn held(&self, i: usize) -> usize {
        self.held.get(i).copied().unwrap_or(held::NONE)
    }

    /// `direction <- B^-1 a` for the column `a` of `variable` in `M z - w + v - c s = -q`.
    fn solve_column(&mut self, variable: Variable) {
        match variable {
            Variable::W(i) => self.basis.solve_unit(i, -1.0, self.direction),
            Variable::V(i) => self.basis.solve_unit(i, 1.0, self.direction),
            Variable::Z(j) => {
                self.avi.column(j, self.column);
                self.basis.solve(self.column, self.direction);
            }
            Variable::S | Variable::Vacant => {
                self.basis.solve(self.covering, self.direction);
                self.direction.iter_mut().for_each(|d| *d = -*d);
            }
        }
    }

    /// Rebuilds the basis of the held variables; false if singular.
    fn rebuild(&mut self, poll: &mut Poll<'_>) -> Result<bool, Interruption> {
        let held = &*self.held;
        self.basis.reset(|i| unit(held, i));
        for i in 0..self.n() {
            if dense::is_time_to_poll(i, self.n()) {
                poll()?;
            }
            if self.held(i) == held::INSIDE && !self.enter_vacancy(Variable::Z(i)) {
                return Ok(false);
            }
        }
        Ok(!self.s_is_basic || self.enter_vacancy(Variable::S))
    }

    /// Puts a column where it has the largest pivot among the vacant positions.
    fn enter_vacancy(&mut self, variable: Variable) -> bool {
        self.solve_column(variable);
        self.effort.columns += 1;
        let vacant = |it: Variable| it == Variable::Vacant;
        match self.largest_pivot(vacant) {
            Some(position) => {
                self.basis.exchange(position, self.direction, variable);
                true
            }
            None => false,
        }
    }

    /// The position of the largest entry of `direction` among the members that may be replaced,
    /// unless all are negligible.
    fn largest_pivot(&self, may_leave: impl Fn(Variable) -> bool) -> Option<usize> {
        let sizes = self.direction.iter().map(|d| d.abs()).enumerate();
        let open = sizes.filter(|&(position, _)| may_leave(self.basis.member(position)));
        let (position, size) =
            open.fold((0, 0.0), |best, it| if it.1 > best.1 { it } else { best });
        let scale = dense::norm(self.direction);
        (size > SINGULAR * scale && size.is_finite()).then_some(position)
    }

    /// `residual <- -q + c s - M z` over what is not basic; then the basic values from scratch.
    fn recompute_values(&mut self) {
        let s = if self.s_is_basic { 0.0 } else { self.s };
        self.column.copy_from_slice(self.resting);
        for (z, &held) in self.column.iter_mut().zip(self.held.iter()) {
            if held == held::INSIDE {
                *z = 0.0;
            }
        }
        self.avi.map(self.column, self.residual);
        for (r, c) in self.residual.iter_mut().zip(self.covering.iter()) {
            *r = c * s - *r;
        }
        self.basis.solve(self.residual, self.values);
    }

    /// At `s = 0`: the basic values again, with iterative refinement, from a fresh basis where
    /// the updated one has lost too much.
    fn refine(&mut self, poll: &mut Poll<'_>) -> Result<(), Interruption> {
        (self.s, self.s_is_basic) = (0.0, false);
        self.recompute_values();
        let mut before = f64::INFINITY;
        let mut rebuilt = false;
        for _ in 0..REFINEMENTS {
            let error = self.defect();
            if error >= 0.25 * before {
                if rebuilt || error <= 1e-15 * (1.0 + dense::norm(self.avi.q)) {
                    return Ok(());
                }
                rebuilt = true;
                if !self.rebuild(poll)? {
                    return Ok(());
                }
                self.recompute_values();
                before = f64::INFINITY;
                continue;
            }
            before = error;
            self.basis.solve(self.residual, self.direction);
            dense::axpy(self.values, 1.0, self.direction);
        }
        Ok(())
    }

    /// `residual <- -(M z + q - w + v)` at the current values; returns its size.
    fn defect(&mut self) -> f64 {
        self.gather_z();
        self.avi.map(self.column, self.residual);
        for (position, &value) in self.values.iter().enumerate() {
            let (i, signed) = match self.basis.member(position) {
                Variable::W(i) => (i, -value),
                Variable::V(i) => (i, value),
                _ => continue,
            };
            let total = dense::at(self.residual, i) + signed;
            dense::put(self.residual, i, total);
        }
        self.residual.iter_mut().for_each(|r| *r = -*r);
        dense::norm(self.residual)
    }

    /// `column <- z`.
    fn gather_z(&mut self) {
        self.column.copy_from_slice(self.resting);
        for (position, &value) in self.values.iter().enumerate() {
            if let Variable::Z(i) = self.basis.member(position) {
                dense::put(self.column, i, value);
            }
        }
    }

    /// The end of the path, in the box.
    fn extract(&mut self, z: &mut [f64]) {
        self.gather_z();
        z.copy_from_slice(self.column);
        dense::project(z, self.avi.lower, self.avi.upper);
    }
}

// The basis and its explicit inverse, updated by rank one: `O(n^2)` a pivot.

/// A variable of the affine VI.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Variable {
    /// `z_i`.
    Z(usize),
    /// `w_i`, the slack of a component at its lower bound.
    W(usize),
    /// `v_i`, the slack of a component at its upper bound.
    V(usize),
    /// The artificial variable `s`.
    S,
    /// Holds the place of a column that has not entered yet.
    Vacant,
}

impl Variable {
    /// As an index, for the caller's slice of indices.
    fn code(self) -> usize {
        match self {
            Self::S => 0,
            Self::Vacant => 1,
            Self::Z(i) => 3 * i + 2,
            Self::W(i) => 3 * i + 3,
            Self::V(i) => 3 * i + 4,
        }
    }

    fn from_code(code: usize) -> Self {
        match (code, code.wrapping_sub(2) / 3, code.wrapping_sub(2) % 3) {
            (0, ..) => Self::S,
            (1, ..) => Self::Vacant,
            (_, i, 0) => Self::Z(i),
            (_, i, 1) => Self::W(i),
            (_, i, _) => Self::V(i),
        }
    }
}

/// The basic variables, one to a position, and the inverse of the matrix of their columns.
#[derive(Debug)]
struct Basis<'a> {
    n: usize,
    inverse: &'a mut [f64],
    members: &'a mut [usize],
    pivot_row: &'a mut [f64],
}

impl<'a> Basis<'a> {
    fn new(inverse: &'a mut [f64], members: &'a mut [usize], pivot_row: &'a mut [f64]) -> Self {
        Self { n: members.len(), inverse, members, pivot_row }
    }

    fn member(&self, position: usize) -> Variable {
        self.members.get(position).map_or(Variable::Vacant, |&code| Variable::from_code(code))
    }

    fn row(&self, position: usize) -> &[f64] {
        dense::row(self.inverse, self.n, position)
    }

    /// The diagonal basis of the given unit columns: `-e_i` for `W(i)`, `e_i` otherwise.
    fn reset(&mut self, unit: impl Fn(usize) -> Variable) {
        self.inverse.fill(0.0);
        for i in 0..self.n {
            let member = unit(i);
            let sign = if matches!(member, Variable::W(_)) { -1.0 } else { 1.0 };
            dense::put(self.inverse, i * self.n + i, sign);
            dense::put(self.members, i, member.code());
        }
    }

    /// `out <- B^-1 a`.
    fn solve(&self, a: &[f64], out: &mut [f64]) {
        // columns of banded matrices are mostly zero
        let support = dense::support(a);
        let a = dense::part(a, support.clone());
        for (out, row) in out.iter_mut().zip(dense::rows(self.inverse, self.n)) {
            *out = dense::dot(dense::part(row, support.clone()), a);
        }
    }

    /// `out <- B^-1 (sign e_i)`.
    fn solve_unit(&self, i: usize, sign: f64, out: &mut [f64]) {
        for (out, row) in out.iter_mut().zip(dense::rows(self.inverse, self.n)) {
            *out = sign * dense::at(row, i);
        }
    }

    /// `entering` takes `position`; `direction = B^-1 a` for its column `a`.
    fn exchange(&mut self, position: usize, direction: &[f64], entering: Variable) {
        let pivot = dense::at(direction, position);
        for (to, from) in self.pivot_row.iter_mut().zip(dense::row(self.inverse, self.n, position))
        {
            *to = from / pivot;
        }
        // away from the diagonal the inverse is zero where only slacks are basic
        let support = dense::support(self.pivot_row);
        let pivot_row = dense::part(self.pivot_row, support.clone());
        let rows = self.inverse.chunks_exact_mut(self.n.max(1));
        for (i, (row, &multiplier)) in rows.zip(direction).enumerate() {
            if i == position {
                row.copy_from_slice(self.pivot_row);
            } else if multiplier != 0.0 {
                let changing = row.get_mut(support.clone()).unwrap_or(&mut []);
                dense::axpy(changing, -multiplier, pivot_row);
            }
        }
        dense::put(self.members, position, entering.code());
    }
}

// The two starts of a path.

/// Distance to a bound, relative to its size, within which a start counts as on it.
const ON_BOUND: f64 = 1e-12;

impl Tableau<'_> {
    /// Makes `z` (nudged where it must be) the end `s = 1` of the path.
    ///
    /// With `y1` the basic values wanted there and `y0` those at `s = 0`, `c = B (y1 - y0)`.
    /// Slacks are given more than they need, each its own share, so that no two vanish together.
    fn start_at(&mut self, z: &[f64], poll: &mut Poll<'_>) -> Result<bool, Interruption> {
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
    fn start_on_ray(&mut self, z: &[f64], poll: &mut Poll<'_>) -> Result<bool, Interruption> {
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

    /// Initial place of component `i`: inside or at a bound.
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

    /// Enters the columns of the inside components. Where one depends on those before it, a bounded
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

// Following the path: ratio test, pivot or bound flip, complementary variable.

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

/// The variable that blocks the entering one.
#[derive(Clone, Copy, Debug)]
enum Blocking {
    /// Nothing: the path is a ray.
    Nothing,
    /// Its own other bound.
    OtherBound,
    /// A basic variable, at its upper or lower bound.
    Member { position: usize, length: f64, at_upper: bool },
}

impl Tableau<'_> {
    /// Drives `s` to zero.
    fn follow_path(&mut self, limit: usize, poll: &mut Poll<'_>) -> Result<PathEnd, Interruption> {
        let refactor_every = self.n().max(50);
        let mut entering =
            Entering { variable: Variable::S, sense: -1.0, from: self.s, range: self.s };
        for pivot in 1..=limit {
            self.solve_column(entering.variable);
            entering = match self.block(&entering) {
                Blocking::Nothing => match self.turn_back(&entering, poll)? {
                    Some(back) => back,
                    None => return Ok(PathEnd::Ray),
                },
                Blocking::OtherBound if entering.variable == Variable::S => {
                    return Ok(PathEnd::Solution);
                }
                Blocking::OtherBound => self.flip(&entering),
                Blocking::Member { position, length, at_upper } => {
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
    fn block(&self, entering: &Entering) -> Blocking {
        let negligible = NEGLIGIBLE * dense::norm(self.direction);
        let rounding = 1e-15 * (1.0 + dense::norm(self.values));
        let mut first =
            if entering.range.is_finite() { Blocking::OtherBound } else { Blocking::Nothing };
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
            let here = Blocking::Member { position, length, at_upper };
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
    fn precedes(&self, a: Blocking, b: Blocking) -> bool {
        let (Blocking::Member { position: p, .. }, other) = (a, b) else { return false };
        if self.basis.member(p) == Variable::S {
            return true;
        }
        let (weight_p, row_p) = self.perturbation(a);
        match other {
            Blocking::Member { position, .. } if self.basis.member(position) == Variable::S => {
                false
            }
            Blocking::Member { .. } => {
                let (weight, row) = self.perturbation(b);
                let pairs = row_p.iter().map(|x| x * weight_p).zip(row.iter().map(|x| x * weight));
                lexicographically_smaller(pairs)
            }
            _ => lexicographically_smaller(row_p.iter().map(|x| (x * weight_p, 0.0))),
        }
    }

    fn perturbation(&self, block: Blocking) -> (f64, &[f64]) {
        match block {
            Blocking::Member { position, at_upper, .. } => {
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

    /// The entering variable after `leaving` has left: `z` at a bound gives way to the slack of
    /// that bound, a slack to its `z`.
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

// Workspace and cost of a path.

/// Cost of a path.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct WorkCounts {
    /// Pivots along the path, bound flips included.
    pub(super) pivots: usize,
    /// These and the columns entered into fresh bases, of about the same cost.
    pub(super) columns: usize,
}

/// Asks whether to go on.
pub(super) type Poll<'a> = dyn FnMut() -> Result<(), Interruption> + 'a;

/// An affine VI on a box, with the matrix `M + shift I`, `M` row by row.
#[derive(Clone, Copy, Debug)]
pub(super) struct AffineVi<'a> {
    /// The matrix `M`, `n^2` entries.
    pub(super) matrix: &'a [f64],
    /// A multiple of the identity added to it.
    pub(super) shift: f64,
    /// The constant term.
    pub(super) q: &'a [f64],
    /// Lower bounds.
    pub(super) lower: &'a [f64],
    /// Upper bounds.
    pub(super) upper: &'a [f64],
}

impl AffineVi<'_> {
    pub(super) fn n(&self) -> usize {
        self.q.len()
    }

    pub(super) fn bounds(&self, i: usize) -> (f64, f64) {
        (dense::at(self.lower, i), dense::at(self.upper, i))
    }

    pub(super) fn is_fixed(&self, i: usize) -> bool {
        let (lower, upper) = self.bounds(i);
        lower == upper
    }

    /// Column `j` of `M + shift I`.
    pub(super) fn column(&self, j: usize, out: &mut [f64]) {
        for (out, row) in out.iter_mut().zip(dense::rows(self.matrix, self.n())) {
            *out = dense::at(row, j);
        }
        dense::put(out, j, dense::at(out, j) + self.shift);
    }

    /// `F = (M + shift I) z + q`.
    pub(super) fn map(&self, z: &[f64], f: &mut [f64]) {
        self.map_where(|_| true, z, f);
    }

    /// The selected components of `F`.
    pub(super) fn map_where(&self, asked: impl Fn(usize) -> bool, z: &[f64], f: &mut [f64]) {
        let rows = dense::rows(self.matrix, self.n()).zip(z.iter().zip(self.q));
        for ((i, f), (row, (zi, q))) in f.iter_mut().enumerate().zip(rows) {
            if asked(i) {
                *f = dense::dot(row, z) + (self.shift * zi + q);
            }
        }
    }

    /// The natural residual at `z`, with `F` left in `f`.
    pub(super) fn residual(&self, z: &[f64], f: &mut [f64]) -> f64 {
        self.map(z, f);
        natural_residual(z, f, self.lower, self.upper)
    }
}

/// Workspace of the pivotal solver: `n^2 + 7 n` reals and `2 n` indices.
#[derive(Debug)]
pub(super) struct PivotalWorkspace<'a> {
    pub(super) inverse: &'a mut [f64],
    pub(super) values: &'a mut [f64],
    pub(super) direction: &'a mut [f64],
    pub(super) covering: &'a mut [f64],
    pub(super) resting: &'a mut [f64],
    pub(super) column: &'a mut [f64],
    pub(super) pivot_row: &'a mut [f64],
    pub(super) residual: &'a mut [f64],
    pub(super) members: &'a mut [usize],
    pub(super) held: &'a mut [usize],
}

#[cfg(test)]
#[allow(clippy::indexing_slicing, clippy::unwrap_used)]
mod pivotal_tests {
    extern crate std;
    use super::super::iterate::Random;
    use super::super::iterate::{workspace_len, Workspace};
    use super::*;
    use std::vec;
    use std::vec::Vec;

    const INF: f64 = f64::INFINITY;

    /// The end of one path from `z`, and the residual there.
    fn path(avi: &AffineVi<'_>, start: Start, z: &mut [f64]) -> (PathEnd, f64) {
        let n = z.len();
        let (reals, indices) = workspace_len(n);
        let (mut reals, mut indices) = (vec![f64::NAN; reals], vec![usize::MAX; indices]);
        let mut work = Workspace::new(n, &mut reals, &mut indices).unwrap();
        let end = follow(avi, start, 50 * n, &mut work.pivotal, z, &mut || Ok(())).unwrap().0;
        (end, avi.residual(z, &mut vec![0.0; n]))
    }

    fn normal(random: &mut Random) -> f64 {
        (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0
    }

    /// On boxes of all kinds with a dominant diagonal, where the solution is unique: either path
    /// ends in it, with bounds that a variable crosses.
    #[test]
    fn either_start_leads_to_the_solution() {
        let mut random = Random::new(3);
        for trial in 0..300 {
            let n = 1 + trial % 9;
            let mut matrix: Vec<f64> = (0..n * n).map(|_| normal(&mut random)).collect();
            for i in 0..n {
                matrix[i * n + i] = 0.1 + (0..n).map(|j| matrix[i * n + j].abs()).sum::<f64>();
            }
            let q: Vec<f64> = (0..n).map(|_| 4.0 * normal(&mut random)).collect();
            let (mut lower, mut upper) = (vec![-INF; n], vec![INF; n]);
            for i in 0..n {
                let (kind, place) = (4.0 * random.uniform(), normal(&mut random));
                if kind < 2.0 {
                    lower[i] = place;
                }
                if (1.0..3.0).contains(&kind) {
                    upper[i] = place + random.uniform();
                }
            }
            let avi = AffineVi { matrix: &matrix, shift: 0.0, q: &q, lower: &lower, upper: &upper };
            for start in [Start::Regular, Start::Ray] {
                let mut z: Vec<f64> =
                    lower.iter().zip(&upper).map(|(l, u)| 0.0_f64.max(*l).min(*u)).collect();
                let (end, residual) = path(&avi, start, &mut z);
                assert_eq!(end, PathEnd::Solution, "{trial} {start:?}");
                assert!(residual < 1e-11, "{trial} {start:?}: {residual}");
            }
        }
    }

    /// `z = (x, y)` with `F = (A y - 1, B' x - 1)`: where a path comes back on a ray, it is that of
    /// Lemke and Howson.
    #[test]
    fn games_are_solved_beyond_the_first_ray() {
        let mut random = Random::new(5);
        let mut solved = 0;
        for _ in 0..200 {
            let (m, n) = (4, 8);
            let mut matrix = vec![0.0; n * n];
            for i in 0..m {
                for j in m..n {
                    matrix[i * n + j] = 1.0 + random.uniform();
                    matrix[j * n + i] = 1.0 + random.uniform();
                }
            }
            let (q, lower, upper) = (vec![-1.0; n], vec![0.0; n], vec![INF; n]);
            let avi = AffineVi { matrix: &matrix, shift: 0.0, q: &q, lower: &lower, upper: &upper };
            for start in [Start::Regular, Start::Ray] {
                let mut z = vec![0.0; n];
                let (end, residual) = path(&avi, start, &mut z);
                if end == PathEnd::Solution {
                    assert!(residual < 1e-11, "{start:?}: {residual}");
                    solved += 1;
                }
            }
        }
        assert_eq!(solved, 400);
    }
}

#[cfg(test)]
mod basis_tests {
    use super::*;

    #[test]
    fn codes_are_invertible() {
        for i in [0, 1, 7, 1000] {
            for it in
                [Variable::Z(i), Variable::W(i), Variable::V(i), Variable::S, Variable::Vacant]
            {
                assert_eq!(Variable::from_code(it.code()), it);
            }
        }
    }

    #[test]
    fn exchanges_keep_the_inverse() {
        let columns = [[2.0, 1.0, 0.5], [0.0, -1.0, 3.0]];
        let (mut inverse, mut members, mut row) = ([0.0; 9], [0; 3], [0.0; 3]);
        let mut basis = Basis::new(&mut inverse, &mut members, &mut row);
        basis.reset(|i| if i == 2 { Variable::W(2) } else { Variable::V(i) });
        let mut direction = [0.0; 3];
        for (position, column) in columns.iter().enumerate() {
            basis.solve(column, &mut direction);
            basis.exchange(position, &direction, Variable::Z(position));
        }
        for (position, column) in columns.iter().enumerate() {
            basis.solve(column, &mut direction);
            for (i, d) in direction.iter().enumerate() {
                let expected = if i == position { 1.0 } else { 0.0 };
                assert!((d - expected).abs() < 1e-15, "{direction:?}");
            }
        }
        assert_eq!(basis.member(1), Variable::Z(1));
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing, clippy::unwrap_used)]
mod path_tests {
    extern crate std;
    use super::super::iterate::Random;
    use super::super::iterate::{workspace_len, Workspace};
    use super::{AffineVi, *};
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
                |position| Blocking::Member { position, length: 0.0, at_upper: position % 3 == 1 };
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
