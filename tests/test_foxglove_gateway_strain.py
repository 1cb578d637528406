"""The process `foxglove_gateway` and those who would bring it down; who may connect; its end."""

from __future__ import annotations

import signal
from collections.abc import Callable
from urllib.parse import urlsplit

import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticStatus
from foxglove_client import FoxgloveClient
from gateway_bench import (
    MODULE,
    AloneBench,
)
from node_bench import assert_refused, values_of
from std_msgs.msg import String
from std_srvs.srv import Trigger
from websockets.exceptions import InvalidStatus

pytestmark = pytest.mark.graph


# Nobody brings it down ------------------------------------------------------------------------
@pytest.mark.parametrize(
    "nonsense",
    [
        "{",
        "[]",
        '{"op": "nothing"}',
        '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99999}]}',
        '{"op": "setParameters", "parameters": [{"name": "", "value": {"a": []}}]}',
        b"",
        b"\xff" * 100,
        b"\x02" + b"\xff" * 20,
        b"\x01\0\0\0\0",
        b"\x01" * 20_000_000,
    ],
    ids=lambda nonsense: repr(nonsense[:20]),
)
def test_nonsense_over_the_websocket(gateway: AloneBench, nonsense: str | bytes) -> None:
    client = gateway.client()
    client.send_raw(nonsense)
    gateway.is_served()


def test_fifty_clients_are_served_or_refused(gateway: AloneBench) -> None:
    def connect() -> None:
        gateway.clients.append(FoxgloveClient(gateway.address))

    assert gateway.crowd(connect) == (20, 30)
    gateway.begin_anew()
    gateway.is_served()


def test_a_client_that_does_not_read_holds_up_nobody(gateway: AloneBench) -> None:
    gateway.serve(backlog=16)
    stalled, client = gateway.client(), gateway.client()
    gateway.hear(stalled, "/words", gateway.words)
    heard, big = client.subscribe("/words"), String(data="x" * 1_000_000)
    gateway.wait(lambda: heard, "the first", lambda: gateway.words.publish(String()))
    sent = len(heard)

    def publish_the_next() -> None:  # no queue in DDS when the gateway gets no processor
        nonlocal sent
        if sent <= len(heard):
            gateway.words.publish(big)
            sent += 1

    with stalled.held():
        before = gateway.resident_mb()
        gateway.wait(lambda: len(heard) >= 120, "120 MB", publish_the_next)
        gateway.is_served()
        assert gateway.resident_mb() - before < 60.0  # 16 wait here, some more in sockets and DDS


def test_all_is_well_in_its_report(gateway: AloneBench) -> None:
    client = gateway.client()
    client.subscribe("/words")
    report: Callable[[DiagnosticStatus], bool] = lambda each: (  # noqa: E731
        values_of(each)["topics_listened"] == "1"
    )
    values = gateway.wait_for_report(report, "one topic that is listened to")
    assert (values["connections"], values["skipped"]) == ("1", "")


@pytest.mark.slow
def test_a_token_is_asked_for_where_others_get_to(gateway: AloneBench) -> None:
    gateway.serve(host="0.0.0.0", token="a-good-token")
    here = f"ws://127.0.0.1:{urlsplit(gateway.address).port}"
    for address in (here, f"{here}?token=another-token"):
        with pytest.raises(InvalidStatus) as caught:
            FoxgloveClient(address)
        assert caught.value.response.status_code == 401
    gateway.address = f"{here}?token=a-good-token"
    gateway.is_served()
    gateway.wait(lambda: gateway.value("refused_connections") == 2, "the count of it")


@pytest.mark.parametrize(
    "number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.slow)]
)
def test_it_ends_with_clients_and_calls_under_way(gateway: AloneBench, number: int) -> None:
    asked: list[object] = []

    def never(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        asked.append(request)
        return response

    gateway.node.create_service(Trigger, "slow", never)
    client = gateway.client()
    gateway.wait(lambda: "/slow" in client.services, "the slow service")
    client.subscribe("/words")
    client.call("/slow")
    client.get_parameters()
    gateway.end(number)
    client.join()


@pytest.mark.slow
def test_an_address_that_is_not_here_is_named() -> None:
    assert_refused(MODULE, "192.0.2.1", host="192.0.2.1", port=0)
