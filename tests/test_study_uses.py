"""A study is told by what its function uses: helpers, globals, classes, closures, decorators."""

import functools
import itertools
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import study_pairs
import zivi
from inside import digest, function_state, is_local, source_digest, unformatted, used, uses

pytest.importorskip("zarr", reason="the extra 'study' is not installed")


pytestmark = pytest.mark.xdist_group("study uses")


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pairs")
    program = (
        "import pathlib, sys, study_pairs\nprint(repr(study_pairs.told(pathlib.Path(sys.argv[1]))))"
    )
    tests = str(Path(__file__).parent)
    path = os.pathsep.join([tests, *filter(None, sys.path)])
    other = subprocess.Popen(
        # files of its own: both write them at the same time
        [sys.executable, "-c", program, tmp_path_factory.mktemp("there")],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONHASHSEED": "5", "PYTHONPATH": path},
    )
    here = study_pairs.told(folder)
    there = eval(other.communicate()[0])
    assert other.returncode == 0
    return here, there


@pytest.mark.slow
@pytest.mark.parametrize("family", study_pairs.FAMILIES)
def test_studies_are_told_apart_by_what_their_functions_use(family, told):
    here, there = told
    same = {}
    for value, idle in itertools.product(study_pairs.VALUES, study_pairs.IDLE):
        same.setdefault(value, set()).update(here[family, value, idle])
        same[value].update(there[family, value, idle])
    # before and after the call, with another comment, in another process: one study
    assert [len(it) for it in same.values()] == [1] * len(same)
    # with another value: another one
    assert len(set.union(*same.values())) == len(same)


@pytest.mark.parametrize(
    "family", ["a global", "a helper of a helper", "a class attribute", "an object that wraps"]
)
def test_a_study_whose_function_uses_something_else_does_not_go_on(family, tmp_path):
    def sweep(value, **more):
        function = study_pairs.imported(tmp_path, family, value, "nothing").f
        return zivi.sweep(function, {"x": [1.0, 2.0]}, out=tmp_path / "a", **more)

    pytest.importorskip("pyarrow")
    for _ in range(2):
        assert sweep(3).value.values.tolist() == [3.0, 6.0]
    with pytest.raises(ValueError, match=r"has another study: what the function (uses|holds)"):
        sweep(5)


def test_a_store_with_older_digests_is_read_and_goes_on_if_the_user_insists(tmp_path):
    import json

    pytest.importorskip("pyarrow")
    function = study_pairs.imported(tmp_path, "a helper", 3, "nothing").f
    call = {"function": function, "points": {"x": [1.0]}, "out": tmp_path / "a"}
    zivi.sweep(**call)
    head = json.loads((tmp_path / "a" / "zarr.json").read_text())
    config = json.loads(head["attributes"]["config"])
    del config["uses"], config["digests"]
    config["held"] = "of another kind"
    head["attributes"]["config"] = json.dumps(config)
    (tmp_path / "a" / "zarr.json").write_text(json.dumps(head))
    assert zivi.open_study(tmp_path / "a").value.values.tolist() == [3.0]
    with pytest.raises(ValueError, match=r"the version of the digests.*: None there, 2 here"):
        zivi.sweep(**call)
    assert zivi.sweep(**call, resume=True).complete


def test_arrays_of_one_size_and_another_shape():
    import numpy as np

    ones = [np.ones((2, 3)), np.ones((3, 2)), np.ones(6), np.ones((2, 3), np.float32)]
    assert len({digest(it) for it in ones}) == 4
    assert len({digest({"a": [it]}) for it in ones}) == 4


K = 3
LOCK = threading.Lock()


def helper(x):
    return K * x


def plain(x):
    return 2 * x


def with_helper(x):
    with LOCK:
        return helper(x)


def recursive(n):
    return n * recursive(n - 1) if n else 1


def missing(x):
    return not_there(x)  # noqa: F821


def from_a_library(x):
    return functools.reduce(max, [x])


def imports(x):
    import study_pairs

    return len(study_pairs.VALUES) * x


def test_what_a_function_uses():
    assert list(used(plain)) == []
    assert [name for name, _ in used(with_helper)] == ["LOCK", "helper"]
    assert [name for name, _ in used(recursive)] == ["recursive"]
    assert list(used(missing)) == [("not_there", "no such name")]
    assert list(used(from_a_library)) == [("functools", functools)]
    assert "VALUES = (3, 5" in dict(used(imports))["import study_pairs"]
    for function in (plain, len, functools.partial(plain, x=1)):
        assert uses(function) is None
    for function in (with_helper, recursive, missing, imports, functools.partial(helper)):
        assert uses(function) == uses(function) is not None


def test_a_global_is_looked_at_when_it_is_asked(monkeypatch):
    before = uses(with_helper), digest(with_helper), digest({"f": [helper]})
    monkeypatch.setattr(sys.modules[__name__], "K", 4)
    after = uses(with_helper), digest(with_helper), digest({"f": [helper]})
    assert not set(before) & set(after)
    monkeypatch.undo()
    assert (uses(with_helper), digest(with_helper), digest({"f": [helper]})) == before
    monkeypatch.delattr(sys.modules[__name__], "K")
    assert uses(with_helper) not in (before[0], after[0])


def test_the_text_of_a_cached_function_counts():
    one, other = functools.cache(plain), functools.cache(helper)
    assert source_digest(one) == source_digest(plain) != source_digest(other)
    assert function_state(one) is function_state(plain) is None
    assert uses(other) == uses(helper)


def test_libraries_count_by_name():
    import numpy as np

    class Own:
        pass

    assert [is_local(it) for it in (np, np.mean, Path, zivi, zivi.simulate, int)] == [False] * 6
    assert [is_local(it) for it in (Own, helper, study_pairs)] == [True] * 3


def test_layout_and_comments_do_not_count():
    one = "    def f(x):  # a comment\n        return (1 +\n            x)\n"
    assert unformatted(one) == unformatted("def f(x): return 1+x") == "def f(x):\n    return 1 + x"
    assert unformatted("no python (") == "no python ("
