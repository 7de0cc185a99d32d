use super::*;
use super::{all_apexes, of_parabola, of_powers};
use crate::record::columns::Quantity;
use crate::switched::path::Form;
use crate::zeno::arc::Bounce;
use crate::zeno::chain::Chain;
use crate::{
    simulate_switched_rk, Flights, LinearForce, Output, Physical, Restitution, Silent, SwitchedRk,
};
use std::convert::Infallible;

/// `x'' = -2`, `e = 1/2`: flights of the heights 1/16, 1/64, ..., from 1 s on.
#[test]
fn a_tail_is_drawn_by_flat_lines_down_to_the_finest_arcs_and_up_to_its_end() {
    let mut chain = Chain::<f64>::new((), 0.5, 0, 4);
    for (t, u) in [(0.0, 1.0), (1.0, 0.5)] {
        assert!(chain.note(Bounce { t, u, g: 2.0 }, &[], &[]).is_ok());
    }
    let tail = chain.tail(2.0, 1.0);
    let drawn = |end: f64, largest: f64| {
        let mut rows = Vec::new();
        draw_tail(&tail, end, Scale { x: largest, xdot: 1.0 }, &mut rows).unwrap();
        assert!(rows.windows(2).all(|pair| pair[0][0] < pair[1][0] && pair[1][0] < end));
        let of_tail = |it: &Row| tail.at(it[0]).x == it[1] && tail.at(it[0]).xdot == it[2];
        assert!(rows.iter().all(of_tail));
        let inside = |it: &&Row| it[1] > 1e-9;
        rows.iter().filter(inside).map(|it| it[0]).collect::<Vec<f64>>()
    };
    // lines between equal parts of a second derivative of 2 are off by a quarter of their square
    for (highest, parts) in [(20.0, vec![4]), (15.0, vec![6, 4]), (1.0, vec![16, 8, 4])] {
        let (mut exact, mut start, mut length) = (Vec::new(), 1.0, 0.5);
        for n in parts {
            let part = length / f64::from(n);
            exact.extend((1..n).map(|k| start + f64::from(k) * part));
            let height = 0.25 * length * length;
            let flat = FLATNESS * height.max(LOW * highest);
            assert!(0.25 * part * part <= flat, "{highest} {n}");
            // with two parts less they are not
            let fewer = length / (f64::from(n) - 2.0);
            assert!(0.25 * fewer * fewer > flat, "{highest} {n}");
            (start, length) = (start + length, 0.5 * length);
        }
        let found = drawn(2.0, highest);
        assert_eq!(found.len(), exact.len(), "{highest} {found:?}");
        for (found, exact) in found.iter().zip(&exact) {
            assert!((found - exact).abs() < 1e-15, "{found} {exact}");
        }
    }
    assert_eq!(drawn(1.3, 1.0), drawn(2.0, 1.0)[..9]);
}

const SPRING: LinearForce = LinearForce {
    stiffness: 1.0,
    damping: 0.05,
    gravity: 0.2,
    amplitude: 0.6,
    omega: 0.9,
    phase: 0.0,
};
const TABLE: LinearForce = LinearForce {
    stiffness: 0.0,
    damping: 0.0,
    gravity: 9.81,
    amplitude: 20.0,
    omega: 6.0,
    phase: 1.0,
};
const PULL: LinearForce = LinearForce { gravity: 3.0, amplitude: 0.0, omega: 0.0, ..TABLE };
/// Beats of two rates, and a spring that pushes away.
const BEATS: LinearForce = LinearForce { stiffness: 4.0, damping: 0.0, omega: 1.9, ..SPRING };
const AWAY: LinearForce = LinearForce { stiffness: -0.2, gravity: 1.0, omega: 2.0, ..SPRING };

/// Runs of both kinds of flights: the samples, the path, times and positions of the steps.
fn runs() -> impl Iterator<Item = (PlotSamples, DensePath, [Vec<f64>; 2])> {
    let kinds = [Flights::Series, Flights::RungeKutta];
    let forces = [SPRING, TABLE, PULL, BEATS, AWAY];
    let all = forces.into_iter().flat_map(move |force| kinds.map(|kind| (force, kind)));
    all.flat_map(|it| [0.0, 0.6, 1.0].map(|e| (it, e))).map(|((mut force, flights), e)| {
        let settings = SwitchedRk { flights, ..SwitchedRk::default() };
        let (start, e) = (Physical { x: 1.0, xdot: 0.7 }, Restitution::from_e(e).unwrap());
        let output = Output::<Infallible> { dense: true, ..Output::default() };
        let span = (0.0, 30.0);
        let run = simulate_switched_rk(settings, e, &mut force, span, start, output, &mut Silent)
            .unwrap();
        let path = run.path.unwrap();
        let steps = [Quantity::T, Quantity::X].map(|it| run.trajectory.columns.of(it).to_vec());
        (path.plot_samples([&steps[0], &steps[1]]).unwrap(), path, steps)
    })
}

