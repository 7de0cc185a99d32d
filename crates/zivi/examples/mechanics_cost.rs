//! Cost of an evaluation in a run of a mechanical system with three coordinates and gaps.
//!
//! `cargo run --release -p zivi --example mechanics_cost`

use std::convert::Infallible;
use std::time::Instant;

use zivi::mechanics::{simulate_mechanical, MechanicalOutput};
use zivi::system::dynamics::{FunctionDynamics, Layout};
use zivi::system::impact_law::newton_impacts;
use zivi::{Order, Silent, SwitchedRk};

/// Three balls above each other on a vibrating floor.
fn tower(t: f64, q: &[f64], _: &[f64], out: &mut [f64]) -> Result<(), Infallible> {
    const MASSES: [f64; 3] = [2.0, 1.0, 0.7];
    let (sin, cos) = (11.0 * t).sin_cos();
    out.fill(0.0);
    for i in 0..3 {
        out[4 * i] = MASSES[i];
        out[9 + i] = -9.81 * MASSES[i];
    }
    out[12..15].copy_from_slice(&[q[0] - 0.12 * sin, q[1] - q[0], q[2] - q[1]]);
    (out[15], out[18], out[19], out[22], out[23]) = (1.0, -1.0, 1.0, -1.0, 1.0);
    (out[24], out[27]) = (0.12 * 121.0 * sin, -0.12 * 11.0 * cos);
    Ok(())
}

fn main() {
    let runs = std::env::args().nth(1).and_then(|it| it.parse().ok()).unwrap_or(200);
    for (order, tol) in [(Order::Eight, 1e-6), (Order::Eight, 1e-9), (Order::Five, 1e-6)] {
        let settings = SwitchedRk { order, ..SwitchedRk::with_tol(tol) };
        let (mut evaluations, start) = (0, Instant::now());
        for _ in 0..runs {
            let layout = Layout::smooth(3, 3);
            let mut system = FunctionDynamics { layout, function: tower };
            let run = simulate_mechanical(
                settings,
                &mut system,
                &newton_impacts(&[0.3, 0.2, 0.3]).unwrap(),
                (0.0, 2.0),
                (&[0.2, 0.5, 0.9], &[0.0; 3]),
                MechanicalOutput::default(),
                &mut Silent,
            );
            evaluations += run.map_or(0, |run| run.counts.nfev);
        }
        let seconds = start.elapsed().as_secs_f64();
        println!(
            "{order:?} {tol:e}: {:.2} ms a run, {:.2} us an evaluation",
            1e3 * seconds / f64::from(runs),
            1e6 * seconds / evaluations as f64
        );
    }
}
