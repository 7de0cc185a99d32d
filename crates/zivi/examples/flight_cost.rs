//! Flights under linear forces, for counting instructions and for timing.
//!
//! ```text
//! flight_cost CASE REPETITIONS
//! ```

use std::convert::Infallible;
use std::hint::black_box;
use std::time::Instant;

use zivi::{
    simulate_switched_rk, Flights, ImpactMap, LinearForce, Output, Physical, Quantity, Restitution,
    Silent, SwitchedIntegrator, SwitchedRk,
};

type Failed = Box<dyn std::error::Error>;

/// The impact oscillator: one impact in each of its periods, nearly.
const OSCILLATOR: LinearForce = LinearForce {
    stiffness: 1.0,
    damping: 0.1,
    gravity: -1.0,
    amplitude: 0.6,
    omega: 0.9,
    phase: 0.0,
};
/// A table that shakes the ball, chaotic.
const TABLE: LinearForce = LinearForce {
    stiffness: 0.0,
    damping: 0.0,
    gravity: 9.81,
    amplitude: 14.0,
    omega: 30.0,
    phase: 0.0,
};

/// A constant force away from the wall.
const FREE: LinearForce = LinearForce {
    stiffness: 0.0,
    damping: 0.0,
    gravity: -1.0,
    amplitude: 0.0,
    omega: 0.0,
    phase: 0.0,
};

/// Stored data of a run.
#[derive(Clone, Copy, PartialEq)]
enum Sampling {
    /// Impacts alone.
    Impacts,
    /// And the ends of steps.
    Steps,
    /// And the motion as a function of time.
    Dense,
    /// And the positions that draw it.
    Positions,
    /// And all quantities of the samples that draw it.
    Drawn,
}

/// A run of a number of periods.
fn run(
    mut force: LinearForce,
    e: f64,
    flights: Flights,
    periods: u32,
    sampling: Sampling,
) -> Result<f64, Failed> {
    let span = (0.0, f64::from(periods) * std::f64::consts::TAU / force.omega);
    let settings = SwitchedRk { flights, max_steps: usize::MAX, ..SwitchedRk::with_tol(1e-6) };
    let start = Physical { x: 1.0, xdot: 0.0 };
    let t_eval = (sampling == Sampling::Impacts).then_some(&[][..]);
    let dense = !matches!(sampling, Sampling::Impacts | Sampling::Steps);
    let drawn = sampling == Sampling::Drawn;
    let output = Output::<Infallible> { t_eval, dense, drawn, ..Output::default() };
    let restitution = Restitution::from_e(e)?;
    let run =
        simulate_switched_rk(settings, restitution, &mut force, span, start, output, &mut Silent)?;
    if let (Some(path), Sampling::Positions) = (&run.path, sampling) {
        let steps = Quantity::ALL.map(|it| run.trajectory.columns.of(it));
        let samples = path.plot_samples([steps[0], steps[1]]).ok_or("no memory")?;
        black_box(samples.column(Quantity::X, path, steps, restitution));
    }
    Ok(black_box(run).trajectory.events.impacts.len() as f64)
}

/// So many impacts by the map.
fn map(e: f64, impacts: u32, tangent: bool) -> Result<f64, Failed> {
    let map = ImpactMap::new(&OSCILLATOR, Restitution::from_e(e)?)?;
    if tangent {
        let (mut phase, mut u) = (1.0, 1.0);
        for _ in 0..impacts {
            let (next, jacobian) = map.with_jacobian(phase, u);
            black_box(jacobian);
            (phase, u) = (next.phase, next.u);
        }
        return Ok(u);
    }
    let mut last = [[0.0; 2]];
    map.orbit(1.0, 1.0, impacts as usize, &mut last);
    Ok(last[0][1])
}

/// So many periods of 10 ms of a sampled loop.
fn sampled(force: LinearForce, flights: Flights, periods: u32) -> Result<f64, Failed> {
    const H: f64 = 0.01;
    let settings = SwitchedRk { flights, first_step: Some(H), ..SwitchedRk::with_tol(1e-6) };
    let mut plant = SwitchedIntegrator::new(settings, Restitution::from_e(0.8)?)?;
    plant.start(0.0, Physical { x: 1.0, xdot: 0.0 })?;
    for k in 1..=periods {
        let mut held = force;
        held.gravity -= 0.01 * plant.state().xdot;
        if plant.advance_to::<Infallible, _>(f64::from(k) * H, &mut held).is_err() {
            return Err("the loop ended early".into());
        }
    }
    Ok(plant.state().x)
}

/// So many short runs, under four laws in turns.
fn alternating(runs: u32) -> Result<f64, Failed> {
    (0..runs).try_fold(0.0, |impacts, k| {
        let force = LinearForce { stiffness: 1.0 + f64::from(k % 4), ..OSCILLATOR };
        Ok(impacts + run(force, 0.8, Flights::Series, 1, Sampling::Impacts)?)
    })
}

fn main() -> Result<(), Failed> {
    let mut arguments = std::env::args().skip(1);
    let case = arguments.next().unwrap_or_default();
    let n: u32 = arguments.next().map_or(Ok(1000), |it| it.parse())?;
    let start = Instant::now();
    let result = match case.as_str() {
        "oscillator" => run(OSCILLATOR, 0.8, Flights::Series, n, Sampling::Impacts),
        "oscillator-rk" => run(OSCILLATOR, 0.8, Flights::RungeKutta, n, Sampling::Impacts),
        "steps" => run(OSCILLATOR, 0.8, Flights::Series, n, Sampling::Steps),
        "steps-rk" => run(OSCILLATOR, 0.8, Flights::RungeKutta, n, Sampling::Steps),
        "dense" => run(OSCILLATOR, 0.8, Flights::Series, n, Sampling::Dense),
        "positions" => run(OSCILLATOR, 0.8, Flights::Series, n, Sampling::Positions),
        "positions-rk" => run(OSCILLATOR, 0.8, Flights::RungeKutta, n, Sampling::Positions),
        "drawn" => run(OSCILLATOR, 0.8, Flights::Series, n, Sampling::Drawn),
        "drawn-rk" => run(OSCILLATOR, 0.8, Flights::RungeKutta, n, Sampling::Drawn),
        "table" => run(TABLE, 0.85, Flights::Series, n, Sampling::Impacts),
        "table-rk" => run(TABLE, 0.85, Flights::RungeKutta, n, Sampling::Impacts),
        "map" => map(0.8, n, false),
        "tangent" => map(0.8, n, true),
        "sampled" => sampled(OSCILLATOR, Flights::Series, n),
        "sampled-rk" => sampled(OSCILLATOR, Flights::RungeKutta, n),
        "sampled-free" => sampled(FREE, Flights::Series, n),
        "alternating" => alternating(n),
        other => Err(format!("unknown case {other:?}").into()),
    }?;
    let each = start.elapsed().as_nanos() as f64 / f64::from(n);
    println!("{case}: {result}, {each:.1} ns each");
    Ok(())
}
