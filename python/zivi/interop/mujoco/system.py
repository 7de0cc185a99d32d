"""Systems evaluated by MuJoCo, for models that a tree does not support."""

from __future__ import annotations

import copy
import ctypes
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array
from zivi.base.extras import needed
from zivi.base.machine_code import compile_model
from zivi.interop.mujoco.contacts import read_gaps
from zivi.interop.mujoco.read import read_ctrl
from zivi.interop.mujoco.refusals import element_name, refuse_for_system
from zivi.system.gap import one_of
from zivi.system.impact_law import GivenRestitutions, restitutions, written
from zivi.system.mechanism import MAX_SIZE, MechanicalSystem, Model, distinct_names
from zivi.system.model_parts import Layout
from zivi.system.tree_bodies import JointLimit, PlaneGap, TreeGap, is_rough

# The numbers of a system from MuJoCo's functions, in C: each call has an mjData of its own.

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


class GapStruct(ctypes.Structure):
    """A gap, as the code in C has it."""

    _fields_ = [
        *((name, ctypes.c_long) for name in ("kind", "a", "b")),
        *((name, ctypes.c_double * 3) for name in ("pa", "pb", "n")),
        ("c", ctypes.c_double),
    ]


class _ModelStruct(ctypes.Structure):
    _fields_ = [
        ("m", ctypes.c_void_p),
        *((name, ctypes.c_long) for name in ("n", "gaps", "slots", "tendons", "actuators")),
        *((name, ctypes.c_void_p) for name in ("slot", "gap", *FUNCTIONS)),
    ]


