"""At times of your own."""

import numpy as np
import zivi

ball = zivi.ImpactSystem(-9.81, e=0.5)
sol = zivi.simulate(ball, (0, 2), (1, 0), t_eval=np.linspace(0, 2, 5))
print(sol.x.round(6))
x, xdot = sol(0.5)  # or at any time afterwards
print(x.round(6), xdot.round(6))

# It prints:
# [1.       0.095835 0.061256 0.       0.      ]
# 0.095835 1.73917
