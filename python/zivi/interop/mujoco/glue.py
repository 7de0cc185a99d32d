"""The numbers of a system from MuJoCo's functions, in C: each call has an mjData of its own."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.interop.mujoco.refuse import name_of
from zivi.system.tree.gaps import JointLimit, PlaneGap, TreeGap

__all__ = ["SOURCE", "Glue", "Point"]

SOURCE = r"""
#include <math.h>

typedef struct {
    int busy; void *d;
    double *qpos, *qvel, *passive, *bias, *actuator, *applied, *xpos, *xmat, *work;
} slot_t;
typedef struct { long kind, a, b; double pa[3], pb[3], n[3], c; } gap_t;
typedef struct {
    void *m; long n, gaps, slots, tendons, actuators; slot_t *slot; gap_t *gap;
    void (*kinematics)(void *, void *), (*com)(void *, void *), (*tendon)(void *, void *);
    void (*mass)(void *, void *), (*transmission)(void *, void *);
    void (*com_velocity)(void *, void *), (*passive)(void *, void *);
    void (*bias)(void *, void *, int, double *);
    void (*velocity)(void *, void *), (*actuation)(void *, void *);
    void (*full)(void *, void *, double *);
    void (*jac)(void *, void *, double *, double *, double *, int);
    void (*jac_dot)(void *, void *, double *, double *, double *, int);
} model_t;

/* place, velocity and acceleration without q'' of a point, and its Jacobian */
static void point(const model_t *s, const slot_t *k, long body, const double *local,
                  const double *w, double *at, double *v, double *a, double *jac)
{
    const double *x = k->xpos + 3 * body, *r = k->xmat + 9 * body;
    double *dot = k->work;
    for (int i = 0; i < 3; ++i) {
        at[i] = x[i] + r[3 * i] * local[0] + r[3 * i + 1] * local[1] + r[3 * i + 2] * local[2];
    }
    s->jac(s->m, k->d, jac, 0, at, (int)body);
    s->jac_dot(s->m, k->d, dot, 0, at, (int)body);
    for (int i = 0; i < 3; ++i) {
        v[i] = a[i] = 0.0;
        for (long j = 0; j < s->n; ++j) {
            v[i] += jac[i * s->n + j] * w[j];
            a[i] += dot[i * s->n + j] * w[j];
        }
    }
}

static void along(const model_t *s, const double *n, const double *jac, double sign, double *row)
{
    for (long j = 0; j < s->n; ++j) {
        row[j] += sign * (n[0] * jac[j] + n[1] * jac[s->n + j] + n[2] * jac[2 * s->n + j]);
    }
}

