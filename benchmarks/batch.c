/* The yardstick of batches: many bouncing balls by hand, one step of all after the other.
 *
 * The scheme of ball.c (implicit Euler, theta = gamma = 1, constant force f < 0), the same for all
 * balls, and nothing recorded. By the symmetry (s, v) -> -(s, v) a ball is kept on the side s >= 0,
 * so |s| = x. With b = -h f the step is one of
 *
 *   free     v+ = P + Q, P = max(v - b/(1 - kappa), 0) and Q = min(v - b/(1 + kappa), 0), which
 *            is 0 at the apex; s+ = s + h ((1 - kappa) P + (1 + kappa) Q) > 0
 *   across   v+ = v + b/(1 - kappa)    s+ = s + h (1 - kappa) v+ < 0, then mirrored
 *   onto     s+ = 0    v+ = s (kappa v - b)/(kappa s + h b) <= 0, then mirrored; rest from s = 0
 *
 * All three are computed for every ball, and selected: no branch, so that a compiler vectorises
 * over the balls. The division is not within the selection, which a compiler that minds traps
 * would otherwise mask. C99, no dependencies but cos.
 *
 * batch_driven does the same under f = -k x - c x' - g + a cos(w t) <= 0, taken at the end of the
 * step. There x' = R v + h f and x = s + h x', so that the force of a free step is
 *
 *   f = (a cos(w t) - g - k s - (k h + c) R v)/(1 + c h + k h^2)
 *
 * with R of the start; the steps over the apex and onto the wall take it, too.
 */
#include <math.h>
#include <stddef.h>

/* Balls that are moved together: their states stay in the first-level cache. */
enum { BLOCK = 1024 };

typedef struct {
    double h, kappa, f;
    size_t balls, steps;
} batch_problem;

static inline double max(double a, double b) { return a > b ? a : b; }
static inline double min(double a, double b) { return a < b ? a : b; }

static void block(const batch_problem *p, size_t balls, double *restrict s, double *restrict v)
{
    const double b = -p->h * p->f, out = 1.0 - p->kappa, in = 1.0 + p->kappa;
    const double kick_out = b / out, kick_in = b / in, h_out = p->h * out, h_in = p->h * in;
    const double fastest = b / p->kappa, reach = p->h * fastest;
    for (size_t k = 0; k < p->steps; k++) {
        for (size_t i = 0; i < balls; i++) {
            const double rises = max(v[i] - kick_out, 0.0), falls = min(v[i] - kick_in, 0.0);
            const double s_free = s[i] + (h_out * rises + h_in * falls);
            const double v_over = v[i] + kick_out, s_over = s[i] + h_out * v_over;
            const double v_onto = s[i] * (fastest - v[i]), below = reach + s[i];
            const int free = s_free > 0.0, over = s_over < 0.0;
            const double v_next = free ? rises + falls : over ? -v_over : v_onto;
            v[i] = v_next / (free ? 1.0 : over ? 1.0 : below);
            s[i] = free ? s_free : over ? -s_over : 0.0;
        }
    }
}

typedef struct {
    double h, kappa, gravity, stiffness, damping, amplitude, omega;
    size_t balls, steps;
} driven_problem;

static void driven_block(const driven_problem *p, size_t balls, double *restrict s,
                         double *restrict v)
{
    const double h = p->h, kappa = p->kappa, out = 1.0 - kappa, in = 1.0 + kappa;
    const double per_out = 1.0 / out, per_in = 1.0 / in, h_out = h * out, h_in = h * in;
    const double k = p->stiffness, by_v = k * h + p->damping;
    const double per_slope = 1.0 / (1.0 + h * by_v);
    for (size_t n = 0; n < p->steps; n++) {
        const double wave = p->amplitude * cos(p->omega * (double)(n + 1) * h);
        for (size_t i = 0; i < balls; i++) {
            const double r = v[i] < 0.0 ? in : out;
            const double f = (wave - p->gravity - k * s[i] - by_v * (r * v[i])) * per_slope;
            const double b = -h * f, fastest = b / kappa;
            const double rises = max(v[i] - b * per_out, 0.0), falls = min(v[i] - b * per_in, 0.0);
            const double s_free = s[i] + (h_out * rises + h_in * falls);
            const double v_over = v[i] + b * per_out, s_over = s[i] + h_out * v_over;
            const double v_onto = s[i] * (fastest - v[i]), below = h * fastest + s[i];
            const int free = s_free > 0.0, over = s_over < 0.0;
            const double v_next = free ? rises + falls : over ? -v_over : v_onto;
            v[i] = v_next / (free ? 1.0 : over ? 1.0 : below);
            s[i] = free ? s_free : over ? -s_over : 0.0;
        }
    }
}

/* Moves the balls from (s, v), s >= 0, over the steps. */
void batch_run(const batch_problem *p, double *s, double *v)
{
    for (size_t i = 0; i < p->balls; i += BLOCK)
        block(p, p->balls - i < BLOCK ? p->balls - i : BLOCK, s + i, v + i);
}

/* The same under linear forces, from t = 0. */
void batch_driven(const driven_problem *p, double *s, double *v)
{
    for (size_t i = 0; i < p->balls; i += BLOCK)
        driven_block(p, p->balls - i < BLOCK ? p->balls - i : BLOCK, s + i, v + i);
}
