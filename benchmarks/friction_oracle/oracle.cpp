// Motions with dry friction and impacts, event by event, in extended precision (-DQUAD: quadruple).
//
// Between events q'' is a Chebyshev polynomial in time, found by Picard's iteration; the gaps Y, their
// rates and the slip speeds W are integrated from zeros that are exact, so that a bounce of 1e-19 m/s
// has all its digits. Every impact of an accumulation is made, to SLOWEST; only then its gap closes.
// Which contacts close, stick or slip is decided by enumeration, in ties by following each choice.
//
// Input, a line for each motion: family, count and numbers of it, T, q, q'. Output, a line of JSON.
#include <cstring>
#include <iostream>
#include <sstream>

#include "families.h"

enum { N = NODES, SAMPLES = 3 * NODES, OPEN = 2 };

// ---------------------------------------------------------------- polynomials on a step
static R node[N + 1], sums[N + 1][N + 1], to_series[N + 1][N + 1], sample_at[SAMPLES + 1], samples[SAMPLES + 1][N + 1];

// T_k at x of [-1, 1]
static R value(const R *series, int terms, R x) {
    R b1 = 0, b2 = 0;
    for (int k = terms - 1; k > 0; k--) {
        R b = 2 * x * b1 - b2 + series[k];
        b2 = b1, b1 = b;
    }
    return x * b1 - b2 + series[0];
}

static void integrate(const R *c, int terms, R *s) {  // from -1; s has one term more
    for (int k = 0; k <= terms; k++) s[k] = 0;
    for (int k = 0; k < terms; k++) {
        if (k == 0) s[1] += c[0];
        else if (k == 1) s[2] += c[1] / 4, s[0] += c[1] / 4;
        else s[k + 1] += c[k] / (2 * (k + 1)), s[k - 1] -= c[k] / (2 * (k - 1));
    }
    R start = 0;
    for (int k = 0; k <= terms; k++) start += k % 2 ? -s[k] : s[k];
    s[0] -= start;
}

static void prepare() {
    R pi = 4 * (R)
#ifdef QUAD
                   atanq(1);
#else
                   atanl(1);
#endif
    for (int j = 0; j <= N; j++) node[j] = j == N ? R(1) : -cos(pi * j / N);
    for (int k = 0; k <= N; k++)
        for (int j = 0; j <= N; j++) {
            R c = cos(pi * ((k * (N - j)) % (2 * N)) / N) * 2 / N;
            to_series[k][j] = c * (k == 0 || k == N ? R(0.5) : R(1)) * (j == 0 || j == N ? R(0.5) : R(1));
        }
    for (int j = 0; j <= N; j++) {
        R c[N + 1], s[N + 2];
        for (int k = 0; k <= N; k++) c[k] = to_series[k][j];
        integrate(c, N + 1, s);
        for (int i = 0; i <= N; i++) sums[i][j] = value(s, N + 2, node[i]) / 2;  // on [0, 1]
        for (int i = 0; i <= SAMPLES; i++) {
            sample_at[i] = i == SAMPLES ? R(1) : -cos(pi * i / SAMPLES);
            samples[i][j] = value(c, N + 1, sample_at[i]);
        }
    }
}

// ---------------------------------------------------------------- state, modes and forces
struct State {
    R t, q[N_MAX], v[N_MAX], Y[M_MAX], Yd[M_MAX], W[P_MAX], lost;
};
struct Mode {
    bool closed[M_MAX];
    int sigma[P_MAX];  // 1, -1 slip, 0 stick, OPEN
    bool operator==(const Mode &o) const {
        return !memcmp(closed, o.closed, sizeof closed) && !memcmp(sigma, o.sigma, sizeof sigma);
    }
};
struct Limit {  // value + sum of factor x: not negative as long as the mode lasts
    R value, part[ROWS];
    char kind;  // 'n' normal force, 's' stick
    int who, sign;
};
struct Forces {
    R a[N_MAX], Ydd[M_MAX], Wd[P_MAX], power;
    int rows, nulls, sign;
    R null[ROWS];
    std::vector<Limit> limits;
};

struct Failure {
    const char *what;
};

struct Motion {
    const Model &o;
    Parts z;
    int rounds = 0;
    explicit Motion(const Model &model) : o(model) {}

    void parts(R t, const R *q, const R *v, const Mode &mode) {
        memset((void *)&z, 0, sizeof z);
        int sigma[P_MAX];
        for (int c = 0; c < o.p; c++) sigma[c] = mode.sigma[c] == OPEN ? 0 : mode.sigma[c];
        o.parts(o, t, q, v, sigma, z);
    }
    void by_mass(const R *f, R *a) const {
        R M[ROWS][ROWS], null[ROWS];
        int sign;
        for (int i = 0; i < o.n; i++)
            for (int j = 0; j < o.n; j++) M[i][j] = z.M[i][j];
        solve(o.n, M, f, a, null, &sign);
    }
    R along(const R *row, const R *a) const {
        R sum = 0;
        for (int j = 0; j < o.n; j++) sum += row[j] * a[j];
        return sum;
    }

