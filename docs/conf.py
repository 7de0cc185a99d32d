"""Settings of the documentation site: ``make docs``, or ``sphinx-build docs out/site``."""

import logging
import os
import sys
import tempfile
from pathlib import Path

import zivi

sys.path.insert(0, str(Path(__file__).parent / "_ext"))
import inventories

FOLDER = tempfile.TemporaryDirectory(prefix="zivi-docs-")
SCRATCH = Path(FOLDER.name)
# the builder's own profile of IPython has no part in what the pages show
os.environ["IPYTHONDIR"] = str(SCRATCH / "ipython")
(SCRATCH / "ipython" / "profile_default").mkdir(parents=True)
(SCRATCH / "ipython" / "profile_default" / "ipython_kernel_config.py").write_text(
    "c.IPKernelApp.log_level = 40\n"  # the notice that a kernel talks over loopback
)
logging.getLogger("traitlets").setLevel(logging.WARNING)  # a line for every page

project = "zivi"
author = "the zivi contributors"
project_copyright = author
version = release = zivi.__version__

extensions = [
    "generated",
    "mathml",
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
]
exclude_patterns = ["_*"]
# formulas and layouts in the pages are indented, and no language
highlight_language = "none"
python_display_short_literal_types = True

# pages in Markdown, read here and in the repository; the tutorial and the gallery are executed
myst_heading_anchors = 3
myst_fence_as_directive = ["math"]  # formulas, as GitHub sets them too
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
# pages whose code a test of its own runs, when a test builds the site
nb_execution_excludepatterns = os.environ.get("ZIVI_DOCS_NOT_EXECUTED", "").split()
nb_merge_streams = True
nb_output_stderr = "warn"  # no page shows a warning of its own code

# the reference, from the docstrings
default_role = "py:obj"
autodoc_member_order = "bysource"
autodoc_typehints = "none"
numpydoc_show_class_members = False
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"
numpydoc_xref_aliases = {
    name: f"zivi.{name}" for name, it in vars(zivi).items() if isinstance(it, type)
} | {
    "ndarray": "numpy.ndarray",
    "xarray.Dataset": "xarray.Dataset",
    "bool": ":class:`python:bool`",
}
intersphinx_mapping = inventories.write(SCRATCH / "inventories")

html_theme = "furo"
html_title = f"zivi {release}"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["copy.js"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#0072B2", "color-brand-content": "#0072B2"},
    "dark_css_variables": {"color-brand-primary": "#56B4E9", "color-brand-content": "#56B4E9"},
}

# a toctree may name pages that a checkout does not have yet
suppress_warnings = ["toc.empty_glob"]
if nb_execution_excludepatterns:
    suppress_warnings.append("myst-nb.lexer")  # what is not executed tells no language
    # furo resolves the tree of all pages for every page: a third of the time
    html_theme, html_theme_options = "basic", {}
