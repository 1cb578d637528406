"""Compliant ground of thesis T27, in N/m and N s/m whatever stands on it.

MuJoCo's own contact parameters are accelerations: the stiffness that they give grows with the mass
on the contact. Here the forces of T27 are found for the end of each physics step (implicit Euler),
since their dampers and the Stribeck velocity of 1 mm/s are too stiff for forces of its beginning,
and MuJoCo's constraint rows of the ground's contacts are set so that its solver returns them.
Joint limits, equalities and contacts between links stay MuJoCo's.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from husky_description.arrays import Array
from husky_description.ground import GroundModel
from husky_description.plain_mujoco import mujoco

_REGULARISATION = 1e3
"""MuJoCo's R of the rows that carry a known force [1/kg]: they resist like a gram of mass."""
_NO_PUSH = -1e9
"""Reference acceleration of a row that carries nothing [m/s^2]."""
_SWEEPS, _TOLERANCE = 1000, 1e-7
"""Most sweeps over the contacts, and the change of a force at which they end [N]."""


class SoftGround:
    """Law of a ground that gives way, for the contacts of one model with its floor.

    A foot, shin or torso presses with one spring, damper and friction: of a body's geoms the
    deepest, whose contact points share them by depth. The ground only pushes.

    Attributes:
        ground: the numbers of T27.
    """

    def __init__(self, model: mujoco.MjModel, ground: GroundModel, floor: str):
        """Prepare for a model whose ground are the geoms with names that begin with `floor`.

        Raises:
            ValueError: the model's friction cones are not elliptic, its Jacobian is sparse, or its
                constraints are solved island by island.
        """
        elliptic = model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
        islands = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_ISLAND
        if not elliptic or islands or mujoco.mj_isSparse(model):
            raise ValueError("soft ground needs elliptic cones, a dense Jacobian and no islands")
        self.ground = ground
        names = [model.geom(index).name for index in range(model.ngeom)]
        self._is_floor = np.array([name.startswith(floor) for name in names])
        self._other_force = np.zeros(model.nv)

    def step(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Advance by one physics step, as `mj_step` does."""
        if data.time == 0.0:
            self._other_force[:] = 0.0
        mujoco.mj_step1(model, data)
        rows = self._press(model, data) if data.ncon else None
        mujoco.mj_step2(model, data)
        self._other_force[:] = data.qfrc_constraint
        if rows is not None:
            jacobian = data.efc_J.reshape(-1, model.nv)[rows]
            self._other_force -= data.efc_force[rows] @ jacobian

    def _press(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array | None:
        """Set the rows of the ground's contacts; return those that press, or None."""
        contact = data.contact
        share = np.zeros(data.ncon)
        _share_of_law(
            contact.geom,
            contact.efc_address,
            contact.dist,
            self._is_floor,
            model.geom_bodyid,
            share,
        )
        touching = self._is_floor[contact.geom].any(axis=1) & (contact.efc_address >= 0)
        data.efc_aref[contact.efc_address[touching]] = _NO_PUSH
        pressing = np.flatnonzero(share)
        if not pressing.size:
            return None
        rows: Array = (contact.efc_address[pressing, None] + np.arange(3)).ravel()
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        jacobian = data.efc_J.reshape(-1, model.nv)[rows]
        # The last row: of the other constraints, their forces of the step before.
        loads = np.vstack((jacobian, self._other_force))
        accelerations = np.empty_like(loads)
        mujoco.mj_solveM(model, data, accelerations, loads)
        mobility = accelerations[:-1] @ jacobian.T
        free = jacobian @ (data.qacc_smooth + accelerations[-1])
        force, gained = np.zeros(rows.size), np.zeros(rows.size)
        ground = self.ground
        _solve(
            model.opt.timestep,
            (ground.stiffness, ground.damping),
            (ground.friction_coulomb, ground.friction_static, ground.stribeck_velocity),
            ground.friction_viscous,
            share[pressing],
            contact.dist[pressing],
            data.efc_vel[rows],
            free,
            mobility,
            force,
            gained,
        )
        data.efc_R[rows] = _REGULARISATION
        data.efc_D[rows] = 1.0 / _REGULARISATION
        data.efc_aref[rows] = _REGULARISATION * force + gained
        # A cone that holds the known force with room to spare.
        tangential = np.hypot(force[1::3], force[2::3])
        slope = np.maximum(1.0, 2.0 * tangential / np.maximum(force[0::3], 1e-9))
        contact.friction[pressing, :2] = slope[:, None]
        contact.mu[pressing] = slope
        lifted = force[0::3] <= 0.0
        data.efc_aref[rows[0::3][lifted]] = _NO_PUSH
        return rows


@njit(cache=True)
def _share_of_law(geoms, addresses, distances, is_floor, body_of, share):  # type: ignore[no-untyped-def]
    """Fill in each contact's part of its body's spring: by depth, in the body's deepest geom."""
    for i in range(len(distances)):
        if (
            addresses[i] < 0
            or distances[i] >= 0.0
            or is_floor[geoms[i, 0]] == is_floor[geoms[i, 1]]
        ):
            continue
        geom = geoms[i, 1] if is_floor[geoms[i, 0]] else geoms[i, 0]
        deepest, total = geom, 0.0
        least = 0.0
        for j in range(len(distances)):
            floor_first = is_floor[geoms[j, 0]]
            if addresses[j] < 0 or floor_first == is_floor[geoms[j, 1]]:
                continue
            other = geoms[j, 1] if floor_first else geoms[j, 0]
            if body_of[other] == body_of[geom] and distances[j] < least:
                least, deepest = distances[j], other
            if other == geom and distances[j] < 0.0:
                total += distances[j]
        if deepest == geom:
            share[i] = distances[i] / total


@njit(cache=True)
def _solve(  # type: ignore[no-untyped-def]
    step, spring, friction, viscous, share, distance, velocity, free, mobility, force, gained
):
    """Find the contact forces that T27 has at the end of a step, contact by contact.

    Args:
        step: its length [s].
        spring: stiffness [N/m] and damping [N s/m].
        friction: mu_c, mu_s [-] and Stribeck velocity [m/s].
        viscous: mu_v [N s/m].
        share: of each contact in its body's law (n,).
        distance: of each contact, negative in the ground [m] (n,).
        velocity: at the beginning, normal and two tangents of each contact [m/s] (3 n,).
        free: acceleration without contact forces [m/s^2] (3 n,).
        mobility: acceleration by force [1/kg] (3 n, 3 n).
        force: filled in [N] (3 n,).
        gained: filled in: acceleration with the contact forces [m/s^2] (3 n,).
    """
    count = len(share)
    stiffness, damping = spring
    coulomb, static, stribeck = friction
    bound = np.empty(count)
    drag = np.zeros(3 * count)
    for i in range(count):
        n = 3 * i
        slip = math.hypot(velocity[n + 1], velocity[n + 2])
        bound[i] = coulomb - (coulomb - static) * math.exp(-((slip / stribeck) ** 2))
        drag[n + 1 : n + 3] = -viscous * share[i] * velocity[n + 1 : n + 3]
    free = free + mobility @ drag
    for _ in range(_SWEEPS):
        change = 0.0
        for i in range(count):
            n = 3 * i
            after = velocity[n] + step * (free[n] + mobility[n] @ force)
            k, c = share[i] * stiffness, share[i] * damping
            excess = force[n] + k * (distance[i] + step * after) + c * after
            slope = 1.0 + (k * step + c) * step * mobility[n, n]
            normal = max(0.0, force[n] - excess / slope)
            change = max(change, abs(normal - force[n]))
            force[n] = normal
            gain = step * (mobility[n + 1, n + 1] + mobility[n + 2, n + 2])
            first = velocity[n + 1] + step * (free[n + 1] + mobility[n + 1] @ force)
            second = velocity[n + 2] + step * (free[n + 2] + mobility[n + 2] @ force)
            first, second = force[n + 1] - first / gain, force[n + 2] - second / gain
            length = math.hypot(first, second)
            if length > bound[i] * normal:
                first *= bound[i] * normal / length
                second *= bound[i] * normal / length
            change = max(change, abs(first - force[n + 1]), abs(second - force[n + 2]))
            force[n + 1], force[n + 2] = first, second
        if change < _TOLERANCE:
            break
    for i in range(count):
        if force[3 * i] > 0.0:
            force[3 * i : 3 * i + 3] += drag[3 * i : 3 * i + 3]
    gained[:] = free + mobility @ (force - drag)