    // M q'' = F + sum lambda N + sum f B in a mode: rows of the closed gaps and the sticking channels
    void forces(R t, const R *q, const R *v, const R *W, const Mode &mode, Forces &f) {
        parts(t, q, v, mode);
        R b[N_MAX] = {}, a0[N_MAX], columns[ROWS][N_MAX], K[ROWS][ROWS], right[ROWS], x[ROWS];
        const R *row[ROWS];
        int normal[M_MAX], sticking[P_MAX], rows = 0;
        for (int j = 0; j < o.n; j++) b[j] = z.F[j];
        for (int c = 0; c < o.p; c++)
            if (o.gap_of[c] < 0)
                for (int j = 0; j < o.n; j++) b[j] -= z.L[c] * mode.sigma[c] * z.B[c][j];
        by_mass(b, a0);
        for (int i = 0; i < o.m; i++) {
            normal[i] = -1;
            if (!mode.closed[i]) continue;
            R force[N_MAX];
            for (int j = 0; j < o.n; j++) force[j] = z.N[i][j];
            for (int c = 0; c < o.p; c++)
                if (o.gap_of[c] == i)
                    for (int j = 0; j < o.n; j++) force[j] -= z.mu[c] * mode.sigma[c] * z.B[c][j];
            by_mass(force, columns[rows]);
            right[rows] = -(along(z.N[i], a0) + z.h[i]);
            row[rows] = z.N[i];
            normal[i] = rows++;
        }
        for (int c = 0; c < o.p; c++) {
            sticking[c] = -1;
            if (mode.sigma[c] != 0) continue;
            by_mass(z.B[c], columns[rows]);
            right[rows] = -(along(z.B[c], a0) + z.k[c]);
            row[rows] = z.B[c];
            sticking[c] = rows++;
        }
        for (int i = 0; i < rows; i++)
            for (int j = 0; j < rows; j++) K[i][j] = along(row[i], columns[j]);
        f.rows = rows, f.nulls = solve(rows, K, right, x, f.null, &f.sign);
        if (f.nulls < 0) throw Failure{"no forces"};
        for (int j = 0; j < o.n; j++) {
            f.a[j] = a0[j];
            for (int i = 0; i < rows; i++) f.a[j] += columns[i][j] * x[i];
        }
        for (int i = 0; i < o.m; i++) f.Ydd[i] = mode.closed[i] ? R(0) : along(z.N[i], f.a) + z.h[i];
        for (int c = 0; c < o.p; c++) f.Wd[c] = mode.sigma[c] == 0 ? R(0) : along(z.B[c], f.a) + z.k[c];
        f.power = 0;
        for (int c = 0; c < o.p; c++) {
            if (mode.sigma[c] == 0 || mode.sigma[c] == OPEN) continue;
            R limit = o.gap_of[c] < 0 ? z.L[c] : z.mu[c] * x[normal[o.gap_of[c]]];
            f.power += limit * mode.sigma[c] * W[c];
        }
        f.limits.clear();
        for (int i = 0; i < o.m; i++)
            if (mode.closed[i]) {
                Limit it{x[normal[i]], {}, 'n', i, 0};
                it.part[normal[i]] = 1;
                f.limits.push_back(it);
            }
        for (int c = 0; c < o.p; c++)
            if (mode.sigma[c] == 0)
                for (int s = -1; s <= 1; s += 2) {
                    Limit it{s * x[sticking[c]], {}, 's', c, s};
                    it.part[sticking[c]] = s;
                    if (o.gap_of[c] < 0) it.value += z.Ls[c];
                    else {
                        int i = normal[o.gap_of[c]];
                        it.value += z.mus[c] * x[i], it.part[i] += z.mus[c];
                    }
                    f.limits.push_back(it);
                }
    }

    // The limits as functions of time; with a null vector of K, of each pair that bounds its factor.
    // 1e30 where it does not count.
    void functions(const Forces &f, std::vector<R> &out) const {
        out.clear();
        size_t n = f.limits.size();
        if (f.nulls == 0) {
            for (auto &it : f.limits) out.push_back(it.value);
            return;
        }
        std::vector<R> slope(n);
        for (size_t i = 0; i < n; i++)
            for (int j = 0; j < f.rows; j++) slope[i] += f.limits[i].part[j] * f.null[j];
        for (size_t i = 0; i < n; i++) out.push_back(fabs(slope[i]) < 1e-10 ? f.limits[i].value : R(1e30));
        for (size_t i = 0; i < n; i++)
            for (size_t j = 0; j < i; j++) {
                bool counts = slope[i] * slope[j] < -1e-20;
                out.push_back(counts ? f.limits[i].value * fabs(slope[j]) + f.limits[j].value * fabs(slope[i]) : R(1e30));
            }
    }
    // Of function k: the limits that it is of.
    void of_function(const Forces &f, int k, std::vector<const Limit *> &out) const {
        int n = f.limits.size();
        out.clear();
        if (k < n) return out.push_back(&f.limits[k]);
        k -= n;
        for (int i = 0; i < n; i++)
            for (int j = 0; j < i; j++)
                if (k-- == 0) return out.push_back(&f.limits[i]), out.push_back(&f.limits[j]);
    }
};

// ---------------------------------------------------------------- a step
struct Watched {
    char kind;  // 'y' gap, 'w' slip, 'f' limit of forces, 'k' det K
    int who;
    R at[N + 1];
};
struct Step {
    R h, q[N_MAX][N + 2], v[N_MAX][N + 2], Y[M_MAX][N + 2], Yd[M_MAX][N + 2], W[P_MAX][N + 2], lost[N + 2];
    R error;
    std::vector<Watched> watched;
};

