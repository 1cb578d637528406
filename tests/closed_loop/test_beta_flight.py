"""Husky-beta in one process: from its legs into the air, down onto the perch, and on its legs."""

import math

import numpy as np
import pytest
from flying_beta import FlyingBeta

from husky_control.flight.thrust_vectoring import tilt_per_moment

pytestmark = pytest.mark.in_a_copy  # each goes on from the same hover


class Pilot(FlyingBeta):
    """Takes off, is seen from outside, and lands."""

    def take_off(self):
        """From sitting to a hover at rest; refused while the propellers are off."""
        self.stand()
        self.become("perch")
        self.become("splay")
        accepted, message = self.controller.request_mode("quadrotor")
        assert not accepted and "not armed" in message
        self.gear.arm()
        self.run(1.5)
        self.become("quadrotor")
        self.run(8.0)

    @property
    def heading(self):
        w, x, y, z = self.data.qpos[3:7]
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))

    def land(self, mode="splay"):
        """Until the perch carries; return the greatest sink rate of the last 2 cm [m/s]."""
        fastest = 0.0
        for _ in range(600):
            self.run(0.02)
            if self.above_perch < 0.02:
                fastest = max(fastest, -self.data.qvel[2])
            if self.controller.mode.value == mode:
                return fastest
        raise AssertionError(f"it does not land: {self.controller.hover.phase}")


@pytest.fixture(scope="module")
def hovering():
    robot = Pilot(1)
    robot.take_off()
    return robot


def test_from_legs_to_air_to_legs(hovering):
    """T19 and T20 in one go; arms that carry ask less of the servos than they can give."""
    robot, places, tilts = hovering, [], []
    for _ in range(60):
        robot.run(0.05)
        places.append(robot.data.qpos[:3].copy())
        tilts.append(robot.tilt)
    assert robot.controller.hover.phase.value == "holding"
    assert not robot.controller.present.stance.any()  # contacts are noise there
    places = np.array(places)
    assert np.linalg.norm(places[:, :2], axis=1).max() < 0.15  # the T265 drifts
    assert np.ptp(places[:, 2]) < 0.05 and places[0, 2] > 0.4
    assert robot.controller.body.estimator.position[2] == pytest.approx(places[-1, 2], abs=0.03)
    assert math.sqrt(np.mean(np.square(tilts))) < 2.0
    assert robot.controller.request_mode("splay") == (True, "landing")
    assert robot.land() < 0.4
    accepted, message = robot.controller.request_mode("perch")
    assert not accepted and "propellers are not off" in message
    robot.gear.autopilot.vehicle.logic.disarm()
    robot.run(0.5)
    robot.become("perch")
    robot.become("stand")
    assert robot.controller.present.stance.all()
    assert robot.controller.body.contacts.contact.all() and robot.tilt < 1.7
    assert robot.controller.counters.faults == 0
    assert robot.peak_torque.max() < robot.robot.bus_servo.torque_limit


def test_it_goes_where_it_is_told_and_lands_there(hovering):
    """Two metres ahead at 1 m, and a turn by 60 degrees."""
    robot = hovering
    robot.controller.parameters.set("quadrotor.height", 1.0)
    robot.run(4.0)
    assert robot.data.qpos[2] > 1.0
    assert not robot.controller.set_velocity_command(0.6, 0.0, 0.0)[0]  # faster than is allowed
    start = robot.data.qpos[:2].copy()
    robot.run(4.0, (0.5, 0.0, 0.0))
    robot.run(4.0)  # silence ends the way
    assert robot.controller.reason == "velocity command silent"
    way = robot.data.qpos[:2] - start
    assert way[0] == pytest.approx(2.2, abs=0.4) and abs(way[1]) < 0.25
    believed = robot.controller.body.estimator.position[:2]
    assert believed == pytest.approx(robot.data.qpos[:2], abs=0.15)  # leg odometry, then the T265
    assert np.linalg.norm(robot.data.qvel[:2]) < 0.1
    robot.controller.parameters.set("quadrotor.height", 0.5)  # it need not sink that far then
    robot.run(2.0, (0.0, 0.0, 0.4))
    robot.run(3.0)
    heading = 2.0 * math.atan2(robot.data.qpos[6], robot.data.qpos[3])
    assert math.degrees(heading) == pytest.approx(60.0, abs=10.0)
    assert robot.controller.request_mode("splay")[0]
    assert robot.land() < 0.4


def test_tilted_propellers_turn_it_sooner_and_come_upright_again(hovering):
    """T21: a step of 30 deg; the hips hold still without it, and for the landing."""
    robot, parameters = hovering, hovering.controller.parameters
    parameters.set("quadrotor.max_yaw_rate", 1.5)
    upright = robot.controller.command.position[0::3].copy()
    times, greatest = {}, {}
    for share in (0.0, 1.0):
        parameters.set("quadrotor.thrust_vectoring", share)
        start, begin, tilts = robot.heading, robot.time, []
        assert robot.controller.set_velocity_command(0.0, 0.0, 1.5)[0]
        while robot.time < begin + 2.4:
            if robot.time > begin + 0.349:
                robot.controller.set_velocity_command(0.0, 0.0, 0.0)
            robot.run(0.01)
            tilts.append(robot.controller.command.position[0::3] - upright)
            if share not in times and robot.heading - start > math.radians(27.0):
                times[share] = robot.time - begin
        assert robot.heading - start == pytest.approx(math.radians(30.0), abs=math.radians(2.0))
        greatest[share] = np.abs(tilts).max()
    assert times[1.0] < 0.75 * times[0.0]
    least = 0.08 * np.abs(tilt_per_moment(robot.robot)).max()  # of a yaw moment of 0.08 N m
    assert greatest[0.0] == 0.0 and least < greatest[1.0] < math.radians(8.1)
    assert robot.controller.request_mode("splay")[0]
    robot.run(0.2)
    np.testing.assert_allclose(robot.controller.command.position[0::3], upright, atol=1e-12)


