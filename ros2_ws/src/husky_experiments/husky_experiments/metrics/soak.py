"""What a soak is judged by: whether what the processes hold has grown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from husky_experiments.metrics.resources import Sample


@dataclass(frozen=True)
class Growths:
    """How much has grown from the first to the last quarter of a time, see `growth`."""

    memory: dict[str, float]  # of each node [bytes]
    descriptors: dict[str, float]  # of each node
    threads: dict[str, float]  # of each node
    shared_entries: float  # files of /dev/shm
    shared_bytes: float  # that these take
    log_rate: float  # of all log files [bytes per minute of wall time]
    minutes: float  # simulated, that were judged


def growth(values: Sequence[float]) -> float:
    """Return the median of the last quarter less that of the first.

    A leak, however slow, parts the two; memory that is used for a moment does not.
    """
    quarter = max(1, len(values) // 4)
    return float(np.median(values[-quarter:]) - np.median(values[:quarter]))


def growths(samples: Sequence[Sample], begin: float) -> Growths:
    """Judge the samples from a time on [s].

    Raises:
        ValueError: fewer than 2 samples, or a node that is missing in one.
    """
    kept = [sample for sample in samples if sample.time >= begin]
    if len(kept) < 2:
        raise ValueError(f"{len(kept)} samples after {begin:g} s, there must be 2 or more")
    names = sorted(set().union(*(sample.nodes for sample in kept)))
    for sample in kept:
        if missing := [name for name in names if name not in sample.nodes]:
            raise ValueError(f"no process of {', '.join(missing)} at {sample.time:g} s")

    def each(value: Callable[[Sample, str], float]) -> dict[str, float]:
        return {name: growth([value(sample, name) for sample in kept]) for name in names}

    first, last = kept[0], kept[-1]
    return Growths(
        memory=each(lambda sample, name: sample.nodes[name].memory),
        descriptors=each(lambda sample, name: sample.nodes[name].descriptors),
        threads=each(lambda sample, name: sample.nodes[name].threads),
        shared_entries=growth([sample.shared_entries for sample in kept]),
        shared_bytes=growth([sample.shared_bytes for sample in kept]),
        log_rate=60.0 * (last.log_bytes - first.log_bytes) / (last.wall - first.wall),
        minutes=(last.time - first.time) / 60.0,
    )


MEMORY_LIMIT = 1.0e6
"""Growth of a node's memory in ten simulated minutes, or in less of them [bytes]: the steps of the
allocator. Four bytes leaked in each tick would be more."""
SHARED_LIMIT = 1.0e5
"""Growth of what the files in /dev/shm take [bytes]: rings whose last pages are touched late."""
LOG_LIMIT = 6.0e3
"""Growth of the log files [bytes per minute]: three devices that change their state all the time
(`LogBudget`), each line of 100 bytes in the node's log and in that of ROS."""


def judged(grown: Growths) -> dict[str, tuple[float, float]]:
    """Return what is judged and its upper limit, by the name of the criterion."""
    memory = MEMORY_LIMIT * max(1.0, grown.minutes / 10.0)
    return {
        "memory_growth_mb_worst": (max(grown.memory.values()) / 1e6, memory / 1e6),
        "descriptors_growth_worst": (max(grown.descriptors.values()), 0.0),
        "threads_growth_worst": (max(grown.threads.values()), 0.0),
        "shared_memory_entries_growth": (grown.shared_entries, 0.0),
        "shared_memory_growth_mb": (grown.shared_bytes / 1e6, SHARED_LIMIT / 1e6),
        "log_kb_per_minute": (grown.log_rate / 1e3, LOG_LIMIT / 1e3),
    }
