"""Hovering, against a body and fans of a few lines, and the camera's poses by closed forms."""

import copy
import functools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from husky_control.estimation.t265_pose import BaseTracker
from husky_control.flight.hover import AIRBORNE, Hover, HoverPhase
from husky_control.flight.hover_gains import HoverGains
from husky_control.tick_data import T265Pose
from husky_description.robot import load_robot
from husky_description.rotation import about_z, conjugate, multiply, rotate, to_rotation_vector

ROBOT = load_robot()
LEVER = np.array(ROBOT.t265.position)
G = 9.80665
DT = 0.002
MOUNT = Rotation.from_euler("xyz", ROBOT.t265.rpy)
MOUNT_QUATERNION = tuple(MOUNT.as_quat())
TO_CAMERA = MOUNT.as_matrix().T
ANGLE = st.floats(-3.0, 3.0)
PLACE = st.tuples(*[st.floats(-5.0, 5.0)] * 3)


def seen(base, position, velocity=(0.0, 0.0, 0.0), rate=(0.0, 0.0, 0.0), stamp=0.0, variance=0.01):
    """What the camera says of a base: Rotation, place [m], velocity in world, rate in base."""
    turning = np.cross(rate, LEVER)
    pose = unturning(base.as_matrix(), base.as_quat(), position, velocity, turning)
    pose.stamp, pose.variance = stamp, variance
    pose.angular_velocity[:] = TO_CAMERA @ rate
    return pose


def unturning(rotation, quaternion, position, velocity, turning=0.0):
    """The same of a base that does not turn: matrix, quaternion, place [m], velocity in world."""
    pose = T265Pose(stamp=0.0, variance=0.01)
    pose.position[:] = position + rotation @ LEVER
    pose.orientation[:] = multiply(quaternion, MOUNT_QUATERNION)
    pose.velocity[:] = TO_CAMERA @ (velocity @ rotation + turning)
    return pose


AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def matrix(quaternion):
    return np.array([rotate(quaternion, axis) for axis in AXES]).T


class Body:
    """A robot with fans of one lag, an attitude loop of another, and ground at height 0."""

    def __init__(self, weight=1.0, most=math.inf, yaw=0.3, trim=(0.0, 0.0)):
        self.hover = Hover(ROBOT)
        self.mass = weight * self.hover.mass
        self.most = most
        self.position, self.velocity = np.zeros(3), np.zeros(3)
        self.camera = np.zeros(3)  # error of the camera's position
        self.camera_yaw = 0.0
        self.base = about_z(yaw)  # a quaternion: SciPy's rotations take three times as long
        self.rotation = matrix(self.base)
        self.trim = tuple(Rotation.from_euler("xyz", (*trim, 0.0)).as_quat())
        self.thrust = self.time = 0.0
        self.blind = False
        self.variance = 0.01
        self.poses = [self.look()] * 6
        self.specific_force = np.array((0.0, 0.0, G))
        self.impact = 0.0

    def look(self):
        rotation, base, place, velocity = self.rotation, self.base, self.position, self.velocity
        if self.camera_yaw:
            turn = Rotation.from_euler("z", self.camera_yaw)
            base, rotation = multiply(about_z(self.camera_yaw), base), turn.as_matrix() @ rotation
            place, velocity = turn.apply(place), turn.apply(velocity)
        pose = unturning(rotation, base, place + self.camera, velocity)
        pose.stamp, pose.variance = self.time, self.variance
        return pose

    @property
    def yaw(self):
        return math.atan2(self.rotation[1, 0], self.rotation[0, 0])

    def begin(self):
        self.hover.begin(self.poses[0], self.yaw, self.yaw, 0.0)
        return self

    def step(self):
        hover = self.hover
        down = 4 if self.position[2] <= 0.0 and self.thrust < 0.8 * self.mass * G else 0
        force = self.specific_force
        hover.tick(self.time, self.poses[0], self.rotation, force, down, self.yaw, DT)
        turn = multiply(multiply(self.trim, hover.attitude), conjugate(self.base))
        x, y, z = (0.5 * DT / 0.25 * way for way in to_rotation_vector(turn))
        self.base = multiply((x, y, z, math.sqrt(1.0 - x * x - y * y - z * z)), self.base)
        self.rotation = matrix(self.base)
        self.thrust += (min(hover.force, self.most) - self.thrust) * DT / 0.12
        lift = self.rotation[:, 2] * self.thrust / self.mass
        before = self.velocity.copy()
        self.velocity = self.velocity + (lift - (0.0, 0.0, G)) * DT
        if self.position[2] <= 0.0 and self.velocity[2] < 0.0:
            self.impact = max(self.impact, -self.velocity[2])
            self.velocity = np.zeros(3)
        self.position = self.position + self.velocity * DT
        self.specific_force = ((self.velocity - before) / DT + (0.0, 0.0, G)) @ self.rotation
        self.time += DT
        if not self.blind:
            self.poses = [*self.poses[1:], self.look()]  # 10 ms old when it is used

    def run(self, duration, until=lambda body: False):
        track = []
        for _ in range(round(duration / DT)):
            self.step()
            track.append(self.position.copy())
            if until(self):
                break
        return np.array(track)


