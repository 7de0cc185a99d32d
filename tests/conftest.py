"""What all tests share."""

import os

import hypothesis
import matplotlib as mpl
import pytest

mpl.use("Agg")

# the same examples in every run of CI; a slow machine is not a failure
hypothesis.settings.register_profile("ci", derandomize=True, deadline=None)
hypothesis.settings.register_profile("explore", deadline=None)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "explore")


@pytest.fixture(autouse=True)
def no_figure_is_left_open():
    yield
    import matplotlib.pyplot as plt

    plt.close("all")
