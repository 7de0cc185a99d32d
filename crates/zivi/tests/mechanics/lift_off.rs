//! Where contacts open under forces of time that are known.

use std::convert::Infallible;

use zivi::mechanics::{simulate_mechanical, MechanicalOutput, MechanicalRun, Occurrence};
use zivi::system::dynamics::{Dynamics, Layout};
use zivi::system::impact_law::newton_impacts;
use zivi::{Silent, Status, SwitchedRk};

/// Forces on masses, by time.
type Forces<'f> = Box<dyn Fn(f64) -> Vec<f64> + 'f>;

/// Unit masses, each on a floor of its own, under forces of time: of any kind, so that the method is
/// compiled once.
struct Masses<'f> {
    force: Forces<'f>,
    n: usize,
    steady: bool,
}

impl Dynamics<Infallible> for Masses<'_> {
    fn layout(&self) -> Layout {
        Layout::smooth(self.n, self.n)
    }

    fn evaluate(
        &mut self,
        t: f64,
        q: &[f64],
        _: &[f64],
        out: &mut [f64],
    ) -> Result<(), Infallible> {
        let (layout, n) = (Layout::smooth(self.n, self.n), self.n);
        let unit: Vec<f64> = (0..n * n).map(|k| f64::from(u8::from(k / n == k % n))).collect();
        out[layout.mass()].copy_from_slice(&unit);
        out[layout.force()].copy_from_slice(&(self.force)(t));
        out[layout.gap()].copy_from_slice(q);
        out[layout.gradient()].copy_from_slice(&unit);
        out[layout.curvature()].fill(0.0);
        out[layout.rate()].fill(0.0);
        Ok(())
    }

    fn is_steady(&self) -> bool {
        self.steady
    }
}

/// Starts at rest on the floors.
fn run(t_end: f64, masses: &mut Masses<'_>) -> MechanicalRun<Infallible> {
    let (zeros, e) = (vec![0.0; masses.n], vec![0.5; masses.n]);
    let run = simulate_mechanical(
        SwitchedRk::default(),
        masses,
        &newton_impacts(&e).unwrap(),
        (0.0, t_end),
        (&zeros, &zeros),
        MechanicalOutput::default(),
        &mut Silent,
    )
    .unwrap();
    assert_eq!(run.status, Status::Completed);
    run
}

fn lift_offs(run: &MechanicalRun<Infallible>) -> Vec<(f64, usize)> {
    let each = run.occurrences.iter().filter_map(|it| match it {
        Occurrence::LiftOff { t, gap } => Some((*t, *gap)),
        _ => None,
    });
    each.collect()
}

/// Those of one mass under a force.
fn of_one(t_end: f64, force: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut masses = Masses { force: Box::new(|t| vec![force(t)]), n: 1, steady: false };
    lift_offs(&run(t_end, &mut masses)).iter().map(|it| it.0).collect()
}

#[test]
fn contacts_that_open_within_a_step_open_one_after_the_other() {
    for swapped in [false, true] {
        let force = Box::new(move |t: f64| {
            let forces = [t - 1.0, t - 1.05];
            vec![forces[usize::from(swapped)], forces[usize::from(!swapped)]]
        });
        let found = lift_offs(&run(2.0, &mut Masses { force, n: 2, steady: false }));
        assert_eq!(found.len(), 2, "{found:?}");
        for (k, exact) in [(0, 1.0), (1, 1.05)] {
            let gap = if swapped { 1 - k } else { k };
            assert!((found[k].0 - exact).abs() < 1e-9 && found[k].1 == gap, "{found:?}");
        }
    }
}

#[test]
fn a_weak_lift_off_is_found() {
    for decade in 1..=8 {
        let excess = 10f64.powi(-decade);
        let found = of_one(6.0, |t| -1.0 + (1.0 + excess) * (t - 2.0).cos());
        let exact = 2.0 - (1.0 / (1.0 + excess)).acos();
        assert!(found.first().is_some_and(|t| (t - exact).abs() < 1e-7), "{decade}: {found:?}");
        let none = of_one(6.0, |t| -1.0 + (1.0 - excess) * (t - 2.0).cos());
        assert!(none.is_empty(), "{decade}: {none:?}");
    }
}

#[test]
fn no_lift_off_is_made_of_a_misfit() {
    // forces that vary faster than the first long steps
    for k in 0..40 {
        let omega = 1.0 + 0.7 * f64::from(k);
        let rest = of_one(10.0, |t| -1.0 + 0.98 * (omega * t).sin());
        assert!(rest.is_empty(), "{omega}: {rest:?}");
        let lifts = of_one(10.0, |t| -1.0 + 1.02 * (omega * t).sin());
        let exact = (1.0 / 1.02f64).asin() / omega;
        assert!((lifts[0] - exact).abs() < 1e-7, "{omega}: {lifts:?} {exact}");
    }
}

#[test]
fn pushes_on_a_ripple_are_seen_in_every_contact() {
    let span = 10.0;
    for ripple in [0.0, 1e-6, 1e-4, 1e-2] {
        for phase in 0..12 {
            let start = 0.7 + 0.731 * f64::from(phase);
            let force = Box::new(move |t: f64| {
                let push = if t > start && t < start + 0.03 * span { 15.0 } else { 0.0 };
                vec![-9.81, push - 9.81 + ripple * (37.0 * t).sin()]
            });
            let found = lift_offs(&run(span, &mut Masses { force, n: 2, steady: false }));
            assert!(found.len() == 1 && found[0].1 == 1, "{ripple} {start}: {found:?}");
            assert!((found[0].0 - start).abs() < 1e-9, "{ripple} {start}: {found:?}");
        }
    }
}

#[test]
fn steady_forces_are_not_probed() {
    let nfev = |steady| {
        let found = run(10.0, &mut Masses { force: Box::new(|_| vec![-9.81]), n: 1, steady });
        assert!(lift_offs(&found).is_empty());
        found.counts.nfev
    };
    // rest between the nodes of its windows, and flights up to once in a hundredth of the run
    let (probed, plain) = (nfev(false), nfev(true));
    assert!(probed > plain + 40 && probed < plain + 70 + 100, "{probed} {plain}");
}

#[test]
fn a_push_on_a_mass_in_flight_is_seen_while_another_rests() {
    for phase in 0..12 {
        let start = 0.7 + 0.731 * f64::from(phase);
        let force = Box::new(move |t: f64| {
            let push = if t > start && t < start + 0.3 { 15.0 } else { 0.0 };
            vec![-9.81, 1.0 + push]
        });
        let found = run(10.0, &mut Masses { force, n: 2, steady: false });
        let size = found.layout.size();
        let last = found.samples.x[found.samples.x.len() - size..][1];
        let exact = 50.0 + 15.0 * 0.3 * (10.0 - start - 0.15);
        assert!((last - exact).abs() < 1e-3, "{start}: {last} {exact}");
    }
}
