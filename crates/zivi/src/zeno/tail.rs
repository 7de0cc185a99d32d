//! The infinitely many flights that a Zeno extrapolation skips, evaluated when they are requested.
//!
//! With `m` counted from the last impact that was computed,
//!
//! ```text
//! T(m) = t_inf - sum_k C_k e^(km)      U(m) = sum_k D_k e^(km)                        (1)
//! ```
//!
//! are the times of the impacts and the speeds after them; `C` and `D` make (1) exact at impacts
//! of the impact sequence (`m <= 0`). On the flight `[T(m), T(m+1)]` the position is `x = 0` at both ends, where the
//! velocities are `U(m)` and `-U(m+1)/e`, and the accelerations those of the cubic through these but for
//!
//! ```text
//! a(m) = e^m sum_k A_k e^(km)                                                               (2)
//! ```
//!
//! at either end, with `A` from the force at a few of the flights ([`Tail::bend`]), else zero.

use crate::zeno::arc::{Bounce, TailArc};
use crate::{Impact, PathPoint};

/// Rounding of positions relative to the height of the first flight, above which terms must be
/// significant.
const SEEN: f64 = 1e-12;
/// How many times more.
const TOLD: f64 = 4.0;
/// Between flights at which the force is evaluated for equation (2), the speed decreases by this
/// factor (or by `e` for neighbours).
const APART: f64 = 0.6;
/// So many flights.
const ASKED: usize = 2;
/// An acceleration that differs by no more, in roundings of the times of its flight, is the cubic's.
pub(crate) const ROUNDINGS: f64 = 16.0;

/// The flights between the last computed impact and the Zeno point.
#[derive(Clone, Debug, PartialEq)]
pub struct Tail {
    pub(super) e: f64,
    pub(super) start: f64,
    pub(super) zeno: f64,
    /// Up to when the run went: `zeno`, unless an event ended it before.
    pub(super) until: f64,
    pub(super) sigma: f64,
    pub(super) c: [f64; TERMS],
    pub(super) d: [f64; TERMS],
    /// Of equation (2), at the start and at the end of a flight.
    pub(super) bends: [[f64; TERMS]; 2],
}

impl Tail {
    /// The tail of a chain of at least one impact that comes to rest at `zeno`.
    ///
    /// With as many terms as the impact sequence has points for, unless rounding of the times would be seen:
    /// then each term must change the positions, by more than rounding does and by less than the
    /// one before. Under a constant force one is exact.
    pub(super) fn new(bounces: &[Bounce], e: f64, zeno: f64, sigma: f64) -> Self {
        let last = bounces.len() - 1;
        let most = TERMS.min(bounces.len());
        let (mut points, looks) = (KnownPoints::new(e), looks(e));
        let mut with = |terms: usize| {
            let q = points.apart(stride(e, terms, last));
            let arc = (1.0 - e) * (zeno - bounces[last].t);
            let noise = rounding(q, terms) * zeno.abs() / arc;
            (Self::with_terms((terms, q), bounces, (e, zeno, sigma)), noise)
        };
        let (tail, noise) = with(most);
        if noise <= SEEN {
            if most < 2 || tail.is_sound(&looks) {
                return tail;
            }
            let found = (2..most).rev().map(|terms| with(terms).0).find(|it| it.is_sound(&looks));
            return found.unwrap_or_else(|| with(1).0);
        }
        let (mut tail, mut change) = (with(1).0, f64::INFINITY);
        for terms in 2..=most {
            let ((next, noise), before) = (with(terms), change);
            change = next.distance(&tail);
            if change >= before || change <= TOLD * noise || !next.is_sound(&looks) {
                break;
            }
            tail = next;
        }
        tail
    }

