//! Box variational inequalities: find `z` in `[lower, upper]` with `F_i(z) >= 0` at the lower bound,
//! `<= 0` at the upper one, `= 0` between them.

use std::ffi::{c_char, c_void, CString};
use std::sync::OnceLock;

use zivi_core::vi::{
    self, Affine, Differenced, EvaluationError, InvalidInput, Problem, Report, Settings, Status,
    Workspace,
};

use crate::border::{array, checked_size, filled, guarded, read, written, Refused};
use zivi::numeric::lu::ByBlocks;

/// Writes `F(z)`, `n` numbers, into `f`; another return value than 0 ends the solve, which keeps its best point.
pub type MapFunction =
    Option<unsafe extern "C" fn(user: *mut c_void, n: usize, z: *const f64, f: *mut f64) -> i32>;

/// Writes `dF_i/dz_j` into `jacobian[i n + j]`; another return value than 0 ends the solve.
pub type JacobianFunction = Option<
    unsafe extern "C" fn(user: *mut c_void, n: usize, z: *const f64, jacobian: *mut f64) -> i32,
>;

/// A box VI. A member that is zero or NULL has its default value.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct ViProblem {
    /// `sizeof(zivi_vi_problem)`.
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// Unknowns.
    pub n: usize,
    /// Lower bounds; NULL: all are minus infinity.
    pub lower: *const f64,
    /// Upper bounds; NULL: all are infinity.
    pub upper: *const f64,
    /// The map (not for `zivi_solve_avi`).
    pub map: MapFunction,
    /// Its Jacobian; NULL: differences of the map.
    pub jacobian: JacobianFunction,
    /// Pointer that is passed to both functions.
    pub user: *mut c_void,
    /// Largest natural residual of a solution, by default 1e-9.
    pub tol: f64,
}

/// Result of a solve.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ViReport {
    /// 0 and 1: solved; see `zivi_vi_message`.
    pub status: i32,
    /// 0.
    pub reserved: u32,
    /// Natural residual at `z`.
    pub residual: f64,
    /// Iterations.
    pub iterations: u64,
    /// Evaluations of the map.
    pub evaluations: u64,
}

/// Sets the size, and all other members to their defaults.
#[no_mangle]
pub unsafe extern "C" fn zivi_vi_defaults(problem: *mut ViProblem) -> i32 {
    guarded(|| {
        // SAFETY: the caller's
        *unsafe { written(problem) }? = ViProblem {
            size: size_of::<ViProblem>() as u32,
            reserved: 0,
            n: 0,
            lower: std::ptr::null(),
            upper: std::ptr::null(),
            map: None,
            jacobian: None,
            user: std::ptr::null_mut(),
            tol: 0.0,
        };
        Ok(0)
    })
}

/// Solves a box VI from the initial point `z`, which the best point found replaces. The code is the
/// status, 0 or 1 if solved. It is < 0 if the problem was rejected; `z` is then unchanged. `report`
/// may be NULL.
#[no_mangle]
pub unsafe extern "C" fn zivi_solve_vi(
    problem: *const ViProblem,
    z: *mut f64,
    report: *mut ViReport,
) -> i32 {
    guarded(|| {
        // SAFETY: the caller's
        let given = unsafe { BoundedProblem::of(problem)? };
        let map = given.problem.map.ok_or_else(Refused::null)?;
        let (n, user) = (given.problem.n, given.problem.user);
        let mut evaluations = 0;
        let map = |z: &[f64], f: &mut [f64]| {
            evaluations += 1;
            // SAFETY: the caller's function with its pointer
            answered(unsafe { map(user, n, z.as_ptr(), f.as_mut_ptr()) })
        };
        let outcome = match given.problem.jacobian {
            Some(jacobian) => {
                let mut problem = CallerJacobian { map, jacobian, user };
                // SAFETY: the caller's array
                unsafe { given.solve(&mut problem, z)? }
            }
            None => {
                let mut work = filled(0.0, 4 * n, ("n", n))?;
                let differenced = Differenced::new(map, &given.lower, &given.upper, &mut work);
                let mut problem = differenced.ok_or(InvalidInput::Workspace)?;
                // SAFETY: the caller's array
                unsafe { given.solve(&mut problem, z)? }
            }
        };
        // SAFETY: NULL or the caller's
        Ok(unsafe { told(&outcome, evaluations, report) })
    })
}

/// Solves the affine box VI of `F(z) = M z + q`, `M` row by row; otherwise as `zivi_solve_vi`.
/// Only the bounds, `n` and `tol` of `problem` are used.
#[no_mangle]
pub unsafe extern "C" fn zivi_solve_avi(
    problem: *const ViProblem,
    matrix: *const f64,
    q: *const f64,
    z: *mut f64,
    report: *mut ViReport,
) -> i32 {
    guarded(|| {
        // SAFETY: the caller's
        let given = unsafe { BoundedProblem::of(problem)? };
        let n = given.problem.n;
        let entries = n.checked_mul(n).ok_or("n must be small enough for n^2 numbers")?;
        // SAFETY: the caller's arrays
        let (matrix, q) = unsafe { (array(matrix, entries)?, array(q, n)?) };
        finite("matrix", matrix)?;
        finite("q", q)?;
        // SAFETY: the caller's array
        let outcome = unsafe { given.solve(&mut Affine { matrix, q }, z)? };
        // SAFETY: NULL or the caller's
        Ok(unsafe { told(&outcome, outcome.counts.f as u64, report) })
    })
}

