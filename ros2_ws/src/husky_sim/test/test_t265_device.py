"""The simulated T265 against the truth that it is told, by way of the driver's own code."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_description.parameters import frozen
from husky_description.robot import load_robot
from husky_drivers.t265.frames import base_pose, odometry
from husky_drivers.t265.gate import PoseGate
from husky_drivers.t265.wire import START, FrameParser
from husky_sim.devices.t265.device import T265Device

FIGURES = load_robot().t265
TILTED = dataclasses.replace(FIGURES, rpy=frozen([0.1, 0.4, -0.3]))
EXACT = {
    "drift": 0.0,
    "position_noise": 0.0,
    "attitude_noise": 0.0,
    "velocity_noise": 0.0,
    "angular_velocity_noise": 0.0,
    "acceleration_noise": 0.0,
}
STEP = 0.005
PERIOD_NS = 5_000_000
LEVEL = (0.0, 0.0, 0.0, 1.0)
ZERO = (0.0, 0.0, 0.0)


class Walk:
    """A base that swings about in all six directions, with its derivatives in closed form.

    The attitude is a constant, then turns about x of base: its angular velocity is exact.
    """

    start = Rotation.from_euler("ZYX", [2.0, 0.3, -0.2])

    def at(self, t):
        position = np.array([1.0 + 0.8 * t, -2.0 + 0.3 * math.sin(2 * t), 0.5 + 0.1 * math.cos(t)])
        velocity = np.array([0.8, 0.6 * math.cos(2 * t), -0.1 * math.sin(t)])
        attitude = self.start * Rotation.from_rotvec([0.5 * math.sin(3 * t), 0.0, 0.0])
        return position, attitude, velocity, np.array([1.5 * math.cos(3 * t), 0.0, 0.0])


def listening(figures=FIGURES, seed=1):
    device = T265Device(figures, seed)
    device.feed(START)
    return device


def feed(device, t, position, attitude, velocity, rate):
    quaternion = attitude.as_quat() if isinstance(attitude, Rotation) else attitude
    device.sample(round(t / STEP) * PERIOD_NS, position, quaternion, velocity, rate)


def run(device, duration, motion=Walk()):  # noqa: B008 - has no state
    """Return the frames of a motion."""
    parser = FrameParser()
    frames = []
    for k in range(round(duration / STEP)):
        feed(device, k * STEP, *motion.at(k * STEP))
        frames += parser.feed(device.take_output())
    return frames


class Rest:
    def at(self, t):
        return ZERO, LEVEL, ZERO, ZERO


# Round trip -------------------------------------------------------------------------------------
def camera_truth(figures, motion, t):
    """Pose and derivatives of the camera in world, by SciPy."""
    position, attitude, velocity, rate = motion.at(t)
    mount = attitude.apply(figures.position.tolist())
    rate = attitude.apply(rate)
    return (
        position + mount,
        attitude * Rotation.from_euler("xyz", figures.rpy.tolist()),
        velocity + np.cross(rate, mount),
        rate,
    )


@pytest.mark.parametrize("figures", [FIGURES, TILTED])
@pytest.mark.parametrize("noisy", [False, True])
def test_from_the_true_pose_to_odometry(figures, noisy):
    motion = Walk()
    frames = run(listening(figures if noisy else dataclasses.replace(figures, **EXACT)), 4.0)
    assert [frame.number for frame in frames] == list(range(800))
    assert [frame.time_ns for frame in frames] == [k * PERIOD_NS for k in range(800)]
    origin, attitude, _, _ = camera_truth(figures, motion, 0.0)
    forward = attitude.apply([1.0, 0.0, 0.0])
    start = Rotation.from_euler("z", math.atan2(forward[1], forward[0]))
    mount_rotation = tuple(Rotation.from_euler("xyz", figures.rpy.tolist()).as_quat())
    # At low confidence noise is four times its figure; 6 sigma of it, and the drift of 3.5 m.
    scale = 24.0 if noisy else 0.0
    drift = figures.drift if noisy else 0.0
    for frame in frames[::7]:
        t = frame.number * STEP
        position, attitude, velocity, rate = camera_truth(figures, motion, t)
        pose, twist = odometry(frame)
        near = 2e-6 + scale * figures.position_noise + 3.5 * drift
        assert pose[:3] == pytest.approx(start.inv().apply(position - origin), abs=near)
        error = Rotation.from_quat(pose[3:]) * (start.inv() * attitude).inv()
        assert error.magnitude() < 2e-6 + scale * figures.attitude_noise + drift
        near = (
            3e-6 + scale * figures.velocity_noise + 3.0 * (scale * figures.attitude_noise + drift)
        )
        assert twist[:3] == pytest.approx(attitude.inv().apply(velocity), abs=near)
        near = (
            3e-6
            + scale * figures.angular_velocity_noise
            + 2.0 * (scale * figures.attitude_noise + drift)
        )
        assert twist[3:] == pytest.approx(attitude.inv().apply(rate), abs=near)

        # And base, which sits still in the camera.
        position, attitude, _, _ = motion.at(t)
        base = base_pose(pose, tuple(figures.position), mount_rotation)
        near = 3e-6 + scale * (figures.position_noise + 0.3 * figures.attitude_noise) + 4.0 * drift
        assert base[:3] == pytest.approx(start.inv().apply(position - origin), abs=near)
        error = Rotation.from_quat(base[3:]) * (start.inv() * attitude).inv()
        assert error.magnitude() < 3e-6 + scale * figures.attitude_noise + drift


def test_the_frame_is_in_the_cameras_own_axes():
    """Forward is -z, left is -x, up is y; and turning left is turning about y."""

    class Away:
        def at(self, t):
            return (t, 2 * t, 3 * t), LEVEL, (1.0, 2.0, 3.0), ZERO

    frame = run(listening(dataclasses.replace(FIGURES, **EXACT)), 1.0, Away())[-1]
    t = 0.995
    assert frame.translation == pytest.approx((-2 * t, 3 * t, -t), abs=1e-6)
    assert frame.velocity == pytest.approx((-2.0, 3.0, -1.0))

    class Left:
        def at(self, t):
            return ZERO, Rotation.from_rotvec([0.0, 0.0, t]), ZERO, (0.0, 0.0, 1.0)

    frame = run(listening(dataclasses.replace(FIGURES, **EXACT)), 1.0, Left())[-1]
    assert Rotation.from_quat(frame.rotation).as_rotvec() == pytest.approx((0, t, 0), abs=1e-6)
    assert frame.angular_velocity == pytest.approx((0.0, 1.0, 0.0))


def test_velocities_and_accelerations_are_derivatives_of_the_pose():
    frames = run(listening(dataclasses.replace(TILTED, **EXACT)), 2.0)
    times = np.array([frame.time_ms for frame in frames]) * 1e-3
    position = np.array([frame.translation for frame in frames])
    velocity = np.array([frame.velocity for frame in frames])
    # Central differences of a motion of 3 rad/s: 1e-4 of the value, and the rounding of floats.
    slope = np.gradient(position, times, axis=0)[1:-1]
    assert slope == pytest.approx(velocity[1:-1], abs=2e-3)
    rate = np.array([frame.angular_velocity for frame in frames])
    rotations = Rotation.from_quat([frame.rotation for frame in frames])
    turned = (rotations[2:] * rotations[:-2].inv()).as_rotvec() / (2.0 * STEP)
    assert turned == pytest.approx(rate[1:-1], abs=2e-3)
    acceleration = np.array([frame.acceleration for frame in frames])
    assert acceleration[1:] == pytest.approx(np.diff(velocity, axis=0) / STEP, abs=2e-3)
    angular = np.array([frame.angular_acceleration for frame in frames])
    assert angular[1:] == pytest.approx(np.diff(rate, axis=0) / STEP, abs=2e-3)


# Errors -----------------------------------------------------------------------------------------
class Course:
    """50 m at 1 m/s: straight on, to and fro, or in circles, by name; level."""

    def __init__(self, kind):
        self.kind = kind

    def at(self, t):
        if self.kind == "straight":
            return (t, 0.0, 0.0), LEVEL, (1.0, 0.0, 0.0), ZERO
        if self.kind == "to and fro":
            leg, part = divmod(t, 10.0)
            there = leg % 2 == 0
            return (part if there else 10 - part, 0, 0), LEVEL, (1 if there else -1, 0, 0), ZERO
        s, c = math.sin(0.5 * t), math.cos(0.5 * t)
        turn = (0.0, 0.0, math.sin(0.25 * t), math.cos(0.25 * t))
        return (2 * s, -2 * c, 0.2 * t), turn, (c, s, 0.2), (0.0, 0.0, 0.5)


@pytest.mark.parametrize(
    "kind", [pytest.param("straight", marks=pytest.mark.slow), "to and fro", "circles"]
)
def test_drift_stays_below_one_percent_of_the_distance(kind):
    """At each instant and for each seed; and it is there."""
    at_origin = {"position": frozen([0.0] * 3), "drift_length": 5.0}
    figures = dataclasses.replace(FIGURES, **{**EXACT, "drift": FIGURES.drift, **at_origin})
    exact = dataclasses.replace(figures, drift=0.0)
    course = Course(kind)
    truth = np.array([frame.translation for frame in run(listening(exact), 50.0, course)])
    travelled = np.cumsum(np.linalg.norm(np.diff(truth, axis=0), axis=1))
    assert travelled[-1] == pytest.approx(50.0, abs=1.1)
    final = []
    for seed in range(4):
        frames = run(listening(figures, seed), 50.0, course)
        error = np.linalg.norm([f.translation for f in frames] - truth, axis=1)[1:]
        assert np.all(error < 0.01 * travelled + 2e-6)
        final.append(error[-1] / travelled[-1])
    assert np.sqrt(np.mean(np.square(final))) > 0.0003


def test_a_wrong_heading_is_wrong_in_attitude_and_motion_alike():
    """So the twist in the camera's own axes does not know of it."""

    class Turn:
        def at(self, t):
            turn = Rotation.from_rotvec([0.0, 0.0, 0.3]) * Rotation.from_rotvec([t, 0.0, 0.0])
            return (0.0, 0.0, 0.3 * t), turn, (0.0, 0.0, 0.3), (1.0, 0.0, 0.0)

    figures = dataclasses.replace(FIGURES, **{**EXACT, "drift": 0.1}, position=frozen([0.0] * 3))
    headings = []
    for seed in range(5):
        frame = run(listening(figures, seed), 1.0, Turn())[-1]
        pose, twist = odometry(frame)
        headings.append(abs(Rotation.from_quat(pose[3:]).as_euler("ZYX")[0]))
        assert twist[3:] == pytest.approx((1.0, 0.0, 0.0), abs=1e-5)
        speed = 0.3 * np.array([0.0, math.sin(0.995), math.cos(0.995)])
        assert twist[:3] == pytest.approx(speed, abs=0.3 * 0.04 + 1e-6)
    assert max(headings) > 0.01


