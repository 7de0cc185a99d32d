"""The examples of arms run, and give the numbers that their page tells."""

import numpy as np

from example_scripts import example


def test_the_arm_taps_rests_presses_and_lifts_off(capsys):
    arm = example("arm_on_table")
    arm.main(None)
    assert "at rest" in capsys.readouterr().out
    run = arm.follow(arm.arm())
    bouncing = (run.t > 0.4) & (run.t < 0.9)
    assert np.sqrt(np.mean(run.error_gaps[bouncing] ** 2)) < 3e-6
    pressed = run.reactions[(run.t > 1.2) & (run.t < arm.LIFT - 0.01), 0]
    assert np.abs(pressed - arm.FORCE).max() < 1e-3
    assert len(run.zeno) == 1
    assert abs(run.liftoffs.t[0] - arm.LIFT) <= 2e-3
    assert np.abs(run.error_gaps[run.t > arm.LIFT + 0.05]).max() < 1e-6
