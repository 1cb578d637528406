"""Climbing with the fans' help (mode `wair`): the plane that is walked on, and the thrust for it.

The order of things when the ground rises: the feet feel it, the fans spool up for it, and only then
the body leans. So there are two planes: the measured one,
for which thrust is asked, and the one that is walked on, which follows as far as the thrust that
is given carries it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from husky_control.gait.ground import LEVEL_GROUND, Ground
from husky_control.incline.assist import FAN_LAG
from husky_control.incline.plan_reference import PlanReference, reference_of
from husky_control.incline.statics import (
    Incline,
    axial_thrust,
    gravity_in_plane,
    load_direction,
    load_slope,
    plane_from_world,
    thrust_for_load,
    turn_towards,
)
from husky_control.parameters import Parameters
from husky_control.planning.plan import Plan
from husky_control.slew import slewed
from husky_description.arrays import Array
from husky_description.gimbal import Gimbal
from husky_description.gravity import GRAVITY
from husky_description.kinematics import Kinematics
from husky_description.robot import Robot

Mask = NDArray[np.bool_]

UP = np.array([0.0, 0.0, 1.0])
GATE = 3.0
"""The body leans while the thrust given is no more than this below what the lean needs [N]."""
LEAN_FROM, LEAN_WHOLE = math.radians(6.0), math.radians(15.0)
"""Slopes at which a body with fixed fans begins to lean ahead, and leans as far as it shall."""
LEANING = 0.05
"""Shift of the feet by which the legs' part in the centre of mass is found [m]."""
REST_THRUST = 1e-3
"""Thrust that counts as none [N]."""
LEVEL = math.radians(8.0)
"""Slope up to which the robot may stand as on the flat [rad]."""


