"""What a person recognises a robot by, as primitive shapes in the links' frames.

What only Husky-beta has stands in `beta_look`.

Sizes of what collides or weighs come from the robot; those of mere decoration stand here.
The legs are drawn as what they are, parallelograms: the upper link (thigh) carries two parallel
rods (calf and rod) that keep the lower link (ankle) parallel to it. Calf, rod and ankle are
frames that follow from the hip sagittal and knee angles, see `parallelogram`.
"""

import math
from dataclasses import dataclass

import numpy as np

from husky_description import beta_look
from husky_description.actuation import BUS_SERVOS
from husky_description.robot import STRUTS_AT_PLATE, Robot
from husky_description.shapes import (
    ALONG_X,
    ALONG_Z,
    Shape,
    ball,
    box,
    disc,
    moved,
    ring,
    rotation_of,
    tube,
)

MATERIALS: dict[str, tuple[float, float, float, float]] = {
    "carbon": (0.115, 0.118, 0.130, 1.0),
    "printed": (0.22, 0.23, 0.25, 1.0),
    "aluminium": (0.62, 0.64, 0.67, 1.0),
    "red": (0.78, 0.06, 0.16, 1.0),
    "board": (0.05, 0.36, 0.18, 1.0),
    "gold": (0.80, 0.62, 0.25, 1.0),
    "rubber": (0.03, 0.03, 0.03, 1.0),
    "label": (0.93, 0.93, 0.90, 1.0),
    "orange": (0.95, 0.45, 0.05, 1.0),
}
"""Colours (red, green, blue, alpha) in [0, 1]."""


@dataclass(frozen=True)
class LegFrame:
    """Frame of a link of the parallelogram: turned as one serial link, displaced along both.

    Attributes:
        name: `thigh`, `calf`, `rod` or `ankle`.
        turns_with: `shin` or `thigh`, the serial link whose orientation it has.
        thigh: Its origin from the hip, along the thigh [m].
        shin: Its origin from there, along the shin [m].
    """

    name: str
    turns_with: str
    thigh: float
    shin: float


def parallelogram(robot: Robot) -> tuple[LegFrame, ...]:
    """Frames of the parallelogram's links, whose origins are its pins."""
    knee, ankle = robot.leg.thigh_link, robot.leg.calf_link
    return (
        LegFrame("thigh", "thigh", 0.0, 0.0),
        LegFrame("calf", "shin", knee, 0.0),
        LegFrame("rod", "shin", knee + robot.leg.rod_offset, 0.0),
        LegFrame("ankle", "thigh", knee, ankle),
    )


def base_look(robot: Robot) -> list[Shape]:
    """Torso, electronics rack, propulsion unit, perch and sensors, in base."""
    if robot.legs_carry_propellers:
        return [*beta_look.body_look(robot), *_perch(robot), *_sensors(robot)]
    return [
        *_torso(robot),
        *_rack(robot),
        *unit_look(robot),
        *_perch(robot),
        *_sensors(robot),
    ]


def _torso(robot: Robot) -> list[Shape]:
    """Two carbon plates, two pairs of pelvis plates, four hip frontal actuators, battery."""
    length, width, height = robot.torso.size
    shapes = []
    for z in (-height / 2 + 0.002, height / 2 - 0.002):
        for y in (-0.031, 0.031):
            shapes.append(box("carbon", (0, y, z), (length + 0.034, 0.020, 0.004)))
        for x in (-0.225, -0.150, -0.075, 0.0, 0.075, 0.150, 0.225):
            shapes.append(box("carbon", (x, 0, z), (0.022, width - 0.008, 0.004)))
    for x in (-0.075, 0.0, 0.075):
        for y in (-0.031, 0.031):
            shapes.append(disc("aluminium", (x, y, 0), 0.004, height - 0.008, ALONG_Z))
    shapes.append(box("red", (0.0, 0.0, -0.022), (0.135, 0.048, 0.050)))
    shapes.append(box("label", (0.0, 0.0, -0.022), (0.060, 0.049, 0.030)))
    for z, stripe in ((0.0285, 0.140), (0.0220, 0.060)):
        for x in (-0.2395, 0.2395):
            shapes.append(box("red", (x, 0, -z), (0.001, stripe, 0.004)))
    for fore in (1, -1):
        for x, pelvis in ((0.163, 0.172), (0.237, 0.140)):
            shapes.append(box("carbon", (fore * x, 0, 0), (0.004, pelvis, 0.088)))
        for hip in robot.hip_position[:2]:
            y = float(hip[1])
            shapes.append(disc("printed", (fore * 0.1445, y, 0), 0.031, 0.033, ALONG_X))
            shapes.append(disc("aluminium", (fore * 0.1265, y, 0), 0.0275, 0.003, ALONG_X))
            shapes.append(disc("printed", (fore * 0.112, y, 0), 0.0245, 0.028, ALONG_X))
            shapes.append(disc("red", (fore * 0.0975, y, 0), 0.019, 0.003, ALONG_X))
            shapes.append(disc("aluminium", (fore * 0.240, y, 0), 0.015, 0.004, ALONG_X))
    return shapes


