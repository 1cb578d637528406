"""A gap in the ground with a step up behind it: flat, a pit, flat and higher.

Uphill is +x; the robot starts at x = 0, on ground of height 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

DEPTH = 1.0
"""Of the pit's bottom below the ground before it [m]."""
BEHIND = 2.0
"""Ground behind the robot's start [m]."""


class Block(NamedTuple):
    """Ground from one x to another, with a level top [m]."""

    start: float
    end: float
    top: float


@dataclass(frozen=True)
class Gap:
    """The measures of a gap.

    Attributes:
        approach: flat ground from x = 0 to the gap [m].
        width: of the gap along x [m].
        step: how much higher the ground behind the gap is [m].
        top: flat ground behind the gap; then the pit's bottom goes on [m].
    """

    approach: float
    width: float
    step: float
    top: float

    @property
    def blocks(self) -> tuple[Block, Block]:
        """What stands on the bottom: the ground before the gap and the ground behind it."""
        far = self.approach + self.width
        return Block(-BEHIND, self.approach, 0.0), Block(far, far + self.top, self.step)

    def height(self, x: float) -> float:
        """Return the height of the ground at x [m]."""
        tops = [block.top for block in self.blocks if block.start <= x <= block.end]
        return tops[0] if tops else -DEPTH
