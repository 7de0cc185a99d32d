//! Gaps between points of a tree, and its dry friction.
//!
//! ```text
//! w = t . (p' - r omega x n)      w' = t . (p'' - r omega' x n)
//! ```
//!
//! is the speed at which a ball of radius `r` about `p` slips over a plane with the normal `n`. Where the body
//! moves in a plane that contains `n` and `t`, what `omega` turns is orthogonal to `t`: the acceleration of the
//! point of the body that touches is `w'` then.

use super::frame::{
    add, cross, dot, read, scaled, sub, turned, zero, Frame, Joint, JointKind, Vector,
};
use crate::numeric::power_series::Real;

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
    pub(super) fn numbers(self) -> usize {
        match self {
            Self::Lower(_) | Self::Upper(_) => 1,
            Self::Plane(_) | Self::Balls(..) => 7,
        }
    }

    pub(super) fn joints(self) -> [Option<usize>; 2] {
        match self {
            Self::Lower(j) | Self::Upper(j) | Self::Plane(j) => [Some(j), None],
            Self::Balls(a, b) => [a, b],
        }
    }
}

/// A channel of dry friction of a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TreeFriction {
    /// In a joint: the force while slipping and the static limit.
    Joint(usize),
    /// Along the plane of a gap, of a body that moves in a plane: the direction `t` of slip, the radius of the ball
    /// about the point of the gap, `mu` in slip and in stick.
    Plane(usize),
    /// One of two directions along the plane of a gap, of a body that moves in space: the same numbers.
    Tangent(usize),
    /// One of two directions between the balls of a gap, `0` or `1`: both radii, `mu` in slip and in stick.
    Between(usize, u8),
}

impl TreeFriction {
    pub(super) fn numbers(self) -> usize {
        match self {
            Self::Joint(_) => 2,
            Self::Plane(_) | Self::Tangent(_) => 6,
            Self::Between(..) => 4,
        }
    }

    /// Whether it belongs to an existing joint or gap above a plane.
    pub(super) fn is_known(self, joints: &[Joint], gaps: &[TreeGap]) -> bool {
        match self {
            Self::Joint(joint) => joint < joints.len(),
            Self::Plane(gap) | Self::Tangent(gap) => {
                matches!(gaps.get(gap), Some(TreeGap::Plane(_)))
            }
            Self::Between(gap, _) => matches!(gaps.get(gap), Some(TreeGap::Balls(..))),
        }
    }
}

/// The places in an evaluation that belong to one gap.
pub(super) struct Row<'a, T> {
    pub(super) gap: &'a mut T,
    pub(super) gradient: &'a mut [T],
    pub(super) curvature: &'a mut T,
}

/// The places in an evaluation that belong to one channel of friction.
pub(super) struct SlipRow<'a, T> {
    pub(super) direction: &'a mut [T],
    pub(super) curvature: &'a mut T,
    pub(super) limit: &'a mut T,
    pub(super) static_limit: &'a mut T,
}

/// A point of a body, with its velocity, and its acceleration without `q''`.
pub(super) struct Point<T> {
    joint: Option<usize>,
    pub(super) at: Vector<T>,
    velocity: Vector<T>,
    pub(super) acceleration: Vector<T>,
}

impl<T: Real> Point<T> {
    #[inline(always)]
    pub(super) fn of(joint: Option<usize>, own: Vector<T>, frames: &[Frame<T>]) -> Self {
        let Some(index) = joint else {
            let still = [T::of(0.0); 3];
            return Self { joint, at: own, velocity: still, acceleration: still };
        };
        Self::on(index, turned(&frames[index].axes, own), frames)
    }

    /// The point of a body at an arm, in axes of the world.
    #[inline(always)]
    fn on(index: usize, arm: Vector<T>, frames: &[Frame<T>]) -> Self {
        let frame = &frames[index];
        Self {
            joint: Some(index),
            at: add(frame.origin, arm),
            velocity: frame.velocity_at(arm),
            acceleration: frame.acceleration_at(arm),
        }
    }

