/* zivi: a mass with impacts, and its twisting controllers, straight through the Zeno point.
 *
 * Link with libzivi.a and nothing else. Every object is a structure of plain numbers that the
 * caller owns: copy it, log it, store it, restore it. Nothing is allocated, nothing is kept
 * elsewhere, no function panics or calls another library, and the work of a call is bounded.
 *
 *     zivi_tracker tracker;
 *     zivi_tracker_config config;
 *     zivi_tracker_defaults(&config);      // or memset 0 and config.size = sizeof config
 *     config.mu1 = 30.0, config.mu2 = 17.0, config.h = 1e-3, config.e = 0.5;
 *     int32_t code = zivi_tracker_init(&tracker, &config);
 *     ...
 *     code = zivi_tracker_step(&tracker, x, xdot, force, force_ref, &u);   // once a period
 *
 * A code is ZIVI_OK, or bits (ZIVI_CLAMPED, ZIVI_SATURATED), or < 0 (ZIVI_E_...): then nothing has
 * changed, but a step has set *u to the last control. zivi_message() gives it in words.
 *
 * Units are those of SI; forces and controls are per unit mass (m/s^2). The numbers must be IEEE
 * doubles in the default mode: no flush to zero, no -ffast-math.
 *
 * Made by cbindgen from crates/zivi-c; do not edit. Apache-2.0. */


#ifndef ZIVI_H
#define ZIVI_H

#include <stdint.h>

// Version of this interface. It changes if a structure or the meaning of a function changes.
#define ZIVI_ABI_VERSION 3

// Success.
#define ZIVI_OK 0

// Bit: the measured position was slightly negative and was taken as 0.
#define ZIVI_CLAMPED 1

// Bit: the control was cut to the actuator's range.
#define ZIVI_SATURATED 2

// A pointer is NULL or not aligned.
#define ZIVI_E_NULL -1

// The member `size` of a configuration is not the size of any version of it.
#define ZIVI_E_SIZE -2

// The object was not initialised, or its settings were changed since, or it is damaged.
#define ZIVI_E_STATE -3

// The state or the force is too large to compute with.
#define ZIVI_E_OVERFLOW -4

// No solution of a step was found within rounding.
#define ZIVI_E_NO_SOLUTION -5

// `h` is not a finite period > 0.
#define ZIVI_E_H -10

// `e` is not in (0, 1].
#define ZIVI_E_E -11

// `kappa` is not in [0, 1), or `e` and `kappa` do not belong together.
#define ZIVI_E_KAPPA -12

// `e_ref` is not in (0, 1].
#define ZIVI_E_E_REF -13

// `kappa_ref` is not in [0, 1), or `e_ref` and `kappa_ref` do not belong together.
#define ZIVI_E_KAPPA_REF -14

// `mu1` is not a gain > 0, or too small for `bound`.
#define ZIVI_E_MU1 -15

// `mu2` is not a gain with 0 < mu2 < mu1, or too small for `bound`.
#define ZIVI_E_MU2 -16

// `bound` is not finite and >= 0.
#define ZIVI_E_BOUND -17

// `depth` is not finite and >= 0.
#define ZIVI_E_DEPTH -18

// `u_min` is not a number.
#define ZIVI_E_U_MIN -19

// `u_max` is not greater than `u_min`.
#define ZIVI_E_U_MAX -20

// `ahead` is too large (`ahead h` is not finite), or given for `ZIVI_TICK_PAPER`.
#define ZIVI_E_AHEAD -21

// `branch` is neither `ZIVI_BRANCH_POSITIVE` nor `ZIVI_BRANCH_NEAREST`.
#define ZIVI_E_BRANCH -22

// `tick` is neither `ZIVI_TICK_LANDING` nor `ZIVI_TICK_PAPER`.
#define ZIVI_E_TICK -23

// `press` is not finite and at least `bound`, or given for `ZIVI_TICK_PAPER`.
#define ZIVI_E_PRESS -24

// `horizon` is not a finite number of periods >= 1, or `horizon h` is not finite.
#define ZIVI_E_HORIZON -25

// `shift` is neither 0 nor 1.
#define ZIVI_E_SHIFT -26

// `noise_x` or `noise_xdot` is not a standard deviation that can be computed with.
#define ZIVI_E_NOISE -27

