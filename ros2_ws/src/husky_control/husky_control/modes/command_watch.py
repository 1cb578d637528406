"""The velocity command over time: when it is silent, and when it may wake a standing robot."""

from __future__ import annotations


class CommandWatch:
    """Counts the silence of the velocity command, whatever the robot does meanwhile.

    A command wakes a standing robot only where it was at rest, zero or silent, before: who holds a
    stick while the robot gets up, or while somebody else stops it, does not set it off.

    Attributes:
        wakes: whether a command may wake a standing robot at all.
        silent_ticks: since the last command.
        silent: for longer than a command may be; nobody has commanded anything at first.
        leads: a command has set the robot in motion, nobody has asked for the mode: zero ends it.
    """

    def __init__(self) -> None:
        """Nothing has been heard, nothing may wake."""
        self.wakes = False
        self.silent_ticks = 0
        self.silent = True
        self.leads = False
        self._rested = True

    def hear(self, moving: bool, stands: bool) -> bool:
        """Take note of a command; return whether it may wake the robot.

        Args:
            moving: it is not zero.
            stands: the robot is in a mode from which a command may wake it.
        """
        self.begin()
        wakes = moving and self.wakes and self._rested
        self._rested = not moving or (self._rested and stands)
        return wakes

    def count(self, patience: int) -> None:
        """Count a tick; the command is silent after more than so many."""
        self.silent_ticks += 1
        self.silent = self.silent or self.silent_ticks > patience
        self._rested = self._rested or self.silent

    def begin(self) -> None:
        """Somebody sets the robot in motion: silence counts from now."""
        self.silent_ticks = 0
        self.silent = False

    def hold(self) -> None:
        """Somebody tells the robot to stand: what is commanded at the moment does not wake it."""
        self._rested = self.silent