/// The flights between impacts and turns upwards, by a fine grid: where each starts and ends, its
/// height and the range of its velocity.
fn arcs(path: &DensePath, curves: &[(FlightCurve, f64)]) -> Vec<(f64, f64, [f64; 2])> {
    let (mut arcs, mut open) = (Vec::new(), None::<(f64, [f64; 4])>);
    for (curve, end) in curves {
        let grid = (0..=200).map(|k| curve.start + f64::from(k) / 200.0 * (end - curve.start));
        for t in grid {
            let at = curve.at(t);
            let all = [at.x, at.x, at.xdot, at.xdot];
            open = Some(open.map_or((t, all), |(from, [a, b, c, d])| {
                (from, [a.min(at.x), b.max(at.x), c.min(at.xdot), d.max(at.xdot)])
            }));
        }
        if curve.lands() || path.end.is_some_and(|(t, _)| t == *end) {
            if let Some((from, [a, b, c, d])) = open.take() {
                arcs.push((from, *end, [b - a, d - c]));
            }
        }
    }
    arcs
}

fn curves(path: &DensePath) -> Vec<(FlightCurve, f64)> {
    let last = path.end.unwrap().0;
    let ends = path.segments.iter().skip(1).map(|segment| segment.start).chain([last]);
    path.segments.iter().zip(ends).filter_map(|(it, end)| Some((path.curve(it)?, end))).collect()
}

#[test]
fn lines_through_the_samples_are_as_near_as_promised() {
    let (mut seen, mut worst) = (0, 0.0_f64);
    for (samples, path, _) in runs() {
        let curves = curves(&path);
        let arcs = arcs(&path, &curves);
        let high = arcs.iter().map(|arc| arc.2[0]).fold(0.0, f64::max);
        for pair in samples.t.windows(2) {
            let Some((curve, end)) =
                curves.iter().find(|(it, end)| it.start <= pair[0] && pair[0] < *end)
            else {
                continue;
            };
            let arc = arcs.iter().find(|arc| arc.0 <= pair[0] && pair[1] <= arc.1).unwrap();
            assert!(pair[0] < pair[1] && pair[1] <= *end);
            for k in 1..8 {
                let part = f64::from(k) / 8.0;
                let t = pair[0] + part * (pair[1] - pair[0]);
                let line =
                    |of: &dyn Fn(f64) -> f64| (1.0 - part) * of(pair[0]) + part * of(pair[1]);
                let off = (line(&|t| curve.at(t).x) - curve.at(t).x).abs();
                // more than a parabola is hardly ever between two of them
                let most = FLATNESS * arc.2[0].max(LOW * high);
                worst = worst.max(off / most);
                seen += 1;
            }
        }
    }
    assert!(seen > 50_000 && (0.8..1.05).contains(&worst), "{seen} {worst}");
}

#[test]
fn every_apex_is_a_sample_and_so_is_the_last_moment_before_an_impact() {
    let (mut apexes, mut impacts) = (0, 0);
    for (samples, path, _) in runs() {
        for (curve, end) in curves(&path) {
            let mut all = Vec::new();
            // by subdivision of the whole velocity
            all_apexes(&curve, &mut all);
            for apex in all.into_iter().filter(|&t| t > curve.start + 1e-9 && t < end - 1e-9) {
                let near = |t: &&f64| (**t - apex).abs() < 1e-10 * (1.0 + apex);
                assert!(samples.t.iter().any(|t| near(&t)), "{curve:?} {apex}");
                apexes += 1;
            }
            if curve.lands() {
                let before = samples.t.partition_point(|&t| t < end);
                let last = samples.t[before - 1];
                let ulps = (end - last) / (end - end.next_down());
                assert!(ulps <= 512.0 && curve.at(last).x > 0.0, "{end} {ulps}");
                impacts += 1;
            }
        }
    }
    assert!(apexes > 200 && impacts > 200, "{apexes} {impacts}");
}

