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

from husky_description.arrays import Array
from husky_description.compiled import Compiled
from husky_description.gravity import GRAVITY
from husky_description.kinematics import LEGS
from husky_description.vectors import Vector, cross, product, product_plus, scaled, vector

if TYPE_CHECKING:
    from husky_description.robot import Robot

Mask = NDArray[np.bool_]

POSITION, VELOCITY, FEET = 0, 1, 2
"""Where base position, base velocity and the first foot stand in a state."""
STATES = FEET + LEGS


class EstimatorNoise(NamedTuple):
    """Standard deviations the filter believes in."""

    acceleration: float  # m/s^2/sqrt(Hz), specific force, with what attitude error leaks in
    foot_drift: float  # m/sqrt(s), of a foot in contact
    foot_position: float  # m, foot from kinematics
    foot_velocity: float  # m/s, foot from kinematics
    ground_height: float  # m, of the ground about its mean, where a foot touches down
    innovation_gate: float  # innovations beyond so many deviations count less (slip)


class LegOdometry(NamedTuple):
    """What one tick measures of the body and of its legs."""

    rotation: Array  # (3, 3), base to world
    angular_velocity: Array  # (3,) rad/s in base
    specific_force: Array  # (3,) m/s^2 in base
    foot_in_base: Array  # (4, 3) m, foot centres
    jacobian: Array  # (4, 3, 3) m/rad in base
    joint_position: Array  # (12,) rad
    joint_velocity: Array  # (12,) rad/s
    trust: Array  # (4,) 0 for a foot in the air to 1 for a foot firmly on the ground


class Footing(NamedTuple):
    """What the feet stand on."""

    foot_radius: float  # m
    # (3,) unit vector in world, of the ground that the feet roll on; only level ground (0, 0, 1) is
    # believed to be at a height
    normal: Array
    height: float  # m, of level ground in world


class Belief(NamedTuple):
    """What the filter believes, updated in place."""

    state: Array  # (6, 3) in world: position [m] and velocity [m/s] of base, foot centres [m]
    horizontal: Array  # (6, 6) covariance of x and of y
    vertical: Array  # (6, 6) covariance of z
    in_contact: Mask  # (4,), feet that were in contact at the last step
    gain: Array  # (6,), of the last measurement


@njit(cache=True)
def _update(covariance: Array, plus: int, minus: int, variance: float, gain: Array) -> None:
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
def _correct(state: Array, axis: int, gain: Array, error: float) -> None:
    """Correct the state of one axis by what a measurement differs from what was expected."""
    for i in range(STATES):
        state[i, axis] += gain[i] * error


@njit(cache=True)
def _propagate(covariance: Array, acceleration: float, foot: float, dt: float) -> None:
    """Propagate one covariance over dt (state: position, velocity, feet)."""
    for i in range(STATES):
        covariance[POSITION, i] += dt * covariance[VELOCITY, i]
    for i in range(STATES):
        covariance[i, POSITION] += dt * covariance[i, VELOCITY]
    covariance[VELOCITY, VELOCITY] += acceleration * acceleration * dt
    for index in range(FEET, STATES):
        covariance[index, index] += foot * foot * dt


@njit(cache=True)
def _predict(belief: Belief, measured: LegOdometry, noise: EstimatorNoise, dt: float) -> None:
    """Move the base on by the accelerometer."""
    state = belief.state
    felt = product(measured.rotation, vector(measured.specific_force))
    acceleration = (felt[0], felt[1], felt[2] - GRAVITY)
    for axis in range(3):
        a = acceleration[axis]
        state[POSITION, axis] += state[VELOCITY, axis] * dt + 0.5 * a * dt * dt
        state[VELOCITY, axis] += a * dt
    _propagate(belief.horizontal, noise.acceleration, noise.foot_drift, dt)
    _propagate(belief.vertical, noise.acceleration, noise.foot_drift, dt)


