//! Time of a batch of balls: a driver for `benchmarks/`.
//!
//! ```text
//! batch_time BALLS STEPS THREADS REPETITIONS
//! ```
//!
//! Prints the nanoseconds per ball and step of each repetition.

use std::time::Instant;

use zivi::drive::batch::{simulate_batch, Member, Save, Task};
use zivi::{ConstantForce, FixedSteps, Physical, Restitution, Silent, ThetaGamma};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let numbers: Vec<usize> =
        std::env::args().skip(1).map(|it| it.parse()).collect::<Result<_, _>>()?;
    let &[balls, steps, threads, repetitions] = numbers.as_slice() else {
        return Err("expected BALLS STEPS THREADS REPETITIONS".into());
    };
    let restitution = Restitution::from_kappa(0.41)?;
    let method = FixedSteps { h: 1e-3, scheme: ThetaGamma::implicit_euler() }.into();
    let task = Task { method, span: (0.0, 1e-3 * steps as f64), slowest: 1e-3 };
    let members: Vec<_> = (0..balls)
        .map(|i| Member {
            law: restitution.into(),
            force: ConstantForce(-9.81),
            initial: Physical { x: 1.0 + 1e-4 * i as f64, xdot: 6.0 },
            tstops: &[],
            kicks: &[],
        })
        .collect();
    for _ in 0..repetitions {
        let start = Instant::now();
        let ends = simulate_batch(&members, task, Save::Final, threads, &mut Silent)
            .map_err(|error| format!("{error:?}"))?;
        let took = start.elapsed().as_secs_f64();
        assert_eq!(ends.len(), balls);
        println!("{:.3}", took * 1e9 / (balls * steps) as f64);
    }
    Ok(())
}
