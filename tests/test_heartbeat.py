"""The sign of life that a container engine looks at."""

import pytest

pytest.importorskip("rclpy")


from husky_description.nodes import heartbeat
from husky_description.nodes.executor import WaitSetExecutor


def test_no_file_no_heartbeat(node, monkeypatch):
    monkeypatch.delenv(heartbeat.VARIABLE, raising=False)
    before = len(list(node.timers))
    heartbeat.beat(node)
    assert len(list(node.timers)) == before


def test_it_beats_as_long_as_timers_are_served(node, tmp_path, monkeypatch):
    file = tmp_path / "heartbeat"
    monkeypatch.setenv(heartbeat.VARIABLE, str(file))
    heartbeat.beat(node)
    first = file.stat().st_mtime_ns
    executor = WaitSetExecutor(node)
    while file.stat().st_mtime_ns == first:  # the test's timeout is the only limit
        executor.spin_once()
    executor.close()


def test_a_place_that_cannot_be_written_is_an_error(node, monkeypatch):
    monkeypatch.setenv(heartbeat.VARIABLE, "/proc/nothing/heartbeat")
    with pytest.raises(OSError, match="nothing"):
        heartbeat.beat(node)
