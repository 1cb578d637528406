"""Programs as the scripts run them: a signal ends them, whatever they are doing."""

import subprocess
import sys

import pytest

SWALLOWS = """
import os, signal

class Swallower:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGTERM)

swallower = Swallower()
del swallower
print("it goes on")
"""


@pytest.mark.parametrize("end", ["", "raise SystemExit(0)"])
def test_a_signal_whose_exception_is_swallowed_ends_it_all_the_same(tmp_path, end):
    """As by an extension in C++ that calls back into Python."""
    program = tmp_path / "program.py"
    program.write_text(SWALLOWS + end)
    command = [sys.executable, "-m", "husky_bringup.front", str(program)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.stdout == "it goes on\n" and "ended by SIGTERM" in ended.stderr
    assert ended.returncode == 128 + 15