// `q_d` is not a finite variance >= 0.
#define ZIVI_E_Q_D -28

// `se` is not in [0, 1].
#define ZIVI_E_SE -29

// `x` is not finite, or less than `-depth`.
#define ZIVI_E_X -30

// `xdot` is not finite.
#define ZIVI_E_XDOT -31

// `force` is not finite.
#define ZIVI_E_FORCE -32

// `force_ref` is not finite, or too large for the reference to stay finite.
#define ZIVI_E_FORCE_REF -33

// The control is not finite: the sample is too large to compute with.
#define ZIVI_E_U -34

// `x_ref` is not finite and >= 0.
#define ZIVI_E_X_REF -35

// `xdot_ref` is not finite.
#define ZIVI_E_XDOT_REF -36

// `acceleration` of the reference is infinite.
#define ZIVI_E_ACCELERATION -37

// `side` of a given reference is neither +1 nor -1.
#define ZIVI_E_SIDE -38

// `dmax` is not a bound from 0 to 1e150.
#define ZIVI_E_DMAX -39

// `position_only` is neither 0 nor 1.
#define ZIVI_E_POSITION_ONLY -40

// `learn_e` is neither 0 nor 1.
#define ZIVI_E_LEARN_E -41

// `q_e` is not in [0, 1].
#define ZIVI_E_Q_E -42

// `dt` is not a finite time > 0.
#define ZIVI_E_DT -43

// `quiet` is not finite and >= 0, or given for `ZIVI_TICK_PAPER`.
#define ZIVI_E_QUIET -44

// `given` has a bit of a member that the configuration does not have.
#define ZIVI_E_GIVEN -45

// `delay` is more than 64 periods.
#define ZIVI_E_DELAY -46

// A setting without a code of its own.
#define ZIVI_E_SETTING -99

// In `tick`: the control update that ends in exact rest, the default.
#define ZIVI_TICK_LANDING 0

// In `tick`: the control update of the paper.
#define ZIVI_TICK_PAPER 1

// In `given`: `e` is set, even if it is 0.
#define ZIVI_GIVEN_E 1

// In `given`: `kappa` is set, even if it is 0 (`e` = 1).
#define ZIVI_GIVEN_KAPPA 2

// In `given`: `e_ref` is set.
#define ZIVI_GIVEN_E_REF 4

// In `given`: `kappa_ref` is set.
#define ZIVI_GIVEN_KAPPA_REF 8

// In `given`: `ahead` is set.
#define ZIVI_GIVEN_AHEAD 16

// In `given`: `press` is set.
#define ZIVI_GIVEN_PRESS 32

// In `given`: `horizon` is set.
#define ZIVI_GIVEN_HORIZON 64

// In `given`: `depth` is set.
#define ZIVI_GIVEN_DEPTH 128

// In `given`: `u_min` and `u_max` are set.
#define ZIVI_GIVEN_U_LIMITS 256

// In `given`: `noise_x` is set.
#define ZIVI_GIVEN_NOISE_X 512

// In `given`: `noise_xdot` is set.
#define ZIVI_GIVEN_NOISE_XDOT 1024

// In `given`: `q_d` is set.
#define ZIVI_GIVEN_Q_D 2048

// In `given`: `dmax` is set.
#define ZIVI_GIVEN_DMAX 4096

// In `branch`: measurements are lifted to `s >= 0`, the default.
#define ZIVI_BRANCH_POSITIVE 0

// In `branch`: measurements are lifted to the preimage that is nearer to the reference.
#define ZIVI_BRANCH_NEAREST 1

// Settings of a mass. A member that is zero has its default value, unless its bit
// of `given` is set.
typedef struct zivi_mass_config {
  // `sizeof(zivi_mass_config)`.
  uint32_t size;
  // `ZIVI_GIVEN_...`: the members whose value 0 is intended and replaces the default.
  uint32_t given;
  // Step size (s), > 0.
  double h;
  // Coefficient of restitution, in (0, 1]; or set `kappa`.
  double e;
  // `(1 - e)/(1 + e)`, in (0, 1), in place of `e`.
  double kappa;
} zivi_mass_config;

