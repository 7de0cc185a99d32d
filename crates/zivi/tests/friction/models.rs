//! The systems of the references with friction, with their derivatives written by hand.

use std::collections::HashMap;
use std::convert::Infallible;

use zivi::system::dynamics::{Dynamics, Layout};
use zivi::system::force::{Channel, Friction, FrictionalImpact};

pub(crate) const G: f64 = 9.81;

/// A gap or a channel: its value (of a gap), row, what it accelerates by without forces, its rate
/// without velocities.
pub(crate) struct Row {
    pub(crate) value: f64,
    pub(crate) row: Vec<f64>,
    pub(crate) curvature: f64,
    pub(crate) rate: f64,
}

/// Values of a system at a state; limits while slipping and sticking.
pub(crate) struct Parts {
    pub(crate) mass: Vec<f64>,
    pub(crate) force: Vec<f64>,
    pub(crate) gaps: Vec<Row>,
    pub(crate) channels: Vec<Row>,
    pub(crate) limits: Vec<(f64, f64)>,
}

type Function = Box<dyn Fn(f64, &[f64], &[f64]) -> Parts>;

/// A system with friction.
pub(crate) struct Rough {
    pub(crate) layout: Layout,
    pub(crate) friction: Friction,
    pub(crate) e: Vec<f64>,
    function: Function,
}

impl Dynamics<Infallible> for Rough {
    fn layout(&self) -> Layout {
        self.layout
    }

    fn friction(&self) -> &Friction {
        &self.friction
    }

    fn evaluate(
        &mut self,
        t: f64,
        q: &[f64],
        w: &[f64],
        out: &mut [f64],
    ) -> Result<(), Infallible> {
        let Parts { mass, force, gaps, channels, limits } = (self.function)(t, q, w);
        let rows = || gaps.iter().chain(&channels);
        let numbers = (mass.into_iter())
            .chain(force)
            .chain(gaps.iter().map(|gap| gap.value))
            .chain(rows().flat_map(|it| it.row.iter().copied()))
            .chain(rows().map(|it| it.curvature))
            .chain(rows().map(|it| it.rate))
            .chain(limits.iter().map(|it| it.0))
            .chain(limits.iter().map(|it| it.1));
        out.iter_mut().zip(numbers).for_each(|(out, number)| *out = number);
        Ok(())
    }
}

fn gap(value: f64, row: &[f64], curvature: f64, rate: f64) -> Row {
    Row { value, row: row.to_vec(), curvature, rate }
}

pub(crate) fn slip(row: &[f64], curvature: f64, rate: f64) -> Row {
    gap(0.0, row, curvature, rate)
}

fn diagonal(masses: &[f64]) -> Vec<f64> {
    let n = masses.len();
    (0..n * n).map(|k| if k / n == k % n { masses[k / n] } else { 0.0 }).collect()
}

/// `n`, the gaps of the channels, restitutions by gap and by channel.
pub(crate) fn rough(
    n: usize,
    gap_of: &[Option<usize>],
    e: &[f64],
    e_t: f64,
    function: impl Fn(f64, &[f64], &[f64]) -> Parts + 'static,
) -> Rough {
    let channels = gap_of.iter().map(|&gap| Channel { gap, e_t }).collect();
    Rough {
        layout: Layout { n, m: e.len(), p: gap_of.len(), k: 0 },
        friction: Friction { channels, law: FrictionalImpact::Newton, ..Friction::default() },
        e: e.to_vec(),
        function: Box::new(function),
    }
}

pub(crate) type Parameters = HashMap<String, f64>;

pub(crate) fn of_family(family: &str, p: &Parameters) -> Rough {
    let of = |name: &str, default: f64| p.get(name).copied().unwrap_or(default);
    let number = |name: &str| of(name, 0.0);
    match family {
        "incline" => incline(number("al"), number("mu"), number("e")),
        "belt" => {
            let [k, c, v, lk, ls] = ["k", "c", "v", "Lk", "Ls"].map(number);
            belt([k, c, v, lk, ls], number("gam"), number("A"), of("Om", 1.0))
        }
        "belt2" => belt2(["k1", "k2", "k12", "v", "L1", "L2", "s1", "s2", "gam"].map(number)),
        "beltstop" => belt_stop(["k", "v", "L", "Ls", "d", "e", "A"].map(number), of("Om", 1.0)),
        "rod" => rod(number("mu"), number("e"), number("two") != 0.0),
        "rock" => rock(["b", "h", "mu", "e", "A", "Om"].map(number)),
        "woodpecker" => woodpecker(),
        "disc" => disc(["mu", "e", "et"].map(number), [0.0; 3]),
        "feeder" => feeder(["al", "mu", "e", "A", "Om", "beta"].map(number)),
        "bowl" => bowl(number("mu"), number("e"), number("cd"), 1.0),
        other => panic!("{other}"),
    }
}

