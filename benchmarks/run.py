"""Run all benchmarks and write `benchmarks/results/ball.md` (`make bench`)."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import bench_ball
import bench_batch
import bench_control
import bench_flights
import bench_mechanics
import bench_vi
import cball
import instructions
import methods
import report
import siconos_peer
import waits

PAGE = Path(__file__).resolve().parent / "results" / "ball.md"


def _compiler() -> str:
    version = subprocess.run(
        [cball.compiler() or "cc", "-dumpfullversion"], capture_output=True, text=True
    )
    return f"C compiler version {version.stdout.strip() or 'unknown'}"


def _say(what: str) -> None:
    print(f"bench: {what} ...", file=sys.stderr, flush=True)


def main() -> None:
    with tempfile.TemporaryDirectory() as directory:
        _say("compiling the C loop")
        builds = cball.build(Path(directory))
        plain = builds[0]
        _say("comparing results")
        grids = [(4.0, 4000), *((t1, bench_ball.STEPS) for t1 in bench_ball.SCENES.values())]
        agreements = [bench_ball.agreement(plain, t1, steps) for t1, steps in grids]
        for it in agreements:
            it.check()
        scenes = {}
        for name, t1 in bench_ball.SCENES.items():
            _say(f"timing beside C, {name}")
            scenes[name] = bench_ball.scene(builds, t1)
        _say("timing the kinds of force")
        forces = bench_ball.forces()
        _say("timing Siconos, if there is one")
        peers = siconos_peer.measure(plain)
        beside = siconos_peer.zivi_beside()
    _say("counting instructions")
    counts = instructions.count()
    figures = report.Figures(
        agreements=agreements,
        scenes=scenes,
        forces=forces,
        peers=peers,
        zivi_beside=beside,
        instructions=counts,
        compiler=_compiler(),
    )
    PAGE.write_text(report.page(figures))
    print(report.page(figures))
    print(bench_vi.write())
    print(bench_control.write())
    print(methods.write())
    print(bench_batch.write())
    print(bench_flights.write())
    print(bench_mechanics.write())
    print(waits.write())


if __name__ == "__main__":
    main()
