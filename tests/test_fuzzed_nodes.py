"""Every subscription and service of every node, given whatever their definitions allow.

What such a message does to a walking robot is tested in `graph/test_hostile_legs`; here, that no
callback is surprised by it. `HUSKY_FUZZ=20` takes twenty times as many, others each time.
"""

import contextlib
import importlib
import os
import re

import pytest

pytest.importorskip("rclpy")

import rclpy
from hostile import Anything, genuine
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import serialize_message

from husky_runtime import graph
from husky_runtime.nodes.executor import WaitSetExecutor
from husky_runtime.nodes.message_rules import make_check
from husky_runtime.nodes.service_desk import Deferred

pytestmark = pytest.mark.graph

MORE = int(os.environ.get("HUSKY_FUZZ", "1"))
LIVE = {"time": "realtime"}  # else a request waits for ticks, which nobody makes here
NODES = {
    graph.PLANT: ("husky_sim", "Plant", {"body": "robot_with_unit"}),
    graph.DRIVE_BRIDGE: ("husky_drivers", "DriveBridge", LIVE),
    graph.DRIVE_SEGMENT: ("husky_sim", "DriveSegment", {**LIVE, "interface": "lo"}),
    graph.SERVO_BRIDGE: ("husky_drivers", "ServoBridge", LIVE),
    graph.VN200_DRIVER: ("husky_drivers", "Vn200Driver", {}),
    graph.T265_DRIVER: ("husky_drivers", "T265Driver", {}),
    graph.D435_DRIVER: ("husky_drivers", "D435Driver", {}),
    graph.ELEVATION_MAPPER: ("husky_navigation", "ElevationMapper", {}),
    graph.LOCALIZER: ("husky_navigation", "Localizer", {}),
    graph.LOW_LEVEL_CONTROLLER: (
        "husky_control",
        "LowLevelController",
        {**LIVE, "propulsion": True},
    ),
    graph.PLANNER: ("husky_control", "PlannerNode", {"keep": False, "compile": False}),
    graph.FLIGHT_CONTROLLER: ("husky_pu", "FlightController", LIVE),
    graph.PIXHAWK_BRIDGE: ("husky_pu", "PixhawkBridge", LIVE),
    graph.RC_TRANSMITTER: ("husky_pu", "RcTransmitter", {}),
    graph.TELEOP: ("husky_bringup", "Teleop", {}),
    graph.CONSOLE: ("husky_bringup", "Console", {"port": 0}),
    graph.FOXGLOVE_GATEWAY: ("husky_bringup", "FoxgloveGateway", {"port": 0}),
}
"""Package, class and parameters; the recorder never looks into what it writes."""
WORDS = ("walk", "stand", "trot", "sit", "imu", "base", "front_left_knee", "unplug", "vector")
"""That a request may use, besides the names of the node's parameters."""
A_DEFECT = re.compile(r"\w+(Error|Exception): ")
"""How an answer begins where a callback of ours has raised what nobody expected."""


@pytest.fixture(scope="module")
def impatience():
    """Who asks for what needs another node gets his no at once."""
    with pytest.MonkeyPatch.context() as patch:
        for module in ("husky_pu.nodes.pixhawk_bridge", "husky_drivers.nodes.joint_bridge"):
            patch.setattr(f"{module}._START_PATIENCE", 0.0)
        yield


@pytest.fixture(scope="module", params=NODES)
def node(request, domain, impatience):
    """A node with its executor, which nobody spins."""
    package, kind, parameters = NODES[request.param]
    module = importlib.import_module(f"{package}.nodes.{request.param}")
    told = [word for key, value in parameters.items() for word in ("-p", f"{key}:={value}")]
    rclpy.init(args=["--ros-args", *told], domain_id=domain)
    with contextlib.ExitStack() as end:
        end.callback(rclpy.shutdown)
        try:
            node = getattr(module, kind)()
        except PermissionError as error:
            pytest.skip(str(error))  # raw sockets are not allowed here
        end.callback(node.destroy_node)
        timers = list(getattr(node, "hot_timers", ()))
        end.callback(WaitSetExecutor(node, list(node.hot), node.quiet, timers).close)
        end.callback(node.close)
        yield node


def examples(count):
    """How many, and which: the same each time, unless more are asked for."""
    return settings(max_examples=MORE * count, derandomize=MORE == 1, database=None)


def test_messages_of_every_subscription(node):
    """They come in any order; what is refused is counted, and nothing else happens."""
    guard = node.executor.guard
    subscriptions = list(node.subscriptions)
    if hasattr(node, "_stamped"):  # the controller's second ear on /cmd_vel
        subscriptions.append(node._stamped._subscription)
    entries = [
        (
            guard.guarded(sub.callback, sub.topic_name, sub.msg_type, raw=sub.raw),
            sub.raw,
            Anything().altered(genuine(sub.msg_type)),
        )
        for sub in subscriptions
    ]
    messages = [st.tuples(st.just(n), altered) for n, (_, _, altered) in enumerate(entries)]

    @examples(25 * len(entries))
    @given(st.one_of(messages))
    def fuzz(come):
        enter, raw, _ = entries[come[0]]
        enter(serialize_message(come[1]) if raw else come[1])
        assert guard.failures == 0, guard.last

    if entries:
        fuzz()
        assert guard.refused.total() > 0


def test_requests_of_every_service(node):
    """Each gets an answer that is one."""
    guard, services = node.executor.guard, list(node.services)
    failed_before = guard.failures
    anything = Anything(*WORDS, *node.list_parameters([], 0).names)
    requests = [
        st.tuples(st.just(service), anything.altered(service.srv_type.Request()))
        for service in services
    ]

    @examples(8 * len(services))
    @given(st.one_of(requests))
    def fuzz(come):
        service, request = come
        check = make_check(type(request))
        answer = guard.answer(check, service.service_name, service, request)
        if isinstance(answer, Deferred):
            answer = answer.response
        assert isinstance(answer, service.srv_type.Response), answer
        assert not A_DEFECT.match(getattr(answer, "message", "")), answer.message

    fuzz()
    assert guard.failures == failed_before, guard.last