class Climbing:
    """Plane, thrust and shift of the feet for one robot.

    Attributes:
        incline: the measured plane.
        plane: (3, 3) rotation, world to the plane that is walked on.
        thrust: (3,) N in world, asked of the fans.
        given: (3,) N in world, what they are taken to give now.
        vectoring: the fans push in any direction; otherwise along the body's z axis alone.
        limit: most thrust that the fans can make now [N]; infinite while none is lost.
        reference: what a plan says, or None while statics alone are followed.
        pitch: of the body relative to the plane, nose down, so that a fixed axis points uphill
            [rad].
    """

    def __init__(self, robot: Robot, parameters: Parameters) -> None:
        """Level, fans off."""
        self.parameters = parameters
        self.mass = float(robot.mass)
        center, self._leg_share = _balance(robot)
        self._foot_radius = robot.foot_radius
        self._center: tuple[float, ...] = tuple(center.tolist())  # m, of mass, in base
        self.vectoring = Gimbal.of(robot) is not None
        self.pitch = 0.0
        self.reference: PlanReference | None = None
        self.incline = Incline()
        self.normal = UP.copy()
        self.plane = LEVEL_GROUND.plane
        self.thrust = np.zeros(3)
        self.given = np.zeros(3)
        self.active = False
        self.limit = math.inf
        self._best = np.zeros(3)
        self._flowing = False

    def follow(self, plan: Plan) -> None:
        """Follow a plan from now on, near its slope.

        Raises:
            ValueError: it is not for this robot; says why.
        """
        mode = "vector" if self.vectoring else "body_z"
        ratio = self.parameters["wair.load_slope"]
        self.reference = reference_of(plan, self.mass, mode, ratio)

    @property
    def slope(self) -> float:
        """Slope of the plane that is walked on [rad]."""
        return math.acos(min(1.0, max(-1.0, float(self.normal[2]))))

    @property
    def uphill(self) -> Array:
        """Unit vector up the plane that is walked on, in world (3,); zero on the level."""
        x, y, z = self.normal.tolist()
        level = math.hypot(x, y)
        return np.zeros(3) if level < 1e-6 else np.array([-x * z / level, -y * z / level, level])

    def ground(self, height: float) -> Ground:
        """Return what is walked on, for a body at a height over the centres of the feet [m]."""
        return Ground(
            self.plane,
            self.bend(),
            self.curve(),
            self.load_slope(),
            self.shift(height),
            self.pitch,
            self.sink,
        )

    def shift(self, height: float) -> tuple[float, float]:
        """Return where the feet stand relative to under the body, (x, y) m in plane.

        The load passes through the centre of mass: the feet stand its height over the ground times
        the load's slope down from under it, and what a plan adds.

        Args:
            height: of the body over the centres of the feet [m].
        """
        x, y = self.load_slope()
        ahead, _, above = self._center
        s, c = math.sin(self.pitch), math.cos(self.pitch)
        lever = height + self._foot_radius + above * c - ahead * s
        x, y = -lever * x + ahead * c + above * s, -lever * y
        # The legs lean with their feet and take the centre of mass along.
        x, y = x / (1.0 - self._leg_share), y / (1.0 - self._leg_share)
        reference = self.reference
        if reference is not None:
            further = reference.weight(self.slope) * reference.shift_extra
            up = self.plane @ self.uphill
            x, y = x + further * float(up[0]), y + further * float(up[1])
        return x, y

    @property
    def gravity(self) -> Array:
        """Gravity in the plane that is walked on, (3,) m/s^2."""
        return gravity_in_plane(self.plane)

    @property
    def given_in_plane(self) -> Array:
        """Thrust that acts, (3,) N in the plane that is walked on."""
        return self.plane @ self.given

    @property
    def lift(self) -> float:
        """Thrust that acts away from the plane that is walked on [N]."""
        return float(self.given_in_plane[2])

    def begin(self, foot_in_world: Array) -> None:
        """Start on level ground, all feet down."""
        self.incline.reset(foot_in_world)
        self.normal[:] = UP
        self.plane = LEVEL_GROUND.plane
        self.active = self._flowing = True

    def end(self) -> None:
        """Level again: the thrust goes by itself."""
        self.active = False
        self.pitch = 0.0
        self.normal[:] = UP
        self.plane = LEVEL_GROUND.plane

    def tick(
        self,
        foot_in_world: Array,
        standing: Mask,
        touchdown: Mask,
        left: Array,
        velocity_error: Array,
        limit: float,
        dt: float,
    ) -> None:
        """Measure the plane, ask for thrust, lean.

        Args:
            foot_in_world: (4, 3) m, estimated.
            standing: (4,) bool.
            touchdown: (4,) bool.
            left: (3,) unit vector in world, the body's left.
            velocity_error: (3,) m/s in plane, desired minus estimated.
            limit: most thrust that the fans can make [N]: 0 while the propulsion unit is not armed
                or does not follow, infinite while no fan is lost.
            dt: s.
        """
        self.limit = limit
        self.incline.tick(
            foot_in_world, standing, touchdown, left, self.parameters["wair.slope_filter"], dt
        )
        self._follow(self._wanted(velocity_error), dt)
        self._lean(dt)

    def fade(self, dt: float) -> None:
        """Out of the mode: let the thrust go."""
        if self._flowing:
            self._follow(np.zeros(3), dt)
            self._flowing = bool(np.abs(self.given).max() > REST_THRUST)
            if not self._flowing:
                self.thrust.fill(0.0)
                self.given.fill(0.0)

    @property
    def sink(self) -> float:
        """How much lower than usual a body that leans ahead walks, so that legs reach down [m]."""
        if not self.pitch:
            return 0.0
        share = min(1.0, self.pitch / max(0.1, self._whole_lean(self.slope)))
        return share * self.parameters["wair.lean_sink"]

    @property
    def lost(self) -> bool:
        """Whether the fans have failed where the feet cannot do without what they fail to give."""
        p = self.parameters
        if self.limit >= p["wair.thrust_limit"] or p["wair.thrust_share"] == 0.0:
            return False
        support = -self.mass * self.gravity - self.plane @ self._best
        ratio = math.hypot(support[0], support[1]) / max(1e-3, float(support[2]))
        return ratio > p["wair.most_load_slope"]

    @property
    def lightness(self) -> float:
        """Share of the weight that presses the feet onto the plane, as thrust is given now."""
        normal = -self.mass * float(self.gravity[2]) - float(self.plane[2] @ self.given)
        return normal / (self.mass * GRAVITY)

    def load_slope(self) -> tuple[float, float]:
        """Return the feet's tangential over normal load with the thrust given, (x, y) in plane."""
        support = -self.mass * self.gravity - self.given_in_plane
        return load_slope(support, self.parameters["wair.most_load_slope"])

    def bend(self) -> Array:
        """Return the rise per way, (4, 2), of the ground of each foot over the walked plane."""
        normals = self.incline.normals @ self.plane.T
        slopes: Array = -normals[:, :2] / np.maximum(normals[:, 2:], 0.3)
        return slopes

    def curve(self) -> Array:
        """Return the change of that rise per way, (2, 2) 1/m."""
        ahead = (self.plane @ self.incline.ahead)[:2]
        change: Array = self.incline.curvature * np.outer(ahead, ahead)
        return change

    def _needed(self, normals: list[Array]) -> Array:
        """Thrust in world that the statics of the grounds under the feet ask for."""
        p = self.parameters
        if not self.vectoring:
            lean = self.pitch
            axis = np.array([math.sin(lean), 0.0, math.cos(lean)])
            thrust = axial_thrust(self.gravity, self.mass, p["wair.load_slope"], axis)
            along: Array = p["wair.thrust_share"] * (thrust @ self.plane)
            return along
        direction = load_direction(normals, p["wair.load_slope"])
        thrust = thrust_for_load(direction, self.mass, p["wair.least_load"], p["wair.thrust_limit"])
        reference = self.reference
        if reference is not None:
            up, out = reference.weight(self.slope) * reference.thrust_extra
            thrust += out * self.normal + up * self.uphill
        return p["wair.thrust_share"] * thrust

    def _whole_lean(self, slope: float) -> float:
        return slope + _steepness(slope) * self.parameters["wair.lean_ahead"]

    def _pitch_for(self, slope: float) -> float:
        """Pitch relative to the plane at which a fixed axis helps: beyond the slope itself."""
        p = self.parameters
        if self.vectoring or p["wair.thrust_share"] == 0.0:
            return 0.0
        share = min(1.0, max(0.0, (slope - LEAN_FROM) / (LEAN_WHOLE - LEAN_FROM)))
        lean = self._whole_lean(slope)
        if self.reference is not None:
            lean += self.reference.weight(slope) * (self.reference.pitch - lean)
        return share * lean

    def _wanted(self, velocity_error: Array) -> Array:
        p = self.parameters
        most = min(p["wair.thrust_limit"], self.limit)
        needed = self._needed(self.incline.grounds())
        size = math.sqrt(float(needed @ needed))
        self._best = needed if size <= most else needed * (most / size)
        if size < 1e-6 or most == 0.0 or not self.vectoring:
            return self._best
        # Feedback along the slope only: across the plane the legs hold the body.
        push = p["wair.velocity_gain"] * velocity_error[:2]
        push_limit = min(p["wair.feedback_limit"], size)
        length = math.hypot(push[0], push[1])
        if length > push_limit:
            push *= push_limit / length
        wanted = needed + push @ self.plane[:2]
        size = math.sqrt(float(wanted @ wanted))
        return wanted if size <= most else wanted * (most / size)

    def _follow(self, wanted: Array, dt: float) -> None:
        step = self.parameters["wair.thrust_slew"] * dt
        change = wanted - self.thrust
        size = math.sqrt(float(change @ change))
        self.thrust += change if size <= step else change * (step / size)
        asked, size = self.thrust, math.sqrt(float(self.thrust @ self.thrust))
        if size > self.limit:
            asked = asked * (self.limit / size)
        self.given += (asked - self.given) * min(1.0, dt / FAN_LAG)

    def _lean(self, dt: float) -> None:
        p = self.parameters
        most = p["wair.lean_rate"] * dt
        self.pitch = slewed(self.pitch, self._pitch_for(self.slope), most)
        ahead = turn_towards(self.normal, self.incline.normal, p["wair.lean_rate"] * dt)
        steeper = ahead[2] < self.normal[2]
        if steeper and self.limit > 0.0 and self.vectoring:
            # What must be there first is what holds the body, not what presses the feet.
            holds = thrust_for_load(load_direction([ahead], p["wair.load_slope"]), self.mass)
            needed = p["wair.thrust_share"] * math.sqrt(float(holds @ holds))
            if needed > math.sqrt(float(self.given @ self.given)) + GATE:
                ahead = self.normal
        if float(np.abs(ahead - self.normal).max()) > 1e-7:
            self.normal[:] = ahead
            self.plane = plane_from_world(ahead)


def _steepness(slope: float) -> float:
    """Return the tangential over the normal part of gravity, up to 1 at 45 degrees [-]."""
    return math.tan(min(slope, math.radians(45.0)))


def _balance(robot: Robot) -> tuple[Array, float]:
    """Return the standing robot's centre of mass in base, and how far it goes with the feet.

    Returns:
        Centre of mass [m] (3,), and its way per way of all feet along x [-].
    """
    kinematics = Kinematics(robot)
    feet = kinematics.foot_positions(robot.stand_joint_position)
    center = kinematics.center_of_mass(robot.stand_joint_position)
    leaning = kinematics.joint_positions(feet + (LEANING, 0.0, 0.0))
    return center, float((kinematics.center_of_mass(leaning) - center)[0]) / LEANING
