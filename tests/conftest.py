"""What all tests share."""

import gc
import os
import signal

# before NumPy comes, here and in all processes that tests start: threads of OpenBLAS beside as many
# workers as processors wait for each other, 500 times as long as an exponential of 12 x 12 takes
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hypothesis
import matplotlib as mpl
import pytest

mpl.use("Agg")

import figure_data

# the same examples in every run, and a slow machine is not a failure; HYPOTHESIS_PROFILE=explore
# looks elsewhere
hypothesis.settings.register_profile("zivi", derandomize=True, deadline=None, max_examples=150)
hypothesis.settings.register_profile("explore", deadline=None, max_examples=1000)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "zivi"))


# while tests are collected nearly all that is made stays: to look at it takes a quarter of the time
gc.disable()


@pytest.hookimpl(trylast=True)
def pytest_collection_finish():
    """The collector need not look at what stays to the end: 9,000 tests and their libraries."""
    gc.enable()
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def no_figure_is_left_open():
    yield
    import matplotlib.pyplot as plt

    plt.close("all")
    if not plt.rcParams["axes.spines.top"]:  # an example uses the style of the figures
        plt.rcdefaults()


@pytest.fixture(autouse=True, scope="session")
def _ctrl_c_works():
    """A job in the background ignores SIGINT, and its Python then has no handler for it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True, scope="session")
def _pictures_of_examples_are_those_that_are_kept():
    with figure_data.watched():
        yield
