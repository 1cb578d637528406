"""How long a device has been silent: by the time of its world, which may stand still."""

from __future__ import annotations

from collections.abc import Callable

WorldTime = Callable[[], float | None]
"""Returns the time of the device's world [s], None where that is the wall's."""


class Silence:
    """Measures how long nothing has come.

    A simulated device says nothing while its world is paused, or waits for somebody; that is no
    silence. The world is asked for its time only once something is late.
    """

    def __init__(self, world_time: WorldTime = lambda: None):
        """Nothing has come yet."""
        self._world_time = world_time
        self._late_since: float | None = None

    def heard(self, stamp: float | None = None) -> None:
        """Something has come, of a time of the device's clock, which is its world's [s]."""
        self._late_since = stamp

    def lasts(self, wall: float) -> float:
        """Return how long nothing has come [s]; by the wall's clock it is `wall` [s]."""
        world = self._world_time()
        if world is None:
            return wall
        if self._late_since is None or world < self._late_since:
            self._late_since = world
        return min(wall, world - self._late_since)
