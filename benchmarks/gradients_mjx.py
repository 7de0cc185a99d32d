"""The gradient of a bouncing ball by MuJoCo's MJX, beside that of zivi.

A ball with drag falls on the ground, e = 0.8; the derivative of its height by the height of the
start, once after the first impact and once after more of them. MJX (``pip install mujoco
mujoco-mjx jax``) has no impacts but soft contacts, a spring with the damping that gives e, in fixed
steps; its forward derivative runs through them. It compiles for minutes.

    python benchmarks/gradients_mjx.py
"""

from __future__ import annotations

import math

import zivi

E, DRAG, G = 0.8, 0.3, 9.81
TIMES = (0.8, 2.0)
STEPS = (1e-3, 5e-4)
STIFFNESS = 2e4
LENGTH = 2000
"""Steps of each run."""

MODEL = """
<mujoco>
  <option timestep="{h}" gravity="0 0 -{g}"/>
  <worldbody>
    <geom type="plane" size="5 5 .1" condim="1"/>
    <body>
      <joint type="slide" axis="0 0 1" damping="{drag}"/>
      <geom type="sphere" size=".1" mass="1" condim="1" solref="-{k} -{b}" solimp="1 1 0.001"/>
    </body>
  </worldbody>
</mujoco>
"""


def exact(times: tuple[float, ...]) -> list[tuple[float, float]]:
    """Give heights and their derivatives by the height of the start."""
    system = zivi.ImpactSystem(zivi.LinearForce(gravity=G, damping=DRAG), e=E)
    s = zivi.sensitivity(system, (0, 9), (1, 0), ("x0",), zivi.SwitchedRK(1e-13, 1e-14))
    return [(float(s.trajectory(t)[0]), float(s(t)[0, 0])) for t in times]


def peer(h: float) -> tuple[list[float], list[float]]:
    """Give heights and derivatives at the ends of the steps."""
    import jax
    import jax.numpy as jnp
    import mujoco
    from mujoco import mjx

    jax.config.update("jax_enable_x64", True)
    ratio = -math.log(E) / math.hypot(math.pi, math.log(E))
    damping = 2 * ratio * math.sqrt(STIFFNESS)
    text = MODEL.format(h=h, g=G, drag=DRAG, k=STIFFNESS, b=damping)
    model = mjx.put_model(mujoco.MjModel.from_xml_string(text))
    empty = mjx.make_data(model)

    def heights(start: jax.Array) -> jax.Array:
        def step(data, _):
            data = mjx.step(model, data)
            return data, data.qpos[0]

        begin = empty.replace(qpos=jnp.array([start + 0.1]))
        return jax.lax.scan(step, begin, None, length=LENGTH)[1] - 0.1

    x, by = jax.jit(lambda start: jax.jvp(heights, (start,), (1.0,)))(1.0)
    return x.tolist(), by.tolist()


def main() -> None:
    """Print both."""
    references = exact(TIMES)
    for t, (x, by) in zip(TIMES, references, strict=True):
        print(f"t = {t:g} s: height {x:.6f} m, derivative {by:.6f}")
    for h in STEPS:
        x, by = peer(h)
        for t, (height, slope) in zip(TIMES, references, strict=True):
            k = round(t / h) - 1
            if k < LENGTH:
                print(
                    f"  MJX, step {h:g} s, t = {t:g}: height off {abs(x[k] - height):.1e} m, "
                    f"derivative {by[k]:.4f}, off {abs(by[k] / slope - 1):.1e}",
                    flush=True,
                )
    system = zivi.ImpactSystem(zivi.LinearForce(gravity=G, damping=DRAG), e=E)
    for tol in (1e-6, 1e-10):
        s = zivi.sensitivity(system, (0, 9), (1, 0), ("x0",), zivi.SwitchedRK(tol, tol))
        off = [abs(s(t)[0, 0] / by - 1) for t, (_, by) in zip(TIMES, references, strict=True)]
        print(f"  zivi, tolerance {tol:g}: derivatives off {off[0]:.1e}, {off[1]:.1e}")


if __name__ == "__main__":
    main()