pub(crate) fn incline(al: f64, mu: f64, e: f64) -> Rough {
    rough(2, &[Some(0)], &[e], 0.0, move |_, q, _| Parts {
        mass: diagonal(&[2.0; 2]),
        force: vec![2.0 * G * al.sin(), -2.0 * G * al.cos()],
        gaps: vec![gap(q[1], &[0.0, 1.0], 0.0, 0.0)],
        channels: vec![slip(&[1.0, 0.0], 0.0, 0.0)],
        limits: vec![(mu, mu)],
    })
}

pub(crate) fn belt([k, c, v, lk, ls]: [f64; 5], gam: f64, a: f64, om: f64) -> Rough {
    rough(1, &[None], &[], 0.0, move |t, q, w| Parts {
        mass: vec![1.0],
        force: vec![-k * q[0] - c * w[0] + a * (om * t).cos()],
        gaps: vec![],
        channels: vec![slip(&[1.0], 0.0, -v)],
        limits: vec![(lk / (1.0 + gam * (w[0] - v).abs()), ls)],
    })
}

pub(crate) fn belt2([k1, k2, k12, v, l1, l2, s1, s2, gam]: [f64; 9]) -> Rough {
    rough(2, &[None, None], &[], 0.0, move |_, q, w| Parts {
        mass: diagonal(&[1.0; 2]),
        force: vec![-k1 * q[0] - k12 * (q[0] - q[1]), -k2 * q[1] - k12 * (q[1] - q[0])],
        gaps: vec![],
        channels: vec![slip(&[1.0, 0.0], 0.0, -v), slip(&[0.0, 1.0], 0.0, -v)],
        limits: vec![
            (l1 / (1.0 + gam * (w[0] - v).abs()), s1),
            (l2 / (1.0 + gam * (w[1] - v).abs()), s2),
        ],
    })
}

pub(crate) fn belt_stop([k, v, l, ls, d, e, a]: [f64; 7], om: f64) -> Rough {
    rough(1, &[None], &[e], 0.0, move |t, q, _| Parts {
        mass: vec![1.0],
        force: vec![-k * q[0] + a * (om * t).cos()],
        gaps: vec![gap(d - q[0], &[-1.0], 0.0, 0.0)],
        channels: vec![slip(&[1.0], 0.0, -v)],
        limits: vec![(l, ls)],
    })
}

pub(crate) fn rod(mu: f64, e: f64, two: bool) -> Rough {
    let signs: &[f64] = if two { &[-1.0, 1.0] } else { &[-1.0] };
    let gap_of: Vec<Option<usize>> = (0..signs.len()).map(Some).collect();
    rough(3, &gap_of, &vec![e; signs.len()], 0.0, move |_, q, w| {
        let ((s, c), o2) = (q[2].sin_cos(), w[2] * w[2]);
        Parts {
            mass: diagonal(&[1.0, 1.0, 1.0 / 3.0]),
            force: vec![0.0, -G, 0.0],
            gaps: signs
                .iter()
                .map(|a| gap(q[1] + a * s, &[0.0, 1.0, a * c], -a * s * o2, 0.0))
                .collect(),
            channels: signs.iter().map(|a| slip(&[1.0, 0.0, -a * s], -a * c * o2, 0.0)).collect(),
            limits: vec![(mu, mu); signs.len()],
        }
    })
}

pub(crate) fn rock([b, h, mu, e, a, om]: [f64; 6]) -> Rough {
    rough(3, &[Some(0), Some(1)], &[e, e], 0.0, move |t, q, w| {
        let ((s, c), o2) = (q[2].sin_cos(), w[2] * w[2]);
        let corners = [(-b, -h), (b, -h)].map(|(x, y)| (x * c - y * s, x * s + y * c));
        let (fv, fa) = (a * om * (om * t).cos(), -a * om * om * (om * t).sin());
        Parts {
            mass: diagonal(&[1.0, 1.0, (b * b + h * h) / 3.0]),
            force: vec![0.0, -G, 0.0],
            gaps: corners
                .iter()
                .map(|(x, y)| gap(q[1] + y, &[0.0, 1.0, *x], -y * o2, 0.0))
                .collect(),
            channels: corners
                .iter()
                .map(|(x, y)| slip(&[1.0, 0.0, -y], -x * o2 - fa, -fv))
                .collect(),
            limits: vec![(mu, mu); 2],
        }
    })
}

