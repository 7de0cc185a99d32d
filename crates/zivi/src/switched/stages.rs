//! One step of an embedded pair on `x'' = f(t, x, x')`.
//!
//! With `y = (x, x')` the stages are velocities `V_i` and accelerations `k_i`:
//!
//! ```text
//! X_i = x + h sum_j a_ij V_j     V_i = x' + h sum_j a_ij k_j     k_i = f(t + c_i h, X_i, V_i)
//! ```
//!
//! Only `f` is evaluated, and it is evaluated where the stages are: `X_i` may be a little below
//! zero in a step that ends in an impact.

use super::flight::series::Linear;
use crate::numeric::bernstein::Bernstein;
use crate::numeric::tableau::{Estimate, Interpolant, Pair, MOST_STAGES};
use crate::record::failure::Failure;
use crate::system::evaluation::{ends_at_the_wall, evaluate};
use crate::{Force, Physical};

/// A force whose evaluations are counted.
pub(crate) struct Counted<'a, F> {
    force: &'a mut F,
    count: u64,
    /// Times between which it is smooth: it is asked at no others.
    smooth: (f64, f64),
    /// Its numbers, where it is known by them: then it is not evaluated.
    linear: Option<Linear>,
}

impl<'a, F> Counted<'a, F> {
    pub(crate) fn new(force: &'a mut F) -> Self {
        Self { force, count: 0, smooth: (f64::NEG_INFINITY, f64::INFINITY), linear: None }
    }

    /// The same, known by its numbers if there are any.
    pub(super) fn linear(self, linear: Option<Linear>) -> Self {
        Self { linear, ..self }
    }

    /// From here on the force is smooth from `start` to `end`, where it may jump: it is asked
    /// between them only, by more than rounding, so that each side has its own limit.
    pub(super) fn is_smooth_between(&mut self, start: f64, end: f64) {
        let margin = |t: f64| (4.0 * f64::EPSILON * t.abs()).max(f64::MIN_POSITIVE);
        self.smooth = (start + margin(start), end - margin(end));
    }

    pub(super) fn count(&self) -> u64 {
        self.count
    }

    /// The force itself, the time at which it is asked instead of `t`, and the window for that.
    pub(super) fn smooth_at(&mut self, t: f64) -> (&mut F, f64, (f64, f64)) {
        (self.force, t.max(self.smooth.0).min(self.smooth.1), self.smooth)
    }

    pub(super) fn at<E>(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, Failure<E>>
    where
        F: Force<E>,
    {
        self.count += 1;
        let t = t.max(self.smooth.0).min(self.smooth.1);
        let state = Physical { x, xdot };
        match evaluate(self.force, t, state) {
            Err(failure) if ends_at_the_wall(self.force, state, &failure) => {
                self.count += 1;
                evaluate(self.force, t, Physical { x: 0.0, ..state })
            }
            value => value,
        }
    }

    /// The force on the mass at rest at the wall.
    pub(super) fn at_wall<E>(&mut self, t: f64) -> Result<f64, Failure<E>>
    where
        F: Force<E>,
    {
        self.known_at(t, 0.0, 0.0)
    }

    /// As [`Counted::at`], by the numbers of the force where it is known by them.
    pub(super) fn known_at<E>(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, Failure<E>>
    where
        F: Force<E>,
    {
        match &mut self.linear {
            Some(linear) => {
                let t = t.max(self.smooth.0).min(self.smooth.1);
                evaluate(linear, t, Physical { x, xdot })
            }
            None => self.at(t, x, xdot),
        }
    }

    pub(super) fn dependence_at_rest<E>(&self) -> crate::Dependence
    where
        F: Force<E>,
    {
        match &self.linear {
            Some(linear) => Force::<E>::dependence_at_rest(linear),
            None => self.force.dependence_at_rest(),
        }
    }

    pub(super) fn shortest_period<E>(&self) -> Option<f64>
    where
        F: Force<E>,
    {
        match &self.linear {
            Some(linear) => Force::<E>::shortest_period(linear),
            None => self.force.shortest_period(),
        }
    }

    pub(super) fn dependence<E>(&self) -> crate::Dependence
    where
        F: Force<E>,
    {
        match &self.linear {
            Some(linear) => Force::<E>::dependence(linear),
            None => self.force.dependence(),
        }
    }
}

/// A state at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Point {
    pub(super) t: f64,
    /// What rounding leaves out of `t`: far from `t = 0` it would add up to a drift.
    pub(super) late: f64,
    pub(super) x: f64,
    pub(super) xdot: f64,
}

impl Point {
    /// The state `x`, `xdot` after the time `h`.
    #[inline]
    pub(super) fn after(self, h: f64, x: f64, xdot: f64) -> Self {
        let step = h + self.late;
        let t = self.t + step;
        Self { t, late: step - (t - self.t), x, xdot }
    }
}

/// The last step that was computed: its stages and both of its ends.
#[derive(Clone, Debug)]
pub(super) struct Stages {
    pub(super) pair: &'static Pair,
    pub(super) from: Point,
    pub(super) h: f64,
    pub(super) end: Point,
    /// Velocities and accelerations of the stages.
    v: [f64; MOST_STAGES],
    k: [f64; MOST_STAGES],
    /// Stages known: those of the step, the one at its end, further ones.
    known: usize,
}

/// Error of a step by component, before scaling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StepError {
    pub(super) x: [f64; 2],
    pub(super) xdot: [f64; 2],
    pub(super) double: bool,
}