#[test]
fn positions_are_those_of_the_path_and_steps_stay() {
    for (mut samples, path, [t, x]) in runs() {
        assert_eq!(samples.len(), samples.x.len());
        assert!(samples.len() > t.len() && !samples.is_empty());
        assert_eq!(samples.runs.iter().map(|run| run.count).sum::<usize>(), samples.len());
        for (t, x) in samples.t.iter().zip(&samples.x) {
            assert_eq!(path.at(*t).unwrap().x.to_bits(), x.to_bits(), "{t}");
        }
        for (t, x) in t.iter().zip(&x) {
            let at = samples.t.iter().position(|it| it == t).unwrap();
            assert_eq!(samples.x[at], *x);
        }
        let (all, steps) = (
            samples.x.clone(),
            Quantity::ALL.map(|it| match it {
                Quantity::T => &t[..],
                _ => &x[..],
            }),
        );
        let wall = Restitution::from_e(0.5).unwrap();
        assert_eq!(samples.column(Quantity::X, &path, steps, wall), Some(all.clone()));
        assert_eq!(samples.take_positions(), all);
        assert_eq!(samples.column(Quantity::X, &path, steps, wall), Some(all));
    }
}

/// Equal to those of a run with additional sample times there.
#[test]
fn steps_that_end_within_segments_are_sorted_in() {
    let (samples, path, [t, x]) = runs().next().unwrap();
    let between = |pair: &[f64]| pair[0] + 0.37 * (pair[1] - pair[0]);
    let mut more: Vec<f64> = samples.t.windows(2).map(between).chain(t.iter().copied()).collect();
    // one at a sample, and one twice
    more.extend([samples.t[3], t[1]]);
    more.sort_by(f64::total_cmp);
    let at: Vec<f64> = more.iter().map(|&t| path.at(t).unwrap().x).collect();
    let sorted = path.plot_samples([&more, &at]).unwrap();
    assert!(sorted.t.windows(2).all(|pair| pair[0] < pair[1]));
    let mut expected: Vec<f64> = more.iter().chain(&samples.t).copied().collect();
    expected.sort_by(f64::total_cmp);
    expected.dedup();
    assert_eq!(sorted.t, expected);
    assert!(x.iter().all(|x| sorted.x.contains(x)));
    assert!(sorted.t.iter().zip(&sorted.x).all(|(&t, &x)| path.at(t).unwrap().x == x));
}

#[test]
fn a_run_of_many_steps_is_drawn_by_fewer_samples_of_each() {
    let mut force = SPRING;
    let e = Restitution::from_e(0.7).unwrap();
    let output = Output::<Infallible> { dense: true, ..Output::default() };
    let run = simulate_switched_rk(
        SwitchedRk { max_steps: usize::MAX, ..SwitchedRk::default() },
        e,
        &mut force,
        (0.0, 60_000.0),
        Physical { x: 1.0, xdot: 0.7 },
        output,
        &mut Silent,
    )
    .unwrap();
    let steps = [Quantity::T, Quantity::X].map(|it| run.trajectory.columns.of(it));
    let path = run.path.unwrap();
    let samples = path.plot_samples(steps).unwrap();
    let added = samples.len() - steps[0].len();
    // apexes and moments before impacts are beyond the budget
    let impacts = run.trajectory.events.impacts.len();
    assert!(steps[0].len() > 40_000 && impacts > 10_000);
    assert!((added as f64) < 2.0 * BUDGET + 3.0 * impacts as f64, "{added}");
    assert!((added as f64) > 0.3 * BUDGET, "{added}");
    // the end of the run as well as its beginning
    let first = samples.t.partition_point(|&t| t < 30_000.0) as f64;
    assert!((first / samples.len() as f64 - 0.5).abs() < 0.03, "{first}");
    assert!(samples.t.windows(2).all(|pair| pair[0] < pair[1]));
}

#[test]
fn a_parabola_is_met_where_it_is_zero_and_else_in_the_middle() {
    // 1 - theta - theta^2, and one that bends the other way
    assert!((of_parabola(1.0, -1.0, -1.0) - 0.5 * (5.0_f64.sqrt() - 1.0)).abs() < 1e-15);
    // (1 - 2 theta)(1 - theta/4)
    assert!((of_parabola(1.0, -2.25, -0.75) - 0.5).abs() < 1e-15);
    assert_eq!(of_parabola(1.0, 1.0, 4.0), 0.5);
    assert_eq!(joined([0.0, 1.0], [-1.0, 0.5]), [-1.0, 1.0]);
    assert_eq!(SampleSource::Rows(3).after(2), SampleSource::Rows(5));
    assert_eq!(SampleSource::Steps(3).after(2), SampleSource::Steps(5));
}

