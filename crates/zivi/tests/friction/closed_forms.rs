//! Against closed forms.

use std::convert::Infallible;

use zivi::mechanics::{simulate_mechanical, FlagKind, MechanicalOutput, MechanicalRun, Occurrence};
use zivi::system::impact_law::newton_impacts;
use zivi::{Order, Silent, Status, SwitchedRk};

use crate::models::{belt, bowl, rock, rod, rough, slip, Parts, Rough, Row, G};

pub(crate) fn simulate(
    mut system: Rough,
    (q, w): (&[f64], &[f64]),
    t1: f64,
    (order, tol): (Order, f64),
) -> MechanicalRun<Infallible> {
    let e = system.e.clone();
    let settings = SwitchedRk { order, rtol: tol, atol: [tol; 2], ..SwitchedRk::default() };
    let output = MechanicalOutput { dense: true, ..MechanicalOutput::default() };
    simulate_mechanical(
        settings,
        &mut system,
        &newton_impacts(&e).unwrap(),
        (0.0, t1),
        (q, w),
        output,
        &mut Silent,
    )
    .unwrap()
}

const FINE: (Order, f64) = (Order::Eight, 1e-9);

fn zeno(run: &MechanicalRun<Infallible>) -> Vec<f64> {
    let time = |it: &Occurrence| match *it {
        Occurrence::Zeno { t, .. } => Some(t),
        _ => None,
    };
    run.occurrences.iter().filter_map(time).collect()
}

fn transitions(run: &MechanicalRun<Infallible>) -> Vec<(f64, usize, i8)> {
    let of = |it: &Occurrence| match *it {
        Occurrence::Transition { t, channel, after, before } if before != 2 => {
            Some((t, channel, after))
        }
        _ => None,
    };
    run.occurrences.iter().filter_map(of).collect()
}

/// A mass in a guide with the friction `l` above a wall.
pub(crate) fn guide(l: f64, e: f64) -> Rough {
    rough(1, &[None], &[e], 0.0, move |_, q, _| Parts {
        mass: vec![1.0],
        force: vec![-G],
        gaps: vec![Row { value: q[0], row: vec![1.0], curvature: 0.0, rate: 0.0 }],
        channels: vec![slip(&[1.0], 0.0, 0.0)],
        limits: vec![(l, l)],
    })
}

#[test]
fn a_mass_in_a_guide_bounces_with_its_own_ratio() {
    for (l, e) in [(0.001, 0.6), (1.0, 0.6), (5.0, 0.6), (2.0, 0.9), (3.0, 0.3)] {
        for tol in [1e-6, 1e-9] {
            let run = simulate(guide(l, e), (&[1.0], &[0.0]), 6.0, (Order::Eight, tol));
            assert_eq!(run.status, Status::Completed);
            let t1 = (2.0 / (G - l)).sqrt();
            let u = e * (2.0 * (G - l)).sqrt();
            let ratio = e * ((G - l) / (G + l)).sqrt();
            let arc = 1.0 / (G + l) + 1.0 / (G * G - l * l).sqrt();
            let exact = t1 + u * arc / (1.0 - ratio);
            let found = zeno(&run);
            assert_eq!(found.len(), 1, "{l} {e} {:?}", run.occurrences);
            let error = (found[0] - exact).abs();
            assert!(error < 1e-13, "{l} {e}: {error:e}");
            assert!(run.counts.impacts <= 12, "{l} {e}: {}", run.counts.impacts);
            let last = run.samples.modes.last().unwrap();
            assert!(last.closed.has(0) && last.stick.has(0), "{last:?}");
        }
    }
}