// A mass above a wall. Everything in it may be read, copied and logged; it is changed by
// `zivi_mass_*` alone.
typedef struct zivi_mass {
  // Step size (s).
  double h;
  // Coefficient of restitution.
  double e;
  // `(1 - e)/(1 + e)`.
  double kappa;
  // Transformed position, `x = |s|` (m).
  double s;
  // Transformed velocity (m/s).
  double v;
  // The side of the wall on which `s` was last, +1 or -1.
  double side;
  // Distance from the wall (m).
  double x;
  // Velocity; at the wall the one after the impact (m/s).
  double xdot;
  // Selection of `sgn s` in the last step, in [-1, 1].
  double lambda_s;
  // Selection of `sgn v` in the last step, in [-1, 1].
  double lambda_v;
  // Steps since the start.
  uint64_t steps;
  // Checksum of the settings, which reveals a damaged or uninitialised object.
  uint64_t seal;
} zivi_mass;

// Settings of a regulator. A member that is zero has its default value, unless its bit
// of `given` is set.
typedef struct zivi_regulator_config {
  // `sizeof(zivi_regulator_config)`.
  uint32_t size;
  // `ZIVI_TICK_LANDING` or `ZIVI_TICK_PAPER`.
  uint32_t tick;
  // Horizon of the contact-establishing law in periods, 1 + the periods of delay; by default 1.
  uint32_t ahead;
  // `ZIVI_GIVEN_...`: the members whose value 0 is intended and replaces the default.
  uint32_t given;
  // Gain on the sign of the position (m/s^2).
  double mu1;
  // Gain on the sign of the velocity, 0 < mu2 < mu1 (m/s^2).
  double mu2;
  // Sampling period (s), > 0.
  double h;
  // Coefficient of restitution of the wall, in (0, 1]; or set `kappa`.
  double e;
  // `(1 - e)/(1 + e)`, in (0, 1), in place of `e`.
  double kappa;
  // A bound of the unknown force that the gains are checked against (m/s^2); by default none.
  double bound;
  // Dead zone of the contact-establishing law, a bound of the velocity error (m/s); by default 0.
  double quiet;
  // Measurements down to `-depth` are replaced by 0, deeper ones are rejected (m); by default 0.1.
  double depth;
  // Least control of the actuator (m/s^2); unlimited while both are 0.
  double u_min;
  // Largest control of the actuator (m/s^2).
  double u_max;
} zivi_regulator_config;

// A regulator. Everything in it may be read, copied and logged; it is changed by
// `zivi_regulator_*` alone.
typedef struct zivi_regulator {
  // Gain on the sign of the position (m/s^2).
  double mu1;
  // Gain on the sign of the velocity (m/s^2).
  double mu2;
  // Sampling period (s).
  double h;
  // Coefficient of restitution.
  double e;
  // `(1 - e)/(1 + e)`.
  double kappa;
  // Dead zone of the contact-establishing law (m/s).
  double quiet;
  // Largest penetration of a valid measurement (m).
  double depth;
  // Least control (m/s^2).
  double u_min;
  // Largest control (m/s^2).
  double u_max;
  // Horizon of the contact-establishing law in periods, 0 for the update of the paper.
  uint32_t ahead;
  // 0.
  uint32_t reserved;
  // The last control (m/s^2).
  double u;
  // Selection of `sgn s` in the last update, in [-1, 1].
  double lambda_s;
  // Selection of `sgn v` in the last update, in [-1, 1].
  double lambda_v;
  // Updates since the start.
  uint64_t ticks;
  // Bits of the changes to the last sample (clamped) and control (saturated).
  uint32_t status;
  // 0.
  uint32_t unused;
  // Checksum of the settings, which reveals a damaged or uninitialised object.
  uint64_t seal;
} zivi_regulator;

