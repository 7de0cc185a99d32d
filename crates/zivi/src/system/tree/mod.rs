//! Trees of rigid bodies that hinges and slides join, with points of them as gaps.
//!
//! ```text
//! M(q) q'' = -b(q, q') - k (q - s) - c q' + tau + N^T lambda
//! ```
//!
//! Each joint has one coordinate and a frame whose third axis is its own. Coordinates, velocities and
//! accelerations of bodies are followed from the root outwards, in axes of the world ([`motion`]);
//! forces and composite bodies are gathered inwards, which gives `b` (the recursive Newton-Euler
//! equations) and `M` (the composite rigid body algorithm, [`gather`]).

mod dynamics;
mod gap;
mod gather;
mod motion;
mod vector;

use std::ops::Range;

pub use dynamics::TreeDynamics;

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// About its axis, by an angle (rad).
    Hinge,
    /// Along its axis (m).
    Slide,
}

/// A joint and what it moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Joint {
    /// The joint that moves it, with a smaller number; none for the world.
    pub parent: Option<usize>,
    /// How it moves.
    pub kind: JointKind,
}

/// A gap of a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TreeGap {
    /// `q_j - bound`: one number.
    Lower(usize),
    /// `bound - q_j`: one number.
    Upper(usize),
    /// `n.p - c` of a point of a body: `p` in the frame of the joint, `n`, `c`.
    Plane(usize),
    /// `|p_a - p_b| - c` of points of two bodies, the world if none: `p_a`, `p_b`, `c`.
    Balls(Option<usize>, Option<usize>),
}

impl TreeGap {
    fn numbers(self) -> usize {
        match self {
            Self::Lower(_) | Self::Upper(_) => 1,
            Self::Plane(_) | Self::Balls(..) => 7,
        }
    }

    fn joints(self) -> [Option<usize>; 2] {
        match self {
            Self::Lower(j) | Self::Upper(j) | Self::Plane(j) => [Some(j), None],
            Self::Balls(a, b) => [a, b],
        }
    }
}

/// Where the numbers of a joint lie, from the first of them on.
mod place {
    /// The origin of its frame in that of the parent.
    pub(super) const POSITION: usize = 0;
    /// The columns of its axes in those of the parent.
    pub(super) const AXES: usize = 3;
    /// Of what it moves: the mass,
    pub(super) const MASS: usize = 12;
    /// the first moment,
    pub(super) const MOMENT: usize = 13;
    /// the inertia about the origin: `xx, yy, zz, xy, xz, yz`.
    pub(super) const INERTIA: usize = 16;
    /// `k`, `s`, `c`, what is added to the diagonal of `M`, `tau`.
    pub(super) const STIFFNESS: usize = 22;
    pub(super) const SPRING: usize = 23;
    pub(super) const DAMPING: usize = 24;
    pub(super) const ARMATURE: usize = 25;
    pub(super) const TORQUE: usize = 26;
    /// The coordinate at which the frame is where position and axes say.
    pub(super) const REFERENCE: usize = 27;
    /// How many there are.
    pub(super) const ALL: usize = 28;
}

/// A tree: joints, gaps, and their numbers, those of gravity (3) first, then of each joint, then of
/// each gap.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    /// The joints.
    pub joints: Vec<Joint>,
    /// The gaps.
    pub gaps: Vec<TreeGap>,
    /// The numbers.
    pub numbers: Vec<f64>,
}

impl Tree {
    /// The same if its parts fit together.
    #[must_use]
    pub fn validated(self) -> Option<Self> {
        let n = self.joints.len();
        let grown = self.joints.iter().enumerate().all(|(i, it)| it.parent.is_none_or(|p| p < i));
        let known = |gap: &TreeGap| gap.joints().into_iter().flatten().all(|joint| joint < n);
        let numbers = self.gap_numbers(self.gaps.len()).start;
        let fits = n > 0 && grown && self.gaps.iter().all(known) && self.numbers.len() == numbers;
        fits.then_some(self)
    }

    fn joint_numbers(&self, joint: usize) -> Range<usize> {
        let start = 3 + joint * place::ALL;
        start..start + place::ALL
    }

    /// Where the numbers of a gap lie; those of the one behind the last start at the end.
    fn gap_numbers(&self, gap: usize) -> Range<usize> {
        let before: usize = self.gaps[..gap].iter().map(|it| it.numbers()).sum();
        let start = 3 + self.joints.len() * place::ALL + before;
        start..start + self.gaps.get(gap).map_or(0, |it| it.numbers())
    }
}
