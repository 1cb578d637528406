"""Numbers of the compliant ground under a foot (thesis T27), once for plant and reduced model."""

import math
from dataclasses import dataclass, fields


@dataclass(frozen=True)
class GroundModel:
    """Spring and damper against sinking, friction after Coulomb and Stribeck against sliding (T27).

    Attributes:
        stiffness: k1 [N/m].
        damping: k2 [N s/m].
        friction_coulomb: mu_c [-], of a foot that slides.
        friction_static: mu_s [-], of a foot that starts to slide.
        friction_viscous: mu_v [N s/m]; multiplies the velocity alone, so it is no coefficient.
        stribeck_velocity: v_s [m/s], over which mu_s turns into mu_c.
        transition_width: depth over which the smooth form takes up its force [m].
        source: where the numbers come from.
        doubt: what is unclear about them, and how it was decided.
    """

    stiffness: float
    damping: float
    friction_coulomb: float
    friction_static: float
    friction_viscous: float
    stribeck_velocity: float
    transition_width: float
    source: str
    doubt: str

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ValueError: a number is not finite, negative, or zero where it divides.
        """
        above_zero = ("stiffness", "stribeck_velocity", "transition_width")
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, str):
                continue
            if not math.isfinite(value) or value < 0.0 or (item.name in above_zero and value == 0):
                allowed = "> 0" if item.name in above_zero else ">= 0"
                raise ValueError(f"{item.name} must be finite and {allowed}, not {value}")


GROUND_PRESETS = {
    "lab": GroundModel(
        stiffness=8000.0,
        damping=250.0,
        friction_coulomb=0.54,
        friction_static=0.60,
        friction_viscous=0.85,
        stribeck_velocity=1e-3,
        transition_width=1e-3,
        source="the lab's reduced-order code: k 8000 N/m, d 250 N s/m, friction 0.60, 0.54, 0.85",
        doubt="damping is 'about' 250; the code has no transition width: the thesis's",
    ),
    "thesis_model": GroundModel(
        stiffness=100.0,
        damping=1e3,
        friction_coulomb=1.0,
        friction_static=1.8,
        friction_viscous=0.0,
        stribeck_velocity=1e-3,
        transition_width=1e-3,
        source="thesis, Simscape model: 100 N/m, 1e3 N/(m/s), width 1e-3 m, friction 1.8 / 1.0",
        doubt="units as printed: the standing robot sinks by 0.2 m; 100 N/mm would be 0.2 mm. "
        "Viscous friction and Stribeck velocity are not given: none, and the lab's",
    ),
    "thesis_results": GroundModel(
        stiffness=5000.0,
        damping=200.0,
        friction_coulomb=0.7,
        friction_static=0.7,
        friction_viscous=0.0,
        stribeck_velocity=1e-3,
        transition_width=1e-3,
        source="thesis, Simscape results: 5e-3 N/mm/mm^2, 2e-10 N/mm/mm^2, friction 0.7 / 0.7",
        doubt="a stiffness by area, of an unknown area: read as 5000 N/m, of 1000 mm^2 (the whole "
        "foot has 707 mm^2); its damping has a stiffness's unit and would be none: 200 N s/m is "
        "taken. The rest is not given: as for thesis_model",
    ),
}
"""Named sets of T27; those of the thesis disagree with each other."""


def ground_preset(name: str) -> GroundModel:
    """Return a preset by name.

    Raises:
        ValueError: there is none of that name; lists those that there are.
    """
    if name not in GROUND_PRESETS:
        raise ValueError(f"ground is {name!r}, it must be one of {', '.join(GROUND_PRESETS)}")
    return GROUND_PRESETS[name]
