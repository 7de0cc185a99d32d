//! The time of an update of the tracker, measured within one process (`benchmarks/control_times.py`).
//!
//! ```text
//! tick_time COUNT ROUNDS
//! tick_time steps ROUNDS < STEPS
//! ```
//!
//! The first prints a line for each case: its name, the mean (ns), the median and the 99.9 % quantile of the updates,
//! and the 99.9 % quantile of all samples. The mean is that of a round over all updates without a
//! clock between them, the median of the rounds. For the quantiles each update is timed by itself,
//! less what the clock takes; an update's time is its shortest over the rounds, so that what the
//! system does in between is left out, while in the last column it is not.
//!
//! The second prints the mean (ns) of a step of given data, the reference's and the plant's solved
//! exactly: doubles `mu1 mu2 kappa kappa_ref f f_ref h`, their number, and for each `s v s_r v_r`.

mod ticks;

use std::hint::black_box;
use std::io::Read;
use std::time::Instant;

use ticks::{closed_loop, drawn, of_the_paper, one_tick, Failure, Rng, Tick};
use zivi_core::control::tracking::{Target, Tracking, TrackingStep};
use zivi_core::control::{Approach, Gains, TwistingTracker};
use zivi_core::{Lifted, Restitution, StepFailure, ThetaGammaStep};

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

/// The shortest time between two readings of the clock.
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
        // an update advances its controller: every round gets them as they were
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

/// A step of given data: the reference's two signs, then the plant's four.
#[inline(never)]
fn both(
    reference: &ThetaGammaStep,
    step: &TrackingStep,
    (f, f_ref): (f64, f64),
    [s, v, s_ref, v_ref]: [f64; 4],
) -> Result<Tracking, StepFailure> {
    let next = reference.solve(Lifted { s: s_ref, v: v_ref }, f_ref, 1.0)?;
    let r = reference.restitution().r(next.lambda_s, next.lambda_v);
    let target = Target { end: next.end(), acceleration: next.lambda_s * f_ref / r };
    Ok(step.solve(Lifted { s, v }, f, target))
}

fn report_steps(rounds: usize) -> Result<(), Failure> {
    let mut bytes = Vec::new();
    std::io::stdin().read_to_end(&mut bytes)?;
    let (words, _) = bytes.as_chunks::<8>();
    let numbers: Vec<f64> = words.iter().map(|&word| f64::from_le_bytes(word)).collect();
    let Some((&[mu1, mu2, kappa, kappa_ref, f, f_ref, h, count], rest)) =
        numbers.split_first_chunk()
    else {
        return Err("the input ends too early".into());
    };
    let (states, _) = rest.as_chunks::<4>();
    if states.len() != count as usize {
        return Err("the input has another number of steps than it says".into());
    }
    let restitution = Restitution::from_kappa(kappa)?;
    let step = TrackingStep { h, restitution, gains: Gains::new(mu1, mu2)? };
    let reference = ThetaGammaStep::new(h, 1.0, 1.0, Restitution::from_kappa(kappa_ref)?)?;
    let mut means: Vec<f64> = (0..rounds)
        .map(|_| {
            seconds(|| {
                for state in states {
                    let _ = black_box(both(&reference, &step, (f, f_ref), *black_box(state)));
                }
            })
        })
        .collect();
    println!("{:.2}", quantile(&mut means, 0.5) / count * 1e9);
    Ok(())
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, count, rounds] = arguments.as_slice() else {
        return Err("usage: tick_time COUNT|steps ROUNDS".into());
    };
    if count == "steps" {
        return report_steps(rounds.parse()?);
    }
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
