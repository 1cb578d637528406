"""Walk, stand, turn, climb for long with all of it running; nothing may grow, or be missing.

All of it is the propulsion unit with its fans and radio, the T265, the planner, the recorder. The
robot goes round after round through the same passages, and once to a slope, up it and down again.
Every few seconds the processes are looked at: after a time in which buffers fill and caches warm
up, nothing that they hold may grow. At the end each end of each wire must have counted the same
messages, one for each tick.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import os
from collections.abc import Collection, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from husky_experiments.climb_scripts import climb_onto, go, walk_down
from husky_experiments.incline_course import Course, climbing_settings
from husky_experiments.metrics.message_counts import (
    MISSED_TICKS,
    GraphCounters,
    Reports,
    count_in_bag,
    count_on_wires,
    counters_of,
)
from husky_experiments.metrics.resources import ResourceMeter, Sample
from husky_experiments.metrics.soak import growths, judged
from husky_experiments.pilot import Pilot
from husky_experiments.run import Run
from husky_experiments.scripts import finish_assisted, ready_fans, stand_up, stop_walking, walk
from husky_experiments.session import Session, SessionError
from husky_experiments.steering import Steering, trot_to
from husky_msgs.srv import PlanCycle
from husky_runtime import graph

_SAMPLES = 300
"""Looks at the processes: a list of them that gets longer would be a growth of its own."""
_WARM_UP = 60.0
"""Time in which buffers fill and caches warm up, at most half of the run [s]."""
_SHORTEST = 10.0
_SHARE = 0.15
"""Of the weight, on the fans: so little that the pack lasts for half an hour of it."""
_COURSE = Course(25.0, approach=7.0, length=6.0)
"""Where it climbs: the rounds, which nearly close, stay before it."""
_CLIMB = 120.0
"""Time that going there, the climb and the way back take, with a margin [s]."""
_SPEED, _UP, _REST = 0.25, 8.0, 2.0
"""Of the climb [m/s]; how long it goes up on the straight, and stands there [s]."""
_PACE = Steering(0.4, 1.0, 0.15, 0.3)
"""Of the way there and back."""
_WAY = 60.0
"""Time that the way there or back takes at most [s]."""
_OWN = "experiment"
_PLANS = 110
"""More than the planner remembers."""

Velocity = tuple[float, float, float]
_PASSAGES: tuple[tuple[float, float, Velocity | None], ...] = (
    (3.0, 0.0, None),
    (6.0, 0.0, (0.4, 0.0, 0.0)),
    (4.0, 0.0, (0.0, 0.0, 0.6)),
    (5.0, _SHARE, (0.0, 0.15, 0.0)),
    (6.0, _SHARE, (0.3, 0.0, 0.4)),
)
"""What a round consists of: time [s], share of the weight on the fans, velocity (x, y [m/s], yaw
rate [rad/s]) or None to stand. A round is shorter than a warm-up of 30 s."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare duration and seed."""
    parser.add_argument("--duration", type=float, default=600.0, help="simulated time [s]")
    parser.add_argument("--seed", type=int, default=0, help="of all sensor noise")


