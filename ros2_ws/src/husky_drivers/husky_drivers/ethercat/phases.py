"""The phases of the drives of a segment, one step a tick.

ENABLING has two stages: all drives switched on, then all enabled. In SETTLING the drives put the
robot down, without those that are lost.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from husky_drivers.cia402 import CONTROLWORD_TOWARD, CONTROLWORDS, DriveCommand, DriveState
from husky_drivers.ethercat.axes import AxisSettings
from husky_drivers.joint_master.phase import Phase, PhaseMachine

_RESET = CONTROLWORDS[DriveCommand.FAULT_RESET]
_ENABLED = DriveState.OPERATION_ENABLED

States = NDArray[np.uint8]
Mask = NDArray[np.bool_]


class DrivePhases(PhaseMachine):
    """The phase machine of the drives.

    Attributes:
        wanted: state that each drive shall reach (n,), values of `DriveState`.
    """

    def __init__(
        self,
        settings: AxisSettings,
        describe: Callable[[Mask], str],
        why_incomplete: Callable[[], str],
    ):
        """Start in OFF.

        Args:
            settings: number of axes and of ticks.
            describe: says which drives are in which state and error.
            why_incomplete: says what is missing on the bus.
        """
        super().__init__()
        self._settings = settings
        self._describe = describe
        self._why_incomplete = why_incomplete
        self._all_enabled = bytes([_ENABLED] * len(settings.joint_names))
        self._confirmed = 0  # ticks in a row in which all drives were as wanted
        self.wanted: States = np.full(
            len(settings.joint_names), DriveState.SWITCH_ON_DISABLED, np.uint8
        )

    @property
    def may_have_torque(self) -> bool:
        """Whether the phase lets drives have torque."""
        return self.phase not in (Phase.OFF, Phase.RESETTING)

    @property
    def switching_on(self) -> bool:
        """Whether it is the first stage of enabling, still without torque."""
        return self.phase is Phase.ENABLING and self.wanted[0] == DriveState.SWITCHED_ON

    def enter(self, phase: Phase, reason: str) -> None:
        """Go to a phase, or its first stage."""
        super().enter(phase, reason)
        self._confirmed = 0
        if phase is Phase.ENABLING:
            self.wanted[:] = DriveState.SWITCHED_ON
        elif phase in (Phase.ENABLED, Phase.SETTLING):
            self.wanted[:] = _ENABLED
        elif phase is Phase.QUICK_STOP:
            self.wanted[:] = DriveState.QUICK_STOP_ACTIVE
        else:
            self.wanted[:] = DriveState.SWITCH_ON_DISABLED

    def controlwords(self, states: States) -> NDArray[np.uint16]:
        """Controlwords of the next frame, for drives in these states."""
        words: NDArray[np.uint16] = CONTROLWORD_TOWARD[states, self.wanted]
        if self.phase is not Phase.RESETTING or self._ticks % 2 == 0:
            words[words == _RESET] = 0  # faults are reset on request, and by an edge
        return words

    def why_lost(self, states: States) -> str:
        """Return which drives have left "operation enabled" by themselves, "" if none has."""
        return "" if states.tobytes() == self._all_enabled else self._describe(states != _ENABLED)

    def advance(self, states: States, complete: bool, modes_confirmed: bool, settled: bool) -> None:
        """Move on by one tick.

        Args:
            states: of the drives, as last known (n,).
            complete: whether the last exchange was, so that they are of this tick.
            modes_confirmed: whether all drives have shown the mode that is asked for.
            settled: whether the robot is down, or has had the time for it.
        """
        self._ticks += 1
        if self.phase is Phase.SETTLING:
            lost = states != _ENABLED
            self.wanted[lost] = DriveState.SWITCH_ON_DISABLED  # a lost drive stays off
            if settled or lost.all():
                self.enter(Phase.QUICK_STOP, self.reason)
        elif self.phase is Phase.ENABLING:
            self._enable(states, modes_confirmed)
        elif self.phase is Phase.QUICK_STOP:
            over = self._ticks >= self._settings.quick_stop_timeout_ticks
            moving = (states >= _ENABLED) & (states < DriveState.FAULT)
            if over or (complete and not moving.any()):
                self.enter(Phase.OFF, self.reason)
        elif self.phase is Phase.RESETTING:
            self._reset(states, complete)

    def _enable(self, states: States, modes_confirmed: bool) -> None:
        """First all drives to switched on, each in the wanted mode; then all to enabled."""
        there = states == self.wanted
        failed = states >= DriveState.QUICK_STOP_ACTIVE
        if not self.switching_on:
            failed |= states < DriveState.SWITCHED_ON
        if failed.any():
            self.enter(Phase.QUICK_STOP, f"not enabled: {self._describe(failed)}")
            return
        self._confirmed = self._confirmed + 1 if there.all() else 0
        confirmed = self._confirmed >= self._settings.confirm_ticks
        if confirmed and not self.switching_on:
            self.enter(Phase.ENABLED, "")
        elif confirmed and modes_confirmed:
            self._ticks = self._confirmed = 0
            self.wanted[:] = _ENABLED
        elif self._ticks >= self._settings.transition_timeout_ticks:
            late = self._describe(~there) or "a drive does not show the mode that is asked for"
            self.enter(Phase.QUICK_STOP, f"not enabled: {late}")

    def _reset(self, states: States, complete: bool) -> None:
        faulty = (states == DriveState.FAULT) | (states == DriveState.FAULT_REACTION_ACTIVE)
        self._confirmed = self._confirmed + 1 if complete and not faulty.any() else 0
        if self._confirmed >= self._settings.confirm_ticks:
            self.enter(Phase.OFF, "not enabled yet")
        elif self._ticks >= self._settings.transition_timeout_ticks:
            why = self._describe(faulty) if complete else self._why_incomplete()
            self.enter(Phase.OFF, f"not reset: {why}")
