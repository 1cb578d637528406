"""`python -m husky_experiments.scenario NAME`: one thing done with a robot that runs already.

For a graph that something else has started, such as a container engine: the operator who makes the
robot stand up and trot. It ends with one line of JSON, and with 0 only when the robot did it.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from husky_bringup.bringup import add_robot_options, settings_of
from husky_bringup.processes import Strangers
from husky_experiments.metrics.walking import has_fallen
from husky_experiments.scripts import stand_up, stop_walking, walk
from husky_experiments.session import Session, SessionError

TROT_SPEED, TROT_DURATION = 0.3, 5.0
"""Of the scenario `trot`: [m/s], [s]."""
_TROT_DISTANCE = 0.8
"""Share of speed times duration that a trot must cover, starting from rest [-]."""


def stand(session: Session) -> None:
    """Stand up.

    Raises:
        SessionError: the robot does not stand.
    """
    if session.state is None or session.state.mode != "stand":
        stand_up(session)


def trot(session: Session) -> None:
    """Stand up, trot 5 s straight ahead, stand.

    Raises:
        SessionError: the robot has fallen or not got far enough.
    """
    stand(session)
    session.set_gait("trot")
    start = _place(session)
    walk(session, TROT_DURATION, (TROT_SPEED, 0.0, 0.0))
    stop_walking(session)
    end = _place(session)
    distance = ((end[0] - start[0]) ** 2 + (end[1] - start[1]) ** 2) ** 0.5
    wanted = _TROT_DISTANCE * TROT_SPEED * TROT_DURATION
    if has_fallen(session.truth):
        raise SessionError("the robot has fallen")
    if distance < wanted:
        raise SessionError(f"the robot has trotted {distance:.2f} m, less than {wanted:.2f} m")


SCENARIOS: dict[str, Callable[[Session], None] | None] = {
    "none": None,
    "stand": stand,
    "trot": trot,
}
"""What can be done, by name; `none` leaves the robot as it is."""


def _place(session: Session) -> tuple[float, float]:
    """Return where the base is in world [m, m]."""
    if session.truth is None:
        raise SessionError("nobody tells where the robot is")
    position = session.truth.pose.pose.position
    return float(position.x), float(position.y)


def play(options: argparse.Namespace, output: Path) -> dict[str, object]:
    """Do it; return what there is to tell.

    Raises:
        SessionError: the graph is not there, or the robot did not do it.
    """
    scenario = SCENARIOS[options.scenario]
    if scenario is None:
        return {}
    started = time.monotonic()
    session = Session(
        output,
        settings_of(options),
        record=False,
        clock=options.time,
        nodes=None if options.start else Strangers(),
    )
    with session:
        met = time.monotonic()
        if options.time == "lockstep":
            session.pause()
        try:
            scenario(session)
        finally:
            session.pause(False)
        height = session.truth.pose.pose.position.z if session.truth is not None else None
    return {
        "simulated_s": round(session.time, 3),
        "graph_complete_s": round(met - started, 1),
        "scenario_s": round(time.monotonic() - met, 1),
        "height_m": height,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Play a scenario; return 0 when the robot did it."""
    parser = argparse.ArgumentParser(
        prog="python -m husky_experiments.scenario", description=__doc__
    )
    parser.add_argument("scenario", choices=tuple(SCENARIOS), help="what to do")
    add_robot_options(parser)
    parser.add_argument("--start", action="store_true", help="start the nodes, and end them")
    parser.add_argument("--output", type=Path, help="directory for the logs of started nodes")
    options = parser.parse_args(arguments)
    result: dict[str, object] = {"scenario": options.scenario, "ok": True}
    with tempfile.TemporaryDirectory() as directory:
        try:
            result |= play(options, options.output or Path(directory))
        except (SessionError, ValueError) as error:
            result |= {"ok": False, "error": str(error)}
    print(json.dumps(result), flush=True)
    return 0 if result["ok"] else 1


if __name__ == "__main__":
    sys.exit(main())
