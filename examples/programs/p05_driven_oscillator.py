"""A driven oscillator, once a period.

After 160 periods, a motion that repeats itself every period, or every second one, or never:
"""

import numpy as np
import zivi

for omega in (2.0, 2.8):
    force = zivi.LinearForce(stiffness=1.0, damping=0.1, amplitude=1.0, omega=omega)
    times = 2 * np.pi / omega * np.arange(201)
    system = zivi.ImpactSystem(force, e=0.8)
    sol = zivi.simulate(system, (0, times[-1]), (1, 0), t_eval=times)
    print(omega, len(np.unique(sol.x[-40:].round(4))) == 1)

# It prints:
# 2.0 True
# 2.8 False
