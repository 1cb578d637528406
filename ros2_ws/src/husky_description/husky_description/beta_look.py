"""What a person recognises Husky-beta by: its body, its servos and the propellers at its knees.

Shapes in the links' frames, as in `look`; sizes of mere decoration stand here.
"""

import math

from husky_description.robot import Robot
from husky_description.shapes import ALONG_X, Shape, ball, box, disc, moved

SERVO = (0.0335, 0.044, 0.0585)
"""Case of a DYNAMIXEL XM540 [m]: width, depth with the horn's side, height."""


def body_look(robot: Robot) -> list[Shape]:
    """Frame with four hip servos, the battery, and the electronics on two vertical plates."""
    length, width, height = robot.torso.size
    shapes = []
    for y in (-1.0, 1.0):
        shapes.append(
            box("carbon", (0, y * (width / 2 - 0.002), 0), (length - 0.06, 0.003, height))
        )
    for hip in robot.hip_position:
        fore = math.copysign(1.0, hip[0])
        middle = hip[0] - fore * 0.050
        shapes.append(box("printed", (middle, hip[1], 0), (SERVO[1], SERVO[2], SERVO[0])))
        shapes.append(box("label", (middle, hip[1], SERVO[0] / 2), (0.020, 0.020, 0.001)))
        shapes.append(disc("aluminium", (hip[0] - fore * 0.025, hip[1], 0), 0.011, 0.006, ALONG_X))
    for fore in (-1.0, 1.0):
        x = fore * (robot.leg.hip_x - 0.045)
        shapes.append(box("printed", (x, 0, 0), (0.026, width + 0.03, 0.010)))
    shapes.append(box("red", robot.cargo_center, robot.payload.size))
    shapes.append(box("label", robot.cargo_center, (0.050, 0.035, 0.020)))
    return [*shapes, *_plates(robot)]


def _plates(robot: Robot) -> list[Shape]:
    """Computer left, converters right, speed controllers on both sides, autopilot on top."""
    length, _, height = robot.rack.size
    low = -robot.rack.position[2]
    shapes = []
    for y in (-0.006, 0.006):
        shapes.append(box("carbon", (0, y, low / 4), (length, 0.002, height + abs(low) / 2)))
    shapes += [
        box("board", (0.035, 0.0100, 0.005), (0.080, 0.004, 0.075)),
        box("aluminium", (0.035, 0.0185, 0.005), (0.048, 0.013, 0.040)),
        box("board", (0.035, -0.0100, 0.005), (0.075, 0.004, 0.055)),
        box("rubber", (0.020, -0.0170, 0.005), (0.022, 0.010, 0.030)),
        box("rubber", (0.052, -0.0170, 0.005), (0.022, 0.010, 0.030)),
    ]
    for y in (-0.011, 0.011):
        for z in (-0.020, 0.018):
            shapes.append(box("red", (-0.065, y, z), (0.045, 0.008, 0.022)))
    top = height / 2 - 0.010
    shapes.append(box("printed", (-0.01, 0, top), (0.053, 0.038, 0.013)))
    shapes.append(box("label", (-0.01, 0, top + 0.007), (0.030, 0.025, 0.001)))
    return moved(shapes, robot.rack.position)


def servo_hip_look(robot: Robot, leg: int) -> list[Shape]:
    """Bracket on the frontal axis, in it the sagittal servo and, behind, that of the knee."""
    side, plane = float(robot.side[leg]), float(robot.lateral_offset[leg])
    inner = plane - side * (SERVO[1] / 2 + 0.010)
    knee = (-SERVO[0] - 0.002, inner, 0.010)
    return [
        disc("aluminium", (0, 0, 0), 0.012, 0.040, ALONG_X),
        box("printed", (0, side * 0.010, 0), (0.030, 0.020, 0.026)),
        box("printed", (0, inner, 0.010), SERVO),
        box("printed", knee, SERVO),
        box("label", (0, inner, 0.010 + SERVO[2] / 2), (0.022, 0.026, 0.001)),
        disc("aluminium", (0, plane - side * 0.007, 0), 0.0145, 0.005),
        disc("aluminium", (knee[0], plane - side * 0.007, 0), 0.0145, 0.005),
    ]


def pod_look(robot: Robot, leg: int) -> list[Shape]:
    """Propeller motor and propeller outside the knee's pins; the origin is the pod's centre."""
    side, pod, propellers = float(robot.side[leg]), robot.knee_pod, robot.propellers
    blades = side * (propellers.offset - pod.offset)
    shapes = [
        disc("aluminium", (0, side * (0.012 - pod.offset), 0), 0.0115, 0.020),
        disc("carbon", (0, side * (0.026 - pod.offset), 0), 0.0190, 0.006),
        disc("aluminium", (0, side * (0.038 - pod.offset), 0), 0.0175, 0.018),
        disc("red", (0, side * (0.050 - pod.offset), 0), 0.0178, 0.006),
        disc("aluminium", (0, blades, 0), 0.0040, 0.018),
        ball("aluminium", (0, blades + side * 0.009, 0), 0.0045),
    ]
    radius, root = propellers.diameter / 2, 0.010
    pitch = float(propellers.spin[leg]) * math.radians(14)
    for along in (-1.0, 1.0):
        middle = along * (root + radius) / 2
        shapes.append(
            box(
                "orange", (middle, blades, 0), (radius - root, 0.0020, 0.022), (along * pitch, 0, 0)
            )
        )
    shapes.append(disc("orange", (0, blades, 0), 0.011, 0.008))
    return shapes
