"""What tests of the gate before a web server share: servers behind it, clients before it."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator

import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.sync.server import ServerConnection, serve

from husky_bringup.web_gate import WebGate

PATIENCE = 60.0
"""Against hanging [s]; nothing is judged by it."""
TOKEN = "a-Token_of.22~characters"
PAGE = b"HTTP/1.1 200 OK\r\nContent-Length: 5\r\nConnection: close\r\n\r\npage\n"
UPGRADE = {"Connection": "keep-alive, Upgrade", "Upgrade": "websocket"}

MakeGate = Callable[..., WebGate]
Handler = Callable[[socket.socket, bytes], None]


def until(true: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < end
        time.sleep(0.002)


def read_all(peer: socket.socket) -> bytes:
    parts = []
    while part := peer.recv(1 << 20):
        parts.append(part)
    return b"".join(parts)


def read_through_head(peer: socket.socket) -> bytes:
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        byte = peer.recv(1)
        if not byte:
            raise EOFError
        head += byte
    return head


def read_exactly(peer: socket.socket, length: int) -> bytes:
    data = b""
    while len(data) < length:
        part = peer.recv(length - len(data))
        if not part:
            raise EOFError
        data += part
    return data


@contextlib.contextmanager
def inner_server(handler: Handler) -> Iterator[int]:
    """Yield the port of a server that lets a handler have each connection and its first head."""
    listener = socket.create_server(("127.0.0.1", 0))
    threads = []

    def serve_one(peer: socket.socket) -> None:
        with peer, contextlib.suppress(OSError, EOFError):
            peer.settimeout(PATIENCE)
            handler(peer, read_through_head(peer))

    def accept() -> None:
        with contextlib.suppress(OSError):
            while True:
                threads.append(threading.Thread(target=serve_one, args=(listener.accept()[0],)))
                threads[-1].start()

    accepting = threading.Thread(target=accept)
    accepting.start()
    try:
        yield listener.getsockname()[1]
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        for thread in [accepting, *threads]:
            thread.join(PATIENCE)
            assert not thread.is_alive()


@pytest.fixture
def heads() -> list[bytes]:
    """The heads that have come to the server of `pages`."""
    return []


@pytest.fixture
def pages(heads: list[bytes]) -> Iterator[int]:
    """The port of a server that answers all with a page."""

    def handler(peer: socket.socket, head: bytes) -> None:
        heads.append(head)
        peer.sendall(PAGE)

    with inner_server(handler) as port:
        yield port


@pytest.fixture(scope="module")
def echo() -> Iterator[int]:
    """The port of a server of websockets that says all back."""

    def handler(connection: ServerConnection) -> None:
        for message in connection:
            connection.send(message)

    with serve(handler, "127.0.0.1", 0, max_size=None, compression=None) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server.socket.getsockname()[1]
        server.shutdown()
        thread.join(PATIENCE)


@pytest.fixture
def gate_to() -> Iterator[MakeGate]:
    """Makes gates and closes them."""
    with contextlib.ExitStack() as gates:

        def make(inner_port: int, host: str = "127.0.0.1", **settings: object) -> WebGate:
            gate = WebGate(host, 0, inner_port, **settings)  # type: ignore[arg-type]
            gates.callback(gate.close)
            return gate

        yield make


def dial(gate: WebGate) -> socket.socket:
    return socket.create_connection(("127.0.0.1", gate.port), PATIENCE)


def head_for(gate: WebGate, target: str = "/", **headers: str) -> bytes:
    """Return the head of a request; a header's name has _ for -."""
    headers = {"Host": f"127.0.0.1:{gate.port}"} | headers
    lines = [f"{name.replace('_', '-')}: {value}" for name, value in headers.items()]
    return "\r\n".join([f"GET {target} HTTP/1.1", *lines, "", ""]).encode()


def status(answer: bytes) -> int:
    assert answer.startswith(b"HTTP/1.1 "), answer[:100]
    return int(answer.split()[1])


def ask(gate: WebGate, head: bytes) -> int:
    """Send a head, return the status."""
    with dial(gate) as client:
        client.sendall(head)
        return status(read_all(client))


def get(gate: WebGate, target: str = "/", **headers: str) -> int:
    return ask(gate, head_for(gate, target, **headers))


def open_websocket(
    gate: WebGate, target: str = "/", **headers: str
) -> contextlib.AbstractContextManager[ClientConnection]:
    headers = {name.replace("_", "-"): value for name, value in headers.items()}
    address = f"ws://127.0.0.1:{gate.port}{target}"
    options = {"proxy": None, "compression": None, "max_size": None, "open_timeout": PATIENCE}
    return connect(address, additional_headers=headers, **options)  # type: ignore[arg-type]


def says_back(connection: ClientConnection, message: str = "hello") -> bool:
    connection.send(message)
    return connection.recv(PATIENCE) == message


def close_in_time(gate: WebGate) -> None:
    thread = threading.Thread(target=gate.close, daemon=True)
    thread.start()
    thread.join(PATIENCE)
    assert not thread.is_alive()
