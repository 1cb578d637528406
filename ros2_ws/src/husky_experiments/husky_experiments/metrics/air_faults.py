"""What a recording says of a flight that ends with a fault: how the robot came down, how it lies.

The ground is the plane z = 0 of world.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np

from husky_description.robot import Robot
from husky_experiments.metrics import measures
from husky_experiments.metrics.morph import RESTING, perch_height
from husky_experiments.recordings.recording import Recording

SINK_BOUND = 1.2
"""Sink rate at touch-down that the robot stands: a fall from 0.07 m [m/s]."""
TILT_BOUND = math.radians(10.0)
"""Tilt of a robot that lies on its perch, not on an arm [rad]."""
THRUST_BOUND = 0.5
"""Thrust of propellers that are off [N]."""
_BEFORE = 0.02
"""By how much before touch-down its speeds are taken [s]."""


@dataclass(frozen=True)
class ComingDown:
    """From a fault in the air to the ground; NaN of what did not happen."""

    time: float  # from the fault to touch-down [s]
    tilt: float  # greatest in the air [rad]
    spin: float  # greatest yaw rate in the air [rad/s]
    sink: float  # at touch-down [m/s]
    slide: float  # horizontal speed at touch-down [m/s]
    rest_tilt: float  # at the end [rad]
    rest_thrust: float  # of all propellers at the end [N]

    @property
    def safe(self) -> bool:
        """Whether it lies on its perch, has not fallen there, and its propellers are off."""
        down = self.sink < SINK_BOUND and self.rest_tilt < TILT_BOUND
        return bool(down and self.rest_thrust < THRUST_BOUND)

    def as_metrics(self) -> dict[str, float]:
        """Return all numbers by name with unit, angles in degrees."""
        values = asdict(self)
        return {
            "down_after_s": values["time"],
            "tilt_max_deg": math.degrees(self.tilt),
            "spin_max_rad_s": self.spin,
            "touch_sink_m_s": self.sink,
            "touch_slide_m_s": self.slide,
            "rest_tilt_deg": math.degrees(self.rest_tilt),
            "rest_thrust_n": self.rest_thrust,
        }


def coming_down(recording: Recording, robot: Robot, fault: float) -> ComingDown:
    """Return how a robot came down after a fault at a time [s]."""
    base = recording.base.between(fault, math.inf)
    tilt, spin = measures.tilt(base.orientation), np.abs(base.angular_velocity[:, 2])
    rest = float(tilt[-1]), float(recording.fans.thrust[-1].sum())
    touching = np.flatnonzero(perch_height(robot, base) <= RESTING)
    if not len(touching):
        nan = math.nan
        return ComingDown(nan, float(tilt.max()), float(spin.max()), nan, nan, *rest)
    touch = int(touching[0])
    before = max(0, int(np.searchsorted(base.time, base.time[touch] - _BEFORE)))
    vx, vy, vz = base.velocity[before].tolist()
    return ComingDown(
        time=float(base.time[touch]) - fault,
        tilt=float(tilt[: touch + 1].max()),
        spin=float(spin[: before + 1].max()),
        sink=-vz,
        slide=math.hypot(vx, vy),
        rest_tilt=rest[0],
        rest_thrust=rest[1],
    )
