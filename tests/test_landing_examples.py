"""The examples of exact rest and of the observed juggler, and what the page says of them."""

import re

import numpy as np
import pytest

from example_scripts import example, shown

REST, JUGGLER = (shown(name) for name in ("exact_rest", "observed_juggler"))


def test_the_landing_rests_where_the_papers_law_chatters(tmp_path):
    rest = example("exact_rest")
    before, after = (rest.run(law) for law in rest.LAWS)
    assert before.rest_time is None
    assert rest.variation(before) > 1e3
    late = after.t > after.rest_time + 0.1
    assert np.all(after.x[late] == 0)
    assert rest.variation(after) == 0
    ((height, time),) = re.findall(r"up to (\S+) mm high.*exactly from (\S+) s", REST)
    assert 1e3 * before.x[before.t > 2].max() == pytest.approx(float(height), abs=0.06)
    assert after.rest_time == pytest.approx(float(time), abs=6e-4)
    # other noise, the same end
    assert rest.run("contact-establishing law", seed=7).rest_time is not None
    rest.main(str(tmp_path / "rest.png"))
    assert (tmp_path / "rest.png").stat().st_size > 1000


def test_the_juggler_holds_the_orbit_from_positions(tmp_path):
    juggler = example("observed_juggler")
    # the reference is periodic: an impact each period, always as fast
    impacts = juggler.orbit().impacts
    np.testing.assert_allclose(impacts["xdot_after"], juggler.LAUNCH, rtol=1e-6)
    np.testing.assert_allclose(np.diff(impacts["t"]), juggler.PERIOD, rtol=1e-6)
    assert len(impacts) >= 19
    run = juggler.juggle()
    rms, largest = juggler.errors(run)
    ((most, mean),) = re.findall(r"within\s+(\S+) mm of the orbit \((\S+) mm rms\)", JUGGLER)
    assert 1e3 * largest == pytest.approx(float(most), rel=0.1)
    assert 1e3 * rms == pytest.approx(float(mean), rel=0.05)
    late = run.t > juggler.SPAN[0] + 2
    unknown = juggler.PUSH * np.cos(juggler.RATE * run.t)
    assert np.sqrt(np.mean((run.d_est - unknown)[late] ** 2)) < 0.4
    juggler.main(str(tmp_path / "juggler.png"))
    assert (tmp_path / "juggler.png").stat().st_size > 1000
