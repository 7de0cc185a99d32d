"""A reference that bounces."""

import zivi

plant = zivi.ImpactSystem(-9.81, e=1 / 3)
tracker = zivi.TwistingTracker(30, 17, h=1e-3, e=1 / 3)
run = zivi.simulate_closed_loop(
    plant, tracker, (0, 2), (6, 5), y_ref0=(3, 3), force_ref=-19.81, noise=(1e-5, 1e-3), seed=1
)
late = run.t > 1.5
print(abs(run.error[late]).max() < 1e-3)
zivi.plot.overview(run).savefig("tracking.png")

# It prints:
# True
