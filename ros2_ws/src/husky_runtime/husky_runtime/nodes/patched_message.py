"""A message as bytes for the middleware, patched rather than converted each time it is sent."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from typing import Any

from rclpy.serialization import serialize_message

_FORMATS = {"double": "d", "float": "f", "int32": "i", "uint32": "I"}


class PatchedMessage:
    """Writes numbers into one serialised message; names, texts and lengths of lists stay.

    What does not change its length has a fixed place. Converting message objects, of which a tree
    of transforms or a list of markers has dozens, costs many times as much.
    """

    def __init__(self, message: Any, places: Iterable[Any]):
        """Serialise the message once.

        Args:
            message: with all its lists and texts.
            places: the parts of the message, a `Vector3` say, whose fields are to be overwritten:
                each has nothing but numbers. They are numbered as they come.

        Raises:
            RuntimeError: the middleware's encoding has no fixed places for the numbers.
        """
        parts = list(places)
        patterns = [_mark(part, index) for index, part in enumerate(parts)]
        self._buffer = bytearray(serialize_message(message))
        self._places: list[tuple[struct.Struct, int]] = []
        for layout, pattern in patterns:
            if self._buffer.count(pattern) != 1:
                kind = type(message).__name__
                raise RuntimeError(f"the middleware encodes {kind} in an unexpected way")
            self._places.append((layout, self._buffer.index(pattern)))

    def write(self, index: int, *values: float) -> None:
        """Write the numbers of one place, in the order of its fields."""
        layout, offset = self._places[index]
        layout.pack_into(self._buffer, offset, *values)

    def encode(self) -> bytes:
        """Return the serialised message as it is now."""
        return bytes(self._buffer)

    def encode_at(self, time_ns: int, *parts: Sequence[float]) -> bytes:
        """Return the message with a stamp [ns] in its first place and numbers in all the others."""
        numbers = (divmod(time_ns, 1_000_000_000), *parts)
        for (layout, offset), values in zip(self._places, numbers, strict=True):
            layout.pack_into(self._buffer, offset, *values)
        return bytes(self._buffer)


def _mark(part: Any, index: int) -> tuple[struct.Struct, bytes]:
    """Fill a part with numbers that stand nowhere else; return its layout and these as bytes."""
    fields = part.get_fields_and_field_types()
    layout = struct.Struct("=" + "".join(_FORMATS[kind] for kind in fields.values()))
    values: list[float] = []
    for column, (name, kind) in enumerate(fields.items()):
        number = 16 * index + column
        # A float has 24 bits for them; an integer's marks are valid seconds and nanoseconds.
        value: float = 0x1234_0000 + number
        if kind == "double":
            value = -1.5e300 - 1e297 * number
        elif kind == "float":
            value = -1.5e30 * (1.0 + number / 65536.0)
            (value,) = struct.unpack("=f", struct.pack("=f", value))
        setattr(part, name, value)
        values.append(value)
    return layout, layout.pack(*values)
