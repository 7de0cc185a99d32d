"""Simulate and control mechanical systems with impacts straight through the Zeno point.

A mass above a wall, ``x'' = f(t, x, x')`` with ``x >= 0``, loses velocity at every impact,
``x'+ = -e x'-``, and bounces infinitely often in finite time; a mechanism has several coordinates
and gaps. Runs pass the accumulations of impacts, rest exactly and lift off again.

>>> import zivi
>>> ball = zivi.ImpactSystem(-9.81, e=0.5)
>>> sol = zivi.simulate(ball, (0, 4), (1, 0))
>>> round(sol.rest_time, 12)  # 3 sqrt(2/9.81)
1.354570922957

Systems
    `ImpactSystem`, `LinearForce`, `HarmonicWall`, `Table`, `SpeedDependentImpact`;
    `MechanicalSystem`, `LinearSystem`, `Tree`, `LinearGap`, `DryFriction`;
    ``zivi.symbolic``
Runs
    `simulate`, `simulate_batch`; the methods `SwitchedRK` (high order, the default), `ThetaGamma`
    (the implicit scheme of Huber and Oza), `MoreauJean`, `ExplicitEuler`
Control
    `TwistingRegulator`, `TwistingTracker`, `ImpactObserver`, `design_tracker`,
    `simulate_closed_loop`; of mechanisms `GapTracker`, `JointObserver`, `reference_run`
Analysis
    `sensitivity`, `impact_map`, `periodic_orbit`, `continue_orbit`, `basins`, `sweep`
Data
    `fit` estimates parameters from `Bounces`, `Record` and `Experiment`
Variational inequalities
    `solve_vi`, `solve_avi`, `solve_ncp`, `solve_lcp`, `bimatrix`
Results
    What these return: ``zivi.simulation.Trajectory``, ``zivi.control.ClosedLoop``,
    ``zivi.derivatives.Sensitivity``, ``zivi.orbits.PeriodicOrbit``, ``zivi.vi.VIResult``, ...
Around them
    ``zivi.plot``, ``zivi.files``, ``zivi.interop``, `export_fmu`, the command ``zivi``
"""

import importlib
import sys
from typing import TYPE_CHECKING

from zivi._zivi import __version__
from zivi.base.status import ModelWarning, Status, StudyStatus