    fn with_terms(
        (terms, q): (usize, &Points),
        bounces: &[Bounce],
        (e, zeno, sigma): (f64, f64, f64),
    ) -> Self {
        let last = bounces.len() - 1;
        let stride = stride(e, terms, last);
        let points = (0..terms).map(|i| &bounces[last - i * stride]);
        let (mut t, mut u) = ([0.0; TERMS], [0.0; TERMS]);
        for (i, bounce) in points.enumerate() {
            (t[i], u[i]) = (zeno - bounce.t, bounce.u);
        }
        let (c, d) = (fit(q, terms, t), fit(q, terms, u));
        let bends = [[0.0; TERMS]; 2];
        Self { e, start: bounces[last].t, zeno, until: zeno, sigma, c, d, bends }
    }

    /// Takes the accelerations at both ends of the flights from the force, `force(t, x')` at the wall. Without
    /// them the flights are cubics: exact under a constant force.
    pub(crate) fn bend<E>(
        &mut self,
        mut force: impl FnMut(f64, f64) -> Result<f64, E>,
    ) -> Result<(), E> {
        self.bend_arcs(|_, arc| Ok([force(arc.start, arc.u)?, force(arc.end, arc.incoming)?]))
    }

    /// The same from the accelerations at both ends of a flight of a number.
    pub(crate) fn bend_arcs<E>(
        &mut self,
        mut accelerations: impl FnMut(usize, &TailArc) -> Result<[f64; 2], E>,
    ) -> Result<(), E> {
        let stride = self.stride();
        let Some(terms) = (1..=ASKED).rev().find(|n| self.arc((n - 1) * stride).is_some()) else {
            return Ok(());
        };
        let mut values = [[0.0; TERMS]; 2];
        let mut uniform = true;
        let [starts, ends] = &mut values;
        for (i, (first, last)) in starts.iter_mut().zip(ends).enumerate().take(terms) {
            let number = (terms - 1 - i) * stride;
            let Some(arc) = self.arc(number) else { return Ok(()) };
            let ([a, b], [of_first, of_last]) = (arc.accelerations(), accelerations(number, &arc)?);
            (*first, *last) = (of_first - a, of_last - b);
            if !(arc.allows(*first) && arc.allows(*last)) {
                return Ok(());
            }
            // what rounding of its times makes of the cubic's accelerations
            let times = arc.start.abs().max(arc.end.abs()) / (arc.end - arc.start);
            let rounding = ROUNDINGS * f64::EPSILON * (1.0 + times);
            uniform &= first.abs() <= rounding * a.abs() && last.abs() <= rounding * b.abs();
        }
        if uniform {
            return Ok(());
        }
        let bends = values.map(|values| fit_ahead(self.e, stride, terms, values));
        if bends.iter().flatten().all(|term| term.is_finite()) {
            self.bends = bends;
        }
        Ok(())
    }

    /// Number of flights over which the speed decreases by [`APART`], at least one.
    pub(crate) fn stride(&self) -> usize {
        (libm::log(APART) / libm::log(self.e)).round().max(1.0) as usize
    }

    /// How far the positions are from those of another tail of the same impact sequence at most, relative to
    /// the height of the first flight: for a constant acceleration, `4/h` times the time between
    /// them, a flight that begins at `q u` moves with the part `q` of that.
    fn distance(&self, other: &Self) -> f64 {
        let first = (1.0 - self.e) * (self.zeno - self.start);
        let at = |q: f64| 4.0 * q * (series(&self.c, q) - series(&other.c, q)).abs() / first;
        PARTS.map(at).into_iter().fold(0.0, f64::max)
    }

    /// Whether times rise and speeds fall over the first flights, as they must.
    fn is_sound(&self, looks: &[[f64; 3]; 4]) -> bool {
        looks.iter().all(|&[m, q, next]| {
            let (speed, slower) = (series(&self.d, q), series(&self.d, next));
            self.time_at(m + 1.0, next) > self.time_at(m, q) && speed > slower && slower > 0.0
        })
    }

    /// Equation (1).
    fn time(&self, m: f64) -> f64 {
        self.time_at(m, libm::pow(self.e, m))
    }

    /// The same with `q = e^m`.
    fn time_at(&self, m: f64, q: f64) -> f64 {
        if m == 0.0 {
            self.start
        } else {
            self.zeno - series(&self.c, q)
        }
    }

