"""Mode `wair` over a crest: up onto the flat top, stop, and down again backwards."""

import pytest
from climbing_robot import APPROACH, ClimbingRobot

from husky_sim.ramp import Ramp

SPEED = 0.25
"""Commanded [m/s]."""
RADIUS, LENGTH = 1.5, 1.5
"""Of the foot and the crest, and length of the straight slope [m]."""
MOST_DRIFT = 0.15
"""Off the straight way, up and down [m]: half of the robot's track."""


def request(robot, mode):
    """Change the mode, wait for it, and let the body come to rest.

    Raises:
        AssertionError: it is refused, or does not come within 2 s.
    """
    accepted, message = robot.controller.request_mode(mode)
    assert accepted, message
    for _ in range(40):
        robot.run(0.05, (0.0, 0.0, 0.0))
        if robot.controller.mode.value == mode:
            robot.run(0.3, (0.0, 0.0, 0.0))
            return
    raise AssertionError(f"{mode} does not come: {robot.controller.reason}")


def walk_until(robot, speed, there):
    """Walk in mode `wair` until `there(x)` holds for the body's x [m]; return the drift [m]."""
    drift = 0.0
    for _ in range(400):
        robot.run(0.1, (speed, 0.0, 0.0))
        x, y, _ = robot.world.base_position
        assert robot.controller.mode.value == "wair", f"{robot.controller.reason} at x = {x:.2f} m"
        drift = max(drift, abs(float(y)))
        assert drift < MOST_DRIFT, f"it drifts at x = {x:.2f} m"
        if there(float(x)):
            return drift
    raise AssertionError(f"it does not get there, it is at x = {robot.world.base_position[0]}")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("slope", "seed"),
    [(15, 1), (20, 1), (30, 1), (30, 2), (30, 3), (40, 1), (45, 1), (45, 2), (45, 3)],
)
def test_it_goes_up_and_down_over_crests_to_the_flat(slope, seed):
    """At the crest the odometry has run by metres, and the reference body has strayed from it."""
    robot = ClimbingRobot(slope, seed, blend=RADIUS, length=LENGTH)
    top = Ramp(robot.slope, APPROACH, RADIUS, LENGTH)
    top_start = top.at(top.slope_end + top.arc)
    robot.start()
    up = walk_until(robot, SPEED, lambda x: x > top_start.x + 0.4)
    robot.run(0.5, (0.0, 0.0, 0.0))
    request(robot, "stand")
    request(robot, "walk")
    robot.run(0.3, (0.1, 0.0, 0.0))
    request(robot, "stand")
    assert robot.world.foot_positions()[:, 2] == pytest.approx(top_start.z, abs=0.04)
    request(robot, "wair")
    down = walk_until(robot, -SPEED, lambda x: x < 0.0)
    print(f"{slope} deg, seed {seed}: drift {up:.2f} m up, {down:.2f} m down")
    assert robot.refusal == ""
