"""The incline under the feet: its normal from the stance feet, the frame on it, and its statics.

Plane frame: origin of world, z the outward normal of the incline, turned from world by the least
rotation, so that walking uphill along the world's x is walking along the plane's x. Nobody tells
the slope: the IMU gives the attitude, leg odometry the feet that stand, and they span the plane.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.gravity import GRAVITY
from husky_description.kinematics import LEGS

Mask = NDArray[np.bool_]

STEEPEST = math.radians(100.0)
"""A normal further from the vertical than this is an estimate that has gone wrong [rad]."""


LANDINGS = 3
"""Places of each foot that the bend of the ground is learnt from."""
STRAIGHTNESS = 3e-4
"""Belief that the ground is straight, in the sum of squares that the bend is fitted to [m^4]."""
TOLERANCE = math.radians(5.0)
"""Noise of a pair's normal [rad]."""


def plane_from_world(normal: Array) -> Array:
    """Return the least rotation (3, 3) that takes a unit normal (3,) in world to the z axis.

    Raises:
        ValueError: the normal points downward, where no least rotation is meant.
    """
    x, y, z = (float(v) for v in normal)
    if not z > -0.9:
        raise ValueError(f"normal is {normal}, its z must be above -0.9")
    s = 1.0 / (1.0 + z)
    return np.array(
        [[1.0 - s * x * x, -s * x * y, -x], [-s * x * y, 1.0 - s * y * y, -y], [x, y, z]]
    )


def feet_normal(foot: Array) -> Array:
    """Return the unit normal (3,) of the plane parallel to both diagonals of four feet.

    For four feet in a rectangle it is the plane of least squares.

    Args:
        foot: (4, 3) m; front left, front right, hind left, hind right.

    Raises:
        ValueError: the diagonals are parallel: the feet span no plane.
    """
    normal = _cross(foot[1] - foot[2], foot[0] - foot[3])
    size = float(np.linalg.norm(normal))
    if size < 1e-6:
        raise ValueError(f"the feet {foot.tolist()} span no plane")
    return normal / size


def least_thrust(gravity: Array, mass: float, ratio: float) -> Array:
    """Return the least force at the centre of mass that keeps the feet's tangential load small.

    With g_t and g_n the parts of gravity along and into the plane, its size is
    m (g_t - ratio g_n) / sqrt(1 + ratio^2), and it points up the slope and *into* it, so that the
    feet keep tangential / normal = ratio; zero where legs alone do.

    Args:
        gravity: (3,) m/s^2 in plane.
        mass: kg.
        ratio: wanted tangential over normal load of the feet.

    Returns:
        (3,) N in plane.
    """
    tangential = math.hypot(float(gravity[0]), float(gravity[1]))
    excess = tangential + ratio * float(gravity[2])
    if excess <= 0.0 or tangential < 1e-9:
        return np.zeros(3)
    size = mass * excess / (1.0 + ratio * ratio)
    return np.array(
        [-size * gravity[0] / tangential, -size * gravity[1] / tangential, -size * ratio]
    )


def axial_thrust(gravity: Array, mass: float, ratio: float, axis: Array) -> Array:
    """Return the least force along a fixed axis that leaves the feet tangential / normal = ratio.

    Args:
        gravity: (3,) m/s^2 in plane.
        mass: kg.
        ratio: wanted tangential over normal load of the feet.
        axis: (3,) unit vector in plane, the body's z axis.

    Returns:
        (3,) N in plane; zero where legs alone do, or where the axis does not lean uphill enough.
    """
    tangential = math.hypot(float(gravity[0]), float(gravity[1]))
    excess = tangential + ratio * float(gravity[2])
    if excess <= 0.0 or tangential < 1e-9:
        return np.zeros(3)
    uphill = -float(gravity[0] * axis[0] + gravity[1] * axis[1]) / tangential
    gain = uphill - ratio * float(axis[2])
    return np.zeros(3) if gain < 0.05 else axis * (mass * excess / gain)


def thrust_for_load(
    direction: Array, mass: float, least: float = 0.0, most: float = math.inf
) -> Array:
    """Return the least force at the centre of mass that turns the feet's load into a direction.

    With b the angle between the direction and the vertical its size is m g sin b, at right angles
    to the load: what `least_thrust` says of one plane, for ground that bends.

    Args:
        direction: (3,) unit vector in world, of the ground's force on the feet.
        mass: kg.
        least: of the ground's force [N]; where gravity leaves less, the thrust presses the feet,
            as far as `most` allows.
        most: of the thrust [N].

    Returns:
        (3,) N in world; no longer than `most`, whatever the load is then.
    """
    weight, upright = mass * GRAVITY, float(direction[2])
    load = weight * upright
    across = weight * math.sqrt(max(0.0, 1.0 - upright * upright))
    if load < least and across < most:
        # |weight up - load direction| = most, solved for the load.
        load = min(least, load + math.sqrt(most * most - across * across))
    thrust: Array = -load * direction
    thrust[2] += weight
    return thrust if across <= most else thrust * (most / across)


def load_direction(normals: list[Array], ratio: float) -> Array:
    """Return the force direction nearest to the vertical that grounds of all normals can bear.

    Args:
        normals: (3,) unit vectors in world, of the grounds under the feet.
        ratio: wanted tangential over normal load; more where the ground bends so much that the
            cones about the normals do not meet: then the direction halves their angle.

    Returns:
        (3,) unit vector in world.
    """
    steep = min(normals, key=lambda n: float(n[2]))
    direction = turn_towards(steep, np.array([0.0, 0.0, 1.0]), math.atan(ratio))
    for normal in normals:
        if float(normal @ direction) < float(steep @ direction):
            middle = normal + steep
            direction = middle / math.sqrt(float(middle @ middle))
    return direction


