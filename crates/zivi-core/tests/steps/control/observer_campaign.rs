//! The observer of positions on masses that are kicked, seen by a sensor with outliers and gaps, in
//! several units, with a wrong restitution. The masses move by a recursion of their own.

use crate::common::Rng;
use zivi_core::observer::{ImpactObserver, Measurement, ObserverSettings};
use zivi_core::Restitution;

/// The state `left` seconds later under the acceleration `a < 0`, and whether it rests.
fn moved((mut x, mut v): (f64, f64), a: f64, e: f64, mut left: f64) -> (f64, f64) {
    for _ in 0..200 {
        let root = (v * v - 2.0 * a * x).max(0.0).sqrt();
        let t = (v + root) / -a;
        if t > left {
            return ((x + left * (v + 0.5 * a * left)).max(0.0), v + a * left);
        }
        (x, v, left) = (0.0, e * root, left - t);
        if 2.0 * v <= left * (1.0 - e) * -a {
            return (0.0, 0.0);
        }
    }
    (0.0, 0.0)
}

/// Normal, by the central limit of twelve.
fn normal(rng: &Rng) -> f64 {
    (0..12).map(|_| rng.unit()).sum::<f64>() - 6.0
}

/// What happens to a mass and to what is seen of it.
#[derive(Clone, Copy, Debug)]
struct Trouble {
    kick: f64,
    outliers: f64,
    missing: f64,
    /// 50 of every 200 samples are missing.
    gaps: bool,
    /// What the observer believes of e beyond the truth.
    wrong_e: f64,
    learn: Option<f64>,
}

const NONE: Trouble =
    Trouble { kick: 0.0, outliers: 0.0, missing: 0.0, gaps: false, wrong_e: 0.0, learn: None };

/// Units of length and time.
type Units = (f64, f64);

#[derive(Clone, Copy, Debug)]
struct Row {
    /// In metres and seconds: truth and estimates.
    v: f64,
    v_est: f64,
    d_est: f64,
    e_est: f64,
    kicked: bool,
    flies: bool,
}

struct Run {
    d: f64,
    e: f64,
    rows: Vec<Row>,
}

const H: f64 = 1e-3;
const SIGMA: f64 = 1e-4;

/// A run of 2.5 s, as far as the mass still bounces by 2 cm.
fn run(seed: u64, trouble: Trouble, (length, time): Units) -> Run {
    let rng = Rng::new(seed);
    let (e, d) = (rng.between(0.3, 0.9), rng.between(-2.0, 2.0));
    let (mut state, known) = ((rng.between(0.5, 2.5), rng.between(-3.0, 3.0)), -9.81);
    let believed = (e + trouble.wrong_e).clamp(0.05, 0.98);
    let wall = Restitution::from_e(believed).expect("in range");
    let unit = length / (time * time);
    let settings = ObserverSettings::new(wall, H * time)
        .and_then(|it| it.with_noise(SIGMA * length, 1e-2 * length / time))
        .and_then(|it| it.with_force(1e-3 * unit * unit, 5.0 * unit))
        .and_then(|it| it.with_restitution_error(trouble.learn.unwrap_or(0.0)))
        .and_then(|it| it.with_learning(trouble.learn.is_some(), 0.0));
    let mut it = ImpactObserver::new(settings.expect("in range").with_position_only(true));
    let mut rows: Vec<Row> = Vec::new();
    let kick_at = 200 + (rng.unit() * 600.0) as usize;
    let mut kicked = false;
    for k in 0..2500 {
        if k > 0 {
            state = moved(state, known + d, e, H);
        }
        let kicks = !kicked && trouble.kick > 0.0 && k >= kick_at && state.0 > 0.05;
        if kicks {
            state.1 += rng.sign() * trouble.kick;
            kicked = true;
        }
        let mut x = state.0 + SIGMA * normal(&rng);
        if rng.chance(trouble.outliers) {
            x += rng.between(-1.0, 1.0);
        }
        let misses = rng.chance(trouble.missing) || (trouble.gaps && k % 200 >= 150);
        let measured = (!misses).then_some(Measurement { x: x * length, xdot: None });
        let found = it.tick_after(H * time, measured, known * unit, 0.0).expect("finite");
        let energy = state.0 + 0.5 * state.1 * state.1 / 9.81;
        rows.push(Row {
            v: state.1,
            v_est: found.state.xdot * time / length,
            d_est: found.d / unit,
            e_est: it.state().e,
            kicked: kicks,
            flies: energy > 0.02,
        });
    }
    Run { d, e, rows }
}

