"""The phases that all joints go through together.

    OFF -> ENABLING -> ENABLED
    ENABLED -> SETTLING (a stop of drives: they put the robot down) -> QUICK_STOP -> OFF
    ENABLED -> DAMPING (a stop of servos: they follow, hold or give way) -> QUICK_STOP -> OFF
    ENABLING -> QUICK_STOP
    any -> OFF (cut: torque goes at once)
    OFF -> RESETTING -> OFF

What leads from one to the next by itself is the wire's to say: `ethercat.phases`,
`dynamixel.phases`. Nothing there blocks or reads a clock: a phase counts the ticks that it waits.
"""

from __future__ import annotations

from enum import Enum


class Phase(Enum):
    """What a master does with its joints."""

    OFF = "off"
    RESETTING = "resetting faults"
    ENABLING = "enabling"
    ENABLED = "enabled"
    SETTLING = "settling"
    DAMPING = "damping"
    QUICK_STOP = "quick stop"


class PhaseMachine:
    """The present phase.

    Attributes:
        phase: where it is.
        reason: why the joints are not enabled, "" when they are.
    """

    def __init__(self) -> None:
        """Start in OFF."""
        self.phase, self.reason = Phase.OFF, "not enabled yet"
        self._ticks = 0  # in this phase

    def enter(self, phase: Phase, reason: str) -> None:
        """Go to a phase; `reason` as in the attribute."""
        self.phase, self.reason = phase, reason
        self._ticks = 0
