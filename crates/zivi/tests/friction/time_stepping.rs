//! Moreau-Jean time stepping with friction.

use zivi::mechanics::{
    simulate_mechanical_moreau_jean, simulate_mechanical_theta_gamma, MechanicalRun, Occurrence,
};
use zivi::{Grid, MoreauJean, Silent, Status};

use crate::closed_forms::guide;
use crate::models::{of_family, rough, slip, Parts, Row, G};
use crate::references::cases;

/// The state at the end of a run.
fn end<E>(run: &MechanicalRun<E>) -> (&[f64], &[f64]) {
    let (size, samples) = (run.layout.size(), &run.samples);
    let first = (samples.t.len() - 1) * size;
    (&samples.x[first..], &samples.v[first..])
}

/// The largest difference of coordinates and velocities at the end from those of a reference.
fn error_at_end<E>(run: &MechanicalRun<E>, exact: &[f64]) -> f64 {
    let (n, (x, v)) = (run.layout.n, end(run));
    let pairs = x[..n].iter().chain(&v[..n]).zip(exact);
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn time_stepping_converges_to_the_references() {
    for (name, errors) in [
        ("incline_stick", [1e-3, 1e-4]),
        ("belt2", [1e-2, 1e-3]),
        ("coulomb", [2e-2, 2e-3]),
        ("feeder", [2e-2, 2e-3]),
        ("rock_slide", [5e-2, 1e-2]),
        ("rod_fall", [4e-2, 4e-3]),
    ] {
        let case = cases().into_iter().find(|case| case.name == name).unwrap();
        let exact = &case.checkpoints.last().unwrap().1;
        for (h, most) in [1e-2, 6.25e-4].into_iter().zip(errors) {
            let mut system = of_family(&case.family, &case.parameters);
            let e = system.e.clone();
            let grid = Grid::new(case.span.0, case.span.1, h).unwrap();
            let start = (&case.q0[..], &case.w0[..]);
            let method = MoreauJean { theta: 0.5 };
            let run = simulate_mechanical_moreau_jean(
                method,
                &mut system,
                &e,
                grid,
                start,
                Vec::new(),
                &mut Silent,
            )
            .unwrap();
            assert_eq!(run.status, Status::Completed, "{name} {h}");
            let error = error_at_end(&run, exact);
            assert!(error < most, "{name} {h} {error:e}");
            let (n, size) = (run.layout.n, run.layout.size());
            // what sticks does so exactly
            for (k, mode) in run.samples.modes.iter().enumerate() {
                for channel in mode.stick.iter() {
                    assert_eq!(run.samples.v[k * size + n + run.layout.m + channel], 0.0);
                }
            }
        }
    }
}

#[test]
fn the_implicit_step_takes_friction_in_joints() {
    for (name, errors) in [
        ("belt_relax", [0.1, 0.02]),
        ("belt2", [0.15, 0.03]),
        ("coulomb", [0.05, 0.01]),
        ("belt_stop", [0.2, 0.03]),
    ] {
        let case = cases().into_iter().find(|case| case.name == name).unwrap();
        let exact = &case.checkpoints.last().unwrap().1;
        for (h, most) in [1e-2, 1e-3].into_iter().zip(errors) {
            let mut system = of_family(&case.family, &case.parameters);
            let e = system.e.clone();
            let grid = Grid::new(case.span.0, case.span.1, h).unwrap();
            let start = (&case.q0[..], &case.w0[..]);
            let run =
                simulate_mechanical_theta_gamma(&mut system, &e, grid, start, vec![], &mut Silent)
                    .unwrap();
            assert_eq!(run.status, Status::Completed, "{name} {h}");
            let error = error_at_end(&run, exact);
            assert!(error < most, "{name} {h} {error:e}");
            let (n, size) = (run.layout.n, run.layout.size());
            let (last, (x, v)) = (run.samples.t.len() - 1, end(&run));
            // slips are the integral of their speeds, work that of the power, forces within limits
            let (rows, row) = (run.layout.rows(), run.layout.m);
            let (mut far, mut work) = (0.0, 0.0);
            for k in 1..=last {
                let slip = run.samples.v[k * size + n + row];
                far += h * slip;
                let forces = &run.samples.lambda[k * rows + row..(k + 1) * rows];
                for (channel, force) in forces.iter().enumerate() {
                    work -= h * force * run.samples.v[k * size + n + row + channel];
                    assert!(force.abs() <= 1.7, "{force}");
                }
            }
            assert!((x[n + row] - far).abs() < 1e-9 * (1.0 + far.abs()), "{name} {h}");
            assert!((v[size - 1] - work).abs() < 1e-9 * (1.0 + work), "{name} {h}");
            let sticks = |k: &usize| run.samples.modes[*k].stick.has(0);
            for k in (0..=last).filter(sticks) {
                assert_eq!(run.samples.v[k * size + n + run.layout.m], 0.0);
                let rate = run.samples.v[k * size] - case.parameters.get("v").unwrap();
                assert!(rate.abs() < 1e-12, "{name} {h} {rate}");
            }
        }
    }
    let case = cases().into_iter().find(|case| case.name == "feeder").unwrap();
    let mut system = of_family(&case.family, &case.parameters);
    let grid = Grid::new(0.0, 1.0, 0.01).unwrap();
    let start = (&case.q0[..], &case.w0[..]);
    let run =
        simulate_mechanical_theta_gamma(&mut system, &[0.4], grid, start, vec![], &mut Silent);
    assert!(run.is_err_and(|why| why.to_string().contains("none at gaps")));
}

#[test]
fn the_implicit_step_brings_a_mass_in_a_guide_to_rest() {
    let (l, e): (f64, f64) = (3.0, 0.5);
    let ratio = e * ((G - l) / (G + l)).sqrt();
    let arc = 1.0 / (G + l) + 1.0 / (G * G - l * l).sqrt();
    let exact = (2.0 / (G - l)).sqrt() + e * (2.0 * (G - l)).sqrt() * arc / (1.0 - ratio);
    for (h, most) in [(1e-3, 2e-2), (1e-4, 3e-3)] {
        let (mut guide, start) = (guide(l, e), (&[1.0][..], &[0.0][..]));
        let grid = Grid::new(0.0, 2.0, h).unwrap();
        let run =
            simulate_mechanical_theta_gamma(&mut guide, &[e], grid, start, vec![], &mut Silent);
        let run = run.unwrap();
        assert_eq!(run.status, Status::Completed);
        assert!(run.samples.modes.last().unwrap().closed.has(0));
        // the force of the wall is less by the friction
        let forces = &run.samples.lambda[run.samples.lambda.len() - 2..];
        assert!((forces[0] + forces[1] - G).abs() < 1e-9 && forces[1].abs() <= l, "{forces:?}");
        let zeno = run.occurrences.iter().find_map(|it| match *it {
            Occurrence::Zeno { t, .. } => Some(t),
            _ => None,
        });
        assert!((zeno.unwrap() - exact).abs() < most, "{zeno:?} {exact}");
    }
}

#[test]
fn a_block_that_slides_loses_what_friction_takes() {
    // v = 2 - mu G t: the trapezoids of a line are exact
    let (mu, t_end) = (0.25, 0.5);
    let mut block = rough(2, &[Some(0)], &[0.5], 0.0, move |_, q, _| Parts {
        mass: vec![1.0, 0.0, 0.0, 1.0],
        force: vec![0.0, -G],
        gaps: vec![Row { value: q[1], row: vec![0.0, 1.0], curvature: 0.0, rate: 0.0 }],
        channels: vec![slip(&[1.0, 0.0], 0.0, 0.0)],
        limits: vec![(mu, mu)],
    });
    let e = block.e.clone();
    let run = simulate_mechanical_moreau_jean(
        MoreauJean { theta: 0.5 },
        &mut block,
        &e,
        Grid::new(0.0, t_end, 0.01).unwrap(),
        (&[0.0, 0.0], &[2.0, 0.0]),
        Vec::new(),
        &mut Silent,
    )
    .unwrap();
    let (x, v) = end(&run);
    let speed = 2.0 - mu * G * t_end;
    let way = 0.5 * (2.0 + speed) * t_end;
    // coordinates, gap, slip, and what friction took
    for (found, exact) in [(x[0], way), (x[3], way), (v[0], speed), (v[3], speed)] {
        assert!((found - exact).abs() < 1e-13, "{found} {exact}");
    }
    assert!((v[4] - mu * G * way).abs() < 1e-13, "{v:?}");
}
