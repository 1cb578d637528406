"""Finds a fan that does not make the thrust it is told to, as PX4's failure detector does.

A fan is lost when, for a while, its rotor is slower than it should be *and* its speed controller
takes less than half of what the jet alone would need. So neither a rotor that is braked (fast, and
feeding back) nor one that spools up (slow, and drawing much) is taken for lost. What should be is
the lesser of the thrust told now and of that thrust behind the fans' lag. All fans weak together
are a weak battery: a fan is judged only while all others that are left do what they should.
Without telemetry (NaN) nothing is found.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from husky_description.fan import FanModel

_LAG = 0.1
"""Time constant behind which a told thrust must have come about [s]; the fans' is 0.08 s."""
_SLOW = 0.9
"""Share of the speed that belongs to the thrust, below which a rotor is slow."""
_WEAK = 0.5
"""Share of the jet's power, below which a fan does not drive it."""


class FanWatch:
    """Watches all fans; `ok` says which are not lost, and a loss stays until `reset`."""

    def __init__(self, fan: FanModel, count: int):
        """Begin with `count` fans, all there; `fan` is what one should do."""
        self._fan = fan
        self.ok = [True] * count
        self._expected = [0.0] * count
        self._missing_for = [0.0] * count

    def reset(self) -> None:
        """Take all fans for sound again: disarmed."""
        self.__init__(self._fan, len(self.ok))  # type: ignore[misc]

    def update(
        self,
        told: Sequence[float],
        speed: Sequence[float],
        current: Sequence[float],
        voltage: float,
        dt: float,
        *,
        least: float,
        patience: float,
    ) -> list[int]:
        """Look at the fans; return those that have just been found lost.

        Args:
            told: thrust of each [N] (n,).
            speed: of each rotor [rad/s] (n,), NaN unknown.
            current: that each takes from the bus [A] (n,), NaN unknown.
            voltage: of the bus [V].
            dt: since the last look [s].
            least: thrust below which a fan is not judged [N].
            patience: how long a fan must fail [s].
        """
        share = 1.0 - math.exp(-dt / _LAG)
        missing = []
        for i in range(len(self.ok)):
            self._expected[i] += share * (told[i] - self._expected[i])
            thrust = min(told[i], self._expected[i])
            fails = thrust > least and self._fails(thrust, speed[i], current[i], voltage)
            self._missing_for[i] = self._missing_for[i] + dt if fails else 0.0
            if fails and self.ok[i]:
                missing.append(i)
        if len(missing) != 1 or self._missing_for[missing[0]] < patience:
            return []
        self.ok[missing[0]] = False
        return missing

    def _fails(self, thrust: float, speed: float, current: float, voltage: float) -> bool:
        wanted = math.sqrt(thrust / self._fan.thrust_coefficient)
        # Comparisons with what is not a number are false.
        slow = speed < _SLOW * wanted
        return slow and current * voltage < _WEAK * self._fan.jet_power(thrust)


def name_lost(names: Sequence[str], ok: Sequence[bool]) -> str:
    """Return the names of the fans that are lost."""
    return ", ".join(name for name, is_ok in zip(names, ok, strict=True) if not is_ok)
