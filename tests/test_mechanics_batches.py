"""Batches and studies of mechanical systems: states at given times, parameters of one model."""

import itertools

import numpy as np
import pytest

import zivi
from inside import BATCH_NUMBERS as NUMBERS, base_machine_code as machine_code
from mechanical_models import model

pytestmark = pytest.mark.xdist_group("mechanical models")

PAR = {"m": 1.0, "J": 0.42, "G": 9.81, "hh": 0.5, "b": 1.0, "A": 0.0, "B": 0.0, "om": 1.0}
START = ([1.0, 0.1], [0.0, 0.0])
TIMES = np.linspace(0, 1.5, 31)
METHODS = [zivi.SwitchedRK(), zivi.SwitchedRK(order=5, rtol=1e-9), zivi.MoreauJean(h=1e-2)]


def blocks(*widths):
    block = model("rock", PAR, 0.4)
    return [block.replace(b=width) for width in widths]


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_states_at_given_times_are_those_of_single_runs(method):
    systems = blocks(0.5, 0.8, 1.1)
    batch = zivi.simulate_batch(systems, (0, 1.5), START, method=method, t_eval=TIMES, threads=2)
    assert batch.success.all()
    assert batch.sample_q.shape == batch.sample_qdot.shape == (3, len(TIMES), 2)
    for number, system in enumerate(systems):
        one = zivi.simulate(system, (0, 1.5), START, method, TIMES)
        assert np.array_equal(one.t, batch.sample_t)
        assert np.array_equal(one.q, batch.sample_q[number])
        assert np.array_equal(one.qdot, batch.sample_qdot[number])
    assert batch.config["t_eval"] == TIMES.tolist()
    assert batch.runs is None
    plain = zivi.simulate_batch(systems, (0, 1.5), START, method=method)
    assert np.array_equal(plain.q, batch.q)
    assert plain.sample_q is None
    pytest.importorskip("xarray")
    dataset = batch.to_xarray()
    assert dataset.sample_q.dims == ("run", "time", "coordinate")
    assert float(dataset.sample_q.sel(run=1, coordinate="th").isel(time=0)) == 0.1


def test_samples_of_linear_systems_are_those_of_batches_and_of_dense_output():
    for seed in range(24):
        rng = np.random.default_rng([3, seed])
        n = int(rng.integers(1, 4))
        mass, stiffness = (a @ a.T + np.eye(n) for a in rng.normal(size=(2, n, n)))
        load = zivi.Harmonic(rng.normal(size=n), 2.0)
        wall = zivi.LinearGap(np.eye(n)[0], 0.3)
        parts = (mass, 0.05 * stiffness, stiffness)
        system = zivi.LinearSystem(*parts, excitation=load, gaps=[wall], e=0.6)
        start, times = (rng.random(n), rng.normal(size=n)), np.linspace(0, 10, 57)
        one = zivi.simulate(system, (0, 10), start, t_eval=times)
        batch = zivi.simulate_batch(system, (0, 10), start, t_eval=times)
        q, qdot = zivi.simulate(system, (0, 10), start)(times)
        for same in (q, batch.sample_q[0], one(times)[0]):
            assert np.array_equal(one.q, same)
        for same in (qdot, batch.sample_qdot[0], one(times)[1]):
            assert np.array_equal(one.qdot, same)


def press():
    """A press comes down on a mass at 1 s where the other coordinate is 0."""
    came = zivi.Gap(lambda t, q: 1 - t - q[0] + q[1] ** 2, lambda t, q: [-1.0, 2 * q[1]], rate=-1.0)
    gaps = [zivi.LinearGap([1, 0]), came]
    return zivi.MechanicalSystem(mass=np.eye(2), force=[-9.81, 0], gaps=gaps, e=0.5)


