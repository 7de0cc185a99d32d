//! Runs of systems with several coordinates and gaps.

use std::ffi::c_void;

use zivi::mechanics::{simulate_mechanical, MechanicalOutput, MechanicalRun};
use zivi::system::dynamics::{FunctionDynamics, Layout};
use zivi::system::impact_law::newton_impacts;
use zivi::SetupError;

use crate::border::{array, checked_size, guarded, read, written, CallerFailed, Refused};
use crate::simulation::{How, Method, UnwatchedRun};

/// Writes a system at `t`, `q`, `w = q'` into `out`, one after another: the mass matrix (n x n), the
/// forces (n), the gaps (m), their gradients (m x n), the rest of their second derivatives (m), their
/// partial derivatives in time (m). A return value other than 0 ends the run, which keeps its data.
pub type Evaluation = Option<
    unsafe extern "C" fn(
        user: *mut c_void,
        t: f64,
        q: *const f64,
        w: *const f64,
        out: *mut f64,
    ) -> i32,
>;

/// A system of `n` coordinates above `m` gaps.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Mechanics {
    /// `sizeof(zivi_mechanics)`.
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// Coordinates.
    pub n: usize,
    /// Gaps.
    pub m: usize,
    /// Coefficients of restitution, one for each gap.
    pub e: *const f64,
    /// The system.
    pub function: Evaluation,
    /// Pointer that is passed to `function`.
    pub user: *mut c_void,
}

/// A run of a mechanical system.
pub struct MechanicalHandle(MechanicalRun<CallerFailed>);

/// Simulates from `q0`, `w0` and returns the run, to be freed by `zivi_mechanical_free`. Codes are those
/// of `zivi_simulate`; `method` may be NULL, and must not have an `h`.
#[no_mangle]
pub unsafe extern "C" fn zivi_simulate_mechanical(
    system: *const Mechanics,
    method: *const Method,
    t0: f64,
    t1: f64,
    q0: *const f64,
    w0: *const f64,
    run: *mut *mut MechanicalHandle,
) -> i32 {
    guarded(|| {
        // SAFETY: the caller's
        let (system, run) = unsafe { (read(system)?, written(run)?) };
        *run = std::ptr::null_mut();
        checked_size::<Mechanics>(system.size)?;
        let (n, m) = (system.n, system.m);
        // SAFETY: the caller's; NULL for the method
        let (how, e, q, w) =
            unsafe { (How::of(method)?, array(system.e, m)?, array(q0, n)?, array(w0, n)?) };
        if how.h != 0.0 {
            return Err(Refused::from("h must be 0: mechanical systems have error control"));
        }
        let function = system.function.ok_or_else(Refused::null)?;
        let user = system.user;
        let function = |t: f64, q: &[f64], w: &[f64], out: &mut [f64]| {
            // SAFETY: the caller's function with its pointer; the arrays have the promised lengths
            match unsafe { function(user, t, q.as_ptr(), w.as_ptr(), out.as_mut_ptr()) } {
                0 => Ok(()),
                _ => Err(CallerFailed),
            }
        };
        let mut dynamics = FunctionDynamics { layout: Layout::smooth(n, m), function };
        let output = MechanicalOutput { t_eval: how.t_eval, ..MechanicalOutput::default() };
        let done = simulate_mechanical(
            how.settings,
            &mut dynamics,
            &newton_impacts(e).map_err(SetupError::from)?,
            (t0, t1),
            (q, w),
            output,
            &mut UnwatchedRun,
        )
        .map_err(Refused::setup)?;
        let status = done.status as i32;
        *run = Box::into_raw(Box::new(MechanicalHandle(done)));
        Ok(status)
    })
}

/// Frees a run; NULL is harmless.
#[no_mangle]
pub unsafe extern "C" fn zivi_mechanical_free(run: *mut MechanicalHandle) {
    if !run.is_null() {
        // SAFETY: it came from `zivi_simulate_mechanical`
        drop(unsafe { Box::from_raw(run) });
    }
}

/// How the run ended, 0 if the end was reached; see `zivi_status_message`.
#[no_mangle]
pub unsafe extern "C" fn zivi_mechanical_status(run: *const MechanicalHandle) -> i32 {
    // SAFETY: the caller's
    guarded(|| Ok(unsafe { read(run) }?.0.status as i32))
}

/// Number of samples.
#[no_mangle]
pub unsafe extern "C" fn zivi_mechanical_samples(run: *const MechanicalHandle) -> usize {
    // SAFETY: the caller's
    unsafe { read(run) }.map_or(0, |it| it.0.samples.t.len())
}

/// The samples one after another, valid until the run is freed: 0 the times; 1 the coordinates and
/// the gaps (n + m numbers a sample); 2 their velocities; 3 the contact forces (m). NULL for another
/// one.
#[no_mangle]
pub unsafe extern "C" fn zivi_mechanical_column(
    run: *const MechanicalHandle,
    column: u32,
) -> *const f64 {
    // SAFETY: the caller's
    let Ok(MechanicalHandle(run)) = (unsafe { read(run) }) else { return std::ptr::null() };
    match column {
        0 => run.samples.t.as_ptr(),
        1 => run.samples.x.as_ptr(),
        2 => run.samples.v.as_ptr(),
        3 => run.samples.lambda.as_ptr(),
        _ => std::ptr::null(),
    }
}
