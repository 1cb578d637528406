"""The line of the radio's frames on a pseudo-terminal."""

import os

from husky_pu.radio.sbus import BAUD
from husky_pu.radio.sbus_line import SbusLine
from husky_runtime.ports.pty_port import PtyPort

FRAME = bytes(range(25))


def test_a_transmitter_that_starts_again_finds_the_line(tmp_path):
    """The pseudo-terminal still has the settings of the one before."""
    with PtyPort(tmp_path / "sbus") as receiver:
        for number in range(3):
            line = SbusLine(str(receiver.path))
            assert line.write(FRAME, float(number)), line.error
            assert receiver.read(BAUD) == FRAME
            line.close()


def test_a_terminal_that_a_dead_receivers_link_leads_to_gets_no_frames(tmp_path):
    (tmp_path / "sbus.lock").touch()  # and nobody holds it
    master, terminal = os.openpty()
    (tmp_path / "sbus").symlink_to(os.ttyname(terminal))
    line = SbusLine(str(tmp_path / "sbus"))
    assert not line.write(FRAME, 0.0)
    assert "left behind by a process that has died" in line.error
    os.close(terminal)
    os.close(master)
