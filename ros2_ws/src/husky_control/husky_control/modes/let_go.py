"""Modes `passive`, `damping` and `emergency_stop`: the drives follow no positions."""

from __future__ import annotations

from typing import ClassVar

from husky_control.modes.behaviour import Behaviour, Event
from husky_control.tick_data import CYCLIC_TORQUE, CYCLIC_VELOCITY, JointCommand


class Passive(Behaviour):
    """Joints get zero torque."""

    active = velocity_counts = False
    operation: ClassVar[int] = CYCLIC_TORQUE

    def estimate(self) -> None:
        """Stay where the body was: nothing says that the feet stand."""
        self.context.body.estimate_at_rest()

    def tick(self, command: JointCommand) -> None:
        """Follow the joints with the positions, so that the next mode starts without a jump."""
        command.position[:] = self.context.body.measurements.joint_position
        command.velocity.fill(0.0)
        command.effort.fill(0.0)
        command.mode_of_operation = self.operation


class Damping(Passive):
    """Joints are held at zero velocity; help by the fans has to be asked for anew."""

    operation = CYCLIC_VELOCITY

    def enter(self, event: Event) -> None:
        """Give no more help."""
        self.context.assist.withhold()


class EmergencyStop(Passive):
    """Joints get zero torque, and the fans end at once."""

    def enter(self, event: Event) -> None:
        """Give no more help, and end what is left of a flight."""
        self.context.assist.withhold()
        self.context.hover.end(at_once=True)
