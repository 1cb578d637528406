"""What goes through the gate, how much at once, and how it ends."""

from __future__ import annotations

import contextlib
import gc
import socket
import struct
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
from gate_bench import (
    PAGE,
    PATIENCE,
    TOKEN,
    UPGRADE,
    MakeGate,
    close_in_time,
    dial,
    get,
    head_for,
    inner_server,
    open_websocket,
    read_all,
    read_exactly,
    says_back,
    status,
    until,
)
from websockets.exceptions import ConnectionClosed, InvalidStatus

from husky_bringup import web_gate
from husky_bringup.web_gate import WebGate


# Many, and large ----------------------------------------------------------------------------------
def test_more_than_allowed_are_refused_until_one_leaves(gate_to: MakeGate, echo: int) -> None:
    gate = gate_to(echo, most=2)
    with open_websocket(gate) as first, open_websocket(gate) as second:
        with pytest.raises(InvalidStatus) as error, open_websocket(gate):
            pass
        assert error.value.response.status_code == 503 and gate.refused == 1
        assert says_back(first) and says_back(second)
        first.close()
        until(lambda: gate.connections == 1)
        with open_websocket(gate) as third:
            assert says_back(third)


def test_who_is_not_let_in_takes_no_place(gate_to: MakeGate, echo: int) -> None:
    gate = gate_to(echo, token=TOKEN, most=1)
    with dial(gate), dial(gate) as client:
        client.sendall(head_for(gate))  # and it stays after the answer
        assert status(read_all(client)) == 401
        with open_websocket(gate, f"/?token={TOKEN}") as connection:
            assert says_back(connection)


