"""Propellers on legs that move: each pushes where its leg holds it (Husky-beta, T17)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from husky_description.arrays import Array
from husky_description.plain_mujoco import mujoco
from husky_description.robot import Robot
from husky_sim.propulsion.fans_in_world import FansInWorld


@njit(cache=True)
def _push(
    carriers: Any,
    spin: Array,
    inertia: float,
    fans: Any,
    places: Array,
    frames: Array,
    centers: Array,
    turning: Array,
    applied: Array,
    base: Array,
    sum_: Array,
) -> None:
    """Put the propellers' forces on what carries them.

    Args:
        carriers: (4, 2) site and body of each.
        spin: (4,) sense of each about its thrust.
        inertia: of a rotor [kg m^2].
        fans: (4,) thrust [N], torque [N m] and speed [rad/s] of each.
        places: of sites in world [m] (n, 3).
        frames: of sites, row by row (n, 9); the thrust is along z.
        centers: of bodies' masses in world [m] (m, 3).
        turning: bodies' angular velocities in world [rad/s] (m, 3 of 6).
        applied: force and moment on bodies, in world (m, 6), of the carriers written.
        base: base's origin in world [m] (3,).
        sum_: all forces and their moment about that origin, in world (6,), written.
    """
    sum_[:] = 0.0
    for i in range(4):
        site, body = carriers[i]
        axis = frames[site].reshape(3, 3)[:, 2]
        force = fans[i].thrust * axis
        momentum = inertia * spin[i] * fans[i].speed * axis
        moment = -spin[i] * fans[i].torque * axis - np.cross(turning[body, :3], momentum)
        applied[body, :3] = force
        applied[body, 3:] = moment + np.cross(places[site] - centers[body], force)
        sum_[:3] += force
        sum_[3:] += moment + np.cross(places[site] - base, force)


class PropellersInWorld(FansInWorld):
    """Steps the propellers with the physics; the legs carry them.

    Each gives its thrust along its axis and, against its spin, the air's torque and that of its
    speeding up; a leg that turns it feels its gyroscopic moment.
    """

    def __init__(self, robot: Robot, model: mujoco.MjModel, data: mujoco.MjData):
        """Find sensors and propellers; they are off."""
        super().__init__(robot, model, data)
        sites = [model.site(f"{leg}_propeller").id for leg in robot.legs]
        self._carriers = np.array([(site, model.site_bodyid[site]) for site in sites])
        self._spin = np.array(robot.propellers.spin)
        self._side_force = robot.propellers.side_force
        self._sum = np.zeros(6)
        self._base = model.body("base").id
        self._center_of_all = data.subtree_com[self._base]

    def step(self, load: float = 0.0) -> None:
        """Advance by one physics step; call before `mj_step`.

        Args:
            load: power that the joints' servos take from the battery [W].
        """
        unit, data = self.unit, self._data
        unit.step(self.pwm, self._step, load)
        _push(
            self._carriers,
            self._spin,
            unit.fan.inertia,
            unit.fans,
            data.site_xpos,
            data.site_xmat,
            data.xipos,
            data.cvel,
            data.xfrc_applied,
            data.xpos[self._base],
            self._sum,
        )
        if self.wind is not None:
            self._blow(self.wind)

    def _blow(self, wind: Array) -> None:
        """Add the force of the air that crosses the propellers' axes."""
        data = self._data
        for (site, body), thrust in zip(self._carriers, self.unit.thrust.tolist(), strict=True):
            place, motion = data.site_xpos[site], data.cvel[body]
            axis = data.site_xmat[site].reshape(3, 3)[:, 2]
            velocity = motion[3:] + np.cross(motion[:3], place - self._center_of_all)
            air = wind - velocity
            force = self._side_force * thrust * (air - float(air @ axis) * axis)
            data.xfrc_applied[body, :3] += force
            data.xfrc_applied[body, 3:] += np.cross(place - data.xipos[body], force)
            self._sum[:3] += force
            self._sum[3:] += np.cross(place - data.xpos[self._base], force)

    @property
    def wrench_in_base(self) -> Array:
        """(6,) force [N] and moment about base's origin [N m], in base."""
        rotation = self._data.xmat[self._base].reshape(3, 3)
        return np.concatenate((self._sum[:3] @ rotation, self._sum[3:] @ rotation))


def propulsion_of(robot: Robot, model: mujoco.MjModel, data: mujoco.MjData) -> FansInWorld:
    """Return what moves the robot's fans or propellers."""
    kind = PropellersInWorld if robot.legs_carry_propellers else FansInWorld
    return kind(robot, model, data)
