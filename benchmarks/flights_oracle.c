/* First impacts of flights x'' = -k x - c x' - g + A cos(w t + phi) in quadruple precision.

   Taylor series over windows; within one, |x''| <= M, so that

       x + x' s - M s^2/2 > 0                                                          (1)

   keeps the mass above the wall: a step by the root of (1) passes none of its own. Close to a
   root across the wall the steps are Newton's.

   Input, binary: flights of 10 numbers k c g A w phi t0 x0 v0 T, and a depth: NaN, or the depth
   below the wall, relative to x0 + |v0| + |g|, that the first minimum of the flight shall have:
   x0 is changed for it. Output for each: what was found (0 no impact, 1 an impact, -1 given up),
   its time after t0, its velocity, x0, and the time and the depth of the minimum. */
#include <quadmath.h>
#include <stdio.h>

typedef __float128 Q;
enum { TERMS = 34, MOST_STEPS = 1000000 };
typedef struct { Q k, c, g, A, w, phi, t0; } Law;

static Q rate(const Law *law) {
    Q own = (fabsq(law->c) + sqrtq(law->c * law->c + 4 * fabsq(law->k))) / 2;
    Q forced = law->A != 0 ? fabsq(law->w) : 0;
    return own > forced ? own : forced;
}

static void series(const Law *law, Q t, Q x, Q v, Q *a) {
    Q angle = law->w * (law->t0 + t) + law->phi, power = law->A;
    Q turns[4] = {cosq(angle), -sinq(angle), 0, 0};
    turns[2] = -turns[0], turns[3] = -turns[1];
    a[0] = x, a[1] = v;
    for (int n = 0; n + 2 < TERMS; n++) {
        Q d = power * turns[n % 4] - (n == 0 ? law->g : 0);
        a[n + 2] = (d - law->k * a[n] - law->c * (n + 1) * a[n + 1]) / ((n + 1) * (n + 2));
        power *= law->w / (n + 1);
    }
}

static Q value(const Q *a, Q s, int derivative) {
    Q sum = 0;
    for (int n = TERMS - 1; n >= derivative; n--) {
        Q factor = 1;
        for (int i = 0; i < derivative; i++) factor *= n - i;
        sum = sum * s + factor * a[n];
    }
    return sum;
}

static Q bound(const Q *a, Q s) {
    Q sum = 0;
    for (int n = TERMS - 1; n >= 2; n--) sum = sum * s + n * (n - 1) * fabsq(a[n]);
    return sum * (1 + 1e-20Q);
}

/* From rest: as long as the first coefficient outweighs all others. */
static Q off_the_wall(const Q *a, Q window) {
    int first = 2;
    while (first < TERMS && a[first] == 0) first++;
    if (first == TERMS || a[first] < 0) return -1;
    Q rest = 0;
    for (int n = TERMS - 1; n > first; n--) rest = rest * window + fabsq(a[n]);
    Q s = rest > 0 ? a[first] / (2 * rest) : window;
    return s < window ? s : window;
}

static int first_impact(const Law *law, Q x, Q v, Q end, Q *when, Q *speed) {
    Q a[TERMS], fastest = rate(law), window = fastest > 0 ? 0.4Q / fastest : end, t = 0;
    for (long step = 0; step < MOST_STEPS; step++) {
        Q left = end - t, s;
        if (left <= 0) return 0;
        series(law, t, x, v, a);
        if (window > left) s = left; else s = window;
        if (x == 0 && v == 0) {
            s = off_the_wall(a, s);
            if (s <= 0) return -1;
        } else {
            Q most = bound(a, s), root = sqrtq(v * v + 2 * most * x);
            Q safe = v >= 0 ? (v + root) / most : 2 * x / (root - v);
            if (v < 0 && 2 * most * x < 1e-12Q * v * v && 2 * x < -v * s) {
                /* across the wall, within the window: Newton */
                Q at = 0;
                for (int i = 0; i < 6; i++) at -= value(a, at, 0) / value(a, at, 1);
                *when = t + at, *speed = value(a, at, 1);
                return *when <= end;
            }
            /* a little less, or rounding may pass it */
            if (0.99Q * safe < s) s = 0.99Q * safe;
        }
        x = value(a, s, 0), v = value(a, s, 1), t += s;
        if (!(x > 0)) return -1;
    }
    return -1;
}

/* The first minimum up to the end: when and how low. */
static int first_minimum(const Law *law, Q x, Q v, Q end, Q *when, Q *low) {
    Q a[TERMS], fastest = rate(law), window = fastest > 0 ? 0.05Q / fastest : end / 64, t = 0;
    for (; t < end; t += window) {
        series(law, t, x, v, a);
        Q later = value(a, window, 1);
        if (v < 0 && later >= 0) {
            Q below = 0, above = window, s = window / 2;
            for (int i = 0; i < 200; i++) {
                Q slope = value(a, s, 1);
                if (slope < 0) below = s; else above = s;
                Q next = s - slope / value(a, s, 2);
                s = next > below && next < above && i < 40 ? next : (below + above) / 2;
            }
            *when = t + s, *low = value(a, s, 0);
            return 1;
        }
        x = value(a, window, 0), v = later;
    }
    return 0;
}

static Q response(Law law, Q t_end) {
    Q a[TERMS], x = 1, v = 0, t = 0;
    law.g = law.A = 0;
    Q fastest = rate(&law), window = fastest > 0 ? 0.4Q / fastest : t_end;
    while (t < t_end) {
        Q s = window < t_end - t ? window : t_end - t;
        series(&law, t, x, v, a);
        x = value(a, s, 0), v = value(a, s, 1), t += s;
    }
    return x;
}

/* Changes x0 so that the first minimum has this depth, as far as a double can. */
static int lowered(const Law *law, double *x0, Q v, Q depth, Q end, Q *when, Q *low) {
    Q x = *x0;
    for (int i = 0; i < 12; i++) {
        if (!first_minimum(law, x, v, end, when, low)) return 0;
        x -= (*low + depth * (x + fabsq(v) + fabsq(law->g))) / response(*law, *when);
        if (!(x > 0)) return 0;
    }
    *x0 = (double)x;
    return first_minimum(law, *x0, v, end, when, low);
}

int main(void) {
    double in[11];
    while (fread(in, sizeof in, 1, stdin) == 1) {
        Law law = {in[0], in[1], in[2], in[3], in[4], in[5], in[6]};
        double x0 = in[7], v0 = in[8], T = in[9];
        Q when = 0, low = 0, tau = 0, speed = 0;
        int found = -1;
        if (in[10] == in[10]) {
            if (lowered(&law, &x0, v0, in[10], T, &when, &low))
                found = first_impact(&law, x0, v0, when, &tau, &speed);
        } else
            found = first_impact(&law, x0, v0, T, &tau, &speed);
        /* times in two parts */
        double head = (double)tau;
        double out[7] = {found, head, (double)(tau - head), (double)speed, x0, (double)when,
                         (double)(-low / (x0 + fabsq((Q)v0) + fabsq(law.g)))};
        fwrite(out, sizeof out, 1, stdout);
    }
    return 0;
}