class CompiledModel:
    """Arguments of the C code, and the objects that keep it alive.

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
        self.names, points = _gap_structs(model, gaps)
        self._points = (GapStruct * max(1, len(points)))(*points)
        count = max(4, os.cpu_count() or 1)
        self._data = [mujoco.MjData(model) for _ in range(count)]
        self._work = np.zeros((count, 9 * model.nv))
        self._slots = (_Slot * count)(*(self._slot(i) for i in range(count)))
        functions = [
            ctypes.cast(getattr(self._library, name), ctypes.c_void_p).value for name in FUNCTIONS
        ]
        self._head = _ModelStruct(
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


def _gap_structs(model: Any, gaps: Sequence[TreeGap]) -> tuple[list[str], list[GapStruct]]:
    """Return names and gaps, one by one."""
    bodies: dict[str | None, int] = {element_name(model, "body", i): i for i in range(model.nbody)}
    bodies[None] = 0
    dofs = {element_name(model, "joint", i): int(model.jnt_dofadr[i]) for i in range(model.njnt)}
    names, points = [], []
    three = ctypes.c_double * 3
    for gap in gaps:
        if isinstance(gap, JointLimit):
            for kind, side in enumerate(("lower", "upper")):
                if (bound := getattr(gap, side)) is not None:
                    names.append(f"{gap.joint}.{side}")
                    points.append(GapStruct(kind, dofs[gap.joint], 0, c=bound))
            continue
        names.append(gap.name or gap.body)
        at = three(*np.asarray(gap.point))
        if isinstance(gap, PlaneGap):
            normal = three(*np.asarray(gap.normal))
            beyond = gap.offset + gap.radius
            points.append(GapStruct(2, bodies[gap.body], 0, at, three(), normal, beyond))
        else:
            other = three(*np.asarray(gap.other_point))
            pair = bodies[gap.body], bodies[gap.other]
            points.append(GapStruct(3, *pair, at, other, three(), gap.radius))
    return names, points


# Systems that MuJoCo computes, for features that `Tree` lacks.


class MujocoSystem(MechanicalSystem):
    """A `zivi.MechanicalSystem` computed by MuJoCo, returned by `system`.

    Parameters
    ----------
    model : mujoco.MjModel
        The model; it is copied.
    gaps, e, ctrl, friction
        As for `system`.
    """

    derived = True

    def __init__(
        self,
        model: Any,
        gaps: Sequence[Any] | str | None = None,
        e: GivenRestitutions = 0.0,
        ctrl: ArrayLike | None = None,
        friction: str = "refuse",
    ) -> None:
        mujoco = needed("mujoco", "models of MuJoCo")
        if not isinstance(model, mujoco.MjModel):
            raise TypeError(f"model must be a mujoco.MjModel, got {model!r}")
        one_of("friction", friction, ("refuse", "ignore"))
        refuse_for_system(model)
        if not 1 <= model.nv <= MAX_SIZE:
            raise ValueError(f"model must have from 1 to {MAX_SIZE} coordinates, got {model.nv}")
        self._state = {"model": model, "gaps": gaps, "ctrl": ctrl, "friction": friction}
        own, flags = copy.copy(model), mujoco.mjtDisableBit
        own.opt.disableflags |= int(flags.mjDSBL_CONTACT) | int(flags.mjDSBL_CONSTRAINT)
        found = read_gaps(model, gaps, friction)
        for gap in (it for it in found if isinstance(it, PlaneGap) and is_rough(it)):
            raise NotImplementedError(
                f"zivi.interop.mujoco.system does not support friction of gaps: {gap.name!r}; use "
                "zivi.Tree"
            )
        self._compiled = CompiledModel(own, found, read_ctrl(model, ctrl))
        self._native = compile_model({"c": SOURCE}, "c")
        self._gaps = ()
        self._gap_names = distinct_names("gaps", self._compiled.names)
        if len(self._gap_names) > MAX_SIZE:
            raise ValueError(f"gaps must be at most {MAX_SIZE}, got {len(self._gap_names)}")
        self._n = int(model.nv)
        self._coordinates = tuple(element_name(model, "joint", i) for i in range(model.njnt))
        self._e = restitutions(e, len(self._gap_names))

    def _new_model(self, n: int) -> Model:
        return Model.of_code(
            Layout(n, self.m), self._native, self._compiled.address, self._compiled
        )

    def __repr__(self) -> str:
        told = f"joints=({', '.join(self._coordinates or ())}), gaps=({', '.join(self._gap_names)})"
        return f"MujocoSystem({told}, e={written(self._e)})"

    def __getstate__(self) -> dict[str, Any]:
        return {**self._state, "e": self._e}

    def __setstate__(self, state: dict[str, Any]) -> None:
        MujocoSystem.__init__(self, **state)


def system(
    model: Any,
    gaps: Sequence[Any] | str | None = None,
    e: GivenRestitutions = 0.0,
    ctrl: ArrayLike | None = None,
    friction: str = "refuse",
) -> MujocoSystem:
    """Return a model of MuJoCo as a system that MuJoCo computes, at every evaluation.

    For what a `zivi.Tree` has not: tendons, fluids, `gravcomp`, nonlinear springs and dampers,
    actuators with other transmissions. A tree needs less time, no MuJoCo and no C compiler.
    Mass and forces are MuJoCo's, contacts and limits are the gaps of zivi: ``solref`` and
    ``solimp`` are not read. Each evaluation works with an ``mjData`` of its own: batches may have
    any number of threads.

    Parameters
    ----------
    model : mujoco.MjModel
        The model; it is copied.
    gaps, e, ctrl
        As for `zivi.Tree.from_mjcf`.
    friction : {"refuse", "ignore"}
        Pairs with friction are rejected, or taken without.

    Returns
    -------
    MujocoSystem
        A `zivi.MechanicalSystem`.

    Raises
    ------
    NotImplementedError
        For free and ball joints, constraints, dry friction, activations, plugins, flexes, mocap
        bodies and callbacks, by name.
    ImportError, RuntimeError
        Without MuJoCo, or without a C compiler.
    """
    return MujocoSystem(model, gaps, e, ctrl, friction)


def scalar_joints(spec: Any) -> Any:
    """Return a model whose free and ball joints are slides and hinges.

    A free joint becomes three slides and three hinges about x, y and z in this order, a ball joint
    three hinges, named ``name.x``, ..., ``name.roll``, ``name.pitch``, ``name.yaw``. At a pitch of
    +-90 degrees the mass matrix is singular.

    Parameters
    ----------
    spec : mujoco.MjSpec
        The model, which is not modified.

    Returns
    -------
    mujoco.MjSpec
        A copy, to be compiled.

    Raises
    ------
    NotImplementedError
        For a free or ball joint with armature, damping, friction or stiffness, by its name.
    """
    mujoco = needed("mujoco", "models of MuJoCo")
    new, kinds = spec.copy(), mujoco.mjtJoint
    for body in list(new.bodies):
        for i, joint in enumerate(list(body.joints)):
            if joint.type not in (kinds.mjJNT_FREE, kinds.mjJNT_BALL):
                continue
            name, at = joint.name or f"{body.name}.joint{i}", np.array(joint.pos)
            _refuse_forces(joint, name)
            free = joint.type == kinds.mjJNT_FREE
            new.delete(joint)
            parts = [(kinds.mjJNT_SLIDE, k) for k in "xyz"] if free else []
            parts += [(kinds.mjJNT_HINGE, k) for k in ("roll", "pitch", "yaw")]
            for k, (kind, part) in enumerate(parts):
                axis = np.eye(3)[k % 3]
                added = body.add_joint(
                    name=f"{name}.{part}", type=kind, axis=axis, pos=at * (not free)
                )
                # nothing of the defaults of other joints
                added.limited = mujoco.mjtLimited.mjLIMITED_FALSE
                added.armature = added.frictionloss = 0.0
                added.stiffness, added.damping = (
                    np.zeros_like(added.stiffness),
                    np.zeros_like(added.damping),
                )
    return new


def _refuse_forces(joint: Any, name: str) -> None:
    """Reject what acts along the axes of a joint that turns with it."""
    for what in ("armature", "damping", "frictionloss", "stiffness"):
        if np.any(getattr(joint, what)):
            raise NotImplementedError(
                f"scalar_joints does not support {what} of free and ball joints: joint {name!r}"
            )
