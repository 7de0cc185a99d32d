"""Functions of studies that use something else under the same text, or the same in all that counts.

Each family is the source of a module with ``{v}``, the value that it uses, and ``{c}``, what counts
for nothing; ``f(x)`` computes ``v * x``. Modules of a family are one study if ``v`` is the same.
"""

from __future__ import annotations

import importlib.util
import itertools
import sys
from pathlib import Path

FAMILIES = {
    "a global": """
        K = {v}
        def f(x): return K * x
        """,
    "a global of a global": """
        A = {v}
        B = [{{"a": A, "b": "text"}}, (1, 2)]
        def f(x): return B[0]["a"] * x
        """,
    "a global of another kind": """
        K = {{1: 1.0, 2: 2}}[{v}] if {v} < 3 else {v}
        def f(x): return K * x
        """,
    "an array": """
        import numpy as np
        K = np.full(100, {v}.0)
        def f(x): return K[50] * x
        """,
    "a helper": """
        def helper(x):
            # {c}
            return {v} * x
        def f(x): return helper(x)
        """,
    "a helper of a helper": """
        def third(x): return {v} * x
        def second(x): return third(x)
        def f(x): return second(x)
        """,
    "a global of a helper": """
        K = {v}
        def helper(x): return K * x
        def f(x): return helper(x)
        """,
    "helpers that call each other": """
        def even(x, n): return {v} * x if n == 0 else odd(x, n - 1)
        def odd(x, n): return even(x, n - 1)
        def f(x): return even(x, 4)
        """,
    "a default of a helper": """
        def helper(x, k={v}): return k * x
        def f(x): return helper(x)
        """,
    "a keyword default": """
        def helper(x, *, k={v}): return k * x
        def f(x): return helper(x)
        """,
    "a default": """
        K = {v}
        def f(x, k=K): return k * x
        """,
    "a closure": """
        def make(k):
            def inner(x): return k * x
            return inner
        f = make({v})
        """,
    "a closure in a global": """
        def make(k): return lambda x: k * x
        g = make({v})
        def f(x): return g(x)
        """,
    "a lambda": """
        g = lambda x: {v} * x
        def f(x): return g(x)
        """,
    "a nested function": """
        K = {v}
        def f(x):
            def inner(): return K * x
            return inner()
        """,
    "a comprehension": """
        K = {v}
        def f(x): return sum([K * y for y in [x]])
        """,
    "a class attribute": """
        class Settings:
            k = {v}
        def f(x): return Settings.k * x
        """,
    "a class attribute of a base": """
        class Base:
            k = {v}
        class Settings(Base): pass
        def f(x): return Settings.k * x
        """,
    "a method": """
        class Model:
            def at(self, x): return {v} * x
        def f(x): return Model().at(x)
        """,
    "a static method": """
        class Model:
            @staticmethod
            def at(x): return {v} * x
        def f(x): return Model.at(x)
        """,
    "a property": """
        class Model:
            @property
            def k(self): return {v}
        def f(x): return Model().k * x
        """,
    "a class attribute of a callable": """
        class Model:
            k = {v}
            def __call__(self, x): return self.k * x
        f = Model()
        """,
    "a method of a callable": """
        class Model:
            def k(self): return {v}
            def __call__(self, x): return self.k() * x
        f = Model()
        """,
    "a class attribute of a method's object": """
        class Model:
            k = {v}
            def at(self, x): return self.k * x
        f = Model().at
        """,
    "an object in a global": """
        class Model:
            def __init__(self, k): self.k = k
        M = Model({v})
        def f(x): return M.k * x
        """,
    "an object with slots": """
        class Model:
            __slots__ = ("k",)
            def __init__(self, k): self.k = k
        M = Model({v})
        def f(x): return M.k * x
        """,
    "a data class": """
        import dataclasses
        @dataclasses.dataclass
        class Model:
            k: float = {v}
            name: str = "a"
        def f(x): return Model().k * x
        """,
    "a factory of a data class": """
        import dataclasses
        @dataclasses.dataclass
        class Model:
            k: list = dataclasses.field(default_factory=lambda: [{v}])
        def f(x): return Model().k[0] * x
        """,
    "an enumeration": """
        import enum
        class Kind(enum.Enum):
            A = {v}
            B = -1
        def f(x): return Kind.A.value * x
        """,
    "a named tuple": """
        from typing import NamedTuple
        class Model(NamedTuple):
            k: float = {v}
        def f(x): return Model().k * x
        """,
    "an object that wraps": """
        import functools
        class Scaled:
            def __init__(self, g, k):
                functools.update_wrapper(self, g)
                self.k = k
            def __call__(self, x): return self.k * self.__wrapped__(x)
        f = Scaled(lambda x: x, {v})
        """,
    "an object that wraps, as a decorator": """
        import functools
        class Scaled:
            def __init__(self, k): self.k = k
            def __call__(self, g): return Bound(self.k, g)
        class Bound:
            def __init__(self, k, g):
                functools.update_wrapper(self, g)
                self.k, self.g = k, g
            def __call__(self, x): return self.k * self.g(x)
        @Scaled({v})
        def f(x): return x
        """,
    "a decorator": """
        import functools
        def scaled(k):
            def around(g):
                @functools.wraps(g)
                def inner(x): return k * g(x)
                return inner
            return around
        @scaled({v})
        def f(x): return x
        """,
    "a decorated helper": """
        import functools
        def scaled(k):
            def around(g):
                @functools.wraps(g)
                def inner(x): return k * g(x)
                return inner
            return around
        @scaled({v})
        def helper(x): return x
        def f(x): return helper(x)
        """,
    "a cached helper": """
        import functools
        @functools.lru_cache
        def helper(x): return {v} * x
        def f(x): return helper(x)
        """,
    "a cached function": """
        import functools
        K = {v}
        @functools.cache
        def f(x): return K * x
        """,
    "a part": """
        import functools
        def scaled(k, x): return k * x
        f = functools.partial(scaled, {v})
        """,
    "a part in a global": """
        import functools
        def scaled(k, x): return k * x
        g = functools.partial(scaled, k={v})
        def f(x): return g(x=x)
        """,
    "a table of functions": """
        G = {{"a": lambda x: {v} * x, "b": lambda x: x}}
        def f(x): return G["a"](x)
        """,
    "an attribute of a function": """
        def helper(x): return helper.k * x
        helper.k = {v}
        def f(x): return helper(x)
        """,
    "a name in a text": """
        K = {v}
        def f(x): return globals()["K"] * x
        """,
    "beside what changes": """
        import logging, threading, time
        LOG, LOCK, STARTED = logging.getLogger("a"), threading.Lock(), time.monotonic()
        K, N, SEEN = {v}, 0, {{}}
        def f(x):
            global N
            with LOCK:
                N += 1
                SEEN[x] = N
                LOG.debug("%s", x)
            return K * x
        """,
    "a counter beside": """
        class Counted:
            def __init__(self, k): self.k, self.n = k, 0
            def __call__(self, x):
                self.n += 1
                return self.k * x
        f = Counted({v})
        """,
    "a counter in a closure": """
        def make(k):
            n = 0
            def inner(x):
                nonlocal n
                n += 1
                return k * x
            return inner
        f = make({v})
        """,
    "a set of texts": """
        K = {{"a", "b", "c", "{v}"}}
        def f(x): return int(max(K - {{"a", "b", "c"}})) * x
        """,
    "a memory in a closure": """
        def remembered(g):
            known = {{}}
            def inner(x):
                if x not in known:
                    known[x] = g(x)
                return known[x]
            return inner
        @remembered
        def helper(x): return {v} * x
        def f(x): return helper(x)
        """,
}
"""Sources of modules."""

