/* zivi on a machine with an operating system: simulation of masses and of mechanical systems with
 * impacts, box variational inequalities. Link with the shared library libzivi, which has the functions
 * of zivi.h too; zivi.hpp is the same for C++17.
 *
 * A code < 0 means that nothing was computed: zivi_last_error() says what was wrong, in words. Any
 * function may be called from any thread; one run must not be used by two threads at once. Functions
 * of yours must not throw C++ exceptions or longjmp across zivi.
 *
 * Made by cbindgen from crates/zivi-host; do not edit. Apache-2.0. */


#ifndef ZIVI_HOST_H
#define ZIVI_HOST_H

#include <stddef.h>
#include <stdint.h>
#include "zivi.h"

// An argument is out of range and is named by `zivi_last_error`; nothing was computed.
#define ZIVI_E_INVALID -50

// A fault in zivi, described by `zivi_last_error`.
#define ZIVI_E_PANIC -51

// Insufficient memory; nothing was computed.
#define ZIVI_E_MEMORY -52

// A run of a mechanical system.
typedef struct zivi_mechanical_run zivi_mechanical_run;

// A run.
typedef struct zivi_run zivi_run;

// Writes a system at `t`, `q`, `w = q'` into `out`, one after another: the mass matrix (n x n), the
// forces (n), the gaps (m), their gradients (m x n), the rest of their second derivatives (m), their
// partial derivatives in time (m). A return value other than 0 ends the run, which keeps its data.
typedef int32_t (*zivi_evaluation)(void *user,
                                   double t,
                                   const double *q,
                                   const double *w,
                                   double *out);

// A system of `n` coordinates above `m` gaps.
typedef struct zivi_mechanics {
  // `sizeof(zivi_mechanics)`.
  uint32_t size;
  // 0.
  uint32_t reserved;
  // Coordinates.
  size_t n;
  // Gaps.
  size_t m;
  // Coefficients of restitution, one for each gap.
  const double *e;
  // The system.
  zivi_evaluation function;
  // Pointer that is passed to `function`.
  void *user;
} zivi_mechanics;

// How a run is computed. A member that is zero has its default value.
typedef struct zivi_method {
  // `sizeof(zivi_method)`.
  uint32_t size;
  // 0.
  uint32_t reserved;
  // Step of the implicit Euler scheme (s); 0: none. Then a mass above a wall flies by power series
  // where the force is constant, exactly but for rounding, and everything else moves by a
  // Runge-Kutta pair of order 8 with error control.
  double h;
  // Relative tolerance, by default 1e-6: of the pair's steps, and of the times at which impacts
  // accumulate. Flights by power series do not depend on it.
  double rtol;
  // Absolute tolerance, by default 1e-9, of the same.
  double atol;
  // Longest step (s), by default none.
  double max_step;
  // Times of the samples, increasing; NULL: where the steps end.
  const double *t_eval;
  // Number of these times.
  size_t n_eval;
} zivi_method;

// A force per unit mass: writes `f(t, x, xdot)` (m/s^2) to `*force`; another return value than 0 ends the run, which
// keeps its data. `user` is the pointer of the system.
typedef int32_t (*zivi_force_function)(void *user,
                                       double t,
                                       double x,
                                       double xdot,
                                       double *force);

// `x'' = f`, `x >= 0`, `x'+ = -e x'-`. A member that is zero has its default value.
typedef struct zivi_system {
  // `sizeof(zivi_system)`.
  uint32_t size;
  // 0.
  uint32_t reserved;
  // Coefficient of restitution, in [0, 1]; or set `kappa`.
  double e;
  // `(1 - e)/(1 + e)`, in place of `e`.
  double kappa;
  // The constant force (m/s^2), used if `function` is NULL.
  double force;
  // The force as a function; NULL for a constant force.
  zivi_force_function function;
  // Pointer that is passed to `function`.
  void *user;
} zivi_system;

// An impact that was resolved.
typedef struct zivi_impact {
  // Time (s).
  double t;
  // Velocity before (m/s).
  double xdot_before;
  // Velocity after (m/s).
  double xdot_after;
} zivi_impact;

// Writes `F(z)`, `n` numbers, into `f`; another return value than 0 ends the solve, which keeps its best point.
typedef int32_t (*zivi_map_function)(void *user, size_t n, const double *z, double *f);

// Writes `dF_i/dz_j` into `jacobian[i n + j]`; another return value than 0 ends the solve.
typedef int32_t (*zivi_jacobian_function)(void *user,
                                          size_t n,
                                          const double *z,
                                          double *jacobian);

