"""Makes what tests share importable under import mode importlib; a master on ideal drives."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

from ideal_drives import Loop


@pytest.fixture
def loop():
    return Loop()


@pytest.fixture
def enabled(loop):
    loop.enable()
    return loop
