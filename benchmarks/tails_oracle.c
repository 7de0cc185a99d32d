/* Impact by impact: x'' = -k x - c x' - g + A cos(w t + phi) above the wall x = 0, x'+ = -e x'-, from
   x = 0 with the velocity v at t = 0, by Taylor series in quadruple precision.

   Input, binary doubles: k c g A w phi e v, the number of times n, the number of impacts m, the level of
   an event, n increasing times. Output: x and x' at each time, time and speed after each of the first m
   impacts, then crossings of the level (m at most, 0 where there are no more), while the run needs to go
   on for these. */
#include <quadmath.h>
#include <stdio.h>
#include <stdlib.h>

typedef __float128 Q;
enum { TERMS = 60, STEPS = 60 };
static double law[11];
static Q a[TERMS];
static int used;

static void series(Q t, Q v) {
    Q angle = (Q)law[4] * t + law[5], power = law[3], turns[4] = {0, 0, 0, 0};
    if (law[3] != 0) turns[0] = cosq(angle), turns[1] = -sinq(angle);
    turns[2] = -turns[0], turns[3] = -turns[1];
    Q h = 4 * v / law[2], reach = v * h;
    a[0] = 0, a[1] = v, used = TERMS;
    Q hn = h * h;
    for (int n = 0; n + 2 < TERMS; n++, hn *= h) {
        Q d = power * turns[n % 4] - (n == 0 ? law[2] : 0);
        a[n + 2] = (d - law[0] * a[n] - law[1] * (n + 1) * a[n + 1]) / ((n + 1) * (n + 2));
        power *= (Q)law[4] / (n + 1);
        if (n > 3 && fabsq(a[n + 2]) * hn < 1e-34Q * reach && fabsq(a[n + 1]) * hn < 1e-34Q * reach * h) {
            used = n + 3;
            break;
        }
    }
}

static Q at(Q s, Q *slope) {
    Q x = 0, v = 0;
    for (int n = used - 1; n >= 0; n--) v = v * s + x, x = x * s + a[n];
    *slope = v;
    return x;
}

static Q root(Q s, Q level) {
    for (int i = 0; i < STEPS; i++) {
        Q v, x = at(s, &v), ds = (x - level) / v;
        s -= ds;
        if (fabsq(ds) < 1e-29Q * fabsq(s)) break;
    }
    return s;
}

/* The highest point of the arc of length h. */
static Q apex(Q h) {
    Q low = 0, high = h, v;
    for (int i = 0; i < 120; i++) {
        Q middle = (low + high) / 2;
        at(middle, &v);
        if (v > 0) low = middle; else high = middle;
    }
    return low;
}

int main(void) {
    if (fread(law, sizeof(double), 11, stdin) != 11) return 1;
    long n = (long)law[8], m = (long)law[9], seen = 0, i = 0, k = 0;
    double *times = malloc((n + 1) * sizeof(double)), *out = calloc(2 * n + 3 * m + 1, sizeof(double));
    if (fread(times, sizeof(double), n, stdin) != (size_t)n) return 1;
    double *hits = out + 2 * n, *crossings = hits + 2 * m;
    Q t = 0, v = law[7], level = law[10];
    while (i < n || k < m) {
        series(t, v);
        Q slope, h = root(2 * v / (Q)law[2], 0);
        /* from above: Newton's method on a concave function ends at the second root */
        for (; i < n && times[i] < t + h; i++) {
            out[2 * i] = at(times[i] - t, &slope);
            out[2 * i + 1] = slope;
        }
        if (level > 0 && seen + 2 <= m) {
            Q top = apex(h);
            if (at(top, &slope) > level) {
                crossings[seen++] = t + root(top * 0.01Q, level);
                crossings[seen++] = t + root(h, level);
            } else {
                level = 0;
            }
        }
        at(h, &slope);
        t += h, v = -(Q)law[6] * slope;
        if (k < m) hits[2 * k] = t, hits[2 * k + 1] = v, k++;
    }
    fwrite(out, sizeof(double), 2 * n + 3 * m, stdout);
    return 0;
}
