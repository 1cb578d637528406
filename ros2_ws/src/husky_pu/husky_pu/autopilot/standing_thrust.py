"""Thrust that was asked for before the unit was armed: it does not count until it is asked anew.

Arming lets the fans turn; it asks for no thrust. The checks before it refuse a thrust that stands
already, but arming by force passes over them.
"""

from __future__ import annotations

from husky_pu.autopilot.failsafes import FlightMode
from husky_pu.autopilot.flight_parameters import FlightParameters
from husky_pu.autopilot.rc import StickInput
from husky_pu.autopilot.setpoints import SetpointStream


class StandingThrust:
    """Knows whose thrust, the companion's or the sticks', has to be asked for anew."""

    def __init__(self, parameters: FlightParameters, stream: SetpointStream, input_: StickInput):
        """Nobody's."""
        self._p, self._stream, self._input = parameters, stream, input_
        self._held: frozenset[FlightMode] = frozenset()

    def arm(self, now: float) -> None:
        """The unit is armed at this time [s]: what is asked for now does not count."""
        self._held = self._asking(now)

    def look(self, now: float, thrust: float) -> None:
        """Let count what is low by now; in flight everything, for others may take over there.

        Args:
            now: time [s].
            thrust: of the unit, 0 to 1; somebody has asked for it since it was armed.
        """
        if thrust > self._p["HKY_INT_THR"]:
            self._held = frozenset()
        elif self._held:
            self._held &= self._asking(now)

    def holds(self, mode: FlightMode) -> bool:
        """Whether a mode's thrust does not count yet."""
        return mode in self._held

    def _asking(self, now: float) -> frozenset[FlightMode]:
        """Return the modes in which more thrust is asked for than arming allows."""
        sticks_alive = self._input.seen and not self._input.silent(now)
        asked = {
            FlightMode.OFFBOARD: self._stream.thrust,
            FlightMode.STABILIZED: self._input.sticks.throttle if sticks_alive else 0.0,
        }
        low = self._p["HKY_ARM_THR"]
        return frozenset(mode for mode, share in asked.items() if share > low)
