"""A depth camera that fails while the robot trots and maps the ground."""

from __future__ import annotations

from typing import NamedTuple

import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from seen_robot import Robot

from husky_description.robot import load_robot
from husky_runtime import graph

pytestmark = pytest.mark.graph

FIGURES = load_robot().d435
PERIOD = 0.1
"""Of the images [s]."""
FROZEN = 0.5
"""Without images, after which the driver has said so [s]. The last image is older than the fault,
by the latency of 0.05 s at least."""
OLD = 1.0
"""The same of the mapper [s]."""
KNOWN = 1000
"""Cells that the trotting robot has seen at least, and points of an image in cells."""

NODES = graph.D435_DRIVER, graph.ELEVATION_MAPPER
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
STREAMING, MAPPING = (OK, "streaming"), (OK, "mapping")
"""Level and text of a report."""
Counters = dict[str, int]


class Counted(NamedTuple):
    """Counters of the camera's driver and of the mapper, while the world stands still."""

    camera: Counters
    ground: Counters


class Sight:
    """Depth camera and map of a trotting robot, as their nodes report them.

    Attributes:
        before: counters of before the fault.
    """

    def __init__(self, robot: Robot):
        """Begin with a mapper that has all images that were published."""
        self.robot, self.session = robot, robot.session
        self.before = self.counters()

    def counters(self) -> Counted:
        """Return the counters of the next report of each node."""
        reports = self.robot.reports
        for node in NODES:
            reports.pop(node, None)
        self.session.wait_for(lambda: reports.keys() >= set(NODES), "reports of both nodes")
        camera, ground = (reports[node].values for node in NODES)
        return Counted(_numbers(camera), _numbers(ground))

    def reported(self, camera: tuple[bytes, str], ground: tuple[bytes, str]) -> Counted:
        """Return the counters once driver and mapper report these states.

        Each image that has been published meanwhile is in the map then, and the robot trots.
        """
        reports, before = self.robot.reports, self.before
        counted = before

        def is_so() -> bool:
            nonlocal counted
            counted = self.counters()
            texts = (camera[1], ground[1])
            published = counted.camera["good"] - before.camera["good"]
            return published == counted.ground["images"] - before.ground["images"] and all(
                text in reports[node].message for text, node in zip(texts, NODES, strict=True)
            )

        self.session.wait_for(is_so, f"{camera[1]}, {ground[1]}, and all images in the map")
        levels = tuple(reports[node].level for node in NODES)
        assert levels == (camera[0], ground[0]), self.robot.seen
        assert self.robot.trots, self.robot.seen
        return counted

    def inject(self, fault: str) -> None:
        """Start a fault."""
        self.session.inject(graph.PLANT_INJECT_FAULT, "d435", fault)

    def recovers(self) -> Counted:
        """Heal the camera; return the counters when its next image is in the map."""
        self.inject("")
        if "no device" in self.robot.reports[graph.D435_DRIVER].message:
            self.robot.reported(graph.D435_DRIVER, "waiting for the first frame")
        self.session.advance(PERIOD)
        return self.reported(STREAMING, MAPPING)


def _numbers(values: list[KeyValue]) -> Counters:
    return {entry.key: int(entry.value) for entry in values if entry.value.isdecimal()}


@pytest.fixture
def sight(seeing_of_module: Robot) -> Sight:
    """Camera and map of a trotting robot, all well."""
    robot = seeing_of_module
    robot.session.inject(graph.PLANT_INJECT_FAULT, "d435", "")
    if not robot.trots:
        robot.start_again()
        robot.stand()
        robot.trot()
    robot.until(
        lambda: robot.reported(graph.ELEVATION_MAPPER, "").message == "mapping",
        "images in the map",
        within=2.0,
        step=PERIOD,
    )
    return Sight(robot)


def test_the_world_began_with_its_camera(sight):
    """The plant has not given up the driver before it listened."""
    assert sight.robot.told(graph.PLANT, "peer_losses") == 0


def test_camera_frozen_and_unplugged(sight):
    """The map is kept and reported as old; feet on the ground still go into it."""
    sight.inject("freeze")
    sight.session.advance(FROZEN)
    sight.reported((WARN, "frozen"), MAPPING)
    sight.inject("unplug")
    sight.session.advance(OLD - FROZEN)
    after = sight.reported((ERROR, "no device"), (WARN, "no depth image for 1."))
    assert after.camera["good"] == sight.before.camera["good"], sight.robot.seen
    assert_kept(sight.before.ground, after.ground)
    assert sight.recovers().camera["good"] == after.camera["good"] + 1, sight.robot.seen


def test_camera_covered(sight):
    """Images without depth are published, and change nothing in the map."""
    sight.inject("cover")
    sight.session.advance(PERIOD)
    after = sight.reported((WARN, "covered"), MAPPING)
    assert after.camera["covered"] == sight.before.camera["covered"] + 1, sight.robot.seen
    pixels = after.ground["used"], after.ground["without_depth"]
    assert pixels == (0, FIGURES.width * FIGURES.height), sight.robot.seen
    assert_kept(sight.before.ground, after.ground)
    assert sight.recovers().ground["used"] > KNOWN, sight.robot.seen


def test_camera_with_damaged_frames(sight):
    """The driver drops and counts them; the images between them go into the map."""
    before, began = sight.before.camera, sight.session.time
    sight.inject("garbage")

    def some_of_both() -> bool:
        now = sight.counters().camera
        return all(now[kind] > before[kind] for kind in ("good", "crc_errors"))

    sight.robot.until(some_of_both, "damaged frames and others", within=2.0, step=2 * PERIOD)
    after = sight.recovers().camera
    images, missed = (after[kind] - before[kind] for kind in ("good", "missed"))
    assert missed >= 1, sight.robot.seen
    assert images + missed == round((sight.session.time - began) * FIGURES.rate), sight.robot.seen


def assert_kept(before: Counters, after: Counters) -> None:
    """Assert that all known cells of the map are known still; footholds may have added some."""
    more = after["known_cells"] - before["known_cells"]
    assert before["known_cells"] > KNOWN
    assert 0 <= more <= after["footholds"] - before["footholds"], f"{more} cells more"
