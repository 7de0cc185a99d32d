"""Write what users may have kept of a version: pickles, files of runs, a study.

`python tests/kept_by_version.py ARCHIVE`, with that version installed. The archives are in
`tests/data`; each later version reads them.
"""

import pickle
import sys
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import zivi
from inside import ball_rest_time

G = 9.81


def mass_things():
    ball = zivi.ImpactSystem(-G, e=0.5)
    wave = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2)
    table = zivi.ImpactSystem(wave, e=0.5)
    yield "system", ball
    yield "moving wall", zivi.ImpactSystem(wave, e=0.6, wall=zivi.HarmonicWall(0.01, 3.0, 0.2))
    yield "table", zivi.Table([0.0, 1.0, 2.0], [-9.0, -10.0, -9.5])
    yield "run", zivi.simulate(ball, (0, 3), (1, 0))
    yield "fixed steps", zivi.simulate(ball, (0, 1), (1, 0), zivi.ThetaGamma(1e-2))
    yield "batch", zivi.simulate_batch([ball] * 3, (0, 2), [(1, 0), (0.5, 0), (2, 0)])
    yield "sensitivity", zivi.sensitivity(ball, (0, 0.8), (1, 0))
    yield "impact map", zivi.impact_map(table)
    orbit = zivi.periodic_orbit(table, [(0.6, 2.1)])
    yield "orbit", orbit
    branch = zivi.continue_orbit(orbit, "amplitude", (1.0, 1.6))
    yield "branch", branch
    curve = zivi.continue_curve(
        branch.of_kind("fold")[0], ("amplitude", "e"), ((1.0, 1.4), (0.4, 0.6))
    )
    yield "curve", curve
    yield (
        "diagram",
        zivi.bifurcation_diagram(table, "amplitude", [1.3, 1.6], starts=(0.3, 1.9), transient=100),
    )
    yield "exponents", zivi.lyapunov_exponents(table, (0, 90), (0.1, 2.0), transient=30)
    yield "basins", zivi.basins(table, np.linspace(0.1, 1, 3), np.linspace(-1, 1, 3))


def mechanical_things():
    floor = zivi.LinearGap([0.0, 1.0], tangent=[1.0, 0.0], mu=0.4)
    guide = zivi.DryFriction([1.0, 0.0], limit=0.1)
    block = zivi.MechanicalSystem(
        mass=np.eye(2), force=[3.0, -10.0], gaps=[floor], e=0.5, friction=[guide]
    )
    start = [0.0, 1.0], [1.0, 0.0]
    yield "mechanism", block
    yield "mechanical run", zivi.simulate(block, (0, 2), start)
    yield "mechanical fixed steps", zivi.simulate(block, (0, 1), start, zivi.MoreauJean(1e-2))
    yield "mechanical batch", zivi.simulate_batch(block, (0, 1), [start] * 2)
    wave = zivi.Harmonic([0.4], 2.0)
    stop = zivi.LinearGap([1.0], -0.5)
    linear = zivi.LinearSystem([[1.0]], [[0.05]], [[1.0]], excitation=wave, gaps=[stop], e=0.5)
    yield "linear system", linear
    yield "linear run", zivi.simulate(linear, (0, 10), ([1.0], [0.0]))
    yield "mechanical sensitivity", zivi.sensitivity(linear, (0, 3), ([1.0], [0.0]))
    run = zivi.simulate(linear, (0, 400), ([1.0], [0.0]))
    orbit = zivi.periodic_orbit(linear, run)
    yield "mechanical orbit", orbit
    yield "mechanical branch", zivi.continue_orbit(orbit, "e", (0.45, 0.55))
    bob = zivi.mechanics.Body("bob", axis=[0, 1, 0], mass=2.0, com=[0, 0, -1], inertia=0.01)
    ground = zivi.mechanics.PlaneGap("bob", point=[0, 0, -1], offset=-0.8, radius=0.1, name="floor")
    tree = zivi.Tree([bob], gaps=[ground], e=0.5)
    yield "tree", tree
    yield "tree run", zivi.simulate(tree, (0, 2), ([1.5], [0.0]))


def control_things():
    plant = zivi.ImpactSystem(-G, kappa=0.5)
    tracker = zivi.TwistingTracker(30, 17, h=1e-2, kappa=0.5)
    design = zivi.design_regulator(1.5, e=0.5, bound=1.0)
    yield "design", design
    yield "regulator", zivi.TwistingRegulator(3, 2, h=1e-3, kappa=0.5, bound=0.9)
    yield "tracker", tracker
    yield "observer", zivi.ImpactObserver(0.5, 1e-2, position_only=True)
    asked = {"y_ref0": (3, 3), "force_ref": -19.81}
    yield "loop", zivi.simulate_closed_loop(plant, tracker, (0, 2), (6, 5), **asked)
    yield "loops", zivi.simulate_closed_loop_batch(plant, tracker, (0, 1), [(6, 5)] * 2, **asked)
    floor = zivi.LinearGap([0, 1], name="floor")
    box = zivi.MechanicalSystem(mass=np.eye(2), force=[0.0, -G], gaps=[floor], e=0.5)
    gap_tracker = zivi.GapTracker(box, h=1e-2, gains={"floor": (30, 17)}, force={"floor": 5.0})
    yield "gap tracker", gap_tracker
    asked = box, gap_tracker, (0, 1)
    start = [0, 0.3], [0, 0]
    yield "mechanical loop", zivi.simulate_closed_loop(*asked, start, reference="rest")
    yield "mechanical loops", zivi.simulate_closed_loop_batch(*asked, [start] * 2, reference="rest")


def other_things():
    box = np.zeros(3), np.ones(3)
    yield "vi", zivi.solve_vi(lambda x: x - 1, *box, np.zeros(3))
    yield "game", zivi.bimatrix([[3.0, 0.0], [5.0, 1.0]], [[3.0, 5.0], [0.0, 1.0]])
    methods = zivi.SwitchedRK(), zivi.ThetaGamma(1e-3), zivi.MoreauJean(1e-3)
    yield "methods", (*methods, zivi.ExplicitEuler(1e-3))
    yield "study", zivi.grid(a=[1.0, 2.0], b=[1.0])
    yield "level", zivi.Level(x=0.24, direction=1)


THINGS = (mass_things, mechanical_things, control_things, other_things)
SAVED = ("run", "fixed steps", "mechanical run", "linear run", "tree run", "loop")
"""What is saved as a file of netCDF, too."""


def entry(name):
    info = zipfile.ZipInfo(name)  # of no date: the same bytes each time
    info.compress_type = zipfile.ZIP_DEFLATED
    return info


def main(archive):
    with zipfile.ZipFile(archive, "w") as file, TemporaryDirectory() as made:
        folder = Path(made)
        for things in THINGS:
            for name, value in things():
                file.writestr(entry(f"{name}.pickle"), pickle.dumps(value))
                if name in SAVED:
                    zivi.files.save(value, folder / f"{name}.nc")
        zivi.sweep(ball_rest_time, {"e": [0.3, 0.5]}, out=folder / "study", progress=False)
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                file.writestr(entry(str(path.relative_to(folder))), path.read_bytes())


if __name__ == "__main__":
    main(sys.argv[1])
