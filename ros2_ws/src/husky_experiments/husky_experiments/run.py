"""One run of an experiment: its output directory, metrics, criteria and result line."""

from __future__ import annotations

import argparse
import copy
import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from husky_bringup.settings import collect
from husky_bringup.system import ParameterValue, simulated_robot
from husky_description.robot import ROBOTS, Robot, load_robot
from husky_description.sections import SOFTEST_FRAME
from husky_experiments.output_directory import OutputDirectory
from husky_experiments.recordings.recording import Recording
from husky_experiments.session import Session, SessionError
from husky_runtime import graph
from husky_runtime.stored_file import write_atomically

SCENE_FILE = "scene.xml"
"""The world of a recording, saved by the plant beside the bag."""
RESULT_FILE = "result.json"
"""The file that a run ends with."""
_GRACE = 10.0
"""Wall time for which nodes wait for each other [s]: an experiment is no test of a busy machine."""
_WAITING = (
    graph.PLANT,
    *graph.JOINT_BRIDGES,
    graph.DRIVE_SEGMENT,
    graph.LOW_LEVEL_CONTROLLER,
    graph.FLIGHT_CONTROLLER,
    graph.PIXHAWK_BRIDGE,
)
"""The nodes that have a parameter `grace`."""


def frame_frequency(text: str) -> float:
    """Read the eigenfrequency of a frame [Hz]; raises ArgumentTypeError with what is allowed."""
    try:
        return load_robot(frame__frequency=float(text)).frame.frequency
    except ValueError as error:
        allowed = f"{text} is not allowed: 0 for a stiff frame, or {SOFTEST_FRAME:g} to 40 Hz"
        raise argparse.ArgumentTypeError(allowed) from error


