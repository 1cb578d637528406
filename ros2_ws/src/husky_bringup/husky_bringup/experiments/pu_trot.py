"""Husky under the propulsion unit trots in place in three bursts, ropes slack above it (T40)."""

from __future__ import annotations

import argparse

import numpy as np

from husky_bringup import metrics
from husky_bringup.run import Run
from husky_bringup.scripts import finish_assisted, stand_assisted, stop_walking, walk
from husky_control.gait import GAITS

_ROPE = 2.4
"""Length of the ropes, just slack above the sitting robot [m]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare thrust, bursts and seed."""
    parser.add_argument("--thrust", type=float, default=0.4, help="share of the weight on the fans")
    parser.add_argument("--bursts", type=int, default=3, help="how often it trots")
    parser.add_argument("--burst", type=float, default=5.0, help="duration of each [s]")
    parser.add_argument("--pause", type=float, default=3.0, help="standing between them [s]")
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def run(run: Run) -> None:
    """No fall; roll sways with the gait, and only in the bursts."""
    options = run.options
    bursts: list[tuple[float, float]] = []
    pauses: list[tuple[float, float]] = []
    settings = {
        "plant": {
            "seed": options.seed,
            "body": "robot_with_unit",
            "gantry": True,
            "rope_length": _ROPE,
        }
    }
    expected = options.bursts * (options.burst + options.pause + 2.0) + 20.0
    with run.session(settings, expected=expected) as session:
        stand_assisted(session, options.thrust)
        for _ in range(options.bursts):
            start = session.time
            session.advance(options.pause)
            pauses.append((start + 1.0, session.time))
            start = session.time
            walk(session, options.burst, (0.0, 0.0, 0.0))
            bursts.append((start + 1.0, session.time))
            if metrics.has_fallen(session.truth):
                break
            stop_walking(session)
        falls = finish_assisted(session)
        run.metrics["trajectory_sha256"] = session.trajectory_sha256
    recording, robot = run.recording(), run.robot()
    for index, (start, end) in enumerate(bursts, 1):
        run.metrics[f"burst_{index}"] = metrics.summary(recording, robot, start, end)
    rolls = [recording.base.between(*span).rpy[:, 0] for span in bursts]
    still = [recording.base.between(*span).rpy[:, 0] for span in pauses]
    tilts = [recording.base.between(*span).rpy[:, :2] for span in bursts]
    run.metrics["attitude_rms_deg"] = float(
        np.degrees(np.sqrt(np.mean(np.concatenate(tilts) ** 2)))
    )
    gait = 1.0 / GAITS["trot"].period
    run.metrics["gait_frequency_hz"] = gait
    lines = [_line(roll, gait) for roll in rolls]
    run.metrics["roll_at_gait_frequency_deg"] = float(np.median([line for line, _ in lines]))
    run.metrics["roll_rms_deg"] = _rms_deg(rolls)
    run.metrics["roll_rms_standing_deg"] = _rms_deg(still)
    for group in ("hip_frontal", "hip_sagittal", "knee"):
        key = f"tracking_rms_{group}_deg"
        run.metrics[key] = max(run.metrics[f"burst_{i}"][key] for i in range(1, len(bursts) + 1))
    run.require("falls", falls, upper=0)
    run.require("bursts", len(bursts), lower=options.bursts)
    run.require(
        "roll_line_over_background",
        float(np.median([line / background for line, background in lines])),
        lower=3.0,
    )
    run.require(
        "roll_in_bursts_over_standing",
        run.metrics["roll_rms_deg"] / run.metrics["roll_rms_standing_deg"],
        lower=2.0,
    )
    for group in ("hip_sagittal", "knee"):
        run.require(
            f"tracking_rms_{group}_deg", run.metrics[f"tracking_rms_{group}_deg"], upper=3.0
        )
    run.illustrate()


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
