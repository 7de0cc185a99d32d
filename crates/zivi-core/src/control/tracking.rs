//! The tracker's step solved exactly: the plant's four signs, for a known step of the reference.
//!
//! ```text
//! v+ = v + h [ ls^2 C + ls (1 - ls^2) F/R ]        C = A - mu1 les - mu2 lev,  A = lsr F_r/R_r
//! s+ = s + h R v+                                  R = 1 - kappa ls lv
//! ls in sgn s+,  lv in sgn v+,  les in sgn(s+ - s_r+),  lev in sgn(v+ - v_r+)
//! u  = R ls C - ls^2 F
//! ```
//!
//! The step is symmetric under `(s, v, s_r, v_r, A, signs) -> -(...)`, so it is solved for `s >= 0`.
//!
//! * **Away from the wall** (`ls = g`, `g = +1` or `-1`) the force drops out, and `v+` solves a
//!   scalar monotone inclusion ([`crate::control::cubic`]): one candidate for each `g`, accepted when
//!   `g s+ >= 0`. Since `R v+` is increasing in `v+`, `s+(g=+1) <= s+(g=-1)`: at most one of the
//!   two is accepted (except ties at zero).
//! * **On the wall** (`s+ = 0`): `lv = -1`, and `ls` is a root of a cubic, which the rejection of
//!   both candidates brackets:
//!
//!   ```text
//!   G(ls) = h (kappa C - F) ls^3 + h C ls^2 + (kappa v + h F) ls + (s/h + v) = 0
//!   ```
//!
//! **The selection rule.** There can be up to five solutions, even for `F = 0`. Taken is the one on
//! the side of `s`; else the one on the other side; else, of those on the wall, the one whose `v+`
//! is nearest to `v_r+`. No decision has a tolerance.
//!
//! Away from the wall, where `v+ = 0`, every `lv` in `[-1, 1]` solves the step: neither `v+` nor
//! `s+ = s` depend on it, only `R` and with it the control does. Taken is that of the reference
//! ([`TrackingStep::solve_near`]): on the reference the control is then `F_r - F`.

use super::cubic::Cubic;
use super::Gains;
use crate::control::cubic::{balance, cut, Switch};
use crate::{sgn, Lifted, Real, Restitution};

/// All that is constant over a run of the tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackingStep {
    /// Sampling period (s).
    pub h: Real,
    /// The plant's wall.
    pub restitution: Restitution,
    /// The gains.
    pub gains: Gains,
}

/// The reference at the end of the step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// `(s_r+, v_r+)`.
    pub end: Lifted,
    /// Its acceleration over the step, `A = lsr F_r/R_r` (m/s^2).
    pub acceleration: Real,
}

/// Where the solution lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Off the wall, on the side of `s`.
    Same,
    /// Off the wall, on the other side: the step crosses it.
    Other,
    /// On the wall, `s+ = 0`.
    Wall,
}

/// The end of the step, its signs, and the control that leads there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracking {
    /// `(s+, v+)`.
    pub end: Lifted,
    /// `ls` in `sgn s+`.
    pub lambda_s: Real,
    /// `lv` in `sgn v+`.
    pub lambda_v: Real,
    /// `les` in `sgn(s+ - s_r+)`.
    pub lambda_es: Real,
    /// `lev` in `sgn(v+ - v_r+)`.
    pub lambda_ev: Real,
    /// The control (m/s^2).
    pub u: Real,
    /// The case.
    pub place: Place,
    /// Iterations for roots of the cubic, at most twice [`super::cubic::MAX_ITERATIONS`].
    pub iterations: u32,
}

/// The end of a step with `ls, lv, les, lev`.
struct StepCandidate {
    end: Lifted,
    signs: [Real; 4],
    iterations: u32,
}

/// The step seen from the side `s >= 0`.
#[derive(Clone, Copy)]
struct SideFrame {
    step: TrackingStep,
    z: Lifted,
    target: Target,
    f: Real,
    /// The multiplier of `sgn v+` off the wall where `v+ = 0`.
    free: Real,
}

impl TrackingStep {
    /// Solves the step from `z` under the force `f` that acts on the plant without control.
    #[inline]
    #[must_use]
    pub fn solve(&self, z: Lifted, f: Real, target: Target) -> Tracking {
        self.solve_near(z, f, target, 0.0)
    }

    /// The same, with the selection of `sgn v+` closest to that of `sgn v_r+`, if free.
    #[inline]
    #[must_use]
    pub fn solve_near(&self, z: Lifted, f: Real, target: Target, lambda_vr: Real) -> Tracking {
        // a factor and not a case: the code that follows need not be there twice
        let side = Real::copysign(1.0, z.s + 0.0);
        let mirrored = |Lifted { s, v }| Lifted { s: side * s, v: side * v };
        let target = Target { end: mirrored(target.end), acceleration: side * target.acceleration };
        let frame = SideFrame { step: *self, z: mirrored(z), target, f, free: side * lambda_vr };
        let (candidate, place) = frame.accepted();
        frame.tracking(candidate, place).seen_from(side)
    }

