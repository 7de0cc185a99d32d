"""The page of the command line and the example files against what is accepted."""

import re
from functools import partial
from pathlib import Path

import pytest
from typer.testing import CliRunner

import zivi
from inside import (
    FILE_CONTROLLERS as CONTROLLERS,
    METHODS,
    files_file_keys as file_keys,
    flatten_keys,
)
from zivi import files
from zivi.cli import app
from zivi.files import FileError

pytest.importorskip("h5netcdf")

ROOT = Path(__file__).parents[1]
WRITTEN = (ROOT / "docs" / "command_line.md").read_text("utf-8")
PAGE = file_keys.insert(WRITTEN)
EXAMPLES = ROOT / "examples" / "files"
PREPARE = {
    "simulate": files.prepare_simulate,
    "mechanics": files.prepare_simulate,
    "tree": files.prepare_simulate,
    "control": files.prepare_control,
    "sweep": files.prepare_sweep,
}


HEADINGS = {"mechanics": "simulate, mechanical systems", "tree": "simulate, trees of bodies"}
"""The sections of the page that are not named after a command."""
COMMAND = {
    "mechanics": ("simulate", "--example-mechanics"),
    "tree": ("simulate", "--example-tree"),
}
"""The command that reads such a file, and its option that prints one."""


def table(heading):
    """Rows of the table below a heading: key, for what, unit, allowed, default."""
    section = PAGE.partition(f"### {heading}\n")[2].partition("\n### ")[0]
    for line in section.splitlines():
        if line.startswith("| `"):
            key, only, *cells, meaning = (cell.strip() for cell in line.strip("|").split(" | "))
            assert meaning
            for kind in only.split(", ") if only else [""]:
                yield key.strip("`"), kind, *cells


def documented(command):
    """Read the tables of the page as a user does, who follows links to tables of objects."""
    found = []
    for key, kind, unit, allowed, default in table(f"zivi {HEADINGS.get(command, command)}"):
        found.append((key, kind, unit, allowed, default))
        for linked, where in re.findall(r"see \[(\w+)\]\(#(\w+)\)", allowed):
            assert linked == where
            names = re.findall(r'"(\w+)"', allowed)
            fewer = dict(re.findall(r"of (\w+) only (\w+)", allowed))
            for own, variant, *cells in table(linked):
                last = own.removeprefix(f"{linked}.")
                if variant and (variant not in names or last != fewer.get(variant, last)):
                    continue
                found.append((f"{key}.{last}", variant, *cells))
    return found


def test_objects_have_one_table_each():
    told = [line for line in PAGE.splitlines() if line.startswith("| `")]
    assert len(set(told)) >= len(told) - 18  # t_span, y0, e: of each command
    assert sum("k in -k x" in line for line in told) == 1


@pytest.mark.parametrize("command", PREPARE)
def test_every_accepted_key_is_documented_once(command):
    listed = [(key, kind) for key, kind, *_ in documented(command)]
    accepted = [(row.path, row.variant) for row in flatten_keys(file_keys.COMMANDS[command])]
    assert sorted(listed) == sorted(accepted)
    assert len(set(listed)) == len(listed) > 15


def test_tables_of_keys_are_made_not_written():
    assert sorted(re.findall(r"^<!-- keys of (\w+) -->$", WRITTEN, re.MULTILINE)) == sorted(
        [*file_keys.COMMANDS, *file_keys.OBJECTS]
    )
    assert file_keys.HEAD not in WRITTEN
    with pytest.raises(KeyError, match="nothing"):
        file_keys.insert("<!-- keys of nothing -->\n")


@pytest.mark.parametrize("command", ["simulate", "control", "sweep"])
def test_keys_are_printed_with_those_of_their_objects(command):
    done = CliRunner().invoke(app, [command, "--keys"])
    assert done.exit_code == 0
    kinds = [it for it in PREPARE if COMMAND.get(it, (it,))[0] == command]
    told = set(re.findall(r"^\| `([^`]+)` \|", done.output, re.MULTILINE))
    for kind in kinds:
        assert {key for key, *_ in table(f"zivi {HEADINGS.get(kind, kind)}")} <= told
    # every link leads to a table
    linked = set(re.findall(r"\(#(\w+)\)", done.output))
    assert {f"# {name}" for name in [*kinds, *linked]} == set(
        re.findall(r"^# \w+$", done.output, re.MULTILINE)
    )


