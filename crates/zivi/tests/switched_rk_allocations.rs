//! A period of the sampled loop allocates nothing.

use std::alloc::{GlobalAlloc, Layout, System};
use std::convert::Infallible;
use std::sync::atomic::{AtomicUsize, Ordering};

use zivi::{ConstantForce, Physical, Restitution, SwitchedIntegrator, SwitchedRk};

/// The system's allocator, counting.
struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
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
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    assert!(episode());
    assert_eq!(ALLOCATIONS.load(Ordering::Relaxed), before);
}
