"""Where frames are, by the newest transform of each."""

from __future__ import annotations

from collections.abc import Sequence

from husky_description.link_frames import inverse
from husky_description.rotation import multiply, rotate

Pose = tuple[float, ...]
"""Of a frame in another: position x, y, z [m], quaternion (x, y, z, w)."""
IDENTITY: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


_MOST = 1000
"""Frames that are known; later ones are not."""


class FrameTree:
    """The frames of `/tf` and `/tf_static`; time plays no part, the newest counts."""

    def __init__(self) -> None:
        """Know no frame."""
        self._told: dict[str, tuple[str, Pose]] = {}

    def tell(self, parent: str, child: str, pose: Sequence[float]) -> None:
        """Take a transform: the pose of a child in its parent, where else it may have been."""
        if child in self._told or len(self._told) < _MOST:
            self._told[child] = parent, tuple(pose)

    def clear(self) -> None:
        """Forget all frames."""
        self._told.clear()

    def frames(self) -> list[str]:
        """Return the names of all frames."""
        return sorted({*self._told, *(parent for parent, _ in self._told.values())})

    def poses(self, origin: str) -> dict[str, Pose]:
        """Return the poses in one frame of all that hang together with it."""
        children: dict[str, list[str]] = {}
        for child, (parent, _) in self._told.items():
            children.setdefault(parent, []).append(child)
        found = {origin: IDENTITY}
        waiting = [origin]
        while waiting:
            frame = waiting.pop()
            steps = {child: self._told[child][1] for child in children.get(frame, ())}
            if frame in self._told:
                parent, pose = self._told[frame]
                steps.setdefault(parent, inverse(pose))
            for other, step in steps.items():
                if other not in found:
                    found[other] = compose(found[frame], step)
                    waiting.append(other)
        return found


def compose(outer: Pose, inner: Pose) -> Pose:
    """Return a pose that is given in a frame as it is in the frame of that one's pose."""
    px, py, pz, qx, qy, qz, qw = outer
    x, y, z, ix, iy, iz, iw = inner
    q = qx, qy, qz, qw
    dx, dy, dz = rotate(q, (x, y, z))
    return (px + dx, py + dy, pz + dz, *multiply(q, (ix, iy, iz, iw)))
