"""The companion's line: what a connection may be, whom `udpin` hears, a port that comes back."""

import socket
import time

import pytest

from husky_pu.companion.client import ClientConfig, MavlinkClient
from husky_pu.companion.link import CompanionLink, MavlinkUdp, opener
from husky_runtime.ports.pty_port import PtyPort


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def wait(condition, what):
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end, f"waited in vain: {what}"
        time.sleep(0.01)


@pytest.mark.parametrize(
    "connection",
    ["", "serial:/dev/x", "serial::9600", "tcp:1.2.3.4:5", "udpin:1.2.3.4:", "udpout::1",
     "serial:/dev/x:fast", "udpin:127.0.0.1:0", "udpout:127.0.0.1:65536"],
)  # fmt: skip
def test_a_bad_connection_is_refused(connection):
    with pytest.raises(ValueError, match="connection is "):
        opener(connection)


def test_a_port_that_is_not_there_cannot_be_opened(tmp_path):
    with pytest.raises(OSError, match="gone"):
        opener(f"serial:{tmp_path}/gone:921600")()


def test_udpin_hears_one_peer_at_a_time(monkeypatch):
    number, now = free_port(), [100.0]
    monkeypatch.setattr("husky_pu.companion.link.time.monotonic", lambda: now[0])
    port = opener(f"udpin:127.0.0.1:{number}")()
    peers = [MavlinkUdp(("127.0.0.1", number), bind=False) for _ in range(2)]
    try:
        assert port.write(b"nobody is there") == 0
        for seconds, peer, heard in ((0, 0, True), (1, 1, False), (1.5, 0, True), (4, 1, True)):
            now[0] = 100.0 + seconds
            peers[peer].write(b"hello")
            assert port.read() == (b"hello" if heard else b"")
            assert port.read() == b""
        port.write(b"answer")
        assert (peers[0].read(), peers[1].read()) == (b"", b"answer")
    finally:
        for one in (port, *peers):
            one.close()


def test_udpout_survives_that_nobody_listens():
    port = opener(f"udpout:127.0.0.1:{free_port()}")()
    for _ in range(5):
        port.write(b"hello")
        assert port.read() == b""
    port.close()


def test_the_line_is_opened_again_and_again(tmp_path, make_autopilot):
    told, autopilot = [], make_autopilot()
    client = MavlinkClient(ClientConfig(4))
    link = CompanionLink(
        client,
        opener(f"serial:{tmp_path}/line:921600"),
        lambda report: None,
        lambda text, heard: told.append((text.split(":")[0], heard)),
    )
    link.start()
    wait(lambda: told, "a word on the missing port")
    with PtyPort(tmp_path / "line") as port:
        for round_ in (1, 2):
            port.replug()

            def serve():
                autopilot.heartbeat()
                port.service(autopilot)
                return link.state == "connected"

            wait(serve, "the autopilot")
            with link.talk() as held:
                held.heartbeat(1e6 * round_)

            def heard(count=round_):
                port.service(autopilot)
                return len(autopilot.of("HEARTBEAT")) >= count

            wait(heard, "our heartbeat")
            port.unplug()
            wait(lambda: link.state == "no port", "the loss of the port")
            assert not client.connected
    link.stop()
    assert link.state == "stopped"
    # Between port and autopilot there may be a moment, which is told too.
    found = [word for word in told if word != ("no autopilot", False)]
    assert found == [("no port", False), *[("connected", True), ("no port", False)] * 2]
    assert (link.connections, client.connections) == (2, 2)