def run(run: Run) -> None:
    """No growth after the first minute, no missed tick, messages sent and received equal."""
    options = run.options
    if not options.duration >= _SHORTEST:
        raise SessionError(
            f"--duration is {options.duration:g}, it must be {_SHORTEST:g} s or more"
        )
    settings = climbing_settings(_COURSE, options.seed)
    settings[graph.FLIGHT_CONTROLLER]["seed"] = options.seed
    settings[graph.PLANNER] = {"keep": False}  # what is planned is planned anew in every run
    operator = _Operator(options.duration / _SAMPLES)
    with run.session(
        settings, expected=options.duration + 25.0, remote=True, on_advance=operator.advanced
    ) as session:
        operator.begin(
            session, ResourceMeter(_groups(session), {_OWN: os.getpid()}, run.output / "bag")
        )
        stand_up(session)
        ready_fans(session)
        session.set_gait("trot")
        operator.fill_planner()
        counted = counters_of(run.robot())
        before = operator.read_counters(counted.nodes)
        start = session.time
        warm = start + min(_WARM_UP, 0.5 * options.duration)
        rounds = operator.go_round(warm)
        climbs = int(options.duration - (session.time - start) > _CLIMB)
        stands = not climbs or operator.climb()
        if stands:
            rounds += operator.go_round(start + options.duration)
        stop_walking(session)
        end, after = session.time, operator.read_counters(counted.nodes)
        falls = finish_assisted(session) if stands else 1
    run.metrics |= {
        "rounds": rounds,
        "climbs": climbs,
        "plans": operator.plans,
        "simulated_s": end - start,
    }
    seen = [dataclasses.asdict(sample) for sample in operator.samples]
    (run.output / "resources.json").write_text(json.dumps(seen) + "\n")
    _judge_growth(run, operator.samples, warm)
    run.say("counting the messages in the bag")
    _judge_messages(run, counted, before, after, (start, end))
    run.require("falls", falls, upper=0)
    if not options.no_figures:
        from husky_experiments.figures.soak import draw_soak

        draw_soak(operator.samples, warm, run.output / "figures")


def _judge_growth(run: Run, samples: Sequence[Sample], begin: float) -> None:
    """State what may grow by how much, from a time on [s]."""
    try:
        grown = growths(samples, begin)
    except ValueError as error:
        raise SessionError(str(error)) from error
    last = samples[-1]
    run.metrics |= {
        "judged_from_s": begin,
        "memory_mb": {name: usage.memory / 1e6 for name, usage in last.nodes.items()},
        "memory_growth_mb": {name: value / 1e6 for name, value in grown.memory.items()},
        "descriptors": sum(usage.descriptors for usage in last.nodes.values()),
        "threads": sum(usage.threads for usage in last.nodes.values()),
        "shared_memory_entries": last.shared_entries,
        "shared_memory_mb": last.shared_bytes / 1e6,
        "log_kb": last.log_bytes / 1e3,
    }
    for name, (value, upper) in judged(grown).items():
        run.require(name, value, upper=upper)


def _judge_messages(
    run: Run, counted: GraphCounters, before: Reports, after: Reports, span: tuple[float, float]
) -> None:
    """State that nothing was missed, dropped or lost in a time [s]."""
    try:
        counts = count_on_wires(counted.wires, before, after, span[1] - span[0])
        losses, faults, missed = (
            sum(counter.between(before, after) for counter in counters)
            for counters in (counted.losses, counted.faults, (MISSED_TICKS,))
        )
    except LookupError as error:
        raise SessionError(str(error)) from error
    counts |= count_in_bag(run.recording(), *span)
    run.metrics["messages"] = {
        name: {"sent": count.sent, "received": count.received} for name, count in counts.items()
    }
    run.require("missed_ticks", missed, upper=0)
    run.require("peer_losses", losses, upper=0)
    run.require("messages_dropped", faults, upper=0)
    run.require("ways_counted", len(counts), lower=len(counted.wires) + 1)
    run.require("ways_unequal", sum(not count.equal for count in counts.values()), upper=0)


