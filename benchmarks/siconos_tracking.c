/* The six-sign VI of the tracker's step with Siconos' VI_BOX_AVI_LSA, F and its Jacobian in C.
 *
 * Reads doubles from standard input: mu1 mu2 kappa kappa_ref f f_ref h, the number of steps, then
 * for each step s v s_ref v_ref and the six signs to start from, ls lv lsr lvr les lev; NaN is where
 * the last solve has ended. Writes for each step its six signs, the time of the solve (ns, less that
 * of two looks at the clock), and the evaluations of F and of its Jacobian, all as doubles.
 *
 * The Debian package of Siconos 4.4 lacks the headers of its VI solvers: what is needed of them is
 * declared here.
 */
#define _POSIX_C_SOURCE 199309L

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include <NumericsMatrix.h>
#include <SiconosSets.h>
#include <SolverOptions.h>

enum { SIGNS = 6, STATE = 4, VI_BOX_AVI_LSA = 1021 };

typedef struct VariationalInequality VI;
struct VariationalInequality {
    int size;
    void *env;
    void (*F)(void *self, int n, double *x, double *f);
    void (*compute_nabla_F)(void *self, int n, double *x, NumericsMatrix *nabla);
    void (*ProjectionOnX)(void *self, double *x, double *projected);
    double normVI;
    int istheNormVIset;
    void *set;
    NumericsMatrix *nabla_F;
};
VI *variationalInequality_new(int size);
void vi_box_AVI_LSA(VI *problem, double *z, double *f, int *info, SolverOptions *options);

/* One step: its data, its state, and what each row is multiplied with. */
typedef struct {
    double mu1, mu2, kappa, kappa_ref, f, f_ref, h;
    double s, v, s_ref, v_ref;
    double factor[SIGNS];
    long nfev, njev;
} step_data;

static void begin_at(step_data *it, const double *state)
{
    it->s = state[0];
    it->v = state[1];
    it->s_ref = state[2];
    it->v_ref = state[3];
    /* as much as the signs can change each row */
    double of_v_ref = it->h * fabs(it->f_ref);
    double of_v = it->h * (it->mu1 + it->mu2 + fabs(it->f)) + of_v_ref;
    double of_s = it->h * (it->kappa * fabs(it->v) + of_v);
    double of_s_ref = it->h * (it->kappa_ref * fabs(it->v_ref) + of_v_ref);
    double scale[SIGNS] = {of_s, of_v, of_s_ref, of_v_ref, of_s + of_s_ref, of_v + of_v_ref};
    for (int i = 0; i < SIGNS; i++)
        it->factor[i] = -1.0 / scale[i];
    it->nfev = it->njev = 0;
}

static void map(void *self, int n, double *x, double *out)
{
    (void)n;
    step_data *it = ((VI *)self)->env;
    double ls = x[0], lv = x[1], lsr = x[2], lvr = x[3], les = x[4], lev = x[5];
    double h = it->h, r = 1.0 - it->kappa * ls * lv, r_ref = 1.0 - it->kappa_ref * lsr * lvr;
    double a = lsr * it->f_ref / r_ref;
    double c = a - it->mu1 * les - it->mu2 * lev;
    double v = it->v + h * (ls * ls * c + ls * (1.0 - ls * ls) * it->f / r);
    double v_ref = it->v_ref + h * a;
    double s = it->s + h * r * v, s_ref = it->s_ref + h * r_ref * v_ref;
    double rows[SIGNS] = {s, v, s_ref, v_ref, s - s_ref, v - v_ref};
    for (int i = 0; i < SIGNS; i++)
        out[i] = it->factor[i] * rows[i];
    it->nfev++;
}