static void series_of(const R *at, R *series) {
    for (int k = 0; k <= N; k++) {
        series[k] = 0;
        for (int j = 0; j <= N; j++) series[k] += to_series[k][j] * at[j];
    }
}

// Values at the nodes of the integral of `rate`; for its end value there is `series`.
static void integral(R start, R h, const R *rate, R *at) {
    for (int i = 0; i <= N; i++) {
        R sum = 0;
        for (int j = 0; j <= N; j++) sum += sums[i][j] * rate[j];
        at[i] = start + h * sum;
    }
}

// False where Picard's iteration does not settle.
static bool take(Motion &m, const State &s, const Mode &mode, R h, Step &step) {
    const Model &o = m.o;
    static R q[N_MAX][N + 1], v[N_MAX][N + 1], W[P_MAX][N + 1], a[N_MAX][N + 1], Ydd[M_MAX][N + 1], Wd[P_MAX][N + 1],
        power[N + 1];
    R before = 1e300;
    for (int i = 0; i <= N; i++) {
        R tau = h * (node[i] + 1) / 2;
        for (int j = 0; j < o.n; j++) q[j][i] = s.q[j] + tau * s.v[j], v[j][i] = s.v[j];
        for (int c = 0; c < o.p; c++) W[c][i] = s.W[c];
    }
    std::vector<Forces> f(N + 1);
    for (int round = 0;; round++) {
        if (++m.rounds > 300000) throw Failure{"too long"};
        for (int i = 0; i <= N; i++) {
            R qi[N_MAX], vi[N_MAX], Wi[P_MAX];
            for (int j = 0; j < o.n; j++) qi[j] = q[j][i], vi[j] = v[j][i];
            for (int c = 0; c < o.p; c++) Wi[c] = W[c][i];
            m.forces(s.t + h * (node[i] + 1) / 2, qi, vi, Wi, mode, f[i]);
            for (int j = 0; j < o.n; j++) a[j][i] = f[i].a[j];
            for (int k = 0; k < o.m; k++) Ydd[k][i] = f[i].Ydd[k];
            for (int c = 0; c < o.p; c++) Wd[c][i] = f[i].Wd[c];
            power[i] = f[i].power;
        }
        R change = 0;
        for (int j = 0; j < o.n; j++) {
            R nv[N + 1], nq[N + 1];
            integral(s.v[j], h, a[j], nv);
            integral(s.q[j], h, nv, nq);
            for (int i = 0; i <= N; i++) {
                change = max(change, max(fabs(nv[i] - v[j][i]) / (1 + fabs(nv[i])), fabs(nq[i] - q[j][i]) / (1 + fabs(nq[i]))));
                v[j][i] = nv[i], q[j][i] = nq[i];
            }
        }
        for (int c = 0; c < o.p; c++) {
            R now[N + 1];
            integral(s.W[c], h, Wd[c], now);
            for (int i = 0; i <= N; i++) W[c][i] = now[i];
        }
        if (change < 8 * EPS || (round > 3 && change < 300 * EPS && change >= before)) break;
        if (!(change < 1e9) || round > 60) return false;
        before = change;
    }
    // twice the rates: the last ones belong to the last but one iterate, which is as good
    step.h = h, step.error = 0;
    auto tail = [&](const R *c) {
        R size = 0;
        for (int k = 0; k <= N; k++) size = max(size, fabs(c[k]));
        if (size > 0) step.error = max(step.error, (fabs(c[N]) + fabs(c[N - 1])) / max(size, 1));
    };
    auto once = [&](const R *rate, R start, R *out) {
        R c[N + 1];
        series_of(rate, c);
        tail(c);
        integrate(c, N + 1, out);
        for (int k = 0; k <= N + 1; k++) out[k] *= h / 2;
        out[0] += start;
    };
    auto twice = [&](const R *speed, R start, R *out) {  // of a series of N + 2 terms
        R c[N + 3];
        integrate(speed, N + 2, c);
        for (int k = 0; k <= N + 1; k++) out[k] = c[k] * h / 2;
        out[0] += start;
    };
    for (int j = 0; j < o.n; j++) once(a[j], s.v[j], step.v[j]), twice(step.v[j], s.q[j], step.q[j]);
    for (int k = 0; k < o.m; k++) once(Ydd[k], s.Yd[k], step.Yd[k]), twice(step.Yd[k], s.Y[k], step.Y[k]);
    for (int c = 0; c < o.p; c++) once(Wd[c], s.W[c], step.W[c]);
    R untold = step.error;
    once(power, s.lost, step.lost);
    step.error = untold;
    step.watched.clear();
    auto watch = [&](char kind, int who, auto at) {
        Watched it{kind, who, {}};
        for (int i = 0; i <= N; i++) it.at[i] = at(i);
        step.watched.push_back(it);
    };
    for (int k = 0; k < o.m; k++)
        if (!mode.closed[k]) watch('y', k, [&](int i) { return value(step.Y[k], N + 2, node[i]); });
    for (int c = 0; c < o.p; c++)
        if (mode.sigma[c] == 1 || mode.sigma[c] == -1) watch('w', c, [&](int i) { return mode.sigma[c] * W[c][i]; });
    std::vector<std::vector<R>> limits(N + 1);
    for (int i = 0; i <= N; i++) m.functions(f[i], limits[i]);
    for (size_t k = 0; k < limits[0].size(); k++)
        watch('f', k, [&](int i) { return k < limits[i].size() ? limits[i][k] : R(1e30); });
    for (int i = 0; i <= N; i++)
        if (f[i].nulls == 0 && f[i].sign <= 0) throw Failure{"Painleve"};
    return true;
}

