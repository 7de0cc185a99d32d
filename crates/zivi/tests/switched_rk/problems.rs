//! Problems, stored references and small tools.

use std::convert::Infallible;
use std::fs;

use serde_json::Value;
use zivi::system::force::{Dependence, LinearLaw};
use zivi::{
    simulate_switched_rk, Flights, Force, LinearForce, Order, Output, Physical, Restitution,
    Silent, Status, SwitchedRk, SwitchedRun,
};

pub(crate) type Run = SwitchedRun<Infallible>;

/// A stored trajectory of `x'' = -k x - c x' - g + a cos(w t + phase)`.
pub(crate) struct Reference {
    name: String,
    pub(crate) force: LinearForce,
    pub(crate) restitution: Restitution,
    pub(crate) span: (f64, f64),
    pub(crate) initial: Physical,
    pub(crate) end: Physical,
    pub(crate) zeno: Vec<f64>,
    pub(crate) lift: Vec<f64>,
    /// Time and speed after the first impacts.
    pub(crate) impacts: Vec<[f64; 2]>,
    /// Time, position, velocity.
    pub(crate) samples: Vec<[f64; 3]>,
    pub(crate) rests_at_end: bool,
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|it| it.as_f64().unwrap()).collect()
}

impl Reference {
    fn read(name: &str, it: &Value) -> Self {
        let number = |key: &str| it[key].as_f64().unwrap();
        let f = |key: &str| it["force"][key].as_f64().unwrap();
        let force = LinearForce {
            stiffness: f("stiffness"),
            damping: f("damping"),
            gravity: f("gravity"),
            amplitude: f("amplitude"),
            omega: f("omega"),
            phase: f("phase"),
        };
        let samples = it["samples"].as_object().unwrap().iter().map(|(t, state)| {
            let state = numbers(state);
            [t.parse().unwrap(), state[0], state[1]]
        });
        let impacts = it["impacts"].as_array().unwrap().iter();
        Self {
            name: name.to_owned(),
            force,
            restitution: Restitution::from_e(number("e")).unwrap(),
            span: (number("t0"), number("t_end")),
            initial: Physical { x: number("x0"), xdot: number("xdot0") },
            end: Physical { x: number("x_end"), xdot: number("xdot_end") },
            zeno: numbers(&it["zeno"]),
            lift: numbers(&it["lift"]),
            impacts: impacts.map(|it| [it[0].as_f64().unwrap(), it[1].as_f64().unwrap()]).collect(),
            samples: samples.collect(),
            rests_at_end: it["at_rest_at_end"].as_bool().unwrap(),
        }
    }

    pub(crate) fn all() -> Vec<Self> {
        let path =
            concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/reference_trajectories.json");
        let file: Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
        let cases = file.as_object().unwrap().iter().filter(|(name, _)| *name != "_about");
        cases.map(|(name, it)| Self::read(name, it)).collect()
    }

    pub(crate) fn named(start: &str) -> Self {
        Self::all().into_iter().find(|it| it.name.starts_with(start)).unwrap()
    }

    pub(crate) fn simulate(&self, settings: SwitchedRk) -> Run {
        simulate(settings, self.restitution, &mut self.force.clone(), self.span, self.initial)
    }

    /// Without dense output.
    pub(crate) fn simulate_bare(&self, settings: SwitchedRk) -> Run {
        let mut own = self.force;
        let (force, output) = (&mut AnyForce(&mut own), Output::default());
        let (span, start) = (self.span, self.initial);
        simulate_switched_rk(settings, self.restitution, force, span, start, output, &mut Silent)
            .unwrap()
    }
}

pub(crate) fn settings(order: Order, tol: f64) -> SwitchedRk {
    SwitchedRk { order, flights: Flights::RungeKutta, ..SwitchedRk::with_tol(tol) }
}

/// Any force: the method is compiled once for all of them.
pub(crate) struct AnyForce<'f, E>(pub(crate) &'f mut dyn Force<E>);

impl<E> Force<E> for AnyForce<'_, E> {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        self.0.at(t, x, xdot)
    }

    fn dependence(&self) -> Dependence {
        self.0.dependence()
    }

    fn dependence_at_rest(&self) -> Dependence {
        self.0.dependence_at_rest()
    }

    fn shortest_period(&self) -> Option<f64> {
        self.0.shortest_period()
    }

    fn linear(&self) -> Option<LinearLaw> {
        self.0.linear()
    }

    fn is_interruption(&self, error: &E) -> bool {
        self.0.is_interruption(error)
    }
}

/// A completed run with dense output.
pub(crate) fn simulate(
    settings: SwitchedRk,
    restitution: Restitution,
    force: &mut dyn Force<Infallible>,
    span: (f64, f64),
    initial: Physical,
) -> Run {
    let output = Output { dense: true, ..Output::default() };
    let force = &mut AnyForce(force);
    let run =
        simulate_switched_rk(settings, restitution, force, span, initial, output, &mut Silent);
    let run = run.unwrap();
    assert_eq!(run.trajectory.status, Status::Completed);
    run
}

/// The last sample.
pub(crate) fn end(run: &Run) -> Physical {
    let of = |quantity| *run.trajectory.columns.of(quantity).last().unwrap();
    Physical { x: of(zivi::Quantity::X), xdot: of(zivi::Quantity::Xdot) }
}

/// Uniform numbers in [0, 1) (xorshift64*).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }
}
