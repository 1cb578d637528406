"""The measures of the gantry that holds the propulsion unit in two ropes (thesis T39)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class GantryOptions:
    """Where the beam is and how long the ropes are.

    Attributes:
        height: of the beam above the ground [m].
        span: between the ropes' upper ends, along y [m].
        rope: length of each rope [m].
        attachment: of the ropes' lower ends in base: distance from the middle along y, height [m].
    """

    height: float = 2.6
    span: float = 0.9
    rope: float = 1.6
    attachment: tuple[float, float] = (0.135, 0.14)

    def __post_init__(self) -> None:
        """Refuse what cannot be built.

        Raises:
            ValueError: naming the option, its value and what is allowed.
        """
        for name, value, least, most in (
            ("gantry_height", self.height, 0.5, 10.0),
            ("gantry_span", self.span, 0.1, 5.0),
            ("rope_length", self.rope, 0.1, 10.0),
        ):
            if not least <= value <= most:
                raise ValueError(f"{name} is {value} m, it must be within {least} and {most}")
