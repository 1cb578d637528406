"""The autopilot flies a rigid body: steps, hover, fail-safes; no ROS and no wire but bytes."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from scipy.spatial.transform import Rotation

from husky_description.gravity import GRAVITY
from husky_description.robot import load_robot
from husky_description.rotation import to_roll_pitch_yaw
from husky_pu.autopilot.autopilot import Autopilot, AutopilotConfig, SensorSample
from husky_pu.autopilot.failsafes import FlightMode
from husky_pu.autopilot.mixer import Mixer
from husky_pu.mavlink.axes import mavlink_attitude, ros_attitude
from husky_sim.propulsion.propulsion_unit import PropulsionUnit

ROBOT = load_robot()
MASS, INERTIA = 2.4, np.diag([0.030, 0.030, 0.050])
HOVER = MASS * GRAVITY / Mixer(ROBOT).max_collective
DT = 0.002
FIELD = np.array([0.0, 0.21, -0.43])  # ENU [gauss]
LEVEL = (1.0, 0.0, 0.0, 0.0)


G_IN_WORLD = np.array([0.0, 0.0, GRAVITY])


def matrix(q):
    """Rotation matrix of a quaternion (x, y, z, w)."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


class Rig:
    """The unit alone, its centre held softly in place; `grounded` holds it altogether."""

    def __init__(
        self,
        seed=1,
        grounded=False,
        inertia=INERTIA,
        attitude=None,
        mass=MASS,
        design=INERTIA,
        **config,
    ):
        self.mass = mass
        self.hovering = mass * GRAVITY / Mixer(ROBOT).max_collective
        self.unit = PropulsionUnit(ROBOT)
        self.autopilot = Autopilot(
            Mixer(ROBOT), AutopilotConfig(inertia=tuple(np.diag(design)), seed=seed, **config)
        )
        self.codec = dialect.MAVLink(None, 1, 191)
        self.inertia, self.grounded = inertia, grounded
        self.quaternion = (attitude or Rotation.identity()).as_quat()  # FLU to ENU
        self.rates = np.zeros(3)
        self.position, self.velocity = np.array([0.0, 0.0, -mass * GRAVITY / 30.0]), np.zeros(3)
        self.force = np.zeros(3)
        self.time_ns = 0
        self.pwm = (0, 0, 0, 0)
        self.sample_hook = None
        self.setpoint = None
        self.rc = None
        self.log = []

    def send(self, message, link="usb"):
        self.autopilot.receive(message.pack(self.codec), link)

    def attitude_message(self, wxyz=LEVEL, thrust=0.0, mask=7, rates=(0.0, 0.0, 0.0)):
        return dialect.MAVLink_set_attitude_target_message(
            self.time_ns // 1_000_000, 1, 1, mask, list(wxyz), *rates, thrust
        )

    def command(self, number, *parameters):
        padded = [*parameters, *[0.0] * (7 - len(parameters))]
        self.send(dialect.MAVLink_command_long_message(1, 1, number, 0, *padded))

    def sensors(self):
        acceleration = self.force / self.mass
        turn = matrix(self.quaternion).T
        flip = np.array([1.0, -1.0, -1.0])
        sample = SensorSample(
            self.time_ns,
            tuple(flip * self.rates),
            tuple(flip * (turn @ (acceleration + G_IN_WORLD))),
            tuple(flip * (turn @ FIELD)),
            101325.0,
            self.unit.battery_voltage,
            self.unit.battery_current,
        )
        return self.sample_hook(sample) if self.sample_hook else sample

    def tick(self):
        if self.setpoint is not None and self.time_ns % 20_000_000 == 0:
            self.send(self.setpoint())
        if self.rc is not None and self.time_ns % 14_000_000 == 0:
            self.autopilot.receive_rc(self.rc())
        self.pwm = self.autopilot.tick(self.sensors())
        wrench = self.unit.step(self.pwm, DT)
        if not self.grounded:
            w = self.rates
            spin = self.inertia @ w
            gyroscopic = np.array(
                [
                    w[1] * spin[2] - w[2] * spin[1],
                    w[2] * spin[0] - w[0] * spin[2],
                    w[0] * spin[1] - w[1] * spin[0],
                ]
            )
            w = self.rates = w + DT * (wrench[3:] - gyroscopic - 0.01 * w) / self.inertia.diagonal()
            x, y, z, s = self.quaternion
            p, q, r = 0.5 * DT * w
            moved = np.array(
                [
                    x + s * p + y * r - z * q,
                    y + s * q + z * p - x * r,
                    z + s * r + x * q - y * p,
                    s - x * p - y * q - z * r,
                ]
            )
            self.quaternion = moved / math.sqrt(moved @ moved)
            thrust = matrix(self.quaternion) @ wrench[:3]
            hold = -30.0 * self.position - 12.0 * self.velocity
            self.force = thrust + hold - self.mass * G_IN_WORLD
            self.velocity = self.velocity + DT * self.force / self.mass
            self.position = self.position + DT * self.velocity
        logic = self.autopilot.vehicle.logic
        self.log.append(
            (
                1e-9 * self.time_ns,
                *self.euler_deg(),
                logic.thrust,
                float(self.unit.thrust.sum()),
                float(max(self.pwm)),
                *np.degrees(to_roll_pitch_yaw(self.autopilot.vehicle.estimator.attitude)),
            )
        )
        self.time_ns += 2_000_000

    def euler_deg(self):
        """Roll, pitch, yaw of the truth in FRD and NED [deg]."""
        w, x, y, z = mavlink_attitude(self.quaternion)
        return np.degrees(to_roll_pitch_yaw((x, y, z, w)))

    def run(self, seconds):
        start = len(self.log)
        for _ in range(round(seconds / DT)):
            self.tick()
        return np.array(self.log[start:])

    @property
    def logic(self):
        return self.autopilot.vehicle.logic

    def texts(self, link="usb"):
        data = self.autopilot.take_output(link)
        parser = dialect.MAVLink(None)
        messages = parser.parse_buffer(data) or []
        return [m.text for m in messages if m.get_type() == "STATUSTEXT"]

    def hover(self, wxyz=None, **kwargs):
        """Arm in OFFBOARD and come to hover with the present heading."""
        heading = wxyz or self.level()
        self.setpoint = lambda: self.attitude_message(heading, 0.0)
        self.run(2.5)
        self.command(176, 1, 6)
        self.command(400, 1)
        self.run(0.1)
        assert self.logic.armed and self.logic.mode is FlightMode.OFFBOARD, self.texts()
        self.setpoint = lambda: self.attitude_message(heading, self.hovering)
        self.run(3.0)
        return heading

    def level(self):
        w, x, y, z = mavlink_attitude(self.quaternion)
        return (w, x, y, z)


