"""Numbers of a robot that follow from the sections of its file: links, limits, postures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from husky_description import sections
from husky_description.arrays import Array
from husky_description.inertia import box_inertia, cylinder_inertia, tube_inertia
from husky_description.parameters import frozen


def actuators(own: Mapping[str, Any]) -> dict[str, Any]:
    """What the joints' actuators tell of themselves, of either kind."""
    if "bus_servo" in own:
        servo = own["bus_servo"]
        # A servo driven against its voltage at its no-load speed gives twice its stall torque.
        bound, armature, knee = 2.0 * servo.stall_torque, servo.armature, own["knee_pod"].mass
    else:
        bound, armature, knee = own["gear"].ratcheting_torque, own["motor"].armature, 0.0
    return {
        "joint_torque_bound": bound,
        "armature": frozen(np.full(12, armature)),
        "knee_mass": knee,
    }


def leg_bodies(leg: sections.LegSection) -> dict[str, Any]:
    """Masses [kg] and inertias [kg m^2] of a leg's links."""
    inner, outer = leg.tube_inner_radius, leg.tube_outer_radius
    thigh_length = leg.thigh_link + leg.ankle_link
    return {
        "hip_mass": leg.hip_mass,
        "thigh_mass": leg.thigh_mass,
        "shin_mass": leg.shin_mass,
        "hip_inertia": cylinder_inertia(leg.hip_mass, leg.hip_radius, leg.hip_length, axis=1),
        "thigh_inertia": tube_inertia(leg.thigh_mass, inner, outer, thigh_length, axis=2),
        "shin_inertia": tube_inertia(leg.shin_mass, inner, outer, leg.calf_link, axis=2),
    }


def payload_bodies(
    mass: float,
    payload: sections.BoxSection,
    torso: sections.BoxSection,
    camera: sections.D435Section,
) -> dict[str, Any]:
    """Masses [kg], centres in base [m] and inertias [kg m^2] of the payload's two parts.

    The depth camera is a part of the payload; a payload that is lighter is all camera. The rest
    balances it: both together have their centre of mass at the payload's position. But the rest
    stays in the smallest box around payload and torso, else it would be far outside of the robot
    where it is much lighter than the camera.

    Args:
        mass: of the payload with the camera [kg].
        payload: where its centre of mass is to be, and the size of the rest.
        torso: of the robot.
        camera: of the robot.
    """
    camera_mass = min(camera.mass, mass)
    cargo_mass = mass - camera_mass
    both, cargo = camera.center, payload.position
    if cargo_mass > 0.0:
        lower = np.minimum(payload.position - payload.size / 2, torso.position - torso.size / 2)
        upper = np.maximum(payload.position + payload.size / 2, torso.position + torso.size / 2)
        ahead = camera.center - payload.position
        cargo = np.clip(payload.position - camera_mass / cargo_mass * ahead, lower, upper)
        both = (cargo_mass * cargo + camera_mass * camera.center) / mass
    return {
        "camera_mass": camera_mass,
        "cargo_mass": cargo_mass,
        "payload_center": frozen(both),
        "camera_center": camera.center,
        "cargo_center": frozen(cargo),
        "camera_inertia": box_inertia(camera_mass, camera.size),
        "cargo_inertia": box_inertia(cargo_mass, payload.size),
    }


def joint_range(joints: sections.JointsSection, sides: Array) -> tuple[Array, Array]:
    """Lower and upper joint limits [rad] (12,) by the legs' sides, +1 left, -1 right (4,)."""
    lower, upper = [], []
    for side in sides:
        frontal = sorted((-side * joints.hip_frontal_inward, side * joints.hip_frontal_outward))
        lower += [frontal[0], joints.hip_sagittal[0], joints.knee[0]]
        upper += [frontal[1], joints.hip_sagittal[1], joints.knee[1]]
    return frozen(lower), frozen(upper)


def posture_at(height: float, thigh: float, shin: float, key: str) -> Array:
    """Joint angles [rad] (12,) that put each foot straight under its hip, knee bent backward.

    Raises:
        ValueError: the legs do not reach so far, or not so near; names the `key`.
    """
    if not abs(thigh - shin) < height < thigh + shin:
        raise ValueError(
            f"{key}: leaves {height:g} m from hip to foot, allowed range "
            f"({abs(thigh - shin):g}, {thigh + shin:g})"
        )
    sagittal = math.acos((thigh**2 + height**2 - shin**2) / (2 * thigh * height))
    knee = -math.acos((height**2 - thigh**2 - shin**2) / (2 * thigh * shin))
    return frozen(np.tile([0.0, sagittal, knee], 4))
