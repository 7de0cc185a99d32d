"""The command line: ``zivi simulate``, ``control``, ``sweep``, ``fit``, ``show`` and ``paper``."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

import zivi._zivi as _zivi
from zivi.base.extras import needed
from zivi.lab.command import lab

# what reads files comes with nearly all of the library, for which --help need not wait: commands
# import it themselves

app = typer.Typer(
    help="Mechanical systems with impacts, straight through the Zeno point.",
    no_args_is_help=True,
    rich_markup_mode=None,  # plain help: rich takes longer to import than all else
)

File = Annotated[Path, typer.Argument(help="What to compute, in TOML; see --example.")]
Out = Annotated[
    Path | None, typer.Option(help="Where the result goes; by default beside the file.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace a result that is there.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no table.")]
Json = Annotated[bool, typer.Option("--json", help="Print the summary as one line of JSON.")]


def _version(wanted: bool) -> None:
    if wanted:
        from zivi.files.commands import say

        say(f"zivi {_zivi.__version__}")
        raise typer.Exit


def _show_example(command: str) -> Callable[[bool], None]:
    def print_example(wanted: bool) -> None:
        if wanted:
            from zivi.files import commands
            from zivi.files.commands import say

            say(commands.example_file(command), end="")
            raise typer.Exit

    return print_example


def _show_keys(*kinds: str) -> Callable[[bool], None]:
    def print_keys(wanted: bool) -> None:
        if wanted:
            from zivi.files import file_keys
            from zivi.files.commands import say

            say(file_keys.keys_as_text(*kinds), end="")
            raise typer.Exit

    return print_keys


def _show_experiments(wanted: bool) -> None:
    if wanted:
        from zivi.files import summary
        from zivi.files.commands import show_table

        show_table(summary.experiments_table())
        raise typer.Exit


@contextlib.contextmanager
def _reported_errors() -> Iterator[None]:
    """Print one line per error and exit with the matching code."""
    from zivi.files import FileError, commands
    from zivi.files.commands import echo_error

    try:
        yield
    except KeyboardInterrupt:
        raise typer.Exit(commands.INTERRUPTED) from None
    except MemoryError:
        echo_error("zivi: the memory is not enough")
        raise typer.Exit(commands.EARLY) from None
    except RuntimeError as error:  # of a study: another run writes to it, or nothing can compute
        echo_error(f"zivi: {error}")
        raise typer.Exit(commands.EARLY) from None
    except (FileError, OSError, ImportError) as error:
        echo_error(f"{error}" if isinstance(error, FileError) else f"zivi: {error}")
        raise typer.Exit(commands.WRONG) from None


@app.callback()
def command_line(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Mechanical systems with impacts, straight through the Zeno point."""


Example = "Print an example file."
Keys = "List the keys of a file."


@app.command("simulate")
def simulate_file(
    file: File,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
    as_json: Json = False,
    example: Annotated[
        bool,
        typer.Option("--example", callback=_show_example("simulate"), is_eager=True, help=Example),
    ] = False,
    example_mechanics: Annotated[
        bool,
        typer.Option(
            "--example-mechanics",
            callback=_show_example("mechanics"),
            is_eager=True,
            help="Print an example file of a mechanical system.",
        ),
    ] = False,
    example_tree: Annotated[
        bool,
        typer.Option(
            "--example-tree",
            callback=_show_example("tree"),
            is_eager=True,
            help="Print an example file of a tree of bodies.",
        ),
    ] = False,
    keys: Annotated[
        bool,
        typer.Option(
            "--keys", callback=_show_keys("simulate", "mechanics", "tree"), is_eager=True, help=Keys
        ),
    ] = False,
) -> None:
    """Simulate one system from a file; write a netCDF file.

    Exit code 0 if the end was reached, 1 if the run ended early (it is kept as far as it went), 2
    for a bad file, 130 for Ctrl-C (kept as well).
    """
    from zivi.files import commands, prepare_simulate

    with _reported_errors():
        code = commands.single(
            prepare_simulate, file, out, force=force, quiet=quiet, as_json=as_json
        )
    raise typer.Exit(code)


@app.command("control")
def control_file(
    file: File,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
    as_json: Json = False,
    example: Annotated[
        bool,
        typer.Option("--example", callback=_show_example("control"), is_eager=True, help=Example),
    ] = False,
    keys: Annotated[
        bool, typer.Option("--keys", callback=_show_keys("control"), is_eager=True, help=Keys)
    ] = False,
) -> None:
    """Simulate one closed loop from a file; write a netCDF file.

    Exit code 0 if the end was reached, 1 if the run ended early (it is kept as far as it went), 2
    for a bad file, 130 for Ctrl-C (kept as well).
    """
    from zivi.files import commands, prepare_control

    with _reported_errors():
        code = commands.single(
            prepare_control, file, out, force=force, quiet=quiet, as_json=as_json
        )
    raise typer.Exit(code)


@app.command("sweep")
def sweep_file(
    file: File,
    out: Out = None,
    force: Annotated[bool, typer.Option("--force", help="Remove a study that is there.")] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on although the version of zivi differs.")
    ] = False,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Compute failed points again.")
    ] = False,
    quiet: Quiet = False,
    as_json: Json = False,
    example: Annotated[
        bool,
        typer.Option("--example", callback=_show_example("sweep"), is_eager=True, help=Example),
    ] = False,
    experiments: Annotated[
        bool,
        typer.Option(
            "--experiments", callback=_show_experiments, is_eager=True, help="List the experiments."
        ),
    ] = False,
    keys: Annotated[
        bool, typer.Option("--keys", callback=_show_keys("sweep"), is_eager=True, help=Keys)
    ] = False,
) -> None:
    """Compute a study, or its missing points, and write a Zarr folder.

    Exit code 0 if all points are done, 1 if some failed or the study ended early, 2 for a bad
    file, 130 for Ctrl-C. The same command continues where it stopped.
    """
    from zivi.files import commands

    with _reported_errors():
        code = commands.study(
            file,
            out,
            force=force,
            resume=resume,
            retry_failed=retry_failed,
            quiet=quiet,
            as_json=as_json,
        )
    raise typer.Exit(code)