@pytest.fixture(scope="module")
def hovering():
    """A rig that hovers, and its heading."""
    rig = Rig()
    return rig, rig.hover()


def turned(wxyz, roll=0.0, pitch=0.0):
    """(w, x, y, z) turned in the body by angles [deg]."""
    w, x, y, z = wxyz
    q = Rotation.from_quat([x, y, z, w]) * Rotation.from_euler("YX", [pitch, roll], degrees=True)
    x, y, z, w = q.as_quat()
    return (w, x, y, z)


SLOW = pytest.mark.slow
"""Further seeds, inertias and fans."""


@pytest.mark.parametrize("seed", [2, *(pytest.param(seed, marks=SLOW) for seed in (1, 3))])
def test_hover_keeps_level_and_heading(seed):
    rig = Rig(seed)
    rig.hover()
    log = rig.run(6.0)
    roll, pitch, yaw = log[:, 1], log[:, 2], log[:, 3] - 90.0
    assert math.sqrt(np.mean(roll**2)) < 1.0  # the accelerometer's bias alone is 0.3 deg
    assert math.sqrt(np.mean(pitch**2)) < 1.0
    assert np.abs(yaw).max() < 5.0  # hard iron of 5 mgauss in 210
    assert np.mean(log[:, 5]) == pytest.approx(MASS * GRAVITY, rel=0.05)


@pytest.mark.parametrize(
    ("factor", "axis"),
    [
        (0.6, 0),
        (1.8, 1),
        *(pytest.param(*row, marks=SLOW) for row in ((0.6, 1), (1.0, 0), (1.0, 1), (1.8, 0))),
    ],
)
def test_step_response(axis, factor):
    """15 deg of roll or pitch with more and less inertia than the gains were made for."""
    rig = Rig(inertia=INERTIA * factor)
    heading = rig.hover()
    angles = {"roll": 15.0} if axis == 0 else {"pitch": 15.0}
    goal = turned(heading, **angles)
    rig.setpoint = lambda: rig.attitude_message(goal, HOVER)
    log = rig.run(3.0)
    angle = log[:, 1 + axis]
    assert angle.max() < 15.0 * 1.35  # overshoot
    assert abs(angle[-500:] - 15.0).max() < 2.0
    risen = log[np.argmax(angle > 13.5), 0] - log[0, 0]
    assert 0.1 < risen < 1.2
    assert abs(log[-500:, 2 - axis]).max() < 2.0


