"""The examples of arms run, and give the numbers that their page tells."""

import numpy as np

from example_scripts import example


def test_the_arm_taps_rests_presses_and_lifts_off(capsys, tmp_path):
    arm = example("arm_on_table")
    arm.main(str(tmp_path / "out.png"))
    assert "at rest" in capsys.readouterr().out
    run = arm.follow(arm.arm())
    bouncing = (run.t > 0.4) & (run.t < 0.9)
    assert np.sqrt(np.mean(run.error_gaps[bouncing] ** 2)) < 3e-6
    pressed = run.reactions[(run.t > 1.2) & (run.t < arm.LIFT - 0.01), 0]
    assert np.abs(pressed - arm.FORCE).max() < 1e-3
    assert len(run.zeno) == 1
    assert abs(run.liftoffs.t[0] - arm.LIFT) <= 2e-3
    assert np.abs(run.error_gaps[run.t > arm.LIFT + 0.05]).max() < 1e-6


def test_the_gantry_is_where_its_stop_is(capsys, tmp_path):
    gantry = example("gantry")
    gantry.main(str(tmp_path / "out.png"))
    assert "leaves at 2.0" in capsys.readouterr().out
    # a mass that is believed wrongly does not change what presses: nothing moves then
    for believed in (None, gantry.gantry(rail=10.5)):
        run = gantry.pick(believed)
        held = (run.t > 1.1) & (run.t < gantry.LEAVE - 0.01)
        assert np.array_equal(run.q[held, 0], np.ones(held.sum()))
        assert np.abs(run.reactions[held, 0] - gantry.FORCE).max() < 1e-2
    assert abs(run.q[1500, 1] + gantry.DEPTH) < 1e-3
    assert abs(run.liftoffs.t[-1] - gantry.LEAVE) <= 2e-3


def test_each_blow_of_the_hammer_has_its_speed(capsys, tmp_path):
    hammer = example("hammer")
    hammer.main(str(tmp_path / "out.png"))
    assert "blow at 0.3000 s" in capsys.readouterr().out
    for delay in (0, 4):
        blows = hammer.strike(delay).resolved_impacts
        np.testing.assert_allclose(-blows["speed_before"], hammer.SPEEDS, rtol=1e-5)
        np.testing.assert_allclose(np.diff(blows["t"]), hammer.INTERVAL, atol=2e-3)


def test_the_juggler_learns_and_changes_the_height(capsys, tmp_path):
    juggler = example("juggler")
    juggler.main(str(tmp_path / "out.png"))
    assert "heights" in capsys.readouterr().out
    found = juggler.heights(juggler.juggle())
    throws = juggler.THROWS
    assert abs(found[throws - 1] - juggler.LOW) < 2e-3
    assert abs(found[0] - juggler.LOW) > 0.1
    assert np.abs(found[throws + 3 :] - juggler.HIGH).max() < 5e-5
    ignored = juggler.heights(juggler.juggle(learn=False))
    assert np.abs(ignored[throws:] - juggler.HIGH).min() > 0.3


def test_the_arm_rests_in_the_corner(capsys, tmp_path):
    arm = example("arm_in_corner")
    arm.main(str(tmp_path / "out.png"))
    assert "kinetic cosine of floor and wall: -0.416" in capsys.readouterr().out
    run = arm.follow()
    assert np.all(np.sqrt(np.mean(run.error_gaps[run.t > 0.3] ** 2, axis=0)) < 3e-6)
    wanted = list(arm.FORCES.values())
    np.testing.assert_allclose(run.reactions[-50:], [wanted] * 50, atol=1e-6)
    for direction in (-0.6, 0.0, 0.6):
        start = arm.posture(direction + 0.1, arm.WIDTH - 0.15, -arm.DEPTH + 0.2)
        landed = arm.land(start, direction)
        assert landed.contacts[-1].all()
        assert arm.at_rest_from(landed) < 0.5
        np.testing.assert_allclose(landed.reactions[-50:], [wanted] * 50, atol=1e-4)
