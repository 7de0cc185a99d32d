//! The memory of the solver, carved from one slice of reals and one of indices.

use super::pivotal::PivotalWorkspace;

/// Vectors of length `n` in addition to the two `n x n` matrices.
const VECTORS: usize = 24;

/// Lengths of the two slices a solve with `n` unknowns works in: reals and indices.
///
/// ```
/// let (reals, indices) = zivi_core::vi::workspace_len(3);
/// let (mut reals, mut indices) = (vec![0.0; reals], vec![0; indices]);
/// assert!(zivi_core::vi::Workspace::new(3, &mut reals, &mut indices).is_some());
/// ```
#[must_use]
pub const fn workspace_len(n: usize) -> (usize, usize) {
    (2 * n * n + VECTORS * n, 2 * n)
}

/// The memory of a solve with `n` unknowns. Nothing in it is read before it is written.
#[derive(Debug)]
pub struct Workspace<'a> {
    pub(super) pivotal: PivotalWorkspace<'a>,
    pub(super) jacobian: &'a mut [f64],
    pub(super) f: &'a mut [f64],
    pub(super) phi: &'a mut [f64],
    pub(super) gradient: &'a mut [f64],
    pub(super) slope_z: &'a mut [f64],
    pub(super) slope_f: &'a mut [f64],
    pub(super) step: &'a mut [f64],
    pub(super) trial: &'a mut [f64],
    pub(super) trial_f: &'a mut [f64],
    pub(super) lower: &'a mut [f64],
    pub(super) upper: &'a mut [f64],
    pub(super) scale: &'a mut [f64],
    pub(super) start: &'a mut [f64],
    pub(super) centre: &'a mut [f64],
    pub(super) best: &'a mut [f64],
    pub(super) point: &'a mut [f64],
    pub(super) neighbour: &'a mut [f64],
    pub(super) weights: &'a mut [f64],
}

impl<'a> Workspace<'a> {
    /// `None` where a slice is shorter than [`workspace_len`] says.
    #[must_use]
    pub fn new(n: usize, reals: &'a mut [f64], indices: &'a mut [usize]) -> Option<Self> {
        let (mut reals, mut indices) = (reals, indices);
        let pivotal = PivotalWorkspace {
            inverse: take(&mut reals, n * n)?,
            values: take(&mut reals, n)?,
            direction: take(&mut reals, n)?,
            covering: take(&mut reals, n)?,
            resting: take(&mut reals, n)?,
            column: take(&mut reals, n)?,
            pivot_row: take(&mut reals, n)?,
            residual: take(&mut reals, n)?,
            members: take(&mut indices, n)?,
            held: take(&mut indices, n)?,
        };
        let jacobian = take(&mut reals, n * n)?;
        let mut vector = || take(&mut reals, n);
        Some(Self {
            pivotal,
            jacobian,
            f: vector()?,
            phi: vector()?,
            gradient: vector()?,
            slope_z: vector()?,
            slope_f: vector()?,
            step: vector()?,
            trial: vector()?,
            trial_f: vector()?,
            lower: vector()?,
            upper: vector()?,
            scale: vector()?,
            start: vector()?,
            centre: vector()?,
            best: vector()?,
            point: vector()?,
            neighbour: vector()?,
            weights: vector()?,
        })
    }
}

impl Workspace<'_> {
    /// `F` at the end of the last solve (NaN where unknown).
    #[must_use]
    pub fn map(&self) -> &[f64] {
        self.trial_f
    }
}

/// The first `length` entries of `rest`, which keeps the others.
fn take<'a, T>(rest: &mut &'a mut [T], length: usize) -> Option<&'a mut [T]> {
    let (head, tail) = core::mem::take(rest).split_at_mut_checked(length)?;
    *rest = tail;
    Some(head)
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;

    #[test]
    fn the_lengths_are_exactly_enough() {
        let (reals, indices) = workspace_len(3);
        let (mut r, mut i) = ([0.0; 200], [0; 20]);
        let fits =
            |reals: &mut [f64], indices: &mut [usize]| Workspace::new(3, reals, indices).is_some();
        assert!(fits(&mut r[..reals], &mut i[..indices]));
        assert!(!fits(&mut r[..reals - 1], &mut i[..indices]));
        assert!(!fits(&mut r[..reals], &mut i[..indices - 1]));
    }
}
