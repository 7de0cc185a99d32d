"""A regulator."""

import zivi

plant = zivi.ImpactSystem(-9.81, e=0.5)
regulator = zivi.TwistingRegulator(30, 17, h=1e-3, e=0.5)  # gains, sampling period
run = zivi.simulate_closed_loop(plant, regulator, (0, 2), (1, 0))
print(run.success, round(run.rest_time, 3), run.x[-1])

# It prints:
# True 0.53 0.0
