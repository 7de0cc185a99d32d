//! Joints of a tree and the motion of their frames, from the root outwards.

use crate::numeric::power_series::Real;

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// About its axis, by an angle (rad).
    Hinge,
    /// Along its axis (m).
    Slide,
    /// One of the three coordinates of a rotation (see `frame`), by its number: each is on the one before.
    Rotation(u8),
}

/// A joint and its body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Joint {
    /// The joint that moves it, with a smaller number; none for the world.
    pub parent: Option<usize>,
    /// How it moves.
    pub kind: JointKind,
}

/// Where the numbers of a joint lie, from the first of them on.
pub(super) mod place {
    /// The origin of its frame in that of the parent.
    pub(in super::super) const POSITION: usize = 0;
    /// The columns of its axes in those of the parent.
    pub(in super::super) const AXES: usize = 3;
    /// Of what it moves: the mass,
    pub(in super::super) const MASS: usize = 12;
    /// the first moment,
    pub(in super::super) const MOMENT: usize = 13;
    /// the inertia about the origin: `xx, yy, zz, xy, xz, yz`.
    pub(in super::super) const INERTIA: usize = 16;
    /// `k`, `s`, `c`, what is added to the diagonal of `M`, `tau`.
    pub(in super::super) const STIFFNESS: usize = 22;
    pub(in super::super) const SPRING: usize = 23;
    pub(in super::super) const DAMPING: usize = 24;
    pub(in super::super) const ARMATURE: usize = 25;
    pub(in super::super) const TORQUE: usize = 26;
    /// The coordinate at which the frame is where position and axes say.
    pub(in super::super) const REFERENCE: usize = 27;
    /// How many there are.
    pub(in super::super) const ALL: usize = 28;
}

// Vectors in space and symmetric matrices.

/// A vector.
pub(super) type Vector<T> = [T; 3];
/// Columns of a matrix.
pub(super) type Columns<T> = [Vector<T>; 3];
/// A symmetric matrix: `xx, yy, zz, xy, xz, yz`.
pub(super) type Symmetric<T> = [T; 6];

#[inline(always)]
pub(super) fn zero<T: Real>() -> Vector<T> {
    [T::of(0.0); 3]
}

#[inline(always)]
pub(super) fn add<T: Real>(a: Vector<T>, b: Vector<T>) -> Vector<T> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub(super) fn sub<T: Real>(a: Vector<T>, b: Vector<T>) -> Vector<T> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(super) fn scaled<T: Real>(a: Vector<T>, s: T) -> Vector<T> {
    [a[0] * s, a[1] * s, a[2] * s]
}

#[inline(always)]
pub(super) fn dot<T: Real>(a: Vector<T>, b: Vector<T>) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(super) fn cross<T: Real>(a: Vector<T>, b: Vector<T>) -> Vector<T> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The three numbers that start here.
#[inline(always)]
pub(super) fn read<T: Real>(numbers: &[T], start: usize) -> Vector<T> {
    [numbers[start], numbers[start + 1], numbers[start + 2]]
}

/// `R x`.
#[inline(always)]
pub(super) fn turned<T: Real>(r: &Columns<T>, x: Vector<T>) -> Vector<T> {
    add(add(scaled(r[0], x[0]), scaled(r[1], x[1])), scaled(r[2], x[2]))
}

/// `S x`.
#[inline(always)]
pub(super) fn times<T: Real>(s: &Symmetric<T>, x: Vector<T>) -> Vector<T> {
    [
        s[0] * x[0] + s[3] * x[1] + s[4] * x[2],
        s[3] * x[0] + s[1] * x[1] + s[5] * x[2],
        s[4] * x[0] + s[5] * x[1] + s[2] * x[2],
    ]
}

/// `R S R^T`.
#[inline(always)]
pub(super) fn turned_inertia<T: Real>(r: &Columns<T>, s: &Symmetric<T>) -> Symmetric<T> {
    let rows = [[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]];
    let h: Columns<T> = [turned(r, rows[0]), turned(r, rows[1]), turned(r, rows[2])];
    [
        h[0][0] * r[0][0] + h[1][0] * r[1][0] + h[2][0] * r[2][0],
        h[0][1] * r[0][1] + h[1][1] * r[1][1] + h[2][1] * r[2][1],
        h[0][2] * r[0][2] + h[1][2] * r[1][2] + h[2][2] * r[2][2],
        h[0][0] * r[0][1] + h[1][0] * r[1][1] + h[2][0] * r[2][1],
        h[0][0] * r[0][2] + h[1][0] * r[1][2] + h[2][0] * r[2][2],
        h[0][1] * r[0][2] + h[1][1] * r[1][2] + h[2][1] * r[2][2],
    ]
}

