"""Where a gate listens: at the port that is asked for, or the next one that is free."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.context import Context
from rclpy.node import Node

from husky_bringup.nodes import open_gate as module
from husky_bringup.nodes.open_gate import open_gate


@pytest.fixture
def node() -> Iterator[Node]:
    """A node with no parameters."""
    context = Context()
    rclpy.init(context=context, domain_id=103)  # in which nothing of ours is
    node = Node("gate", context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_the_next_free_port_is_taken(node: Node, capfd: pytest.CaptureFixture[str]) -> None:
    """As for the console of a second robot."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        gate = open_gate(node, 1, port, ())
    try:
        assert port < gate.port < port + 10
        assert f"port {port} is taken: listening on {gate.port}" in capfd.readouterr().err
    finally:
        gate.close()


def test_where_none_is_free_the_error_is_told(node: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_PORTS", 1)
    with (
        socket.create_server(("127.0.0.1", 0)) as taken,
        pytest.raises(OSError, match="in use"),
    ):
        open_gate(node, 1, taken.getsockname()[1], ())
