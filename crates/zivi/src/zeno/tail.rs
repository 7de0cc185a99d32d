//! The infinitely many arcs that a jump to rest skips, evaluated when they are asked for.
//!
//! With `m` counted from the last impact that was computed,
//!
//! ```text
//! T(m) = t_inf - sum_k C_k e^(km)      U(m) = sum_k D_k e^(km)                        (1)
//! ```
//!
//! are the times of the impacts and the speeds after them; `C` and `D` make (1) exact at impacts
//! of the chain (`m <= 0`). On the arc `[T(m), T(m+1)]` the position is the cubic with `x = 0` at
//! both ends and the velocities `U(m)` and `-U(m+1)/e` there.

use super::chain::Bounce;
use crate::numeric::bernstein::Bernstein;
use crate::record::point::is_sigma;
use crate::record::user_events::Level;
use crate::{Impact, PathPoint};

/// Most terms of (1).
const TERMS: usize = 4;

/// The arcs between the last computed impact and the Zeno point.
#[derive(Clone, Debug, PartialEq)]
pub struct Tail {
    e: f64,
    start: f64,
    zeno: f64,
    /// Up to when the run went: `zeno`, unless an event ended it before.
    until: f64,
    sigma: f64,
    c: [f64; TERMS],
    d: [f64; TERMS],
}

/// One arc: where it starts and ends, and the velocities there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TailArc {
    pub(crate) start: f64,
    pub(crate) end: f64,
    pub(crate) u: f64,
    pub(crate) incoming: f64,
    pub(crate) sigma: f64,
}

impl TailArc {
    pub(crate) fn at(&self, t: f64) -> PathPoint {
        let h = self.end - self.start;
        let theta = ((t - self.start) / h).clamp(0.0, 1.0);
        let rest = 1.0 - theta;
        let (u, w) = (self.u, self.incoming);
        let x = h * theta * rest * (u * rest - w * theta);
        let xdot = u * rest * (1.0 - 3.0 * theta) + w * theta * (3.0 * theta - 2.0);
        PathPoint { x, xdot, sigma: self.sigma }
    }

    /// Of the cubic.
    pub(crate) fn acceleration(&self, t: f64) -> f64 {
        let h = self.end - self.start;
        let theta = ((t - self.start) / h).clamp(0.0, 1.0);
        let (u, w) = (self.u, self.incoming);
        (u * (6.0 * theta - 4.0) + w * (6.0 * theta - 2.0)) / h
    }
}

impl TailArc {
    /// When a level is crossed.
    pub(crate) fn crossings(&self, level: Level) -> Vec<f64> {
        let h = self.end - self.start;
        let (u, w) = (self.u, self.incoming);
        let all = match level {
            Level::Position(c) => Bernstein::hermite((0.0, h * u), (0.0, h * w)).crossings(c),
            Level::Velocity(c) => Bernstein::new(&[u, -(u + w), w]).crossings(c),
        };
        all.iter().map(|theta| (self.start + theta * h).min(self.end)).collect()
    }
}

/// Numbers that a tail consists of.
pub(crate) const TAIL_NUMBERS: usize = 5 + 2 * TERMS;

impl Tail {
    /// All that it consists of.
    pub(crate) fn to_numbers(&self) -> Vec<f64> {
        let Self { e, start, zeno, until, sigma, c, d } = self;
        [*e, *start, *zeno, *until, *sigma].iter().chain(c).chain(d).copied().collect()
    }

    /// What [`Tail::to_numbers`] came from; `None` for numbers that are none of a tail.
    pub(crate) fn from_numbers(numbers: &[f64]) -> Option<Self> {
        let (head, series) = numbers.split_at_checked(5)?;
        let &[e, start, zeno, until, sigma] = head else { return None };
        let (c, d) = series.split_at_checked(TERMS)?;
        let finite = numbers.iter().all(|number| number.is_finite());
        let ordered = start <= until && until <= zeno && 0.0 < e && e < 1.0 && is_sigma(sigma);
        let (c, d) = (c.try_into().ok()?, d.try_into().ok()?);
        (finite && ordered).then_some(Self { e, start, zeno, until, sigma, c, d })
    }

    /// The tail of a chain of at least one impact that comes to rest at `zeno`.
    pub(super) fn new(bounces: &[Bounce], e: f64, zeno: f64, sigma: f64) -> Self {
        let last = bounces.len() - 1;
        let mut terms = TERMS.min(bounces.len());
        loop {
            let stride = stride(e, terms, last);
            let points = (0..terms).map(|i| &bounces[last - i * stride]);
            let (mut t, mut u) = ([0.0; TERMS], [0.0; TERMS]);
            for (i, bounce) in points.enumerate() {
                (t[i], u[i]) = (zeno - bounce.t, bounce.u);
            }
            let (c, d) = (fit(e, stride, terms, t), fit(e, stride, terms, u));
            let start = bounces[last].t;
            let tail = Self { e, start, zeno, until: zeno, sigma, c, d };
            if terms == 1 || tail.is_sound() {
                return tail;
            }
            terms -= 1;
        }
    }