def test_standing_still_does_not_drift_and_scatters_as_ordered():
    frames = run(listening(dataclasses.replace(FIGURES, warm_up=0.0)), 20.0, Rest())
    for field, figure in (
        ("translation", FIGURES.position_noise),
        ("velocity", FIGURES.velocity_noise),
        ("acceleration", FIGURES.acceleration_noise),
        ("angular_velocity", FIGURES.angular_velocity_noise),
    ):
        values = np.array([getattr(frame, field) for frame in frames])
        assert values.mean(axis=0) == pytest.approx(ZERO, abs=5 * figure / math.sqrt(4000))
        # The relative error of a deviation of 4000 numbers is 1.1 %.
        assert values.std(axis=0) == pytest.approx([figure] * 3, rel=0.06)
    turn = Rotation.from_quat([frame.rotation for frame in frames]).as_rotvec()
    assert turn.std(axis=0) == pytest.approx([FIGURES.attitude_noise] * 3, rel=0.06)
    assert abs(turn.mean(axis=0)[1]) < FIGURES.drift  # Heading is wrong from the start.
    assert turn.mean(axis=0)[::2] == pytest.approx((0, 0), abs=5 * FIGURES.attitude_noise / 63)


def output(device, duration=3.0):
    data = b""
    for k in range(round(duration / STEP)):
        feed(device, k * STEP, *Walk().at(k * STEP))
        data += device.take_output()
    return data


