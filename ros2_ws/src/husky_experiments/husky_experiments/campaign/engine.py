"""Carry out a campaign: which runs are left, on which workers, and what stays of them."""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
import subprocess
import sys
from collections.abc import Collection, Iterator, Mapping
from multiprocessing import current_process
from pathlib import Path
from typing import Any

import pandas as pd
import psutil
from distributed import Client, Future, LocalCluster, as_completed
from tqdm import tqdm

from husky_experiments.campaign.campaign_file import (
    Campaign,
    CampaignError,
    PlannedRun,
    read_campaign,
)
from husky_experiments.campaign.execution import (
    CancelledRunError,
    Record,
    execute,
    make_record,
    read_record,
    remove_data,
    wait_for_end,
)
from husky_experiments.campaign.report import write_report
from husky_runtime import record_lock

_MEMORY_OF_RUN = 1.5e9
"""Memory that a graph with its recording and its figures needs [bytes]."""
_CONNECTING = 30.0
"""Wall time within which a scheduler must answer [s]."""
_LOCK_FILE = ".campaign"
_OWN_FILES = ("runs", "figures", "replay")
_LEAVE_INTERRUPTS = "import signal; signal.signal(signal.SIGINT, lambda *_: None)"
"""For workers of this machine: Ctrl-C at the terminal reaches them too, but the campaign ends them.
"""
DISK_LIMIT = 10.0
"""Room for the bags, videos and figures that stay, by default [GB]."""


def run(
    source: Path | str | Mapping[str, Any],
    *,
    output: Path | str | None = None,
    workers: int | None = None,
    scheduler: Any = None,
    again: bool = False,
    disk: float = DISK_LIMIT,
    quiet: bool = False,
) -> pd.DataFrame:
    """Carry out a campaign and return its table, one row a run, also written to `output`.

    Runs that an earlier call has finished are not run again. A program that calls this guards its
    main module (`if __name__ == "__main__":`), as all that start Python processes.

    Args:
        source: a campaign file, or a mapping with its keys.
        output: directory of the results; by default `out/campaigns/` and the file's name.
        workers: runs at a time on this machine; by default as many as it carries.
        scheduler: address of a Dask scheduler, or a cluster of `dask_jobqueue`, to use instead.
        again: forget the results of an earlier call.
        disk: room for bags, videos and figures that stay [GB].
        quiet: print nothing.

    Raises:
        CampaignError: the campaign cannot be run as it is written.
        BlockingIOError: another campaign writes into the directory.
        OSError: the directory cannot be written, or a worker does not see it.
    """
    _check_call(workers, scheduler, disk)
    campaign = read_campaign(source)
    directory = output_of(source, output)
    with reserved(directory):
        records = {} if again else _finished(campaign, directory)
        _say(quiet, f"{campaign.title}: {len(campaign.runs)} runs, {len(records)} done before")
        version = _source_version()
        if other := {record["version"] for record in records.values()} - {version}:
            _say(quiet, f"note: {', '.join(sorted(other))} made some; --again runs all anew")
        left = [each for each in campaign.runs if each.row not in records]
        budget = _DiskBudget(directory, {each.name for each in left}, disk)
        try:
            if left:
                with _connected(scheduler, workers or _workers_for(len(left)), directory) as client:
                    if again:
                        _clear(directory)
                    _keep_source(source, directory)
                    if not client.scheduler_info()["workers"]:
                        _say(quiet, "the scheduler has no workers yet: waiting")
                    for row, record in _carry_out(
                        campaign, left, directory, version, client, quiet
                    ):
                        records[row] = record
                        budget.enforce(directory / "runs" / campaign.runs[row].name, record)
        finally:
            table = write_report(campaign, records, directory)
        _say(quiet, budget.statement())
        if unknown := [name for name in campaign.metrics if name not in table.columns]:
            _say(quiet, f"note: no run has the metrics {', '.join(unknown)}")
        return table


def _check_call(workers: int | None, scheduler: Any, disk: float) -> None:
    """Raise CampaignError for arguments of `run` that are not allowed, or an unguarded call."""
    if getattr(current_process(), "_inheriting", False):
        raise CampaignError('guard the main module: if __name__ == "__main__": campaign.run(...)')
    if workers is not None and (workers < 1 or scheduler is not None):
        raise CampaignError(f"workers: {workers} is not 1 or more, or a scheduler is given too")
    if not disk >= 0.0:
        raise CampaignError(f"disk: {disk} is no size of 0 or more [GB]")


def output_of(source: Path | str | Mapping[str, Any], output: Path | str | None) -> Path:
    """Return the absolute directory of a campaign's results."""
    if output is None:
        name = "campaign" if isinstance(source, Mapping) else Path(source).stem
        output = Path("out") / "campaigns" / name
    return Path(output).absolute()


def _source_version() -> str:
    """Return the version of the source tree, as git describes it."""
    command = ["git", "-C", os.environ["HUSKY_ROOT"], "describe", "--always", "--dirty", "--tags"]
    with contextlib.suppress(OSError, subprocess.CalledProcessError):
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
    return "unknown"


# Runs -------------------------------------------------------------------------------------------
def _finished(campaign: Campaign, directory: Path) -> dict[int, Record]:
    """Return the records of runs that are done, by row; directories follow an edited file."""
    records = {}
    earlier = {place.name.rpartition("-")[2]: place for place in directory.glob("runs/*-*")}
    for each in campaign.runs:
        place = directory / "runs" / each.name
        if not place.exists() and each.key in earlier:
            earlier[each.key].rename(place)
        if (record := read_record(place)) is not None:
            records[each.row] = record
    return records