impl Run {
    /// Longest time in samples in flight without a velocity within 0.5 m/s, from the start on.
    fn longest_lost(&self) -> usize {
        let (mut now, mut most) = (0, 0);
        for row in self.rows.iter().filter(|row| row.flies) {
            now = if (row.v - row.v_est).abs() > 0.5 { now + 1 } else { 0 };
            most = most.max(now);
        }
        most
    }

    /// Samples after the kick from which on the velocity is known.
    fn known_after_kick(&self) -> Option<usize> {
        let at = self.rows.iter().position(|row| row.kicked)?;
        let flight = self.rows[at..].iter().take_while(|row| row.flies);
        // but for single samples on the other side of an impact
        let wrong: Vec<bool> = flight.map(|row| (row.v - row.v_est).abs() > 0.5).collect();
        let last = wrong.windows(3).rposition(|it| it.iter().all(|it| *it));
        Some(last.map_or(0, |it| it + 3))
    }

    /// Root mean squares of the errors of velocity and force in the second half of the bouncing.
    fn errors(&self) -> [f64; 2] {
        let moving: Vec<&Row> = self.rows.iter().filter(|row| row.flies).collect();
        let late = &moving[moving.len() / 2..];
        let rms = |of: fn(&Row, f64) -> f64| {
            let sum: f64 = late.iter().map(|row| of(row, self.d).powi(2)).sum();
            (sum / late.len() as f64).sqrt()
        };
        [rms(|row, _| row.v - row.v_est), rms(|row, d| row.d_est - d)]
    }
}

trait Windows {
    fn rposition(self, test: impl FnMut(&[bool]) -> bool) -> Option<usize>;
}

impl Windows for std::slice::Windows<'_, bool> {
    fn rposition(self, mut test: impl FnMut(&[bool]) -> bool) -> Option<usize> {
        let all: Vec<&[bool]> = self.collect();
        (0..all.len()).rev().find(|k| test(all[*k]))
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

const SI: Units = (1.0, 1.0);

fn campaign(runs: u64) {
    for kick in [3.0, 5.0, 10.0, 20.0, 30.0, 100.0] {
        let all: Vec<Run> = (0..runs).map(|seed| run(seed, Trouble { kick, ..NONE }, SI)).collect();
        let late: Vec<usize> = all.iter().filter_map(Run::known_after_kick).collect();
        let lost = all.iter().filter(|it| it.longest_lost() > 30).count();
        println!("kick {kick}: known after at most {:?}, lost {lost} of {runs}", late.iter().max());
    }
    for outliers in [0.05, 0.1, 0.2, 0.4] {
        let all: Vec<Run> =
            (0..runs).map(|seed| run(seed, Trouble { outliers, ..NONE }, SI)).collect();
        let lost = all.iter().filter(|it| it.longest_lost() > 30).count();
        let worst = all.iter().map(|it| it.errors()[0]).fold(0.0, f64::max);
        let middle = median(all.iter().map(|it| it.errors()[0]).collect());
        println!("outliers {outliers}: lost {lost} of {runs}, rms {middle:.1e}, worst {worst:.2}");
    }
    for missing in [0.0, 0.05, 0.2, 0.5, 0.8, -1.0_f64] {
        let trouble = Trouble { missing: missing.max(0.0), gaps: missing < 0.0, ..NONE };
        let all: Vec<Run> = (0..runs).map(|seed| run(seed, trouble, SI)).collect();
        let middle = median(all.iter().map(|it| it.errors()[0]).collect());
        let worst = all.iter().map(|it| it.errors()[0]).fold(0.0, f64::max);
        println!("missing {missing}: rms {middle:.1e}, worst {worst:.2}");
    }
    for (wrong_e, learn) in
        [(0.0, None), (0.03, Some(0.1)), (-0.08, Some(0.1)), (0.15, Some(0.1)), (0.05, None)]
    {
        let trouble = Trouble { wrong_e, learn, ..NONE };
        let all: Vec<Run> = (0..runs).map(|seed| run(seed, trouble, SI)).collect();
        let of = |k: usize| median(all.iter().map(|it| it.errors()[k]).collect());
        let off = |it: &Run| {
            let last = it.rows.iter().rfind(|row| row.flies).map_or(0.0, |row| row.e_est);
            (last - it.e).abs()
        };
        let worst = all.iter().map(off).fold(0.0, f64::max);
        let middle = median(all.iter().map(off).collect());
        println!("e wrong by {wrong_e}, {learn:?}: rms {:.1e}, {:.1e}, e {middle:.1e}, worst {worst:.1e}", of(0), of(1));
    }
}

#[test]
#[ignore = "some minutes"]
fn print_campaign() {
    campaign(1000);
}