// Settings of a tracker. A member that is zero has its default value, unless its bit
// of `given` is set.
typedef struct zivi_tracker_config {
  // `sizeof(zivi_tracker_config)`.
  uint32_t size;
  // `ZIVI_BRANCH_POSITIVE` or `ZIVI_BRANCH_NEAREST`.
  uint32_t branch;
  // `ZIVI_TICK_LANDING` or `ZIVI_TICK_PAPER`.
  uint32_t tick;
  // Horizon of the contact-establishing law in periods, 1 + the periods of delay; by default 1.
  uint32_t ahead;
  // 1: in free flight the measured velocity is shifted back by half a period; 0: it is not.
  uint32_t shift;
  // `ZIVI_GIVEN_...`: the members whose value 0 is intended and replaces the default.
  uint32_t given;
  // Gain on the sign of the position error (m/s^2).
  double mu1;
  // Gain on the sign of the velocity error, 0 < mu2 < mu1 (m/s^2).
  double mu2;
  // Sampling period (s), > 0.
  double h;
  // Coefficient of restitution of the plant's wall, in (0, 1]; or set `kappa`.
  double e;
  // `(1 - e)/(1 + e)`, in (0, 1), in place of `e`.
  double kappa;
  // Coefficient of restitution of the reference's wall; by default the plant's.
  double e_ref;
  // `(1 - e_ref)/(1 + e_ref)` in place of `e_ref`.
  double kappa_ref;
  // A bound of the unknown force that the gains are checked against (m/s^2); by default none.
  double bound;
  // Acceleration towards the wall of a mass at rest, at least `bound` (m/s^2); by default the
  // law's own.
  double press;
  // Dead zone of the contact-establishing law, a bound of the velocity error (m/s); by default 0.
  double quiet;
  // Periods that a step is planned over, >= 1; by default 1.
  double horizon;
  // Measurements down to `-depth` are replaced by 0, deeper ones are rejected (m); by default 0.1.
  double depth;
  // Least control of the actuator (m/s^2); unlimited while both are 0.
  double u_min;
  // Largest control of the actuator (m/s^2).
  double u_max;
} zivi_tracker_config;

// A tracker with its reference. Everything in it may be read, copied and logged; it is changed by
// `zivi_tracker_*` alone.
typedef struct zivi_tracker {
  // Gain on the sign of the position error (m/s^2).
  double mu1;
  // Gain on the sign of the velocity error (m/s^2).
  double mu2;
  // Sampling period (s).
  double h;
  // Coefficient of restitution of the plant's wall.
  double e;
  // `(1 - e)/(1 + e)`.
  double kappa;
  // Coefficient of restitution of the reference's wall.
  double e_ref;
  // `(1 - e_ref)/(1 + e_ref)`.
  double kappa_ref;
  // Acceleration towards the wall of a mass at rest (m/s^2), infinite for the law's own.
  double press;
  // Dead zone of the contact-establishing law (m/s).
  double quiet;
  // Periods that a step is planned over.
  double horizon;
  // Largest penetration of a valid measurement (m).
  double depth;
  // Least control (m/s^2).
  double u_min;
  // Largest control (m/s^2).
  double u_max;
  // How measurements are lifted.
  uint32_t branch;
  // Horizon of the contact-establishing law in periods, 0 for the update of the paper.
  uint32_t ahead;
  // Whether the measured velocity is shifted back by half a period in free flight.
  uint32_t shift;
  // 0.
  uint32_t reserved;
  // The reference's transformed position (m).
  double s_ref;
  // The reference's transformed velocity (m/s).
  double v_ref;
  // The side of the wall on which the reference was last, +1 or -1.
  double side;
  // The reference at the next sample: its distance from the wall (m).
  double x_ref;
  // The reference's velocity (m/s).
  double xdot_ref;
  // The last control (m/s^2).
  double u;
  // Selection of `sgn s` in the last update, in [-1, 1].
  double lambda_s;
  // Selection of `sgn v`.
  double lambda_v;
  // Selection of `sgn s_ref`.
  double lambda_sr;
  // Selection of `sgn v_ref`.
  double lambda_vr;
  // Selection of `sgn (s - s_ref)`.
  double lambda_es;
  // Selection of `sgn (v - v_ref)`.
  double lambda_ev;
  // Updates since the last reset.
  uint64_t ticks;
  // Bits of the changes to the last sample (clamped) and control (saturated).
  uint32_t status;
  // Iterations of the last update.
  uint32_t iterations;
  // Checksum of the settings, which reveals a damaged or uninitialised object.
  uint64_t seal;
} zivi_tracker;

// A reference that is given, at one sample.
typedef struct zivi_given_reference {
  // Distance from the wall, >= 0 (m).
  double x;
  // Velocity (m/s).
  double xdot;
  // The side of the wall on which it is followed, +1 or -1: it changes with each impact of the
  // reference. Only `ZIVI_BRANCH_NEAREST` looks at it.
  double side;
} zivi_given_reference;

