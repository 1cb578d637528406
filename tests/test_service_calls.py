"""Calls of services from any thread, as the gateway makes them for its clients."""

import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

import rclpy
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from husky_bringup.node_parameter import NodeParameter
from husky_bringup.nodes import service_calls
from husky_bringup.nodes.remote_parameters import RemoteParameters
from husky_bringup.nodes.service_calls import CallError, ServiceCalls
from husky_runtime.nodes.executor import WaitSetExecutor


@pytest.fixture
def executor(node):
    executor = WaitSetExecutor(node)
    yield executor
    executor.close()


def make(node, patience):
    return ServiceCalls(node, lambda: None, patience, most=2)


def reason(calls, executor, answer):
    """Serve until a call is over; return why it has failed."""
    while not answer.done():  # the test's timeout is the only limit
        calls.serve()
        executor.spin_once()
    with pytest.raises(CallError) as caught:
        answer.result()
    return str(caught.value)


def test_a_service_that_is_not_there_is_given_up(node, executor):
    calls = make(node, 0.05)
    begun = time.monotonic()
    answer = calls.call("/nowhere", Trigger, Trigger.Request())
    assert reason(calls, executor, answer) == "/nowhere: is not there"
    assert time.monotonic() - begun >= 0.05


def test_a_service_that_does_not_answer_is_given_up(node, executor):
    asked = []
    service = node.create_service(Trigger, "/silent", lambda request, response: response)
    service.send_response = lambda response, header: asked.append(response)
    calls = make(node, 600.0)
    answer = calls.call("/silent", Trigger, Trigger.Request())
    while not asked:
        calls.serve()
        executor.spin_once()
    assert not answer.done()
    for call in calls._under_way:
        call.until = 0.0  # its time is over
    assert reason(calls, executor, answer) == "/silent: has not answered in time"


def test_a_node_that_was_stopped_gives_no_call_up(node, monkeypatch):
    """Of the stop one look counts; then the call has nearly all of its time."""
    now = [1000.0]
    monkeypatch.setattr(service_calls, "time", SimpleNamespace(monotonic=lambda: now[0]))
    node.set_parameters([Parameter("use_sim_time", value=True)])
    calls = make(node, 1.0)
    answer = calls.call("/nowhere", Trigger, Trigger.Request())
    now[0] += 20.0
    for _ in range(16):
        assert not calls.serve() and not answer.done()
        now[0] += 0.05
    now[0] += 0.05
    for _ in range(4):
        now[0] += 0.05
        calls.serve()
    assert "is not there" in str(answer.exception())


def test_more_calls_than_it_makes_at_once_are_refused(node, executor):
    calls = make(node, 600.0)
    waiting = [calls.call("/nowhere", Trigger, Trigger.Request()) for _ in range(2)]
    third = calls.call("/nowhere", Trigger, Trigger.Request())
    assert reason(calls, executor, third) == "/nowhere: 2 calls are under way already"
    calls.close()
    for answer in (*waiting, calls.call("/nowhere", Trigger, Trigger.Request())):
        assert reason(calls, executor, answer) == "/nowhere: the node ends"


# Parameters -----------------------------------------------------------------------------------
@pytest.fixture
def walker(node):
    """Another node, with parameters."""
    walker = rclpy.create_node("walker", context=node.context)
    within = FloatingPointRange(from_value=0.1, to_value=0.6)
    height = ParameterDescriptor(
        description="of the base [m]", floating_point_range=[within], read_only=True
    )
    word = ParameterDescriptor(additional_constraints="one of ideal, noisy")
    walker.declare_parameter("trot.height", 0.4, height)
    walker.declare_parameter("sensing", "ideal", word)
    walker.declare_parameter("qos_overrides./clock.depth", 1)
    walker.declare_parameter("gains", [1.0, 2.5])
    walker.declare_parameter("unset", Parameter.Type.STRING)
    walker.declare_parameter("blob", [b"\1", b"\2"])
    yield walker
    walker.destroy_node()


def served(node, walker, ask):
    """Ask parameters from another thread while both nodes serve; return the answer."""
    ours, theirs = WaitSetExecutor(node), WaitSetExecutor(walker)
    calls = ServiceCalls(node, lambda: None, 600.0)
    remote = RemoteParameters(node, calls)
    with ThreadPoolExecutor() as pool:
        while "/walker" not in remote.nodes():
            ours.spin_once()
        asked = pool.submit(ask, remote)
        while not asked.done():
            calls.serve()
            for executor in (ours, theirs):
                executor.spin_once()
    for executor in (ours, theirs):
        executor.close()
    return asked.result()


def test_the_parameters_of_a_node_are_described(node, walker):
    found = served(node, walker, lambda remote: remote.describe("/walker"))
    assert found == [
        NodeParameter("trot.height", 0.4, "of the base [m]", 0.1, 0.6, True, ""),
        NodeParameter(
            "sensing", "ideal", "", None, None, False, "ideal, noisy", ("ideal", "noisy")
        ),
        NodeParameter("gains", [1.0, 2.5], "", None, None, False, ""),
        NodeParameter("unset", None, "", None, None, False, ""),
        NodeParameter("blob", b"\1\2", "", None, None, False, ""),
    ]


@pytest.mark.parametrize("name", ["/tested", "/nobody", "no name", "/walker/"])
def test_what_is_no_other_node_is_not_described(node, walker, name):
    with pytest.raises(CallError, match=f"{name}: is not there"):
        served(node, walker, lambda remote: remote.describe(name))


def test_half_a_character_is_refused(node, walker):
    values = {"/walker.sensing": "\ud800"}
    (why,) = served(node, walker, lambda remote: remote.write(values))
    assert why == "/walker.sensing: '\\ud800' has half a character"
