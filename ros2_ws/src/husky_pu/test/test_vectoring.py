"""A force in any direction: from the companion's bytes through the autopilot to fans and axis."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_description.gimbal import Gimbal, axis
from husky_description.robot import load_robot
from husky_pu.autopilot.autopilot import Autopilot, AutopilotConfig, SensorSample
from husky_pu.autopilot.failsafes import FlightMode
from husky_pu.autopilot.imu import NO_ERRORS
from husky_pu.autopilot.mixer import Mixer
from husky_pu.autopilot.weighted_mixer import mixer_of
from husky_pu.companion.bridge import Kind, Limits, ThrustCommand, ThrustSetpoints
from husky_pu.companion.client import ClientConfig, MavlinkClient
from husky_pu.companion.propulsion_force import ForceEstimate
from husky_sim.propulsion.propulsion_unit import PropulsionUnit

ROBOT = load_robot(fans__mounting="vectoring")
MIXER = Mixer(ROBOT)
GIMBAL = Gimbal.of(ROBOT)
TICK = 0.002
UP_THE_WALL = np.array((0.8, 0.0, -0.6))
"""Forward and down in base."""


class Chain:
    """Bridge, flight controller and fans on their own bytes and pulses; the unit does not move."""

    def __init__(self, robot=ROBOT, **parameters):
        self.robot = robot
        gimbal = Gimbal.of(robot)
        self.gimbal = gimbal or GIMBAL
        mixer = mixer_of(robot)
        self.autopilot = Autopilot(
            mixer, AutopilotConfig(errors=NO_ERRORS, parameters=parameters, gimbal=gimbal)
        )
        self.client = MavlinkClient(ClientConfig(len(mixer.names)))
        limits = Limits(mixer.max_collective, list(mixer.moment_scale), 80.0, gimbal is not None)
        self.setpoints = ThrustSetpoints(limits, enabled=True)
        self.unit = PropulsionUnit(robot)
        self.estimate = ForceEstimate(robot)
        self.tilt = self.told = (0.0, 0.0)
        self.command = None
        self.time = 0
        self.reports = []
        self.log = []  # time, force made in base, force told in the state

    @property
    def logic(self):
        return self.autopilot.vehicle.logic

    @property
    def now(self):
        return 1e-9 * self.time

    def made(self):
        """Return the force that the fans make, in base [N]."""
        return float(self.unit.thrust.sum()) * np.array(axis(self.tilt))

    def ask(self, force, moment=(0.0, 0.0, 0.0), kind=Kind.WRENCH):
        """From now on command this force in base [N]; None is silence."""
        self.command = None if force is None else (kind, tuple(map(float, force)), moment)

    def run(self, seconds):
        """Return the log of this while: times, forces made, forces told."""
        begin = len(self.log)
        for _ in range(round(seconds / TICK)):
            self._companion()
            sample = SensorSample(
                self.time,
                (0.0, 0.0, 0.0),
                (0.0, 0.0, -9.81),
                (0.195, 0.0, 0.48),
                101325.0,
                self.unit.battery_voltage,
                self.unit.battery_current,
                tuple(self.unit.speed.tolist()),
                tuple(self.unit.current.tolist()),
            )
            pwm = self.autopilot.tick(sample)
            self.told = self.gimbal.told(self.autopilot.vehicle.tilt, self.told)
            for _ in range(4):
                self.unit.step(pwm, TICK / 4)
                self.tilt = self.gimbal.followed(self.tilt, self.told, TICK / 4)
            self.client.feed(self.autopilot.take_output("usb"), self.now)
            for report in self.client.take_bundles():
                self.report = report
            self.time += 2_000_000
            told = self.estimate.of(self.client.telemetry.report).force
            self.log.append((self.now, *self.made(), *told))
        log = np.array(self.log[begin:])
        return log[:, 0], log[:, 1:4], log[:, 4:7]

    def _companion(self):
        if self.time % 10_000_000 == 0:
            self.client.heartbeat(self.now)
            if self.command is not None:
                kind, force, moment = self.command
                setpoint = self.setpoints.convert(
                    ThrustCommand(self.time, kind, force=force, moment=moment)
                )
                if setpoint is not None and self.client.connected:
                    setpoint.send(self.client, self.time // 1000)
        self.client.poll(self.now)
        self.autopilot.receive(self.client.take_output(), "usb")

    def fly(self, force, seconds=1.4):
        """Arm in OFFBOARD and bring a force about."""
        self.ask((0, 0, 0))
        self.run(1.5)
        assert self.logic.set_mode(FlightMode.OFFBOARD) == ""
        assert self.logic.arm() == ""
        self.ask(force)
        self.run(seconds)
        return self


def aside(forces, direction):
    """Return the part of forces that is not along a direction, and the part along [N]."""
    along = forces @ direction
    return np.linalg.norm(forces - along[:, None] * direction, axis=1), along


@pytest.fixture(scope="module")
def up_the_wall():
    """A chain that makes 40 N up the wall, for tests in a copy."""
    return Chain().fly(40 * UP_THE_WALL)


@pytest.mark.parametrize(
    "force",
    [
        (25, -8, 5),
        (61, 0, -20),
        *(
            pytest.param(force, marks=pytest.mark.slow)
            for force in ((0, 0, 30), (32, 0, -24), (0, 20, 30), (-20, 0, 20))
        ),
    ],
)
def test_the_force_that_is_asked_for_is_made_and_told(force):
    chain = Chain().fly(force)
    _, made, told = chain.run(0.5)
    # Pulses of 1 us: 0.02 N a fan, 0.3 deg of the axis, 0.35 N of 64 N.
    np.testing.assert_allclose(made.mean(axis=0), force, atol=0.6)
    np.testing.assert_allclose(told[-1], made[-1], atol=0.6)


@given(st.lists(st.floats(-40, 40), min_size=3, max_size=3), st.booleans())
def test_what_goes_on_the_wire_is_the_force_in_frd(force, armed):
    setpoints = ThrustSetpoints(Limits(80.0, (5.0, 4.0, 2.0), 1e9, True), enabled=armed)
    setpoint = setpoints.convert(ThrustCommand(0, Kind.WRENCH, force=force))
    client = MavlinkClient(ClientConfig(4, target_system=1))
    setpoint.send(client, 1000)
    (message,) = client.reader.feed(client.take_output())
    assert message.get_type() == "SET_ATTITUDE_TARGET"
    assert message.type_mask == 32 | 7 | 128
    x, y, z = np.array(force) / 80.0 * armed
    assert message.thrust_body == pytest.approx([x, -y, -z], abs=1e-6)
    assert message.thrust == pytest.approx(max(0.0, z), abs=1e-6)


def test_a_moment_goes_with_a_force_along_z_alone():
    setpoints = ThrustSetpoints(Limits(80.0, (5.0, 4.0, 2.0), 80.0, True), enabled=True)
    moment = (1.0, 0.0, 0.0)
    good = ThrustCommand(0, Kind.WRENCH, force=(0, 0, 20.0), moment=moment)
    assert setpoints.convert(good).as_wrench
    for force in ((1.0, 0, 20.0), (0, 0, -20.0)):
        bad = ThrustCommand(10_000_000, Kind.WRENCH, force=force, moment=moment)
        assert setpoints.convert(bad) is None and "moment beside a force" in setpoints.refusal
    long = ThrustCommand(10_000_000, Kind.WRENCH, force=(60.0, 0, 60.0))
    assert setpoints.convert(long) is None and "84.8528 N" in setpoints.refusal


def test_fixed_fans_take_the_part_along_z_and_say_so():
    chain = Chain(load_robot()).fly((20.0, 0.0, 25.0))
    _, made, told = chain.run(0.3)
    np.testing.assert_allclose(made[-1], (0, 0, 25.0), atol=0.3)
    np.testing.assert_allclose(told[-1], (0, 0, 25.0), atol=0.3)
    assert chain.setpoints.projected > 100 and "(20, 0) N" in chain.setpoints.projection
    chain.ask((20.0, 0.0, -10.0))  # none of it can be had
    chain.run(0.6)
    assert np.abs(chain.made()).max() < 0.2


def test_a_fixed_flight_controller_leaves_out_what_is_across_and_says_so():
    chain = Chain(load_robot())
    chain.setpoints.limits = Limits(80.0, (5.0, 4.0, 2.0), 80.0, True)  # a wrong bridge
    chain.fly((20.0, 0.0, 25.0))
    np.testing.assert_allclose(chain.made(), (0, 0, 25.0), atol=0.3)
    assert "they are fixed" in chain.client.telemetry.report.reason
    assert chain.autopilot.vehicle.tilt == (0, 0)


def test_a_new_direction_never_pushes_where_neither_was_wanted():
    chain = Chain().fly((0, 0, 40))
    chain.ask(40 * UP_THE_WALL)
    times, made, _ = chain.run(2.0)
    np.testing.assert_allclose(made[-1], 40 * UP_THE_WALL, atol=0.6)
    length = np.linalg.norm(made, axis=1)
    assert length.max() < 40.5
    # While the axis is more than a right angle off, thrust only falls, as fast as fans can.
    off = made @ UP_THE_WALL < 0.0
    assert np.all(np.diff(length[off]) <= 0.05)
    assert times[off][-1] - times[0] < 0.3


def test_a_reversal_goes_through_no_thrust():
    chain = Chain().fly((30, 0, 10))
    chain.ask((-30, 0, 10))
    _, made, _ = chain.run(2.0)
    assert np.linalg.norm(made, axis=1).min() < 10.0
    np.testing.assert_allclose(made[-1], (-30, 0, 10), atol=0.6)


def falls(made, direction, before):
    """The thrust only falls, and along the direction that it had."""
    across, along = aside(made, direction)
    assert across.max() < 0.02 * before + 0.1
    assert along.min() > -0.05
    lowest = np.minimum.accumulate(along)
    assert (along - lowest).max() < 0.2 and along.max() < before + 0.2


@pytest.mark.in_a_copy
@pytest.mark.parametrize("cause", ["silence", "kill", "disarm", "none", "terminate", "zero"])
def test_after_a_loss_thrust_only_falls_and_its_axis_stays(up_the_wall, cause):
    chain = up_the_wall
    direction = np.array(axis(chain.tilt))
    before = float(np.linalg.norm(chain.made()))
    assert before == pytest.approx(40.0, abs=0.5)
    if cause == "silence":
        chain.ask(None)
    elif cause == "kill":
        chain.logic.disarm(force=True)
    elif cause == "disarm":
        chain.logic.disarm()
    elif cause == "terminate":
        chain.logic.terminate(True)
    elif cause == "none":
        chain.ask((0, 0, 0), kind=Kind.NONE)
    else:
        chain.ask((0, 0, 0))
    times, made, _ = chain.run(2.5)
    falls(made, direction, before)
    length = np.linalg.norm(made, axis=1)
    assert times[length > 0.5][-1] - times[0] < 2.0
    if cause not in ("none", "zero"):
        assert not chain.logic.armed and chain.logic.tilt == pytest.approx(chain.tilt, abs=2e-3)
        # A ramp where one is due: no step in what is asked for.
        if cause in ("silence", "disarm"):
            assert length[np.searchsorted(times, times[0] + 0.1)] > 0.5 * before


@pytest.mark.in_a_copy
def test_a_dead_flight_controller_leaves_the_axis(up_the_wall):
    chain = up_the_wall
    direction, before = np.array(axis(chain.tilt)), float(np.linalg.norm(chain.made()))
    made = []
    for _ in range(4000):
        chain.unit.step((0.0,) * 4, 0.0005)
        chain.tilt = GIMBAL.followed(chain.tilt, GIMBAL.told((0, 0), chain.told), 0.0005)
        made.append(chain.made())
    falls(np.array(made), direction, before)
    assert np.linalg.norm(made[-1]) < 0.5


def test_the_axis_returns_once_the_rotors_stand():
    chain = Chain().fly(20 * UP_THE_WALL)
    chain.ask((0, 0, 0), kind=Kind.NONE)
    chain.run(0.9)
    assert chain.tilt[0] > 1.0
    chain.ask((0, 0, 1e-9))
    chain.run(2.0)
    assert chain.tilt == pytest.approx((0, 0), abs=0.01)


def test_one_fan_lost_the_rest_keep_the_direction_without_a_moment():
    chain = Chain().fly(36 * UP_THE_WALL)
    chain.unit.fail_fan(0)
    failed = chain.now
    times, made, told = chain.run(2.0)
    assert chain.logic.fans_ok == [False, True, True, True]
    assert chain.client.telemetry.report.reason == "Fan front_left lost"
    assert chain.client.telemetry.report.fan_ok == (False, True, True, True)
    across, along = aside(made, UP_THE_WALL)
    assert across.max() < 0.6
    # Three fans make 36 N again, of the 40 N (at 22.2 V) that they can without a moment.
    settled = times > failed + 0.8
    np.testing.assert_allclose(along[settled], 36.0, atol=0.5)
    np.testing.assert_allclose(told[-1], made[-1], atol=0.6)
    moment = chain.unit.wrench_in_base[3:5]
    assert np.abs(moment).max() < 0.1
    chain.ask(70 * UP_THE_WALL)
    chain.run(1.5)
    limit = chain.estimate.of(chain.client.telemetry.report).limit
    assert 36.0 < limit < 45.0
    assert np.linalg.norm(chain.made()) == pytest.approx(limit, rel=0.04)
    # It is told until the next disarming.
    chain.logic.disarm(force=True)
    chain.run(1.2)
    assert chain.client.telemetry.report.fan_ok == (True,) * 4


def test_the_mixer_may_be_told_to_ignore_it():
    chain = Chain(CA_FAILURE_MODE=0).fly((0, 0, 30))
    chain.unit.fail_fan(0)
    chain.run(1.0)
    assert not chain.logic.fans_ok[0]
    assert chain.made()[2] == pytest.approx(22.5, abs=0.5)  # three quarters


def test_two_fans_lost_end_it():
    chain = Chain().fly((0, 0, 30))
    chain.unit.fail_fan(0)
    chain.run(0.6)
    chain.unit.fail_fan(1)
    _, made, _ = chain.run(2.0)
    assert np.linalg.norm(made[-1]) < 0.1 and not chain.logic.armed
    texts = chain.client.telemetry.report.reason
    assert "fans lost" in texts


def test_without_telemetry_of_the_speed_controllers_force_is_by_the_pulses():
    chain = Chain().fly((0, 0, 30))
    report = chain.client.telemetry.report
    assert chain.estimate.of(report).force[2] == pytest.approx(30.0, abs=0.4)
    blind = chain.estimate.of(replace(report, fan_speed=(math.nan,) * 4))
    assert blind.force[2] == pytest.approx(30.0, abs=0.7)


def test_of_six_fans_every_one_is_told_and_the_axis_behind_them():
    """ESC_STATUS and ESC_INFO tell of four each; the axis's servos are the outputs 7 and 8."""
    rotors = {name: dict(vars(rotor)) for name, rotor in ROBOT.fans.rotors.items()}
    rotors["nose"] = {"x": 0.25, "y": 0.0, "spin": 1.0}
    rotors["tail"] = {"x": -0.25, "y": 0.0, "spin": -1.0}
    robot = load_robot(fans__mounting="vectoring", fans__rotors=rotors)
    chain = Chain(robot).fly(60 * UP_THE_WALL)
    _, made, told = chain.run(0.5)
    np.testing.assert_allclose(made[-1], 60 * UP_THE_WALL, atol=0.6)
    np.testing.assert_allclose(told[-1], made[-1], atol=0.6)
    report = chain.client.telemetry.report
    assert report.pwm == chain.autopilot.vehicle.pwm and len(report.pwm) == 6
    assert report.tilt == chain.autopilot.vehicle.tilt
    np.testing.assert_allclose(report.fan_speed, chain.unit.speed, rtol=0.02)
    chain.unit.fail_fan(5)
    chain.run(2.0)
    assert chain.client.telemetry.report.reason == "Fan tail lost"
    assert chain.client.telemetry.report.fan_ok == (True,) * 5 + (False,)
    assert np.linalg.norm(chain.made()) == pytest.approx(60.0, abs=0.6)
