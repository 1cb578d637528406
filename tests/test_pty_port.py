"""The pseudo-terminal as a serial line: bytes, baud rates, plugs, paths."""

import os
import select
import termios

import pytest
import serial
from hypothesis import assume, given
from hypothesis import strategies as st

from husky_drivers.vn200.binary import IMU_LAYOUT
from husky_drivers.vn200.protocol import BAUDS, crc16
from husky_drivers.vn200.stream import StreamParser
from husky_runtime.ports.pty_port import PtyPort, receive
from husky_runtime.ports.serial_line import open_serial

ALL_BYTES = bytes(range(256))


@pytest.fixture
def port(tmp_path):
    with PtyPort(tmp_path / "dev" / "imu") as port:
        yield port


@pytest.fixture
def terminal():
    """A terminal of somebody else's."""
    master, slave = os.openpty()
    yield slave
    os.close(slave)
    os.close(master)


def left_behind(path):
    """Return the path, of a port whose process has been killed."""
    child = os.fork()
    if child == 0:
        PtyPort(path)
        os._exit(0)  # no clean-up
    os.waitpid(child, 0)
    assert path.is_symlink()
    return path


def open_host(port, baud=921600):
    host = serial.Serial(str(port.path), baud, timeout=0, exclusive=True)
    port.read(baud)  # the device's end notices
    return host


def host_read(host, count):
    """Return what has arrived once there is at least so much; the wait is for a slow machine."""
    data = b""
    while len(data) < count and select.select([host], [], [], 10.0)[0]:
        data += os.read(host.fileno(), 4096)
    return data


def test_bytes_go_both_ways_unchanged(port):
    with open_host(port) as host:
        assert port.write(ALL_BYTES, 921600) == 256
        assert host_read(host, 256) == ALL_BYTES
        host.write(ALL_BYTES)
        assert port.read(921600) == ALL_BYTES
        assert port.read(921600) == b""
        assert port.connected


@pytest.mark.parametrize("baud", BAUDS)
def test_the_hosts_rate_is_known(port, baud):
    with open_host(port, baud):
        assert port.host_baud == baud


def test_a_wrong_rate_makes_garbage_both_ways(port):
    with open_host(port, 115200) as host:
        port.write(b"$VNYPR,+010.071\r\n", 921600)
        port.write(b"\x00", 115200)  # the end mark
        arrived = host_read(host, 1)
        assert b"$" not in arrived and b"VN" not in arrived
        host.write(b"$VNASY,0*4F\r\n")
        garbled = port.read(921600)
        assert garbled and b"VN" not in garbled


def test_nobody_listening_loses_the_bytes_and_counts_them(port):
    assert port.read(921600) == b""
    assert not port.connected
    assert port.write(bytes(54), 921600) == 0
    assert port.dropped == 54
    with open_host(port) as host:
        port.write(b"new", 921600)
        assert host_read(host, 3) == b"new"
    assert port.read(921600) == b""
    port.write(bytes(10), 921600)
    assert port.dropped == 64


def test_a_host_that_does_not_read_blocks_nobody(port):
    with open_host(port):
        for _ in range(20_000):
            port.write(bytes(54), 921600)
        assert port.dropped > 500_000


def test_a_pulled_plug_hangs_the_host_up_and_the_path_is_gone(port):
    with open_host(port) as host:
        port.unplug()
        assert not port.plugged
        assert not port.path.is_symlink()
        assert select.select([host], [], [], 10.0)[0]
        assert os.read(host.fileno(), 10) == b""  # end of file: hung up
        assert port.write(b"lost", 921600) == 0
        assert port.read(921600) == b""
    port.replug()
    with open_host(port) as host:
        port.write(b"back", 921600)
        assert host_read(host, 4) == b"back"


