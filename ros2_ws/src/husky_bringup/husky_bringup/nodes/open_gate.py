"""A gate as parameters of a node describe it."""

from __future__ import annotations

import errno
from collections.abc import Mapping, Sequence

from rclpy.node import Node

from husky_bringup.web_gate import WebGate
from husky_runtime.nodes.parameters import declare

_PORTS = 10
"""So many are tried, the one that is asked for and those behind it."""


def open_gate(
    node: Node,
    inner_port: int,
    port: int,
    origins: Sequence[str],
    places: Mapping[str, int] = {},
) -> WebGate:
    """Declare the parameters of a gate and open it, at the next free port where another one has the
    one that is asked for.

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
    what = "to listen on, or the next free one; 0 for any that is free"
    port = declare(node, "port", port, what, 0, 65535)
    token = declare(node, "token", "", "that clients show; empty for one made at the start")
    what = "pages that may connect, as https://host; file:// are installed programs"
    origins = declare(node, "origins", list(origins), what)
    most = declare(node, "connections", 32, "at once", 1, 1000)
    last = port if port == 0 else min(port + _PORTS - 1, 65535)
    for each in range(port, last + 1):
        try:
            gate = WebGate(
                host, each, inner_port, places=places, token=token, origins=origins, most=most
            )
        except OSError as error:
            if error.errno != errno.EADDRINUSE or each == last:
                raise
        else:
            if each != port:
                node.get_logger().info(f"port {port} is taken: listening on {each}")
            return gate
    raise AssertionError("the last one is returned or raises")