def test_what_a_run_did_not_reach_is_nan():
    starts = [[0.0, 0.0], [0.0, 5.0]]  # the press of the second stays away
    batch = zivi.simulate_batch(press(), (0, 1.5), (starts, [0, 0]), t_eval=TIMES, save="events")
    assert batch.status.tolist() == [zivi.Status.REDUNDANT_CONTACTS, zivi.Status.COMPLETED]
    reached = batch.t[0] >= TIMES
    assert 0 < reached.sum() < len(TIMES)
    assert np.all(np.isfinite(batch.sample_q[0]) == reached[:, None])
    assert batch.sample_q[0, reached, 0] == pytest.approx(0.0, abs=1e-12)
    assert np.all(np.isfinite(batch.sample_q[1]))
    assert len(batch.events) == 2


def test_without_times_a_run_that_ends_early_has_its_end_and_one_at_rest_its_start():
    batch = zivi.simulate_batch(press(), (0, 1.5), ([[0.0, 0.0], [0.0, 5.0]], [0, 0]))
    assert batch.status.tolist() == [zivi.Status.REDUNDANT_CONTACTS, zivi.Status.COMPLETED]
    assert batch.t == pytest.approx([1.0, 1.5], rel=1e-9)
    assert batch.rest_time[0] == 0.0
    mass = zivi.MechanicalSystem(mass=[[1.0]], force=[-9.81], gaps=[zivi.LinearGap([1])], e=0.5)
    rests = zivi.simulate_batch(mass, (0.25, 2.5), ([[0.0], [1.0]], [0.0]))
    assert rests.rest_time == pytest.approx([0.25, 0.25 + 3 * np.sqrt(2 / 9.81)], rel=1e-9)


def test_ends_and_numbers_are_those_of_single_runs_also_of_runs_that_fail():
    eye, gap = np.eye(2), zivi.LinearGap([1, 0])
    chain = zivi.LinearSystem(eye, 0.1 * eye, 40 * eye, excitation=[-9, 0], gaps=[gap], e=0.5)
    bar = zivi.MechanicalSystem(
        mass=eye, force=[-9.81, 0], gaps=[gap, zivi.LinearGap([1, 0.7])], e=[0.5, 0.3]
    )
    rests = []
    for system, method in itertools.product(
        (chain, bar), (zivi.SwitchedRK(), zivi.SwitchedRK(max_steps=3))
    ):
        starts = [[1.0, 0.5], [0.2, 0.0]]
        batch = zivi.simulate_batch(system, (0, 12), (starts, [0, 0]), method=method)
        for i, q in enumerate(starts):
            sol = zivi.simulate(system, (0, 12), (q, [0, 0]), method)
            assert batch.status[i] == sol.status
            # flights and coordinates have gaps that differ by rounding
            assert np.allclose(batch.gaps[i], sol.gaps[-1], rtol=1e-14, atol=0)
            for name in ("t", "q", "qdot", "contacts"):
                assert np.array_equal(getattr(batch, name)[i], getattr(sol, name)[-1]), name
            rest = np.nan if sol.rest_time is None else sol.rest_time
            assert np.array_equal(batch.rest_time[i], rest, equal_nan=True)
            assert batch.n_impacts[i] == sol.impacts["group"].max(initial=0)
            if batch.n_impacts[i]:
                assert batch.last_impact[i] == sol.impacts["t"][-1]
            rests.append(rest)
    assert np.isfinite(rests).any()
    assert np.isnan(rests).any()


@pytest.mark.parametrize("times", [[0.2, 0.1], [-1.0], [[0.1]]])
def test_bad_times_are_named(times):
    with pytest.raises(ValueError, match="t_eval must be"):
        zivi.simulate_batch(blocks(1.0), (0, 1), START, t_eval=times)


def test_no_memory_for_the_samples():
    starts = np.broadcast_to(START[0], (10**6, 2)), START[1]
    with pytest.raises(MemoryError, match="y0 has 1000000 runs"):  # beyond all addresses
        zivi.simulate_batch(blocks(1.0), (0, 1), starts, t_eval=np.broadcast_to(0.5, 10**7))