def test_a_live_path_is_not_stolen_and_a_stale_one_is_replaced(tmp_path):
    path = tmp_path / "imu"
    path.symlink_to("/dev/pts/does-not-exist")
    first = PtyPort(path)
    with pytest.raises(FileExistsError, match="another process serves this port"):
        PtyPort(path)
    assert os.path.exists(path)
    with open_host(first) as host:
        first.write(b"alive", 921600)
        assert host_read(host, 5) == b"alive"
    first.close()
    assert list(tmp_path.iterdir()) == []
    PtyPort(path).close()


def test_the_port_of_a_killed_process_is_replaced(tmp_path):
    path = left_behind(tmp_path / "imu")
    with PtyPort(path) as port, open_host(port) as host:
        port.write(b"mine", 921600)
        assert host_read(host, 4) == b"mine"


def test_what_a_killed_process_has_left_is_not_opened(tmp_path, terminal):
    """The number of its pseudo-terminal has been given to somebody else."""
    path = left_behind(tmp_path / "imu")
    path.unlink()
    path.symlink_to(os.ttyname(terminal))
    with pytest.raises(FileNotFoundError, match="left behind by a process that has died"):
        open_serial(str(path), 921600)
    with PtyPort(path) as port:
        open_serial(str(path), 921600).close()
        port.unplug()
        with pytest.raises(OSError, match="No such file"):
            open_serial(str(path), 921600)


def test_a_link_of_ones_own_is_opened(tmp_path, terminal):
    path = tmp_path / "imu"
    path.symlink_to(os.ttyname(terminal))
    open_serial(str(path), 921600).close()


def test_a_real_file_is_never_replaced(tmp_path):
    path = tmp_path / "imu"
    path.write_text("precious")
    with pytest.raises(FileExistsError, match="is no symbolic link"):
        PtyPort(path)
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]


def test_the_terminal_neither_echoes_nor_edits(port):
    with open_host(port) as host:
        flags = termios.tcgetattr(host.fileno())[3]
        assert not flags & (termios.ECHO | termios.ICANON | termios.ISIG)
        port.write(b"\x03\x04\r\n\x11\x13", 921600)
        assert host_read(host, 6) == b"\x03\x04\r\n\x11\x13"
        assert port.read(921600) == b""


# The UART ---------------------------------------------------------------------------------------
@given(data=st.binary(max_size=100), baud=st.sampled_from(BAUDS))
def test_the_same_rate_changes_nothing(data, baud):
    assert receive(data, baud, baud) == data


@given(data=st.binary(min_size=1, max_size=60), error=st.floats(-0.03, 0.03))
def test_three_percent_of_error_are_within_what_a_uart_bears(data, error):
    """A frame of 9.5 bits may be off by half a bit."""
    assert receive(data, 100_000, round(100_000 * (1.0 + error))) == data


@given(payload=st.binary(min_size=48, max_size=48), pair=st.permutations(BAUDS))
def test_no_message_survives_another_rate(payload, pair):
    sent, read = pair[:2]
    assume(max(sent, read) > 1.2 * min(sent, read))  # 115200 and 128000 are close
    packet = IMU_LAYOUT.header + payload
    packet += crc16(packet[1:]).to_bytes(2, "big")
    for message in (packet, b"$VNASY,0*4F\r\n"):
        assert StreamParser(IMU_LAYOUT).feed(message)
        assert not StreamParser(IMU_LAYOUT).feed(receive(message * 3, sent, read) + bytes(600))


@pytest.mark.parametrize(
    ("data", "sent", "read", "received"),
    [
        (b"\x00", 115200, 57600, b"\xf8"),  # 9 low bits: a start bit and 3.5 of twice the length
        (b"\xff", 57600, 115200, b"\xfe"),  # one low bit is two short ones
        (b"\xff", 921600, 9600, b"\xff"),  # a glitch that is taken for a start bit
    ],
)
def test_bytes_worked_out_by_hand(data, sent, read, received):
    assert receive(data, sent, read) == received
