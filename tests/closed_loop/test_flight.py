"""The controller flies the simulated robot in one process: take-off, hold, landing, faults."""

import math

import numpy as np
import pytest
from flying import FlyingRobot

from husky_control.flight.hover import HoverPhase
from husky_control.flight.hover_gains import HoverGains

HEIGHT = HoverGains().height


pytestmark = pytest.mark.in_a_copy


@pytest.fixture(scope="module")
def standing():
    """A robot that stands, and does not hear its camera."""
    robot = FlyingRobot()
    robot.gear.frozen = True
    robot.stand()
    return robot


@pytest.fixture(scope="module")
def flying(standing):
    """The robot hovers; and the place where it stood [m]."""
    robot = standing
    robot.gear.frozen = False
    robot.arm()
    ground = robot.world.base_position.copy()
    accepted, message = robot.controller.request_mode("fly")
    assert accepted, message
    robot.run(6.0)
    assert robot.controller.mode.value == "fly", robot.controller.reason
    return robot, ground


def watch(robot, duration, until=None):
    """Positions [m] (n, 3) and tilts [rad] (n,) of every tick, half a second beyond a mode."""
    positions, tilts, beyond = [], [], 0
    for _ in range(round(duration / 0.002)):
        robot.tick()
        beyond += robot.controller.mode.value == until
        if beyond > 250:
            break
        positions.append(robot.world.base_position.copy())
        tilts.append(robot.tilt)
    return np.array(positions), np.array(tilts)


def test_flight_is_refused_without_fans_and_without_the_camera(standing):
    """The first test: then it flies."""
    robot = standing
    assert "fans are not armed" in robot.controller.request_mode("fly")[1]
    robot.arm()
    accepted, message = robot.controller.request_mode("fly")
    assert not accepted and "T265" in message
    assert robot.controller.mode.value == "stand" and not robot.controller.hover.active


def test_hovers_above_where_it_stood_and_lands_there(flying):
    robot, ground = flying
    positions, tilts = watch(robot, 3.0)
    assert np.linalg.norm(positions - (ground + (0.0, 0.0, HEIGHT)), axis=1).max() < 0.2
    assert math.degrees(tilts.max()) < 3.0
    # The odometry goes on in the air.
    before = robot.controller.body.estimator.position.copy()
    assert before[2] == pytest.approx(robot.world.base_position[2], abs=0.05)
    assert robot.controller.request_mode("stand") == (True, "landing")
    positions, tilts = watch(robot, 6.0, until="stand")
    assert robot.controller.mode.value == "stand", robot.controller.hover.phase
    assert robot.controller.reason == "landed" and not robot.controller.counters.faults
    assert -np.diff(positions[:, 2]).min() / 0.002 < 0.35
    assert robot.thrust < 0.5
    assert robot.world.base_position[2] == pytest.approx(ground[2], abs=0.01)
    assert np.linalg.norm(robot.world.base_position[:2] - ground[:2]) < 0.15
    assert robot.controller.body.contacts.contact.all()
    # It walks as ever.
    assert robot.controller.request_mode("walk")[0]
    robot.run(1.0, (0.2, 0.0, 0.0))
    assert robot.controller.mode.value == "walk", robot.controller.reason


def test_without_the_camera_it_lands_level_and_stands(flying):
    robot, ground = flying
    robot.gear.frozen = True
    positions, tilts = watch(robot, 7.0, until="stand")
    assert robot.controller.mode.value == "stand", robot.controller.hover.phase
    assert robot.controller.reason.startswith("T265 lost")
    assert math.degrees(tilts.max()) < 4.0
    assert np.linalg.norm(positions[:, :2] - ground[:2], axis=1).max() < 0.5
    assert -np.diff(positions[:, 2]).min() / 0.002 < 0.6


def test_a_jump_of_the_camera_does_not_throw_it_around(flying):
    robot, _ = flying
    before = robot.world.base_position.copy()
    robot.gear.camera.inject("jump", 0.5)
    positions, tilts = watch(robot, 2.0)
    assert robot.controller.hover.jumps == 1 and "jumped" in robot.controller.reason
    assert robot.controller.mode.value == "fly"
    assert np.linalg.norm(positions - before, axis=1).max() < 0.1
    assert math.degrees(tilts.max()) < 3.0


def test_fans_that_are_lost_end_in_damping(flying):
    robot, _ = flying
    robot.autopilot.vehicle.logic.terminate(True)
    robot.run(1.5)
    assert robot.controller.mode.value == "damping"
    assert robot.controller.reason == "the fans are lost in flight"
    assert robot.thrust < 1.0 and not robot.controller.hover.active


def test_damping_in_flight_lets_the_thrust_fade_level(flying):
    robot, _ = flying
    force = robot.controller.hover.force
    assert robot.controller.request_mode("damping")[0]
    robot.run(0.1)
    assert robot.controller.hover.phase is HoverPhase.FADE
    assert 0.7 * force < robot.controller.hover.force < force
    robot.run(2.0)
    assert robot.thrust < 1.0 and not robot.controller.hover.active
    # What is asked of the fans is a wrench of nothing again.
    assert robot.controller.assist.force == 0.0