@njit(cache=True)
def _foot_motion(measured: LegOdometry, leg: int) -> tuple[Vector, Vector, Vector]:
    """Return how a foot and its shin move, in world.

    Returns:
        Foot centre relative to the base [m], its rate [m/s], angular velocity of the shin [rad/s].
    """
    rotation, w = measured.rotation, vector(measured.angular_velocity)
    foot = vector(measured.foot_in_base[leg])
    joint_rate = vector(measured.joint_velocity[3 * leg : 3 * leg + 3])
    frontal, pitch_rate = measured.joint_position[3 * leg], joint_rate[1] + joint_rate[2]
    # The hip axes are x and the rotated y.
    spin = (
        w[0] + joint_rate[0],
        w[1] + pitch_rate * math.cos(frontal),
        w[2] + pitch_rate * math.sin(frontal),
    )
    rate = product_plus(measured.jacobian[leg], joint_rate, cross(w, foot))
    return product(rotation, foot), product(rotation, rate), product(rotation, spin)


@njit(cache=True)
def _restart_foot(belief: Belief, index: int, relative: Vector, variance: float) -> None:
    """Put a foot where the base and the kinematics say it is."""
    for axis in range(3):
        belief.state[index, axis] = belief.state[POSITION, axis] + relative[axis]
    for covariance in (belief.horizontal, belief.vertical):
        for i in range(STATES):
            covariance[index, i] = covariance[POSITION, i]
        for i in range(STATES):
            covariance[i, index] = covariance[i, POSITION]
        covariance[index, index] = covariance[POSITION, POSITION] + variance


@njit(cache=True)
def _touch_level_ground(belief: Belief, index: int, footing: Footing, variance: float) -> None:
    """Take the ground under a foot to be at its height: holds the body's against drift."""
    _update(belief.vertical, index, -1, variance, belief.gain)
    centre = footing.height + footing.foot_radius
    _correct(belief.state, 2, belief.gain, centre - belief.state[index, 2])


@njit(cache=True)
def _see_foot(belief: Belief, index: int, relative: Vector, variance: float) -> None:
    """Take the measurement of where a foot is, seen from the base."""
    state, gain = belief.state, belief.gain
    _update(belief.horizontal, index, POSITION, variance, gain)
    for axis in range(2):
        error = relative[axis] - (state[index, axis] - state[POSITION, axis])
        _correct(state, axis, gain, error)
    _update(belief.vertical, index, POSITION, variance, gain)
    _correct(state, 2, gain, relative[2] - (state[index, 2] - state[POSITION, 2]))


@njit(cache=True)
def _see_speed(belief: Belief, speed: Vector, variance: float, gate: float) -> None:
    """Take the measurement of the base's velocity; the further off it is, the less it counts."""
    state, gain = belief.state, belief.gain
    x = speed[0] - state[VELOCITY, 0]
    y = speed[1] - state[VELOCITY, 1]
    z = speed[2] - state[VELOCITY, 2]
    _update(
        belief.horizontal, VELOCITY, -1,
        _gated(x * x + y * y, belief.horizontal, variance, gate), gain,
    )
    _correct(state, 0, gain, x)
    _correct(state, 1, gain, y)
    _update(belief.vertical, VELOCITY, -1, _gated(z * z, belief.vertical, variance, gate), gain)
    _correct(state, 2, gain, z)


@njit(cache=True)
def _gated(square: float, covariance: Array, variance: float, gate: float) -> float:
    """Return the variance of a speed whose innovation has this square: more beyond the gate."""
    expected = covariance[VELOCITY, VELOCITY] + variance
    inflation: float = max(1.0, square / (gate * gate * expected))
    return variance * inflation


