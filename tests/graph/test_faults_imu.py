"""An IMU or its line that fails while the robot trots."""

import pytest

from husky_runtime import graph

pytestmark = pytest.mark.graph


@pytest.mark.parametrize(
    ("fault", "report"),
    [
        ("stop", "stale"),
        # In one process: a frozen device and damaged packets in husky_sim's test_vn200_closed_loop.
        pytest.param("repeat", "stale", marks=pytest.mark.slow),
        # It is asked, answers, and streams again as far as it can be told.
        pytest.param("flip_bits:20", "", marks=pytest.mark.slow),
        # Of the driver's process: tests/test_vn200_driver; the robot's way down: as with `stop`.
        pytest.param("unplug", "no port", marks=pytest.mark.slow),
    ],
)
def test_imu_lost(trotting, record_property, fault, report):
    s = trotting.session
    damaged = _damaged(trotting)
    failed = trotting.watch()
    s.inject(graph.PLANT_INJECT_FAULT, "imu", fault)
    trotting.until(lambda: trotting.mode == "settle", "settle", within=0.1)
    assert "IMU" in s.state.reason, trotting.seen
    s.advance(0.7)
    record_property("reaction_s", trotting.settled(failed))
    assert s.drives.operational, "damping needs the drives"
    trotting.reported(graph.LOW_LEVEL_CONTROLLER, "vn200_driver is lost")
    trotting.reported(graph.VN200_DRIVER, report)
    assert (_damaged(trotting) > damaged) == fault.startswith("flip_bits")
    s.inject(graph.PLANT_INJECT_FAULT, "imu", "")
    trotting.reported(graph.VN200_DRIVER, "streaming", "stale")
    trotting.recover()


@pytest.mark.slow  # the driver's process alone: tests/test_vn200_driver; the way down: `stop`
def test_imu_starts_again(trotting, record_property):
    """It comes back with the settings of its flash memory: another baud rate, another output."""
    s = trotting.session
    failed = trotting.watch()
    s.inject(graph.PLANT_INJECT_FAULT, "imu", "power_cycle")
    trotting.until(lambda: trotting.mode == "settle", "settle", within=0.1)
    s.advance(0.7)
    record_property("reaction_s", trotting.settled(failed))
    trotting.until(
        lambda: "lost" not in trotting.reported(graph.LOW_LEVEL_CONTROLLER, "").message,
        "the driver to find the device and set it up by itself",
        within=2.0,
        step=0.2,
    )
    trotting.recover()


def test_line_that_damages_some_packets(trotting, record_property):
    """Each fifth packet or so is damaged: none of them gets in, and the robot trots on."""
    s = trotting.session
    before = _damaged(trotting)
    s.inject(graph.PLANT_INJECT_FAULT, "imu", "flip_bits:0.2")
    s.advance(0.5)
    damaged = _damaged(trotting) - before
    record_property("damaged", damaged)
    assert damaged > 20
    assert trotting.mode == "walk" and trotting.height > 0.5, trotting.seen
    s.inject(graph.PLANT_INJECT_FAULT, "imu", "")


def _damaged(robot):
    values = robot.reported(graph.VN200_DRIVER, "").values
    return sum(int(each.value) for each in values if each.key in ("crc_errors", "truncated"))