static void state_at(const Model &o, const State &s, const Step &step, R x, State &out) {
    out = s;
    out.t = s.t + step.h * (x + 1) / 2;
    for (int j = 0; j < o.n; j++) out.q[j] = value(step.q[j], N + 2, x), out.v[j] = value(step.v[j], N + 2, x);
    for (int k = 0; k < o.m; k++) out.Y[k] = value(step.Y[k], N + 2, x), out.Yd[k] = value(step.Yd[k], N + 2, x);
    for (int c = 0; c < o.p; c++) out.W[c] = value(step.W[c], N + 2, x);
    out.lost = value(step.lost, N + 2, x);
}

// First x where a function that starts at >= 0 becomes negative; 2 if none. `touch`: the least
// relative depth by which it stays off zero inside the step.
static R first_root(const Watched &it, R *touch) {
    R size = 0, at[SAMPLES + 1];
    bool partly = false;
    for (int j = 0; j <= N; j++) partly |= it.at[j] > 1e29, size = max(size, fabs(it.at[j]));
    if (size > 1e29) size = 1;
    if (partly) {  // a pair of limits that does not count everywhere: no polynomial
        for (int j = 1; j <= N; j++)
            if (it.at[j] < 0) return node[j];
        return 2;
    }
    R c[N + 1];
    series_of(it.at, c);
    for (int i = 0; i <= SAMPLES; i++) {
        at[i] = 0;
        for (int j = 0; j <= N; j++) at[i] += samples[i][j] * it.at[j];
    }
    auto root = [&](R low, R high) {
        for (int k = 0; k < 200 && high - low > EPS; k++) {
            R fl = value(c, N + 1, low), fh = value(c, N + 1, high);
            R x = k % 3 == 2 || !(fl > fh) ? (low + high) / 2 : low + (high - low) * fl / (fl - fh);
            if (!(x > low && x < high)) x = (low + high) / 2;
            if (!(x > low && x < high)) break;
            (value(c, N + 1, x) < 0 ? high : low) = x;
        }
        return high;
    };
    for (int i = 1; i <= SAMPLES; i++) {
        if (at[i] < 0 && !(i < 3 && fabs(at[i]) < 50 * EPS * size)) return root(sample_at[i - 1], sample_at[i]);
        if (i >= 2 && i < SAMPLES && at[i] < at[i - 1] && at[i] <= at[i + 1]) {
            R low = sample_at[i - 1], high = sample_at[i + 1];
            for (int k = 0; k < 120; k++) {
                R x = low + (high - low) / 3, y = high - (high - low) / 3;
                (value(c, N + 1, x) < value(c, N + 1, y) ? high : low) = value(c, N + 1, x) < value(c, N + 1, y) ? y : x;
            }
            R least = value(c, N + 1, low);
            if (least < 0) return root(sample_at[i - 1], low);
            *touch = min(*touch, least / size);
        }
    }
    return 2;
}

// ---------------------------------------------------------------- the run
struct Told {
    std::string kind;
    R t;
    int who;
};
struct Hit {
    R t;
    int gap;
    R speed;
    int sigma;
};

struct Run {
    Motion m;
    const Model &o;
    State s{};
    Mode mode{};
    R end, h, since = 0, touch = 1e30, tie = 1e30, drift = 0, normal_lost = 0;
    std::vector<Told> told;
    std::vector<Hit> hits;
    int steps = 0, loops = 0;
    bool not_unique = false, paradox = false, undetermined = false;

    Run(const Model &model, R T) : m(model), o(model), end(T), h(T / 8) {}

    void tell(const std::string &kind, int who) { told.push_back({kind, s.t, who}); }

    // How far a mode is from the borders of what it may do, just now. Returns its least margin, relative.
    R margin(const Mode &it, const bool *undecided, const bool *still, Forces &f) {
        m.forces(s.t, s.q, s.v, s.W, it, f);
        if (f.nulls > 1) return -1e30;
        if (f.nulls == 0 && f.sign <= 0) return paradox = true, -1e30;
        R size = 0, least = 1e30;
        for (int j = 0; j < o.n; j++) size = max(size, fabs(f.a[j]));
        for (int j = 0; j < o.n; j++) size = max(size, fabs(m.z.F[j]) / max(m.z.M[j][j], EPS));
        size = max(size, EPS);
        for (int k = 0; k < o.m; k++)
            if (undecided[k] && !it.closed[k]) least = min(least, f.Ydd[k] / size);
        for (int c = 0; c < o.p; c++)
            if (still[c] && (it.sigma[c] == 1 || it.sigma[c] == -1)) least = min(least, it.sigma[c] * f.Wd[c] / size);
        R loads = 0;
        for (int j = 0; j < o.n; j++) loads = max(loads, fabs(m.z.F[j]));
        for (auto &l : f.limits) loads = max(loads, fabs(l.value));
        std::vector<R> limits;
        m.functions(f, limits);
        for (R x : limits)
            if (x < 1e29) least = min(least, x / max(loads, EPS));
        return least;
    }