@njit(cache=True)
def _follow_foot(
    belief: Belief,
    measured: LegOdometry,
    leg: int,
    footing: Footing,
    noise: EstimatorNoise,
    dt: float,
) -> None:
    """Take what one leg measures: a foot in the air begins anew, one on the ground corrects."""
    state, index, trust = belief.state, FEET + leg, measured.trust[leg]
    normal = vector(footing.normal)
    relative, rate, spin = _foot_motion(measured, leg)
    place_variance = noise.foot_position * noise.foot_position
    touching = trust > 0.0
    if not touching or not belief.in_contact[leg]:
        _restart_foot(belief, index, relative, place_variance)
        if touching and normal[2] == 1.0:
            height_variance = noise.ground_height * noise.ground_height
            _touch_level_ground(belief, index, footing, height_variance)
        belief.in_contact[leg] = touching
    if not touching:
        return
    # A sphere that rolls: its centre moves at spin x (radius normal).
    roll = scaled(footing.foot_radius, cross(spin, normal))
    for axis in range(3):
        state[index, axis] += roll[axis] * dt
    _see_foot(belief, index, relative, place_variance / trust)
    # How fast it moves: base velocity + rate = rolling.
    speed = (roll[0] - rate[0], roll[1] - rate[1], roll[2] - rate[2])
    speed_variance = noise.foot_velocity * noise.foot_velocity / trust
    _see_speed(belief, speed, speed_variance, noise.innovation_gate)


@njit(cache=True)
def estimate(
    belief: Belief,
    measured: LegOdometry,
    footing: Footing,
    noise: EstimatorNoise,
    dt: float,
) -> None:
    """One step of the filter.

    Args:
        belief: updated.
        measured: in this tick.
        footing: what the feet stand on.
        noise: standard deviations.
        dt: s.
    """
    _predict(belief, measured, noise, dt)
    for leg in range(LEGS):
        _follow_foot(belief, measured, leg, footing, noise, dt)


class Estimator:
    """Base position and velocity of one robot, tick by tick.

    Attributes:
        foot_radius: [m].
        normal: of the ground, unit vector in world (3,).
        ground_height: of level ground in world; zero where it began [m].
        position: base in world [m] (3,).
        velocity: base in world [m/s] (3,).
        foot_in_world: foot centres [m] (4, 3).
        horizontal: covariance of x and of y: position, velocity, feet (6, 6).
        vertical: the same of z (6, 6).
    """

    def __init__(self, robot: Robot) -> None:
        """A filter at the origin of the world."""
        self.foot_radius = float(robot.foot_radius)
        self.normal = np.array([0.0, 0.0, 1.0])
        self.ground_height = 0.0
        state = np.zeros((STATES, 3))
        self.position: Array = state[POSITION]
        self.velocity: Array = state[VELOCITY]
        self.foot_in_world: Array = state[FEET:]
        self.horizontal = np.zeros((STATES, STATES))
        self.vertical = np.zeros((STATES, STATES))
        in_contact = np.zeros(LEGS, dtype=np.bool_)
        self._belief = Belief(state, self.horizontal, self.vertical, in_contact, np.zeros(STATES))
        self._estimate = Compiled(estimate)
        self.reset(np.zeros((LEGS, 3)), np.eye(3))

    def reset(self, foot_in_base: Array, rotation: Array) -> None:
        """Begin again at rest over the origin, the lowest foot on the ground."""
        lowest = min(float(rotation[2] @ foot) for foot in foot_in_base)
        self.position[:] = 0.0, 0.0, self.ground_height + self.foot_radius - lowest
        self.velocity.fill(0.0)
        self.foot_in_world[:] = self.position + foot_in_base @ rotation.T
        for covariance in (self.horizontal, self.vertical):
            covariance.fill(0.0)
            np.fill_diagonal(covariance, 1e-4)
        self._belief.in_contact.fill(False)

    def update(self, measured: LegOdometry, noise: EstimatorNoise, dt: float) -> None:
        """Take one tick's measurements, dt [s] after the last ones."""
        footing = Footing(self.foot_radius, self.normal, self.ground_height)
        self._estimate.call(self._belief, measured, footing, noise, dt)
