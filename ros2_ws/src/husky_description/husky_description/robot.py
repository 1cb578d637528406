"""A robot as numbers: names, order, geometry, masses, limits, postures and devices.

Everything comes from a file: of `config`, Husky Carbon's or Husky-beta's, or one of a user's own,
which says all but that a robot has four legs of three joints. Legs, joints and feet
keep one order everywhere: leg 0..3 is front left, front right, hind left, hind right; joint index =
3 * leg + joint with joint 0 hip frontal (about +x), 1 hip sagittal (+y), 2 knee (+y). Axes are
REP-103.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import yaml

from husky_description import sections
from husky_description.actuation import OWN_SECTIONS, DriveSections, ServoSections
from husky_description.arrays import Array
from husky_description.parameters import check_keys, frozen, number, read_section, read_value
from husky_description.robot_checks import check_together
from husky_description.robot_numbers import (
    actuators,
    joint_range,
    leg_bodies,
    payload_bodies,
    posture_at,
)
from husky_description.share import share_path

_DEFAULT = "carbon"
ROBOTS = (_DEFAULT, *sorted({f.stem for f in share_path("config").glob("*.yaml")} - {_DEFAULT}))
"""Robots that have a file of their name in `config`; the first is the default."""

LEG_NAMES = ("front_left", "front_right", "hind_left", "hind_right")
LEG_JOINTS = ("hip_frontal", "hip_sagittal", "knee")
JOINT_NAMES = tuple(f"{leg}_{joint}" for leg in LEG_NAMES for joint in LEG_JOINTS)

_FORE = np.array([1.0, 1.0, -1.0, -1.0])
_SIDE = np.array([1.0, -1.0, 1.0, -1.0])

# By libyaml, where PyYAML has it: every node reads a robot as it starts, in 2 ms instead of 16.
_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_Dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


@dataclass(frozen=True, eq=False)
class RobotSections:
    """The sections that every parameter file has, as they were read; more in `actuation`."""

    body: sections.BodySection
    payload: sections.BoxSection
    leg: sections.LegSection
    joints: sections.JointsSection
    contact: sections.ContactSection
    frame: sections.FrameSection
    posture: sections.PostureSection
    size: sections.SizeSection
    servo: sections.ServoSection
    imu: sections.ImuSection
    t265: sections.T265Section
    d435: sections.D435Section
    esc: sections.EscSection
    battery: sections.BatterySection
    perch: sections.BoxSection
    torso: sections.BoxSection
    rack: sections.BoxSection


STRUTS_AT_PLATE = np.array([0.075, 0.031])
"""Where the struts of the perch meet the torso's lower plate, fore and aside of base [m]."""


def sections_of(actuation: str) -> dict[str, type[Any]]:
    """Return the sections of a parameter file by its kind of actuation."""
    return {**get_type_hints(RobotSections), **OWN_SECTIONS[actuation]}


