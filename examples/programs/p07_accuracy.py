"""How accurate it is.

The default controls its error; `ThetaGamma`, the scheme with implicit signs, is of first order in
`h`.
"""

import math
import zivi

ball = zivi.ImpactSystem(-9.81, e=0.5)
exact = 3 * math.sqrt(2 / 9.81)  # the Zeno point
print(abs(zivi.simulate(ball, (0, 2), (1, 0)).rest_time - exact) < 1e-12)
for h in (1e-2, 1e-3, 1e-4):
    sol = zivi.simulate(ball, (0, 2), (1, 0), method=zivi.ThetaGamma(h))
    print(f"h = {h:g}: {sol.rest_time - exact:+.4f} s")

# It prints:
# True
# h = 0.01: -0.1746 s
# h = 0.001: -0.0316 s
# h = 0.0001: -0.0043 s
