"""A gentle slope through the whole graph: plans are asked for, followed, and done without."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from seen_robot import QUICKLY, Robot

from husky_control.planning.collocation.planner import Planner
from husky_control.planning.collocation.request import PlanRequest, machine_of
from husky_description.robot import load_robot
from husky_experiments.climb_scripts import climb_onto, get_ready, go
from husky_experiments.incline_course import Course, climbing_settings
from husky_runtime import graph

pytestmark = pytest.mark.graph

COURSE = Course(slope_deg=15.0, approach=0.3, blend=0.5, length=4.0)
SPEED = 0.3
INTERVALS = 12
GRACE = 20.0
"""Wall time: the planner derives its formulas, some seconds of a processor [s]."""


@pytest.fixture(scope="module")
def climber(new_graph) -> Iterator[Robot]:
    """A robot on the straight part of a slope, climbing."""
    # The planner finds its derivatives compiled: nobody waits in vain for a compiler.
    request = PlanRequest(slope=math.radians(10.0), gait="climb", intervals=INTERVALS)
    Planner(machine_of(load_robot())).plan(request)
    settings = climbing_settings(COURSE, seed=1, controller={"grace": GRACE, **QUICKLY})
    settings[graph.PLANT]["grace"] = GRACE
    settings[graph.PLANNER] = {"keep": False, "intervals": INTERVALS}
    with new_graph(**settings) as robot:
        get_ready(robot.session)
        assert climb_onto(robot.session, COURSE, SPEED), robot.seen
        yield robot


def test_plans_are_asked_for_on_the_way_and_followed(climber):
    plans = climber.told(graph.LOW_LEVEL_CONTROLLER, "plans")
    # 7.5, 10, 12.5 and 15 deg are passed; the first steps may be taken at other speeds.
    assert plans >= 3
    assert climber.told(graph.LOW_LEVEL_CONTROLLER, "plans_refused") == 0
    assert climber.told(graph.PLANNER, "plans") >= plans
    assert climber.session.state.reason == "plan for 15 deg"
    climber.reported(graph.PLANNER, "ready")


def locks_of_segments(process: int) -> list[Path]:
    """Those that Fast DDS holds in a process as long as its shared memory is in use."""
    files = []
    for entry in Path(f"/proc/{process}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):  # closed meanwhile
            files.append(entry.readlink())
    return [file for file in files if re.fullmatch(r"fastrtps_[0-9a-f]{16}_el", file.name)]


def test_without_the_planner_it_climbs_on(climber):
    """Nor does any shared memory of it stay behind."""
    session = climber.session
    locks = locks_of_segments(session.processes.process_group(graph.PLANNER))
    assert locks and all(lock.exists() for lock in locks)
    session.kill(graph.PLANNER)
    left = [path for lock in locks for path in (lock, lock.with_name(lock.name[:-3]))]
    assert not any(path.exists() for path in left), left
    plans = climber.told(graph.LOW_LEVEL_CONTROLLER, "plans")
    start = climber.height
    assert go(session, COURSE, 1.2, 0.2), climber.seen  # another speed asks for another plan
    assert climber.mode == "wair" and climber.height > start + 0.04
    assert climber.told(graph.LOW_LEVEL_CONTROLLER, "plans") == plans


@pytest.mark.slow
def test_a_new_planner_is_asked_again(climber):
    session = climber.session
    if session.processes.running(graph.PLANNER):
        session.kill(graph.PLANNER)
    plans = climber.told(graph.LOW_LEVEL_CONTROLLER, "plans")
    session.start(graph.PLANNER)
    climber.reported(graph.PLANNER, "ready")  # in simulated time nobody waits for it
    climber.until(
        lambda: (
            climber.told(graph.LOW_LEVEL_CONTROLLER, "plans") > plans
            or not go(session, COURSE, 1.0, 0.15)
        ),
        "a plan of the new planner",
        within=15.0,
    )
    assert climber.mode == "wair", climber.seen
