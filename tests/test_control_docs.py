"""What pages, the README and benchmarks/results/loops.md say of control, computed again."""

import re
from pathlib import Path

import numpy as np
import pytest

import zivi
from inside import (
    last_above,
    paper_chattering as chattering,
    paper_closed_loops as closed_loops,
    paper_rest as rest,
    paper_robustness as robustness,
    track,
)
from page_blocks import blocks

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "benchmarks" / "results" / "loops.md").read_text()
README = (ROOT / "README.md").read_text()
TEXT = " ".join(PAGE.split())
BRANCHES = ("positive", "nearest")


def table(first_column, text=PAGE):
    """Cells of the rows below the header that starts with `first_column`."""
    lines = iter(text.splitlines())
    for line in lines:
        if line.startswith(f"| {first_column} |"):
            break
    next(lines)
    result = []
    for line in lines:
        if not line.startswith("|"):
            return result
        result.append([cell.strip() for cell in line.strip("|").split(" | ")])
    return result


def numbers(cell):
    return [float(number) for number in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", cell)]


def quoted(pattern):
    (found,) = re.findall(pattern, TEXT)
    return float(found) if isinstance(found, str) else [float(number) for number in found]


def snippet(text):
    *_, code = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    return code


def page(name):
    return (ROOT / "docs" / f"{name}.md").read_text()


def names_of(name):
    """What the code of a page leaves behind."""
    names: dict = {}
    for _, code in blocks(name):
        exec(compile(code, name, "exec"), names)
    return names


def test_the_programs_of_the_pages(capsys):
    assert names_of("control")["run"].u[-1] == 9.81 - 19.5  # D = 2 (30 - 17)/(4/3)
    assert "-9.69" in capsys.readouterr().out
    seen = names_of("noise_delay")["seen"]
    assert seen.rest_time < 1.5
    assert abs(seen.d_est[(seen.t > 0.5) & (seen.t < 1.2)].mean() - 1.5) < 0.1
    assert abs(names_of("follow_reference")["run"].error[1500:]).max() < 1e-3


QUOTES = {
    "choose_gains": ("mu1, mu2", "mu1, mu2"),
    "implicit_signs": ("reference", "reference"),
}
"""Pages with rows of the results: first column there and here."""


@pytest.mark.parametrize("name", QUOTES)
def test_rows_on_pages_are_of_the_results(name):
    there, here = QUOTES[name]
    measured = " ".join(" ".join(row) for row in table(there))
    rows = table(here, page(name))
    assert len(rows) >= 3
    for row in rows:
        for figure in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", " ".join(row[1:])):
            assert re.search(rf"(?<![\d.]){re.escape(figure)}(?![\d.])", measured), (row, figure)


def test_shares_at_rest_on_the_page_of_exact_rest():
    measured = {float(row[0]): int(row[1]) for row in table("e")}
    rows = table("e", page("exact_rest"))
    assert len(rows) == 4
    for span, count, paper in rows:
        ends = numbers(span)
        first = 0.0 if "up to" in span else ends[0]
        found = [share for e, share in measured.items() if first <= e <= ends[-1]]
        told = numbers(count.replace(" of 50", ""))
        assert (min(found), max(found)) == (told[0], told[-1])
        assert paper == "50"


def test_the_readmes_snippet_runs(tmp_path, monkeypatch, capsys):
    import matplotlib.pyplot as plt

    code = snippet(README)
    assert sum(bool(line.strip()) for line in code.splitlines()) <= 6
    monkeypatch.chdir(tmp_path)
    names = {"zivi": zivi}
    exec(compile(code, "README.md", "exec"), names)
    plt.close("all")
    assert (tmp_path / "tracking.png").stat().st_size > 1000
    run = names["run"]
    rests, u = re.findall(r"# (\d\.\d+), (-\d\.\d+):", code)[0]
    assert run.rest_time == pytest.approx(float(rests), abs=0.01)
    assert run.u[-1] == pytest.approx(float(u), abs=1e-9)
    still = run.t > run.rest_time
    assert not np.any(run.x[still])
    assert not np.any(run.xdot[still])
    assert len(set(run.u[still])) == 1


def test_branches_on_the_papers_problem():
    nearest, positive = quoted(r"from (\d\.\d+) s on, `positive` from (\d\.\d+) s")
    assert last_above(track("nearest"), 1e-2) == pytest.approx(nearest, abs=5e-3)
    assert last_above(track("positive"), 1e-2) == pytest.approx(positive, abs=5e-3)
    rests = quoted(r"example does, from (\d\.\d+) s, with `nearest` from (\d\.\d+) s;")
    for branch, printed in zip(BRANCHES, rests, strict=True):
        assert track(branch).rest_time == pytest.approx(printed, abs=6e-3)


def test_gains(monkeypatch):
    rows = table("mu1, mu2")
    assert len(rows) == 6
    for gains, *cells in rows:
        monkeypatch.setattr(closed_loops, "MU1", numbers(gains)[0])
        monkeypatch.setattr(closed_loops, "MU2", numbers(gains)[1])
        runs = [track(branch) for branch in BRANCHES]
        for run, cell in zip(runs, cells[:2], strict=True):
            assert last_above(run, 1e-2) == pytest.approx(float(cell), abs=2e-3)
        low, high = numbers(cells[2])
        u = runs[0].u
        assert (u.min(), u.max()) == pytest.approx((low, high), abs=0.06)
        kappa, r_ref = 0.5, 0.5
        bound = (1 + kappa) * (sum(numbers(gains)) + 19.81 / r_ref) + 9.81
        assert np.abs(u).max() <= bound


def test_how_much_unknown_force_is_held():
    held, lost = quoted(r"With (\d+) m/s\^2 that the model lacks .*? with (\d+) it loses it")
    for extra, held_on in ((held, True), (lost, False)):
        run = track(force=closed_loops.FORCE + extra, t_end=8.0)
        assert (np.abs(run.error[run.t > 6]).max() < 1e-4) == held_on


def test_the_error_in_the_air():
    error = quoted(r"\((\S+) m under 9\.81 at 1e-3 s\)")
    assert error == pytest.approx(9.81 * 1e-3**2 / 2, rel=0.01)
    up = (3.0, 10.0)
    run = track(start=up, start_ref=up, force_ref=-9.81, t_end=0.9)
    assert np.abs(run.error[run.t > 0.3]).max() == pytest.approx(error, rel=0.01)


def test_exact_rest():
    measured = rest.measure_rest()
    rows = table("e")
    assert len(rows) == len(measured)
    for (e, sampled, paper, distance, speed), row in zip(rows, measured, strict=True):
        assert row.e == pytest.approx(float(e), abs=5e-4)
        # on the edge the last digits decide whether a start ends in the cycle
        assert row.sampled == pytest.approx(int(sampled), abs=3)
        assert row.paper == int(paper)
        assert row.distance == pytest.approx(float(distance), rel=0.1)
        assert row.speed == pytest.approx(float(speed), rel=0.1)


def test_the_regulator():
    ratio = quoted(r"`e sqrt\(D/U\)` = (\S+) from")
    assert ratio == pytest.approx(1 / 3 * (1 / 5) ** 0.5, abs=5e-4)
    settle = quoted(r"= (\d\.\d+)\\ \\mathrm\{s\} ``` with `t_c`")
    assert settle == pytest.approx(1.7727623, abs=5e-5)
    found = quoted(
        r"rests exactly, at (\S+), (\S+), (\S+) s in the paper's loop and (\S+), (\S+), (\S+) s in"
        r" the sampled one.*with a landing at (\S+), (\S+), (\S+) s and (\S+), (\S+), (\S+) s\."
    )
    measured = [
        closed_loops.regulate(h, sampled=sampled, landing=landing).rest_time
        for landing in (False, True)
        for sampled in (False, True)
        for h in (1e-2, 1e-3, 1e-4)
    ]
    assert measured == pytest.approx(found, abs=6e-4)


def test_the_starts_that_rest_without_a_landing():
    rng = np.random.default_rng(3)
    y0 = np.column_stack([rng.uniform(0, 2, 30), rng.uniform(-4, 4, 30)])
    rows = re.findall(r"^\| 30, (\d+) \|(( \d+ \|){6})$", PAGE, re.MULTILINE)
    assert [mu2 for mu2, *_ in rows] == ["17", "25"]
    for mu2, counts, _ in rows:
        for e, count in zip((0.8, 0.9, 0.92, 0.96, 0.98, 0.99), counts.split("|"), strict=False):
            if e not in (0.8, 0.96):  # the others take as long
                continue
            regulator = zivi.TwistingRegulator(30, int(mu2), h=1e-3, e=e, landing=False)
            plant = zivi.ImpactSystem(-9.81, e=e)
            batch = zivi.simulate_closed_loop_batch(plant, regulator, (0, 20), y0)
            # on the edge the last digits decide
            assert np.count_nonzero(batch.rest_time < 19.9) == pytest.approx(int(count), abs=4)


def advanced(h, e_ref, t_end=20.0):
    """A tracker's reference under the force of 1 + 0.3 sin 3t: its samples, and that force."""
    tracker = zivi.TwistingTracker(30, 17, h=h, kappa=0.5, e_ref=e_ref)
    tracker.reset(1.0, 0.9)
    x, v, force = [1.0], [0.9], []
    for k in range(round(t_end / h)):
        force.append(-2.7 * np.sin(3 * k * h))
        tracker.step(x[-1], v[-1], -9.81, force[-1])
        x.append(tracker.x_ref)
        v.append(tracker.xdot_ref)
    return np.array(x), np.array(v), np.array(force)


def test_a_reference_given_as_a_force_drifts_as_documented():
    """By kicks of at most (1 - e_r) h |F_r|, all outward, whose sum is the whole of the drift."""
    small, large = quoted(r"then (\S+) m off with `h` = 1e-3 and (\S+) m with 1e-2, while")
    for h, drift in ((1e-3, small), (1e-2, large)):
        x, v, force = advanced(h, 1 / 3)
        off = x[-1] - 1 - 0.3 * np.sin(60.0)
        assert off == pytest.approx(drift, rel=5e-3)
        kicks = np.diff(v) - h * force
        changes = np.abs(kicks) > 1e-9
        share = kicks[changes] / ((1 - 1 / 3) * h * np.abs(force[changes]))
        assert len(share) == quoted(r"has (\d+) changes in 20 s")
        assert np.all((share >= 0) & (share <= 1))
        assert share.mean() == pytest.approx(0.5, abs=0.15)
        left = 20.0 - h * np.arange(1, len(x))
        assert off == pytest.approx(np.sum(kicks * left), rel=3e-3)
    x, _, _ = advanced(1e-3, 1.0)
    elastic = quoted(r"no kicks \((\S+) m off")
    assert x[-1] - 1 - 0.3 * np.sin(60.0) == pytest.approx(elastic, rel=0.05)


def test_a_wrong_restitution_of_the_reference():
    small, middle, large, right = quoted(
        r"to (\S+) mm for `e_ref` = 0\.32, (\S+) mm for 0\.4 and (\S+) mm for 0\.5, and (\S+) mm"
    )
    up = (3.0, 10.0)
    for e_ref, millimetres in ((0.32, small), (0.4, middle), (0.5, large), (1 / 3, right)):
        run = track(start=up, start_ref=up, force_ref=-9.81, e_ref=e_ref, t_end=2.6)
        (impact,) = run.t[1:][np.diff(run.xdot_ref) > 1]
        after = (run.t > impact + 0.05) & (run.t < impact + 0.3)
        assert 1e3 * np.abs(run.error[after]).max() == pytest.approx(millimetres, rel=0.15)
    for e_ref in (0.2, 0.3, 0.4, 0.5):
        run = track(start=up, start_ref=up, force_ref=-9.81, e_ref=e_ref, t_end=0.9)
        assert np.abs(run.error[run.t > 0.3]).max() == pytest.approx(4.9e-6, rel=0.01)
        assert np.all(np.abs(run.signs[run.t > 0.3, 5]) == 1)


def test_explicit_and_implicit():
    measured = chattering.measure_chattering()
    rows = table("reference")
    assert 3 * len(rows) == len(measured)
    for k, (where, h, *cells) in enumerate(rows):
        for j, row in enumerate(measured[3 * k : 3 * k + 3]):
            assert where == row.where + (", +1.5" if row.force_error else "")
            assert row.h == float(h)
            u, error = numbers(cells[j]), numbers(cells[3 + j])
            for found, printed in zip((row.u_range, row.u_variation), u, strict=True):
                assert close(found, printed, 1e-2)
            for found, printed in zip((row.error_range, row.error_mean), error, strict=True):
                assert close(found, printed, 1e-7 * row.h / 1e-3)


def close(found, printed, rounding):
    """Within 6 %, the printed digits; far below what matters both may be any rounding."""
    return abs(found - printed) <= 0.06 * abs(printed) or max(abs(found), abs(printed)) < rounding


def test_disturbances():
    rows = table("disturbance")
    measured = robustness.measure_robustness()
    assert 2 * len(rows) == len(measured)
    for k, (name, *cells) in enumerate(rows):
        for j, row in enumerate(measured[2 * k : 2 * k + 2]):
            assert row.disturbance == name
            at_rest, reached, error, speed = numbers(cells[2 * j])
            low, high = (float(end) for end in cells[2 * j + 1].split(" .. "))
            assert row.reached == pytest.approx(reached, abs=6e-3)
            # with another compiler a run may end in the cycle instead of at rest
            assert row.at_rest == pytest.approx(at_rest, abs=3)
            if 0 < row.at_rest != at_rest:
                continue
            assert row.error == pytest.approx(error, rel=0.3)
            assert row.speed == pytest.approx(speed, rel=0.3)
            assert (row.u_low, row.u_high) == pytest.approx(
                (low, high), abs=0.1 * (high - low) + 0.06
            )


def test_the_component():
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, kappa=0.5)
    before = tracker.state
    with pytest.raises(ValueError, match="depth"):
        tracker.step(-0.2, 0.0, -9.81, -19.81)
    assert tracker.state == before
    tracker.step(-0.05, 0.0, -9.81, -19.81)
    assert tracker.status is zivi.TickStatus.CLAMPED
    for name in re.findall(r"`(reset|copy|state|signs|status|x_ref|xdot_ref)\b", page("control")):
        assert hasattr(tracker, name)
    run = track()
    assert run.signs[-2, 0] == 1.0
