"""The inside of zivi that tests look at: the only file of the tests that names private modules.

A test that can say what it holds by public names does so. What stands here moves with the library.
"""

import importlib

NAMES = {
    "base.check": "reads_time",
    "base.expressions": "depends expression",
    "base.extras": "EXTRAS",
    "base.former": "FORMER",
    "base.formula": "FUNCTIONS FormulaError parse",
    "base.habits": "ARGUMENTS ATTRIBUTES CALLS MODULE MODULE_CALLS PLOT",
    "base.machine_code": "c_compiler",
    "base.table": "Tabulated",
    "control.component": "Shared",
    "control.design": "FLATTEST Landing ControlLaw STEEPEST bound_landing",
    "control.loop_arguments": "check_ahead",
    "control.loop_run": "LOOP_NUMBERS=NUMBERS SIGNS",
    "control.mechanical_reference": "_gap_branches reference_of",
    "control.twisting": "CONTROLLERS",
    "derivatives.mechanical_sensitivity": "run_of",
    "estimation.search": "SPURIOUS align geometric_indices",
    "files.file_keys": "FILE_CONTROLLERS=CONTROLLERS METHODS flatten_keys",
    "files.fits": "file_columns=read_csv_columns",
    "files.kinds": "FileError",
    "files.picture": "_edges",
    "files.results": "check_suffix read_curve open_result",
    "files.runs": "prepare_control prepare_simulate",
    "interop.fmu.description": "MODELS",
    "lab.controls": "read_controls panel",
    "lab.figures": "A_SECOND curves draw_runs film thinned",
    "lab.runs": "BeltRun ExplicitRegulator FAR simulate_settings facts warning_texts",
    "lab.server": "RequestGate MOST_SESSIONS",
    "lab.settings": (
        "Ball Belt KINDS PRESETS Regulator Tracker end_notices preset_name query ranges read_query"
    ),
    "lab.view": "script describe_signs",
    "orbits.arc": "_chain _power",
    "orbits.attractor": "Attractor Settled least_rows",
    "orbits.critical": "Turning crossed",
    "orbits.curve": "CodimensionTwo Line run",
    "orbits.dry_friction": "friction_flow_of",
    "orbits.equations": (
        "Frame ImpulseTerms Terms evaluate multipliers_of newton of_segments row_sizes sizes_of"
    ),
    "orbits.find": "is_free",
    "orbits.flows": "exponentials FlightError MassFlow PRECISE impact_maps parsed",
    "orbits.follow": "doubled",
    "orbits.orbit": "chatter_exponent SequenceFrame=MassFrame rows_along word_of_rows",
    "orbits.path": (
        "Margins Path Point by_parameter flow_of frame_of located located_near moved_frame "
        "period_of secant value_of"
    ),
    "orbits.words": "canonical recent repeating resting_orbit weaker_reason",
    "paper.closed_loops": "last_above track",
    "plot.curves": "SIGN_ROW line_of",
    "simulation.batch": "BATCH_NUMBERS=NUMBERS",
    "simulation.mechanical_trajectory": "forces_at summary_rows",
    "simulation.method_settings": "FixedSteps class_of",
    "simulation.run": "argument_text",
    "study.design": "child generators points seeds",
    "study.digest": (
        "UndigestibleError digest function_name function_state identity is_local source_digest "
        "unformatted used uses"
    ),
    "study.drive": "Driver OPEN Pool SignalGate compute_points=compute",
    "study.experiments": "ball_rest_time",
    "study.folder": "FileCodec FolderStore read_head write_below",
    "study.outcome": "LONGEST message_of",
    "study.store": "Chunks",
    "system.impact_law": "law_class",
    "system.model_parts": "STEP differenced",
    "system.parameters": "friction_numbers parameter with_value",
    "system.start": "_Look _check_curvatures _check_gradients _check_rates check_start",
    "system.symbolic_system": "derive",
    "vi.factorisation": "Factoriser Factors ReleaseEvent in_thread",
    "vi.jacobian": "ColouredDifferences colours_of pattern_of",
    "vi.solve": "Affine _sizes",
    "vi.sparse": "AffineMap _agrees _is_within_rounding",
    "vi.sparse_methods": "_Smoothing _proves interior_point is_infeasible Search",
}
"""Names of each module; ``A=b``: `b` is called `A` here."""
MODULES = {
    "_zivi": "_zivi",
    "base_extras": "base.extras",
    "base_machine_code": "base.machine_code",
    "control_gap_tracker": "control.gap_tracker",
    "control_loop_batch": "control.loop_batch",
    "files_commands": "files.commands",
    "files_file_keys": "files.file_keys",
    "files_kinds": "files.kinds",
    "files_picture": "files.picture",
    "files_results": "files.results",
    "files_summary": "files.summary",
    "interop_gradient": "interop.gradient",
    "orbits_along": "orbits.orbit",
    "orbits_attractor": "orbits.attractor",
    "orbits_cells": "orbits.attractor",
    "orbits_follow": "orbits.follow",
    "orbits_lyapunov": "orbits.lyapunov",
    "orbits_mechanical_curve": "orbits.curve",
    "orbits_mechanical_find": "orbits.words",
    "orbits_start": "orbits.find",
    "orbits_switch": "orbits.follow",
    "paper__siconos_steps": "paper._siconos_steps",
    "paper_ball": "paper.ball",
    "paper_ball_steps": "paper.ball",
    "paper_chattering": "paper.chattering",
    "paper_closed_loops": "paper.closed_loops",
    "paper_linearisation": "paper.linearisation",
    "paper_regulator": "paper.regulator",
    "paper_report": "paper.report",
    "paper_rest": "paper.rest",
    "paper_robustness": "paper.robustness",
    "paper_step_solvers": "paper.step_solvers",
    "paper_tracker": "paper.tracker",
    "paper_tracking_steps": "paper.tracker",
    "simulation_trajectory": "simulation.trajectory",
    "study_digest": "study.digest",
    "study_drive": "study.drive",
    "study_folder": "study.folder",
    "study_head": "study.folder",
    "study_pools": "study.drive",
    "study_result": "study.result",
    "study_run": "study.run",
    "study_store": "study.store",
    "system_impact_law": "system.impact_law",
    "vi_sparse": "vi.sparse",
    "vi_sparse_methods": "vi.sparse_methods",
    "vi_sparse_search": "vi.sparse_methods",
}
"""Modules in which tests replace something."""

_PLACES = {}
for _module, _names in NAMES.items():
    for _name in _names.split():
        _here, _, _there = _name.partition("=")
        _PLACES[_here] = _module, _there or _here


def __getattr__(name):
    if name in MODULES:
        return importlib.import_module(f"zivi.{MODULES[name]}")
    if name in _PLACES:
        module, there = _PLACES[name]
        return getattr(importlib.import_module(f"zivi.{module}"), there)
    raise AttributeError(f"tests/inside.py has no {name!r}: add it to NAMES or MODULES")