VALUES = {
    "tstops": "[1.0]",
    "force": "-1.0",
    "force_ref": "-1.0",
    "force_model": "-1.0",
    "noise": "[1e-3, 0]",
    "quantization": "[1e-3, 0]",
    "t_eval": "[0.5]",
    "u_limits": "[-99.0, 99.0]",
    "name": "'SwitchedRK'",
    "kind": "'list'",
    "solver": "'newton'",
    "branch": "'nearest'",
    "landing": "true",
    "shift": "true",
    "order": "5",
    "e": "0.5",
    "kappa": "0.5",
    "e_ref": "0.5",
    "kappa_ref": "0.5",
    "h": "1e-2",
    "rtol": "1e-3",
    "theta": "0.5",
    "gamma": "0.5",
    "max_impacts": "10",
    "flights": "'series'",
    "bound": "0.5",
    "y_ref0": "[1, 1]",
    "executor": "'threads'",
    "sampler": "'halton'",
    "log": "true",
    "V": "'9.81*u'",
    "system.friction.NAME": "['udot', 0.5]",
    "impact_law": "'poisson'",
    "paradox": "'impact'",
    "Q": "['cos(3*t) - 0.1*udot']",
}
BASES = {
    "simulate": {"t_span": "[0, 1]", "y0": "[1, 0]", "system.force": "-1.0", "system.e": "0.5"},
    "mechanics": {
        "t_span": "[0, 1]", "y0": "[[1], [0]]", "system.q": "['u']", "system.T": "'udot**2/2'",
    },
    "control": {
        "t_span": "[0, 0.1]", "y0": "[1, 0]", "system.force": "-1.0", "system.e": "0.5",
        "controller.name": "'TwistingTracker'", "controller.mu1": "3.0", "controller.mu2": "2.0",
        "controller.h": "1e-2",
    },
    "sweep": {"experiment": "'ball_rest_time'", "parameters.e": "[0.5]"},
    "tree": {"t_span": "[0, 1]", "y0": "[[0], [0]]"},
}  # fmt: skip
BODY = {"name": "'arm'", "axis": "[0, 1, 0]", "mass": "1.0", "inertia": "0.1"}
TREE_GAPS = {
    "limit": {"joint": "'arm'", "upper": "1.0"},
    "plane": {"body": "'arm'", "point": "[1, 0, 0]", "offset": "-2.0"},
    "ball": {"body": "'arm'", "point": "[1, 0, 0]", "radius": "0.1"},
}
SHAPES = {
    "ball": {"radius": "0.1"},
    "box": {"half_extents": "[1, 2, 3]"},
    "capsule": {"radius": "0.1", "half_length": "0.2"},
    "plane": {"normal": "[0, 0, 1]"},
}
OF_TREE = {
    "name": "'arm'", "parent": "'root'", "kind": "'slide'", "coordinate": "'turn'",
    "rotation": "[[0, -1, 0], [1, 0, 0], [0, 0, 1]]", "joint": "'arm'", "body": "'arm'",
    "other": "'root'", "lower": "-1.0", "offset": "-3.0",
    **dict.fromkeys(("position", "axis", "anchor", "com", "normal", "half_extents"), "[1, 2, 3]"),
    **dict.fromkeys(("point", "other_point", "center"), "[3, 0, 0.5]"),
    "first": "'tip'", "second": "'floor'", "mu": "0.2", "mu_static": "0.3", "share": "0.4",
}  # fmt: skip
LAWS = {
    "NewtonImpact": {"e": "0.5"},
    "SpeedDependentImpact": {"e0": "0.5", "v0": "1.0", "k": "0.2"},
    "RestitutionTable": {"v": "[0.5, 2.0]", "e": "[0.8, 0.6]"},
}
RANGE = {"start": "0.1", "stop": "0.5", "num": "2"}