VALUES = (3, 5, 7, 11, 13)
IDLE = ("nothing", "a comment that says more")


def source(family: str, value: int, idle: str) -> str:
    """Give the source of a module."""
    lines = FAMILIES[family].strip("\n").splitlines()
    text = "\n".join(line[8:] for line in lines)
    unused = f"\nUNUSED = {idle!r}  # {idle}\ndef unused(): return UNUSED\n"
    return text.format(v=value, c=idle) + unused


def imported(folder: Path, family: str, value: int, idle: str, name: str = "studied"):
    """Import a module of a family under one name."""
    sys.modules.pop(name, None)
    file = folder / f"{value}-{IDLE.index(idle)}-{list(FAMILIES).index(family)}" / f"{name}.py"
    file.parent.mkdir(exist_ok=True)
    file.write_text(source(family, value, idle))
    spec = importlib.util.spec_from_file_location(name, file)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def told(folder: Path) -> dict[tuple[str, int, str], tuple[str, str]]:
    """Tell what all studies are, before and after the function is called."""
    from inside import identity, points

    design, found = points(x=[1.0, 2.0]), {}
    for family, value, idle in itertools.product(FAMILIES, VALUES, IDLE):
        function = imported(folder, family, value, idle).f
        before = identity(function, design, {}, None, None, faithful=True)
        assert [function(1.0), function(2.0)] == [value, 2 * value], family
        after = identity(function, design, {}, None, None, faithful=True)
        found[family, value, idle] = (repr(before), repr(after))
    return found
