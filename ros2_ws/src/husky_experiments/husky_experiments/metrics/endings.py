"""What a recording says of a robot that something failed on: how it came down, how it ends.

The ground is the plane z = 0 of world.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from husky_description.arrays import Array
from husky_description.robot import Robot
from husky_description.rotor_geometry import rotor_geometry
from husky_experiments.metrics import measures
from husky_experiments.metrics.morph import AIRBORNE, RESTING, center_of_mass, perch_height
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Base

SINK_BOUND = 1.2
"""Sink rate of the perch at touch-down that the robot stands: a fall from 0.07 m [m/s]."""
TILT_BOUND = math.radians(10.0)
"""Tilt of a robot that lies on its perch, not on an arm [rad]."""
FALLEN_BOUND = math.radians(45.0)
"""The same of one that stood on legs: it may lie on one that has failed, but not on its side."""
THRUST_BOUND = 0.5
"""Thrust of propellers that are off [N]."""
SPEED_BOUND = 0.05
"""Speed of a body that is at rest, the greatest of the last `_REST` [m/s]."""
_REST = 0.5
"""Time of the end [s]."""
_BEFORE = 0.02
"""By how much before touch-down its speeds are taken [s]."""
_TURNING = 30.0
"""Speed of a rotor whose blades hurt [rad/s]."""


@dataclass(frozen=True)
class Ending:
    """From a fault to the end of a recording; NaN of what did not happen."""

    flew: bool  # the perch was off the ground and the propellers carried, when it failed
    stood: bool  # it was on its legs
    time: float  # from the fault until the perch is on the ground [s]
    tilt: float  # greatest until then [rad]
    spin: float  # greatest yaw rate until then [rad/s]
    sink: float  # greatest speed at which the perch meets the ground [m/s], 0 if it is there
    slide: float  # horizontal speed at touch-down [m/s]
    blades: float  # least height of a turning propeller's disc over the ground [m]
    rest_tilt: float  # at the end [rad]
    rest_speed: float  # of the body, at the end [m/s]
    rest_thrust: float  # of all propellers, at the end [N]

    @property
    def safe(self) -> bool:
        """Whether it rests, upright, with its propellers off, and has hit nothing hard."""
        met = self.sink < SINK_BOUND and not self.blades < 0.0
        upright = self.rest_tilt < (FALLEN_BOUND if self.stood else TILT_BOUND)
        still = self.rest_thrust < THRUST_BOUND and self.rest_speed < SPEED_BOUND
        down = self.stood or not math.isnan(self.time)
        return bool(met and upright and still and down)

    def as_metrics(self) -> dict[str, float]:
        """Return all numbers by name with unit, angles in degrees."""
        values = asdict(self)
        return {
            "flew": int(self.flew),
            "stood": int(self.stood),
            "down_after_s": values["time"],
            "tilt_max_deg": math.degrees(self.tilt),
            "spin_max_rad_s": self.spin,
            "touch_sink_m_s": self.sink,
            "touch_slide_m_s": self.slide,
            "blades_min_m": self.blades,
            "rest_tilt_deg": math.degrees(self.rest_tilt),
            "rest_speed_m_s": self.rest_speed,
            "rest_thrust_n": self.rest_thrust,
            "safe": int(self.safe),
        }


def ending(recording: Recording, robot: Robot, fault: float) -> Ending:
    """Return how a robot ended after a fault at a time [s]."""
    base, fans = recording.base.between(fault, math.inf), recording.fans
    tilt, spin = measures.tilt(base.orientation), np.abs(base.angular_velocity[:, 2])
    height = perch_height(robot, base)
    row = int(measures.nearest(fans.time, np.array([fault]))[0])
    carried = float(fans.thrust[row].sum())
    above, flew = bool(height[0] > AIRBORNE), carried > THRUST_BOUND
    touching = np.flatnonzero(height <= RESTING)
    touch = int(touching[0]) if len(touching) else None
    until = slice(None) if touch is None else slice(touch + 1)
    resting = base.time >= base.time[-1] - _REST
    return Ending(
        flew=above and flew,
        stood=above and not flew,
        time=math.nan if touch is None else float(base.time[touch]) - fault,
        tilt=float(tilt[until].max()),
        spin=float(spin[until].max()),
        sink=_sink(base, height),
        slide=math.nan if touch is None else _speeds_before(base, touch)[0],
        blades=_blades(recording, robot, base),
        rest_tilt=float(tilt[-1]),
        rest_speed=float(np.linalg.norm(base.velocity[resting], axis=1).max()),
        rest_thrust=float(fans.thrust[-1].sum()),
    )


def _speeds_before(base: Base, row: int) -> tuple[float, float]:
    """Return the speeds over the ground and down just before a row [m/s]."""
    before = max(0, int(np.searchsorted(base.time, base.time[row] - _BEFORE)))
    vx, vy, vz = base.velocity[before].tolist()
    return math.hypot(vx, vy), -vz


def _sink(base: Base, height: Array) -> float:
    """Return the greatest speed down just before the perch comes to the ground [m/s]."""
    lies = height <= RESTING
    meets = np.flatnonzero(lies[1:] & ~lies[:-1]) + 1
    return max((_speeds_before(base, int(row))[1] for row in meets), default=0.0)


def _blades(recording: Recording, robot: Robot, base: Base) -> float:
    """Return how near the discs of turning propellers come to the ground [m]; NaN if none turns.

    Joints are the measured ones; where they are not told any more, the last.
    """
    speed = recording.fans.speed[measures.nearest(recording.fans.time, base.time)]
    rows = np.flatnonzero((speed > _TURNING).any(axis=1))
    if not len(rows):
        return math.nan
    joints = recording.joints
    position = joints.position[measures.nearest(joints.time, base.time[rows])]
    centers = center_of_mass(robot, position)
    turns = Rotation.from_quat(base.orientation[rows]).as_matrix()
    least = math.inf
    for row, place, center, turn in zip(rows, position, centers, turns, strict=True):
        rotors = rotor_geometry(robot, place)
        heights = base.position[row, 2] + (rotors.position + center) @ turn[2]
        tops = np.clip(rotors.axis @ turn[2], -1.0, 1.0)
        lowest = heights - 0.5 * robot.propellers.diameter * np.sqrt(1.0 - tops * tops)
        least = min(least, float(lowest[speed[row] > _TURNING].min()))
    return least
