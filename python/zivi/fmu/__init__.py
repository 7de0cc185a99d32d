"""FMUs (functional mock-up units): zivi in Simulink, OpenModelica, Dymola and other tools."""

from __future__ import annotations

from zivi.base.habits import hint_calls
from zivi.interop.fmu.export import export_fmu, export_loop

__all__ = ["export_fmu", "export_loop"]

hint_calls(__name__)
