//! Cost of runs of the switched method by the embedded pairs: time, evaluations, steps.
//!
//! ```text
//! switched_cost [REPETITIONS]
//! ```

use std::convert::Infallible;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::hint::black_box;
use std::time::Instant;

use zivi::{
    simulate_switched_rk, ConstantForce, Counts, Flights, LinearForce, Order, Output, Physical,
    Restitution, Silent, SwitchedIntegrator, SwitchedRk,
};

/// The measured method.
const PAIR: Flights = Flights::RungeKutta;

/// Nanoseconds of one of many calls.
fn time(repetitions: u32, mut call: impl FnMut()) -> f64 {
    call();
    let start = Instant::now();
    (0..repetitions).for_each(|_| call());
    start.elapsed().as_nanos() as f64 / f64::from(repetitions)
}

fn run(
    settings: SwitchedRk,
    force: &LinearForce,
    e: f64,
    t_end: f64,
    start: Physical,
    dense: bool,
) -> Result<Counts, Box<dyn std::error::Error>> {
    let restitution = Restitution::from_e(e)?;
    let output = Output::<Infallible> { dense, ..Output::default() };
    let span = (0.0, t_end);
    let mut force = *force;
    let run =
        simulate_switched_rk(settings, restitution, &mut force, span, start, output, &mut Silent)?;
    Ok(black_box(run).counts)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let repetitions = std::env::args().nth(1).map_or(Ok(200), |it| it.parse())?;
    let ball = LinearForce {
        stiffness: 0.0,
        damping: 0.0,
        gravity: 9.81,
        amplitude: 0.0,
        omega: TAU,
        phase: -FRAC_PI_2,
    };
    let table = LinearForce { amplitude: 14.715, ..ball };
    let oscillator = LinearForce {
        stiffness: 1.0,
        damping: 0.1,
        gravity: 0.0,
        amplitude: 1.0,
        omega: 0.6,
        phase: 0.0,
    };
    let cases = [
        ("ball, one Zeno point", ball, 0.418_439_716, 3.0, Physical { x: 1.0, xdot: 6.0 }),
        ("vibrating table, ten Zeno points", table, 0.5, 10.0, Physical { x: 0.2, xdot: 0.0 }),
        ("oscillator that sticks", oscillator, 0.5, 30.0, Physical { x: 0.5, xdot: 0.0 }),
    ];
    for (name, force, e, t_end, start) in cases {
        for order in [Order::Five, Order::Eight] {
            for tol in [1e-6, 1e-10] {
                for dense in [false, true] {
                    let settings = SwitchedRk { order, flights: PAIR, ..SwitchedRk::with_tol(tol) };
                    let counts = run(settings, &force, e, t_end, start, dense)?;
                    let cost = time(repetitions, || {
                        let _ = run(settings, &force, e, t_end, start, dense);
                    });
                    let Counts { nfev, accepted, rejected, impacts } = counts;
                    println!(
                        "{name}, {order:?}, tol {tol:e}, dense {dense}: {:.1} us, {nfev} \
                         evaluations, {accepted} + {rejected} steps, {impacts} impacts",
                        cost / 1e3
                    );
                }
            }
        }
    }
    for order in [Order::Five, Order::Eight] {
        let settings =
            SwitchedRk { order, first_step: Some(1e-3), flights: PAIR, ..SwitchedRk::default() };
        let mut plant = SwitchedIntegrator::new(settings, Restitution::from_e(0.5)?)?;
        plant.start(0.0, Physical { x: 1e6, xdot: 0.0 })?;
        let mut k = 0;
        let flight = time(100 * repetitions, || {
            k += 1;
            let u = &mut ConstantForce(black_box(-9.81));
            let _ = plant.advance_to::<Infallible, _>(f64::from(k) * 1e-3, u);
        });
        plant.start(0.0, Physical::default())?;
        k = 0;
        let rest = time(100 * repetitions, || {
            k += 1;
            let u = &mut ConstantForce(black_box(-9.81));
            let _ = plant.advance_to::<Infallible, _>(f64::from(k) * 1e-3, u);
        });
        println!("a period of 1 ms under a held force, {order:?}: {flight:.0} ns in flight, {rest:.0} ns at rest");
    }
    Ok(())
}