def complete(command, key, kind):
    """Give a file with one further key and what it needs beside it."""
    given = dict(BASES[command])
    table, _, name = key.rpartition(".")
    if kind:
        tag = {
            "method": "method.name",
            "controller": "controller.name",
            "design": "design.kind",
            "system.e": "system.e.law",
        }
        given[tag[table]] = f"'{kind}'"
        if table == "method" and kind != "SwitchedRK":
            given["method.h"] = "1e-2"
        if kind == "sample":
            given |= {"parameters.e": "{ start = 0.1, stop = 0.9 }", "design.n": "4"}
    if table == "system.e":
        del given["system.e"]
        law = kind if kind in LAWS else "NewtonImpact"
        given["system.e.law"] = f"'{law}'"
        given |= {f"system.e.{it}": value for it, value in LAWS[law].items()}
    if key == "system.e" and command == "mechanics":
        given["system.gaps.floor"] = "'u'"
    if table == "system.friction" and command == "simulate":
        given["system.friction.limit"] = "1.0"
    if name == "NAME" and table in ("system.slips", "system.mu", "system.e_t"):
        given |= {"system.gaps.floor": "'u'", "system.slips.floor": "'udot'"}
        given |= {"system.mu.floor": "0.3", f"{table}.floor": GAPS[table]}
        return written(given)
    if key == "system.kappa":
        del given["system.e"]
    if table == "system.wall":
        given |= {"system.wall.amplitude": "0.1", "system.wall.omega": "1.0"}
    if table in ("system.force", "force_ref", "force_model"):
        given.pop(table, None)
    if table in ("t_eval", "parameters.NAME"):
        given.pop("parameters.e", None)
        given |= {f"{table}.{end}": value for end, value in RANGE.items()}
    if key == "workers":
        given["executor"] = "'processes'"
    if key.endswith("e_ref") and table == "controller":
        given["controller.name"] = f"'{kind}'"
    given.setdefault(key, VALUES.get(key, VALUES.get(name, "1")))
    return written(given)


def complete_tree(key, kind):
    """Give a file of a tree with one further key."""
    table, _, name = key.rpartition(".")
    given = dict(BASES["tree"])
    body, gap = dict(BODY), dict(TREE_GAPS[kind or "plane"]) if table == "system.gaps" else {}
    if table == "system.bodies":
        body[name] = OF_TREE.get(name, "1.0")
    elif gap:
        gap["kind"] = f"'{kind or 'plane'}'"
        if name != "kind":
            gap[name] = OF_TREE.get(name, "1.0")
    elif table.startswith(("system.shapes", "system.contacts")):
        return tree_with_shapes(table, name, kind, written(given))
    elif table == "system.parameters":
        given["system.parameters"] = "{ 'arm.mass' = 2.0 }"
    elif table in ("t_eval", "method"):
        if table == "method" and kind:
            given |= {"method.name": f"'{kind}'"}
        if kind and kind != "SwitchedRK":
            given["method.h"] = "1e-2"
        given |= {f"t_eval.{end}": value for end, value in RANGE.items()}
        given.setdefault(key, VALUES.get(name, "1"))
    else:
        given.setdefault(key, {"gravity": "[0, 0, -1]", "e": "0.5"}.get(name, VALUES.get(name)))
    tables = [("bodies", {"name": "'root'", "kind": "'fixed'"}), ("bodies", body)]
    tables += [("gaps", gap)] if gap else [("gaps", TREE_GAPS["plane"] | {"kind": "'plane'"})]
    lines = [f"[[system.{of}]]\n{written(it)}" for of, it in tables]
    return written(given) + "".join(lines)


def tree_with_shapes(table, name, kind, text):
    """Give a file of a tree whose arm has a shape above a floor."""
    of = kind if table == "system.shapes.NAME" and kind else "ball"
    shape = {"kind": f"'{of}'", **SHAPES[of]} | ({} if of == "plane" else {"body": "'arm'"})
    contact = {"first": "'tip'", "second": "'floor'"}
    if table == "system.contacts.e":
        law = kind if kind in LAWS else "NewtonImpact"
        contact |= {"e.law": f"'{law}'", **{f"e.{it}": value for it, value in LAWS[law].items()}}
        contact.setdefault(f"e.{name}", "0.9")
    elif table == "system.contacts":
        contact.setdefault(name, OF_TREE.get(name, "0.5"))
        contact |= {"mu": "0.2", "name": "'tips'"} if name in ("mu_static", "name") else {}
    elif name != "kind":
        shape[name] = OF_TREE.get(name, "0.5")
    body = {"name": "'arm'", "kind": "'free'", "mass": "1.0", "inertia": "0.1"}
    tables = [("[[system.bodies]]", body), ("[system.shapes.tip]", shape)]
    if of != "plane":
        tables += [("[system.shapes.floor]", {"kind": "'plane'"}), ("[[system.contacts]]", contact)]
    return text + "".join(f"{head}\n{written(it)}" for head, it in tables)


