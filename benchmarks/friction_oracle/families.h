// The mechanical systems: M q'' = F + forces of contacts and joints, at (t, q, v).
//
// Gap i: value g, gradient N, partial derivative g_t, and h = g'' without acceleration. Channel c:
// slip speed w = B v + beta, and k = w' without acceleration; it belongs to the gap gap_of[c], or is
// a joint (-1) of limit L, in stick Ls. sigma is the sign of slip, by which |w| is analytic.
#pragma once
#include <vector>

#include "numbers.h"

struct Parts {
    R M[N_MAX][N_MAX], F[N_MAX];
    R N[M_MAX][N_MAX], g[M_MAX], gt[M_MAX], h[M_MAX];
    R B[P_MAX][N_MAX], beta[P_MAX], k[P_MAX], L[P_MAX], Ls[P_MAX], mu[P_MAX], mus[P_MAX], mu0[P_MAX];
};

struct Model {
    int n, m, p;
    int gap_of[P_MAX];
    R e[M_MAX], et[P_MAX];
    std::vector<R> a;  // the family's numbers
    void (*parts)(const Model &, R t, const R *q, const R *v, const int *sigma, Parts &);
};

static const R G = real_of("9.81");

static R speed_of(const Model &o, const Parts &z, int c, const R *v, const int *sigma) {
    R w = z.beta[c];
    for (int j = 0; j < o.n; j++) w += z.B[c][j] * v[j];
    return sigma[c] * w;
}

static void rubs(Parts &z, int c, R mu, R mus) { z.mu[c] = z.mu0[c] = mu, z.mus[c] = mus; }

// al mu e et mus m: a block on a slope
static void incline(const Model &o, R, const R *q, const R *, const int *, Parts &z) {
    R m = o.a[5];
    z.M[0][0] = z.M[1][1] = m;
    z.F[0] = m * G * sin(o.a[0]), z.F[1] = -m * G * cos(o.a[0]);
    z.N[0][1] = z.B[0][0] = 1, z.g[0] = q[1];
    rubs(z, 0, o.a[1], o.a[4]);
}

// k c v Lk Ls gam A Om: a mass on a belt
static void belt(const Model &o, R t, const R *q, const R *v, const int *sigma, Parts &z) {
    const R *a = o.a.data();
    z.M[0][0] = z.B[0][0] = 1, z.beta[0] = -a[2];
    z.F[0] = -a[0] * q[0] - a[1] * v[0] + a[6] * cos(a[7] * t);
    z.L[0] = a[3] / (1 + a[5] * speed_of(o, z, 0, v, sigma)), z.Ls[0] = a[4];
}

// k1 k2 k12 v L1 L2 s1 s2 gam: two blocks on a belt
static void belt2(const Model &o, R, const R *q, const R *v, const int *sigma, Parts &z) {
    const R *a = o.a.data();
    for (int c = 0; c < 2; c++) {
        z.M[c][c] = z.B[c][c] = 1, z.beta[c] = -a[3];
        z.F[c] = -a[c] * q[c] - a[2] * (q[c] - q[1 - c]);
        z.L[c] = a[4 + c] / (1 + a[8] * speed_of(o, z, c, v, sigma)), z.Ls[c] = a[6 + c];
    }
}

// k v L Ls d e A Om: a forced mass on a belt, with a stop
static void beltstop(const Model &o, R t, const R *q, const R *, const int *, Parts &z) {
    const R *a = o.a.data();
    z.M[0][0] = z.B[0][0] = 1, z.beta[0] = -a[1];
    z.F[0] = -a[0] * q[0] + a[6] * cos(a[7] * t);
    z.N[0][0] = -1, z.g[0] = a[4] - q[0];
    z.L[0] = a[2], z.Ls[0] = a[3];
}

// mu e et A Om mus, ends: a slender rod of half length 1 on a floor that moves up and down
static void rod_of(const Model &o, R t, const R *q, const R *v, Parts &z, int ends) {
    const R *a = o.a.data();
    R s = sin(q[2]), c = cos(q[2]), o2 = v[2] * v[2];
    R floor = a[3] * sin(a[4] * t), rate = a[3] * a[4] * cos(a[4] * t);
    z.M[0][0] = z.M[1][1] = 1, z.M[2][2] = R(1) / 3;
    z.F[1] = -G;
    for (int i = 0; i < ends; i++) {
        R d = i ? 1 : -1;
        z.N[i][1] = 1, z.N[i][2] = d * c, z.g[i] = q[1] + d * s - floor, z.gt[i] = -rate;
        z.h[i] = -d * s * o2 + a[4] * a[4] * floor;
        z.B[i][0] = 1, z.B[i][2] = -d * s, z.k[i] = -d * c * o2;
        rubs(z, i, a[0], a[5]);
    }
}
static void rod1(const Model &o, R t, const R *q, const R *v, const int *, Parts &z) { rod_of(o, t, q, v, z, 1); }
static void rod2(const Model &o, R t, const R *q, const R *v, const int *, Parts &z) { rod_of(o, t, q, v, z, 2); }

