"""Which leg bears how much: torque feed-forward of the weight, and moments against tilt."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from husky_control.gait.ground import Ground
from husky_control.gait.stance import Load, distribute_weight, lean_forces
from husky_control.gait.state import BodyInGround
from husky_control.gait.table import GaitClock
from husky_description.arrays import Array
from husky_description.compiled import Compiled
from husky_description.kinematics import LEGS, LegTargets, center_of_mass, leg_masses

if TYPE_CHECKING:
    from husky_control.parameters import Parameters
    from husky_description.robot import Robot


MOST_SHARE = 0.7  # of the weight that one foot carries, also when it lands before its partner


class Bearing:
    """How the legs of a walk share the weight.

    Attributes:
        share: (4,) 0 for a foot in the air to 1 for a foot fully loaded.
        center: (3,) m, centre of mass in base.
    """

    def __init__(self, robot: Robot, parameters: Parameters, legs: LegTargets) -> None:
        """All legs bear alike; foot forces are written to the targets of `legs`."""
        self.share = np.ones(LEGS)
        self.center = np.zeros(3)
        self._masses = leg_masses(robot)
        self._parameters = parameters
        self._legs = legs
        self._find_center = Compiled(center_of_mass)
        self._distribute = Compiled(distribute_weight)

    def shift(self, clock: GaitClock, *, moving: bool, dt: float) -> None:
        """Load legs that have come down, and unload the one that a static gait lifts next."""
        p, static = self._parameters, clock.gait.static_margin > 0.0
        load_time = p["walk.static_load_time" if static else "walk.load_time"]
        rate = dt / max(load_time, dt)
        lifting, wait = clock.next_to_lift() if static and moving else (-1, 0.0)
        for leg in range(LEGS):
            if clock.swinging[leg]:
                self.share[leg] = 0.0
            elif leg == lifting and wait < load_time:
                self.share[leg] = max(0.0, self.share[leg] - rate)
            else:
                self.share[leg] = min(1.0, self.share[leg] + rate)

    def carry(
        self, body: BodyInGround, foot_in_base: Array, ground: Ground, weight: float, height: float
    ) -> None:
        """Set the foot forces that carry the body.

        Args:
            body: measured.
            foot_in_base: (4, 3) m, measured.
            ground: that is walked on.
            weight: into the ground [N].
            height: of the body over the feet's plane [m].
        """
        p, legs, rotation = self._parameters, self._legs, body.rotation
        self._find_center.call(
            legs.geometry, self._masses, legs.joints.position, legs.placed.foot, self.center
        )
        stiffness, damping = p["walk.attitude_stiffness"], p["walk.attitude_damping"]
        moment_x = moment_y = 0.0
        if stiffness or damping:
            w = rotation @ body.angular_velocity
            # Tilt as a rotation vector in world: z_base x z_world.
            moment_x = stiffness * rotation[1, 2] - damping * w[0]
            moment_y = -stiffness * rotation[0, 2] - damping * w[1]
        slope_x, slope_y = ground.load_slope
        leaning = bool(slope_x or slope_y)
        if leaning:
            # Tangential forces act below the centre of mass and turn the body as well.
            moment_x -= height * slope_y * weight
            moment_y += height * slope_x * weight
        load = Load(weight, float(moment_x), float(moment_y), MOST_SHARE * weight)
        force = legs.feet.force
        self._distribute.call(foot_in_base, self.center, self.share, rotation, load, force)
        if leaning:
            lean_forces(rotation, slope_x, slope_y, force)
