//! One kind of step, many times: a driver for counting instructions (`benchmarks/instructions.py`).
//!
//! ```text
//! step_cost CASE REPETITIONS
//! ```
//!
//! Two counts with different repetitions differ by the cost of the steps between them.

use std::hint::black_box;

use zivi::{
    ConstantForce, Force, Grid, Lifted, LinearForce, MoreauJean, Physical, Restitution, Scheme,
    SetupError, Silent, ThetaGamma,
};
use zivi_core::{Case, StepFailure, StepSolution, ThetaGammaStep};

const H: f64 = 1e-3;
const GRAVITY: f64 = -9.81;

/// A soft spring and gravity, both towards the wall.
const SPRING: LinearForce = LinearForce {
    stiffness: 1e-6,
    damping: 1e-6,
    gravity: 9.81,
    amplitude: 0.0,
    omega: 0.0,
    phase: 0.0,
};

/// Name, state, force and the case that the step must take.
const STEPS: [(&str, Lifted, f64, Case); 7] = [
    ("flight", Lifted { s: 1.0, v: 5.0 }, GRAVITY, Case::Regular),
    ("crossing", Lifted { s: 1e-3, v: -5.0 }, GRAVITY, Case::Regular),
    ("wall", Lifted { s: 5.5e-6, v: -0.005 }, GRAVITY, Case::Wall),
    ("apex", Lifted { s: 1.0, v: 0.009 }, GRAVITY, Case::Apex),
    ("stop", Lifted { s: 0.0, v: 0.005 }, GRAVITY, Case::Origin),
    ("rest", Lifted { s: 0.0, v: 0.0 }, GRAVITY, Case::Origin),
    ("selection", Lifted { s: 1e-6, v: -1e-4 }, 2.0, Case::Regular),
];

#[inline(never)]
fn solve(step: &ThetaGammaStep, z: Lifted, f: f64) -> Result<StepSolution, StepFailure> {
    step.solve(z, f, 1.0)
}

#[inline(never)]
fn residual(step: &ThetaGammaStep, z: Lifted, f: f64) -> f64 {
    step.vi_residual(z, f, [1.0, 1.0])
}

/// The calls alone: what is to be subtracted.
#[inline(never)]
fn nothing(_: &ThetaGammaStep, _: Lifted, f: f64) -> f64 {
    f
}

/// A run with a record, high enough to stay in flight.
fn record<F>(
    scheme: impl Scheme,
    restitution: Restitution,
    mut force: F,
    grid: Grid,
) -> Result<(), SetupError>
where
    F: Force<std::convert::Infallible>,
{
    let start = Physical { x: 1e6, xdot: 5.0 };
    black_box(scheme.run(restitution, &mut force, grid, start, &mut Silent)?);
    Ok(())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, case, count] = arguments.as_slice() else {
        return Err("usage: step_cost CASE REPETITIONS".into());
    };
    let repetitions: u32 = count.parse()?;
    let restitution = Restitution::from_kappa(0.41)?;
    let step = ThetaGammaStep::new(H, 1.0, 1.0, restitution)?;
    let (up, f) = (Lifted { s: 1.0, v: 5.0 }, GRAVITY);
    let grid = Grid::new(0.0, f64::from(repetitions) * H, H);
    match case.as_str() {
        "nothing" => (0..repetitions).for_each(|_| {
            black_box(nothing(black_box(&step), black_box(up), black_box(f)));
        }),
        "residual" => (0..repetitions).for_each(|_| {
            black_box(residual(black_box(&step), black_box(up), black_box(f)));
        }),
        // "-linear": beside a spring and a damper
        "recorded" => record(ThetaGamma::implicit_euler(), restitution, ConstantForce(f), grid?)?,
        "recorded-linear" => record(ThetaGamma::implicit_euler(), restitution, SPRING, grid?)?,
        "moreau" => record(MoreauJean::MIDPOINT, restitution, ConstantForce(f), grid?)?,
        "moreau-linear" => record(MoreauJean::MIDPOINT, restitution, SPRING, grid?)?,
        name => {
            let known = STEPS.iter().find(|it| it.0 == name);
            let &(_, z, f, expected) = known.ok_or("unknown case")?;
            let taken = step.solve(z, f, 1.0).map_err(|failure| format!("{failure:?}"))?;
            if taken.case != expected {
                return Err(format!("{name}: took {taken:?}, not {expected:?}").into());
            }
            (0..repetitions).for_each(|_| {
                let _ = black_box(solve(black_box(&step), black_box(z), black_box(f)));
            });
        }
    }
    Ok(())
}
