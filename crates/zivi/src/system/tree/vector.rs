//! Vectors in space and symmetric matrices.

use crate::numeric::real::Real;

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
    let half: Columns<T> = rows.map(|row| turned(r, row));
    let entry =
        |i: usize, j: usize| half[0][i] * r[0][j] + half[1][i] * r[1][j] + half[2][i] * r[2][j];
    [entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(0, 2), entry(1, 2)]
}

/// What a mass `m` with the first moment `h` adds to its inertia about a point `-d` from its own:
/// `(2 h.d + m d^2) 1 - h d^T - d h^T - m d d^T`.
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
