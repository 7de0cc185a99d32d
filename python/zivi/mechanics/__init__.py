"""Mechanical systems with several coordinates and gaps: names for `zivi.system` and its runs."""

from zivi.base.habits import hint_calls
from zivi.system.gap import Gap, LinearGap
from zivi.system.mechanism import MechanicalSystem
from zivi.system.model_parts import Evaluation
from zivi.system.space import Ball, Box, Capsule, Contact, Plane
from zivi.system.start import GapCoordinates, gap_coordinates
from zivi.system.tree_bodies import (
    BallGap,
    Body,
    Connect,
    Couple,
    Drive,
    JointLimit,
    PlaneGap,
    Weld,
)

__all__ = [
    "Ball",
    "BallGap",
    "Body",
    "Box",
    "Capsule",
    "Connect",
    "Contact",
    "Couple",
    "Drive",
    "Evaluation",
    "Gap",
    "GapCoordinates",
    "JointLimit",
    "LinearGap",
    "MechanicalSystem",
    "Plane",
    "PlaneGap",
    "Weld",
    "gap_coordinates",
]

hint_calls(__name__)