def test_those_who_wait_outside_are_not_without_number(
    gate_to: MakeGate, pages: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(web_gate, "_WAITING", 3)
    gate = gate_to(pages, most=2)
    with contextlib.ExitStack() as stack:
        idle = [stack.enter_context(dial(gate)) for _ in range(9)]
        until(lambda: gate.refused == 4)
        for client in idle[5:]:
            with contextlib.suppress(ConnectionError):
                assert client.recv(1) == b""
    until(lambda: not gate._tasks)
    assert get(gate) == 200


def test_fifty_at_once_are_each_served_or_refused(gate_to: MakeGate, echo: int) -> None:
    gate = gate_to(echo, most=20)
    all_known = threading.Barrier(50)

    def client(number: int) -> int:
        try:
            with open_websocket(gate) as connection:
                all_known.wait(PATIENCE)
                assert says_back(connection, f"I am {number}")
                return 101
        except InvalidStatus as error:
            all_known.wait(PATIENCE)
            return error.response.status_code

    with ThreadPoolExecutor(50) as pool:
        answers = list(pool.map(client, range(50)))
    assert answers.count(101) == 20 and answers.count(503) == 30 == gate.refused
    until(lambda: gate.connections == 0)


def test_a_large_message_arrives_whole_both_ways(gate_to: MakeGate, echo: int) -> None:
    message = bytes(range(251)) * 4200
    assert len(message) > 1_000_000
    with open_websocket(gate_to(echo)) as connection:
        for _ in range(3):
            connection.send(message)
        for _ in range(3):
            assert connection.recv(PATIENCE) == message


class Flood:
    """More than all sockets hold."""

    total = 128 << 20
    block = bytes(range(256)) * 1024

    def __init__(self) -> None:
        self.sent = 0
        self.received = 0
        self.may_read = threading.Event()

    def pour(self, peer: socket.socket) -> None:
        while self.sent < self.total:
            peer.sendall(self.block)
            self.sent += len(self.block)
        peer.shutdown(socket.SHUT_WR)

    def take(self, peer: socket.socket) -> None:
        self.may_read.wait(PATIENCE)
        while part := peer.recv(1 << 20):
            self.received += len(part)

    def handler(self, peer: socket.socket, head: bytes) -> None:
        if b"/pour" in head:
            self.pour(peer)
        elif b"/take" in head:
            self.take(peer)
        else:
            while part := peer.recv(1 << 16):
                peer.sendall(part)


@pytest.mark.parametrize("way", ["/pour", "/take"])
def test_who_does_not_read_holds_little_memory_and_nobody_up(gate_to: MakeGate, way: str) -> None:
    """Either the client does not, or the inner server."""
    flood = Flood()
    with inner_server(flood.handler) as port, ThreadPoolExecutor(1) as pool:
        gate = gate_to(port)
        with dial(gate) as stalled, dial(gate) as other:
            stalled.sendall(head_for(gate, way, **UPGRADE))
            done = pool.submit(flood.take if way == "/pour" else flood.pour, stalled)
            other.sendall(head_for(gate, "/echo", **UPGRADE))
            before = -1
            while flood.sent != before:
                before = flood.sent
                for _ in range(20):
                    other.sendall(flood.block[:65_536])
                    assert read_exactly(other, 65_536) == flood.block[:65_536]
            assert 0 < flood.sent < flood.total
            flood.may_read.set()
            done.result(PATIENCE)
            until(lambda: flood.received == flood.total)


# Ends ---------------------------------------------------------------------------------------------
def test_without_an_inner_server_the_gate_says_so(gate_to: MakeGate) -> None:
    with socket.create_server(("127.0.0.1", 0)) as gone:
        port = gone.getsockname()[1]
    gate = gate_to(port)
    without: dict[str, str] = {}
    for headers in [without, UPGRADE]:
        with dial(gate) as client:
            client.sendall(head_for(gate, **headers))
            answer = read_all(client)
        assert status(answer) == 502 and b"cannot be reached" in answer
    assert gate.connections == 0 and gate.refused == 2


def test_a_connection_is_half_closed_through_the_gate(gate_to: MakeGate) -> None:
    sent, answer = b"a" * 300_000, b"b" * 1_000_000

    def handler(peer: socket.socket, head: bytes) -> None:
        if read_all(peer) == sent:
            peer.sendall(answer)

    with inner_server(handler) as port:
        gate = gate_to(port)
        # So that the last of it still waits in the gate when the server has ended.
        gate._server.sockets[0].setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        with dial(gate) as client:
            client.sendall(head_for(gate) + sent)
            client.shutdown(socket.SHUT_WR)
            assert read_all(client) == answer


def test_an_answer_that_is_awaited_is_no_garbage(gate_to: MakeGate) -> None:
    """When the client has said all, asyncio holds neither its socket nor its task."""

    def handler(peer: socket.socket, head: bytes) -> None:
        assert read_all(peer) == b"all"
        time.sleep(0.05)  # so that the gate waits
        gc.collect()
        peer.sendall(PAGE)

    with inner_server(handler) as port, dial(gate_to(port)) as client:
        client.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\nall")
        client.shutdown(socket.SHUT_WR)
        assert read_all(client) == PAGE


def test_a_server_that_ends_a_connection_frees_its_place(gate_to: MakeGate, pages: int) -> None:
    gate = gate_to(pages, most=1)
    with dial(gate) as client:
        client.sendall(head_for(gate))
        assert read_all(client) == PAGE
        until(lambda: gate.connections == 0)
        assert get(gate) == 200


def reset(peer: socket.socket) -> None:
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    peer.close()


@pytest.mark.parametrize("end", [reset, socket.socket.close])
def test_clients_that_go_away_leave_nothing_behind(
    gate_to: MakeGate, caplog: pytest.LogCaptureFixture, end: Callable[[socket.socket], None]
) -> None:
    flood = Flood()
    flood.may_read.set()
    with inner_server(flood.handler) as port:
        gate = gate_to(port)
        for way in ["/pour", "/take", "/echo"]:
            head = head_for(gate, way, **UPGRADE)
            for sent in [b"", head[:9], head, head + flood.block, b"\r\n\r\n" + flood.block]:
                client = dial(gate)
                client.sendall(sent)
                end(client)
                flood.sent = 0
        client = dial(gate)
        client.sendall(head_for(gate, "/pour", **UPGRADE))
        read_exactly(client, 1_000_000)  # it flows
        end(client)
        until(lambda: not gate._tasks)
        assert gate.connections == 0
    assert not [record for record in caplog.records if record.name == "asyncio"]


def test_a_server_that_resets_ends_the_connection(gate_to: MakeGate) -> None:
    def handler(peer: socket.socket, head: bytes) -> None:
        peer.sendall(b"x")
        peer.recv(1)
        reset(peer)

    with inner_server(handler) as port:
        gate = gate_to(port)
        for _ in range(2):
            with dial(gate) as client:
                client.sendall(head_for(gate, **UPGRADE))
                assert client.recv(1) == b"x"
                client.sendall(b"y")
                assert read_all(client) == b""
                until(lambda: gate.connections == 0)


@pytest.mark.parametrize("length", [100, 1_000_000])
def test_who_still_sends_gets_the_refusal(gate_to: MakeGate, pages: int, length: int) -> None:
    """A socket that is closed with bytes unread resets the connection, and the answer is lost."""
    gate = gate_to(pages, token=TOKEN)
    post = head_for(gate, Content_Length=str(length)).replace(b"GET", b"POST")
    for head, answer in [(post, 401), (b"x" * 20_000, 431), (b"no\r\n\r\n", 400)]:
        for _ in range(20):
            with dial(gate) as client:
                client.sendall(head)
                client.sendall(b"x" * length)
                assert status(read_all(client)) == answer


def test_who_is_refused_and_does_not_leave_is_dropped(
    gate_to: MakeGate, pages: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(web_gate, "_PATIENCE", 0.05)
    gate = gate_to(pages, token=TOKEN)
    with dial(gate) as client:
        client.sendall(head_for(gate))
        assert status(read_all(client)) == 401

        def is_dropped() -> bool:
            try:
                client.sendall(b"more")
            except ConnectionError:
                return True
            return False

        until(is_dropped)


def test_close_ends_what_is_open(
    gate_to: MakeGate,
    echo: int,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(web_gate, "_PATIENCE", 1e6)
    flood = Flood()
    with inner_server(flood.handler) as port, contextlib.ExitStack() as stack:
        gate, websockets = gate_to(port, most=3), gate_to(echo)
        connection = stack.enter_context(open_websocket(websockets))
        assert says_back(connection)
        idle, refused, stalled = (stack.enter_context(dial(gate)) for _ in range(3))
        refused.sendall(b"no\r\n\r\n")
        assert status(read_all(refused)) == 400
        stalled.sendall(head_for(gate, "/pour", **UPGRADE))
        sent = -1
        while flood.sent != sent:  # until nothing more goes in
            sent = flood.sent
            time.sleep(0.05)
        for each in [gate, websockets]:
            close_in_time(each)
            close_in_time(each)
            assert each.connections == 0
            with pytest.raises(ConnectionRefusedError):
                dial(each)
        with contextlib.suppress(ConnectionResetError):
            assert idle.recv(1) == b""
        with contextlib.suppress(ConnectionResetError):
            assert len(read_all(stalled)) < flood.total
        with pytest.raises(ConnectionClosed):
            connection.recv(PATIENCE)
    assert not [record for record in caplog.records if record.name == "asyncio"]


def test_close_ends_a_gate_that_is_being_run_into(gate_to: MakeGate, pages: int) -> None:
    for _ in range(5):
        gate = gate_to(pages)
        closed = threading.Event()

        def run_into(gate: WebGate = gate, closed: threading.Event = closed) -> None:
            while not closed.is_set():
                with contextlib.suppress(OSError), dial(gate) as client:
                    client.sendall(head_for(gate))
                    read_all(client)

        with ThreadPoolExecutor(4) as pool:
            runs = [pool.submit(run_into) for _ in range(4)]
            try:
                until(lambda gate=gate: gate.connections > 0)  # type: ignore[misc]
                close_in_time(gate)
            finally:
                closed.set()
            for run in runs:
                run.result(PATIENCE)


def test_a_port_that_is_taken_is_an_os_error(gate_to: MakeGate, pages: int) -> None:
    gate = gate_to(pages)
    with pytest.raises(OSError):
        WebGate("127.0.0.1", gate.port, pages)
    assert get(gate) == 200
    port = gate.port
    gate.close()
    again = WebGate("127.0.0.1", port, pages)
    assert again.port == port
    again.close()
