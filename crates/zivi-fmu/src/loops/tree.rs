//! Trees of bodies whose numbers follow from parameters.
//!
//! ```text
//! x_i = sum_k a_ik p_j p_l ...
//! ```
//!
//! Masses, places and inertias make polynomials of the numbers that the bodies of a joint have together.

use std::sync::Arc;

use zivi::system::tree::{Joint, JointKind, Tree, TreeGap};

/// Most parameters of a term: a mass and two lengths.
const DEGREE: usize = 8;

/// `a p_j p_l ...`.
#[derive(Clone, Debug)]
struct Term {
    factor: f64,
    of: Vec<usize>,
}

impl Term {
    fn at(&self, parameters: &[f64]) -> f64 {
        let known = |j: &usize| parameters.get(*j).copied().unwrap_or(f64::NAN);
        self.of.iter().map(known).fold(self.factor, |value, p| value * p)
    }
}

/// A tree and the polynomials of its numbers.
#[derive(Clone, Debug)]
pub(super) struct ParametricTree {
    tree: Tree,
    numbers: Vec<Vec<Term>>,
}

impl ParametricTree {
    /// A tree with these numbers of joints and gaps; `None` if the parts are inconsistent.
    pub(super) fn read(
        from: &mut Numbers<'_>,
        (n, m): (usize, usize),
        parameters: &[f64],
    ) -> Option<Self> {
        let mut joints = Vec::new();
        for _ in 0..n {
            let [parent, slide] = from.array()?;
            let kind = if slide == 0.0 { JointKind::Hinge } else { JointKind::Slide };
            joints.push(Joint { parent: number(parent)?, kind });
        }
        let mut gaps = Vec::new();
        for _ in 0..m {
            let [kind, first, second] = from.array()?;
            let (a, b) = (number(first)?, number(second)?);
            gaps.push(match (kind as usize, a) {
                (0, Some(a)) => TreeGap::Lower(a),
                (1, Some(a)) => TreeGap::Upper(a),
                (2, Some(a)) => TreeGap::Plane(a),
                (3, a) => TreeGap::Balls(a, b),
                _ => return None,
            });
        }
        let mut numbers = Vec::new();
        for _ in 0..from.count()? {
            let mut terms = Vec::new();
            for _ in 0..from.count()? {
                let (factor, degree) = (from.one()?, from.count()?);
                let of: Option<Vec<usize>> = (0..degree).map(|_| from.count()).collect();
                let of = of.filter(|of| of.len() <= DEGREE)?;
                if of.iter().any(|j| *j >= parameters.len()) {
                    return None;
                }
                terms.push(Term { factor, of });
            }
            numbers.push(terms);
        }
        let mut it = Self {
            tree: Tree {
                joints,
                gaps,
                friction: vec![],
                constraints: vec![],
                drives: vec![],
                numbers: vec![],
            },
            numbers,
        };
        it.tree = Tree { numbers: it.numbers_at(parameters), ..it.tree }.validated()?;
        Some(it)
    }

    /// With these parameters.
    pub(super) fn at(&self, parameters: &[f64]) -> Arc<Tree> {
        Arc::new(Tree { numbers: self.numbers_at(parameters), ..self.tree.clone() })
    }

    fn numbers_at(&self, parameters: &[f64]) -> Vec<f64> {
        let value = |terms: &Vec<Term>| terms.iter().map(|term| term.at(parameters)).sum();
        self.numbers.iter().map(value).collect()
    }
}

/// Index of a joint, -1 for the world; `None` if invalid.
fn number(value: f64) -> Option<Option<usize>> {
    match value {
        -1.0 => Some(None),
        value if (0.0..1e6).contains(&value) => Some(Some(value as usize)),
        _ => None,
    }
}

// Numbers of a file, one after the other; `None` after its end.

/// Numbers of a file, the next first.
pub(super) struct Numbers<'a>(&'a [u8]);

impl<'a> Numbers<'a> {
    pub(super) fn of(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    /// Whether all of them have been read.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn one(&mut self) -> Option<f64> {
        let (first, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(f64::from_le_bytes(*first))
    }

    pub(super) fn array<const K: usize>(&mut self) -> Option<[f64; K]> {
        let mut array = [0.0; K];
        for it in &mut array {
            *it = self.one()?;
        }
        Some(array)
    }

    pub(super) fn many(&mut self, count: usize) -> Option<Vec<f64>> {
        (0..count).map(|_| self.one()).collect()
    }

    /// A count.
    pub(super) fn count(&mut self) -> Option<usize> {
        let value = self.one()?;
        (value >= 0.0 && value <= self.0.len() as f64 + 64.0).then_some(value as usize)
    }

    /// This number of values if the flag before them is set.
    pub(super) fn optional(&mut self, count: usize) -> Option<Option<Vec<f64>>> {
        match self.one()? {
            0.0 => Some(None),
            _ => self.many(count).map(Some),
        }
    }
}
