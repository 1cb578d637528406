"""Husky-beta in one process: over a gap, onto a step, and on its legs up there."""

import math

import pytest
from flying_beta import FlyingBeta

from husky_sim.terrain import TerrainOptions

pytestmark = pytest.mark.slow

GROUND = TerrainOptions(kind="gap", approach=0.7, size=0.8, height=0.3, top=4.0)
STEP = GROUND.height


class Traveller(FlyingBeta):
    """Steers by its own estimate."""

    def fly_to(self, x):
        """Go ahead to a place by the estimate [m]."""
        for _ in range(100):
            left = x - self.believed[0]
            if left < 0.05:
                break
            self.run(0.2, (min(0.5, 0.8 * left), 0.0, 0.0))
        else:
            raise AssertionError(f"{left:.2f} m are left to go")
        self.run(1.0, (0.0, 0.0, 0.0))

    @property
    def believed(self):
        return self.controller.body.estimator.position

    @property
    def place(self):
        return self.data.qpos[:3]

    @property
    def perch_above_step(self):
        return float(self.data.site("perch").xpos[2]) - STEP


@pytest.fixture(scope="module")
def robot():
    """In the air over the middle of the gap."""
    robot = Traveller(1, terrain=GROUND)
    robot.stand()
    robot.become("perch")
    robot.become("splay")
    robot.gear.arm()
    robot.run(1.5)
    robot.become("quadrotor")
    robot.run(4.0)
    robot.fly_to(GROUND.approach + GROUND.size / 2.0)
    return robot


def test_over_the_gap_it_does_not_land(robot):
    """Asked to land, it sinks as far as it is told to look for ground, and holds again."""
    depth = robot.controller.parameters["quadrotor.landing_depth"]
    resting = robot.robot.sit_height + robot.robot.foot_radius
    assert robot.controller.request_mode("splay") == (True, "landing")
    for mode in ("perch", "stand"):
        accepted, message = robot.controller.request_mode(mode)
        assert not accepted and "cannot follow" in message
    lowest = math.inf
    for _ in range(100):
        robot.run(0.1)
        lowest = min(lowest, robot.place[2])
        if robot.controller.hover.phase.value == "holding" and robot.place[2] > resting + 0.4:
            break
    assert "no ground is found" in robot.controller.reason
    assert resting - depth - 0.1 < lowest < resting - depth + 0.03
    assert robot.controller.mode.value == "quadrotor"


def test_on_the_step_it_lands_stands_and_trots(robot):
    """Nothing remembers the height of where it took off."""
    robot.fly_to(GROUND.approach + GROUND.size + 0.8)
    assert robot.controller.request_mode("splay")[0]
    fastest = 0.0
    for _ in range(500):
        robot.run(0.02)
        if robot.controller.mode.value == "splay":
            break
        if robot.perch_above_step < 0.02:
            fastest = max(fastest, -robot.data.qvel[2])
    assert fastest < 0.4 and abs(robot.perch_above_step) < 0.003
    assert robot.believed == pytest.approx(robot.place, abs=0.15)
    assert robot.believed[2] == pytest.approx(robot.place[2], abs=0.03)
    robot.gear.autopilot.vehicle.logic.disarm()
    robot.run(0.5)
    robot.become("perch")
    robot.become("stand")
    standing = STEP + robot.robot.stand_height + robot.robot.foot_radius
    assert robot.place[2] == pytest.approx(standing, abs=0.01)
    assert robot.believed[2] == pytest.approx(robot.place[2], abs=0.02)
    assert robot.controller.request_mode("walk")[0]
    start, lowest = robot.place[0], math.inf
    for _ in range(10):
        robot.run(0.2, (0.3, 0.0, 0.0))
        lowest = min(lowest, robot.place[2])
    assert robot.place[0] - start > 0.4 and lowest > standing - 0.03
    assert robot.believed[2] == pytest.approx(robot.place[2], abs=0.02)
    assert robot.controller.counters.faults == 0