    // Whether a mode lasts for a moment.
    bool lasts(const Mode &it, R dt, const bool *undecided, const bool *still) {
        static Step step;
        try {
            if (!take(m, s, it, dt, step)) return false;
        } catch (const Failure &) {
            return false;
        }
        for (auto &w : step.watched)
            if ((w.kind != 'y' || undecided[w.who]) && (w.kind != 'w' || still[w.who]))
                for (int i = N / 2; i <= N; i += N / 4)
                    if (w.at[i] < -20 * EPS) return false;
        return true;
    }

    // Chooses closed or open for gaps with Y = Y' = 0, stick or slip for channels with W = 0.
    Mode decide(const bool *held) {
        bool undecided[M_MAX], still[P_MAX];
        std::vector<Mode> all{Mode{}}, next;
        for (int k = 0; k < o.m; k++) {
            undecided[k] = s.Y[k] == 0 && s.Yd[k] == 0;
            next.clear();
            for (auto it : all)
                for (int closed = 0; closed <= (undecided[k] ? 1 : 0); closed++) it.closed[k] = closed, next.push_back(it);
            all = next;
        }
        for (int c = 0; c < o.p; c++) {
            still[c] = s.W[c] == 0;
            next.clear();
            for (auto it : all) {
                if (o.gap_of[c] >= 0 && !it.closed[o.gap_of[c]]) it.sigma[c] = OPEN, next.push_back(it);
                else if (!still[c]) it.sigma[c] = s.W[c] > 0 ? 1 : -1, next.push_back(it);
                else
                    for (int sigma = -1; sigma <= 1; sigma++) it.sigma[c] = sigma, next.push_back(it);
            }
            all = next;
        }
        if (all.size() == 1) return all[0];
        auto rank = [&](const Mode &it) {
            int r = 0;
            for (int k = 0; k < o.m; k++) r += it.closed[k] ? 1000 : 0;
            for (int c = 0; c < o.p; c++) r += it.sigma[c] == 0 ? 10 + held[c] : 0;
            return r;
        };
        const Mode *best = nullptr;
        std::vector<const Mode *> ties;
        bool twofold = false;
        Forces f;
        R nearest = 1e30;
        for (auto &it : all) {
            R room = -1e30;
            try {
                room = margin(it, undecided, still, f);
            } catch (const Failure &) {
                continue;
            }
            if (f.nulls > 1) twofold = true;
            nearest = min(nearest, fabs(room));
            if (room > 1e-9 && (!best || rank(it) > rank(*best))) best = &it;
            if (fabs(room) <= 1e-9) ties.push_back(&it);
        }
        for (R dt : {R(1e-5), R(1e-4), R(1e-6), R(1e-3)}) {
            const Mode *chosen = best;
            for (auto it : ties)
                if ((!chosen || rank(*it) > rank(*chosen)) && lasts(*it, dt, undecided, still)) chosen = it;
            if (chosen) {
                if (ties.empty()) tie = min(tie, nearest);
                return *chosen;
            }
        }
        throw Failure{twofold ? "several null vectors" : paradox ? "Painleve" : "no mode"};
    }

    // `broken`: channels whose limits are reached. The others rather stick on.
    void settle(bool first, const bool *opened, const bool *broken = nullptr) {
        Mode before = mode;
        bool held[P_MAX];
        for (int c = 0; c < o.p; c++) held[c] = before.sigma[c] == 0 && !(broken && broken[c]);
        mode = decide(held);
        for (int k = 0; k < o.m; k++)
            if (before.closed[k] && !mode.closed[k]) tell(opened && opened[k] ? "open" : "lift", k);
        for (int c = 0; c < o.p; c++) {
            int now = mode.sigma[c], was = first ? OPEN : before.sigma[c];
            if (now == OPEN || now == was) continue;
            const char *name = now == 0 ? "stick" : now > 0 ? "slip+" : "slip-";
            tell((was == OPEN ? std::string("land_") : std::string()) + name, c);
        }
        // what stays closed or stuck does so exactly
        for (int k = 0; k < o.m; k++)
            if (mode.closed[k]) s.Y[k] = s.Yd[k] = 0;
    }

