//! Against trajectories of 26 digits.

use std::path::Path;

use serde_json::Value;
use zivi::mechanics::{simulate_mechanical, MechanicalOutput, MechanicalRun, Occurrence};
use zivi::system::impact_law::newton_impacts;
use zivi::{Order, Silent, Status, SwitchedRk};

use crate::models::{Model, Parameters};

fn read(name: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data").join(name);
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().or_else(|| value.as_str().and_then(|text| text.parse().ok())).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(number).collect()
}

/// An event: what, when, which gap.
type Event = (&'static str, f64, usize);

/// One case of either file.
pub(crate) struct Case {
    pub(crate) name: String,
    pub(crate) model: String,
    pub(crate) par: Parameters,
    pub(crate) e: Vec<f64>,
    pub(crate) q0: Vec<f64>,
    pub(crate) w0: Vec<f64>,
    pub(crate) t1: f64,
    events: Vec<Event>,
    state: Vec<f64>,
    pub(crate) nested: bool,
    corner: Option<f64>,
}

fn kind(name: &str) -> Option<&'static str> {
    ["zeno", "lift"].into_iter().find(|kind| *kind == name)
}

fn one_gap() -> Vec<Case> {
    let file = read("ndof_references.json");
    let cases = file.as_object().unwrap().iter().filter(|(name, _)| *name != "_about");
    cases
        .map(|(name, case)| {
            let par = &case["par"];
            let events = case["events"].as_array().unwrap().iter().filter_map(|event| {
                kind(event[0].as_str().unwrap()).map(|kind| (kind, number(&event[1]), 0))
            });
            let model = case["problem"].as_str().unwrap();
            Case {
                name: name.clone(),
                model: if model == "dpend" { "dpend1".into() } else { model.into() },
                par: scalars(par),
                e: vec![number(&par["e"])],
                q0: numbers(&par["q0"]),
                w0: numbers(&par["w0"]),
                t1: number(&par["T"]),
                events: events.collect(),
                state: numbers(&case["zT"]),
                nested: false,
                corner: None,
            }
        })
        .collect()
}

fn scalars(par: &Value) -> Parameters {
    let numbers = par.as_object().unwrap().iter().filter(|(_, value)| !value.is_array());
    numbers.map(|(name, value)| (name.clone(), number(value))).collect()
}

fn several_gaps() -> Vec<Case> {
    let file = read("multi_references.json");
    let cases = file["cases"].as_object().unwrap().iter();
    cases
        .map(|(name, case)| {
            let spec = &case["spec"];
            let all = case["events"].as_array().unwrap();
            let of = |event: &Value| event[0].as_str().unwrap().to_owned();
            let events = all.iter().filter_map(|event| {
                let gaps = event[2].as_array().unwrap();
                kind(&of(event)).map(|kind| (kind, number(&event[1]), number(&gaps[0]) as usize))
            });
            Case {
                name: name.clone(),
                model: spec["model"].as_str().unwrap().into(),
                par: scalars(&spec["par"]),
                e: numbers(&spec["e"]),
                q0: numbers(&spec["q0"]),
                w0: numbers(&spec["w0"]),
                t1: number(&spec["T"]),
                events: events.collect(),
                state: numbers(&case["state"]),
                nested: all.iter().any(|event| of(event) == "open"),
                corner: all.iter().find(|it| of(it) == "corner").map(|it| number(&it[1])),
            }
        })
        .collect()
}

fn run(case: &Case, order: Order, tol: f64) -> MechanicalRun<std::convert::Infallible> {
    let settings = SwitchedRk { order, ..SwitchedRk::with_tol(tol) };
    let mut model = Model::new(&case.model, case.par.clone());
    let span = (0.0, case.t1);
    let start = (&case.q0[..], &case.w0[..]);
    let output = MechanicalOutput::default();
    simulate_mechanical(
        settings,
        &mut model,
        &newton_impacts(&case.e).unwrap(),
        span,
        start,
        output,
        &mut Silent,
    )
    .unwrap()
}

fn events_of<E>(run: &MechanicalRun<E>) -> Vec<Event> {
    let event = |it: &Occurrence| match *it {
        Occurrence::Zeno { t, gap, .. } => Some(("zeno", t, gap)),
        Occurrence::LiftOff { t, gap } => Some(("lift", t, gap)),
        _ => None,
    };
    run.occurrences.iter().filter_map(event).collect()
}

/// Errors of the state at the end and of the Zeno and lift times, in tolerances; or a description
/// of the failure.
fn errors(case: &Case, order: Order, tol: f64) -> Result<[f64; 3], String> {
    let run = run(case, order, tol);
    if run.status != Status::Completed {
        return Err(format!("{:?} at {}", run.status, run.samples.t.last().unwrap()));
    }
    let (found, mut wanted) = (events_of(&run), case.events.clone());
    let mut listed = found.clone();
    if case.nested {
        listed.truncate(3);
        wanted.truncate(3);
    }
    let list = |events: &[Event]| events.iter().map(|it| (it.0, it.2)).collect::<Vec<_>>();
    if list(&listed) != list(&wanted) {
        return Err(format!("{found:?} instead of {wanted:?}"));
    }
    let mut worst = [0.0_f64; 3];
    for (one, other) in listed.iter().zip(&wanted) {
        let which = if one.0 == "zeno" { 1 } else { 2 };
        worst[which] = worst[which].max((one.1 - other.1).abs() / tol);
    }
    let (n, size) = (case.q0.len(), case.q0.len() + case.e.len());
    let last = run.samples.x.len() - size;
    let state = run.samples.x[last..][..n].iter().chain(&run.samples.v[last..][..n]);
    for (one, other) in state.zip(&case.state) {
        worst[0] = worst[0].max((one - other).abs() / tol);
    }
    let mut corners = run.occurrences.iter().filter_map(|it| match it {
        Occurrence::Corner { t, .. } => Some(*t),
        _ => None,
    });
    if let (Some(wanted), Some(found)) = (case.corner, corners.next_back()) {
        worst[1] = worst[1].max((found - wanted).abs() / tol);
    } else if case.corner.is_some() {
        return Err("no corner".into());
    }
    Ok(worst)
}

fn check(cases: &[Case]) {
    let mut failures = Vec::new();
    for case in cases {
        for order in [Order::Five, Order::Eight] {
            for tol in [1e-6, 1e-9, 1e-12] {
                let label = format!("{} {order:?} {tol:e}", case.name);
                let found = errors(case, order, tol);
                println!("{label}: {found:?} {:?}", run(case, order, tol).counts);
                // rounding of 1e-14 in the steps of a run adds up
                let allowed = |most: f64| most.max(1e-13 / tol);
                match found {
                    Ok([state, zeno, _]) if state <= allowed(30.0) && zeno <= allowed(50.0) => (),
                    other => failures.push(format!("{label}: {other:?}")),
                }
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn systems_of_one_gap() {
    check(&one_gap());
}

#[test]
fn systems_of_several_gaps() {
    check(&several_gaps());
}

/// All cases.
pub(crate) fn cases() -> Vec<Case> {
    one_gap().into_iter().chain(several_gaps()).collect()
}