@dataclass(frozen=True, eq=False)
class Robot(RobotSections, DriveSections, ServoSections):
    """The robot's numbers, SI and radians; arrays are read-only.

    Attributes:
        name: Name of the robot.
        actuation: Its kind of actuation, a key of `OWN_SECTIONS`.
        own_sections: The sections that go with it, by key; also attributes of the robot.
        legs: Leg names (4), in order.
        leg_joints: Joint names of one leg without the leg's name (3).
        joint_names: Joint names (12), in order.
        gains: Of the controller, by name, where they differ from its table's.
        gain_ranges: Lower and upper end of those whose range differs, too.
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
        joint_torque_bound: Beyond anything an actuator gives before it breaks [N m].
        armature: Rotor inertia seen at each joint [kg m^2] (12,).

        mass: Total, with payload [kg].
        base_mass, payload_mass, hip_mass, thigh_mass, shin_mass: [kg], the last three per leg.
        camera_mass, cargo_mass: Of the payload, the depth camera and the rest [kg].
        knee_mass: What is fixed to the thigh at the knee, per leg, 0 without [kg].
        payload_center, camera_center, cargo_center: Centres of mass of the payload with its camera,
            of the camera and of the rest, in base [m] (3,).
        base_inertia, camera_inertia, cargo_inertia, hip_inertia, thigh_inertia, shin_inertia:
            Principal inertia about the link's centre of mass along its axes [kg m^2] (3,).

        stand_joint_position, sit_joint_position: Named postures [rad] (12,).
        stand_height, sit_height: Base above the foot *centres* in these postures [m].
    """

    name: str
    actuation: str
    own_sections: Mapping[str, Any]
    legs: tuple[str, ...]
    leg_joints: tuple[str, ...]
    joint_names: tuple[str, ...]
    gains: Mapping[str, float]
    gain_ranges: Mapping[str, tuple[float, float]]
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
    joint_torque_bound: float
    armature: Array

    mass: float
    base_mass: float
    payload_mass: float
    camera_mass: float
    cargo_mass: float
    hip_mass: float
    thigh_mass: float
    shin_mass: float
    knee_mass: float
    payload_center: Array
    camera_center: Array
    cargo_center: Array
    base_inertia: Array
    camera_inertia: Array
    cargo_inertia: Array
    hip_inertia: Array
    thigh_inertia: Array
    shin_inertia: Array

    stand_joint_position: Array
    sit_joint_position: Array
    stand_height: float
    sit_height: float

    @property
    def leg_length(self) -> float:
        """Of a straight leg, from the hip sagittal axis to the foot's centre [m]."""
        return self.thigh_length + self.shin_length

    @property
    def joint_speed(self) -> float:
        """What every joint can do [rad/s]."""
        return float(self.joint_velocity_limit.min())

    @property
    def legs_carry_propellers(self) -> bool:
        """Whether a propeller is at each knee; if not, fans are on the body."""
        return "propellers" in self.own_sections

    @cached_property
    def rotor_names(self) -> tuple[str, ...]:
        """Names of the fans, in the order of the file, or of the propellers: those of the legs."""
        return self.legs if self.legs_carry_propellers else tuple(self.fans.rotors)

    @cached_property
    def fan_position(self) -> Array:
        """Fans in base [m] (n, 3), ordered as `rotor_names`."""
        place = self.fans.place
        return frozen(np.column_stack((place, np.full(len(place), self.fans.z))))

    @cached_property
    def propeller_in_thigh(self) -> Array:
        """Propellers in the thighs' frames [m] (4, 3); they push outward, along their y."""
        offset = _SIDE * self.propellers.offset
        return frozen(np.column_stack((np.zeros(4), offset, np.full(4, -self.leg.thigh_link))))

    @cached_property
    def knee_pod_in_thigh(self) -> Array:
        """Centres of the knee pods in the thighs' frames [m] (4, 3)."""
        offset = _SIDE * self.knee_pod.offset
        return frozen(np.column_stack((np.zeros(4), offset, np.full(4, -self.leg.thigh_link))))

    @cached_property
    def perch_struts(self) -> sections.BoxSection:
        """Return the box in base that the struts between torso and perch fill half way up."""
        plate = self.torso.position - [0.0, 0.0, self.torso.size[2] / 2]
        skids = self.perch.position + [0.0, 0.0, self.perch.size[2] / 2]
        width, depth = (self.perch.size[:2] + 2.0 * STRUTS_AT_PLATE) / 2.0
        height = max(0.001, plate[2] - skids[2])
        position = np.array([skids[0] / 2, skids[1] / 2, (plate[2] + skids[2]) / 2])
        return sections.BoxSection(frozen(position), frozen(np.array([width, depth, height])))

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
    """Read a robot from a parameter file; Husky Carbon by default.

    Args:
        path: A file with the keys of carbon.yaml or beta.yaml, one of `ROBOTS` for its file (made
            once), or None for the first of them. What is neither is refused.
        overrides: Values that replace the file's: `payload_mass` [kg] (changes the total mass),
            or a dotted key with `__` for the dot, `servo__kp=150.0`.

    Raises:
        ValueError: There is no such file; or a key is unknown or missing, or a value is not
            allowed: names the dotted key, the value and the allowed range.
    """
    name = ROBOTS[0] if path is None else path
    if name in ROBOTS and not overrides:
        return _robot_of_name(str(name))
    tree = copy.deepcopy(_read(share_path(f"config/{name}.yaml") if name in ROBOTS else Path(name)))
    for key, value in overrides.items():
        _override(tree, key, value)
    return make_robot(tree)


@lru_cache
def _robot_of_name(name: str) -> Robot:
    return make_robot(_read(share_path(f"config/{name}.yaml")))


def _read(path: Path) -> dict[str, Any]:
    try:
        tree = yaml.load(path.read_text(encoding="utf-8"), _Loader)
    except OSError as error:
        raise ValueError(
            f"robot is {str(path)!r}, it must be one of {', '.join(ROBOTS)} or the path of a file: "
            f"{error.strerror}"
        ) from error
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise ValueError(f"{path}: not YAML: {error}") from error
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
    body = read_section(sections.BodySection, tree.get("body"), "body")
    leg = read_section(sections.LegSection, tree.get("leg"), "leg")
    pod = OWN_SECTIONS.get(tree.get("actuation", ""), {}).get("knee_pod")
    knee = 0.0 if pod is None else read_section(pod, tree.get("knee_pod"), "knee_pod").mass
    return body.mass + 4.0 * (leg.hip_mass + leg.thigh_mass + leg.shin_mass + knee)


