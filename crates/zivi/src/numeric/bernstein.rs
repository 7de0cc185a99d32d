//! Polynomials on `[0, 1]` in Bernstein form, and their first sign change.
//!
//! ```text
//! p(theta) = sum_j c_j binom(n, j) theta^j (1 - theta)^(n-j)
//! ```
//!
//! The coefficients enclose the values (`min c <= p <= max c`) and the number of their changes of
//! sign bounds the number of roots: both certify that a step has no root, which the values at its
//! ends cannot.

use std::convert::Infallible;

use super::power_series::TERMS;
use super::root;

/// Largest degree.
pub(crate) const MOST_DEGREE: usize = 7;

/// A polynomial with at most `M` coefficients.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Polynomial<const M: usize> {
    n: usize,
    c: [f64; M],
}

/// A polynomial of degree up to [`MOST_DEGREE`].
pub(crate) type Bernstein = Polynomial<{ MOST_DEGREE + 1 }>;

/// Halvings of `[0, 1]`: two roots that rounding does not separate count as none.
const DEPTH: u32 = 32;

impl Bernstein {
    /// `a_0 + a_1 theta + ... + a_4 theta^4`.
    pub(crate) fn from_quartic(a: [f64; 5]) -> Self {
        // c_j = sum_i binom(j, i)/binom(4, i) a_i
        let [a0, a1, a2, a3, a4] = a;
        Self::new(&[
            a0,
            a0 + a1 / 4.0,
            a0 + a1 / 2.0 + a2 / 6.0,
            a0 + 0.75 * a1 + a2 / 2.0 + a3 / 4.0,
            a0 + a1 + a2 + a3 + a4,
        ])
    }

    /// `y + theta (f_0 + (1 - theta) (f_1 + theta (f_2 + (1 - theta) (f_3 + ...))))`.
    pub(crate) fn from_nested(y: f64, [f0, f1, f2, f3, f4, f5, f6]: [f64; 7]) -> Self {
        let mut c = [0.0; MOST_DEGREE + 1];
        c[0] = f6;
        times_theta_plus::<1>(&mut c, f5);
        times_one_minus_theta_plus::<2>(&mut c, f4);
        times_theta_plus::<3>(&mut c, f3);
        times_one_minus_theta_plus::<4>(&mut c, f2);
        times_theta_plus::<5>(&mut c, f1);
        times_one_minus_theta_plus::<6>(&mut c, f0);
        times_theta_plus::<7>(&mut c, y);
        Self { n: MOST_DEGREE, c }
    }
}

/// `theta p + constant`, of degree `N`.
#[inline(always)]
fn times_theta_plus<const N: usize>(c: &mut [f64; MOST_DEGREE + 1], constant: f64) {
    for j in (1..=N).rev() {
        c[j] = j as f64 / N as f64 * c[j - 1] + constant;
    }
    c[0] = 0.0 + constant;
}

/// `(1 - theta) p + constant`, of degree `N`.
#[inline(always)]
fn times_one_minus_theta_plus<const N: usize>(c: &mut [f64; MOST_DEGREE + 1], constant: f64) {
    for (j, c) in c.iter_mut().enumerate().take(N) {
        *c = (N - j) as f64 / N as f64 * *c + constant;
    }
    c[N] = 0.0 + constant;
}

impl<const M: usize> Polynomial<M> {
    /// `1/binom(M - 1, i)`.
    const WEIGHTS: [f64; M] = {
        let (mut weights, mut binomial, mut i) = ([1.0; M], 1.0, 0);
        while i < M {
            weights[i] = 1.0 / binomial;
            binomial = binomial * (M - 1 - i) as f64 / (i + 1) as f64;
            i += 1;
        }
        weights
    };

    pub(crate) fn new(coefficients: &[f64]) -> Self {
        let mut c = [0.0; M];
        c[..coefficients.len()].copy_from_slice(coefficients);
        Self { n: coefficients.len() - 1, c }
    }

    /// The cubic with values and derivatives (by `theta`) `(x0, d0)` and `(x1, d1)` at the ends.
    pub(crate) fn hermite((x0, d0): (f64, f64), (x1, d1): (f64, f64)) -> Self {
        Self::new(&[x0, x0 + d0 / 3.0, x1 - d1 / 3.0, x1])
    }