// Settings of an observer. A member that is zero has its default value, unless its bit
// of `given` is set.
typedef struct zivi_observer_config {
  // `sizeof(zivi_observer_config)`.
  uint32_t size;
  // 1: the velocity is not measured; 0: it is measured unless it is NaN.
  uint32_t position_only;
  // 1: `e` is estimated; `se` is then its initial standard deviation, by default 0.1.
  uint32_t learn_e;
  // `ZIVI_GIVEN_...`: the members whose value 0 is intended and replaces the default.
  uint32_t given;
  // Sampling period (s), > 0.
  double h;
  // Coefficient of restitution of the wall, in (0, 1]; or set `kappa`.
  double e;
  // `(1 - e)/(1 + e)`, in (0, 1), in place of `e`.
  double kappa;
  // Standard deviation of a measured position (m); by default 1e-4.
  double noise_x;
  // Standard deviation of a measured velocity (m/s); by default 1e-2.
  double noise_xdot;
  // Variance of the change of the unknown force in a period (m^2/s^4); by default 1e-3.
  double q_d;
  // Standard deviation of `e`; by default 0.
  double se;
  // Bound of the unknown force (m/s^2); by default 20.
  double dmax;
  // Variance that an impact adds to an estimated `e`; by default 0.
  double q_e;
} zivi_observer_config;

// An observer. Everything in it may be read, copied and logged; it is changed by
// `zivi_observer_*` alone.
typedef struct zivi_observer {
  // The settings, defaults filled in.
  struct zivi_observer_config config;
  // Estimate of the distance from the wall (m).
  double x;
  // Estimate of the velocity (m/s).
  double xdot;
  // Estimate of the unknown force (m/s^2).
  double d;
  // The coefficient of restitution, or its estimate.
  double e;
  // Covariance of the estimates.
  double p_xx;
  // Covariance of position and velocity.
  double p_xv;
  // Covariance of position and force.
  double p_xd;
  // Variance of the velocity.
  double p_vv;
  // Covariance of velocity and force.
  double p_vd;
  // Variance of the force.
  double p_dd;
  // Covariance of position and `e`.
  double p_xe;
  // Covariance of velocity and `e`.
  double p_ve;
  // Covariance of force and `e`.
  double p_de;
  // Variance of `e`, 0 if it is not estimated.
  double p_ee;
  // The last measured positions, the newest first, minus the displacement by the acceleration
  // since the measurement (m).
  double seen_y[6];
  // Time since each measurement (s).
  double seen_age[6];
  // Number of stored positions.
  uint32_t seen;
  // Whether the velocity waits for a second position.
  uint32_t waiting;
  // Whether there was a measurement.
  uint32_t started;
  // Measurements rejected in a row.
  uint32_t in_a_row;
  // Measurements rejected so far.
  uint32_t refused;
  // 0.
  uint32_t reserved;
  // Checksum of the settings, which reveals a damaged or uninitialised object.
  uint64_t seal;
} zivi_observer;

// Settings of a predictor. A member that is zero has its default value, unless its bit
// of `given` is set.
typedef struct zivi_predictor_config {
  // `sizeof(zivi_predictor_config)`.
  uint32_t size;
  // `ZIVI_GIVEN_...`: the members whose value 0 is intended and replaces the default.
  uint32_t given;
  // Periods from a measurement to the moment when its control acts, 0 to 64.
  uint32_t delay;
  // 0.
  uint32_t reserved;
  // Sampling period (s), > 0.
  double h;
  // Coefficient of restitution, in (0, 1]; or set `kappa`.
  double e;
  // `(1 - e)/(1 + e)`, in (0, 1), in place of `e`.
  double kappa;
  // Measurements down to `-depth` are replaced by 0, deeper ones are rejected (m); by default 0.1.
  double depth;
} zivi_predictor_config;

