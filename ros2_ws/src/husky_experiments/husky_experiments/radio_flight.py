"""A flight by radio: look at the unit, move the sticks of `Pilot`, let time pass.

The operator stands for a person beside the gantry who sees the unit. So what is seen is the ground
truth: place, velocity and heading of the unit, and whether a rope is taut.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from husky_description.gantry import GantryOptions
from husky_description.gravity import GRAVITY
from husky_description.robot import Robot
from husky_experiments.pilot import Pilot, Sight, Wish

LOOK = 0.07
"""Time between two looks of the operator, each with a movement of the sticks [s]."""


class Flown(Protocol):
    """What the operator needs of a session."""

    time: float
    truth: Any
    fans: Any

    def joystick(self, axes: list[float], buttons: list[int]) -> None:
        """Move the sticks."""

    def advance(self, duration: float) -> bool:
        """Let time pass."""


def hanging_height(gantry: GantryOptions) -> float:
    """Return the height of the base above the ground when it hangs in the ropes [m]."""
    y, z = gantry.attachment
    return gantry.height - math.sqrt(gantry.rope**2 - (gantry.span / 2 - y) ** 2) - z


def weight_share(robot: Robot) -> float:
    """Return the share of full thrust that carries the unit."""
    return robot.payload_mass * GRAVITY / (len(robot.rotor_names) * robot.fans.max_thrust)


class Flight:
    """An operator and what is flown.

    Attributes:
        passages: name, start and end [s] of what has been flown.
    """

    def __init__(self, session: Flown, pilot: Pilot):
        """Begin."""
        self.passages: dict[str, tuple[float, float]] = {}
        self._session = session
        self.pilot = pilot

    def see(self) -> Sight:
        """Return place, velocity and heading of the unit in truth, as a person sees them."""
        odometry = self._session.truth
        if odometry is None:
            return Sight(self.pilot.place, np.zeros(3), 0.0)
        p, q = odometry.pose.pose.position, odometry.pose.pose.orientation
        v = odometry.twist.twist.linear
        turn = Rotation.from_quat((q.x, q.y, q.z, q.w))
        yaw = turn.as_euler("ZYX")[0]
        return Sight(np.array((p.x, p.y, p.z)), turn.apply((v.x, v.y, v.z)), float(yaw))

    def fly(
        self,
        duration: float,
        wish: Wish | Callable[[float], Wish] | None = None,
        *,
        name: str = "",
        until: Callable[[], bool] | None = None,
    ) -> None:
        """Fly for a while [s], or until something is seen.

        Args:
            duration: at most so long [s].
            wish: what is wanted, or a function of the time since now [s]; by default to hover.
            name: of the passage.
            until: ends it.
        """
        start = self._session.time
        while (past := self._session.time - start) < duration - 1e-6:
            now = wish(past) if callable(wish) else wish or Wish()
            self.pilot.move(self.see(), now, LOOK)
            self._session.joystick(*self.pilot.joy())
            self._session.advance(LOOK)
            if until is not None and until():
                break
        if name:
            self.passages[name] = (start, self._session.time)

    def rope_taut(self) -> bool:
        """Return whether a rope is taut in truth, as a person sees it."""
        return self._session.fans is not None and any(self._session.fans.rope_taut)
