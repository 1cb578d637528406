"""What equal rotors give by pulses and bus voltage, and what a mixer of them must do."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.fan import FanModel
from husky_description.parameters import frozen
from husky_description.robot import Robot


class RotorThrust(ABC):
    """Thrust of n equal rotors by pulses and bus voltage, ordered as `names`.

    Attributes:
        names: of the rotors.
        fan: thrust curve of one.
        max_thrust: of one at `voltage` [N].
        max_collective: of all at `voltage` [N]; 1 of a normalised thrust.
        voltage: of the bus at which these hold [V].
        effectiveness: (4, n) from thrusts [N] to collective [N] and moment in base [N m].
        moment_scale: (3,) roll, pitch, yaw [N m] that one unit of a normalised moment means: what
            half the collective can carry, every rotor between none and full thrust.
    """

    def __init__(
        self,
        robot: Robot,
        max_thrust: float,
        voltage: float,
        levers: Sequence[float],
        patterns: Array,
    ):
        """Take the thrust curve of the robot's rotors.

        Args:
            robot: its numbers.
            max_thrust: of one rotor at full throttle [N].
            voltage: of the bus then [V].
            levers: of roll, pitch, yaw [m].
            patterns: (3, n) roll, pitch, yaw of each rotor's thrust over the lever and the thrust.
        """
        self.fan = FanModel.of(robot)
        self.max_thrust, self.voltage = max_thrust, voltage
        self.names = robot.rotor_names
        count = len(self.names)
        self.max_collective = count * max_thrust
        self.moment_scale = frozen(count / 2.0 * max_thrust * np.array(levers))
        up = np.ones(count)
        self.effectiveness = frozen(np.vstack((up, patterns * np.array(levers)[:, None])))
        self._low, self._start = robot.esc.pulse_low, robot.esc.pulse_start
        self._span = robot.esc.pulse_high - robot.esc.pulse_low

    def thrust_limit(self, voltage: float | None = None) -> float:
        """Return the steady thrust of one rotor at full throttle [N].

        Args:
            voltage: of the bus [V]; `voltage` of the class if None.

        Raises:
            ValueError: the voltage is not finite or not positive.
        """
        return self.fan.steady_thrust(self._checked(voltage))

    @abstractmethod
    def allocate(
        self,
        collective: float,
        moment: Sequence[float] | Array,
        voltage: float | None = None,
        available: Sequence[bool] | NDArray[np.bool_] | None = None,
        rise: float = math.inf,
    ) -> Array:
        """Return the thrust of each rotor [N] (n,).

        Args:
            collective: along base z [N]; below 0 counts as 0.
            moment: (3,) in base [N m].
            voltage: of the bus [V]; `voltage` of the class if None.
            available: (n,) false for a rotor that is lost; all there if None.
            rise: how far above the demand moments may raise the collective [N] >= 0.

        Raises:
            ValueError: a demand or the voltage is not finite (`rise` may be infinite), or `rise`
                is negative.
        """

    def greatest_collective(
        self, voltage: float | None = None, available: Sequence[bool] | None = None
    ) -> float:
        """Greatest collective without a moment [N]; voltage [V] and fans as in `allocate`."""
        most = self.allocate(self.max_collective, (0.0, 0.0, 0.0), voltage, available, rise=0.0)
        return float(most.sum())

    def wrench(self, thrust: Sequence[float] | Array) -> tuple[float, Array]:
        """Collective [N] and moment in base [N m] (3,) that steady thrusts [N] (n,) give."""
        result = self.effectiveness @ np.asarray(thrust, float)
        return float(result[0]), result[1:]

    def pulses(
        self, thrust: Sequence[float] | Array, voltage: float | None = None
    ) -> NDArray[np.uint16]:
        """Pulse widths [us] (n,) that keep the thrusts [N] (n,), within low and high pulse.

        What would fall into the speed controllers' dead band becomes the low pulse.

        Raises:
            ValueError: a thrust or the voltage is not finite.
        """
        bus = self._checked(voltage)
        result = np.empty(len(self.names), np.uint16)
        for i, wanted in enumerate(thrust):
            if not math.isfinite(wanted):
                raise ValueError(f"thrust: {thrust!r} is not finite")
            pulse = self._low
            if wanted > 0.0:
                throttle = min(self.fan.steady_voltage(float(wanted)) / bus, 1.0)
                pulse += self._span * throttle
            result[i] = round(pulse if pulse >= self._start else self._low)
        return result

    def steady_thrust(self, pulses: Any, voltage: float | None = None) -> Array:
        """Thrusts [N] (n,) that pulses [us] (n,) keep; inverse of `pulses` but for rounding."""
        bus = self._checked(voltage)
        result = np.zeros(len(self.names))
        for i, pulse in enumerate(pulses):
            if pulse >= self._start:
                throttle = min((float(pulse) - self._low) / self._span, 1.0)
                result[i] = self.fan.steady_thrust(throttle * bus)
        return result

    def _checked(self, voltage: float | None) -> float:
        bus = self.voltage if voltage is None else float(voltage)
        if not (math.isfinite(bus) and bus > 0.0):
            raise ValueError(f"voltage: {voltage!r} is not finite and positive")
        return bus

    def checked_demand(
        self, collective: float, moment: Sequence[float] | Array, rise: float
    ) -> tuple[float, float, float, float]:
        """Return collective [N], no less than 0, and moment [N m], as plain numbers.

        Raises:
            ValueError: one is not finite, or `rise` [N] is negative.
        """
        demand = (float(collective), *(float(m) for m in moment))
        if len(demand) != 4 or not all(map(math.isfinite, demand)):
            raise ValueError(f"collective {collective!r}, moment {moment!r}: not finite or not 3")
        if not rise >= 0.0:
            raise ValueError(f"rise: {rise!r} is not zero or more")
        return (max(demand[0], 0.0), *demand[1:])
