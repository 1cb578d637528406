"""Stamps: nanoseconds inside, `builtin_interfaces/Time` on the wire."""

from builtin_interfaces.msg import Time


def to_ns(stamp: Time) -> int:
    """Return a stamp in nanoseconds."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def fill(stamp: Time, time_ns: int) -> None:
    """Write nanoseconds into a stamp."""
    stamp.sec, stamp.nanosec = divmod(time_ns, 1_000_000_000)
