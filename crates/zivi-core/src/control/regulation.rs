//! The regulator's step solved exactly: two signs, in closed form.
//!
//! ```text
//! v+ = v + h ( ls (F - mu1) - mu2 lv ) / R      R = 1 - kappa ls lv
//! s+ = s + h R v+                               ls in sgn s+,  lv in sgn v+
//! u  = -mu1 - mu2 ls lv                         (in physical terms, -mu1 - mu2 sgn x')
//! ```
//!
//! With `D = h (F - mu1)` and `B = h mu2` the signs of one side are found from
//! `R v+ = R v + ls D - B lv`, and on the wall (`s+ = 0`) everything is linear in `ls`:
//!
//! * off the wall on the side of `s` (`ls = 1`), accepted when `s+ >= 0`;
//! * off the wall on the other side (`ls = -1`), accepted when `s+ <= 0`;
//! * on the wall: `lv = -1` and `ls = -(s/h + v + B)/(kappa v + D)`. From `s = 0` the step ends at
//!   the origin, and among the signs that stop it there, those with the smallest `|ls|` are chosen.
//!
//! Under the gain condition (`|F| <= M`, `M < mu2 < mu1 - M`, hence `D < -B`) the solution is
//! unique. Without it the order above is the selection rule; of two velocities on one side the one
//! that keeps the sign of `v` is taken.

use super::Gains;
use crate::control::cubic::cut;
use crate::{Lifted, Real, Restitution};

/// All that is constant over a run of the regulator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegulationStep {
    /// Sampling period (s).
    pub h: Real,
    /// The plant's wall.
    pub restitution: Restitution,
    /// The gains.
    pub gains: Gains,
}

/// The end of the step and its signs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Regulation {
    /// `(s+, v+)`.
    pub end: Lifted,
    /// `ls` in `sgn s+`.
    pub lambda_s: Real,
    /// `lv` in `sgn v+`.
    pub lambda_v: Real,
    /// The control (m/s^2).
    pub u: Real,
}

/// One side of the wall: `R v+`, `v+` and its sign.
struct Side {
    travel: Real,
    v: Real,
    lambda_v: Real,
}

impl RegulationStep {
    /// Solves the step from `z` under the force `f` that acts on the plant without control.
    #[must_use]
    pub fn solve(&self, z: Lifted, f: Real) -> Regulation {
        let sigma = if z.s < 0.0 { -1.0 } else { 1.0 };
        let z = Lifted { s: sigma * z.s, v: sigma * z.v };
        let push = self.h * (f - self.gains.mu1());
        let Regulation { end, lambda_s, lambda_v, u } = self.on_positive_side(z, push);
        // adding 0.0 turns the -0.0 of a mirrored zero into 0.0
        let mirror = |value: Real| sigma * value + 0.0;
        let end = Lifted { s: mirror(end.s), v: mirror(end.v) };
        Regulation { end, lambda_s: mirror(lambda_s), lambda_v: mirror(lambda_v), u }
    }

    /// The end of the step of these signs.
    #[must_use]
    pub fn of_signs(&self, z: Lifted, f: Real, [lambda_s, lambda_v]: [Real; 2]) -> Regulation {
        let r = self.restitution.r(lambda_s, lambda_v);
        let push = lambda_s * (f - self.gains.mu1()) - self.gains.mu2() * lambda_v;
        let v = z.v + self.h * push / r;
        self.regulation(Lifted { s: z.s + self.h * (r * v), v }, lambda_s, lambda_v)
    }

    fn on_positive_side(&self, z: Lifted, push: Real) -> Regulation {
        // the side of s, and the other one, mirrored
        let mut g = 1.0;
        loop {
            let Side { travel, v, lambda_v } = self.off_the_wall(g * z.v, push);
            let s = z.s + g * (self.h * travel);
            if g * s >= 0.0 {
                let mirror = |value: Real| g * value + 0.0;
                return self.regulation(Lifted { s, v: mirror(v) }, g, mirror(lambda_v));
            }
            if g < 0.0 {
                return self.on_the_wall(z, push);
            }
            g = -1.0;
        }
    }

    /// `R v+ = R v + D - B lv` with `lv` in `sgn v+`, `R = 1 - kappa lv`.
    fn off_the_wall(&self, v: Real, push: Real) -> Side {
        let brake = self.h * self.gains.mu2();
        let (slow, fast) = (self.restitution.r(1.0, 1.0), self.restitution.r(1.0, -1.0));
        let outward = slow * v + push - brake;
        let inward = fast * v + push + brake;
        if outward > 0.0 && (v > 0.0 || inward >= 0.0) {
            Side { travel: outward, v: outward / slow, lambda_v: 1.0 }
        } else if inward < 0.0 {
            Side { travel: inward, v: inward / fast, lambda_v: -1.0 }
        } else {
            let lambda_v = quotient(v + push, self.restitution.kappa() * v + brake);
            Side { travel: 0.0, v: 0.0, lambda_v }
        }
    }

    fn on_the_wall(&self, z: Lifted, push: Real) -> Regulation {
        let brake = self.h * self.gains.mu2();
        let kappa = self.restitution.kappa();
        if z.s == 0.0 {
            let (lambda_s, lambda_v) = self.stopping_signs(z.v, push);
            return self.regulation(Lifted::default(), lambda_s, lambda_v);
        }
        let travel = z.s / self.h;
        let lambda_s = quotient(-(travel + z.v + brake), kappa * z.v + push);
        let v = -travel / self.restitution.r(lambda_s, -1.0);
        self.regulation(Lifted { s: 0.0, v }, lambda_s, -1.0)
    }

    /// Signs with `R v + ls D - B lv = 0`: one equation for two. The brake alone stops a slow mass
    /// (`|v| <= B`, `ls = 0`); a faster one has it in full and the smallest `|ls|` that is needed.
    fn stopping_signs(&self, v: Real, push: Real) -> (Real, Real) {
        let brake = self.h * self.gains.mu2();
        let share = v / brake;
        if share.abs() <= 1.0 {
            return (0.0, share);
        }
        let (speed, sign) = (v.abs(), Real::copysign(1.0, v));
        let lambda_s = quotient(speed - brake, self.restitution.kappa() * speed - push);
        (sign * lambda_s, sign)
    }

    fn regulation(&self, end: Lifted, lambda_s: Real, lambda_v: Real) -> Regulation {
        let u = -self.gains.mu1() - self.gains.mu2() * (lambda_s * lambda_v);
        Regulation { end, lambda_s, lambda_v, u }
    }
}

/// `a/b` cut to `[-1, 1]`, and `0` for `0/0`.
fn quotient(a: Real, b: Real) -> Real {
    if a == 0.0 {
        0.0
    } else {
        cut(a / b)
    }
}
