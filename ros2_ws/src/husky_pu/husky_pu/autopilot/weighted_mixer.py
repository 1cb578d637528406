"""From a collective thrust and a moment to rotors that stand anywhere, as on legs that are arms.

The wanted thrusts are the inverse of what the rotors do about the centre of mass. Where one of them
lies outside 0 .. full throttle, or a rotor is lost, the thrusts are those whose collective and
moments are nearest to the wanted ones by weighted least squares within these limits. The weights
make things give way in the order of `mixer`: collective first, then yaw, roll and pitch last; with
a rotor lost yaw is the first to go.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.fan import FanModel
from husky_description.robot import Robot
from husky_description.rotor_geometry import (
    RotorGeometry,
    fan_geometry,
    flight_posture,
    rotor_geometry,
)
from husky_pu.autopilot.mixer import Mixer, stands_in_rectangle
from husky_pu.autopilot.rotor_thrust import RotorThrust

_WEIGHTS = (1e-3, 1.0, 1.0, 0.03)
"""Of collective, roll, pitch and yaw, over their levers."""
_YAW_OF_THE_REST = 1e-4
"""Share of yaw's weight that is left with a rotor lost, so that it gives way before the collective;
of three rotors it is not asked at all."""
_LEAST_DETERMINANT = 1e-3
"""Of the rotors' mean effect over the levers: with less, an axis is as good as lost."""


class WeightedMixer(RotorThrust):
    """Allocation of three rotors or more, wherever they stand."""

    def __init__(self, robot: Robot, geometry: RotorGeometry):
        """Take the places and axes of the robot's rotors.

        Raises:
            ValueError: as they stand they cannot make all of collective, roll, pitch and yaw.
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
        volume = np.linalg.det(self._rows @ self._rows.T / len(self.names))
        if volume < _LEAST_DETERMINANT**2:
            raise ValueError(
                f"rotors at {geometry.position.tolist()} with axes {geometry.axis.tolist()}: "
                "collective, roll, pitch and yaw do not come apart"
            )
        self._levers = np.array((1.0, *levers))
        self._inverse = np.linalg.pinv(self._rows)

    def allocate(
        self,
        collective: float,
        moment: Sequence[float] | Array,
        voltage: float | None = None,
        available: Sequence[bool] | NDArray[np.bool_] | None = None,
        rise: float = math.inf,
    ) -> Array:
        """Return the thrust of each rotor [N] (n,); the module says what gives way.

        With fewer than three left nothing is allocated: all zero.
        """
        demand = np.array(self.checked_demand(collective, moment, rise)) / self._levers
        full = self.thrust_limit(voltage)
        count = len(self.names)
        left = np.ones(count, bool) if available is None else np.asarray(available, bool)
        thrust: Array = np.zeros(count)
        if left.sum() < 3:
            return thrust
        if left.all():
            thrust = self._inverse @ demand
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
            weight[3] *= _YAW_OF_THE_REST if left.sum() > 3 else 0.0
        matrix = weight[:, None] * self._rows[:, left]
        result = self._least_squares(matrix, weight * demand, (0.0, full), method="bvls")
        thrust = np.zeros(len(self.names))
        thrust[left] = np.clip(result.x, 0.0, full)
        return thrust


def mixer_of(robot: Robot) -> RotorThrust:
    """Return the mixer of a robot's rotors: fans that stand, or propellers in flight's posture."""
    if robot.legs_carry_propellers:
        return WeightedMixer(robot, rotor_geometry(robot, flight_posture(robot)))
    if stands_in_rectangle(robot.fans):
        return Mixer(robot)
    return WeightedMixer(robot, fan_geometry(robot))
