"""EtherCAT frames: twelve simulated drives through SOEM, a bare SOEM loop beside them.

The slaves run in processes of their own, as in the robot, each at the far end of a veth pair:

    python ethercat.py drives INTERFACE     the simulated drives, as the node drive_segment has them
    python ethercat.py minimal INTERFACE    least work on a cyclic frame: the working counter

The thesis has its EtherCAT master issue position commands to 12 drives at 10 kHz; the drives return
encoder values at 500 Hz to 4 kHz (ch. 2, "Communication Between Modules"). This robot's cycle is
2 ms, 500 Hz.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import os
import select
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from husky_bringup.settings import HelpFormatter
from husky_description.robot import load_robot
from husky_drivers.ethercat import objects as od
from husky_drivers.ethercat import pdo
from husky_drivers.ethercat.axes import settings_of
from husky_drivers.ethercat.bus import AlState, BusOptions
from husky_drivers.ethercat.commissioning import DriveError
from husky_drivers.ethercat.interface import ETHERTYPE, check_interface
from husky_drivers.ethercat.master import Master
from husky_drivers.ethercat.soem_bus import SoemBus
from husky_experiments.session import SessionError
from husky_runtime import graph, starter
from husky_sim.devices.drives.segment import SimulatedSegment
from husky_sim.devices.ethercat.cable import Cable
from husky_sim.devices.ethercat.frames import DATAGRAM_HEADER, HEADER, Command
from husky_sim.devices.ethercat.raw_port import RawPort
from husky_sim.devices.ethercat.wired_segment import WiredSegment

THESIS_RATE = 10_000.0
"""Position commands of the thesis's EtherCAT master to 12 drives [Hz]."""
MOST_LATE = 0.001
"""Share of cycles that may be late where a rate counts as held [-]."""
_DRIVES, _BARE = ("ecat0", "ecat1"), ("bare0", "bare1")
"""Veth pairs, the master's end first: of `scripts/wire.sh`, and one of the same kind for the bare
loop. On one pair each master would find the other's frames in its socket.
"""
_PATIENCE = 0.02
"""Time after which a frame counts as lost [s]: that of `drive_bridge` beside simulated drives."""
_START = 30.0
"""Wall time in which a far side must be ready [s]."""
_TO_OP = 5.0
"""Wall time in which the slaves of the bare loop must be in OP [s]."""
_PROBE = 1.0
"""Length of a run that looks for a rate [s]."""
_ATTEMPTS = 3
"""Runs at a rate before a lower one is tried: a neighbour on the machine may disturb one."""
_LOWEST_RATE = 100.0
"""Below which none is looked for [Hz]."""
_SPIN_NS = 150_000
"""Time before the beginning of a cycle that is not slept [ns]: sleeping takes longer than asked."""

Exchange = Callable[[], bool]
"""One exchange of process data; returns whether the working counter is complete."""


def bench(arguments: list[str]) -> dict[str, Any]:
    """Round trip and highest rate of process data over frames; a bare SOEM loop beside it."""
    parser = argparse.ArgumentParser(
        prog="scripts/bench.sh ethercat", formatter_class=HelpFormatter
    )
    parser.add_argument("--cycles", type=int, default=100_000, help="of each of the two loops")
    parser.add_argument("--block", type=int, default=1000, help="cycles until the other's turn")
    parser.add_argument("--seconds", type=float, default=10.0, help="a rate is to be held [s]")
    what = (
        "of SCHED_FIFO while round trips are timed, as on the robot, where it is allowed; 0: none. "
        "Rates are looked for without: the kernel stops what uses a processor for more than 95 %% "
        "of a second (sched_rt_runtime_us)"
    )
    parser.add_argument("--priority", type=int, default=80, help=what)
    options = parser.parse_args(arguments)
    try:
        check_interface(_DRIVES[0])
        with contextlib.ExitStack() as stack:
            stack.enter_context(_cable(*_BARE))
            processes = [
                stack.enter_context(_far_side("drives", _DRIVES[1])),
                stack.enter_context(_far_side("minimal", _BARE[1])),
            ]
            bus, bare = stack.enter_context(_drive_bus()), stack.enter_context(_bare_loop())
            with _priority(options.priority, processes) as priority:
                metrics = {"priority": priority} | _round_trips(bus, bare, options)
            return metrics | _rates(bus, bare, metrics, options.seconds)
    except (DriveError, OSError) as error:
        raise SessionError(str(error)) from None


@contextlib.contextmanager
def _priority(priority: int, processes: list[int]) -> Iterator[int]:
    """Give a priority of SCHED_FIFO to this process and others; yield the one it is."""
    threads = [0] + [
        int(task.name) for pid in processes for task in Path(f"/proc/{pid}/task").iterdir()
    ]
    try:
        if priority:
            for thread in threads:
                os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        priority = 0
    try:
        yield priority
    finally:
        for thread in threads:
            os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))


