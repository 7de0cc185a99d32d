//! Many contacts with friction at once: which of them open, stick and slip.
//!
//! ```text
//! v = b + D x      0 <= p  perp  v_n >= 0            f in -mu p Sign(v_t),   -L Sign(v_t) in a joint   (1)
//! x_j+1 solves (1) with D + eps I and b - eps x_j                                                     (2)
//! ```
//!
//! Patterns of few contacts are tried one by one. Of more, proximal steps (2) make singular `D` regular, and
//! each is solved contact by contact (Gauss-Seidel, M. Jean and J. J. Moreau). What they are needed for is
//! the pattern: its equations are solved exactly afterwards.

use crate::numeric::vector::dot;

/// Most patterns of stick and slip that are tried one by one.
pub(super) const MOST_PATTERNS: usize = 256;
/// The proximal parameter, relative to the diagonal.
const PROXIMAL: f64 = 0.1;
/// Most proximal steps, and most sweeps over all contacts in one of them.
const STEPS: usize = 60;
const SWEEPS: usize = 3000;
/// Changes below this part of the largest number end the sweeps, and the proximal steps.
const SETTLED: f64 = 1e-13;
const STEADY: f64 = 1e-11;
/// Rates below this part of the largest term are none.
const STILL: f64 = 1e-9;

/// What acts in one place.
#[derive(Clone, Copy, Debug)]
pub(super) enum Site {
    /// A gap with its row of the problem.
    Gap { normal: usize, friction: Option<Rough> },
    /// A joint with its row, and the limits of its force in slip and in stick.
    Joint { row: usize, limits: (f64, f64) },
}

/// The friction of a gap.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rough {
    pub(super) row: usize,
    /// The coefficients in slip and in stick.
    pub(super) mu: (f64, f64),
    /// The sign of a slip that goes on, zero if that is what is asked for.
    pub(super) slip: f64,
}

/// What a site does: whether it is closed, and the sign of its slip, zero in stick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Outcome {
    pub(super) closed: bool,
    pub(super) slip: f64,
}

/// The problem (1), scaled to a diagonal of ones.
#[derive(Debug)]
pub(super) struct Coulomb {
    sites: Vec<Site>,
    d: Vec<f64>,
    b: Vec<f64>,
}

impl Coulomb {
    /// From `D` row by row and `b`.
    pub(super) fn new(sites: Vec<Site>, d: &[f64], b: &[f64]) -> Self {
        let k = b.len();
        let root: Vec<f64> = (0..k).map(|i| d[i * k + i].sqrt()).collect();
        let d = (0..k * k).map(|at| d[at] / root[at / k] / root[at % k]).collect();
        let b = b.iter().zip(&root).map(|(b, root)| b / root).collect();
        let both = |(one, other): (f64, f64), by: f64| (one * by, other * by);
        let scaled = |site: &Site| match *site {
            Site::Gap { normal, friction } => Site::Gap {
                normal,
                friction: friction.map(|rough| Rough {
                    mu: both(rough.mu, root[rough.row] / root[normal]),
                    ..rough
                }),
            },
            Site::Joint { row, limits } => Site::Joint { row, limits: both(limits, root[row]) },
        };
        Self { sites: sites.iter().map(scaled).collect(), d, b }
    }

    /// What each site does, after as many steps as are allowed; none if numbers overflow.
    pub(super) fn outcomes(&self) -> Option<Vec<Outcome>> {
        let k = self.b.len();
        let mut x = vec![0.0; k];
        for _ in 0..STEPS {
            let shifted: Vec<f64> = self.b.iter().zip(&x).map(|(b, x)| b - PROXIMAL * x).collect();
            let before = x.clone();
            for _ in 0..SWEEPS {
                let mut moved = 0.0_f64;
                for site in &self.sites {
                    moved = moved.max(self.relax(site, &shifted, &mut x));
                }
                if moved <= SETTLED * size(&x) {
                    break;
                }
            }
            if !x.iter().all(|x| x.is_finite()) {
                return None;
            }
            let moved = x.iter().zip(&before).fold(0.0_f64, |a, (x, y)| a.max((x - y).abs()));
            if moved <= STEADY * size(&x) {
                break;
            }
        }
        let rate = |i: usize| self.b[i] + dot(&self.d[i * k..][..k], &x);
        let still = STILL * (size(&self.b) + size(&x));
        let sign = |v: f64| if v.abs() <= still { 0.0 } else { v.signum() };
        let outcome = |site: &Site| match *site {
            Site::Gap { normal, friction, .. } => Outcome {
                closed: rate(normal) <= still,
                slip: friction.map_or(0.0, |it| match it.slip {
                    0.0 => sign(rate(it.row)),
                    slip => slip,
                }),
            },
            Site::Joint { row, .. } => Outcome { closed: true, slip: sign(rate(row)) },
        };
        Some(self.sites.iter().map(outcome).collect())
    }

    /// Solves (2) at one site with the forces of the others: by how much its own have moved.
    fn relax(&self, site: &Site, b: &[f64], x: &mut [f64]) -> f64 {
        let k = b.len();
        let diagonal = 1.0 + PROXIMAL;
        let entry = |i: usize, j: usize| self.d[i * k + j];
        let others = |x: &[f64], i: usize| b[i] + dot(&self.d[i * k..][..k], x) - x[i];
        match *site {
            Site::Joint { row, limits: (slip, stick) } => {
                let held = -others(x, row) / diagonal;
                let force = if held.abs() <= stick { held } else { slip * held.signum() };
                set(x, row, force)
            }
            Site::Gap { normal, friction: None } => {
                let force = (-others(x, normal) / diagonal).max(0.0);
                set(x, normal, force)
            }
            Site::Gap { normal, friction: Some(Rough { row, mu: (mu, mu_s), slip }) } => {
                let c = entry(normal, row);
                let g = others(x, normal) - c * x[row];
                let w = others(x, row) - c * x[normal];
                let sliding = |sign: f64| -g / (diagonal - mu * sign * c);
                let (p, f) = if slip != 0.0 {
                    let p = sliding(slip).max(0.0);
                    (p, -mu * slip * p)
                } else {
                    let determinant = diagonal * diagonal - c * c;
                    let p = (c * w - diagonal * g) / determinant;
                    let f = (c * g - diagonal * w) / determinant;
                    let slides = |sign: f64| {
                        let p = sliding(sign);
                        let slip = w + c * p - diagonal * mu * sign * p;
                        (p >= 0.0 && sign * slip >= 0.0).then_some((p, -mu * sign * p))
                    };
                    if p >= 0.0 && f.abs() <= mu_s * p {
                        (p, f)
                    } else {
                        slides(1.0).or_else(|| slides(-1.0)).unwrap_or((0.0, 0.0))
                    }
                };
                let moved = set(x, normal, p);
                moved.max(set(x, row, f))
            }
        }
    }
}

fn size(x: &[f64]) -> f64 {
    x.iter().fold(f64::MIN_POSITIVE, |size, x| size.max(x.abs()))
}

/// Sets a number: by how much it has moved.
fn set(x: &mut [f64], at: usize, value: f64) -> f64 {
    (std::mem::replace(&mut x[at], value) - value).abs()
}