static double dot3(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void fill(const model_t *s, const slot_t *k, const gap_t *g, const double *q,
                 const double *w, double *gap, double *row, double *h)
{
    double pa[3], va[3], aa[3], pb[3], vb[3], ab[3], u[3];
    double *ja = k->work + 3 * s->n, *jb = k->work + 6 * s->n;
    for (long j = 0; j < s->n; ++j) row[j] = 0.0;
    *h = 0.0;
    if (g->kind < 2) {
        double sign = g->kind == 0 ? 1.0 : -1.0;
        *gap = sign * (q[g->a] - g->c);
        row[g->a] = sign;
        return;
    }
    point(s, k, g->a, g->pa, w, pa, va, aa, ja);
    if (g->kind == 2) {
        *gap = dot3(g->n, pa) - g->c;
        along(s, g->n, ja, 1.0, row);
        *h = dot3(g->n, aa);
        return;
    }
    point(s, k, g->b, g->pb, w, pb, vb, ab, jb);
    for (int i = 0; i < 3; ++i) { pa[i] -= pb[i]; va[i] -= vb[i]; aa[i] -= ab[i]; }
    double length = sqrt(dot3(pa, pa));
    for (int i = 0; i < 3; ++i) u[i] = pa[i] / length;
    double closing = dot3(u, va);
    *gap = length - g->c;
    along(s, u, ja, 1.0, row);
    along(s, u, jb, -1.0, row);
    *h = dot3(u, aa) + (dot3(va, va) - closing * closing) / length;
}

int model(double t, const double *q, const double *w, double *out, void *data)
{
    const model_t *s = data;
    long n = s->n, m = s->gaps, i = 0;
    (void)t;
    /* one of the mjData that no other thread is at work with */
    while (__sync_lock_test_and_set(&s->slot[i].busy, 1)) i = (i + 1) % s->slots;
    slot_t *k = &s->slot[i];
    for (long j = 0; j < n; ++j) { k->qpos[j] = q[j]; k->qvel[j] = w[j]; }
    /* parts of mj_fwdPosition and mj_fwdVelocity: the rest of them reads a clock 20 times */
    s->kinematics(s->m, k->d);
    s->com(s->m, k->d);
    if (s->tendons) s->tendon(s->m, k->d);
    s->mass(s->m, k->d);
    if (s->actuators) s->transmission(s->m, k->d);
    if (s->tendons || s->actuators) {
        s->velocity(s->m, k->d);
        s->actuation(s->m, k->d);
    } else {
        s->com_velocity(s->m, k->d);
        s->passive(s->m, k->d);
        s->bias(s->m, k->d, 0, k->bias);
    }
    s->full(s->m, k->d, out);
    double *force = out + n * n, *gap = force + n, *row = gap + m, *h = row + m * n;
    for (long j = 0; j < n; ++j) {
        force[j] = k->passive[j] - k->bias[j] + k->actuator[j] + k->applied[j];
    }
    for (long j = 0; j < m; ++j) {
        fill(s, k, &s->gap[j], q, w, gap + j, row + j * n, h + j);
        h[m + j] = 0.0;
    }
    __sync_lock_release(&k->busy);
    return 0;
}
"""

POINTERS = ("qpos", "qvel", "qfrc_passive", "qfrc_bias", "qfrc_actuator", "qfrc_applied")
FUNCTIONS = (
    "mj_kinematics",
    "mj_comPos",
    "mj_tendon",
    "mj_makeM",
    "mj_transmission",
    "mj_comVel",
    "mj_passive",
    "mj_rne",
    "mj_fwdVelocity",
    "mj_fwdActuation",
    "mj_fullM",
    "mj_jac",
    "mj_jacDot",
)


class _Slot(ctypes.Structure):
    _fields_ = [
        ("busy", ctypes.c_int),
        *((f"p{i}", ctypes.c_void_p) for i in range(len(POINTERS) + 4)),
    ]


class Point(ctypes.Structure):
    """A gap, as the code in C has it."""

    _fields_ = [
        *((name, ctypes.c_long) for name in ("kind", "a", "b")),
        *((name, ctypes.c_double * 3) for name in ("pa", "pb", "n")),
        ("c", ctypes.c_double),
    ]


class _Model(ctypes.Structure):
    _fields_ = [
        ("m", ctypes.c_void_p),
        *((name, ctypes.c_long) for name in ("n", "gaps", "slots", "tendons", "actuators")),
        *((name, ctypes.c_void_p) for name in ("slot", "gap", *FUNCTIONS)),
    ]


class Glue:
    """What the code in C is called with, and what keeps it alive.

    Parameters
    ----------
    model : mujoco.MjModel
        A model of its own.
    gaps : sequence of TreeGap
        The gaps.
    ctrl : ndarray
        The controls.
    """

    def __init__(self, model: Any, gaps: Sequence[TreeGap], ctrl: Array) -> None:
        import mujoco

        self.model, self.ctrl = model, ctrl
        folder = Path(mujoco.__file__).parent
        library = next(
            it for it in sorted(folder.iterdir()) if it.name.startswith(("libmujoco", "mujoco.dll"))
        )
        self._library = ctypes.CDLL(str(library))
        self.names, points = _points(model, gaps)
        self._points = (Point * max(1, len(points)))(*points)
        count = max(4, os.cpu_count() or 1)
        self._data = [mujoco.MjData(model) for _ in range(count)]
        self._work = np.zeros((count, 9 * model.nv))
        self._slots = (_Slot * count)(*(self._slot(i) for i in range(count)))
        functions = [
            ctypes.cast(getattr(self._library, name), ctypes.c_void_p).value for name in FUNCTIONS
        ]
        self._head = _Model(
            model._address,
            model.nv,
            len(points),
            count,
            model.ntendon,
            model.nu,
            ctypes.addressof(self._slots),
            ctypes.addressof(self._points),
            *functions,
        )

    @property
    def address(self) -> int:
        """Where it is."""
        return ctypes.addressof(self._head)

    def _slot(self, i: int) -> _Slot:
        data = self._data[i]
        data.ctrl[:] = self.ctrl
        arrays = [getattr(data, name) for name in POINTERS]
        arrays += [data.xpos, data.xmat, self._work[i]]
        return _Slot(0, data._address, *(array.ctypes.data for array in arrays))


def _points(model: Any, gaps: Sequence[TreeGap]) -> tuple[list[str], list[Point]]:
    """Give names and gaps, one by one."""
    bodies: dict[str | None, int] = {name_of(model, "body", i): i for i in range(model.nbody)}
    bodies[None] = 0
    dofs = {name_of(model, "joint", i): int(model.jnt_dofadr[i]) for i in range(model.njnt)}
    names, points = [], []
    three = ctypes.c_double * 3
    for gap in gaps:
        if isinstance(gap, JointLimit):
            for kind, side in enumerate(("lower", "upper")):
                if (bound := getattr(gap, side)) is not None:
                    names.append(f"{gap.joint}.{side}")
                    points.append(Point(kind, dofs[gap.joint], 0, c=bound))
            continue
        names.append(gap.name or gap.body)
        at = three(*np.asarray(gap.point))
        if isinstance(gap, PlaneGap):
            normal = three(*np.asarray(gap.normal))
            beyond = gap.offset + gap.radius
            points.append(Point(2, bodies[gap.body], 0, at, three(), normal, beyond))
        else:
            other = three(*np.asarray(gap.other_point))
            pair = bodies[gap.body], bodies[gap.other]
            points.append(Point(3, *pair, at, other, three(), gap.radius))
    return names, points