// b h mu e et A Om mus: a block on two feet, on a floor that moves sideways
static void rock(const Model &o, R t, const R *q, const R *v, const int *, Parts &z) {
    const R *a = o.a.data();
    R s = sin(q[2]), c = cos(q[2]), o2 = v[2] * v[2];
    z.M[0][0] = z.M[1][1] = 1, z.M[2][2] = (a[0] * a[0] + a[1] * a[1]) / 3;
    z.F[1] = -G;
    for (int i = 0; i < 2; i++) {
        R d = i ? a[0] : -a[0], x = d * c + a[1] * s, y = d * s - a[1] * c;
        z.N[i][1] = 1, z.N[i][2] = x, z.g[i] = q[1] + y, z.h[i] = -y * o2;
        z.B[i][0] = 1, z.B[i][2] = -y, z.beta[i] = -a[5] * a[6] * cos(a[6] * t);
        z.k[i] = -x * o2 + a[5] * a[6] * a[6] * sin(a[6] * t);
        rubs(z, i, a[2], a[7]);
    }
}

// mu: the toy
static void woodpecker(const Model &o, R, const R *q, const R *, const int *, Parts &z) {
    static const R mS = real_of(".0045"), mM = real_of(".0003"), JS = real_of("7e-7"), JM = real_of("5e-9"),
                   c = real_of(".0056"), r0 = real_of(".0025"), rM = real_of(".0031"), hM = real_of(".0058"),
                   lM = real_of(".01"), lG = real_of(".015"), hS = real_of(".02"), lS = real_of(".0201");
    R M[3][3] = {{mS + mM, mS * lM, mS * lG},
                 {mS * lM, JM + mS * lM * lM, mS * lM * lG},
                 {mS * lG, mS * lM * lG, JS + mS * lG * lG}};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) z.M[i][j] = M[i][j];
    z.F[0] = -(mS + mM) * G;
    z.F[1] = -c * (q[1] - q[2]) - mS * G * lM, z.F[2] = -c * (q[2] - q[1]) - mS * G * lG;
    z.N[0][2] = -hS, z.N[1][1] = hM, z.N[2][1] = -hM;
    z.g[0] = lM + lG - lS - r0 - hS * q[2], z.g[1] = rM - r0 + hM * q[1], z.g[2] = rM - r0 - hM * q[1];
    z.B[0][0] = z.B[1][0] = z.B[2][0] = 1;
    z.B[0][1] = lM, z.B[0][2] = lG - lS, z.B[1][1] = z.B[2][1] = rM;
    for (int i = 0; i < 3; i++) rubs(z, i, o.a[0], o.a[0]);
}

// mu e et r A Om al mus: a disc on a slope that vibrates along its normal
static void disc(const Model &o, R t, const R *q, const R *, const int *, Parts &z) {
    const R *a = o.a.data();
    R r = a[3], floor = a[4] * sin(a[5] * t);
    z.M[0][0] = z.M[1][1] = 1, z.M[2][2] = r * r / 2;
    z.F[0] = G * sin(a[6]), z.F[1] = -G * cos(a[6]);
    z.N[0][1] = 1, z.g[0] = q[1] - r - floor, z.gt[0] = -a[4] * a[5] * cos(a[5] * t), z.h[0] = a[5] * a[5] * floor;
    z.B[0][0] = 1, z.B[0][2] = r;
    rubs(z, 0, a[0], a[7]);
}

