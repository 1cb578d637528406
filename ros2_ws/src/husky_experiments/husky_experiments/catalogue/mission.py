"""Missions: each robot goes to goals one after the other, and finds the way to each by itself.

Carbon walks to a slope, climbs it, walks along its top, and comes back down. Husky-beta trots,
flies over a gap onto a step, and back; with little charge left it refuses the flight, and walks
where a walk leads.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from husky_bringup.system import ParameterValue
from husky_experiments.figures import video
from husky_experiments.figures.mission import Stage, draw_mission
from husky_experiments.figures.stroboscope import Moment, stroboscope
from husky_experiments.gap_course import GapCourse
from husky_experiments.incline_course import Course
from husky_experiments.journey import REACHED_WITHIN, Traveller, off_goal, seeing_settings
from husky_experiments.metrics.cycle import energy_over
from husky_experiments.metrics.walking import has_fallen, lowest_upright
from husky_experiments.recordings.recording import Recording
from husky_experiments.run import SCENE_FILE, Run
from husky_experiments.scripts import stand_up
from husky_experiments.session import Session
from husky_navigation.planning.route import PlanePose
from husky_runtime import graph

_LONGEST = 200.0
"""Simulated time that the way to a goal may take [s]."""
_LOOKING = 2.0
"""Time to look at the ground before the first goal, and to come to rest behind each [s]."""
_SLOPE = Course(slope_deg=45.0, approach=2.5, length=0.4)
_TOP = 4.0
"""Length of the level top, behind which it goes down as steeply [m]."""
_TOP_HEIGHT = float(_SLOPE.crest_middle[2]) + _SLOPE.blend
"""Height of that top [m]."""
_GAP = GapCourse(approach=3.0, step=0.25, top=5.0)
_LOW = 0.1
"""Charge with which no flight is possible. The autopilot, which has it from the voltage, tells up
to 0.08 more; that less the navigator's reserve is 4 kJ, and a flight takes 12 kJ.
"""
_ESTIMATING = 6.0
"""Time within which the autopilot tells another charge [s]."""
_SHOWN_FROM = 2.0
"""Time in a mode from which on a picture shows it [s]."""
_ELEVATION = -20.0
"""Of the camera's look on that picture: over the fence onto the feet [deg]."""
_WORDS = {"walk": "walks", "wair": "climbs", "quadrotor": "flies"}
"""Of modes in which the robot goes somewhere, for pictures."""


@dataclass(frozen=True)
class Goal:
    """A goal of a mission, and what must come of it.

    Attributes:
        name: of the metrics.
        pose: in `map`.
        modes: of the controller by which it must get there; each is used, but where it is refused.
        height: of the ground there [m].
        charge: that the battery is given before [-].
        refused: a word of the reason for which the navigator must not go; "" if it must.
    """

    name: str
    pose: PlanePose
    modes: tuple[str, ...]
    height: float = 0.0
    charge: float = 1.0
    refused: str = ""


_HOME = PlanePose(0.0, 0.0, 0.0)
_ON_STEP = PlanePose(_GAP.far_edge + 2.5, 0.5, 0.0)
_ON_TOP = PlanePose(float(_SLOPE.crest_middle[0]) + 2.5, 1.0, 0.0)
MISSIONS = {
    "carbon": (
        Goal("up", _ON_TOP, ("walk", "wair"), _TOP_HEIGHT),
        Goal("back", _HOME, ("walk", "wair")),
    ),
    "beta": (
        Goal("low_charge", _ON_STEP, ("walk",), charge=_LOW, refused="battery"),
        Goal("low_charge_walk", PlanePose(1.0, 0.5, 0.0), ("walk",), charge=_LOW),
        Goal("over_gap", _ON_STEP, ("walk", "quadrotor"), _GAP.step),
        Goal("back", _HOME, ("walk", "quadrotor")),
    ),
}
"""Goals of each robot, in order."""