@pytest.mark.in_a_copy
def test_yaw_follows_slowly_but_surely(hovering):
    rig, _ = hovering
    w, x, y, z = mavlink_attitude((Rotation.from_euler("z", -30, degrees=True)).as_quat())
    rig.setpoint = lambda: rig.attitude_message((w, x, y, z), HOVER)
    log = rig.run(5.0)
    assert log[-1, 3] == pytest.approx(120.0, abs=4.0)
    assert abs(log[:, 1:3]).max() < 3.0


@pytest.mark.in_a_copy
def test_body_rates_are_followed(hovering):
    rig, _ = hovering
    rig.setpoint = lambda: rig.attitude_message(LEVEL, HOVER, mask=128, rates=(0.2, 0.0, 0.0))
    log = rig.run(1.5)
    slope = (log[-1, 1] - log[250, 1]) / (log[-1, 0] - log[250, 0])
    assert math.radians(slope) == pytest.approx(0.2, abs=0.04)


def test_moments_go_past_the_control_loops():
    """SET_ACTUATOR_CONTROL_TARGET: the thrusts are those of the mixer's own scales."""
    rig = Rig(grounded=True)

    def setpoint(thrust, moments=(0.0, 0.0, 0.0)):
        return dialect.MAVLink_set_actuator_control_target_message(
            rig.time_ns // 1000, 0, 1, 1, [*moments, thrust, 0.0, 0.0, 0.0, 0.0]
        )

    rig.setpoint = lambda: setpoint(0.0)
    rig.run(2.5)
    rig.command(176, 1, 6)
    rig.command(400, 1)
    rig.run(0.1)
    rig.setpoint = lambda: setpoint(0.4, (0.3, -0.2, 0.1))
    rig.run(2.0)
    wrench = rig.unit.wrench_in_base
    scale = Mixer(ROBOT).moment_scale
    assert wrench[2] == pytest.approx(32.0, rel=0.03)
    expected = np.array([0.3, 0.2, -0.1]) * scale  # FRD to FLU
    # One microsecond of pulse is 0.05 N and bearings carry part of the torque.
    assert wrench[3:] == pytest.approx(expected, abs=0.05)


def test_armed_on_the_ground_nothing_winds_up():
    """The unit cannot move and is not as asked; thrust comes from nothing but the demand."""
    rig = Rig(grounded=True, attitude=Rotation.from_euler("x", 10, degrees=True))
    goal = rig.level()
    level = turned(goal, roll=-10.0)
    rig.setpoint = lambda: rig.attitude_message(level, 0.0)
    rig.run(2.5)
    rig.command(176, 1, 6)
    rig.command(400, 1)
    log = rig.run(3.0)
    assert rig.logic.armed
    assert log[:, 6].max() <= 1000
    rig.setpoint = lambda: rig.attitude_message(level, 0.04)
    rig.run(3.0)
    assert max(map(abs, rig.logic._control.integral)) == 0.0


def test_estimate_is_true_and_unhurried():
    rig = Rig(seed=5)
    rig.hover()
    rig.run(5.0)
    log = np.array(rig.log[-2500:])
    assert np.abs(log[:, 7:9] - log[:, 1:3]).max() < 1.0
    w, x, y, z = mavlink_attitude(rig.quaternion)
    assert np.array(ros_attitude((w, x, y, z))) == pytest.approx(rig.quaternion, abs=1e-9)


def falls_to_zero(log, lost_at, limit=2.0):
    """Thrust never rises from the loss on, and is zero in time."""
    after = log[log[:, 0] >= lost_at]
    assert np.diff(after[:, 4]).max() <= 1e-12
    late = log[log[:, 0] >= lost_at + limit]
    assert len(late) > 100
    assert late[:, 4].max() == 0.0
    assert late[:, 6].max() <= 1000
    assert late[:, 5].max() < 0.02 * MASS * GRAVITY  # what still turns


@pytest.mark.in_a_copy
def test_offboard_loss(hovering):
    rig, _ = hovering
    rig.setpoint = None
    log = rig.run(3.0)
    held = log[log[:, 0] < log[0, 0] + 0.95]
    assert held[:, 4].min() == pytest.approx(HOVER, abs=1e-3)
    falls_to_zero(log, log[0, 0])
    assert np.diff(log[:, 5]).max() < 0.1  # [N] in 2 ms: the fans do not jump either
    assert not rig.logic.armed
    assert any("offboard lost" in text for text in rig.texts())
    assert abs(log[:700, 1:3]).max() < 5.0  # level while there is thrust