def test_a_seed_gives_the_same_bytes_whenever_the_host_listens():
    device = listening(seed=3)
    first = output(device)
    assert len(first) == 600 * 102
    assert output(listening(seed=3)) == first
    assert output(listening(seed=4)) != first
    device.restart(3)
    assert output(device) == first
    late = T265Device(FIGURES, 3)
    heard = b""
    for k in range(600):
        if k == 100:
            late.feed(b"noise" + START[:2])
            assert not late.streaming
            late.feed(START[2:])
        feed(late, k * STEP, *Walk().at(k * STEP))
        heard += late.take_output()
    assert late.streaming
    assert heard == first[100 * 102 :]


def test_confidence_is_low_at_the_start_and_while_it_turns_fast():
    class Spin:
        def at(self, t):
            fast = 4.0 <= t < 5.0
            return ZERO, LEVEL, ZERO, (0.0, 0.0, 4.1 if fast else 3.9)

    frames = run(listening(), 7.0, Spin())
    seen = {t: frames[round(t / STEP)].tracker_confidence for t in (0, 0.9, 1.5, 3, 4.5, 5.4, 6)}
    assert seen == {0: 1, 0.9: 1, 1.5: 2, 3: 3, 4.5: 1, 5.4: 1, 6: 3}
    mapper = [frame.mapper_confidence for frame in frames]
    assert (mapper[0], mapper[-1]) == (0, 3)
    assert mapper == sorted(mapper)
    quiet = np.std([f.translation for f in frames[600:800]])
    assert np.std([f.translation for f in frames[800:1000]]) == pytest.approx(4 * quiet, rel=0.3)


