"""The line of the radio's frames on a pseudo-terminal."""

from husky_description.pty_port import PtyPort
from husky_pu.sbus import BAUD
from husky_pu.sbus_line import SbusLine

FRAME = bytes(range(25))


def test_a_transmitter_that_starts_again_finds_the_line(tmp_path):
    """The pseudo-terminal still has the settings of the one before."""
    with PtyPort(tmp_path / "sbus") as receiver:
        for number in range(3):
            line = SbusLine(str(receiver.path))
            assert line.write(FRAME, float(number)), line.error
            assert receiver.read(BAUD) == FRAME
            line.close()
