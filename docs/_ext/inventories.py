"""Addresses of what the docstrings refer to in other projects, without asking them.

Intersphinx would fetch their inventories at every build, and a build without a network would fail.
The few names that are needed are written to an inventory of our own instead.
"""

import zlib
from pathlib import Path

NUMPY = "https://numpy.org/doc/stable/"
SCIPY = "https://docs.scipy.org/doc/scipy/"
XARRAY = "https://docs.xarray.dev/en/stable/"
MATPLOTLIB = "https://matplotlib.org/stable/"
PYTHON = "https://docs.python.org/3/"
CONTROL = "https://python-control.readthedocs.io/en/stable/"

GENERATED = "generated/{name}.html#{name}"
PROJECTS = {
    "numpy": (
        NUMPY,
        {
            "py:class": {
                "numpy.ndarray": "reference/" + GENERATED,
                "numpy.random.Generator": "reference/random/generator.html#{name}",
                "numpy.random.SeedSequence": "reference/random/bit_generators/" + GENERATED,
            },
            "std:term": {"array_like": "glossary.html#term-{name}"},
        },
    ),
    "scipy": (
        SCIPY,
        {
            "py:class": {
                "scipy.LowLevelCallable": "reference/" + GENERATED,
                "scipy.stats.qmc.QMCEngine": "reference/" + GENERATED,
            },
            "py:function": {"scipy.integrate.solve_ivp": "reference/" + GENERATED},
        },
    ),
    "xarray": (XARRAY, {"py:class": {"xarray.Dataset": GENERATED}}),
    "matplotlib": (
        MATPLOTLIB,
        {
            "py:class": {
                "matplotlib.axes.Axes": "api/_as_gen/{name}.html#{name}",
                "matplotlib.figure.Figure": "api/_as_gen/{name}.html#{name}",
            },
            "py:method": {
                "matplotlib.axes.Axes.plot": "api/_as_gen/{name}.html#{name}",
            },
        },
    ),
    "python": (
        PYTHON,
        {
            "py:class": {
                "concurrent.futures.Executor": "library/concurrent.futures.html#{name}",
                "float": "library/functions.html#{name}",
                "int": "library/functions.html#{name}",
                "bool": "library/functions.html#{name}",
                "str": "library/stdtypes.html#{name}",
                "dict": "library/stdtypes.html#{name}",
                "list": "library/stdtypes.html#{name}",
                "tuple": "library/stdtypes.html#{name}",
            },
            "py:exception": dict.fromkeys(
                ("ImportError", "KeyboardInterrupt", "RuntimeError", "TypeError", "ValueError"),
                "library/exceptions.html#{name}",
            ),
            "py:data": dict.fromkeys(("None", "True", "False"), "library/constants.html#{name}"),
            "py:function": {"callable": "library/functions.html#{name}"},
            "std:term": {"sequence": "glossary.html#term-{name}"},
        },
    ),
    "control": (
        CONTROL,
        {
            "py:class": {"control.NonlinearIOSystem": GENERATED},
            "py:function": {
                "control.interconnect": GENERATED,
                "control.input_output_response": GENERATED,
            },
        },
    ),
}
"""For each project its address, and under it the pages of the names by their kind."""


def write(folder: Path) -> dict[str, tuple[str, str]]:
    """Write an inventory for each project (version 2 of the format of Sphinx).

    Parameters
    ----------
    folder : Path
        Where to; it is made.

    Returns
    -------
    dict
        The setting ``intersphinx_mapping``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    mapping = {}
    for project, (address, kinds) in PROJECTS.items():
        lines = [
            f"{name} {kind} 1 {page.format(name=name)} -\n"
            for kind, names in kinds.items()
            for name, page in names.items()
        ]
        head = f"# Sphinx inventory version 2\n# Project: {project}\n# Version: \n"
        head += "# The remainder of this file is compressed using zlib.\n"
        path = folder / f"{project}.inv"
        path.write_bytes(head.encode() + zlib.compress("".join(lines).encode()))
        mapping[project] = (address, str(path))
    return mapping
