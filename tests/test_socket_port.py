"""The stream socket of a simulated device: bytes, plugs, paths."""

import os
import select
import socket
from pathlib import Path

import pytest

from husky_runtime.ports.socket_port import SocketPort

LONG = bytes(range(256)) * 1000
"""About as long as seven depth images."""


class Device:
    """Says what it is told to say, whole, and keeps what it hears."""

    def __init__(self):
        self.heard, self.output = b"", b""

    def feed(self, data):
        self.heard += data

    def take_output(self):
        output, self.output = self.output, b""
        return output


@pytest.fixture
def port(tmp_path):
    with SocketPort(tmp_path / "dev" / "d435") as port:
        yield port


@pytest.fixture
def device():
    return Device()


def connect(port):
    host = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    host.connect(str(port.path))
    host.setblocking(False)
    return host


def read_all(host, port, device, count):
    """Return what has come once there are so many bytes; the port is served meanwhile."""
    data = b""
    while len(data) < count:
        port.service(device)
        if select.select([host], [], [], 0.0)[0]:
            data += host.recv(65536)
    return data


def test_bytes_go_both_ways_unchanged(port, device):
    with connect(port) as host:
        host.sendall(b"give me more")
        device.output = LONG
        assert port.service(device) and port.connected
        assert device.heard == b"give me more"
        assert read_all(host, port, device, len(LONG)) == LONG
        assert not port.service(device)


def test_a_driver_that_does_not_read_is_not_asked_for_more(port, device):
    """Whole outputs wait at the device, which may drop images; no image is sent in part."""
    with connect(port) as host:
        sent = 0
        while not device.output:
            device.output = LONG
            sent += 1
            port.service(device)
        data = read_all(host, port, device, sent * len(LONG))
        assert data == LONG * sent and not device.output
        assert port.dropped == 0


def test_without_a_driver_bytes_are_lost_and_counted(port, device):
    device.output = LONG
    port.service(device)
    assert not port.connected and port.dropped == len(LONG)
    with connect(port) as host:
        device.output = b"fresh"
        assert read_all(host, port, device, 5) == b"fresh"


def test_one_driver_after_the_other(port, device):
    with connect(port) as first:
        port.service(device)
        with connect(port) as second:  # waits in the queue
            device.output = b"1"
            assert read_all(first, port, device, 1) == b"1"
            first.close()
            port.service(device)
            device.output = b"2"
            assert read_all(second, port, device, 1) == b"2"


def test_unplug_hangs_up_and_replug_lets_in(port, device):
    with connect(port) as host:
        port.service(device)
        port.unplug()
        assert select.select([host], [], [], 10.0)[0] and host.recv(1) == b""
        assert not port.path.exists() and not port.plugged
    with pytest.raises(FileNotFoundError):
        connect(port)
    device.output = LONG
    port.service(device)
    assert port.dropped == len(LONG)
    port.replug()
    with connect(port) as host:
        device.output = b"again"
        assert read_all(host, port, device, 5) == b"again"


def test_who_serves_the_path_is_alone(port):
    read_end, write_end = os.pipe()
    if os.fork() == 0:
        try:
            SocketPort(port.path)
        except FileExistsError as error:
            os.write(write_end, str(error).encode())
        os._exit(0)
    os.close(write_end)
    with os.fdopen(read_end, "rb") as answer:
        assert b"another process serves this port" in answer.read()
    os.wait()


def test_a_socket_left_behind_by_a_dead_process_is_replaced(tmp_path, device):
    path = tmp_path / "d435"
    if os.fork() == 0:
        SocketPort(path)
        os._exit(0)  # no clean-up
    os.wait()
    assert path.is_socket()
    with pytest.raises(ConnectionRefusedError), socket.socket(socket.AF_UNIX) as host:
        host.connect(str(path))
    with SocketPort(path) as port, connect(port) as host:
        device.output = b"alive"
        assert read_all(host, port, device, 5) == b"alive"
    assert not list(tmp_path.iterdir())


def test_something_else_at_the_path_is_left_alone(tmp_path):
    path: Path = tmp_path / "d435"
    path.write_text("precious")
    with pytest.raises(FileExistsError, match="exists and is no socket"):
        SocketPort(path)
    assert path.read_text() == "precious"
