"""The propulsion unit alone under its gantry, flown by radio: steps in attitude, rope and battery.

Thesis T39. Two ropes hang from the gantry's beam, short enough to keep the unit off the ground: it
begins and ends hanging in them, and they hold it when its operator goes too far. The operator is a
person who sees the unit and has a joystick; sticks go through the radio's SBUS to the autopilot in
STABILIZED, so the ROS side only watches.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from husky_bringup.pilot import Pilot, Sight, Wish
from husky_bringup.propulsion_metrics import attitude_summary, battery_summary
from husky_bringup.run import Run
from husky_bringup.session import RADIO_LOOK, RADIO_PHASE
from husky_bringup.system import ParameterValue
from husky_description.gantry import GantryOptions
from husky_description.graph import TICK_PERIOD
from husky_description.robot import Robot

GANTRY = GantryOptions(height=2.6, rope=1.6)
"""Beam and ropes: the unit hangs with its base 0.89 m above the ground, and has 0.6 m of air to
either side before a rope is taut when it flies 0.3 m higher."""
_GRAVITY = 9.81
_FLYING = 0.3
"""Height of flight above hanging [m]."""
_STEP = math.radians(5.0)
_STEP_TIME = 0.7
"""Of a step in roll or pitch [rad, s]; three of them, 1, -2, 1, come back to where they began."""
_TURN = math.radians(45.0)
_TURN_RATE = math.radians(25.0)
_TOO_FAR = math.radians(2.5)
"""Roll that the operator holds until a rope is taut, and after that [rad]."""
_TOO_FAR_TIME = 4.0
_AGAINST_ROPE = 0.5


class Flown(Protocol):
    """What the operator needs of a session."""

    time: float
    truth: Any
    fans: Any

    def joystick(self, axes: list[float], buttons: list[int]) -> None:
        """Move the sticks."""

    def advance(self, duration: float) -> bool:
        """Let time pass."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the length of the holds and the seed."""
    parser.add_argument("--hold", type=float, default=4.0, help="hovering between passages [s]")
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def run(run: Run) -> None:
    """Attitude within 1.5 deg, worse at a taut rope; battery as its resistance says."""
    options, robot = run.options, run.robot()
    settings: dict[str, dict[str, ParameterValue]] = {
        "plant": {
            "seed": options.seed,
            "body": "unit",
            "keyframe": "stand",
            "gantry": True,
            "gantry_height": GANTRY.height,
            "rope_length": GANTRY.rope,
            "start_height": hanging_height() - standing_height(robot),
        },
        "flight_controller": {"seed": options.seed},
    }
    with run.session(settings, expected=34.0 + 2 * options.hold, remote=True) as session:
        flight = Flight(session, Pilot(weight_share(robot)))
        fly_script(flight, options.hold)
        run.metrics["trajectory_sha256"] = session.trajectory_sha256
        run.metrics["failsafe"] = session.propulsion.failsafe if session.propulsion else "silent"
        disarmed = session.propulsion is not None and not session.propulsion.armed
    for name, (start, end) in flight.passages.items():
        run.say(f"{name}: {start:.2f} s to {end:.2f} s")
    recording, passages = run.recording(), flight.passages
    start, end = passages["armed"][0], passages["spool_down"][1]
    run.metrics |= attitude_summary(recording, start, end)
    hold = passages["hold"]
    run.metrics |= battery_summary(recording, robot, (start - 2.0, start), (hold[1] - 2.0, hold[1]))
    metrics = run.metrics
    run.require("disarmed_at_the_end", int(disarmed), lower=1)
    run.require("attitude_rms_deg", metrics["attitude_rms_deg"], upper=1.5)
    run.require("attitude_measured_rms_deg", metrics["attitude_measured_rms_deg"], upper=1.5)
    run.require(
        "attitude_rms_taut_deg",
        metrics.get("attitude_rms_taut_deg", math.nan),
        lower=metrics["attitude_rms_deg"],
    )
    run.require("current_rise_a", metrics["current_rise_a"], lower=0.0)
    run.require("voltage_drop_v", metrics["voltage_drop_v"], lower=0.0)
    run.require("voltage_drop_ratio", metrics["voltage_drop_ratio"], lower=0.95, upper=1.05)
    run.require(
        "resistance_ratio",
        metrics["resistance_measured_mohm"] / metrics["resistance_mohm"],
        lower=0.95,
        upper=1.05,
    )
    run.illustrate()


def standing_height(robot: Robot) -> float:
    """Return the height of the unit's base above the ground when it stands on it [m]."""
    return robot.fans.height / 2 - robot.fans.z