/// Meaning and remedy of the status of a solve.
#[no_mangle]
pub extern "C" fn zivi_vi_message(status: i32) -> *const c_char {
    const ALL: [Status; 10] = [
        Status::Solved,
        Status::SolvedNotIsolated,
        Status::Stationary,
        Status::Stalled,
        Status::IterationLimit,
        Status::PivotLimit,
        Status::DomainError,
        Status::EvaluationError,
        Status::Infeasible,
        Status::Stopped,
    ];
    static WORDS: OnceLock<Vec<CString>> = OnceLock::new();
    let words = WORDS.get_or_init(|| {
        ALL.iter().map(|it| CString::new(it.message()).unwrap_or_default()).collect()
    });
    let known = usize::try_from(status).ok().and_then(|status| words.get(status));
    known.map_or(c"not a status of this library".as_ptr(), |it| it.as_ptr())
}

fn finite(name: &str, values: &[f64]) -> Result<(), Refused> {
    match values.iter().position(|it| !it.is_finite()) {
        Some(k) => Err(Refused::from(format!("{name}[{k}] must be finite, got {:?}", values[k]))),
        None => Ok(()),
    }
}

fn answered(code: i32) -> Result<(), EvaluationError> {
    if code == 0 {
        Ok(())
    } else {
        Err(EvaluationError)
    }
}

unsafe fn told(outcome: &Report, evaluations: u64, report: *mut ViReport) -> i32 {
    let status = outcome.status as i32;
    // SAFETY: NULL or the caller's
    if let Ok(report) = unsafe { written(report) } {
        *report = ViReport {
            status,
            reserved: 0,
            residual: outcome.residual,
            iterations: outcome.counts.iterations as u64,
            evaluations,
        };
    }
    status
}

/// A copy of an array of `n` numbers.
fn copied(of: &[f64]) -> Result<Vec<f64>, Refused> {
    let mut list = filled(0.0, of.len(), ("n", of.len()))?;
    list.copy_from_slice(of);
    Ok(list)
}

/// A problem with bounds for all components.
struct BoundedProblem<'a> {
    problem: &'a ViProblem,
    lower: Vec<f64>,
    upper: Vec<f64>,
}

impl BoundedProblem<'_> {
    unsafe fn of(problem: *const ViProblem) -> Result<Self, Refused> {
        // SAFETY: the caller's
        let problem = unsafe { read(problem)? };
        checked_size::<ViProblem>(problem.size)?;
        let n = problem.n;
        // whose matrices no machine holds, and whose lengths are numbers
        if n > 1 << 24 {
            return Err(Refused::memory("n", n));
        }
        let bounds = |given: *const f64, other: f64| -> Result<Vec<f64>, Refused> {
            if given.is_null() {
                return filled(other, n, ("n", n));
            }
            // SAFETY: the caller's array
            copied(unsafe { array(given, n)? })
        };
        let lower = bounds(problem.lower, f64::NEG_INFINITY)?;
        let upper = bounds(problem.upper, f64::INFINITY)?;
        Ok(Self { problem, lower, upper })
    }

    unsafe fn solve(&self, problem: &mut dyn Problem, z: *mut f64) -> Result<Report, Refused> {
        let n = self.problem.n;
        vi::validate_bounds(n, &self.lower, &self.upper)?;
        // SAFETY: the caller's array
        let mut point = copied(unsafe { array(z, n)? })?;
        let tol = match self.problem.tol {
            0.0 => Settings::default().tol,
            tol => tol,
        };
        let settings = Settings { tol, ..Settings::default() };
        let (reals, indices) = vi::workspace_len(n);
        let (mut reals, mut indices) =
            (filled(0.0, reals, ("n", n))?, filled(0, indices, ("n", n))?);
        let work = Workspace::new(n, &mut reals, &mut indices);
        let mut work = work.ok_or(InvalidInput::Workspace)?;
        let bounds = (&self.lower[..], &self.upper[..]);
        let problem = &mut ByBlocks(problem);
        let report = vi::solve(problem, bounds, &mut point, &settings, &mut work)?;
        // SAFETY: the caller's array, of which no reference is left
        unsafe { std::ptr::copy_nonoverlapping(point.as_ptr(), z, n) };
        Ok(report)
    }
}

/// A map with its Jacobian, both the caller's.
struct CallerJacobian<M> {
    map: M,
    jacobian: unsafe extern "C" fn(*mut c_void, usize, *const f64, *mut f64) -> i32,
    user: *mut c_void,
}

impl<M: FnMut(&[f64], &mut [f64]) -> Result<(), EvaluationError>> Problem for CallerJacobian<M> {
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        (self.map)(z, f)
    }

    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        // SAFETY: the caller's function with its pointer
        answered(unsafe { (self.jacobian)(self.user, z.len(), z.as_ptr(), jacobian.as_mut_ptr()) })
    }
}