    /// `T(m + 1) - T(m) = sum_k C_k q^k (1 - e^k)` with `q = e^m`.
    fn flight_at(&self, q: f64) -> f64 {
        series(&self.flight_terms(), q)
    }

    /// The length of the flights as a polynomial in `e^m`, the constant first.
    pub(crate) fn lengths(&self) -> Vec<f64> {
        [0.0].into_iter().chain(self.flight_terms()).collect()
    }

    /// The sum of a polynomial in `e^m`, the constant first, which is zero, over the flights from `m` on, as another one.
    pub(crate) fn sum_of_arcs_from(&self, of: &[f64]) -> Vec<f64> {
        let log = libm::log(self.e);
        let whole = |k: usize| -libm::expm1(k as f64 * log);
        of.iter().enumerate().map(|(k, a)| if k > 0 { a / whole(k) } else { 0.0 }).collect()
    }

    /// `C_k (1 - e^k)`, with `1 - e^k = (1 - e) (1 + e + ...)`.
    fn flight_terms(&self) -> [f64; TERMS] {
        let (mut falls, mut sum) = (self.c, 0.0);
        for fall in &mut falls {
            sum = 1.0 + self.e * sum;
            *fall *= (1.0 - self.e) * sum;
        }
        falls
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
        let ahead = move |it: &Impact| it.xdot_after >= speed && self.passed(it);
        (1..=at_most).map(|m| self.impact(m)).take_while(ahead)
    }

    /// How many impacts after [`Tail::start`] have at least the speed before them (m/s), and the
    /// time of the last of these (s).
    #[must_use]
    pub fn count_down_to(&self, speed: f64) -> (usize, f64) {
        let is_listed = |m: usize| {
            let it = self.impact(m + 1);
            -it.xdot_before >= speed && self.passed(&it)
        };
        let count = self.first_not(speed * self.e / self.d[0], is_listed);
        (count, self.time(count as f64))
    }

    /// When its impact `m = 1, 2, ...` is (s).
    pub(crate) fn time_of(&self, m: usize) -> f64 {
        self.time(m as f64)
    }

    /// The speed after its impact `m = 1, 2, ...` (m/s).
    pub(crate) fn speed_of(&self, m: usize) -> f64 {
        self.speed(m as f64)
    }

    fn impact(&self, m: usize) -> Impact {
        let m = m as f64;
        let u = self.speed(m);
        Impact { t: self.time(m), xdot_before: -u / self.e, xdot_after: u }
    }

    /// Whether the run reached this impact, which is distinguishable from the Zeno point.
    fn passed(&self, it: &Impact) -> bool {
        it.t <= self.until && it.t < self.zeno
    }

    /// The flight `m = 0, 1, ...`, unless it is too short to be resolved.
    pub(crate) fn arc(&self, m: usize) -> Option<TailArc> {
        let n = m as f64;
        let [q, next] = [n, n + 1.0].map(|m| libm::pow(self.e, m));
        let (start, end) = (self.time_at(n, q), self.time_at(n + 1.0, next).min(self.zeno));
        let sigma = if m.is_multiple_of(2) { self.sigma } else { -self.sigma };
        let incoming = -series(&self.d, next) / self.e;
        let (u, length) = (series(&self.d, q), self.flight_at(q));
        let bends = self.bends.map(|terms| q * series(&terms, q));
        let arc = TailArc { start, end, u, incoming, sigma, length, bends };
        (end > start && arc.u > 0.0 && incoming < 0.0).then_some(arc)
    }

    /// The flight that contains `t`, if it can be resolved.
    pub(crate) fn arc_at(&self, t: f64) -> Option<TailArc> {
        self.numbered_arc_at(t).map(|(_, arc)| arc)
    }

    /// The same, and its number.
    pub(crate) fn numbered_arc_at(&self, t: f64) -> Option<(usize, TailArc)> {
        let (left, whole) = (self.zeno - t, self.zeno - self.start);
        if !(left > 0.0 && left <= whole) {
            return None;
        }
        let is_over = |m: usize| self.arc(m).is_some_and(|arc| arc.end <= t);
        let m = self.first_not(left / whole, is_over);
        self.arc(m).map(|arc| (m, arc))
    }

