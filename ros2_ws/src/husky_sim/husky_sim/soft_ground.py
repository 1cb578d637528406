"""Compliant ground of thesis T27, in N/m and N s/m whatever stands on it.

MuJoCo's own contact parameters are accelerations: the stiffness that they give grows with the mass
on the contact. Here the forces of T27 are found for the end of each physics step (implicit Euler),
since their dampers and the Stribeck velocity of 1 mm/s are too stiff for forces of its beginning,
and MuJoCo's constraint rows of the ground's contacts are set so that its solver returns them.
Joint limits, equalities and contacts between links stay MuJoCo's.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from husky_description.arrays import Array
from husky_description.ground import GroundModel
from husky_description.plain_mujoco import mujoco

_REGULARISATION = 1e3
"""MuJoCo's R of the rows that carry a known force [1/kg]: they resist like a gram of mass."""
_NO_PUSH = -1e9
"""Reference acceleration of a row that carries nothing [m/s^2]."""
_AXES = np.arange(3)
_SWEEPS, _TOLERANCE = 200, 1e-6
"""Most sweeps over the contacts, and the change of a force at which they end [N].

Four feet take some 30; a robot that lies on fifteen contacts would take thousands.
"""


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
        pressed = self._press(model, data) if data.ncon else None
        mujoco.mj_step2(model, data)
        self._other_force[:] = data.qfrc_constraint
        if pressed is not None:
            rows, jacobian = pressed
            self._other_force -= data.efc_force[rows] @ jacobian

    def _press(self, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Array, Array] | None:
        """Set the rows of the ground's contacts.

        Returns:
            Indices of the rows that press (n,) and their Jacobian (n, nv), or None.
        """
        contact, ground = data.contact, self.ground
        pressing, share = _pressing(
            contact.geom, contact.efc_address, contact.dist, self._is_floor, model.geom_bodyid
        )
        _release(contact.geom, contact.efc_address, self._is_floor, data.efc_aref)
        if not pressing.size:
            return None
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        rows: Array = (contact.efc_address[pressing, None] + _AXES).ravel()
        # The last row: of the other constraints, their forces of the step before.
        loads = np.empty((rows.size + 1, model.nv))
        loads[:-1] = data.efc_J.reshape(-1, model.nv)[rows]
        loads[-1] = self._other_force
        jacobian, accelerations = loads[:-1], np.empty_like(loads)
        mujoco.mj_solveM(model, data, accelerations, loads)
        force, gained = _solve(
            model.opt.timestep,
            (ground.stiffness, ground.damping, ground.friction_viscous),
            (ground.friction_coulomb, ground.friction_static, ground.stribeck_velocity),
            share,
            contact.dist[pressing],
            data.efc_vel[rows],
            jacobian @ (data.qacc_smooth + accelerations[-1]),
            accelerations[:-1] @ jacobian.T,
        )
        _impose(
            force,
            gained,
            pressing,
            rows,
            (data.efc_R, data.efc_D, data.efc_aref, contact.friction, contact.mu),
        )
        return rows, jacobian


@njit(cache=True)
def _ground_geom(geoms: Any, index: int, is_floor: Any) -> int:
    """Return the geom that touches the floor in a contact, -1 for a contact without the floor."""
    first, second = geoms[index]
    if is_floor[first] == is_floor[second]:
        return -1
    return second if is_floor[first] else first  # type: ignore[no-any-return]


@njit(cache=True)
def _pressing(
    geoms: Any, addresses: Any, distances: Any, is_floor: Any, body_of: Any
) -> tuple[Any, Any]:
    """Return the contacts that press, and each one's share of its body's law, by depth.

    Of a body only the deepest geom presses.
    """
    count = len(distances)
    share = np.zeros(count)
    for i in range(count):
        geom = _ground_geom(geoms, i, is_floor)
        if geom < 0 or addresses[i] < 0 or distances[i] >= 0.0:
            continue
        deepest, least, total = geom, 0.0, 0.0
        for j in range(count):
            other = _ground_geom(geoms, j, is_floor)
            if other < 0 or addresses[j] < 0 or distances[j] >= 0.0:
                continue
            if body_of[other] == body_of[geom] and distances[j] < least:
                least, deepest = distances[j], other
            if other == geom:
                total += distances[j]
        if deepest == geom:
            share[i] = distances[i] / total
    pressing = np.flatnonzero(share)
    return pressing, share[pressing]


