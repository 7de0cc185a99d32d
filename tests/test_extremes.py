"""Overflow is a status with finite samples; what cannot be used is refused by name."""

from operator import attrgetter

import numpy as np
import pytest

import zivi
import zivi.base.progress

BALL = zivi.ImpactSystem(-9.81, e=0.5)
METHOD = zivi.ThetaGamma(h=0.1)


def run(force, e, span, state, method):
    return zivi.simulate(zivi.ImpactSystem(force, e=e), span, state, method)


OVERFLOW = {
    "h^2 f": (1e10, 1.0, (0, 3e150), (0.5, 0), zivi.ThetaGamma(1e150)),
    "h f": (1.7e308, 1.0, (0, 3e150), (0.5, 0), zivi.ThetaGamma(1e150)),
    "velocity on a pattern": (
        lambda t, x, xdot: -1e150 + x,
        1e-3,
        (0, 5e299),
        (0, -1e150),
        zivi.ThetaGamma(1e300, 1e-300, 1e-300),
    ),
}


@pytest.mark.parametrize("case", OVERFLOW.values(), ids=OVERFLOW)
def test_overflow_is_a_status(case):
    sol = run(*case)
    assert sol.status in (zivi.Status.STATE_NOT_FINITE, zivi.Status.FORCE_NOT_CONVERGED)
    assert not sol.success
    for name in ("x", "xdot", "transformed.s", "transformed.v", "residual"):
        assert np.all(np.isfinite(attrgetter(name)(sol)))


REFUSED = {
    "xdot0 with e tiny": ("xdot0", lambda: run(-1.0, 1e-10, (0, 1), (1, 1e300), METHOD)),
    "h": ("h", lambda: zivi.ThetaGamma(h=10**400)),
    "force": ("force", lambda: zivi.ImpactSystem(10**400, e=0.5)),
    "t_span": ("t_span", lambda: zivi.simulate(BALL, (0, 10**400), (1, 0), METHOD)),
    "t_span as text": ("t_span", lambda: zivi.simulate(BALL, ("0", "1"), (1, 0), METHOD)),
    "y0": ("y0", lambda: zivi.simulate(BALL, (0, 1), (10**400, 0), METHOD)),
    "method class": ("method", lambda: zivi.simulate(BALL, (0, 1), (1, 0), zivi.ThetaGamma)),
    "t_eval": ("t_eval", lambda: zivi.simulate(BALL, (0, 1), (1, 0), METHOD, t_eval="ab")),
    "time asked": ("t", lambda: zivi.simulate(BALL, (0, 1), (1, 0), METHOD)("x")),
    "e": ("e", lambda: zivi.lift(1, 1, e="a")),
    "x": ("x", lambda: zivi.lift("a", 1, e=0.5)),
    "xdot": ("xdot", lambda: zivi.lift(1, np.nan, e=0.5)),
    "plastic lift": ("e", lambda: zivi.lift(1, 1, e=0)),
}


@pytest.mark.parametrize(("name", "call"), REFUSED.values(), ids=REFUSED)
def test_the_argument_is_named(name, call):
    with pytest.raises((ValueError, TypeError), match=rf"(^|\W){name}( |:)"):
        call()


def test_numbers_in_messages_are_short():
    with pytest.raises(ValueError, match="1e-300") as caught:
        zivi.simulate(BALL, (0, 1), (-1e-300, 0), METHOD)
    assert len(str(caught.value)) < 100


def test_the_residual_at_small_e_is_what_is_documented():
    force = zivi.LinearForce(stiffness=1.1, damping=1.1, gravity=1.0)
    for e, bound in [(1e-2, 1e-13), (1e-6, 1e-11)]:
        sol = run(force, e, (0, 20), (1, 1.2), METHOD)
        assert sol.success
        assert sol.residual.max() <= bound


def test_the_explicit_baseline_has_no_residual():
    residual = zivi.simulate(BALL, (0, 1), (1, 0), zivi.ExplicitEuler(h=0.1)).residual
    assert np.isnan(residual[1:]).all()


def test_progress_asked_for_without_a_terminal_shows_something(capfd, monkeypatch):
    monkeypatch.setattr(zivi.base.progress, "DELAY", 0.0)
    zivi.simulate(BALL, (0, 4), (1, 0), zivi.ThetaGamma(h=1e-5), progress=True)
    assert "simulate" in capfd.readouterr().err
