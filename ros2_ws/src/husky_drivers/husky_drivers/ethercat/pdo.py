"""Process data of the drives: which objects stand at which byte, and numbers into those bytes.

The layout follows from the assigned mapping objects, as it does in the drive (0x1C12, 0x1C13). The
"standard" pair of a public SDK for walking robots is used: 18 bytes to a drive, 22 bytes from it,
little-endian, packed. (A dump of a Gold Twitter, firmware 01.01.15.00, shows the same mapping
objects and 144 and 176 bits.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array

Image = NDArray[np.void]


@dataclass(frozen=True)
class Entry:
    """One object in a mapping: index, subindex, NumPy type and field name."""

    index: int
    subindex: int
    type: str
    name: str


_PAD = Entry(0x0000, 0, "<i1", "padding")

MAPPINGS: dict[int, tuple[Entry, ...]] = {
    # outputs, master to drive
    0x1605: (
        Entry(0x607A, 0, "<i4", "target_position"),  # counts
        Entry(0x60FF, 0, "<i4", "target_velocity"),  # counts/s
        Entry(0x6071, 0, "<i2", "target_torque"),  # per mille of rated current
        Entry(0x6072, 0, "<u2", "max_torque"),  # per mille of rated current
        Entry(0x6040, 0, "<u2", "controlword"),
        Entry(0x6060, 0, "<i1", "mode_of_operation"),
        _PAD,  # since firmware 01.01.15.00
    ),
    0x1618: (Entry(0x60B2, 0, "<i2", "torque_offset"),),  # per mille of rated current
    # inputs, drive to master
    0x1A03: (
        Entry(0x6064, 0, "<i4", "position"),  # counts
        Entry(0x60FD, 0, "<u4", "digital_inputs"),
        Entry(0x606C, 0, "<i4", "velocity"),  # counts/s
        Entry(0x6041, 0, "<u2", "statusword"),
    ),
    0x1A1D: (Entry(0x2205, 1, "<i2", "analog_input"),),  # mV
    0x1A1F: (Entry(0x6078, 0, "<i2", "current"),),  # per mille of rated current
    0x1A18: (Entry(0x6079, 0, "<u4", "bus_voltage"),),  # mV
}
"""What each mapping object holds, in order."""


def mapped(index: int) -> tuple[int, ...]:
    """Return what stands in a mapping object: index, subindex and bits of each entry, as a number.

    An entry that only fills has index 0.
    """
    return tuple(
        entry.index << 16 | entry.subindex << 8 | 8 * np.dtype(entry.type).itemsize
        for entry in MAPPINGS[index]
    )


RX_ASSIGNMENT = (0x1605, 0x1618)
"""Mapping objects of the outputs (0x1C12)."""
TX_ASSIGNMENT = (0x1A03, 0x1A1D, 0x1A1F, 0x1A18)
"""Mapping objects of the inputs (0x1C13)."""

STO_RELEASED = 1 << 3
"""Bit 3 (interlock) of the digital inputs: high while both STO inputs are. A healthy Gold Twitter
shows 0x00000008; that this bit is the STO chain is our reading of it."""


def layout(assignment: Sequence[int]) -> np.dtype[np.void]:
    """Return the packed type of one drive's data; raises KeyError for an unknown mapping object."""
    entries = [entry for index in assignment for entry in MAPPINGS[index]]
    return np.dtype([(entry.name, entry.type) for entry in entries])


RX = layout(RX_ASSIGNMENT)
"""Outputs of one drive, 18 bytes."""
TX = layout(TX_ASSIGNMENT)
"""Inputs of one drive, 22 bytes."""


class ProcessImage:
    """The bytes of all drives and a view of them by field.

    Attributes:
        data: the image, drive after drive.
        fields: the same bytes as a structured array, one row a drive.
    """

    def __init__(self, kind: np.dtype[np.void], drives: int):
        """Start with zeros for a number of drives; `kind` is `RX` or `TX`."""
        self.data = bytearray(kind.itemsize * drives)
        self.fields: Image = np.frombuffer(self.data, kind)

    def load(self, data: bytes | bytearray | memoryview) -> None:
        """Replace all bytes; raises ValueError when the length differs."""
        if len(data) != len(self.data):
            raise ValueError(f"{len(data)} bytes of process data, expected {len(self.data)}")
        self.data[:] = data


class Field:
    """One field of a process image, written from and read as floating-point numbers.

    Attributes:
        raw: the field of all drives, as integers in the image's bytes.
        lower, upper: what the wire's type can carry.
    """

    def __init__(self, image: ProcessImage, name: str):
        """Look at a field of an image by its name."""
        self.name = name
        self.raw: NDArray[Any] = image.fields[name]
        limits = np.iinfo(self.raw.dtype)
        self.lower, self.upper = float(limits.min), float(limits.max)
        self._rounded = np.zeros(len(self.raw))

    def write(self, values: Array) -> None:
        """Round numbers into the image.

        Args:
            values: one number a drive, in the unit of the wire.

        Raises:
            ValueError: when a number is not finite or does not fit; nothing is written.
        """
        rounded = np.rint(values, self._rounded)
        # written so that NaN fails too
        if not (rounded.max() <= self.upper and rounded.min() >= self.lower):
            raise ValueError(
                f"{self.name}: {values} is not finite or outside [{self.lower:.0f}, "
                f"{self.upper:.0f}]"
            )
        self.raw[:] = rounded

    def read(self, scale: Array | float, out: Array) -> Array:
        """Multiply the field by a scale into `out`, one number a drive; returns `out`."""
        np.multiply(self.raw, scale, out)
        return out
