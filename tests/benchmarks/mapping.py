"""The walking graph with its depth camera beside the same without: time of an image, cost of eyes.

Both graphs run in domains of their own and walk in turn for a second or so on the same ground,
while the world of the other one is paused: the machine's own speed changes from second to second,
and a pair of neighbouring walks sees the same machine. Eyes are the depth camera, whose rays are
cast in the plant, its driver, the mapper and the localizer.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import tempfile
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import loop
import numpy as np

from husky_bringup.settings import HelpFormatter
from husky_bringup.system import ParameterValue
from husky_experiments.session import Session, SessionError
from husky_runtime import graph
from husky_runtime.domain_locks import domain_of

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
_SPEED = 0.2
"""Of the walk [m/s]: slow, so that the lane is long enough for many pairs."""
_BLIND, _EYES = "blind", "eyes"
_NODES = (graph.PLANT, graph.D435_DRIVER, graph.ELEVATION_MAPPER, graph.LOCALIZER)
"""Nodes whose processor time is reported."""
_TIMES = (
    "image_ms_p50",
    "image_ms_p99",
    "image_cpu_ms_p50",
    "image_cpu_ms_p99",
    "map_ms_p50",
    "map_cpu_ms_p50",
)
"""Of the mapper's reports on `/diagnostics`, which are of all images of the run."""
_PATIENCE = 300.0
"""Wall time that a graph has to start, to stand up and for a walk [s]."""


class _Walk(NamedTuple):
    """Walk of a graph.

    Attributes:
        wall: wall time [s].
        simulated: simulated time [s].
        cpu: processor time of each node for a simulated second, until it is paused again [s].
        at_the_end: whether the robot is where the lane ends.
        paused: processors that the other graph takes meanwhile.
    """

    wall: float
    simulated: float
    cpu: dict[str, float]
    at_the_end: bool
    paused: float = 0.0


class _Pair(NamedTuple):
    """Walks of both graphs, one after the other."""

    blind: _Walk
    eyes: _Walk

    @property
    def ratio(self) -> float:
        """Wall time for a simulated second of the graph with eyes, over that without."""
        return (self.eyes.wall / self.eyes.simulated) / (self.blind.wall / self.blind.simulated)


def bench(arguments: list[str]) -> dict[str, Any]:
    """Walking graph with eyes and without: time of an image, wall time, CPU.

    - `image_ms_p50`, `_p99`: wall time of an image in the mapper; other processes share the
      processors, of which the graph takes all that it can get;
    - `image_cpu_ms_p50`, `_p99`: its processor time, in one thread: its wall time on a core of its
      own;
    - `map_ms_p50`, `map_cpu_ms_p50`: the same of the messages of a map, once in ten images;
    - `wall_s_per_sim_s_<graph>`: wall time for a simulated second, `eyes` or `blind`;
    - `eyes_over_blind`: their ratio in a pair of walks, the median of the pairs;
      `eyes_over_blind_p25`, `_p75`: its quartiles; `pairs`: their number;
    - `paused_processors_<graph>`: processors that a paused graph takes from the one that walks: its
      nodes still look at their wires;
    - `cpu_s_per_sim_s_<graph>_<node>`: processor time of nodes for a simulated second.
    """
    parser = argparse.ArgumentParser(prog="scripts/bench.sh mapping", formatter_class=HelpFormatter)
    parser.add_argument("--seconds", type=float, default=0.5, help="wall time of a walk [s]")
    parser.add_argument("--pairs", type=int, default=200, help="of walks, at most; the lane ends")
    options = parser.parse_args(arguments)
    domain = domain_of(os.environ)
    pairs: list[_Pair] = []
    other = domain + 1 if domain < 100 else domain - 1
    with _Graph(domain, eyes=False) as blind, _Graph(other, eyes=True) as eyes:
        at_the_end = False
        while len(pairs) < options.pairs and not at_the_end:
            eyes_first = len(pairs) % 2 == 1
            pairs.append(_walk_in_turn(blind, eyes, options.seconds, eyes_first=eyes_first))
            at_the_end = pairs[-1].blind.at_the_end or pairs[-1].eyes.at_the_end
            print(f"pair {len(pairs)}: {pairs[-1].ratio:.2f}", flush=True)
        times = eyes.ask("times")
    return _summary(pairs) | times


