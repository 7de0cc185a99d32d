"""A force of `(t, y)`, and an event.

`fun` gives the second derivative only; functions of `(t, x, xdot)` will do as well. `zivi.event`
sets the attributes `terminal` and `direction` that SciPy has.
"""

import zivi


def fun(t, y):
    x, xdot = y
    return -9.81 - 0.3 * abs(xdot) * xdot


@zivi.event(terminal=True, direction=-1)
def half_way(t, y):
    return y[0] - 0.5


sol = zivi.simulate(zivi.ImpactSystem(fun, e=0.5), (0, 3), (1, 0), events=half_way)
print(sol.status.name, sol.t_events[0].round(6), sol.y_events[0].round(6))

# It prints:
# TERMINATED_BY_EVENT [0.327314] [[ 0.5      -2.911226]]
