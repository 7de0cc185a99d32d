//! Allocations of a period of the sampled loop and of the end of a run.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::convert::Infallible;

use zivi::{
    simulate_switched_rk, ConstantForce, Monitor, Output, Physical, Quantity, Restitution,
    SwitchedIntegrator, SwitchedRk,
};

/// The system's allocator, counting.
struct Counting;

thread_local! {
    /// Bytes that this thread has asked for.
    static ALLOCATED: Cell<usize> = const { Cell::new(0) };
}

unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATED.set(ALLOCATED.get() + layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_warm_integrator_allocates_nothing() {
    let restitution = Restitution::from_e(0.7).unwrap();
    let settings = SwitchedRk { first_step: Some(1e-2), ..SwitchedRk::default() };
    let mut plant = SwitchedIntegrator::new(settings, restitution).unwrap();
    // flight, impacts, Zeno point, rest and lift-off, again and again
    let mut episode = || {
        plant.start(0.0, Physical { x: 0.1, xdot: 0.0 }).unwrap();
        let mut rested = false;
        for k in 1..=300 {
            let u = if k % 100 > 90 { 3.0 } else { -9.81 };
            let t = f64::from(k) * 1e-2;
            assert!(plant.advance_to::<Infallible, _>(t, &mut ConstantForce(u)).is_ok());
            rested |= plant.is_at_rest();
        }
        rested
    };
    assert!(episode());
    let before = ALLOCATED.get();
    assert!(episode());
    assert_eq!(ALLOCATED.get(), before);
}

/// Stops a run at a poll.
struct Stop {
    polls: usize,
    allocated: usize,
}

impl Monitor<()> for Stop {
    fn poll(&mut self, _: usize, _: usize) -> Result<(), ()> {
        self.polls -= 1;
        if self.polls > 0 {
            return Ok(());
        }
        self.allocated = ALLOCATED.get();
        Err(())
    }
}

#[test]
fn a_run_that_is_stopped_makes_nothing_of_its_samples() {
    let settings = SwitchedRk { max_steps: 1 << 40, max_impacts: 1 << 40, ..SwitchedRk::default() };
    let wall = Restitution::from_e(1.0).unwrap();
    let stopped = |polls, in_rows| {
        let mut stop = Stop { polls, allocated: 0 };
        let (start, force) = (Physical { x: 1e-9, xdot: 0.0 }, &mut ConstantForce(-9.81));
        let output = Output { dense: true, in_rows, ..Output::default() };
        let run = simulate_switched_rk(settings, wall, force, (0.0, 1e9), start, output, &mut stop);
        let later = ALLOCATED.get() - stop.allocated;
        (run.unwrap(), later)
    };
    let ((short, little), (long, as_little)) = (stopped(4, true), stopped(64, true));
    let (short, long) = (short.rows.unwrap(), long.rows.unwrap());
    assert!(long.len() > 10 * short.len() && short.len() > 100, "{} {}", long.len(), short.len());
    assert!(little.max(as_little) < 4096, "{little} {as_little}");
    // the same columns, when they are wanted
    let (made, _) = stopped(4, false);
    let columns = short.columns(None, wall, |_, _| ()).unwrap();
    for quantity in Quantity::ALL {
        let bits = |it: &[f64]| it.iter().map(|it| it.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(columns.of(quantity)), bits(made.trajectory.columns.of(quantity)));
    }
    assert_eq!((made.rows, short.last()), (None, columns.of(Quantity::T).last().copied()));
}