static void jacobian(void *self, int n, double *x, NumericsMatrix *nabla)
{
    (void)n;
    step_data *it = ((VI *)self)->env;
    double ls = x[0], lv = x[1], lsr = x[2], lvr = x[3], les = x[4], lev = x[5];
    double h = it->h, r = 1.0 - it->kappa * ls * lv, r_ref = 1.0 - it->kappa_ref * lsr * lvr;
    double a_lsr = it->f_ref / (r_ref * r_ref), a_lvr = a_lsr * it->kappa_ref * lsr * lsr;
    double c = lsr * it->f_ref / r_ref - it->mu1 * les - it->mu2 * lev;
    double square = ls * ls, bent = it->f * it->kappa * ls * (1.0 - square) / (r * r);
    double v = it->v + h * (square * c + ls * (1.0 - square) * it->f / r);
    double of_v[SIGNS] = {
        h * (2.0 * ls * c + (1.0 - 3.0 * square) * it->f / r + bent * lv),
        h * bent * ls,
        h * square * a_lsr,
        h * square * a_lvr,
        -h * square * it->mu1,
        -h * square * it->mu2,
    };
    double of_v_ref[SIGNS] = {0.0, 0.0, h * a_lsr, h * a_lvr, 0.0, 0.0};
    double of_s_ref[SIGNS] = {0.0};
    of_s_ref[2] = h * (h * it->f_ref - it->kappa_ref * lvr * it->v_ref);
    of_s_ref[3] = -h * it->kappa_ref * lsr * it->v_ref;
    double *out = nabla->matrix0; /* column by column */
    for (int j = 0; j < SIGNS; j++) {
        double of_s = h * r * of_v[j];
        if (j == 0)
            of_s -= h * it->kappa * lv * v;
        if (j == 1)
            of_s -= h * it->kappa * ls * v;
        double rows[SIGNS] = {of_s,        of_v[j],           of_s_ref[j],
                              of_v_ref[j], of_s - of_s_ref[j], of_v[j] - of_v_ref[j]};
        for (int i = 0; i < SIGNS; i++)
            out[i + SIGNS * j] = it->factor[i] * rows[i];
    }
    it->njev++;
}

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return 1e9 * (double)time.tv_sec + (double)time.tv_nsec;
}

/* The shortest time between two looks at the clock. */
static double two_looks(void)
{
    double least = INFINITY;
    for (int i = 0; i < 100000; i++) {
        double begin = now();
        least = fmin(least, now() - begin);
    }
    return least;
}

static void read_doubles(double *to, size_t count)
{
    if (fread(to, sizeof *to, count, stdin) != count) {
        fputs("the input ends too early\n", stderr);
        exit(1);
    }
}

int main(void)
{
    double head[8];
    read_doubles(head, 8);
    step_data it = {head[0], head[1], head[2], head[3], head[4], head[5], head[6],
                    0.0,     0.0,     0.0,     0.0,     {0.0},   0,       0};
    size_t count = (size_t)head[7];
    enum { IN = STATE + SIGNS, OUT = SIGNS + 3 };
    double *asked = malloc((count + 1) * IN * sizeof *asked);
    double *found = malloc((count + 1) * OUT * sizeof *found);
    if (!asked || !found)
        return 1;
    read_doubles(asked, count * IN);

    double lower[SIGNS], upper[SIGNS], signs[SIGNS] = {0.0}, f[SIGNS];
    for (int i = 0; i < SIGNS; i++) {
        lower[i] = -1.0;
        upper[i] = 1.0;
    }
    box_constraints box = {SICONOS_SET_BOX, lower, upper};
    VI *problem = variationalInequality_new(SIGNS);
    problem->env = &it;
    problem->F = map;
    problem->compute_nabla_F = jacobian;
    problem->set = &box;
    problem->nabla_F = NM_create(NM_DENSE, SIGNS, SIGNS);
    SolverOptions *options = solver_options_create(VI_BOX_AVI_LSA);
    options->iparam[0] = 1000;
    options->dparam[0] = 1e-12;
    /* the smallest step of the line search: by default 0, and then the search may never end */
    options->dparam[2] = 1e-16;

    double clock_took = two_looks();
    for (size_t k = 0; k < count; k++) {
        const double *start = asked + k * IN + STATE;
        double *out = found + k * OUT;
        begin_at(&it, asked + k * IN);
        for (int i = 0; i < SIGNS; i++) {
            if (!isnan(start[i]))
                signs[i] = start[i];
            else if (isnan(signs[i]))
                signs[i] = 0.0;
            f[i] = 0.0;
        }
        int info = 0;
        double begin = now();
        vi_box_AVI_LSA(problem, signs, f, &info, options);
        out[SIGNS] = now() - begin - clock_took;
        for (int i = 0; i < SIGNS; i++)
            out[i] = signs[i];
        out[SIGNS + 1] = (double)it.nfev;
        out[SIGNS + 2] = (double)it.njev;
    }
    return fwrite(found, sizeof *found, count * OUT, stdout) == count * OUT ? 0 : 1;
}
