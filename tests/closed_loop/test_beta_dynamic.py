"""Husky-beta in one process: legs that stand become arms, one, two, four (dynamic morphing)."""

import numpy as np
import pytest
from flying_beta import FlyingBeta

from husky_description.gravity import GRAVITY

pytestmark = pytest.mark.in_a_copy  # each goes on from the same standing robot


class Balancer(FlyingBeta):
    """Notes what its propellers gave and how far it tilted."""

    greatest_tilt = 0.0

    @property
    def feet_above_ground(self):
        feet = [self.data.site(name).xpos[2] for name in self.robot.foot_names]
        return np.array(feet) - self.robot.foot_radius

    def until(self, holds, most):
        """Advance until something holds; return the greatest thrust of each propeller [N]."""
        thrust = np.zeros(4)
        for _ in range(round(most / 0.02)):
            self.run(0.02)
            self.greatest_tilt = max(self.greatest_tilt, self.tilt)
            thrust = np.maximum(thrust, self.propellers.unit.thrust)
            if holds():
                return thrust
        raise AssertionError(f"{self.controller.mode}: {self.controller.reason}")

    def outside(self, leg):
        """Return how far the centre of mass is beyond the line of the feet beside a leg [m]."""
        sites = [self.data.site(name).xpos[:2] for name in self.robot.foot_names]
        begin, end = sites[leg ^ 1], sites[leg ^ 2]
        normal = np.array((begin[1] - end[1], end[0] - begin[0])) / np.linalg.norm(end - begin)
        if normal @ (sites[leg] - begin) < 0.0:
            normal = -normal
        center = self.data.subtree_com[self.model.body("base").id][:2]
        return float(normal @ (center - begin))

    def standing_again(self):
        return self.controller.mode.value == "stand"


@pytest.fixture(scope="module")
def standing():
    robot = Balancer(1)
    robot.stand()
    assert not robot.controller.request_mode("balance")[0]  # propellers off
    assert not robot.controller.request_mode("leap")[0]
    robot.gear.arm()
    robot.run(0.3)
    return robot


def test_one_leg_splays_and_without_its_propeller_comes_down_at_once(standing):
    """The propeller holds a centre of mass that three feet could not; lost, four feet catch it."""
    robot = standing
    assert robot.controller.request_mode("balance")[0]
    thrust = robot.until(lambda: robot.controller.present.settled, 8.0)
    assert robot.feet_above_ground[0] > 0.2 and robot.feet_above_ground[1:].max() < 0.003
    assert robot.outside(0) > 0.005
    weight = robot.robot.mass * GRAVITY
    assert 0.07 < thrust[0] / weight < 0.23
    assert thrust[1:].max() < 0.1  # those of standing legs are off
    assert robot.greatest_tilt < 3.0
    robot.gear.autopilot.vehicle.logic.disarm(force=True)
    robot.until(robot.standing_again, 4.0)
    assert "propellers are lost" in robot.controller.reason or "put down" in robot.controller.reason
    robot.run(0.5)
    assert robot.greatest_tilt < 8.0 and robot.tilt < 1.0
    assert robot.controller.body.contacts.contact.all()
    assert robot.controller.counters.faults == 0


def test_two_legs_across_splay_and_return_while_the_body_balances_on_two_feet(standing):
    robot = standing
    robot.controller.parameters.set("balance.legs", 4.0)
    assert robot.controller.request_mode("balance")[0]
    robot.until(lambda: robot.controller.present.settled, 20.0)
    assert robot.feet_above_ground[[0, 3]].min() > 0.2
    assert robot.feet_above_ground[[1, 2]].max() < 0.003
    robot.greatest_tilt = 0.0
    robot.run(0.5)
    assert robot.tilt < 2.0
    assert robot.controller.request_mode("stand") == (True, "going back to stand")
    robot.until(robot.standing_again, 20.0)
    assert robot.controller.reason == "back on four feet"
    assert robot.greatest_tilt < 4.0
    robot.run(0.3)
    assert robot.propellers.unit.thrust.max() < 0.1
    assert robot.controller.body.contacts.contact.all()


def test_four_legs_become_arms_in_a_leap(standing):
    """The perch stays clear of the ground, and the robot flies on at the height of the hold."""
    robot, lowest = standing, []
    assert robot.controller.request_mode("leap")[0]
    robot.until(lambda: robot.controller.mode.value == "quadrotor", 5.0)
    for _ in range(100):
        robot.run(0.02)
        robot.greatest_tilt = max(robot.greatest_tilt, robot.tilt)
        lowest.append(robot.data.site("perch").xpos[2])
    assert robot.controller.mode.value == "quadrotor"
    assert min(lowest) > 0.04 and robot.greatest_tilt < 12.0
    assert lowest[-1] > 0.2
    assert robot.controller.counters.faults == 0


@pytest.mark.slow  # `test_one_leg_splays...` is the same on hard ground
def test_on_ground_that_gives_way_it_stays_level_and_feels_where_it_steps():
    """The feet sink unevenly while one leg is an arm; on 200 N/m it would tip over."""
    robot, leg = Balancer(2, contact="thesis_model", stiffness=500.0), 1
    robot.stand()
    robot.gear.arm()
    robot.run(0.5)
    robot.controller.parameters.set("balance.legs", float(leg))
    assert robot.controller.request_mode("balance")[0]
    robot.until(lambda: robot.controller.present.settled, 9.0)
    robot.until(lambda: robot.time > 12.0, 9.0)
    standing = np.delete(robot.feet_above_ground, leg)
    assert standing.max() < -0.015 and np.ptp(standing) > 0.03
    assert robot.greatest_tilt < 4.0 and robot.outside(leg) < 0.02
    assert robot.controller.request_mode("stand")[0]
    robot.until(robot.standing_again, 9.0)
    robot.run(0.5)
    assert robot.controller.reason == "back on four feet"
    assert robot.greatest_tilt < 4.0
    assert robot.feet_above_ground.max() < 0.001
    assert robot.controller.request_mode("walk")[0]
    robot.run(3.0, (0.2, 0.0, 0.0))
    assert robot.data.qvel[0] > 0.1 and robot.tilt < 3.0