@pytest.mark.in_a_copy
def test_offboard_comes_back_during_the_descent(hovering):
    """It does not take over by itself, but does when it asks for the mode."""
    rig, heading = hovering
    rig.setpoint = None
    rig.run(1.04)
    assert rig.logic.failsafe is not None
    rig.setpoint = lambda: rig.attitude_message(heading, HOVER)
    before = rig.logic.thrust
    rig.run(0.04)
    assert rig.logic.thrust < before
    low = rig.logic.thrust
    rig.command(176, 1, 6)
    log = rig.run(0.5)
    assert rig.logic.armed and rig.logic.failsafe is None
    assert rig.logic.thrust > low
    assert np.diff(log[:, 4]).max() <= 1.0 * DT + 1e-12  # HKY_THR_UP


def pulses(roll=1500, pitch=1500, throttle=1000, yaw=1500, mode=1000, arm=1000, kill=1000):
    return [roll, pitch, throttle, yaw, mode, arm, kill, *[1500] * 9]


@pytest.fixture(scope="module")
def by_sticks():
    """A rig that hovers by its sticks, their throttle, and the log of its flight."""
    rig = Rig()
    rig.rc = lambda: pulses()
    rig.run(2.5)
    rig.rc = lambda: pulses(arm=2000)
    rig.run(0.1)
    assert rig.logic.armed, rig.texts()
    throttle = 1000 + 1000 * HOVER
    rig.rc = lambda: pulses(arm=2000, throttle=throttle)
    return rig, throttle, rig.run(3.0)


@pytest.mark.in_a_copy
def test_stabilized_by_sticks(by_sticks):
    rig, throttle, log = by_sticks
    assert np.abs(log[-500:, 1:3]).max() < 2.0
    rig.rc = lambda: pulses(arm=2000, throttle=throttle, roll=1755, pitch=1500)
    log = rig.run(2.0)
    assert log[-1, 1] == pytest.approx(10.0, abs=1.5)  # right side down
    rig.rc = lambda: pulses(arm=2000, throttle=throttle, pitch=1755)
    log = rig.run(2.0)
    assert log[-1, 2] == pytest.approx(-10.0, abs=1.5)  # nose down
    rig.rc = lambda: pulses(arm=2000, throttle=throttle, yaw=1755)
    log = rig.run(3.0)
    turn = np.unwrap(np.radians(log[:, 3]))
    assert np.degrees(turn[-1] - turn[500]) == pytest.approx(60.0, rel=0.2)  # 30 deg/s for 2 s


@pytest.mark.in_a_copy
def test_rc_loss(by_sticks):
    rig, _, _ = by_sticks
    rig.rc = None
    log = rig.run(3.0)
    falls_to_zero(log, log[0, 0])
    assert not rig.logic.armed


@pytest.mark.in_a_copy
def test_kill_switch(by_sticks):
    rig, throttle, _ = by_sticks
    rig.rc = lambda: pulses(arm=2000, throttle=throttle, kill=2000)
    log = rig.run(2.5)
    assert log[20, 6] == 1000  # two frames later at the latest
    falls_to_zero(log, log[20, 0])
    rig.rc = lambda: pulses(arm=2000, throttle=1000)
    rig.run(1.0)
    assert not rig.logic.armed  # the switch has to be turned off and on again


@pytest.mark.in_a_copy
def test_sensor_loss(hovering):
    rig, _ = hovering
    bad = (math.nan, 0.0, 0.0)
    rig.sample_hook = lambda sample: sample._replace(angular_velocity=bad)
    log = rig.run(3.0)
    falls_to_zero(log, log[0, 0])
    assert not rig.logic.armed


@pytest.mark.in_a_copy
def test_a_few_bad_samples_do_no_harm(hovering):
    rig, _ = hovering
    bad = (0.0, math.inf, 0.0)
    rig.sample_hook = lambda s: s._replace(specific_force=bad) if s.time_ns % 40_000_000 == 0 else s
    log = rig.run(3.0)
    assert rig.logic.armed
    assert np.abs(log[:, 1:3]).max() < 3.0


@pytest.mark.in_a_copy
def test_critical_battery(hovering):
    rig, _ = hovering
    rig.unit.set_charge(0.005)
    log = rig.run(6.0)
    lost = next(row[0] for row in log if row[4] < HOVER - 1e-6)
    falls_to_zero(log, lost)
    assert not rig.logic.armed
    assert any("battery critical" in text for text in rig.texts())


