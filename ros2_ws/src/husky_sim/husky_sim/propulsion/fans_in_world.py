"""The propulsion unit in the MuJoCo world: its wrench on the body, and what its autopilot feels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array
from husky_description.gimbal import NEUTRAL, Angles, Gimbal, into_base
from husky_description.gravity import GRAVITY
from husky_description.plain_mujoco import mujoco
from husky_description.robot import Robot
from husky_sim.propulsion.propulsion_unit import PropulsionUnit

MAGNETIC_FIELD = (0.0, 0.195, -0.480)
"""Of the earth in world axes, east, north, up [gauss]: Boston, declination left out, by the World
Magnetic Model (0.195 horizontal, 0.480 down)."""
SEA_LEVEL = 101325.0
"""Pressure of the standard atmosphere at height 0 [Pa]."""
_PRESSURE_SLOPE = -1.225 * GRAVITY
"""Its change with height near the ground [Pa/m]: -density times gravity, 1.225 kg/m^3."""
_FIELD = np.array(MAGNETIC_FIELD)
_FRD = np.array((1.0, -1.0, -1.0))
SENSORS = (
    ("autopilot_orientation", mujoco.mjtSensor.mjSENS_FRAMEQUAT),
    ("autopilot_gyro", mujoco.mjtSensor.mjSENS_GYRO),
    ("autopilot_accelerometer", mujoco.mjtSensor.mjSENS_ACCELEROMETER),
)
"""MuJoCo sensors at the site `autopilot`."""


class FlightSample(NamedTuple):
    """What ideal sensors of the flight controller measure; axes forward, right, down.

    Attributes:
        angular_velocity: [rad/s] (3,).
        specific_force: [m/s^2] (3,).
        magnetic_field: [gauss] (3,).
        pressure: [Pa].
    """

    angular_velocity: Array
    specific_force: Array
    magnetic_field: Array
    pressure: float


def add_autopilot(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Put the flight controller's site on the base, and its sensors on that.

    It is amid the fans, or on top of the plates that carry the electronics (T17).
    """
    if robot.legs_carry_propellers:
        height = float(robot.rack.position[2] + robot.rack.size[2] / 2.0)
    else:
        height = robot.fans.z
    spec.body("base").add_site(name="autopilot", pos=[0.0, 0.0, height], group=4)
    for name, kind in SENSORS:
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="autopilot")


class FansInWorld:
    """Steps the unit with the physics and puts its wrench on the base.

    Fixed fans push where they stand, along base z. Vectored ones are the thesis's thrust (T25): the
    unit's force acts at the centre of mass of all that hangs on the base, along an axis that two
    servos turn; fans, speed controllers and battery are the same. Gyroscopic moments of the turning
    rotors are left out: in pairs they cancel at equal speed.

    Attributes:
        unit: fans, speed controllers, battery.
        pwm: pulses in force [us] (n,).
        tilt_pwm: pulses of the axis's servos in force [us] (2,).
        tilt: pitch and roll of the axis [rad].
        wind: velocity of the air in world [m/s] (3,), None where it is left out; fans in ducts take
            no notice of it.
    """

    def __init__(self, robot: Robot, model: mujoco.MjModel, data: mujoco.MjData):
        """Find the sensors; the unit is off."""
        self.unit = PropulsionUnit(robot)
        self.wind: Array | None = None
        self.tilt: Angles = NEUTRAL
        self._told: Angles = NEUTRAL
        self.pwm, self.tilt_pwm = np.zeros(len(robot.rotor_names)), np.zeros(2)
        self._gimbal = Gimbal.of(robot)
        self._wrench = np.zeros(6)
        self._step = model.opt.timestep
        self._data = data
        self._orientation, self._gyro, self._accelerometer = (
            data.sensordata[sensor.adr[0] : sensor.adr[0] + sensor.dim[0]]
            for sensor in (model.sensor(name) for name, _ in SENSORS)
        )
        # The base's free joint: force in world axes at its origin, moment in base axes about it.
        self._force: Array = data.qfrc_applied[0:3]
        self._moment: Array = data.qfrc_applied[3:6]
        self._field = np.empty(3)
        self._inverse = np.empty(4)
        self._lever = np.empty(3)
        self._center = data.subtree_com[model.body("base").id]
        self.reset()

    def reset(self) -> None:
        """Off, full battery."""
        self.unit.reset()
        self.pwm[:] = self.tilt_pwm[:] = 0.0
        self._wrench[:] = 0.0
        self.tilt = self._told = NEUTRAL

    @property
    def wrench_in_base(self) -> Array:
        """(6,) force [N] and moment about base's origin [N m], in base."""
        return self._wrench

    def step(self, load: float = 0.0) -> None:
        """Advance by one physics step; call before `mj_step`.

        Args:
            load: power that the joints' drives take from the battery [W].
        """
        wrench = self.unit.step(self.pwm, self._step, load)
        if self._gimbal is not None:
            wrench = self._vectored(self._gimbal, wrench)
        self._wrench[:] = wrench
        mujoco.mju_rotVecQuat(self._force, wrench[:3], self._data.qpos[3:7])
        self._moment[:] = wrench[3:]

    def _vectored(self, gimbal: Gimbal, wrench: Array) -> Array:
        """Turn the unit's wrench with its axis and put it at the centre of mass."""
        self._told = gimbal.told(self.tilt_pwm.tolist(), self._told)
        self.tilt = gimbal.followed(self.tilt, self._told, self._step)
        # The unit's own moments are about its middle: its force is along its z, over base's origin.
        _, _, thrust, *moment = wrench.tolist()
        fx, fy, fz = into_base(self.tilt, (0.0, 0.0, thrust))
        mx, my, mz = into_base(self.tilt, moment)
        mujoco.mju_negQuat(self._inverse, self._data.qpos[3:7])
        mujoco.mju_rotVecQuat(self._lever, self._center - self._data.qpos[0:3], self._inverse)
        x, y, z = self._lever.tolist()
        return np.array(
            (fx, fy, fz, mx + y * fz - z * fy, my + z * fx - x * fz, mz + x * fy - y * fx)
        )

    def sample(self) -> FlightSample:
        """Return what the flight controller's sensors measure."""
        mujoco.mju_negQuat(self._inverse, self._orientation)
        mujoco.mju_rotVecQuat(self._field, _FIELD, self._inverse)
        return FlightSample(
            self._gyro * _FRD,
            self._accelerometer * _FRD,
            self._field * _FRD,
            SEA_LEVEL + _PRESSURE_SLOPE * float(self._data.qpos[2]),
        )
