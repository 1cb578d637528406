"""A run of pytest within a test: a little tree of tests, with the plugins of this directory."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
from left_out import MARKERS

HERE = Path(__file__).parent
_PLUGINS = ("conftest.py", "left_out.py", "second_try.py", "side_by_side.py", "watchdog.py")


def inner_run(root: Path, files: Mapping[str, str], *options: str, code: int = 0) -> str:
    """Run tests in workers side by side; return what is said.

    Args:
        root: an empty directory, in which the tests run.
        files: the text of each test file, by its path below `tests`.
        options: of pytest.
        code: exit code that is expected.
    """
    pytest.importorskip("xdist")
    tests = root / "tests"
    for name, text in files.items():
        (tests / name).parent.mkdir(parents=True, exist_ok=True)
        (tests / name).write_text(text)
    for name in _PLUGINS:
        shutil.copy(HERE / name, tests)
    markers = "".join(f"\n    {marker}: ." for marker in ("graph", *MARKERS))
    settings = f"[pytest]\naddopts = --import-mode=importlib --strict-markers\nmarkers ={markers}\n"
    (root / "pytest.ini").write_text(settings)
    distributed = ["-p", "xdist.plugin", "--dist", "loadfile"]
    run = subprocess.run(
        [sys.executable, "-m", "pytest", *distributed, *options, "tests"],
        cwd=root,
        timeout=240,
        env={
            **{n: v for n, v in os.environ.items() if not n.startswith("PYTEST_")},
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        },
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert run.returncode == code, run.stdout
    return run.stdout