/// `3 cos(1.75 theta + phase)`, over a step of half a second.
#[test]
fn bounds_are_little_more_than_what_they_bound() {
    const RATE: f64 = 1.75;
    for phase in (0..20).map(|k| 0.3 * f64::from(k)) {
        let (mut a, mut term) = ([0.0; TERMS], 3.0);
        for (n, a) in a.iter_mut().enumerate() {
            *a = term * (phase + n as f64 * std::f64::consts::FRAC_PI_2).cos();
            term *= RATE / (n as f64 + 1.0);
        }
        let curve = FlightCurve::powers((1.0, 0.5), 1.0, a, a[1] / 0.5, false);
        let mut apexes = Vec::new();
        let Form::Powers(a, ..) = &curve.form else { panic!("no powers") };
        let (outline, guess) = of_powers(pulp::Scalar::new(), &curve, a, &mut apexes);
        if let Some(theta) = guess {
            apexes.push(0.0);
            let mut guesses = Guesses::NONE;
            guesses.push((0, apexes.len() - 1), a, theta);
            guesses.polish(pulp::Scalar::new(), &mut [(curve, outline)], &mut apexes);
        }
        let grid = || (0..=1000).map(|k| phase + RATE * f64::from(k) / 1000.0);
        let largest = |of: fn(f64) -> f64| grid().map(|it| of(it).abs()).fold(0.0, f64::max);
        let bend = 3.0 * RATE * RATE * largest(f64::cos);
        let jerk = 3.0 * RATE * RATE * RATE * largest(f64::sin) / 0.5;
        for (bound, true_one) in outline.bends.into_iter().zip([bend, jerk]) {
            assert!((0.995..1.1001).contains(&(bound / true_one)), "{phase} {bound} {true_one}");
        }
        assert!(apexes.iter().all(|apex| {
            let turns = (phase + RATE * (apex - 1.0) / 0.5) / std::f64::consts::TAU;
            (turns - turns.round()).abs() < 1e-10
        }));
    }
}

#[test]
fn a_run_is_as_fast_as_the_fastest_of_its_steps_begins() {
    for (_, path, _) in runs() {
        let speeds = curves(&path).into_iter().map(|(curve, _)| curve.at(curve.start).xdot.abs());
        let fastest = speeds.fold(0.0, f64::max);
        let found = Scale::of(&path).xdot;
        assert!((found - fastest).abs() < 1e-12 * fastest, "{found} {fastest}");
    }
}

#[test]
fn the_last_sample_before_an_impact_goes_back_to_where_it_is_above_the_wall() {
    let (mut stayed, mut moved) = (0, 0);
    for k in 1..400 {
        // down onto the wall, so slowly that rounding decides
        let (bend, start) = (0.37 * f64::from(k), 0.1 * f64::from(k % 7));
        let mut a = [0.0; TERMS];
        (a[0], a[2], a[3]) = (bend, 0.3 * bend, 0.3 * bend);
        let h = 0.3 + 0.01 * f64::from(k % 11);
        a[1] = -(a[0] + a[2] + a[3]);
        let curve = FlightCurve::powers((start, h), 1.0, a, a[1] / h, true);
        let end = start + h;
        let mut merged = Merged::new([&[], &[]], 1);
        merged.make_room(2 + TIMES_AT_ONCE, 0).unwrap();
        let mut times = [0.0; MOST];
        (times[0], times[1]) = (start + 0.5 * h, end.next_down());
        merged.push(&curve, &times, 2);
        merged.last_before(&curve, end, 0);
        let ulp = end - end.next_down();
        let moments = (0..10).map(|k| end - f64::from(1 << k) * ulp);
        let last = moments.into_iter().find(|&t| curve.at(t).x > 0.0).unwrap();
        assert_eq!(merged.all.t, [times[0], last], "{k}");
        assert_eq!(merged.all.x, merged.all.t.iter().map(|&t| curve.at(t).x).collect::<Vec<_>>());
        *if last == times[1] { &mut stayed } else { &mut moved } += 1;
        // one that is not later than the sample before is none
        times[0] = end.next_down().next_down();
        let mut merged = Merged::new([&[], &[]], 1);
        merged.make_room(2 + TIMES_AT_ONCE, 0).unwrap();
        merged.push(&curve, &times, 2);
        merged.last_before(&curve, end, 0);
        assert_eq!(merged.all.t.len(), 1 + usize::from(last > times[0]), "{k}");
    }
    assert!(stayed > 100 && moved > 20, "{stayed} {moved}");
}
