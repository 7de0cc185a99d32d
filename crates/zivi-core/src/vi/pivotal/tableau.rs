//! The tableau: which variable is basic, at which value, and where the others rest.

use super::super::dense;
use super::super::interruption::Interruption;
use super::basis::Basis;
use super::basis::Variable;
use super::work::{AffineVi, PivotalWorkspace, Poll, WorkCounts};

/// Which variable of an index is basic, as kept in the caller's slice of indices.
pub(super) mod held {
    pub(in super::super) const INSIDE: usize = 0;
    pub(in super::super) const AT_LOWER: usize = 1;
    pub(in super::super) const AT_UPPER: usize = 2;
    pub(in super::super) const NONE: usize = 3;
}

/// Smallest pivot, relative to its column, with which a column may enter a fresh basis.
const SINGULAR: f64 = 1e-13;
/// Rounds of iterative refinement at the end of a path.
const REFINEMENTS: usize = 3;

/// The unit column that is basic for index `i`, if one is.
pub(super) fn unit(held: &[usize], i: usize) -> Variable {
    match held.get(i) {
        Some(&held::AT_LOWER) => Variable::W(i),
        Some(&held::AT_UPPER) => Variable::V(i),
        _ => Variable::Vacant,
    }
}

#[derive(Debug)]
pub(super) struct Tableau<'a> {
    pub(super) avi: &'a AffineVi<'a>,
    pub(super) basis: Basis<'a>,
    /// Values of the basic variables.
    pub(super) values: &'a mut [f64],
    /// `B^-1 a` of the entering column.
    pub(super) direction: &'a mut [f64],
    /// The covering vector `c`.
    pub(super) covering: &'a mut [f64],
    /// Where each `z_i` rests while it is not basic.
    pub(super) resting: &'a mut [f64],
    pub(super) column: &'a mut [f64],
    pub(super) residual: &'a mut [f64],
    /// What is basic of each index.
    pub(super) held: &'a mut [usize],
    /// The value of `s` while it is not basic.
    pub(super) s: f64,
    pub(super) s_is_basic: bool,
    pub(super) effort: WorkCounts,
}

impl<'a> Tableau<'a> {
    pub(super) fn new(avi: &'a AffineVi<'a>, work: &'a mut PivotalWorkspace<'_>) -> Self {
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

    pub(super) fn n(&self) -> usize {
        self.avi.n()
    }

    pub(super) fn held(&self, i: usize) -> usize {
        self.held.get(i).copied().unwrap_or(held::NONE)
    }

    /// `direction <- B^-1 a` for the column `a` of `variable` in `M z - w + v - c s = -q`.
    pub(super) fn solve_column(&mut self, variable: Variable) {
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

    /// The basis of what is held, from scratch. False where it is singular.
    pub(super) fn rebuild(&mut self, poll: &mut Poll<'_>) -> Result<bool, Interruption> {
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
    pub(super) fn enter_vacancy(&mut self, variable: Variable) -> bool {
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
    pub(super) fn largest_pivot(&self, may_leave: impl Fn(Variable) -> bool) -> Option<usize> {
        let sizes = self.direction.iter().map(|d| d.abs()).enumerate();
        let open = sizes.filter(|&(position, _)| may_leave(self.basis.member(position)));
        let (position, size) =
            open.fold((0, 0.0), |best, it| if it.1 > best.1 { it } else { best });
        let scale = dense::norm(self.direction);
        (size > SINGULAR * scale && size.is_finite()).then_some(position)
    }

    /// `residual <- -q + c s - M z` over what is not basic; then the basic values from scratch.
    pub(super) fn recompute_values(&mut self) {
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
    pub(super) fn refine(&mut self, poll: &mut Poll<'_>) -> Result<(), Interruption> {
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
    pub(super) fn extract(&mut self, z: &mut [f64]) {
        self.gather_z();
        z.copy_from_slice(self.column);
        dense::project(z, self.avi.lower, self.avi.upper);
    }
}
