//! Equality rows of a tree: points and frames that coincide, joints that move together or as prescribed.
//!
//! ```text
//! p_a = p_b      a_i . b_j = 0 for (i, j) = (1, 2), (2, 3), (3, 1)      q_a - r_a - sum_k c_k (q_b - r_b)^k = 0
//! ```
//!
//! Of axes that are fixed in two bodies `(a . b)' = (omega_a - omega_b) . (a x b)`.

use super::frame::{
    add, cross, dot, read, scaled, sub, turned, zero, Frame, Joint, JointKind, Vector,
};
use super::gap::Point;
use crate::numeric::power_series::Real;

/// Equality rows of a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TreeConstraint {
    /// Points of two bodies, the world if none, are one, three rows: `p_a`, `p_b` in the frames of the joints.
    Connect(Option<usize>, Option<usize>),
    /// The same, and axes of both bodies stay orthogonal, six rows: `p_a`, `p_b`, the three axes in the frame of
    /// `a`, the same in that of `b`.
    Weld(Option<usize>, Option<usize>),
    /// A coordinate follows another one, or a constant: `r_a`, `r_b`, `c_0` to `c_4`.
    Joint(usize, Option<usize>),
}

/// The places of equality rows in an evaluation, from the first row on.
pub(super) struct EqualityRows<'a, T> {
    pub(super) values: &'a mut [T],
    pub(super) gradients: &'a mut [T],
    pub(super) curvatures: &'a mut [T],
}

/// Pairs of axes that are orthogonal where two frames are one.
const PAIRS: [(usize, usize); 3] = [(0, 1), (1, 2), (2, 0)];

impl TreeConstraint {
    /// How many rows there are.
    #[must_use]
    pub fn rows(self) -> usize {
        match self {
            Self::Connect(..) => 3,
            Self::Weld(..) => 6,
            Self::Joint(..) => 1,
        }
    }

    pub(super) fn numbers(self) -> usize {
        match self {
            Self::Connect(..) => 6,
            Self::Weld(..) => 24,
            Self::Joint(..) => 7,
        }
    }

    pub(super) fn joints(self) -> [Option<usize>; 2] {
        match self {
            Self::Connect(a, b) | Self::Weld(a, b) => [a, b],
            Self::Joint(a, b) => [Some(a), b],
        }
    }

    /// Writes values, gradients and curvatures; `numbers` are its own.
    pub(super) fn fill<T: Real>(
        self,
        numbers: &[T],
        q: &[T],
        w: &[T],
        known: (&[Joint], &[Frame<T>]),
        rows: EqualityRows<'_, T>,
    ) {
        rows.gradients.fill(T::of(0.0));
        match self {
            Self::Connect(a, b) => connect(numbers, (a, b), known, rows),
            Self::Weld(a, b) => {
                let n = q.len();
                let (values, turned) = rows.values.split_at_mut(3);
                let (gradients, turned_gradients) = rows.gradients.split_at_mut(3 * n);
                let (curvatures, turned_curvatures) = rows.curvatures.split_at_mut(3);
                connect(numbers, (a, b), known, EqualityRows { values, gradients, curvatures });
                let rest = EqualityRows {
                    values: turned,
                    gradients: turned_gradients,
                    curvatures: turned_curvatures,
                };
                align(&numbers[6..], (a, b), known, rest);
            }
            Self::Joint(a, b) => {
                let [value, slope, bend] = polynomial(numbers, b.map(|b| q[b]));
                let rate = b.map_or(T::of(0.0), |b| w[b]);
                rows.values[0] = q[a] - numbers[0] - value;
                rows.gradients[a] = T::of(1.0);
                if let Some(b) = b {
                    rows.gradients[b] = rows.gradients[b] - slope;
                }
                rows.curvatures[0] = -(bend * rate * rate);
            }
        }
    }
}

/// `sum_k c_k x^k` and its derivatives.
fn polynomial<T: Real>(numbers: &[T], q: Option<T>) -> [T; 3] {
    let Some(q) = q else { return [numbers[2], T::of(0.0), T::of(0.0)] };
    let x = q - numbers[1];
    let start = [T::of(0.0); 3];
    numbers[2..7].iter().rev().fold(start, |[value, slope, bend], c| {
        [value * x + *c, slope * x + value, bend * x + slope + slope]
    })
}

/// Points that coincide.
fn connect<T: Real>(
    numbers: &[T],
    (a, b): (Option<usize>, Option<usize>),
    (joints, frames): (&[Joint], &[Frame<T>]),
    rows: EqualityRows<'_, T>,
) {
    let n = joints.len();
    let a = Point::of(a, read(numbers, 0), frames);
    let b = Point::of(b, read(numbers, 3), frames);
    let (apart, bias) = (sub(a.at, b.at), sub(a.acceleration, b.acceleration));
    for k in 0..3 {
        let mut along = zero();
        along[k] = T::of(1.0);
        let gradient = &mut rows.gradients[k * n..][..n];
        a.pull(along, joints, frames, gradient);
        b.pull(scaled(along, T::of(-1.0)), joints, frames, gradient);
        rows.values[k] = apart[k];
        rows.curvatures[k] = bias[k];
    }
}

/// An axis in space and its angular velocity and acceleration.
#[derive(Clone, Copy)]
struct Axis<T> {
    joint: Option<usize>,
    along: Vector<T>,
    omega: Vector<T>,
    alpha: Vector<T>,
}

impl<T: Real> Axis<T> {
    fn of(joint: Option<usize>, own: Vector<T>, frames: &[Frame<T>]) -> Self {
        match joint.map(|index| &frames[index]) {
            None => Self { joint, along: own, omega: zero(), alpha: zero() },
            Some(frame) => Self {
                joint,
                along: turned(&frame.axes, own),
                omega: frame.omega,
                alpha: frame.alpha,
            },
        }
    }

    /// Its rate, and the rate of that without `q''`.
    fn rates(&self) -> [Vector<T>; 2] {
        let rate = cross(self.omega, self.along);
        [rate, add(cross(self.alpha, self.along), cross(self.omega, rate))]
    }

    /// Adds `n` times how each coordinate turns it.
    fn pull(&self, n: Vector<T>, joints: &[Joint], frames: &[Frame<T>], out: &mut [T]) {
        let mut at = self.joint;
        while let Some(index) = at {
            if joints[index].kind != JointKind::Slide {
                out[index] = out[index] + dot(n, frames[index].axis());
            }
            at = joints[index].parent;
        }
    }
}

/// Axes that stay orthogonal.
fn align<T: Real>(
    numbers: &[T],
    (a, b): (Option<usize>, Option<usize>),
    (joints, frames): (&[Joint], &[Frame<T>]),
    rows: EqualityRows<'_, T>,
) {
    let n = joints.len();
    for (k, (i, j)) in PAIRS.into_iter().enumerate() {
        let a = Axis::of(a, read(numbers, 3 * i), frames);
        let b = Axis::of(b, read(numbers, 9 + 3 * j), frames);
        let across = cross(a.along, b.along);
        let gradient = &mut rows.gradients[k * n..][..n];
        a.pull(across, joints, frames, gradient);
        b.pull(scaled(across, T::of(-1.0)), joints, frames, gradient);
        let ([of_a, bias_a], [of_b, bias_b]) = (a.rates(), b.rates());
        let both = dot(of_a, of_b);
        rows.values[k] = dot(a.along, b.along);
        rows.curvatures[k] = dot(bias_a, b.along) + dot(a.along, bias_b) + both + both;
    }
}