def test_a_fault_in_the_air_lands_it_with_its_arms_held(hovering):
    robot = hovering
    assert robot.controller.lose_drives("servo_bridge is lost") is False
    assert robot.controller.lose_drives("servo_bridge is lost") is False  # as it goes on
    assert robot.controller.mode.value == "quadrotor"
    assert robot.land() < 0.4
    assert robot.controller.counters.faults == 1
    robot.run(0.3)
    assert robot.controller.present.lift_centred


def test_without_the_camera_it_lands_on_its_perch(hovering):
    robot = hovering
    robot.gear.frozen = True
    assert robot.land() < 0.8
    assert robot.tilt < 5.7 and robot.above_perch < 0.005
    assert "T265 lost" in robot.controller.reason


def come_down(robot, most=10.0):
    """Run until the mode is no flight any more; return what the way and the end were like.

    Greatest tilt [deg], and at touch-down sink rate [m/s], spin [rad/s], tilt [deg].
    """
    tilt, touch = 0.0, None
    for _ in range(round(most / 0.01)):
        robot.run(0.01)
        if touch is None:
            tilt = max(tilt, robot.tilt)
            before = (-robot.data.qvel[2], abs(robot.data.qvel[5]), robot.tilt)
            if robot.above_perch < 0.003:
                touch = before
        if robot.controller.mode.value != "quadrotor":
            return tilt, *touch
    raise AssertionError(f"it does not come down: {robot.controller.reason}")


@pytest.mark.parametrize("leg", [0, pytest.param(3, marks=pytest.mark.slow)])
def test_a_lost_rotor_is_found_and_the_other_three_bring_it_down(hovering, leg):
    """Arms that sweep and tilt keep three rotors in command; the flight controller lands."""
    robot, logic = hovering, hovering.gear.autopilot.vehicle.logic
    robot.propellers.unit.fail_fan(leg)
    robot.run(0.3)
    assert [index for index, ok in enumerate(logic.fans_ok) if not ok] == [leg]
    assert logic.failsafe.value == "fans lost"
    tilt, sink, spin, last = come_down(robot)
    assert tilt < 8.0 and last < 4.0
    assert sink < 0.75 and spin < 0.5
    assert robot.controller.mode.value == "splay" and not logic.armed
    robot.run(1.0)
    assert robot.tilt < 2.8 and robot.above_perch < 0.003
    assert robot.propellers.unit.thrust.sum() < 0.1
    assert robot.controller.counters.faults == 0


def test_an_arm_whose_hip_gives_way_is_evened_out_by_the_one_across(hovering):
    """The limp arm goes to its stop, 12 degrees up."""
    robot = hovering
    start = robot.data.qpos[:2].copy()
    robot.lose_servo("front_left_hip_frontal")
    robot.run(0.5)
    hips = robot.data.qpos[7::3]
    stop = robot.robot.joint_upper[0]
    assert hips[0] > stop - 0.02 and hips[1] == pytest.approx(-hips[0], abs=0.05)
    tilt, sink, spin, last = come_down(robot)
    assert tilt < 4.0 and last < 2.0 and sink < 0.4 and spin < 0.3
    assert np.linalg.norm(robot.data.qpos[:2] - start) < 0.25
    robot.run(0.1)
    assert robot.controller.mode.value == "damping"  # the servos are not well: down, and let go
    assert robot.controller.counters.faults == 2


def test_an_empty_battery_lands_it(hovering):
    robot, logic = hovering, hovering.gear.autopilot.vehicle.logic
    robot.propellers.unit.set_charge(0.05)
    tilt, sink, spin, last = come_down(robot)
    # The voltage falls faster than the flight controller trims: it meets the ground at 0.85 m/s.
    assert tilt < 5.0 and last < 3.0 and sink < 0.9 and spin < 0.3
    assert not logic.armed and logic.arm() != ""
    assert robot.controller.reason == "the propellers are off"


@pytest.mark.slow  # the next test loses it on its way
def test_a_companion_that_falls_silent_does_not_let_it_fall(hovering):
    robot = hovering
    robot.gear.silent = True
    tilt, sink, _, last = come_down(robot)
    assert tilt < 8.0 and last < 3.0 and sink < 0.7
    assert not robot.gear.autopilot.vehicle.logic.armed


def test_on_its_way_it_brakes_what_a_silent_companion_has_left(hovering):
    """The last tilt that was asked for stays until the silence counts as one."""
    robot = hovering
    robot.run(0.6, (0.4, -0.4, 0.0))
    robot.gear.silent = True
    robot.run(0.5)
    left = np.linalg.norm(robot.data.qvel[:2])
    assert left > 0.35
    tilt, sink, _, last = come_down(robot)
    assert np.linalg.norm(robot.data.qvel[:2]) < 0.5 * left
    assert tilt < 12.0 and last < 3.0 and sink < 0.9
    robot.run(1.0)
    assert robot.tilt < 2.0


def test_a_stop_in_the_air_lands_first_with_its_arms_held(hovering):
    """The last of two that are asked for is what follows."""
    robot = hovering
    posture = robot.data.qpos[7:].copy()
    for stop in ("damping", "emergency_stop"):
        accepted, message = robot.controller.request_mode(stop)
        assert accepted and message.startswith("landing") and stop in message
        robot.run(0.2)
        assert robot.controller.mode.value == "quadrotor"
    assert np.abs(robot.data.qpos[7:] - posture).max() < 0.1
    assert robot.land("emergency_stop") < 0.4
    assert robot.tilt < 2.8
