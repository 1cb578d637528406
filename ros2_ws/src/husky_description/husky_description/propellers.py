"""Sections of a robot with a propeller outside each knee: the propellers, and what carries them.

SI units and radians; sources of the values stand in beta.yaml.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from husky_description.arrays import Array
from husky_description.parameters import number, vector

POINTS = 9
"""Points of the maker's static table."""


@dataclass(frozen=True, eq=False)
class KneePodSection:
    """What sits at each knee, fixed to the thigh: knee servo, propeller motor and propeller.

    Attributes:
        mass: of one [kg].
        size: of the box it is taken for, along x, y, z of the thigh [m] (3,).
        offset: from the plane of the leg to the box's centre, outward [m].
    """

    mass: Annotated[float, number(1e-3, 5.0)]
    size: Annotated[Array, vector(3, 0.001, 0.5)]
    offset: Annotated[float, number(-0.1, 0.2)]


@dataclass(frozen=True, eq=False)
class PropellersSection:
    """Four propellers, one outside each knee, that push outward along the knee's axis.

    Attributes:
        diameter: [m].
        offset: from the plane of the leg to the plane of the blades, outward [m].
        flight_knee: knee angle in flight [rad].
        spin: sense of rotation of each about its thrust, -1 or 1 (4,).
        speed: of the maker's static table, rising [rad/s] (`POINTS`,).
        thrust: at these speeds [N] (`POINTS`,).
        torque: of the air against the rotor, at these speeds [N m] (`POINTS`,).
        full_speed: at full throttle on the battery's nominal voltage, under load [rad/s].
        speed_constant: of the motor [rad/s/V].
        resistance: of motor and speed controller, seen from the direct current side [ohm].
        no_load_current: of the motor [A].
        rotor_inertia: of propeller and bell [kg m^2].
        side_force: of air that crosses the axis, over the thrust and its speed [s/m].
    """

    diameter: Annotated[float, number(0.02, 1.0)]
    offset: Annotated[float, number(0.0, 0.3)]
    flight_knee: Annotated[float, number(-3.0, 0.0)]
    spin: Annotated[Array, vector(4, -1.0, 1.0)]
    speed: Annotated[Array, vector(POINTS, 1.0, 10000.0)]
    thrust: Annotated[Array, vector(POINTS, 0.0, 500.0)]
    torque: Annotated[Array, vector(POINTS, 0.0, 50.0)]
    full_speed: Annotated[float, number(10.0, 10000.0)]
    speed_constant: Annotated[float, number(1.0, 5000.0)]
    resistance: Annotated[float, number(1e-3, 5.0)]
    no_load_current: Annotated[float, number(0.0, 20.0)]
    rotor_inertia: Annotated[float, number(1e-8, 1e-2)]
    side_force: Annotated[float, number(0.0, 1.0)]

    def static_thrust(self, speed: float) -> float:
        """Return the thrust of one [N] at a speed [rad/s] in still air, from the table."""
        return self._at(speed, self.thrust)

    def static_torque(self, speed: float) -> float:
        """Return the air's torque on the rotor of one [N m] at a speed [rad/s] in still air."""
        return self._at(speed, self.torque)

    def _at(self, speed: float, values: Array) -> float:
        # Both go nearly with the square of the speed: linear between the points in that square.
        squares = np.concatenate(([0.0], self.speed**2))
        return float(np.interp(speed * speed, squares, np.concatenate(([0.0], values))))

    def check(self) -> None:
        """Refuse numbers that contradict each other.

        Raises:
            ValueError: names the key and what is wrong.
        """
        for key in ("speed", "thrust", "torque"):
            if np.any(np.diff(getattr(self, key)) <= 0.0):
                raise ValueError(f"propellers.{key}: does not rise from point to point")
        if self.spin.tolist() not in ([1.0, -1.0, -1.0, 1.0], [-1.0, 1.0, 1.0, -1.0]):
            raise ValueError(
                f"propellers.spin: {self.spin.tolist()}: each is 1 or -1, neighbours of opposite "
                "sense"
            )
        if self.full_speed > self.speed[-1]:
            raise ValueError(
                f"propellers.full_speed: {self.full_speed:g} is above the last of propellers.speed,"
                f" {self.speed[-1]:g}"
            )
