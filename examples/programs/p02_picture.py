"""Its picture."""

import matplotlib.pyplot as plt
import zivi

sol = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.7), (0, 5), (1, 3))
fig, (above, below) = plt.subplots(2, sharex=True)
above.plot(sol.t, sol.x)  # the samples draw the motion
zivi.plot.velocity(sol, ax=below)  # broken at impacts
fig.savefig("ball.png")
print(f"at rest from {sol.rest_time:.3f} s")

# It prints:
# at rest from 3.396 s
