"""Parameters of systems with impacts, estimated from data."""

from zivi.base.former import of_zivi
from zivi.estimation.data import Bounces, Experiment, Record
from zivi.estimation.fits import fit
from zivi.estimation.result import Bootstrap, Fit, FitStatus, Profile

__all__ = ["Bootstrap", "Bounces", "Experiment", "Fit", "FitStatus", "Profile", "Record", "fit"]

of_zivi(globals())
