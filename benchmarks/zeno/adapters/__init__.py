"""One file for each tool.

An adapter is a module with

- ``NAME``, ``LEVELS``: the tool, and its settings from coarse to fine, each a number;
- ``missing()``: why it cannot run here, or None;
- ``refuses(problem)``: why it does not take a problem, or None;
- ``run(problem, level)``: a ``Motion``. What it does before the first step may be slow, and counts.
"""
