"""Propellers on legs that move: each pushes where its leg holds it (Husky-beta, T17)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.plain_mujoco import mujoco
from husky_description.robot import Robot
from husky_sim.propulsion.fans_in_world import FansInWorld


class Propellers(NamedTuple):
    """The propellers, and what carries them."""

    carrier: NDArray[np.intp]  # (4, 2) site and body of each
    spin: Array  # (4,) sense of each about its thrust
    inertia: float  # of a rotor [kg m^2]
    fans: Any  # (4,) thrust [N], torque [N m] and speed [rad/s] of each


class Carriers(NamedTuple):
    """Sites and bodies of the world, all in world axes; views of MuJoCo's own arrays."""

    place: Array  # of sites [m] (n, 3)
    frame: Array  # of sites, row by row (n, 9); the thrust is along z
    center: Array  # of bodies' masses [m] (m, 3)
    turning: Array  # bodies' angular velocities, then others [rad/s] (m, 6)
    applied: Array  # force and moment on bodies [N, N m] (m, 6)


@njit(cache=True)
def _push(propellers: Propellers, carriers: Carriers, base: Array, sum_: Array) -> None:
    """Put the propellers' forces on what carries them.

    Args:
        propellers: as they turn now.
        carriers: of whose bodies what is applied is written.
        base: base's origin in world [m] (3,).
        sum_: all forces and their moment about that origin, in world (6,), written.
    """
    sum_[:] = 0.0
    for i in range(len(propellers.fans)):
        fan, spin = propellers.fans[i], propellers.spin[i]
        site, body = propellers.carrier[i]
        axis = carriers.frame[site].reshape(3, 3)[:, 2]
        force = fan.thrust * axis
        momentum = propellers.inertia * spin * fan.speed * axis
        moment = -spin * fan.torque * axis - np.cross(carriers.turning[body, :3], momentum)
        place = carriers.place[site]
        carriers.applied[body, :3] = force
        carriers.applied[body, 3:] = moment + np.cross(place - carriers.center[body], force)
        sum_[:3] += force
        sum_[3:] += moment + np.cross(place - base, force)


class PropellersInWorld(FansInWorld):
    """Steps the propellers with the physics; the legs carry them.

    Each gives its thrust along its axis and, against its spin, the air's torque and that of its
    speeding up; a leg that turns it feels its gyroscopic moment.
    """

    def __init__(self, robot: Robot, model: mujoco.MjModel, data: mujoco.MjData):
        """Find sensors and propellers; they are off."""
        super().__init__(robot, model, data)
        sites = [model.site(f"{leg}_propeller").id for leg in robot.legs]
        self._propellers = Propellers(
            np.array([(site, model.site_bodyid[site]) for site in sites]),
            np.array(robot.propellers.spin),
            self.unit.fan.inertia,
            self.unit.fans,
        )
        self._carriers = Carriers(
            data.site_xpos, data.site_xmat, data.xipos, data.cvel, data.xfrc_applied
        )
        self._side_force = robot.propellers.side_force
        self._sum = np.zeros(6)
        self._base = model.body("base").id
        self._center_of_all = data.subtree_com[self._base]

    def step(self, load: float = 0.0) -> None:
        """Advance by one physics step; call before `mj_step`.

        Args:
            load: power that the joints' servos take from the battery [W].
        """
        self.unit.step(self.pwm, self._step, load)
        _push(self._propellers, self._carriers, self._data.xpos[self._base], self._sum)
        if self.wind is not None:
            self._blow(self.wind)

    def _blow(self, wind: Array) -> None:
        """Add the force of the air that crosses the propellers' axes."""
        data = self._data
        carriers = self._propellers.carrier
        for (site, body), thrust in zip(carriers, self.unit.thrust.tolist(), strict=True):
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
