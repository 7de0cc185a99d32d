"""Runs one adapter and prints a line of JSON for each run: ``python -m zeno.worker NAME [...]``."""

import argparse
import importlib
import json
import time

from .problem import errors, load


def main():
    """Run the adapter on the problems that it takes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("adapter")
    parser.add_argument("--problems", nargs="*", default=[])
    parser.add_argument("--seconds", type=float, default=30.0, help="for each problem, see run.py")
    options = parser.parse_args()
    adapter = importlib.import_module(f".adapters.{options.adapter}", __package__)
    if why := adapter.missing():
        print(json.dumps({"tool": adapter.NAME, "missing": why}), flush=True)
        return
    for problem in [load(name) for name in options.problems] or load():
        at = {"tool": adapter.NAME, "problem": problem.id}
        if why := adapter.refuses(problem):
            print(json.dumps({**at, "refused": why}), flush=True)
            continue
        begun = time.process_time()
        for level in adapter.LEVELS:
            print(json.dumps({**at, "level": level, **once(adapter, problem, level)}), flush=True)
            if time.process_time() - begun > options.seconds:
                break


def once(adapter, problem, level):
    """Run once: errors and work, or what went wrong."""
    begun = time.process_time()
    try:
        motion = adapter.run(problem, level)
    except Exception as error:
        return {"failed": f"{type(error).__name__}: {error}"[:200]}
    took = time.process_time() - begun
    state, zeno = errors(problem, motion)
    return {
        "error": state,
        "zeno": zeno,
        "evaluations": motion.evaluations,
        "steps": motion.steps,
        "seconds": took,
    }


if __name__ == "__main__":
    main()
