//! The ball, the regulator and the tracker over a grid, for a browser: `docs/_static/browser`.
//!
//! Each function makes one run and returns how many rows of the table it has filled, 0 where a
//! setting is rejected. The mass always moves by the implicit step (in a loop: the paper's own
//! loop), except where explicit Euler is requested. A row is
//!
//! ```text
//! x, x', s, v, x_r, x_r', u, lambda_s, lambda_v, lambda_sr, lambda_vr, lambda_es, lambda_ev
//! ```
//!
//! with NaN in columns that do not apply. The numbers are bit-identical to those of the host library.

#![cfg_attr(target_arch = "wasm32", no_std)]

use core::cell::UnsafeCell;
use zivi_core::control::regulation::RegulationStep;
use zivi_core::control::{Approach, ExplicitTwisting, Gains, TwistingRegulator, TwistingTracker};
use zivi_core::{sgn, transform, Branch, Lifted, Physical, Restitution, ThetaGammaStep};

/// Nothing here panics; if something did, the page would get an error.
#[cfg(target_arch = "wasm32")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    core::arch::wasm32::unreachable()
}

/// Address of the table.
#[no_mangle]
pub extern "C" fn table() -> *const f64 {
    TABLE.start()
}

/// Doubles of a row.
#[no_mangle]
pub extern "C" fn width() -> u32 {
    WIDTH as u32
}

/// Number of rows of the table.
#[no_mangle]
pub extern "C" fn capacity() -> u32 {
    ROWS as u32
}

/// A ball under the constant force `f` (m/s^2): implicit Euler, or explicit Euler.
#[no_mangle]
pub extern "C" fn ball(explicit: u32, n: u32, h: f64, e: f64, f: f64, x: f64, xdot: f64) -> u32 {
    let start = Physical { x, xdot };
    let run = |scheme: ThetaGammaStep| {
        let advance = |z: Lifted, side: f64| {
            if explicit != 0 {
                return Some(explicit_euler(z, f, h, scheme.restitution()));
            }
            let found = scheme.solve(z, f, side).ok()?;
            Some((found.end(), [found.lambda_s, found.lambda_v]))
        };
        fall(n, start, scheme.restitution(), advance)
    };
    scheme(h, e).and_then(run).unwrap_or(0)
}

/// The regulator without the contact-establishing law, or with the sign of the sample: `u = -mu1 - mu2 sgn x'`.
#[no_mangle]
pub extern "C" fn regulator(
    explicit: u32,
    n: u32,
    h: f64,
    e: f64,
    mu1: f64,
    mu2: f64,
    f: f64,
    x: f64,
    xdot: f64,
) -> u32 {
    let start = Physical { x, xdot };
    let run = || {
        let scheme = scheme(h, e)?;
        let gains = Gains::new(mu1, mu2).ok()?;
        let law = if explicit != 0 {
            LoopLaw::Sampled(gains)
        } else {
            let regulator = TwistingRegulator::new(gains, h, scheme.restitution()).ok()?;
            let step = RegulationStep { h, restitution: scheme.restitution(), gains };
            LoopLaw::Regulator(regulator.with_landing(None), step)
        };
        close(law, scheme, LoopForces { plant: f, model: f, reference: 0.0 }, start, n)
    };
    run().unwrap_or(0)
}

/// The tracker on either branch (0 `s >= 0`, 1 the nearest), or with explicit signs (2); the walls
/// of the mass and of its reference have the same restitution. The force in the controller's model is `f`,
/// the force on the mass is `true_f`.
#[no_mangle]
pub extern "C" fn tracker(
    kind: u32,
    n: u32,
    h: f64,
    e: f64,
    mu1: f64,
    mu2: f64,
    f: f64,
    true_f: f64,
    f_ref: f64,
    x: f64,
    xdot: f64,
    x_ref: f64,
    xdot_ref: f64,
) -> u32 {
    let (start, reference) = (Physical { x, xdot }, Physical { x: x_ref, xdot: xdot_ref });
    let run = || {
        let scheme = scheme(h, e)?;
        let (gains, restitution) = (Gains::new(mu1, mu2).ok()?, scheme.restitution());
        let approach = if kind == 1 { Approach::Nearest } else { Approach::Positive };
        let law = if kind == 2 {
            let mut law = ExplicitTwisting::new(gains, h, restitution, restitution).ok()?;
            law.reset(reference).ok()?;
            LoopLaw::Explicit(law)
        } else {
            let law = TwistingTracker::new(gains, h, restitution, restitution, approach).ok()?;
            let mut law = law.with_landing(None);
            law.reset(reference).ok()?;
            LoopLaw::Tracker(law)
        };
        close(law, scheme, LoopForces { plant: true_f, model: f, reference: f_ref }, start, n)
    };
    run().unwrap_or(0)
}

