"""Wing-assisted incline running: from the flat up a slope, held against it by the fans (T32)."""

from __future__ import annotations

import argparse

from husky_bringup.system import ParameterValue
from husky_experiments.climb_scripts import climb_onto, get_ready, go, has_fallen, walk_down
from husky_experiments.incline_course import MOUNTINGS, Course, climbing_settings, course_for
from husky_experiments.metrics.incline import climb_summary, worst_tilt_deg
from husky_experiments.run import Run
from husky_experiments.scripts import sit_down
from husky_experiments.session import Session
from husky_runtime import graph

_PUSH = 0.1
"""Duration of a push [s]."""
_STOPPING, _STANDING = 2.0, 3.0
"""Time to come to a stop on the slope, and then to stand there [s]."""
_SHARE = {"vector": 0.32 / 0.7, "body_z": 0.22 / 0.7}
"""Of the ground's friction, which the feet are to use in each thrust mode [-]."""
_ROUGH = 0.7
"""Friction from which on more of it is not used [-]."""
_BEFORE_FAULT, _AFTER_FAULT = 3.0, 8.0
"""Time on the slope before something is lost, and to see how it ends [s]."""
_TUMBLE = 75.0
"""Tilt from which on the robot has rolled over [deg]."""
_NARROW, _WIDE = 1.5, 3.0
"""Radii of the slope's foot [m]."""
_WIDE_FROM = {"vector": 60.0, "body_z": 30.0}
"""Slope beyond which the foot is wide in each thrust mode [deg]."""
_SLIP = 2.0
"""Most slip per step [mm]: four times what feet need to land, 2 % of a step."""
_THRUST_AT_45 = 40.0
"""Most thrust at 45 degrees [N]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare slope, speed, thrust and disturbances."""
    parser.add_argument("--slope", type=float, default=45.0, help="of the ground [deg]")
    parser.add_argument("--speed", type=float, default=0.25, help="along the slope [m/s]")
    parser.add_argument("--duration", type=float, default=20.0, help="measured time [s]")
    parser.add_argument("--friction", type=float, default=0.7, help="sliding friction [-]")
    parser.add_argument(
        "--thrust-mode", choices=tuple(MOUNTINGS), default="vector", help="how the fans push"
    )
    parser.add_argument("--no-thrust", action="store_true", help="climb with the legs alone")
    parser.add_argument("--return", dest="back", action="store_true", help="stop, and walk down")
    parser.add_argument("--pushes", type=int, default=0, help="how many, one every 3 s")
    parser.add_argument("--push-impulse", type=float, default=5.0, help="of each [N s]")
    parser.add_argument(
        "--blend",
        type=float,
        help="radius of the slope's foot [m]: 1.5, but 3 beyond 60 deg, with body_z beyond 30",
    )
    parser.add_argument(
        "--lose", choices=("fan", "link"), help="a fan, or the autopilot's bridge, on the slope"
    )
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def load_slope(thrust_mode: str, friction: float) -> float:
    """Return what the feet are asked to bear on ground of a friction, tangential over normal [-].

    On rough ground no more than at `_ROUGH`: the feet would have to stand too far down the slope.
    """
    return _SHARE[thrust_mode] * min(friction, _ROUGH)


def blend(options: argparse.Namespace) -> float:
    """Return the radius of the slope's foot [m]: what was asked for, or what the robot masters."""
    if options.blend is not None:
        return float(options.blend)
    wide = options.slope > _WIDE_FROM[options.thrust_mode]
    return _WIDE if wide else _NARROW


def controller_settings(options: argparse.Namespace) -> dict[str, ParameterValue]:
    """Return the controller's parameters that the options change."""
    chosen: dict[str, ParameterValue] = {}
    if options.thrust_mode == "body_z":
        chosen["planner"] = False  # Its plans pitch further, for less thrust, and feet slip more.
    if options.no_thrust:
        chosen["wair.thrust_share"] = 0.0
    chosen["wair.load_slope"] = load_slope(options.thrust_mode, options.friction)
    return chosen


