"""Base position and velocity from leg odometry: a Kalman filter over IMU and joint encoders.

State per axis of the world: base position, base velocity, the four foot positions. With the
attitude taken from the IMU the three axes do not couple, and x and y share one covariance, so the
filter is two 6 x 6 covariances and scalar updates. A foot in contact rolls on its sphere; a foot in
the air is carried along and starts afresh at touchdown. World is the odometry frame: level, heading
from the IMU, origin where the filter was reset; x and y drift, as those of any odometry do.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_control.kinematics import LEGS

if TYPE_CHECKING:
    from husky_description.robot import Robot

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

GRAVITY = 9.80665  # m/s^2
STATES = 2 + LEGS


class EstimatorNoise(NamedTuple):
    """Standard deviations the filter believes in."""

    acceleration: float  # m/s^2/sqrt(Hz), specific force, with what attitude error leaks in
    foot_drift: float  # m/sqrt(s), of a foot in contact
    foot_position: float  # m, foot from kinematics
    foot_velocity: float  # m/s, foot from kinematics
    ground_height: float  # m, of the ground about its mean, where a foot touches down
    innovation_gate: float  # innovations beyond so many deviations count less (slip)


@njit(cache=True)
def _update(
    covariance: Array, plus: int, minus: int, variance: float, gain: Array
) -> None:
    """Gain and covariance of one scalar measurement z = x[plus] - x[minus] (minus < 0: none)."""
    for i in range(STATES):
        gain[i] = covariance[i, plus] - (covariance[i, minus] if minus >= 0 else 0.0)
    innovation = gain[plus] - (gain[minus] if minus >= 0 else 0.0) + variance
    for i in range(STATES):
        for k in range(STATES):
            covariance[i, k] -= gain[i] * gain[k] / innovation
    # gain now becomes the Kalman gain; the covariance above used the unscaled one twice.
    for i in range(STATES):
        gain[i] /= innovation


@njit(cache=True)
def _predict(covariance: Array, acceleration: float, foot: float, dt: float) -> None:
    """Propagate one covariance over dt (state: position, velocity, feet)."""
    for i in range(STATES):
        covariance[0, i] += dt * covariance[1, i]
    for i in range(STATES):
        covariance[i, 0] += dt * covariance[i, 1]
    covariance[1, 1] += acceleration * acceleration * dt
    for leg in range(LEGS):
        covariance[2 + leg, 2 + leg] += foot * foot * dt


@njit(cache=True)
def _restart_foot(covariance: Array, index: int, variance: float) -> None:
    """Covariance of a foot that is where the base and the kinematics say it is."""
    for i in range(STATES):
        covariance[index, i] = covariance[0, i]
    for i in range(STATES):
        covariance[i, index] = covariance[i, 0]
    covariance[index, index] = covariance[0, 0] + variance


@njit(cache=True)
def estimate(
    rotation: Array,
    angular_velocity: Array,
    specific_force: Array,
    foot_in_base: Array,
    jacobian: Array,
    joint_position: Array,
    joint_velocity: Array,
    trust: Array,
    foot_radius: float,
    normal: Array,
    noise: EstimatorNoise,
    dt: float,
    position: Array,
    velocity: Array,
    foot: Array,
    horizontal: Array,
    vertical: Array,
    in_contact: Mask,
    gain: Array,
) -> None:
    """One step of the filter.

    Args:
        rotation: (3, 3), base to world.
        angular_velocity: (3,) rad/s in base.
        specific_force: (3,) m/s^2 in base.
        foot_in_base: (4, 3) m, foot centres.
        jacobian: (4, 3, 3) m/rad in base.
        joint_position: (12,) rad.
        joint_velocity: (12,) rad/s.
        trust: (4,) 0 for a foot in the air to 1 for a foot firmly on the ground.
        foot_radius: m.
        normal: (3,) unit vector in world, of the ground that the feet roll on; only level ground
            (0, 0, 1) is believed to be at height zero.
        noise: standard deviations.
        dt: s.
        position: (3,) m, base in world, updated.
        velocity: (3,) m/s, base in world, updated.
        foot: (4, 3) m, foot centres in world, updated.
        horizontal: (6, 6) covariance of x and of y, updated.
        vertical: (6, 6) covariance of z, updated.
        in_contact: (4,) bool, feet that were in contact at the last step, updated.
        gain: (6,) scratch.
    """
    r, w = rotation, angular_velocity
    for i in range(3):
        a = (
            r[i, 0] * specific_force[0] + r[i, 1] * specific_force[1] + r[i, 2] * specific_force[2]
        )
        if i == 2:
            a -= GRAVITY
        position[i] += velocity[i] * dt + 0.5 * a * dt * dt
        velocity[i] += a * dt
    _predict(horizontal, noise.acceleration, noise.foot_drift, dt)
    _predict(vertical, noise.acceleration, noise.foot_drift, dt)
    place_variance = noise.foot_position * noise.foot_position
    for leg in range(LEGS):
        index = 2 + leg
        fx, fy, fz = foot_in_base[leg, 0], foot_in_base[leg, 1], foot_in_base[leg, 2]
        frontal = joint_position[3 * leg]
        frontal_rate = joint_velocity[3 * leg]
        pitch_rate = joint_velocity[3 * leg + 1] + joint_velocity[3 * leg + 2]
        # The shin's angular velocity in base: hip axes are x and the rotated y.
        sx = w[0] + frontal_rate
        sy = w[1] + pitch_rate * math.cos(frontal)
        sz = w[2] + pitch_rate * math.sin(frontal)
        spin_x = r[0, 0] * sx + r[0, 1] * sy + r[0, 2] * sz
        spin_y = r[1, 0] * sx + r[1, 1] * sy + r[1, 2] * sz
        spin_z = r[2, 0] * sx + r[2, 1] * sy + r[2, 2] * sz
        # Foot centre relative to the base, and its rate, in world.
        ux = w[1] * fz - w[2] * fy
        uy = w[2] * fx - w[0] * fz
        uz = w[0] * fy - w[1] * fx
        for k in range(3):
            rate = joint_velocity[3 * leg + k]
            ux += jacobian[leg, 0, k] * rate
            uy += jacobian[leg, 1, k] * rate
            uz += jacobian[leg, 2, k] * rate
        rel_x = r[0, 0] * fx + r[0, 1] * fy + r[0, 2] * fz
        rel_y = r[1, 0] * fx + r[1, 1] * fy + r[1, 2] * fz
        rel_z = r[2, 0] * fx + r[2, 1] * fy + r[2, 2] * fz
        rate_x = r[0, 0] * ux + r[0, 1] * uy + r[0, 2] * uz
        rate_y = r[1, 0] * ux + r[1, 1] * uy + r[1, 2] * uz
        rate_z = r[2, 0] * ux + r[2, 1] * uy + r[2, 2] * uz
        touching = trust[leg] > 0.0
        if not touching or not in_contact[leg]:
            foot[leg, 0] = position[0] + rel_x
            foot[leg, 1] = position[1] + rel_y
            foot[leg, 2] = position[2] + rel_z
            _restart_foot(horizontal, index, place_variance)
            _restart_foot(vertical, index, place_variance)
            if touching and normal[2] == 1.0:
                # The ground is level about zero: holds the height against drift.
                _update(vertical, index, -1, noise.ground_height * noise.ground_height, gain)
                error = foot_radius - foot[leg, 2]
                position[2] += gain[0] * error
                velocity[2] += gain[1] * error
                for k in range(LEGS):
                    foot[k, 2] += gain[2 + k] * error
            in_contact[leg] = touching
        if not touching:
            continue
        # A sphere that rolls: its centre moves at spin x (radius normal).
        roll_x = foot_radius * (spin_y * normal[2] - spin_z * normal[1])
        roll_y = foot_radius * (spin_z * normal[0] - spin_x * normal[2])
        roll_z = foot_radius * (spin_x * normal[1] - spin_y * normal[0])
        foot[leg, 0] += roll_x * dt
        foot[leg, 1] += roll_y * dt
        foot[leg, 2] += roll_z * dt
        # Where the foot is.
        variance = place_variance / trust[leg]
        _update(horizontal, index, 0, variance, gain)
        ex = rel_x - (foot[leg, 0] - position[0])
        ey = rel_y - (foot[leg, 1] - position[1])
        position[0] += gain[0] * ex
        position[1] += gain[0] * ey
        velocity[0] += gain[1] * ex
        velocity[1] += gain[1] * ey
        for k in range(LEGS):
            foot[k, 0] += gain[2 + k] * ex
            foot[k, 1] += gain[2 + k] * ey
        _update(vertical, index, 0, variance, gain)
        ez = rel_z - (foot[leg, 2] - position[2])
        position[2] += gain[0] * ez
        velocity[2] += gain[1] * ez
        for k in range(LEGS):
            foot[k, 2] += gain[2 + k] * ez
        # How fast it moves: base velocity + rate = rolling.
        speed_variance = noise.foot_velocity * noise.foot_velocity / trust[leg]
        ex = roll_x - rate_x - velocity[0]
        ey = roll_y - rate_y - velocity[1]
        ez = roll_z - rate_z - velocity[2]
        for axes in range(2):
            covariance = horizontal if axes == 0 else vertical
            square = ex * ex + ey * ey if axes == 0 else ez * ez
            expected = covariance[1, 1] + speed_variance
            gate = noise.innovation_gate * noise.innovation_gate * expected
            inflated = speed_variance * max(1.0, square / gate)
            _update(covariance, 1, -1, inflated, gain)
            if axes == 0:
                position[0] += gain[0] * ex
                position[1] += gain[0] * ey
                velocity[0] += gain[1] * ex
                velocity[1] += gain[1] * ey
                for k in range(LEGS):
                    foot[k, 0] += gain[2 + k] * ex
                    foot[k, 1] += gain[2 + k] * ey
            else:
                position[2] += gain[0] * ez
                velocity[2] += gain[1] * ez
                for k in range(LEGS):
                    foot[k, 2] += gain[2 + k] * ez


class Estimator:
    """Base position and velocity of one robot, tick by tick."""

    def __init__(self, robot: Robot) -> None:
        """A filter at the origin of the world."""
        self.foot_radius = float(robot.foot_radius)
        self.position = np.zeros(3)
        self.velocity = np.zeros(3)
        self.foot_in_world = np.zeros((LEGS, 3))
        self.normal = np.array([0.0, 0.0, 1.0])  # of the ground, in world
        self.horizontal = np.zeros((STATES, STATES))
        self.vertical = np.zeros((STATES, STATES))
        self._in_contact = np.zeros(LEGS, dtype=np.bool_)
        self._gain = np.zeros(STATES)
        self.reset(np.zeros((LEGS, 3)), np.eye(3))

    def reset(self, foot_in_base: Array, rotation: Array) -> None:
        """Begin again at rest at the origin, the lowest foot on the ground (z = 0)."""
        lowest = min(float(rotation[2] @ foot) for foot in foot_in_base)
        self.position[:] = 0.0, 0.0, self.foot_radius - lowest
        self.velocity.fill(0.0)
        self.foot_in_world[:] = self.position + foot_in_base @ rotation.T
        for covariance in (self.horizontal, self.vertical):
            covariance.fill(0.0)
            np.fill_diagonal(covariance, 1e-4)
        self._in_contact.fill(False)

    def update(
        self,
        rotation: Array,
        angular_velocity: Array,
        specific_force: Array,
        foot_in_base: Array,
        jacobian: Array,
        joint_position: Array,
        joint_velocity: Array,
        trust: Array,
        noise: EstimatorNoise,
        dt: float,
    ) -> None:
        """Take one tick's measurements; see estimate for shapes, units and frames."""
        estimate(
            rotation,
            angular_velocity,
            specific_force,
            foot_in_base,
            jacobian,
            joint_position,
            joint_velocity,
            trust,
            self.foot_radius,
            self.normal,
            noise,
            dt,
            self.position,
            self.velocity,
            self.foot_in_world,
            self.horizontal,
            self.vertical,
            self._in_contact,
            self._gain,
        )