    /// Whether times rise and speeds fall over the first arcs, as they must.
    fn is_sound(&self) -> bool {
        let arcs = 2 + (1.0 / (1.0 - self.e)) as i32;
        (0..4).all(|i| {
            let m = f64::from(i * arcs / 4);
            self.time(m + 1.0) > self.time(m)
                && self.speed(m) > self.speed(m + 1.0)
                && self.speed(m + 1.0) > 0.0
        })
    }

    /// Equation (1).
    fn time(&self, m: f64) -> f64 {
        if m == 0.0 {
            self.start
        } else {
            self.zeno - series(&self.c, libm::pow(self.e, m))
        }
    }

    fn speed(&self, m: f64) -> f64 {
        series(&self.d, libm::pow(self.e, m))
    }

    /// Time of the last impact before the tail (s).
    #[must_use]
    pub fn start(&self) -> f64 {
        self.start
    }

    /// Time at which the motion comes to rest (s).
    #[must_use]
    pub fn zeno_time(&self) -> f64 {
        self.zeno
    }

    /// Ends the tail before its Zeno point.
    pub(crate) fn cut(&mut self, t: f64) {
        self.until = t;
    }

    /// The impacts after [`Tail::start`], at falling speeds after them, down to `speed` (m/s); at
    /// most `at_most`.
    pub fn impacts_down_to(&self, speed: f64, at_most: usize) -> impl Iterator<Item = Impact> + '_ {
        (1..=at_most)
            .map(|m| {
                let m = m as f64;
                let u = self.speed(m);
                Impact { t: self.time(m), xdot_before: -u / self.e, xdot_after: u }
            })
            .take_while(move |it| it.xdot_after >= speed && it.t <= self.until && it.t < self.zeno)
    }

    /// The arc `m = 0, 1, ...`, unless it is too short to be told from its ends.
    pub(crate) fn arc(&self, m: usize) -> Option<TailArc> {
        let n = m as f64;
        let (start, end) = (self.time(n), self.time(n + 1.0).min(self.zeno));
        let sigma = if m.is_multiple_of(2) { self.sigma } else { -self.sigma };
        let incoming = -self.speed(n + 1.0) / self.e;
        let arc = TailArc { start, end, u: self.speed(n), incoming, sigma };
        (end > start && arc.u > 0.0 && incoming < 0.0).then_some(arc)
    }

    /// The arc on which `t` lies, if there is one that can be told from its ends.
    pub(crate) fn arc_at(&self, t: f64) -> Option<TailArc> {
        let (left, whole) = (self.zeno - t, self.zeno - self.start);
        if !(left > 0.0 && left <= whole) {
            return None;
        }
        let is_over = |m: usize| self.arc(m).is_some_and(|arc| arc.end <= t);
        // the leading term of (1) gives the arc up to a few: from there a bracket, and its halves
        let guess = (libm::log(left / whole) / libm::log(self.e)).floor().clamp(0.0, 1e9) as usize;
        let (mut first, mut beyond, mut step) = (guess, guess, 1);
        while first > 0 && !is_over(first - 1) {
            (beyond, first) = (first - 1, first.saturating_sub(step));
            step *= 2;
        }
        while is_over(beyond) {
            (first, beyond) = (beyond + 1, beyond + step);
            step *= 2;
        }
        while first < beyond {
            let middle = first + (beyond - first) / 2;
            if is_over(middle) {
                first = middle + 1;
            } else {
                beyond = middle;
            }
        }
        self.arc(first)
    }

    /// The state at `t`, within the tail.
    #[must_use]
    pub fn at(&self, t: f64) -> PathPoint {
        let rest = PathPoint { x: 0.0, xdot: 0.0, sigma: self.sigma };
        self.arc_at(t).map_or(rest, |arc| arc.at(t))
    }
}

/// Points of the chain for the fit lie so many impacts apart that the speed falls by a tenth, if
/// it has that many: neighbours tell little from each other when `e` is near 1, and what is far
/// away tells little of the tail.
fn stride(e: f64, terms: usize, last: usize) -> usize {
    if terms < 2 {
        return 1;
    }
    let tenth = (libm::log(0.9) / libm::log(e)).round().max(1.0) as usize;
    tenth.min(last / (terms - 1)).max(1)
}

/// `sum_k a_k q^k`, `k = 1, 2, ...`
fn series(a: &[f64; TERMS], q: f64) -> f64 {
    a.iter().rev().fold(0.0, |sum, a| (sum + a) * q)
}

