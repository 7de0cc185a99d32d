"""What all tests share."""

import matplotlib as mpl
import pytest

mpl.use("Agg")


@pytest.fixture(autouse=True)
def no_figure_is_left_open():
    yield
    import matplotlib.pyplot as plt

    plt.close("all")
