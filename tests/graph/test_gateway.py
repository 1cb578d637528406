"""The walking robot in the hands of a client of `foxglove_gateway`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from foxglove_client import FoxgloveClient
from gateway_bench import CMD_VEL, GatewayBench
from geometry_msgs.msg import Twist
from rclpy.serialization import serialize_message
from seen_robot import STOP_TIME

from husky_runtime import graph

pytestmark = pytest.mark.graph

EMERGENCY_STOP = graph.absolute(graph.DRIVES_EMERGENCY_STOP)
WAKES = f"/{graph.LOW_LEVEL_CONTROLLER}.walk_on_command"


class Gateway(GatewayBench):
    """The process beside the robot."""

    def set(self, client: FoxgloveClient, name: str, value: Any) -> None:
        """Set a parameter of the robot."""
        done = client.set_parameter(name, value)
        self.wait(lambda: done in client.answered, name)
        assert not client.statuses, client.statuses


@pytest.fixture(scope="module")
def gateway(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Gateway]:
    gateway = Gateway(domain, tmp_path_factory.mktemp("gateway"))
    gateway.serve()
    yield gateway
    gateway.close()


@pytest.mark.slow
def test_a_client_that_is_lost_drives_no_longer(standing: Any, gateway: Gateway) -> None:
    client = gateway.client(EMERGENCY_STOP)
    gateway.set(client, WAKES, True)
    try:
        client.advertise(CMD_VEL, "geometry_msgs/msg/Twist")
        twist = Twist()
        twist.linear.x = 0.3

        def walks() -> bool:
            client.publish(serialize_message(twist))
            state = standing.session.state
            return bool(standing.mode == "walk" and state.commanded_velocity[0] > 0.29)

        standing.until(walks, "walk", within=20.0, step=0.1)
        client.break_off()
        standing.until(lambda: standing.mode == "stand", "stand", within=4.0)
        assert list(standing.session.state.commanded_velocity) == [0.0, 0.0, 0.0]
    finally:
        gateway.set(gateway.client(EMERGENCY_STOP), WAKES, False)


# The process alone: `test_foxglove_gateway_strain.py`; a stop beside a client that does not read,
# in the graph: test_console.
@pytest.mark.slow
def test_an_emergency_stop_beside_a_client_that_does_not_read(
    trotting: Any, gateway: Gateway, record_property: Any
) -> None:
    """The stop begins within 0.1 s of simulated time; the world waits for nobody meanwhile."""
    stalled, client = gateway.client(EMERGENCY_STOP), gateway.client(EMERGENCY_STOP)
    heard = client.subscribe(graph.absolute(graph.TF))
    stalled.subscribe(graph.absolute(graph.TF))
    with stalled.held():
        trotting.until(lambda: bool(heard), "a transform at the client", within=20.0, step=0.1)
        stopped = trotting.watch()
        call = client.call(EMERGENCY_STOP)
        with trotting.beside(gateway.process):
            trotting.advance(0.9)
        gateway.wait(lambda: call in client.answers, "the answer")
        record_property("reaction_s", trotting.put_down(stopped, within=STOP_TIME + 0.1))
    drives = trotting.session.drives
    assert drives.emergency_stop and trotting.mode == "damping", trotting.seen
    trotting.session.set_mode("passive")
    trotting.recover()
