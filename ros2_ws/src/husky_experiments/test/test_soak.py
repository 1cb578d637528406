"""A soak's criteria on synthetic samples, and its meter on a process that holds what it is told."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_description.robot import load_robot
from husky_experiments.figures.soak import draw_soak
from husky_experiments.metrics.message_counts import (
    GraphCounters,
    count_in_bag,
    count_on_wires,
    counters_of,
)
from husky_experiments.metrics.resources import ResourceMeter, Sample, Usage
from husky_experiments.metrics.soak import growth, growths, judged
from husky_experiments.recordings.recording import Recording
from husky_runtime import graph

BEGIN = 60.0
JOINT_STATES = graph.absolute(graph.JOINT_STATES)
NODES = ("plant", "planner")
Leak = Callable[[float, Usage], Usage]


def samples(
    duration: float = 600.0, leak: Leak | None = None, **common: Callable[[float], int]
) -> list[Sample]:
    """Of a soak at half of real time that is flat after some warm-up, but for a leak."""
    rng = np.random.default_rng(6)
    made = []
    for time in np.arange(0.0, duration, 2.0):
        warm = min(1.0, time / 30.0)
        nodes = {name: Usage(int(1e8 * warm + rng.integers(0, 20_000)), 20, 14) for name in NODES}
        if leak is not None:
            nodes["planner"] = leak(time, nodes["planner"])
        sample = Sample(time, 1e3 + 2.0 * time, nodes, 68, 7_262_208, 1000 + int(20 * time))
        made.append(
            dataclasses.replace(sample, **{name: value(time) for name, value in common.items()})
        )
    return made


def failing(made: list[Sample]) -> set[str]:
    return {name for name, (value, upper) in judged(growths(made, BEGIN)).items() if value > upper}


@pytest.mark.parametrize("duration", [90.0, 600.0, 3600.0])
def test_what_is_flat_passes(duration: float) -> None:
    assert failing(samples(duration)) == set()


@pytest.mark.parametrize(
    ("leak", "criterion"),
    [
        # The bytes of one small object a tick.
        (lambda t, u: dataclasses.replace(u, memory=u.memory + int(56 * 500 * t)), "memory"),
        # 30 kB with each plan, one in five seconds.
        (lambda t, u: dataclasses.replace(u, memory=u.memory + 30_000 * int(t / 5)), "memory"),
        (lambda t, u: dataclasses.replace(u, descriptors=20 + int(t > 300)), "descriptors"),
        (lambda t, u: dataclasses.replace(u, threads=14 + int(t / 100)), "threads"),
    ],
)
def test_a_leak_of_one_node_fails(leak: Leak, criterion: str) -> None:
    assert failing(samples(leak=leak)) == {f"{criterion}_growth_worst"} or failing(
        samples(leak=leak)
    ) == {f"{criterion}_growth_mb_worst"}


@pytest.mark.parametrize(
    ("common", "criterion"),
    [
        ({"shared_entries": lambda t: 68 + int(t / 200)}, "shared_memory_entries_growth"),
        ({"shared_bytes": lambda t: 7_000_000 + int(1000 * t)}, "shared_memory_growth_mb"),
        # A line of 100 bytes, twice a second of wall time.
        ({"log_bytes": lambda t: int(100 * 2 * 2.0 * t)}, "log_kb_per_minute"),
    ],
)
def test_a_leak_of_all_fails(common: dict[str, Callable[[float], int]], criterion: str) -> None:
    assert failing(samples(**common)) == {criterion}


@given(st.lists(st.floats(0.0, 1e6), min_size=8, max_size=100), st.data())
def test_growth_is_none_of_what_comes_and_goes(values: list[float], data: Any) -> None:
    """A few samples however high do not count, a step that stays does, in full."""
    flat = [5.0] * 100
    for place in data.draw(st.lists(st.integers(0, 99), max_size=10)):
        flat[place] = data.draw(st.sampled_from(values))
    assert growth(flat) == 0.0
    assert growth([*flat[:50], *(value + 3.0 for value in flat[50:])]) == 3.0


def test_a_node_that_is_gone_is_no_flat_node() -> None:
    made = samples()
    made[-1] = dataclasses.replace(made[-1], nodes={"plant": made[-1].nodes["plant"]})
    with pytest.raises(ValueError, match="no process of planner at 598 s"):
        growths(made, BEGIN)
    with pytest.raises(ValueError, match="0 samples after 700 s"):
        growths(made, 700.0)


def test_the_figure(tmp_path: Path) -> None:
    path = draw_soak(samples(100.0), BEGIN, tmp_path / "figures")
    assert path.read_bytes().startswith(b"\x89PNG")


# The meter ------------------------------------------------------------------------------------
_HOLDER = """
import mmap, os, sys, threading
log, data, shared = (open(path, "a+b") for path in sys.argv[1:4])
held = []
print("ready", flush=True)
for line in sys.stdin:
    what, count = line.split()
    count = int(count)
    if what == "memory":
        held.append(b"x" * count)
    elif what == "files":
        held.append([open(os.devnull) for _ in range(count)])
    elif what == "threads":
        held.append([threading.Thread(target=threading.Event().wait, daemon=True)
                     for _ in range(count)])
        [thread.start() for thread in held[-1]]
    elif what == "shared":
        shared.truncate(count)
        held.append(mmap.mmap(shared.fileno(), count))
        held[-1].write(b"x" * count)
        shared.close()
    else:
        {"log": log, "data": data}[what].write(b"x" * count)
        log.flush(), data.flush()
    print("done", flush=True)
