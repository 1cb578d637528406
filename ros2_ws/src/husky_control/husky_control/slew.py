"""A value that may change only so fast."""

from __future__ import annotations


def slewed(value: float, wanted: float, most: float) -> float:
    """Return a value moved towards the wanted one, no further than a step."""
    return value + min(most, max(-most, wanted - value))
