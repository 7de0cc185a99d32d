//! Error control: how long a step may be.

use super::coordinates::{Coordinates, State};
use super::stages::Equation;
use super::step_error::Tolerances;

/// Factor that keeps the next step from being rejected.
pub(crate) const SAFETY: f64 = 0.9;
/// Smallest and largest factor between two steps.
pub(crate) const FACTORS: (f64, f64) = (0.2, 5.0);
/// Factor after a step that could not be judged.
pub(crate) const RETREAT: f64 = 0.25;

/// By which factor a step whose error is `error` could be longer, if that is of the order `h^q`.
#[inline]
pub(crate) fn factor(error: f64, q: f64) -> f64 {
    SAFETY * error.powf(-1.0 / q)
}

/// The factor for a step that is rejected, from [`factor`], which may be no number.
#[inline]
pub(crate) fn shorter(factor: f64) -> f64 {
    if factor > FACTORS.0 {
        factor.min(SAFETY)
    } else {
        FACTORS.0
    }
}

/// A step size, and what the error control had asked for if that was more.
#[derive(Clone, Copy)]
pub(crate) struct Plan {
    pub(crate) h: f64,
    pub(crate) wanted: f64,
}

impl Plan {
    /// The step of the wanted length, or up to the end where that is `left` away.
    pub(crate) fn up_to(left: f64, h: f64, wanted: f64) -> Self {
        // no sliver of a step is left for the end
        let h = if h >= left * (1.0 - 1e-12) { left } else { h };
        Self { h, wanted }
    }

    /// The step to try after one of length `h`, which may grow by the factor `growth`.
    pub(crate) fn next(self, h: f64, growth: f64) -> f64 {
        if h < self.h {
            h * growth.min(1.0)
        } else if h < self.wanted && growth >= 1.0 {
            // a step that something else cut short says nothing against a longer one
            (h * growth).max(self.wanted)
        } else {
            h * growth
        }
    }
}

/// A step so short that rounding is all that is left of it may have any error: the acceleration
/// jumps there. Not two of them in a row: that is a singularity.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Jump {
    /// Whether the step that is tried is that short.
    pub(crate) allowed: bool,
    /// Whether its error was too large.
    pub(crate) met: bool,
    /// Whether that of the last step was.
    met_before: bool,
}

impl Jump {
    /// That of the next step.
    pub(crate) fn next(self) -> Self {
        Self { met_before: self.met, ..Self::default() }
    }

    /// Whether the shortest step may be tried in spite of its error.
    pub(crate) fn may_be_allowed(self) -> bool {
        !(self.allowed || self.met_before)
    }
}

/// A step whose error should be near the tolerance, from the accelerations `slope` and their change
/// (E. Hairer, S. P. Norsett, G. Wanner, *Solving Ordinary Differential Equations I*, section
/// II.4); an acceleration ahead that cannot be had for a reason that is `harmless` does not count.
pub(crate) fn first_step<Q: Coordinates, X>(
    now: &State<Q>,
    slope: &Q,
    left: f64,
    (tolerances, q): (&Tolerances, f64),
    equation: &mut impl Equation<Q, X>,
    harmless: impl Fn(&X) -> bool,
) -> Result<f64, X> {
    let (x, xdot, slope) = (now.x.as_slice(), now.xdot.as_slice(), slope.as_slice());
    let norm = |of: &dyn Fn(usize) -> (f64, f64)| {
        (0..x.len()).fold(0.0_f64, |worst, c| {
            let at = (x[c], xdot[c]);
            let ([scale_x, scale_xdot], (x, xdot)) = (tolerances.scales(at, at), of(c));
            worst.max((x / scale_x).abs().max((xdot / scale_xdot).abs()))
        })
    };
    let (size, rate) = (norm(&|c| (x[c], xdot[c])), norm(&|c| (xdot[c], slope[c])));
    let known = size > 1e-5 && rate > 1e-5;
    let euler = if known { 1e-2 * size / rate } else { 1e-6 * left }.min(left);
    let mut ahead = now.clone();
    ahead.t = now.t + euler;
    for c in 0..x.len() {
        ahead.x.as_mut_slice()[c] += euler * xdot[c];
        ahead.xdot.as_mut_slice()[c] += euler * slope[c];
    }
    let mut there = Q::zeros(x.len());
    match equation.acceleration(&ahead, &mut there) {
        Err(why) if harmless(&why) => return Ok(euler),
        ahead => ahead?,
    }
    let there = there.as_slice();
    let change = norm(&|c| (euler * slope[c], there[c] - slope[c])) / euler;
    let fastest = rate.max(change);
    let step = if fastest > 1e-15 { (1e-2 / fastest).powf(1.0 / q) } else { left };
    let longest = if equation.is_autonomous() { left } else { left.min(100.0 * euler) };
    Ok(step.min(longest))
}
