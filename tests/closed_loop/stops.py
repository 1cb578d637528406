"""Stops of a robot that steps, at evenly spaced phases of its gait, in one process.

`python tests/closed_loop/stops.py` prints the table of docs/faults.md.
"""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from in_process import InProcessRobot

from husky_control.gait.table import GAITS
from husky_description.robot import LEG_NAMES, load_robot
from husky_drivers.joint_master.phase import Phase
from husky_runtime import graph

WALKS = (
    *(("trot", speed) for speed in (0.0, 0.5, 1.0)),
    *(("crawl", speed) for speed in (0.0, 0.05)),
    *(("bound", speed) for speed in (0.0, 0.5)),
    *(("pronk", speed) for speed in (0.0, 0.3)),
)
"""Gaits and speeds [m/s]."""
WARM_UP = {"crawl": 4.0}
"""Time until a gait is as it will be [s]; else `USUAL_WARM_UP`."""
USUAL_WARM_UP = 1.5
FALLS_FOR = 1.2
"""Time for which a stop is looked at [s]."""
_PERCH = load_robot().perch
DOWN = 0.004
"""Height of the lowest corner of the perch from which it is on the ground [m]."""


class Outcome(NamedTuple):
    """Course of one stop."""

    tilt: float  # deg, greatest
    sink: float  # m/s, downwards, when the perch meets the ground
    off: float  # s, from the stop until no drive has torque


Act = Callable[[InProcessRobot], Any]


class Stop(NamedTuple):
    """A kind of stop, by ways of doing it that are alike; `payload` in kg."""

    what: str
    acts: tuple[Act, ...]
    payload: float = 0.0


def _ask_for(mode: str) -> Act:
    def act(robot: InProcessRobot) -> None:
        accepted, message = robot.controller.request_mode(mode)
        assert accepted, message

    return act


def _lose(joint: str, fault: str = "fault:2310") -> tuple[Act, ...]:
    """Return faults of the drive of one joint of each leg."""

    def of(leg: str) -> Act:
        return lambda robot: robot.segment.inject(f"{leg}_{joint}", fault)

    return tuple(map(of, LEG_NAMES))


def _die(robot: InProcessRobot) -> None:
    robot.alive = False


def _stop_the_drives(robot: InProcessRobot) -> None:
    robot.master.emergency_stop()


STOPS = {
    "mode": Stop("mode `emergency_stop`", (_ask_for("emergency_stop"),)),
    "drives": Stop("`/drives/emergency_stop`", (_stop_the_drives,)),
    "dead": Stop("controller killed", (_die,)),
    "payload": Stop("`/drives/emergency_stop`, 1 kg more of payload", (_stop_the_drives,), 1.0),
    "knee": Stop("fault of a knee's drive", _lose("knee")),
    "frontal": Stop("fault of a hip's frontal drive", _lose("hip_frontal")),
    "sagittal": Stop("fault of a hip's sagittal drive", _lose("hip_sagittal")),
}
"""Ways to stop a robot, of each drive those of four legs."""


def standing_robot(payload: float = 0.0) -> InProcessRobot:
    """Return a robot that stands, and carries more payload than usual, which is configured [kg]."""
    mass = load_robot().payload_mass + payload
    robot = InProcessRobot(robot=load_robot(payload_mass=mass) if payload else None)
    robot.stand()
    return robot


def perch_height(robot: InProcessRobot) -> float:
    """Return the height of the lowest corner of the perch [m]."""
    x, y, z, w = robot.world.base_orientation
    up = np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    half = np.array(_PERCH.size) / 2.0
    return float(robot.world.base_position[2] + up @ np.array(_PERCH.position) - np.abs(up) @ half)


def come_down(robot: InProcessRobot) -> Outcome:
    """Let a stop that has begun take its course."""
    tilt, sink, off, down = 0.0, 0.0, FALLS_FOR, False
    for tick in range(round(FALLS_FOR / graph.TICK_PERIOD)):
        speed = -float(robot.world.base_velocity[2])
        robot.tick()
        tilt = max(tilt, robot.tilt)
        if not down and perch_height(robot) < DOWN:
            sink, down = speed, True
        if off == FALLS_FOR and robot.master.phase is Phase.OFF:
            off = (tick + 1) * graph.TICK_PERIOD
    return Outcome(tilt, sink, off)


def in_a_copy(function: Callable[[], Any]) -> Any:
    """Return what a function returns in a copy of this process; the robot here stays as it is."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        with os.fdopen(writer, "wb") as told:
            try:
                pickle.dump(function(), told)
            except BaseException as error:
                pickle.dump(RuntimeError(repr(error)), told)
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as told:
        result = pickle.load(told)
    os.waitpid(child, 0)
    if isinstance(result, RuntimeError):
        raise result
    return result


def walk_and_stop(
    robot: InProcessRobot, gait: str, speed: float, stops: list[Stop], phases: int
) -> list[list[Outcome]]:
    """Let a standing robot walk, and stop it at evenly spaced phases of its gait.

    Args:
        robot: stands; it is changed.
        gait: its name.
        speed: ahead [m/s].
        stops: ways to stop it.
        phases: how many.

    Returns:
        Outcomes of each phase, for each of the stops.
    """
    accepted, message = robot.controller.request_gait(gait)
    assert accepted, message
    _ask_for("walk")(robot)
    robot.run(WARM_UP.get(gait, USUAL_WARM_UP), (speed, 0.0, 0.0))
    outcomes: list[list[Outcome]] = [[] for _ in stops]
    for _ in range(phases):
        assert robot.controller.mode.value == "walk", robot.controller.reason
        for stop, row in zip(stops, outcomes, strict=True):
            for act in stop.acts:

                def stopped(act: Act = act) -> Outcome:
                    act(robot)
                    return come_down(robot)

                row.append(in_a_copy(stopped))
        robot.run(GAITS[gait].period / phases, (speed, 0.0, 0.0))
    return outcomes


def main(phases: int = 10) -> None:
    """Print the table: greatest tilt [deg] / sink speed [m/s] of each stop and walk."""
    robots = {payload: standing_robot(payload) for payload in (0.0, 1.0)}
    names = list(STOPS)
    cells: dict[str, list[str]] = {name: [] for name in names}
    for gait, speed in WALKS:
        for payload, robot in robots.items():
            here = [name for name in names if STOPS[name].payload == payload]
            stops = [STOPS[name] for name in here]

            def walked(
                robot: InProcessRobot = robot, stops: list[Stop] = stops, walk: Any = (gait, speed)
            ) -> list[list[Outcome]]:
                return walk_and_stop(robot, *walk, stops, phases)

            for name, rows in zip(here, in_a_copy(walked), strict=True):
                tilts = [row.tilt for row in rows]
                beyond = sum(tilt > 40.0 for tilt in tilts)
                more = f" ({beyond} over 40)" if beyond else ""
                sink = max(row.sink for row in rows)
                cells[name].append(f"{max(tilts):.0f} / {sink:.2f}{more}")
    header = " | ".join(f"{gait} {speed:g}" for gait, speed in WALKS)
    print(f"| stop | {header} |\n|---|{'---|' * len(WALKS)}")
    for name in names:
        print(f"| {STOPS[name].what} | {' | '.join(cells[name])} |")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
