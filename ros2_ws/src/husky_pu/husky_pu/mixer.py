"""From a collective thrust and a moment to four fans and back.

Fan i at (x_i, y_i) with spin s_i and moment per thrust q gives, in base (x forward, y left, z up):
collective = sum T_i, roll = sum y_i T_i, pitch = -sum x_i T_i, yaw = -sum s_i q T_i (steady state).

Each T_i lies within 0 and what full throttle gives at the bus voltage. If not everything fits, in
this order:

1. roll and pitch: both scaled by the greatest factor <= 1 for which *some* collective fits;
2. yaw: then scaled in the same way, roll and pitch as they stand;
3. collective: then the nearest one that fits, lower or higher than asked.

So attitude is kept before collective, and a moment may raise the collective above the demand:
`rise` bounds by how much (a fail-safe that ramps down sets it to 0; moments then shrink instead).
With one fan lost, yaw is given up and three fans carry roll, pitch and collective. The fan opposite
to the lost one makes one sign of moment only: what cannot be had is left out along that diagonal
alone (nearest point in roll / y and pitch / x), collective last as before. With two or more lost
nothing is allocated: all zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from husky_description.parameters import frozen
from husky_description.robot import Robot
from husky_pu.fan import FanModel

Array = NDArray[np.float64]


class Mixer:
    """Allocation of the four fans, ordered as the legs.

    Attributes:
        max_collective: of four fans at `fans.voltage` [N]; 1 of a normalised thrust.
        moment_scale: (3,) roll, pitch, yaw [N m] that one unit of a normalised moment means: what
            half the collective can carry, every fan between none and full thrust.
        max_thrust: of one fan at `fans.voltage` [N].
        fan: thrust curve of one fan.
        effectiveness: (4, 4) from thrusts [N] to collective [N] and moment in base [N m].
    """

    def __init__(self, robot: Robot):
        """Take places, senses and thrust curve of the robot's fans.

        Raises:
            ValueError: the fans stand on a line.
        """
        fans = robot.fans
        if min(fans.x, fans.y) <= 0.0:
            raise ValueError(f"fans.x {fans.x:g}, fans.y {fans.y:g}: no lever to roll or pitch")
        self.fan = FanModel.from_section(fans)
        self._voltage = fans.voltage
        self._low, self._start = robot.esc.pulse_low, robot.esc.pulse_start
        self._span = robot.esc.pulse_high - robot.esc.pulse_low
        self._lever = (fans.y, fans.x, self.fan.moment_per_thrust)
        side, fore = np.sign(robot.fan_position[:, 1]), np.sign(robot.fan_position[:, 0])
        patterns = np.array([side, -fore, -fans.spin])
        self._pattern: list[list[float]] = patterns.T.tolist()
        self.max_thrust = fans.max_thrust
        self.max_collective = 4.0 * fans.max_thrust
        self.moment_scale = frozen(2.0 * fans.max_thrust * np.array(self._lever))
        self.effectiveness = frozen(
            np.vstack((np.ones(4), patterns * np.array(self._lever)[:, None]))
        )

    def thrust_limit(self, voltage: float | None = None) -> float:
        """Steady thrust of one fan at full throttle [N]; bus voltage [V], `fans.voltage` if None.

        Raises:
            ValueError: the voltage is not finite or not positive.
        """
        return self.fan.steady_thrust(self._checked(voltage))

    def allocate(
        self,
        collective: float,
        moment: Sequence[float] | Array,
        voltage: float | None = None,
        available: Sequence[bool] | NDArray[np.bool_] | None = None,
        rise: float = math.inf,
    ) -> Array:
        """Thrust of each fan [N] (4,); see the module for what gives way.

        Args:
            collective: along base z [N]; below 0 counts as 0.
            moment: (3,) in base [N m].
            voltage: of the bus [V]; `fans.voltage` if None.
            available: (4,) false for a fan that is lost; all there if None.
            rise: how far above the demand moments may raise the collective [N] >= 0.

        Raises:
            ValueError: a demand or the voltage is not finite (`rise` may be infinite), or `rise`
                is negative.
        """
        demand = (float(collective), *(float(m) for m in moment))
        if len(demand) != 4 or not all(map(math.isfinite, demand)):
            raise ValueError(f"collective {collective!r}, moment {moment!r}: not finite or not 3")
        if not rise >= 0.0:
            raise ValueError(f"rise: {rise!r} is not zero or more")
        full = self.thrust_limit(voltage)
        total = max(demand[0], 0.0)
        roll, pitch, yaw = (m / lever for m, lever in zip(demand[1:], self._lever, strict=True))
        lost = [i for i in range(4) if available is not None and not available[i]]
        if not lost:
            thrust = self._allocate_four(total, roll, pitch, yaw, full, rise)
        elif len(lost) == 1:
            thrust = self._allocate_three(lost[0], total, roll, pitch, full, rise)
        else:
            thrust = [0.0] * 4
        return np.array([min(max(t, 0.0), full) for t in thrust])

    def _allocate_four(
        self, total: float, roll: float, pitch: float, yaw: float, full: float, rise: float
    ) -> list[float]:
        """Thrusts [N]; moments over their levers [N]."""
        highest = min(full, (total + rise) / 4.0)  # that the mean may become
        tilt = [(p[0] * roll + p[1] * pitch) / 4.0 for p in self._pattern]
        twist = [p[2] * yaw / 4.0 for p in self._pattern]
        wanted = [total / 4.0 + t + w for t, w in zip(tilt, twist, strict=True)]
        if min(wanted) >= 0.0 and max(wanted) <= full:
            return wanted
        share = _greatest_share([0.0] * 4, tilt, full, highest)
        tilt = [share * t for t in tilt]
        share = _greatest_share(tilt, twist, full, highest)
        offset = [t + share * w for t, w in zip(tilt, twist, strict=True)]
        mean = max(min(total / 4.0, full - max(offset)), -min(offset))
        return [mean + o for o in offset]

    def _allocate_three(
        self, lost: int, total: float, roll: float, pitch: float, full: float, rise: float
    ) -> list[float]:
        """Thrusts [N] without fan `lost`; roll / y and pitch / x fall apart into two diagonals.

        With s, f the signs of the lost fan in roll and pitch, o the fan opposite to it, a the one
        on its side and b the one at its end: T_o = -(s roll + f pitch) / 2 and
        T_a - T_b = (s roll - f pitch) / 2.
        """
        s, f, _ = self._pattern[lost]
        opposite = 3 - lost
        a = next(i for i in range(4) if i != lost and self._pattern[i][0] == s)
        b = next(i for i in range(4) if i != lost and self._pattern[i][1] == f)
        highest = total + rise
        t_opposite = min(max(-(s * roll + f * pitch) / 2.0, 0.0), full, highest)
        room = min(full, highest - t_opposite)
        difference = min(max((s * roll - f * pitch) / 2.0, -room), room)
        pair = min(max(total - t_opposite, abs(difference)), 2.0 * full - abs(difference))
        thrust = [0.0] * 4
        thrust[opposite] = t_opposite
        thrust[a] = (pair + difference) / 2.0
        thrust[b] = (pair - difference) / 2.0
        return thrust

    def greatest_collective(
        self, voltage: float | None = None, available: Sequence[bool] | None = None
    ) -> float:
        """Greatest collective without a moment [N]; voltage [V] and fans as in `allocate`."""
        most = self.allocate(self.max_collective, (0.0, 0.0, 0.0), voltage, available, rise=0.0)
        return float(most.sum())

    def wrench(self, thrust: Sequence[float] | Array) -> tuple[float, Array]:
        """Collective [N] and moment in base [N m] (3,) that steady thrusts [N] (4,) give."""
        result = self.effectiveness @ np.asarray(thrust, float)
        return float(result[0]), result[1:]

    def pulses(
        self, thrust: Sequence[float] | Array, voltage: float | None = None
    ) -> NDArray[np.uint16]:
        """Pulse widths [us] (4,) that keep the thrusts [N] (4,), within low and high pulse.

        What would fall into the speed controllers' dead band becomes the low pulse.

        Raises:
            ValueError: a thrust or the voltage is not finite.
        """
        bus = self._checked(voltage)
        result = np.empty(4, np.uint16)
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
        """Thrusts [N] (4,) that pulses [us] (4,) keep; inverse of `pulses` but for rounding."""
        bus = self._checked(voltage)
        result = np.zeros(4)
        for i, pulse in enumerate(pulses):
            if pulse >= self._start:
                throttle = min((float(pulse) - self._low) / self._span, 1.0)
                result[i] = self.fan.steady_thrust(throttle * bus)
        return result

    def _checked(self, voltage: float | None) -> float:
        bus = self._voltage if voltage is None else float(voltage)
        if not (math.isfinite(bus) and bus > 0.0):
            raise ValueError(f"voltage: {voltage!r} is not finite and positive")
        return bus


def _greatest_share(
    base: Sequence[float], change: Sequence[float], full: float, highest: float
) -> float:
    """Greatest share <= 1 of `change` on top of `base` that some mean thrust can carry.

    The offsets base + share * change need a mean m with 0 <= m + offset <= full, m <= highest;
    share 0 fits. All [N].
    """
    share = 1.0
    for b, c in zip(base, change, strict=True):
        if c < 0.0:
            share = min(share, (highest + b) / -c)
        for b_other, c_other in zip(base, change, strict=True):
            if c > c_other:
                share = min(share, (full - b + b_other) / (c - c_other))
    return max(share, 0.0)
