//! The time of a tick of the tracker, measured within one process (`benchmarks/control_times.py`).
//!
//! ```text
//! tick_time COUNT ROUNDS
//! ```
//!
//! A line for each case: its name, the mean (ns), the median and the 99.9 % quantile of the ticks,
//! and the 99.9 % quantile of all samples. The mean is that of a round over all ticks without a
//! clock between them, the median of the rounds. For the quantiles each tick is timed by itself,
//! less what the clock takes; a tick's time is its shortest over the rounds, so that what the
//! system does in between is left out, while in the last column it is not.

mod ticks;

use std::hint::black_box;
use std::time::Instant;

use ticks::{closed_loop, drawn, of_the_paper, one_tick, Failure, Rng, Tick};
use zivi_core::control::{Approach, TwistingTracker};

type Ticks = Vec<Tick<TwistingTracker>>;

fn seconds(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64()
}

fn quantile(values: &mut [f64], part: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    values[((last as f64 * part).ceil() as usize).min(last)]
}

/// The shortest time between two looks at the clock.
fn clock() -> f64 {
    let samples = (0..100_000).map(|_| seconds(|| ()));
    samples.fold(f64::INFINITY, f64::min)
}

fn take(it: &mut Tick<TwistingTracker>) {
    let _ = black_box(one_tick(black_box(it)));
}

fn report(name: &str, ticks: &Ticks, rounds: usize) {
    let clock = clock();
    let mut means = Vec::with_capacity(rounds);
    let mut shortest = vec![f64::INFINITY; ticks.len()];
    let mut all = Vec::with_capacity(rounds * ticks.len());
    for _ in 0..rounds {
        // a tick advances its controller: every round gets them as they were
        let mut fresh = ticks.clone();
        means.push(seconds(|| fresh.iter_mut().for_each(take)) / ticks.len() as f64);
        let mut fresh = ticks.clone();
        for (it, least) in fresh.iter_mut().zip(&mut shortest) {
            let took = seconds(|| take(it)) - clock;
            *least = least.min(took);
            all.push(took);
        }
    }
    let figures = [
        quantile(&mut means, 0.5),
        quantile(&mut shortest, 0.5),
        quantile(&mut shortest, 0.999),
        quantile(&mut all, 0.999),
    ];
    let [mean, median, most, with_system] = figures.map(|value| value * 1e9);
    println!("{name} {mean:.2} {median:.2} {most:.2} {with_system:.2}");
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, count, rounds] = arguments.as_slice() else {
        return Err("usage: tick_time COUNT ROUNDS".into());
    };
    let (count, rounds): (usize, usize) = (count.parse()?, rounds.parse()?);
    // the paper's loop: 2 s
    for (name, approach) in [("loop", Approach::Positive), ("nearest", Approach::Nearest)] {
        report(name, &closed_loop(of_the_paper(approach)?, 2000)?, rounds);
    }
    let rng = Rng::new(103);
    for kind in ["wide", "near", "crossing"] {
        let ticks: Result<Ticks, _> = (0..count).map(|_| drawn(kind, &rng)).collect();
        report(kind, &ticks?, rounds);
    }
    Ok(())
}