fn scheme(h: f64, e: f64) -> Option<ThetaGammaStep> {
    ThetaGammaStep::new(h, 1.0, 1.0, Restitution::from_e(e).ok()?).ok()
}

/// `v+ = v + h sgn(s) f / R`, `s+ = s + h R v` with `sgn 0 = +1`.
fn explicit_euler(z: Lifted, f: f64, h: f64, restitution: Restitution) -> (Lifted, [f64; 2]) {
    let sign = |z: f64| if z < 0.0 { -1.0 } else { 1.0 };
    let (lambda_s, lambda_v) = (sign(z.s), sign(z.v));
    let rate = transform::field(z.v, lambda_s, lambda_v, f, restitution);
    (Lifted { s: z.s + h * rate.s, v: z.v + h * rate.v }, [lambda_s, lambda_v])
}

/// A run without control.
fn fall(
    n: u32,
    start: Physical,
    restitution: Restitution,
    advance: impl Fn(Lifted, f64) -> Option<(Lifted, [f64; 2])>,
) -> Option<u32> {
    let mut z = lifted(start, restitution)?;
    let (mut side, mut signs) = (transform::side(z, 1.0), [sgn(z.s), sgn(z.v)]);
    TABLE.fill(n, |k| {
        if k > 0 {
            (z, signs) = advance(z, side)?;
            side = transform::side(z, side);
        }
        let Physical { x, xdot } = transform::project(z, restitution);
        let [lambda_s, lambda_v] = signs;
        Some(SampleRow { x, xdot, s: z.s, v: z.v, lambda_s, lambda_v, ..SampleRow::EMPTY })
    })
}

// The table that the page reads.

/// Doubles of a row.
const WIDTH: usize = 13;
/// Samples of the longest run.
const ROWS: usize = 20_001;

/// One sample.
struct SampleRow {
    x: f64,
    xdot: f64,
    s: f64,
    v: f64,
    x_ref: f64,
    xdot_ref: f64,
    u: f64,
    lambda_s: f64,
    lambda_v: f64,
    /// The signs of the reference and of the errors.
    others: [f64; 4],
}

impl SampleRow {
    /// A run has none of it.
    const EMPTY: Self = Self {
        x: f64::NAN,
        xdot: f64::NAN,
        s: f64::NAN,
        v: f64::NAN,
        x_ref: f64::NAN,
        xdot_ref: f64::NAN,
        u: f64::NAN,
        lambda_s: f64::NAN,
        lambda_v: f64::NAN,
        others: [f64::NAN; 4],
    };

    fn doubles(self) -> [f64; WIDTH] {
        let Self { x, xdot, s, v, x_ref, xdot_ref, u, lambda_s, lambda_v, others } = self;
        let [lambda_sr, lambda_vr, lambda_es, lambda_ev] = others;
        [
            x, xdot, s, v, x_ref, xdot_ref, u, lambda_s, lambda_v, lambda_sr, lambda_vr, lambda_es,
            lambda_ev,
        ]
    }
}

struct SampleTable(UnsafeCell<[[f64; WIDTH]; ROWS]>);

// SAFETY: a browser calls the functions of a module one after another
unsafe impl Sync for SampleTable {}

static TABLE: SampleTable = SampleTable(UnsafeCell::new([[0.0; WIDTH]; ROWS]));

impl SampleTable {
    fn start(&self) -> *const f64 {
        self.0.get().cast()
    }

