//! The systems of the references, with their derivatives written by hand.

use std::collections::HashMap;
use std::convert::Infallible;

use zivi::system::dynamics::{Dynamics, FunctionDynamics, Layout};

/// A function that evaluates a system.
pub(crate) type Evaluate<'f> =
    Box<dyn FnMut(f64, &[f64], &[f64], &mut [f64]) -> Result<(), Infallible> + 'f>;

/// A system given by any function: the method is compiled once for all of them.
pub(crate) fn of_function<'f>(
    layout: Layout,
    function: impl FnMut(f64, &[f64], &[f64], &mut [f64]) -> Result<(), Infallible> + 'f,
) -> FunctionDynamics<Evaluate<'f>> {
    FunctionDynamics { layout, function: Box::new(function) }
}

/// Parameters by name.
pub(crate) type Parameters = HashMap<String, f64>;

/// `M`, `F`, then `g`, `n`, `h`, `g_t` of each gap.
pub(crate) struct Parts {
    pub(crate) mass: Vec<f64>,
    pub(crate) force: Vec<f64>,
    pub(crate) gaps: Vec<(f64, Vec<f64>, f64, f64)>,
}

type Function = fn(&Parameters, f64, &[f64], &[f64]) -> Parts;

/// A system of the references.
pub(crate) struct Model {
    layout: Layout,
    parameters: Parameters,
    function: Function,
}

impl Model {
    pub(crate) fn new(name: &str, parameters: Parameters) -> Self {
        let (n, m, function): (usize, usize, Function) = match name {
            "incline" => (2, 1, incline),
            "bowl" => (2, 1, bowl),
            "sine" => (2, 1, sine),
            "hopper" => (2, 1, hopper),
            "cart" => (2, 1, cart),
            "dpend1" => (2, 1, pendulum_tip),
            "surf3" => (3, 1, surface),
            "pair" => (1, 2, pair),
            "wedge" => (2, 2, wedge),
            "corner" => (2, 2, corner),
            "dome" => (2, 2, dome),
            "cradle" => (3, 2, cradle),
            "rock" => (2, 2, rock),
            "dumb" => (3, 3, dumb),
            "dpend" => (2, 3, pendulum_walls),
            "tower3" => (3, 3, tower),
            "gear" => (2, 2, gear),
            other => panic!("{other}"),
        };
        Self { layout: Layout::smooth(n, m), parameters, function }
    }
}

impl Dynamics<Infallible> for Model {
    fn layout(&self) -> Layout {
        self.layout
    }

    fn evaluate(
        &mut self,
        t: f64,
        q: &[f64],
        w: &[f64],
        out: &mut [f64],
    ) -> Result<(), Infallible> {
        let parts = (self.function)(&self.parameters, t, q, w);
        let gaps = &parts.gaps;
        let numbers = (parts.mass.into_iter())
            .chain(parts.force)
            .chain(gaps.iter().map(|gap| gap.0))
            .chain(gaps.iter().flat_map(|gap| gap.1.iter().copied()))
            .chain(gaps.iter().map(|gap| gap.2))
            .chain(gaps.iter().map(|gap| gap.3));
        out.iter_mut().zip(numbers).for_each(|(out, number)| *out = number);
        Ok(())
    }
}

fn diagonal(masses: &[f64]) -> Vec<f64> {
    let n = masses.len();
    (0..n * n).map(|k| if k / n == k % n { masses[k / n] } else { 0.0 }).collect()
}

fn incline(p: &Parameters, _: f64, q: &[f64], _: &[f64]) -> Parts {
    let (sin, cos) = p["al"].sin_cos();
    Parts {
        mass: diagonal(&[p["mm"]; 2]),
        force: vec![0.0, -p["mm"] * p["G"]],
        gaps: vec![(q[1] * cos - q[0] * sin, vec![-sin, cos], 0.0, 0.0)],
    }
}

fn bowl(p: &Parameters, _: f64, q: &[f64], w: &[f64]) -> Parts {
    let (c, cd) = (p["c"], p["cd"]);
    Parts {
        mass: diagonal(&[1.0; 2]),
        force: vec![-cd * w[0], -p["G"] - cd * w[1]],
        gaps: vec![(
            q[1] - c * q[0] * q[0],
            vec![-2.0 * c * q[0], 1.0],
            -2.0 * c * w[0] * w[0],
            0.0,
        )],
    }
}

fn sine(p: &Parameters, _: f64, q: &[f64], w: &[f64]) -> Parts {
    let (a, k) = (p["a"], p["k"]);
    let (sin, cos) = (k * q[0]).sin_cos();
    Parts {
        mass: diagonal(&[1.0; 2]),
        force: vec![0.0, -p["G"]],
        gaps: vec![(q[1] - a * sin, vec![-a * k * cos, 1.0], a * k * k * sin * w[0] * w[0], 0.0)],
    }
}

