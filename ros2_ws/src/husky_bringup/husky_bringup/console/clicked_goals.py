"""Goals that operators click on the ground of the picture.

A click comes twice: from viser with its ray, and over the operator's own websocket with a beat, as
each of his words does. Only both together are a goal: a browser that is asleep or late, or that of
somebody else than who has asked for it, moves nothing.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from viser import SceneApi

from husky_bringup.console.frame_tree import Pose
from husky_bringup.console.operators import Ask, Operator
from husky_bringup.outcome import Outcome
from husky_description.arrays import Array
from husky_description.rotation import to_roll_pitch_yaw

NAVIGATION = "navigation"
"""Kind of these requests of an operator; its values are the following."""
GO_TO, CLICK, STOP_GOING = "go to", "click", "stop going"
_LATE = 2.0
"""How old a word may be, and how far apart the two of a click may come [s]."""
_PATIENCE = 30.0
"""For which a click is waited for [s]."""
_MOST_STOPS = 32
"""That wait for the node's thread."""


class ClickedGoals:
    """Sends the robot where the operator clicks who has pressed "go to", and stops it.

    Whatever button is pressed next, by anyone, ends the waiting for his click.

    Attributes:
        picker: operator whose click is waited for, None for nobody's.
    """

    def __init__(
        self,
        scene: SceneApi,
        go: Callable[[Array, Array], Pose],
        stop: Callable[[Outcome], None],
    ):
        """Wait for nobody's click.

        Args:
            scene: that is clicked on.
            go: sends the robot where a ray of the scene leads, given by origin and direction;
                returns the goal in `map`, raises ValueError where there is none or nobody takes it.
            stop: ends what the robot is sent to, and notes how that went.
        """
        self._scene, self._go, self._stop = scene, go, stop
        self.picker: Operator | None = None
        self._ray = np.zeros((2, 3))
        self._since = self._clicked = self._hit = -math.inf  # when each has come [s]
        self._stops: deque[Operator] = deque(maxlen=_MOST_STOPS)
        self._listens = False

    # The threads of servers -------------------------------------------------------------------
    def hear(self, operator: Operator, ask: Ask, age: float) -> None:
        """Take a button that an operator has pressed, of other things too; its age is in [s]."""
        was, value = self.picker, ask.value if ask.what == NAVIGATION else ""
        if value and age > _LATE:
            operator.outcome = Outcome.refusal(f"{value}: came too late, ask again")
            return
        if value == CLICK:
            if operator is was:
                self._clicked = time.monotonic()
            return
        self.picker = None
        if was is not None and was is not operator:
            was.outcome = Outcome.refusal(f"{GO_TO}: somebody has pressed {ask.value}")
        if not value:
            return
        operator.outcome = Outcome()
        if value == STOP_GOING:
            self._stops.append(operator)
        elif value != GO_TO:
            operator.outcome.refuse("", f"there is nothing called {NAVIGATION} {value}")
        elif was is not operator:  # or he has thought better of it
            operator.outcome.wait(f"{GO_TO}: click on the ground")
            self._since, self._clicked, self._hit = time.monotonic(), -math.inf, -math.inf
            self.picker = operator

    def _on_click(self, event: Any) -> None:
        """Take a ray, or whatever a client has sent for one."""
        try:
            ray = np.array((event.ray_origin, event.ray_direction), dtype=float)
        except (TypeError, ValueError):
            return
        if ray.shape == (2, 3) and np.isfinite(ray).all() and ray[1].any():
            self._ray, self._hit = ray, time.monotonic()

    # The node's thread ------------------------------------------------------------------------
    def turn(self) -> None:
        """Do what has been asked for."""
        if self._stops:
            outcome = Outcome()
            while self._stops:
                self._stops.popleft().outcome = outcome
            self._stop(outcome)
        picker = self.picker
        if self._listens != (picker is not None):
            self._listens = not self._listens
            if self._listens:
                self._scene.on_click()(self._on_click)
            else:
                self._scene.remove_click_callback(self._on_click)
        if picker is None:
            return
        if abs(self._hit - self._clicked) < _LATE:
            self.picker = None
            picker.outcome = self._outcome_of(*self._ray)
        elif time.monotonic() > self._since + _PATIENCE:
            self.picker = None
            picker.outcome = Outcome.refusal(f"{GO_TO}: no click within {_PATIENCE:.0f} s")

    def _outcome_of(self, origin: Array, direction: Array) -> Outcome:
        """Send the robot where a ray leads."""
        try:
            x, y, _, *turn = self._go(origin, direction)
        except ValueError as error:
            return Outcome.refusal(f"{GO_TO}: {error}")
        yaw = math.degrees(to_roll_pitch_yaw((turn[0], turn[1], turn[2], turn[3]))[2])
        outcome = Outcome()
        outcome.wait(f"going to {x:.2f}, {y:.2f} m in map, heading {yaw:.0f} deg")
        return outcome