if TYPE_CHECKING:
    from zivi import (
        files as files,
        interop as interop,
        mechanics as mechanics,
        plot as plot,
        symbolic as symbolic,
    )
    from zivi.control.closed_loop import Controller, simulate_closed_loop
    from zivi.control.component import TickStatus
    from zivi.control.design import (
        GainDesign as GainDesign,
        InfeasibleError,
        best_ratio,
        design_regulator,
        design_tracker,
    )
    from zivi.control.gap_tracker import GapTracker, Striker
    from zivi.control.loop_batch import (
        MechanicalLoopBatch as MechanicalLoopBatch,
        simulate_closed_loop_batch,
    )
    from zivi.control.loop_run import ClosedLoop as ClosedLoop, ClosedLoopBatch as ClosedLoopBatch
    from zivi.control.mechanical_loop import (
        MechanicalClosedLoop as MechanicalClosedLoop,
        MechanicalController,
        RKPeriod,
    )
    from zivi.control.mechanical_reference import ReferenceSample as ReferenceSample, reference_run
    from zivi.control.model_based import JointObserver
    from zivi.control.observer import ImpactObserver, Observed as Observed
    from zivi.control.twisting import ExplicitTwisting, TwistingRegulator, TwistingTracker
    from zivi.derivatives.impact_map import (
        ImpactMap as ImpactMap,
        ImpactReturn as ImpactReturn,
        impact_map,
    )
    from zivi.derivatives.mechanical_sensitivity import (
        MechanicalSensitivity as MechanicalSensitivity,
    )
    from zivi.derivatives.result import OrbitStatus, Sensitivity as Sensitivity
    from zivi.derivatives.sensitivity import sensitivity
    from zivi.estimation import (
        Bootstrap as Bootstrap,
        Bounces,
        Experiment,
        Fit as Fit,
        FitStatus,
        Profile as Profile,
        Record,
        fit,
    )
    from zivi.fmu import export_fmu
    from zivi.interop import native as native
    from zivi.orbits import (
        Attractor as Attractor,
        Basins as Basins,
        Branch as Branch,
        BranchEvent as BranchEvent,
        CodimensionTwo as CodimensionTwo,
        Diagram as Diagram,
        EventCurve as EventCurve,
        Lyapunov as Lyapunov,
        MechanicalBranch as MechanicalBranch,
        MechanicalEvent as MechanicalEvent,
        MechanicalOrbit as MechanicalOrbit,
        PeriodicOrbit as PeriodicOrbit,
        bifurcation_diagram,
        continue_curve,
        continue_orbit,
        grazing_curve,
        lyapunov_exponents,
        periodic_orbit,
        response_amplitude,
    )
    from zivi.orbits.diagram import basins
    from zivi.simulation import methods as methods
    from zivi.simulation.batch import MechanicalBatch as MechanicalBatch, simulate_batch
    from zivi.simulation.batch_result import Batch as Batch
    from zivi.simulation.events import Level, event
    from zivi.simulation.mechanical_trajectory import MechanicalTrajectory as MechanicalTrajectory
    from zivi.simulation.method_settings import Method
    from zivi.simulation.methods import ExplicitEuler, MoreauJean, SwitchedRK, ThetaGamma
    from zivi.simulation.run import simulate
    from zivi.simulation.trajectory import Trajectory as Trajectory
    from zivi.study import Design, Study, grid, open_study, points, sample, sweep
    from zivi.system.gap import (
        DryFriction,
        Gap,
        HarmonicWall,
        Hertz,
        HuntCrossley,
        LinearGap,
        MovingWall,
        SpringDamper,
    )
    from zivi.system.impact_law import (
        ImpactLaw,
        NewtonImpact,
        Restitution,
        RestitutionTable,
        SpeedDependentImpact,
    )
    from zivi.system.kicks import Kick
    from zivi.system.linear import Harmonic, LinearSystem
    from zivi.system.mass import ImpactSystem, LinearForce, ParametricForce, lift, project
    from zivi.system.mechanism import MechanicalSystem
    from zivi.system.model_parts import Equality
    from zivi.system.parameters import ParametricSystem
    from zivi.system.start import consistent
    from zivi.system.table import Pulse, Square, Table
    from zivi.system.tree import Tree
    from zivi.vi.complementarity import Equilibrium as Equilibrium, bimatrix, solve_lcp, solve_ncp
    from zivi.vi.jacobian import check_jacobian
    from zivi.vi.solve import natural_residual, solve_avi, solve_vi
    from zivi.vi.types import VIOptions, VIProgress as VIProgress, VIResult as VIResult, VIStatus

importlib.import_module("zivi.base.extras").watch()
_habits = importlib.import_module("zivi.base.habits")
_former = importlib.import_module("zivi.base.former")
_former.hand_on()

__all__ = [
    "Bounces",
    "Controller",
    "Design",
    "DryFriction",
    "Equality",
    "Experiment",
    "ExplicitEuler",
    "ExplicitTwisting",
    "FitStatus",
    "Gap",
    "GapTracker",
    "Harmonic",
    "HarmonicWall",
    "Hertz",
    "HuntCrossley",
    "ImpactLaw",
    "ImpactObserver",
    "ImpactSystem",
    "InfeasibleError",
    "JointObserver",
    "Kick",
    "Level",
    "LinearForce",
    "LinearGap",
    "LinearSystem",
    "MechanicalController",
    "MechanicalSystem",
    "Method",
    "ModelWarning",
    "MoreauJean",
    "MovingWall",
    "NewtonImpact",
    "OrbitStatus",
    "ParametricForce",
    "ParametricSystem",
    "Pulse",
    "RKPeriod",
    "Record",
    "Restitution",
    "RestitutionTable",
    "SpeedDependentImpact",
    "SpringDamper",
    "Square",
    "Status",
    "Striker",
    "Study",
    "StudyStatus",
    "SwitchedRK",
    "Table",
    "ThetaGamma",
    "TickStatus",
    "Tree",
    "TwistingRegulator",
    "TwistingTracker",
    "VIOptions",
    "VIStatus",
    "__version__",
    "basins",
    "best_ratio",
    "bifurcation_diagram",
    "bimatrix",
    "check_jacobian",
    "consistent",
    "continue_curve",
    "continue_orbit",
    "design_regulator",
    "design_tracker",
    "event",
    "export_fmu",
    "fit",
    "grazing_curve",
    "grid",
    "impact_map",
    "lift",
    "lyapunov_exponents",
    "natural_residual",
    "open_study",
    "periodic_orbit",
    "plot",
    "points",
    "project",
    "reference_run",
    "response_amplitude",
    "sample",
    "sensitivity",
    "simulate",
    "simulate_batch",
    "simulate_closed_loop",
    "simulate_closed_loop_batch",
    "solve_avi",
    "solve_lcp",
    "solve_ncp",
    "solve_vi",
    "sweep",
]

