//! Instructions of a period of a closed loop, controller and plant: the tip of an arm of two or three
//! links follows balls above a floor, with three links before a wall too.
//!
//! `valgrind --tool=callgrind target/release/examples/gap_tracker_cost 2 400`, less the same with 200:
//! links, then periods.

use std::convert::Infallible;

use zivi::drive::mechanical::{
    BelievedPlant, GapTracker, GapTrackerSettings, MechanicalController, MechanicalReference,
    MechanicalSensor, Observing, SampledLoop, Tracking,
};
use zivi::mechanics::{simulate_mechanical_loop, Sampling, Ticks};
use zivi::system::dynamics::{Driven, FunctionDynamics, InputMatrix, Layout};
use zivi::system::impact_law::newton_impacts;
use zivi::{AnyImpactLaw, Order, Restitution, Silent, SwitchedRk};
use zivi_core::control::{Approach, Gains, TwistingTracker};

const LENGTHS: [f64; 3] = [0.5, 0.45, 0.3];
const MASSES: [f64; 3] = [1.0, 0.8, 0.4];
const PERIOD: f64 = 1e-3;

/// Point masses at the ends of links with absolute directions `q_0 + ... + q_i`.
fn arm(n: usize, q: &[f64], w: &[f64], out: &mut [f64]) {
    let (mut sin, mut cos, mut turn) = ([0.0; 3], [0.0; 3], [0.0; 3]);
    let (mut angle, mut rate) = (0.0, 0.0);
    for i in 0..n {
        (angle, rate) = (angle + q[i], rate + w[i]);
        (sin[i], cos[i]) = angle.sin_cos();
        turn[i] = rate;
    }
    let layout = Layout::smooth(n, n - 1);
    out.fill(0.0);
    let (mut x, mut y) = ([0.0; 3], [0.0; 3]);
    let (mut along_x, mut along_y) = (0.0, 0.0);
    let (mut tip_x, mut tip_y) = (0.0, 0.0);
    for i in 0..n {
        (tip_x, tip_y) = (tip_x + LENGTHS[i] * cos[i], tip_y + LENGTHS[i] * sin[i]);
        along_x -= LENGTHS[i] * cos[i] * turn[i] * turn[i];
        along_y -= LENGTHS[i] * sin[i] * turn[i] * turn[i];
        for j in 0..=i {
            x[j] -= LENGTHS[i] * sin[i];
            y[j] += LENGTHS[i] * cos[i];
        }
        for j in 0..=i {
            for k in 0..=i {
                out[j * n + k] += MASSES[i] * (x[j] * x[k] + y[j] * y[k]);
            }
            let load = -(x[j] * along_x + y[j] * (along_y + 9.81));
            out[layout.force().start + j] += MASSES[i] * load;
        }
    }
    (out[layout.gap().start], out[layout.curvature().start]) = (tip_y + 0.3, along_y);
    out[layout.gradient().start..][..n].copy_from_slice(&y[..n]);
    if n == 3 {
        (out[layout.gap().start + 1], out[layout.curvature().start + 1]) = (1.2 - tip_x, -along_x);
        for j in 0..n {
            out[layout.gradient().start + n + j] = -x[j];
        }
    }
}

/// Nobody.
struct Nobody;

impl Observing<Infallible> for Nobody {
    fn estimate(
        &mut self,
        _: f64,
        _: (&mut [f64], &mut [f64]),
        _: &[f64],
    ) -> Result<(), Infallible> {
        Ok(())
    }
}

/// Gaps that fall freely, and the rest at its place.
fn falling(n: usize, q: &[f64], gaps: &[f64], count: usize) -> MechanicalReference {
    let mut it = MechanicalReference::default();
    for k in 0..count {
        let t = k as f64 * PERIOD;
        it.q.extend_from_slice(q);
        it.w.extend(vec![0.0; n]);
        it.turning.extend(vec![0.0; n]);
        it.gaps.extend(gaps.iter().map(|gap| gap - 0.5 * t * t));
        it.rates.extend(gaps.iter().map(|_| -t));
        it.accelerations.extend(gaps.iter().map(|_| -1.0));
        it.sides.extend(gaps.iter().map(|_| 1.0));
        it.contacts.extend(gaps.iter().map(|_| false));
    }
    it
}

