"""Simulated drives behind EtherCAT frames: the line of their slave controllers.

A frame is processed in no time. It takes and gives the process data of the segment exactly as an
exchange in the process does: inputs are those from before the outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import partial

import numpy as np
from numpy.typing import NDArray

from husky_drivers.ethercat.bus import AlState
from husky_sim.devices.drives.segment import SimulatedSegment
from husky_sim.devices.ethercat.clocks import Clocks
from husky_sim.devices.ethercat.cyclic_frame import CyclicFrame, TimeDatagram
from husky_sim.devices.ethercat.frames import (
    HEADER,
    SYSTEM_TIME,
    Command,
    Datagram,
    datagrams,
    is_ethercat,
    pass_frame,
)
from husky_sim.devices.ethercat.slave_controller import ProcessData, SlaveController

_SAFEOP = int(AlState.SAFEOP)
_LRD, _LWR, _LRW = int(Command.LRD), int(Command.LWR), int(Command.LRW)


class Frame(IntEnum):
    """Kinds of frames that come to the drives."""

    FOREIGN = 0
    """Not EtherCAT: it is left alone, and nothing goes back."""
    OTHER = 1
    """EtherCAT, as the set-up has them."""
    CYCLIC = 2
    """Reads or writes the process data of a drive in OP."""


@dataclass(frozen=True)
class _Step:
    """Bytes of a datagram that an FMMU leads to the memory of a slave.

    Attributes:
        start, end: in the datagram.
        into_drive: whether they are written there, else read.
        physical: address in the memory.
        data: the whole outputs or inputs of the drive when it is these; None for other memory.
    """

    start: int
    end: int
    into_drive: bool
    physical: int
    data: memoryview | None


@dataclass(frozen=True)
class _Plan:
    """Paths of a logical datagram through the slaves.

    Attributes:
        paths: slaves in wire order with their steps, outputs first.
        reached: (n,) 1 for a drive in OP whose outputs are all in the datagram.
        takes_outputs: whether there is one.
        in_operation: whether a drive in OP is touched.
    """

    paths: tuple[tuple[SlaveController, tuple[_Step, ...]], ...]
    reached: NDArray[np.uint8]
    takes_outputs: bool
    in_operation: bool


class WiredSegment:
    """A segment of drives as a network interface sees it. Not for several threads at a time.

    Attributes:
        segment: the drives; motors, faults and states are asked for there.
        slaves: their controllers, in wire order.
    """

    def __init__(
        self,
        segment: SimulatedSegment,
        clock_ns: Callable[[], int],
        drift_ppm: Sequence[float] | None = None,
    ):
        """Put the drives on the wire; they are in INIT then.

        Args:
            segment: the drives.
            clock_ns: time [ns], of which the drives' distributed clocks are made.
            drift_ppm: of each drive's clock; none by default.
        """
        self.segment = segment
        self._clock_ns, self._now = clock_ns, 0
        segment.close()
        outputs, inputs = segment.process_data
        count = segment.slave_count
        drifts = [0.0] * count if drift_ppm is None else list(drift_ppm)
        if len(drifts) != count:
            raise ValueError(f"{len(drifts)} drifts for {count} drives")
        self._al_status = segment.records["al_status"]
        self._away = segment.records["away"]
        self._clocks = Clocks(lambda: self._now, drifts, self._away)
        self._plans: dict[tuple[int, int], _Plan] = {}
        self._cyclic: CyclicFrame | None = None  # the last that is known
        self._seen = b""
        self._line: Sequence[SlaveController] = ()
        self._process_data = []
        for i in range(count):
            reached = np.zeros(count, np.uint8)
            reached[i] = 1
            out_size, in_size = len(outputs) // count, len(inputs) // count
            self._process_data.append(
                ProcessData(
                    outputs[i * out_size : (i + 1) * out_size],
                    inputs[i * in_size : (i + 1) * in_size],
                    segment.put_inputs,
                    partial(segment.take_outputs, reached),
                )
            )
        self.slaves = tuple(
            SlaveController(
                (i, count),
                drive,
                self._process_data[i],
                self._clocks,
                self._forget,
            )
            for i, drive in enumerate(segment.drives)
        )
        segment.put_inputs()  # compiled, so that no frame waits
        segment.take_outputs(np.zeros(count, np.uint8))
        nothing = Datagram(_LRW, 0, HEADER, HEADER, HEADER)
        CyclicFrame(segment, self._clocks, bytes(HEADER + 8), nothing, ({}, {}), None)

    def pass_frame(self, frame: bytearray) -> Frame:
        """Pass an Ethernet frame through the drives, in place; return of which kind it was."""
        self._now = self._clock_ns()
        known = self._cyclic
        if known is not None and known.fits(frame) and known.pass_frame(frame, self._now):
            return Frame.CYCLIC
        kind = Frame.OTHER
        if self.is_cyclic(frame):
            kind = Frame.CYCLIC
            if self._cyclic is None or not self._cyclic.fits(frame):
                self._cyclic = self._learn(frame)
        if pass_frame(frame, self._line, self._logical, self._follow):
            return kind
        return Frame.FOREIGN

    def is_cyclic(self, frame: bytes | bytearray) -> bool:
        """Return whether a frame reads or writes the process data of a drive in OP."""
        self._notice_changes()
        if self._cyclic is not None and self._cyclic.fits(frame):
            return True
        if not is_ethercat(frame):
            return False
        return any(
            _LRD <= datagram.command <= _LRW
            and self._plan(datagram.address, datagram.end - datagram.data).in_operation
            for datagram in datagrams(frame)
        )

    def _notice_changes(self) -> None:
        """Forget the paths when a drive has changed its state by itself or left the bus."""
        seen = self._al_status.tobytes() + self._away.tobytes()
        if seen != self._seen:
            self._seen = seen
            self._forget()
            for slave in self.slaves:
                slave.notice_start()
            self._line = [
                slave for slave, off in zip(self.slaves, self._away, strict=True) if not off
            ]

    def _forget(self) -> None:
        """Forget where addresses lead, as something has changed."""
        self._plans.clear()
        self._cyclic = None

    def _learn(self, frame: bytes | bytearray) -> CyclicFrame | None:
        """Return a frame with process data of drives in OP as one to come again, if it is one."""
        parts = list(datagrams(frame))
        first = parts[0]
        if first.command != _LRW or len(parts) > 2:
            return None
        places: tuple[dict[int, int], dict[int, int]] = ({}, {})  # of outputs, of inputs
        for slave, steps in self._plan(first.address, first.end - first.data).paths:
            for step in steps:
                where = places[not step.into_drive]
                if step.data is None or slave.position in where:
                    return None
                where[slave.position] = step.start
        if len(parts) == 1:
            return CyclicFrame(self.segment, self._clocks, frame, first, places, None)
        last = parts[1]
        station, memory = last.address & 0xFFFF, last.address >> 16
        readers = [each for each in self._line if each.answers_to(station)]
        if (
            last.command != Command.FRMW
            or memory != SYSTEM_TIME
            or not 4 <= last.end - last.data <= 8
            or len(readers) != 1
        ):
            return None
        time = TimeDatagram(last, readers[0].position, len(self._line))
        return CyclicFrame(self.segment, self._clocks, frame, first, places, time)

    def _follow(self, command: int, slave: int, data: memoryview) -> tuple[int, int]:
        """Read a system time into a datagram; let the clocks behind follow it.

        Those before it, or all when no slave is addressed, follow what the master has sent.
        """
        line = self._line
        if command == Command.FRMW:
            leaves = slave
            readers = [each for each in line if each.answers_to(slave)]
        else:
            leaves, place = slave + len(line) & 0xFFFF, -slave & 0xFFFF
            readers = list(line[place : place + 1])
        behind = 0
        for reader in readers:
            self._clocks.follow(behind, reader.position, int.from_bytes(data[:4], "little"))
            data[:] = reader.read(SYSTEM_TIME, len(data)) or data
            behind = reader.position + 1
        self._clocks.follow(behind, len(self.slaves), int.from_bytes(data[:4], "little"))
        return leaves, len(line)

    def _logical(self, command: int, address: int, data: memoryview) -> int:
        plan = self._plan(address, len(data))
        reads, writes = command != _LWR, command != _LRD
        if reads and plan.paths and self.segment.put_inputs():
            for slave in self._line:
                slave.serve_mailbox()  # where emergencies wait
        count = 0
        for slave, steps in plan.paths:
            wrote = read = False
            for step in steps:
                if step.into_drive:
                    if not writes:
                        continue
                    if step.data is not None:
                        step.data[:] = data[step.start : step.end]
                        wrote = True
                    else:
                        wrote |= slave.write(step.physical, bytes(data[step.start : step.end]))
                elif reads:
                    found = step.data or slave.read(step.physical, step.end - step.start)
                    if found is not None:
                        data[step.start : step.end] = found
                        read = True
            count += read + (wrote * 2 if reads else wrote)
        if writes and plan.takes_outputs:
            self.segment.take_outputs(plan.reached)
        return count

    def _plan(self, address: int, length: int) -> _Plan:
        plan = self._plans.get((address, length))
        if plan is None:
            plan = self._plans[address, length] = self._make_plan(address, length)
        return plan

    def _make_plan(self, address: int, length: int) -> _Plan:
        paths = []
        reached = np.zeros(len(self.slaves), np.uint8)
        in_operation = False
        for i, slave in enumerate(self.slaves):
            if self._away[i] or slave.state < _SAFEOP:
                continue
            steps = self._steps(i, address, length)
            if steps:
                paths.append((slave, steps))
                in_operation |= slave.operates
                reached[i] = any(step.into_drive and step.data is not None for step in steps)
        return _Plan(tuple(paths), reached, bool(reached.any()), in_operation)

    def _steps(self, i: int, address: int, length: int) -> tuple[_Step, ...]:
        """Return what the FMMUs of a slave do with a stretch of logical addresses."""
        slave, process_data = self.slaves[i], self._process_data[i]
        steps = []
        for fmmu in slave.fmmus:
            start = max(fmmu.logical, address)
            end = min(fmmu.logical + fmmu.length, address + length)
            if start >= end:
                continue
            physical = fmmu.physical + start - fmmu.logical
            memory = (physical, physical + end - start)
            stretch = (start - address, end - address)
            if fmmu.writes:
                whole = slave.operates and memory == slave.outputs_at
                data = process_data.outputs if whole else None
                steps.append(_Step(*stretch, True, physical, data))
            if fmmu.reads:
                whole = memory == slave.inputs_at
                data = process_data.inputs if whole else None
                steps.append(_Step(*stretch, False, physical, data))
        return tuple(sorted(steps, key=lambda step: not step.into_drive))
