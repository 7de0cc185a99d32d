//! The basis and its explicit inverse, updated by rank one: `O(n^2)` a pivot.

use super::super::dense;

/// A variable of the affine VI.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Variable {
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
    pub(super) fn code(self) -> usize {
        match self {
            Self::S => 0,
            Self::Vacant => 1,
            Self::Z(i) => 3 * i + 2,
            Self::W(i) => 3 * i + 3,
            Self::V(i) => 3 * i + 4,
        }
    }

    pub(super) fn from_code(code: usize) -> Self {
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
pub(super) struct Basis<'a> {
    n: usize,
    inverse: &'a mut [f64],
    members: &'a mut [usize],
    pivot_row: &'a mut [f64],
}

impl<'a> Basis<'a> {
    pub(super) fn new(
        inverse: &'a mut [f64],
        members: &'a mut [usize],
        pivot_row: &'a mut [f64],
    ) -> Self {
        Self { n: members.len(), inverse, members, pivot_row }
    }

    pub(super) fn member(&self, position: usize) -> Variable {
        self.members.get(position).map_or(Variable::Vacant, |&code| Variable::from_code(code))
    }

    pub(super) fn row(&self, position: usize) -> &[f64] {
        dense::row(self.inverse, self.n, position)
    }

    /// The diagonal basis of the given unit columns: `-e_i` for `W(i)`, `e_i` otherwise.
    pub(super) fn reset(&mut self, unit: impl Fn(usize) -> Variable) {
        self.inverse.fill(0.0);
        for i in 0..self.n {
            let member = unit(i);
            let sign = if matches!(member, Variable::W(_)) { -1.0 } else { 1.0 };
            dense::put(self.inverse, i * self.n + i, sign);
            dense::put(self.members, i, member.code());
        }
    }

    /// `out <- B^-1 a`.
    pub(super) fn solve(&self, a: &[f64], out: &mut [f64]) {
        // columns of banded matrices are mostly zero
        let support = dense::support(a);
        let a = dense::part(a, support.clone());
        for (out, row) in out.iter_mut().zip(dense::rows(self.inverse, self.n)) {
            *out = dense::dot(dense::part(row, support.clone()), a);
        }
    }

    /// `out <- B^-1 (sign e_i)`.
    pub(super) fn solve_unit(&self, i: usize, sign: f64, out: &mut [f64]) {
        for (out, row) in out.iter_mut().zip(dense::rows(self.inverse, self.n)) {
            *out = sign * dense::at(row, i);
        }
    }

    /// `entering` takes `position`; `direction = B^-1 a` for its column `a`.
    pub(super) fn exchange(&mut self, position: usize, direction: &[f64], entering: Variable) {
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

#[cfg(test)]
mod tests {
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
