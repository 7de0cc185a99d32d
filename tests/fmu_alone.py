"""Simulate FMUs where zivi cannot be imported: ``fmu_alone.py FOLDER``; prints JSON."""

import json
import sys
from pathlib import Path

sys.modules["zivi"] = None  # type: ignore[assignment]

from fmpy import simulate_fmu  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402


def main() -> None:
    """Validate all, simulate the ball and the loop."""
    try:
        import zivi  # noqa: F401

        raise SystemExit("zivi can be imported")
    except ImportError:
        pass
    folder = Path(sys.argv[1])
    told = {"problems": {}, "runs": {}}
    for path in sorted(folder.glob("*.fmu")):
        told["problems"][path.name] = list(validate_fmu(str(path)))
        settings = {
            "ImpactingMass": {"x0": 1.0, "xdot0": 6.0, "e": 0.41843971631205673},
            "TwistingLoop": {
                "x0": 6.0,
                "xdot0": 5.0,
                "x_ref0": 3.0,
                "xdot_ref0": 3.0,
                "force_ref": -19.81,
            },
        }.get(path.stem[:-1])
        if settings is None:
            simulate_fmu(str(path), stop_time=0.01, output_interval=1e-3)
            continue
        result = simulate_fmu(
            str(path),
            stop_time=3.0,
            step_size=1e-3,
            output_interval=1e-3,
            start_values=settings,
            output=["x", "xdot"],
        )
        told["runs"][path.name] = [[float(v).hex() for v in row] for row in result.tolist()]
    print(json.dumps(told))


if __name__ == "__main__":
    main()
