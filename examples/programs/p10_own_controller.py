"""A controller of your own."""

import zivi


class Spring:
    h = 1e-3  # the sampling period

    def step(self, x, xdot, force):
        return 40.0 * (0.5 - x) - 6.0 * xdot - force


plant = zivi.ImpactSystem(-9.81, e=0.5)
run = zivi.simulate_closed_loop(plant, Spring(), (0, 3), (1, 0))
print(run.x[-1].round(3), run.u[-1].round(3))

# It prints:
# 0.5 9.81