#[test]
fn sticking_is_exact_and_grazing_harmless() {
    let relax = belt([1.0, 0.0, 0.2, 0.8, 1.2], 0.0, 0.0, 1.0);
    let run = simulate(relax, (&[0.0], &[0.2]), 30.0, FINE);
    let stuck = run.samples.modes.iter().enumerate().filter(|(_, mode)| mode.stick.has(0));
    let size = run.layout.size();
    let mut count = 0;
    for (k, _) in stuck {
        assert_eq!(run.samples.v[k * size + 1], 0.0);
        count += 1;
    }
    assert!(!run.occurrences.iter().any(|it| matches!(it, Occurrence::Flag { .. })));
    assert!(count > 10);
    // an oscillator whose amplitude is the belt's speed touches it
    for d in [-1e-3, -1e-6, -1e-9, 0.0, 1e-9, 1e-6, 1e-3] {
        for tol in [1e-6, 1e-9] {
            let system = belt([1.0, 0.0, 1.0, 1.0, 1.0], 0.0, 0.0, 1.0);
            let run = simulate(system, (&[1.0], &[1.0 + d]), 30.0, (Order::Eight, tol));
            assert_eq!(run.status, Status::Completed, "{d}");
            let graze =
                |it: &Occurrence| matches!(it, Occurrence::Flag { kind: FlagKind::SlipGraze, .. });
            let sticks = transitions(&run).iter().any(|&(t, _, after)| t > 1.0 && after == 0);
            assert!(sticks || !run.occurrences.iter().any(graze), "{d}");
            if d.abs() < 1e-8 && sticks {
                assert!(run.occurrences.iter().any(graze), "{d} {tol:e}");
            }
        }
    }
}

#[test]
fn a_box_on_two_feet_stands_and_slips_at_once() {
    // pulled by 2 t at its centre; feet with the coefficients (a, b)
    let pulled = |a: f64, b: f64| {
        let (width, height): (f64, f64) = (0.5, 0.4);
        rough(3, &[Some(0), Some(1)], &[0.0, 0.0], 0.0, move |t, q, w| {
            let ((s, c), o2) = (q[2].sin_cos(), w[2] * w[2]);
            let corners =
                [(-width, -height), (width, -height)].map(|(x, y)| (x * c - y * s, x * s + y * c));
            let row = |value, row: [f64; 3], curvature| Row {
                value,
                row: row.to_vec(),
                curvature,
                rate: 0.0,
            };
            let inertia = (width * width + height * height) / 3.0;
            Parts {
                mass: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, inertia],
                force: vec![2.0 * t, -G, 0.0],
                gaps: corners.iter().map(|(x, y)| row(q[1] + y, [0.0, 1.0, *x], -y * o2)).collect(),
                channels: corners.iter().map(|(x, y)| row(0.0, [1.0, 0.0, -y], -x * o2)).collect(),
                limits: vec![(a, a), (b, b)],
            }
        })
    };
    for (a, b, exact) in [(0.3, 0.3, 1.4715), (0.3, 0.5, 3.924 / 1.84)] {
        let run = simulate(pulled(a, b), (&[0.0, 0.4, 0.0], &[0.0; 3]), 3.0, FINE);
        assert_eq!(run.status, Status::Completed, "{:?}", run.occurrences);
        let slips = transitions(&run);
        assert_eq!(slips.len(), 2, "{slips:?}");
        for (t, _, after) in slips {
            assert!((t - exact).abs() < 1e-12 && after == 1, "{t} {exact}");
        }
        let told = |it: &Occurrence| {
            matches!(it, Occurrence::Flag { kind: FlagKind::UndeterminedForces, .. })
        };
        assert!(run.occurrences.iter().any(told));
        // the forces sum to what holds the box, and obey the limits
        let (size, rows) = (run.layout.size(), run.layout.rows());
        for (k, mode) in
            run.samples.modes.iter().enumerate().filter(|(_, mode)| mode.stick.len() == 2)
        {
            let (t, forces) = (run.samples.t[k], &run.samples.lambda[k * rows..][..rows]);
            assert!((forces[0] + forces[1] - G).abs() < 1e-12);
            assert!((forces[2] + forces[3] + 2.0 * t).abs() < 1e-12, "{t} {forces:?}");
            // moments about the centre: forces at the height -0.4
            let moment = 0.5 * (forces[1] - forces[0]) + 0.4 * (forces[2] + forces[3]);
            assert!(moment.abs() < 1e-12, "{moment}");
            for (foot, mu) in [a, b].into_iter().enumerate() {
                assert!(forces[2 + foot].abs() <= mu * forces[foot] + 1e-9, "{t} {forces:?}");
            }
            assert!(mode.closed.len() == 2 && run.samples.v[k * size].abs() < 1e-15);
            // the least that is possible: equal, or at the limit of the weaker foot
            let lower = (-a * forces[0]).max(-2.0 * t - b * forces[1]);
            let upper = (a * forces[0]).min(-2.0 * t + b * forces[1]);
            assert!((forces[2] - (-t).clamp(lower, upper)).abs() < 1e-9, "{t} {forces:?}");
        }
    }
}

