"""The executor of the nodes: what it owes to those who ask."""

import itertools
import warnings

import pytest

pytest.importorskip("rclpy")

import rclpy
from rcl_interfaces.msg import (
    Parameter,
    ParameterType,
    ParameterValue,
    SetParametersResult,
)
from rcl_interfaces.srv import SetParameters
from std_msgs.msg import String
from std_srvs.srv import Trigger

from husky_runtime.nodes import qos, service_desk
from husky_runtime.nodes.executor import WaitSetExecutor


@pytest.fixture
def deaf(node, monkeypatch):
    """A service whose first answers do not reach their client, as rclpy reports it."""

    def answer(request, response):
        response.success = True
        return response

    service = node.create_service(Trigger, "ask", answer)
    service.lost, service.tried = 0, 0
    send = service.send_response

    def send_response(response, header):
        service.tried += 1
        if service.tried <= service.lost:
            warnings.warn("failed to send response (timeout)", RuntimeWarning, stacklevel=2)
        else:
            send(response, header)

    monkeypatch.setattr(service, "send_response", send_response)
    monkeypatch.setattr(service_desk, "_ANSWER_AGAIN", (0.01, 0.01, 0.01))
    return service


def ask(node, kind=Trigger, name="ask", **request):
    """Call a service; return who asks, its executor and the future."""
    other = rclpy.create_node("asking", context=node.context)
    client = other.create_client(kind, name)
    spinner = rclpy.executors.SingleThreadedExecutor(context=node.context)
    spinner.add_node(other)
    assert client.wait_for_service(30.0)
    future = client.call_async(kind.Request(**request))
    return other, spinner, future


@pytest.mark.parametrize("lost", [0, 1, 3])
def test_an_answer_that_was_lost_is_sent_again(node, deaf, lost):
    deaf.lost = lost
    other, spinner, future = ask(node)
    served = WaitSetExecutor(node)
    while not future.done():  # the test's timeout is the only limit
        served.spin_once()
        spinner.spin_once(timeout_sec=0.01)
    assert future.result().success and deaf.tried == lost + 1
    served.close()
    other.destroy_node()


def test_a_client_that_is_never_found_is_given_up_with_a_warning(node, deaf):
    deaf.lost = 100
    other, _, future = ask(node)
    served = WaitSetExecutor(node)
    with pytest.warns(RuntimeWarning, match="/ask: failed to send response"):
        while deaf.tried < 4:
            served.spin_once()
    for _ in range(3):
        served.spin_once()
    assert deaf.tried == 4 and not future.done()
    served.close()
    other.destroy_node()


@pytest.fixture
def live(node):
    """A node with 100 parameters that counts how many are set, and refuses one."""
    for number in range(100):
        node.declare_parameter(f"live{number}", 0.0)
    node.set = 0

    def on_set(parameters):
        node.set += len(parameters)
        return SetParametersResult(successful=parameters[0].name != "live7")

    node.add_on_set_parameters_callback(on_set)
    return node


def wish(number, kind=ParameterType.PARAMETER_DOUBLE):
    """A parameter as a request has it."""
    value = ParameterValue(type=kind, double_value=1.0)
    return Parameter(name=f"live{number % 100}", value=value)


def set_parameters(node, wanted):
    """Ask for them at once; return the results, and how many were set in one go at most."""
    name = f"/{node.get_name()}/set_parameters"
    other, spinner, future = ask(node, SetParameters, name, parameters=wanted)
    served, most = WaitSetExecutor(node), 0
    while not future.done():
        before = node.set
        served.spin_once()
        most = max(most, node.set - before)
        spinner.spin_once(timeout_sec=0.01)
    served.close()
    other.destroy_node()
    return future.result().results, most


@pytest.mark.parametrize("count", [1, 16, 17, 100, 512])
def test_of_many_parameters_a_tick_sets_a_few(live, count):
    results, most = set_parameters(live, [wish(number) for number in range(count)])
    refused = [number for number, each in enumerate(results) if not each.successful]
    assert len(results) == count and refused == list(range(7, count, 100))
    assert most <= 2 * 16  # a look before the wait and one behind it


def test_a_parameter_of_no_type_is_refused_alone(live):
    results, _ = set_parameters(live, [wish(1), wish(2, kind=200), wish(3)])
    assert [each.successful for each in results] == [True, False, True]
    assert live.get_parameter("live1").value == live.get_parameter("live3").value == 1.0
    assert live.get_parameter("live2").value == 0.0


def test_too_many_parameters_are_refused(live):
    results, most = set_parameters(live, [wish(number) for number in range(513)])
    assert results[0].reason == "parameters holds 513 values, 512 are allowed"
    assert most == 0


TOPICS = ("command", "status", "tick")


@pytest.mark.parametrize("hot", list(itertools.permutations(TOPICS)))
def test_hot_messages_are_served_in_the_order_in_which_they_came(node, hot):
    """Also when all of them wait, because the node has had to wait for a processor."""
    served = []
    other = rclpy.create_node("sender", context=node.context)
    senders = {name: other.create_publisher(String, name, qos.COMMAND) for name in TOPICS}
    executor = WaitSetExecutor(
        node,
        [
            node.create_subscription(String, name, lambda m: served.append(m.data), qos.COMMAND)
            for name in hot
        ],
    )
    while any(sender.get_subscription_count() < 1 for sender in senders.values()):
        executor.spin_once()
    sent = [
        f"{name} {i}" for i, name in enumerate(("tick", "command", "command", *TOPICS, *TOPICS))
    ]
    for text in sent:
        senders[text.split()[0]].publish(String(data=text))
    while len(served) < len(sent):  # the test's timeout is the only limit
        executor.spin_once()
    assert served == sent
    executor.close()
    other.destroy_node()


@pytest.mark.parametrize("has_hot", [True, False])
def test_what_comes_over_a_wire_while_it_waits_is_carried_at_once(node, monkeypatch, has_hot):
    """Not after another wait, on everything, which may take 50 ms."""
    wire, carried = [], []

    def carry():
        carried.extend(wire)
        return bool(wire) and not wire.clear()

    node.hot_wires = (carry,)
    hot = node.create_subscription(String, "tick", print, qos.COMMAND)
    executor = WaitSetExecutor(node, [hot] if has_hot else [])
    try:
        executor.spin_once()  # makes its wait set
        waits = (executor, "_wait_hot") if has_hot else (executor._look_at_rest(), "wait")
        monkeypatch.setattr(*waits, lambda *_: not wire.append("bytes"))
        serve = executor._look_at_rest().serve
        monkeypatch.setattr(
            executor._look_at_rest(),
            "serve",
            lambda **asked: serve(**asked) or carried.append("the rest"),
        )
        executor.spin_once()
        assert carried[0] == "bytes"
    finally:
        executor.close()


def test_a_node_that_nothing_is_urgent_to_is_looked_through_once_a_wait(node, monkeypatch):
    executor = WaitSetExecutor(node)
    looks = []
    try:
        rest = executor._look_at_rest()
        serve = rest.serve
        monkeypatch.setattr(rest, "serve", lambda **asked: looks.append(serve(**asked)))
        for _ in range(5):
            executor.end_wait()
            executor.spin_once()
        assert len(looks) == 5
    finally:
        executor.close()
