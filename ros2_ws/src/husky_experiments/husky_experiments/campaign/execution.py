"""One run of a campaign, on the worker: a process graph in a ROS domain of its own.

The run is the command that you would type, `scripts/experiment.sh NAME ...`. Its `record.json` is
written last and whole: a run with a record is done. When a worker ends, its run's processes end
too, and the run, without a record, starts again.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from distributed import Status, get_worker

from husky_bringup import fork_server
from husky_experiments.campaign.campaign_file import PlannedRun, Policy
from husky_experiments.run import RESULT_FILE
from husky_runtime import record_lock, starter
from husky_runtime.domain_locks import free_domain
from husky_runtime.stored_file import write_atomically

RECORD_FILE = "record.json"
"""Record of a run: its options, every attempt with its results, host and wall time."""
_LOCK_FILE = ".lock"
_LOOK_PERIOD, _LOCK_PERIOD = 0.1, 0.5
"""Wall time between two looks at a run, and at a lock [s]."""
_ENDING = 20.0
"""Wall time that an experiment gets to end its nodes when it is asked to [s]."""
_DATA = ("bag", "video.mp4", "figures")
"""Large results of an attempt."""
_LAST_LINES = 5

Record = dict[str, Any]


class CancelledRunError(RuntimeError):
    """The campaign has been ended, and the run with it."""


def execute(run: PlannedRun, directory: Path, policy: Policy, version: str) -> Record:
    """Carry out a run, unless it has been; return its record.

    A run that fails is tried once more, with video and figures.

    Args:
        run: to carry out.
        directory: of the campaign, which all workers share.
        policy: rules for retries, data and time.
        version: of the source tree, for the record.

    Raises:
        FileNotFoundError: this machine does not see the directory.
        CancelledRunError: the campaign has been ended.
    """
    if not directory.is_dir():
        raise FileNotFoundError(
            f"worker {platform.node()} does not see {directory}: "
            "the workers of a campaign share the file system of its output"
        )
    place = directory / "runs" / run.name
    place.mkdir(parents=True, exist_ok=True)
    check = _cancellation()
    with _locked(place / _LOCK_FILE, check) as lock:
        if (record := read_record(place)) is not None:
            return record
        for left in place.glob("attempt_*"):
            _remove(left)
        attempts: list[Record] = []
        while not attempts or (len(attempts) == 1 and _retries(policy, attempts[0])):
            illustrated = policy.keep == "all" or bool(attempts)
            output = place / f"attempt_{len(attempts) + 1}"
            attempts.append(_attempt(run, output, illustrated, policy.timeout, lock, check))
        for attempt in attempts:
            if not _keeps(policy, attempt):
                remove_data(place / attempt["directory"])
        record = make_record(run, version, platform.node(), attempts)
        write_atomically(place / RECORD_FILE, json.dumps(record, indent=2).encode())
        return record


def make_record(run: PlannedRun, version: str, host: str, attempts: list[Record]) -> Record:
    """Return the record of a run.

    Args:
        run: that is done.
        version: of the source tree.
        host: machine that it ran on.
        attempts: its attempts, one or two.
    """
    return {
        "experiment": run.experiment,
        "options": dict(run.options),
        "command": run.command,
        "version": version,
        "host": host,
        "attempts": attempts,
    }


def read_record(place: Path) -> Record | None:
    """Return the record of a run that is done, else None."""
    with contextlib.suppress(OSError, ValueError, LookupError, TypeError):
        record: Record = json.loads((place / RECORD_FILE).read_text("utf-8"))
        last = record["attempts"][-1]
        if {"host", "version"} <= record.keys() and {"ok", "metrics", "criteria"} <= last.keys():
            return record
    return None


def _remove(left: Path) -> None:
    """Remove files of an attempt whose worker was killed; its nodes may write a little longer."""
    end = time.monotonic() + _ENDING
    while left.exists():
        try:
            shutil.rmtree(left) if left.is_dir() else left.unlink()
        except OSError:
            if time.monotonic() > end:
                raise
            time.sleep(_LOCK_PERIOD)


def remove_data(directory: Path) -> None:
    """Remove bag, video and figures of an attempt, those of its sessions as well."""
    for name in _DATA:
        for each in list(directory.rglob(name)):
            shutil.rmtree(each) if each.is_dir() else each.unlink(missing_ok=True)


def wait_for_end(directory: Path, within: float = _ENDING) -> None:
    """Wait until no run of a campaign is under way any more, as long as that may take [s]."""
    end = time.monotonic() + within
    for lock in directory.glob(f"runs/*/{_LOCK_FILE}"):
        with lock.open("a") as file:
            while not record_lock.try_take(file.fileno()) and time.monotonic() < end:
                time.sleep(_LOOK_PERIOD)


# An attempt -------------------------------------------------------------------------------------
def start_experiment(
    run: PlannedRun,
    output: Path,
    domain: int,
    *,
    illustrated: bool,
    server: str = "",
    **process: Any,
) -> subprocess.Popen[bytes]:
    """Start the experiment of a run in a ROS domain, unheard by other machines.

    Args:
        run: to start.
        output: directory of its results.
        domain: for its graph.
        illustrated: with video and figures.
        server: socket of the server that its nodes come from, if any.
        process: more arguments of `subprocess.Popen`.
    """
    script = Path(os.environ["HUSKY_ROOT"]) / "scripts" / "experiment.sh"
    command = [str(script), run.experiment, *run.arguments, f"--output={output}"]
    if not illustrated:
        command += ["--no-video", "--no-figures"]
    environment = os.environ | {
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        starter.VARIABLE: starter.identity(),
        fork_server.VARIABLE: server,
    }
    return subprocess.Popen(command, env=environment, **process)


def _retries(policy: Policy, attempt: Record) -> bool:
    """Return whether a run is tried again after this attempt."""
    if attempt["ok"] or policy.retry == "never":
        return False
    return policy.retry == "failed" or attempt["error"] != ""


def _keeps(policy: Policy, attempt: Record) -> bool:
    """Return whether bag, video and figures of an attempt stay."""
    return policy.keep == "all" or (policy.keep == "failed" and not attempt["ok"])


def _attempt(
    run: PlannedRun,
    output: Path,
    illustrated: bool,
    timeout: float,
    lock: int,
    check: Callable[[], None],
) -> Record:
    """Run the experiment; return its outcome.

    Args:
        run: to carry out.
        output: directory of its results; what it prints goes to a file beside it.
        illustrated: with video and figures.
        timeout: wall time after which it is ended [s].
        lock: descriptor that the experiment holds for as long as it lives.
        check: raises CancelledRunError when the campaign has been ended.
    """
    printed = output.with_suffix(".txt")
    begun = time.monotonic()
    # Of this thread and all that it starts: graphs share the processors best where a process that
    # wakes does not interrupt another.
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    with free_domain() as domain, printed.open("w") as file:
        process = start_experiment(
            run,
            output,
            domain,
            illustrated=illustrated,
            server=_fork_server(),
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            pass_fds=(lock,),
            start_new_session=True,  # Ctrl-C reaches the campaign alone, which ends its runs
        )
        try:
            late = not _wait(process, begun + timeout, check)
        finally:
            _end(process)
    result = read_result(output)
    error = result["metrics"].get("error", "")
    if late:
        error = f"ended after {timeout:g} s of wall time"
    elif "experiment" not in result:
        error = f"exit code {process.returncode}: {_last_lines(printed)}"
    return {
        "directory": output.name,
        "ok": process.returncode == 0 and not error,
        "error": error,
        "wall_s": round(time.monotonic() - begun, 2),
        "metrics": result["metrics"],
        "criteria": result["criteria"],
    }


def _wait(process: subprocess.Popen[bytes], deadline: float, check: Callable[[], None]) -> bool:
    """Wait until a process has ended; return whether it has by the deadline."""
    while time.monotonic() < deadline:
        check()
        try:
            process.wait(_LOOK_PERIOD)
        except subprocess.TimeoutExpired:
            continue
        return True
    return False


def _end(process: subprocess.Popen[bytes]) -> None:
    """End an experiment with its nodes; does nothing when it has ended."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(_ENDING)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def read_result(output: Path) -> Record:
    """Return `result.json` of an attempt, or one without metrics."""
    with contextlib.suppress(OSError, ValueError):
        result = json.loads((output / RESULT_FILE).read_text("utf-8"))
        if isinstance(result, dict) and {"experiment", "metrics", "criteria"} <= result.keys():
            return result
    return {"metrics": {}, "criteria": {}}


