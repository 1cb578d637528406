"""Husky hangs under the propulsion unit and trots in place in three bursts (thesis T40).

The ropes of the gantry hold the robot so that its feet just touch the ground; the fans carry a
share of the weight. Steps are the position-based trot (T18): feet go up and down under their hips,
whatever the body does, so it sways with every step. As in `pu_test` the operator holds the sticks
of the radio, level, and the autopilot is in STABILIZED: it keeps the attitude as far as it can.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping

import numpy as np

from husky_bringup.system import ParameterValue
from husky_control.gait.table import GAITS
from husky_description.arrays import Array
from husky_description.gantry import GantryOptions
from husky_description.robot import Robot
from husky_experiments.catalogue import pu_test
from husky_experiments.metrics import walking as metrics
from husky_experiments.metrics.measures import JOINT_GROUPS
from husky_experiments.metrics.propulsion import Span, attitude_summary, battery_summary
from husky_experiments.pilot import Pilot, Wish
from husky_experiments.radio_flight import Flight, hanging_height, weight_share
from husky_experiments.run import Run
from husky_experiments.session import Session

_PRESSED = 0.006
"""How much lower the robot would hang without the ground, legs in the standing posture [m]."""
_ALONE = "unit_alone"
"""Label of the session in which the unit flies `pu_test`, to compare with."""
_HOLD_ALONE = 4.0
"""As in `pu_test` [s]."""
_SETTLING = 6.0
"""For the legs to take their posture, and the robot to hang still: nobody arms before [s]."""
_AXES = ("roll", "pitch", "yaw")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare thrust, bursts and seed."""
    parser.add_argument("--thrust", type=float, default=0.4, help="share of the weight on the fans")
    parser.add_argument("--bursts", type=int, default=3, help="how often it trots")
    parser.add_argument("--burst", type=float, default=5.0, help="duration of each [s]")
    parser.add_argument("--pause", type=float, default=3.0, help="hanging between them [s]")
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def run(run: Run) -> None:
    """Roll sways with the gait, more than the unit alone as it hovers; the joints follow."""
    options, robot = run.options, run.robot()
    alone, _ = pu_test.fly(run, _HOLD_ALONE, options.seed, _ALONE)
    alone_recording = run.recording(_ALONE)
    unit = attitude_summary(alone_recording, *pu_test.flown(alone))["attitude_rms_deg"]
    hovering = alone_recording.base.between(*alone.passages["hold"]).rpy
    gantry = gantry_over(robot)
    settings: dict[str, dict[str, ParameterValue]] = {
        "plant": {
            "seed": options.seed,
            "body": "robot_with_unit",
            "gantry": True,
            "gantry_height": gantry.height,
            "rope_length": gantry.rope,
            "start_height": hanging_height(gantry) - sitting_height(robot),
        },
        "flight_controller": {"seed": options.seed},
    }
    expected = options.bursts * (options.burst + options.pause) + _SETTLING + 16.0
    with run.session(settings, expected=expected, remote=True) as session:
        # The stick that carries this share; full throttle is full thrust.
        throttle = options.thrust * weight_share(robot) * robot.mass / robot.payload_mass
        flight = Flight(session, Pilot(throttle))
        trot(session, flight, options, Wish(roll=0.0, pitch=0.0, throttle=throttle))
        run.metrics["ended"] = session.state.reason if session.state is not None else "silent"
        active = session.state is not None and session.state.mode == "hang"
        run.require("falls", int(not active or metrics.has_fallen(session.truth)), upper=0)
    measure(run, flight.passages)
    run.metrics["attitude_rms_unit_alone_deg"] = unit
    run.metrics["tilt_oscillation_unit_alone_deg"] = tilt_oscillation([hovering])
    judge(run)
    run.illustrate()


def measure(run: Run, passages: Mapping[str, Span]) -> None:
    """Measure attitude, its oscillations, battery and joints in the bursts."""
    recording, robot, result = run.recording(), run.robot(), run.metrics
    bursts = [span for name, span in passages.items() if name.startswith("burst")]
    pauses = [span for name, span in passages.items() if name.startswith("pause")]
    summaries = [metrics.summary(recording, robot, *span) for span in bursts]
    result |= {f"burst_{index}": summary for index, summary in enumerate(summaries, 1)}
    result["bursts"] = len(bursts)
    result |= attitude_summary(recording, bursts[0][0], bursts[-1][1])
    # Taut or slack: the ropes are part of how it hangs.
    result["attitude_rms_deg"] = result["attitude_rms_all_deg"]
    before, loaded = passages["before"], passages["pause_1"]
    result |= battery_summary(recording, robot, (before[1] - 2.0, before[1]), loaded)
    result["gait_frequency_hz"] = gait = 1.0 / GAITS["trot"].period
    angles = [recording.base.between(*span).rpy for span in bursts]
    for axis, name in enumerate(_AXES):
        swings = [without_drift(burst[:, axis]) for burst in angles]
        result[f"{name}_oscillation_deg"] = _rms_deg(swings)
    result["tilt_oscillation_deg"] = tilt_oscillation(angles)
    lines = [_line(burst[:, 0], gait) for burst in angles]
    result["roll_at_gait_frequency_deg"] = float(np.median([line for line, _ in lines]))
    result["roll_line_over_background"] = float(np.median([a / b for a, b in lines]))
    result["roll_rms_deg"] = _rms_deg([burst[:, 0] for burst in angles])
    still = [recording.base.between(*span).rpy[:, 0] for span in pauses]
    result["roll_rms_hanging_deg"] = _rms_deg(still)
    for group in JOINT_GROUPS:
        key = f"tracking_rms_{group}_deg"
        result[key] = max(float(summary[key] or np.nan) for summary in summaries)