def written(given):
    """Write a file, with names that are the user's."""
    told = {
        re.sub(
            r"(parameters|fixed|gaps|friction)\.NAME", lambda m: f"{m[1]}.{NAMES[m[1]]}", path
        ): value
        for path, value in given.items()
    }
    return "".join(f"{path} = {value}\n" for path, value in told.items())


NAMES = {"parameters": "e", "fixed": "g", "gaps": "floor", "friction": "guide"}
GAPS = {"system.slips": "'udot - 1'", "system.mu": "[0.3, 0.4]", "system.e_t": "0.5"}
WHOLE_TABLES = ("system", "system.wall", "system.gaps", "system.parameters", "method", "controller",
                "system.slips", "system.mu", "system.e_t", "system.friction", "system.bodies",
                "system.shapes", "system.shapes.NAME", "system.contacts", "parameters",
                "parameters.NAME", "fixed", "design")  # fmt: skip


@pytest.mark.parametrize(
    ("command", "key", "kind"),
    [(command, key, kind) for command in PREPARE for key, kind, *_ in documented(command)],
)
def test_every_documented_key_is_accepted(command, key, kind, tmp_path):
    path = tmp_path / "file.toml"
    if key in WHOLE_TABLES:  # by the keys in it
        assert any(other.startswith(f"{key}.") for other, *_ in documented(command))
        return
    path.write_text((complete_tree if command == "tree" else partial(complete, command))(key, kind))
    PREPARE[command](path)
    wrong = path.read_text().replace(f"{key.rpartition('.')[2]} =", "wrong_key =")
    if "NAME" not in key:
        path.write_text(wrong)
        with pytest.raises(FileError, match=r"wrong_key is not a known key|is missing"):
            PREPARE[command](path)


def number(text):
    try:
        return float(text)
    except ValueError:
        return text.strip('"')


def test_documented_defaults_are_those_of_the_library():
    settings = {
        "SwitchedRK": zivi.SwitchedRK(),
        "ThetaGamma": zivi.ThetaGamma(h=1.0),
        "MoreauJean": zivi.MoreauJean(h=1.0),
        "ExplicitEuler": zivi.ExplicitEuler(h=1.0),
    }
    checked = 0
    for command in ("simulate", "control"):
        for key, kind, _, _, default in documented(command):
            table, _, name = key.rpartition(".")
            if table == "method" and kind and not default.startswith(("**", "from")):
                assert number(default) == getattr(settings[kind], name), key
                checked += 1
            elif table in ("system.force", "force_ref", "force_model"):
                assert number(default) == getattr(zivi.LinearForce(), name), key
                checked += 1
            elif table == "system.wall" and not default.startswith("**"):
                assert number(default) == getattr(zivi.HarmonicWall(1.0, 1.0), name), key
                checked += 1
    law = zivi.TwistingTracker(3, 2, h=1, e=0.5)
    defaults = {key: default for key, _, _, _, default in documented("control")}
    assert number(defaults["controller.depth"]) == law.settings["depth"]
    assert number(defaults["controller.branch"]) == law.branch
    assert checked > 30


def test_all_settings_of_the_library_are_there():
    """What Python takes, a file takes, or it is left out on purpose."""
    import dataclasses
    import inspect

    for name, keys in METHODS.items():
        fields = {field.name for field in dataclasses.fields(getattr(zivi, name))}
        assert {key.name for key in keys} == fields
        method = getattr(zivi, name)
        needed = {key.name for key in keys if key.default is None}
        assert needed == ({"h"} if name != "SwitchedRK" else set())
        assert method(**dict.fromkeys(needed, 1e-3)) is not None
    for name, keys in CONTROLLERS.items():
        taken = set(inspect.signature(getattr(zivi, name).__new__).parameters) - {"cls"}
        assert {key.name for key in keys} == taken
    taken = set(inspect.signature(zivi.simulate_closed_loop).parameters)
    keys = {key.name for key in file_keys.COMMANDS["control"]}
    always = {"progress", "events", "kicks", "dense_output", "misplaced", "slowest"}
    assert taken - keys == always | {"t_eval", "reference", "observer", "disturbance"}
    taken = set(inspect.signature(zivi.simulate).parameters)
    for command in ("simulate", "mechanics", "tree"):
        keys = {key.name for key in file_keys.COMMANDS[command]}
        assert taken - keys == always | {"samples"}
    taken = set(inspect.signature(zivi.symbolic.system).parameters)
    (system,) = (key for key in file_keys.COMMANDS["mechanics"] if key.name == "system")
    others = {"qdot", "compiler", "inputs", "contact", "states", "equalities"}
    assert taken - {key.name for key in system.kind.keys} == others


