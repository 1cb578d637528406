"""What a recording says of a robot that becomes a quadrotor on its perch and a quadruped again.

The ground is level under the whole robot: z = 0 of world, unless a function says how high it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from scipy.spatial.transform import Rotation

from husky_control.gait.stability import static_margin
from husky_description.arrays import Array
from husky_description.gravity import GRAVITY
from husky_description.mujoco_model import build_spec
from husky_description.plain_mujoco import mujoco
from husky_description.robot import Robot
from husky_experiments.metrics import measures
from husky_experiments.recordings.recording import Recording
from husky_experiments.recordings.tables import Base, ControllerStates, JointCommands, Mask

RESTING = 0.002
"""Height of the perch's lowest corner below which it lies on the ground [m]."""
AIRBORNE = 0.01
"""The same above which the robot has lifted off [m]."""
_PATIENCE = 0.05
"""Time for which no leg must feel load, as the controller wants it [s]."""
_MOVING = 1e-5
"""Change of a commanded angle from one tick to the next above which it is on its way [rad]."""

GroundHeight = Callable[[Array], Array]
"""From positions in world [m] (n, 3) to the height of the ground under them [m] (n,)."""


def level_ground(position: Array) -> Array:
    """Return the height of a plane at zero under positions (n, 3), [m] (n,)."""
    return np.zeros(len(position))


def perch_corners(robot: Robot) -> Array:
    """Return the corners of the perch's underside in base [m] (4, 3), around the rectangle."""
    half = robot.perch.size / 2.0
    signs = np.array(((1, 1, -1), (1, -1, -1), (-1, -1, -1), (-1, 1, -1)))
    corners: Array = robot.perch.position + signs * half
    return corners


def perch_in_world(robot: Robot, base: Base) -> Array:
    """Return the corners of the perch's underside in world [m] (n, 4, 3)."""
    turns = Rotation.from_quat(base.orientation).as_matrix()
    corners: Array = base.position[:, None] + np.einsum("nij,kj->nki", turns, perch_corners(robot))
    return corners


def perch_height(robot: Robot, base: Base, ground: GroundHeight = level_ground) -> Array:
    """Return the height of the perch's lowest corner above the ground [m] (n,)."""
    height: Array = perch_in_world(robot, base)[..., 2].min(axis=1) - ground(base.position)
    return height


def center_of_mass(robot: Robot, joint_position: Array) -> Array:
    """Return the centre of mass in base by the joints, [m] (n, 3).

    Args:
        robot: its numbers.
        joint_position: [rad] (n, 12).
    """
    model = build_spec(robot).compile()
    data = mujoco.MjData(model)
    data.qpos[:7] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    base = model.body("base").id
    centers = np.empty((len(joint_position), 3))
    for center, joints in zip(centers, joint_position, strict=True):
        data.qpos[7:] = joints
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        center[:] = data.subtree_com[base]
    return centers


def perch_margins(robot: Robot, base: Base, joint_position: Array) -> Array:
    """Return how far the centre of mass is inside the perch's rectangle, on the ground [m] (n,).

    Args:
        robot: its numbers.
        base: true motion (n rows).
        joint_position: measured, at the same times [rad] (n, 12).
    """
    turns = Rotation.from_quat(base.orientation)
    centers = base.position + turns.apply(center_of_mass(robot, joint_position))
    pairs = zip(centers, perch_in_world(robot, base), strict=True)
    return np.array([static_margin(center, corners) for center, corners in pairs])


@dataclass(frozen=True)
class MorphTimes:
    """When a robot that became a quadrotor, and then a quadruped again, was where [s].

    What did not happen is NaN.
    """

    crouch: float  # the crouch began
    felt: float  # no leg carries load by its motors' currents, as the controller feels it
    touch: float  # a corner of the perch is on the ground
    perched: float  # the feet carry nothing any more
    splay: float  # the legs begin to splay
    armed: float  # the legs are arms and hold still
    quadrotor: float  # the flight was asked for
    lift_off: float  # the perch has left the ground
    landed: float  # it lies on the ground again
    back: float  # the arms begin to become legs
    stand: float  # the robot stands on its legs

    @property
    def spans(self) -> dict[str, float]:
        """Durations by name with unit, ready for JSON."""
        return {
            "perch_touched_s": self.touch - self.crouch,
            "perch_felt_s": self.felt - self.crouch,
            "morph_to_arms_s": self.armed - self.crouch,
            "legs_to_lift_off_s": self.lift_off - self.crouch,
            "flight_s": self.landed - self.lift_off,
            "morph_to_legs_s": self.stand - self.back,
        }


