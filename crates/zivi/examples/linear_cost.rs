//! Cost of 60 s of a forced impact sequence between two stops, integrated exactly and by the pair.
//!
//! `cargo run --release -p zivi --example linear_cost 20`

use std::convert::Infallible;
use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::Instant;

use zivi::mechanics::{simulate_mechanical, MechanicalOutput};
use zivi::system::impact_law::newton_impacts;
use zivi::system::linear_dynamics::LinearDynamics;
use zivi::system::linear_system::{GapMotion, LinearGap, LinearSystem, LoadWave};
use zivi::{Flights, Silent, SwitchedRk};

/// A chain of `n` equal masses whose first is tied to the ground and whose last is shaken between two
/// stops: first frequency 1 Hz, damping 2 % there.
fn chain(n: usize, hertz: f64) -> LinearSystem {
    let lowest = 2.0 - 2.0 * (TAU / 4.0 / (n as f64 + 0.5)).cos();
    let spring = TAU * TAU / lowest;
    let at = |i: usize, j: usize| match (i.abs_diff(j), i + 1 == n) {
        (0, true) => spring,
        (0, false) => 2.0 * spring,
        (1, _) => -spring,
        _ => 0.0,
    };
    let stiffness: Vec<f64> = (0..n * n).map(|k| at(k / n, k % n)).collect();
    let damping = stiffness.iter().map(|k| 0.04 / TAU * k).collect();
    let mass = (0..n * n).map(|k| f64::from(u8::from(k / n == k % n))).collect();
    let last =
        |value: f64| (0..n).map(|i| if i + 1 == n { value } else { 0.0 }).collect::<Vec<_>>();
    let wave = LoadWave { amplitude: last(30.0), omega: TAU * hertz, phase: 0.0 };
    let gap = |side: f64| LinearGap { normal: last(side), offset: 0.02, motion: GapMotion::Fixed };
    LinearSystem {
        mass,
        damping,
        stiffness,
        load: vec![0.0; n],
        waves: vec![wave],
        tables: vec![],
        gaps: vec![gap(-1.0), gap(1.0)],
    }
}

fn main() {
    let argument = |k: usize| std::env::args().nth(k);
    let n = argument(1).and_then(|it| it.parse().ok()).unwrap_or(20);
    let runs = argument(2).and_then(|it| it.parse().ok()).unwrap_or(5);
    let pair = argument(3).is_none();
    for hertz in [0.8, 1.7, 3.1] {
        let system = Arc::new(chain(n, hertz));
        for flights in [Flights::Auto, Flights::RungeKutta] {
            if flights == Flights::RungeKutta && !pair {
                continue;
            }
            let settings = SwitchedRk { flights, ..SwitchedRk::with_tol(1e-6) };
            let (mut best, mut counts) = (f64::INFINITY, String::new());
            for _ in 0..if flights == Flights::Auto { runs } else { 1 } {
                let start = Instant::now();
                let mut dynamics = LinearDynamics::new(system.clone());
                let zero = vec![0.0; n];
                let output =
                    MechanicalOutput { t_eval: Some(&[60.0]), ..MechanicalOutput::default() };
                let run = simulate_mechanical::<Infallible, _>(
                    settings,
                    &mut dynamics,
                    &newton_impacts(&[0.6, 0.6]).unwrap(),
                    (0.0, 60.0),
                    (&zero, &zero),
                    output,
                    &mut Silent,
                );
                best = best.min(start.elapsed().as_secs_f64());
                if let Ok(run) = run {
                    counts = format!("{:?} {}", run.counts, run.occurrences.len());
                }
            }
            println!("{hertz} Hz {flights:?}: {:.2} ms, {counts}", 1e3 * best);
        }
    }
}