def _rack(robot: Robot) -> list[Shape]:
    """Twelve drives on both sides of an upright plate; the flight controller on top."""
    length, width, height = robot.rack.size
    side = width / 2
    shapes = [
        box("carbon", (0, 0, 0), (length, 0.004, height)),
        box("carbon", (0, 0, height / 2), (length, width - 0.02, 0.003)),
    ]
    for x in (-length / 2, length / 2):
        shapes.append(box("carbon", (x, 0, 0), (0.004, width - 0.02, height)))
    for x in (-0.085, 0.0, 0.085):
        for z in (-0.028, 0.028):
            for y in (-1.0, 1.0):
                shapes.append(box("board", (x, y * 0.013, z), (0.070, 0.003, 0.047)))
                shapes.append(box("gold", (x, y * 0.0185, z), (0.047, 0.008, 0.035)))
                shapes.append(box("rubber", (x, y * (side - 0.0125), z), (0.041, 0.006, 0.029)))
    top = height / 2 + 0.0015
    shapes.append(box("printed", (0, 0, top + 0.008), (0.082, 0.050, 0.016)))
    shapes.append(box("label", (0.012, 0, top + 0.0165), (0.030, 0.036, 0.001)))
    shapes.append(box("red", (-0.022, 0, top + 0.0165), (0.018, 0.050, 0.001)))
    return moved(shapes, robot.rack.position)


def unit_look(robot: Robot) -> list[Shape]:
    """The ducted fans on carbon arms, speed controllers on those that go across."""
    fans = robot.fans
    shapes = []
    for position in robot.fan_position:
        shapes += moved(_fan(robot), position)
    along, across = fans.place.T
    for x in sorted(set(along.tolist())):
        inner = float(across[along == x].max()) - fans.outer_radius
        if inner <= 0.0:
            continue  # one amid the body
        for z in (-0.020, 0.020):
            ends = ((x, -inner, fans.z + z), (x, inner, fans.z + z))
            shapes.append(tube("carbon", *ends, 0.006))
        for y in (-0.066, 0.066):
            shapes.append(box("red", (x, y, fans.z), (0.016, 0.042, 0.030)))
            shapes.append(box("label", (x, y, fans.z), (0.017, 0.020, 0.014)))
    for y in sorted(set(across.tolist())):
        row = along[across == y]
        fore, hind = float(row.max()) - fans.outer_radius, float(row.min()) + fans.outer_radius
        for z in (-0.020, 0.020):
            ends = ((hind, y, fans.z + z), (fore, y, fans.z + z))
            shapes += [tube("carbon", *ends, 0.005)] if fore > hind else []
    return shapes


def _fan(robot: Robot) -> list[Shape]:
    fans = robot.fans
    top, hub = fans.height / 2, 0.38 * fans.inner_radius
    span = fans.inner_radius - hub
    shapes = [
        ring("carbon", (0, 0, 0), fans.inner_radius, fans.outer_radius, fans.height),
        ring("aluminium", (0, 0, top), fans.inner_radius, fans.outer_radius + 0.005, 0.007),
        ring("red", (0, 0, -0.006), fans.outer_radius, fans.outer_radius + 0.001, 0.012),
        disc("printed", (0, 0, -0.010), hub, fans.height - 0.025, ALONG_Z),
        ball("aluminium", (0, 0, top - 0.023), hub),
    ]
    for blade in range(9):
        angle = 2 * math.pi * blade / 9
        middle = hub + span / 2
        place = (middle * math.cos(angle), middle * math.sin(angle), top - 0.020)
        shapes.append(box("printed", place, (span, 0.013, 0.0016), (math.radians(35), 0, angle)))
    for vane in range(4):
        angle = math.pi * (2 * vane + 1) / 4
        place = (middle * math.cos(angle), middle * math.sin(angle), -0.015)
        shapes.append(box("carbon", place, (span, 0.002, 0.030), (0, 0, angle)))
    return shapes