impl StepError {
    /// The larger of the two components, each by its scale.
    pub(super) fn norm(&self, scale_x: f64, scale_xdot: f64) -> f64 {
        let one = |[first, second]: [f64; 2], scale: f64| {
            let (first, second) = ((first / scale).abs(), second / scale);
            if !self.double || first == 0.0 {
                return first;
            }
            // of the orders 5 and 3, together of order 7: e5^2/sqrt(e5^2 + 0.01 e3^2)
            first * (first / first.hypot(0.1 * second))
        };
        let (x, xdot) = (one(self.x, scale_x), one(self.xdot, scale_xdot));
        // f64::max would drop NaN
        if x > xdot || x.is_nan() {
            x
        } else {
            xdot
        }
    }
}

impl Stages {
    pub(super) fn new(pair: &'static Pair) -> Self {
        let (from, zeros) = (Point::default(), [0.0; MOST_STAGES]);
        Self { pair, from, h: 0.0, end: from, v: zeros, k: zeros, known: 0 }
    }

    /// What rounding of the time does to position and velocity, `eps t (x', x'')/4`, in a step that
    /// is not itself of that size.
    pub(super) fn rounding(&self) -> [f64; 2] {
        let time = 0.25 * f64::EPSILON * self.from.t.abs();
        if self.h < 1e4 * time {
            return [0.0; 2];
        }
        let fastest = self.from.xdot.abs().max(self.end.xdot.abs());
        let pull = self.k[..self.pair.b.len()].iter().fold(0.0_f64, |most, k| most.max(k.abs()));
        [time * fastest, time * pull]
    }

    pub(super) fn order_of_error(&self) -> f64 {
        self.pair.q
    }

