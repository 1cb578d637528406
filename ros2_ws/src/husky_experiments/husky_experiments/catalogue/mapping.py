"""Walk 6 m along a lane and map the ground beside it and ahead."""

from __future__ import annotations

import argparse

from husky_bringup.system import ParameterValue
from husky_experiments.metrics import mapping, walking
from husky_experiments.run import SCENE_FILE, Run
from husky_experiments.scripts import finish, stand_up
from husky_experiments.session import Session
from husky_sim.gap import Gap

_SPEED = 0.5
"""Of the walk [m/s]."""
_DISTANCE = 6.0
"""Length of the walk [m]."""
_SPARE = 4.0
"""Time that the walk may take more than at that speed [s]."""
_SMOOTH = ("flat", "slope", "rough")
"""Scenes without steps."""
_LANE: dict[str, ParameterValue] = {"terrain_lane": 1.2, "terrain_approach": 7.0}
"""The robot is 0.4 m wide; its front feet are 0.3 m ahead of base, and it stops within 0.3 m."""
_GAP = Gap(7.0, 0.5, 0.0, 4.0)

_SCENES: dict[str, dict[str, ParameterValue]] = {
    "flat": {"terrain": "flat"},
    "slope": {"terrain": "banks", "slope_deg": 15.0, **_LANE},
    "rough": {"terrain": "rough", "terrain_height": 0.08, "terrain_size": 0.45, **_LANE},
    "steps": {"terrain": "steps", "terrain_height": 0.08, "terrain_size": 0.35, **_LANE},
    "gap": {
        "terrain": "gap",
        "terrain_approach": _GAP.approach,
        "terrain_size": _GAP.width,
        "terrain_height": _GAP.step,
        "terrain_top": _GAP.top,
    },
    "boxes": {"terrain": "boxes", "terrain_height": 0.35, **_LANE},
    "mixed": {"terrain": "mixed", "terrain_height": 0.35, "terrain_size": 0.5, **_LANE},
}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare scene and seed."""
    parser.add_argument("--scene", choices=tuple(_SCENES), default="mixed", help="the ground")
    parser.add_argument("--seed", type=int, default=0, help="of the ground and sensor noise")


def _way(session: Session) -> float:
    """Return the estimated way along x [m]."""
    return float(session.state.position[0]) if session.state is not None else 0.0


def run(run: Run) -> None:
    """No fall; the map is right within 2.5 m, and has what the camera has had in view."""
    scene = run.options.scene
    world = {**_SCENES[scene], "camera": True, "seed": run.options.seed}
    duration = _DISTANCE / _SPEED + _SPARE
    with run.session({"plant": world}, expected=duration + 12) as session:
        stand_up(session)
        session.set_gait("trot")
        start = session.time
        session.set_velocity(_SPEED)
        session.set_mode("walk")
        session.advance(duration, lambda: _way(session) >= _DISTANCE)
        end = session.time
        falls = finish(session)
    recording, robot = run.recording(), run.robot()
    run.metrics |= walking.summary(recording, robot, start, end)
    run.require("falls", falls, upper=0)
    run.require("distance_m", lower=0.95 * _DISTANCE)
    maps = mapping.judge(recording, robot, run.output / SCENE_FILE, end)
    if not maps:
        run.fail("there is no map after the first metre of the walk")
        return
    run.metrics |= mapping.summary(maps)
    run.require("rmse_m", upper=0.02 if scene in _SMOOTH else 0.03)
    run.require("bias_m", lower=-0.015, upper=0.015)
    run.require("coverage", lower=0.75)
    if scene == "gap":
        near, far = mapping.gap_edges(maps[-1])
        run.metrics |= {"near_edge_m": near, "far_edge_m": far}
        upper = mapping.EDGE_TOLERANCE
        run.require("near_edge_error_m", abs(near - _GAP.approach), upper=upper)
        run.require("far_edge_error_m", abs(far - _GAP.approach - _GAP.width), upper=upper)
    if not run.options.no_figures:
        from husky_experiments.figures.mapping import draw_map

        draw_map(maps, run.output)
    run.illustrate()
