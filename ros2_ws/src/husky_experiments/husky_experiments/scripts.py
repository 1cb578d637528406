"""Passages that several experiments share."""

from __future__ import annotations

import numpy as np

from husky_experiments.metrics.walking import has_fallen
from husky_experiments.session import Session, SessionError

_SITTING_DOWN = 3.0
"""Time that sitting down takes, with a margin [s]."""
_CONNECTING = 5.0
"""Time within which the bridge and the autopilot must have found each other [s]."""
_COMING_TO_REST = 5.0
"""Longest time that the body may sway before it sits down [s]."""


def stand_up(session: Session) -> None:
    """Enable the drives and stand."""
    session.enable_drives()
    session.set_mode("stand_up", reached="stand", within=10.0)


def sit_down(session: Session) -> None:
    """Sit down from standing, once the body is at rest, and take the torque off."""
    session.set_mode("sit", patience=_COMING_TO_REST)
    session.advance(_SITTING_DOWN)
    session.set_mode("passive", within=1.0)


def walk(
    session: Session,
    duration: float,
    velocity: tuple[float, float, float],
    mode: str = "walk",
) -> None:
    """Walk with a velocity command (x, y [m/s], yaw rate [rad/s]) for a while [s].

    Args:
        session: the running graph.
        duration: [s].
        velocity: command.
        mode: that steps.
    """
    session.set_velocity(*velocity)
    if session.state is None or session.state.mode != mode:
        session.set_mode(mode)
    session.advance(duration)


def stop_walking(session: Session) -> None:
    """Slow down and stand; a robot that stands already goes on standing."""
    if session.state is not None and session.state.mode == "stand":
        session.release_velocity()
        return
    session.set_velocity(0.0)
    session.set_mode("stand", reached="stand", within=5.0)
    session.release_velocity()


def finish(session: Session, minimum_height: float = 0.27) -> int:
    """Stop walking and sit down, unless the robot has fallen; return the falls, 0 or 1.

    The minimum height is that of `has_fallen` [m].
    """
    if has_fallen(session.truth, minimum_height):
        return 1
    stop_walking(session)
    session.advance(1.0)
    if has_fallen(session.truth, minimum_height):
        return 1
    sit_down(session)
    return int(has_fallen(session.truth, minimum_height=0.0))


def push(session: Session, impulse: tuple[float, float], duration: float = 0.1) -> None:
    """Push the base with an impulse in x and y of world [N s]."""
    session.push((impulse[0] / duration, impulse[1] / duration, 0.0), duration)


def walk_with_pushes(
    session: Session,
    duration: float,
    velocity: tuple[float, float, float],
    impulse: float,
    period: float,
    seed: int,
) -> None:
    """Walk and push sideways, to a random side, every so often.

    Args:
        session: the running graph.
        duration: [s].
        velocity: command (x, y [m/s], yaw rate [rad/s]).
        impulse: of each push [N s]; 0 for none.
        period: time between pushes [s].
        seed: of the sides.
    """
    sides = np.random.default_rng(seed)
    end = session.time + duration
    while session.time < end - 1e-9:
        if impulse > 0.0:
            push(session, (0.0, impulse * float(sides.choice((-1.0, 1.0)))))
        walk(session, min(period, end - session.time), velocity)


def ready_fans(session: Session) -> None:
    """Hand the fans to the controller: mode OFFBOARD, armed; nothing is asked of them yet."""
    if not session.advance(_CONNECTING, lambda: session.connected):
        raise SessionError("the bridge has no autopilot")
    session.advance(0.5)  # the autopilot wants to see commands before it follows them
    session.set_flight_mode("OFFBOARD")
    session.arm()
    session.advance(1.5)  # a speed controller wants to see a second of low pulses


def assist(session: Session, share: float) -> None:
    """Let the fans carry a share of the weight, and wait until they do."""
    session.set_parameter("low_level_controller", "assist.share", float(share))
    session.advance(3.0)


def release_fans(session: Session) -> None:
    """Give the weight back to the legs, then disarm."""
    assist(session, 0.0)
    session.arm(False)


def stand_assisted(session: Session, share: float) -> None:
    """Stand, a share of the weight on the fans, ready to trot."""
    stand_up(session)
    ready_fans(session)
    assist(session, share)
    session.set_gait("trot")


def finish_assisted(session: Session) -> int:
    """As `finish`, once the legs have the weight again; return the falls, 0 or 1."""
    if not has_fallen(session.truth):
        release_fans(session)
    return finish(session)
