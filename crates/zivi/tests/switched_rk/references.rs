//! The stored trajectories, computed in closed form between events with 50 digits.

use zivi::Order;

use crate::problems::{end, settings, Reference};

#[test]
fn events_and_states_are_the_stored_ones_at_every_tolerance() {
    for reference in Reference::all() {
        for order in [Order::Five, Order::Eight] {
            for tol in [1e-4, 1e-6, 1e-8, 1e-10, 1e-12] {
                let run = reference.simulate(settings(order, tol));
                let events = &run.trajectory.events;
                let (zeno, lift) = (&events.zeno_times, &events.liftoff_times);
                let name = format!("{} {order:?} {tol:e}", reference.name);
                let worst = |a: &[f64], b: &[f64]| {
                    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
                };
                let at_end = end(&run);
                let path = run.path.as_ref().unwrap();
                let samples = reference.samples.iter().map(|&[t, x, v]| { let p = path.at(t).unwrap(); (p.x-x).abs().max((p.xdot-v).abs())}).fold(0.0, f64::max);
                let impacts = reference.impacts.iter().zip(&events.impacts).map(|(a,b)| (a[0]-b.t).abs().max((a[1]-b.xdot_after).abs())).fold(0.0, f64::max);
                println!(
                    "{name:32} zeno {}/{} {:8.1e} lift {}/{} {:8.1e} end {:8.1e} {:8.1e} samples {:8.1e} impacts {:8.1e} nfev {} steps {} rej {} imp {}",
                    zeno.len(), reference.zeno.len(), worst(zeno, &reference.zeno),
                    lift.len(), reference.lift.len(), worst(lift, &reference.lift),
                    (at_end.x - reference.end.x).abs(), (at_end.xdot - reference.end.xdot).abs(), samples, impacts,
                    run.counts.nfev, run.counts.accepted, run.counts.rejected, run.counts.impacts,
                );
            }
        }
    }
}
