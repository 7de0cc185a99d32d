"""A thousand balls."""

import numpy as np
import zivi

speeds = np.random.default_rng(1).uniform(0, 4, 1000)
starts = np.column_stack([np.ones(1000), speeds])
ball = zivi.ImpactSystem(-9.81, e=0.5)
batch = zivi.simulate_batch(ball, (0, 10), starts, method=zivi.SwitchedRK())
landing = np.sqrt(speeds**2 + 2 * 9.81)  # velocity of the first impact, from 1 m
expected = (speeds + landing + 2 * landing * 0.5 / (1 - 0.5)) / 9.81
print(batch)
print(np.abs(batch.rest_time - expected).max() < 1e-12)

# It prints:
# <Batch of 1000 runs: 1000 completed, 1000 at rest>
# True