@dataclass
class _Loop:
    """Round trips of a loop.

    Attributes:
        exchange: one cycle.
        times_ns: of the cycles [ns].
        lost: exchanges without a complete working counter.
    """

    exchange: Exchange
    times_ns: list[int] = field(default_factory=list)
    lost: int = 0

    def run(self, cycles: int) -> None:
        """Run cycles, one at once after the other."""
        exchange, clock = self.exchange, time.perf_counter_ns
        for _ in range(cycles):
            start = clock()
            complete = exchange()
            self.times_ns.append(clock() - start)
            self.lost += not complete

    def metrics(self, prefix: str) -> dict[str, Any]:
        """Return percentiles [us] and the number of lost frames."""
        times = np.array(self.times_ns) / 1e3
        return {
            f"{prefix}_us_p50": float(np.percentile(times, 50)),
            f"{prefix}_us_p99": float(np.percentile(times, 99)),
            f"{prefix}_us_max": float(times.max()),
            f"{prefix}_lost": self.lost,
        }


def _round_trips(bus: Exchange, bare: Exchange, options: argparse.Namespace) -> dict[str, Any]:
    ours, theirs = _Loop(bus), _Loop(bare)
    for loop in (ours, theirs):
        _Loop(loop.exchange).run(options.block)  # warm-up
    gc.collect()
    gc.freeze()  # as the nodes do
    while (left := options.cycles - len(ours.times_ns)) > 0:
        for loop in (ours, theirs):
            loop.run(min(options.block, left))
    metrics: dict[str, Any] = {"cycles": options.cycles}
    metrics |= ours.metrics("cycle") | theirs.metrics("bare")
    metrics["cycle_over_bare"] = metrics["cycle_us_p50"] / metrics["bare_us_p50"]
    return metrics


# -- rates


def _rates(
    bus: Exchange, bare: Exchange, round_trips: dict[str, Any], seconds: float
) -> dict[str, Any]:
    metrics: dict[str, Any] = {}
    for prefix, exchange in (("", bus), ("bare_", bare)):
        fastest = 1e6 / round_trips["bare_us_p50" if prefix else "cycle_us_p50"]
        rate, late = _highest_rate(exchange, fastest, seconds)
        metrics |= {f"{prefix}rate_hz": rate, f"{prefix}rate_late_percent": 100.0 * late}
    metrics["thesis_rate_hz"] = THESIS_RATE
    metrics["rate_over_thesis"] = metrics["rate_hz"] / THESIS_RATE
    return metrics


def _highest_rate(exchange: Exchange, fastest: float, seconds: float) -> tuple[float, float]:
    """Return the highest rate that is held [Hz], and its share of late cycles [-]; 0 for none.

    Rates are tried from the fastest down, each a tenth lower than the one before: a short run,
    which ends early where too many cycles are late, and a long one to confirm it.

    Args:
        exchange: one cycle.
        fastest: rate that cannot be held, as half of the round trips take longer [Hz].
        seconds: length of the run that confirms [s].
    """
    rate = fastest
    while (rate := 0.9 * rate) > _LOWEST_RATE:
        for _ in range(_ATTEMPTS):
            if _late_share(exchange, rate, _PROBE) <= MOST_LATE:
                late = _late_share(exchange, rate, seconds)
                if late <= MOST_LATE:
                    return rate, late
    return 0.0, 1.0


def _late_share(exchange: Exchange, rate: float, seconds: float) -> float:
    """Return the share of late cycles [-] at a rate [Hz]; a run that ends early has too many."""
    cycles = round(rate * seconds)
    return _late_cycles(exchange, round(1e9 / rate), cycles) / cycles


