"""A ramp's surface as a line in the world's x-z plane: flat, arc, slope, arc, flat top.

Uphill is +x. Places on it are lengths along the surface from x = 0, where the robot starts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

_FACET = math.radians(3.0)
"""Most that one facet of an arc turns [rad]; with a radius of 1 m it is 0.3 mm off the arc."""


class SurfacePoint(NamedTuple):
    """A point of the surface in the world [m] and its inclination there [rad]."""

    x: float
    z: float
    angle: float


Place = tuple[float, float]
"""x and z in the world [m]."""


@dataclass(frozen=True)
class Ramp:
    """The measures of a ramp.

    Attributes:
        slope: inclination [rad], 0 to pi/2.
        approach: flat ground from x = 0 to the foot of the slope [m].
        blend: radius of the arcs at foot and crest [m].
        length: of the straight slope [m].
        top: flat ground at the top [m].
    """

    slope: float
    approach: float = 1.5
    blend: float = 1.0
    length: float = 12.0
    top: float = 4.0

    def __post_init__(self) -> None:
        """Raise ValueError for what cannot be built: the measure, its value, what is allowed."""
        for name, value in vars(self).items():
            most = math.pi / 2 if name == "slope" else 100.0
            if not 0.0 <= value <= most:
                raise ValueError(f"ramp {name} is {value}, it must be 0 to {most:.3g}")

    @property
    def arc(self) -> float:
        """Length of each arc [m]."""
        return self.blend * self.slope

    @property
    def slope_start(self) -> float:
        """Length along the surface to where the slope is full and straight [m]."""
        return self.approach + self.arc

    @property
    def slope_end(self) -> float:
        """Length along the surface to where it ends [m]."""
        return self.slope_start + self.length

    def at(self, distance: float) -> SurfacePoint:
        """Return the point at a length along the surface [m]; before and behind it is flat."""
        x, z, angle = min(distance, self.approach), 0.0, 0.0
        left = max(distance - self.approach, 0.0)
        turned = min(left / self.blend, self.slope) if self.blend else self.slope * (left > 0.0)
        x += self.blend * math.sin(turned)
        z += self.blend * (1.0 - math.cos(turned))
        angle = turned
        left -= self.blend * turned
        straight = min(max(left, 0.0), self.length)
        x, z = x + straight * math.cos(self.slope), z + straight * math.sin(self.slope)
        left -= straight
        if left > 0.0:
            angle = max(self.slope - left / self.blend, 0.0) if self.blend else 0.0
            x += self.blend * (math.sin(self.slope) - math.sin(angle))
            z += self.blend * (math.cos(angle) - math.cos(self.slope))
            x += max(left - self.arc, 0.0)
        return SurfacePoint(x, z, angle)

    def facets(self, turn: float = _FACET) -> list[tuple[Place, Place]]:
        """Return where the straight pieces of foot, slope, crest and top begin and end.

        Args:
            turn: most that one facet of an arc turns [rad].
        """
        count = max(1, math.ceil(self.slope / turn - 1e-9)) if self.arc else 0
        foot = [self.approach + self.arc * i / count for i in range(count)]
        crest = [self.slope_end + self.arc * i / count for i in range(count)]
        end = self.slope_end + self.arc
        places = [*foot, self.slope_start, *crest, end, end + self.top]
        points = [self.at(place)[:2] for place in places]
        return [(a, b) for a, b in pairwise(points) if math.dist(a, b) > 1e-9]