_LAZY = (
    *(
        "control",
        "derivatives",
        "estimation",
        "files",
        "fmu",
        "interop",
        "lab",
        "mechanics",
        "orbits",
        "plot",
    ),
    *("simulation", "study", "symbolic", "system", "vi"),
)
"""Modules that are imported when they are first asked for."""
_LATE = {
    "control": (
        *("ClosedLoop", "ClosedLoopBatch", "Controller", "ExplicitTwisting", "GainDesign"),
        *("GapTracker", "ImpactObserver", "InfeasibleError", "JointObserver"),
        *("MechanicalClosedLoop", "MechanicalController", "MechanicalLoopBatch", "Observed"),
        *("RKPeriod", "ReferenceSample", "Striker", "TickStatus", "TwistingRegulator"),
        *("TwistingTracker", "best_ratio", "design_regulator", "design_tracker"),
        *("reference_run", "simulate_closed_loop", "simulate_closed_loop_batch"),
    ),
    "derivatives": (
        *("ImpactMap", "ImpactReturn", "MechanicalSensitivity", "OrbitStatus", "Sensitivity"),
        *("impact_map", "sensitivity"),
    ),
    "estimation": (
        *("Bootstrap", "Bounces", "Experiment", "Fit", "FitStatus", "Profile", "Record", "fit"),
    ),
    "fmu": ("export_fmu",),
    "orbits": (
        *("Attractor", "Basins", "Branch", "BranchEvent", "CodimensionTwo", "Diagram"),
        *("EventCurve", "Lyapunov", "MechanicalBranch", "MechanicalEvent", "MechanicalOrbit"),
        *("PeriodicOrbit", "basins", "bifurcation_diagram", "continue_curve", "continue_orbit"),
        *("grazing_curve", "lyapunov_exponents", "periodic_orbit", "response_amplitude"),
    ),
    "simulation": (
        *("Batch", "ExplicitEuler", "Level", "MechanicalBatch", "MechanicalTrajectory", "Method"),
        *("MoreauJean", "SwitchedRK", "ThetaGamma", "Trajectory", "event", "simulate"),
        "simulate_batch",
    ),
    "study": ("Design", "Study", "grid", "open_study", "points", "sample", "sweep"),
    "system": (
        *("DryFriction", "Equality", "Gap", "Harmonic", "HarmonicWall", "Hertz", "HuntCrossley"),
        *("ImpactLaw", "ImpactSystem", "SpringDamper"),
        *("Kick", "LinearForce", "LinearGap", "LinearSystem", "MechanicalSystem", "MovingWall"),
        *("NewtonImpact", "ParametricForce", "ParametricSystem", "Restitution"),
        *("Pulse", "RestitutionTable", "SpeedDependentImpact", "Square", "Table", "Tree"),
        *("consistent", "lift", "project"),
    ),
    "vi": (
        *("Equilibrium", "JacobianError", "VIDerivative", "VIOptions", "VIProgress", "VIResult"),
        *("VIStatus", "bimatrix", "check_jacobian", "natural_residual", "solve_avi", "solve_lcp"),
        *("solve_ncp", "solve_vi"),
    ),
}
"""What comes with some of them."""
_ROOM_OF = {name: room for room, names in _LATE.items() for name in names}


def __getattr__(name: str) -> object:
    if name in _LAZY:
        return importlib.import_module(f"zivi.{name}")
    if name in _ROOM_OF:
        globals()[name] = found = getattr(importlib.import_module(f"zivi.{_ROOM_OF[name]}"), name)
        return found
    if not name.startswith("_") and name in _former.FORMER:
        return sys.modules[f"zivi.{name}"]
    if not name.startswith("_") and name in (known := _methods_and_controllers()):
        return known[name]
    raise _habits.module_error("zivi", name, __dir__(), _habits.MODULE)


def _methods_and_controllers() -> dict[str, type]:
    """Return the methods and controllers, those too that are not among the names above."""
    controllers = importlib.import_module("zivi.control.twisting").CONTROLLERS
    return {it.__name__: it for it in (*sys.modules["zivi.methods"].METHODS.values(), *controllers)}


def __dir__() -> list[str]:
    return sorted({*__all__, *_LAZY, "methods", *_methods_and_controllers()})


_former.of_zivi(globals())
