"""A robot kept at its task while one live parameter after the other goes to an end of its range.

It goes on from test to test, so that an end costs a second or two of simulated time; one that has
failed is replaced.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from in_process import InProcessRobot

from husky_control.parameters import TABLE
from husky_control.rotation import matrix_from_quaternion
from husky_runtime import graph

LONGER = float(os.environ.get("HUSKY_SWEEP", "1"))
"""Each part of the sweep takes so many times as long; above 1 it takes each end both ways."""
SPEED = {"crawl": 0.05, "trot": 0.3, "climb": 0.25, "bound": 0.2, "pronk": 0.1}
"""Commanded in each gait, as far as its `max_speed` allows [m/s]."""
SIDEWAYS = {"crawl": 0.0, "trot": 0.1, "bound": 0.0, "pronk": 0.0}
TURN = {"crawl": 0.1, "trot": 0.4, "bound": 0.1, "pronk": 0.1}
"""Besides, where they allow for it [m/s], [rad/s]."""
LEAST = {"crawl": 0.5, "trot": 0.3, "bound": 0.2, "pronk": 0.4, "climb": 0.35}
"""Share of the way ahead that they make at least, in a cycle or some [-]."""
STOPPING = 8.0
"""With a gait that steps on the spot until it is slow enough: 0.2 to 3.6 s were seen [s]."""
LOOK = 10
"""Ticks between two looks at the robot."""


def ends(*prefixes: str, but: tuple[str, ...] = ()) -> list[tuple[str, str]]:
    """Return (name, end) of live parameters by how names begin and do not; lower before upper.

    Without the ends that are defaults: with those all others are swept.
    """
    rows = [n for n in TABLE if n.startswith(prefixes) and not n.startswith(but)]
    both = [(name, end) for name in rows for end in ("lower", "upper")]
    return [(name, end) for name, end in both if getattr(TABLE[name], end) != TABLE[name].default]


def cases(*prefixes: str, but: tuple[str, ...] = (), one_by_default: bool = False) -> list[Any]:
    """Return the `ends` as pytest's parameters: all are slow, or all but the first one."""
    return [
        pytest.param(*row, marks=[pytest.mark.slow] * (number > 0 or not one_by_default))
        for number, row in enumerate(ends(*prefixes, but=but))
    ]


def at_end(name: str, end: str) -> dict[str, float]:
    """Return the value of a parameter at an end of its range."""
    return {name: getattr(TABLE[name], end)}


