//! Power series, and what a step under a linear force starts from.

pub(crate) use crate::numeric::power_series::{Series, TERMS};

/// Most waves of a force.
pub(crate) const WAVES: usize = 2;

/// What a table is for: stiffness, damping and the angular frequencies of the waves, 0 where there
/// is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Law {
    pub(crate) stiffness: f64,
    pub(crate) damping: f64,
    pub(crate) omega: [f64; WAVES],
}

/// Where a step starts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Start {
    /// Position (m).
    pub(crate) x: f64,
    /// Velocity times the length of a step (m).
    pub(crate) v: f64,
    /// Constant force (m/s^2).
    pub(crate) force: f64,
    /// Waves: real and imaginary parts (m/s^2).
    pub(crate) waves: [[f64; 2]; WAVES],
}

/// The sum of `of(n, a_n)`, the smallest first.
pub(super) fn sum_by(a: &Series, of: impl Fn(f64, f64) -> f64) -> f64 {
    a.iter().enumerate().rev().map(|(n, &a)| of(n as f64, a)).sum()
}

/// Equation (2).
pub(crate) fn column(k: f64, c: f64, x: f64, v: f64, d: &Series) -> Series {
    let mut a = [0.0; TERMS];
    (a[0], a[1]) = (x, v);
    for n in 0..TERMS - 2 {
        let (one, two) = (n as f64 + 1.0, n as f64 + 2.0);
        a[n + 2] = (d[n] - k * a[n] - c * one * a[n + 1]) / (one * two);
    }
    a
}

/// `h^2 Re z e^(i W s)` by powers of `s` for `z = 1` and `z = i`.
pub(crate) fn wave(w: f64, h: f64) -> [Series; 2] {
    let (mut cos, mut sin) = ([0.0; TERMS], [0.0; TERMS]);
    let mut term = h * h;
    for n in 0..TERMS {
        match n % 4 {
            0 => cos[n] = term,
            1 => sin[n] = -term,
            2 => cos[n] = -term,
            _ => sin[n] = term,
        }
        term *= w / (n as f64 + 1.0);
    }
    [cos, sin]
}
