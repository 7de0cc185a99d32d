"""Impacts that are aimed at: heights and speeds that are asked for, from parabolas of our own."""

import functools
import pickle

import numpy as np
import pytest

import zivi
from inside import control_gap_tracker as gap_tracker

G = 9.81


def juggled(e=0.6, ball=0.2):
    return zivi.MechanicalSystem(
        mass=np.diag([ball, 1.0]),
        force=[-ball * G, -G],
        gaps=[zivi.LinearGap([1, -1], name="racket")],
        e=e,
        coordinates=["ball", "paddle"],
        inputs=[[0.0], [1.0]],
    )


def heights(run, since):
    """The apexes above the height 0, of the parabolas that begin at impacts."""
    times = run.resolved_impacts["t"]
    states = np.array([run(t) for t in times[times > since]])
    return states[:, 0, 0] + states[:, 1, 0] ** 2 / (2 * G)


def juggle(believed=None, end=5.0, apex=0.5, **more):
    settings = {name: more.pop(name) for name in ("learn", "delay_told") if name in more}
    told = {"delay": settings.pop("delay_told", 0)} | settings
    ctl = zivi.Striker(believed or juggled(), gap="racket", body="ball", apex=apex, **told)
    start = ([0.4, 0.0], [0.5, 0.0])
    return zivi.simulate_closed_loop(
        juggled(), ctl, (0, end), start, method=zivi.RKPeriod(), **more
    )


def test_a_ball_is_thrown_as_high_as_is_asked():
    found = heights(juggle(), 3.0)
    assert len(found) >= 2
    np.testing.assert_allclose(found, 0.5, atol=5e-6)


def test_wrong_masses_and_restitutions_are_learnt():
    believed = juggled(e=0.7, ball=0.25)
    np.testing.assert_allclose(heights(juggle(believed, end=7.0), 5.0), 0.5, atol=1e-4)
    ignored = heights(juggle(believed, end=7.0, learn=False), 5.0)
    assert np.abs(ignored - 0.5).min() > 0.02


@pytest.mark.parametrize(("e", "ball"), [(0.6, 0.24), (0.6, 0.16), (0.7, 0.2), (0.5, 0.2)])
def test_what_is_not_learnt_ends_at_the_fixed_point_of_the_throws(e, ball):
    """v+ = v- + r (V - v-), r = gamma/gamma believed, and v- = -v+ in the next flight."""
    believed = juggled(e=e, ball=ball)
    r = (1.6 / 1.2) / ((1 + e) / (1 + ball))
    expected = 0.5 * (r / (2 - r)) ** 2
    found = heights(juggle(believed, end=12.0, learn=False), 8.0)
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_a_height_that_changes_in_flight_is_reached_at_the_next_throw():
    run = juggle(apex=lambda k: 0.5 if k < 3 else 0.8)
    times = run.resolved_impacts["t"]
    found = heights(run, times[1])
    np.testing.assert_allclose(found[0], 0.5, atol=1e-3)
    np.testing.assert_allclose(found[1:], 0.8, atol=1e-3)


def test_a_late_racket_that_knows_it_hits_as_well():
    run = juggle(delay=5, delay_told=5)
    np.testing.assert_allclose(heights(run, 3.0), 0.5, atol=5e-6)


@pytest.mark.parametrize("late", [0, 5])
def test_a_push_on_the_racket_is_learnt_from_its_acceleration(late):
    told = {"delay": late, "delay_told": late, "disturbance": [0.0, 2.0]}
    np.testing.assert_allclose(heights(juggle(**told), 3.0), 0.5, atol=5e-6)
    ignored = heights(juggle(learn=False, **told), 3.0)
    assert np.abs(ignored - 0.5).min() > 5e-4


@pytest.mark.parametrize("late", [1, 5, 20])
def test_a_delay_that_nobody_told_is_learnt_as_a_push(late):
    """The control is a + d h a' late: what the racket lacks is what the delay takes."""
    run = juggle(delay=late, end=8.0)
    np.testing.assert_allclose(heights(run, 5.0), 0.5, atol=1e-5)
    assert len(heights(run, 5.0)) >= 4


def test_an_impact_that_is_predicted_wrongly_is_learnt_when_it_is_measured():
    run = juggle(juggled(e=0.7), end=7.0, delay=5, delay_told=5)
    np.testing.assert_allclose(heights(run, 5.0), 0.5, atol=1e-4)


def test_the_noise_of_a_speed_is_averaged_over_a_flight(monkeypatch):
    def off():
        runs = [juggle(noise=(1e-6, 1e-2), seed=seed) for seed in range(4)]
        return np.sqrt(np.mean(np.concatenate([heights(run, 2.0) - 0.5 for run in runs]) ** 2))

    averaged = off()
    assert averaged < 5e-3
    monkeypatch.setattr(gap_tracker, "MEAN", 1)
    monkeypatch.setattr(gap_tracker, "LEAST", gap_tracker.LEARNT)
    assert averaged < 0.75 * off()