fn hopper(p: &Parameters, t: f64, q: &[f64], w: &[f64]) -> Parts {
    let stretch = p["l0"] - (q[1] - q[0]);
    let leg = p["k"] * stretch - p["c"] * (w[1] - w[0]) + p["A"] * (p["om"] * t).sin();
    Parts {
        mass: diagonal(&[p["mf"], p["mb"]]),
        force: vec![-p["mf"] * p["G"] - leg, -p["mb"] * p["G"] + leg],
        gaps: vec![(q[0], vec![1.0, 0.0], 0.0, 0.0)],
    }
}

fn cart(p: &Parameters, _: f64, q: &[f64], w: &[f64]) -> Parts {
    let (sin, cos) = q[1].sin_cos();
    let arm = p["mp"] * p["l"];
    Parts {
        mass: vec![p["mc"] + p["mp"], arm * cos, arm * cos, arm * p["l"]],
        force: vec![
            -p["f0"] + arm * w[1] * w[1] * sin - p["cx"] * w[0],
            -arm * p["G"] * sin - p["cp"] * w[1],
        ],
        gaps: vec![(q[0], vec![1.0, 0.0], 0.0, 0.0)],
    }
}

fn pendulum(p: &Parameters, q: &[f64], w: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (m1, m2, l1, l2, g, cd) = (p["m1"], p["m2"], p["l1"], p["l2"], p["G"], p["cd"]);
    let (sin, cos) = (q[0] - q[1]).sin_cos();
    let c = m2 * l1 * l2;
    let mass = vec![(m1 + m2) * l1 * l1, c * cos, c * cos, m2 * l2 * l2];
    let force = vec![
        -c * sin * w[1] * w[1] - (m1 + m2) * g * l1 * q[0].sin() - cd * w[0],
        c * sin * w[0] * w[0] - m2 * g * l2 * q[1].sin() - cd * w[1],
    ];
    (mass, force)
}

/// `sign (l1 sin a + l2 sin b) + d`.
fn tip(p: &Parameters, q: &[f64], w: &[f64], sign: f64, d: f64) -> (f64, Vec<f64>, f64, f64) {
    let (l1, l2) = (sign * p["l1"], sign * p["l2"]);
    let ((s0, c0), (s1, c1)) = (q[0].sin_cos(), q[1].sin_cos());
    let bend = -l1 * s0 * w[0] * w[0] - l2 * s1 * w[1] * w[1];
    (l1 * s0 + l2 * s1 + d, vec![l1 * c0, l2 * c1], bend, 0.0)
}

fn pendulum_tip(p: &Parameters, _: f64, q: &[f64], w: &[f64]) -> Parts {
    let (mass, force) = pendulum(p, q, w);
    Parts { mass, force, gaps: vec![tip(p, q, w, 1.0, p["d"])] }
}

fn pendulum_walls(p: &Parameters, _: f64, q: &[f64], w: &[f64]) -> Parts {
    let (mass, force) = pendulum(p, q, w);
    let (l1, (sin, cos)) = (p["l1"], q[0].sin_cos());
    let elbow = (l1 * sin + p["d1"], vec![l1 * cos, 0.0], -l1 * sin * w[0] * w[0], 0.0);
    let gaps = vec![elbow, tip(p, q, w, 1.0, p["d2"]), tip(p, q, w, -1.0, p["d3"])];
    Parts { mass, force, gaps }
}

fn surface(p: &Parameters, t: f64, q: &[f64], w: &[f64]) -> Parts {
    let (a, b, k, cd) = (p["a"], p["b"], p["k"], p["cd"]);
    let ((sx, cx), (sy, cy)) = ((k * q[0]).sin_cos(), (k * q[1]).sin_cos());
    let bend = a * k * k * sx * w[0] * w[0] + b * k * k * cy * w[1] * w[1];
    let push = p["f"] * (p["om"] * t).cos();
    Parts {
        mass: diagonal(&[1.0; 3]),
        force: vec![-cd * w[0] + push, -cd * w[1], -p["G"] - cd * w[2]],
        gaps: vec![(q[2] - a * sx - b * cy, vec![-a * k * cx, b * k * sy, 1.0], bend, 0.0)],
    }
}

fn pair(p: &Parameters, t: f64, q: &[f64], w: &[f64]) -> Parts {
    let (a, om) = (p["A"], p["om"]);
    let (sin, cos) = (om * t).sin_cos();
    let (wall, rate, bend) = (a * sin, a * om * cos, -a * om * om * sin);
    Parts {
        mass: vec![p["m"]],
        force: vec![-p["k"] * q[0] - p["m"] * p["G"] - p["c"] * w[0]],
        gaps: vec![
            (q[0] - wall, vec![1.0], -bend, -rate),
            (p["L"] + wall - q[0], vec![-1.0], bend, rate),
        ],
    }
}

fn wedge(p: &Parameters, _: f64, q: &[f64], w: &[f64]) -> Parts {
    let ((s1, c1), (s2, c2)) = (p["a1"].sin_cos(), p["a2"].sin_cos());
    Parts {
        mass: diagonal(&[p["m"]; 2]),
        force: vec![-p["cd"] * w[0], -p["m"] * p["G"] - p["cd"] * w[1]],
        gaps: vec![
            (q[1] * c1 + q[0] * s1, vec![s1, c1], 0.0, 0.0),
            (q[1] * c2 - q[0] * s2, vec![-s2, c2], 0.0, 0.0),
        ],
    }
}

