"""Husky-beta on its servos in one process: legs become a quadrotor's arms, and legs (T19, T20)."""

import math

import numpy as np
import pytest
from servo_robot import ServoRobot

from husky_description.robot import load_robot
from husky_description.rotor_geometry import rotor_geometry
from husky_sim.scene import WorldOptions

ROBOT = load_robot("beta")


class MorphingRobot(ServoRobot):
    """Notes how level the body stays."""

    def become(self, mode, most=8.0):
        """Ask for a mode, run until it has settled; return the time [s] and the tilt [deg]."""
        accepted, message = self.controller.request_mode(mode)
        assert accepted, message
        start, greatest = self.time, 0.0
        while self.time - start < most:
            self.run(0.02)
            greatest = max(greatest, self.tilt)
            if self.controller.mode.value == mode and self.controller.present.settled:
                return self.time - start, greatest
        raise AssertionError(f"{mode}: {self.controller.mode}, {self.controller.context.reason}")

    @property
    def base_height(self):
        return float(self.data.qpos[2])

    @property
    def perch_touches(self):
        perch = self.model.geom("perch").id
        return any(perch in (contact.geom1, contact.geom2) for contact in self.data.contact)

    @property
    def feet_above_ground(self):
        feet = [self.data.site(name).xpos[2] for name in self.robot.foot_names]
        return min(feet) - self.robot.foot_radius

    def margin(self):
        """Distance of the centre of mass from the nearest edge of the perch, level [m]."""
        body = self.model.body("base").id
        x, y, _ = self.data.subtree_com[body] - self.data.qpos[:3]
        half = self.robot.perch.size[:2] / 2
        offset = np.abs(np.array((x, y)) - self.robot.perch.position[:2])
        return float((half - offset).min())


@pytest.fixture(scope="module")
def robot():
    robot = MorphingRobot()
    robot.stand()
    return robot


def test_there_and_back(robot):
    """Level within 3 degrees, centre of mass over the perch; at most 6 s each way."""
    crouch, tilt = robot.become("perch")
    assert tilt < 3.0
    assert abs(robot.above_perch) < 0.002 and robot.feet_above_ground > 0.015
    assert robot.margin() > 0.02
    assert robot.controller.body.estimator.position[2] == pytest.approx(robot.base_height, abs=0.01)
    splay, tilt = robot.become("splay")
    assert tilt < 3.0 and crouch + splay < 6.0
    assert robot.margin() > 0.02
    robot.run(0.3)
    assert robot.controller.present.lift_centred
    geometry = rotor_geometry(ROBOT, robot.data.qpos[7:])  # the true one
    assert np.linalg.norm(geometry.position.mean(axis=0)[:2]) < 0.008
    assert geometry.axis[:, 2].min() > math.cos(math.radians(3.0))
    fold, tilt = robot.become("perch")
    assert tilt < 3.0
    rise, tilt = robot.become("stand")
    assert tilt < 3.0 and fold + rise < 6.0
    assert robot.data.qpos[2] == pytest.approx(ROBOT.stand_height + ROBOT.foot_radius, abs=0.01)
    assert robot.controller.counters.faults == 0
    assert robot.peak_torque.max() < ROBOT.bus_servo.torque_limit


def test_the_perch_is_felt_when_it_touches():
    """Told by the feet's load alone, two seconds after the crouch has begun (T19)."""
    robot = MorphingRobot(options=WorldOptions(seed=2, contact="thesis_model"))
    robot.stand()
    assert robot.controller.request_mode("perch")[0]
    start, touched, felt = robot.time, None, None
    while felt is None and robot.time - start < 4.0:
        robot.run(0.01)
        if touched is None and robot.perch_touches:
            touched = robot.time - start
        if robot.controller.present.touching:
            felt = robot.time - start
    assert 1.5 < touched < 2.5
    assert touched < felt < touched + 0.3


@pytest.mark.in_a_copy
def test_without_ground_under_the_perch_it_stands_up_again(robot):
    """On blocks under its feet the body sinks into nothing: the perch touches nothing."""
    robot.data.qpos[2] += 0.05
    for name in ("perch", "perch_struts"):
        robot.model.geom(name).contype = robot.model.geom(name).conaffinity = 0
    assert robot.controller.request_mode("perch")[0]
    reasons = set()
    for _ in range(60):
        robot.run(0.1)
        reasons.add(robot.controller.context.reason)
        if robot.controller.mode.value == "stand":
            break
    assert "no ground is felt under the perch" in reasons
    assert robot.controller.mode.value == "stand"


def test_what_has_not_been_measured_is_not_begun(robot):
    """No splay from standing, none before the body rests; no standing up with splayed legs."""
    accepted, message = robot.controller.request_mode("splay")
    assert not accepted and "cannot follow" in message
    assert robot.controller.request_mode("perch")[0]
    robot.run(1.0)
    accepted, message = robot.controller.request_mode("splay")
    assert not accepted and "does not rest on its perch" in message
    robot.run(3.0)
    robot.become("splay")
    accepted, message = robot.controller.request_mode("stand")
    assert not accepted and "cannot follow" in message


def test_after_a_fault_splayed_legs_fold_before_they_stand(robot):
    """Let go and damped on the perch the arms sink; they are no legs to stand up on."""
    if robot.controller.mode.value != "splay":
        robot.become("perch")
        robot.become("splay")
    robot.controller.lose_drives("a servo is lost")
    assert robot.controller.mode.value == "damping"
    robot.run(1.0)
    assert robot.controller.request_mode("passive")[0]
    robot.run(0.1)
    accepted, message = robot.controller.request_mode("stand_up")
    assert not accepted and "splayed: ask for perch" in message
    _, tilt = robot.become("perch")
    assert tilt < 3.0
    robot.become("stand")
    assert robot.controller.body.contacts.contact.all()