fn woodpecker() -> Rough {
    let [ms, mm, js, jm, c] = [0.0045, 0.0003, 7e-7, 5e-9, 0.0056];
    let [r0, rm, hm, lm, lg, hs, ls] = [0.0025, 0.0031, 0.0058, 0.01, 0.015, 0.02, 0.0201];
    rough(3, &[Some(0), Some(1), Some(2)], &[0.5, 0.0, 0.0], 0.0, move |_, q, _| Parts {
        mass: vec![
            ms + mm,
            ms * lm,
            ms * lg,
            ms * lm,
            jm + ms * lm * lm,
            ms * lm * lg,
            ms * lg,
            ms * lm * lg,
            js + ms * lg * lg,
        ],
        force: vec![
            -(ms + mm) * G,
            -c * (q[1] - q[2]) - ms * lm * G,
            -c * (q[2] - q[1]) - ms * lg * G,
        ],
        gaps: vec![
            gap(lm + lg - ls - r0 - hs * q[2], &[0.0, 0.0, -hs], 0.0, 0.0),
            gap(rm - r0 + hm * q[1], &[0.0, hm, 0.0], 0.0, 0.0),
            gap(rm - r0 - hm * q[1], &[0.0, -hm, 0.0], 0.0, 0.0),
        ],
        channels: vec![
            slip(&[1.0, lm, lg - ls], 0.0, 0.0),
            slip(&[1.0, rm, 0.0], 0.0, 0.0),
            slip(&[1.0, rm, 0.0], 0.0, 0.0),
        ],
        limits: vec![(0.3, 0.3); 3],
    })
}

/// On a slope that vibrates along its normal.
pub(crate) fn disc([mu, e, e_t]: [f64; 3], [al, a, om]: [f64; 3]) -> Rough {
    let r = 0.1;
    rough(3, &[Some(0)], &[e], e_t, move |t, q, _| {
        let (sin, cos) = (om * t).sin_cos();
        Parts {
            mass: diagonal(&[1.0, 1.0, r * r / 2.0]),
            force: vec![G * al.sin(), -G * al.cos(), 0.0],
            gaps: vec![gap(q[1] - r - a * sin, &[0.0, 1.0, 0.0], a * om * om * sin, -a * om * cos)],
            channels: vec![slip(&[1.0, 0.0, r], 0.0, 0.0)],
            limits: vec![(mu, mu)],
        }
    })
}

pub(crate) fn feeder([al, mu, e, a, om, beta]: [f64; 6]) -> Rough {
    let (sb, cb) = beta.sin_cos();
    rough(2, &[Some(0)], &[e], 0.0, move |t, q, _| {
        let (x, v) = (a * (om * t).sin(), a * om * (om * t).cos());
        Parts {
            mass: diagonal(&[1.0; 2]),
            force: vec![G * al.sin(), -G * al.cos()],
            gaps: vec![gap(q[1] - sb * x, &[0.0, 1.0], sb * om * om * x, -sb * v)],
            channels: vec![slip(&[1.0, 0.0], cb * om * om * x, -cb * v)],
            limits: vec![(mu, mu)],
        }
    })
}

/// A particle above the parabola `y = x^2/2`, whose gap and tangent are `scale` times as large.
pub(crate) fn bowl(mu: f64, e: f64, cd: f64, scale: f64) -> Rough {
    rough(2, &[Some(0)], &[e], 0.0, move |_, q, w| {
        let (x, v, a) = (q[0], w[0].hypot(w[1]), scale);
        Parts {
            mass: diagonal(&[1.0; 2]),
            force: vec![-cd * v * w[0], -G - cd * v * w[1]],
            gaps: vec![gap(a * (q[1] - x * x / 2.0), &[-a * x, a], -a * w[0] * w[0], 0.0)],
            channels: vec![slip(&[a, a * x], a * w[0] * w[1], 0.0)],
            limits: vec![(mu, mu)],
        }
    })
}

/// Numbers in [0, 1) from a seed.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}
