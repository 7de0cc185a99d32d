"""A wall that shakes."""

import zivi

table = zivi.HarmonicWall(amplitude=0.01, omega=60.0)
shaken = zivi.ImpactSystem(-9.81, e=0.5, wall=table)
sol = zivi.simulate(shaken, (0, 1), (0.1, 0))  # relative to the wall, as y0 is
position, velocity = sol.fixed()  # in the fixed frame
print(len(sol.impacts), sol.x.min() >= 0, round(position[0], 6))

# It prints:
# 7 True 0.11