def morph_times(
    recording: Recording, robot: Robot, ground: GroundHeight = level_ground
) -> MorphTimes:
    """Return when a recording of one morph, there and back, passed from step to step."""
    states, base, contacts = recording.controller, recording.base, recording.contacts
    begun = mode_begins(states, "perch")
    crouch, back = begun[0], begun[-1] if len(begun) > 1 else float("nan")
    splay, fly = mode_begins(states, "splay")[0], mode_begins(states, "quadrotor")[0]
    height = perch_height(robot, base, ground)
    load = contacts.force[..., 2].sum(axis=1)
    weight = robot.mass * GRAVITY
    touch = first_time(base.time, height <= 0.0, crouch)
    lift_off = first_time(base.time, height > AIRBORNE, fly)
    return MorphTimes(
        crouch=crouch,
        felt=felt_time(states, crouch),
        touch=touch,
        perched=first_time(contacts.time, load < 0.001 * weight, touch),
        splay=splay,
        armed=still_from(recording.commands.between(splay, fly)),
        quadrotor=fly,
        lift_off=lift_off,
        landed=first_time(base.time, height <= RESTING, lift_off),
        back=back,
        stand=first_time(states.time, states.mode == "stand", back),
    )


def mode_begins(states: ControllerStates, mode: str) -> list[float]:
    """Return when a mode was entered, each time [s]; one NaN when it never was."""
    inside = states.mode == mode
    entered = np.flatnonzero(inside & ~np.concatenate(([False], inside[:-1])))
    return [float(states.time[index]) for index in entered] or [float("nan")]


def first_time(time: Array, holds: Mask, start: float) -> float:
    """Return the first time from a start on at which something holds [s], NaN if it never does."""
    found = np.flatnonzero(holds & (time >= start))
    return float(time[found[0]]) if len(found) else float("nan")


def felt_time(states: ControllerStates, start: float) -> float:
    """Return when the controller began to feel no load on any leg, for `_PATIENCE` [s]; or NaN."""
    empty: Mask = states.contact.sum(axis=1) == 0
    last = np.searchsorted(states.time, states.time + _PATIENCE, "right") - 1
    loaded = np.concatenate(([0], np.cumsum(~empty)))
    lasting = empty & (loaded[last + 1] == loaded[:-1])
    return first_time(states.time, lasting, start)


def still_from(commands: JointCommands) -> float:
    """Return when the commanded joints came to rest for good [s], NaN of no command."""
    if not len(commands):
        return float("nan")
    steps = np.abs(np.diff(commands.position, axis=0)).max(axis=1)
    moving = np.flatnonzero(steps > _MOVING)
    return float(commands.time[moving[-1] + 1 if len(moving) else 0])


@dataclass(frozen=True, eq=False)
class PerchStability:
    """How safely a robot rests on its perch, over time (n rows)."""

    time: Array  # [s] (n,)
    resting: Mask  # the perch lies on the ground (n,)
    margin: Array  # of the centre of mass inside the perch's rectangle [m] (n,)
    tilt: Array  # of the body [rad] (n,)

    def while_resting(self, start: float, end: float) -> tuple[float, float]:
        """Return least margin [m] and greatest tilt [rad] while it rests, between times [s]."""
        chosen = self.resting & (self.time >= start) & (self.time <= end)
        if not chosen.any():
            return float("nan"), float("nan")
        return float(self.margin[chosen].min()), float(self.tilt[chosen].max())


def perch_stability(
    recording: Recording,
    robot: Robot,
    start: float,
    end: float,
    ground: GroundHeight = level_ground,
) -> PerchStability:
    """Return how safely the robot rests on its perch between two times [s]."""
    base, joints = recording.base.between(start, end), recording.joints
    nearest = measures.nearest(joints.time, base.time)
    return PerchStability(
        base.time,
        perch_height(robot, base, ground) <= RESTING,
        perch_margins(robot, base, joints.position[nearest]),
        measures.tilt(base.orientation),
    )


def as_metrics(times: MorphTimes) -> dict[str, float]:
    """Return all times [s] and durations of a morph, by name."""
    at = {f"{item.name}_at_s": getattr(times, item.name) for item in fields(times)}
    return {**at, **times.spans}