def _carry_out(
    campaign: Campaign,
    left: list[PlannedRun],
    directory: Path,
    version: str,
    client: Client,
    quiet: bool,
) -> Iterator[tuple[int, Record]]:
    """Yield row and record of each run as it ends."""
    # Keys of one group: Dask keeps such tasks until a worker is free, and knows how long they take.
    group = f"runs of {directory}"
    futures: dict[Future[Record], PlannedRun] = {
        client.submit(
            execute, each, directory, campaign.policy, version, key=(group, each.name), pure=False
        ): each
        for each in left
    }
    failed = 0
    with tqdm(
        total=len(campaign.runs),
        initial=len(campaign.runs) - len(left),
        desc="runs",
        disable=quiet,
        file=sys.stderr,
        dynamic_ncols=True,
        mininterval=0.5 if sys.stderr.isatty() else 30.0,
    ) as bar:
        ended = as_completed(futures, loop=client.loop)
        for future in ended:
            if future.status == "error" and isinstance(future.exception(), CancelledRunError):
                # Its worker was told to close.
                future.retry()
                ended.add(future)
                continue
            planned = futures[future]
            record = _outcome(future, planned, version)
            ok = record["attempts"][-1]["ok"]
            failed += not ok
            if not ok:
                bar.write(f"row {planned.row} failed: {planned.label}", file=sys.stderr)
            bar.set_postfix(failed=failed, refresh=False)
            bar.update()
            future.release()
            yield planned.row, record


def _outcome(future: Future[Record], planned: PlannedRun, version: str) -> Record:
    """Return the record of a run; one that has ended several workers has none of its own."""
    if future.cancelled():
        raise ConnectionError("the scheduler has gone; the same command goes on with what is left")
    error = future.exception()
    if error is None:
        return dict(future.result())
    if isinstance(error, OSError):
        raise error
    attempt = {"directory": "", "ok": False, "error": f"{type(error).__name__}: {error}"}
    attempt |= {"wall_s": 0.0, "metrics": {}, "criteria": {}}
    return make_record(planned, version, "", [attempt])


# Workers ----------------------------------------------------------------------------------------
def _workers_for(runs: int) -> int:
    """Return how many runs this machine carries at a time."""
    by_memory = int(psutil.virtual_memory().available / _MEMORY_OF_RUN)
    return max(1, min(runs, len(os.sched_getaffinity(0)), by_memory))


def local_cluster(workers: int) -> LocalCluster:
    """Return a scheduler with so many workers on this machine; close it at the end."""
    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        memory_limit=0,  # it would count the worker alone, not the graph below it
        dashboard_address=":0",
        silence_logs=logging.CRITICAL,
        preload=_LEAVE_INTERRUPTS,
    )


@contextlib.contextmanager
def _connected(scheduler: Any, workers: int, directory: Path) -> Iterator[Client]:
    """Connect to a scheduler; without one, start one with workers, and end them with all runs."""
    with contextlib.ExitStack() as ends:
        ends.callback(wait_for_end, directory)
        if scheduler is None:
            scheduler = ends.enter_context(local_cluster(workers))
        try:
            client = Client(scheduler, timeout=_CONNECTING, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise CampaignError(f"no Dask scheduler answers at {scheduler}: {error}") from error
        yield ends.enter_context(client)


# Files ------------------------------------------------------------------------------------------
@contextlib.contextmanager
def reserved(directory: Path) -> Iterator[None]:
    """Make and hold the directory of a campaign."""
    directory.mkdir(parents=True, exist_ok=True)
    if any(directory.iterdir()) and not (directory / _LOCK_FILE).exists():
        raise CampaignError(f"{directory} holds something else than a campaign")
    with (directory / _LOCK_FILE).open("a") as lock:
        if not record_lock.try_take(lock.fileno()):
            raise BlockingIOError(f"another campaign writes into {directory}")
        yield


def _clear(directory: Path) -> None:
    """Remove the results of earlier calls."""
    for name in _OWN_FILES:
        shutil.rmtree(directory / name, ignore_errors=True)


def _keep_source(source: Path | str | Mapping[str, Any], directory: Path) -> None:
    """Keep a copy of the campaign beside its results."""
    if not isinstance(source, Mapping) and Path(source).resolve() != directory / "campaign.yaml":
        shutil.copyfile(source, directory / "campaign.yaml")


class _DiskBudget:
    """Disk space of the results that stay, and its limit."""

    def __init__(self, directory: Path, left: Collection[str], limit: float):
        """Count the results that are there.

        Args:
            directory: of the campaign.
            left: names of runs that are still to be done, and counted when they are.
            limit: [GB].
        """
        self._limit = limit
        done = (each for each in directory.glob("runs/*") if each.name not in left)
        self._used = sum(_size(each) for each in done)
        self._dropped = 0

    def enforce(self, place: Path, record: Record) -> None:
        """Count the results of a run; beyond the limit its bag, video and figures go."""
        size = _size(place)
        if self._used + size > self._limit * 1e9:
            for attempt in record["attempts"]:
                remove_data(place / attempt["directory"])
            self._dropped += 1
            size = _size(place)
        self._used += size

    def statement(self) -> str:
        """Return how much is used, and what had no room."""
        text = f"disk: {self._used / 1e6:.1f} MB of {self._limit:g} GB"
        return f"{text}; beyond it {self._dropped} runs keep no data" if self._dropped else text


def _size(directory: Path) -> int:
    """Return the bytes of all files below a directory, but of those that vanish meanwhile."""
    found = 0
    for each in directory.rglob("*"):
        with contextlib.suppress(OSError):
            found += each.lstat().st_size if each.is_file() else 0
    return found


def _say(quiet: bool, text: str) -> None:
    if not quiet:
        print(text, file=sys.stderr, flush=True)