@functools.cache
def _taken_off():
    body = Body().begin()
    body.run(8.0)
    assert body.hover.phase is HoverPhase.HOLD
    return body


def hovering():
    """A body that has taken off and holds its place: flown once, a copy for each test."""
    return copy.deepcopy(_taken_off())


# ------------------------------------------------------------- the camera's poses


@given(ANGLE, st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), PLACE, PLACE, PLACE)
def test_the_tracker_finds_the_base_behind_the_camera(yaw, pitch, roll, place, velocity, rate):
    base = Rotation.from_euler("ZYX", (yaw, pitch, roll))
    tracker = BaseTracker(ROBOT)
    tracker.begin(seen(base, place, velocity, rate), 0.0)
    np.testing.assert_allclose(tracker.position, place, atol=1e-9)
    np.testing.assert_allclose(tracker.velocity, velocity, atol=1e-9)
    assert tracker.yaw == pytest.approx(yaw, abs=1e-9)


@given(PLACE, st.floats(0.06, 3.0), ANGLE)
def test_motion_is_no_jump_and_a_jump_no_motion(velocity, size, yaw):
    base = Rotation.from_euler("z", yaw)
    tracker = BaseTracker(ROBOT)
    tracker.begin(seen(base, (0.0, 0.0, 0.0), velocity), 0.0)
    way = 0.005 * np.array(velocity)
    assert tracker.follow(seen(base, way, velocity, stamp=0.005), 0.0) is None
    expected = 2 * way
    jump = tracker.follow(seen(base, expected + (0.0, size, 0.0), velocity, stamp=0.01), 0.0)
    assert jump is not None
    np.testing.assert_allclose(jump[0], expected, atol=1e-9)
    assert tracker.jumps == 1


def test_a_heading_that_turns_without_the_imu_is_a_jump():
    tracker = BaseTracker(ROBOT)
    tracker.begin(seen(Rotation.identity(), (0.0, 0.0, 0.0)), 1.0)
    turned = Rotation.from_euler("z", 0.3)
    assert tracker.follow(seen(turned, (0.0, 0.0, 0.0), stamp=0.005), 1.3) is None
    assert tracker.follow(seen(Rotation.identity(), (0.0, 0.0, 0.0), stamp=0.01), 1.3) is not None


@pytest.mark.parametrize(
    ("change", "usable"),
    [
        ({}, True),
        ({"variance": 0.1}, True),
        ({"variance": 1.0}, False),
        ({"stamp": -0.2}, False),
        ({"stamp": 0.5}, False),
    ],
)
def test_only_fresh_and_confident_poses_are_flown_by(change, usable):
    assert seen(Rotation.identity(), (1.0, 0.0, 0.0), **change).usable(0.01) is usable


@pytest.mark.parametrize("name", ["position", "orientation", "velocity", "angular_velocity"])
def test_a_pose_that_is_no_number_is_not_flown_by(name):
    pose = seen(Rotation.identity(), (0.0, 0.0, 0.0))
    getattr(pose, name)[1] = math.nan
    assert not pose.usable(0.0)


# ------------------------------------------------------------------- the flight


@given(st.floats(-4, 4), st.floats(-4, 4), ANGLE)
def test_the_attitude_accelerates_as_it_is_asked_to(forward, left, yaw):
    hover = Hover(ROBOT)
    hover._yaw = yaw
    hover._tilt(forward, left)
    x, y, z = Rotation.from_quat(hover.attitude).apply((0.0, 0.0, 1.0))
    level = Rotation.from_euler("z", -yaw).apply((x, y, 0.0)) * G / z
    np.testing.assert_allclose(level[:2], (forward, left), atol=1e-6)
    assert np.linalg.norm(hover.attitude) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "weight", [*(pytest.param(slow, marks=pytest.mark.slow) for slow in (0.95, 1.0)), 1.04]
)
def test_takes_off_holds_its_height_and_lands(weight):
    body = Body(weight=weight).begin()
    forces = [0.0]
    for _ in range(round(8.0 / DT)):
        body.step()
        forces.append(body.hover.force)
    climbing = np.array(forces)[: round(1.0 / DT)]
    assert np.abs(np.diff(climbing)).max() <= body.hover.gains.take_off_rate * 75.0 * DT * 1.01
    track = body.run(6.0)
    height = body.hover.gains.height
    assert np.abs(track - (0.0, 0.0, height)).max() < 0.05
    body.hover.land()
    body.run(10.0, lambda b: b.hover.done)
    assert body.hover.done and body.position[2] <= 0.0
    assert body.impact < 0.3
    body.hover.finish()
    assert not body.hover.active and body.hover.force == 0.0