@pytest.mark.parametrize("command", PREPARE)
def test_examples(command, tmp_path, monkeypatch):
    name, option = COMMAND.get(command, (command, "--example"))
    told = CliRunner().invoke(app, [name, option])
    assert told.exit_code == 0
    kept = EXAMPLES / f"{command}.toml"
    assert told.output == kept.read_text("utf-8")
    monkeypatch.chdir(tmp_path)
    Path("FILE.toml").write_text(told.output)
    ended = CliRunner().invoke(app, [name, "FILE.toml"])
    assert ended.exit_code == 0, ended.output
    # each setting in a comment works as well, in place of the one that it is an example for
    together = re.search(r"^# \[.*?(\n\n|\Z)", told.output, re.MULTILINE | re.DOTALL)
    text = told.output if together is None else told.output.replace(together[0], "")
    for key, value in re.findall(r"^# (\w+) = (.*)$", text, re.MULTILINE):
        line = f"{key} = {value}"
        changed = re.sub(rf"^{key} = .*$", "", text, flags=re.MULTILINE)
        Path("FILE.toml").write_text(changed.replace(f"# {line}", line))
        PREPARE[command](Path("FILE.toml"))


def test_tables_in_comments_of_examples(tmp_path):
    text = (EXAMPLES / "simulate.toml").read_text()
    path = tmp_path / "FILE.toml"
    path.write_text(re.sub(r"^# (\[system.wall\]|amplitude|omega)", r"\1", text, flags=re.M))
    assert (
        "wall=HarmonicWall(amplitude=0.01, omega=60.0"
        in repr(files.prepare_simulate(path).run().config)
        or files.prepare_simulate(path).run().config["wall"]["omega"] == 60.0
    )
    text = (EXAMPLES / "sweep.toml").read_text()
    text = re.sub(r"^# (\[design\]|kind|n =|sampler|seed)", r"\1", text, flags=re.M)
    path.write_text(re.sub(r", num = \d+", "", text))
    assert len(files.prepare_sweep(path).design) == 64


def test_what_the_page_says():
    for command in {*PREPARE} - {*COMMAND} | {"show"}:
        told = CliRunner().invoke(app, [command, "--help"]).output
        for option in re.findall(r"--[a-z-]+", told):
            assert f"`{option}" in PAGE or option == "--help", option
    shown = re.search(r"```text\n(.*?)```", PAGE, re.DOTALL)[1].splitlines()
    for line in shown:
        assert line.startswith("ball.toml: ")


def test_the_mistakes_on_the_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("ball.toml").write_text(
        "t_span = [0, 1]\ny0 = [-1.0, 0]\n[system]\nforce = 1\ne = 0.5\n"
        "wall = { amplitude = 1 }\n[method]\nrtoll = 1\n"
    )
    with pytest.raises(FileError) as caught:
        files.prepare_simulate(Path("ball.toml"))
    shown = re.search(r"```text\n(.*?)```", PAGE, re.DOTALL)[1].splitlines()
    assert sorted(str(caught.value).splitlines()) == sorted(shown)


def test_sections_of_the_page_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for line in re.search(r"```sh\n(.*?)```", PAGE, re.DOTALL)[1].splitlines():
        words = line.partition("#")[0].split()
        assert words[0] == "zivi"
        arguments = words[1 : words.index(">") if ">" in words else None]
        ended = CliRunner().invoke(app, arguments)
        assert ended.exit_code == 0, ended.output
        if ">" in words:
            Path(words[-1]).write_text(ended.output)
    assert Path("ball.png").exists()
    assert files.load("ball.nc").success
