"""Mode `fly`: hovers on the fans, legs in the standing posture; also take-off and landing."""

from __future__ import annotations

import math

import numpy as np

from husky_control.flight.hover import AIRBORNE
from husky_control.modes.behaviour import Behaviour, Event, Happening
from husky_control.modes.context import ModeContext
from husky_control.rotation import yaw_of
from husky_control.tick_data import CYCLIC_POSITION, TICK, JointCommand
from husky_description.arrays import Array
from husky_description.kinematics import JOINTS


class Fly(Behaviour):
    """One flight; the legs keep their posture and carry what the fans do not."""

    answers = frozenset({"stand"})

    def __init__(self, name: str, context: ModeContext) -> None:
        """On the ground."""
        super().__init__(name, context)
        self._posture = np.zeros(JOINTS)
        self._start = np.zeros(3)  # m, estimated position of the body before take-off

    def enter(self, event: Event) -> None:
        """Take off from standing; the fans go on with what they help already."""
        c, body = self.context, self.context.body
        m, yaw = body.measurements, yaw_of(body.rotation)
        self._posture[:] = c.command.position
        self._start[:] = body.estimator.position
        fans_yaw = m.fans_yaw if math.isfinite(m.fans_yaw) else yaw
        c.hover.begin(m.pose, yaw, fans_yaw, c.assist.force)
        c.assist.reset()

    def leave(self, event: Event) -> str:
        """Stand on the posture of the flight, if it is over; else let the thrust fade."""
        c = self.context
        if event is Event.DONE:
            c.hover.finish()
            c.stand_on(self._posture)
        else:
            c.hover.end()
        return ""

    def estimate(self) -> None:
        """Know in the air where the flight has brought the body: the feet tell nothing."""
        body, hover = self.context.body, self.context.hover
        if hover.phase not in AIRBORNE:
            super().estimate()
            return
        yaw, start = yaw_of(body.rotation), self._start
        c, s = math.cos(yaw), math.sin(yaw)
        x, y, z = hover.way.tolist()
        vx, vy, vz = hover.velocity.tolist()
        body.place(
            (start[0] + c * x - s * y, start[1] + s * x + c * y, start[2] + z),
            (c * vx - s * vy, s * vx + c * vy, vz),
        )

    def prepare(self) -> Happening | None:
        """Give up without the fans."""
        super().prepare()
        return None if self.fans_available else (Event.FAULT, "the fans are lost in flight")

    def tick(self, command: JointCommand) -> Happening | None:
        """Fly, or spool up and down."""
        c, body, hover = self.context, self.context.body, self.context.hover
        m, note = body.measurements, hover.note
        hover.tick(
            m.time,
            m.pose,
            body.rotation,
            m.specific_force_base,
            self._feet_down(),
            yaw_of(body.rotation),
            TICK,
        )
        if hover.note != note:
            c.reason = hover.note
        command.mode_of_operation = CYCLIC_POSITION
        command.position[:] = self._posture
        command.velocity.fill(0.0)
        self._carry(command.effort)
        return (Event.DONE, hover.failed or "landed") if hover.done else None

    def _feet_down(self) -> int:
        """Return how many feet touch the ground."""
        return int(self.context.body.contacts.contact.sum())

    def _carry(self, joint_torque: Array) -> None:
        """Write the torques (12,) [N m] by which the legs carry what the fans do not."""
        body, hover = self.context.body, self.context.hover
        weight = max(0.0, hover.weight - hover.lift * float(body.rotation[2, 2]))
        body.carry(weight, joint_torque)

    def answer(self, request: str) -> tuple[bool, str] | None:
        """Land, when asked for the mode that follows."""
        if request not in self.answers:
            return None
        self.context.hover.land()
        return True, "landing"

    @property
    def grounded(self) -> bool:
        """True if the legs may carry the body: the flight has not begun, or is over."""
        return self.context.hover.phase not in AIRBORNE

    @property
    def landed(self) -> bool:
        """Whether the legs carry the weight again."""
        return self.context.hover.done
