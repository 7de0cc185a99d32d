"""What the lab says and shows beside its plots: presets, links, sentences, the motion."""

import dataclasses
import re
import xml.etree.ElementTree

import numpy as np
import pytest

import zivi
from inside import (
    A_SECOND,
    PRESETS,
    Ball,
    Belt,
    Regulator,
    Tracker,
    describe_signs,
    end_notices,
    film,
    preset_name,
    query,
    read_query,
    simulate_settings,
)

EVERY = [(kind, name) for kind, presets in PRESETS.items() for name in presets]


def of(kind, name):
    return simulate_settings(PRESETS[kind][name])


@pytest.mark.parametrize(("kind", "name"), EVERY, ids=lambda it: getattr(it, "__name__", it))
def test_every_preset_runs_to_its_end(kind, name):
    runs = of(kind, name)
    assert all(run.success for run in runs.values())
    assert describe_signs(runs)


@pytest.mark.parametrize("kind", PRESETS)
def test_there_are_the_presets_that_were_promised(kind):
    wanted = {"first look", "chattering"} | ({"the paper"} if kind is not Belt else set())
    wanted |= {"noise"} if kind in (Regulator, Tracker) else set()
    assert wanted <= set(PRESETS[kind])


@pytest.mark.parametrize(("kind", "name"), EVERY, ids=lambda it: getattr(it, "__name__", it))
def test_a_preset_is_called_by_its_name(kind, name):
    assert preset_name(PRESETS[kind][name]) == name
    assert preset_name(dataclasses.replace(kind(), x0=1.2345)) == "first look"


def test_a_slider_at_an_end_of_its_range_is_told_unless_the_preset_is_there():
    assert end_notices(Regulator(), Regulator()) == []
    told = end_notices(Regulator(noise_x=0.1, h=1e-4, landing=False), Regulator())
    assert [it.partition(";")[0] for it in told] == [
        "h, sampling period (s): 0.0001 is an end of its range, 0.0001 to 0.05",
        "noise of x (m): 0.1 is an end of its range, 0 to 0.1",
    ]


def test_chattering_is_that_of_explicit_signs():
    runs = of(Tracker, "chattering")
    late = {name: np.abs(np.diff(run.u[run.t > 1.35])).sum() for name, run in runs.items()}
    assert late["explicit"] > 100 * late["implicit"]
    ball = of(Ball, "chattering")
    assert ball["implicit"].rest_time is not None
    assert ball["explicit"].rest_time is None


def test_landing_is_exact_rest_where_the_control_alternated_for_ever():
    landed, before = (
        of(Tracker, name)["implicit"] for name in ("exact rest at e = 0.8", "e = 0.8, no landing")
    )
    late = landed.t > 3.0
    assert landed.rest_time < 3.0
    assert np.all(landed.error[late] == 0.0)
    assert len(set(landed.u[late])) == 1
    assert before.rest_time is None
    assert np.ptp(before.u[late]) > 15.0
    assert np.abs(np.diff(before.u[late])).sum() > 1e4


def test_positions_alone_under_an_unknown_sine_are_enough_to_land():
    run = of(Tracker, "sine, positions alone")["implicit"]
    assert run.config["observer"]["position_only"] is True
    assert run.rest_time < 3.0


def test_the_sentence_has_the_numbers_of_the_runs():
    runs = simulate_settings(Ball())
    said = describe_signs(runs)
    rests = [f"{runs[name].rest_time:.4g} s" for name in ("implicit", "high_order")]
    assert re.findall(r"from (\S+ s)", said) == rests
    assert "not at rest within 4 s with explicit ones" in said

    runs = of(Tracker, "chattering")
    t = runs["implicit"].t
    late = t >= 0.5 * t[-1]  # neither comes to rest
    variations = [np.abs(np.diff(runs[name].u[late])).sum() for name in ("explicit", "implicit")]
    said = describe_signs(runs)
    assert f"at most {np.abs(runs['implicit'].error[late]).max():.2g} m off" in said
    assert f"changes {variations[0] / variations[1]:.3g} times as much" in said
    assert "From 0.75 to 1.5 s" in said
    still = simulate_settings(Regulator(x0=0.0))
    assert "neither control changes" in describe_signs(still)


def test_the_film_shows_the_motion():
    runs = simulate_settings(Ball(t_end=2.0))
    drawn = xml.etree.ElementTree.fromstring(film(runs))
    circles = drawn.findall("circle")
    assert len(circles) == len(runs) == 3
    top = max(run.x.max() for run in runs.values())
    for circle, run in zip(circles, runs.values(), strict=True):
        (moved,) = circle
        assert moved.get("dur") == "2s"
        heights = np.array([float(y) for y in moved.get("values").split(";")])
        assert len(heights) == 2 * A_SECOND
        x = run(np.linspace(0.0, 2.0, len(heights)))[0]
        across = (heights.max() - heights) / np.ptp(heights)
        assert np.abs(across * x.max() - x).max() < 0.01 * top
    with_reference = xml.etree.ElementTree.fromstring(film(simulate_settings(Tracker())))
    assert [text.text for text in with_reference.findall("text")] == [
        "implicit signs",
        "explicit signs",
        "reference",
    ]


@pytest.mark.parametrize(
    ("asked", "settings"),
    [
        ({}, Ball()),
        ({"tab": "Nothing", "e": "0.7"}, Ball(e=0.7)),
        ({"tab": "Ball", "e": "1.5", "gravity": "-99"}, Ball(e=1.0, gravity=-5.0)),
        ({"tab": "Ball", "e": "nan", "x0": "1e400", "mu1": "3"}, Ball()),
        ({"tab": "Tracker", "h": "0.0011", "branch": "nearest"}, Tracker(h=1e-3, branch="nearest")),
        ({"tab": "Regulator", "landing": "False", "observer": "7"}, Regulator(landing=False)),
        ({"tab": "Tracker", "branch": "best", "delay": "2.4"}, Tracker(delay=2)),
    ],
)
def test_a_link_asks_for_settings_that_are_possible(asked, settings):
    assert read_query(asked) == settings


def test_a_link_names_what_is_no_default():
    assert query(Regulator()) == "?tab=Regulator"
    assert query(Tracker(h=1e-3, branch="nearest")) == "?tab=Tracker&h=0.001&branch=nearest"
    assert query(Tracker(landing=False)) == "?tab=Tracker&landing=False"


@pytest.mark.parametrize("columns", [1, 2, 3])
@pytest.mark.parametrize("given", [Ball(), Tracker()], ids=["five", "six"])
def test_panels_do_not_overlap(columns, given):
    pytest.importorskip("plotly")
    from inside import draw_runs

    layout = draw_runs(simulate_settings(given), columns=columns).layout
    count = 5 if isinstance(given, Ball) else 6
    boxes = [
        (*layout[f"xaxis{k}"].domain, *layout[f"yaxis{k}"].domain) for k in range(1, count + 1)
    ]
    rows = -(-count // columns)
    inside = layout.height - layout.margin.t - layout.margin.b
    for k, (left, right, low, high) in enumerate(boxes):
        assert 0 <= left < right <= 1 + 1e-12
        assert 0 <= low < high <= 1
        assert (high - low) * inside > 200
        for other in boxes[:k]:
            apart = other[1] < left or right < other[0] or other[3] < low or high < other[2]
            assert apart
    assert inside < 300 * rows
    assert zivi.plot.BLUE in {
        trace.line.color for trace in draw_runs(simulate_settings(given)).data
    }