/// The `a` with `sum_k a_k q_i^k = values_i`, `q_i = e^(-i stride)`, by Newton's interpolation of
/// `values/q`.
fn fit(e: f64, stride: usize, terms: usize, values: [f64; TERMS]) -> [f64; TERMS] {
    let q: [f64; TERMS] = std::array::from_fn(|i| libm::pow(e, -((i * stride) as f64)));
    let mut d: [f64; TERMS] = std::array::from_fn(|i| values[i] / q[i]);
    for level in 1..terms {
        for i in (level..terms).rev() {
            d[i] = (d[i] - d[i - 1]) / (q[i] - q[i - level]);
        }
    }
    // from the Newton form to powers
    let mut a = [0.0; TERMS];
    for i in (0..terms).rev() {
        for k in (1..TERMS).rev() {
            a[k] = a[k - 1] - q[i] * a[k];
        }
        a[0] = d[i] - q[i] * a[0];
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tail_that_is_cut_has_no_impacts_after_that() {
        // x'' = -2, e = 1/2: impacts at 0, 1, 1.5, 1.75, ..., with half the speed each time
        let mut chain = Vec::new();
        for (t, u) in [(0.0, 1.0), (1.0, 0.5), (1.5, 0.25)] {
            chain.push(Bounce { t, u, g: 2.0 });
        }
        let mut tail = Tail::new(&chain, 0.5, 2.0, 1.0);
        tail.cut(1.9);
        let times: Vec<f64> = tail.impacts_down_to(1e-6, 100).map(|it| it.t).collect();
        assert_eq!(times.len(), 2, "{times:?}");
        assert!((times[0] - 1.75).abs() < 1e-14 && (times[1] - 1.875).abs() < 1e-14);
    }

    #[test]
    fn the_ball_is_exact() {
        let (e, g, u0) = (0.6, 9.81, 3.0);
        let mut chain = Vec::new();
        let (mut t, mut u) = (1.0, u0);
        for _ in 0..6 {
            chain.push(Bounce { t, u, g });
            (t, u) = (t + 2.0 * u / g, e * u);
        }
        let (start, first) = (t - 2.0 * (u / e) / g, u / e);
        let zeno = start + 2.0 * first / (g * (1.0 - e));
        let tail = Tail::new(&chain, e, zeno, 1.0);
        let (mut begin, mut speed, mut sigma) = (start, first, 1.0);
        for m in 0..20 {
            let flight = 2.0 * speed / g;
            for part in [0.0, 0.2, 0.5, 0.9] {
                let tau = part * flight;
                let PathPoint { x, xdot, sigma: side } = tail.at(begin + tau + 1e-15);
                let exact = speed * tau - g * tau * tau / 2.0;
                assert!((x - exact).abs() < 1e-13, "{m} {part}: {x:e} {exact:e}");
                assert!((xdot - (speed - g * tau)).abs() < 1e-12 || part == 0.0);
                assert!(side == sigma || part == 0.0);
            }
            (begin, speed, sigma) = (begin + flight, e * speed, -sigma);
        }
        assert_eq!(tail.at(zeno).xdot, 0.0);
        let impacts: Vec<Impact> = tail.impacts_down_to(1e-3 * first, 100).collect();
        assert_eq!(impacts.len(), 13); // e^13 = 1.3e-3
        assert!(impacts.iter().all(|it| (it.xdot_after + e * it.xdot_before).abs() < 1e-15));
    }

    #[test]
    fn the_arc_at_a_time_is_found_however_far_the_leading_term_is_off() {
        // t_n = 9 - q - 0.3 q^2, q = e^n: the leading term alone is thousands of arcs off
        let e = 0.9999_f64;
        let mut chain = Vec::new();
        for n in 0..5000 {
            let q = e.powi(n);
            chain.push(Bounce { t: 9.0 - q - 0.3 * q * q, u: 5e-4 * q * (1.0 + 0.3 * q), g: 9.81 });
        }
        let tail = Tail::new(&chain, e, 9.0, 1.0);
        for m in [0, 1, 77, 3000, 9999, 40_000] {
            let arc = tail.arc(m).unwrap();
            for part in [0.1, 0.5, 0.9] {
                let t = arc.start + part * (arc.end - arc.start);
                assert_eq!(tail.arc_at(t), Some(arc), "{m} {part}");
                assert!(tail.at(t).x > 0.0);
            }
        }
        assert_eq!(tail.at(9.0 - 1e-13).sigma.abs(), 1.0);
        assert_eq!((tail.arc_at(9.0), tail.arc_at(tail.start() - 1e-3)), (None, None));
    }

    #[test]
    fn the_fit_reproduces_a_series() {
        let a = [1.0, -0.4, 0.2, 0.05];
        let values = std::array::from_fn(|i| series(&a, 0.5f64.powi(-(i as i32))));
        let fitted = fit(0.5, 1, 4, values);
        for k in 0..4 {
            assert!((fitted[k] - a[k]).abs() < 1e-13);
        }
    }
}
