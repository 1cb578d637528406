"""The thesis's slopes one after the other, in one page of figures each (T32 to T38)."""

from __future__ import annotations

import argparse

import numpy as np

from husky_experiments.climb_scripts import climb_onto, get_ready, go
from husky_experiments.figures import incline as figure_incline
from husky_experiments.figures.incline import Climb
from husky_experiments.incline_course import climbing_settings, course_for
from husky_experiments.metrics.incline import climb_summary
from husky_experiments.run import SCENE_FILE, Run

_SNAPSHOTS, _CYCLE = 5, 0.35
"""Pictures of the steepest climb (T38), over a cycle of its gait [s]."""
_RISE = 0.1
"""Least rise of the mean thrust from one slope to the next [N]: from flat to 10 deg it is 0.9."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare slopes, speed, time and seed."""
    parser.add_argument(
        "--slopes", type=float, nargs="+", default=[0.0, 10.0, 20.0, 30.0, 45.0], help="[deg]"
    )
    parser.add_argument("--speed", type=float, default=0.25, help="along the slope [m/s]")
    parser.add_argument("--duration", type=float, default=10.0, help="measured on each [s]")
    parser.add_argument("--friction", type=float, default=0.7, help="sliding friction [-]")
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def run(run: Run) -> None:
    """No fall on any slope; on the steepest the knees do less than on the flat, the fans more."""
    slopes = sorted(run.options.slopes)
    outcomes = [_climb(run, slope) for slope in slopes]
    climbs = [climb for climb, _ in outcomes]
    for climb, (_, falls) in zip(climbs, outcomes, strict=True):
        run.metrics[climb.name] = {**climb.summary, "falls": falls}
    first, last = climbs[0].summary, climbs[-1].summary
    run.require("falls", sum(falls for _, falls in outcomes), upper=0)
    run.require("inside_cone", min(c.summary["inside_cone"] for c in climbs), lower=0.95)
    if len(climbs) > 1:
        key = "torque_rms_knee_Nm"
        run.require("knee_torque_ratio", float(last[key]) / float(first[key]), upper=1.0)
        thrusts = [float(climb.summary["thrust_mean_n"]) for climb in climbs]
        run.require("thrust_rises", float(np.diff(thrusts).min()), lower=_RISE)
    _illustrate(run, climbs)


def _climb(run: Run, slope: float) -> tuple[Climb, int]:
    """Climb one slope; return it and the falls."""
    options, label = run.options, f"slope_{slope:g}"
    course = course_for(slope, 1.5 * options.speed * options.duration, options.friction)
    with run.session(
        climbing_settings(course, options.seed), label=label, expected=options.duration + 30
    ) as session:
        get_ready(session)
        stands = climb_onto(session, course, options.speed)
        start = session.time
        stands = stands and go(session, course, options.duration, options.speed)
        end = session.time
    if not stands:
        start = max(0.0, end - options.duration)
    recording = run.recording(label)
    summary = climb_summary(recording, run.robot(), course, start, end)
    return Climb(course, recording, start, end, dict(summary)), int(not stands)


def _illustrate(run: Run, climbs: list[Climb]) -> None:
    if not run.options.no_figures:
        run.say("drawing figures")
        figure_incline.draw_all(climbs, run.robot(), run.output / "figures")
    if run.options.no_video:
        return
    from husky_experiments.figures import video

    steepest = climbs[-1]
    directory = run.output / f"slope_{steepest.course.slope_deg:g}"
    model = video.load_scene(directory / SCENE_FILE)
    run.say("rendering video and snapshots of the steepest slope")
    times = steepest.start + 2.0 + np.linspace(0.0, _CYCLE, _SNAPSHOTS, endpoint=False)
    pictures = run.output / "snapshots.png"
    if video.snapshots(steepest.recording, model, pictures, times.tolist()) is None:
        run.say(video.unavailable_reason())
        return
    video.render(steepest.recording, model, run.output / "video.mp4")