    /// `e^m`.
    pub(crate) fn power(&self, m: usize) -> f64 {
        libm::pow(self.e, m as f64)
    }

    /// The sum over the flights before `m` (all for `None`) of a polynomial in `e^i` times a power
    /// of the length of the flight `i`.
    pub(crate) fn sum_over_arcs(&self, of: &[f64], power: usize, m: Option<usize>) -> f64 {
        let lengths = self.flight_terms();
        let mut product = of.to_vec();
        for _ in 0..power {
            let mut next = vec![0.0; product.len() + TERMS];
            for (i, a) in product.iter().enumerate() {
                lengths.iter().enumerate().for_each(|(k, c)| next[i + k + 1] += a * c);
            }
            product = next;
        }
        // sum_i e^(ik) = (1 - e^(mk))/(1 - e^k)
        let log = libm::log(self.e);
        let up_to = |k: f64| m.map_or(1.0, |m| -libm::expm1(m as f64 * k * log));
        let geometric = |k: usize| up_to(k as f64) / -libm::expm1(k as f64 * log);
        product.iter().enumerate().skip(1).rev().map(|(k, a)| a * geometric(k)).sum()
    }

    /// The first `m` that is not over, of an order; the leading term of (1) gives it up to a few,
    /// as `e^m = part`: from there a bracket, and its halves.
    fn first_not(&self, part: f64, is_over: impl Fn(usize) -> bool) -> usize {
        let guess = (libm::log(part) / libm::log(self.e)).floor().clamp(0.0, 1e9) as usize;
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
        first
    }

    /// The state at `t`, within the tail.
    #[must_use]
    pub fn at(&self, t: f64) -> PathPoint {
        let rest = PathPoint { x: 0.0, xdot: 0.0, sigma: self.sigma };
        self.arc_at(t).map_or(rest, |arc| arc.at(t))
    }
}

/// The flights at which a tail has to be sound: `m`, `e^m`, `e^(m + 1)`.
fn looks(e: f64) -> [[f64; 3]; 4] {
    let arcs = 2 + (1.0 / (1.0 - e)) as i32;
    std::array::from_fn(|i| {
        let m = f64::from(i as i32 * arcs / 4);
        [m, libm::pow(e, m), libm::pow(e, m + 1.0)]
    })
}

// Series in powers of the ratio `e` through impacts of an impact sequence.

/// Most terms of a series.
///
/// With `e` of 0.99 to 0.999 4 leave errors of positions of 100 times `rtol` of the first apex, 5 of one.
pub(super) const TERMS: usize = 6;
/// Parts of the tail at which tails are compared.
pub(super) const PARTS: [f64; 4] = [0.25, 0.5, 0.7, 0.9];

/// Distance in impacts between points of the fit over which the speed decreases by a tenth:
/// neighbours are nearly identical when `e` is near 1, and distant points carry little information
/// about the tail.
pub(super) fn stride(e: f64, terms: usize, last: usize) -> usize {
    if terms < 2 {
        return 1;
    }
    let tenth = (libm::log(0.9) / libm::log(e)).round().max(1.0) as usize;
    tenth.min(last / (terms - 1)).max(1)
}

/// Effect of rounding of all times by one unit in the last place of 1 on the positions, in the
/// units of [`Tail::distance`] with a first flight of length 1: `4 q sum_i |l_i(q)|` with the
/// polynomials `l_i` of Lagrange at the points of [`fit`] and zero.
pub(super) fn rounding(q: &Points, terms: usize) -> f64 {
    let mut weights = [0.0; TERMS];
    for (i, weight) in weights.iter_mut().enumerate().take(terms) {
        let others = (0..terms).filter(|&j| j != i);
        *weight = 1.0 / others.fold(q[i], |product, j| product * (q[i] - q[j]));
    }
    let largest = PARTS.map(|at| {
        let of = |i: usize| {
            let others = (0..terms).filter(|&j| j != i);
            others.fold(at * weights[i], |l, j| l * (at - q[j])).abs()
        };
        4.0 * at * (0..terms).map(of).sum::<f64>()
    });
    f64::EPSILON * largest.into_iter().fold(0.0, f64::max)
}

