"""Studies: one function at many points, on threads, processes or a cluster, kept as it goes.

design      ->    work       ->   drive           ->   store
(points)          (a task)        (who, and again)     (memory, folder)
"""

from zivi.base.former import of_zivi
from zivi.study.design import Design, grid, points, sample
from zivi.study.experiments import EXPERIMENTS
from zivi.study.result import Study, open_study
from zivi.study.run import sweep

__all__ = ["EXPERIMENTS", "Design", "Study", "grid", "open_study", "points", "sample", "sweep"]

of_zivi(globals())
