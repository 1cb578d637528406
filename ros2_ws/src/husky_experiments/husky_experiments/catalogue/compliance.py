"""Trot, climb and fly on frames that bend (T6), from a stiff one to one of 10 Hz."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from typing import Any

from husky_experiments import catalogue
from husky_experiments.figures.compliance import draw_compliance
from husky_experiments.metrics.measures import MAXIMUM_TILT
from husky_experiments.run import Run, frame_frequency
from husky_experiments.session import SessionError

CASES = {
    "trot": ("trot", "--speed 0.5 --duration 30"),
    "wair_30": ("wair", "--slope 30 --duration 10"),
    "wair_45": ("wair", "--slope 45 --duration 10"),
    "hover": ("hover", ""),
    "beta_hover": ("beta_hover", "--duration 20"),
}
"""Experiments by name of the case, with the options that are not their defaults."""
MUST_HOLD = {"trot": 15.0, "wair_30": 15.0}
"""Frequency down to which a case has to meet its criteria [Hz]; the others must with a stiff frame.
"""
REPORTED = ("roll_rms_deg", "pitch_rms_deg", "foot_placement_rms_mm", "tilt_max_deg")
"""Metrics that are reported of each case; flights have no foot placement."""

Outcome = dict[str, Any]
"""Result of a case on a frame: `ok`, its criteria that `failed` with their values, metrics."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare frequencies, cases and seed."""
    parser.add_argument(
        "--compliance",
        type=frame_frequency,
        nargs="+",
        metavar="HZ",
        default=[40.0, 20.0, 15.0, 10.0],
        help="eigenfrequencies of the frame, 10 to 40, tried beside a stiff one",
    )
    parser.add_argument(
        "--cases",
        nargs="+",
        metavar="CASE",
        choices=tuple(CASES),
        default=list(CASES),
        help=f"experiments to run, of {', '.join(CASES)}",
    )
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def run(run: Run) -> None:
    """Meet each case's own criteria, down to the frequency at which they have to hold."""
    options = run.options
    frequencies = [0.0, *sorted(set(options.compliance) - {0.0}, reverse=True)]
    cases = list(dict.fromkeys(options.cases))
    found = {case: {hz: _run_case(run, case, hz) for hz in frequencies} for case in cases}
    for case, by_frequency in found.items():
        run.metrics[case] = {_name(hz): figures for hz, figures in by_frequency.items()}
        run.metrics[f"softest_frame_{case}"] = softest(by_frequency)
        least = MUST_HOLD.get(case, math.inf)
        asked = [figures for hz, figures in by_frequency.items() if not hz or hz >= least]
        failures = sum(not figures["ok"] for figures in asked)
        run.require(f"frames_failed_{case}", failures, upper=0)
    if not options.no_figures:
        draw_compliance(found, run.output / "figures")


def softest(by_frequency: Mapping[float, Outcome]) -> str:
    """Return the name of the softest frame with which, and with all stiffer ones, a case is `ok`.

    Args:
        by_frequency: figures by frequency [Hz], 0 for a stiff frame.

    Returns:
        As `10_hz`; `stiff` where no frame may bend; `none` where the case fails on a stiff one.
    """
    found = "none"
    for hz in sorted(by_frequency, key=lambda hz: -hz if hz else -math.inf):
        if not by_frequency[hz]["ok"]:
            break
        found = _name(hz)
    return found


def _run_case(run: Run, case: str, frequency: float) -> Outcome:
    """Run one case on one frame."""
    name, arguments = CASES[case]
    experiment = catalogue.find(name)
    parser = argparse.ArgumentParser()
    experiment.add_options(parser)
    chosen = parser.parse_args([*arguments.split(), "--seed", str(run.options.seed)])
    chosen.compliance, chosen.no_video, chosen.no_figures = frequency, True, True
    part = run.part(f"{case}_{_name(frequency)}", chosen)
    try:
        experiment.run(part)
    except SessionError as error:
        part.fail(str(error))
    failed = {key: entry["value"] for key, entry in part.criteria.items() if not entry["ok"]}
    run.say(f"{case}, {_name(frequency)}: {', '.join(failed) or 'all criteria hold'}")
    told: Outcome = {"ok": part.ok, "failed": failed}
    told["falls"] = part.criteria.get("falls", {}).get("value")
    told |= {key: part.metrics.get(key) for key in REPORTED}
    if told["tilt_max_deg"] is not None:
        told["attitude_margin_deg"] = math.degrees(MAXIMUM_TILT) - told["tilt_max_deg"]
    return told


def _name(frequency: float) -> str:
    """Return the name of a frame."""
    return f"{frequency:g}_hz" if frequency else "stiff"