    /// Adds how the point moves along `n` with each coordinate.
    #[inline(always)]
    pub(super) fn pull(&self, n: Vector<T>, joints: &[Joint], frames: &[Frame<T>], out: &mut [T]) {
        let mut at = self.joint;
        while let Some(index) = at {
            let frame = &frames[index];
            let moved = match joints[index].kind {
                JointKind::Slide => frame.axis(),
                JointKind::Hinge | JointKind::Rotation(_) => {
                    cross(frame.axis(), sub(self.at, frame.origin))
                }
            };
            out[index] = out[index] + dot(n, moved);
            at = joints[index].parent;
        }
    }
}

impl TreeGap {
    /// Writes the gap, its gradient and its curvature; `numbers` are its own.
    #[inline(always)]
    pub(super) fn fill<T: Real>(
        self,
        numbers: &[T],
        q: &[T],
        (joints, frames): (&[Joint], &[Frame<T>]),
        row: Row<'_, T>,
    ) {
        row.gradient.fill(T::of(0.0));
        match self {
            Self::Lower(joint) => {
                *row.gap = q[joint] - numbers[0];
                row.gradient[joint] = T::of(1.0);
                *row.curvature = T::of(0.0);
            }
            Self::Upper(joint) => {
                *row.gap = numbers[0] - q[joint];
                row.gradient[joint] = T::of(-1.0);
                *row.curvature = T::of(0.0);
            }
            Self::Plane(joint) => {
                let (point, n) =
                    (Point::of(Some(joint), read(numbers, 0), frames), read(numbers, 3));
                *row.gap = dot(n, point.at) - numbers[6];
                point.pull(n, joints, frames, row.gradient);
                *row.curvature = dot(n, point.acceleration);
            }
            Self::Balls(a, b) => {
                let a = Point::of(a, read(numbers, 0), frames);
                let b = Point::of(b, read(numbers, 3), frames);
                // l'' = u.s'' + (|s'|^2 - (u.s')^2)/l  with s = p_a - p_b, l = |s|, u = s/l
                let [s, rate] = [sub(a.at, b.at), sub(a.velocity, b.velocity)];
                let distance = dot(s, s).sqrt();
                let u = scaled(s, distance.inverse());
                *row.gap = distance - numbers[6];
                a.pull(u, joints, frames, row.gradient);
                b.pull(scaled(u, T::of(-1.0)), joints, frames, row.gradient);
                let closing = dot(u, rate);
                let swing = (dot(rate, rate) - closing * closing) * distance.inverse();
                *row.curvature = dot(u, sub(a.acceleration, b.acceleration)) + swing;
            }
        }
    }
}

impl TreeFriction {
    /// Writes direction, curvature and limits; `numbers` are its own, those of a gap above a plane are `of_gap`.
    #[inline(always)]
    pub(super) fn fill<T: Real>(
        self,
        (numbers, of_gap): (&[T], &[T]),
        gaps: &[TreeGap],
        (joints, frames): (&[Joint], &[Frame<T>]),
        row: SlipRow<'_, T>,
    ) {
        row.direction.fill(T::of(0.0));
        *row.curvature = T::of(0.0);
        let limits = match self {
            Self::Joint(joint) => {
                row.direction[joint] = T::of(1.0);
                numbers
            }
            Self::Plane(gap) => {
                if let TreeGap::Plane(joint) = gaps[gap] {
                    let (t, n) = (read(numbers, 0), read(of_gap, 3));
                    let arm = turned(&frames[joint].axes, read(of_gap, 0));
                    let touching = Point::on(joint, sub(arm, scaled(n, numbers[3])), frames);
                    touching.pull(t, joints, frames, row.direction);
                    *row.curvature = dot(t, touching.acceleration);
                }
                &numbers[4..]
            }
            Self::Tangent(gap) => {
                if let TreeGap::Plane(joint) = gaps[gap] {
                    let (t, n, frame) = (read(numbers, 0), read(of_gap, 3), &frames[joint]);
                    let (arm, beside) =
                        (turned(&frame.axes, read(of_gap, 0)), scaled(n, -numbers[3]));
                    Point::on(joint, add(arm, beside), frames).pull(
                        t,
                        joints,
                        frames,
                        row.direction,
                    );
                    // the ball touches with another of its points at each time
                    let turning = cross(frame.alpha, beside);
                    *row.curvature = dot(t, add(frame.acceleration_at(arm), turning));
                }
                &numbers[4..]
            }
            Self::Between(gap, which) => {
                if let TreeGap::Balls(a, b) = gaps[gap] {
                    let centres = [(a, read(of_gap, 0)), (b, read(of_gap, 3))];
                    let radii = [numbers[0], numbers[1]];
                    *row.curvature =
                        between(which, centres, radii, (joints, frames), row.direction);
                }
                &numbers[2..]
            }
        };
        (*row.limit, *row.static_limit) = (limits[0], limits[1]);
    }
}

