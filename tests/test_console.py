"""The process `console` without a robot: who gets to the page, and who would bring it down."""

from __future__ import annotations

import contextlib
import signal
import urllib.request
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest

pytest.importorskip("rclpy")

from console_process import MODULE, URDF, ConsoleBench
from geometry_msgs.msg import Point
from node_bench import assert_refused, values_of
from page_client import PageClient
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray
from websockets.exceptions import InvalidStatus

from husky_bringup.console.server import PageServer

pytestmark = pytest.mark.graph


@pytest.fixture(scope="module")
def console_of_module(
    domain: int, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[ConsoleBench]:
    console = ConsoleBench(domain, tmp_path_factory.mktemp("console"))
    yield console
    console.close()


@pytest.fixture
def console(console_of_module: ConsoleBench) -> Iterator[ConsoleBench]:
    console_of_module.serve(connections=20)
    yield console_of_module
    console_of_module.begin_anew()


def test_the_page_is_a_website(console: ConsoleBench) -> None:
    with urllib.request.urlopen(console.address) as answer:
        assert answer.status == 200 and b"<html" in answer.read()


def test_a_page_that_comes_later_shows_the_same(console: ConsoleBench) -> None:
    console.shows(console.client(), 0.5)
    later = console.client()
    console.wait(lambda: later.positions.get("/scene/body", (None,))[0] == 0.5, "the same")
    assert later.nodes == console.clients[0].nodes


def test_nobody_listens_while_nobody_looks(console: ConsoleBench) -> None:
    console.is_served()
    console.wait(lambda: console.transforms.get_subscription_count() == 1, "one that listens")
    console.leave()
    console.wait(lambda: console.transforms.get_subscription_count() == 0, "nobody")
    console.is_served()


# Nobody brings it down ------------------------------------------------------------------------
@pytest.mark.parametrize(
    "nonsense",
    [
        "text",
        b"",
        b"\xff" * 100,
        b"\xc1",
        msgspec.msgpack.encode([]),
        msgspec.msgpack.encode({"type": "NoSuchMessage"}),
        msgspec.msgpack.encode({"type": "ViewerCameraMessage"}),
        msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": 1}}),
        msgspec.msgpack.encode({"type": "ShareUrlRequest"}),
        b"\x91" * 100_000,
        b"\x01" * 20_000_000,
        b"\x01" * 60_000_000,
    ],
    ids=lambda nonsense: repr(nonsense[:20]),
)
def test_nonsense_over_the_websocket(console: ConsoleBench, nonsense: str | bytes) -> None:
    client = console.client()
    console.shows(client, 0.25)
    client.send_raw(nonsense)
    console.is_served()


@pytest.mark.parametrize("value", [[1, [2]], {"a": None}, 7, "nothing", None, 1e300])
def test_values_of_controls_that_are_none(console: ConsoleBench, value: Any) -> None:
    client = console.client()
    console.shows(client, 0.25)
    for uuid in client.gui:
        client.say(type="GuiUpdateMessage", uuid=uuid, updates={"value": value})
    console.is_served()
    report = console.wait_for_report(lambda each: True, "a report")
    assert report["failed_callbacks"] == "0"


@pytest.mark.parametrize(
    "updates", [{"gui_api": 1}, {"removed": True}, {"value": "x", "uuid": "y"}, {}, 7]
)
def test_browsers_set_values_of_controls_and_nothing_else(
    console: ConsoleBench, updates: Any
) -> None:
    """viser would set any attribute, and fail at its next own word to the control."""
    client = console.client()
    console.shows(client, 0.25)
    for uuid in client.gui:
        client.say(type="GuiUpdateMessage", uuid=uuid, updates=updates)
    console.is_served()
    name = f"frame_{next(console.places)}"
    console.move(0.0, name)
    console.wait(lambda: any(name in each.get("options", ()) for each in client.gui.values()), name)


def test_fifty_pages_are_served_or_refused(console: ConsoleBench) -> None:
    assert console.crowd(console.client) == (20, 30)
    console.begin_anew()
    console.is_served()


@pytest.mark.slow
def test_pages_that_do_not_read_hold_up_nobody(console: ConsoleBench) -> None:
    """They show where the robot is once they read again."""
    stalled = [console.client() for _ in range(6)]
    for client in stalled:
        console.shows(client, 0.5)
    other = console.client()

    def at(client: PageClient) -> float:
        return client.positions.get("/scene/body", (0.0,))[0]

    line = Marker(type=Marker.LINE_STRIP, ns="line", action=Marker.ADD)
    line.header.frame_id, line.scale.x, line.color.a = "body", 0.01, 1.0
    line.points = [Point(x=0.1 * index) for index in range(4000)]

    drawn: set[int] = set()

    def change() -> None:
        if other.received not in drawn:  # a slow console has no more to do than a quick one
            drawn.add(other.received)
            line.points[0].x += 0.1
            console.markers.publish(MarkerArray(markers=[line]))

    with contextlib.ExitStack() as holds:
        for client in stalled:
            holds.enter_context(client.held())
        before, begin = console.resident_mb(), other.received
        console.wait(lambda: other.received > begin + 8_000_000, "8 MB at the other", change)
        assert console.resident_mb() - before < 15.0  # of 48
        console.is_served()
    console.move(-1.0)
    for client in stalled:
        console.wait(lambda c=client: c.closed or at(c) == -1.0, "the newest, or that it is let go")
        if client.closed:  # by a slow machine's wall time, and comes again, as a browser does
            client = console.client()
            console.wait(lambda c=client: at(c) == -1.0, "the newest")


def test_what_is_no_description_is_refused(console: ConsoleBench) -> None:
    console.shows(console.client(), 0.5)
    console.description.publish(String(data="<robot"))
    console.wait_for_report(lambda each: "no XML" in each.message, "the reason")
    console.description.publish(String(data=URDF))
    console.is_served()


def test_nobody_opens_a_tunnel() -> None:
    server = PageServer()
    try:
        server.request_share_url()  # as a client asks for
        assert server._share_tunnel is None
    finally:
        server.stop()


# Who gets in ----------------------------------------------------------------------------------
def test_others_show_a_token(console: ConsoleBench) -> None:
    console.serve(host="0.0.0.0", token="open-sesame", connections=20)
    console.address = f"http://127.0.0.1:{console.address.rpartition(':')[2]}"
    with pytest.raises(InvalidStatus, match="401"):
        console.client()
    console.shows(console.client(additional_headers={"Authorization": "Bearer open-sesame"}), 0.5)
    console.wait_for_report(lambda each: values_of(each)["refused_connections"] == "1", "counted")


def test_pages_of_somebody_else_stay_outside(console: ConsoleBench) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        console.client(origin="https://example.org")


@pytest.mark.parametrize(
    "number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.slow)]
)
def test_it_ends_while_somebody_looks(console: ConsoleBench, number: int) -> None:
    client = console.client()
    console.shows(client, 0.5)
    console.end(number)
    client.join()


@pytest.mark.slow
def test_pages_that_may_connect_are_named(console: ConsoleBench) -> None:
    console.serve(origins=["https://lab.example.org"])
    console.shows(console.client(origin="https://lab.example.org"), 0.5)


@pytest.mark.slow
def test_a_parameter_that_may_not_be_is_named() -> None:
    assert_refused(MODULE, "rate", rate=0.0)
