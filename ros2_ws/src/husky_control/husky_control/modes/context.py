"""What all modes share: the body's state, the walk, the fans, the last command."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from husky_control.estimation.sensed_body import SensedBody
from husky_control.flight.hover import Hover
from husky_control.flight.thrust_vectoring import ThrustVectoring
from husky_control.gait.ground import LEVEL_GROUND
from husky_control.gait.suspended import Suspended
from husky_control.gait.walking import Walking
from husky_control.incline.assist import ThrustAssist
from husky_control.incline.climbing import Climbing
from husky_control.modes.command_watch import CommandWatch
from husky_control.modes.morph_postures import MorphPostures
from husky_control.posture import PEAK, Postures
from husky_control.safety import Safety
from husky_control.tick_data import Counters, JointCommand
from husky_description.arrays import Array
from husky_description.kinematics import Kinematics

if TYPE_CHECKING:
    from husky_control.parameters import Parameters
    from husky_description.robot import Robot


class ModeContext:
    """The parts of one controller.

    Attributes:
        robot: its numbers.
        parameters: live.
        counters: of what has happened.
        command: of the last tick; its arrays are reused.
        reason: of the present mode, or what has changed the robot's mind within it, in words.
        request: name of the mode that an operator has been granted last.
        gait: name of the gait that is walked or will be.
        watch: the velocity command over time.
        body: the body, measured and estimated.
        safety: judge of measurements and commands.
        walking: legs of a robot that stands or walks.
        suspended: legs of a robot that hangs.
        postures: named ones.
        assist: help by the fans on the flat.
        climbing: plane and thrust on an incline.
        hover: flight on the fans.
        morph: postures between legs and arms; None where the legs carry no propellers.
        vectoring: propellers that the arms tilt; None likewise.
    """

    def __init__(self, robot: Robot, parameters: Parameters) -> None:
        """Everything at rest."""
        self.robot = robot
        self.parameters = parameters
        self.counters = Counters()
        self.command = JointCommand()
        self.reason = "started"
        self.request = ""
        self.gait = "trot"
        self.watch = CommandWatch()
        self.body = SensedBody(robot, parameters)
        self.safety = Safety(robot, parameters)
        self.walking = Walking(robot, parameters, parameters.gait(self.gait))
        self.suspended = Suspended(robot, parameters.gait(self.gait))
        self.postures = Postures(robot)
        self.assist = ThrustAssist(robot, parameters)
        self.climbing = Climbing(robot, parameters)
        self.hover = Hover(robot)
        arms = robot.legs_carry_propellers
        self.morph = MorphPostures(robot) if arms else None
        self.vectoring = ThrustVectoring(robot) if arms else None
        self._kinematics = Kinematics(robot)

    @property
    def desired_position(self) -> Array:
        """Reference body position in world, (3,) m."""
        return self.walking.body_position @ self.climbing.plane

    @property
    def desired_velocity(self) -> Array:
        """Reference body velocity in world, (3,) m/s."""
        return self.walking.body_velocity @ self.climbing.plane

    @property
    def thrust_in_base(self) -> Array:
        """Force asked of the fans outside of flight, (3,) N in base."""
        force: Array = self.body.rotation.T @ self.climbing.thrust
        force[2] += self.assist.force
        return force

    def come_to_level(self) -> None:
        """Turn the frame of the walk back to the world: the robot comes from an incline."""
        self.walking.stand_on(LEVEL_GROUND)
        self.climbing.end()
        self.body.set_lightness(1.0)
        self.body.stand_on_level()

    def stand_posture(self) -> Array:
        """Return the joint positions (12,) [rad] to stand in."""
        p = self.parameters
        return self.postures.stand(p["stand.lateral_spread"], p["stand.height_offset"])

    def gathering_time(self, start: Array, end: Array) -> float:
        """Return the time between two postures (12,) [rad] at the gathering speed [s]."""
        furthest = float(np.abs(np.asarray(end) - np.asarray(start)).max())
        return max(0.2, PEAK * furthest / self.parameters["stand.joint_speed"])

    def stand_on(self, joint_position: Array) -> None:
        """Let the legs stand as they were commanded to, at joint positions (12,) [rad]."""
        self.walking.begin(
            self.body.rotation,
            self.body.estimator.position,
            self._kinematics.foot_positions(joint_position),
            self.parameters.gait(self.gait),
        )