@njit(cache=True)
def _release(geoms: Any, addresses: Any, is_floor: Any, reference: Any) -> None:
    """Let no contact with the floor carry anything, by MuJoCo's reference accelerations."""
    for i in range(len(addresses)):
        if addresses[i] >= 0 and _ground_geom(geoms, i, is_floor) >= 0:
            reference[addresses[i]] = _NO_PUSH


@njit(cache=True)
def _solve(
    step: float,
    normal_law: tuple[float, float, float],
    friction: tuple[float, float, float],
    share: Any,
    distance: Any,
    velocity: Any,
    free: Any,
    mobility: Any,
) -> tuple[Any, Any]:
    """Return the contact forces that T27 has at the end of a step, contact by contact.

    Args:
        step: its length [s].
        normal_law: stiffness [N/m], damping [N s/m], and mu_v [N s/m].
        friction: mu_c, mu_s [-] and Stribeck velocity [m/s].
        share: of each contact in its body's law (n,).
        distance: of each contact, negative in the ground [m] (n,).
        velocity: at the beginning, normal and two tangents of each contact [m/s] (3 n,).
        free: acceleration without contact forces [m/s^2] (3 n,).
        mobility: acceleration by force [1/kg] (3 n, 3 n).

    Returns:
        Forces [N] (3 n,), and the accelerations with them [m/s^2] (3 n,).
    """
    count = len(share)
    stiffness, damping, viscous = normal_law
    coulomb, static, stribeck = friction
    bound, force, drag = np.empty(count), np.zeros(3 * count), np.zeros(3 * count)
    for i in range(count):
        n = 3 * i
        slip = math.hypot(velocity[n + 1], velocity[n + 2])
        bound[i] = coulomb - (coulomb - static) * math.exp(-((slip / stribeck) ** 2))
        drag[n + 1 : n + 3] = -viscous * share[i] * velocity[n + 1 : n + 3]
    dragged = free + mobility @ drag
    for _ in range(_SWEEPS):
        change = 0.0
        for i in range(count):
            n = 3 * i
            after = velocity[n] + step * (dragged[n] + mobility[n] @ force)
            k, c = share[i] * stiffness, share[i] * damping
            excess = force[n] + k * (distance[i] + step * after) + c * after
            normal = max(0.0, force[n] - excess / (1.0 + (k * step + c) * step * mobility[n, n]))
            change = max(change, abs(normal - force[n]))
            force[n] = normal
            gain = step * (mobility[n + 1, n + 1] + mobility[n + 2, n + 2])
            first = velocity[n + 1] + step * (dragged[n + 1] + mobility[n + 1] @ force)
            second = velocity[n + 2] + step * (dragged[n + 2] + mobility[n + 2] @ force)
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
    return force, free + mobility @ force


@njit(cache=True)
def _impose(
    force: Any, gained: Any, pressing: Any, rows: Any, solver: tuple[Any, Any, Any, Any, Any]
) -> None:
    """Set MuJoCo's rows so that its solver returns known forces.

    Args:
        force: [N] (3 n,).
        gained: accelerations with them [m/s^2] (3 n,).
        pressing: number of each contact (n,).
        rows: of the contacts (3 n,).
        solver: R, D, reference accelerations, friction coefficients and mu, as MuJoCo has them.
    """
    resistance, conductance, reference, coefficients, cone = solver
    for i in range(len(pressing)):
        n = 3 * i
        if force[n] <= 0.0:
            continue
        for row in range(n, n + 3):
            resistance[rows[row]] = _REGULARISATION
            conductance[rows[row]] = 1.0 / _REGULARISATION
            reference[rows[row]] = _REGULARISATION * force[row] + gained[row]
        # A cone that holds the known force with room to spare.
        slope = max(1.0, 2.0 * math.hypot(force[n + 1], force[n + 2]) / force[n])
        coefficients[pressing[i], 0] = coefficients[pressing[i], 1] = slope
        cone[pressing[i]] = slope
