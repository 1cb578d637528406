"""Settings that a master has changed in its devices, because somebody had saved others."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import NamedTuple


class SettingChange(NamedTuple):
    """A setting that held something else.

    Attributes:
        axis: place of the device.
        what: the setting, with its address.
        before, after: what it held and holds, in words.
    """

    axis: int
    what: str
    before: str
    after: str


def describe_changes(
    names: Sequence[str], devices: str, changes: Iterable[SettingChange]
) -> list[str]:
    """Say what was changed, devices with the same change in one sentence.

    Args:
        names: of the devices, by their places.
        devices: what they are, in the plural.
        changes: what was changed.
    """
    places: dict[tuple[str, str, str], list[int]] = defaultdict(list)
    for axis, *change in changes:
        places[change[0], change[1], change[2]].append(axis)
    return [
        (f"all {devices}" if len(which) == len(names) else ", ".join(names[axis] for axis in which))
        + f": {what} was {before or 'empty'}, set to {after}"
        for (what, before, after), which in places.items()
    ]