class SweptRobot:
    """One robot; it stands or walks between tests.

    Attributes:
        robot: in one process.
    """

    def __init__(
        self,
        make: Callable[[], InProcessRobot],
        *,
        base: Mapping[str, float] | None = None,
        up: tuple[float, float, float] = (0.0, 0.0, 1.0),
        falling: float = 0.45,
    ) -> None:
        """Nothing is made before the first test asks.

        Args:
            make: makes a robot that stands.
            base: what its task needs besides the defaults, by parameter.
            up: where its body points in world.
            falling: angle from there that none of its tasks comes near [rad].
        """
        self._make, self._base = make, dict(base or {})
        self._up, self._falling = np.array(up), falling
        self._made: InProcessRobot | None = None
        self._rotation = np.eye(3)

    @property
    def robot(self) -> InProcessRobot:
        """The robot; a new one after a failure."""
        if self._made is None:
            self._made = self._make()
            self._made.controller.parameters.set_all(self._base)
        return self._made

    def drop(self) -> None:
        """It has had its day."""
        self._made = None

    @property
    def mode(self) -> str:
        """Present mode."""
        return self.robot.controller.mode.value

    @contextmanager
    def healthy(self) -> Iterator[None]:
        """Set everything back afterwards; drop a robot that has failed."""
        try:
            yield
        except BaseException:
            self.drop()
            raise
        if self._made is not None:
            self.set({**{name: row.default for name, row in TABLE.items()}, **self._base})

    def set(self, values: Mapping[str, float]) -> None:
        """Set live parameters."""
        self.robot.controller.parameters.set_all(values)

    def ask(self, mode: str) -> None:
        """Ask for a mode that must be accepted."""
        accepted, message = self.robot.controller.request_mode(mode)
        assert accepted, message

    def go(
        self,
        duration: float,
        velocity: tuple[float, float, float] | None,
        *modes: str,
        until: Callable[[], bool] | None = None,
    ) -> float:
        """Go on for a time [s], or until something holds, in one of some modes.

        Returns:
            Way ahead over the way that the ramped command asked for.
        """
        robot, way, asked = self.robot, 0.0, 0.0
        controller = robot.controller
        for index in range(round(duration / LOOK / graph.TICK_PERIOD)):
            if until is not None and until():
                break
            if velocity is not None and index % 2 == 0:
                accepted, message = controller.set_velocity_command(*velocity)
                assert accepted, message
            before = robot.world.base_position.copy()
            for _ in range(LOOK):
                robot.tick()
            asked += float(controller.walking.reference.ramped[0]) * LOOK * graph.TICK_PERIOD
            assert self.mode in modes, f"{self.mode}: {controller.reason}"
            assert not robot.refusal, robot.refusal
            matrix_from_quaternion(robot.world.base_orientation, self._rotation)
            way += float((robot.world.base_position - before) @ self._rotation[:, 0])
            tilt = math.acos(min(1.0, float(self._up @ self._rotation[:, 2])))
            assert tilt < self._falling, f"{self.mode}: the body is off by {tilt:.2f} rad"
        else:
            assert until is None, f"{self.mode}: nothing new after {duration:g} s"
        return way / asked if abs(asked) > 0.01 else 1.0

    def velocity(self, gait: str) -> tuple[float, float, float]:
        """Return the velocity (m/s, m/s, rad/s) ahead that a gait is swept with."""
        most = self.robot.controller.parameters[f"gait.{gait}.max_speed"]
        return min(SPEED[gait], most), 0.0, 0.0

    # On the flat ------------------------------------------------------------------------------
    def be_standing(self) -> None:
        """Stand, if it does not."""
        if self.mode == "sit":
            self.ask("stand_up")
            self.go(40.0, None, "stand_up", "stand", until=lambda: self.mode == "stand")
        if self.mode == "walk":
            self.ask("stand")
            p = self.robot.controller.parameters
            slow_down = max(0.3 / p["command.acceleration"], 0.4 / p["command.yaw_acceleration"])
            most = STOPPING + slow_down + 3.0 * self.cycle(self.robot.controller.context.gait)
            self.go(most, None, "walk", "stand", until=lambda: self.mode == "stand")

    def be_sitting(self) -> None:
        """Sit, if it does not."""
        if self.mode == "sit":
            return
        self.be_standing()
        self.go(0.3, None, "stand")
        self.ask("sit")
        self.go(40.0, None, "sit", until=lambda: self.robot.controller.present.settled)

    def be_walking(self, gait: str) -> None:
        """Walk in a gait, if it does not."""
        if self.robot.controller.context.gait != gait:
            self.be_standing()
        if self.mode == "stand":
            self.robot.controller.request_gait(gait)
            self.ask("walk")
            self.go(0.4, self.velocity(gait), "walk")

    def walk(self, gait: str, duration: float) -> None:
        """Walk ahead, then turn and go sideways."""
        p = self.robot.controller.parameters
        ahead = self.velocity(gait)
        self.go(0.2 * duration, ahead, "walk")
        done = self.go(0.5 * duration, ahead, "walk")
        if gait == "trot" or 0.5 * duration > 4.0 * self.cycle(gait):
            assert done > LEAST[gait], f"{done:.2f} of the way that was asked for"
        columns = (f"gait.{gait}.max_speed", f"gait.{gait}.max_lateral_speed")
        most = min(p[name] for name in ("command.max_lateral_speed", *columns))
        sideways = min(SIDEWAYS[gait], most)
        turn = min(TURN[gait], p["command.max_yaw_rate"], p[f"gait.{gait}.max_yaw_rate"])
        self.go(0.3 * duration, (0.5 * ahead[0], sideways, turn), "walk")

    # On a slope -------------------------------------------------------------------------------
    def be_stepping(self) -> None:
        """Climb."""
        self.go(0.2, self.velocity("climb"), "wair")

    def climb(self, duration: float, sign: float) -> None:
        """Go up (1) or down (-1)."""
        speed = sign * self.velocity("climb")[0]
        self.go(0.3 * duration, (speed, 0.0, 0.0), "wair")
        done = self.go(0.7 * duration, (speed, 0.0, 0.0), "wair")
        assert done > LEAST["climb"], f"{done:.2f} of the way that was asked for"

    def be_still(self) -> None:
        """Stand on the slope: all feet down for a cycle."""
        looks, enough = [], math.ceil(self.cycle("climb") / LOOK / graph.TICK_PERIOD)

        def still() -> bool:
            looks.append(bool(not self.robot.controller.present.clock.swinging.any()))
            return len(looks) > enough and all(looks[-enough:])

        self.go(STOPPING, (0.0, 0.0, 0.0), "wair", until=still)

    def cycle(self, gait: str) -> float:
        """Period of a gait [s]."""
        return self.robot.controller.parameters[f"gait.{gait}.period"]