@dataclass(frozen=True)
class Way:
    """The way to a goal as it was gone: when, and how it ended.

    Attributes:
        goal: that was sent.
        start: time [s].
        end: time [s].
        said: by the navigator, "" if the goal is reached.
        off: true distance [m] and angle [rad] from the goal at the end.
        fell: the robot lay then.
    """

    goal: Goal
    start: float
    end: float
    said: str
    off: tuple[float, float]
    fell: bool


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare robots and seed."""
    parser.add_argument(
        "--robots", nargs="+", choices=tuple(MISSIONS), default=list(MISSIONS), help="which go"
    )
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def run(run: Run) -> None:
    """Every goal is reached by the modes that it takes, or refused for want of charge; no fall."""
    for robot in run.options.robots:
        with run.session(
            _settings(robot, run.options.seed), label=robot, expected=200.0
        ) as session:
            stand_up(session)
            session.advance(_LOOKING)
            traveller = Traveller(session)
            lowest = lowest_upright(run.robot())
            ways = [_go(session, traveller, goal, lowest) for goal in MISSIONS[robot]]
        recording = run.recording(robot)
        for way in ways:
            _judge(run, robot, way, recording)
        run.require(f"{robot}_falls", sum(way.fell for way in ways), upper=0)
        if not run.options.no_figures:
            stages = [Stage(way.goal.name, way.start, way.end) for way in ways]
            draw_mission(recording, stages, run.output / robot)
        if not run.options.no_video:
            _film(run, robot, recording, ways)


def _settings(robot: str, seed: int) -> dict[str, dict[str, ParameterValue]]:
    """Return the parameters of a robot that sees, on the ground of its mission."""
    hill = {**_SLOPE.plant(), "terrain": "ridge", "terrain_top": _TOP}
    plant = _GAP.plant() if robot == "beta" else hill
    return seeing_settings(robot, seed, plant)


def _go(session: Session, traveller: Traveller, goal: Goal, lowest: float) -> Way:
    """Go to a goal; `lowest` is the height over ground below which the robot has fallen [m]."""
    session.inject(graph.PLANT_INJECT_FAULT, "battery", str(goal.charge))
    session.advance(_ESTIMATING)
    start = session.time
    traveller.send(goal.pose)
    said = traveller.said if traveller.go_on(_LONGEST) else f"not ended in {_LONGEST:g} s"
    end = session.time
    session.advance(_LOOKING)
    fell = has_fallen(session.truth, goal.height + lowest)
    return Way(goal, start, end, said, off_goal(session, goal.pose), fell)


def _judge(run: Run, robot: str, way: Way, recording: Recording) -> None:
    """Fill the metrics of a way, state its criteria."""
    goal, name = way.goal, f"{robot}_{way.goal.name}"
    states = recording.controller.between(way.start, way.end)
    gone = sorted(set(states.mode.tolist()) & set(_WORDS))
    energy = energy_over(recording, way.start, way.end)
    run.say(f"{name}: {way.said or 'reached'}; {', '.join(gone)}; {energy / 1e3:.1f} kJ")
    run.metrics |= {
        f"{name}_said": way.said,
        f"{name}_time_s": way.end - way.start,
        f"{name}_energy_j": energy,
        f"{name}_modes": ", ".join(gone),
    }
    missing = set() if goal.refused else set(goal.modes) - set(gone)
    run.require(f"{name}_modes_ok", int(not missing and set(gone) <= set(goal.modes)), lower=1)
    if goal.refused:
        run.require(f"{name}_refused", int(goal.refused in way.said), lower=1)
        return
    run.require(f"{name}_reached", int(not way.said), lower=1)
    near, turned = REACHED_WITHIN[robot]
    run.require(f"{name}_off_m", way.off[0], upper=near)
    run.require(f"{name}_off_rad", way.off[1], upper=turned)


def _film(run: Run, robot: str, recording: Recording, ways: list[Way]) -> None:
    """Render the video, and a picture of the first way on which more than one mode is used."""
    directory = run.output / robot
    run.say(f"rendering the video of {robot}")
    model = video.load_scene(directory / SCENE_FILE)
    if video.render(recording, model, directory / "video.mp4") is None:
        run.say(video.unavailable_reason())
        return
    way = next(way for way in ways if len(way.goal.modes) > 1)
    moments = _moments(recording, way.start, way.end)
    stroboscope(recording, model, directory / "way.png", moments, elevation=_ELEVATION)


def _moments(recording: Recording, start: float, end: float) -> list[Moment]:
    """Return when to show the robot between two times [s]: at the ends, and in the midst of each
    time in a mode in which it goes somewhere.
    """
    states = recording.controller.between(start, end)
    changes = np.flatnonzero(states.mode[1:] != states.mode[:-1]) + 1
    spells = np.split(np.arange(len(states.time)), changes)
    shown = [Moment(start, "stands")]
    for spell in spells:
        mode, times = str(states.mode[spell[0]]), states.time[spell]
        if mode in _WORDS and np.ptp(times) > _SHOWN_FROM:
            shown.append(Moment(float(times[len(times) // 2]), _WORDS[mode]))
    return [*shown, Moment(end, "there")]
