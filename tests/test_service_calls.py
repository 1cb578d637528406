"""Calls of services from any thread, as the gateway makes them for its clients."""

import time

import pytest

pytest.importorskip("rclpy")

from std_srvs.srv import Trigger

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


def test_more_calls_than_it_makes_at_once_are_refused(node, executor):
    calls = make(node, 600.0)
    waiting = [calls.call("/nowhere", Trigger, Trigger.Request()) for _ in range(2)]
    third = calls.call("/nowhere", Trigger, Trigger.Request())
    assert reason(calls, executor, third) == "/nowhere: 2 calls are under way already"
    calls.close()
    for answer in (*waiting, calls.call("/nowhere", Trigger, Trigger.Request())):
        assert reason(calls, executor, answer) == "/nowhere: the node ends"