    // Newton's law with Coulomb's on the contacts C, by enumeration of patterns
    void impact(const std::vector<int> &hit) {
        m.parts(s.t, s.q, s.v, mode);
        const Parts &z = m.z;
        std::vector<int> C;
        for (int k = 0; k < o.m; k++) {
            bool in = mode.closed[k];
            for (int g : hit) in |= g == k;
            if (in) C.push_back(k);
        }
        int channel[M_MAX];
        for (int k = 0; k < o.m; k++) {
            channel[k] = -1;
            for (int c = 0; c < o.p; c++)
                if (o.gap_of[c] == k) channel[k] = c;
        }
        struct Found {
            std::vector<int> pattern;
            R dv[N_MAX], PN[M_MAX], PT[P_MAX];
            int rank, nulls;
        };
        std::vector<Found> found;
        std::vector<int> pattern(C.size(), 0);  // 0 stick (or closed), 1, -1 slip, OPEN
        const int kinds[4] = {0, 1, -1, OPEN};
        int total = 1;
        R speed = 0;
        for (int k : C) speed = max(speed, fabs(s.Yd[k]));
        for (size_t i = 0; i < C.size(); i++) total *= 4;
        for (int number = 0; number < total; number++) {
            int rest = number, rows = 0;
            bool skip = false;
            R K[ROWS][ROWS], right[ROWS], x[ROWS], null[ROWS], columns[ROWS][N_MAX];
            const R *row[ROWS];
            int pn[M_MAX], pt[M_MAX], sign;
            for (size_t i = 0; i < C.size(); i++) {
                pattern[i] = kinds[rest % 4], rest /= 4;
                int k = C[i], c = channel[k];
                pn[k] = pt[k] = -1;
                if (c < 0 && (pattern[i] == 1 || pattern[i] == -1)) skip = true;
                if (pattern[i] == OPEN) continue;
                R force[N_MAX];
                for (int j = 0; j < o.n; j++)
                    force[j] = z.N[k][j] - (pattern[i] ? z.mu0[c] * pattern[i] * z.B[c][j] : R(0));
                m.by_mass(force, columns[rows]);
                row[rows] = z.N[k], right[rows] = -(1 + (mode.closed[k] ? R(0) : o.e[k])) * s.Yd[k];
                pn[k] = rows++;
                if (pattern[i] == 0 && c >= 0) {
                    m.by_mass(z.B[c], columns[rows]);
                    row[rows] = z.B[c], right[rows] = -(1 + o.et[c]) * s.W[c];
                    pt[k] = rows++;
                }
            }
            if (skip) continue;
            for (int i = 0; i < rows; i++)
                for (int j = 0; j < rows; j++) K[i][j] = m.along(row[i], columns[j]);
            int nulls = solve(rows, K, right, x, null, &sign);
            if (nulls < 0 || nulls > 1) continue;
            Found it;
            it.pattern = pattern, it.rank = 0, it.nulls = nulls;
            for (int j = 0; j < o.n; j++) {
                it.dv[j] = 0;
                for (int i = 0; i < rows; i++) it.dv[j] += columns[i][j] * x[i];
            }
            R low = -1e30, high = 1e30;
            bool good = true;
            auto need = [&](R a, R slope, R scale) {
                if (fabs(slope) < 1e-10) good &= a >= -1e-13 * scale;
                else if (slope > 0) low = max(low, -a / slope);
                else high = min(high, -a / slope);
            };
            R push = 0;
            for (int i = 0; i < rows; i++) push = max(push, fabs(x[i]));
            for (size_t i = 0; i < C.size(); i++) {
                int k = C[i], c = channel[k];
                R g = s.Yd[k] + m.along(z.N[k], it.dv), w = c >= 0 ? s.W[c] + m.along(z.B[c], it.dv) : R(0);
                R nearly = c >= 0 ? 1e-13 * fabs(w - s.W[c]) + 30 * EPS * fabs(s.W[c]) : R(0);
                if (pattern[i] == OPEN) {
                    good &= g + (mode.closed[k] ? R(0) : o.e[k]) * s.Yd[k] >= -1e-13 * speed;
                    continue;
                }
                it.rank += 100 + (pattern[i] == 0);
                R along_null = nulls ? null[pn[k]] : R(0);
                need(x[pn[k]], along_null, push);
                if (pattern[i]) good &= pattern[i] * (w + o.et[c] * s.W[c]) >= -nearly;
                else if (c >= 0)
                    for (int sg = -1; sg <= 1; sg += 2)
                        need(z.mu0[c] * x[pn[k]] + sg * x[pt[k]], nulls ? z.mu0[c] * along_null + sg * null[pt[k]] : R(0), push);
            }
            if (!good || low > high + 1e-13 * push) continue;
            R alpha = !nulls ? R(0) : low < -1e29 ? (high > 1e29 ? R(0) : high) : high > 1e29 ? low : (low + high) / 2;
            for (size_t i = 0; i < C.size(); i++) {
                int k = C[i], c = channel[k];
                it.PN[k] = pn[k] < 0 ? R(0) : x[pn[k]] + (nulls ? alpha * null[pn[k]] : R(0));
                if (c < 0) continue;
                it.PT[c] = pt[k] >= 0 ? x[pt[k]] + (nulls ? alpha * null[pt[k]] : R(0))
                           : pattern[i] == OPEN ? R(0)
                                                : -z.mu0[c] * pattern[i] * it.PN[k];
            }
            found.push_back(it);
        }
        if (found.empty()) throw Failure{"no impact"};
        const Found *best = &found[0];
        for (auto &it : found) {
            R apart = 0, size = 0;
            for (int j = 0; j < o.n; j++) apart = max(apart, fabs(it.dv[j] - found[0].dv[j])), size = max(size, fabs(it.dv[j]));
            if (apart > 1e-9 * size) not_unique = true;
            if (it.rank > best->rank) best = &it;
        }
        bool opened[M_MAX] = {}, stuck[P_MAX] = {};
        R Yd[M_MAX], W[P_MAX];
        for (int k = 0; k < o.m; k++) Yd[k] = s.Yd[k] + m.along(z.N[k], best->dv);
        for (int c = 0; c < o.p; c++) {
            R jump = m.along(z.B[c], best->dv), size = 0;
            for (int j = 0; j < o.n; j++) size = max(size, fabs(z.B[c][j] * best->dv[j]));
            W[c] = fabs(jump) <= 30 * EPS * size ? s.W[c] : s.W[c] + jump;
            if (fabs(W[c]) < 1e3 * EPS * (size + fabs(s.W[c]))) W[c] = 0;
        }
        for (size_t i = 0; i < C.size(); i++) {
            int k = C[i], c = channel[k];
            if (best->pattern[i] == OPEN) {
                opened[k] = mode.closed[k];
                continue;
            }
            Yd[k] = mode.closed[k] ? R(0) : -o.e[k] * s.Yd[k];
            if (c >= 0 && best->pattern[i] == 0) W[c] = -o.et[c] * s.W[c], stuck[c] = true;
        }
        for (int k : hit) {
            int sigma = 0;
            for (size_t i = 0; i < C.size(); i++)
                if (C[i] == k) sigma = best->pattern[i];
            hits.push_back({s.t, k, -s.Yd[k], sigma});
        }
        for (int k : C) normal_lost -= best->PN[k] * (s.Yd[k] + Yd[k]) / 2;
        for (int c = 0; c < o.p; c++)
            if (o.gap_of[c] >= 0)
                for (int k : C)
                    if (o.gap_of[c] == k) s.lost -= best->PT[c] * (s.W[c] + W[c]) / 2;
        undetermined |= best->nulls > 0;
        R arrived = 0;
        for (int k : hit) arrived = max(arrived, -s.Yd[k]);
        for (int j = 0; j < o.n; j++) s.v[j] += best->dv[j];
        for (int k = 0; k < o.m; k++) s.Yd[k] = Yd[k];
        for (int c = 0; c < o.p; c++) s.W[c] = W[c];
        for (int k : C) s.Y[k] = 0;
        // the end of an accumulation, and of all that goes with it
        bool zeno = false;
        R slowest = SLOWEST * (s.t - since < 100 * SLOWEST ? 1000 : 1);
        zeno = arrived < slowest;
        if (zeno)
            for (int k = 0; k < o.m; k++) {
                bool slow = !mode.closed[k] && s.Y[k] < 1e3 * slowest * slowest && fabs(s.Yd[k]) < 30 * slowest;
                if (mode.closed[k] && opened[k] && s.Yd[k] < 30 * slowest) s.Yd[k] = 0, opened[k] = false;
                if (slow) {
                    s.Y[k] = s.Yd[k] = 0;
                    if (o.e[k] > 0) tell("zeno", k);
                }
            }
        if (zeno)
            for (int c = 0; c < o.p; c++)
                // where each impact reverses the slip, so does the last
                if (fabs(s.W[c]) < 1e4 * slowest || stuck[c]) s.W[c] = 0;
        settle(false, opened);
    }

