"""The phases of the servos of a line, one step a tick.

ENABLING writes goals, torque and watchdog, and sees each servo with torque. In DAMPING a servo is
lost, an emergency stop has come, or the controller is silent. That lasts while the controller asks
for positions (it lands, or brings a body on legs down), `landing_ticks` at most: the other servos
follow meanwhile, after an emergency stop for `settle_ticks` only. What nobody commands any more may
be in the air: it holds still as long, whoever sends commands again. In the end the servos give way
for `yield_ticks`. RESETTING restarts servos and sets them up again.
"""

from __future__ import annotations

import numpy as np

from husky_drivers.dynamixel.readings import ServoReadings
from husky_drivers.dynamixel.settings import ServoSettings
from husky_drivers.dynamixel.troubles import ServoTroubles
from husky_drivers.joint_master.phase import Phase, PhaseMachine


class ServoPhases(PhaseMachine):
    """The phase machine of the servos.

    Attributes:
        cycles: packets written to all servos in this phase; counted by who writes.
        abandoned: DAMPING because of a controller that has fallen silent.
    """

    def __init__(self, settings: ServoSettings, readings: ServoReadings, troubles: ServoTroubles):
        """Start in OFF."""
        super().__init__()
        self._settings, self._readings, self._troubles = settings, readings, troubles
        self._health_before = np.zeros(len(settings.joint_names), np.int64)
        self.cycles = 0
        self.abandoned = False

    def enter(self, phase: Phase, reason: str) -> None:
        """Go to a phase; what a servo told before enabling does not count for it."""
        self.abandoned = self.abandoned and phase is Phase.DAMPING
        super().enter(phase, reason)
        self.cycles = 0
        if phase is Phase.ENABLING:
            self._health_before[:] = self._readings.health_count

    def abandon(self, reason: str) -> None:
        """Hold still: the controller that asked for positions is silent."""
        if not self.abandoned:
            self.enter(Phase.DAMPING, reason)
            self.abandoned = True

    def follows(self, *, stopped: bool) -> bool:
        """Return whether the servos follow the controller, as far as they are well."""
        if self.phase is not Phase.DAMPING:
            return self.phase is Phase.ENABLED
        most = self._settings.settle_ticks if stopped else self._settings.landing_ticks
        return not self.abandoned and self._ticks < most

    @property
    def yields(self) -> bool:
        """Whether the servos give way, damped, because they have held for long enough."""
        return self.phase is Phase.DAMPING and self._ticks >= self._settings.landing_ticks

    def advance(self, *, stopped: bool, positions: bool) -> None:
        """Move on by one tick, by what is known of the servos.

        Args:
            stopped: there was an emergency stop.
            positions: are what the controller asks for.
        """
        self._ticks += 1
        settings = self._settings
        if self.phase is Phase.ENABLED and (why := self._why_not_well()):
            self.enter(Phase.DAMPING, why)
        elif self.phase is Phase.DAMPING:
            if not (stopped or self.abandoned):
                self.reason = self._why_not_well() or self.reason  # the health may say more by now
            if self._ticks >= settings.longest_hold(stopped, positions or self.abandoned):
                self.enter(Phase.QUICK_STOP, self.reason)
        elif self.phase is Phase.QUICK_STOP and self._ticks >= settings.stop_ticks:
            self.enter(Phase.OFF, self.reason)
        elif self.phase is Phase.ENABLING:
            self._enable()
        elif self.phase is Phase.RESETTING:
            why = self._troubles.describe(sorted(self._troubles.unusable))
            if not why:
                self.enter(Phase.OFF, "not enabled yet")
            elif self._ticks >= settings.confirm_ticks:
                self.enter(Phase.OFF, f"not reset: {why}")

    def _enable(self) -> None:
        """All servos are enabled when each has been seen twice, with torque."""
        fresh = self._readings.health_count >= self._health_before + 2
        if (fresh & self._readings.torque_on).all() and not self._why_not_well():
            self.enter(Phase.ENABLED, "")
        elif self._troubles.unusable or self._ticks >= self._settings.confirm_ticks:
            why = self._why_not_well() or "a servo does not take torque"
            self.enter(Phase.QUICK_STOP, f"not enabled: {why}")

    def _why_not_well(self) -> str:
        return self._troubles.why_not_well(enabled=self.phase is Phase.ENABLED)