fn corner(p: &Parameters, t: f64, q: &[f64], _: &[f64]) -> Parts {
    Parts {
        mass: diagonal(&[p["m"]; 2]),
        force: vec![p["fx"] * (p["om"] * t).cos(), -p["m"] * p["G"]],
        gaps: vec![(q[1], vec![0.0, 1.0], 0.0, 0.0), (p["d"] - q[0], vec![-1.0, 0.0], 0.0, 0.0)],
    }
}

fn dome(p: &Parameters, t: f64, q: &[f64], w: &[f64]) -> Parts {
    let push = p["fx"] * (p["om"] * t).sin();
    let ramp = q[1] + p["s"] * q[0] + p["c"] * q[0] * q[0];
    let normal = vec![p["s"] + 2.0 * p["c"] * q[0], 1.0];
    Parts {
        mass: diagonal(&[p["m"]; 2]),
        force: vec![-p["cd"] * w[0] + push, -p["m"] * p["G"] - p["cd"] * w[1]],
        gaps: vec![
            (ramp, normal, 2.0 * p["c"] * w[0] * w[0], 0.0),
            (p["d"] - q[0], vec![-1.0, 0.0], 0.0, 0.0),
        ],
    }
}

fn cradle(p: &Parameters, _: f64, q: &[f64], _: &[f64]) -> Parts {
    let masses = [p["m1"], p["m2"], p["m3"]];
    let pull = |i: usize| -masses[i] * p["om"].powi(2) * (q[i] + i as f64 * p["dl"]);
    Parts {
        mass: diagonal(&masses),
        force: (0..3).map(pull).collect(),
        gaps: vec![
            (q[1] - q[0], vec![-1.0, 1.0, 0.0], 0.0, 0.0),
            (q[2] - q[1], vec![0.0, -1.0, 1.0], 0.0, 0.0),
        ],
    }
}

fn rock(p: &Parameters, t: f64, q: &[f64], w: &[f64]) -> Parts {
    let (h, b) = (p["hh"], p["b"]);
    let (sin, cos) = q[1].sin_cos();
    let (up, turn) = (p["A"] * (p["om"] * t).sin(), p["B"] * (p["om"] * t).sin());
    let foot = |b: f64| {
        let bend = (h * cos - b * sin) * w[1] * w[1];
        (q[0] - h * cos + b * sin, vec![1.0, h * sin + b * cos], bend, 0.0)
    };
    Parts {
        mass: diagonal(&[p["m"], p["J"]]),
        force: vec![up - p["m"] * p["G"], turn],
        gaps: vec![foot(b), foot(-b)],
    }
}

fn dumb(p: &Parameters, _: f64, q: &[f64], w: &[f64]) -> Parts {
    let l = p["l"];
    let (sin, cos) = q[2].sin_cos();
    let (up, side) = (l * sin * w[2] * w[2], l * cos * w[2] * w[2]);
    Parts {
        mass: diagonal(&[p["m"], p["m"], p["J"]]),
        force: vec![0.0, -p["m"] * p["G"], 0.0],
        gaps: vec![
            (q[1] + l * sin, vec![0.0, 1.0, l * cos], -up, 0.0),
            (q[1] - l * sin, vec![0.0, 1.0, -l * cos], up, 0.0),
            (p["d"] - q[0] - l * cos, vec![-1.0, 0.0, l * sin], side, 0.0),
        ],
    }
}

fn tower(p: &Parameters, t: f64, q: &[f64], _: &[f64]) -> Parts {
    let masses = [p["m0"], p["m1"], p["m2"]];
    let (a, om) = (p["A"], p["om"]);
    let (sin, cos) = (om * t).sin_cos();
    Parts {
        mass: diagonal(&masses),
        force: masses.iter().map(|m| -m * p["G"]).collect(),
        gaps: vec![
            (q[0] - a * sin, vec![1.0, 0.0, 0.0], a * om * om * sin, -a * om * cos),
            (q[1] - q[0], vec![-1.0, 1.0, 0.0], 0.0, 0.0),
            (q[2] - q[1], vec![0.0, -1.0, 1.0], 0.0, 0.0),
        ],
    }
}

fn gear(p: &Parameters, t: f64, q: &[f64], w: &[f64]) -> Parts {
    let (r, half) = (p["r"], 0.5 * p["bl"]);
    let x = r * (q[0] - q[1]);
    Parts {
        mass: diagonal(&[p["J1"], p["J2"]]),
        force: vec![
            p["T0"] + p["T1"] * (p["om"] * t).sin() - p["c1"] * w[0],
            -p["TL"] - p["c2"] * w[1],
        ],
        gaps: vec![(half + x, vec![r, -r], 0.0, 0.0), (half - x, vec![-r, r], 0.0, 0.0)],
    }
}