// A predictor with the controls that do not act yet. Everything in it may be read, copied and logged;
// it is changed by `zivi_predictor_*` alone.
typedef struct zivi_predictor {
  // Sampling period (s).
  double h;
  // Coefficient of restitution.
  double e;
  // `(1 - e)/(1 + e)`.
  double kappa;
  // Largest penetration of a valid measurement (m).
  double depth;
  // Periods from a measurement to the moment when its control acts.
  uint32_t delay;
  // 0.
  uint32_t reserved;
  // Predicted distance from the wall at the time when the control acts (m).
  double x;
  // Predicted velocity at that time (m/s).
  double xdot;
  // The controls that do not act yet (m/s^2): `sent[(first + k) % 64]`, k = 0 ... `delay` - 1.
  double sent[64];
  // Index of the oldest.
  uint32_t first;
  // 0.
  uint32_t reserved_too;
  // Checksum of the settings, which reveals a damaged or uninitialised object.
  uint64_t seal;
} zivi_predictor;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// `ZIVI_ABI_VERSION` of the library: compare it with that of the header.
uint32_t zivi_abi_version(void);

// The version of zivi, for instance "0.2.0".
const char *zivi_version(void);

// Meaning of a code, one line of English.
const char *zivi_message(int32_t code);

// `sizeof(zivi_mass)` in the library.
uint32_t zivi_mass_size(void);

// Sets `size`, and all other members to their default, 0. You set the members without a default:
// gains, period, wall.
int32_t zivi_mass_defaults(struct zivi_mass_config *config);

// Checks the settings and starts at rest on the wall. If the returned code is < 0, nothing is
// written.
int32_t zivi_mass_init(struct zivi_mass *mass, const struct zivi_mass_config *config);

// Puts the mass at `x` >= 0 (m) with velocity `xdot` (m/s).
int32_t zivi_mass_reset(struct zivi_mass *mass, double x, double xdot);

// Moves the mass by one step `h` under `force` per unit mass (m/s^2). The new state is
// `mass->x` (m) and `mass->xdot` (m/s), exactly 0 at rest.
int32_t zivi_mass_step(struct zivi_mass *mass, double force);

// `sizeof(zivi_regulator)` in the library.
uint32_t zivi_regulator_size(void);

// Sets `size`, and all other members to their default, 0. You set the members without a default:
// gains, period, wall.
int32_t zivi_regulator_defaults(struct zivi_regulator_config *config);

// Checks the settings. If the returned code is < 0, nothing is written.
int32_t zivi_regulator_init(struct zivi_regulator *regulator,
                            const struct zivi_regulator_config *config);

// Forgets the last update.
int32_t zivi_regulator_reset(struct zivi_regulator *regulator);

// The control for the period that starts with the measurement `x` (m), `xdot` (m/s): `*u`
// (m/s^2), to be held for one period. `force` acts on the mass without control (m/s^2).
//
// If a sample is invalid, the returned code is < 0, `*u` is the last control, and nothing else
// is written.
int32_t zivi_regulator_step(struct zivi_regulator *regulator,
                            double x,
                            double xdot,
                            double force,
                            double *u);

// `zivi_regulator_step` for a period of the length `dt` > 0 (s) instead of `h`. For a missing sample
// pass NaN as `x`: `*u` is then the last control, `xdot` and `force` are ignored.
int32_t zivi_regulator_step_over(struct zivi_regulator *regulator,
                                 double dt,
                                 double x,
                                 double xdot,
                                 double force,
                                 double *u);

// `sizeof(zivi_tracker)` in the library.
uint32_t zivi_tracker_size(void);

// Sets `size`, `horizon` to 1, and all other members to their default, 0. You set the members without
// a default: gains, period, wall.
int32_t zivi_tracker_defaults(struct zivi_tracker_config *config);

// Checks the settings; the reference starts at rest. If the returned code is < 0, nothing is
// written.
int32_t zivi_tracker_init(struct zivi_tracker *tracker,
                          const struct zivi_tracker_config *config);

// Puts the reference at `x_ref` >= 0 (m) with velocity `xdot_ref` (m/s) and forgets the last update.
int32_t zivi_tracker_reset(struct zivi_tracker *tracker,
                           double x_ref,
                           double xdot_ref);

// The control for the period that starts with the measurement `x` (m), `xdot` (m/s): `*u`
// (m/s^2), to be held for one period. `force` acts on the mass without control, `force_ref` on
// the reference (m/s^2), which advances by one period: `tracker->x_ref` is that at the next sample.
//
// If a sample is invalid, the returned code is < 0, `*u` is the last control, and nothing else
// is written: the reference has not advanced.
int32_t zivi_tracker_step(struct zivi_tracker *tracker,
                          double x,
                          double xdot,
                          double force,
                          double force_ref,
                          double *u);