def rests(b, e=0.4):
    """Compute one point of a study of the width of a block."""
    return zivi.simulate(model("rock", PAR, e).replace(b=b), (0, 1.5), START)


def test_a_study_of_a_parameter_compiles_nothing(monkeypatch):
    widths = [0.5, 0.8, 1.1]
    known = [rests(b) for b in widths]
    monkeypatch.setattr(machine_code, "_compile", None)  # whoever compiles fails
    study = zivi.sweep(rests, {"b": widths}, fixed={"e": 0.4})
    dataset = study.dataset
    assert np.all(dataset["status"] == zivi.StudyStatus.COMPLETED)
    for number, run in enumerate(known):
        point = dataset.isel(b=number)
        assert np.array_equal(point["q"], run.q[-1])
        assert np.array_equal(point["contacts"], run.contacts[-1])
        assert float(point["n_zeno"]) == len(run.zeno)
        assert float(point["n_impacts"]) == run.impacts["group"].max()
    assert dataset["t"].attrs["units"] == "s"
    batch = zivi.simulate_batch(blocks(*widths), (0, 1.5), START)
    assert np.array_equal(batch.q, dataset["q"])
    events = zivi.sweep(lambda b: (rests(b), rests(b).liftoffs), {"b": widths})
    assert np.array_equal(events.dataset["q"], dataset["q"])


def test_numbers_that_are_counted_are_those_of_the_tables():
    """Skipped impacts, several gaps at once, corners and flags; speeds down to a part."""
    rng, eye = np.random.default_rng(24), np.eye(3)
    systems, sums = [], dict.fromkeys(NUMBERS, 0)
    for _ in range(12):
        k, e, rows = rng.uniform(20, 200), rng.choice([0.0, 0.5, 0.8], 4), rng.normal(size=(2, 3))
        opposite = [zivi.LinearGap(sign * eye[0], 0.05) for sign in (1, -1)]
        # two that are hit at once, and two that are not
        twins = [zivi.LinearGap(eye[1], 0.1), zivi.LinearGap(eye[1] + [0, 0, 1e-9], 0.1)]
        gaps = opposite + (twins if len(systems) % 2 else [zivi.LinearGap(n, 0.1) for n in rows])
        drive = zivi.Harmonic(rng.uniform(5, 20, 3), rng.uniform(2, 9))
        springs = k * (2 * eye - np.eye(3, k=1) - np.eye(3, k=-1))
        systems.append(zivi.LinearSystem(eye, 0.5 * eye, springs, excitation=drive, gaps=gaps, e=e))
    bar = [zivi.LinearGap([1, x]) for x in (-1, 0.7)]
    bars = [
        zivi.MechanicalSystem(mass=np.diag([1, 0.3]), force=[-9.81, 0], gaps=bar, e=e)
        for e in (0.3, 0.6)
    ]
    for several, start in ((systems, ([0, 0, 0], [0.1, 0, 0])), (bars, ([1.0, 0.1], [0.0, 0.0]))):
        for slowest in (1e-3, 0.2, 1.0):
            alone, tables = (
                zivi.simulate_batch(several, (0, 6), start, save=save, slowest=slowest)
                for save in ("final", "events")
            )
            assert alone.config | {"save": "events"} == tables.config
            for name in (*NUMBERS, "t", "q", "qdot", "gaps", "contacts"):
                one, other = getattr(alone, name), getattr(tables, name)
                assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f"), name
            flagged = np.count_nonzero(alone.n_flags)
            assert (f"; {flagged} with flags>" in repr(alone)) == bool(flagged)
            for name in NUMBERS:
                sums[name] += int(np.nan_to_num(getattr(alone, name)).sum())
    assert sums["n_impacts"] > 1000
    assert min(sums[name] for name in ("n_zeno", "n_liftoffs", "n_corners", "n_flags")) > 2, sums
