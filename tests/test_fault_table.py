"""The table of faults names every test of a fault, and no other."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OF_FAULTS = ("test_faults_*.py", "test_determinism.py", "test_realtime.py", "test_start_and_end.py",
             "test_world.py")  # fmt: skip


def test_table_of_faults_is_complete():
    named = set(re.findall(r"`(test_\w+)`", (ROOT / "docs/faults.md").read_text()))
    files = [file for pattern in OF_FAULTS for file in (ROOT / "tests/graph").rglob(pattern)]
    there = {
        name for file in files for name in re.findall(r"^def (test_\w+)", file.read_text(), re.M)
    }
    assert files and named == there
