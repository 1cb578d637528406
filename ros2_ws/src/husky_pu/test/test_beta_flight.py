"""The autopilot flies Husky-beta in MuJoCo: a quad-X whose arms are its splayed legs (T19)."""

import math

import mujoco
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from scipy.spatial.transform import Rotation

from husky_description.gravity import GRAVITY
from husky_description.mujoco_model import build_spec, flying_inertia
from husky_description.robot import load_robot
from husky_description.rotor_geometry import flight_posture, rotor_geometry
from husky_pu.autopilot.autopilot import Autopilot, AutopilotConfig, SensorSample
from husky_pu.autopilot.weighted_mixer import WeightedMixer
from husky_pu.mavlink.axes import mavlink_attitude
from husky_sim.propulsion.fans_in_world import add_autopilot
from husky_sim.propulsion.propellers_in_world import PropellersInWorld

ROBOT = load_robot("beta")
POSTURE = flight_posture(ROBOT)
GEOMETRY = rotor_geometry(ROBOT, POSTURE)
WEIGHT = ROBOT.mass * GRAVITY
DT = 0.002
SUBSTEPS = 4


class Flyer:
    """Husky-beta on its perch, legs splayed and held by the servos' law, and its autopilot.

    Its height is held by a rule of the test, which knows the truth; the autopilot has the attitude.
    """

    def __init__(self, seed=1):
        spec = build_spec(ROBOT)
        spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[10, 10, 0.1])
        add_autopilot(spec, ROBOT)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key("sit").id)
        self.data.qpos[7:] = POSTURE
        mujoco.mj_forward(self.model, self.data)
        self.propellers = PropellersInWorld(ROBOT, self.model, self.data)
        self.mixer = WeightedMixer(ROBOT, GEOMETRY)
        cells = {"BAT1_N_CELLS": float(ROBOT.battery.cells)}
        self.autopilot = Autopilot(
            self.mixer,
            AutopilotConfig(inertia=flying_inertia(ROBOT, "robot"), seed=seed, parameters=cells),
        )
        self.codec = dialect.MAVLink(None, 1, 191)
        self.time_ns = 0
        self.wanted_height = None
        self.heading = 0.0  # ENU [rad]
        self.legs = POSTURE.copy()
        self.log = []

    @property
    def height(self):
        return self.data.qpos[2] - ROBOT.sit_height - ROBOT.foot_radius

    def send(self, message):
        self.autopilot.receive(message.pack(self.codec), "usb")

    def command(self, number, *parameters):
        padded = [*parameters, *[0.0] * (7 - len(parameters))]
        self.send(dialect.MAVLink_command_long_message(1, 1, number, 0, *padded))

    def setpoint(self):
        thrust = 0.0
        if self.wanted_height is not None:
            climb = 1.5 * (self.wanted_height - self.height) - self.data.qvel[2]
            thrust = WEIGHT * (1.0 + 0.3 * climb) / self.mixer.max_collective
        level = mavlink_attitude(Rotation.from_euler("z", self.heading).as_quat())
        self.send(
            dialect.MAVLink_set_attitude_target_message(
                self.time_ns // 1_000_000, 1, 1, 7, list(level), 0.0, 0.0, 0.0, min(thrust, 1.0)
            )
        )

    def tick(self):
        if self.time_ns % 20_000_000 == 0:
            self.setpoint()
        sample, unit = self.propellers.sample(), self.propellers.unit
        self.propellers.pwm[:] = self.autopilot.tick(
            SensorSample(
                self.time_ns,
                tuple(sample.angular_velocity),
                tuple(sample.specific_force),
                tuple(sample.magnetic_field),
                sample.pressure,
                unit.battery_voltage,
                unit.battery_current,
            )
        )
        law, data = ROBOT.servo, self.data
        for _ in range(SUBSTEPS):
            torque = law.kp * (self.legs - data.qpos[7:]) - law.kd * data.qvel[6:]
            data.ctrl[:] = np.clip(torque, -law.torque_limit, law.torque_limit)
            self.propellers.step()
            mujoco.mj_step(self.model, data)
        self.time_ns += 2_000_000
        angles = Rotation.from_quat(np.roll(data.qpos[3:7], -1)).as_euler("zyx", degrees=True)
        self.log.append([*angles, self.height, np.abs(data.ctrl).max(), unit.thrust.sum()])

    def run(self, seconds):
        start = len(self.log)
        for _ in range(round(seconds / DT)):
            self.tick()
        return np.array(self.log[start:])

    def take_off(self, height=1.0):
        """Arm on the perch, rise, come to rest."""
        self.run(2.5)
        self.command(176, 1, 6)  # OFFBOARD
        self.command(400, 1)
        self.run(0.1)
        assert self.autopilot.vehicle.logic.armed
        self.wanted_height = height
        self.run(4.0)


@pytest.fixture(scope="module")
def hovering():
    flyer = Flyer()
    flyer.take_off()
    return flyer


def test_it_lifts_off_its_perch_and_stays_level(hovering):
    """As much of a hover as is the autopilot's: attitude, on the thrust that the weight takes."""
    log = hovering.run(3.0)
    yaw, pitch, roll, height, torque, thrust = log.T
    assert np.sqrt(np.mean(roll**2)) < 2.0 and np.sqrt(np.mean(pitch**2)) < 2.0
    assert np.abs(yaw - yaw[0]).max() < 3.0
    assert np.abs(height - 1.0).max() < 0.1
    assert thrust.mean() == pytest.approx(WEIGHT, rel=0.02)
    assert torque.max() < ROBOT.servo.torque_limit


def test_yaw_turns_by_the_propellers_drag(hovering):
    yaw = hovering.run(0.1)[-1, 0]
    hovering.heading = math.radians(30.0)
    turned = hovering.run(5.0)
    assert turned[-1, 0] - yaw == pytest.approx(30.0, abs=3.0)
    assert np.abs(turned[:, 1:3]).max() < 5.0


def test_a_leg_that_gives_way_tilts_its_propeller(hovering):
    """The force is where the leg is: a hip that turns by 0.1 rad pushes the body sideways."""
    before = hovering.propellers.wrench_in_base[1]
    hovering.legs[0] += 0.1
    hovering.run(0.3)
    hovering.legs[0] -= 0.1
    after = hovering.propellers.wrench_in_base[1]
    assert after - before == pytest.approx(-math.sin(0.1) * WEIGHT / 4.0, rel=0.4)