def _perch(robot: Robot) -> list[Shape]:
    """Two skids and what holds them under the lower plate."""
    length, width, height = robot.perch.size
    x, y, z = robot.perch.position
    side = width / 2 - 0.008
    shapes = []
    for sign in (-1, 1):
        shapes.append(
            box("carbon", (x, y + sign * side, z + 0.004), (length, 0.014, height - 0.008))
        )
        shapes.append(
            box("rubber", (x, y + sign * side, z - height / 2 + 0.004), (length, 0.016, 0.008))
        )
    for reach in (-0.5, 0.0, 0.5):
        cross = (x + reach * (length - 0.014), y, z)
        shapes.append(box("carbon", cross, (0.014, width - 0.016, 0.006)))
    plate = -robot.torso.size[2] / 2
    for fore in (-1, 1):
        for sign in (-1, 1):
            foot = (x + fore * (length / 2 - 0.012), y + sign * side, z)
            top = (fore * STRUTS_AT_PLATE[0], sign * STRUTS_AT_PLATE[1], plate)
            shapes.append(tube("carbon", foot, top, 0.0055))
            shapes.append(disc("aluminium", top, 0.009, 0.010, ALONG_Z))
    return shapes


def _sensors(robot: Robot) -> list[Shape]:
    """VN-200 on the torso and T265 at the front, where their frames are; the D435's mount."""
    camera, size = robot.t265.position, robot.t265.size
    front = camera[0] + size[0] / 2
    shapes = [
        box("orange", robot.imu.position, (0.036, 0.033, 0.0095)),
        box("aluminium", robot.imu.position - [0, 0, 0.006], (0.046, 0.066, 0.003)),
        box("rubber", camera, (size[0], size[1] - size[2], size[2])),
        box("carbon", camera - [0.004, 0, 0.018], (0.004, 0.030, 0.036)),
    ]
    for sign in (-1, 1):
        end = camera + [0, sign * (size[1] - size[2]) / 2, 0]
        shapes.append(disc("rubber", end, size[2] / 2, size[0], ALONG_X))
        lens = (front, camera[1] + sign * 0.032, camera[2])
        shapes.append(disc("aluminium", lens, 0.0095, 0.003, ALONG_X))
        shapes.append(disc("rubber", lens, 0.0075, 0.005, ALONG_X))
    return [*shapes, *_camera_mount(robot)]


def _camera_mount(robot: Robot) -> list[Shape]:
    """Post behind the D435, from the torso's near plate to the middle of its case, in base."""
    camera, torso = robot.d435, robot.torso
    x, y, z = camera.center
    behind = np.abs(rotation_of(camera.rpy)[0]) @ camera.size / 2 + 0.004
    plate = torso.position[2] + math.copysign(torso.size[2] / 2, z - torso.position[2])
    return [tube("carbon", (x - behind, y, plate), (x - behind, y, z), 0.005)]


def camera_look(robot: Robot) -> list[Shape]:
    """D435 in the frame of camera_link: case, glass, imagers, projector and colour sensor."""
    camera = robot.d435
    depth, width, height = camera.size
    center = -camera.depth_offset
    front = center[0] + depth / 2
    glass = width - height - 0.002
    shapes = [
        box("aluminium", center, (depth, width - height, height)),
        box("rubber", (front, center[1], center[2]), (0.001, glass, height - 0.006)),
    ]
    for sign in (-1, 1):
        end = center + [0, sign * (width - height) / 2, 0]
        shapes.append(disc("aluminium", end, height / 2, depth, ALONG_X))
        shapes.append(disc("rubber", end + [depth / 2, 0, 0], height / 2 - 0.003, 0.001, ALONG_X))
    for y, radius in (
        (0.0, 0.0045),
        (-camera.baseline, 0.0045),
        (-0.029, 0.0035),
        (0.015, 0.0035),
    ):
        shapes.append(disc("printed", (front, y, center[2]), radius, 0.002, ALONG_X))
        shapes.append(disc("rubber", (front, y, center[2]), radius - 0.0015, 0.003, ALONG_X))
    return shapes