def load_slope(support: Array, most: float) -> tuple[float, float]:
    """Return tangential over normal load, (x, y) in plane, no more than `most` in size.

    Args:
        support: (3,) N in plane, of all feet together.
        most: greatest ratio.
    """
    normal = max(1.0, float(support[2]))
    x, y = float(support[0]) / normal, float(support[1]) / normal
    size = math.hypot(x, y)
    scale = most / size if size > most else 1.0
    return scale * x, scale * y


class Incline:
    """The measured ground under the feet: the plane of all four, and how it bends along the way.

    Attributes:
        normal: (3,) unit vector in world, outward, behind a first-order filter.
        normals: (4, 3) unit vectors in world, of the ground where each foot came down last.
        ahead: (3,) unit vector in world, along the way.
        curvature: change of the ground's slope per way along it, negative over a crest [1/m].
    """

    def __init__(self) -> None:
        """Level."""
        self.normal = np.array([0.0, 0.0, 1.0])
        self.normals = np.tile(self.normal, (LEGS, 1))
        self.ahead, self.curvature = np.array([1.0, 0.0, 0.0]), 0.0
        self._contact = np.zeros((LEGS, 3))
        self._landings = np.zeros((LANDINGS, LEGS, 3))  # where each foot came down, newest first

    def reset(self, foot_in_world: Array) -> None:
        """Begin with all feet standing at foot_in_world (4, 3) m; the filter is settled."""
        self._contact[:] = self._landings[:] = foot_in_world
        self.normal[:] = self._spanned()
        self.normals[:] = self.normal
        self.curvature = 0.0

    def tick(
        self,
        foot_in_world: Array,
        standing: Mask,
        touchdown: Mask,
        left: Array,
        time_constant: float,
        dt: float,
    ) -> None:
        """Take the feet that stand; the others count where they stood last.

        Args:
            foot_in_world: (4, 3) m, estimated.
            standing: (4,) bool.
            touchdown: (4,) bool, feet that have just come down.
            left: (3,) unit vector in world, the body's left.
            time_constant: of the filter [s].
            dt: s.
        """
        self._contact[standing] = foot_in_world[standing]
        self.normal += (self._spanned() - self.normal) * (dt / (time_constant + dt))
        self.normal /= math.sqrt(float(self.normal @ self.normal))
        if touchdown.any():
            landings = self._landings
            landings[1:, touchdown] = landings[:-1, touchdown].copy()
            landings[0, touchdown] = foot_in_world[touchdown]
            self._fit(left)

    def _fit(self, left: Array) -> None:
        """Lay a parabola through the landings, as heights over the plane along the way."""
        ahead = _cross(left, self.normal)
        ahead /= max(1e-6, math.sqrt(float(ahead @ ahead)))
        points = self._landings.reshape(-1, 3)
        along, height = points @ ahead, points @ self.normal
        middle = along.mean()
        along -= middle
        columns = np.column_stack((np.ones_like(along), along, along * along))
        square = columns.T @ columns
        square[2, 2] += STRAIGHTNESS
        square[1, 1] += 1e-9  # m^2: feet all side by side tell no slope
        _, slope, bend = np.linalg.solve(square, columns.T @ height)
        self.ahead, self.curvature = ahead, 2.0 * float(bend)
        slopes = slope + self.curvature * (self._landings[0] @ ahead - middle)
        normals = self.normal - slopes[:, None] * ahead
        self.normals[:] = normals / np.linalg.norm(normals, axis=1, keepdims=True)

    @property
    def slope(self) -> float:
        """Angle between the plane and the level [rad]."""
        return math.acos(min(1.0, max(-1.0, float(self.normal[2]))))

    def grounds(self) -> list[Array]:
        """Return the normals, (3,) in world, of the plane, and of the ground of each pair of feet.

        Within `TOLERANCE` of the plane a pair's normal counts as the plane's.
        """
        pairs = self.normals.reshape(2, 2, 3).sum(axis=1)
        pairs /= np.linalg.norm(pairs, axis=1, keepdims=True)
        return [self.normal, *(turn_towards(pair, self.normal, TOLERANCE) for pair in pairs)]

    def _spanned(self) -> Array:
        try:
            normal = feet_normal(self._contact)
        except ValueError:
            return self.normal
        return normal if normal[2] > math.cos(STEEPEST) else self.normal


def turn_towards(start: Array, end: Array, most: float) -> Array:
    """Return the unit vector that lies from start towards end, both unit, by at most `most` rad."""
    angle = math.acos(min(1.0, max(-1.0, float(start @ end))))
    if angle <= most or angle < 1e-9:
        return np.array(end, dtype=np.float64)
    s = math.sin(angle)
    turned: Array = (math.sin(angle - most) * start + math.sin(most) * end) / s
    return turned / math.sqrt(float(turned @ turned))


def _cross(a: Array, b: Array) -> Array:
    """Vector product of two (3,): NumPy's own takes ten times as long."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def gravity_in_plane(plane: Array) -> Array:
    """Return the acceleration of gravity in a plane frame, (3,) m/s^2, for plane_from_world."""
    return -GRAVITY * plane[:, 2]