    fn times_theta(self) -> Self {
        let n = self.n + 1;
        let mut c = [0.0; M];
        for (j, c) in c.iter_mut().enumerate().take(n + 1).skip(1) {
            *c = j as f64 / n as f64 * self.c[j - 1];
        }
        Self { n, c }
    }

    fn times_one_minus_theta(self) -> Self {
        let n = self.n + 1;
        let mut c = [0.0; M];
        for (j, c) in c.iter_mut().enumerate().take(n) {
            *c = (n - j) as f64 / n as f64 * self.c[j];
        }
        Self { n, c }
    }

    /// `(theta - root) p(theta)`, of a degree below [`MOST_DEGREE`].
    pub(crate) fn times_root(self, root: f64) -> Self {
        let (mut product, down) = (self.times_theta(), self.times_one_minus_theta());
        for (c, down) in product.c.iter_mut().zip(down.c) {
            *c = (1.0 - root) * *c - root * down;
        }
        product
    }

    /// `p(theta) + constant`.
    pub(crate) fn plus(mut self, constant: f64) -> Self {
        self.add(constant);
        self
    }

    pub(crate) fn add(&mut self, constant: f64) {
        self.c[..=self.n].iter_mut().for_each(|c| *c += constant);
    }

    /// `a_0 + a_1 theta + ...` with `M` coefficients.
    #[inline(always)]
    pub(crate) fn from_powers(a: [f64; M]) -> Self {
        const { assert!(M.is_multiple_of(4)) }
        // c_j = sum_i binom(j, i)/binom(M - 1, i) a_i, by repeated sums
        let mut c = a;
        for (c, weight) in c.iter_mut().zip(Self::WEIGHTS) {
            *c *= weight;
        }
        // four sums at once: the last of each is all that the next coefficient needs of them
        for k in (0..M).step_by(4) {
            let (first, rest) = c[k..].split_at_mut(4);
            let once = [first[0] + first[1], first[1] + first[2], first[2] + first[3]];
            let twice = [once[0] + once[1], once[1] + once[2]];
            let thrice = twice[0] + twice[1];
            let mut last = [first[3], once[2], twice[1], thrice];
            [first[1], first[2], first[3]] = [once[0], twice[0], thrice];
            for c in rest {
                for last in &mut last {
                    (*last, *c) = (*c, *last + *c);
                }
            }
        }
        Self { n: M - 1, c }
    }

    /// The coefficients.
    pub(crate) fn coefficients(&self) -> &[f64] {
        &self.c[..=self.n]
    }

    /// The size of the term of the highest power, `a_n theta^ceil(n/2) (1 - theta)^floor(n/2)` of
    /// the nested form, at most `2^-n |a_n|`: a smooth function is nearer to its polynomial.
    pub(crate) fn last_term(&self) -> f64 {
        let mut d = self.c;
        for n in (1..=self.n).rev() {
            for j in 0..n {
                d[j] = 0.5 * (d[j + 1] - d[j]);
            }
        }
        d[0].abs()
    }

    /// The value at `theta`, by de Casteljau's scheme.
    pub(crate) fn at(&self, theta: f64) -> f64 {
        value::<M>(self.coefficients(), theta)
    }

    /// The integral from 0 to `theta`: that of a Bernstein form is the mean of its coefficients.
    pub(crate) fn integral(&self, theta: f64) -> f64 {
        let (part, _) = self.split(theta);
        theta * part.coefficients().iter().sum::<f64>() / (self.n + 1) as f64
    }

    /// The values at several places together, with the bits of [`Polynomial::at`] at each.
    #[inline(always)]
    pub(crate) fn values<const L: usize>(&self, theta: &[f64; L]) -> [f64; L] {
        if self.n > MOST_DEGREE {
            return theta.map(|theta| self.at(theta));
        }
        let mut c = [[0.0; L]; MOST_DEGREE + 1];
        for (c, &own) in c.iter_mut().zip(self.coefficients()) {
            *c = [own; L];
        }
        for level in 1..=self.n {
            for j in 0..=self.n - level {
                for l in 0..L {
                    c[j][l] += theta[l] * (c[j + 1][l] - c[j][l]);
                }
            }
        }
        c[0]
    }

