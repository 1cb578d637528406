"""The light frame bends under load (T6): three springs between the body and each hip.

Two carbon fibre plates, one above the hip drives and one below, hold Husky Carbon's hips. Such a
pair of plates bends like a parallel flexure: a hip under load shifts, and hardly turns. So each
hip has a slide joint with stiffness and damping along every axis of base; the same for the printed
parts that hold Husky-beta's arms. The three axes are alike, since no source tells them apart.
Neither the drives nor the controller measure how far a hip has shifted.
"""

from __future__ import annotations

import math

from husky_description.plain_mujoco import mujoco
from husky_description.robot import Robot

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
"""Of base, along which a hip shifts: joints `<leg>_frame_<axis>`, outside of the hip frontal."""


def loaded_mass(robot: Robot) -> float:
    """Return the mass that the springs of one hip carry when the robot stands on four legs [kg]."""
    leg = robot.hip_mass + robot.thigh_mass + robot.shin_mass + robot.knee_mass
    return robot.mass / 4.0 - leg


def stiffness(robot: Robot) -> float:
    """Return the stiffness of each spring [N/m].

    With it the body swings at `frame.frequency` on its four standing legs, when joints are blocked
    and feet held; it sinks by g / (2 pi f)^2. Drives and ground give way besides.
    """
    return loaded_mass(robot) * (2.0 * math.pi * robot.frame.frequency) ** 2


def damping(robot: Robot) -> float:
    """Return the damping of each spring [N s/m], by `frame.damping_ratio` of the same mode."""
    rate = 2.0 * math.pi * robot.frame.frequency
    return 2.0 * robot.frame.damping_ratio * rate * loaded_mass(robot)


def add_springs(hip: mujoco.MjsBody, leg: str, robot: Robot) -> None:
    """Let a hip shift against its springs; to be called before the hip gets its own joint."""
    for name, axis in AXES.items():
        hip.add_joint(
            name=f"{leg}_frame_{name}",
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=axis,
            stiffness=stiffness(robot),
            damping=damping(robot),
            armature=0.0,  # the default class gives every joint a rotor
        )
