"""Mode `wair`: the walk takes place on the plane that is climbed, with the thrust that is given."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from husky_control.climbing import LEVEL, Climbing
from husky_control.estimator import GRAVITY
from husky_control.parameters import Parameters
from husky_control.walking import Walking
from husky_description.robot import Robot

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LIGHTEST = 0.4
"""Share of the weight on the feet, down to which contact thresholds shrink with it."""
REST_TIME = 0.5
"""Time at zero command after which the feet of a climbing robot stay down [s]."""


class InclineWalk:
    """Turns the frame of a walk to the incline and tells it what acts there.

    Attributes:
        climbing: plane and thrust.
        leaving: the robot is to stand, as soon as its feet are down.
    """

    def __init__(self, robot: Robot, parameters: Parameters, walking: Walking) -> None:
        """Level.

        Args:
            robot: its numbers.
            parameters: live.
            walking: the walk to be led.
        """
        self.parameters = parameters
        self.climbing = Climbing(robot, parameters)
        self.leaving = False
        self._walking = walking
        self._rest = 0.0

    @property
    def is_level(self) -> bool:
        """Whether the feet are down, on ground where the robot may stand as on the flat."""
        return bool(self._walking.stopped) and self.climbing.slope < LEVEL

    @property
    def only_down(self) -> bool:
        """Whether the robot may go down only: a fan is lost, and the ground is not level."""
        return 0.0 < self.climbing.limit < math.inf and self.climbing.slope > LEVEL

    @property
    def lightness(self) -> float:
        """Share of the weight on the feet by which contact thresholds shrink."""
        return min(1.0, max(LIGHTEST, self.climbing.lightness))

    def begin(self, foot_in_world: Array) -> None:
        """Start on level ground, all feet (4, 3) m down."""
        self.leaving = False
        self.climbing.begin(foot_in_world)

    def tick(
        self,
        foot_in_world: Array,
        velocity: Array,
        rotation: Array,
        standing: Mask,
        silence: float,
        limit: float,
        dt: float,
    ) -> None:
        """Measure the plane, ask for thrust, turn the walk's frame.

        Args:
            foot_in_world: (4, 3) m, estimated.
            velocity: (3,) m/s in world, estimated.
            rotation: (3, 3), base to world.
            standing: (4,) bool, feet that stand and feel the ground.
            silence: time since the last velocity command [s].
            limit: most thrust that the fans can make [N], 0 while they do not follow.
            dt: s.
        """
        climbing, walking = self.climbing, self._walking
        error = walking.reference.velocity - (climbing.plane @ velocity)[:2]
        climbing.tick(
            foot_in_world, standing, walking.clock.touchdown, rotation[:, 1], error, limit, dt
        )
        if climbing.turning:
            walking.turn(climbing.turn)
        walking.gravity[:] = climbing.gravity
        walking.thrust[:] = climbing.given_in_plane
        walking.pitch, walking.sink = climbing.pitch, climbing.sink
        walking.bend = climbing.bend()
        walking.load_slope = climbing.load_slope()
        walking.shift[:] = climbing.shift(walking.height)
        self._rest = 0.0 if walking.reference.command.any() else self._rest + dt
        rested = self._rest > REST_TIME and walking.reference.at_rest
        if walking.stepping and (rested or silence > self.parameters["command.timeout"]):
            walking.stop_stepping()

    def step_again(self, position: Array) -> None:
        """Set the feet in motion, if they stand still and the robot is to stay in the mode.

        Args:
            position: (3,) m of the body in world, estimated.
        """
        if not self.leaving and self._walking.stopped:
            self._rest = 0.0
            self._walking.start_stepping(
                self.parameters.gait("climb"), self.climbing.plane @ position
            )

    def leave(self) -> tuple[bool, str]:
        """Stop, to stand as on the flat; refused on an incline, with the reason."""
        slope = self.climbing.slope
        if slope > LEVEL:
            degrees = math.degrees(slope)
            return False, f"stand refused: the robot is on an incline of {degrees:.0f} deg"
        self.leaving = True
        self._walking.stop_stepping()
        return True, "stopping"

    def level(self) -> None:
        """Back from an incline: the ground's frame is the world's again."""
        walking = self._walking
        walking.turn(self.climbing.plane.T.copy())
        self.climbing.end()
        walking.gravity[:] = 0.0, 0.0, -GRAVITY
        walking.thrust.fill(0.0)
        walking.shift.fill(0.0)
        walking.load_slope = (0.0, 0.0)
        walking.bend = None
        walking.pitch = walking.sink = 0.0