    /// The derivative at `theta`.
    pub(crate) fn slope(&self, theta: f64) -> f64 {
        let mut d = [0.0; M];
        for (d, pair) in d.iter_mut().zip(self.coefficients().windows(2)) {
            *d = self.n as f64 * (pair[1] - pair[0]);
        }
        value::<M>(&d[..self.n.max(1)], theta)
    }

    /// The derivative, as a polynomial of the same degree.
    #[inline(always)]
    pub(crate) fn derivative(&self) -> Self {
        // n (c_(j+1) - c_j), of a degree less, raised by one
        let (mut d, mut before, mut after) = ([0.0; M], 0.0, self.n as f64);
        for j in 0..self.n.min(M - 1) {
            let difference = self.c[j + 1] - self.c[j];
            d[j] += after * difference;
            (before, after) = (before + 1.0, after - 1.0);
            d[j + 1] = before * difference;
        }
        Self { n: self.n, c: d }
    }

    /// The same times a number.
    #[inline(always)]
    pub(crate) fn times(mut self, factor: f64) -> Self {
        self.c.iter_mut().for_each(|c| *c *= factor);
        self
    }

    /// The sum with one of the same degree.
    pub(crate) fn sum(mut self, other: &Self) -> Self {
        self.c.iter_mut().zip(&other.c).for_each(|(c, more)| *c += more);
        self
    }

    /// `p(theta)/theta` for a polynomial with `p(0) = 0`.
    pub(crate) fn without_root_at_zero(&self) -> Self {
        let n = self.n;
        let mut c = [0.0; M];
        for (j, c) in c.iter_mut().enumerate().take(n) {
            *c = n as f64 / (j + 1) as f64 * self.c[j + 1];
        }
        Self { n: n - 1, c }
    }

    /// The parts over `[0, at]` and `[at, 1]`, each mapped to `[0, 1]`.
    pub(crate) fn split(&self, at: f64) -> (Self, Self) {
        let n = self.n;
        let (mut left, mut right) = (*self, *self);
        for level in 1..=n {
            for j in 0..=n - level {
                right.c[j] += at * (right.c[j + 1] - right.c[j]);
            }
            left.c[level] = right.c[0];
        }
        (left, right)
    }

    /// With the value at zero set.
    pub(crate) fn starting_at(mut self, first: f64) -> Self {
        self.c[0] = first;
        self
    }

    /// With the values at the ends set.
    pub(crate) fn with_ends(mut self, first: f64, last: f64) -> Self {
        (self.c[0], self.c[self.n]) = (first, last);
        self
    }

    /// The same with its sign changed.
    pub(crate) fn negated(mut self) -> Self {
        self.c.iter_mut().for_each(|c| *c = -*c);
        self
    }

    /// Changes of sign among the coefficients that are not zero.
    fn sign_changes(&self) -> usize {
        let signs = self.coefficients().iter().filter(|&&c| c != 0.0).map(|&c| c > 0.0);
        signs.clone().zip(signs.skip(1)).filter(|(a, b)| a != b).count()
    }

    /// The sign just after `theta = 0`: that of the first coefficient that is not zero.
    pub(crate) fn starts_negative(&self) -> bool {
        self.coefficients().iter().find(|&&c| c != 0.0).is_some_and(|&c| c < 0.0)
    }

    /// The first point of `[0, 1]` after which the polynomial is negative.
    ///
    /// A touch without a change of sign is none, nor are two roots closer than `2^-32`.
    pub(crate) fn first_negative(&self) -> Option<f64> {
        self.search(0.0, 1.0, DEPTH)
    }

    /// The points of `(0, 1)` at which the polynomial less `level` reaches zero to change its sign
    /// there, ascending: none is missed (see [`Polynomial::first_negative`]).
    pub(crate) fn crossings(mut self, level: f64) -> Vec<f64> {
        self.add(-level);
        let (mut p, mut start, mut all) = (self, 0.0, Vec::new());
        while p.n > 0 {
            if p.c[0] == 0.0 {
                // divided out, it is not found again
                p = p.without_root_at_zero();
                continue;
            }
            let above = if p.starts_negative() { p.negated() } else { p };
            let Some(theta) = above.first_negative() else { break };
            start += theta * (1.0 - start);
            all.push(start);
            if above.sign_changes() == 1 {
                break;
            }
            p = above.split(theta).1;
            p.c[0] = 0.0;
        }
        all
    }