// al mu e A Om beta mus fall: a part on a slope that vibrates; mu/(1 + fall |w|) in slip
static void feeder(const Model &o, R t, const R *q, const R *v, const int *sigma, Parts &z) {
    const R *a = o.a.data();
    R x = a[3] * sin(a[4] * t), rate = a[3] * a[4] * cos(a[4] * t), push = a[4] * a[4] * x;
    R cb = cos(a[5]), sb = sin(a[5]);
    z.M[0][0] = z.M[1][1] = 1;
    z.F[0] = G * sin(a[0]), z.F[1] = -G * cos(a[0]);
    z.N[0][1] = 1, z.g[0] = q[1] - sb * x, z.gt[0] = -sb * rate, z.h[0] = sb * push;
    z.B[0][0] = 1, z.beta[0] = -cb * rate, z.k[0] = cb * push;
    rubs(z, 0, a[1], a[6]);
    z.mu[0] = a[1] / (1 + a[7] * speed_of(o, z, 0, v, sigma));
}

// mu e cd kappa mus: a particle in the bowl y = kappa x^2/2, with drag -cd |v| v
static void bowl(const Model &o, R, const R *q, const R *v, const int *, Parts &z) {
    const R *a = o.a.data();
    R x = q[0], fast = sqrt(v[0] * v[0] + v[1] * v[1]);
    z.M[0][0] = z.M[1][1] = 1;
    z.F[0] = -a[2] * fast * v[0], z.F[1] = -G - a[2] * fast * v[1];
    z.N[0][0] = -a[3] * x, z.N[0][1] = 1, z.g[0] = q[1] - a[3] * x * x / 2, z.h[0] = -a[3] * v[0] * v[0];
    z.B[0][0] = 1, z.B[0][1] = a[3] * x, z.k[0] = a[3] * v[0] * v[1];
    rubs(z, 0, a[0], a[4]);
}

// muf muw ef ew r Fx A Om T0 T1: a disc in the corner of a floor and a wall, pushed by Fx + A cos Om t
// and turned by T0 + T1 sin Om t
static void corner(const Model &o, R t, const R *q, const R *, const int *, Parts &z) {
    const R *a = o.a.data();
    R r = a[4];
    z.M[0][0] = z.M[1][1] = 1, z.M[2][2] = r * r / 2;
    z.F[0] = a[5] + a[6] * cos(a[7] * t), z.F[1] = -G, z.F[2] = a[8] + a[9] * sin(a[7] * t);
    z.N[0][1] = 1, z.g[0] = q[1] - r, z.B[0][0] = 1, z.B[0][2] = r;
    z.N[1][0] = 1, z.g[1] = q[0] - r, z.B[1][1] = 1, z.B[1][2] = -r;
    rubs(z, 0, a[0], a[0]), rubs(z, 1, a[1], a[1]);
}

// ks cs kp kd A Om L Ls d e ml: a motor with stiction drives a load through a spring, up to a stop
static void servo(const Model &o, R t, const R *q, const R *v, const int *, Parts &z) {
    const R *a = o.a.data();
    R twist = a[0] * (q[0] - q[1]) + a[1] * (v[0] - v[1]);
    z.M[0][0] = 1, z.M[1][1] = a[10];
    z.F[0] = -twist - a[2] * (q[0] - a[4] * sin(a[5] * t)) - a[3] * (v[0] - a[4] * a[5] * cos(a[5] * t));
    z.F[1] = twist;
    z.N[0][1] = -1, z.g[0] = a[8] - q[1];
    z.B[0][0] = 1, z.L[0] = a[6], z.Ls[0] = a[7];
}

// m12 L Ls e A Om c: a mass bounces in a guide with friction; a second coordinate is coupled by inertia
static void guide(const Model &o, R t, const R *q, const R *v, const int *, Parts &z) {
    const R *a = o.a.data();
    z.M[0][0] = z.M[1][1] = 1, z.M[0][1] = z.M[1][0] = a[0];
    z.F[0] = -G - a[6] * v[0] + a[4] * sin(a[5] * t), z.F[1] = -4 * q[1] - a[6] * v[1];
    z.N[0][0] = 1, z.g[0] = q[0];
    z.B[0][a[0] != 0] = 1;  // without coupling the guide itself rubs, with it the second coordinate
    z.L[0] = a[1], z.Ls[0] = a[2];
}

