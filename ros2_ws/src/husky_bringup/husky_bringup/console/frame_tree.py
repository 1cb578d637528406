"""Where frames are, by the newest transform of each."""

from __future__ import annotations

from collections.abc import Sequence

from husky_description.link_frames import inverse
from husky_description.rotation import multiply, rotate

Pose = tuple[float, ...]
"""Of a frame in another: position x, y, z [m], quaternion (x, y, z, w)."""
IDENTITY: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)

_Way = tuple[str, str, bool]
"""From a frame to another that hangs on it, and whether that one is its child, not its parent."""
_MOST = 1000
"""Frames that are known; later ones are not."""


class FrameTree:
    """The frames of `/tf` and `/tf_static`; time plays no part, the newest counts."""

    def __init__(self) -> None:
        """Know no frame."""
        self._told: dict[str, tuple[str, Pose]] = {}
        self._frames: list[str] | None = None  # None when they have changed
        self._ways: dict[str, list[_Way]] = {}  # by origin, as long as nothing hangs elsewhere

    def tell(self, parent: str, child: str, pose: Sequence[float]) -> None:
        """Take a transform: the pose of a child in its parent, where else it may have been."""
        known = self._told.get(child)
        if known is None and len(self._told) >= _MOST:
            return
        if known is None or known[0] != parent:
            self._forget_ways()
        self._told[child] = parent, tuple(pose)

    def clear(self) -> None:
        """Forget all frames."""
        self._told.clear()
        self._forget_ways()

    def _forget_ways(self) -> None:
        self._frames = None
        self._ways.clear()

    def frames(self) -> list[str]:
        """Return the names of all frames."""
        if self._frames is None:
            self._frames = sorted({*self._told, *(parent for parent, _ in self._told.values())})
        return self._frames

    def poses(self, origin: str) -> dict[str, Pose]:
        """Return the poses in one frame of all that hang together with it."""
        ways = self._ways.get(origin)
        if ways is None:
            ways = self._ways[origin] = self._find_ways(origin)
        found = {origin: IDENTITY}
        for frame, other, is_child in ways:
            step = self._told[other][1] if is_child else inverse(self._told[frame][1])
            found[other] = compose(found[frame], step)
        return found

    def _find_ways(self, origin: str) -> list[_Way]:
        """Return how to get from one frame to all that hang together with it, nearer ones first."""
        children: dict[str, list[str]] = {}
        for child, (parent, _) in self._told.items():
            children.setdefault(parent, []).append(child)
        found, ways, waiting = {origin}, [], [origin]
        while waiting:
            frame = waiting.pop()
            steps = dict.fromkeys(children.get(frame, ()), True)
            if frame in self._told:
                steps.setdefault(self._told[frame][0], False)
            for other, is_child in steps.items():
                if other not in found:
                    found.add(other)
                    ways.append((frame, other, is_child))
                    waiting.append(other)
        return ways


def compose(outer: Pose, inner: Pose) -> Pose:
    """Return a pose that is given in a frame as it is in the frame of that one's pose."""
    px, py, pz, qx, qy, qz, qw = outer
    x, y, z, ix, iy, iz, iw = inner
    q = qx, qy, qz, qw
    dx, dy, dz = rotate(q, (x, y, z))
    return (px + dx, py + dy, pz + dz, *multiply(q, (ix, iy, iz, iw)))