def hip_look(robot: Robot, leg: int) -> list[Shape]:
    """Bracket on the frontal axis; sagittal actuator inside, knee actuator outside the leg."""
    if robot.actuation == BUS_SERVOS:
        return beta_look.servo_hip_look(robot, leg)
    side, plane = float(robot.side[leg]), float(robot.lateral_offset[leg])
    radius, length = robot.leg.hip_radius, robot.leg.hip_length
    can = length / 2 - 0.009
    shapes = [
        disc("aluminium", (0, 0, 0), 0.012, 0.070, ALONG_X),
        box("printed", (0, side * 0.007, 0), (0.062, 0.014, 0.050)),
        box("printed", (0, plane, radius - 0.004), (0.034, length, 0.012)),
    ]
    for inward in (-1, 1):
        middle = plane + inward * side * (0.009 + can / 2)
        end = plane + inward * side * length / 2
        shapes.append(disc("printed", (0, middle, 0), radius, can))
        shapes.append(
            disc("aluminium", (0, plane + inward * side * 0.010, 0), radius + 0.001, 0.003)
        )
        shapes.append(disc("aluminium", (0, end, 0), radius - 0.005, 0.003))
        shapes.append(disc("red", (0, end, 0), 0.020, 0.006))
    return shapes


def propeller_rpy(robot: Robot, leg: int) -> tuple[float, float, float]:
    """Frame of a propeller in its thigh, z along the thrust, as roll, pitch, yaw [rad]."""
    return (-robot.side[leg] * math.pi / 2, 0.0, 0.0)


def knee_pod_look(robot: Robot, leg: int) -> list[Shape]:
    """Knee servo, propeller motor and propeller, in the knee pod's frame."""
    return beta_look.pod_look(robot, leg)


def thigh_look(robot: Robot) -> list[Shape]:
    """Upper link of the parallelogram, with the pins of both rods."""
    knee = robot.leg.thigh_link
    radius = robot.leg.tube_outer_radius
    return [
        disc("aluminium", (0, 0, 0), 0.025, 0.014),
        tube("carbon", (0, 0, -0.015), (0, 0, -knee), radius),
        tube("aluminium", (0, 0, -0.024), (0, 0, -0.036), radius + 0.003),
        *_pins(robot, -knee),
    ]


def calf_look(robot: Robot) -> list[Shape]:
    """Middle link of the parallelogram."""
    length, radius = robot.leg.calf_link, 0.85 * robot.leg.tube_outer_radius
    return [
        tube("carbon", (0, 0, 0), (0, 0, -length), radius),
        tube("aluminium", (0, 0, -0.012), (0, 0, -0.028), radius + 0.002),
        tube("aluminium", (0, 0, -length + 0.012), (0, 0, -length + 0.028), radius + 0.002),
    ]


def rod_look(robot: Robot) -> list[Shape]:
    """The thinner rod parallel to the calf."""
    length = robot.leg.calf_link
    return [
        tube("carbon", (0, 0, 0), (0, 0, -length), 0.0055),
        tube("aluminium", (0, 0, -0.010), (0, 0, -0.024), 0.007),
        tube("aluminium", (0, 0, -length + 0.010), (0, 0, -length + 0.024), 0.007),
    ]


def ankle_look(robot: Robot) -> list[Shape]:
    """Lower link of the parallelogram, with the foot."""
    length, radius = robot.leg.ankle_link, 0.85 * robot.leg.tube_outer_radius
    return [
        *_pins(robot, 0.0),
        tube("carbon", (0, 0, 0), (0, 0, -length), radius),
        tube("red", (0, 0, -length + 0.012), (0, 0, -length + 0.032), radius + 0.002),
        ball("rubber", (0, 0, -length), robot.foot_radius),
    ]


def _pins(robot: Robot, z: float) -> list[Shape]:
    """Block with the pins of both rods; the first pin at height `z` [m] of the link."""
    apart = robot.leg.rod_offset
    return [
        box("printed", (0, 0.0115, z - apart / 2), (0.022, 0.005, apart + 0.022)),
        box("printed", (0, -0.0115, z - apart / 2), (0.022, 0.005, apart + 0.022)),
        box("printed", (0, 0, z - apart / 2), (0.010, 0.024, apart - 0.012)),
        disc("aluminium", (0, 0, z), 0.0065, 0.032),
        disc("aluminium", (0, 0, z - apart), 0.0065, 0.032),
    ]


def serial_thigh_look(robot: Robot) -> list[Shape]:
    """Thigh of the serial equivalent of the leg."""
    length, radius = robot.thigh_length, robot.leg.tube_outer_radius
    return [
        disc("aluminium", (0, 0, 0), 0.025, 0.014),
        tube("carbon", (0, 0, -0.015), (0, 0, -length), radius),
        disc("aluminium", (0, 0, -length), 0.014, 0.024),
    ]


def serial_shin_look(robot: Robot) -> list[Shape]:
    """Shin of the serial equivalent of the leg, with the foot."""
    length, radius = robot.shin_length, robot.leg.tube_outer_radius
    return [
        tube("carbon", (0, 0, 0), (0, 0, -length), radius),
        ball("rubber", (0, 0, -length), robot.foot_radius),
    ]