def weight_share(robot: Robot) -> float:
    """Return the share of full thrust that carries the unit."""
    return robot.payload_mass * _GRAVITY / (4 * robot.fans.max_thrust)


def hanging_height(gantry: GantryOptions = GANTRY) -> float:
    """Return the height of the base above the ground when it hangs in the ropes [m]."""
    y, z = gantry.attachment
    return gantry.height - math.sqrt(gantry.rope**2 - (gantry.span / 2 - y) ** 2) - z


class Flight:
    """An operator and what is flown.

    Attributes:
        passages: name, start and end [s] of what has been flown.
    """

    def __init__(self, session: Flown, pilot: Pilot):
        """Begin."""
        self.passages: dict[str, tuple[float, float]] = {}
        self._session = session
        self.pilot = pilot

    def see(self) -> Sight:
        """Look at the unit."""
        odometry = self._session.truth
        if odometry is None:
            return Sight(self.pilot.place, np.zeros(3), 0.0)
        p, q = odometry.pose.pose.position, odometry.pose.pose.orientation
        v = odometry.twist.twist.linear
        turn = Rotation.from_quat((q.x, q.y, q.z, q.w))
        yaw = turn.as_euler("ZYX")[0]
        return Sight(np.array((p.x, p.y, p.z)), turn.apply((v.x, v.y, v.z)), float(yaw))

    def fly(
        self,
        duration: float,
        wish: Wish | Callable[[float], Wish] | None = None,
        *,
        name: str = "",
        until: Callable[[], bool] | None = None,
    ) -> None:
        """Fly for a while [s], or until something is seen.

        Args:
            duration: at most so long [s].
            wish: what is wanted, or a function of the time since now [s]; by default to hover.
            name: of the passage.
            until: ends it.
        """
        self._wait_for_radio()
        start = self._session.time
        while (past := self._session.time - start) < duration - 1e-6:
            now = wish(past) if callable(wish) else wish or Wish()
            self.pilot.move(self.see(), now, RADIO_LOOK)
            self._session.joystick(*self.pilot.joy())
            self._session.advance(RADIO_LOOK)
            if until is not None and until():
                break
        if name:
            self.passages[name] = (start, self._session.time)

    def _wait_for_radio(self) -> None:
        """Let time pass until sticks act at the same tick in every run."""
        now, look, phase = (
            round(time / TICK_PERIOD) for time in (self._session.time, RADIO_LOOK, RADIO_PHASE)
        )
        if ticks := (phase - now) % look:
            self._session.advance(ticks * TICK_PERIOD)

    def rope_taut(self) -> bool:
        """Return whether a rope is seen to be taut."""
        return self._session.fans is not None and any(self._session.fans.rope_taut)


def fly_script(flight: Flight, hold: float) -> None:
    """Spool up, hover, steps in roll, pitch and yaw, too far, spool down.

    Args:
        flight: that has not begun.
        hold: hovering between passages [s].
    """
    pilot, none = flight.pilot, Wish(roll=0.0, pitch=0.0, throttle=0.0)
    hanging = hanging_height()
    pilot.place = np.array((0.0, 0.0, hanging + _FLYING))
    flight.fly(3.0, none, name="before")
    pilot.armed = True
    flight.fly(2.0, none, name="armed")
    flight.fly(4.0, name="spool_up")
    flight.fly(hold, name="hold")
    flight.fly(4 * _STEP_TIME, lambda past: Wish(roll=steps(past)), name="roll")
    flight.fly(hold / 2)
    flight.fly(4 * _STEP_TIME, lambda past: Wish(pitch=steps(past)), name="pitch")
    flight.fly(hold / 2)
    for name, side in (("yaw_left", 1.0), ("yaw_right", -1.0)):
        flight.fly(_TURN / _TURN_RATE, Wish(yaw_rate=side * _TURN_RATE), name=name)
        flight.fly(hold / 2)
    too_far = Wish(roll=_TOO_FAR)
    flight.fly(_TOO_FAR_TIME, too_far, name="too_far", until=flight.rope_taut)
    flight.fly(_AGAINST_ROPE, too_far, name="against_rope")
    flight.fly(hold, name="back")
    pilot.place = np.array((0.0, 0.0, hanging - 0.03))
    flight.fly(4.0, name="descent", until=flight.rope_taut)
    flight.fly(2.0, none, name="spool_down")
    pilot.armed = False
    flight.fly(1.0, none, name="disarmed")


def steps(past: float) -> float:
    """Return the tilt of the steps [rad]: one way, twice the other way, and back.

    Args:
        past: since their beginning [s].
    """
    return (1.0, -1.0, -1.0, 1.0)[min(int(past / _STEP_TIME + 1e-6), 3)] * _STEP