def _masses(tree: Mapping[str, Any]) -> tuple[float, float]:
    """Return the total mass and the payload's part of it [kg]."""
    mass = float(read_value(tree["total_mass"], number(0.0, 100.0), "total_mass"))
    bare = _mass_without_payload(tree)
    if mass < bare:
        raise ValueError(
            f"total_mass: {mass} is outside the allowed range [{bare:.3g}, 100]: in it are "
            "body.mass and four times leg.hip_mass, leg.thigh_mass, leg.shin_mass, knee_pod.mass"
        )
    return mass, mass - bare


def make_robot(tree: Mapping[str, Any]) -> Robot:
    """Make a robot from the tree of a parameter file; raises ValueError as `load_robot`."""
    actuation, read = _read_sections(tree)
    leg: sections.LegSection = read["leg"]
    joints: sections.JointsSection = read["joints"]
    check_together(read)

    mass, payload_mass = _masses(tree)
    thigh_length = leg.thigh_link + leg.ankle_link
    stand_height = read["posture"].stand_height
    perch: sections.BoxSection = read["perch"]
    sit_height = (
        perch.size[2] / 2 - perch.position[2] + read["posture"].perch_clearance - leg.foot_radius
    )
    lower, upper = joint_range(joints, _SIDE)
    stand = posture_at(stand_height, thigh_length, leg.calf_link, "posture.stand_height")
    sit = posture_at(sit_height, thigh_length, leg.calf_link, "perch.position[2]")
    for key, posture in (("posture.stand_height", stand), ("perch.position[2]", sit)):
        if np.any(posture < lower) or np.any(posture > upper):
            raise ValueError(f"{key}: its posture {posture[:3]} is outside the joints' range")

    own = {key: read.pop(key) for key in OWN_SECTIONS[actuation]}
    gains = _gains(tree["gains"])
    return Robot(
        name=tree["name"],
        actuation=actuation,
        own_sections=own,
        legs=LEG_NAMES,
        leg_joints=LEG_JOINTS,
        joint_names=JOINT_NAMES,
        gains={name: gain[0] for name, gain in gains.items()},
        gain_ranges={name: (gain[1], gain[2]) for name, gain in gains.items() if gain[1:]},
        parameters=yaml.dump(dict(tree), Dumper=_Dumper, sort_keys=False),
        hip_position=frozen(np.column_stack((_FORE * leg.hip_x, _SIDE * leg.hip_y, np.zeros(4)))),
        side=frozen(_SIDE),
        lateral_offset=frozen(_SIDE * leg.lateral_offset),
        thigh_length=thigh_length,
        shin_length=leg.calf_link,
        foot_radius=leg.foot_radius,
        foot_names=tuple(f"{name}_foot" for name in LEG_NAMES),
        joint_lower=lower,
        joint_upper=upper,
        joint_torque_limit=frozen(np.full(12, read["servo"].torque_limit)),
        joint_velocity_limit=frozen(np.full(12, joints.velocity_limit)),
        **actuators(own),
        mass=mass,
        base_mass=read["body"].mass,
        payload_mass=payload_mass,
        base_inertia=read["body"].inertia,
        **payload_bodies(payload_mass, read["payload"], read["torso"], read["d435"]),
        **leg_bodies(leg),
        stand_joint_position=stand,
        sit_joint_position=sit,
        stand_height=stand_height,
        sit_height=float(sit_height),
        **read,
    )


def _read_sections(tree: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return the kind of actuation and all sections that go with it."""
    actuation = tree.get("actuation", "(missing)")
    if actuation not in OWN_SECTIONS:
        raise ValueError(f"actuation: {actuation!r} is not one of {', '.join(OWN_SECTIONS)}")
    kinds = sections_of(actuation)
    check_keys(tree, {"name", "actuation", "total_mass", "gains", *kinds}, "")
    if not isinstance(tree["name"], str):
        raise ValueError(f"name: {tree['name']!r} is not a string")
    return actuation, {key: read_section(kind, tree[key], key) for key, kind in kinds.items()}


def _gains(values: Any) -> dict[str, tuple[float, ...]]:
    """Read numbers, or numbers with lower and upper end of their ranges, by name."""
    if not isinstance(values, dict):
        raise ValueError(f"gains: {values!r} is not a mapping of names to numbers")
    gains: dict[str, tuple[float, ...]] = {}
    for name, value in values.items():
        key, parts = f"gains.{name}", value if isinstance(value, list) else [value]
        gain = tuple(float(read_value(part, number(-1e6, 1e6), key)) for part in parts)
        if len(gain) not in (1, 3) or (len(gain) == 3 and not gain[1] <= gain[0] <= gain[2]):
            raise ValueError(f"{key}: {value!r} is neither a number nor [number, lower, upper]")
        gains[str(name)] = gain
    return gains
