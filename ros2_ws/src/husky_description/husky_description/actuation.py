"""What the robots differ in: the sections that only one kind of actuation has."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Generic, TypeVar, overload

from husky_description import sections
from husky_description.bus_servo import BusServoSection
from husky_description.propellers import KneePodSection, PropellersSection

Section = TypeVar("Section")


class AbsentSection(ValueError):
    """A section was asked for that this robot's kind of actuation does not have."""


class OwnSection(Generic[Section]):
    """A section that only some robots have, read as an attribute of the robot.

    Reading it from a robot without it raises `AbsentSection`, which names the robot, the section
    and those that it has instead.
    """

    def __init__(self, kind: type[Section]) -> None:
        """Make the attribute for a section of this kind."""
        self.kind = kind

    def __set_name__(self, owner: type[Any], name: str) -> None:
        """Remember under which key of the parameter file the section stands."""
        self.name = name

    @overload
    def __get__(self, robot: None, owner: type[Any]) -> OwnSection[Section]: ...
    @overload
    def __get__(self, robot: OwnSections, owner: type[Any]) -> Section: ...
    def __get__(self, robot: OwnSections | None, owner: type[Any]) -> OwnSection[Section] | Section:
        """Return the section of a robot.

        Raises:
            AbsentSection: it has none.
        """
        if robot is None:
            return self
        section = robot.own_sections.get(self.name)
        if section is None:
            raise AbsentSection(
                f"{robot.name} has no section {self.name!r}: with actuation {robot.actuation!r} "
                f"it has {', '.join(robot.own_sections)}"
            )
        found: Section = section
        return found


class OwnSections:
    """Base of the robot: what every kind of actuation must tell of itself."""

    name: str
    actuation: str
    own_sections: Mapping[str, Any]


class DriveSections(OwnSections):
    """Electric drives with gears in the legs, ducted fans on the body."""

    motor = OwnSection(sections.MotorSection)
    gear = OwnSection(sections.GearSection)
    encoder = OwnSection(sections.EncoderSection)
    drive = OwnSection(sections.DriveSection)
    fans = OwnSection(sections.FansSection)
    gimbal = OwnSection(sections.GimbalSection)


class ServoSections(OwnSections):
    """Bus servos in the legs, a propeller at each knee."""

    bus_servo = OwnSection(BusServoSection)
    knee_pod = OwnSection(KneePodSection)
    propellers = OwnSection(PropellersSection)


DRIVES, BUS_SERVOS = "drives", "bus_servos"
OWN_SECTIONS: Mapping[str, Mapping[str, type[Any]]] = {
    actuation: {key: own.kind for key, own in vars(kind).items() if isinstance(own, OwnSection)}
    for actuation, kind in ((DRIVES, DriveSections), (BUS_SERVOS, ServoSections))
}
"""Sections of a parameter file by the kind of actuation that its key `actuation` names."""
