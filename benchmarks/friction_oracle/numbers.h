// The real numbers of the oracle, and small linear systems in them.
#pragma once
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#ifdef QUAD
#include <quadmath.h>
typedef __float128 R;
static R sin(R x) { return sinq(x); }
static R cos(R x) { return cosq(x); }
static R sqrt(R x) { return sqrtq(x); }
static R fabs(R x) { return fabsq(x); }
static R pow(R x, R y) { return powq(x, y); }
static R real_of(const char *text) { return strtoflt128(text, nullptr); }
static std::string text_of(R x) {
    char text[64];
    quadmath_snprintf(text, 64, "%.30Qg", x);
    return text;
}
static const R EPS = 2e-34Q, TRUNCATION = 1e-30Q, SLOWEST = 1e-28Q;
enum { NODES = 36 };
#else
typedef long double R;
using std::cos;
using std::fabs;
using std::pow;
using std::sin;
using std::sqrt;
static R real_of(const char *text) { return strtold(text, nullptr); }
static std::string text_of(R x) {
    char text[64];
    snprintf(text, 64, "%.20Lg", x);
    return text;
}
static const R EPS = 1.1e-19L, TRUNCATION = 2e-17L, SLOWEST = 1e-19L;
enum { NODES = 20 };
#endif
static R max(R a, R b) { return a > b ? a : b; }
static R min(R a, R b) { return a < b ? a : b; }

enum { N_MAX = 4, M_MAX = 3, P_MAX = 4, ROWS = M_MAX + P_MAX };

// Solves K x = r by elimination with full pivoting; of a singular system one solution, and the
// null vector where there is one. Returns the number of null vectors, -1 for no solution.
static int solve(int n, const R K[ROWS][ROWS], const R *r, R *x, R *null, int *sign) {
    R a[ROWS][ROWS + 1], size = 0;
    int column[ROWS], rank = 0;
    *sign = 1;
    for (int i = 0; i < n; i++) {
        column[i] = i;
        for (int j = 0; j < n; j++) a[i][j] = K[i][j], size = max(size, fabs(a[i][j]));
        a[i][n] = r[i];
    }
    for (; rank < n; rank++) {
        int best_i = rank, best_j = rank;
        for (int i = rank; i < n; i++)
            for (int j = rank; j < n; j++)
                if (fabs(a[i][j]) > fabs(a[best_i][best_j])) best_i = i, best_j = j;
        if (fabs(a[best_i][best_j]) <= 1e-13 * size) break;
        if (best_i != rank) {
            *sign = -*sign;
            for (int j = 0; j <= n; j++) std::swap(a[rank][j], a[best_i][j]);
        }
        if (best_j != rank) {
            *sign = -*sign;
            for (int i = 0; i < n; i++) std::swap(a[i][rank], a[i][best_j]);
            std::swap(column[rank], column[best_j]);
        }
        if (a[rank][rank] < 0) *sign = -*sign;
        for (int i = 0; i < n; i++) {
            if (i == rank) continue;
            R factor = a[i][rank] / a[rank][rank];
            for (int j = rank; j <= n; j++) a[i][j] -= factor * a[rank][j];
        }
    }
    R largest = 0;
    for (int i = 0; i < n; i++) largest = max(largest, fabs(r[i])), x[column[i]] = null[column[i]] = 0;
    for (int i = rank; i < n; i++)
        if (fabs(a[i][n]) > 1e-11 * (largest + 1e-300)) return -1;
    for (int i = 0; i < rank; i++) x[column[i]] = a[i][n] / a[i][i];
    if (rank == n - 1) {
        R norm = 1;
        null[column[rank]] = 1;
        for (int i = 0; i < rank; i++) {
            null[column[i]] = -a[i][rank] / a[i][i];
            norm += null[column[i]] * null[column[i]];
        }
        for (int i = 0; i < n; i++) null[i] /= sqrt(norm);
    }
    if (rank < n) *sign = 1;
    return n - rank;
}
