//! Gaps between points of a tree.

use super::motion::Frame;
use super::vector::{add, cross, dot, read, scaled, sub, turned, Vector};
use super::{Joint, JointKind, TreeGap};
use crate::numeric::real::Real;

/// The places in an evaluation that belong to one gap.
pub(super) struct Row<'a, T> {
    pub(super) gap: &'a mut T,
    pub(super) gradient: &'a mut [T],
    pub(super) curvature: &'a mut T,
}

/// A point of a body, with its velocity, and its acceleration without `q''`.
struct Point<T> {
    joint: Option<usize>,
    at: Vector<T>,
    velocity: Vector<T>,
    acceleration: Vector<T>,
}

impl<T: Real> Point<T> {
    #[inline(always)]
    fn of(joint: Option<usize>, own: Vector<T>, frames: &[Frame<T>]) -> Self {
        let Some(index) = joint else {
            let still = [T::of(0.0); 3];
            return Self { joint, at: own, velocity: still, acceleration: still };
        };
        let frame = &frames[index];
        let arm = turned(&frame.axes, own);
        Self {
            joint,
            at: add(frame.origin, arm),
            velocity: frame.velocity_at(arm),
            acceleration: frame.acceleration_at(arm),
        }
    }

    /// Adds how the point moves along `n` with each coordinate.
    #[inline(always)]
    fn pull(&self, n: Vector<T>, joints: &[Joint], frames: &[Frame<T>], out: &mut [T]) {
        let mut at = self.joint;
        while let Some(index) = at {
            let frame = &frames[index];
            let moved = match joints[index].kind {
                JointKind::Hinge => cross(frame.axis(), sub(self.at, frame.origin)),
                JointKind::Slide => frame.axis(),
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
