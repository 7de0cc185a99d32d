//! Runs of a mass above a wall.

use std::ffi::{c_char, c_void, CString};
use std::sync::OnceLock;

use zivi::{
    simulate_switched_rk, simulate_theta_gamma, ConstantForce, Force, Grid, Monitor, Output,
    Physical, Quantity, Restitution, Status, SwitchedRk, ThetaGamma, Trajectory,
};

use crate::border::{array, checked_size, guarded, read, written, CallerFailed, Refused};

/// A force per unit mass: writes `f(t, x, xdot)` (m/s^2) to `*force`; another return value than 0 ends the run, which
/// keeps its data. `user` is the pointer of the system.
pub type ForceFunction = Option<
    unsafe extern "C" fn(user: *mut c_void, t: f64, x: f64, xdot: f64, force: *mut f64) -> i32,
>;

/// `x'' = f`, `x >= 0`, `x'+ = -e x'-`. A member that is zero has its default value.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct System {
    /// `sizeof(zivi_system)`.
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// Coefficient of restitution, in [0, 1]; or give `kappa`.
    pub e: f64,
    /// `(1 - e)/(1 + e)`, in place of `e`.
    pub kappa: f64,
    /// The constant force (m/s^2), used if `function` is NULL.
    pub force: f64,
    /// The force as a function; NULL for a constant force.
    pub function: ForceFunction,
    /// Pointer that is passed to `function`.
    pub user: *mut c_void,
}

/// How a run is computed. A member that is zero has its default value.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Method {
    /// `sizeof(zivi_method)`.
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// Step of the implicit Euler scheme (s); 0: none. Then a mass above a wall flies by power series
    /// where the force is constant, exactly but for rounding, and everything else moves by a
    /// Runge-Kutta pair of order 8 with error control.
    pub h: f64,
    /// Relative tolerance, by default 1e-6: of the pair's steps, and of the times at which impacts
    /// accumulate. Flights by power series do not depend on it.
    pub rtol: f64,
    /// Absolute tolerance, by default 1e-9, of the same.
    pub atol: f64,
    /// Longest step (s), by default none.
    pub max_step: f64,
    /// Times of the samples, increasing; NULL: where the steps end.
    pub t_eval: *const f64,
    /// Number of these times.
    pub n_eval: usize,
}

pub use zivi::Impact;

/// A run.
pub struct RunHandle(Trajectory);

/// Sets the size, and all other members to their defaults.
#[no_mangle]
pub unsafe extern "C" fn zivi_system_defaults(system: *mut System) -> i32 {
    guarded(|| {
        // SAFETY: the caller's
        *unsafe { written(system) }? = System {
            size: size_of::<System>() as u32,
            reserved: 0,
            e: 0.0,
            kappa: 0.0,
            force: 0.0,
            function: None,
            user: std::ptr::null_mut(),
        };
        Ok(0)
    })
}

/// Sets the size, and all other members to their defaults.
#[no_mangle]
pub unsafe extern "C" fn zivi_method_defaults(method: *mut Method) -> i32 {
    guarded(|| {
        // SAFETY: the caller's
        *unsafe { written(method) }? = Method {
            size: size_of::<Method>() as u32,
            reserved: 0,
            h: 0.0,
            rtol: 0.0,
            atol: 0.0,
            max_step: 0.0,
            t_eval: std::ptr::null(),
            n_eval: 0,
        };
        Ok(0)
    })
}

/// Simulates from `t0` to `t1` and returns the run, to be freed by `zivi_run_free`. The code is the
/// status of the run, 0 if the end was reached: a run that ended early keeps its data.
/// If it is < 0, nothing was computed and `*run` is NULL. `method` may be NULL.
#[no_mangle]
pub unsafe extern "C" fn zivi_simulate(
    system: *const System,
    method: *const Method,
    t0: f64,
    t1: f64,
    x0: f64,
    xdot0: f64,
    run: *mut *mut RunHandle,
) -> i32 {
    guarded(|| {
        // SAFETY: the caller's
        let (system, run) = unsafe { (read(system)?, written(run)?) };
        *run = std::ptr::null_mut();
        checked_size::<System>(system.size)?;
        // SAFETY: NULL or the caller's
        let how = unsafe { How::of(method)? };
        let restitution = restitution(system.e, system.kappa)?;
        let start = Physical { x: x0, xdot: xdot0 };
        let trajectory = match system.function {
            Some(function) => how.run(
                &mut Callback { function, user: system.user },
                restitution,
                (t0, t1),
                start,
            )?,
            None => how.run(&mut ConstantForce(system.force), restitution, (t0, t1), start)?,
        };
        let status = trajectory.status as i32;
        *run = Box::into_raw(Box::new(RunHandle(trajectory)));
        Ok(status)
    })
}

/// Frees a run; NULL is harmless.
#[no_mangle]
pub unsafe extern "C" fn zivi_run_free(run: *mut RunHandle) {
    if !run.is_null() {
        // SAFETY: it came from `zivi_simulate`
        drop(unsafe { Box::from_raw(run) });
    }
}

/// How the run ended, 0 if the end was reached; see `zivi_status_message`.
#[no_mangle]
pub unsafe extern "C" fn zivi_run_status(run: *const RunHandle) -> i32 {
    // SAFETY: the caller's
    guarded(|| Ok(unsafe { read(run) }?.0.status as i32))
}