def _walk_in_turn(blind: _Graph, eyes: _Graph, seconds: float, *, eyes_first: bool) -> _Pair:
    """Let both graphs walk for a while of wall time [s]; the order changes from pair to pair."""
    walks = {}
    for graph_ in (eyes, blind) if eyes_first else (blind, eyes):
        paused = eyes if graph_ is blind else blind
        begun, before = time.monotonic(), paused.ask("cpu")
        walk = graph_.ask(seconds)
        used, wall = paused.ask("cpu") - before, time.monotonic() - begun
        walks[graph_] = walk._replace(paused=used / wall)
    return _Pair(walks[blind], walks[eyes])


def _summary(pairs: Sequence[_Pair]) -> dict[str, float]:
    """Return the metrics of pairs of walks."""
    low, middle, high = np.percentile([pair.ratio for pair in pairs], (25, 50, 75)).tolist()
    metrics = {"eyes_over_blind": middle, "eyes_over_blind_p25": low, "eyes_over_blind_p75": high}
    metrics["pairs"] = len(pairs)
    walks_of = {_BLIND: [pair.blind for pair in pairs], _EYES: [pair.eyes for pair in pairs]}
    for state, other in ((_BLIND, _EYES), (_EYES, _BLIND)):
        walks = walks_of[state]
        wall, simulated = (sum(each) for each in zip(*(walk[:2] for walk in walks), strict=True))
        metrics[f"wall_s_per_sim_s_{state}"] = wall / simulated
        metrics[f"paused_processors_{other}"] = float(np.mean([walk.paused for walk in walks]))
        for node in (node for node in _NODES if node in walks[0].cpu):
            used = float(np.mean([walk.cpu[node] for walk in walks]))
            metrics[f"cpu_s_per_sim_s_{state}_{node}"] = used
    return metrics


class _Graph:
    """A walking graph in a process and a domain of its own, paused unless it is asked to walk."""

    def __init__(self, domain: int, *, eyes: bool):
        """Start it, have the robot stand up and trot, and pause it."""
        spawn = multiprocessing.get_context("spawn")
        self._pipe, theirs = spawn.Pipe()
        self._process = spawn.Process(target=_serve, args=(theirs, domain, eyes))
        self._process.start()
        theirs.close()
        self._answer()

    def __enter__(self) -> _Graph:
        return self

    def __exit__(self, *_: object) -> None:
        self._pipe.close()
        self._process.join()

    def ask(self, request: float | str) -> Any:
        """Return the answer of `_serve` to a request."""
        self._pipe.send(request)
        return self._answer()

    def _answer(self) -> Any:
        if not self._pipe.poll(_PATIENCE):
            raise SessionError(f"a graph does not answer within {_PATIENCE} s")
        try:
            return self._pipe.recv()
        except EOFError:
            raise SessionError("a graph has ended; its error is above") from None


def _serve(pipe: Connection, domain: int, eyes: bool) -> None:
    """Run a graph: walk for each number of seconds that is asked for, until the pipe is closed."""
    os.environ["ROS_DOMAIN_ID"] = str(domain)
    with (
        tempfile.TemporaryDirectory() as directory,
        loop.free_run(Path(directory), plant={**_GROUND, "camera": eyes}) as session,
    ):
        session.pause()
        probe = loop.Probe(session)
        answer: Any = None
        while True:
            pipe.send(answer)
            try:
                request = pipe.recv()
            except EOFError:
                return
            if request == "cpu":
                answer = sum(loop.cpu_seconds(session.processes, session.specs).values())
            elif request == "times":
                answer = {key: _newest(probe, key) for key in _TIMES}
            else:
                answer = _walk(session, probe, request)


def _walk(session: Session, probe: loop.Probe, seconds: float) -> _Walk:
    """Walk for a while of wall time [s], or to the lane's end."""
    before = loop.cpu_seconds(session.processes, session.specs)
    session.pause(False)
    start, start_simulated = time.monotonic(), probe.simulated()
    probe.walk_for(seconds, lambda: _is_at_the_end(session), _SPEED)
    simulated, wall = probe.simulated() - start_simulated, time.monotonic() - start
    session.pause()
    after = loop.cpu_seconds(session.processes, session.specs)
    if session.state is None or session.state.mode != "walk":
        raise SessionError(f"the robot walks no longer: {session.state}")
    stepped = probe.simulated() - start_simulated
    cpu = {node: (after[node] - before[node]) / stepped for node in after}
    return _Walk(wall, simulated, cpu, _is_at_the_end(session))


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