def _last_lines(log: Path) -> str:
    """Return the end of an experiment's output."""
    lines = log.read_text("utf-8", "replace").splitlines()
    return " | ".join(line.strip() for line in lines[-_LAST_LINES:] if line.strip())


# The worker -------------------------------------------------------------------------------------
_servers: list[fork_server.ForkServer] = []
"""The one of this worker, once there is one."""


def _fork_server() -> str:
    """Return the address of this worker's server of nodes, which ends with the worker."""
    if not _servers or not _servers[0].running:
        _servers[:] = [fork_server.ForkServer()]
    return _servers[0].address


def _cancellation() -> Callable[[], None]:
    """Return a function that raises CancelledRunError once this task is no longer wanted.

    Dask does not interrupt a task that runs: whoever has asked for it may have gone, or the worker
    may be about to close.
    """
    worker = get_worker()
    key = worker.get_current_task()

    def check() -> None:
        task = worker.state.tasks.get(key)
        wanted = task is not None and task.state in ("executing", "long-running")
        if not wanted or worker.status in (Status.closing, Status.closed, Status.failed):
            raise CancelledRunError(f"{key} was cancelled")

    return check


@contextlib.contextmanager
def _locked(path: Path, check: Callable[[], None]) -> Iterator[int]:
    """Hold the lock of a run, as soon as an attempt that has lost its worker is over."""
    with path.open("a") as file:
        while not record_lock.try_take(file.fileno()):
            check()
            time.sleep(_LOCK_PERIOD)
        yield file.fileno()