    /// The same for the part over `[start, start + width]` of the whole.
    fn search(&self, start: f64, width: f64, depth: u32) -> Option<f64> {
        if self.starts_negative() {
            return Some(start);
        }
        match self.sign_changes() {
            0 => None,
            1 => Some(start + width * self.only_root()),
            _ if depth == 0 => None,
            _ => {
                let (left, right) = self.split(0.5);
                left.search(start, 0.5 * width, depth - 1)
                    .or_else(|| right.search(start + 0.5 * width, 0.5 * width, depth - 1))
            }
        }
    }

    /// The root of a polynomial that changes from positive to negative once.
    fn only_root(&self) -> f64 {
        // a zero at the start is left upwards
        let (start, end) = (self.c[0].max(f64::MIN_POSITIVE), self.c[self.n]);
        if end == 0.0 {
            return 1.0;
        }
        let value = |theta| Ok::<f64, Infallible>(self.at(theta));
        let Ok(root) = root::between((0.0, start), (1.0, end), value);
        root.best
    }
}

/// The Bernstein coefficients with value, slope and second derivative at both ends of a length.
pub(crate) fn quintic([x0, v0, a0]: [f64; 3], [x1, v1, a1]: [f64; 3], h: f64) -> [f64; 6] {
    let (v0, v1, a0, a1) = (h * v0 / 5.0, h * v1 / 5.0, h * h * a0 / 20.0, h * h * a1 / 20.0);
    let (c1, c4) = (x0 + v0, x1 - v1);
    [x0, c1, c1 + v0 + a0, c4 - v1 + a1, c4, x1]
}

/// The value at `theta` of the polynomial with these coefficients (at most [`MOST_DEGREE`]` + 1`).
pub(crate) fn evaluate(coefficients: &[f64], theta: f64) -> f64 {
    value::<{ MOST_DEGREE + 1 }>(coefficients, theta)
}

fn value<const M: usize>(coefficients: &[f64], theta: f64) -> f64 {
    const ALL: usize = MOST_DEGREE + 1;
    let n = coefficients.len();
    if n > ALL {
        return nested(coefficients, theta);
    }
    if let Ok(mut c) = <[f64; ALL]>::try_from(coefficients) {
        // most are of this degree
        for level in 1..ALL {
            for j in 0..ALL - level {
                c[j] += theta * (c[j + 1] - c[j]);
            }
        }
        return c[0];
    }
    let mut c = [0.0; M];
    c[..n].copy_from_slice(coefficients);
    for level in 1..n {
        for j in 0..n - level {
            c[j] += theta * (c[j + 1] - c[j]);
        }
    }
    c[0]
}

/// `(n - j)/(j + 1)`, by `n` and `j`.
const RATIOS: [[f64; TERMS]; TERMS] = {
    let (mut ratios, mut n) = ([[0.0; TERMS]; TERMS], 0);
    while n < TERMS {
        let mut j = 0;
        while j < n {
            ratios[n][j] = (n - j) as f64 / (j + 1) as f64;
            j += 1;
        }
        n += 1;
    }
    ratios
};

/// A cheaper alternative to de Casteljau's scheme, with `u = theta/(1 - theta)` in the first half
/// (in the second, from the other end),
///
/// ```text
/// p = (1 - theta)^n (c_0 + u n/1 (c_1 + u (n - 1)/2 (c_2 + ... + u/n c_n))).
/// ```
fn nested(coefficients: &[f64], theta: f64) -> f64 {
    let (n, rest) = (coefficients.len() - 1, 1.0 - theta);
    let ratios = &RATIOS[n][..n];
    if theta <= 0.5 {
        let (u, inner) = (theta / rest, coefficients[..n].iter().zip(ratios).rev());
        let sum = inner.fold(coefficients[n], |sum, (c, ratio)| sum * (u * ratio) + c);
        rest.powi(n as i32) * sum
    } else {
        let (u, inner) = (rest / theta, coefficients[1..].iter().zip(ratios.iter().rev()));
        let sum = inner.fold(coefficients[0], |sum, (c, ratio)| sum * (u * ratio) + c);
        theta.powi(n as i32) * sum
    }
}

#[cfg(test)]
mod tests;
