//! What a state consists of: one number, or several.
//!
//! A mass above a wall is the smallest case of a mechanical system, and costs no more than code
//! that is written for one number: its coordinates are an `f64`, seen as a slice of length one.

use std::fmt::Debug;

/// Most stages that a pair has, further ones included.
pub(crate) const MOST_STAGES: usize = 16;

/// What a stage has beyond a uniform acceleration from the start of the step: `(V_i - x' - c_i h
/// k_0)/h` and `k_i - k_0`, side by side for sums over both.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(16))]
pub(crate) struct Beyond {
    pub(crate) v: f64,
    pub(crate) k: f64,
}

/// That of all stages in one coordinate. The start has nothing beyond itself.
pub(crate) type Row = [Beyond; MOST_STAGES];

/// The coordinates of a state.
pub(crate) trait Coordinates: Clone + Debug + PartialEq {
    /// One row for each of them.
    type Rows: Clone + Debug + AsRef<[Row]> + AsMut<[Row]>;

    /// So many zeros; one number is one, whatever is requested.
    fn zeros(count: usize) -> Self;

    /// So many rows of zeros.
    fn rows(count: usize) -> Self::Rows;

    /// Memory to work in, lent from a place that keeps it; one number needs none. What is in it is
    /// of no interest.
    fn lend(place: &mut Self) -> Self;

    /// Back to the place that keeps it.
    fn give_back(self, place: &mut Self);

    /// All of them, in order.
    fn as_slice(&self) -> &[f64];

    /// The same, to be changed.
    fn as_mut_slice(&mut self) -> &mut [f64];
}

impl Coordinates for f64 {
    type Rows = [Row; 1];

    fn zeros(_: usize) -> Self {
        0.0
    }

    fn rows(_: usize) -> Self::Rows {
        [Row::default()]
    }

    #[inline(always)]
    fn lend(_: &mut Self) -> Self {
        0.0
    }

    #[inline(always)]
    fn give_back(self, _: &mut Self) {}

    #[inline(always)]
    fn as_slice(&self) -> &[f64] {
        std::slice::from_ref(self)
    }

    #[inline(always)]
    fn as_mut_slice(&mut self) -> &mut [f64] {
        std::slice::from_mut(self)
    }
}

impl Coordinates for Vec<f64> {
    type Rows = Vec<Row>;

    fn zeros(count: usize) -> Self {
        vec![0.0; count]
    }

    fn rows(count: usize) -> Self::Rows {
        vec![Row::default(); count]
    }

    fn lend(place: &mut Self) -> Self {
        std::mem::take(place)
    }

    fn give_back(self, place: &mut Self) {
        *place = self;
    }

    fn as_slice(&self) -> &[f64] {
        self
    }

    fn as_mut_slice(&mut self) -> &mut [f64] {
        self
    }
}

/// Coordinates and their rates at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct State<Q> {
    pub(crate) t: f64,
    /// What rounding leaves out of `t`: far from `t = 0` it would add up to a drift.
    pub(crate) late: f64,
    pub(crate) x: Q,
    pub(crate) xdot: Q,
}

impl<Q: Coordinates> State<Q> {
    /// So many coordinates at rest in the origin, at `t = 0`.
    pub(crate) fn zeros(count: usize) -> Self {
        Self { t: 0.0, late: 0.0, x: Q::zeros(count), xdot: Q::zeros(count) }
    }

    /// Becomes another one, in the memory that it has.
    #[inline]
    pub(crate) fn copy_from(&mut self, other: &Self) {
        (self.t, self.late) = (other.t, other.late);
        self.x.clone_from(&other.x);
        self.xdot.clone_from(&other.xdot);
    }
}

impl<Q> State<Q> {
    /// Moves the time on by `h`.
    #[inline]
    pub(crate) fn pass(&mut self, h: f64) {
        let step = h + self.late;
        let t = self.t + step;
        self.late = step - (t - self.t);
        self.t = t;
    }

    /// The coordinates `x` with the rates `xdot` after the time `h`.
    #[inline]
    pub(crate) fn after(&self, h: f64, x: Q, xdot: Q) -> Self {
        let mut after = State { t: self.t, late: self.late, x, xdot };
        after.pass(h);
        after
    }
}
