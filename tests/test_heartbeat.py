"""The sign of life that a container engine looks at."""

import pytest

pytest.importorskip("rclpy")


from husky_runtime.nodes.executor import WaitSetExecutor
from husky_runtime.nodes.run import HEARTBEAT, beat


def test_no_file_no_heartbeat(node, monkeypatch):
    monkeypatch.delenv(HEARTBEAT, raising=False)
    before = len(list(node.timers))
    beat(node)
    assert len(list(node.timers)) == before


def test_it_beats_as_long_as_timers_are_served(node, tmp_path, monkeypatch):
    file = tmp_path / "heartbeat"
    monkeypatch.setenv(HEARTBEAT, str(file))
    beat(node)
    first = file.stat().st_mtime_ns
    executor = WaitSetExecutor(node)
    while file.stat().st_mtime_ns == first:  # the test's timeout is the only limit
        executor.spin_once()
    executor.close()


def test_a_place_that_cannot_be_written_is_an_error(node, monkeypatch):
    monkeypatch.setenv(HEARTBEAT, "/proc/nothing/heartbeat")
    with pytest.raises(OSError, match="nothing"):
        beat(node)
