"""A robot that walks over a ground: where it is, and where its odometry takes it to be."""

import math
from dataclasses import dataclass

import numpy as np
from terrain_scenes import Scene

from husky_description.arrays import Array

CAMERA_IN_BASE = np.array([0.25, 0.0, 0.08])
_TILT = math.radians(30.0)
OPTICAL_IN_BASE = np.array(
    [
        [0.0, -math.sin(_TILT), math.cos(_TILT)],
        [-1.0, 0.0, 0.0],
        [0.0, -math.cos(_TILT), -math.sin(_TILT)],
    ]
)
"""Columns: right, down, ahead of the camera, tilted down by 30 deg."""
BASE_HEIGHT = 0.55
FEET_IN_BASE = np.array([[0.2, 0.1], [0.2, -0.1], [-0.2, 0.1], [-0.2, -0.1]])


@dataclass(frozen=True)
class Pose:
    """Rotation (3, 3) and position (3,) of a body."""

    rotation: Array
    position: Array

    def camera(self) -> "Pose":
        """Of the camera on a base."""
        return Pose(self.rotation @ OPTICAL_IN_BASE, self.position + self.rotation @ CAMERA_IN_BASE)

    def to(self, other: "Pose", points: Array) -> Array:
        """Move points (n, 3) with the body from here to another pose."""
        return (points - self.position) @ self.rotation @ other.rotation.T + other.position


@dataclass(frozen=True)
class Motion:
    """Of the walk, and errors of its odometry.

    Attributes:
        speed: [m/s].
        bob, sway: amplitudes of height [m], and of roll and pitch [rad].
        attitude_noise: of roll and pitch, from image to image [rad].
        attitude_bias: of pitch and roll [rad].
        height_noise: [m].
        climb: drift of the height by distance [m/m].
        stretch: drift along x by distance [m/m].
        yaw_rate: [rad/s], of the robot, about its start.
    """

    speed: float = 0.5
    bob: float = 0.02
    sway: float = 0.02
    attitude_noise: float = 0.004
    attitude_bias: float = 0.003
    height_noise: float = 0.002
    climb: float = 0.003
    stretch: float = 0.01
    yaw_rate: float = 0.0


STEADY = Motion(0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def _matrix(roll: float, pitch: float, yaw: float) -> Array:
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def poses(
    scene: Scene, motion: Motion, time: float, random: np.random.Generator
) -> tuple[Pose, Pose]:
    """Return the base's true pose at a time [s] and the one that odometry has."""
    way = motion.speed * time
    yaw = motion.yaw_rate * time
    under = np.linspace(-0.3, 0.3, 13)
    ground = scene.height(way + under, np.zeros(13))
    ground = np.maximum(ground, -0.1)  # it steps over a gap
    gradient = float(np.polyfit(under, ground, 1)[0])
    phase = 2.0 * math.pi * 2.5 * time
    roll = motion.sway * math.sin(0.5 * phase + 0.4)
    pitch = motion.sway * math.sin(phase + 1.1) - 0.7 * math.atan(gradient)
    z = float(ground.mean()) + BASE_HEIGHT + motion.bob * math.sin(phase)
    true = Pose(_matrix(roll, pitch, yaw), np.array([way, 0.0, z]))
    tilt = motion.attitude_noise * random.standard_normal(2) + motion.attitude_bias
    error = np.array(
        [
            motion.stretch * way,
            0.0,
            motion.climb * way + motion.height_noise * random.standard_normal(),
        ]
    )
    rotation = _matrix(roll + tilt[0], pitch + tilt[1], yaw)
    return true, Pose(rotation, true.position + error)


def footholds(scene: Scene, base: Pose, odometry: Pose) -> Array:
    """Return where the ground is under the feet of a standing robot, in odometry (4, 3)."""
    feet = base.position[:2] + FEET_IN_BASE
    places = np.column_stack((feet, scene.height(feet[:, 0], feet[:, 1])))
    return base.to(odometry, places)