    /// The step of length `h` from `from`, where the acceleration is `slope`.
    pub(super) fn step<E, F: Force<E>>(
        &mut self,
        from: Point,
        slope: f64,
        h: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Point, Failure<E>> {
        let pair = self.pair;
        (self.from, self.h, self.known) = (from, h, 1);
        (self.v[0], self.k[0]) = (from.xdot, slope);
        for row in pair.a {
            self.stage(row, force)?;
        }
        self.end = self.along(pair.b, 1.0);
        Ok(self.end)
    }

    /// The state at the stage `i`, whose row of the tableau this is.
    pub(super) fn node(&self, i: usize, row: &[f64]) -> Point {
        self.along(row, self.pair.c[i])
    }

    /// The point `from + h sum_j a_j (V_j, k_j)` at the node `c`.
    #[inline]
    fn along(&self, a: &[f64], c: f64) -> Point {
        let (x, xdot) = self.weighted(a);
        let from = self.from;
        from.after(c * self.h, from.x + self.h * x, from.xdot + self.h * xdot)
    }

    #[inline]
    fn weighted(&self, a: &[f64]) -> (f64, f64) {
        let (mut x, mut xdot) = (0.0, 0.0);
        for ((a, v), k) in a.iter().zip(&self.v).zip(&self.k) {
            x += a * v;
            xdot += a * k;
        }
        (x, xdot)
    }

    #[inline]
    fn stage<E, F: Force<E>>(
        &mut self,
        row: &[f64],
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let i = self.known;
        let at = self.along(row, self.pair.c[i]);
        self.v[i] = at.xdot;
        self.k[i] = force.at(at.t, at.x, at.xdot)?;
        self.known = i + 1;
        Ok(())
    }

    /// The acceleration at the start of the step.
    pub(super) fn slope_at_start(&self) -> f64 {
        self.k[0]
    }

    /// The acceleration at the end of the step, which is also that of the next stage.
    pub(super) fn slope_at_end<E, F: Force<E>>(
        &mut self,
        force: &mut Counted<'_, F>,
    ) -> Result<f64, Failure<E>> {
        let i = self.pair.b.len();
        if self.known == i {
            self.v[i] = self.end.xdot;
            self.k[i] = force.at(self.end.t, self.end.x, self.end.xdot)?;
            self.known = i + 1;
        }
        Ok(self.k[i])
    }

    /// The estimated error of the step.
    pub(super) fn error<E, F: Force<E>>(
        &mut self,
        force: &mut Counted<'_, F>,
    ) -> Result<StepError, Failure<E>> {
        let h = self.h;
        Ok(match self.pair.estimate {
            Estimate::Single(e) => {
                self.slope_at_end(force)?;
                let (x, xdot) = self.weighted(e);
                StepError { x: [h * x, 0.0], xdot: [h * xdot, 0.0], double: false }
            }
            Estimate::Double(e5, e3) => {
                let ((x5, v5), (x3, v3)) = (self.weighted(e5), self.weighted(e3));
                StepError { x: [h * x5, h * x3], xdot: [h * v5, h * v3], double: true }
            }
        })
    }

    /// Whether all stages and the end move away from the wall, or are pushed away from it: so the
    /// whole step from rest moves away. (Where the force grows like a high power of the time, the
    /// velocities of some stages are negative for every step size.)
    pub(super) fn rises(&self) -> bool {
        let last = self.pair.b.len();
        let away = |of: &[f64]| of[..last].iter().all(|&it| it >= 0.0);
        (away(&self.v) || away(&self.k)) && self.end.x > self.from.x && self.end.xdot > 0.0
    }

    /// The cubic through the ends of the step, and by how much the position may differ from it
    /// (relative to `theta` if the step starts at the wall): the accelerations of the stages say
    /// how far the motion is from one with a linear acceleration. None where more stages would
    /// not tell more.
    pub(super) fn screen(&self) -> Option<(Bernstein, f64)> {
        let Interpolant::Nested { .. } = self.pair.interpolant else { return None };
        let (from, end) = (self.from, self.end);
        screen(self.pair, self.h, (from.x, from.xdot), (end.x, end.xdot), &self.k)
    }

    /// How far the polynomials of the last step are from `x'' = f` at `theta`, as an error of the
    /// position and of the velocity at its end.
    pub(super) fn defect<E, F: Force<E>>(
        &self,
        [x, xdot]: &[Bernstein; 2],
        theta: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<StepError, Failure<E>> {
        let at = self.from.after(theta * self.h, x.at(theta), xdot.at(theta));
        let f = force.at(at.t, at.x, at.xdot)?;
        let defect = self.h * f - xdot.slope(theta);
        Ok(StepError { x: [self.h * defect, 0.0], xdot: [defect, 0.0], double: false })
    }

    /// The polynomials of position and velocity over the step.
    pub(super) fn polynomials<E, F: Force<E>>(
        &mut self,
        force: &mut Counted<'_, F>,
    ) -> Result<[Bernstein; 2], Failure<E>> {
        self.slope_at_end(force)?;
        let (h, from, end) = (self.h, self.from, self.end);
        let [x, xdot] = match self.pair.interpolant {
            Interpolant::Monomials(p) => [
                Bernstein::from_quartic(quartic(from.x, h, &self.v, p)),
                Bernstein::from_quartic(quartic(from.xdot, h, &self.k, p)),
            ],
            Interpolant::Nested { a, d } => {
                let last = self.pair.b.len();
                for row in &a[self.known - last - 1..] {
                    self.stage(row, force)?;
                }
                let x = nested([from.x, end.x], h, &self.v, last, &d);
                let xdot = nested([from.xdot, end.xdot], h, &self.k, last, &d);
                [Bernstein::from_nested(from.x, x), Bernstein::from_nested(from.xdot, xdot)]
            }
        };
        // what rounding leaves at the ends would be on the wrong side of the wall
        Ok([x.with_ends(from.x, end.x), xdot.with_ends(from.xdot, end.xdot)])
    }
}

/// As [`Stages::screen`], from the position and velocity at the ends and the accelerations `k`.
pub(crate) fn screen(
    pair: &Pair,
    h: f64,
    (x0, v0): (f64, f64),
    (x1, v1): (f64, f64),
    k: &[f64; MOST_STAGES],
) -> Option<(Bernstein, f64)> {
    let cubic = Bernstein::hermite((x0, h * v0), (x1, h * v1));
    let &[c0, c1, c2, c3] = cubic.coefficients() else { return None };
    let (first, last) = (6.0 * (c0 - 2.0 * c1 + c2), 6.0 * (c1 - 2.0 * c2 + c3));
    let mut worst = 0.0_f64;
    for (c, k) in pair.c.iter().zip(k).take(pair.b.len()) {
        worst = worst.max((h * h * k - first - c * (last - first)).abs());
    }
    // |e''| <= worst and e = 0 at both ends: |e| <= worst/8, |e'| <= worst/2
    Some(if x0 == 0.0 {
        (cubic.without_root_at_zero(), 0.5 * worst)
    } else {
        (cubic, 0.125 * worst)
    })
}

/// Coefficients of `y + h sum_i k_i p_i(theta)`.
pub(crate) fn quartic(y: f64, h: f64, k: &[f64; MOST_STAGES], p: &[[f64; 4]]) -> [f64; 5] {
    let mut a = [y, 0.0, 0.0, 0.0, 0.0];
    for (k, row) in k.iter().zip(p) {
        for (a, p) in a[1..].iter_mut().zip(row) {
            *a += h * k * p;
        }
    }
    a
}

/// Coefficients of the nested form: the Hermite part from the ends, the rest from all stages.
pub(crate) fn nested(
    [y, end]: [f64; 2],
    h: f64,
    k: &[f64; MOST_STAGES],
    last: usize,
    d: &[&[f64]; 4],
) -> [f64; 7] {
    let rise = end - y;
    let mut f = [rise, h * k[0] - rise, 2.0 * rise - h * (k[0] + k[last]), 0.0, 0.0, 0.0, 0.0];
    for (f, row) in f[3..].iter_mut().zip(d) {
        *f = h * row.iter().zip(k).map(|(d, k)| d * k).sum::<f64>();
    }
    f
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::tableau::{DOP853, DORMAND_PRINCE_5};
    use crate::FunctionForce;

    /// `x'' = -x + 0.3 t - 0.1 x'`: error of one step and of its polynomials, by step size.
    fn errors(pair: &'static Pair, h: f64) -> [f64; 2] {
        let exact = |t: f64| {
            // x = p + q t + e^(-0.05 t) (a cos w t + b sin w t), q = 0.3, p = -0.03
            let w = (1.0 - 0.0025f64).sqrt();
            let (a, b) = (1.03, (0.2 - 0.3 + 0.05 * 1.03) / w);
            let (sin, cos) = (w * t).sin_cos();
            let decay = (-0.05 * t).exp();
            -0.03 + 0.3 * t + decay * (a * cos + b * sin)
        };
        let f = |t: f64, x: f64, v: f64| Ok::<f64, ()>(-x + 0.3 * t - 0.1 * v);
        let (mut force, mut stages) = (FunctionForce(f), Stages::new(pair));
        let force = &mut Counted::new(&mut force);
        let from = Point { x: 1.0, xdot: 0.2, ..Point::default() };
        let Ok(slope) = force.at::<()>(0.0, 1.0, 0.2) else { panic!() };
        let Ok(end) = stages.step::<(), _>(from, slope, h, force) else { panic!() };
        let Ok([x, xdot]) = stages.polynomials::<(), _>(force) else { panic!() };
        assert!((x.at(1.0) - end.x).abs() < 1e-14 && (xdot.at(1.0) - end.xdot).abs() < 1e-14);
        let inside = (1..8).map(|i| f64::from(i) / 8.0);
        let dense = inside.map(|c| (x.at(c) - exact(c * h)).abs()).fold(0.0, f64::max);
        [(end.x - exact(h)).abs(), dense]
    }

    #[test]
    fn the_screen_bounds_the_motion() {
        // x'' = 6 cos(4 t): far from a cubic within the step; the polynomials show by how much
        let mut force =
            FunctionForce(|t: f64, _: f64, _: f64| Ok::<f64, ()>(6.0 * (4.0 * t).cos()));
        let force = &mut Counted::new(&mut force);
        for x in [0.0, 0.3] {
            let mut stages = Stages::new(&DOP853);
            let from = Point { t: 0.2, late: 0.0, x, xdot: 1.0 };
            let Ok(slope) = force.at::<()>(0.2, x, 1.0) else { panic!() };
            assert!(stages.step::<(), _>(from, slope, 0.5, force).is_ok());
            let Some((cubic, slack)) = stages.screen() else { panic!("no screen") };
            let Ok([p, _]) = stages.polynomials::<(), _>(force) else { panic!() };
            let p = if x == 0.0 { p.without_root_at_zero() } else { p };
            let apart = |i: i32| {
                let theta = f64::from(i) / 20.0;
                (p.at(theta) - cubic.at(theta)).abs()
            };
            let worst = (0..=20).map(apart).fold(0.0, f64::max);
            // a bound, and not a needless one
            assert!(worst > 1e-3 && worst <= slack && slack < 20.0 * worst, "{worst} {slack}");
        }
    }

    #[test]
    fn steps_and_polynomials_have_their_orders() {
        // local errors: h^(p+1) for the step, h^(q+1) for the polynomial of order q
        for (pair, h, orders) in [(&DORMAND_PRINCE_5, 0.4, [5.9, 4.8]), (&DOP853, 1.6, [8.7, 7.7])]
        {
            let (coarse, fine) = (errors(pair, h), errors(pair, h / 2.0));
            for i in 0..2 {
                let order = (coarse[i] / fine[i]).log2();
                assert!(order > orders[i], "{i}: order {order} {coarse:?} {fine:?}");
            }
        }
    }
}
