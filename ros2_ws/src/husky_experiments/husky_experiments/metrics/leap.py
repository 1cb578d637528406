"""What a recording says of a robot that leaps from its legs into flight."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from husky_description.arrays import Array
from husky_description.robot import Robot
from husky_description.rotor_geometry import rotor_geometry
from husky_experiments.metrics import measures
from husky_experiments.metrics.morph import RESTING, first_time, perch_height
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Base, Joints

ARMS = math.radians(10.0)
"""Tilt of the propellers below which the legs count as arms [rad]."""
_IN_THE_AIR = 0.02
"""Time that no foot touches anything, to count as off the ground [s]."""


@dataclass(frozen=True)
class Leap:
    """A leap, the flight after it and its landing; what did not happen is NaN."""

    off: float  # from the request until no foot touches the ground [s]
    speed: float  # upward, at that moment [m/s]
    leaning: float  # greatest tilt of a propeller's axis from up, at that moment [rad]
    opening: float  # from then until the legs are arms [s]
    rate: float  # mean one at which the propellers come up meanwhile [rad/s]
    hip_speed: float  # greatest of a hip frontal joint meanwhile [rad/s]
    lowest: float  # perch over the ground until the landing was asked for [m]
    tilt: float  # greatest of the body until then [rad]
    astray: float  # farthest from where it leapt until then [m]
    torque: float  # greatest of a servo until then, by its current [N m]
    landed: float  # from where it leapt to where it touches down, level [m]
    landing_tilt: float  # of the body as the perch touches [rad]
    landing_lean: float  # greatest tilt of a propeller's axis then [rad]

    @property
    def metrics(self) -> dict[str, float]:
        """By name with unit, ready for JSON."""
        return {
            "leap_feet_off_after_s": self.off,
            "leap_speed_mps": self.speed,
            "leap_propellers_lean_deg": math.degrees(self.leaning),
            "leap_arms_after_s": self.opening,
            "leap_arms_rate_degps": math.degrees(self.rate),
            "leap_hip_speed_max_radps": self.hip_speed,
            "leap_perch_lowest_m": self.lowest,
            "leap_tilt_max_deg": math.degrees(self.tilt),
            "leap_astray_max_m": self.astray,
            "leap_torque_max_nm": self.torque,
            "leap_landed_away_m": self.landed,
            "leap_landing_tilt_deg": math.degrees(self.landing_tilt),
            "leap_landing_propellers_lean_deg": math.degrees(self.landing_lean),
        }


def leap_of(recording: Recording, robot: Robot, asked: float, end: float) -> Leap:
    """Return what happened from a request on [s] until a landing was asked for [s], and after."""
    base, contacts, joints = recording.base, recording.contacts, recording.joints
    flight = base.between(asked, end)
    period = float(np.median(np.diff(contacts.time)))
    lasting = 1 + round(_IN_THE_AIR / period)
    free = np.convolve(~contacts.contact.any(axis=1), np.ones(lasting))[: len(contacts)]
    off = first_time(contacts.time, free >= lasting, asked) - (lasting - 1) * period
    opened = joints.between(off, end)
    tilts = _tilts(robot, base, opened)
    arms = first_time(opened.time, tilts <= ARMS, off)
    height = perch_height(robot, base)
    touch = first_time(base.time, height <= RESTING, end)
    start = flight.position[0, :2]
    row = {time: measures.nearest(base.time, np.array([time]))[0] for time in (off, touch)}
    landed = joints.between(touch, math.inf)
    return Leap(
        off=off - asked,
        speed=float(base.velocity[row[off], 2]),
        leaning=float(tilts[0]),
        opening=arms - off,
        rate=float((tilts[0] - ARMS) / (arms - off)),
        hip_speed=measures.peak(opened.between(off, arms).velocity[:, 0::3]),
        lowest=float(height[(base.time >= asked) & (base.time <= end)].min()),
        tilt=float(measures.tilt(flight.orientation).max()),
        astray=float(np.linalg.norm(flight.position[:, :2] - start, axis=1).max()),
        torque=float(np.abs(joints.between(asked, end).torque).max()),
        landed=float(np.linalg.norm(base.position[row[touch], :2] - start)),
        landing_tilt=float(measures.tilt(base.orientation)[row[touch]]),
        landing_lean=float(_tilts(robot, base, landed)[0]),
    )


def _tilts(robot: Robot, base: Base, joints: Joints) -> Array:
    """Return the greatest tilt of a propeller's axis from up at the times of joints [rad] (n,)."""
    orientation = base.orientation[measures.nearest(base.time, joints.time)]
    return propeller_tilts(robot, orientation, joints.position)


def propeller_tilts(robot: Robot, orientation: Array, joint_position: Array) -> Array:
    """Return the greatest tilt of a propeller's axis from up, over time [rad] (n,).

    Args:
        robot: its legs carry propellers.
        orientation: of the base in world, quaternions (x, y, z, w) (n, 4).
        joint_position: [rad] (n, 12).
    """
    up = Rotation.from_quat(orientation).inv().apply((0.0, 0.0, 1.0))
    pairs = zip(up, joint_position, strict=True)
    rise = [float((rotor_geometry(robot, joints).axis @ above).min()) for above, joints in pairs]
    tilts: Array = np.arccos(np.clip(rise, -1.0, 1.0))
    return tilts
