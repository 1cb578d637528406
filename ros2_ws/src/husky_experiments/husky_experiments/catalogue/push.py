"""Pushes from the side and from ahead while trotting, and the largest impulse that is survived."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from husky_experiments.metrics.walking import has_fallen
from husky_experiments.run import Run
from husky_experiments.scripts import push, stand_up, walk
from husky_experiments.session import Session

_DIRECTIONS = {
    "from the right": (0.0, 1.0),
    "from the left": (0.0, -1.0),
    "from behind": (1.0, 0.0),
    "from ahead": (-1.0, 0.0),
}
_RECOVERY = 3.0
"""Time after a push in which a fall counts [s]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare impulse, number of pushes, speed and seed."""
    parser.add_argument("--impulse", type=float, default=8.0, help="of each push [N s]")
    parser.add_argument("--pushes", type=int, default=10, help="how many")
    parser.add_argument("--speed", type=float, default=0.3, help="forward speed [m/s]")
    parser.add_argument("--largest", type=float, default=30.0, help="end of the bisection [N s]")
    parser.add_argument("--resolution", type=float, default=1.0, help="of the bisection [N s]")
    parser.add_argument("--no-bisection", action="store_true", help="only the pushes")
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def run(run: Run) -> None:
    """All pushes survived; the limits in each direction are reported."""
    options = run.options
    directions = list(_DIRECTIONS.items())
    survived = 0
    with run.session(
        {"plant": {"seed": options.seed}}, expected=options.pushes * (_RECOVERY + 0.4) + 10
    ) as session:
        start_walking(session, options.speed)
        for number in range(options.pushes):
            name, direction = directions[number % len(directions)]
            # Another phase of the gait each time.
            walk(session, 0.37 + 0.01 * number, (options.speed, 0.0, 0.0))
            stands = survives(session, direction, options.impulse, options.speed)
            survived += stands
            run.say(f"{options.impulse:g} N s {name}: {'survived' if stands else 'fell'}")
            if not stands:
                recover(session, options.speed)
    run.metrics["survived"] = survived
    run.require("survived", lower=options.pushes)
    if not options.no_bisection:
        with run.session(
            {"plant": {"seed": options.seed}}, label="bisection", record=False
        ) as session:
            start_walking(session, options.speed)
            for name, direction in _DIRECTIONS.items():
                key = f"largest_impulse_{name.replace(' ', '_')}_ns"
                run.metrics[key] = bisect(
                    options.impulse,
                    options.largest,
                    options.resolution,
                    lambda impulse, d=direction: probe(  # type: ignore[misc]
                        session, d, impulse, options.speed
                    ),
                )
                run.say(f"largest impulse {name}: {run.metrics[key]:g} N s")
    run.illustrate()


def start_walking(session: Session, speed: float) -> None:
    """Stand up and trot."""
    stand_up(session)
    session.set_gait("trot")
    walk(session, 2.0, (speed, 0.0, 0.0))


def recover(session: Session, speed: float) -> None:
    """Put a robot that has fallen back on its feet and trot."""
    session.start_again()
    start_walking(session, speed)


def survives(
    session: Session, direction: tuple[float, float], impulse: float, speed: float
) -> bool:
    """Push [N s] in a direction of world; return whether the robot still walks afterwards."""
    push(session, (impulse * direction[0], impulse * direction[1]))
    walk(session, _RECOVERY, (speed, 0.0, 0.0))
    assert session.state is not None
    return session.state.mode == "walk" and not has_fallen(session.truth)


def probe(session: Session, direction: tuple[float, float], impulse: float, speed: float) -> bool:
    """As `survives`, and back on its feet afterwards."""
    walk(session, 0.5, (speed, 0.0, 0.0))
    stands = survives(session, direction, impulse, speed)
    if not stands:
        recover(session, speed)
    return stands


def bisect(low: float, high: float, resolution: float, good: Callable[[float], bool]) -> float:
    """Return the largest value in a range that is good, to a resolution, if goodness ends once."""
    if not good(low):
        low, high = 0.0, low
    while high - low > resolution:
        middle = 0.5 * (low + high)
        if good(middle):
            low = middle
        else:
            high = middle
    return low