// A box VI. A member that is zero or NULL has its default value.
typedef struct zivi_vi_problem {
  // `sizeof(zivi_vi_problem)`.
  uint32_t size;
  // 0.
  uint32_t reserved;
  // Unknowns.
  size_t n;
  // Lower bounds; NULL: all are minus infinity.
  const double *lower;
  // Upper bounds; NULL: all are infinity.
  const double *upper;
  // The map (not for `zivi_solve_avi`).
  zivi_map_function map;
  // Its Jacobian; NULL: differences of the map.
  zivi_jacobian_function jacobian;
  // Pointer that is passed to both functions.
  void *user;
  // Largest natural residual of a solution, by default 1e-9.
  double tol;
} zivi_vi_problem;

// Result of a solve.
typedef struct zivi_vi_report {
  // 0 and 1: solved; see `zivi_vi_message`.
  int32_t status;
  // 0.
  uint32_t reserved;
  // Natural residual at `z`.
  double residual;
  // Iterations.
  uint64_t iterations;
  // Evaluations of the map.
  uint64_t evaluations;
} zivi_vi_report;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Message of the last call of this thread that returned a code < 0; valid until the next such call.
const char *zivi_last_error(void);

// Simulates from `q0`, `w0` and returns the run, to be freed by `zivi_mechanical_free`. Codes are those
// of `zivi_simulate`; `method` may be NULL, and must not have an `h`.
int32_t zivi_simulate_mechanical(const struct zivi_mechanics *system,
                                 const struct zivi_method *method,
                                 double t0,
                                 double t1,
                                 const double *q0,
                                 const double *w0,
                                 struct zivi_mechanical_run **run);

// Frees a run; NULL is harmless.
void zivi_mechanical_free(struct zivi_mechanical_run *run);

// How the run ended, 0 if the end was reached; see `zivi_status_message`.
int32_t zivi_mechanical_status(const struct zivi_mechanical_run *run);

// Number of samples.
size_t zivi_mechanical_samples(const struct zivi_mechanical_run *run);

// The samples one after another, valid until the run is freed: 0 the times; 1 the coordinates and
// the gaps (n + m numbers a sample); 2 their velocities; 3 the contact forces (m). NULL for another
// one.
const double *zivi_mechanical_column(const struct zivi_mechanical_run *run,
                                     uint32_t column);

// Sets the size, and all other members to their defaults.
int32_t zivi_system_defaults(struct zivi_system *system);

// Sets the size, and all other members to their defaults.
int32_t zivi_method_defaults(struct zivi_method *method);

// Simulates from `t0` to `t1` and returns the run, to be freed by `zivi_run_free`. The code is the
// status of the run, 0 if the end was reached: a run that ended early keeps its data.
// If it is < 0, nothing was computed and `*run` is NULL. `method` may be NULL.
int32_t zivi_simulate(const struct zivi_system *system,
                      const struct zivi_method *method,
                      double t0,
                      double t1,
                      double x0,
                      double xdot0,
                      struct zivi_run **run);

// Frees a run; NULL is harmless.
void zivi_run_free(struct zivi_run *run);

// How the run ended, 0 if the end was reached; see `zivi_status_message`.
int32_t zivi_run_status(const struct zivi_run *run);

// Number of samples.
size_t zivi_run_samples(const struct zivi_run *run);

// A column of the samples, valid until the run is freed: 0 t, 1 x, 2 xdot, 3 s, 4 v; NULL for
// another one.
const double *zivi_run_column(const struct zivi_run *run, uint32_t column);

// The time from which the mass is at rest until the end (s), NaN if it is not.
double zivi_run_rest_time(const struct zivi_run *run);

// The impacts that were resolved, valid until the run is freed; `*count` is their number.
const struct zivi_impact *zivi_run_impacts(const struct zivi_run *run, size_t *count);

// Meaning and remedy of the status of a run.
const char *zivi_status_message(int32_t status);

// Sets the size, and all other members to their defaults.
int32_t zivi_vi_defaults(struct zivi_vi_problem *problem);

// Solves a box VI from the initial point `z`, which the best point found replaces. The code is the
// status, 0 or 1 if solved. It is < 0 if the problem was rejected; `z` is then unchanged. `report`
// may be NULL.
int32_t zivi_solve_vi(const struct zivi_vi_problem *problem,
                      double *z,
                      struct zivi_vi_report *report);

// Solves the affine box VI of `F(z) = M z + q`, `M` row by row; otherwise as `zivi_solve_vi`.
// Only the bounds, `n` and `tol` of `problem` are used.
int32_t zivi_solve_avi(const struct zivi_vi_problem *problem,
                       const double *matrix,
                       const double *q,
                       double *z,
                       struct zivi_vi_report *report);

// Meaning and remedy of the status of a solve.
const char *zivi_vi_message(int32_t status);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* ZIVI_HOST_H */