/// Contribution of a mass `m` with the first moment `h` to the inertia about a point `-d` from its
/// own: `(2 h.d + m d^2) 1 - h d^T - d h^T - m d d^T`.
#[inline(always)]
pub(super) fn shift<T: Real>(m: T, h: Vector<T>, d: Vector<T>) -> Symmetric<T> {
    // with e = h + m d: e.d + h.d on the diagonal, less h d^T + d e^T
    let e = add(h, scaled(d, m));
    let both = dot(e, d) + dot(h, d);
    let product = |i: usize, j: usize| h[i] * d[j] + d[i] * e[j];
    [
        both - product(0, 0),
        both - product(1, 1),
        both - product(2, 2),
        -product(0, 1),
        -product(0, 2),
        -product(1, 2),
    ]
}

// How the frames of the joints move, from the root outwards.

/// The frame of a joint, in axes of the world; accelerations are those without `q''` and gravity.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame<T> {
    /// Its axes.
    pub(super) axes: Columns<T>,
    /// How the body turns or moves at a unit speed of the joint: an axis, of length one but in a rotation.
    pub(super) along: Vector<T>,
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
            along: z,
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
        self.along
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
        let x = turned(&self.axes, read(numbers, place::AXES));
        let y = turned(&self.axes, read(numbers, place::AXES + 3));
        let axis = turned(&self.axes, read(numbers, place::AXES + 6));
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
                    along: axis,
                    origin: add(self.origin, arm),
                    arm,
                    omega: add(self.omega, scaled(axis, w)),
                    velocity: self.velocity_at(arm),
                    alpha: add(self.alpha, swept),
                    acceleration: self.acceleration_at(arm),
                }
            }
            JointKind::Slide | JointKind::Rotation(_) => {
                arm = add(arm, scaled(axis, moved));
                Self {
                    axes: [x, y, axis],
                    along: axis,
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

// Rotations in space: three coordinates with two charts.
//
// ```text
// s = p / (1 + p_0)      R = 1 + c ((1 - s.s) S + 2 S S)      omega = c ((1 - s.s) s' + 2 s x s' + 2 s (s.s'))
// c = 4 / (1 + s.s)^2    omega' = ... + 2 c (s'.s') s - 4 (s.s') / (1 + s.s) omega
// ```
//
// is the stereographic projection of the unit quaternion `(p_0, p)`, in axes of the frame that carries the rotation;
// `S` is the matrix of `s x`. `-p` is the same rotation, with the coordinates `-s / s.s`: one of both is at most one. The
// matrix of `omega` is orthogonal but for its factor, so that no chart is singular before `|s|` is infinite, a whole
// turn (J. Stuelpnagel, On the parametrization of the three-dimensional rotation group, SIAM Review 6, 1964).

/// A rotation and how it turns, in axes of the frame that carries it.
struct Turning<T> {
    s: Vector<T>,
    square: T,
    factor: T,
}

impl<T: Real> Turning<T> {
    fn of(s: Vector<T>) -> Self {
        let square = dot(s, s);
        let part = (square + T::of(1.0)).inverse();
        Self { s, square, factor: T::of(4.0) * part * part }
    }

    /// `1 - s.s`.
    fn rest(&self) -> T {
        T::of(1.0) - self.square
    }

    /// The axes of the body, `R`.
    fn axes(&self) -> Columns<T> {
        std::array::from_fn(|k| {
            let mut axis = zero();
            axis[k] = T::of(1.0);
            let once = cross(self.s, axis);
            let twice = cross(self.s, once);
            let more = add(scaled(once, self.rest()), scaled(twice, T::of(2.0)));
            add(axis, scaled(more, self.factor))
        })
    }

    /// `omega` for the rates `v`.
    fn omega(&self, v: Vector<T>) -> Vector<T> {
        let along = dot(self.s, v);
        let across = add(scaled(cross(self.s, v), T::of(2.0)), scaled(self.s, along + along));
        scaled(add(scaled(v, self.rest()), across), self.factor)
    }

    /// The rates for `omega`: its matrix is orthogonal but for a factor.
    fn rates(&self, omega: Vector<T>) -> Vector<T> {
        let along = dot(self.s, omega);
        let across = add(scaled(cross(self.s, omega), T::of(-2.0)), scaled(self.s, along + along));
        scaled(add(scaled(omega, self.rest()), across), T::of(0.25))
    }

    /// `omega'` without `s''`.
    fn bias(&self, v: Vector<T>) -> Vector<T> {
        let two = self.factor * T::of(2.0) * dot(v, v);
        let part = (self.square + T::of(1.0)).inverse();
        let back = T::of(-4.0) * dot(self.s, v) * part;
        add(scaled(self.s, two), scaled(self.omega(v), back))
    }
}

impl<T: Real> Frame<T> {
    /// The frame of the coordinate `k` of a rotation, which is that of joint `i`, on this one: that of the last turns.
    pub(super) fn next_in_rotation(
        &self,
        k: u8,
        numbers: &[T],
        (i, q, w): (usize, &[T], &[T]),
    ) -> Self {
        let k = usize::from(k);
        let first = i - k;
        let turning = Turning::of(read(q, first));
        let axes = [0, 1, 2].map(|k| turned(&self.axes, read(numbers, place::AXES + 3 * k)));
        let arm = turned(&self.axes, read(numbers, place::POSITION));
        let mut unit = zero();
        unit[k] = T::of(1.0);
        let still = Self {
            axes,
            along: turned(&axes, turning.omega(unit)),
            origin: add(self.origin, arm),
            arm,
            omega: self.omega,
            velocity: self.velocity_at(arm),
            alpha: self.alpha,
            acceleration: self.acceleration_at(arm),
        };
        if k < 2 {
            return still;
        }
        let v = read(w, first);
        let [omega, bias] = [turning.omega(v), turning.bias(v)].map(|it| turned(&axes, it));
        Self {
            axes: turning.axes().map(|axis| turned(&axes, axis)),
            omega: add(self.omega, omega),
            alpha: add(self.alpha, add(cross(self.omega, omega), bias)),
            ..still
        }
    }
}

/// Takes a rotation with `|s| > far` into its other chart; whether that was so.
pub(super) fn change_chart(far: f64, s: &mut [f64], v: &mut [f64]) -> bool {
    let here = Turning::of(read(s, 0));
    if here.square.is_nan() || here.square <= far * far {
        return false;
    }
    let omega = here.omega(read(v, 0));
    let there = Turning::of(scaled(here.s, -here.square.recip()));
    v.copy_from_slice(&there.rates(omega));
    s.copy_from_slice(&there.s);
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::power_series::DualNumber;

    const S: Vector<f64> = [0.7, -1.1, 0.4];
    const V: Vector<f64> = [0.3, 0.9, -0.5];

    fn dual(s: Vector<f64>, v: Vector<f64>) -> Vector<DualNumber> {
        std::array::from_fn(|k| DualNumber { value: s[k], slope: v[k] })
    }

    fn near(a: Vector<f64>, b: Vector<f64>) {
        assert!((0..3).all(|k| (a[k] - b[k]).abs() < 1e-14), "{a:?} {b:?}");
    }

    #[test]
    fn axes_turn_with_omega_and_omega_changes_by_the_bias() {
        let (here, moved) = (Turning::of(S), Turning::of(dual(S, V)));
        let omega = here.omega(V);
        for (axis, moved) in here.axes().into_iter().zip(moved.axes()) {
            near(moved.map(|it| it.slope), cross(omega, axis));
        }
        let steady = V.map(DualNumber::of);
        near(moved.omega(steady).map(|it| it.slope), here.bias(V));
        near(here.rates(omega), V);
    }

    #[test]
    fn both_charts_have_one_rotation_and_one_angular_velocity() {
        let (mut s, mut v) = (S, V);
        assert!(!change_chart(2.0, &mut s, &mut v) && s == S);
        assert!(change_chart(1.0, &mut s, &mut v) && dot(s, s) < 1.0);
        let (one, other) = (Turning::of(S), Turning::of(s));
        near(one.omega(V), other.omega(v));
        for (a, b) in one.axes().into_iter().zip(other.axes()) {
            near(a, b);
        }
        assert!(!change_chart(1.0, &mut s, &mut v));
    }
}
