"""Controllers, their gains, the observer, closed loops."""

from zivi.control.twisting import ExplicitTwisting, TickStatus, TwistingRegulator, TwistingTracker

__all__ = ["ExplicitTwisting", "TickStatus", "TwistingRegulator", "TwistingTracker"]
