"""From a collective thrust and a moment to four fans at the corners of a rectangle, and back.

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

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.fan import FanModel
from husky_description.robot import Robot
from husky_description.sections import FansSection
from husky_pu.autopilot.rotor_thrust import RotorThrust


def stands_in_rectangle(fans: FansSection) -> bool:
    """Return whether there is one fan in each corner of a rectangle about base's origin."""
    x, y = fans.reach.tolist()
    corners = {(x, y), (x, -y), (-x, y), (-x, -y)}
    return len(fans.rotors) == 4 and set(map(tuple, fans.place.tolist())) == corners


class Mixer(RotorThrust):
    """Allocation of four fans."""

    def __init__(self, robot: Robot):
        """Take the robot's fans; raises ValueError if they stand otherwise."""
        fans = robot.fans
        if not stands_in_rectangle(fans):
            raise ValueError(f"fans.rotors: at {fans.place.tolist()} m, not in a rectangle")
        x, y = fans.reach.tolist()
        self._lever = (y, x, FanModel.of(robot).moment_per_thrust)
        fore, side = np.sign(fans.place.T)
        patterns = np.array([side, -fore, -fans.spin])
        self._pattern: list[list[float]] = patterns.T.tolist()
        super().__init__(robot, fans.max_thrust, fans.voltage, self._lever, patterns)

    def allocate(
        self,
        collective: float,
        moment: Sequence[float] | Array,
        voltage: float | None = None,
        available: Sequence[bool] | NDArray[np.bool_] | None = None,
        rise: float = math.inf,
    ) -> Array:
        """Return the thrust of each fan [N] (4,); the module says what gives way."""
        total, *moments = self.checked_demand(collective, moment, rise)
        full = self.thrust_limit(voltage)
        roll, pitch, yaw = (m / lever for m, lever in zip(moments, self._lever, strict=True))
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
        opposite = next(i for i in range(4) if self._pattern[i][:2] == [-s, -f])
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