#[test]
fn two_equal_blocks_move_as_one() {
    let system = crate::models::belt2([1.0, 1.0, 1.2, 0.3, 1.0, 1.0, 1.3, 1.3, 0.0]);
    let run = simulate(system, (&[0.0, 0.0], &[0.0, 0.0]), 25.0, FINE);
    assert_eq!(run.status, Status::Completed);
    let size = run.layout.size();
    let last = &run.samples.x[run.samples.x.len() - size..];
    assert_eq!(last[0], last[1]);
    assert!(transitions(&run).len() > 6);
}

#[test]
fn the_scale_of_gap_and_tangent_does_not_matter() {
    let run = |scale: f64| {
        simulate(bowl(0.2, 0.6, 0.1, scale), (&[0.5, 1.0], &[0.3, 0.0]), 3.0, (Order::Eight, 1e-11))
    };
    let (one, three) = (run(1.0), run(3.0));
    let end = |run: &MechanicalRun<Infallible>| {
        let size = run.layout.size();
        [
            &run.samples.x[run.samples.x.len() - size..][..2],
            &run.samples.v[run.samples.v.len() - size..][..2],
        ]
        .concat()
    };
    for (a, b) in end(&one).iter().zip(end(&three)) {
        assert!((a - b).abs() < 1e-10, "{a} {b}");
    }
    assert_eq!(transitions(&one).len(), transitions(&three).len());
}

#[test]
fn painleve_s_paradox_is_told() {
    let mut counts = [0; 3];
    for mu in [0.5, 1.2, 1.4, 1.6, 2.0] {
        for k in 0..7 {
            let th = 0.2 + 0.2 * f64::from(k);
            for vx in [-2.0, 2.0] {
                for om in [0.0, -4.0] {
                    let start = ([0.0, th.sin(), th], [vx, th.cos() * om, om]);
                    let run = simulate(rod(mu, 0.0, false), (&start.0, &start.1), 0.05, FINE);
                    let (s, c) = th.sin_cos();
                    // slip speed and free acceleration of the tip, l = m = 1, I = 1/3
                    let slip = vx + s * om;
                    let kappa = 1.0 + 3.0 * c * c + 3.0 * mu * slip.signum() * s * c;
                    let b = -G + s * om * om;
                    let kind = match (kappa > 0.0, b < 0.0) {
                        (true, _) => 0,
                        (false, true) => 1,
                        (false, false) => 2,
                    };
                    counts[kind] += 1;
                    let status = run.status;
                    let first = run.samples.t.len() <= 2;
                    match kind {
                        0 => assert!(
                            !(first && status != Status::Completed),
                            "{mu} {th} {vx} {om} {status:?}"
                        ),
                        1 => assert_eq!(status, Status::InconsistentContact, "{mu} {th} {vx} {om}"),
                        _ => {
                            assert_eq!(status, Status::IndeterminateContact, "{mu} {th} {vx} {om}")
                        }
                    }
                    assert!(run.counts.accepted < 1000);
                }
            }
        }
    }
    assert_eq!(counts, [119, 7, 14]);
}

#[test]
fn a_rocking_block_does_not_creep_and_energy_is_balanced() {
    for tol in [1e-6, 1e-9] {
        let system = rock([0.5, 1.5, 0.6, 0.0, 0.0, 0.0]);
        let th: f64 = 0.1;
        let (x, y) = (-0.5 * th.cos() + 1.5 * th.sin(), -0.5 * th.sin() - 1.5 * th.cos());
        let run = simulate(system, (&[0.0, -y, th], &[0.0; 3]), 0.3, (Order::Eight, tol));
        assert_eq!(run.status, Status::Completed);
        let size = run.layout.size();
        for k in 0..run.samples.t.len() {
            let q = &run.samples.x[k * size..];
            let foot = q[0] - 0.5 * q[2].cos() + 1.5 * q[2].sin();
            assert!((foot - x).abs() < 1e-14, "{foot} {x}");
        }
        let start = ([0.0, 1.0_f64.sin(), 1.0], [2.0, 0.0, 0.0]);
        let run = simulate(rod(0.3, 0.0, false), (&start.0, &start.1), 0.7, (Order::Eight, tol));
        let size = run.layout.size();
        let energy = |k: usize| {
            let (q, w) = (&run.samples.x[k * size..], &run.samples.v[k * size..]);
            0.5 * (w[0] * w[0] + w[1] * w[1] + w[2] * w[2] / 3.0) + G * q[1]
        };
        let last = run.samples.t.len() - 1;
        let dissipated = run.samples.v[last * size + size - 1];
        let left = energy(0) - energy(last) - dissipated;
        assert!(left.abs() < 20.0 * tol * energy(0), "{left} {dissipated}");
    }
}