/// Number of samples.
#[no_mangle]
pub unsafe extern "C" fn zivi_run_samples(run: *const RunHandle) -> usize {
    // SAFETY: the caller's
    unsafe { read(run) }.map_or(0, |it| it.0.columns.len())
}

/// A column of the samples, valid until the run is freed: 0 t, 1 x, 2 xdot, 3 s, 4 v; NULL for
/// another one.
#[no_mangle]
pub unsafe extern "C" fn zivi_run_column(run: *const RunHandle, column: u32) -> *const f64 {
    let wanted = Quantity::ALL.get(column as usize).filter(|_| column < 5);
    // SAFETY: the caller's
    match (unsafe { read(run) }, wanted) {
        (Ok(it), Some(quantity)) => it.0.columns.of(*quantity).as_ptr(),
        _ => std::ptr::null(),
    }
}

/// The time from which the mass is at rest until the end (s), NaN if it is not.
#[no_mangle]
pub unsafe extern "C" fn zivi_run_rest_time(run: *const RunHandle) -> f64 {
    // SAFETY: the caller's
    unsafe { read(run) }.ok().and_then(|it| it.0.events.rest_time).unwrap_or(f64::NAN)
}

/// The impacts that were resolved, valid until the run is freed; `*count` is their number.
#[no_mangle]
pub unsafe extern "C" fn zivi_run_impacts(
    run: *const RunHandle,
    count: *mut usize,
) -> *const Impact {
    // SAFETY: the caller's
    match unsafe { (read(run), written(count)) } {
        (Ok(it), Ok(count)) => {
            *count = it.0.events.impacts.len();
            it.0.events.impacts.as_ptr()
        }
        _ => std::ptr::null(),
    }
}

/// Meaning and remedy of the status of a run.
#[no_mangle]
pub extern "C" fn zivi_status_message(status: i32) -> *const c_char {
    static WORDS: OnceLock<Vec<CString>> = OnceLock::new();
    let words = WORDS.get_or_init(|| {
        Status::ALL.iter().map(|it| CString::new(it.message()).unwrap_or_default()).collect()
    });
    let known = usize::try_from(status).ok().and_then(|status| words.get(status));
    known.map_or(c"not a status of this library".as_ptr(), |it| it.as_ptr())
}

/// `e` or `kappa`, whichever is not zero; `e = 0` is the plastic wall.
pub(crate) fn restitution(e: f64, kappa: f64) -> Result<Restitution, Refused> {
    Ok(match (e == 0.0, kappa == 0.0) {
        (_, true) => Restitution::from_e(e)?,
        (true, false) => Restitution::from_kappa(kappa)?,
        (false, false) => Restitution::from_both(e, kappa)?,
    })
}

/// The requested method.
pub(crate) struct How<'a> {
    pub(crate) h: f64,
    pub(crate) settings: SwitchedRk,
    pub(crate) t_eval: Option<&'a [f64]>,
}

impl How<'_> {
    pub(crate) unsafe fn of(method: *const Method) -> Result<Self, Refused> {
        let mut settings = SwitchedRk::default();
        if method.is_null() {
            return Ok(Self { h: 0.0, settings, t_eval: None });
        }
        // SAFETY: the caller's
        let method = unsafe { read(method)? };
        checked_size::<Method>(method.size)?;
        if method.rtol != 0.0 {
            settings.rtol = method.rtol;
        }
        if method.atol != 0.0 {
            settings.atol = [method.atol; 2];
        }
        if method.max_step != 0.0 {
            settings.max_step = method.max_step;
        }
        let given = !method.t_eval.is_null() || method.n_eval > 0;
        // SAFETY: the caller's array
        let times = unsafe { array(method.t_eval, method.n_eval)? };
        Ok(Self { h: method.h, settings, t_eval: given.then_some(times) })
    }

    fn run(
        &self,
        force: &mut impl Force<CallerFailed>,
        restitution: Restitution,
        span: (f64, f64),
        start: Physical,
    ) -> Result<Trajectory, Refused> {
        if self.h == 0.0 {
            let output = Output { t_eval: self.t_eval, ..Output::default() };
            let run = simulate_switched_rk(
                self.settings,
                restitution,
                force,
                span,
                start,
                output,
                &mut UnwatchedRun,
            );
            return Ok(run.map_err(Refused::setup)?.trajectory);
        }
        if self.t_eval.is_some() {
            return Err(Refused::from("t_eval must be NULL where h is given: samples are h apart"));
        }
        let (grid, method) = (Grid::new(span.0, span.1, self.h)?, ThetaGamma::implicit_euler());
        let run = simulate_theta_gamma(method, restitution, force, grid, start, &mut UnwatchedRun);
        Ok(run.map_err(Refused::setup)?.trajectory)
    }
}

/// A force of the caller.
struct Callback {
    function: unsafe extern "C" fn(*mut c_void, f64, f64, f64, *mut f64) -> i32,
    user: *mut c_void,
}

impl Force<CallerFailed> for Callback {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, CallerFailed> {
        let mut force = f64::NAN;
        // SAFETY: the caller's function with its pointer
        match unsafe { (self.function)(self.user, t, x, xdot, &mut force) } {
            0 => Ok(force),
            _ => Err(CallerFailed),
        }
    }
}

/// Nobody watches a run.
pub(crate) struct UnwatchedRun;

impl Monitor<CallerFailed> for UnwatchedRun {
    fn poll(&mut self, _: usize, _: usize) -> Result<(), CallerFailed> {
        Ok(())
    }
}