def _late_cycles(exchange: Exchange, period: int, cycles: int) -> int:
    """Return the number of late cycles; a run with too many ends early.

    A cycle is late when its exchange ends after the beginning of the next period, or fails. The
    next one begins at once then; periods that have passed as a whole had no cycle and are late.

    Args:
        exchange: one cycle.
        period: time from one beginning to the next [ns].
        cycles: length of the run.
    """
    clock = time.perf_counter_ns
    start = clock() + period
    cycle = late = 0
    while cycle < cycles and late <= MOST_LATE * cycles:
        begin = start + cycle * period
        if (left := begin - clock()) > _SPIN_NS:
            time.sleep((left - _SPIN_NS) / 1e9)
        while clock() < begin:
            pass
        complete = exchange()
        over = clock() - begin - period
        if over > 0 or not complete:
            missed = max(0, over // period)
            late += 1 + missed
            cycle += missed
        cycle += 1
    return late


# -- masters


@contextlib.contextmanager
def _drive_bus() -> Iterator[Exchange]:
    """Bring twelve drives to OP as `drive_bridge` does; raises DriveError, OSError."""
    robot = load_robot()
    bus = SoemBus(robot, BusOptions(_DRIVES[0], _PATIENCE, graph.TICK_PERIOD))
    master = Master(bus, settings_of(robot), robot)
    master.configure()
    try:
        master.start()
        outputs = bytes(pdo.RX.itemsize * bus.slave_count)
        complete = bus.expected_working_counter
        yield lambda: bus.exchange(outputs)[1] == complete
    finally:
        master.stop()


@contextlib.contextmanager
def _bare_loop() -> Iterator[Exchange]:
    """Bring the slaves of the second cable to OP with SOEM alone; raises OSError."""
    import pysoem

    master = pysoem.Master()
    master.open(_BARE[0])
    try:
        if master.config_init() != len(load_robot().joint_names):
            raise OSError(f"{len(master.slaves)} slaves answer on {_BARE[0]}, expected are 12")
        for slave in master.slaves:
            _assign(slave, od.RX_COUNT.index, pdo.RX_ASSIGNMENT)
            _assign(slave, od.TX_COUNT.index, pdo.TX_ASSIGNMENT)
        master.config_map()
        master.config_dc()
        patience, complete = round(_PATIENCE * 1e6), 3 * len(master.slaves)
        master.state_check(int(AlState.SAFEOP), round(_TO_OP * 1e6))
        master.state = int(AlState.OP)
        master.write_state()
        end = time.monotonic() + _TO_OP
        while master.read_state() != AlState.OP:
            if time.monotonic() > end:
                raise OSError(f"the slaves on {_BARE[0]} do not come to OP")
            master.send_processdata()
            master.receive_processdata(patience)

        def exchange() -> bool:
            master.send_processdata()
            return bool(master.receive_processdata(patience) == complete)

        yield exchange
    finally:
        master.close()


def _assign(slave: Any, index: int, mappings: tuple[int, ...]) -> None:
    """Let a slave map what the robot's drives map: the frames have the same size."""
    slave.sdo_write(index, 0, b"\0")
    for subindex, mapping in enumerate(mappings, 1):
        slave.sdo_write(index, subindex, struct.pack("<H", mapping))
    slave.sdo_write(index, 0, bytes((len(mappings),)))


# -- far sides


@contextlib.contextmanager
def _cable(*ends: str) -> Iterator[None]:
    """Lay a veth pair as `scripts/wire.sh` does; raises OSError."""
    remove = ["ip", "link", "delete", ends[0]]
    subprocess.run(remove, capture_output=True, check=False)  # of a run that was killed
    commands = [["ip", "link", "add", ends[0], "type", "veth", "peer", "name", ends[1]]]
    commands += [["ip", "link", "set", end, "multicast", "off", "up"] for end in ends]
    try:
        for command in commands:
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                raise OSError(f"no second cable can be laid: {' '.join(command)}: {done.stderr}")
        yield
    finally:
        subprocess.run(remove, capture_output=True, check=False)


@contextlib.contextmanager
def _far_side(kind: str, interface: str) -> Iterator[int]:
    """Run slaves on an interface in a process of their own, yield its number; raises OSError."""
    command = [sys.executable, "-P", str(Path(__file__).resolve()), kind, interface]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        if not select.select([process.stdout], [], [], _START)[0] or not process.stdout.readline():
            raise OSError(f"the slaves on {interface} do not start")
        yield process.pid
    finally:
        process.kill()
        process.communicate()


def _serve_drives(interface: str) -> None:
    """Answer frames as the node drive_segment does; the motors tick while frames come."""
    robot = load_robot()
    segment = SimulatedSegment(robot)
    wired = WiredSegment(segment, time.monotonic_ns)
    cable = Cable(wired)
    lock = threading.Lock()
    frames = 0

    def on_frame(frame: bytearray) -> list[bytearray]:
        nonlocal frames
        with lock:
            frames += 1
            return cable.pass_frame(frame)[0]

    count = segment.slave_count
    still, current = np.zeros(count, np.int32), np.zeros(count)
    gc.collect()
    gc.freeze()  # as the node does
    port = RawPort(interface, on_frame)  # kept: it has the thread
    print("ready", flush=True)
    seen = 0
    while port:
        time.sleep(graph.TICK_PERIOD)
        if seen != frames:  # else the other loop has its turn, and no watchdog is to expire
            seen = frames
            with lock:
                segment.set_servo_state(still, still, current, robot.drive.bus_voltage)


def _serve_minimal(interface: str) -> None:
    """Write the working counter into cyclic frames; simulated drives do the set-up."""
    wired = WiredSegment(SimulatedSegment(load_robot()), time.monotonic_ns)
    counter = struct.pack("<H", 3 * len(wired.slaves))
    at = HEADER + DATAGRAM_HEADER + (pdo.RX.itemsize + pdo.TX.itemsize) * len(wired.slaves)
    cyclic = int(Command.LRW)
    port = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETHERTYPE))
    port.bind((interface, ETHERTYPE))
    buffer = bytearray(2048)
    view = memoryview(buffer)
    print("ready", flush=True)
    operate = False
    while True:
        length = port.recv_into(buffer)
        if operate and buffer[HEADER] == cyclic:
            buffer[at : at + 2] = counter
            port.send(view[:length])
        else:
            frame = bytearray(view[:length])
            wired.pass_frame(frame)
            operate = all(slave.operates for slave in wired.slaves)
            port.send(frame)


if __name__ == "__main__":
    starter.end_with_starter()
    {"drives": _serve_drives, "minimal": _serve_minimal}[sys.argv[1]](sys.argv[2])
