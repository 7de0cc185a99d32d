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
use super::fit::{fit, rounding, series, stride, PARTS, TERMS};
use crate::numeric::bernstein::Bernstein;
use crate::record::point::is_sigma;
use crate::record::user_events::Level;
use crate::{Impact, PathPoint};

/// What rounding may do to positions, relative to the height of the first arc, before terms must
/// show that they are more than that.
const SEEN: f64 = 1e-12;
/// How many times more.
const TOLD: f64 = 4.0;

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
    /// As `end - start`, with the precision of the speeds: near the end of a long tail, and where `e` is
    /// near 1, rounding of the times is much of that difference.
    pub(crate) length: f64,
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
        let h = self.length;
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
    ///
    /// With as many terms as the chain has points for, unless rounding of the times would be seen:
    /// then each term must change the positions, by more than rounding does and by less than the
    /// one before. Under a constant force one is exact.
    pub(super) fn new(bounces: &[Bounce], e: f64, zeno: f64, sigma: f64) -> Self {
        let last = bounces.len() - 1;
        let most = TERMS.min(bounces.len());
        let with = |terms: usize| Self::with_terms(terms, bounces, (e, zeno, sigma));
        let noise = |terms: usize| {
            let arc = (1.0 - e) * (zeno - bounces[last].t);
            rounding(e, stride(e, terms, last), terms) * zeno.abs() / arc
        };
        if noise(most) <= SEEN {
            let found = (2..=most).rev().map(with).find(Self::is_sound);
            return found.unwrap_or_else(|| with(1));
        }
        let (mut tail, mut change) = (with(1), f64::INFINITY);
        for terms in 2..=most {
            let (next, before) = (with(terms), change);
            change = next.distance(&tail);
            if change >= before || change <= TOLD * noise(terms) || !next.is_sound() {
                break;
            }
            tail = next;
        }
        tail
    }

    fn with_terms(terms: usize, bounces: &[Bounce], (e, zeno, sigma): (f64, f64, f64)) -> Self {
        let last = bounces.len() - 1;
        let stride = stride(e, terms, last);
        let points = (0..terms).map(|i| &bounces[last - i * stride]);
        let (mut t, mut u) = ([0.0; TERMS], [0.0; TERMS]);
        for (i, bounce) in points.enumerate() {
            (t[i], u[i]) = (zeno - bounce.t, bounce.u);
        }
        let (c, d) = (fit(e, stride, terms, t), fit(e, stride, terms, u));
        Self { e, start: bounces[last].t, zeno, until: zeno, sigma, c, d }
    }

    /// How far the positions are from those of another tail of the same chain at most, relative to
    /// the height of the first arc: under a constant pull that is `4/h` times the time between
    /// them, an arc that begins at `q u` moves with the part `q` of that.
    fn distance(&self, other: &Self) -> f64 {
        let first = (1.0 - self.e) * (self.zeno - self.start);
        let at = |q: f64| 4.0 * q * (series(&self.c, q) - series(&other.c, q)).abs() / first;
        PARTS.map(at).into_iter().fold(0.0, f64::max)
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

    /// `T(m + 1) - T(m) = sum_k C_k e^(km) (1 - e^k)`, with `1 - e^k = (1 - e) (1 + e + ...)`.
    fn flight(&self, m: f64) -> f64 {
        let (mut falls, mut sum) = (self.c, 0.0);
        for fall in &mut falls {
            sum = 1.0 + self.e * sum;
            *fall *= (1.0 - self.e) * sum;
        }
        series(&falls, libm::pow(self.e, m))
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
        let arc = TailArc { start, end, u: self.speed(n), incoming, sigma, length: self.flight(n) };
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
        assert_eq!((tail.c[1..].to_vec(), tail.d[1..].to_vec()), (vec![0.0; 3], vec![0.0; 3]));
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
    fn the_length_of_an_arc_keeps_its_digits() {
        // t_n = 1 - 0.9 q - 0.1 q^2
        let (e, c) = (0.5_f64, [0.9, 0.1, 0.0, 0.0]);
        let tail = Tail { e, start: 0.0, zeno: 1.0, until: 1.0, sigma: 1.0, c, d: c };
        for m in [0, 1, 20, 50] {
            let (q, arc) = (e.powi(m as i32), tail.arc(m).unwrap());
            let exact = 0.9 * q * 0.5 + 0.1 * q * q * 0.75;
            assert!((arc.length / exact - 1.0).abs() < 1e-15, "{m}");
            assert!((arc.end - arc.start - exact).abs() < 2e-16);
        }
    }
}
