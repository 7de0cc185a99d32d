"""Files: what a run or a study is, read from TOML, and single runs on disk.

reading     ->    runs, sweeps    ->   results     ->   summary, picture
(keys, TOML)      (prepared)           (netCDF)         (tables, figures)
"""

from zivi.base.habits import hint_calls
from zivi.files.file_keys import tree_text
from zivi.files.kinds import FileError
from zivi.files.results import ResultError, load, save
from zivi.files.runs import (
    Prepared,
    PreparedSweep,
    mechanism_of,
    prepare_control,
    prepare_simulate,
    prepare_sweep,
)

__all__ = [
    "FileError",
    "Prepared",
    "PreparedSweep",
    "ResultError",
    "load",
    "mechanism_of",
    "prepare_control",
    "prepare_simulate",
    "prepare_sweep",
    "save",
    "tree_text",
]

hint_calls(__name__)
