"""The gaits in one table (T12), and the clock that says which leg stands and which swings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_control.kinematics import LEGS

Array = NDArray[np.float64]
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
    static_margin: float  # m, that the body keeps inside of the support polygon; 0 for dynamic gaits
    hop_speed: float  # m/s, upward speed of the body at liftoff
    max_speed: float  # m/s


#                touchdown phase        period duty  swing stance forward lateral follow margin hop  max
#                fl   fr   hl   hr      s      -     m     m      m       m       -      m      m/s  m/s
# fmt: off
GAITS: dict[str, Gait] = {gait.name: gait for gait in (
    Gait("crawl", (.40, .90, .20, .70), 4.00, .88,  .06,  .53,   .00,    .05,    0.0,   .050,  0.0, 0.05),
    Gait("trot",  (.00, .50, .50, .00), 0.34, .50,  .08,  .54,   .00,    .04,    0.4,   .000,  0.0, 1.60),
    Gait("climb", (.00, .50, .50, .00), 0.34, .50,  .08,  .50,   .00,    .04,    0.4,   .000,  0.0, 0.60),
    Gait("bound", (.00, .00, .50, .50), 0.30, .60,  .06,  .54,  -.10,    .04,    0.8,   .000,  0.0, 0.50),
    Gait("pronk", (.00, .00, .00, .00), 0.40, .70,  .04,  .52,   .00,    .04,    0.8,   .000,  0.6, 0.40),
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
}


@njit(cache=True)
def advance_clock(
    phase: float,
    touchdown_phase: Array,
    period: float,
    duty: float,
    late_limit: float,
    lift_allowed: bool,
    contact: Mask,
    dt: float,
    swinging: Mask,
    swing_progress: Array,
    late: Array,
    touchdown: Mask,
    liftoff: Mask,
) -> float:
    """Advance the clock by one tick and raise the events of the legs (T13).

    A leg lifts off when the clock says so. It touches down when its contact says so in the second
    half of its swing; when the clock says so first, the clock waits for the ground, for late_limit
    at most.

    Args:
        phase: of the gait, in [0, 1).
        touchdown_phase: (4,) fraction of the period.
        period: s.
        duty: fraction of the period that a leg stands.
        late_limit: s.
        lift_allowed: False keeps feet on the ground: walking stops.
        contact: (4,) bool, from the contact observer.
        dt: s.
        swinging: (4,) bool, updated.
        swing_progress: (4,) 0 to 1 in the swing, -1 in stance, written.
        late: (4,) s since the scheduled touchdown, updated.
        touchdown: (4,) bool, legs that touched down at this tick, written.
        liftoff: (4,) bool, legs that lifted off at this tick, written.

    Returns:
        The new phase.
    """
    waiting = False
    for leg in range(LEGS):
        waiting = waiting or (swinging[leg] and late[leg] > 0.0)
    step = 0.0 if waiting else dt / period
    new_phase = phase + step
    if new_phase >= 1.0:
        new_phase -= 1.0
    for leg in range(LEGS):
        touchdown[leg] = liftoff[leg] = False
        before = (phase - touchdown_phase[leg]) % 1.0
        now = (new_phase - touchdown_phase[leg]) % 1.0
        if swinging[leg]:
            progress = (now - duty) / (1.0 - duty)
            if now < duty or late[leg] > 0.0:
                late[leg] += dt
                progress = 1.0
            swing_progress[leg] = progress
            if (contact[leg] and progress > 0.5) or late[leg] > late_limit:
                touchdown[leg] = True
                swinging[leg] = False
                swing_progress[leg] = -1.0
                late[leg] = 0.0
        elif lift_allowed and before < duty <= now:
            liftoff[leg] = True
            swinging[leg] = True
            swing_progress[leg] = 0.0
            late[leg] = 0.0
        else:
            swing_progress[leg] = -1.0
    return new_phase


class GaitClock:
    """The phase of a gait and the state of its legs."""

    def __init__(self, gait: Gait) -> None:
        """All feet on the ground, at the phase where the next leg is about to lift."""
        self.swinging = np.zeros(LEGS, dtype=np.bool_)
        self.swing_progress = np.full(LEGS, -1.0)
        self.touchdown = np.zeros(LEGS, dtype=np.bool_)
        self.liftoff = np.zeros(LEGS, dtype=np.bool_)
        self._late = np.zeros(LEGS)
        self.start(gait)

    def start(self, gait: Gait) -> None:
        """Begin a gait with all feet on the ground.

        A hop begins with the stance, a static gait with the longest stand of all four, any other
        just before the first leg lifts.
        """
        self.gait = gait
        self.touchdown_phase = np.array(gait.touchdown_phase, dtype=np.float64)
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
        self._late.fill(0.0)

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
        self.phase = advance_clock(
            self.phase,
            self.touchdown_phase,
            self.gait.period,
            self.gait.duty,
            late_limit,
            lift_allowed,
            contact,
            dt,
            self.swinging,
            self.swing_progress,
            self._late,
            self.touchdown,
            self.liftoff,
        )