/// A direction of slip between two balls: fills in its row, and returns its curvature.
///
/// ```text
/// u = s/l, s = p_a - p_b      c_a = v_a - r_a omega_a x u      c_b = v_b + r_b omega_b x u
/// w = t . (c_a - c_b)         w' = t . (c_a - c_b)' + t' . (c_a - c_b)
/// t_1 = e_x - x/(1 + z) (e_z + u)   t_2 = e_y - y/(1 + z) (e_z + u),   u = (x, y, z)
/// ```
///
/// with the tangents that turn along the shortest way with `u` from the third axis: all `u` but its opposite.
fn between<T: Real>(
    which: u8,
    [(a, at_a), (b, at_b)]: [(Option<usize>, Vector<T>); 2],
    radii: [T; 2],
    (joints, frames): (&[Joint], &[Frame<T>]),
    row: &mut [T],
) -> T {
    let (one, other) = (Point::of(a, at_a, frames), Point::of(b, at_b, frames));
    let [s, rate] = [sub(one.at, other.at), sub(one.velocity, other.velocity)];
    let part = dot(s, s).sqrt().inverse();
    let u = scaled(s, part);
    let turning = scaled(sub(rate, scaled(u, dot(u, rate))), part);
    let (t, t_rate) = tangent(usize::from(which), u, turning);
    let sides = [(one, a, -radii[0], T::of(1.0)), (other, b, radii[1], T::of(-1.0))];
    let mut curvature = T::of(0.0);
    for (point, joint, radius, sign) in sides {
        let (arm, arm_rate) = (scaled(u, radius), scaled(turning, radius));
        let (mut velocity, mut acceleration) = (point.velocity, point.acceleration);
        if let Some(frame) = joint.map(|index| &frames[index]) {
            velocity = add(velocity, cross(frame.omega, arm));
            let by_arm = add(cross(frame.alpha, arm), cross(frame.omega, arm_rate));
            acceleration = add(acceleration, by_arm);
        }
        let touching = Point { at: add(point.at, arm), ..point };
        touching.pull(scaled(t, sign), joints, frames, row);
        curvature = curvature + sign * (dot(t, acceleration) + dot(t_rate, velocity));
    }
    curvature
}

/// One of two directions across `u`, and its rate where `u` has the rate `v`.
fn tangent<T: Real>(k: usize, u: Vector<T>, v: Vector<T>) -> (Vector<T>, Vector<T>) {
    let part = (u[2] + T::of(1.0)).inverse();
    let slope = u[k] * part;
    let slope_rate = (v[k] - slope * v[2]) * part;
    let mut sum = u;
    sum[2] = sum[2] + T::of(1.0);
    let mut t = scaled(sum, -slope);
    t[k] = t[k] + T::of(1.0);
    (t, sub(scaled(sum, -slope_rate), scaled(v, slope)))
}

// Equality rows of a tree: points and frames that coincide, joints that move together or as prescribed.
//
// ```text
// p_a = p_b      a_i . b_j = 0 for (i, j) = (1, 2), (2, 3), (3, 1)      q_a - r_a - sum_k c_k (q_b - r_b)^k = 0
// ```
//
// Of axes that are fixed in two bodies `(a . b)' = (omega_a - omega_b) . (a x b)`.

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