@pytest.mark.in_a_copy
def test_termination_and_disarming(hovering):
    rig, _ = hovering
    rig.command(185, 1)
    log = rig.run(2.5)
    assert log[1, 6] == 1000
    assert rig.logic.terminated
    rig.command(400, 1, 21196)
    rig.run(0.1)
    assert not rig.logic.armed
    rig.command(185, 0)
    rig.run(1.0)
    assert not rig.logic.terminated


@pytest.mark.in_a_copy
def test_disarming_at_thrust_goes_through_the_ramp(hovering):
    rig, _ = hovering
    rig.command(400, 0)
    log = rig.run(3.0)
    falls_to_zero(log, log[0, 0])
    assert not rig.logic.armed


@pytest.mark.in_a_copy
def test_force_disarms_at_once(hovering):
    rig, _ = hovering
    rig.command(400, 0, 21196)
    log = rig.run(0.01)
    assert log[0, 6] == 1000


def test_excessive_tilt_terminates_if_wanted():
    rig = Rig(parameters={"FD_FAIL_R": 30})
    heading = rig.hover()
    goal = turned(heading, roll=45.0)
    rig.setpoint = lambda: rig.attitude_message(goal, HOVER)
    rig.run(3.0)
    assert rig.logic.terminated and not rig.logic.armed


def test_thrust_rises_no_faster_than_allowed():
    rig = Rig(grounded=True)
    rig.setpoint = lambda: rig.attitude_message(LEVEL, 0.0)
    rig.run(2.5)
    rig.command(176, 1, 6)
    rig.command(400, 1)
    rig.run(0.1)
    rig.setpoint = lambda: rig.attitude_message(LEVEL, 1.0)
    log = rig.run(1.5)
    assert np.diff(log[:, 4]).max() <= DT * 1.0 + 1e-12
    assert log[-1, 4] == 1.0


def test_same_seed_same_flight(hovering):
    one, two, other = hovering[0], Rig(), Rig(8)
    two.hover()
    other.setpoint = lambda: other.attitude_message()
    other.run(1.0)
    logs = [np.array(rig.log) for rig in (one, two, other)]
    assert np.array_equal(logs[0], logs[1])
    assert not np.array_equal(logs[0][: len(logs[2])], logs[2])


@pytest.mark.in_a_copy
def test_restart_forgets_the_flight(hovering):
    rig, _ = hovering
    rig.autopilot.restart()
    rig.time_ns = 0
    rig.setpoint = None
    rig.run(0.5)
    assert not rig.logic.armed
    assert rig.pwm == (1000,) * 4


def test_loss_at_full_thrust():
    rig = Rig(grounded=True)
    heading = rig.hover()
    rig.setpoint = lambda: rig.attitude_message(heading, 1.0)
    rig.run(2.0)
    assert rig.unit.thrust.sum() > 70.0
    rig.setpoint = None
    log = rig.run(2.6)
    falls_to_zero(log, log[0, 0])


@pytest.mark.parametrize("fan", [0, *(pytest.param(fan, marks=SLOW) for fan in (1, 2, 3))])
def test_a_lost_fan_ends_the_flight_when_the_tilt_is_watched(fan):
    """Nobody tells the autopilot of the fan; what it sees is that the unit tips over."""
    rig = Rig(parameters={"FD_FAIL_R": 40, "FD_FAIL_P": 40, "FD_FAIL_R_TTRI": 0.05})
    rig.hover()
    rig.unit.fail_fan(fan)
    log = rig.run(2.5)
    assert rig.logic.terminated and not rig.logic.armed
    falls_to_zero(log, log[0, 0])


@pytest.mark.parametrize(
    ("mass", "inertia"),
    [
        (2.4, (0.015, 0.015, 0.02)),
        pytest.param(4.4, (0.08, 0.1, 0.1), marks=SLOW),
        (6.8, (0.3, 0.35, 0.3)),
    ],
)
def test_gains_follow_from_the_inertia(mass, inertia):
    """The unit alone, and with the robot under it: the same response."""
    rig = Rig(mass=mass, inertia=np.diag(inertia), design=np.diag(inertia))
    heading = rig.hover()
    goal = turned(heading, roll=10.0)
    rig.setpoint = lambda: rig.attitude_message(goal, rig.hovering)
    log = rig.run(3.0)
    assert log[:, 1].max() < 11.5
    assert log[-500:, 1] == pytest.approx(10.0, abs=1.0)
    assert 0.3 < log[np.argmax(log[:, 1] > 9.0), 0] - log[0, 0] < 0.5
