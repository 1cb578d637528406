"""What can go wrong between a VN-200's processor and the wire, reproducible from a seed."""

from __future__ import annotations

import random

FAULTS = {
    "stop": (0.0, "the device falls silent and answers nothing"),
    "flip_bits": (1.0, "each packet has so many bits inverted on average, 0 to 100"),
    "repeat": (0.0, "the same measurement comes again and again, its time standing still"),
    "garbage": (1.0, "random bytes in front of this share of the packets, 0 to 1"),
    "truncate": (0.5, "this share of the packets is cut short, 0 to 1"),
    "power_cycle": (0.0, "once: the device starts again with the settings of its flash memory"),
}
"""Faults: default intensity, and what they do."""


class LineFaults:
    """Damages packets on their way out by a `kind` of fault, "" for none."""

    def __init__(self, seed: int):
        """Start without a fault."""
        self.kind = ""
        self._intensity = 0.0
        self.reseed(seed)

    def reseed(self, seed: int) -> None:
        """Start the randomness anew."""
        self._random = random.Random(f"vn200 faults {seed}")

    def set(self, kind: str, intensity: float | None = None) -> None:
        """Choose the fault; "" for none.

        Raises:
            ValueError: no such fault, or an intensity that is out of range.
        """
        if kind and kind not in FAULTS:
            raise ValueError(f"no fault {kind!r}; there are {', '.join(FAULTS)}")
        upper = 100.0 if kind == "flip_bits" else 1.0
        if intensity is not None and not 0.0 <= intensity <= upper:
            raise ValueError(f"intensity of {kind} is {intensity}, it must be within 0 and {upper}")
        self.kind = kind
        self._intensity = FAULTS[kind][0] if kind and intensity is None else intensity or 0.0

    def apply(self, packet: bytes) -> bytes:
        """Return what becomes of a packet."""
        if self.kind == "stop":
            return b""
        if self.kind == "flip_bits":
            return self._flip(packet)
        if self.kind == "garbage" and self._random.random() < self._intensity:
            return self._random.randbytes(self._random.randint(1, len(packet))) + packet
        if self.kind == "truncate" and self._random.random() < self._intensity:
            return packet[: self._random.randrange(len(packet))]
        return packet

    def _flip(self, packet: bytes) -> bytes:
        """Invert bits at exponentially distributed distances."""
        damaged = bytearray(packet)
        bits = 8 * len(packet)
        position = 0.0
        while self._intensity > 0.0:
            position += self._random.expovariate(self._intensity / bits)
            if position >= bits:
                break
            damaged[int(position) // 8] ^= 1 << int(position) % 8
        return bytes(damaged)
