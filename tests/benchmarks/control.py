"""The controller's pure tick while trotting."""

from __future__ import annotations

import argparse
import gc
import sys
from pathlib import Path
from typing import Any

import numpy as np

from husky_bringup.settings import HelpFormatter
from husky_runtime import graph

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "closed_loop"))
from in_process import InProcessRobot


def bench(arguments: list[str]) -> dict[str, Any]:
    """Time of the controller's tick while trotting, and its share of the 2 ms period."""
    parser = argparse.ArgumentParser(prog="scripts/bench.sh control", formatter_class=HelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="simulated time [s]")
    parser.add_argument("--speed", type=float, default=0.5, help="[m/s]")
    options = parser.parse_args(arguments)
    robot = InProcessRobot()
    robot.stand()
    robot.controller.request_mode("walk")
    robot.run(2.0, (options.speed, 0.0, 0.0))
    robot.tick_seconds.clear()
    gc.collect()
    gc.freeze()  # as the nodes do
    robot.run(options.seconds, (options.speed, 0.0, 0.0))
    if robot.controller.mode.value != "walk":
        raise RuntimeError(f"the robot does not walk: {robot.controller.reason}")
    ticks = np.array(robot.tick_seconds)
    p50, p99 = (float(np.percentile(ticks, percent)) for percent in (50, 99))
    return {
        "tick_us_p50": 1e6 * p50,
        "tick_us_p99": 1e6 * p99,
        "tick_over_period_p50": p50 / graph.TICK_PERIOD,
        "tick_over_period_p99": p99 / graph.TICK_PERIOD,
        "ticks": len(ticks),
    }