    // After an event of the limits: who breaks must not stick again by rounding; the rest is decided.
    void go_on(const bool *broken) {
        Mode before = mode;
        settle(false, nullptr, broken);
        if (mode == before && ++loops > 12) throw Failure{"chatter"};
    }

    void start() {
        for (int c = 0; c < o.p; c++) mode.sigma[c] = OPEN;
        m.parts(s.t, s.q, s.v, mode);
        std::vector<int> hit;
        for (int k = 0; k < o.m; k++) {
            s.Y[k] = m.z.g[k], s.Yd[k] = m.along(m.z.N[k], s.v) + m.z.gt[k];
            if (fabs(s.Y[k]) < 1e-15) s.Y[k] = 0;
            if (s.Y[k] == 0 && fabs(s.Yd[k]) < 1e-15) s.Yd[k] = 0;
            if (s.Y[k] == 0 && s.Yd[k] < 0) hit.push_back(k);
        }
        for (int c = 0; c < o.p; c++) {
            s.W[c] = m.along(m.z.B[c], s.v) + m.z.beta[c];
            if (fabs(s.W[c]) < 1e-15) s.W[c] = 0;
        }
        settle(true, nullptr);
        if (!hit.empty()) impact(hit);
    }

    // A step as long as it is accurate, and no longer than what comes next seems to be away.
    R length(R room) {
        Forces f;
        m.forces(s.t, s.q, s.v, s.W, mode, f);
        R most = min(h, room);
        for (int k = 0; k < o.m; k++)
            if (!mode.closed[k]) {
                R a = -f.Ydd[k], b = s.Yd[k], root = b * b + 2 * a * s.Y[k];
                if (a > 0 && root > 0) most = min(most, R(1.25) * (b + sqrt(root)) / a);
            }
        for (int c = 0; c < o.p; c++)
            if ((mode.sigma[c] == 1 || mode.sigma[c] == -1) && s.W[c] != 0 && s.W[c] * f.Wd[c] < 0)
                most = min(most, R(1.25) * fabs(s.W[c] / f.Wd[c]));
        return most;
    }

