"""The bar of `examples/mechanics_bar.py` by Siconos, for a Python that has it: its last state.

Arguments: a file of numpy with mass and stiffness, height, speed, end, gravity, step.
"""

import sys

import numpy as np
import siconos.kernel as kernel

numbers = np.load(sys.argv[1])
mass, stiffness = numbers["mass"], numbers["stiffness"]
height, speed, end, gravity, h = (float(it) for it in sys.argv[2:])
n = len(mass)
bar = kernel.LagrangianLinearTIDS(np.full(n, height), np.full(n, speed), mass)
bar.setKPtr(stiffness)
bar.setFExtPtr(-gravity * mass @ np.ones(n))
relation = kernel.LagrangianLinearTIR(np.eye(n)[:1])
contact = kernel.Interaction(kernel.NewtonImpactNSL(0.0), relation)
system = kernel.NonSmoothDynamicalSystem(0.0, end)
system.insertDynamicalSystem(bar)
system.link(contact, bar)
stepping = kernel.TimeStepping(
    system, kernel.TimeDiscretisation(0.0, h), kernel.MoreauJeanOSI(0.5), kernel.LCP()
)
while stepping.hasNextEvent():
    stepping.computeOneStep()
    stepping.nextStep()
print(stepping.startingTime(), *bar.q())
