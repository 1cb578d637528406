"""The executor of the nodes: what it owes to those who ask."""

import warnings

import pytest

pytest.importorskip("rclpy")

import rclpy
from std_srvs.srv import Trigger

from husky_runtime.nodes import service_desk
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


def ask(node):
    """Call the service; return who asks, its executor and the future."""
    other = rclpy.create_node("asking", context=node.context)
    client = other.create_client(Trigger, "ask")
    spinner = rclpy.executors.SingleThreadedExecutor(context=node.context)
    spinner.add_node(other)
    assert client.wait_for_service(30.0)
    future = client.call_async(Trigger.Request())
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
