r"""A fit of the restitution to a sound recording of a bouncing ball.

The recording is a WAV file that is made here: each impact is a short ring of 2.6 kHz, as loud as
its speed, in white noise. Clicks are the times at which the energy of half a millisecond rises
above a multiple of its median. The recording starts before the ball is released, and the height of
the drop is unknown: both follow from the clicks. In brackets: true values.

Run as ``python examples/fit_microphone.py [out.png]``.
"""

import sys
import tempfile
import wave
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import zivi

RATE = 44_100
RELEASE, HEIGHT, E = 0.35, 0.62, 0.81
"""Time of the release (s), height (m) and restitution of the recorded ball."""
BLOCK, QUIET = 22, 0.12
"""Samples of a block, and the shortest time between clicks (s)."""


def record(path: Path, seed: int = 0) -> None:
    """Write the sound of a ball that bounces 14 times, by closed form."""
    fall = np.sqrt(2 * HEIGHT / 9.81)
    times = RELEASE + fall + np.concatenate([[0.0], np.cumsum(2 * fall * E ** np.arange(1.0, 14))])
    t = np.arange(int((times[-1] + 0.3) * RATE)) / RATE
    sound = 2e-3 * np.random.default_rng(seed).standard_normal(len(t))
    for k, hit in enumerate(times):
        after = t[t >= hit] - hit
        ring = 0.8 * E**k * np.sin(2 * np.pi * 2600 * after) * np.exp(-after / 4e-3)
        sound[t >= hit] += ring
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE)
        file.writeframes((32_000 * sound).astype("<i2").tobytes())


def clicks(path: Path) -> NDArray[np.float64]:
    """Return the times at which the sound of a file becomes loud (s)."""
    with wave.open(str(path), "rb") as file:
        rate = file.getframerate()
        sound = np.frombuffer(file.readframes(file.getnframes()), "<i2").astype(float)
    energy = (sound[: len(sound) // BLOCK * BLOCK] ** 2).reshape(-1, BLOCK).mean(axis=1)
    loud = np.flatnonzero(energy > 20 * np.median(energy))
    found: list[float] = []
    for k in loud:
        t = k * BLOCK / rate
        if not found or t - found[-1] > QUIET:
            found.append(t)
    return np.array(found)


def main(path: str | None) -> None:
    """Make a recording, find its clicks, fit, and draw if a path is given."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "ball.wav"
        record(file)
        times = clicks(file)
    ball = zivi.ImpactSystem(-9.81, e=0.6)
    data = zivi.Bounces(times, sigma=BLOCK / RATE / np.sqrt(12))
    found = zivi.fit(ball, data, ("e", "x0", "t0"), y0=(1.0, 0.0))
    print(f"{len(times)} clicks, found by {found.found} of {found.starts} starts")
    for name, true in {"e": E, "x0": HEIGHT, "t0": RELEASE}.items():
        print(f"{name:2} {found.values[name]:.5f} +- {found.std[name]:.5f} ({true})")
    if path is not None:
        import matplotlib as mpl

        mpl.use("Agg")
        import matplotlib.pyplot as plt

        with plt.style.context("zivi.plot.figures"):
            figure = found.plot()
            figure.suptitle("Intervals between the clicks of a recording, and the fit")
            figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
