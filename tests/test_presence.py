"""In which namespace a node is, and what is kept apart by it."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.node import Node

from husky_pu.autopilot.mavlink_ports import default_port
from husky_runtime import graph
from husky_runtime.nodes.presence import default_serial_port, namespace_of

RULE = ("-r", "__ns:=/robot1")


@pytest.mark.parametrize(
    ("arguments", "namespace"),
    [
        ([], "/"),
        (["--ros-args"], "/"),
        (["--ros-args", *RULE], "/robot1"),
        (["--ros-args", "--remap", "__ns:=/fleet/robot1"], "/fleet/robot1"),
        (["--ros-args", "-r", "tested:__ns:=/robot1", "-r", "__ns:=/other"], "/robot1"),
        (["--ros-args", "-r", "plant:__ns:=/robot1", "-r", "__ns:=/other"], "/other"),
        (["--ros-args", *RULE, "-r", "__ns:=/other"], "/robot1"),
        (["--ros-args", "--", *RULE], "/robot1"),
        (["__ns:=/robot1", "__ns:=/other"], "/robot1"),
    ],
)
def test_the_namespace_is_the_one_that_rcl_gives(
    domain: int, arguments: list[str], namespace: str
) -> None:
    context = rclpy.Context()
    rclpy.init(args=["a program", *arguments], context=context, domain_id=domain)
    node = Node("tested", context=context)
    try:
        assert node.get_namespace() == namespace_of(arguments, "tested") == namespace
        wire = default_serial_port(node, "vn200")
        assert wire == graph.serial_port("vn200", domain, namespace)
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)


def test_wires_of_two_robots_are_two() -> None:
    names = ("/", "/robot1", "/robot2", "/fleet/robot1", "/fleet_robot1", "/vn200")
    assert len({graph.serial_port("vn200", 0, name) for name in names}) == len(names)
    assert graph.serial_port("vn200", 7) == "/tmp/husky-7/vn200"
    assert graph.serial_port("vn200", 7, "/fleet/robot1") == "/tmp/husky-7.fleet.robot1/vn200"


def test_ports_of_two_robots_are_two() -> None:
    """In all domains, up to 99 robots by their numbers; none is beyond the range of ports."""
    names = ["/", *(f"/robot{number}" for number in range(1, 100))]
    ports = [default_port(domain, name) for domain in range(233) for name in names]
    assert len(set(ports)) == len(ports)
    assert (default_port(5), default_port(5, "/robot1")) == (18575, 18575 + 233)
    assert default_port(5, "/fleet/husky_02") == default_port(5, "/robot2")
    words = [default_port(232, f"/{word}") for word in ("carbon", "robot123", "robot0", "x" * 99)]
    assert not set(words) & set(ports) and max(words) < 65536


def test_every_name_of_the_graph_is_below_the_namespace() -> None:
    for row in graph.TOPICS:
        assert graph.absolute(row.relative, "/robot1") == f"/robot1{row.name}"
        assert graph.topic(row.relative) is graph.topic(row.name) is row
