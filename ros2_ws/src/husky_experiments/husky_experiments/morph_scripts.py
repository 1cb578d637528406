"""Passages of a robot whose legs become arms: onto the perch, splayed, in flight, and back.

Each asks for a mode for as long as its guard refuses it: the controller begins a step only when
what it stands on was measured (docs/beta.md).
"""

from __future__ import annotations

from collections.abc import Mapping

from husky_bringup.system import ParameterValue
from husky_experiments.scripts import ready_fans
from husky_experiments.session import Session, SessionError
from husky_runtime import graph

_AT_REST = 5.0
"""Longest time that the body may sway before it crouches [s]."""
_PERCHED = 6.0
"""Time within which crouching and folding the legs must have ended [s]."""
_SPLAYED = 4.0
"""Time within which the legs must be arms, and armed propellers be heard of [s]."""
_OFF = 2.0
"""Time within which the propellers must be told to be off [s]."""
_LANDING = 20.0
"""Longest time from the hold to the perch [s]."""
_RAISED = 10.0
"""Time within which the body must be up again [s]."""
_SWEEP = 0.14
"""By which the arms near each other in flight, and back, 8 deg each [rad]."""
_SWEEPING = 4.0
"""Time for the sweep, and as much for the way back [s]."""


def beta_settings(
    seed: int, sensing: str = "noisy", plant: Mapping[str, ParameterValue] | None = None
) -> dict[str, dict[str, ParameterValue]]:
    """Return parameters of a session's nodes by which Husky-beta walks and flies.

    Args:
        seed: of all sensor noise.
        sensing: "noisy", or "ideal": IMU, camera and autopilot err in nothing.
        plant: more of the plant's parameters.
    """
    told: dict[str, ParameterValue] = {"seed": seed, "sensing": sensing}
    return {
        graph.PLANT: {"robot": "beta", "body": "robot_with_unit", **told, **(plant or {})},
        graph.FLIGHT_CONTROLLER: told,
    }


def become_perched(session: Session) -> None:
    """Crouch from standing until the perch carries; the legs fold meanwhile."""
    session.set_mode("perch", patience=_AT_REST)


def become_splayed(session: Session) -> None:
    """Make arms of the legs, as soon as the body rests on its perch."""
    session.set_mode("splay", patience=_PERCHED)


def take_off(session: Session) -> None:
    """Arm the propellers and take off, as soon as the legs hold them as flight needs them."""
    ready_fans(session)
    session.set_mode("quadrotor", patience=_SPLAYED)


def sweep_arms(session: Session) -> tuple[float, float]:
    """Have the arms near each other in flight, and part again; return from when to when [s]."""
    start = session.time
    for sweep in (_SWEEP, 0.0):
        session.set_parameter(graph.LOW_LEVEL_CONTROLLER, "quadrotor.arm_sweep", sweep)
        session.advance(_SWEEPING)
    return start, session.time


def land(session: Session) -> None:
    """Land on the perch and switch the propellers off; the legs stay arms.

    Raises:
        SessionError: it is not down in time.
    """
    session.set_mode("splay")
    if not session.advance(_LANDING, lambda: _mode(session) == "splay"):
        raise SessionError(f"it has not landed within {_LANDING:g} s: {_mode(session)}")
    session.arm(False)


def become_legged(session: Session) -> None:
    """Make legs of the arms, push off the perch and stand."""
    session.set_mode("perch", patience=_OFF)
    session.set_mode("stand_up", reached="stand", within=_RAISED, patience=_PERCHED)


def _mode(session: Session) -> str:
    return session.state.mode if session.state is not None else ""
