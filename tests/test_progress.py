"""The progress bar: long runs on a terminal only, unless asked for."""

import contextlib
import io
import sys

import pytest

import zivi
import zivi.base.progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def at_once(monkeypatch):
    """Bars appear without delay."""
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(zivi.base.progress, "DELAY", 0.0)


@contextlib.contextmanager
def terminal():
    """Standard error as a terminal that remembers what was written."""
    with contextlib.redirect_stderr(Terminal()) as screen:
        yield screen


def run(steps=400_000, force=-9.81, **more):
    system = zivi.ImpactSystem(force, e=0.5)
    return zivi.simulate(system, (0, 4), (1, 0), method=zivi.ThetaGamma(h=4 / steps), **more)


@pytest.mark.usefixtures("at_once")
def test_nothing_is_printed_when_stderr_is_not_a_terminal(capfd):
    run()
    assert capfd.readouterr() == ("", "")


@pytest.mark.usefixtures("at_once")
@pytest.mark.parametrize("wanted", [None, True])
def test_a_bar_is_shown_on_a_terminal(wanted, capfd):
    with terminal() as screen:
        sol = run(progress=wanted)
    assert sol.success
    assert "simulate" in screen.getvalue()
    assert capfd.readouterr().out == ""


@pytest.mark.usefixtures("at_once")
def test_a_bar_can_be_refused_on_a_terminal():
    with terminal() as screen:
        run(progress=False)
    assert screen.getvalue() == ""


def test_a_short_run_shows_none():
    assert zivi.base.progress.DELAY == 1.0
    with terminal() as screen:
        run(progress=True)
    assert screen.getvalue() == ""


@pytest.mark.usefixtures("at_once")
def test_the_result_does_not_depend_on_it():
    plain, shown = run(50_000, progress=False), run(50_000, progress=True)
    assert (plain.transformed.s == shown.transformed.s).all()
    assert plain.nfev == shown.nfev


@pytest.mark.usefixtures("at_once")
def test_the_bar_is_taken_down_when_the_force_raises():
    def force(t, x, xdot):
        if t > 2:
            raise ArithmeticError
        return -9.81

    with terminal() as screen, pytest.raises(ArithmeticError):
        run(20_000, force)
    # the cursor that was hidden for the bar is shown again
    text = screen.getvalue()
    assert text.count("\x1b[?25l") == text.count("\x1b[?25h") == 1


def test_reports_count_up_to_all_steps(monkeypatch):
    seen = []

    class Recorder(zivi.base.progress.ProgressBar):
        @property
        def report(self):
            return lambda done, of: seen.append((done, of))

    monkeypatch.setattr(sys.modules["zivi.simulation.run"], "ProgressBar", Recorder)
    run(300_000, progress=True)
    done = [k for k, _ in seen]
    assert done == sorted(set(done))
    assert seen[-1] == (300_000, 300_000)
    assert {of for _, of in seen} == {300_000}


def closed():
    stream = io.StringIO()
    stream.close()
    return stream


@pytest.mark.usefixtures("at_once")
@pytest.mark.parametrize("wanted", [None, True])
@pytest.mark.parametrize("stream", [lambda: None, closed], ids=["none", "closed"])
def test_a_service_without_standard_error(stream, wanted, monkeypatch):
    monkeypatch.setattr(sys, "stderr", stream())
    assert run(progress=wanted).success