@app.command("fit")
def fit_file(
    file: File,
    out: Out = None,
    force: Force = False,
    quiet: Quiet = False,
    as_json: Json = False,
    example: Annotated[
        bool,
        typer.Option("--example", callback=_show_example("fit"), is_eager=True, help=Example),
    ] = False,
    keys: Annotated[
        bool, typer.Option("--keys", callback=_show_keys("fit"), is_eager=True, help=Keys)
    ] = False,
) -> None:
    """Fit parameters of a system to data; write a netCDF file with the estimates.

    Exit code 0 if the fit converged, 1 if it did not, 2 for a bad file, 130 for Ctrl-C (the best
    of what was computed is kept).
    """
    from zivi.files import commands

    with _reported_errors():
        code = commands.fit_to_data(file, out, force=force, quiet=quiet, as_json=as_json)
    raise typer.Exit(code)


@app.command()
def show(
    result: Annotated[Path, typer.Argument(help="A netCDF file or the folder of a study.")],
    out: Annotated[
        Path | None, typer.Option(help="The picture; by default beside the result, .png.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a picture.")] = False,
    window: Annotated[bool, typer.Option("--window", help="Open a window instead.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No table.")] = False,
    as_json: Json = False,
) -> None:
    """Draw a result and sum it up; exit code 2 if it cannot be read."""
    from zivi.files import commands

    if not window:
        import matplotlib as mpl

        mpl.use("Agg")
    with _reported_errors():
        code = commands.picture(
            result, out, force=force, window=window, quiet=quiet, as_json=as_json
        )
    raise typer.Exit(code)


@app.command()
def paper(
    out: Annotated[Path, typer.Option(help="Folder for the figures, their data and the tables.")],
    only: Annotated[
        list[str] | None, typer.Option(help="A stage to run alone; may be given repeatedly.")
    ] = None,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="No progress, no tables: the last line alone.")
    ] = False,
) -> None:
    """Write the figures and the numbers of the paper.

    The stages are ball, regulator, tracker (figures and checked numbers), linearisation,
    chattering, robustness and rest (what was measured). The last line counts the checked numbers
    that agree. Exit code 1 if one is off, 2 for a stage that does not exist.
    """
    from zivi.files import FileError

    with _reported_errors():
        needed("matplotlib", "the figures of the paper").use("Agg")
        from zivi.paper.write import check_stages, reproduce

        try:
            check_stages(only)
        except ValueError as error:
            raise FileError(f"{error}") from None
        agree = reproduce(out, only, quiet=quiet)
    raise typer.Exit(0 if agree else 1)


@app.command()
def fmu(
    out: Annotated[Path, typer.Option(help="Folder for the FMUs; those of the same names go.")],
    file: Annotated[
        Path | None,
        typer.Argument(
            help="A tree or mechanism instead: TOML of zivi simulate, MJCF (.xml) or URDF (.urdf)."
        ),
    ] = None,
    model: Annotated[
        list[str] | None,
        typer.Option(help="mass, regulator, tracker, loop or observer; may be given repeatedly."),
    ] = None,
    fmi: Annotated[list[int] | None, typer.Option(help="2 or 3; by default both.")] = None,
    name: Annotated[
        str | None, typer.Option(help="Of the unit of a file; by default MechanicalSystem.")
    ] = None,
    gap: Annotated[
        list[str] | None,
        typer.Option(help="Of MJCF, URDF: a joint, or a pair of geoms, 'ball,floor'; repeatedly."),
    ] = None,
    e: Annotated[
        list[float] | None,
        typer.Option("--e", help="Restitution of these gaps: of all, or repeatedly; default 0."),
    ] = None,
    q0: Annotated[
        list[float] | None,
        typer.Option(help="Their coordinates at the start, repeatedly; default 0."),
    ] = None,
    ignore_friction: Annotated[
        bool, typer.Option("--ignore-friction", help="Leave out friction of these gaps.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Write FMUs: zivi in Simulink and other tools, without Python.

    Exit code 2 if a model, version or binary does not exist or a file cannot be read.
    """
    from zivi.files import FileError, commands, mechanism_of
    from zivi.files.commands import echo_error, say
    from zivi.fmu import export_fmu

    paths = []
    with _reported_errors():
        try:
            if file is None:
                if name or gap or e or q0 or ignore_friction:
                    raise FileError(
                        "zivi: --name, --gap, --e, --q0, --ignore-friction are for a FILE"
                    )
                paths = export_fmu(out, model or None, fmi or None)
            else:
                if model:
                    raise FileError("zivi: --model is for zivi's own models, without a FILE")
                friction = "ignore" if ignore_friction else "refuse"
                system, y0 = mechanism_of(
                    file, gaps=gap or (), e=e or (), q0=q0 or (), friction=friction
                )
                paths = export_fmu(out, system, fmi or None, y0=y0, name=name)
        except FileError:
            raise
        except (ValueError, TypeError, NotImplementedError) as error:
            echo_error(f"zivi: {error}")
    if not quiet:
        for path in paths:
            say(str(path))
    raise typer.Exit(0 if paths else commands.WRONG)


app.command()(lab)
