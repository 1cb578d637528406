"""The frame that a master sends every cycle, passed through the drives in one compiled step.

It has one datagram that reads and writes the process data of drives and, behind it, none or one
that hands on the system time. Every other frame, and this one when a drive has changed its state,
goes through `husky_sim.devices.ethercat.frames`, which does the same, one datagram after the other.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numba import njit, typeof

from husky_drivers.cia402 import COMMAND_OF_CONTROLWORD, NEXT_STATE
from husky_drivers.ethercat import pdo
from husky_sim.devices.drives import drive_cycle
from husky_sim.devices.drives.segment import SimulatedSegment
from husky_sim.devices.ethercat import clocks
from husky_sim.devices.ethercat.frames import HEADER, RETURNED, Datagram

_OUTPUTS, _INPUTS = pdo.RX.itemsize, pdo.TX.itemsize
_DRIVE = np.dtype(
    [
        ("al_status", "i4"),  # at which all this holds
        ("away", "i4"),  # likewise
        ("reached", "i4"),  # 1 if it gets its outputs
        ("outputs", "i4"),  # where these stand in the frame
        ("inputs", "i4"),  # where its inputs stand, 0 without
    ]
)
_LAYOUT = np.dtype(
    [
        ("counter", "i4"),  # where the working counter of the process data stands in the frame
        ("count", "i4"),  # that is added to it
        ("time", "i4"),  # where the system time stands, 0 without one
        ("time_counter", "i4"),  # and its working counter
        ("time_count", "i4"),
        ("reference", "i4"),  # drive whose system time it is
    ]
)


class TimeDatagram(NamedTuple):
    """A datagram that hands on the system time of a drive.

    Attributes:
        datagram: where it stands.
        reference: position of the drive.
        counting: number of drives that count, all on the line.
    """

    datagram: Datagram
    reference: int
    counting: int


@njit(cache=True)
def _add(frame: Any, at: int, count: int) -> None:
    """Add to a working counter."""
    count += frame[at] | frame[at + 1] << 8
    frame[at], frame[at + 1] = count & 0xFF, count >> 8 & 0xFF


@njit(cache=True)
def _pass(
    frame: Any,
    layouts: Any,
    known: Any,
    drives: Any,
    outputs: Any,
    inputs: Any,
    times: Any,
    now: int,
) -> bool:
    """Pass the frame through `drives`, whose clocks are `times`: see `CyclicFrame.pass_frame`."""
    for i in range(len(drives)):
        drive = drives[i]
        if drive.emergency or drive.al_status != known[i].al_status or drive.away != known[i].away:
            return False
    layout = layouts[0]
    drive_cycle.put_inputs(drives, inputs)
    sources, targets = inputs.view(np.uint8), outputs.view(np.uint8)
    for i in range(len(drives)):
        if known[i].reached:
            for k in range(_OUTPUTS):
                targets[i * _OUTPUTS + k] = frame[known[i].outputs + k]
        if known[i].inputs:
            for k in range(_INPUTS):
                frame[known[i].inputs + k] = sources[i * _INPUTS + k]
    drive_cycle.take_outputs(drives, outputs, known.reached, NEXT_STATE, COMMAND_OF_CONTROLWORD)
    _add(frame, layout.counter, layout.count)
    if layout.time:
        sent = 0
        for k in range(4):
            sent |= int(frame[layout.time + k]) << 8 * k
        time = clocks.hand_on(times, layout.reference, now, sent, known.away)
        for k in range(layout.time_counter - layout.time):
            frame[layout.time + k] = time >> 8 * k & 0xFF
        _add(frame, layout.time_counter, layout.time_count)
    frame[6] |= RETURNED
    return True


class CyclicFrame:
    """That frame, while FMMUs, sync managers and station addresses stay as they are."""

    def __init__(
        self,
        segment: SimulatedSegment,
        line_clocks: clocks.Clocks,
        frame: bytes | bytearray,
        process_data: Datagram,
        places: tuple[Mapping[int, int], Mapping[int, int]],
        time: TimeDatagram | None,
    ):
        """Learn it from one frame, whose states of the drives count.

        Args:
            segment: the drives.
            line_clocks: of the drives.
            frame: from the Ethernet header on.
            process_data: its first datagram.
            places: where in the datagram the outputs of drives in OP stand, by position, and where
                the inputs. Outputs count 2 and inputs 1.
            time: its second datagram; None when there is no other.
        """
        parts = [process_data] + ([] if time is None else [time.datagram])
        self._end = parts[-1].end + 2
        headers, place = f"<{HEADER - 4}x4s", HEADER  # Ethernet type, length and type of EtherCAT
        for part in parts:  # all but index and interrupts
            headers += f"{part.header - place}xcx6s"
            place = part.header + 8
        self._headers = struct.Struct(headers)
        self._expected = self._headers.unpack_from(frame)
        outputs, inputs = places
        layout = np.zeros(1, _LAYOUT)
        layout["counter"], layout["count"] = process_data.end, 2 * len(outputs) + len(inputs)
        if time is not None:
            layout["time"], layout["time_counter"] = time.datagram.data, time.datagram.end
            layout["time_count"], layout["reference"] = time.counting, time.reference
        drives = segment.records
        known = np.zeros(len(drives), _DRIVE)
        known["al_status"], known["away"] = drives["al_status"], drives["away"]
        for i, start in outputs.items():
            known[i]["outputs"], known[i]["reached"] = process_data.data + start, 1
        for i, start in inputs.items():
            known[i]["inputs"] = process_data.data + start
        images = (
            np.frombuffer(data, kind)
            for data, kind in zip(segment.process_data, (pdo.RX, pdo.TX), strict=True)
        )
        self._arguments: tuple[Any, ...] = (layout, known, drives, *images, line_clocks.records)
        # called without a look at the types of the arguments, which takes longer than the frame
        types = tuple(typeof(each) for each in (bytearray(), *self._arguments, 0))
        self._pass: Callable[..., bool] = _pass.compile(types)

    def fits(self, frame: bytes | bytearray) -> bool:
        """Return whether a frame is this one, with whatever index and data."""
        return len(frame) >= self._end and self._headers.unpack_from(frame) == self._expected

    def pass_frame(self, frame: bytearray, now: int) -> bool:
        """Pass a frame that fits through the drives, in place.

        Args:
            frame: from the Ethernet header on.
            now: time at which it enters the line [ns].

        Returns:
            False when a drive has changed its state or has an emergency message; the frame is as it
            was.
        """
        return self._pass(frame, *self._arguments, now)