def test_a_level_that_is_not_level_is_trimmed():
    body = Body(trim=(0.02, -0.02)).begin()
    body.run(8.0)
    assert body.hover.phase is HoverPhase.HOLD
    track = body.run(15.0)
    assert np.abs(track[:, :2]).max() < 0.3
    assert np.abs(track[-1, :2]).max() < 0.05


def test_fans_that_do_not_lift_give_the_weight_back():
    body = Body(most=0.98 * Hover(ROBOT).weight).begin()
    track = body.run(10.0, lambda b: b.hover.done)
    assert body.hover.done and "do not lift" in body.hover.failed
    assert track[:, 2].max() < 0.02


@pytest.mark.parametrize("shift", [(0.3, 0.0, 0.0), (0.0, -1.0, 0.0), (0.2, 0.2, 0.5)])
def test_a_jump_of_the_camera_does_not_move_the_body(shift):
    body = hovering()
    before = body.position.copy()
    body.camera += shift
    track = body.run(4.0)
    assert body.hover.phase is HoverPhase.HOLD and body.hover.jumps == 1
    assert np.abs(track - before).max() < 0.03
    assert "jumped" in body.hover.note


def test_a_camera_that_turns_does_not_move_the_body():
    body = hovering()
    body.position[:2] += 0.02  # off its place: the error must turn, too
    body.run(0.05)
    before = body.position.copy()
    body.camera_yaw = 1.0
    track = body.run(4.0)
    assert body.hover.jumps == 1
    assert np.abs(track - before).max() < 0.06
    assert np.linalg.norm(track[-1, :2]) < 0.02


@pytest.mark.parametrize("kind", ["freeze", "lost"])
def test_without_the_camera_it_lands_level(kind):
    body = hovering()
    if kind == "freeze":
        body.blind = True
    else:
        body.variance = 10.0
    body.run(0.24)
    assert body.hover.phase is HoverPhase.HOLD
    body.run(0.03)
    assert body.hover.phase is HoverPhase.BLIND
    level = Rotation.from_quat(body.hover.attitude).apply((0.0, 0.0, 1.0))
    assert level[2] == pytest.approx(1.0)
    body.run(8.0, lambda b: b.hover.done)
    assert body.hover.done and "T265 lost" in body.hover.failed
    assert body.impact < 0.4
    assert np.abs(body.position[:2]).max() < 0.2


def test_a_camera_that_is_back_in_time_is_flown_by():
    body = hovering()
    body.blind = True
    body.run(0.2)
    body.blind = False
    body.run(2.0)
    assert body.hover.phase is HoverPhase.HOLD and np.abs(body.position - (0, 0, 0.3)).max() < 0.05


@pytest.mark.parametrize("bias", [-0.05, 0.05])
def test_a_blind_landing_ends_with_a_biased_accelerometer(bias):
    body = hovering()
    body.blind = True
    for _ in range(round(10.0 / DT)):
        body.specific_force = body.specific_force + (0.0, 0.0, bias)
        body.step()
        if body.hover.done:
            break
    assert body.hover.done and body.impact < 0.8


@pytest.mark.parametrize("at_once", [False, True])
def test_an_ended_flight_fades(at_once):
    body = hovering()
    hover, force = body.hover, body.hover.force
    hover.end(at_once=at_once)
    assert hover.active and hover.force == (0.0 if at_once else force)
    for _ in range(round(2.0 / DT)):
        before = hover.force
        hover.fade(DT)
        assert before - hover.force <= 1.001 * hover.gains.fade_rate * hover.weight * DT
    assert not hover.active and hover.force == 0.0


EVENT = st.sampled_from(["wait", "land", "freeze", "see", "jump", "lost", "good", "end"])


@settings(max_examples=12)  # each takes a tenth of a second
@given(st.lists(EVENT, min_size=1, max_size=12), st.floats(0.9, 1.05))
def test_whatever_happens_force_and_tilt_stay_within_their_limits(events, weight):
    body = Body(weight=weight).begin()
    for event in events:
        if event == "land":
            body.hover.land()
        elif event in ("freeze", "see"):
            body.blind = event == "freeze"
        elif event in ("lost", "good"):
            body.variance = 10.0 if event == "lost" else 0.01
        elif event == "jump":
            body.camera = body.camera + (0.3, -0.2, 0.1)
        elif event == "end":
            body.hover.end()
        for _ in range(100):
            if body.hover.phase is HoverPhase.FADE:
                body.hover.fade(DT)
            elif body.hover.active:
                body.step()
            assert 0.0 <= body.hover.force <= body.hover.most
            tilt = Rotation.from_quat(body.hover.attitude).apply((0.0, 0.0, 1.0))[2]
            assert tilt >= math.cos(1.02 * HoverGains().tilt_limit)
            assert body.hover.phase in AIRBORNE or body.position[2] < 0.2 or not body.hover.active
