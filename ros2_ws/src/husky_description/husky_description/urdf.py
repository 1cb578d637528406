"""The robot as a URDF, by xacro; `python -m husky_description.urdf > carbon.urdf` writes it."""

import argparse
import tempfile
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

import xacro

from husky_description import look
from husky_description.robot import ROBOTS, Robot, load_robot
from husky_description.shapes import Shape, without_rings
from husky_description.share import share_path


def build_urdf(robot: Robot, parallelogram: bool = False) -> str:
    """Make the URDF of the robot, fit for /robot_description.

    The root link is `base_link` (REP-105); the torso's inertia is on the link `torso`, fixed to
    it. Then come `<leg>_hip`, `<leg>_thigh`, `<leg>_shin`, `<leg>_foot`, and the frames
    `imu_link`, `t265_link`, `perch` and `<fan>_fan`, or `<leg>_knee_pod` and `<leg>_propeller`;
    of the depth camera, as realsense-ros names them, `camera_link` with its mass,
    `camera_depth_frame` and `camera_depth_optical_frame` (z along the view, x right, y down).
    What weighs and collides comes from urdf/carbon.urdf.xacro, what is seen from
    `husky_description.look`.

    Args:
        robot: The robot.
        parallelogram: Draw the legs as the parallelograms they are, with three massless links
            per leg on joints that mimic the knee, for tools that follow mimic joints (as
            robot_state_publisher and RViz do). Without it the serial equivalent is drawn, and
            the joints are exactly the twelve of the robot.
    """
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder) / "config.yaml"
        config.write_text(robot.parameters, encoding="utf-8")
        document = xacro.process_file(
            str(share_path("urdf/carbon.urdf.xacro")),
            mappings={"config": str(config), "parallelogram": str(parallelogram).lower()},
        )
    root = ElementTree.fromstring(document.documentElement.toxml())
    root.set("name", robot.name)
    for name, rgba in reversed(look.MATERIALS.items()):
        material = ElementTree.Element("material", name=name)
        ElementTree.SubElement(material, "color", rgba=_text(rgba))
        root.insert(0, material)
    links = {link.get("name"): link for link in root.iter("link")}
    for name, shapes in _look_of_links(robot, parallelogram).items():
        for shape in without_rings(shapes):
            links[name].append(_visual(shape))
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _look_of_links(robot: Robot, parallelogram: bool) -> dict[str, list[Shape]]:
    shapes = {"torso": look.base_look(robot), "camera_link": look.camera_look(robot)}
    for index, leg in enumerate(robot.legs):
        shapes[f"{leg}_hip"] = look.hip_look(robot, index)
        if robot.legs_carry_propellers:
            shapes[f"{leg}_knee_pod"] = look.knee_pod_look(robot, index)
        if parallelogram:
            shapes[f"{leg}_thigh"] = look.thigh_look(robot)
            shapes[f"{leg}_calf"] = look.calf_look(robot)
            shapes[f"{leg}_rod"] = look.rod_look(robot)
            shapes[f"{leg}_ankle"] = look.ankle_look(robot)
        else:
            shapes[f"{leg}_thigh"] = look.serial_thigh_look(robot)
            shapes[f"{leg}_shin"] = look.serial_shin_look(robot)
    return shapes


def _visual(shape: Shape) -> ElementTree.Element:
    visual = ElementTree.Element("visual")
    ElementTree.SubElement(visual, "origin", xyz=_text(shape.position), rpy=_text(shape.rpy))
    geometry = ElementTree.SubElement(visual, "geometry")
    if shape.kind == "box":
        ElementTree.SubElement(geometry, "box", size=_text(shape.size))
    elif shape.kind == "cylinder":
        radius, length = shape.size
        ElementTree.SubElement(geometry, "cylinder", radius=_text([radius]), length=_text([length]))
    elif shape.kind == "sphere":
        ElementTree.SubElement(geometry, "sphere", radius=_text(shape.size))
    else:
        raise ValueError(f"no URDF geometry for a {shape.kind}")
    ElementTree.SubElement(visual, "material", name=shape.material)
    return visual


def _text(values: Iterable[float]) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def main() -> None:
    """Write the URDF to standard output."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--config", help=f"parameter file, or one of {', '.join(ROBOTS)}")
    parser.add_argument("--payload-mass", type=float, help="payload [kg]")
    parser.add_argument("--parallelogram", action="store_true", help="draw the parallelograms")
    arguments = parser.parse_args()
    overrides = {}
    if arguments.payload_mass is not None:
        overrides["payload_mass"] = arguments.payload_mass
    print(build_urdf(load_robot(arguments.config, **overrides), arguments.parallelogram), end="")


if __name__ == "__main__":
    main()
