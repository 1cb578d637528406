"""A wall clock that runs slower: processes that must keep real time do so on a slow machine too.

A robot with real devices has no clock but the wall's, so lockstep cannot help it. Its processes and
those that stand for the devices read their clocks, and wait, through `fixtures/slow_clock.c`.
"""

from __future__ import annotations

import shutil
import subprocess
import time
from pathlib import Path

import pytest

_SOURCE = Path(__file__).parent / "fixtures/slow_clock.c"


def slow_clock(directory: Path, rate: float) -> dict[str, str]:
    """Return the environment in which clocks run at a rate from now on, for all processes alike.

    The test is skipped where there is no C compiler.
    """
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    library = directory / "slow_clock.so"
    command = [compiler, "-O2", "-shared", "-fPIC", "-o", library, _SOURCE, "-ldl"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        pytest.skip(f"the slow clock cannot be built here: {done.stderr}")
    begun = f"{rate} {time.monotonic_ns()} {time.time_ns()}"
    return {"LD_PRELOAD": str(library), "HUSKY_SLOW_CLOCK": begun}
