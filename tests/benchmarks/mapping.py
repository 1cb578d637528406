"""The walking graph with its depth camera beside the same without: time of an image, cost of eyes.

A round is both graphs one after the other on the same ground, in an order that changes from round
to round: the machine's own speed changes meanwhile. Eyes are the depth camera, whose rays are cast
in the plant, its driver, the mapper and the localizer.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import loop
import numpy as np

from husky_bringup.settings import HelpFormatter
from husky_bringup.system import ParameterValue
from husky_experiments.session import Session, SessionError
from husky_runtime import graph

_GROUND: dict[str, ParameterValue] = {
    "terrain": "mixed",
    "terrain_height": 0.35,
    "terrain_size": 0.5,
    "terrain_lane": 1.2,
    "terrain_approach": 7.0,
}
"""The scene `mixed` of the experiment `mapping`: a lane 7 m long, with boxes, steps and facets
beside it and ahead."""
_FURTHEST = 6.0
"""Where the robot's walk ends, with its feet still in the lane [m]."""
_BLIND, _EYES = "blind", "eyes"
_NODES = (graph.PLANT, graph.D435_DRIVER, graph.ELEVATION_MAPPER, graph.LOCALIZER)
"""Whose processor time is reported."""
_MEDIANS = ("image_ms_p50", "image_cpu_ms_p50", "map_ms_p50", "map_cpu_ms_p50")
_WORST = ("image_ms_p99", "image_cpu_ms_p99")
"""Of the mapper's reports on `/diagnostics`: metrics are the median and the worst of the rounds."""


def bench(arguments: list[str]) -> dict[str, Any]:
    """Walking graph with eyes and without: time of an image, wall time, CPU.

    - `image_ms_p50`, `_p99`: wall time of an image in the mapper; other processes share the
      processors, of which the graph takes all that it can get;
    - `image_cpu_ms_p50`, `_p99`: its processor time, in one thread: its wall time on a core of its
      own;
    - `map_ms_p50`, `map_cpu_ms_p50`: the same of the messages of a map, once in ten images;
    - `wall_s_per_sim_s_<graph>`: wall time for a simulated second, `eyes` or `blind`;
    - `eyes_over_blind`: their ratio in the same round, the median of the rounds;
    - `cpu_s_per_sim_s_<graph>_<node>`: processor time of nodes for a simulated second.
    """
    parser = argparse.ArgumentParser(prog="scripts/bench.sh mapping", formatter_class=HelpFormatter)
    parser.add_argument("--seconds", type=float, default=8.0, help="wall time measured at once [s]")
    parser.add_argument("--rounds", type=int, default=3, help="both graphs in turn")
    options = parser.parse_args(arguments)
    rounds = []
    for number in range(options.rounds):
        found = {}
        for state in (_BLIND, _EYES) if number % 2 == 0 else (_EYES, _BLIND):
            print(f"round {number + 1}: {state}", flush=True)
            found[state] = _walk(options.seconds, eyes=state == _EYES)
        rounds.append(found)
    return _summary(rounds)


def _walk(seconds: float, *, eyes: bool) -> dict[str, float]:
    """Walk for a while of wall time [s], or to the lane's end; return what was measured."""
    with (
        tempfile.TemporaryDirectory() as directory,
        loop.free_run(Path(directory), plant={**_GROUND, "camera": eyes}) as session,
    ):
        probe = loop.Probe(session)
        measured = loop.measure(session, probe, seconds, lambda: _is_at_the_end(session))
        if session.state is None or session.state.mode != "walk":
            raise SessionError(f"the robot walks no longer: {session.state}")
        if eyes:
            measured |= {key: _newest(probe, key) for key in (*_MEDIANS, *_WORST)}
        return measured


def _is_at_the_end(session: Session) -> bool:
    """Return whether the robot is where the lane ends."""
    truth = session.truth
    return truth is not None and truth.pose.pose.position.x > _FURTHEST


def _newest(probe: loop.Probe, key: str) -> float:
    """Return what the mapper reported last, which is of all images of the run.

    Raises:
        SessionError: it has not reported it twice; the first report may be of the time before.
    """
    try:
        return probe.values(graph.ELEVATION_MAPPER, key)[-1]
    except LookupError:
        name = graph.ELEVATION_MAPPER
        raise SessionError(f"{name} does not report {key} yet: measure for longer") from None


def _summary(rounds: Sequence[dict[str, dict[str, float]]]) -> dict[str, float]:
    """Return the metrics of the rounds."""

    def of(state: str, key: str) -> Any:
        return np.array([each[state][key] for each in rounds])

    metrics = {key: float(np.median(of(_EYES, key))) for key in _MEDIANS}
    metrics |= {key: float(np.max(of(_EYES, key))) for key in _WORST}
    for state in (_BLIND, _EYES):
        metrics[f"wall_s_per_sim_s_{state}"] = float(np.median(1.0 / of(state, "rtf")))
    metrics["eyes_over_blind"] = float(np.median(of(_BLIND, "rtf") / of(_EYES, "rtf")))
    for state in (_BLIND, _EYES):
        for node in _NODES:
            key = f"cpu_s_per_sim_s_{node}"
            if key in rounds[0][state]:
                metrics[f"cpu_s_per_sim_s_{state}_{node}"] = float(np.median(of(state, key)))
    return metrics
