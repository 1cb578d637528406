"""Trot over tiles of random height on slippery ground."""

from __future__ import annotations

import argparse

from husky_experiments.metrics import walking as metrics
from husky_experiments.run import Run
from husky_experiments.scripts import finish, stand_up, walk

_FLAT = 0.5
"""Flat ground before the first tile, from the front feet on [m]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare ground, speed, distance and seed."""
    parser.add_argument("--height", type=float, default=0.03, help="greatest tile height [m]")
    parser.add_argument("--tile", type=float, default=0.2, help="edge of a tile [m]")
    parser.add_argument("--friction", type=float, default=0.4, help="sliding friction")
    parser.add_argument("--speed", type=float, default=0.3, help="forward speed [m/s]")
    parser.add_argument("--length", type=float, default=4.0, help="length of the tiles [m]")
    parser.add_argument("--seed", type=int, default=0, help="of tiles and sensor noise")


def run(run: Run) -> None:
    """No fall over the whole length; slip and speed are reported."""
    options = run.options
    world = {
        "terrain": "tiles",
        "terrain_height": options.height,
        "terrain_size": options.tile,
        "terrain_length": options.length,
        "friction": options.friction,
        "seed": options.seed,
    }
    duration = (options.length + _FLAT + 1.0) / options.speed
    with run.session({"plant": world}, expected=duration + 10) as session:
        stand_up(session)
        session.set_gait("trot")
        start = session.time
        walk(session, duration, (options.speed, 0.0, 0.0))
        end = session.time
        falls = finish(session)
    run.metrics |= metrics.summary(run.recording(), run.robot(), start, end)
    run.require("falls", falls, upper=0)
    run.require("distance_m", lower=0.9 * (options.length + _FLAT))
    run.illustrate()
