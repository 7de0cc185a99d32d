"""What a wheel must do where nothing but NumPy is installed: ``python tools/smoke.py``."""

import ctypes
import os
import sys
import tempfile
import zipfile
from importlib import metadata

import numpy as np

import zivi
from zivi import native


def exports() -> bool:
    """Whether an FMU is written without a compiler, and its binary loads."""
    os.environ["PATH"] = ""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        (path,) = zivi.export_fmu(folder, "mass", 3)
        with zipfile.ZipFile(path) as archive:
            (name,) = [it for it in archive.namelist() if it.startswith("binaries/")]
            binary = ctypes.CDLL(archive.extract(name, folder))
    binary.fmi3GetVersion.restype = ctypes.c_char_p
    return bool(binary.fmi3GetVersion() == b"3.0")


def has_library() -> bool:
    """Whether the C library and its header are there."""
    folder = native.prefix()
    library = "zivi.lib" if sys.platform == "win32" else "libzivi.a"
    return (folder / "lib" / library).exists() and (folder / "include" / "zivi.h").exists()


def main() -> int:
    """Compare a few results with their closed forms."""
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    fall = (2 / 9.81) ** 0.5
    zeno = 3 * fall  # the fall, then twice 1/2 + 1/4 + ... of it
    times = np.linspace(0.0, 0.4, 9)
    batch = zivi.simulate_batch(ball, (0, 4), [[1, 0], [0.25, 0]], method=zivi.ThetaGamma(1e-3))
    plant = zivi.ImpactSystem(-9.81, e=0.5)
    regulator = zivi.TwistingRegulator(30, 17, h=1e-3, e=0.5)
    held = zivi.simulate_closed_loop(plant, regulator, (0, 4), (1, 0))
    answer = zivi.solve_vi(lambda x: x**3 - 2, -np.inf, np.inf, [1.0])
    sol = zivi.simulate(ball, (0, 4), (1, 0))
    results = {
        "Zeno point": abs(sol.rest_time - zeno) < 1e-12,
        "dense output": np.max(np.abs(sol(times)[0] - 1 + 4.905 * times**2)) < 1e-12,
        "batch": bool(np.all(batch.x == 0.0)),
        "closed loop": held.success and held.x[-1] == 0.0,
        "variational inequality": abs(answer.x[0] - 2 ** (1 / 3)) < 1e-9,
        "FMU": exports(),
        "C library": has_library(),
        "version": zivi.__version__ == metadata.version("zivi"),
    }
    for name, right in results.items():
        print(f"{name}: {'right' if right else 'WRONG'}")
    return 0 if all(results.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