/// `q_i = e^(-i stride)`.
pub(super) type Points = [f64; TERMS];

/// These, worked out once for each stride that follows another one.
pub(super) struct KnownPoints {
    e: f64,
    stride: usize,
    q: Points,
}

impl KnownPoints {
    /// Of a ratio.
    pub(super) fn new(e: f64) -> Self {
        Self { e, stride: 0, q: [1.0; TERMS] }
    }

    /// With this number of impacts between neighbours.
    pub(super) fn apart(&mut self, stride: usize) -> &Points {
        if stride != self.stride {
            (self.stride, self.q) = (stride, points(self.e, stride));
        }
        &self.q
    }
}

fn points(e: f64, stride: usize) -> Points {
    std::array::from_fn(|i| if i > 0 { libm::pow(e, -((i * stride) as f64)) } else { 1.0 })
}

/// `sum_k a_k q^k`, `k = 1, 2, ...`
pub(super) fn series(a: &[f64; TERMS], q: f64) -> f64 {
    a.iter().rev().fold(0.0, |sum, a| (sum + a) * q)
}

/// The `a` with `sum_k a_k q_i^k = values_i` at `terms` points, by Newton's interpolation of
/// `values/q`.
pub(super) fn fit(q: &Points, terms: usize, values: [f64; TERMS]) -> [f64; TERMS] {
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

/// The `a` with `q_i sum_k a_k q_i^k = values_i` at the `q_i = e^m` of the flights `m = (terms - 1 - i) stride`
/// after the impact sequence, the last of them first.
pub(super) fn fit_ahead(
    e: f64,
    stride: usize,
    terms: usize,
    mut values: [f64; TERMS],
) -> [f64; TERMS] {
    // in units of the first of these q
    let q = points(e, stride);
    for (value, q) in values.iter_mut().zip(q) {
        *value /= q;
    }
    let unit = libm::pow(e, ((terms - 1) * stride) as f64);
    let (mut a, mut power) = (fit(&q, terms, values), unit);
    for a in &mut a {
        power *= unit;
        *a /= power;
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
        // t_n = 9 - q - 0.3 q^2, q = e^n: the leading term alone is thousands of flights off
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
    fn a_term_that_rounding_made_is_left_out_and_one_that_tells_is_kept() {
        // under a constant pull, from 3 impacts that fell by 1e-4 each
        let (e, g): (f64, f64) = (0.9999, 9.81);
        let (mut chain, mut t, mut u) = (Vec::new(), 0.1, 3.0);
        for _ in 0..3 {
            chain.push(Bounce { t, u, g });
            (t, u) = (t + 2.0 * u / g, e * u);
        }
        let last = chain[2];
        let zeno = last.t + 2.0 * last.u / (g * (1.0 - e));
        let tail = Tail::new(&chain, e, zeno, 1.0);
        assert_eq!(
            (tail.c[1..].to_vec(), tail.d[1..].to_vec()),
            (vec![0.0; TERMS - 1], vec![0.0; TERMS - 1])
        );
        // t_n = 8000 - 8000 q - 5 q^2 + q^3 over 5000 impacts: both further terms are seen
        let mut chain = Vec::new();
        for n in 0..5000 {
            let q = e.powi(n);
            let t = 8000.0 * (1.0 - q) - 5.0 * q * q + q.powi(3);
            chain.push(Bounce { t, u: 4.0 * q * (1.0 + 1e-3 * q), g });
        }
        let tail = Tail::new(&chain, e, 8000.0, 1.0);
        for m in [1, 5000, 20_000] {
            let q = e.powi(4999 + m);
            let exact = 8000.0 * (1.0 - q) - 5.0 * q * q + q.powi(3);
            assert!((tail.time(f64::from(m)) - exact).abs() < 1e-9, "{m}");
            assert!((tail.speed(f64::from(m)) - 4.0 * q * (1.0 + 1e-3 * q)).abs() < 1e-12, "{m}");
        }
    }

    #[test]
    fn arcs_bend_with_a_smooth_force_only() {
        // x'' = -2 and at the ends of flights a little more and less, which falls with q^2
        let bounce = |q: f64| Bounce { t: 2.0 - 2.0 * q, u: q, g: 2.0 };
        let chain: Vec<Bounce> = (0..8).map(|n| bounce(0.5_f64.powi(n))).collect();
        let cubic = Tail::new(&chain, 0.5, 2.0, 1.0);
        let part = |m: usize| (0.5_f64.powi(m as i32)).powi(2) * 0.3;
        let bend = |least: f64| {
            let mut tail = cubic.clone();
            let starts: Vec<f64> = (0..5).map(|m| cubic.time(f64::from(m))).collect();
            let force = |t: f64, v: f64| -> Result<f64, ()> {
                let m = starts.iter().rposition(|&start| start <= t).unwrap_or(0);
                let m = if v > 0.0 { m } else { m - 1 };
                Ok(-2.0 + least * part(m) * v.signum())
            };
            assert_eq!(tail.bend(force), Ok(()));
            tail
        };
        let tail = bend(1.0);
        for m in 0..8 {
            let [a, b] = tail.arc(m).unwrap().bends;
            assert!((a - part(m)).abs() < 1e-12 && (b + part(m)).abs() < 1e-12, "{m}: {a} {b}");
        }
        // what moves flights by as much as they are high is none of their motion
        assert_eq!(bend(10.0), cubic);
        assert_eq!(bend(f64::NAN), cubic);
    }

    #[test]
    fn arcs_do_not_bend_with_the_rounding_of_their_times() {
        // x'' = -2 and a part of it more, from the time `start` on
        let bends = |start: f64, more: f64| {
            let bounce = |q: f64| Bounce { t: start + 2.0 - 2.0 * q, u: q, g: 2.0 };
            let chain: Vec<Bounce> = (0..8).map(|n| bounce(0.5_f64.powi(n))).collect();
            let mut tail = Tail::new(&chain, 0.5, start + 2.0, 1.0);
            assert_eq!(tail.bend(|_, _| Ok::<f64, ()>(-2.0 * (1.0 + more))), Ok(()));
            tail.bends != [[0.0; TERMS]; 2]
        };
        assert!(!bends(1e6, 0.0) && bends(1e6, 1e-6));
        // the first flight lasts from 0 to 2^-7: 16 roundings of its acceleration, and of its end
        let zeno = 2.0_f64.powi(-6);
        assert!(!bends(zeno - 2.0, 24.0 * f64::EPSILON));
        assert!(bends(zeno - 2.0, 40.0 * f64::EPSILON));
    }

    #[test]
    fn a_tail_of_one_arc_bends_with_that() {
        // x'' = -2, and what comes after a flight of 1e-4 s is far below rounding of its time
        let (e, left, zeno) = (1e-12, 1e-4, 100.0);
        let chain = [Bounce { t: zeno - left, u: left * (1.0 - e), g: 2.0 }];
        let mut tail = Tail::new(&chain, e, zeno, 1.0);
        assert!(tail.arc(0).is_some() && tail.arc(1).is_none());
        assert_eq!(tail.bend(|_, v| Ok::<f64, ()>(-2.0 + 0.1 * v.signum())), Ok(()));
        let [first, last] = tail.arc(0).unwrap().bends;
        assert!((first - 0.1).abs() < 1e-6 && (last + 0.1).abs() < 1e-6, "{first} {last}");
    }

    #[test]
    fn the_first_arc_that_is_not_over_is_found_in_few_looks() {
        // from the 6,900,000th on down, from the first on up, and where the guess is right
        let e = 0.9999;
        let tail = Tail::new(&[Bounce { t: 0.0, u: 1e-4, g: 2.0 }], e, 1.0, 1.0);
        for (part, exact) in [(1e-300, 1), (1.0, 1_000_003), (1e-3, 69_074)] {
            let looks = std::cell::Cell::new(0);
            let is_over = |m: usize| {
                looks.set(looks.get() + 1);
                m < exact
            };
            assert_eq!(tail.first_not(part, is_over), exact);
            // up by doubled steps, then by halves
            assert!(looks.get() < 64, "{exact}: {}", looks.get());
        }
    }

    #[test]
    fn the_length_of_an_arc_keeps_its_digits() {
        // t_n = 1 - 0.9 q - 0.1 q^2
        let (e, c) = (0.5_f64, [0.9, 0.1, 0.0, 0.0, 0.0, 0.0]);
        let tail = Tail {
            e,
            start: 0.0,
            zeno: 1.0,
            until: 1.0,
            sigma: 1.0,
            c,
            d: c,
            bends: [[0.0; TERMS]; 2],
        };
        for m in [0, 1, 20, 50] {
            let (q, arc) = (e.powi(m as i32), tail.arc(m).unwrap());
            let exact = 0.9 * q * 0.5 + 0.1 * q * q * 0.75;
            assert!((arc.length / exact - 1.0).abs() < 1e-15, "{m}");
            assert!((arc.end - arc.start - exact).abs() < 2e-16);
        }
    }
}

#[cfg(test)]
mod fit_tests {
    use super::*;

    #[test]
    fn the_fit_reproduces_a_series() {
        let a = [1.0, -0.4, 0.2, 0.05, 0.0, 0.0];
        let values = std::array::from_fn(|i| series(&a, 0.5f64.powi(-(i as i32))));
        let fitted = fit(&points(0.5, 1), 4, values);
        for k in 0..TERMS {
            assert!((fitted[k] - a[k]).abs() < 1e-13);
        }
    }

    #[test]
    fn points_span_the_chain_up_to_a_tenth_of_the_speed_each() {
        // the last of four, three strides back, is the first of ten impacts
        assert_eq!([9, 11, 12].map(|last| stride(0.9999, 4, last)), [3, 3, 4]);
        assert_eq!(stride(0.9999, 4, 1_000_000), 1054);
        assert_eq!([stride(0.9, 4, 100), stride(0.99, 4, 2), stride(0.9999, 1, 100)], [1; 3]);
    }

    #[test]
    fn a_series_in_the_arcs_ahead_is_reproduced() {
        let a = [0.3, 1.0, -0.4, 0.2, 0.0, 0.0];
        for (e, stride) in [(0.1_f64, 1), (0.5, 1), (0.9, 5), (0.9999, 5000)] {
            let q = |m: usize| e.powi(m as i32);
            let mut values = [0.0; TERMS];
            for (i, value) in values.iter_mut().enumerate().take(4) {
                let q = q((3 - i) * stride);
                *value = q * series(&a, q);
            }
            let fitted = fit_ahead(e, stride, 4, values);
            for m in [0, 1, stride, 2 * stride, 7 * stride] {
                let (q, part) = (q(m), q(m) * series(&fitted, q(m)));
                assert!((part - q * series(&a, q)).abs() < 1e-13 * q, "{e} {m}");
            }
        }
    }

    #[test]
    fn rounding_grows_by_the_polynomials_of_lagrange() {
        // in the points 1 and 1/e the values 1 and -1 make a line; with q = 1 - x, 1/e = 1 + d
        let e = 1.0 / 1.01;
        let line = |q: f64| q * ((1.01 - q) / 0.01 + (1.0 - q) / (1.01 * 0.01));
        let largest = PARTS.map(|q| 4.0 * q * line(q)).into_iter().fold(0.0, f64::max);
        let found = rounding(&points(e, 1), 2) / f64::EPSILON;
        assert!((found / largest - 1.0).abs() < 1e-12, "{found} {largest}");
        assert_eq!(rounding(&points(e, 1), 1), 4.0 * 0.9 * 0.9 * f64::EPSILON);
        // far less where the points are apart
        assert!(rounding(&points(0.5, 1), 4) < 40.0 * f64::EPSILON);
        assert!(rounding(&points(0.9999, 1), 3) > 1e7 * f64::EPSILON);
    }
}
