"""The salted Kalman filter of hybrid-tools, for the comparison of observers."""

from collections.abc import Callable

import numpy as np

try:
    import hybrid_tools
except ImportError:
    hybrid_tools = None

F, H, DMAX, Q_D = -9.81, 1e-3, 5.0, 1e-3


def bouncing_mass(e: float, sigma: float) -> "hybrid_tools.HybridDynamicalSystem":
    """Build the mass with an unknown force ``d``, positions measured.

    The modes of the package's own ball: falling until ``x = 0``, rising until ``x' = 0``. The noise
    enters as inputs do, here as the rate of ``d``.
    """

    def transition(mode: np.ndarray, time: float) -> np.ndarray:
        return np.array([[1, time, time * time / 2], [0, 1, time], [0, 0, 1]])

    dynamics = hybrid_tools.ModeDynamics(
        f_cont=lambda z, u, _h, _p: np.array([z[1], F + z[2], u[0]]),
        A_disc=lambda z, _u, time, _p: transition(z, time),
        B_disc=lambda _z, _u, time, _p: np.array([[0.0], [0.0], [time]]),
        y=lambda z, _p: z[:1],
        C=lambda _z, _p: np.array([[1.0, 0.0, 0.0]]),
    )

    def reset(matrix: np.ndarray) -> "hybrid_tools.ModeReset":
        return hybrid_tools.ModeReset(
            r=lambda z, _u, _h, _p: matrix @ z, R=lambda _z, _u, _h, _p: matrix
        )

    def guard(row: list[list[float]]) -> "hybrid_tools.ModeGuard":
        row = np.array(row)
        return hybrid_tools.ModeGuard(g=lambda z, _u, _h, _p: row @ z, G=lambda _z, _u, _h, _p: row)

    # the rate is constant over a period: (h rate)^2 = q_d
    noise = hybrid_tools.ModeNoise(W=np.array([[Q_D / H**2]]), V=np.array([[sigma**2]]))
    return hybrid_tools.HybridDynamicalSystem(
        {"falling": dynamics, "rising": dynamics},
        {
            "falling": {"rising": reset(np.diag([1.0, -e, 1.0]))},
            "rising": {"falling": reset(np.eye(3))},
        },
        {
            "falling": {"rising": guard([[1.0, 0.0, 0.0]])},
            "rising": {"falling": guard([[0.0, 1.0, 0.0]])},
        },
        {"falling": noise, "rising": noise},
    )


def _salted(x: np.ndarray, e: float, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Estimate velocity and unknown force with the package's filter as it is."""
    start, covariance = np.array([x[0], 0.0, 0.0]), np.diag([sigma**2, 25, DMAX**2])
    system, nothing = bouncing_mass(e, sigma), np.zeros(1)
    it = hybrid_tools.SKF(start, "falling", covariance, H, nothing, system)
    out = np.empty((len(x), 3))
    out[0] = start
    for k in range(1, len(x)):
        it.predict((k - 1) * H, nothing)
        out[k], _ = it.update(k * H, nothing, x[k : k + 1])
    return out[:, 1], out[:, 2]


Observed = tuple[np.ndarray, np.ndarray]
salted_kalman: Callable[[np.ndarray, float, float], Observed] | None = (
    None if hybrid_tools is None else _salted
)