    /// The end of the step and the control (20) of these `ls, lv, les, lev`.
    #[must_use]
    pub fn of_signs(&self, z: Lifted, f: Real, target: Target, signs: [Real; 4]) -> Tracking {
        let [lambda_s, lambda_v, lambda_es, lambda_ev] = signs;
        let (h, square) = (self.h, lambda_s * lambda_s);
        let r = self.restitution.r(lambda_s, lambda_v);
        let pull =
            target.acceleration - self.gains.mu1() * lambda_es - self.gains.mu2() * lambda_ev;
        let v = z.v + h * (square * pull + lambda_s * (1.0 - square) * f / r);
        let end = Lifted { s: z.s + h * (r * v), v };
        let place = match lambda_s * z.s {
            _ if square < 1.0 => Place::Wall,
            side if side < 0.0 => Place::Other,
            _ => Place::Same,
        };
        let u = r * lambda_s * pull - square * f;
        Tracking { end, lambda_s, lambda_v, lambda_es, lambda_ev, u, place, iterations: 0 }
    }
}

impl SideFrame {
    /// By the selection rule. (A NaN continues to the wall.)
    #[inline(always)]
    fn accepted(&self) -> (StepCandidate, Place) {
        let (mut g, mut place) = (1.0, Place::Same);
        loop {
            let candidate = self.off_the_wall(g);
            if g * candidate.end.s >= 0.0 {
                return (candidate, place);
            }
            if g < 0.0 {
                return (self.on_the_wall(), Place::Wall);
            }
            (g, place) = (-1.0, Place::Other);
        }
    }

    /// The candidate with `ls = g`. With `psi(v+) = R v+ = v+ (1 - kappa g sgn v+)` the position
    /// error switches where `psi(v+) = (s_r+ - s)/h`.
    #[inline(always)]
    fn off_the_wall(&self, g: Real) -> StepCandidate {
        let TrackingStep { h, restitution, gains } = self.step;
        let Target { end: aim, acceleration } = self.target;
        let travel = (aim.s - self.z.s) / h;
        let at_aim = travel / restitution.r(g, Real::copysign(1.0, travel)); // at 0 any R > 0 will do
        let found = balance(
            self.z.v + h * acceleration,
            Switch { at: at_aim, weight: h * gains.mu1() },
            Switch { at: aim.v, weight: h * gains.mu2() },
        );
        let moves = found.y.abs() > 0.0;
        let lambda_v = if moves { Real::copysign(1.0, found.y) } else { self.free };
        let r = restitution.r(g, lambda_v);
        // on the switch the position is the reference's, to the last bit
        let s = if found.y == at_aim { aim.s } else { self.z.s + h * (r * found.y) };
        let end = Lifted { s, v: found.y };
        StepCandidate { end, signs: [g, lambda_v, found.first, found.second], iterations: 0 }
    }

    /// `s+ = 0`. The sign of the velocity error switches at `ls = split`, where `v+ = v_r+`; that of
    /// the position error is `-sgn s_r+`, and free where the reference is on the wall too. The
    /// cubic's value between its two limits at `split` decides on which side of it there is a root.
    #[cold]
    #[inline(never)]
    fn on_the_wall(self) -> StepCandidate {
        let aim = self.target.end;
        let travel = self.z.s / self.step.h;
        let split = self.split(travel);
        let near = cut(split);
        // C is largest with both error signs at -1
        let (es_low, es_high) = if aim.s == 0.0 { (-1.0, 1.0) } else { (-sgn(aim.s), -sgn(aim.s)) };
        let (ev_low, ev_high) =
            (if split < -1.0 { 1.0 } else { -1.0 }, if split > 1.0 { -1.0 } else { 1.0 });
        let greatest = self.value(near, es_low, ev_low);
        let least = self.value(near, es_high, ev_high);
        let way = if least > 0.0 {
            Some((1.0, es_high, [ev_high, ev_low]))
        } else if greatest < 0.0 {
            Some((-1.0, es_low, [ev_low, ev_high]))
        } else {
            None
        };
        let (ls, les, lev, iterations) = if let Some((end, les, signs)) = way {
            self.nearest_root(near, end, les, signs)
        } else {
            let part = if greatest > least { greatest / (greatest - least) } else { 0.0 };
            let between = |low: Real, high: Real| cut(low + part * (high - low));
            (near, between(es_low, es_high), between(ev_low, ev_high), 0)
        };
        // to the last bit; nowhere for a reference that leaves the wall
        let v = if ls == split { aim.v } else { self.velocity_on_the_wall(ls) };
        let end = Lifted { s: 0.0, v };
        StepCandidate { end, signs: [ls, -1.0, les, lev], iterations }
    }

