//! Forces and composite bodies, gathered from the leaves inwards.

use super::motion::Frame;
use super::vector::{
    add, cross, dot, read, scaled, shift, sub, times, turned, turned_inertia, Symmetric, Vector,
};
use super::{place, Joint, JointKind};
use crate::numeric::real::Real;

/// A force and its moment about the origin of a frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wrench<T> {
    force: Vector<T>,
    moment: Vector<T>,
}

impl<T: Real> Wrench<T> {
    /// Its power for a unit speed of the joint.
    #[inline(always)]
    fn along(&self, joint: Joint, frame: &Frame<T>) -> T {
        let of = match joint.kind {
            JointKind::Hinge => self.moment,
            JointKind::Slide => self.force,
        };
        dot(frame.axis(), of)
    }

    /// The same about the origin of the parent.
    #[inline(always)]
    fn carried(&self, arm: Vector<T>) -> Self {
        Self { force: self.force, moment: add(self.moment, cross(arm, self.force)) }
    }
}

/// What a joint moves, its own body first, then all that it carries too.
#[derive(Clone, Copy, Debug)]
pub(super) struct Load<T> {
    mass: T,
    /// The first moment about the origin of the frame.
    first: Vector<T>,
    /// The inertia about the origin.
    inertia: Symmetric<T>,
    /// What moves it as it moves without `q''`, against gravity.
    wrench: Wrench<T>,
}

impl<T: Real> Load<T> {
    /// That of the body of a joint.
    #[inline(always)]
    pub(super) fn of(frame: &Frame<T>, numbers: &[T], gravity: Vector<T>) -> Self {
        let mass = numbers[place::MASS];
        let first = turned(&frame.axes, read(numbers, place::MOMENT));
        let own: Symmetric<T> = std::array::from_fn(|k| numbers[place::INERTIA + k]);
        let inertia = turned_inertia(&frame.axes, &own);
        let Frame { omega, alpha, .. } = *frame;
        let fall = sub(frame.acceleration, gravity);
        let turning = add(cross(alpha, first), cross(omega, cross(omega, first)));
        let spinning = add(times(&inertia, alpha), cross(omega, times(&inertia, omega)));
        let wrench = Wrench {
            force: add(scaled(fall, mass), turning),
            moment: add(spinning, cross(first, fall)),
        };
        Self { mass, first, inertia, wrench }
    }

    /// The force of the joint that is needed, `b`.
    #[inline(always)]
    pub(super) fn bias(&self, joint: Joint, frame: &Frame<T>) -> T {
        self.wrench.along(joint, frame)
    }

    /// Adds what a child carries.
    #[inline(always)]
    pub(super) fn take(&mut self, child: &Self, arm: Vector<T>) {
        let moved = shift(child.mass, child.first, arm);
        self.mass = self.mass + child.mass;
        self.first = add(self.first, add(child.first, scaled(arm, child.mass)));
        self.inertia = std::array::from_fn(|k| self.inertia[k] + (child.inertia[k] + moved[k]));
        let wrench = child.wrench.carried(arm);
        self.wrench = Wrench {
            force: add(self.wrench.force, wrench.force),
            moment: add(self.wrench.moment, wrench.moment),
        };
    }

    /// The momentum of all at a unit speed of the joint.
    #[inline(always)]
    fn momentum(&self, joint: Joint, axis: Vector<T>) -> Wrench<T> {
        match joint.kind {
            JointKind::Hinge => {
                Wrench { force: cross(axis, self.first), moment: times(&self.inertia, axis) }
            }
            JointKind::Slide => {
                Wrench { force: scaled(axis, self.mass), moment: cross(self.first, axis) }
            }
        }
    }
}

/// Row and column of `M` of a joint: how its motion moves the joints that carry it.
#[inline(always)]
pub(super) fn couple<T: Real>(
    i: usize,
    joints: &[Joint],
    frames: &[Frame<T>],
    load: &Load<T>,
    mass: &mut [T],
) {
    let n = joints.len();
    let mut momentum = load.momentum(joints[i], frames[i].axis());
    let mut at = i;
    loop {
        let entry = momentum.along(joints[at], &frames[at]);
        mass[i * n + at] = entry;
        mass[at * n + i] = entry;
        match joints[at].parent {
            Some(parent) => {
                momentum = momentum.carried(frames[at].arm);
                at = parent;
            }
            None => return,
        }
    }
}
