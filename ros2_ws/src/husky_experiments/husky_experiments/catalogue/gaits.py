"""Crawl, trot, bound and pronk, one after the other, through stand."""

from __future__ import annotations

import argparse

from husky_experiments.metrics import walking as metrics
from husky_experiments.run import Run
from husky_experiments.scripts import sit_down, stand_up, stop_walking, walk

_SPEEDS = {"crawl": 0.05, "trot": 0.3, "bound": 0.2, "pronk": 0.1}
"""Forward speed of each gait [m/s]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare duration, gaits and seed."""
    parser.add_argument("--duration", type=float, default=20.0, help="of each gait [s]")
    parser.add_argument("--gaits", nargs="+", default=list(_SPEEDS), choices=list(_SPEEDS))
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def run(run: Run) -> None:
    """No fall; the crawl keeps its centre of mass inside the support polygon."""
    options = run.options
    spans: dict[str, tuple[float, float]] = {}
    fell = False
    with run.session(
        {"plant": {"seed": options.seed}},
        expected=(options.duration + 4) * len(options.gaits) + 10,
    ) as session:
        stand_up(session)
        for gait in options.gaits:
            run.say(gait)
            session.set_gait(gait)
            start = session.time
            walk(session, options.duration, (_SPEEDS[gait], 0.0, 0.0))
            spans[gait] = (start, session.time)
            fell = metrics.has_fallen(session.truth)
            if fell:
                break
            stop_walking(session)
        if not fell:
            sit_down(session)
    recording = run.recording()
    for gait, (start, end) in spans.items():
        run.metrics[gait] = metrics.summary(recording, run.robot(), start, end)
    run.require("falls", int(fell), upper=0)
    run.require("gaits_walked", len(spans), lower=len(options.gaits))
    if "crawl" in spans:
        margin = metrics.static_margin(recording, *spans["crawl"])
        run.metrics["crawl"]["static_margin_true_min_m"] = margin
        run.require("crawl_static_margin_m", margin, lower=1e-4)
    run.illustrate()