def run(run: Run) -> None:
    """No fall, fast enough, feet inside of the cone, thrust within what the statics promise."""
    options = run.options
    way = 1.5 * options.speed * options.duration
    course = course_for(options.slope, way, options.friction, blend(options))
    run.metrics["blend_m"] = course.blend
    settings = climbing_settings(
        course, options.seed, options.thrust_mode, controller_settings(options)
    )
    with run.session(settings, expected=options.duration + 40) as session:
        get_ready(session, fans=not options.no_thrust)
        reached = climb_onto(session, course, options.speed)
        start = session.time
        if options.lose:
            stands = reached and go(session, course, _BEFORE_FAULT, options.speed)
        else:
            stands = reached and _climb(run, session, course)
        end = session.time
        if stands and options.lose:
            _lose(run, session, course)
        last = session.time
        came_back = True
        if stands and options.back:
            came_back = _come_back(run, session, course, options.speed)
        assert session.state is not None
        run.metrics["last_mode"] = session.state.mode
        run.metrics["last_reason"] = session.state.reason
    if not reached:
        start = max(0.0, end - 2.0)
        run.metrics["fell_before_the_slope"] = True
    run.metrics |= climb_summary(run.recording(), run.robot(), course, start, end)
    if options.lose:
        tilt = worst_tilt_deg(run.recording(), course, end, last)
        run.metrics["worst_tilt_deg"] = tilt
        run.require("falls_before", int(not stands), upper=0)
        run.require("tumbles", int(tilt > _TUMBLE), upper=0)
        if options.lose == "fan":
            run.require("walked_down", int(run.metrics.get("walked_down", False)), lower=1)
    else:
        judge(run, course, falls=int(not (stands and came_back)))
    run.illustrate()


def judge(run: Run, course: Course, falls: int) -> None:
    """State the criteria of a climb."""
    run.require("falls", falls, upper=0)
    run.require("mean_speed", lower=0.2)
    run.require("inside_cone", lower=0.95)
    run.require("slip_mm_per_step", upper=_SLIP)
    if course.slope_deg == 45.0 and run.options.thrust_mode == "vector":
        run.require("thrust_max_n", upper=_THRUST_AT_45)


def _climb(run: Run, session: Session, course: Course) -> bool:
    """Climb for the measured time, pushed now and then; return whether the robot stands."""
    options = run.options
    uphill = course.uphill
    directions = ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), tuple(uphill), tuple(-uphill))
    end = session.time + options.duration
    for number in range(options.pushes):
        size = options.push_impulse / _PUSH
        x, y, z = (size * float(part) for part in directions[number % 4])
        session.push((x, y, z), _PUSH)
        if not go(session, course, 3.0, options.speed):
            return False
        run.say(f"push {number + 1} survived")
    return go(session, course, max(0.0, end - session.time), options.speed)


def _lose(run: Run, session: Session, course: Course) -> None:
    """Lose a fan and walk down again, or the link, and see what becomes of the robot."""
    if run.options.lose == "link":
        session.kill(graph.PIXHAWK_BRIDGE)
        session.set_velocity(0.0)
        session.advance(_AFTER_FAULT)
        return
    fans = run.robot().rotor_names
    session.inject(graph.PLANT_INJECT_FAULT, f"{fans[run.options.seed % len(fans)]}_fan", "fail")
    stands = go(session, course, _STOPPING, run.options.speed)
    run.metrics["walked_down"] = stands and walk_down(session, course, -run.options.speed)


def _come_back(run: Run, session: Session, course: Course, speed: float) -> bool:
    """Stop, stand, walk down backwards to the flat, stand and sit; return whether it did."""
    if not go(session, course, _STOPPING, 0.0) or not go(session, course, _STANDING, 0.0):
        return False
    run.say("stood on the slope")
    if not walk_down(session, course, -speed):
        return False
    run.say("back on the flat")
    if not go(session, course, _STOPPING, 0.0):
        return False
    session.set_mode("stand", reached="stand", within=3.0, patience=2.0)
    session.release_velocity()
    sit_down(session)
    return not has_fallen(session, course) or session.state.mode == "passive"  # type: ignore[union-attr]
