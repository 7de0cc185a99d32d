"""How a run ended."""

import enum


class Status(enum.IntEnum):
    """How a run ended; ``0`` is success, as in SciPy.

    Whatever the status, the trajectory is valid up to its last sample.
    """

    COMPLETED = 0
    """The end of ``t_span`` was reached."""
    FORCE_NOT_FINITE = 1
    """The force returned NaN or infinity."""
    STATE_NOT_FINITE = 2
    """The state overflowed."""
    FORCE_NOT_CONVERGED = 3
    """The force at the end of a step was not found within the iterations."""
    STEP_NOT_SOLVED = 4
    """No sign pattern solved a step within rounding."""
    RAISED = 5
    """The force raised an exception or the run was interrupted."""
    ZENO_BUDGET = 6
    """An accumulation had more impacts than ``max_impacts``, or no pull to the wall behind it."""
    STEP_BUDGET = 7
    """The run took more steps than ``max_steps``."""
    STEP_SIZE_TOO_SMALL = 8
    """No step that still advances the time was short enough for the tolerances."""
    TERMINATED_BY_EVENT = 9
    """A terminal event of the user ended the run (a success)."""
    OUT_OF_MEMORY = 10
    """The record of the run grew beyond the memory."""
    INTERNAL = 11
    """A fault in zivi itself; only in batches, whose other runs are kept."""
