//! The controllers' steps as variational inequalities on `[-1, 1]^n`: the other form of the same
//! steps, for the general solver and for checking. No update uses it unless it is requested.
//!
//! ```text
//! regulator   Lambda = (ls, lv)                        F = -(s+, v+)
//! plant       Lambda = (ls, lv, les, lev)              F = -(s+, v+, s+ - s_r+, v+ - v_r+)
//! tracker     Lambda = (ls, lv, lsr, lvr, les, lev)    F = -(s+, v+, s_r+, v_r+, s+ - s_r+, v+ - v_r+)
//! ```

use core::ops::{Add, Div, Mul, Sub};

use crate::control::regulation::RegulationStep;
use crate::control::tracking::{Target, TrackingStep};
use crate::vi::{self, natural_component};
use crate::{Lifted, Real, Restitution};

/// A step as a box VI: its map, and the scales of its residual.
pub trait Inclusion<const N: usize> {
    /// `F(Lambda)`.
    fn map(&self, lambda: [f64; N]) -> [f64; N];

    /// `dF/dLambda`, row by row.
    fn jacobian(&self, lambda: [f64; N]) -> [[f64; N]; N];

    /// Magnitudes of the terms of each row (`1` where all vanish).
    fn scales(&self, lambda: [f64; N]) -> [f64; N];

    /// The natural residual of `Lambda`, each row divided by its scale: at rounding level for a
    /// solution, however small the state is.
    fn residual(&self, lambda: [f64; N]) -> f64 {
        let mut worst = 0.0;
        for ((row, scale), sign) in
            self.map(lambda).into_iter().zip(self.scales(lambda)).zip(lambda)
        {
            let residual = natural_component(sign, row / scale, -1.0, 1.0).abs();
            if residual > worst || residual.is_nan() {
                worst = residual;
            }
        }
        worst
    }
}

/// The regulator's step: two signs.
#[derive(Clone, Copy, Debug)]
pub struct RegulationInclusion<'a> {
    /// The scheme.
    pub step: &'a RegulationStep,
    /// Where the step starts.
    pub z: Lifted,
    /// The force without control (m/s^2).
    pub f: f64,
}

/// The plant's part of the tracker's step for a known step of the reference: four signs.
#[derive(Clone, Copy, Debug)]
pub struct PlantInclusion<'a> {
    /// The scheme.
    pub step: &'a TrackingStep,
    /// Where the step starts.
    pub z: Lifted,
    /// The force without control (m/s^2).
    pub f: f64,
    /// The reference at the end of the step.
    pub target: Target,
}

/// The whole of the tracker's step: six signs.
#[derive(Clone, Copy, Debug)]
pub struct TrackingInclusion<'a> {
    /// The scheme.
    pub step: &'a TrackingStep,
    /// The reference's wall.
    pub restitution_ref: Restitution,
    /// Where the plant's step starts.
    pub z: Lifted,
    /// Where the reference's step starts.
    pub reference: Lifted,
    /// The force without control (m/s^2).
    pub f: f64,
    /// The reference's force (m/s^2).
    pub f_ref: f64,
}

/// `R = 1 - kappa ls lv`.
fn r<const N: usize>(restitution: Restitution, lambda_s: Dual<N>, lambda_v: Dual<N>) -> Dual<N> {
    lambda_s * lambda_v * -restitution.kappa() + 1.0
}

/// The end of the regulator's step.
fn regulated<const N: usize>(
    it: &RegulationInclusion<'_>,
    [lambda_s, lambda_v]: [Dual<N>; 2],
) -> [Dual<N>; 2] {
    let RegulationStep { h, restitution, gains } = *it.step;
    let r = r(restitution, lambda_s, lambda_v);
    let push = lambda_s * (it.f - gains.mu1()) + lambda_v * -gains.mu2();
    let v = push / r * h + it.z.v;
    [r * v * h + it.z.s, v]
}

