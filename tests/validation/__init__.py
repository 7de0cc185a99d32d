"""Values that others published, computed anew: the tables of benchmarks/results/validation.md.

``cd tests && python -m validation`` prints them, with ``--write`` it writes them into the page. The
numbers of the sources are in ``data/validation.json``: a selection, with where each stands.
"""