def test_output_that_nobody_takes_is_bounded():
    device = listening()
    for k in range(200):
        feed(device, k * STEP, *Rest().at(0))
    assert len(device.take_output()) < 4096 + 102


# Faults -----------------------------------------------------------------------------------------
def position(device, k):
    feed(device, k * STEP, *Rest().at(0))
    return np.array(FrameParser().feed(device.take_output())[0].translation)


@pytest.mark.parametrize(("intensity", "size"), [(None, 0.3), (2.0, 2.0)])
def test_a_jump_is_a_horizontal_step_that_stays(intensity, size):
    device = listening(dataclasses.replace(FIGURES, **EXACT))
    assert position(device, 0) == pytest.approx(ZERO)
    device.inject("jump", intensity)
    jumped = position(device, 1)
    assert np.linalg.norm(jumped) == pytest.approx(size)
    assert jumped[1] == 0.0
    device.inject("")
    assert position(device, 2) == pytest.approx(jumped)
    device.restart(1)
    assert position(device, 0) == pytest.approx(ZERO)
    device.inject("jump", intensity)
    assert position(device, 1) == pytest.approx(jumped)


def test_frozen_it_says_nothing_and_then_goes_on():
    device = listening()
    first = output(device, 0.5)
    device.inject("freeze")
    assert output(device, 0.5) == b""
    device.inject("")
    device.restart(1)
    assert output(device, 0.5) == first


def test_lost_it_drifts_away_like_an_accelerometer():
    device = listening(dataclasses.replace(FIGURES, **EXACT))
    device.inject("lost", 0.2)
    frames = run(device, 2.0, Rest())
    assert {(frame.tracker_confidence, frame.mapper_confidence) for frame in frames} == {(0, 0)}
    away = np.linalg.norm([frame.translation for frame in frames], axis=1)
    expected = [0.5 * 0.2 * (STEP * (k + 1)) ** 2 for k in range(400)]
    assert away == pytest.approx(expected, abs=2e-3)
    assert np.linalg.norm(frames[-1].velocity) == pytest.approx(0.4)
    device.inject("")
    feed(device, 2.0, *Rest().at(0))
    frame = FrameParser().feed(device.take_output())[0]
    assert np.linalg.norm(frame.velocity) == pytest.approx(0.0)
    assert np.linalg.norm(frame.translation) == pytest.approx(away[-1])
    assert frame.tracker_confidence > 0


def test_a_power_cycle_starts_at_zero_where_it_is():
    device = listening(dataclasses.replace(FIGURES, **EXACT))
    frames = run(device, 3.0)
    assert frames[-1].tracker_confidence == 3
    assert np.linalg.norm(frames[-1].translation) > 2.0
    device.inject("power_cycle")
    feed(device, 3.0, *Walk().at(3.0))
    frame = FrameParser().feed(device.take_output())[0]
    assert frame.translation == ZERO
    assert (frame.number, frame.tracker_confidence, frame.time_ms) == (0, 1, 3000.0)


def test_faults_are_refused_with_what_there_is():
    device = T265Device(FIGURES)
    with pytest.raises(ValueError, match="no fault 'fog'; there are jump, freeze, lost"):
        device.inject("fog")
    for intensity in (-1.0, math.nan, 101.0):
        with pytest.raises(ValueError, match="must be within 0 and 100"):
            device.inject("jump", intensity)


@pytest.mark.parametrize(("fault", "jumps"), [("", 0), ("jump", 1), ("power_cycle", 1)])
def test_the_drivers_gate_sees_what_was_done(fault, jumps):
    """And takes noise, the start, and 1.5 rad/s of swinging for none."""
    device = listening()
    parser, gate = FrameParser(), PoseGate()
    for k in range(1200):
        if k == 800:
            device.inject(fault)
        feed(device, k * STEP, *Walk().at(k * STEP))
        assert all([gate.accept(frame) for frame in parser.feed(device.take_output())])
    assert (gate.counters.good, gate.counters.jumps) == (1200, jumps)
