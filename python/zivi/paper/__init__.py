"""The figures and numbers of the paper, recomputed.

O. Huber and H. B. Oza, *Implicit numerical integration for the simulation and control of a
non-smooth system with resets*, CDC 2016, doi 10.1109/CDC.2016.7799277.

`write` makes them; ``zivi paper`` is its command line.
"""

from zivi.paper.report import Check
from zivi.paper.write import STAGES, Reproduction, write

__all__ = ["STAGES", "Check", "Reproduction", "write"]
