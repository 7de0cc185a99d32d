"""A racket that throws a ball as high as is asked for, another height from the fifth throw on.

A gap that is followed perfectly does not know how high the ball flies: its height drifts. So the
racket aims at the next impact, at the place and the time that the flight of the ball tells, with
the speed that the throw needs. It believes in a wrong restitution and a wrong mass: both are one
number, which each impact shows. Without learning the throws stay wrong.

Run as ``python examples/juggler.py [out.png]``.
"""

import sys
from typing import Any

import numpy as np

import zivi

G, LOW, HIGH, THROWS, END = 9.81, 0.5, 0.8, 5, 9.0


def racket(ball: float = 0.2, e: float = 0.6) -> zivi.MechanicalSystem:
    """Give a ball above a racket of 1 kg; only the racket has a drive."""
    return zivi.MechanicalSystem(
        mass=np.diag([ball, 1.0]),
        force=[-ball * G, -G],
        gaps=[zivi.LinearGap([1, -1], name="racket")],
        e=e,
        coordinates=["ball", "racket"],
        inputs=[[0.0], [1.0]],
    )


def juggle(**settings: Any) -> zivi.MechanicalClosedLoop:
    """Run it."""
    controller = zivi.Striker(
        racket(ball=0.25, e=0.5),
        gap="racket",
        body="ball",
        apex=lambda k: LOW if k < THROWS else HIGH,
        **settings,
    )
    start = ([0.4, 0.0], [0.5, 0.0])
    return zivi.simulate_closed_loop(racket(), controller, (0, END), start, method=zivi.RKPeriod())


def heights(run: zivi.MechanicalClosedLoop) -> np.ndarray:
    """Give how high each throw goes, from where the ball leaves and its speed."""
    states = np.array([run(t) for t in run.resolved_impacts["t"]])
    return states[:, 0, 0] + states[:, 1, 0] ** 2 / (2 * G)


def main(path: str | None) -> None:
    """Print the numbers, and draw if a path is given."""
    run = juggle()
    for name, it in (("heights", run), ("without learning", juggle(learn=False))):
        print(f"{name}:", " ".join(f"{height:.5f}" for height in heights(it)), "m")
    if path is None:
        return
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axis = plt.subplots(figsize=(7, 4), layout="constrained")
    axis.plot(run.t, run.q, label=["ball", "racket"])
    for height in (LOW, HIGH):
        axis.axhline(height, color="0.7", linewidth=0.8)
    axis.set_ylabel("height (m)")
    axis.set_xlabel("time (s)")
    axis.legend(loc="upper left", bbox_to_anchor=(1, 1))
    figure.suptitle("A juggler: apex 0.5 m, from the fifth throw on 0.8 m (grey)")
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