// m2 mu1 mu2 e1 e2 A Om Ah Oh mus1 mus2 h down: two stacked blocks (x1 y1 x2 y2), the upper one pushed
// down, on a floor that moves up and sideways
static void stack(const Model &o, R t, const R *q, const R *, const int *, Parts &z) {
    const R *a = o.a.data();
    R floor = a[5] * sin(a[6] * t);
    z.M[0][0] = z.M[1][1] = 1, z.M[2][2] = z.M[3][3] = a[0];
    z.F[1] = -G, z.F[3] = -a[0] * G - a[12];
    z.N[0][1] = 1, z.g[0] = q[1] - floor, z.gt[0] = -a[5] * a[6] * cos(a[6] * t), z.h[0] = a[6] * a[6] * floor;
    z.B[0][0] = 1, z.beta[0] = -a[7] * a[8] * cos(a[8] * t), z.k[0] = a[7] * a[8] * a[8] * sin(a[8] * t);
    z.N[1][1] = -1, z.N[1][3] = 1, z.g[1] = q[3] - q[1] - a[11];
    z.B[1][0] = -1, z.B[1][2] = 1;
    rubs(z, 0, a[1], a[9]), rubs(z, 1, a[2], a[10]);
}

// m2 mu e mus L Ls k A Om: an arm of two links of length 1, point masses 1 and m2 at their ends; the
// shoulder rubs, the tip meets the floor y = -d (a[9]); A sin Om t turns the shoulder, springs k hold both
static void arm(const Model &o, R t, const R *q, const R *v, const int *, Parts &z) {
    const R *a = o.a.data();
    R m2 = a[0], s1 = sin(q[0]), c1 = cos(q[0]), s2 = sin(q[1]), c2 = cos(q[1]);
    R cd = c1 * c2 + s1 * s2, sd = s1 * c2 - c1 * s2;  // of q0 - q1; absolute angles from below
    z.M[0][0] = 1 + m2, z.M[0][1] = z.M[1][0] = m2 * cd, z.M[1][1] = m2;
    z.F[0] = -m2 * sd * v[1] * v[1] - (1 + m2) * G * s1 - a[6] * q[0] + a[7] * sin(a[8] * t);
    z.F[1] = m2 * sd * v[0] * v[0] - m2 * G * s2 - a[6] * q[1];
    // tip: x = sin q0 + sin q1, y = -cos q0 - cos q1
    z.N[0][0] = s1, z.N[0][1] = s2, z.g[0] = a[9] - c1 - c2, z.h[0] = c1 * v[0] * v[0] + c2 * v[1] * v[1];
    z.B[0][0] = c1, z.B[0][1] = c2, z.k[0] = -s1 * v[0] * v[0] - s2 * v[1] * v[1];
    rubs(z, 0, a[1], a[3]);
    z.B[1][0] = 1, z.L[1] = a[4], z.Ls[1] = a[5];
}

static bool model_of(const std::string &name, const std::vector<R> &a, Model &o) {
    o = Model{};
    o.a = a;
    auto is = [&](const char *it, int n, int m, int p, decltype(o.parts) parts) {
        if (name != it) return false;
        o.n = n, o.m = m, o.p = p, o.parts = parts;
        for (int c = 0; c < p; c++) o.gap_of[c] = c < m ? c : -1;
        return true;
    };
    auto law = [&](R e, R et) {
        for (int i = 0; i < o.m; i++) o.e[i] = e;
        for (int c = 0; c < o.p; c++) o.et[c] = et;
        return true;
    };
    if (is("incline", 2, 1, 1, incline)) return law(a[2], a[3]);
    if (is("belt", 1, 0, 1, belt)) return true;
    if (is("belt2", 2, 0, 2, belt2)) return true;
    if (is("beltstop", 1, 1, 1, beltstop)) return o.gap_of[0] = -1, law(a[5], 0);
    if (is("rod1", 3, 1, 1, rod1) || is("rod2", 3, 2, 2, rod2)) return law(a[1], a[2]);
    if (is("rock", 3, 2, 2, rock)) return law(a[3], a[4]);
    if (is("woodpecker", 3, 3, 3, woodpecker)) return o.e[0] = R(1) / 2, true;
    if (is("disc", 3, 1, 1, disc)) return law(a[1], a[2]);
    if (is("feeder", 2, 1, 1, feeder)) return law(a[2], 0);
    if (is("bowl", 2, 1, 1, bowl)) return law(a[1], 0);
    if (is("corner", 3, 2, 2, corner)) return o.e[0] = a[2], o.e[1] = a[3], true;
    if (is("servo", 2, 1, 1, servo)) return o.gap_of[0] = -1, law(a[9], 0);
    if (is("guide", 2, 1, 1, guide)) return o.gap_of[0] = -1, law(a[3], 0);
    if (is("stack", 4, 2, 2, stack)) return o.e[0] = a[3], o.e[1] = a[4], true;
    if (is("arm", 2, 1, 2, arm)) return law(a[2], 0);
    return false;
}