    void go() {
        start();
        static Step step;
        while (s.t < end) {
            if (++steps > 30000) throw Failure{"too many steps"};
            R dt = length(end - s.t);
            R last = 1e300;
            for (;;) {
                bool settled = take(m, s, mode, dt, step);
                if (settled && step.error <= TRUNCATION) break;
                if (!settled) step.error = 1;
                // no shorter step helps against rounding
                if (step.error < 1e6 * EPS && step.error > last / 4) {
                    h = 2 * dt;
                    break;
                }
                last = step.error;
                R shorter = dt * max(R(0.3), min(R(0.8), pow(TRUNCATION / max(step.error, EPS * EPS), R(1) / N)));
                dt = h = shorter;
                if (dt < 1e-14) break;
            }
            if (dt > h / 2 && step.error <= TRUNCATION) h = dt * min(R(1.6), max(R(0.9), pow(TRUNCATION / max(step.error, EPS), R(1) / N)));
            R first = 2;
            for (auto &it : step.watched) {
                R t = 1e30, x = first_root(it, &t);
                if (x > 1) touch = min(touch, t);
                first = min(first, x);
            }
            State now;
            state_at(o, s, step, min(first, 1), now);
            if (first > 1) {
                if (dt == end - s.t) now.t = end;
                s = now, loops = 0;
                check();
                continue;
            }
            event(step, first, now);
        }
    }

    void check() {
        m.parts(s.t, s.q, s.v, mode);
        for (int k = 0; k < o.m; k++) drift = max(drift, fabs(m.z.g[k] - s.Y[k]));
        for (int c = 0; c < o.p; c++) {
            R w = m.z.beta[c] + m.along(m.z.B[c], s.v);
            drift = max(drift, fabs(w - s.W[c]) / (1 + fabs(w)));
        }
    }

    void event(const Step &step, R x, const State &now) {
        std::vector<int> hit, stopped;
        bool limits = false, broken[P_MAX] = {};
        R near = 1e3 * EPS * (1 + x) + EPS;
        for (auto &it : step.watched) {
            R none = 1e30, at = first_root(it, &none);
            if (at > x + near) continue;
            if (it.kind == 'y') hit.push_back(it.who);
            if (it.kind == 'w') stopped.push_back(it.who);
            if (it.kind != 'f') continue;
            limits = true;
            Forces f;
            std::vector<const Limit *> of;
            m.forces(now.t, now.q, now.v, now.W, mode, f);
            m.of_function(f, it.who, of);
            for (auto one : of)
                if (one->kind == 's') broken[one->who] = true;
        }
        State before = s;
        since = before.t;
        s = now;
        check();
        for (int k : hit) s.Y[k] = 0;
        for (int c : stopped) s.W[c] = 0;
        // two feet of one body stop together
        for (int c = 0; !stopped.empty() && c < o.p; c++)
            if (mode.sigma[c] != OPEN && mode.sigma[c] != 0 && fabs(s.W[c]) < 1e6 * EPS) s.W[c] = 0;
        if (s.t - before.t > 1e-15) loops = 0;
        if (!hit.empty()) {
            if (!stopped.empty() || limits) settle(false, nullptr, broken);
            impact(hit);
        } else go_on(broken);
    }
};

static void print(const Run &r, const char *status) {
    auto quoted = [](R x) { return text_of(x); };
    std::cout << "{\"status\": \"" << status << "\", \"events\": [";
    const char *comma = "";
    for (auto &it : r.told) std::cout << comma << "[\"" << it.kind << "\", " << quoted(it.t) << ", " << it.who << "]", comma = ", ";
    std::cout << "], \"impacts\": [", comma = "";
    for (auto &it : r.hits)
        std::cout << comma << "[" << quoted(it.t) << ", " << it.gap << ", " << quoted(it.speed) << ", " << it.sigma << "]", comma = ", ";
    std::cout << "], \"t\": " << quoted(r.s.t) << ", \"end\": [", comma = "";
    for (int j = 0; j < r.o.n; j++) std::cout << comma << quoted(r.s.q[j]), comma = ", ";
    for (int j = 0; j < r.o.n; j++) std::cout << comma << quoted(r.s.v[j]);
    std::cout << "], \"modes\": [", comma = "";
    for (int c = 0; c < r.o.p; c++) std::cout << comma << r.mode.sigma[c], comma = ", ";
    std::cout << "], \"friction\": " << quoted(r.s.lost) << ", \"normal\": " << quoted(r.normal_lost)
              << ", \"drift\": " << quoted(r.drift) << ", \"touch\": " << quoted(r.touch) << ", \"tie\": " << quoted(r.tie)
              << ", \"steps\": " << r.steps << ", \"not_unique\": " << (r.not_unique ? "true" : "false")
              << ", \"undetermined\": " << (r.undetermined ? "true" : "false") << "}" << std::endl;
}

int main() {
    prepare();
    std::string line;
    while (std::getline(std::cin, line)) {
        std::istringstream in(line);
        std::string family, word;
        size_t count;
        in >> family >> count;
        std::vector<R> a(count);
        for (auto &x : a) in >> word, x = real_of(word.c_str());
        Model o;
        if (!model_of(family, a, o)) {
            std::cout << "{\"status\": \"no such family\"}" << std::endl;
            continue;
        }
        in >> word;
        Run run(o, real_of(word.c_str()));
        for (int j = 0; j < o.n; j++) in >> word, run.s.q[j] = real_of(word.c_str());
        for (int j = 0; j < o.n; j++) in >> word, run.s.v[j] = real_of(word.c_str());
        try {
            run.go();
            print(run, "ok");
        } catch (const Failure &f) {
            print(run, f.what);
        }
    }
}
