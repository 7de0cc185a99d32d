"""What all tests share."""

import os
import signal

import hypothesis
import matplotlib as mpl
import pytest

mpl.use("Agg")

# the same examples in every run, and a slow machine is not a failure; HYPOTHESIS_PROFILE=explore
# looks elsewhere
hypothesis.settings.register_profile("zivi", derandomize=True, deadline=None, max_examples=150)
hypothesis.settings.register_profile("explore", deadline=None, max_examples=1000)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "zivi"))


@pytest.fixture(autouse=True)
def no_figure_is_left_open():
    yield
    import matplotlib.pyplot as plt

    plt.close("all")


@pytest.fixture(autouse=True, scope="session")
def _ctrl_c_works():
    """A job in the background ignores SIGINT, and its Python then has no handler for it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
