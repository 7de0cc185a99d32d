//! Against trajectories of 28 digits.

use std::convert::Infallible;
use std::path::Path;

use serde_json::Value;
use zivi::mechanics::{simulate_mechanical, MechanicalOutput, MechanicalRun, Occurrence};
use zivi::system::impact_law::newton_impacts;
use zivi::{Order, Silent, Status, SwitchedRk};

use crate::models::{of_family, Parameters};

fn number(value: &Value) -> f64 {
    match value {
        Value::Bool(value) => f64::from(u8::from(*value)),
        value => value.as_f64().or_else(|| value.as_str()?.parse().ok()).unwrap(),
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(number).collect()
}

/// An event: kind, gap or channel, time.
type Event = (String, usize, f64);

pub(crate) struct Case {
    pub(crate) name: String,
    pub(crate) family: String,
    pub(crate) parameters: Parameters,
    pub(crate) q0: Vec<f64>,
    pub(crate) w0: Vec<f64>,
    pub(crate) span: (f64, f64),
    events: Vec<Event>,
    pub(crate) checkpoints: Vec<(f64, Vec<f64>)>,
}

pub(crate) fn cases() -> Vec<Case> {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/friction_references.json");
    let file: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let case = |case: &Value| {
        let text = |name: &str| case[name].as_str().unwrap().to_owned();
        let parameters = case["parameters"].as_object().unwrap();
        let event = |it: &Value| {
            let who = it["who"].as_array().map_or(&it["who"], |all| &all[0]);
            let who = who.as_u64().unwrap() as usize;
            (it["kind"].as_str().unwrap().to_owned(), who, number(&it["t"]))
        };
        let checkpoint = |it: &Value| (number(&it["t"]), numbers(&it["state"]));
        let mut checkpoints: Vec<_> =
            case["checkpoints"].as_array().unwrap().iter().map(checkpoint).collect();
        checkpoints.push(checkpoint(&case["end"]));
        Case {
            name: text("name"),
            family: text("family"),
            parameters: parameters.iter().map(|(k, v)| (k.clone(), number(v))).collect(),
            q0: numbers(&case["q0"]),
            w0: numbers(&case["qdot0"]),
            span: (number(&case["t0"]), number(&case["T"])),
            events: case["events"].as_array().unwrap().iter().map(event).collect(),
            checkpoints,
        }
    };
    file["cases"].as_array().unwrap().iter().map(case).collect()
}

/// Events of a run. The references list closings through infinitely many impacts only.
fn events(run: &MechanicalRun<Infallible>, e: &[f64]) -> Vec<Event> {
    let slip = |number: i8| match number {
        1 => "slip+",
        -1 => "slip-",
        _ => "stick",
    };
    let event = |it: &Occurrence| match *it {
        Occurrence::Zeno { gap, .. } if e[gap] == 0.0 => None,
        Occurrence::Zeno { t, gap, .. } => Some(("zeno".to_owned(), gap, t)),
        Occurrence::LiftOff { t, gap } => Some(("lift".to_owned(), gap, t)),
        Occurrence::Opened { t, gap } => Some(("open".to_owned(), gap, t)),
        Occurrence::Transition { t, channel, before: 2, after } => {
            Some((format!("land_{}", slip(after)), channel, t))
        }
        Occurrence::Transition { t, channel, after, .. } => {
            Some((slip(after).to_owned(), channel, t))
        }
        _ => None,
    };
    run.occurrences.iter().filter_map(event).collect()
}

fn tolerances(order: Order, tol: f64) -> SwitchedRk {
    SwitchedRk { order, rtol: tol, atol: [tol; 2], ..SwitchedRk::default() }
}

fn run(case: &Case, order: Order, tol: f64) -> MechanicalRun<Infallible> {
    run_with(case, tolerances(order, tol))
}

fn run_with(case: &Case, settings: SwitchedRk) -> MechanicalRun<Infallible> {
    let mut system = of_family(&case.family, &case.parameters);
    let e = system.e.clone();
    let times: Vec<f64> = case.checkpoints.iter().map(|it| it.0).collect();
    let output = MechanicalOutput { t_eval: Some(&times), ..MechanicalOutput::default() };
    let start = (&case.q0[..], &case.w0[..]);
    simulate_mechanical(
        settings,
        &mut system,
        &newton_impacts(&e).unwrap(),
        case.span,
        start,
        output,
        &mut Silent,
    )
    .unwrap()
}

/// The largest errors of states and times in tolerances, where the list of events is right.
fn errors(case: &Case, run: &MechanicalRun<Infallible>) -> Result<(f64, f64), String> {
    if run.status != Status::Completed {
        return Err(format!("{:?} after {:?}", run.status, run.samples.t.last()));
    }
    let e = of_family(&case.family, &case.parameters).e;
    let mut found = events(run, &e);
    found.sort_by(|a, b| a.2.total_cmp(&b.2));
    let names = |all: &[Event]| all.iter().map(|it| (it.0.clone(), it.1)).collect::<Vec<_>>();
    if names(&found) != names(&case.events) {
        return Err(format!("events {found:?}\n  instead of {:?}", case.events));
    }
    let of_times = found.iter().zip(&case.events).map(|(a, b)| (a.2 - b.2).abs());
    let (n, size) = (run.layout.n, run.layout.size());
    let mut of_states = 0.0_f64;
    for (k, (_, state)) in case.checkpoints.iter().enumerate() {
        let sample = [&run.samples.x[k * size..][..n], &run.samples.v[k * size..][..n]].concat();
        for (a, b) in sample.iter().zip(state) {
            of_states = of_states.max((a - b).abs());
        }
    }
    Ok((of_states, of_times.fold(0.0, f64::max)))
}

#[test]
fn trajectories_are_those_of_the_references() {
    let mut wrong = Vec::new();
    for case in cases() {
        for order in [Order::Five, Order::Eight] {
            for tol in [1e-6, 1e-9, 1e-11] {
                let run = run(&case, order, tol);
                let limit = if case.name.starts_with("belt") { 100.0 } else { 40.0 };
                match errors(&case, &run) {
                    Ok((x, t)) => {
                        if x.max(t) > limit * tol + 1e-12 {
                            wrong.push(format!("{} {order:?} {tol:e}: {x:e} {t:e}", case.name));
                        }
                    }
                    Err(what) => wrong.push(format!("{} {order:?} {tol:e}: {what}", case.name)),
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn steps_of_one_length_show_the_orders() {
    // the length of the longest steps of either order; they are halved
    for (name, five, eight) in
        [("rod_slide", 0.04, 0.1), ("feeder_lift", 0.02, 0.08), ("belt_stribeck", 0.08, 0.16)]
    {
        let case = cases().into_iter().find(|case| case.name == name).unwrap();
        for (order, longest, least) in [(Order::Five, five, 4.5), (Order::Eight, eight, 7.0)] {
            let error = |halvings: i32| {
                let max_step = longest / f64::from(1 << halvings);
                let settings = SwitchedRk { adaptive: false, max_step, ..tolerances(order, 1e-13) };
                errors(&case, &run_with(&case, settings)).unwrap().0
            };
            let found: Vec<f64> = (0..4).map(error).collect();
            // from the first to the last above rounding
            let last = found.iter().rposition(|&error| error > 1e-13).unwrap();
            let fitted = (found[0] / found[last]).log2() / last as f64;
            assert!(last > 0 && fitted >= least, "{name} {order:?}: {fitted} {found:?}");
        }
    }
}
