//! How the frames of the joints move, from the root outwards.

use super::vector::{add, cross, read, scaled, turned, zero, Columns, Vector};
use super::{place, Joint, JointKind};
use crate::numeric::real::Real;

/// The frame of a joint, in axes of the world; accelerations are those without `q''` and gravity.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame<T> {
    /// Its axes.
    pub(super) axes: Columns<T>,
    /// Its origin.
    pub(super) origin: Vector<T>,
    /// The origin less that of the parent.
    pub(super) arm: Vector<T>,
    pub(super) omega: Vector<T>,
    pub(super) velocity: Vector<T>,
    pub(super) alpha: Vector<T>,
    pub(super) acceleration: Vector<T>,
}

impl<T: Real> Frame<T> {
    /// That of the world.
    pub(super) fn world() -> Self {
        let (one, zero) = (T::of(1.0), zero());
        let [mut x, mut y, mut z] = [zero; 3];
        (x[0], y[1], z[2]) = (one, one, one);
        Self {
            axes: [x, y, z],
            origin: zero,
            arm: zero,
            omega: zero,
            velocity: zero,
            alpha: zero,
            acceleration: zero,
        }
    }

    /// The axis of the joint.
    #[inline(always)]
    pub(super) fn axis(&self) -> Vector<T> {
        self.axes[2]
    }

    /// `omega x r`.
    #[inline(always)]
    pub(super) fn velocity_at(&self, arm: Vector<T>) -> Vector<T> {
        add(self.velocity, cross(self.omega, arm))
    }

    /// `a + alpha x r + omega x (omega x r)`.
    #[inline(always)]
    pub(super) fn acceleration_at(&self, arm: Vector<T>) -> Vector<T> {
        let turning = add(cross(self.alpha, arm), cross(self.omega, cross(self.omega, arm)));
        add(self.acceleration, turning)
    }

    /// The frame of a joint on this one.
    #[inline(always)]
    pub(super) fn next(&self, joint: Joint, numbers: &[T], q: T, w: T) -> Self {
        let axis_of = |k: usize| turned(&self.axes, read(numbers, place::AXES + 3 * k));
        let [x, y, axis] = [axis_of(0), axis_of(1), axis_of(2)];
        let mut arm = turned(&self.axes, read(numbers, place::POSITION));
        let moved = q - numbers[place::REFERENCE];
        let swept = cross(self.omega, scaled(axis, w));
        match joint.kind {
            JointKind::Hinge => {
                let (sin, cos) = moved.sin_cos();
                Self {
                    axes: [
                        add(scaled(x, cos), scaled(y, sin)),
                        add(scaled(y, cos), scaled(x, -sin)),
                        axis,
                    ],
                    origin: add(self.origin, arm),
                    arm,
                    omega: add(self.omega, scaled(axis, w)),
                    velocity: self.velocity_at(arm),
                    alpha: add(self.alpha, swept),
                    acceleration: self.acceleration_at(arm),
                }
            }
            JointKind::Slide => {
                arm = add(arm, scaled(axis, moved));
                Self {
                    axes: [x, y, axis],
                    origin: add(self.origin, arm),
                    arm,
                    omega: self.omega,
                    velocity: add(self.velocity_at(arm), scaled(axis, w)),
                    alpha: self.alpha,
                    acceleration: add(self.acceleration_at(arm), add(swept, swept)),
                }
            }
        }
    }
}
