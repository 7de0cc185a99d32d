//! Updates of one kind, for counting their instructions with callgrind.
//!
//! ```text
//! tick_cost CASE COUNT
//! ```
//!
//! Only what is done inside `one_tick` is to be counted; the total divided by COUNT is the mean,
//! and a dump after every call gives each update's own count, the same on every run of one build:
//!
//! ```text
//! cargo build --release --package zivi-core --example tick_cost
//! valgrind --tool=callgrind --collect-atstart=no --toggle-collect='*::one_tick' \
//!     --callgrind-out-file=/dev/null target/release/examples/tick_cost wide 2500
//! valgrind --tool=callgrind --collect-atstart=no --toggle-collect='*::one_tick' \
//!     --dump-after='*::one_tick' --callgrind-out-file=updates target/release/examples/tick_cost hard 500
//! grep -h '^totals:' updates.* | sort -k2n | tail -1
//! ```

mod ticks;

use std::hint::black_box;

use ticks::{
    closed_loop, drawn, hard, observed, of_the_paper, one_tick, Controller, Failure, Rng, Tick, H,
};
use zivi_core::control::{Approach, ExplicitTwisting, TwistingRegulator};
use zivi_core::Physical;

fn count<C: Controller>(ticks: Vec<Tick<C>>) -> Result<(), Failure> {
    let mut largest: f64 = 0.0;
    for mut it in ticks {
        largest = largest.max(black_box(one_tick(black_box(&mut it)))?.abs());
    }
    println!("largest control {largest} m/s^2");
    Ok(())
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, case, number] = arguments.as_slice() else {
        return Err("usage: tick_cost CASE COUNT".into());
    };
    let number: usize = number.parse()?;
    let rng = Rng::new(101);
    let tracker = of_the_paper(Approach::Positive)?;
    let (gains, restitution) = (tracker.step().gains, tracker.step().restitution);
    match case.as_str() {
        "loop" => count(closed_loop(tracker, number)?),
        "nearest" => count(closed_loop(of_the_paper(Approach::Nearest)?, number)?),
        "regulator" => count(closed_loop(TwistingRegulator::new(gains, H, restitution)?, number)?),
        "explicit" => {
            let mut explicit = ExplicitTwisting::new(gains, H, restitution, restitution)?;
            explicit.reset(Physical { x: 3.0, xdot: 3.0 })?;
            count(closed_loop(explicit, number)?)
        }
        "observer" => count(observed(tracker, number)?),
        "hard" => count(hard(number, &rng)?),
        kind => count((0..number).map(|_| drawn(kind, &rng)).collect::<Result<_, _>>()?),
    }
}