/// The end of the plant's step, for the acceleration `a` of the reference.
fn plant<const N: usize>(
    step: &TrackingStep,
    z: Lifted,
    f: f64,
    a: Dual<N>,
    [lambda_s, lambda_v, lambda_es, lambda_ev]: [Dual<N>; 4],
) -> [Dual<N>; 2] {
    let TrackingStep { h, restitution, gains } = *step;
    let r = r(restitution, lambda_s, lambda_v);
    let square = lambda_s * lambda_s;
    let pull = a + lambda_es * -gains.mu1() + lambda_ev * -gains.mu2();
    let free = lambda_s * (square * -1.0 + 1.0) * f / r;
    let v = (square * pull + free) * h + z.v;
    [r * v * h + z.s, v]
}

/// The end of the reference's step, and its acceleration `A = lsr F_r/R_r`.
fn reference<const N: usize>(
    it: &TrackingInclusion<'_>,
    [lambda_sr, lambda_vr]: [Dual<N>; 2],
) -> ([Dual<N>; 2], Dual<N>) {
    let h = it.step.h;
    let r = r(it.restitution_ref, lambda_sr, lambda_vr);
    let a = lambda_sr * it.f_ref / r;
    let v = a * h + it.reference.v;
    ([r * v * h + it.reference.s, v], a)
}

impl RegulationInclusion<'_> {
    fn rows<const N: usize>(&self, lambda: [Dual<N>; 2]) -> [Dual<N>; 2] {
        regulated(self, lambda).map(|row| row * -1.0)
    }
}

impl PlantInclusion<'_> {
    fn rows<const N: usize>(&self, lambda: [Dual<N>; 4]) -> [Dual<N>; 4] {
        let Target { end: aim, acceleration } = self.target;
        let a = Dual::constant(acceleration);
        let [s, v] = plant(self.step, self.z, self.f, a, lambda);
        [s, v, s + -aim.s, v + -aim.v].map(|row| row * -1.0)
    }
}

impl TrackingInclusion<'_> {
    fn rows<const N: usize>(&self, [ls, lv, lsr, lvr, les, lev]: [Dual<N>; 6]) -> [Dual<N>; 6] {
        let ([s_ref, v_ref], a) = reference(self, [lsr, lvr]);
        let [s, v] = plant(self.step, self.z, self.f, a, [ls, lv, les, lev]);
        [s, v, s_ref, v_ref, s - s_ref, v - v_ref].map(|row| row * -1.0)
    }
}

fn or_one(scale: f64) -> f64 {
    if scale == 0.0 {
        1.0
    } else {
        scale
    }
}

/// Magnitudes of the terms of the plant's `s+` and `v+`.
fn plant_scales(
    step: &TrackingStep,
    z: Lifted,
    f: f64,
    a: f64,
    [ls, lv, les, lev]: [f64; 4],
) -> [f64; 2] {
    let TrackingStep { h, restitution, gains } = *step;
    let r = restitution.r(ls, lv);
    let pull = a.abs() + gains.mu1() * les.abs() + gains.mu2() * lev.abs();
    let v = z.v.abs() + h * (ls * ls * pull + (ls * (1.0 - ls * ls) * f / r).abs());
    [z.s.abs() + h * r * v, v]
}

/// The two forms in which the solvers and the checks want a step's rows.
macro_rules! forms {
    ($n:literal) => {
        fn map(&self, lambda: [f64; $n]) -> [f64; $n] {
            self.rows(lambda.map(Dual::<0>::constant)).map(|row| row.value)
        }

        fn jacobian(&self, lambda: [f64; $n]) -> [[f64; $n]; $n] {
            let mut index = 0;
            let unknowns = lambda.map(|value| {
                index += 1;
                Dual::<$n>::unknown(value, index - 1)
            });
            self.rows(unknowns).map(|row| row.gradient)
        }
    };
}

impl Inclusion<2> for RegulationInclusion<'_> {
    forms!(2);

    fn scales(&self, [ls, lv]: [f64; 2]) -> [f64; 2] {
        let RegulationStep { h, restitution, gains } = *self.step;
        let r = restitution.r(ls, lv);
        let push = (ls * (self.f.abs() + gains.mu1())).abs() + gains.mu2() * lv.abs();
        let v = self.z.v.abs() + h * push / r;
        [self.z.s.abs() + h * r * v, v].map(or_one)
    }
}

impl Inclusion<4> for PlantInclusion<'_> {
    forms!(4);

    fn scales(&self, lambda: [f64; 4]) -> [f64; 4] {
        let Target { end: aim, acceleration } = self.target;
        let [s, v] = plant_scales(self.step, self.z, self.f, acceleration, lambda);
        [s, v, s + aim.s.abs(), v + aim.v.abs()].map(or_one)
    }
}