fn driven(n: usize) -> Driven<impl zivi::system::dynamics::Dynamics<Infallible>, NoMatrix> {
    let function = move |_: f64, q: &[f64], w: &[f64], out: &mut [f64]| {
        arm(n, q, w, out);
        Ok(())
    };
    let dynamics = FunctionDynamics { layout: Layout::smooth(n, n - 1), function };
    let unit = (0..n * n).map(|k| if k % (n + 1) == 0 { 1.0 } else { 0.0 }).collect();
    Driven::new(dynamics, (n, n), InputMatrix::Constant(unit)).expect("n x n")
}

type NoMatrix = fn(f64, &[f64], &mut [f64]) -> Result<(), Infallible>;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1).map(|it| it.parse().unwrap_or(0_usize));
    let (n, count) = (arguments.next().unwrap_or(2), arguments.next().unwrap_or(400));
    let (q, w) = ([0.5, -1.2, 0.3], [0.0; 3]);
    let (q, w, laws) = (&q[..n], &w[..n], newton_impacts(&vec![0.6; n - 1])?);
    let layout = Layout::smooth(n, n - 1);
    let mut row = vec![0.0; layout.len()];
    arm(n, q, w, &mut row);
    let reference = falling(n, q, &row[layout.gap()], count + 2);
    let restitution = Restitution::from_e(0.6)?;
    let gains = Gains::new(40.0, 22.0)?;
    let tracker =
        TwistingTracker::new(gains, PERIOD, restitution, restitution, Approach::Positive)?;
    let settings = GapTrackerSettings {
        h: PERIOD,
        posture: (400.0, 40.0),
        limits: Some(vec![(-100.0, 100.0); n]),
        latch: None,
        delay: 0,
        learn_offsets: false,
    };
    let (mut plant, mut believed) = (driven(n), driven(n));
    let law = GapTracker::new(vec![tracker; n - 1], settings);
    let tracking = Tracking {
        law,
        plant: BelievedPlant { driven: &mut believed, tasks: None, laws: &laws, h: PERIOD },
        reference: Some(&reference),
        asked: |_, _| Ok(None),
        wrong: |error| panic!("{error:?}"),
    };
    ran(tracking, &mut plant, (q, w), &laws, count)
}

fn ran<C: MechanicalController<Infallible>>(
    controller: C,
    plant: &mut Driven<impl zivi::system::dynamics::Dynamics<Infallible>, NoMatrix>,
    (q, w): (&[f64], &[f64]),
    laws: &[AnyImpactLaw],
    count: usize,
) -> Result<(), Box<dyn std::error::Error>> {
    let n = q.len();
    let times: Vec<f64> = (0..=count).map(|k| k as f64 * PERIOD).collect();
    let sensor = MechanicalSensor::default();
    let mut ticks = SampledLoop::new(controller, None::<Nobody>, sensor, (n - 1, n, 0));
    let mut u = vec![0.0; n];
    let Ok(()) = ticks.tick(0, 0.0, (q, w), &mut u);
    let settings = SwitchedRk {
        rtol: 1e-9,
        atol: [1e-12; 2],
        order: Order::Five,
        adaptive: false,
        max_step: times.windows(2).map(|it| it[1] - it[0]).fold(0.0, f64::max),
        ..SwitchedRk::DEFAULT
    };
    let sampling = Sampling { times: &times, stops: &times[1..count] };
    let (run, _) = simulate_mechanical_loop(
        settings,
        (plant, laws),
        sampling,
        (q, w),
        (&u, &mut ticks),
        (false, None),
        &mut Silent,
    )?;
    println!(
        "{} evaluations, gaps {:?}",
        run.counts.nfev,
        &run.samples.x[run.samples.x.len() - n + 1..]
    );
    Ok(())
}