def judge(run: Run) -> None:
    """State the criteria.

    The attitude's error is none: it is mostly the heading's, which the compass corrects while the
    robot stands, and of the unit alone that of the steps which it flies.
    """
    result = run.metrics
    run.require("bursts", lower=run.options.bursts)
    swings = result["tilt_oscillation_deg"] / result["tilt_oscillation_unit_alone_deg"]
    run.require("tilt_oscillation_over_unit_alone", swings, lower=3.0)
    run.require("roll_line_over_background", lower=3.0)
    louder = result["roll_rms_deg"] / result["roll_rms_hanging_deg"]
    run.require("roll_in_bursts_over_hanging", louder, lower=2.0)
    for group in ("hip_sagittal", "knee"):
        key = f"tracking_rms_{group}_deg"
        run.require(key, upper=3.0)
    run.require("voltage_drop_ratio", lower=0.95, upper=1.05)
    run.require("current_rise_a", lower=result["current_rise_least_a"])


def without_drift(angle: Array) -> Array:
    """Return an angle over time without its slow wandering, a cubic fitted to it.

    The wandering of the heading is no oscillation: the autopilot turns towards a heading that its
    compass still corrects, and the feet let it.
    """
    place = np.linspace(-1.0, 1.0, len(angle))
    swing: Array = angle - np.polynomial.Polynomial.fit(place, angle, 3)(place)
    return swing


def tilt_oscillation(spans: list[Array]) -> float:
    """Return the root mean square of roll and pitch over spans, each without its wandering [deg].

    Args:
        spans: roll, pitch, yaw over time, one array (n, 3) for each [rad].
    """
    return _rms_deg([without_drift(span[:, axis]) for span in spans for axis in range(2)])


def gantry_over(robot: Robot) -> GantryOptions:
    """Return the gantry of `pu_test`, its beam so high that the feet just touch the ground."""
    known = pu_test.GANTRY
    wanted = robot.stand_height + robot.foot_radius - _PRESSED
    return GantryOptions(height=known.height + wanted - hanging_height(known), rope=known.rope)


def sitting_height(robot: Robot) -> float:
    """Return the height of the base above the ground in the posture `sit` [m]."""
    return robot.sit_height + robot.foot_radius


def trot(session: Session, flight: Flight, options: argparse.Namespace, wish: Wish) -> None:
    """Hang, arm, spool up, trot in bursts, spool down."""
    none = Wish(roll=0.0, pitch=0.0, throttle=0.0)
    session.enable_drives()
    session.set_mode("hang")
    flight.fly(_SETTLING, none, name="before")
    flight.pilot.armed = True
    flight.fly(2.0, none, name="armed")
    flight.fly(3.0, wish, name="spool_up")
    for burst in range(1, options.bursts + 1):
        flight.fly(options.pause, wish, name=f"pause_{burst}")
        session.set_mode("tread")
        flight.fly(options.burst, wish, name=f"burst_{burst}")
        session.set_mode("hang", within=1.0)
    flight.fly(3.0, none, name="spool_down")
    flight.pilot.armed = False
    flight.fly(1.0, none, name="disarmed")


def _rms_deg(parts: list[np.ndarray]) -> float:
    """Root mean square about each part's own mean [deg]."""
    return float(np.degrees(np.sqrt(np.mean(np.concatenate([p - p.mean() for p in parts]) ** 2))))


def _line(signal: np.ndarray, frequency: float) -> tuple[float, float]:
    """Amplitude of a signal's oscillation at a frequency, and of what lies between its harmonics.

    Args:
        signal: angle at 100 Hz [rad].
        frequency: of the gait [Hz]; one diagonal steps like the other, so halves of it count too.

    Returns:
        Amplitude at that frequency, and the median amplitude a quarter of it beside the harmonics
        up to 10 Hz [deg].
    """
    window = np.hanning(len(signal))
    spectrum = np.abs(np.fft.rfft((signal - signal.mean()) * window, 16384)) * 2 / window.sum()
    at = np.fft.rfftfreq(16384, 0.01)

    def amplitude(wanted: float) -> float:
        return float(np.degrees(spectrum[np.argmin(np.abs(at - wanted))]))

    between = np.arange(0.25, 10.0 / frequency, 0.5) * frequency
    return amplitude(frequency), float(np.median([amplitude(f) for f in between]))