impl Inclusion<6> for TrackingInclusion<'_> {
    forms!(6);

    fn scales(&self, [ls, lv, lsr, lvr, les, lev]: [f64; 6]) -> [f64; 6] {
        let h = self.step.h;
        let r = self.restitution_ref.r(lsr, lvr);
        let a = lsr * self.f_ref / r;
        let [s, v] = plant_scales(self.step, self.z, self.f, a, [ls, lv, les, lev]);
        let v_ref = self.reference.v.abs() + h * a.abs();
        let s_ref = self.reference.s.abs() + h * r * v_ref;
        [s, v, s_ref, v_ref, s + s_ref, v + v_ref].map(or_one)
    }
}

/// Lets the general solver see a step.
#[derive(Clone, Copy, Debug)]
pub struct AsProblem<I>(
    /// The step.
    pub I,
);

impl<I> AsProblem<I> {
    fn write<const N: usize>(&self, lambda: &[f64], f: &mut [f64])
    where
        I: Inclusion<N>,
    {
        if let Ok(lambda) = lambda.try_into() {
            for (to, row) in f.iter_mut().zip(self.0.map(lambda)) {
                *to = row;
            }
        }
    }

    fn write_jacobian<const N: usize>(&self, lambda: &[f64], jacobian: &mut [f64])
    where
        I: Inclusion<N>,
    {
        if let Ok(lambda) = lambda.try_into() {
            let rows = self.0.jacobian(lambda);
            for (to, entry) in jacobian.iter_mut().zip(rows.as_flattened()) {
                *to = *entry;
            }
        }
    }
}

macro_rules! problem {
    ($inclusion:ident, $n:literal) => {
        impl vi::Problem for AsProblem<$inclusion<'_>> {
            fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), vi::EvaluationError> {
                self.write::<$n>(z, f);
                Ok(())
            }

            fn jacobian(&mut self, z: &[f64], j: &mut [f64]) -> Result<(), vi::EvaluationError> {
                self.write_jacobian::<$n>(z, j);
                Ok(())
            }
        }
    };
}

problem!(RegulationInclusion, 2);
problem!(PlantInclusion, 4);
problem!(TrackingInclusion, 6);

// Numbers that carry their derivatives with respect to `N` unknowns: an equation is written once
// and gives its Jacobian too.

/// A value and its gradient; `Dual<0>` is a plain number.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dual<const N: usize> {
    pub(super) value: Real,
    pub(super) gradient: [Real; N],
}

impl<const N: usize> Dual<N> {
    /// A constant.
    pub(super) fn constant(value: Real) -> Self {
        Self { value, gradient: [0.0; N] }
    }

    /// The `index`-th unknown.
    pub(super) fn unknown(value: Real, index: usize) -> Self {
        let mut gradient = [0.0; N];
        if let Some(own) = gradient.get_mut(index) {
            *own = 1.0;
        }
        Self { value, gradient }
    }

    /// `value` with the gradient `p a' + q b'`.
    fn combined(value: Real, p: Real, a: [Real; N], q: Real, b: [Real; N]) -> Self {
        let mut gradient = [0.0; N];
        for ((g, a), b) in gradient.iter_mut().zip(a).zip(b) {
            *g = p * a + q * b;
        }
        Self { value, gradient }
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::combined(self.value + other.value, 1.0, self.gradient, 1.0, other.gradient)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::combined(self.value - other.value, 1.0, self.gradient, -1.0, other.gradient)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let value = self.value * other.value;
        Self::combined(value, other.value, self.gradient, self.value, other.gradient)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        let inverse = 1.0 / other.value;
        Self::combined(value, inverse, self.gradient, -value * inverse, other.gradient)
    }
}

impl<const N: usize> Mul<Real> for Dual<N> {
    type Output = Self;
    fn mul(self, factor: Real) -> Self {
        Self::combined(self.value * factor, factor, self.gradient, 0.0, [0.0; N])
    }
}

impl<const N: usize> Add<Real> for Dual<N> {
    type Output = Self;
    fn add(self, term: Real) -> Self {
        Self { value: self.value + term, ..self }
    }
}
