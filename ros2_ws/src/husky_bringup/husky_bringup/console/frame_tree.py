"""Where frames are, by the newest transform of each."""

from __future__ import annotations

from collections.abc import Sequence

from husky_description.link_frames import inverse
from husky_description.rotation import multiply, rotate

Pose = tuple[float, ...]
"""Of a frame in another: position x, y, z [m], quaternion (x, y, z, w)."""
IDENTITY: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class FrameTree:
    """The frames of `/tf` and `/tf_static`; time plays no part, the newest counts."""

    def __init__(self) -> None:
        """Know no frame."""
        self._parent: dict[str, tuple[str, Pose]] = {}
        self._near: dict[str, set[str]] = {}

    def tell(self, parent: str, child: str, pose: Sequence[float]) -> None:
        """Take a transform: the pose of a child in its parent, where else it may have been."""
        before = self._parent.get(child)
        if before is None or before[0] != parent:
            if before is not None:
                self._near[before[0]].discard(child)
                self._near[child].discard(before[0])
            self._near.setdefault(parent, set()).add(child)
            self._near.setdefault(child, set()).add(parent)
        self._parent[child] = parent, tuple(pose)

    def frames(self) -> list[str]:
        """Return the names of all frames."""
        return sorted(self._near)

    def poses(self, origin: str) -> dict[str, Pose]:
        """Return the poses in one frame of all that hang together with it."""
        found = {origin: IDENTITY}
        waiting = [origin]
        while waiting:
            frame = waiting.pop()
            for other in self._near.get(frame, ()):
                if other not in found:
                    found[other] = compose(found[frame], self._step(frame, other))
                    waiting.append(other)
        return found

    def _step(self, frame: str, other: str) -> Pose:
        """Return the pose of a frame in the one beside it."""
        parent, pose = self._parent.get(other, ("", IDENTITY))
        return pose if parent == frame else inverse(self._parent[frame][1])


def compose(outer: Pose, inner: Pose) -> Pose:
    """Return a pose that is given in a frame as it is in the frame of that one's pose."""
    px, py, pz, qx, qy, qz, qw = outer
    x, y, z, ix, iy, iz, iw = inner
    q = qx, qy, qz, qw
    dx, dy, dz = rotate(q, (x, y, z))
    return (px + dx, py + dy, pz + dz, *multiply(q, (ix, iy, iz, iw)))
