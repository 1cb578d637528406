"""Husky Carbon as numbers: names, order, geometry, masses, limits, postures and devices.

Everything comes from `config/carbon.yaml`. Legs, joints and feet keep one order everywhere:
leg 0..3 is front left, front right, hind left, hind right; joint index = 3 * leg + joint with
joint 0 hip frontal (about +x), 1 hip sagittal (+y), 2 knee (+y). Axes are REP-103.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from husky_description import sections
from husky_description.inertia import box_inertia, cylinder_inertia, tube_inertia
from husky_description.parameters import (
    Array,
    check_keys,
    frozen,
    number,
    read_section,
    read_value,
)
from husky_description.share import share_path

LEGS = ("front_left", "front_right", "hind_left", "hind_right")
LEG_JOINTS = ("hip_frontal", "hip_sagittal", "knee")
JOINT_NAMES = tuple(f"{leg}_{joint}" for leg in LEGS for joint in LEG_JOINTS)

_FORE = np.array([1.0, 1.0, -1.0, -1.0])
_SIDE = np.array([1.0, -1.0, 1.0, -1.0])

_SECTIONS: dict[str, type[Any]] = {
    "body": sections.Body,
    "payload": sections.Box,
    "leg": sections.Leg,
    "joints": sections.Joints,
    "contact": sections.Contact,
    "posture": sections.Posture,
    "servo": sections.Servo,
    "motor": sections.Motor,
    "gear": sections.Gear,
    "encoder": sections.Encoder,
    "drive": sections.Drive,
    "imu": sections.Imu,
    "t265": sections.T265,
    "fans": sections.Fans,
    "gimbal": sections.Gimbal,
    "esc": sections.Esc,
    "battery": sections.Battery,
    "perch": sections.Box,
    "torso": sections.Box,
    "rack": sections.Box,
}


@dataclass(frozen=True, eq=False)
class Robot:
    """The robot's numbers, SI and radians; arrays are read-only.

    Attributes:
        name: Name of the robot.
        legs: Leg names (4), in order.
        leg_joints: Joint names of one leg without the leg's name (3).
        joint_names: Joint names (12), in order.
        parameters: The parameter file after overrides, as YAML text, to hand to xacro.

        hip_position: Hips (on the hip frontal axes) in base [m] (4, 3).
        side: +1 for left, -1 for right legs (4,).
        lateral_offset: From the hip frontal axis to the plane of the leg, signed, + left [m] (4,).
        thigh_length, shin_length: Serial equivalent of the parallelogram leg [m].
        foot_radius: [m].
        foot_names: Names of the foot frames (4).

        joint_lower, joint_upper: Joint range [rad] (12,).
        joint_torque_limit: Torque limit of the servo at the joint [N m] (12,).
        joint_velocity_limit: [rad/s] (12,).
        armature: Rotor inertia seen at each joint [kg m^2] (12,).

        mass: Total, with payload [kg].
        base_mass, payload_mass, hip_mass, thigh_mass, shin_mass: [kg], the last three per leg.
        base_inertia, payload_inertia, hip_inertia, thigh_inertia, shin_inertia: Principal
            inertia about the link's centre of mass along its axes [kg m^2] (3,).

        stand_joint_position, sit_joint_position: Named postures [rad] (12,).
        stand_height, sit_height: Base above the foot *centres* in these postures [m].
        fan_position: Fans in base [m] (4, 3), ordered as the legs.
    """

    name: str
    legs: tuple[str, ...]
    leg_joints: tuple[str, ...]
    joint_names: tuple[str, ...]
    parameters: str

    hip_position: Array
    side: Array
    lateral_offset: Array
    thigh_length: float
    shin_length: float
    foot_radius: float
    foot_names: tuple[str, ...]

    joint_lower: Array
    joint_upper: Array
    joint_torque_limit: Array
    joint_velocity_limit: Array
    armature: Array

    mass: float
    base_mass: float
    payload_mass: float
    hip_mass: float
    thigh_mass: float
    shin_mass: float
    base_inertia: Array
    payload_inertia: Array
    hip_inertia: Array
    thigh_inertia: Array
    shin_inertia: Array

    stand_joint_position: Array
    sit_joint_position: Array
    stand_height: float
    sit_height: float
    fan_position: Array

    body: sections.Body
    payload: sections.Box
    leg: sections.Leg
    joints: sections.Joints
    contact: sections.Contact
    posture: sections.Posture
    servo: sections.Servo
    motor: sections.Motor
    gear: sections.Gear
    encoder: sections.Encoder
    drive: sections.Drive
    imu: sections.Imu
    t265: sections.T265
    fans: sections.Fans
    gimbal: sections.Gimbal
    esc: sections.Esc
    battery: sections.Battery
    perch: sections.Box
    torso: sections.Box
    rack: sections.Box

    @property
    def gear_rated_torque(self) -> float:
        """Rated torque of the gear at the joint [N m]."""
        return self.gear.rated_torque

    @property
    def gear_repeated_peak_torque(self) -> float:
        """Repeated peak torque of the gear at the joint [N m]."""
        return self.gear.repeated_peak_torque

    @property
    def gear_momentary_peak_torque(self) -> float:
        """Momentary peak torque of the gear at the joint [N m]."""
        return self.gear.momentary_peak_torque

    @property
    def encoder_counts_per_joint_turn(self) -> float:
        """Encoder counts per turn of a joint; the encoder sits on the motor shaft."""
        return self.encoder.counts_per_motor_turn * self.gear.ratio


def load_robot(path: Path | str | None = None, **overrides: float | str) -> Robot:
    """Read a robot from a parameter file; Husky Carbon by default (made once).

    Args:
        path: A file with the keys of carbon.yaml, or None for carbon.yaml.
        overrides: Values that replace the file's: `payload_mass` [kg] (changes the total mass),
            or a dotted key with `__` for the dot, `servo__kp=150.0`.

    Raises:
        ValueError: A key is unknown or missing or a value is not allowed; names the dotted key,
            the value and the allowed range.
    """
    if path is None and not overrides:
        return _default_robot()
    tree = copy.deepcopy(_read(Path(path) if path is not None else share_path(DEFAULT_FILE)))
    for key, value in overrides.items():
        _override(tree, key, value)
    return make_robot(tree)


DEFAULT_FILE = "config/carbon.yaml"


@lru_cache(maxsize=1)
def _default_robot() -> Robot:
    return make_robot(_read(share_path(DEFAULT_FILE)))


def _read(path: Path) -> dict[str, Any]:
    with path.open(encoding="utf-8") as stream:
        tree = yaml.safe_load(stream)
    if not isinstance(tree, dict):
        raise ValueError(f"{path}: not a mapping of sections")
    return tree


def _override(tree: dict[str, Any], key: str, value: Any) -> None:
    if key == "payload_mass":
        value = read_value(value, number(0.0, 50.0), "payload_mass")
        tree["total_mass"] = _mass_without_payload(tree) + value
        return
    *parents, leaf = key.split("__")
    node: Any = tree
    for parent in parents:
        node = node.get(parent) if isinstance(node, dict) else None
    if not isinstance(node, dict) or leaf not in node:
        raise ValueError(f"{key.replace('__', '.')}: unknown key")
    node[leaf] = value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _mass_without_payload(tree: Mapping[str, Any]) -> float:
    body = read_section(sections.Body, tree.get("body"), "body")
    leg = read_section(sections.Leg, tree.get("leg"), "leg")
    return body.mass + 4.0 * (leg.hip_mass + leg.thigh_mass + leg.shin_mass)


def make_robot(tree: Mapping[str, Any]) -> Robot:
    """Make a robot from the tree of a parameter file; raises ValueError as `load_robot`."""
    check_keys(tree, {"name", "total_mass", *_SECTIONS}, "")
    if not isinstance(tree["name"], str):
        raise ValueError(f"name: {tree['name']!r} is not a string")
    read = {key: read_section(kind, tree[key], key) for key, kind in _SECTIONS.items()}
    leg: sections.Leg = read["leg"]
    joints: sections.Joints = read["joints"]
    _check_together(read)

    bare_mass = _mass_without_payload(tree)
    mass = read_value(tree["total_mass"], number(bare_mass, 100.0), "total_mass")
    thigh_length = leg.thigh_link + leg.ankle_link
    stand_height = read["posture"].stand_height
    perch: sections.Box = read["perch"]
    sit_height = (
        perch.size[2] / 2 - perch.position[2] + read["posture"].perch_clearance - leg.foot_radius
    )
    fans: sections.Fans = read["fans"]
    lower, upper = _joint_range(joints)
    stand = _posture(stand_height, thigh_length, leg.calf_link, "posture.stand_height")
    sit = _posture(sit_height, thigh_length, leg.calf_link, "perch.position[2]")
    for key, posture in (("posture.stand_height", stand), ("perch.position[2]", sit)):
        if np.any(posture < lower) or np.any(posture > upper):
            raise ValueError(f"{key}: its posture {posture[:3]} is outside the joints' range")

    return Robot(
        name=tree["name"],
        legs=LEGS,
        leg_joints=LEG_JOINTS,
        joint_names=JOINT_NAMES,
        parameters=yaml.safe_dump(dict(tree), sort_keys=False),
        hip_position=frozen(np.column_stack((_FORE * leg.hip_x, _SIDE * leg.hip_y, np.zeros(4)))),
        side=frozen(_SIDE),
        lateral_offset=frozen(_SIDE * leg.lateral_offset),
        thigh_length=thigh_length,
        shin_length=leg.calf_link,
        foot_radius=leg.foot_radius,
        foot_names=tuple(f"{name}_foot" for name in LEGS),
        joint_lower=lower,
        joint_upper=upper,
        joint_torque_limit=frozen(np.full(12, read["servo"].torque_limit)),
        joint_velocity_limit=frozen(np.full(12, joints.velocity_limit)),
        armature=frozen(np.full(12, read["motor"].armature)),
        mass=mass,
        base_mass=read["body"].mass,
        payload_mass=mass - bare_mass,
        hip_mass=leg.hip_mass,
        thigh_mass=leg.thigh_mass,
        shin_mass=leg.shin_mass,
        base_inertia=read["body"].inertia,
        payload_inertia=box_inertia(mass - bare_mass, read["payload"].size),
        hip_inertia=cylinder_inertia(leg.hip_mass, leg.hip_radius, leg.hip_length, axis=1),
        thigh_inertia=tube_inertia(
            leg.thigh_mass, leg.tube_inner_radius, leg.tube_outer_radius, thigh_length, axis=2
        ),
        shin_inertia=tube_inertia(
            leg.shin_mass, leg.tube_inner_radius, leg.tube_outer_radius, leg.calf_link, axis=2
        ),
        stand_joint_position=stand,
        sit_joint_position=sit,
        stand_height=stand_height,
        sit_height=float(sit_height),
        fan_position=frozen(np.column_stack((_FORE * fans.x, _SIDE * fans.y, np.full(4, fans.z)))),
        **read,
    )


def _joint_range(joints: sections.Joints) -> tuple[Array, Array]:
    """Lower and upper joint limits [rad] (12,); outward is positive left, negative right."""
    lower, upper = [], []
    for side in _SIDE:
        frontal = sorted((-side * joints.hip_frontal_inward, side * joints.hip_frontal_outward))
        lower += [frontal[0], joints.hip_sagittal[0], joints.knee[0]]
        upper += [frontal[1], joints.hip_sagittal[1], joints.knee[1]]
    return frozen(lower), frozen(upper)


def _posture(height: float, thigh: float, shin: float, key: str) -> Array:
    """Joint angles [rad] (12,) that put each foot straight under its hip, knee bent backward."""
    if not abs(thigh - shin) < height < thigh + shin:
        raise ValueError(
            f"{key}: leaves {height:g} m from hip to foot, allowed range "
            f"({abs(thigh - shin):g}, {thigh + shin:g})"
        )
    sagittal = math.acos((thigh**2 + height**2 - shin**2) / (2 * thigh * height))
    knee = -math.acos((height**2 - thigh**2 - shin**2) / (2 * thigh * shin))
    return frozen(np.tile([0.0, sagittal, knee], 4))


def _check_together(read: Mapping[str, Any]) -> None:
    """Checks that involve more than one number."""
    pairs = (
        ("leg", "tube_inner_radius", "tube_outer_radius"),
        ("fans", "inner_radius", "outer_radius"),
        ("gear", "rated_torque", "repeated_peak_torque"),
        ("gear", "repeated_peak_torque", "momentary_peak_torque"),
        ("gear", "momentary_peak_torque", "ratcheting_torque"),
        ("drive", "continuous_current", "peak_current"),
        ("esc", "pulse_low", "pulse_start"),
    )
    for section, small, large in pairs:
        low, high = getattr(read[section], small), getattr(read[section], large)
        if low > high:
            raise ValueError(f"{section}.{small}: {low:g} is above {section}.{large}, {high:g}")
    for key in ("hip_sagittal", "knee"):
        low, high = getattr(read["joints"], key)
        if low >= high:
            raise ValueError(f"joints.{key}: lower limit {low:g} is not below upper limit {high:g}")
    inertia = read["body"].inertia
    if 2 * inertia.max() > inertia.sum():
        raise ValueError(f"body.inertia: {inertia.tolist()}: one exceeds the sum of the other two")
    fans: sections.Fans = read["fans"]
    if fans.spin.tolist() not in ([1.0, -1.0, -1.0, 1.0], [-1.0, 1.0, 1.0, -1.0]):
        raise ValueError(
            f"fans.spin: {fans.spin.tolist()}: each is 1 or -1, neighbours of opposite sense"
        )
    if not fans.no_load_current < fans.full_current < fans.voltage / fans.resistance:
        raise ValueError(
            f"fans.efficiency: {fans.efficiency:g} asks for {fans.full_current:.1f} A, outside "
            "fans.no_load_current to fans.voltage / fans.resistance"
        )
    if np.any(np.diff(read["battery"].cell_voltage) <= 0.0):
        raise ValueError("battery.cell_voltage: does not rise with the charge")