@pytest.mark.parametrize("learn", [True, False])
def test_a_hammer_hits_a_wall_with_the_speed_that_is_asked(learn):
    hammer = zivi.MechanicalSystem(
        mass=2.0, force=[0.0], gaps=[zivi.LinearGap([1], name="wall")], e=0.3
    )
    wanted = [1.0, 0.5, 2.0, 1.5]
    ctl = zivi.Striker(hammer, gap="wall", speed=lambda k: wanted[k % 4], interval=0.3, learn=learn)
    run = zivi.simulate_closed_loop(hammer, ctl, (0, 1.3), ([0.1], [0.0]))
    blows = run.resolved_impacts
    np.testing.assert_allclose(-blows["speed_before"], wanted, atol=1e-5)
    np.testing.assert_allclose(np.diff(blows["t"]), 0.3, atol=2e-3)


@functools.cache
def compiled():
    """The same in formulas, which are compiled."""
    return zivi.symbolic.system(
        "ball paddle",
        T="(m*balldot**2 + paddledot**2)/2",
        V="9.81*(m*ball + paddle)",
        gaps={"racket": "ball - paddle"},
        parameters={"m": 0.2},
        e=0.6,
        inputs={"force": [0, 1]},
    )


class Stepped:
    """A controller of our own that asks a striker sample by sample."""

    def __init__(self, striker):
        self.striker, self.h, self.delay = striker, striker.h, striker.delay

    @property
    def status(self):
        return self.striker.status

    def step(self, t, q, qdot):
        return self.striker.step(t, q, qdot)


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"apex": lambda k: 0.4 + 0.1 * (k % 2)},
        {"delay": 4, "learn": False},
        {"u_limits": [(-30.0, 30.0)]},
        {"noise": (1e-6, 1e-2)},
    ],
    ids=["constant", "function", "late", "limits", "noise"],
)
def test_a_loop_that_runs_natively_is_the_one_that_asks_sample_by_sample(more):
    noise = more.pop("noise", (0.0, 0.0))
    settings = {"gap": "racket", "body": "ball", "apex": 0.5} | more
    ctl = zivi.Striker(compiled().replace(m=0.25), **settings)
    asked = {"method": zivi.RKPeriod(), "delay": ctl.delay, "noise": noise, "seed": 2}
    start = ([0.4, 0.0], [0.5, 0.0])
    run = zivi.simulate_closed_loop(compiled(), ctl, (0, 1.5), start, **asked)
    assert ctl.strokes == 0  # a copy ran
    other = ctl.copy()
    if noise != (0.0, 0.0):
        other.sensed(noise, (0.0, 0.0))
    again = zivi.simulate_closed_loop(compiled(), Stepped(other), (0, 1.5), start, **asked)
    assert len(run.impacts) >= 2
    for name in ("q", "qdot", "u", "tick_status"):
        assert np.array_equal(getattr(run, name), getattr(again, name)), name


def test_a_batch_of_loops_is_the_single_ones():
    ctl = zivi.Striker(compiled(), gap="racket", body="ball", apex=0.5)
    masses, starts = np.array([0.1, 0.2, 0.4]), ([0.4, 0.0], [0.5, 0.0])
    asked = {"method": zivi.RKPeriod(), "noise": (1e-6, 1e-3)}
    many = zivi.simulate_closed_loop_batch(
        compiled(), ctl, (0, 1.2), starts, parameters={"m": masses}, seed=[1, 2, 3], **asked
    )
    for i, m in enumerate(masses):
        one = zivi.simulate_closed_loop(
            compiled().replace(m=m), ctl, (0, 1.2), starts, seed=1 + i, **asked
        )
        assert np.array_equal(many.q[i], one.q[-1])
        assert np.array_equal(many.u[i], one.u[-1])


def test_a_striker_travels_and_goes_on_alike():
    one = zivi.Striker(juggled(), gap="racket", body="ball", apex=0.5)
    for k in range(50):
        one.step(k * 1e-3, [0.4, 0.0], [0.5 - k * 9.81e-3, 0.0])
    others = [one.copy(), pickle.loads(pickle.dumps(one))]
    u = one.step(0.05, [0.4, 0.0], [0.0, 0.1])
    assert all(np.array_equal(it.step(0.05, [0.4, 0.0], [0.0, 0.1]), u) for it in others)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"gap": "floor"}, "gap"),
        ({"apex": None}, "either"),
        ({"apex": 0.0}, "apex must be finite and > 0"),
        ({"speed": 1.0}, "either"),
        ({"interval": 0.0}, "interval"),
        ({"delay": -1}, "delay"),
    ],
)
def test_settings_out_of_range_are_named(settings, message):
    with pytest.raises(ValueError, match=message):
        zivi.Striker(juggled(), **{"gap": "racket", "body": "ball", "apex": 0.5} | settings)


def test_a_body_that_is_no_coordinate_is_named():
    wrong = zivi.Striker(juggled(), gap="racket", body="dog", apex=0.5)
    with pytest.raises(ValueError, match="coordinates"):
        wrong.step(0.0, [1, 0], [0, 0])
