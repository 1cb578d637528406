"""The gaits in one table (T12), and the clock that says which leg stands and which swings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.compiled import Compiled
from husky_description.kinematics import LEGS

Mask = NDArray[np.bool_]


class Gait(NamedTuple):
    """One gait: when each leg touches down, and how it steps."""

    name: str
    touchdown_phase: tuple[float, float, float, float]  # fraction of the period, legs in order
    period: float  # s
    duty: float  # fraction of the period that a leg stands
    swing_height: float  # m, foot over the straight line from liftoff to foothold
    stance_height: float  # m, base over the foot centres
    forward_spread: float  # m, nominal foothold ahead of the front hip, behind the hind hip
    lateral_spread: float  # m, nominal foothold outside of the hip
    velocity_follow: float  # share of the velocity error that the stance feet give way to
    static_margin: float  # m, kept inside of the support polygon; 0 for dynamic gaits
    hop_speed: float  # m/s, upward speed of the body at liftoff
    max_speed: float  # m/s
    max_lateral_speed: float  # m/s
    max_yaw_rate: float  # rad/s


#                touchdown phase        period duty  swing stance forward lateral follow margin hop  max   max  max
#                fl   fr   hl   hr      s      -     m     m      m       m       -      m      m/s  m/s   m/s  rad/s
# fmt: off
GAITS: dict[str, Gait] = {gait.name: gait for gait in (
    Gait("crawl", (.40, .90, .20, .70), 4.00, .88,  .06,  .53,   .00,    .05,    0.0,   .050,  0.0, 0.05, .02, 0.10),
    Gait("trot",  (.00, .50, .50, .00), 0.34, .50,  .08,  .54,   .00,    .04,    0.4,   .000,  0.0, 1.60, .30, 0.80),
    Gait("climb", (.00, .50, .50, .00), 0.34, .50,  .08,  .50,   .00,    .04,    0.4,   .000,  0.0, 0.60, .30, 0.80),
    Gait("bound", (.00, .00, .50, .50), 0.30, .60,  .06,  .54,  -.10,    .04,    0.8,   .000,  0.0, 0.50, .30, 0.80),
    Gait("pronk", (.00, .00, .00, .00), 0.40, .70,  .04,  .52,   .00,    .04,    0.8,   .000,  0.6, 0.40, .30, 0.80),
)}
# fmt: on

COLUMN_UNITS = {
    "period": "s",
    "duty": "-",
    "swing_height": "m",
    "stance_height": "m",
    "forward_spread": "m",
    "lateral_spread": "m",
    "velocity_follow": "-",
    "static_margin": "m",
    "hop_speed": "m/s",
    "max_speed": "m/s",
    "max_lateral_speed": "m/s",
    "max_yaw_rate": "rad/s",
}

# Smallest and greatest value of each column. Measured with the others at their defaults and all
# sensor noise on: start, walk ahead, turn and stop at the speeds of the experiment `gaits`, `climb`
# up and down 25 deg; the ends lie inside of what was walked. (0, 0): the gait has no such thing.
# tests/closed_loop/test_parameter_sweep.py walks at every end. Only the crawl has walked at the ends
# of max_lateral_speed and max_yaw_rate; of the others they are what a command may be allowed at all.
#            period       duty        swing       stance      forward       lateral     follow      margin       hop         max         max         max
#            s            -           m           m           m             m           -           m            m/s         m/s         m/s         rad/s
# fmt: off
GAIT_RANGES: dict[str, dict[str, tuple[float, float]]] = {
    name: dict(zip(COLUMN_UNITS, row, strict=True)) for name, row in {
    "crawl": ((3.0, 5.0), (.85, .91), (.03, .10), (.50, .55), (-.05, .04), (.03, .08), (0.0, 0.5), (.04, .06), (0.0, 0.0), (0.0, .06), (0.0, .02), (0.0, .12)),
    "trot":  ((.24, .42), (.40, .65), (.02, .16), (.38, .58), (-.03, .15), (-.04, .15), (0.0, 0.8), (0.0, 0.0), (0.0, 0.0), (0.0, 1.8), (0.0, 1.0), (0.0, 2.0)),
    "climb": ((.25, .42), (.45, .62), (.03, .15), (.42, .55), (-.08, .08), (.00, .12), (0.0, 0.8), (0.0, 0.0), (0.0, 0.0), (0.0, .60), (0.0, .30), (0.0, 2.0)),
    "bound": ((.26, .32), (.55, .65), (.02, .08), (.46, .57), (-.14, -.08), (.00, .10), (0.5, 0.9), (0.0, 0.0), (0.0, 0.0), (0.0, .60), (0.0, .50), (0.0, 2.0)),
    "pronk": ((.36, .45), (.66, .75), (.02, .06), (.45, .56), (-.06, .06), (.00, .10), (0.4, .85), (0.0, 0.0), (0.5, 0.7), (0.0, .50), (0.0, .40), (0.0, 2.0)),
}.items()}
# fmt: on
SWING_TIMES: dict[str, tuple[float, float]] = {
    "crawl": (0.26, 0.75),
    "trot": (0.10, 0.25),
    "climb": (0.10, 0.23),
    "bound": (0.09, 0.14),
    "pronk": (0.09, 0.14),
}
"""Least and most time that period and duty may leave a leg for its swing [s]; measured likewise: the
trot fell with 0.08 s, the bound with 0.08 and 0.15 s, the pronk with 0.15 s."""


class StepTiming(NamedTuple):
    """When the legs step."""

    touchdown_phase: Array  # (4,) fraction of the period
    period: float  # s
    duty: float  # fraction of the period that a leg stands


class LegPhases(NamedTuple):
    """What the legs do, and what has happened to them at this tick."""

    swinging: Mask  # (4,)
    progress: Array  # (4,) 0 to 1 in the swing, -1 in stance
    late: Array  # (4,) s since the scheduled touchdown
    touchdown: Mask  # (4,) legs that touched down at this tick
    liftoff: Mask  # (4,) legs that lifted off at this tick


@njit(cache=True)
def advance_clock(
    timing: StepTiming,
    legs: LegPhases,
    phase: float,
    contact: Mask,
    lift_allowed: bool,
    late_limit: float,
    dt: float,
) -> float:
    """Advance the clock by one tick and raise the events of the legs (T13).

    A leg lifts off when the clock says so. It touches down when its contact says so in the second
    half of its swing; when the clock says so first, the clock waits for the ground, for late_limit
    at most.

    Args:
        timing: of the gait.
        legs: updated.
        phase: of the gait, in [0, 1).
        contact: (4,) bool, from the contact observer.
        lift_allowed: False keeps feet on the ground: walking stops.
        late_limit: s.
        dt: s.

    Returns:
        The new phase.
    """
    waiting = False
    for leg in range(LEGS):
        waiting = waiting or (legs.swinging[leg] and legs.late[leg] > 0.0)
    new_phase = phase + (0.0 if waiting else dt / timing.period)
    if new_phase >= 1.0:
        new_phase -= 1.0
    for leg in range(LEGS):
        before = (phase - timing.touchdown_phase[leg]) % 1.0
        now = (new_phase - timing.touchdown_phase[leg]) % 1.0
        legs.touchdown[leg] = legs.liftoff[leg] = False
        if legs.swinging[leg]:
            legs.progress[leg] = (now - timing.duty) / (1.0 - timing.duty)
            if now < timing.duty or legs.late[leg] > 0.0:
                legs.late[leg] += dt
                legs.progress[leg] = 1.0
            landed = contact[leg] and legs.progress[leg] > 0.5
            legs.touchdown[leg] = landed or legs.late[leg] > late_limit
        elif lift_allowed and before < timing.duty <= now:
            legs.liftoff[leg] = legs.swinging[leg] = True
            legs.progress[leg] = 0.0
        if legs.touchdown[leg]:
            legs.swinging[leg] = False
        if not legs.swinging[leg]:
            legs.progress[leg] = -1.0
            legs.late[leg] = 0.0
    return new_phase


class GaitClock:
    """The phase of a gait and the state of its legs."""

    def __init__(self, gait: Gait) -> None:
        """All feet on the ground, at the phase where the next leg is about to lift."""
        self._advance = Compiled(advance_clock)
        self._legs = LegPhases(
            swinging=np.zeros(LEGS, dtype=np.bool_),
            progress=np.full(LEGS, -1.0),
            late=np.zeros(LEGS),
            touchdown=np.zeros(LEGS, dtype=np.bool_),
            liftoff=np.zeros(LEGS, dtype=np.bool_),
        )
        self.swinging, self.swing_progress, _, self.touchdown, self.liftoff = self._legs
        self.start(gait)

    def start(self, gait: Gait) -> None:
        """Begin a gait with all feet on the ground.

        A hop begins with the stance, a static gait with the longest stand of all four, any other
        just before the first leg lifts.
        """
        self.gait = gait
        self.touchdown_phase = np.array(gait.touchdown_phase, dtype=np.float64)
        self._timing = StepTiming(self.touchdown_phase, gait.period, gait.duty)
        first = gait.touchdown_phase[0]
        liftoffs = (self.touchdown_phase + gait.duty) % 1.0
        if gait.hop_speed > 0.0:
            self.phase = first
        elif gait.static_margin > 0.0:
            self.phase = max(
                gait.touchdown_phase, key=lambda start: float(((liftoffs - start) % 1.0).min())
            )
        else:
            self.phase = (first + gait.duty - 1e-9) % 1.0
        self.swinging.fill(False)
        self.swing_progress.fill(-1.0)
        self._legs.late.fill(0.0)

    @property
    def stance_time(self) -> float:
        """Time that a leg stands in one cycle, s."""
        return self.gait.period * self.gait.duty

    @property
    def swing_time(self) -> float:
        """Time that a leg swings in one cycle, s."""
        return self.gait.period * (1.0 - self.gait.duty)

    @property
    def stance_progress(self) -> float:
        """Progress of the first leg's stance by the clock, beyond 1 in its swing."""
        return float((self.phase - self.touchdown_phase[0]) % 1.0) / self.gait.duty

    def next_to_lift(self) -> tuple[int, float]:
        """The standing leg that lifts off next, and the time until then, s."""
        wait = (self.touchdown_phase + self.gait.duty - self.phase) % 1.0
        leg = min(
            (k for k in range(LEGS) if not self.swinging[k]), key=lambda k: wait[k], default=0
        )
        return leg, float(wait[leg]) * self.gait.period

    def swing_window(self, leg: int) -> tuple[float, float]:
        """Time until a leg's swing begins (0 while it swings) and until it ends, s."""
        gait = self.gait
        end = float((self.touchdown_phase[leg] - self.phase) % 1.0) * gait.period
        return max(0.0, end - self.swing_time), end

    def tick(self, contact: Mask, lift_allowed: bool, late_limit: float, dt: float) -> None:
        """Advance by dt s; see advance_clock."""
        self.phase = self._advance.call(
            self._timing, self._legs, self.phase, contact, lift_allowed, late_limit, dt
        )