    /// The root whose `v+` is nearest to `v_r+`, with its signs and the iterations: between `near`
    /// and `end` there is one, towards `-end` there can be two. The sign of the velocity error is
    /// `ahead` on the one way and `behind` on the other.
    #[inline]
    fn nearest_root(
        &self,
        near: Real,
        end: Real,
        lambda_es: Real,
        [ahead, behind]: [Real; 2],
    ) -> (Real, Real, Real, u32) {
        let (root, count) = self.cubic(lambda_es, ahead).first_root(near, end);
        let back = self.cubic(lambda_es, behind).next_root(near, -end);
        let excess = |ls: Real| (self.velocity_on_the_wall(ls) - self.target.end.v).abs();
        match back {
            Some((other, more)) if excess(other) < excess(root) => {
                (other, lambda_es, behind, count + more)
            }
            Some((_, more)) => (root, lambda_es, ahead, count + more),
            None => (root, lambda_es, ahead, count),
        }
    }

    /// `v+ = -(s/h)/R` for `s+ = 0` (adding `0.0` turns `-0.0` into `0.0`).
    fn velocity_on_the_wall(&self, lambda_s: Real) -> Real {
        -(self.z.s / self.step.h) / self.step.restitution.r(lambda_s, -1.0) + 0.0
    }

    /// The `ls` at which `v+ = -(s/h)/(1 + kappa ls)` equals `v_r+`: below it `v+` is smaller.
    fn split(&self, travel: Real) -> Real {
        let v_r = self.target.end.v;
        if v_r < 0.0 {
            let excess = -travel / v_r - 1.0;
            // at kappa = 0 the velocity on the wall does not depend on ls: nowhere or everywhere
            if excess == 0.0 {
                0.0
            } else {
                excess / self.step.restitution.kappa()
            }
        } else if v_r == 0.0 && travel == 0.0 {
            0.0
        } else {
            Real::INFINITY
        }
    }

    /// `G` with these signs of the errors.
    #[inline(never)] // seldom asked for, at four places
    fn cubic(&self, lambda_es: Real, lambda_ev: Real) -> Cubic {
        let h = self.step.h;
        let kappa = self.step.restitution.kappa();
        let c = self.pull(lambda_es, lambda_ev);
        Cubic {
            c0: self.z.s / h + self.z.v,
            c1: kappa * self.z.v + h * self.f,
            c2: h * c,
            c3: h * (kappa * c - self.f),
        }
    }

    /// The value of `G` at `lambda_s`.
    #[inline(never)]
    fn value(&self, lambda_s: Real, lambda_es: Real, lambda_ev: Real) -> Real {
        self.cubic(lambda_es, lambda_ev).at(lambda_s)
    }

    /// `C = A - mu1 les - mu2 lev`.
    #[inline]
    fn pull(&self, lambda_es: Real, lambda_ev: Real) -> Real {
        let gains = self.step.gains;
        self.target.acceleration - gains.mu1() * lambda_es - gains.mu2() * lambda_ev
    }

    /// The accepted candidate with its control.
    #[inline]
    fn tracking(&self, candidate: StepCandidate, place: Place) -> Tracking {
        let StepCandidate { end, signs, iterations } = candidate;
        let [lambda_s, lambda_v, lambda_es, lambda_ev] = signs;
        let r = self.step.restitution.r(lambda_s, lambda_v);
        let c = self.pull(lambda_es, lambda_ev);
        let u = r * lambda_s * c - lambda_s * lambda_s * self.f;
        Tracking { end, lambda_s, lambda_v, lambda_es, lambda_ev, u, place, iterations }
    }
}

impl Tracking {
    /// The solution on the other branch, for the factor -1; the control is the same (adding
    /// `0.0` turns `-0.0` into `0.0`).
    #[inline]
    fn seen_from(self, side: Real) -> Self {
        let mirror = |value: Real| side * value + 0.0;
        Tracking {
            end: Lifted { s: mirror(self.end.s), v: mirror(self.end.v) },
            lambda_s: mirror(self.lambda_s),
            lambda_v: mirror(self.lambda_v),
            lambda_es: mirror(self.lambda_es),
            lambda_ev: mirror(self.lambda_ev),
            ..self
        }
    }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use super::*;

    #[test]
    fn on_the_wall_the_velocity_is_that_of_the_reference_to_the_last_bit() {
        let gains = Gains::new(30.0, 17.0).expect("mu1 > mu2");
        let restitution = Restitution::from_e(0.5).expect("e");
        let step = TrackingStep { h: 0.0625, restitution, gains };
        let mut rounded = 0;
        for k in 1_u8..=20 {
            // the reference already has x < 0, and A - mu1 + [-mu2, mu2] has a zero, so
            // v+ = v_r+; v+ (1 + kappa ls) = -s/h
            let v = -0.7 - 0.03 * Real::from(k);
            let z = Lifted { s: 0.0625 * 1.1 * -v, v };
            let target = Target { end: Lifted { s: -0.5, v }, acceleration: 30.0 };
            let found = step.solve(z, 0.0, target);
            assert_eq!((found.place, found.end), (Place::Wall, Lifted { s: 0.0, v }));
            assert!((found.lambda_s * restitution.kappa() - 0.1).abs() < 1e-6);
            let of_sign = -z.s / step.h / restitution.r(found.lambda_s, -1.0);
            rounded += u8::from(of_sign != v);
        }
        assert!(rounded > 0);
    }
}
