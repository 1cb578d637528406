"""A gate as parameters of a node describe it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rclpy.node import Node

from husky_bringup.web_gate import WebGate
from husky_runtime.nodes.parameters import declare


def open_gate(
    node: Node,
    inner_port: int,
    port: int,
    origins: Sequence[str],
    places: Mapping[str, int] = {},
) -> WebGate:
    """Declare the parameters of a gate and open it.

    Args:
        node: that gets the parameters.
        inner_port: where the server is that it guards, on this machine.
        port: to listen on by default.
        origins: pages that may connect by default.
        places: ports of other servers that it guards, by the path below which they are.

    Raises:
        OSError: it cannot listen there.
        ValueError: a parameter has a value that it may not have.
    """
    what = "address to listen on; one that other machines get to asks for a token"
    host = declare(node, "host", "127.0.0.1", what)
    port = declare(node, "port", port, "to listen on, 0 for any that is free", 0, 65535)
    token = declare(node, "token", "", "that clients show; empty for one made at the start")
    what = "pages that may connect, as https://host; file:// are installed programs"
    origins = declare(node, "origins", list(origins), what)
    most = declare(node, "connections", 32, "at once", 1, 1000)
    return WebGate(
        host, port, inner_port, places=places, token=token, origins=origins, most=most
    )