class Run:
    """An experiment fills it; at its end, as a context, the directory of results is in order.

    Attributes:
        options: the parsed command line.
        results: directory of everything that the run leaves.
        output: where it writes until it is over, a subdirectory of `results`.
        metrics: what was measured; ends up in `result.json`.
        criteria: what had to hold, by name: `{"value", "bound", "ok"}`.
    """

    def __init__(self, name: str, options: argparse.Namespace):
        """Make an empty directory to write into.

        Raises:
            FileExistsError: it holds something else than an earlier run.
            OSError: it cannot be made.
        """
        self.name = name
        self.options = options
        self.results: Path = options.output
        self.metrics: dict[str, Any] = {}
        self.criteria: dict[str, dict[str, Any]] = {}
        self._progress = Progress()
        self._hints: tuple[str, ...] = ()
        self._robot = ROBOTS[0]
        self._started = time.monotonic()
        self._simulated = 0.0
        self._directory = OutputDirectory(self.results)
        self.output = self._directory.work
        if self._directory.notice:
            self.say(self._directory.notice)

    def __enter__(self) -> Run:
        """Return itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Leave the directory of results with what was written, or as it was."""
        self._leave()

    def part(self, label: str, options: argparse.Namespace) -> Run:
        """Return another experiment as a part of this one, with criteria and metrics of its own.

        Args:
            label: subdirectory of the output for its results.
            options: of its own; this run's options stand in for all others.
        """
        part = copy.copy(self)
        part.options = argparse.Namespace(**(vars(self.options) | vars(options)))
        part.output = self.output / label
        part.metrics, part.criteria = {}, {}
        return part

    # The graph ------------------------------------------------------------------------------
    @contextmanager
    def session(
        self,
        settings: Mapping[str, Mapping[str, ParameterValue]] | None = None,
        *,
        label: str = "",
        expected: float = 0.0,
        record: bool = True,
        remote: bool = False,
        on_advance: Callable[[float], None] | None = None,
    ) -> Iterator[Session]:
        """Start the graph in lockstep; the digest of a session that is recorded is a metric.

        Args:
            settings: parameters by node name.
            label: subdirectory of the output for one of several sessions.
            expected: simulated time that the session will take [s], for the progress bar.
            record: whether to record a bag.
            remote: whether the remote control takes part.
            on_advance: called with the simulated time [s] every 0.2 s of it.
        """
        directory = self.output / label
        directory.mkdir(parents=True, exist_ok=True)
        chosen = {node: dict(values) for node, values in (settings or {}).items()}
        for node, values in collect(self.options.set).items():
            chosen.setdefault(node, {}).update(values)
        plant = chosen.setdefault(graph.PLANT, {})
        if self.options.compliance is not None:
            plant["frame_frequency"] = float(self.options.compliance)
        if self.options.bus is not None:
            plant["bus"] = self.options.bus
        self._robot = str(plant.get("robot", ROBOTS[0]))
        plant["save_scene"] = str((directory / SCENE_FILE).resolve())
        try:
            specs = simulated_robot("lockstep", chosen, None, remote)
        except ValueError as error:
            raise SessionError(str(error)) from error
        for spec in specs:
            if spec.name in _WAITING:
                chosen.setdefault(spec.name, {}).setdefault("grace", _GRACE)
        self.say(f"starting the graph{f' ({label})' if label else ''}")
        self._progress.begin(expected)

        def advanced(simulated: float) -> None:
            self._progress.at(simulated)
            if on_advance is not None:
                on_advance(simulated)

        where = directory.resolve()
        with Session(where, chosen, record=record, on_advance=advanced, remote=remote) as session:
            self._directory.begun()
            yield session
        if record:
            self.metrics["trajectory_sha256"] = session.trajectory_sha256

    def say(self, text: str) -> None:
        """Print a line of progress."""
        self._progress.line(f"[{time.monotonic() - self._started:6.1f} s] {text}")

    # Results --------------------------------------------------------------------------------
    def recording(self, label: str = "") -> Recording:
        """Open the bag of a session that has ended.

        Raises:
            SessionError: it is not whole, and nothing can be judged by it.
        """
        recording = Recording(self.output / label / "bag")
        if recording.damage:
            raise SessionError(f"the recording is not whole: {recording.damage}")
        return recording

    def robot(self) -> Robot:
        """Return the numbers of the robot of the last session, of the default one before any."""
        return load_robot(self._robot)

    def illustrate(self, label: str = "") -> None:
        """Draw the figures and render the video of a session that has ended."""
        directory = self.output / label
        recording = self.recording(label)
        if not self.options.no_figures:
            from husky_experiments.figures import figures

            self.say("drawing figures")
            figures.make_all(recording, self.robot(), directory / "figures")
        if not self.options.no_video:
            from husky_experiments.figures import video

            self.say("rendering video")
            model = video.load_scene(directory / SCENE_FILE)
            result = video.render(recording, model, directory / "video.mp4")
            if result is None:
                self.say(video.unavailable_reason())

    def require(
        self,
        name: str,
        value: float | None = None,
        *,
        lower: float | None = None,
        upper: float | None = None,
    ) -> bool:
        """State a criterion: `lower <= value <= upper`; a value that is not a number fails.

        The value is the metric of that name where none is given. Return whether it holds.
        """
        value = self.metrics[name] if value is None else value
        ok = value is not None and math.isfinite(value)
        bounds = []
        if lower is not None:
            ok = ok and value >= lower
            bounds.append(f">= {lower:g}")
        if upper is not None:
            ok = ok and value <= upper
            bounds.append(f"<= {upper:g}")
        self.criteria[name] = {"value": _plain(value), "bound": " and ".join(bounds), "ok": ok}
        return ok

    def hint(self, *lines: str) -> None:
        """Say at the end where things are and what to try next."""
        self._hints = lines

    def fail(self, reason: str) -> None:
        """The experiment could not be carried through."""
        self.metrics["error"] = reason
        self.criteria["carried_through"] = {"value": 0, "bound": ">= 1", "ok": False}
        self._progress.line(f"failed: {reason}")

    @property
    def ok(self) -> bool:
        """True when every criterion holds, and there is one."""
        return bool(self.criteria) and all(entry["ok"] for entry in self.criteria.values())

    def finish(self) -> int:
        """Write `result.json`, print it as the last line, return the exit code."""
        ok = self.ok
        self._progress.end()
        for name, entry in self.criteria.items():
            mark = "ok  " if entry["ok"] else "FAIL"
            value = entry["value"]
            shown = f"{value:.4g}" if isinstance(value, int | float) else str(value)
            print(f"  {mark} {name} = {shown} ({entry['bound']})")
        result = {
            "experiment": self.name,
            "ok": ok,
            "metrics": {key: _plain(value) for key, value in self.metrics.items()},
            "criteria": self.criteria,
        }
        try:
            text = json.dumps(result, indent=2) + "\n"
            write_atomically(self.output / RESULT_FILE, text.encode())
        except OSError as error:
            ok = False
            print(f"error: {self.output / RESULT_FILE}: {error.strerror}", file=sys.stderr)
        if not self._leave():
            ok = False
        elif self._directory.as_it_was:
            print(f"{self.results}/ is as it was")
        else:
            print(f"results in {self.results}/")
        for line in self._hints:
            print(line)
        print(json.dumps(result), flush=True)
        return 0 if ok else 1

    def _leave(self) -> bool:
        """Leave the directory of results; return whether that could be done, or say why not."""
        try:
            self._directory.leave()
        except OSError as error:
            place = error.filename2 or error.filename or self.results
            print(f"error: {place}: {error.strerror}", file=sys.stderr)
            return False
        return True


def _plain(value: Any) -> Any:
    """Make a value JSON-able: NumPy numbers to Python's, what is not finite to null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, bool | str) or value is None:
        return value
    number = float(value)
    if not math.isfinite(number):
        return None
    return int(number) if isinstance(value, int) else round(number, 6)


class Progress:
    """A progress bar on a terminal, a line now and then elsewhere."""

    def __init__(self) -> None:
        self._terminal = sys.stdout.isatty()
        self._expected = 0.0
        self._next_line = 0.0
        self._open = False

    def begin(self, expected: float) -> None:
        """A session of so much simulated time [s] starts."""
        self._expected = expected
        self._next_line = 0.0
        self._wall = time.monotonic()

    def at(self, simulated: float) -> None:
        """So much simulated time [s] has passed."""
        pace = simulated / max(1e-3, time.monotonic() - self._wall)
        share = min(1.0, simulated / self._expected) if self._expected > 0 else 0.0
        if self._terminal:
            bar = "#" * int(30 * share)
            print(
                f"\r  [{bar:<30}] {simulated:6.1f} s simulated, {pace:4.2f}x real time",
                end="",
                flush=True,
            )
            self._open = True
        elif simulated >= self._next_line:
            print(f"  {simulated:6.1f} s simulated, {pace:4.2f}x real time", flush=True)
            self._next_line = simulated + max(5.0, self._expected / 10)

    def line(self, text: str) -> None:
        """Print a line of its own."""
        self.end()
        print(text, flush=True)

    def end(self) -> None:
        """Leave the bar."""
        if self._open:
            print(flush=True)
            self._open = False
