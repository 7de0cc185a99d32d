//! Runs with and without derivatives, for callgrind: `sensitivity_cost <case> <repetitions>`.
//!
//! The sticking oscillator of `tests/data/orbit_references.json` (two Zeno points, two lift-offs), by
//! Runge-Kutta. Cases: `plain`, `1`, `3`, `10` columns; with `slow-` in front a force of ten
//! exponentials more, which takes over 100 ns.

use std::convert::Infallible;
use std::hint::black_box;

use zivi::switched::sensitivity::{sensitivity, Question, Wrt};
use zivi::system::slopes::{DifferentiableForce, Place, Slopes};
use zivi::{
    simulate_switched_rk, Flights, Force, LinearForce, Output, Physical, Restitution, Silent,
    SwitchedRk,
};

const LAW: LinearForce = LinearForce {
    stiffness: 1.0,
    damping: 0.1,
    gravity: 0.4,
    amplitude: 0.9,
    omega: 0.7,
    phase: 0.0,
};
const START: Physical = Physical { x: 1.0, xdot: 0.0 };
const SPAN: (f64, f64) = (0.0, 22.0);
const E: f64 = 0.5;

/// The columns, in the order in which they are taken.
const COLUMNS: [Wrt; 10] = [
    Wrt::X0,
    Wrt::Xdot0,
    Wrt::E,
    Wrt::T0,
    Wrt::Parameter(0),
    Wrt::Parameter(1),
    Wrt::Parameter(2),
    Wrt::Parameter(3),
    Wrt::Parameter(4),
    Wrt::Parameter(5),
];

/// `1e-6 sum_k exp(-k x)` more than a linear force.
struct Slow(LinearForce);

impl Slow {
    fn sum(x: f64, power: i32) -> f64 {
        (1..=10).map(f64::from).map(|k| 1e-6 * (-k).powi(power) * (-k * x).exp()).sum()
    }
}

impl Force<Infallible> for Slow {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, Infallible> {
        Ok(Force::<Infallible>::at(&mut self.0, t, x, xdot)? + Self::sum(x, 0))
    }
}

impl DifferentiableForce<Infallible> for Slow {
    fn parameters(&self) -> usize {
        6
    }

    fn slopes(
        &mut self,
        at: Place,
        by_time: bool,
        by: &[usize],
        out: &mut [f64],
    ) -> Result<Slopes, Infallible> {
        let own: Slopes =
            DifferentiableForce::<Infallible>::slopes(&mut self.0, at, by_time, by, out)?;
        Ok(Slopes { x: own.x + Self::sum(at.x, 1), ..own })
    }
}

/// One run; steps that were taken.
fn run<F: DifferentiableForce<Infallible>>(
    force: &mut F,
    columns: Option<usize>,
) -> Result<u64, Box<dyn std::error::Error>> {
    let settings = SwitchedRk { flights: Flights::RungeKutta, ..SwitchedRk::with_tol(1e-6) };
    let restitution = Restitution::from_e(E)?;
    let Some(m) = columns else {
        let output = Output::default();
        let run =
            simulate_switched_rk(settings, restitution, force, SPAN, START, output, &mut Silent)?;
        return Ok(run.counts.accepted);
    };
    let question =
        Question { wrt: &COLUMNS[..m], sizes: &[1.0; 10][..m], controlled: true, times: &[] };
    let output = Output::default();
    let (run, derivatives) =
        sensitivity(settings, restitution, force, SPAN, START, output, &question, &mut Silent)?;
    black_box(derivatives.q);
    Ok(run.counts.accepted)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let case = arguments.next().ok_or("which case?")?;
    let repetitions: usize = arguments.next().ok_or("how often?")?.parse()?;
    let (slow, kind) = match case.strip_prefix("slow-") {
        Some(kind) => (true, kind),
        None => (false, case.as_str()),
    };
    let columns = if kind == "plain" { None } else { Some(kind.parse()?) };
    let mut steps = 0;
    for _ in 0..repetitions {
        let law = black_box(LAW);
        steps = if slow { run(&mut Slow(law), columns)? } else { run(&mut law.clone(), columns)? };
    }
    println!("{steps} steps");
    Ok(())
}
