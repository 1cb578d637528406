"""Simulated drives behind EtherCAT frames: the line of their slave controllers.

A frame is processed in no time. It takes and gives the process data of the segment exactly as an
exchange in the process does: inputs are those from before the outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from husky_drivers.ethercat.bus import AlState
from husky_sim.devices.drives.segment import SimulatedSegment
from husky_sim.devices.ethercat.frames import Command, datagrams, is_ethercat, pass_frame
from husky_sim.devices.ethercat.slave_controller import ProcessData, SlaveController

_SAFEOP = int(AlState.SAFEOP)
_LRD, _LWR, _LRW = int(Command.LRD), int(Command.LWR), int(Command.LRW)


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
        self._plans: dict[tuple[int, int], _Plan] = {}
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
                self._time_of_frame,
                drifts[i],
                self._plans.clear,
            )
            for i, drive in enumerate(segment.drives)
        )
        segment.put_inputs()  # compiled, so that no frame waits
        segment.take_outputs(np.zeros(count, np.uint8))

    def _time_of_frame(self) -> int:
        return self._now

    def pass_frame(self, frame: bytearray) -> bool:
        """Pass an Ethernet frame through the drives, in place.

        Returns:
            False for a frame that is not EtherCAT: nothing goes back.
        """
        self._notice_changes()
        self._now = self._clock_ns()
        return pass_frame(frame, self._line, self._logical)

    def is_cyclic(self, frame: bytes | bytearray) -> bool:
        """Return whether a frame reads or writes the process data of a drive in OP."""
        if not is_ethercat(frame):
            return False
        self._notice_changes()
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
            self._plans.clear()
            for slave in self.slaves:
                slave.notice_start()
            self._line = [
                slave for slave, off in zip(self.slaves, self._away, strict=True) if not off
            ]

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