"""


class Holder:
    """A process in a group of its own, below a parent."""

    def __init__(self, directory: Path):
        self.shared = Path(f"/dev/shm/husky_test_{os.getpid()}")
        (directory / "bag").mkdir()
        paths = [directory / "log", directory / "bag" / "bag.mcap", self.shared]
        command = [sys.executable, "-c", _HOLDER, *map(str, paths)]
        self.process = subprocess.Popen(
            ["sh", "-c", '"$@"; true', "sh", *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self.meter = ResourceMeter({"holder": self.process.pid}, {}, directory / "bag")
        self._hear()

    def _hear(self) -> None:
        assert self.process.stdout is not None
        assert self.process.stdout.readline()

    def hold(self, what: str, count: int) -> Sample:
        assert self.process.stdin is not None
        print(what, count, file=self.process.stdin, flush=True)
        self._hear()
        return self.meter.look(0.0)


@pytest.fixture
def holder(tmp_path: Path) -> Iterator[Holder]:
    holder = Holder(tmp_path)
    yield holder
    holder.process.communicate()
    holder.shared.unlink()


def test_the_meter_sees_what_a_process_holds(holder: Holder) -> None:
    before = holder.meter.look(0.0)
    first = holder.hold("log", 1000)
    assert set(first.nodes) == {"holder"}
    assert first.log_bytes - before.log_bytes == 1000
    assert first.shared_entries >= 1

    after = holder.hold("memory", 30_000_000)
    grown = after.nodes["holder"].memory - first.nodes["holder"].memory
    assert grown == pytest.approx(30e6, rel=0.01)

    after = holder.hold("files", 7)
    assert after.nodes["holder"].descriptors - first.nodes["holder"].descriptors == 7
    after = holder.hold("threads", 3)
    assert after.nodes["holder"].threads - first.nodes["holder"].threads == 3

    own = after.nodes["holder"].memory
    after = holder.hold("shared", 1_000_000)  # mapped, and no longer open
    assert after.shared_entries == first.shared_entries
    assert after.shared_bytes - first.shared_bytes == pytest.approx(1e6, abs=4096)
    assert after.nodes["holder"].memory - own < 200_000, "shared memory is counted once"

    after = holder.hold("data", 5000)
    assert after.log_bytes == first.log_bytes, "a bag is no log"
    assert holder.hold("log", 500).log_bytes == first.log_bytes + 500


def test_the_meter_sees_a_process_apart_from_its_group(holder: Holder, tmp_path: Path) -> None:
    meter = ResourceMeter({"holder": holder.process.pid}, {"test": os.getpid()}, tmp_path)
    usages = meter.look(0.0).nodes
    assert set(usages) == {"holder", "test"}
    assert usages["test"].memory > usages["holder"].memory > 0


# Messages -------------------------------------------------------------------------------------
def reports(counted: GraphCounters, ticks: int, **wrong: float) -> dict[str, dict[str, float]]:
    made: dict[str, dict[str, float]] = {}
    for counter in counted.faults:
        made.setdefault(counter.node, {})[counter.key] = 0.0
    for wire in counted.wires:
        count = round((wire.rate or 100.0) * ticks * graph.TICK_PERIOD)
        for end in (wire.sender, wire.receiver):
            if end is not None:
                made.setdefault(end.node, {})[end.key] = count
    for name, value in wrong.items():
        node, _, key = name.partition("__")
        made[node][key] = value
    return made


@pytest.mark.parametrize(
    ("robot", "bridge"), [("carbon", graph.DRIVE_BRIDGE), ("beta", graph.SERVO_BRIDGE)]
)
def test_messages_on_wires_are_counted(robot: str, bridge: str) -> None:
    counted = counters_of(load_robot(robot))
    before, after = reports(counted, 100), reports(counted, 30_100)
    assert counted.nodes == before.keys() | {graph.PLANT}
    counts = count_on_wires(counted.wires, before, after, 60.0)
    assert set(counts) == {wire.name for wire in counted.wires}
    assert all(count.equal for count in counts.values())
    assert counts[JOINT_STATES].received == 30_000

    lost = reports(counted, 30_100, low_level_controller__ticks=30_099)
    unequal = [
        n for n, c in count_on_wires(counted.wires, before, lost, 60.0).items() if not c.equal
    ]
    assert unequal == [JOINT_STATES]
    del lost[bridge]["cycles"]
    with pytest.raises(LookupError, match=f"{bridge} does not report cycles"):
        count_on_wires(counted.wires, before, lost, 60.0)


@pytest.mark.parametrize(("left_out", "equal"), [(1, True), (6, False)])
def test_messages_in_the_bag_are_counted(
    tmp_path: Path, write_bag: Any, messages: Any, left_out: int, equal: bool
) -> None:
    """Each stamp once, however often the message was said; a thousandth may be missing."""
    tick, zeros = graph.TICK_PERIOD_NS, [0.0] * 12
    numbers = [0, *range(1, 500), *range(500 + left_out, 1501), 1500]
    content = [
        (JOINT_STATES, messages.joint_states(i * tick, zeros, zeros, zeros)) for i in numbers
    ]
    write_bag(tmp_path / "bag", content)
    (count,) = count_in_bag(Recording(tmp_path / "bag"), 0.2, 2.8).values()
    assert (count.sent, count.received) == (1300, 1300 - left_out)
    assert count.equal is equal
