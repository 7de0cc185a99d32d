"""Statuses of runs and of points of a study; warnings."""

from __future__ import annotations

import enum
import sys
import warnings
from pathlib import Path

# Status of runs and of points of a study.


class NamedStatus(enum.IntEnum):
    """An integer that prints as its name; `int` and number formats return the integer."""

    def __str__(self) -> str:
        return self.name

    def __format__(self, spec: str) -> str:
        return format(int(self) if spec[-1:] in tuple("bcdeEfFgGnoxX%") else self.name, spec)


class Status(NamedStatus):
    """How a run ended. The numbers are **not** those of SciPy: use ``success``.

    In SciPy's `solve_ivp`, 1 is the success of a run that a terminal event ended, and failures are
    negative. Here only 0 is the same, the end of the span. Every other number names one way to end:
    `TERMINATED_BY_EVENT`, 9, is a success too, all others are failures; none is negative, since a
    batch keeps the status of a run as an unsigned byte. So neither ``status < 0`` nor
    ``status == 1`` means what it does there; ``success``, and the names, always tell.

    Whatever the status, the trajectory is valid up to its last sample.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> sol = zivi.simulate(ball, (0, 3), (1, 0))
    >>> sol.success, sol.status
    (True, <Status.COMPLETED: 0>)
    >>> print(sol.status)
    COMPLETED
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
    """More impacts than ``max_impacts`` in one accumulation, at ``e = 1``, or without a force
    towards the wall."""
    STEP_BUDGET = 7
    """The run took more steps than ``max_steps``."""
    STEP_SIZE_TOO_SMALL = 8
    """No step that still advances the time was short enough for the tolerances."""
    TERMINATED_BY_EVENT = 9
    """A terminal event of the user ended the run (a success)."""
    OUT_OF_MEMORY = 10
    """The record of the run exceeded the memory."""
    INTERNAL = 11
    """A fault in zivi itself; only in batches, whose other runs are kept."""
    REDUNDANT_CONTACTS = 12
    """Closed gaps of a mechanism depend on each other, and no forces keep all of them closed."""
    IMPACT_NOT_SOLVED = 13
    """The impulses of an impact on several gaps were not found."""
    CONTACT_NOT_SOLVED = 14
    """The closed contacts of a mechanical system could not be determined, or its impacts at one
    instant do not end."""
    MASS_NOT_DEFINITE = 15
    """The mass matrix of a mechanical system is not symmetric positive definite."""
    INCONSISTENT_CONTACT = 16
    """No motion of a sliding contact obeys the law of friction (Painlevé's paradox)."""
    INDETERMINATE_CONTACT = 17
    """Several motions obey the law of friction: Painlevé's paradox, or an open prestress."""
    PAINLEVE_SINGULAR = 18
    """A sliding contact reached the border of Painlevé's paradox."""
    REDUNDANT_STICK = 19
    """No longer returned: undetermined forces no longer end a run."""
    MODE_CHATTER = 20
    """Friction changed its mode repeatedly at one instant."""
    CONTROL_REJECTED = 21
    """A loop reached the end of ``t_span``, but its control updates were rejected: all of them, or
    all of the last tenth."""
    NO_PROGRESS = 22
    """1000 steps of a mechanical system without an event covered less than 1e-9 of the span."""
    INCONSISTENT_CONSTRAINTS = 23
    """Dependent equality rows of a mechanical system prescribe different motions."""
    INCONSISTENT_IMPACT = 24
    """No impulses obey the laws of an impact on several gaps with friction."""


class StudyStatus(NamedStatus):
    """Outcome of a point of a study, in ``status`` of a `Study` and of its dataset.

    The words are those of runs and batches: what was computed is *completed*, what was not
    *failed*; only a study, which can go on later, has points that are *missing*. A point is
    completed when its function returned: how a run in it ended is another number, ``run_status`` of
    zivi's own experiments, a `Status`. The numbers are those of the stored files and do not change.

    Examples
    --------
    >>> study = zivi.sweep(lambda x: 1 / x, {"x": [0, 1, 2]})
    >>> [zivi.StudyStatus(number).name for number in study.status]
    ['FAILED', 'COMPLETED', 'COMPLETED']
    """

    MISSING = 0
    """Not computed yet, or the stored result is damaged."""
    COMPLETED = 1
    """The function returned, and its result is stored."""
    FAILED = 2
    """The function raised, or its worker died: ``message`` has the reason."""


# Warnings of zivi, attributed to the calling line of user code.


class ModelWarning(UserWarning):
    """A model or a closed loop probably contains a mistake.

    The model of a controller differs from the plant, more than a tenth of its updates were rejected
    or saturated, or a constant force accelerates a mass away from the wall without return. A
    controller without `e` uses the plant's. If the mismatch is intended, silence the warning with
    ``warnings.simplefilter("ignore", zivi.ModelWarning)``.
    """


PACKAGE = str(Path(__file__).parents[1])


def warn(text: str, category: type[Warning] = ModelWarning) -> None:
    """Warn at the nearest line that is not of this package."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(PACKAGE):
        level, frame = level + 1, frame.f_back
    warnings.warn(text, category, stacklevel=level)
