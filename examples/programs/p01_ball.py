"""A ball, to rest."""

import zivi

ball = zivi.ImpactSystem(-9.81, e=0.5)  # force per unit mass, restitution
sol = zivi.simulate(ball, (0, 2), (1, 0))  # t_span and y0 = (x, xdot), as in solve_ivp
print(sol.success, round(sol.rest_time, 6))
print(sol.impacts["t"][:3].round(4))
print(sol.x[-1], sol.xdot[-1])

# It prints:
# True 1.354571
# [0.4515 0.903  1.1288]
# 0.0 0.0