class _Operator:
    """Who keeps the sticks level, leads the robot round and looks at the processes.

    Attributes:
        samples: what was seen.
        plans: how many the planner has made.
    """

    def __init__(self, sample_period: float) -> None:
        self._sample_period = sample_period
        self.samples: list[Sample] = []
        self.plans = 0
        self._session: Session | None = None
        self._answer: Any = None
        self._joy = Pilot(0.0).joy()
        self._next_sample = 0.0
        self._reports: dict[str, tuple[int, dict[str, float]]] = {}

    def begin(self, session: Session, meter: ResourceMeter) -> None:
        """Take the radio."""
        self._meter = meter
        session.subscribe(DiagnosticArray, graph.DIAGNOSTICS, self._on_diagnostics)
        session.add_service(PlanCycle, graph.PLAN_CYCLE)
        session.joystick(*self._joy)
        self._session = session

    def advanced(self, time: float) -> None:
        """So much simulated time has passed [s]."""
        if self._session is None:
            return
        self._session.joystick(*self._joy)
        if time >= self._next_sample:
            self.samples.append(self._meter.look(time))
            self._next_sample = time + self._sample_period

    def fill_planner(self) -> None:
        """Let the planner make more plans than it remembers, while the robot stands."""
        session = self._session
        assert session is not None
        while self.plans < _PLANS:
            self._plan(session)
            session.advance(0.2)

    def go_round(self, end: float) -> int:
        """Go round after round until a time [s]; return how many."""
        session = self._session
        assert session is not None
        rounds = 0
        while session.time < end - 1e-6:
            for duration, share, velocity in _PASSAGES:
                left = end - session.time
                if left <= 0.0:
                    break
                session.set_parameter(graph.LOW_LEVEL_CONTROLLER, "assist.share", share)
                if velocity is None:
                    stop_walking(session)
                    session.advance(min(duration, left))
                else:
                    walk(session, min(duration, left), velocity)
                self._plan(session)
            rounds += 1
        self._finish_plan(session)
        return rounds

    def climb(self) -> bool:
        """Go to the slope, up, stand there, come down, go back to where the rounds began.

        Returns:
            Whether the robot is on its legs still.
        """
        session = self._session
        assert session is not None
        session.set_parameter(graph.LOW_LEVEL_CONTROLLER, "assist.share", 0.0)
        stop_walking(session)
        trot_to(session, (_COURSE.approach - Course.approach, 0.0), _WAY, _PACE)
        session.set_mode("wair", reached="wair", within=1.0)
        stands = (
            climb_onto(session, _COURSE, _SPEED)
            and go(session, _COURSE, _UP, _SPEED)
            and go(session, _COURSE, _REST, 0.0)
            and walk_down(session, _COURSE, -_SPEED)
            and go(session, _COURSE, _REST, 0.0)
        )
        if stands:
            session.set_mode("stand", reached="stand", within=3.0, patience=2.0)
            trot_to(session, (0.0, 0.0), _WAY, _PACE)
        return stands

    def _plan(self, session: Session) -> None:
        """Ask for a cycle that has not been planned yet; it is planned while the robot goes on."""
        self._finish_plan(session)
        request = PlanCycle.Request(
            slope=math.radians(5.0 + 7.0 * self.plans % 40.0),
            speed=0.2 + 1e-5 * self.plans,
            load_slope=0.35,
            thrust_mode="vector",
            thrust_limit=76.0,
        )
        self._answer = session.ask(graph.PLAN_CYCLE, request)

    def _finish_plan(self, session: Session) -> None:
        """Wait for the plan that was asked for."""
        answer = self._answer
        if answer is None:
            return
        session.wait_for(answer.done, "a plan")
        response = answer.result()
        if not response.success:
            raise SessionError(f"{graph.absolute(graph.PLAN_CYCLE)}: {response.message}")
        self.plans += 1

    def read_counters(self, names: Collection[str]) -> dict[str, dict[str, float]]:
        """Return the numbers of some nodes' reports, all of this very time."""
        session = self._session
        assert session is not None
        self._reports.clear()
        # The first that comes may have been sent before the world stood still.
        session.wait_for(
            lambda: all(self._reports.get(name, (0, {}))[0] >= 2 for name in names),
            f"two reports of {', '.join(sorted(names))}",
        )
        return {name: values for name, (_, values) in self._reports.items()}

    def _on_diagnostics(self, report: DiagnosticArray) -> None:
        for status in report.status:
            values: dict[str, float] = {}
            for entry in status.values:
                try:
                    values[entry.key] = float(entry.value)
                except ValueError:
                    continue
            count = self._reports.get(status.name, (0, values))[0]
            self._reports[status.name] = (count + 1, values)


def _groups(session: Session) -> dict[str, int]:
    return {spec.name: session.processes.process_group(spec.name) for spec in session.specs}
