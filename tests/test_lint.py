"""Style, types and directions of imports of the whole tree."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = sorted(str(path) for path in ROOT.glob("ros2_ws/src/husky_*/husky_*"))
CHECKS = {
    "ruff": ("ruff", "check", "--output-format", "concise", "."),
    "yamllint": ("yamllint", "--strict", ".github"),
    "imports": ("lint-imports", "--no-cache"),
    "mypy": (sys.executable, "-m", "mypy", *PACKAGES),
}


@pytest.mark.timeout(900)
@pytest.mark.parametrize("check", CHECKS)
def test_the_tree_passes(check):
    """The first time mypy reads everything that is imported, which takes it a minute."""
    result = subprocess.run(CHECKS[check], cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
