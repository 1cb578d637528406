"""Husky-beta in one process, with propellers, autopilot and T265."""

from __future__ import annotations

from typing import Any

import numpy as np
from flying import FlightGear
from servo_robot import ServoRobot

from husky_drivers.dynamixel.units import ServoUnits
from husky_sim.propulsion.propellers_in_world import PropellersInWorld
from husky_sim.terrain import TerrainOptions
from husky_sim.world import POSE_PERIOD_NS, PoseSample, WorldOptions

_CREEP = 0.05
"""Speed below which a servo's friction is linear [rad/s], as in `motors`."""


class FlyingBeta(ServoRobot):
    """On its servos, and on its propellers.

    Attributes:
        gear: flight controller and camera.
        propellers: in the world.
        limp: joints whose servos have let go (12,) bool; the others follow on.
    """

    def __init__(self, seed: int = 0, terrain: TerrainOptions | None = None, **ground: Any):
        """Sit on the perch, everything powered on; on flat, hard ground, if no other is given.

        Args:
            seed: of all noise.
            terrain: shape of the ground.
            ground: further `WorldOptions` of it.
        """
        shape = terrain or TerrainOptions()
        super().__init__(options=WorldOptions(shape, seed=seed, body="robot_with_unit", **ground))
        self.propellers = PropellersInWorld(self.robot, self.model, self.data)
        self.gear = FlightGear(self.robot, "robot", seed)
        self.limp = np.zeros(12, np.bool_)
        self._friction = ServoUnits(self.robot.bus_servo).friction

    @property
    def time_ns(self) -> int:
        """Simulated time [ns]."""
        return round(1e6 * self.data.time) * 1000

    def tick(self) -> None:
        """Advance by 2 ms."""
        now = self.time_ns
        self.gear.fly(now, self.propellers, self.measurements)
        super().tick()
        poses = []
        if now % POSE_PERIOD_NS == 0:
            q, v = self.data.qpos, self.data.qvel
            orientation = tuple(np.roll(q[3:7], -1).tolist())
            poses = [PoseSample(now, q[:3].tolist(), orientation, v[:3].tolist(), v[3:6].tolist())]
        self.gear.hear(now, self.controller, poses)

    def become(self, mode: str) -> None:
        """Ask for a mode; run until it is there and settled, for 8 s at most."""
        accepted, message = self.controller.request_mode(mode)
        assert accepted, message
        for _ in range(80):
            self.run(0.1)
            if self.controller.mode.value == mode and self.controller.present.settled:
                return
        raise AssertionError(f"{mode}: {self.controller.mode}, {self.controller.reason}")

    def lose_servo(self, joint: str) -> None:
        """Take torque off one servo, and have its bridge tell that the servos are not well."""
        self.limp[self.robot.joint_names.index(joint)] = True
        self.measurements.drives_operational = False

    def _drive(self) -> None:
        super()._drive()
        if self.limp.any():
            drag = -self._friction * np.clip(self.data.qvel[6:] / _CREEP, -1.0, 1.0)
            self.data.ctrl[self.limp] = drag[self.limp]
        self.propellers.step()