// `zivi_tracker_step` for a given reference, at this sample (`now`) and at the next one (`next`).
// `acceleration` is that of the reference over the period (m/s^2). If it is NaN, the difference quotient
// of the velocities replaces it, or `force` if the reference has an impact in the period.
int32_t zivi_tracker_step_to(struct zivi_tracker *tracker,
                             double x,
                             double xdot,
                             double force,
                             const struct zivi_given_reference *now,
                             const struct zivi_given_reference *next,
                             double acceleration,
                             double *u);

// `zivi_tracker_step` for a period of the length `dt` > 0 (s) instead of `h`: the reference advances by
// `dt`; `horizon` and `ahead` count periods of this length. For a missing sample pass NaN as `x`: `*u` is
// then the last control, the reference advances, `xdot` and `force` are
// ignored.
int32_t zivi_tracker_step_over(struct zivi_tracker *tracker,
                               double dt,
                               double x,
                               double xdot,
                               double force,
                               double force_ref,
                               double *u);

// `zivi_tracker_step_to` for a period of `dt` > 0 (s), or without a sample, in the same way.
int32_t zivi_tracker_step_to_over(struct zivi_tracker *tracker,
                                  double dt,
                                  double x,
                                  double xdot,
                                  double force,
                                  const struct zivi_given_reference *now,
                                  const struct zivi_given_reference *next,
                                  double acceleration,
                                  double *u);

// `sizeof(zivi_observer)` in the library.
uint32_t zivi_observer_size(void);

// Sets `size`, and all other members to their default, 0. You set the members without a default:
// period, wall.
int32_t zivi_observer_defaults(struct zivi_observer_config *config);

// Checks the settings and forgets all measurements. If the returned code is < 0, nothing is written.
int32_t zivi_observer_init(struct zivi_observer *observer,
                           const struct zivi_observer_config *config);

// Forgets all measurements.
int32_t zivi_observer_reset(struct zivi_observer *observer);

// Updates the estimates with the measurement `x` (m), `xdot` (m/s, NaN if not measured). `force` is the
// known force, `u` the control that acted over the period that ends now (m/s^2). The estimates are
// `observer->x` (m), `->xdot` (m/s) and `->d`, the unknown force (m/s^2); they are valid from
// `observer->started` on. For a missing measurement pass NaN as `x`: the estimates are predicted and
// not corrected, `xdot` is ignored.
//
// If the returned code is < 0, the measurement is invalid and nothing has changed.
int32_t zivi_observer_step(struct zivi_observer *observer,
                           double x,
                           double xdot,
                           double force,
                           double u);

// `zivi_observer_step` if `dt` (s) passed since the last call, instead of `h`.
int32_t zivi_observer_step_after(struct zivi_observer *observer,
                                 double dt,
                                 double x,
                                 double xdot,
                                 double force,
                                 double u);

// `sizeof(zivi_predictor)` in the library.
uint32_t zivi_predictor_size(void);

// Sets `size`, and all other members to their default, 0. You set the members without a default:
// delay, period, wall.
int32_t zivi_predictor_defaults(struct zivi_predictor_config *config);

// Checks the settings; no control is pending. If the returned code is < 0, nothing is written.
int32_t zivi_predictor_init(struct zivi_predictor *predictor,
                            const struct zivi_predictor_config *config);

// Forgets pending controls: a control of 0 acts until the first one that is sent does.
int32_t zivi_predictor_reset(struct zivi_predictor *predictor);

// Predicts from the measurement `x` (m), `xdot` (m/s) and the known `force` (m/s^2) the state at which the
// control of this sample acts, through impacts and into rest: `predictor->x` and `->xdot`. Pass them
// to a controller (`ahead` 1) in place of the measurement. Its reference is `delay` periods ahead: call
// `zivi_tracker_step_over` `delay` times without a sample after a reset. Then `zivi_predictor_send`.
int32_t zivi_predictor_step(struct zivi_predictor *predictor,
                            double x,
                            double xdot,
                            double force);

// Stores the control that is sent (m/s^2), after limits. Call it once a period, and with the last control
// if that is held.
int32_t zivi_predictor_send(struct zivi_predictor *predictor,
                            double u);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* ZIVI_H */