    /// Fills the rows 0 to `n`, at most the size of the table, while there is a next one, and counts
    /// them.
    fn fill(&self, n: u32, mut row: impl FnMut(usize) -> Option<SampleRow>) -> Option<u32> {
        let last = n as usize;
        if last >= ROWS {
            return None;
        }
        // SAFETY: nobody else reads or writes while one of the functions runs, see above
        let rows = unsafe { &mut *self.0.get() };
        let mut filled = 0;
        for (k, to) in rows.iter_mut().take(last + 1).enumerate() {
            let Some(next) = row(k) else { break };
            *to = next.doubles();
            filled += 1;
        }
        Some(filled)
    }
}

// The controllers, and their loop with a mass that moves by the implicit step.

enum LoopLaw {
    /// `u = -mu1 - mu2 sgn x'` with the sign of the sample.
    Sampled(Gains),
    Regulator(TwistingRegulator, RegulationStep),
    Tracker(TwistingTracker),
    Explicit(ExplicitTwisting),
}

/// Forces on the mass, in the controller's model of it, and on the reference (m/s^2).
#[derive(Clone, Copy)]
struct LoopForces {
    plant: f64,
    model: f64,
    reference: f64,
}

const NONE: f64 = f64::NAN;

impl LoopLaw {
    fn tick(&mut self, measured: Physical, forces: LoopForces) -> Option<(f64, [f64; 6])> {
        let LoopForces { model: f, reference: f_ref, .. } = forces;
        match self {
            LoopLaw::Sampled(gains) => {
                Some((-gains.mu1() - gains.mu2() * sgn(measured.xdot), [NONE; 6]))
            }
            LoopLaw::Regulator(law, _) => {
                let u = law.tick(measured, f).ok()?;
                let [lambda_s, lambda_v] = law.state().signs;
                Some((u, [lambda_s, lambda_v, NONE, NONE, NONE, NONE]))
            }
            LoopLaw::Tracker(law) => Some((law.tick(measured, f, f_ref).ok()?, law.state().signs)),
            LoopLaw::Explicit(law) => Some((law.tick(measured, f, f_ref).ok()?, law.state().signs)),
        }
    }

    /// The end of the regulator's own step, whose force at the wall differs from that of a held control.
    fn planned(&self, z: Lifted, side: f64, force: f64) -> Option<Lifted> {
        let LoopLaw::Regulator(_, step) = self else { return None };
        let mirror = |z: Lifted| Lifted { s: side * z.s, v: side * z.v };
        Some(mirror(step.solve(mirror(z), force).end))
    }

    fn reference(&self) -> Physical {
        match self {
            LoopLaw::Tracker(law) => law.reference(),
            LoopLaw::Explicit(law) => law.reference(),
            _ => Physical { x: NONE, xdot: NONE },
        }
    }
}

/// A start above the wall, on the branch `s >= 0`.
fn lifted(start: Physical, restitution: Restitution) -> Option<Lifted> {
    let z = transform::lift(start, Branch::Positive, restitution);
    (z.s >= 0.0 && z.is_finite()).then_some(z)
}

/// The loop: measure, update the control, move the mass by one implicit step, with the control held or as planned.
fn close(
    mut law: LoopLaw,
    scheme: ThetaGammaStep,
    forces: LoopForces,
    start: Physical,
    n: u32,
) -> Option<u32> {
    let restitution = scheme.restitution();
    let mut state = start;
    let mut z = lifted(start, restitution)?;
    let mut side = transform::side(z, 1.0);
    let (mut u, mut signs) = (0.0, [NONE; 6]);
    TABLE.fill(n, |k| {
        if k > 0 {
            z = match law.planned(z, side, forces.plant) {
                Some(end) => end,
                None => scheme.solve(z, forces.plant + u, side).ok()?.end(),
            };
            side = transform::side(z, side);
            state = transform::project(z, restitution);
        }
        let reference = law.reference();
        if k < n as usize {
            (u, signs) = law.tick(state, forces)?;
        }
        let [lambda_s, lambda_v, others @ ..] = signs;
        let Physical { x, xdot } = state;
        let Physical { x: x_ref, xdot: xdot_ref } = reference;
        let (s, v) = (z.s, z.v);
        Some(SampleRow { x, xdot, s, v, x_ref, xdot_ref, u, lambda_s, lambda_v, others })
    })
}