#[test]
fn the_arcs_that_a_guide_skips_are_drawn() {
    let (l, e): (f64, f64) = (3.0, 0.6);
    let run = simulate(guide(l, e), (&[1.0], &[0.0]), 3.0, FINE);
    let path = run.path.as_ref().unwrap();
    let mut last = run.occurrences.iter().filter_map(|it| match *it {
        Occurrence::Impact { t, after, .. } => Some((t, after)),
        _ => None,
    });
    let (mut t, mut u) = last.next_back().unwrap();
    assert!(t + 1e-3 < zeno(&run)[0]);
    for _ in 0..4 {
        for part in [0.1, 0.5, 0.9] {
            let (rise, top) = (u / (G + l), 0.5 * u * u / (G + l));
            let s = part * rise;
            let at = path.at(t + s).unwrap();
            assert!(
                (at.x[0] - s * (u - 0.5 * s * (G + l))).abs() < 1e-12 && at.mode.slip_plus.has(0)
            );
            let fall = (2.0 * top / (G - l)).sqrt();
            let s = part * fall;
            let at = path.at(t + rise + s).unwrap();
            assert!(
                (at.x[0] - (top - 0.5 * s * s * (G - l))).abs() < 1e-12
                    && at.mode.slip_minus.has(0)
            );
        }
        t += u / (G + l) + u / (G * G - l * l).sqrt();
        u *= e * ((G - l) / (G + l)).sqrt();
    }
}

#[test]
fn units_of_length_do_not_matter() {
    // a block on a floor that is inclined as the pull is, and pulled along it by 2 t: it slips where
    // that is mu G, then s'' = 2 (t - t0)
    let (mu, (sin, cos)) = (0.3, 0.7_f64.sin_cos());
    for unit in [1e-13, 1e-6, 1.0, 1e6, 1e13] {
        let mut block = rough(2, &[Some(0)], &[0.5], 0.0, move |t, q, _| Parts {
            mass: vec![1.0, 0.0, 0.0, 1.0],
            force: vec![unit * (2.0 * t * cos + G * sin), unit * (2.0 * t * sin - G * cos)],
            gaps: vec![Row {
                value: cos * q[1] - sin * q[0],
                row: vec![-sin, cos],
                curvature: 0.0,
                rate: 0.0,
            }],
            channels: vec![slip(&[cos, sin], 0.0, 0.0)],
            limits: vec![(mu, mu)],
        });
        let settings = SwitchedRk { rtol: 1e-9, atol: [1e-9 * unit; 2], ..SwitchedRk::default() };
        let run = simulate_mechanical(
            settings,
            &mut block,
            &newton_impacts(&[0.5]).unwrap(),
            (0.0, 3.0),
            (&[0.0, 0.0], &[0.0, 0.0]),
            MechanicalOutput::default(),
            &mut Silent,
        )
        .unwrap();
        assert_eq!(run.status, Status::Completed, "{unit:e}");
        let (slips, t0) = (transitions(&run), 0.5 * mu * G);
        assert!(slips.len() == 1 && (slips[0].0 - t0).abs() < 1e-12, "{unit:e}: {slips:?}");
        let size = run.layout.size();
        let last = &run.samples.x[run.samples.x.len() - size..];
        let last = (cos * last[0] + sin * last[1]) / unit;
        assert!((last - (3.0 - t0).powi(3) / 3.0).abs() < 1e-8, "{unit:e}: {last}");
    }
}
