"""From a collective thrust and a moment to four rotors that stand anywhere: legs are their arms.

The wanted thrusts are the inverse of what the rotors do about the centre of mass. Where one of them
lies outside 0 .. full throttle, or a rotor is lost, the thrusts are those whose collective and
moments are nearest to the wanted ones by weighted least squares within these limits. The weights
make things give way in the order of `mixer`: collective first, then yaw, roll and pitch last.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.fan import FanModel
from husky_description.robot import Robot
from husky_description.rotor_geometry import RotorGeometry, flight_posture, rotor_geometry
from husky_pu.autopilot.mixer import Mixer
from husky_pu.autopilot.rotor_thrust import RotorThrust

_WEIGHTS = (1e-3, 1.0, 1.0, 0.03)
"""Of collective, roll, pitch and yaw, over their levers."""
_LEAST_DETERMINANT = 1e-3
"""Of the rotors' effect over the levers: with less, an axis is as good as lost."""


class PostureMixer(RotorThrust):
    """Allocation of rotors that the legs hold, ordered as the legs."""

    def __init__(self, robot: Robot, geometry: RotorGeometry):
        """Take the places and axes of the robot's propellers.

        Raises:
            ValueError: in this posture they cannot make all of collective, roll, pitch and yaw.
        """
        # Here, for it takes a third of a second of each node that has another mixer.
        from scipy.optimize import lsq_linear

        self._least_squares = lsq_linear
        fan = FanModel.of(robot)
        effect = geometry.effectiveness(fan.moment_per_thrust)
        _, _, up, *turning = effect
        # Yaw comes of drag and of tilted axes: it is as strong as the posture makes it.
        levers = [float(np.abs(row).mean()) for row in turning]
        if min(levers) <= 0.0:
            raise ValueError(f"rotors at {geometry.position.tolist()}: no lever about an axis")
        patterns = np.array(turning) / np.array(levers)[:, None]
        voltage = fan.steady_voltage(fan.max_thrust)
        super().__init__(robot, fan.max_thrust, voltage, levers, patterns)
        self.effectiveness = np.vstack((up, *turning))
        self._rows = np.vstack((up, patterns))
        if abs(np.linalg.det(self._rows / 2.0)) < _LEAST_DETERMINANT:
            raise ValueError(
                f"rotors at {geometry.position.tolist()} with axes {geometry.axis.tolist()}: "
                "collective, roll, pitch and yaw do not come apart"
            )
        self._levers = np.array((1.0, *levers))

    def allocate(
        self,
        collective: float,
        moment: Sequence[float] | Array,
        voltage: float | None = None,
        available: Sequence[bool] | NDArray[np.bool_] | None = None,
        rise: float = math.inf,
    ) -> Array:
        """Return the thrust of each rotor [N] (4,); the module says what gives way.

        With two or more lost nothing is allocated: all zero.
        """
        demand = np.array(self.checked_demand(collective, moment, rise)) / self._levers
        full = self.thrust_limit(voltage)
        left = np.ones(4, bool) if available is None else np.asarray(available, bool)
        thrust = np.zeros(4)
        if left.sum() < 3:
            return thrust
        if left.all():
            thrust = np.linalg.solve(self._rows, demand)
            if thrust.min() >= 0.0 and thrust.max() <= full:
                return thrust
        thrust = self._nearest(demand, _WEIGHTS, full, left)
        highest = demand[0] + rise
        if self._rows[0] @ thrust > highest:
            # What moments may add to the collective is used up: they give way.
            demand[0] = highest
            thrust = self._nearest(demand, (1e3, *_WEIGHTS[1:]), full, left)
        return thrust

    def _nearest(
        self, demand: Array, weights: Sequence[float], full: float, left: NDArray[np.bool_]
    ) -> Array:
        weight = np.array(weights)
        if not left.all():
            weight[3] = 0.0  # three rotors carry collective, roll and pitch
        matrix = weight[:, None] * self._rows[:, left]
        result = self._least_squares(matrix, weight * demand, (0.0, full), method="bvls")
        thrust = np.zeros(4)
        thrust[left] = np.clip(result.x, 0.0, full)
        return thrust


def mixer_of(robot: Robot) -> RotorThrust:
    """Return the mixer of a robot's rotors: fans that stand, or propellers in flight's posture."""
    if robot.legs_carry_propellers:
        return PostureMixer(robot, rotor_geometry(robot, flight_posture(robot)))
    return Mixer(robot)
