"""Places for the flight controller's MAVLink links: who gets one, and whose is taken for another.

There are 16. A newcomer whose first words are good gets a place at once; when all are taken he gets
that of the least trusted, and among equals of the one who has been silent longest. So the newest
is always served, and a crowd costs no more than 16 peers do.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from enum import IntEnum

from husky_pu.autopilot.mavlink_link import MavlinkLink

MOST_LINKS = 16
MOST_ESTABLISHED = 8
"""Peers who keep their places against newcomers; the others' places go round."""
ESTABLISHED_NS = 500_000_000
"""Between the first and a later word of a peer who is established [ns of the clock]."""
_MOST_PARTING = 64
"""Parting words kept until somebody takes them."""


class Trust(IntEnum):
    """How firmly a link holds its place."""

    SILENT = 0
    """Nothing good has been heard."""
    SPOKEN = 1
    """A good word, or several at one time."""
    RETURNED = 2
    """Good words at two times or more."""
    ESTABLISHED = 3
    """Good words over a while: a ground station at work."""
    KEPT = 4
    """Opened by us, or the companion whose setpoints are followed."""


class LinkTable:
    """The links by name, and how many were `evicted`: their place was given to another."""

    def __init__(self, make: Callable[[int], MavlinkLink]):
        """Start without a link; `make` opens one of a number, which counts from 1."""
        self._make = make
        self._links: dict[Hashable, MavlinkLink] = {}
        self._trust: dict[Hashable, Trust] = {}
        self._first_ns: dict[Hashable, int] = {}
        self._parting: dict[Hashable, bytes] = {}
        self._opened = 0
        self._closed_damaged = self._closed_refused = 0
        self.evicted = 0

    def __iter__(self) -> Iterator[tuple[Hashable, MavlinkLink]]:
        """The links there are, each with its name."""
        return iter(list(self._links.items()))

    def get(self, name: Hashable) -> MavlinkLink | None:
        """Return a link, or None."""
        return self._links.get(name)

    @property
    def names(self) -> list[Hashable]:
        """Names of the links there are."""
        return list(self._links)

    @property
    def addressees(self) -> list[Hashable]:
        """Names of all who may have to be told something: `names`, and some that are gone."""
        return list(dict.fromkeys((*self._links, *self._parting)))

    @property
    def damaged(self) -> int:
        """Frames with a bad checksum or none, on all links there have been."""
        counters = (link.reader.counters for link in self._links.values())
        return self._closed_damaged + sum(c.damaged for c in counters)

    @property
    def refused(self) -> int:
        """Frames refused because they were not signed with our key, on the same."""
        counters = (link.reader.counters for link in self._links.values())
        return self._closed_refused + sum(c.refused for c in counters)

    def new(self) -> MavlinkLink:
        """Return a link that has no place yet."""
        self._opened += 1
        return self._make(self._opened)

    def place(
        self, name: Hashable, link: MavlinkLink, trust: Trust, now_ns: int, keep: Hashable = None
    ) -> bool:
        """Give a link a place, somebody else's if need be; return whether there was one.

        Args:
            name: of the link.
            link: a new one.
            trust: in it; one that has said nothing good takes nobody's place.
            now_ns: time [ns].
            keep: name of the companion's link, which is not taken.
        """
        if len(self._links) >= MOST_LINKS:
            last = self._least(keep)
            if trust is Trust.SILENT or self._trust[last] >= Trust.ESTABLISHED or last == keep:
                self._count(link)
                return False
            self._evict(last)
        link.heard_ns = now_ns
        self._links[name] = link
        self._trust[name] = trust
        self._first_ns[name] = now_ns
        return True

    def heard(self, name: Hashable, now_ns: int) -> None:
        """A good word has come on a link."""
        link = self._links[name]
        link.heard_ns = now_ns
        trust = self._trust[name]
        if trust is Trust.SILENT:
            self._first_ns[name] = now_ns
            self._trust[name] = Trust.SPOKEN
        elif trust in (Trust.SPOKEN, Trust.RETURNED) and now_ns > self._first_ns[name]:
            self._trust[name] = Trust.RETURNED
            established = list(self._trust.values()).count(Trust.ESTABLISHED)
            long_enough = now_ns - self._first_ns[name] >= ESTABLISHED_NS
            if long_enough and established < MOST_ESTABLISHED:
                self._trust[name] = Trust.ESTABLISHED

    def keep(self, name: Hashable) -> None:
        """From now on a link's place is nobody else's."""
        self._trust[name] = Trust.KEPT

    def restart(self) -> None:
        """Time starts again at zero."""
        for name, link in self._links.items():
            link.heard_ns = min(link.heard_ns, 0)
            self._first_ns[name] = min(self._first_ns[name], 0)

    def close(self, name: Hashable) -> None:
        """Forget a link."""
        link = self._links.pop(name, None)
        if link is not None:
            del self._trust[name], self._first_ns[name]
            self._count(link)

    def take_output(self, name: Hashable) -> bytes:
        """Return the bytes to put on a link since the last call."""
        link = self._links.get(name)
        parting = self._parting.pop(name, b"")
        return parting + (link.take_output() if link is not None else b"")

    def _least(self, keep: Hashable) -> Hashable:
        """Return whose place goes next."""

        def firmness(name: Hashable) -> tuple[int, int]:
            trust = Trust.KEPT if name == keep else self._trust[name]
            return trust, self._links[name].heard_ns

        return min(self._links, key=firmness)

    def _evict(self, name: Hashable) -> None:
        """Take a link's place; what it was to be told, or else that we are here, it is told."""
        link = self._links[name]
        output = link.parting_output()
        if output and len(self._parting) < _MOST_PARTING:
            self._parting[name] = self._parting.get(name, b"") + output
        self.evicted += 1
        self.close(name)

    def _count(self, link: MavlinkLink) -> None:
        self._closed_damaged += link.reader.counters.damaged
        self._closed_refused += link.reader.counters.refused
